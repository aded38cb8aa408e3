//! The ways of computing form factors, behind one entry.

use super::blockers::Blockers;
use super::hemicube::{self, HemicubeSettings};
use super::hierarchy::{self, HierarchySettings};
use super::pairs::{self, PairSettings, Row, Surface};
use super::ray_cast::{self, RayCastSettings};
use super::virtual_rooms;
use super::visibility::Transfer;
use super::{FormFactors as _, Outside, Stored};
use crate::math::sampler::mix;
use crate::patch::{PatchId, PatchMesh};
use crate::progress::Observer;
use crate::world::World;
use crate::world::walk::RayCounts;
use rayon::prelude::*;

/// How form factors between patches are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, serde::Serialize, serde::Deserialize)]
pub enum FormFactorMethod {
    /// Pair by pair: the exact unobstructed kernel times the visible fraction.
    Analytic,
    /// Patches as they project on half cubes over points of each patch [Cohen85].
    Hemicube,
    /// The share of cosine-distributed rays that arrive [Malley88].
    #[default]
    RayCast,
    /// Links between groups of patches.
    Hierarchical,
}

impl FormFactorMethod {
    /// All methods.
    pub const ALL: [FormFactorMethod; 4] = [Self::Analytic, Self::Hemicube, Self::RayCast, Self::Hierarchical];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            FormFactorMethod::Analytic => "analytic",
            FormFactorMethod::Hemicube => "hemicube",
            FormFactorMethod::RayCast => "ray-cast",
            FormFactorMethod::Hierarchical => "hierarchical",
        }
    }

    /// The method of that name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name)
    }

    /// The tolerance where none is asked for: analytic, the error of an exchange relative to the unobstructed one; hierarchical, the bound on the
    /// error that each link leaves to the form factors between its nodes; the others, the standard error of any form factor.
    pub fn default_tolerance(self) -> f64 {
        match self {
            FormFactorMethod::Analytic | FormFactorMethod::Hierarchical => 1e-3,
            FormFactorMethod::Hemicube | FormFactorMethod::RayCast => 0.0221,
        }
    }
}

/// How form factors are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FormFactorSettings {
    /// The method.
    pub method: FormFactorMethod,
    /// In the sense of [`FormFactorMethod::default_tolerance`].
    pub tolerance: f64,
    /// Shadow rays that a patch of the full size sends: light that both kinds of rays find is shared in proportion.
    pub shadow_rays: f64,
    /// By way of mirrors, glass and gloss as well (extended form factors, [Sillion89]).
    pub extended: bool,
    /// By way of flat mirrors, so many in a row, as exchanges with virtual rooms [Wallace87]; beside extended ones they would count twice.
    /// Links between groups of patches hold none.
    pub virtual_rooms: Option<u32>,
    /// Rays of [`FormFactorMethod::RayCast`] start in pairs, and what they met is kept.
    pub in_pairs: bool,
    /// Seed of all rays.
    pub seed: u64,
}

/// Rays tell what leaves a scene without mirrors up to this standard error: that no row is taken for closed that is open by more.
const OPENNESS: f64 = 0.0442;
impl FormFactorMethod {
    /// A row whose sum is further from 1 than this is not scaled to it, whatever rays say of it.
    fn closed_within(self) -> f64 {
        match self {
            FormFactorMethod::Analytic => 0.02,
            _ => 0.25,
        }
    }
}

/// Share of the tolerance that the unobstructed kernel may use: next to shadows it costs little.
const KERNEL_SHARE: f64 = 0.03;

impl FormFactorSettings {
    /// Number of rays that find the surroundings for each shadow ray that a patch sends.
    pub fn rays_beside_shadow_rays(&self, world: &World) -> f64 {
        match self.method {
            FormFactorMethod::Hierarchical => self.links().rays_beside_shadow_rays,
            _ => self.rays(world).rays_beside_shadow_rays,
        }
    }

    fn links(&self) -> HierarchySettings {
        let links = HierarchySettings::for_tolerance(self.tolerance, self.shadow_rays, self.seed);
        HierarchySettings { max_events: if self.extended { links.max_events } else { 0 }, ..links }
    }

