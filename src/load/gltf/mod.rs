//! glTF 2.0 (.gltf, .glb) as a scene: nodes, triangle meshes, materials, the first perspective camera, point lights.
//!
//! The file's metres, +y up and linear colours are the renderer's own; texture v points down in both. Photometric numbers (candela
//! of a light, nits of a surface) are taken for radiometric ones, all by the same factor. What lies outside the scene's folder is
//! refused, as everywhere.

mod buffers;
mod material;

use super::error::{LoadError, LoadErrorKind};
use super::files::Files;
use super::framing::Model;
use super::mesh::{Placement, RawMesh, fan};
use super::mitsuba::Parts;
use crate::geometry::tessellate::Triangles;
use crate::material::MaterialId;
use crate::math::{DAffine3, DVec2, DVec3, Rgb, Vec2};
use crate::scene::camera::FovAxis;
use crate::scene::{Camera, LightSource, ShapeSource, SurfaceSource};
use buffers::{Buffers, malformed};
use gltf::camera::Projection;
use gltf::khr_lights_punctual::Kind;
use gltf::mesh::Mode;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::HashSet;
use std::path::Path;

type Result<T> = std::result::Result<T, LoadErrorKind>;

/// A perspective camera without a far plane sees this far.
const FAR: f64 = 1e7;

/// Reads the glTF file `main`.
pub(super) fn scene(files: &Files, main: &Path, name: String) -> std::result::Result<Parts, LoadError> {
    read(files, main, name).map_err(|kind| kind.in_file(main))
}

fn read(files: &Files, main: &Path, name: String) -> Result<Parts> {
    let bytes = files.read(main, files.limits.mesh_bytes)?;
    let (json, blob) = if bytes.starts_with(b"glTF") {
        // The crate subtracts its header from the length that the file claims.
        let length = bytes.get(8..).and_then(|rest| rest.first_chunk()).map(|length| u32::from_le_bytes(*length));
        if let Some(length @ 0..12) = length {
            return Err(malformed("an intact .glb file", format!("a length of {length} bytes at byte 8")));
        }
        let glb = gltf::binary::Glb::from_slice(&bytes).map_err(|error| malformed("an intact .glb file", error.to_string()))?;
        (glb.json, glb.bin)
    } else {
        (Cow::Borrowed(&bytes[..]), None)
    };
    let not_gltf = |error: &dyn std::fmt::Display| malformed("glTF 2.0 in JSON", error.to_string());
    let root = gltf::json::Root::from_slice(&json).map_err(|error| not_gltf(&error))?;
    complete(&root)?;
    let document = gltf::Document::from_json(root).map_err(|error| not_gltf(&error))?;
    let buffers = Buffers::read(&document, blob, files)?;
    let mut walk = Walk::default();
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let scene = scene.ok_or_else(|| malformed("a scene", "a file without one"))?;
    for node in scene.nodes() {
        walk.node(&node, DAffine3::IDENTITY, files.limits.depth)?;
    }
    let Walk { placed, mut model, .. } = walk;
    let found = placed.iter().fold(0_u64, |sum, p| sum.saturating_add(triangle_count(&p.primitive)));
    if found > files.limits.triangles {
        let (what, limit) = ("number of triangles".to_owned(), files.limits.triangles);
        return Err(LoadErrorKind::OverLimit { what, limit, found });
    }
    // Each material once, in the order of first use.
    let mut used: Vec<gltf::Material<'_>> = Vec::new();
    let material_of: Vec<usize> = placed
        .iter()
        .map(|p| {
            let material = p.primitive.material();
            used.iter().position(|m| m.index() == material.index()).unwrap_or_else(|| {
                used.push(material);
                used.len() - 1
            })
        })
        .collect();
    let pictures = material::decode(&used, &buffers, files)?;
    let mut emissions = Vec::new();
    for material in &used {
        let (surface, emission) = material::surface(material, &pictures, &mut model.warnings)?;
        model.materials.push(surface);
        emissions.push(emission);
    }
    let surfaces: Vec<Result<Triangles>> = placed.par_iter().map(|p| p.read(&buffers)).collect();
    for ((placed, triangles), material) in placed.into_iter().zip(surfaces).zip(material_of) {
        let (id, surface) = (placed.id, SurfaceSource::Triangles(triangles?));
        let shape = ShapeSource { id, surface, material: MaterialId(material as u32), emission: emissions[material].clone() };
        model.shapes.push(shape);
    }
    Ok(model.into_parts(name))
}

