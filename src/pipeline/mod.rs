//! Geometry, form factors, solve, render: the stages of the two passes in order.

mod adaptive;
mod allocation;
pub mod checkpoint;
pub mod cost;
pub mod direct;
pub mod form_factor_table;
mod groups;
pub mod keys;
mod lit_gltf;
pub mod pass_one;
pub mod probe;
mod progressive;
mod shown;
pub mod solution_file;
pub mod surface_points;

pub use checkpoint::{Checkpoint, CheckpointError};
pub use cost::{StageCost, StageCosts};
pub use direct::LampWeight;
pub use lit_gltf::lit_gltf;
pub use pass_one::{Kept, PassOne, PassOneSettings, Seen, Whole};

use crate::accel::{AccelError, AccelKind};
use crate::film::layer::Layer;
use crate::film::{Film, Quantity};
use crate::form_factor::FormFactorMethod;
use crate::integrator::drive::{Before, Budget, Clocks, Driven, Snapshot, drive};
use crate::integrator::{Frame, Integrator, IntegratorSettings, Method, MethodSettings, ReadOut};
use crate::math::SamplerKind;
use crate::patch::PatchError;
use crate::plan::{self, Asked, Plan};
use crate::progress::{Observer, Stage};
use crate::radiosity::SolveError;
use crate::scene::Scene;
use crate::world::stages::ByStages;
use crate::world::walk::RayCounts;
use crate::world::{DirectSampling, Stages, World};
use progressive::{Progressive, first_pass_one};
use std::sync::Arc;

/// Everything that a render depends on besides the scene.
#[derive(Debug, Clone)]
pub struct RenderSettings {
    /// The method.
    pub method: Method,
    /// How pass two reads pass one; `None`: as the method does.
    pub read_out: Option<ReadOut>,
    /// Size of the picture; `None`: the scene's.
    pub size: Option<(usize, usize)>,
    /// Part of the picture: left, top, width, height.
    pub crop: Option<[usize; 4]>,
    /// Longest light path in edges; `None`: the scene's; `Some(None)`: unlimited.
    pub max_depth: Option<Option<u32>>,
    /// When to stop; without any limit the scene's sample count holds.
    pub budget: Budget,
    /// Gather rays per camera sample.
    pub gather_rays: u32,
    /// What only single methods know.
    pub methods: MethodSettings,
    /// Seed of all random numbers.
    pub seed: u64,
    /// How samples of one pixel lie among each other.
    pub sampler: SamplerKind,
    /// Pass one.
    pub pass_one: PassOneSettings,
    /// Ray engine.
    pub accel: AccelKind,
    /// The unfinished run to go on from, of the same scene and settings.
    pub resume: Option<Arc<Checkpoint>>,
    /// Whether stages that the scene does not need are left out.
    pub plan: plan::Mode,
    /// Whether pictures of the progressive way are filtered by what their halves agree on.
    pub image_filter: bool,
}

/// Gather rays per camera sample. On the Cornell box 1, 2, 4 and 8 reach relMSE 3.8e-4, 2.2e-4, 1.78e-4 and 1.76e-4 in 8 CPU seconds;
/// of the two best, 4 adds passes, and with them antialiasing, more often.
pub const DEFAULT_GATHER_RAYS: u32 = 4;

/// Elements that the patch size aims at, unless it is given, where patches meet each other in virtual rooms.
const VIRTUAL_ELEMENTS: f64 = 1500.0;

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            method: Method::TwoPass,
            read_out: None,
            size: None,
            crop: None,
            max_depth: None,
            budget: Budget::default(),
            gather_rays: DEFAULT_GATHER_RAYS,
            methods: MethodSettings::default(),
            seed: 0,
            sampler: SamplerKind::default(),
            pass_one: PassOneSettings::default(),
            accel: AccelKind::default(),
            resume: None,
            plan: plan::Mode::default(),
            image_filter: true,
        }
    }
}

