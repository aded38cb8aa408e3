//! Form factors between shapes, or between patches, as a table: for those who want nothing else.

use crate::form_factor::blockers::{Blockers, merged};
use crate::form_factor::method::{self, FormFactorMethod, FormFactorSettings};
use crate::form_factor::pairs::{self, PairSettings, Row, Surface};
use crate::form_factor::polygon::Polygon;
use crate::form_factor::visibility::Transfer;
use crate::geometry::Ray;
use crate::math::{DVec3, Frame, Sampler, warp};
use crate::patch::{PatchId, PatchMesh};
use crate::progress::Observer;
use crate::scene::{ShapeSurface, SurfaceSource};
use crate::world::World;
use crate::world::walk::RayCounts;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Shapes of up to this many facets, and all shapes together of up to as many more, are taken facet by facet, in the exact coordinates of the
/// file; larger ones by their patches.
const MOST_FACETS: usize = 1024;
const MOST_FACETS_IN_ALL: usize = 6144;
/// Error of an unobstructed exchange between flat shapes: a hundredth of what is asked of it.
const KERNEL_TOLERANCE: f64 = 1e-11;
/// Rays by which it is found out whether a surface sees out of the scene.
const RAYS: u64 = 256;

/// What rows and columns of the table are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grouping {
    /// Shapes; the back of a two-sided one stands for itself.
    Shapes,
    /// Patches.
    Patches,
}

/// A row or column.
#[derive(Debug, Clone, PartialEq)]
pub struct Side {
    /// Id of the shape, with " (back)" behind it for the back of a two-sided one, or with "/" and the number of the patch.
    pub name: String,
    /// Area [m²].
    pub area: f64,
}

/// One entry, in both directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Entry {
    /// Index of the first side; not above `to`.
    pub from: u32,
    /// Index of the second.
    pub to: u32,
    /// A_i F_ij with its error [m²].
    pub transfer: Transfer,
}

/// The table.
#[derive(Debug, Clone)]
pub struct Table {
    /// Rows and columns.
    pub sides: Vec<Side>,
    /// Entries above zero, by rising `from` and `to`.
    pub entries: Vec<Entry>,
    /// Largest |1 - row sum| of sides that see nothing but others, and how many those are; 0 if there are none.
    pub row_sum_defect: (f64, usize),
    /// Largest relative difference between A_i F_ij and A_j F_ji before the two were made one; exactly 0 where a pair is measured once.
    pub reciprocity_defect: f64,
}

impl Table {
    /// Rows of the table: from, to, form factor and its standard error, for each direction; by rising from and to.
    pub fn rows(&self) -> Vec<(usize, usize, f64, f64)> {
        let mut rows = Vec::with_capacity(2 * self.entries.len());
        for e in &self.entries {
            let (i, j) = (e.from as usize, e.to as usize);
            let mut add = |i: usize, j: usize| {
                let area = self.sides[i].area;
                rows.push((i, j, (e.transfer.value / area).min(1.0), e.transfer.error / area));
            };
            add(i, j);
            if i != j {
                add(j, i);
            }
        }
        rows.sort_unstable_by_key(|r| (r.0, r.1));
        rows
    }
}

