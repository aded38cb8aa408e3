//! How long scenes take to load (files to `Scene`, no tree) and what memory that takes at its peak, beside what the scene keeps.
//!
//! `cargo bench --bench load -- [--into FOLDER] [SCENE...]` measures a generated scene of 175 OBJ files, 385,700 triangles and 13
//! textures, or the scenes named; with `--into` both, and the generated scene is kept, so that other renderers can be timed on it.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;
use twopass::load::load_scene;
use twopass::math::sampler::mix;
use twopass::run_report::peak_memory_bytes;

/// Counts what is allocated.
#[global_allocator]
static HEAP: cap::Cap<std::alloc::System> = cap::Cap::new(std::alloc::System, usize::MAX);

/// Loads of each scene, of which the median is printed.
const RUNS: usize = 5;

const MESHES: usize = 175;
const TEXTURES: usize = 13;
/// Quads of one mesh in each direction: 2,204 triangles.
const QUADS: (usize, usize) = (29, 38);
/// Texels of a texture in each direction.
const SIDE: u32 = 1024;

fn main() {
    let mut into = None;
    let mut scenes = Vec::new();
    // Cargo itself adds --bench.
    let mut arguments = std::env::args_os().skip(1).filter(|a| a != "--bench");
    while let Some(argument) = arguments.next() {
        if argument == "--into" {
            into = arguments.next().map(PathBuf::from);
        } else {
            scenes.push(PathBuf::from(argument));
        }
    }
    // One scene a run tells its own memory peak.
    if into.is_some() || scenes.is_empty() {
        let temporary = tempfile::TempDir::new().expect("a temporary folder");
        let folder = into.unwrap_or_else(|| temporary.path().to_owned());
        if !folder.join("scene.xml").exists() {
            generate(&folder).expect("the folder can be written");
        }
        measure(&folder.join("scene.xml"));
    }
    for scene in scenes {
        measure(&scene);
    }
}

fn measure(path: &Path) {
    let mut seconds = Vec::new();
    let mut last = None;
    let mut before = 0;
    for _ in 0..RUNS {
        // The scene before must not be in memory any more.
        drop(last.take());
        before = HEAP.allocated();
        let start = Instant::now();
        last = Some(load_scene(path, &Default::default()).unwrap_or_else(|error| panic!("{error}")));
        seconds.push(start.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    let kept = HEAP.allocated() - before;
    let loaded = last.expect("loaded at least once");
    let megabytes = |bytes: usize| bytes as f64 / 1e6;
    println!(
        "{}: {} triangles, median {:.3} s (fastest {:.3}), scene {:.1} MB; peak of the program so far {:.1} MB allocated, {:.1} MB resident",
        path.display(),
        loaded.scene.n_triangles(),
        seconds[RUNS / 2],
        seconds[0],
        megabytes(kept),
        megabytes(HEAP.max_allocated()),
        megabytes(peak_memory_bytes() as usize),
    );
}

/// Writes the scene: bumpy sheets in rows, in the layout of public interior scenes (`v`, `vt`, `vn`, faces `a/b/c`).
fn generate(folder: &Path) -> std::io::Result<()> {
    for sub in ["models", "textures"] {
        std::fs::create_dir_all(folder.join(sub))?;
    }
    let mut xml = String::from(
        "<scene version=\"3.0.0\"><sensor type=\"perspective\"><float name=\"fov\" value=\"40\"/>\
         <film type=\"hdrfilm\"><rfilter type=\"box\"/></film></sensor><emitter type=\"constant\"/>\n",
    );
    for i in 0..TEXTURES {
        let random = |x: u32, y: u32| mix(u64::from(x / 16) << 40 | u64::from(y / 16) << 8 | i as u64).to_le_bytes();
        let image = image::RgbImage::from_fn(SIDE, SIDE, |x, y| {
            let [r, g, b, ..] = random(x, y);
            image::Rgb([r, g, b])
        });
        image.save(folder.join(format!("textures/{i}.png"))).map_err(std::io::Error::other)?;
        let _ = writeln!(
            xml,
            "<bsdf type=\"twosided\" id=\"m{i}\"><bsdf type=\"diffuse\"><texture type=\"bitmap\" name=\"reflectance\">\
             <string name=\"filename\" value=\"textures/{i}.png\"/></texture></bsdf></bsdf>"
        );
    }
    for i in 0..MESHES {
        std::fs::write(folder.join(format!("models/{i}.obj")), sheet(i))?;
        let _ = writeln!(
            xml,
            "<shape type=\"obj\"><string name=\"filename\" value=\"models/{i}.obj\"/><ref id=\"m{}\"/></shape>",
            i % TEXTURES
        );
    }
    xml.push_str("</scene>\n");
    std::fs::write(folder.join("scene.xml"), xml)
}

fn sheet(index: usize) -> String {
    let (columns, rows) = QUADS;
    let vertices = || (0..=rows).flat_map(|row| (0..=columns).map(move |column| (column as f64, row as f64)));
    let height = |x: f64, y: f64| 0.1 * (0.3 * x + index as f64).sin() * (0.2 * y).cos();
    let (mut text, at) = (String::new(), (index % 14) as f64 * 40.0);
    for (x, y) in vertices() {
        let _ = writeln!(text, "v {:.6} {:.6} {:.6}", x + at, height(x, y), y + (index / 14) as f64 * 50.0);
    }
    for (x, y) in vertices() {
        let _ = writeln!(text, "vt {:.6} {:.6}", x / columns as f64, y / rows as f64);
    }
    for (x, y) in vertices() {
        let (dx, dy) = (height(x + 1e-3, y) - height(x, y), height(x, y + 1e-3) - height(x, y));
        let _ = writeln!(text, "vn {:.6} {:.6} {:.6}", -dx * 1e3, 1.0, -dy * 1e3);
    }
    for row in 0..rows {
        for column in 0..columns {
            let a = row * (columns + 1) + column + 1;
            let (b, c) = (a + 1, a + columns + 1);
            let d = c + 1;
            let _ = writeln!(text, "f {a}/{a}/{a} {c}/{c}/{c} {b}/{b}/{b}\nf {b}/{b}/{b} {c}/{c}/{c} {d}/{d}/{d}");
        }
    }
    text
}