impl RenderSettings {
    /// The read-out in use; `None` for a method without a first pass.
    ///
    /// # Errors
    /// [`PipelineError::NoFirstPass`] if one was chosen for such a method.
    pub fn read_out(&self) -> Result<Option<ReadOut>, PipelineError> {
        match (self.method.read_out(), self.read_out) {
            (None, Some(_)) => Err(PipelineError::NoFirstPass(self.method)),
            (Some(own), Some(chosen)) if own != chosen && !self.method.has_read_outs() => {
                Err(PipelineError::OneReadOut(self.method))
            }
            (own, chosen) => Ok(chosen.or(own)),
        }
    }

    /// The stages that a scene needs.
    ///
    /// # Errors
    /// As [`Self::read_out`].
    pub fn plan_for(&self, world: &World) -> Result<Plan, PipelineError> {
        Ok(Plan::new(world, &self.asked(world)?))
    }

    /// What the plan has to know besides the scene.
    fn asked(&self, world: &World) -> Result<Asked, PipelineError> {
        let read_out = self.read_out()?;
        Ok(Asked {
            mode: self.plan,
            by_stages: self.method.is_by_stages(),
            max_depth: self.max_depth.unwrap_or(world.scene().film.max_depth),
            error_goal: self.budget.error,
            has_pass_one: read_out.is_some(),
            shows_pass_one: read_out == Some(ReadOut::Stored),
            gathers: matches!(read_out, Some(ReadOut::FinalGather | ReadOut::Progressive)),
            by_patch: self.pass_one.form_factors == FormFactorMethod::RayCast,
        })
    }

    /// What the method is told, for paths of at most `max_depth` edges.
    ///
    /// # Errors
    /// As [`Self::read_out`].
    pub fn integrator(&self, max_depth: Option<u32>) -> Result<IntegratorSettings, PipelineError> {
        Ok(IntegratorSettings {
            // Progressive is a way of rounds; each sample of it gathers.
            read_out: self.read_out()?.filter(|r| *r != ReadOut::Progressive).unwrap_or(ReadOut::FinalGather),
            max_depth,
            gather_rays: self.gather_rays,
            direct: DirectSampling::default(),
            seed: self.seed,
            sampler: self.sampler,
        })
    }
}

/// Why a run gave nothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PipelineError {
    /// The ray engine could not be set up.
    #[error(transparent)]
    Accel(#[from] AccelError),
    /// Too many patches.
    #[error(transparent)]
    Patch(#[from] PatchError),
    /// Patches and form factors would take more memory than they may.
    #[error(
        "pass one over about {patches} patches would take {} MB by {} form factors, more than the {} MB of --max-memory; \
         larger patches (--patch-size){} take less",
        predicted / 1_000_000, method.name(), limit / 1_000_000,
        if *method == FormFactorMethod::Hierarchical { " or a larger --tolerance" } else { " or --form-factors hierarchical" }
    )]
    Memory {
        /// Patches expected, or made.
        patches: u64,
        /// Bytes predicted.
        predicted: u64,
        /// The limit [bytes].
        limit: u64,
        /// How form factors were to be computed.
        method: FormFactorMethod,
    },
    /// No solution exists.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// The crop lies outside the picture or is empty.
    #[error("the crop {0:?} (left, top, width, height) does not lie inside the picture of {1}x{2} pixels")]
    Crop([usize; 4], usize, usize),
    /// A read-out was asked of a method that has no first pass.
    #[error("the method {} has no first pass, so there is no read-out to choose", .0.name())]
    NoFirstPass(Method),
    /// Another read-out was asked of a method that has one of its own.
    #[error("the method {} reads its first pass in one way only, so there is no read-out to choose", .0.name())]
    OneReadOut(Method),
    /// The state of an unfinished run is not one of this method in this version.
    #[error("the unfinished run was begun by another version of the method {}: render anew without --resume", .0.name())]
    Unfinished(Method),
    /// Links between groups of patches hold no virtual rooms.
    #[error(
        "two-pass-planar cannot be done with hierarchical form factors: links hold no virtual rooms; expected analytic, hemicube or ray-cast"
    )]
    NoVirtualRooms,
    /// Stopped before there was anything to show.
    #[error("stopped before the first picture")]
    Stopped,
}

