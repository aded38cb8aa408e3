//! The solved scene as a binary glTF 2.0 [glTF20]: what it looks like in its own light, for any viewer.
//!
//! Every patch is a polygon with the radiance B/pi that it sends as its corners' colours, drawn without further light
//! (`KHR_materials_unlit`). Corners that patches of one surface share get the mean of their radiances, unless the surface folds there: so
//! light does not leak over creases, nor from one shape to the next. What is only a mirror or glass has no radiance of its own and becomes a plain
//! metal.

use super::PassOne;
use crate::math::{DVec3, Rgb, Vec3};
use crate::patch::PatchId;
use crate::scene::ShapeSurface;
use crate::world::World;
use serde_json::{Value, json};
use std::collections::{BTreeMap, HashMap};
use std::f64::consts::FRAC_1_PI;

/// Share of the area of surfaces that do not emit that is drawn no brighter than [`BRIGHT`]; glTF's colours end at 1.
const SHARE: f64 = 0.95;
const BRIGHT: f64 = 0.8;
/// Corners this near, in patch sizes, are one: the same place by way of two triangles differs by rounding.
const SAME_PLACE: f64 = 1e-3;
/// Faces whose normals differ by more than this cosine do not share a corner's radiance.
const CREASE: f64 = 0.9;

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;

/// One polygon of a patch.
struct Face {
    corners: Vec<DVec3>,
    normal: DVec3,
    area: f64,
    radiance: Rgb,
}

/// The file's bytes.
pub fn lit_gltf(world: &World, pass_one: &PassOne) -> Vec<u8> {
    let patches = &pass_one.field.patches;
    let radiance = |i: usize| pass_one.field.radiosity(i) * FRAC_1_PI;
    let mut shapes: BTreeMap<u32, Vec<Face>> = BTreeMap::new();
    for i in 0..patches.len() {
        let id = PatchId(i as u32);
        let (shape, _) = patches.side_of(world, id);
        let faces = shapes.entry(shape).or_default();
        for corners in patches.drawn(world, id) {
            let turns: DVec3 = corners.windows(2).map(|e| (e[0] - corners[0]).cross(e[1] - corners[0])).sum();
            let (area, normal) = (0.5 * turns.length(), turns.normalize_or_zero());
            if area > 0.0 {
                faces.push(Face { corners, normal, area, radiance: radiance(i) });
            }
        }
    }
    let exposure = exposure(pass_one);
    let mut file = Builder::default();
    let unit = SAME_PLACE * patches.patch_size;
    for (shape, faces) in &shapes {
        file.add_lit(&world.scene().shapes[*shape as usize].id, faces, unit, exposure);
    }
    for (index, shape) in world.scene().shapes.iter().enumerate() {
        if let (false, ShapeSurface::Mesh(mesh)) = (shapes.contains_key(&(index as u32)), &shape.surface) {
            file.add_plain(&shape.id, &mesh.positions, &mesh.triangles);
        }
    }
    file.finish(world, exposure)
}

/// Factor from radiance [W/(m² sr)] to colour.
fn exposure(pass_one: &PassOne) -> f64 {
    let patches = &pass_one.field.patches;
    let lit = (0..patches.len()).filter(|&i| patches.exitance[i].is_black());
    let mut all: Vec<(f64, f64)> =
        lit.map(|i| (pass_one.field.radiosity(i).max() * FRAC_1_PI, patches.area[i])).filter(|(l, _)| *l > 0.0).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let whole: f64 = all.iter().map(|e| e.1).sum();
    let mut below = 0.0;
    let bright = all.iter().find(|(_, area)| {
        below += area;
        below >= SHARE * whole
    });
    bright.map_or(1.0, |(radiance, _)| BRIGHT / radiance)
}

/// Parts of the file as they grow.
#[derive(Default)]
struct Builder {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
}

