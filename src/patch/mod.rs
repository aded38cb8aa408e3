//! The patches of pass one: pieces of surface over which radiosity is taken as constant.
//!
//! A patch is what [Cohen93] calls an element. Its size follows the patch size asked for, not the triangles: large triangles are
//! split ([`subdivide`]), small neighbours grouped ([`cluster`]), and no patch straddles a surface that cuts it ([`cuts`]).

pub mod cluster;
mod covered;
pub mod cuts;
mod measure;
pub mod outline;
mod raster;
mod refine;
mod shares;
pub mod subdivide;

use crate::geometry::soup::Primitive;
use crate::math::{DVec3, Rgb, Vec2, Vec3, warp};
use crate::scene::{Scene, Shape, ShapeSurface};
use crate::world::{All, Stages, SurfaceInteraction, World};
use cuts::Cutters;
use raster::Raster;
pub use refine::FINEST_LEVEL;
use std::f64::consts::PI;
use subdivide::{NO_PIECE, Sizes, SplitTree};

/// Points are sampled this far inside the border of a split piece, relative to the scene's diagonal: a point that rounding moves
/// across a cut would carry light from one room to the next.
const BORDER_MARGIN: f64 = 1e-6;

/// Triangles with no edge longer than this many patch sizes are never cut.
const SMALLEST_CUT: f64 = 1.0 / 64.0;

/// Index of a patch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
pub struct PatchId(pub u32);

/// How finely the scene is cut.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PatchSettings {
    /// Edge length of a patch in scene units; `None`: chosen so that the scene's area makes about `elements`.
    pub patch_size: Option<f64>,
    /// Elements that the patch size aims at unless it is given.
    pub elements: f64,
    /// More elements than this are refused before they are made.
    pub max_patches: usize,
    /// For a first look: what is smaller than a patch is not cut where a wall stands on it, and small patches get a quarter of their rays. A
    /// room full of things costs a third then; what leaks through a wall by a tile that reaches under it goes with the next, finer patches.
    #[serde(skip)]
    pub rough: bool,
    /// Elements are cut in quarters where the radiosity of a solution bends by more than this share of its mean; `None`: nowhere.
    pub adaptive: Option<f64>,
}

/// Elements that the default patch size aims at. On the Cornell box a final gather over as many reached relMSE 8.7e-6 at 512 samples
/// and was still falling, while stored radiosity stopped at 6.7e-5.
pub const DEFAULT_ELEMENTS: f64 = 4000.0;

/// Coarse patches are cut as so many elements would be, for a first look; else as the default is.
const ROUGH_CUTS: f64 = 1000.0;

impl Default for PatchSettings {
    fn default() -> Self {
        Self { patch_size: None, elements: DEFAULT_ELEMENTS, max_patches: 4_000_000, rough: false, adaptive: None }
    }
}

/// Why patches were not made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PatchError {
    /// Too many.
    #[error(
        "a patch size of {patch_size} would make about {estimate:.0} patches, more than the limit of {limit}; ask for larger patches"
    )]
    TooMany {
        /// Edge length asked for.
        patch_size: f64,
        /// Patches expected.
        estimate: f64,
        /// The limit.
        limit: usize,
    },
}

/// A triangle of an element: corners as barycentric weights on one triangle primitive, or one cell of a sphere's grid.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
enum Piece {
    /// `inset` is the factor by which the corners were moved towards the middle of their polygon; areas are those without it.
    Triangle {
        primitive: u32,
        corners: [[f32; 2]; 3],
        inset: f32,
    },
    SphereCell {
        primitive: u32,
        row: u32,
        column: u32,
        rows: u32,
        columns: u32,
    },
}

/// A piece of surface that is one patch on each side that reflects or emits.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
struct Element {
    pieces: std::ops::Range<u32>,
    front: Option<PatchId>,
    back: Option<PatchId>,
    /// How often it was cut in quarters.
    level: u8,
}

/// How a primitive finds its element.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
enum Lookup {
    None,
    Whole(u32),
    Split { tree: u32 },
    Grid { first: u32, rows: u32, columns: u32 },
}