/// What a render gave.
pub struct Rendered {
    /// The scene as it was used.
    pub world: World,
    /// Pass one; `None` if the method has none, or no light path is long enough to need it.
    pub pass_one: Option<PassOne>,
    /// The picture and its layers.
    pub film: Film,
    /// What was rendered.
    pub frame: Frame,
    /// The read-out used; `None` for a method without a first pass.
    pub read_out: Option<ReadOut>,
    /// Rays of both passes.
    pub counts: RayCounts,
    /// Time by stage, in order.
    pub stages: Vec<StageCost>,
    /// False if it was stopped before its budget was met.
    pub complete: bool,
    /// If it was stopped: what another process needs to go on, besides the film.
    pub unfinished: Option<(RayCounts, Vec<u8>)>,
    /// The stages kept and left out.
    pub plan: Plan,
}

impl Rendered {
    /// All layers of the EXR file: the picture itself, its parts, and what was seen.
    pub fn layers(&self) -> Vec<Layer> {
        let film = &self.film;
        let mut layers = vec![Layer::main(film.image())];
        layers.extend(Quantity::ALL.into_iter().map(|q| match q {
            Quantity::Normal => Layer::xyz(q.name(), film.quantity_image(q)),
            Quantity::Depth => Layer::z(q.name(), film.quantity_image(q).channel(0)),
            _ => Layer::rgb(q.name(), film.quantity_image(q)),
        }));
        layers.push(Layer::rgb("variance", film.variance_image()));
        layers
    }
}

/// Both passes: from a scene to a film.
///
/// `clocks` were started at the end of loading: time limits include the tree and pass one. `snapshot` sees the film after every pass.
///
/// # Errors
/// [`PipelineError`] if there is nothing to show.
pub fn render(
    scene: Scene,
    settings: &RenderSettings,
    clocks: &Clocks,
    observer: &mut Observer<'_>,
    snapshot: &mut Snapshot<'_>,
) -> Result<Rendered, PipelineError> {
    let mut watch = StageCosts::default();
    frame_of(&scene, settings)?;
    let world = watch.time(Stage::Tree, || World::new(scene, settings.accel))?;
    render_world(world, settings, clocks, watch, observer, snapshot)
}

/// Pass two over a kept solution, for a scene whose lamps were made `weights` times as strong.
///
/// The settings of pass one in `settings` are to be those of the solution. Otherwise as [`render`].
///
/// # Errors
/// [`PipelineError`] if there is nothing to show.
pub fn render_kept(
    scene: Scene,
    settings: &RenderSettings,
    (kept, weights): (Whole, &[LampWeight]),
    clocks: &Clocks,
    observer: &mut Observer<'_>,
    snapshot: &mut Snapshot<'_>,
) -> Result<Rendered, PipelineError> {
    let mut watch = StageCosts::default();
    frame_of(&scene, settings)?;
    let world = watch.time(Stage::Tree, || World::new(scene, settings.accel))?;
    let pass_one = watch.time(Stage::Patches, || kept.weighted(&world, weights));
    render_over((world, Some(pass_one)), settings, clocks, watch, observer, snapshot)
}

/// Both passes over a world that is ready; `watch` holds what making it cost.
///
/// # Errors
/// As [`render`].
pub fn render_world(
    world: World,
    settings: &RenderSettings,
    clocks: &Clocks,
    watch: StageCosts,
    observer: &mut Observer<'_>,
    snapshot: &mut Snapshot<'_>,
) -> Result<Rendered, PipelineError> {
    render_over((world, None), settings, clocks, watch, observer, snapshot)
}