/// An error where the crate would panic: at members that it takes for granted, and at indices that it follows before it checks them.
fn complete(json: &gltf::json::Root) -> Result<()> {
    use gltf::json::validation::Checked;
    let positions = json.meshes.iter().flat_map(|m| &m.primitives).filter_map(|p| {
        let index = p.attributes.get(&Checked::Valid(gltf::Semantic::Positions))?;
        Some(index.value())
    });
    if let Some(index) = positions.filter(|i| *i >= json.accessors.len()).min() {
        let expected = format!("positions in one of {} accessors", json.accessors.len());
        return Err(malformed(expected, format!("accessor {index}")));
    }
    for (i, image) in json.images.iter().enumerate() {
        let (expected, found) = match (&image.buffer_view, &image.mime_type, &image.uri) {
            (Some(_), None, _) => ("an image in a view with its mimeType", "none"),
            (None, _, None) => ("an image with a bufferView or a uri", "neither"),
            _ => continue,
        };
        return Err(malformed(expected, format!("{found} in image {i}")));
    }
    for (i, camera) in json.cameras.iter().enumerate() {
        use gltf::json::camera::Type;
        let is_there = match camera.type_ {
            Checked::Valid(Type::Perspective) => camera.perspective.is_some(),
            Checked::Valid(Type::Orthographic) => camera.orthographic.is_some(),
            Checked::Invalid => true,
        };
        if !is_there {
            return Err(malformed("a camera with the properties of its type", format!("none in camera {i}")));
        }
    }
    Ok(())
}

/// A primitive where a node puts it.
struct Placed<'a> {
    id: String,
    primitive: gltf::Primitive<'a>,
    to_world: DAffine3,
}

/// What the nodes hold.
#[derive(Default)]
struct Walk<'a> {
    placed: Vec<Placed<'a>>,
    model: Model,
    /// Nodes met: each has one parent at most.
    seen: HashSet<usize>,
    ids: HashSet<String>,
}

impl<'a> Walk<'a> {
    fn node(&mut self, node: &gltf::Node<'a>, parent: DAffine3, depth: usize) -> Result<()> {
        if !self.seen.insert(node.index()) {
            return Err(malformed("nodes in a tree", format!("node {} with two parents, or in a cycle", node.index())));
        }
        let Some(depth) = depth.checked_sub(1) else {
            return Err(malformed("nodes nested less deep", format!("node {} beyond the limit", node.index())));
        };
        let to_world = parent * local(&node.transform());
        if let Some(mesh) = node.mesh() {
            self.mesh(node, &mesh, to_world);
        }
        if let Some(camera) = node.camera() {
            self.camera(&camera, to_world)?;
        }
        if let Some(light) = node.light() {
            self.light(&light, to_world)?;
        }
        node.children().try_for_each(|child| self.node(&child, to_world, depth))
    }