    /// The rays cast beside the method, or as the method: for what is seen by way of mirrors, glass and gloss, and outside.
    pub fn rays(&self, world: &World) -> RayCastSettings {
        let tolerance = match self.method {
            FormFactorMethod::RayCast => self.tolerance,
            _ if needs_rays(world) => (22.1 * self.tolerance).clamp(0.005, FormFactorMethod::RayCast.default_tolerance()),
            _ => OPENNESS,
        };
        let rays = RayCastSettings::for_tolerance(tolerance, self.shadow_rays, self.seed);
        RayCastSettings { max_events: if self.extended { rays.max_events } else { 0 }, in_pairs: self.in_pairs, ..rays }
    }
}

/// True if rays find light that form factors between patches do not hold: of the surroundings, or by way of anything that is not diffuse.
fn needs_rays(world: &World) -> bool {
    let scene = world.scene();
    scene.environment.is_some() || scene.shapes.iter().any(|s| !scene.material_of(s).material.is_diffuse())
}

/// Form factors of all patches, symmetric and closed, and what patches see outside; `None` if the observer stopped it.
pub fn build(
    world: &World,
    patches: &PatchMesh,
    settings: &FormFactorSettings,
    counts: &mut RayCounts,
    observer: &mut Observer<'_>,
) -> Option<(Stored, Outside)> {
    if settings.method == FormFactorMethod::Hierarchical {
        let (links, outside) = hierarchy::link(world, patches, &settings.links(), counts, observer)?;
        return Some((Stored::Links(Box::new(links)), outside));
    }
    let (mut matrix, mut outside) = ray_cast::cast(world, patches, &settings.rays(world), counts, observer)?;
    if let Some(reflections) = settings.virtual_rooms {
        let seed = mix(settings.seed ^ 0x0b1d);
        virtual_rooms::add(world, patches, (reflections, seed), &mut matrix, &mut outside, counts);
    }
    let exchanges: Vec<Row> = match settings.method {
        FormFactorMethod::RayCast | FormFactorMethod::Hierarchical => return Some((Stored::Rows(Box::new(matrix)), outside)),
        FormFactorMethod::Analytic => analytic(world, patches, settings, observer)?,
        FormFactorMethod::Hemicube => hemicube(world, patches, settings, counts, observer)?,
    };
    let upper: Vec<Vec<(u32, f64)>> = exchanges.iter().map(|row| row.iter().map(|(j, t)| (*j, t.value)).collect()).collect();
    let mut sums = vec![0.0; patches.len()];
    for (i, row) in upper.iter().enumerate() {
        for &(j, s) in row {
            sums[i] += s / patches.area[i];
            if j as usize != i {
                sums[j as usize] += s / patches.area[j as usize];
            }
        }
    }
    // Rays know which rows are closed by patches that are seen directly; of others, what is missing from 1 is outside or by other ways.
    let is_closed = |i: usize| matrix.direct_sum(i) > 1.0 - 1e-9 && (sums[i] - 1.0).abs() < settings.method.closed_within();
    let target: Vec<Option<f64>> = (0..patches.len()).map(|i| (is_closed(i) || sums[i] > 1.0).then_some(1.0)).collect();
    let beside = |i: usize| matrix.specular(i).map(|(_, f)| f.max()).sum::<f64>();
    if !needs_rays(world) {
        for (i, sum) in sums.iter().enumerate() {
            outside.set_open_share(i, (1.0 - matrix.direct_sum(i)).max(0.0), (1.0 - sum).max(0.0));
        }
    }
    let raw: Vec<f64> = (0..patches.len()).map(|i| sums[i] + beside(i) + outside.escaped(i).max()).collect();
    let (low, high) = raw.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), s| (l.min(*s), h.max(*s)));
    if !raw.is_empty() {
        (matrix.closure.row_sum_min, matrix.closure.row_sum_max) = (low, high);
        matrix.closure.escaped_max = (0..raw.len()).map(|i| outside.escaped(i).max()).fold(0.0, f64::max);
    }
    matrix.set_exchanges(&upper, &patches.area, &target);
    Some((Stored::Rows(Box::new(matrix)), outside))
}

