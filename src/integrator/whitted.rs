//! Whitted's recursion over the solution of pass one: I = I_local + Kr R + Kt T [Whitted80].

use super::irradiance_cache::{Gap, IrradianceCache};
use super::{Frame as FilmFrame, Integrator, ReadOut, Start, TwoPass, branches};
use crate::film::{PixelSample, Quantity};
use crate::geometry::Ray;
use crate::math::{Frame, Rgb, Sampler, sampler::mix, warp};
use crate::radiosity::RadiosityField;
use crate::world::sight::{balance, cosine_density};
use crate::world::walk::RayCounts;
use crate::world::{Shading, ShadowRay, Sight, Stages, SurfaceInteraction};

/// No recursion goes deeper, whatever the scene asks: a closed box of perfect mirrors would never end.
const DEEPEST: u32 = 512;

/// Where in the recursion a ray is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Path {
    /// Radiance at the camera over radiance along the ray.
    pub weight: Rgb,
    /// Specular events so far.
    pub depth: u32,
    /// Power left since branches are chosen at random, without the n² scaling: decides how likely the path goes on.
    pub survival: f64,
    /// Which emission along the ray is its to count.
    pub sight: Sight,
    /// Length from the camera to where the ray starts [m].
    pub length: f32,
}

impl Path {
    /// A ray from the camera.
    pub const START: Path = Path { weight: Rgb::WHITE, depth: 0, survival: 1.0, sight: Sight::Alone, length: 0.0 };
}

/// What one camera sample carries along its recursion.
pub(super) struct Trace<'a> {
    pub sampler: Sampler,
    /// Key of the pixel's gather rays.
    pub key: u64,
    /// Index of the pass within its half.
    pub index: u64,
    pub counts: &'a mut RayCounts,
    pub sample: PixelSample,
    /// Emission that the ray and its reflections have met, as seen by the camera.
    pub seen: Rgb,
    /// Nothing else is looked for.
    pub glances: bool,
    /// Where an irradiance cache is being filled: nothing is lit then, gaps are noted.
    pub collect: Option<Collect<'a>>,
}

/// Places that lack a record.
pub(super) struct Collect<'a> {
    pub cache: &'a IrradianceCache,
    /// Width of a pixel at distance 1.
    pub per_distance: f32,
    pub gaps: Vec<Gap>,
}

impl<'a> Trace<'a> {
    pub fn new(sampler: Sampler, key: u64, index: u64, counts: &'a mut RayCounts) -> Self {
        Self { sampler, key, index, counts, sample: PixelSample::default(), seen: Rgb::BLACK, glances: false, collect: None }
    }
}

impl<K: Stages> Integrator for TwoPass<'_, K> {
    fn pass(&mut self, frame: &FilmFrame, index: u32) -> (Vec<PixelSample>, RayCounts) {
        super::each_pixel(self.world, &self.settings, frame, index, |start, counts| self.sample(start, counts))
    }

    fn is_signed(&self) -> bool {
        self.residual.is_some()
    }
}