/// Both passes, or the second over a first one that is there.
fn render_over(
    (mut world, given): (World, Option<PassOne>),
    settings: &RenderSettings,
    clocks: &Clocks,
    watch: StageCosts,
    observer: &mut Observer<'_>,
    snapshot: &mut Snapshot<'_>,
) -> Result<Rendered, PipelineError> {
    let plan = settings.plan_for(&world)?;
    plan.apply(&mut world);
    plan.needs.choose(Render { world, given, settings, clocks, watch, observer, snapshot, plan })
}

/// A render whose stages are known.
struct Render<'a, 'o, 's> {
    world: World,
    given: Option<PassOne>,
    settings: &'a RenderSettings,
    clocks: &'a Clocks,
    watch: StageCosts,
    observer: &'a mut Observer<'o>,
    snapshot: &'a mut Snapshot<'s>,
    plan: Plan,
}

impl ByStages for Render<'_, '_, '_> {
    type Output = Result<Rendered, PipelineError>;

    fn run<K: Stages>(self) -> Self::Output {
        let Render { world, given, settings, clocks, mut watch, observer, snapshot, plan } = self;
        let scene = world.scene();
        let frame = frame_of(scene, settings)?;
        let max_depth = plan.max_depth;
        let mut budget = settings.budget;
        if budget.is_unlimited() {
            budget.spp = Some(scene.film.sample_count);
        }
        let read_out = settings.read_out()?;
        let mut counts = RayCounts::default();
        let progressive = read_out == Some(ReadOut::Progressive);
        // A path of two edges or fewer never meets a second diffuse surface.
        // Nor is there anything to read where nothing shines or nothing is diffuse.
        let is_read = read_out.is_some_and(|r| r == ReadOut::Stored || max_depth.is_none_or(|d| d > 2))
            && scene.may_emit()
            && scene.has_diffuse();
        let coarse = progressive || settings.method == Method::TwoPassUnbiased;
        let mut first = if coarse { first_pass_one(&settings.pass_one, &world) } else { settings.pass_one };
        first.extended &= settings.method.extends_form_factors();
        if settings.method == Method::TwoPassPlanar {
            if first.form_factors == FormFactorMethod::Hierarchical {
                return Err(PipelineError::NoVirtualRooms);
            }
            first.virtual_rooms = Some(settings.methods.virtual_rooms.reflections);
            // Every patch meets every other in each room.
            first.patches.elements = first.patches.elements.min(VIRTUAL_ELEMENTS);
        }
        let mut pass_one = given.filter(|_| is_read);
        if pass_one.is_none() && plan.pass_one {
            match pass_one::solve(&world, &first, settings.seed, &mut watch, &mut counts, observer) {
                Ok(solved) => pass_one = Some(solved),
                // What is solved for nobody to read may fail.
                Err(error) if is_read || error == PipelineError::Stopped => return Err(error),
                Err(_) => {}
            }
        }
        let mut integrator = settings.integrator(max_depth)?;
        if integrator.read_out == ReadOut::FinalGather && !plan.gather && settings.method.has_read_outs() {
            integrator.read_out = ReadOut::DirectStored;
        }
        if progressive && scene.may_emit() {
            let (pass_one, unread) = if is_read { (pass_one, None) } else { (None, pass_one) };
            let mut method = Progressive::<K>::new(&world, settings, integrator, pass_one, counts);
            let driven = watch.time(Stage::Render, || {
                let before = take_up(&mut method, settings)?;
                Ok::<Driven, PipelineError>(drive(&mut method, (&frame, before), &budget, clocks, observer, snapshot))
            })?;
            watch.take_off(Stage::Render, clocks.excluded());
            let Driven { film, complete, counts: pass_two } = driven;
            let unfinished = (!complete).then(|| (pass_two, method.state()));
            let counts = method.counts;
            let pass_one = method.finish(&mut watch).or(unread);
            let stages = watch.stages;
            return Ok(Rendered { pass_one, film, frame, read_out, counts, stages, complete, unfinished, plan, world });
        }
        let field = pass_one.as_ref().filter(|_| is_read).map(|p| &p.field);
        let mut method = settings.method.integrator::<K>(&world, field, integrator, &settings.methods);
        let before = take_up(&mut *method, settings)?;
        let Driven { film, counts: pass_two, complete } =
            watch.time(Stage::Render, || drive(&mut *method, (&frame, before), &budget, clocks, observer, snapshot));
        watch.take_off(Stage::Render, clocks.excluded());
        let unfinished = (!complete).then(|| (pass_two, method.state()));
        counts += pass_two;
        drop(method);
        Ok(Rendered { pass_one, film, frame, read_out, counts, stages: watch.stages, complete, unfinished, plan, world })
    }
}