/// What patches exchange, pair by pair, as the kernel and visibility give it.
pub fn analytic(
    world: &World,
    patches: &PatchMesh,
    settings: &FormFactorSettings,
    observer: &mut Observer<'_>,
) -> Option<Vec<Row>> {
    let blockers = Blockers::new(world);
    let seed = mix(settings.seed ^ 0x0a_a1);
    let surfaces: Vec<Surface> =
        (0..patches.len() as u32).into_par_iter().map(|i| Surface::of_patch(world, patches, PatchId(i), seed)).collect();
    let settings = PairSettings { tolerance: settings.tolerance, kernel_tolerance: KERNEL_SHARE * settings.tolerance, seed };
    pairs::transfers(world, &blockers, &surfaces, &settings, observer)
}

/// What patches exchange by hemicubes, the two directions of a pair averaged by their variances.
pub fn hemicube(
    world: &World,
    patches: &PatchMesh,
    settings: &FormFactorSettings,
    counts: &mut RayCounts,
    observer: &mut Observer<'_>,
) -> Option<Vec<Row>> {
    let hemicubes = HemicubeSettings::for_tolerance(settings.tolerance, mix(settings.seed ^ 0x0cbe));
    let rows = hemicube::project(world, patches, &hemicubes, counts, observer)?;
    Some(averaged(&rows, &patches.area))
}

/// What patches exchange by rays, symmetric and closed, with standard errors by the binomial law, and the reciprocity defect of what was
/// measured.
pub fn ray_cast(
    world: &World,
    patches: &PatchMesh,
    settings: &FormFactorSettings,
    counts: &mut RayCounts,
    observer: &mut Observer<'_>,
) -> Option<(Vec<Row>, f64)> {
    let rays = settings.rays(world);
    let (matrix, _) = ray_cast::cast(world, patches, &rays, counts, observer)?;
    // Rays per area: what a pair's two estimates weigh.
    let per_area = |i: usize| f64::from(rays.rays_of(patches, i)) / patches.area[i];
    let row = |i: usize| {
        let upper = matrix.direct(i).filter(|(j, _)| *j >= i);
        upper
            .map(|(j, f)| {
                let value = f * patches.area[i];
                // A hit more or less of both is the least that is not known.
                let hits = per_area(i) + per_area(j);
                let error = (value.max(1.0 / hits) / hits).sqrt();
                (j as u32, Transfer { value, error })
            })
            .collect()
    };
    Some(((0..patches.len()).map(row).collect(), matrix.closure.reciprocity_defect))
}

/// What patches exchange by links spread over their patches, symmetric and closed; the error is the bound that links were refined to.
pub fn hierarchical(
    world: &World,
    patches: &PatchMesh,
    settings: &FormFactorSettings,
    counts: &mut RayCounts,
    observer: &mut Observer<'_>,
) -> Option<(Vec<Row>, f64)> {
    let (links, _) = build(world, patches, settings, counts, observer)?;
    let row = |i: usize| {
        let mut upper = Row::new();
        links.row(i, &mut |j, f| {
            let transfer = |f: f64| Transfer { value: f * patches.area[i], error: settings.tolerance * f * patches.area[i] };
            if j >= i {
                upper.push((j as u32, transfer(f.g)));
            }
        });
        upper
    };
    Some(((0..patches.len()).map(row).collect(), links.closure().reciprocity_defect))
}

/// One exchange from the two directions in which each pair was measured: rows hold F_ij with its standard error. Each direction counts by the
/// inverse of its area, as its error does: weights by the errors that were found would favour what came out small.
pub fn averaged(rows: &[Vec<(u32, Transfer)>], area: &[f64]) -> Vec<Row> {
    let mut measured: Vec<Row> = vec![Row::new(); rows.len()];
    for (i, row) in rows.iter().enumerate() {
        for &(j, f) in row {
            let k = j as usize;
            // A patch with itself is measured once; a direction in which nothing was found counts with its 0.
            let share = if i == k { 1.0 } else { area[k] / (area[i] + area[k]) };
            let scale = area[i] * share;
            measured[i.min(k)].push((i.max(k) as u32, Transfer { value: f.value * scale, error: f.error * scale }));
        }
    }
    for (i, all) in measured.iter_mut().enumerate() {
        all.sort_by_key(|e| e.0);
        all.dedup_by(|second, first| {
            let same = second.0 == first.0;
            if same {
                first.1 = first.1.plus(second.1);
            }
            same
        });
        all.iter_mut().for_each(|(j, t)| t.value = t.value.min(area[i].min(area[*j as usize])));
    }
    measured
}