/// All patches, as arrays.
#[derive(serde::Serialize, serde::Deserialize)]
pub struct PatchMesh {
    /// Area [m²].
    pub area: Vec<f64>,
    /// Mean of its points.
    pub centroid: Vec<Vec3>,
    /// Area-weighted unit normal on the side the patch is for.
    pub normal: Vec<Vec3>,
    /// Diffuse reflectance rho, averaged over the patch in linear light.
    pub rho: Vec<Rgb>,
    /// Exitance E = pi L_e [W/m²].
    pub exitance: Vec<Rgb>,
    /// Edge length that was asked for or chosen.
    pub patch_size: f64,
    /// Area that lies in the same place as that of another opaque surface that faces the same way, and is hidden by it [m²].
    #[serde(skip)]
    pub given_twice: f64,
    /// As [`PatchSettings::rough`].
    #[serde(skip)]
    rough: bool,
    element_of: Vec<u32>,
    side: Vec<bool>,
    elements: Vec<Element>,
    pieces: Vec<Piece>,
    /// Running share of the element's area up to and including each piece, in (0, 1].
    piece_share: Vec<f32>,
    lookups: Vec<Lookup>,
    trees: Vec<SplitTree>,
    tree_elements: Vec<u32>,
    /// A shorter way to the same, if it was asked for.
    #[serde(skip)]
    raster: Raster,
    /// Patches whose light cannot count in the picture; empty: none.
    #[serde(skip)]
    idle: Vec<bool>,
}

impl PatchMesh {
    /// Cuts the scene into patches.
    ///
    /// # Errors
    /// [`PatchError::TooMany`] before anything large is made.
    pub fn build(world: &World, settings: &PatchSettings) -> Result<PatchMesh, PatchError> {
        let relevant: Vec<bool> = world.scene().shapes.iter().map(|s| needs_patches(world.scene(), s)).collect();
        let total: f64 = world.scene().shapes.iter().zip(&relevant).filter(|(_, r)| **r).map(|(s, _)| s.area()).sum();
        let patch_size = settings.patch_size.unwrap_or_else(|| (total / settings.elements).sqrt());
        let estimate = total / (patch_size * patch_size);
        if estimate > settings.max_patches as f64 {
            return Err(PatchError::TooMany { patch_size, estimate, limit: settings.max_patches });
        }
        let cut_as = if settings.rough { ROUGH_CUTS } else { DEFAULT_ELEMENTS };
        let sizes = Sizes { patch: patch_size, cut: patch_size.min((total / cut_as).sqrt()) };
        let mut mesh = PatchMesh { rough: settings.rough, ..PatchMesh::empty(patch_size, world.soup().len()) };
        // Anything may cut a large triangle; a small one is cut only by large ones, since two fine meshes that touch would make
        // as many patches as triangles.
        let cutters = [Cutters::new(world, 0.0), Cutters::new(world, 0.5 * sizes.cut)];
        for (index, shape) in world.scene().shapes.iter().enumerate().filter(|(i, _)| relevant[*i]) {
            match &shape.surface {
                ShapeSurface::Mesh(_) => mesh.add_mesh(world, index, &cutters, sizes),
                ShapeSurface::Sphere(_) => mesh.add_sphere(world, index),
            }
        }
        mesh.measure(world);
        mesh.leave_out_covered(world);
        Ok(mesh)
    }

    /// No patches yet, on so many primitives.
    fn empty(patch_size: f64, primitives: usize) -> Self {
        PatchMesh {
            area: Vec::new(),
            centroid: Vec::new(),
            normal: Vec::new(),
            rho: Vec::new(),
            exitance: Vec::new(),
            patch_size,
            given_twice: 0.0,
            rough: false,
            element_of: Vec::new(),
            side: Vec::new(),
            elements: Vec::new(),
            pieces: Vec::new(),
            piece_share: Vec::new(),
            lookups: vec![Lookup::None; primitives],
            trees: Vec::new(),
            tree_elements: Vec::new(),
            raster: Raster::default(),
            idle: Vec::new(),
        }
    }

    /// Elements that [`Self::build`] will make, from areas alone: each is a patch on one side or on both, and cuts make more of them.
    pub fn expected(world: &World, settings: &PatchSettings) -> f64 {
        settings.patch_size.map_or(settings.elements, |size| {
            let shapes = world.scene().shapes.iter().filter(|s| needs_patches(world.scene(), s));
            shapes.map(|s| s.area()).sum::<f64>() / (size * size)
        })
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.area.len()
    }

    /// True if nothing in the scene reflects diffusely or emits.
    pub fn is_empty(&self) -> bool {
        self.area.is_empty()
    }

    /// For each patch: true if the lamp it belongs to is found by shadow rays, so that form factors must not carry its emission.
    pub fn found_by_shadow_rays(&self, world: &World) -> Vec<bool> {
        self.shapes(world).into_iter().map(|shape| world.partition().found_by_shadow_rays(shape)).collect()
    }