    fn mesh(&mut self, node: &gltf::Node<'a>, mesh: &gltf::Mesh<'a>, to_world: DAffine3) {
        if node.skin().is_some() {
            self.model.warnings.push(format!("node {}: its skin plays no part", node.index()));
        }
        let name = node.name().or(mesh.name()).map_or_else(|| format!("node-{}", node.index()), str::to_owned);
        for primitive in mesh.primitives() {
            if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
                self.model.warnings.push(format!("mesh \"{name}\": points and lines are left out"));
                continue;
            }
            let mut id = name.clone();
            let mut number = 1;
            while !self.ids.insert(id.clone()) {
                number += 1;
                id = format!("{name}-{}-{number}", node.index());
            }
            self.placed.push(Placed { id, primitive, to_world });
        }
    }

    fn camera(&mut self, camera: &gltf::Camera<'_>, to_world: DAffine3) -> Result<()> {
        if self.model.view.is_some() {
            self.model.warnings.push("the file has several cameras; the first is used".to_owned());
            return Ok(());
        }
        let Projection::Perspective(lens) = camera.projection() else {
            self.model.warnings.push("an orthographic camera is passed over".to_owned());
            return Ok(());
        };
        let (fov, near_clip) = (f64::from(lens.yfov()), f64::from(lens.znear()));
        let far_clip = lens.zfar().map_or(FAR, f64::from);
        let aspect = lens.aspect_ratio().map(f64::from);
        let is_lens = fov > 0.0 && fov < std::f64::consts::PI && near_clip > 0.0 && far_clip > near_clip;
        if !is_lens || aspect.is_some_and(|a| !(a > 0.0 && a.is_finite())) {
            let found = format!("yfov {fov}, znear {near_clip}, zfar {far_clip}, aspectRatio {aspect:?}");
            return Err(malformed("a camera of 0 < yfov < pi, 0 < znear < zfar and aspectRatio > 0", found));
        }
        // The file's camera looks along its -z with +x to the right, the renderer's along +z with +x to the left.
        let m = to_world.matrix3;
        let axes = [-m.x_axis, m.y_axis, -m.z_axis].map(DVec3::try_normalize);
        let [Some(left), Some(up), Some(forward)] = axes else {
            return Err(malformed("a camera with a direction", "a node that flattens space"));
        };
        let to_scene = DAffine3::from_cols(left, up, forward, to_world.translation);
        let principal_point = DVec2::ZERO;
        let camera =
            Camera { to_scene, tan_half_fov: (0.5 * fov).tan(), fov_axis: FovAxis::Y, principal_point, near_clip, far_clip };
        self.model.view = Some((camera, aspect));
        Ok(())
    }

    fn light(&mut self, light: &gltf::khr_lights_punctual::Light<'_>, to_world: DAffine3) -> Result<()> {
        let [r, g, b] = light.color().map(f64::from);
        let intensity = Rgb::new(r, g, b) * f64::from(light.intensity());
        if !intensity.is_finite() || intensity.min() < 0.0 {
            return Err(malformed("a light of 0 or more in every channel", format!("{intensity:?}")));
        }
        let position = to_world.translation;
        // Lights shine along their local -z.
        let axis = (-to_world.matrix3.z_axis).try_normalize();
        let axis = axis.ok_or_else(|| malformed("a light with a direction", "a node that flattens space"))?;
        self.model.lights.push(match light.kind() {
            Kind::Point => LightSource::Point { position, intensity },
            Kind::Spot { inner_cone_angle, outer_cone_angle } => {
                let (beam_width, cutoff) = (f64::from(inner_cone_angle), f64::from(outer_cone_angle));
                if !(0.0 <= beam_width && beam_width <= cutoff && cutoff <= std::f64::consts::FRAC_PI_2) {
                    let found = format!("{beam_width} and {cutoff}");
                    return Err(malformed("cone angles from 0 to pi/2, the inner one no wider than the outer", found));
                }
                LightSource::Spot { position, axis, intensity, cutoff, beam_width }
            }
            Kind::Directional => LightSource::Directional { direction: axis, irradiance: intensity },
        });
        Ok(())
    }
}

fn local(transform: &gltf::scene::Transform) -> DAffine3 {
    match transform {
        gltf::scene::Transform::Matrix { matrix } => {
            let column = |i: usize| DVec3::new(matrix[i][0].into(), matrix[i][1].into(), matrix[i][2].into());
            DAffine3::from_cols(column(0), column(1), column(2), column(3))
        }
        gltf::scene::Transform::Decomposed { translation, rotation, scale } => {
            let rotation = glam::DQuat::from_array(rotation.map(f64::from));
            let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { glam::DQuat::IDENTITY };
            let [translation, scale] = [translation, scale].map(|v| DVec3::from(v.map(f64::from)));
            DAffine3::from_scale_rotation_translation(scale, rotation, translation)
        }
    }
}

