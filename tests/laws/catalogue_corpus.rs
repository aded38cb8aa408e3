//! The seeds of the fuzz targets, and the inputs with which fuzzing found a fault: every reader answers each of them, in time.

use crate::catalogue_images::{deflated, exr, header, png};
use std::io::Cursor;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use twopass::load::fuzz;

fn folder(kind: &str, target: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "tests/fuzz", kind, target].iter().collect()
}

/// The inputs of a target: its seeds, and what once was a fault.
fn inputs(target: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let files = ["seeds", "found"].into_iter().filter_map(|kind| std::fs::read_dir(folder(kind, target)).ok()).flatten();
    let mut paths: Vec<PathBuf> = files.map(|e| e.expect("readable").path()).collect();
    paths.sort();
    paths.into_iter().map(|p| (p.clone(), std::fs::read(p).expect("readable"))).collect()
}

fn replay(target: &str, read: impl Fn(&[u8]) -> bool) {
    let (mut accepted, mut bytes) = (0, 0);
    let inputs = inputs(target);
    for (path, input) in &inputs {
        let timed = || {
            let start = Instant::now();
            (read(input), start.elapsed())
        };
        // Other work may run beside this: an input that is slow by itself is slow each time.
        let tries = [timed(), timed(), timed()];
        let least = tries.iter().map(|t| t.1).min().expect("three");
        assert!(least < Duration::from_secs(1), "{} took {least:?}", path.display());
        assert!(tries.iter().all(|t| t.0 == tries[0].0), "{} is accepted now and then", path.display());
        accepted += usize::from(tries[0].0);
        bytes += input.len();
    }
    // Seeds that are all refused, or all accepted, would lead a fuzzer nowhere.
    assert!(accepted > 0 && accepted < inputs.len(), "{target}: {accepted} of {} accepted", inputs.len());
    assert!(bytes < 60_000, "{target}: {bytes} bytes");
}

#[test]
fn the_corpus_of_each_reader_is_answered() {
    replay("xml", fuzz::xml);
    replay("obj", fuzz::obj);
    replay("ply", fuzz::ply);
    replay("serialized", fuzz::serialized);
    replay("image", fuzz::image);
    let folder = tempfile::tempdir().expect("a temporary folder");
    replay("scene", |bytes| fuzz::scene(bytes, folder.path()));
    replay("model", |bytes| fuzz::model(bytes, folder.path()));
    replay("gltf", |bytes| fuzz::gltf(bytes, folder.path()));
}