impl<K: Stages> TwoPass<'_, K> {
    fn sample(&self, start: Start, counts: &mut RayCounts) -> PixelSample {
        let mut trace = Trace::new(start.sampler, mix(start.seed ^ start.key), start.index, counts);
        self.radiance(&start.ray, Path::START, &mut trace);
        *trace.sample.layer(Quantity::Direct) += trace.seen;
        trace.sample
    }

    /// Longest path in edges, bounded.
    pub(super) fn depth_limit(&self) -> u32 {
        self.settings.max_depth.map_or(DEEPEST, |d| d.min(DEEPEST))
    }

    /// Adds what arrives along `ray` to the sample.
    pub(super) fn radiance(&self, ray: &Ray, path: Path, trace: &mut Trace<'_>) {
        if K::PLAIN {
            self.plain_radiance(ray, path, trace);
            return;
        }
        let Path { weight, depth, .. } = path;
        if depth >= self.depth_limit() {
            trace.counts.truncate(weight);
            return;
        }
        let Some(si) = self.world.intersect_by::<K>(ray) else {
            if K::DISTANT {
                trace.counts.distant += 1;
                let share = self.world.escape_share(&path.sight, ray.direction);
                trace.seen += weight * self.world.scene().escaped_radiance(ray.direction) * share;
            }
            return;
        };
        let shape = &self.world.scene().shapes[si.shape as usize];
        if depth == 0 {
            *trace.sample.layer(Quantity::Depth) += Rgb::grey(f64::from(si.t));
            *trace.sample.layer(Quantity::Normal) += Rgb::from(si.ns.to_array());
        }
        if si.front && shape.emits() {
            let share = self.world.emission_share(&path.sight, ray.direction, &si);
            trace.seen += weight * shape.emitted(si.uv) * share;
        }
        trace.counts.met::<K>();
        let shading = self.world.shading_by::<K>(&si);
        if !K::SPECULAR {
            if shading.has_diffuse() {
                if trace.glances {
                    self.stored(&si, &shading, path.weight * shading.diffuse_reflectance(), trace);
                } else {
                    self.local(&si, &shading, 0.0, &path, trace);
                }
            }
            return;
        }
        trace.counts.lobes += 1;
        let branches = self.branches(&shading, &path, trace);
        if trace.glances {
            self.stored(&si, &shading, path.weight * shading.diffuse_reflectance(), trace);
        } else if shading.has_diffuse() || shading.has_glossy() {
            self.local(&si, &shading, branches.glossy, &path, trace);
        }
        branches::follow(self, &si, &shading, &branches, &path, trace);
    }

    /// What pass one knows of the diffuse part, seen with a weight and reflectance of `weight_rho`; gives the irradiance that it accepts [W/m²].
    fn stored(&self, si: &SurfaceInteraction, shading: &Shading<'_>, weight_rho: Rgb, trace: &mut Trace<'_>) -> Option<Rgb> {
        *trace.sample.layer(Quantity::Albedo) += weight_rho;
        let field = self.field.filter(|_| shading.has_diffuse())?;
        let [stored, irradiance] = field.accepted_and_whole(si);
        *trace.sample.layer(Quantity::Radiosity) += RadiosityField::reflected_radiance(weight_rho, stored);
        *trace.sample.layer(Quantity::Irradiance) += irradiance;
        Some(stored)
    }

    /// I_local: what the diffuse and glossy parts reflect of the lights, and the diffuse part of everything else, by the chosen read-out
    /// of pass one. `glossy_rays` is the expected number of rays that follow the glossy lobes.
    pub(super) fn local(
        &self,
        si: &SurfaceInteraction,
        shading: &Shading<'_>,
        glossy_rays: f64,
        path: &Path,
        trace: &mut Trace<'_>,
    ) {
        let Path { weight, depth, .. } = *path;
        let weight_rho = weight * shading.diffuse_reflectance();
        let limit = self.depth_limit();
        let reflect = |h: Rgb| RadiosityField::reflected_radiance(weight_rho, h);
        let mut read_out = self.settings.read_out;
        if let (Some(field), Some(stored)) = (self.field, self.stored(si, shading, weight_rho, trace)) {
            if read_out == ReadOut::Stored && depth + 2 <= limit {
                let shown = self.smooth.as_ref().map_or(stored, |smooth| smooth.irradiance(field, si));
                *trace.sample.layer(Quantity::Indirect) += reflect(shown);
            }
        } else if read_out != ReadOut::FinalGather && !shading.has_diffuse() {
            // Gloss alone has nothing stored.
            read_out = ReadOut::DirectStored;
        }
        let stored_only = read_out == ReadOut::Stored && self.field.is_some();
        let diffuse_wanted = !(stored_only || weight_rho.is_black());
        if depth + 2 > limit || !(diffuse_wanted || shading.has_glossy()) {
            return;
        }
        if let Some(collect) = &mut trace.collect {
            if diffuse_wanted && read_out == ReadOut::FinalGather && !collect.cache.has(si, shading.normal()) {
                collect.gaps.push(Gap { si: *si, pixel: collect.per_distance * (path.length + si.t) });
            }
            return;
        }
        let gathers = diffuse_wanted && read_out == ReadOut::FinalGather;
        let cached = self.cache.filter(|_| gathers).and_then(|cache| cache.read(si.point, shading.normal(), si.shape));
        // Shadow rays share light with as many gather rays as there are, or as records took them to be.
        let gather_rays = match cached {
            Some(_) => self.settings.gather_rays,
            None if read_out == ReadOut::FinalGather => self.gather_rays(weight_rho),
            None => 0,
        };
        let respond = |ray: &ShadowRay| {
            let mut response = shading.eval(ray.direction);
            let cos = ray.direction.dot(shading.normal());
            let share = if diffuse_wanted { ray.share_beside_gather_rays(f64::from(gather_rays), cos) } else { 0.0 };
            response.diffuse = response.diffuse * share;
            if K::SPECULAR && !response.glossy.is_black() {
                response.glossy = response.glossy * balance(ray.density, glossy_rays * shading.glossy_pdf(ray.direction));
            }
            response
        };
        let direct =
            self.world.direct_by::<K>(si, shading.receiver(), self.settings.direct, &mut trace.sampler, trace.counts, respond);
        *trace.sample.layer(Quantity::Direct) += weight * (direct.diffuse + direct.glossy);
        if !diffuse_wanted {
            return;
        }
        if let Some(map) = self.caustics.filter(|_| gathers) {
            *trace.sample.layer(Quantity::Caustic) += reflect(map.irradiance(si, shading));
        }
        match (read_out, self.field) {
            (ReadOut::FinalGather, _) => match cached {
                Some(found) => {
                    *trace.sample.layer(Quantity::Indirect) += reflect(found.reflected);
                    *trace.sample.layer(Quantity::Caustic) += reflect(found.emitted);
                }
                None => self.gather(si, shading, weight, depth, gather_rays, trace),
            },
            (_, Some(field)) => {
                let rest = match &self.smooth {
                    Some(smooth) => smooth.rest_irradiance(field, si),
                    None => field.rest_irradiance(si),
                };
                *trace.sample.layer(Quantity::Indirect) += reflect(rest);
            }
            (_, None) => {
                *trace.sample.layer(Quantity::Indirect) += weight_rho * self.ambient;
                if self.world.partition().leaves_some() {
                    let seen = self.seen_by_chance(si, shading, trace);
                    *trace.sample.layer(Quantity::Direct) += weight * seen;
                }
            }
        }
    }

    /// What the diffuse part reflects of emitters that no shadow ray looks for (large lamps, even surroundings), by one
    /// cosine-distributed ray that goes straight on through plates and ends at the first surface else.
    fn seen_by_chance(&self, si: &SurfaceInteraction, shading: &Shading<'_>, trace: &mut Trace<'_>) -> Rgb {
        let scene = self.world.scene();
        let local = warp::cosine_hemisphere(trace.sampler.next_2d());
        let direction = Frame::new(shading.normal()).to_world(local);
        let mut carried = shading.eval(direction).diffuse / cosine_density(1.0, local.z);
        let mut found = Rgb::BLACK;
        let mut ray = si.spawn(direction);
        trace.counts.gather += 1;
        for _ in 0..DEEPEST {
            if carried.is_black() {
                break;
            }
            let Some(met) = self.world.intersect_by::<K>(&ray) else {
                if K::DISTANT && self.world.partition().environment().is_none() {
                    found += carried * scene.escaped_radiance(ray.direction);
                }
                break;
            };
            if met.front && !self.world.partition().found_by_shadow_rays(met.shape as usize) {
                found += carried * scene.shapes[met.shape as usize].emitted(met.uv);
            }
            if !K::SPECULAR {
                break;
            }
            carried *= self.world.shading_by::<K>(&met).straight_share();
            ray.t_min = met.end;
        }
        found
    }
}