    /// For each patch the index of its shape.
    pub fn shapes(&self, world: &World) -> Vec<usize> {
        self.element_of.iter().map(|&e| self.shape_of(world, e)).collect()
    }

    fn shape_of(&self, world: &World, element: u32) -> usize {
        let first = self.elements[element as usize].pieces.start as usize;
        match self.pieces[first] {
            Piece::Triangle { primitive, .. } | Piece::SphereCell { primitive, .. } => world.shape_index(primitive),
        }
    }

    /// Notes which patches lie on sides of triangles whose light cannot count in the picture, as a plan has told the world.
    pub fn mark_idle(&mut self, world: &World) {
        if !world.has_idle() {
            return;
        }
        let is_idle = |(&element, &front): (&u32, &bool)| {
            let pieces = self.elements[element as usize].pieces.clone();
            self.pieces[pieces.start as usize..pieces.end as usize].iter().all(|piece| match *piece {
                Piece::Triangle { primitive, .. } | Piece::SphereCell { primitive, .. } => world.is_idle(primitive, front),
            })
        };
        self.idle = self.element_of.iter().zip(&self.side).map(is_idle).collect();
    }

    /// True if the light of patch `i` cannot count in the picture.
    #[inline]
    pub fn is_idle(&self, i: usize) -> bool {
        self.idle.get(i).is_some_and(|idle| *idle)
    }

    /// The shape that patch `id` belongs to, and whether it is for its front.
    pub fn side_of(&self, world: &World, id: PatchId) -> (u32, bool) {
        let element = &self.elements[self.element_of[id.0 as usize] as usize];
        let (Piece::Triangle { primitive, .. } | Piece::SphereCell { primitive, .. }) =
            self.pieces[element.pieces.start as usize];
        (world.shape_index(primitive) as u32, self.side[id.0 as usize])
    }

    /// The convex polygons of patch `id` in coordinates of the scene, counter-clockwise as seen from its side; `None` if it is curved. Their
    /// corners are as exact as the patch's own, to about 1e-7 of the triangle they are cut from.
    pub fn polygons(&self, world: &World, id: PatchId) -> Option<Vec<Vec<DVec3>>> {
        let element = &self.elements[self.element_of[id.0 as usize] as usize];
        let mut polygons: Vec<(u32, f64, Vec<DVec3>)> = Vec::new();
        for piece in &self.pieces[element.pieces.start as usize..element.pieces.end as usize] {
            let Piece::Triangle { primitive, corners, inset } = *piece else { return None };
            let [a, b, c] = world.soup().corners(primitive as usize).map(|c| c.as_dvec3());
            let place = |w: [f32; 2]| a + (b - a) * f64::from(w[0]) + (c - a) * f64::from(w[1]);
            // Pieces of one primitive are the fan of one polygon, all drawn in by the same factor.
            match polygons.last_mut().filter(|(of, ..)| *of == primitive) {
                Some((.., polygon)) => polygon.push(place(corners[2])),
                None => polygons.push((primitive, f64::from(inset), corners.map(place).to_vec())),
            }
        }
        let restored = polygons.into_iter().map(|(primitive, inset, mut polygon)| {
            let middle = polygon.iter().sum::<DVec3>() / polygon.len() as f64;
            polygon.iter_mut().for_each(|c| *c = middle + (*c - middle) / inset);
            let seen = world.on_triangle(primitive, (1.0 / 3.0, 1.0 / 3.0), Vec3::Z);
            let front = if seen.front { seen.ng } else { -seen.ng };
            // All of it: clipping leaves corners that all but coincide.
            let turns: DVec3 = polygon.windows(2).map(|e| (e[0] - middle).cross(e[1] - middle)).sum();
            if (turns.dot(front.as_dvec3()) > 0.0) != self.side[id.0 as usize] {
                polygon.reverse();
            }
            polygon
        });
        Some(restored.collect())
    }