/// The seeds are what this writes when asked: `TWOPASS_WRITE_SEEDS=1 cargo test --release --test laws seeds_are_up_to_date`.
#[test]
fn seeds_are_up_to_date() {
    let writes = std::env::var_os("TWOPASS_WRITE_SEEDS").is_some();
    let put = |target: &str, name: &str, bytes: &[u8]| {
        let path = folder("seeds", target).join(name);
        if writes {
            std::fs::create_dir_all(folder("seeds", target)).expect("a folder");
            std::fs::write(&path, bytes).expect("written");
        }
        assert!(std::fs::read(&path).is_ok_and(|kept| kept == bytes), "seed {target}/{name} is not what is written here");
    };
    let square = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0.5\n";
    let rich_obj =
        format!("# c\n{square}vt 0 0\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/1/1\nf -1 -2 -3\ng a\nf 1//1 2//1 3//1 4//1\n");
    put("obj", "rich", rich_obj.as_bytes());
    for (name, line) in [("zero", "f 1 2 0"), ("large", "f 1 2 99999999999999999999"), ("nan", "v nan 0 0"), ("short", "f 1 2")] {
        put("obj", name, format!("{square}{line}\n").as_bytes());
    }
    let ply_head = |format: &str, n: &str| {
        format!(
            "ply\nformat {format} 1.0\ncomment c\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float z\n\
             property uchar red\nproperty float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\n\
             property short flags\nelement other 1\nproperty list uint double data\nend_header\n"
        )
    };
    let rows = "0 0 0 7 0 0\n1 0 0 7 1 0\n0 1 0.5 7 0 0.25\n3 0 1 2 -1\n1 9\n";
    put("ply", "ascii", format!("{}{rows}", ply_head("ascii", "3")).as_bytes());
    put("ply", "many", format!("{}{rows}", ply_head("ascii", "4000000000")).as_bytes());
    for big in [false, true] {
        let mut file = ply_head(if big { "binary_big_endian" } else { "binary_little_endian" }, "3").into_bytes();
        let mut item = |bytes: &[u8]| {
            let mut bytes = bytes.to_vec();
            if big {
                bytes.reverse();
            }
            file.extend(bytes);
        };
        for v in [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]] {
            v.iter().for_each(|x| item(&x.to_le_bytes()));
            item(&[7]);
            [0.5_f32, 0.25].iter().for_each(|x| item(&x.to_le_bytes()));
        }
        item(&[3]);
        [0_i32, 1, 2].iter().for_each(|i| item(&i.to_le_bytes()));
        item(&(-1_i16).to_le_bytes());
        item(&1_u32.to_le_bytes());
        item(&9.0_f64.to_le_bytes());
        put("ply", if big { "big" } else { "little" }, &file);
        put("ply", if big { "big-cut" } else { "little-cut" }, &file[..file.len() - 9]);
    }
    // One triangle in single precision, with a name; then the list of one mesh at byte 0.
    let mut mesh = [0x1000_u32.to_le_bytes().as_slice(), b"name\0", &3_u64.to_le_bytes(), &1_u64.to_le_bytes()].concat();
    [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().for_each(|x| mesh.extend(x.to_le_bytes()));
    [0_u32, 1, 2].iter().for_each(|i| mesh.extend(i.to_le_bytes()));
    let file = [[0x1c, 4, 4, 0].as_slice(), &deflated(&mesh), &0_u64.to_le_bytes(), &1_u32.to_le_bytes()].concat();
    put("serialized", "triangle", &file);
    put("serialized", "cut", &file[..20]);
    models(&put);
    let scene = rich_scene();
    put("xml", "rich", scene.replace("<include filename='part.xml'/>", "").as_bytes());
    put("xml", "include", scene.as_bytes());
    put("xml", "laughs", b"<!DOCTYPE s [<!ENTITY a 'ha'><!ENTITY b '&a;&a;&a;'>]><scene version='3.0.0'>&b;</scene>");
    put("xml", "deep", format!("{}{}", "<bsdf type='twosided'>".repeat(300), "</bsdf>".repeat(300)).as_bytes());
    put("xml", "old", b"<scene version='0.6.0'><shape type='sphere'><transform name='toWorld'><lookAt origin='1,2,3' target='0,0,0' up='0,1,0'/></transform></shape></scene>");
    let ascii_ply = format!("{}{rows}", ply_head("ascii", "3"));
    let part = "<scene version='3.0.0'><shape type='cube'><bsdf type='dielectric'/></shape><alias id='a' as='b'/></scene>";
    let files = [("part.xml", part), ("m.obj", &rich_obj), ("m.ply", &ascii_ply)];
    let archive: String = files.iter().map(|(name, text)| format!("\n{}{name}\n{text}", fuzz::DIVIDER)).collect();
    put("scene", "rich", format!("{scene}{archive}").as_bytes());
    put("scene", "alone", scene.as_bytes());
    images(|name, bytes| put("image", name, bytes));
}