fn triangle_count(primitive: &gltf::Primitive<'_>) -> u64 {
    let corners = primitive.indices().or_else(|| primitive.get(&gltf::Semantic::Positions)).map_or(0, |a| a.count());
    match primitive.mode() {
        Mode::Triangles => corners as u64 / 3,
        _ => (corners as u64).saturating_sub(2),
    }
}

impl Placed<'_> {
    fn read(&self, buffers: &Buffers<'_>) -> Result<Triangles> {
        let mut mesh = self.raw(buffers)?;
        let flat = mesh.normals.is_empty();
        // Vertex normals keep their side under a mirroring; without them the winding has to.
        if flat && self.to_world.matrix3.determinant() < 0.0 {
            mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        // Where a file gives no normals it asks for flat faces.
        Ok(Placement { to_world: self.to_world, face_normals: flat, flip_normals: false }.apply(mesh))
    }

    fn raw(&self, buffers: &Buffers<'_>) -> Result<RawMesh> {
        let get = |semantic| self.primitive.get(&semantic);
        let positions = get(gltf::Semantic::Positions).ok_or_else(|| malformed("a mesh with the attribute POSITION", "none"))?;
        let positions: Vec<DVec3> = buffers.vectors::<3>(&positions)?.into_iter().map(DVec3::from).collect();
        if let Some(vertex) = positions.iter().position(|p| !p.is_finite()) {
            return Err(malformed("finite coordinates", format!("{} at vertex {vertex} of \"{}\"", positions[vertex], self.id)));
        }
        let mut normals: Vec<DVec3> = match get(gltf::Semantic::Normals) {
            None => Vec::new(),
            Some(accessor) => buffers.vectors::<3>(&accessor)?.into_iter().map(DVec3::from).collect(),
        };
        normals.iter_mut().filter(|n| !n.is_finite()).for_each(|n| *n = DVec3::ZERO);
        let set = self.primitive.material().pbr_metallic_roughness().base_color_texture().map_or(0, |info| {
            let moved = info.texture_transform().and_then(|t| t.tex_coord());
            moved.unwrap_or(info.tex_coord())
        });
        let mut uvs: Vec<Vec2> = match get(gltf::Semantic::TexCoords(set)) {
            None => Vec::new(),
            Some(accessor) => buffers.vectors::<2>(&accessor)?.into_iter().map(|t| Vec2::from(t.map(|v| v as f32))).collect(),
        };
        uvs.iter_mut().filter(|t| !t.is_finite()).for_each(|t| *t = Vec2::ZERO);
        let count = positions.len();
        for (name, found) in [("normals", normals.len()), ("texture coordinates", uvs.len())] {
            if found != 0 && found != count {
                return Err(malformed(format!("{count} {name} in \"{}\"", self.id), format!("{found}")));
            }
        }
        let corners = match self.primitive.indices() {
            Some(accessor) => buffers.indices(&accessor)?,
            None => (0..count as u32).collect(),
        };
        if let Some(bad) = corners.iter().find(|i| **i as usize >= count) {
            return Err(malformed(format!("vertices below {count} in \"{}\"", self.id), format!("vertex {bad}")));
        }
        let triangles: Vec<[u32; 3]> = match self.primitive.mode() {
            Mode::Triangles => corners.as_chunks::<3>().0.to_vec(),
            Mode::TriangleFan => fan(&corners).collect(),
            // Every other triangle of a strip is wound the other way.
            _ => corners
                .windows(3)
                .enumerate()
                .map(|(i, t)| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] })
                .collect(),
        };
        Ok(RawMesh { positions, normals, uvs, triangles })
    }
}