/// Makes a method go on with an unfinished run, if there is one; its film and rays.
fn take_up<'a>(integrator: &mut dyn Integrator, settings: &'a RenderSettings) -> Result<Before<'a>, PipelineError> {
    let Some(checkpoint) = &settings.resume else { return Ok(None) };
    if !integrator.take_up(&checkpoint.state) {
        return Err(PipelineError::Unfinished(settings.method));
    }
    Ok(Some((&checkpoint.film, checkpoint.counts)))
}

/// What pass one alone gave.
pub struct Solved {
    /// The scene as it was used.
    pub world: World,
    /// The solution.
    pub pass_one: PassOne,
    /// Rays cast.
    pub counts: RayCounts,
    /// Time by stage.
    pub stages: Vec<StageCost>,
    /// The stages kept and left out.
    pub plan: Plan,
}

/// Pass one alone.
///
/// # Errors
/// [`PipelineError`] if there is no solution.
pub fn solve(scene: Scene, settings: &RenderSettings, observer: &mut Observer<'_>) -> Result<Solved, PipelineError> {
    let mut costs = StageCosts::default();
    let world = costs.time(Stage::Tree, || World::new(scene, settings.accel))?;
    solve_world(world, settings, costs, observer)
}

/// Pass one alone over a world that is ready; `costs` holds what making it cost.
///
/// # Errors
/// As [`solve`].
pub fn solve_world(
    world: World,
    settings: &RenderSettings,
    costs: StageCosts,
    observer: &mut Observer<'_>,
) -> Result<Solved, PipelineError> {
    solve_from(world, settings, Kept::default(), costs, observer)
}

/// Pass one alone, as far as it is not `kept` from an earlier run.
///
/// # Errors
/// As [`solve`].
pub fn solve_from(
    mut world: World,
    settings: &RenderSettings,
    kept: Kept,
    mut costs: StageCosts,
    observer: &mut Observer<'_>,
) -> Result<Solved, PipelineError> {
    // What pass one itself was asked for is never left out.
    let shown = RenderSettings { read_out: Some(ReadOut::Stored), method: Method::TwoPass, ..settings.clone() };
    // Nor is what one camera does not see.
    let plan = Plan::new(&world, &Asked { by_patch: false, ..shown.asked(&world)? });
    world.leave_out(plan.needs, plan.one_channel);
    let mut counts = RayCounts::default();
    let settings = (&settings.pass_one, settings.seed);
    let pass_one = pass_one::solve_from(&world, settings, kept, &mut costs, &mut counts, observer)?;
    Ok(Solved { world, pass_one, counts, stages: costs.stages, plan })
}

fn frame_of(scene: &Scene, settings: &RenderSettings) -> Result<Frame, PipelineError> {
    let (width, height) = settings.size.unwrap_or((scene.film.width, scene.film.height));
    let mut frame = Frame::whole(width, height);
    if let Some(crop) = settings.crop {
        let [x, y, w, h] = crop;
        let inside =
            |start: usize, length: usize, whole: usize| length > 0 && start.checked_add(length).is_some_and(|end| end <= whole);
        if !inside(x, w, width) || !inside(y, h, height) {
            return Err(PipelineError::Crop(crop, width, height));
        }
        frame.crop = crop;
    }
    Ok(frame)
}