/// OBJ files with a library, and glTF files with what the reader knows.
fn models(put: &impl Fn(&str, &str, &[u8])) {
    let obj = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0.5\nvt 0 0\nvt 1 1\nusemtl a\nf 1/1 2/2 3/1\nusemtl b c\nf 2 3 4\n\
               usemtl d\nf 1 2 4\nusemtl e\nf 1 3 4\n";
    let mtl = "newmtl a\nKd .5 .25 1\nKs .2 .2 .2\nNs 98\nillum 2\nmap_Kd -s 2 3 -o .5 .25 -clamp on t.png\nnewmtl b c\nKe 3 2 1\n\
               map_Ke t.png\nnewmtl d\nillum 7\nNi 1.33\nTf .9 .9 .9\nTr 0.75\nnewmtl e\nPm .5\nPr .2\nmap_d t.png\n";
    let text = format!("{obj}\n{0}m.mtl\n{mtl}\n{0}t.png\n", fuzz::DIVIDER);
    let mut file = text.into_bytes();
    file.extend(small_png());
    put("model", "rich", &file);
    put("model", "fault", format!("{obj}\n{}m.mtl\nnewmtl a\nKd .5 .5\n", fuzz::DIVIDER).as_bytes());
    let reals = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0];
    let mut bytes: Vec<u8> = reals.iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0_u16, 1, 2, 0].iter().flat_map(|i| i.to_le_bytes()));
    let image = bytes.len();
    bytes.extend(small_png());
    let json = |uri: &str| gltf_json(uri, bytes.len(), image);
    let uri = format!(",\"uri\":\"data:application/octet-stream;base64,{}\"", base64(&bytes));
    put("gltf", "text", json(&uri).as_bytes());
    put("gltf", "elsewhere", json(",\"uri\":\"a.bin\"").as_bytes());
    let (mut json, mut blob) = (json("").into_bytes(), bytes.clone());
    json.resize(json.len().next_multiple_of(4), b' ');
    blob.resize(blob.len().next_multiple_of(4), 0);
    let length = |n: usize| (n as u32).to_le_bytes();
    let binary = [
        b"glTF\x02\0\0\0".as_slice(),
        &length(28 + json.len() + blob.len()),
        &length(json.len()),
        b"JSON",
        &json,
        &length(blob.len()),
        b"BIN\0",
        &blob,
    ]
    .concat();
    put("gltf", "binary", &binary);
    put("gltf", "cut", &binary[..binary.len() - 40]);
}

fn small_png() -> Vec<u8> {
    png(&[header(2, 2), (b"IDAT", deflated(&[0, 255, 0, 9, 9, 9, 9, 0, 255, 0, 1, 2, 3, 4])), (b"IEND", Vec::new())])
}

fn base64(bytes: &[u8]) -> String {
    use base64::Engine;
    base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// Every member that the reader asks for: a sparse accessor, a strip, two materials, a camera and three lights in nested nodes.
fn gltf_json(uri: &str, bytes: usize, image: usize) -> String {
    let length = bytes - image;
    format!(
        r#"{{"asset":{{"version":"2.0"}},"extensionsUsed":["KHR_lights_punctual","KHR_texture_transform"],"scene":0,
"scenes":[{{"nodes":[0]}}],"nodes":[{{"name":"n","mesh":0,"rotation":[0,0.6,0,0.8],"scale":[1,2,-1],"children":[1,2]}},
{{"camera":0,"translation":[0,0,5],"extensions":{{"KHR_lights_punctual":{{"light":0}}}}}},
{{"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,1,2,3,1],"extensions":{{"KHR_lights_punctual":{{"light":1}}}}}}],
"extensions":{{"KHR_lights_punctual":{{"lights":[{{"type":"point","color":[1,0.5,0],"intensity":9}},
{{"type":"spot","spot":{{"innerConeAngle":0.2,"outerConeAngle":0.5}}}},{{"type":"directional"}}]}}}},
"cameras":[{{"type":"perspective","perspective":{{"yfov":0.8,"znear":0.1,"zfar":99,"aspectRatio":1.5}}}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"indices":2,"material":0}},
{{"attributes":{{"POSITION":3,"NORMAL":0}},"indices":2,"mode":5,"material":1}}]}}],
"materials":[{{"doubleSided":true,"alphaMode":"MASK","emissiveFactor":[1,0.5,0],"emissiveTexture":{{"index":0}},
"pbrMetallicRoughness":{{"baseColorFactor":[0.5,0.25,1,1],"roughnessFactor":0.4,"metallicFactor":0.5,"baseColorTexture":
{{"index":0,"extensions":{{"KHR_texture_transform":{{"offset":[0,1],"scale":[2,2],"rotation":1}}}}}}}},
"extensions":{{"KHR_materials_emissive_strength":{{"emissiveStrength":6}}}}}},
{{"extensions":{{"KHR_materials_transmission":{{"transmissionFactor":1}},"KHR_materials_ior":{{"ior":1.4}},
"KHR_materials_volume":{{"thicknessFactor":1}}}}}}],
"textures":[{{"source":0,"sampler":0}}],"images":[{{"bufferView":3,"mimeType":"image/png"}}],
"samplers":[{{"wrapS":33071,"magFilter":9728}}],"buffers":[{{"byteLength":{bytes}{uri}}}],
"bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":24}},
{{"buffer":0,"byteOffset":60,"byteLength":8}},{{"buffer":0,"byteOffset":{image},"byteLength":{length}}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
{{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}},
{{"bufferView":2,"componentType":5123,"count":3,"type":"SCALAR"}},
{{"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0],"sparse":{{"count":1,
"indices":{{"bufferView":2,"componentType":5123}},"values":{{"bufferView":0}}}}}}]}}"#
    )
}