    /// Polygons to draw patch `id` with, as [`Self::polygons`]; those of a cell of a sphere have their corners on it.
    pub fn drawn(&self, world: &World, id: PatchId) -> Vec<Vec<DVec3>> {
        if let Some(polygons) = self.polygons(world, id) {
            return polygons;
        }
        let element = &self.elements[self.element_of[id.0 as usize] as usize];
        let Piece::SphereCell { primitive, row, column, rows, columns } = self.pieces[element.pieces.start as usize] else {
            return Vec::new();
        };
        let Primitive::Sphere(sphere) = world.soup().primitive(primitive) else { return Vec::new() };
        let at = |row: u32, column: u32| {
            let z = 1.0 - 2.0 * f64::from(row) / f64::from(rows);
            let (s, c) = (2.0 * PI * f64::from(column % columns) / f64::from(columns)).sin_cos();
            let r = (1.0 - z * z).max(0.0).sqrt();
            sphere.center.as_dvec3() + f64::from(sphere.radius) * DVec3::new(r * c, r * s, z)
        };
        let mut cell = vec![at(row, column), at(row + 1, column), at(row + 1, column + 1), at(row, column + 1)];
        if !self.side[id.0 as usize] {
            cell.reverse();
        }
        vec![cell]
    }

    fn add_mesh(&mut self, world: &World, shape: usize, [any_cutter, large_cutters]: &[Cutters; 2], sizes: Sizes) {
        let ShapeSurface::Mesh(mesh) = &world.scene().shapes[shape].surface else { return };
        let first = world.first_primitive(shape);
        let edge = |i: u32| cuts::longest_edge(world.soup().corners(i as usize));
        let all = first..first + mesh.triangles.len() as u32;
        let (large, small): (Vec<u32>, Vec<u32>) = all.partition(|&i| edge(i) > self.patch_size);
        for (primitive, tree) in subdivide::split_all(world, any_cutter, &large, sizes) {
            self.add_tree(world, primitive, tree);
        }
        // A leak through a triangle this small is beyond what any patch resolves.
        let may_cross = |&i: &u32| !self.rough && edge(i) > SMALLEST_CUT * sizes.cut;
        let (crossing, tiny): (Vec<u32>, Vec<u32>) = small.into_iter().partition(may_cross);
        let mut divided = subdivide::split_divided(world, large_cutters, &crossing, sizes);
        for (primitive, tree) in divided.drain(..) {
            self.add_tree(world, primitive, tree);
        }
        let undivided = |i: &u32| matches!(self.lookups[*i as usize], Lookup::None);
        let whole: Vec<u32> = crossing.into_iter().filter(undivided).chain(tiny).collect();
        for group in cluster::group(world, &whole, self.patch_size) {
            self.add_group(group, 0);
        }
    }

    fn add_tree(&mut self, world: &World, primitive: u32, tree: SplitTree) {
        let base = self.tree_elements.len() as u32;
        let margin = f64::from(world.bounds().diagonal()) * BORDER_MARGIN;
        for leaf in &tree.leaves {
            let element = self.add_polygon(world, primitive, leaf, 0, margin);
            self.tree_elements.push(element);
        }
        self.lookups[primitive as usize] = Lookup::Split { tree: self.trees.len() as u32 };
        self.trees.push(tree.without_leaves(base));
    }

    /// A grid of cells of equal area: rows of equal height, columns of equal angle (Archimedes).
    fn add_sphere(&mut self, world: &World, shape: usize) {
        let ShapeSurface::Sphere(sphere) = world.scene().shapes[shape].surface else { return };
        let primitive = world.first_primitive(shape);
        let around = 2.0 * PI * f64::from(sphere.radius) / self.patch_size;
        let rows = ((0.5 * around).ceil() as u32).max(4);
        let columns = (around.ceil() as u32).max(6);
        let first = self.elements.len() as u32;
        for row in 0..rows {
            for column in 0..columns {
                self.add_element(std::iter::once(Piece::SphereCell { primitive, row, column, rows, columns }), 0);
            }
        }
        self.lookups[primitive as usize] = Lookup::Grid { first, rows, columns };
    }

    /// The patch that a surface point belongs to, on the side it is seen from; `None` for surfaces without patches.
    #[inline]
    pub fn patch_at(&self, si: &SurfaceInteraction) -> Option<PatchId> {
        self.patch_of(si.primitive, si.place, si.front)
    }

    /// True if a surface point belongs to a patch, or to a sliver on a triangle of patches: less than finding which.
    #[inline]
    pub fn has_patch_at(&self, si: &SurfaceInteraction) -> bool {
        let any = match self.lookups[si.primitive as usize] {
            Lookup::None => return false,
            Lookup::Whole(element) | Lookup::Grid { first: element, .. } => element,
            Lookup::Split { tree } => self.tree_elements[self.trees[tree as usize].base as usize],
        };
        // All of a triangle has patches on the same sides, but for what has no area.
        let element = &self.elements[any as usize];
        match (element.front, element.back) {
            (None, _) => self.patch_at(si).is_some(),
            (_, back) => si.front || back.is_some(),
        }
    }