/// The table of a scene; `None` if the observer stopped it. `exact`: the shapes as they were read, in the same order.
pub fn table(
    world: &World,
    exact: &[SurfaceSource],
    patches: &PatchMesh,
    grouping: Grouping,
    settings: &FormFactorSettings,
    observer: &mut Observer<'_>,
) -> Option<Table> {
    let side_of_patch: Vec<(u32, bool)> = (0..patches.len() as u32).map(|i| patches.side_of(world, PatchId(i))).collect();
    let mut sides = Vec::new();
    let mut index = BTreeMap::new();
    // By shape and front first.
    for key in side_of_patch.iter().map(|(shape, front)| (*shape, !*front)).collect::<std::collections::BTreeSet<_>>() {
        let (shape, back) = key;
        index.insert((shape, !back), sides.len() as u32);
        let id = &world.scene().shapes[shape as usize].id;
        sides.push(Side { name: if back { format!("{id} (back)") } else { id.clone() }, area: 0.0 });
    }
    let mut reciprocity_defect = 0.0;
    let (owners, surfaces, rows): (Vec<u32>, Vec<Surface>, Vec<Row>) = match (settings.method, grouping) {
        (FormFactorMethod::Analytic, Grouping::Shapes) => {
            let (owners, surfaces) = exact_surfaces(world, exact, patches, &side_of_patch, &index, settings.seed);
            let pairs = PairSettings { tolerance: settings.tolerance, kernel_tolerance: KERNEL_TOLERANCE, seed: settings.seed };
            let rows = pairs::transfers(world, &Blockers::new(world), &surfaces, &pairs, observer)?;
            (owners, surfaces, rows)
        }
        _ => {
            let mut counts = RayCounts::default();
            let rows = match settings.method {
                FormFactorMethod::Analytic => method::analytic(world, patches, settings, observer)?,
                FormFactorMethod::Hemicube => method::hemicube(world, patches, settings, &mut counts, observer)?,
                FormFactorMethod::Hierarchical => {
                    let (rows, defect) = method::hierarchical(world, patches, settings, &mut counts, observer)?;
                    reciprocity_defect = defect;
                    rows
                }
                FormFactorMethod::RayCast => {
                    let (rows, defect) = method::ray_cast(world, patches, settings, &mut counts, observer)?;
                    reciprocity_defect = defect;
                    rows
                }
            };
            let surface = |i: u32| Surface::of_patch(world, patches, PatchId(i), settings.seed);
            let surfaces = (0..patches.len() as u32).into_par_iter().map(surface).collect();
            (side_of_patch.iter().map(|key| index[key]).collect(), surfaces, rows)
        }
    };
    let (owners, sides) = match grouping {
        Grouping::Shapes => (owners, sides),
        Grouping::Patches => {
            let name = |(i, owner): (usize, &u32)| Side { name: format!("{}/{i}", sides[*owner as usize].name), area: 0.0 };
            ((0..owners.len() as u32).collect(), owners.iter().enumerate().map(name).collect())
        }
    };
    Some(gathered(world, patches, &surfaces, &owners, sides, &rows, reciprocity_defect, settings.seed))
}

/// Sums what the surfaces of each side exchange.
#[expect(clippy::too_many_arguments, reason = "the last step of one function")]
fn gathered(
    world: &World,
    patches: &PatchMesh,
    surfaces: &[Surface],
    owners: &[u32],
    mut sides: Vec<Side>,
    rows: &[Row],
    reciprocity_defect: f64,
    seed: u64,
) -> Table {
    for (surface, owner) in surfaces.iter().zip(owners) {
        sides[*owner as usize].area += surface.area();
    }
    let mut sums: BTreeMap<(u32, u32), Transfer> = BTreeMap::new();
    for (i, row) in rows.iter().enumerate() {
        for (j, t) in row {
            let (a, b) = (owners[i], owners[*j as usize]);
            // Within one side a pair counts for both of its surfaces.
            let both = a == b && i != *j as usize;
            let t = if both { Transfer { value: 2.0 * t.value, error: 2.0 * t.error } } else { *t };
            let sum = sums.entry((a.min(b), a.max(b))).or_default();
            *sum = sum.plus(t);
        }
    }
    let mut totals = vec![0.0; sides.len()];
    for (&(a, b), t) in &sums {
        totals[a as usize] += t.value / sides[a as usize].area;
        if a != b {
            totals[b as usize] += t.value / sides[b as usize].area;
        }
    }
    let open: Vec<bool> = surfaces.par_iter().enumerate().map(|(i, s)| sees_out(world, patches, s, i as u64, seed)).collect();
    let mut closed = vec![true; sides.len()];
    open.iter().zip(owners).filter(|(open, _)| **open).for_each(|(_, owner)| closed[*owner as usize] = false);
    let defect = |(total, closed): (&f64, &bool)| if *closed { (total - 1.0).abs() } else { (total - 1.0).max(0.0) };
    let worst = totals.iter().zip(&closed).map(defect).fold(0.0, f64::max);
    let entries = sums.into_iter().map(|((from, to), transfer)| Entry { from, to, transfer }).collect();
    Table { sides, entries, row_sum_defect: (worst, closed.iter().filter(|c| **c).count()), reciprocity_defect }
}