fn rich_scene() -> String {
    "<scene version='3.0.0'><default name='r' value='0.5'/><include filename='part.xml'/>
<sensor type='perspective'><float name='fov' value='40'/><transform name='to_world'><lookat origin='0,0,-5' target='0,0,0'
up='0,1,0'/></transform><sampler type='independent'><integer name='sample_count' value='4'/></sampler><film type='hdrfilm'>
<integer name='width' value='8'/><integer name='height' value='4'/><rfilter type='box'/></film></sensor>
<integrator type='path'><integer name='max_depth' value='5'/></integrator>
<bsdf type='twosided' id='a'><bsdf type='roughplastic'><float name='alpha' value='0.2'/></bsdf></bsdf>
<shape type='obj'><string name='filename' value='m.obj'/><ref id='a'/></shape>
<shape type='ply'><string name='filename' value='m.ply'/><emitter type='area'><rgb name='radiance' value='1 2 3'/></emitter></shape>
<shape type='sphere'><point name='center' x='1' y='$r' z='2'/><transform name='to_world'><rotate y='1' angle='30'/>
<scale value='2'/></transform><bsdf type='conductor'><rgb name='eta' value='1'/></bsdf></shape>
<shape type='disk'><transform name='to_world'><matrix value='1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1'/></transform><bsdf type='diffuse'>
<texture type='checkerboard' name='reflectance'><rgb name='color0' value='0.1'/><transform name='to_uv'><scale x='4' y='4'/>
</transform></texture></bsdf></shape><shape type='rectangle'/><shape type='cube'><boolean name='flip_normals' value='true'/>
<bsdf type='dielectric'><float name='int_ior' value='1.5'/></bsdf></shape>
<emitter type='constant'><spectrum name='radiance' value='0.5'/></emitter>
<emitter type='point'><point name='position' x='0' y='3' z='0'/></emitter></scene>"
        .to_owned()
}

fn images(put: impl Fn(&str, &[u8])) {
    use exr::prelude::Compression;
    use image::{DynamicImage, ImageFormat};
    let colour = DynamicImage::from(image::RgbImage::from_fn(9, 7, |x, y| image::Rgb([x as u8 * 20, y as u8 * 30, 77])));
    let encoded = |image: &DynamicImage, format| {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).expect("encodes");
        bytes.into_inner()
    };
    put("rgb.png", &encoded(&colour, ImageFormat::Png));
    put("grey.png", &encoded(&colour.to_luma8().into(), ImageFormat::Png));
    put("rgba16.png", &encoded(&colour.to_rgba16().into(), ImageFormat::Png));
    put("rgb.jpg", &encoded(&colour, ImageFormat::Jpeg));
    put("grey.jpg", &encoded(&colour.to_luma8().into(), ImageFormat::Jpeg));
    put("flat.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n\x80\x40\x20\x81\x80\x40\x20\x81");
    put("runs.hdr", b"#?RADIANCE\n\n-Y 1 +X 8\n\x02\x02\x00\x08\x88\x80\x88\x40\x88\x20\x88\x81");
    let claim = png(&[header(8_000_000, 4_000_000_000), (b"IEND", Vec::new())]);
    put("claim.png", &claim);
    let text = (b"zTXt", [b"Comment\0\0".as_slice(), &deflated(&[0; 10_000])].concat());
    put("text.png", &png(&[header(2, 2), text, (b"IDAT", deflated(&[0; 14])), (b"IEND", Vec::new())]));
    let all = [
        ("none.exr", Compression::Uncompressed),
        ("rle.exr", Compression::RLE),
        ("zip1.exr", Compression::ZIP1),
        ("zip16.exr", Compression::ZIP16),
        ("piz.exr", Compression::PIZ),
        ("pxr24.exr", Compression::PXR24),
        ("b44.exr", Compression::B44),
        ("b44a.exr", Compression::B44A),
    ];
    for (name, compression) in all {
        put(name, &exr(compression, 0.5));
    }
    put("nan.exr", &exr(Compression::ZIP16, f32::NAN));
}