impl Builder {
    /// A buffer view with what `values` are written as, and an accessor of all of it; its index.
    fn add_accessor(&mut self, target: u32, values: impl Iterator<Item = [u8; 4]>, mut accessor: Value) -> usize {
        let offset = self.bytes.len();
        values.for_each(|v| self.bytes.extend(v));
        let length = self.bytes.len() - offset;
        self.views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": length, "target": target }));
        accessor["bufferView"] = json!(self.views.len() - 1);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn add_positions(&mut self, positions: &[Vec3]) -> usize {
        let low = positions.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = positions.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        let accessor = json!({
            "componentType": FLOAT, "count": positions.len(), "type": "VEC3", "min": low.to_array(), "max": high.to_array()
        });
        self.add_accessor(ARRAY_BUFFER, positions.iter().flat_map(|p| p.to_array()).map(f32::to_le_bytes), accessor)
    }

    fn add_indices(&mut self, indices: &[u32]) -> usize {
        let accessor = json!({ "componentType": UNSIGNED_INT, "count": indices.len(), "type": "SCALAR" });
        self.add_accessor(ELEMENT_ARRAY_BUFFER, indices.iter().map(|i| i.to_le_bytes()), accessor)
    }

    fn add_mesh(&mut self, name: &str, primitive: Value) {
        self.meshes.push(json!({ "name": name, "primitives": [primitive] }));
        self.nodes.push(json!({ "name": name, "mesh": self.meshes.len() - 1 }));
    }

    /// Polygons with a colour at each corner.
    fn add_lit(&mut self, name: &str, faces: &[Face], unit: f64, exposure: f64) {
        // Off by no round share, so that the border of two cells is nowhere where corners like to be.
        let key = |c: DVec3| (c / unit + 0.371).to_array().map(|v| v.floor() as i64);
        // The first corner there gives its place to all, so that no crack opens between them.
        let mut around: HashMap<[i64; 3], (DVec3, Vec<usize>)> = HashMap::new();
        for (k, face) in faces.iter().enumerate() {
            face.corners.iter().for_each(|c| around.entry(key(*c)).or_insert((*c, Vec::new())).1.push(k));
        }
        let (mut positions, mut colours, mut indices) = (Vec::new(), Vec::new(), Vec::new());
        for face in faces {
            let base = positions.len() as u32;
            for corner in &face.corners {
                let (place, there) = &around[&key(*corner)];
                let alike = there.iter().map(|&k| &faces[k]).filter(|f| f.normal.dot(face.normal) > CREASE);
                let (sum, area) = alike.fold((Rgb::BLACK, 0.0), |(s, a), f| (s + f.radiance * f.area, a + f.area));
                positions.push(place.as_vec3());
                colours.push((sum / area * exposure).to_array().map(|v| v.clamp(0.0, 1.0) as f32));
            }
            indices.extend((1..face.corners.len() as u32 - 1).flat_map(|k| [base, base + k, base + k + 1]));
        }
        if indices.is_empty() {
            return;
        }
        let accessor = json!({ "componentType": FLOAT, "count": colours.len(), "type": "VEC3" });
        let colour = self.add_accessor(ARRAY_BUFFER, colours.into_iter().flatten().map(f32::to_le_bytes), accessor);
        let (position, indices) = (self.add_positions(&positions), self.add_indices(&indices));
        let attributes = json!({ "POSITION": position, "COLOR_0": colour });
        self.add_mesh(name, json!({ "attributes": attributes, "indices": indices, "material": 0 }));
    }

    /// Triangles without light of their own.
    fn add_plain(&mut self, name: &str, positions: &[Vec3], triangles: &[[u32; 3]]) {
        if triangles.is_empty() {
            return;
        }
        let (position, indices) = (self.add_positions(positions), self.add_indices(triangles.as_flattened()));
        self.add_mesh(name, json!({ "attributes": { "POSITION": position }, "indices": indices, "material": 1 }));
    }

    fn finish(mut self, world: &World, exposure: f64) -> Vec<u8> {
        let scene = world.scene();
        let camera = &scene.camera;
        let aspect = scene.film.width as f64 / scene.film.height as f64;
        let half = camera.half_width(scene.film.width, scene.film.height) / aspect;
        // glTF's camera looks along -z with x to the right; the scene's along +z with x to the left.
        let m = camera.to_scene.matrix3;
        let columns = [-m.x_axis, m.y_axis, -m.z_axis].map(DVec3::normalize_or_zero);
        let t = camera.to_scene.translation;
        let matrix: Vec<f64> = columns.iter().flat_map(|c| [c.x, c.y, c.z, 0.0]).chain([t.x, t.y, t.z, 1.0]).collect();
        self.nodes.push(json!({ "name": "camera", "camera": 0, "matrix": matrix }));
        let children: Vec<usize> = (0..self.nodes.len()).collect();
        // What was subtracted when the scene was read goes on top, in as many digits as the file has.
        self.nodes.push(json!({ "name": scene.name, "children": children, "translation": scene.origin.to_array() }));
        let mut root = json!({
            "asset": { "version": "2.0", "generator": concat!("twopass ", env!("CARGO_PKG_VERSION")) },
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{ "nodes": [self.nodes.len() - 1], "extras": { "colour_per_radiance": exposure } }],
            "nodes": self.nodes,
            "cameras": [{ "type": "perspective", "perspective": {
                "yfov": 2.0 * half.atan(), "aspectRatio": aspect, "znear": camera.near_clip, "zfar": camera.far_clip
            } }],
            "materials": [
                { "name": "solved", "pbrMetallicRoughness": { "metallicFactor": 0.0 }, "extensions": { "KHR_materials_unlit": {} } },
                { "name": "specular", "pbrMetallicRoughness": { "metallicFactor": 1.0, "roughnessFactor": 0.0 }, "doubleSided": true }
            ]
        });
        if !self.meshes.is_empty() {
            root["meshes"] = Value::Array(self.meshes);
            root["accessors"] = Value::Array(self.accessors);
            root["bufferViews"] = Value::Array(self.views);
            root["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        }
        container(root.to_string().into_bytes(), self.bytes)
    }
}

/// The two chunks of a .glb: JSON padded by spaces, bytes by zeros, both to multiples of four.
fn container(mut text: Vec<u8>, mut bytes: Vec<u8>) -> Vec<u8> {
    text.resize(text.len().next_multiple_of(4), b' ');
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    let chunks: [(&[u8; 4], Vec<u8>); 2] = [(b"JSON", text), (b"BIN\0", bytes)];
    let mut file = Vec::new();
    for (kind, chunk) in chunks.into_iter().filter(|(_, chunk)| !chunk.is_empty()) {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    let mut whole = b"glTF".to_vec();
    whole.extend(2_u32.to_le_bytes());
    whole.extend((file.len() as u32 + 12).to_le_bytes());
    whole.extend(file);
    whole
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_container_is_aligned_and_knows_its_length() {
        let file = container(b"{\"a\":1}".to_vec(), vec![7; 5]);
        assert_eq!(&file[..4], b"glTF");
        assert_eq!(u32::from_le_bytes(file[8..12].try_into().unwrap()) as usize, file.len());
        assert_eq!(u32::from_le_bytes(file[12..16].try_into().unwrap()), 8);
        assert_eq!((&file[16..20], &file[20..28]), (&b"JSON"[..], &b"{\"a\":1} "[..]));
        assert_eq!(&file[28..], [8, 0, 0, 0, b'B', b'I', b'N', 0, 7, 7, 7, 7, 7, 0, 0, 0]);
    }
}