/// True if a ray from the surface ends anywhere but at a patch.
fn sees_out(world: &World, patches: &PatchMesh, surface: &Surface, key: u64, seed: u64) -> bool {
    (0..RAYS).any(|k| {
        let mut sampler = Sampler::new(seed ^ 0x5ee5, key, k);
        let Some((x, n)) = surface.sample(&mut sampler) else { return false };
        let (x, n) = (x.as_vec3(), n.as_vec3());
        let error = crate::math::Vec3::splat(8.0 * f32::EPSILON * x.abs().max_element());
        let direction = Frame::new(n).to_world(warp::cosine_hemisphere(sampler.next_2d()));
        let ray = Ray::new(crate::geometry::offset_origin(x, error, n, direction), direction);
        world.intersect(&ray).is_none_or(|at| patches.patch_at(&at).is_none())
    })
}

/// The sides' facets in the exact coordinates of the file; patches of those that have too many, and of curved ones.
fn exact_surfaces(
    world: &World,
    exact: &[SurfaceSource],
    patches: &PatchMesh,
    side_of_patch: &[(u32, bool)],
    index: &BTreeMap<(u32, bool), u32>,
    seed: u64,
) -> (Vec<u32>, Vec<Surface>) {
    let (mut owners, mut surfaces) = (Vec::new(), Vec::new());
    let mut by_patches = vec![true; world.scene().shapes.len()];
    let mut left = MOST_FACETS_IN_ALL;
    for (shape, source) in exact.iter().enumerate() {
        let is_side = |front: bool| index.get(&(shape as u32, front)).copied();
        if is_side(true).is_none() && is_side(false).is_none() {
            continue;
        }
        let Some(facets) = facets(world, shape, source).filter(|f| f.len() <= MOST_FACETS.min(left)) else { continue };
        left -= facets.len();
        by_patches[shape] = false;
        for facet in facets {
            for front in [true, false] {
                if let Some(owner) = is_side(front) {
                    owners.push(owner);
                    surfaces.push(Surface::of_facets(vec![if front { facet.clone() } else { facet.flipped() }]));
                }
            }
        }
    }
    let patched = (0..patches.len() as u32).filter(|i| by_patches[side_of_patch[*i as usize].0 as usize]);
    for i in patched {
        owners.push(index[&side_of_patch[i as usize]]);
        surfaces.push(Surface::of_patch(world, patches, PatchId(i), seed));
    }
    (owners, surfaces)
}

/// The convex facets of a mesh, seen from its front; `None` for a sphere.
fn facets(world: &World, shape: usize, source: &SurfaceSource) -> Option<Vec<Polygon>> {
    let (SurfaceSource::Triangles(read), ShapeSurface::Mesh(mesh)) = (source, &world.scene().shapes[shape].surface) else {
        return None;
    };
    let origin = world.scene().origin;
    let corners = |k: usize| mesh.triangles[k].map(|v| read.positions[v as usize] - origin);
    let is_turned = |k: usize| {
        let [a, b, c] = corners(k);
        let seen = world.on_triangle(world.first_primitive(shape) + k as u32, (1.0 / 3.0, 1.0 / 3.0), crate::math::Vec3::Z);
        let front = if seen.front { seen.ng } else { -seen.ng };
        (b - a).cross(c - a).dot(front.as_dvec3()) < 0.0
    };
    let mut facets = Vec::new();
    let mut k = 0;
    while k < mesh.triangles.len() {
        let turned = is_turned(k);
        let pair = (k + 1 < mesh.triangles.len()).then(|| merged(corners(k), corners(k + 1), EXACTLY_COPLANAR)).flatten();
        let mut facet: Vec<DVec3> = pair.map_or_else(|| corners(k).to_vec(), |quad| quad.to_vec());
        k += 1 + usize::from(pair.is_some());
        if turned {
            facet.reverse();
        }
        facets.extend(Polygon::new(&facet));
    }
    Some(facets)
}

/// Quadrilaterals of f64 corners are flat to this share of their size: the form factors of what is not would be wrong by as much.
const EXACTLY_COPLANAR: f64 = 1e-13;