    /// The same by primitive, place on it, and side.
    #[inline]
    fn patch_of(&self, primitive: u32, place: (f64, f64), front: bool) -> Option<PatchId> {
        let element = match self.lookups[primitive as usize] {
            Lookup::None => return None,
            Lookup::Whole(element) => element,
            Lookup::Split { tree } => {
                let tree = &self.trees[tree as usize];
                match tree.find(place.0, place.1) {
                    NO_PIECE => return None,
                    leaf => self.tree_elements[(tree.base + leaf) as usize],
                }
            }
            Lookup::Grid { first, rows, columns } => {
                let cell = |t: f64, n: u32| ((t * f64::from(n)) as u32).min(n - 1);
                first + cell(0.5 * (1.0 - place.1), rows) * columns + cell(place.0, columns)
            }
        };
        let element = &self.elements[element as usize];
        if front { element.front } else { element.back }
    }

    /// A uniform point of patch `id`, seen from its side.
    #[inline]
    pub fn sample(&self, world: &World, id: PatchId, u: Vec2) -> SurfaceInteraction {
        self.sample_by::<All>(world, id, u)
    }

    /// As [`Self::sample`], by code that holds the stages `K`.
    #[inline]
    pub fn sample_by<K: Stages>(&self, world: &World, id: PatchId, u: Vec2) -> SurfaceInteraction {
        let element = &self.elements[self.element_of[id.0 as usize] as usize];
        let range = element.pieces.start as usize..element.pieces.end as usize;
        let shares = &self.piece_share[range.clone()];
        let k = shares.partition_point(|&s| s <= u.x).min(shares.len() - 1);
        let before = if k == 0 { 0.0 } else { shares[k - 1] };
        let x = ((u.x - before) / (shares[k] - before)).clamp(0.0, 1.0 - f32::EPSILON);
        self.on_piece::<K>(world, range.start + k, Vec2::new(x, u.y), self.side[id.0 as usize])
    }

    /// A point of piece `index`; `front` names the side it is seen from.
    fn on_piece<K: Stages>(&self, world: &World, index: usize, u: Vec2, front: bool) -> SurfaceInteraction {
        let mut si = match self.pieces[index] {
            Piece::Triangle { primitive, corners, .. } => {
                let w = warp::triangle(u);
                let at = |axis: usize| {
                    let [p, q, r] = corners.map(|c| f64::from(c[axis]));
                    p + (q - p) * f64::from(w.x) + (r - p) * f64::from(w.y)
                };
                let place = (at(0), at(1));
                if K::PLAIN
                    && let Some(at) = world.on_flat(primitive, place, front)
                {
                    return at;
                }
                world.on_triangle(primitive, place, Vec3::Z)
            }
            Piece::SphereCell { primitive, row, column, rows, columns } => {
                let z = 1.0 - 2.0 * (row as f32 + u.x) / rows as f32;
                let (s, c) = (std::f32::consts::TAU * (column as f32 + u.y) / columns as f32).sin_cos();
                let r = (1.0 - z * z).max(0.0).sqrt();
                world.on_sphere(primitive, Vec3::new(r * c, r * s, z), Vec3::Z, 0.0)
            }
        };
        if si.front != front {
            (si.ng, si.ns, si.front) = (-si.ng, -si.ns, front);
        }
        si.wo = si.ng;
        si
    }

    /// Area of piece `index` in f64.
    fn piece_area(&self, world: &World, index: usize) -> f64 {
        match self.pieces[index] {
            Piece::Triangle { primitive, corners, inset } => {
                let Primitive::Triangle([a, b, c]) = world.soup().primitive(primitive) else { return 0.0 };
                let [p, q, r] = corners.map(|c| c.map(f64::from));
                let det = (q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1]);
                crate::geometry::triangle::area_vector(a, b, c).length() * det.abs() / f64::from(inset).powi(2)
            }
            Piece::SphereCell { primitive, rows, columns, .. } => match world.soup().primitive(primitive) {
                Primitive::Sphere(sphere) => sphere.area() / (f64::from(rows) * f64::from(columns)),
                Primitive::Triangle(_) => 0.0,
            },
        }
    }
}

/// True if a shape has patches: it emits, or some of it reflects diffusely.
pub fn needs_patches(scene: &Scene, shape: &Shape) -> bool {
    let material = &scene.material_of(shape).material;
    shape.emits() || material.has_diffuse()
}
