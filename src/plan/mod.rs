//! What this scene needs: which stages are kept, which are left out, and why.
//!
//! Every decision rests on bounds over whole materials, lights and shapes, never on samples: what is left out could not have
//! contributed. The picture is therefore the same, bit for bit, as with every stage at work ([`Mode::Full`]).

mod parts;

use crate::scene::Scene;
use crate::world::World;
use crate::world::regions::Regions;
use crate::world::stages::Needs;

/// Whether stages may be left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// What the scene does not need is left out.
    #[default]
    Lean,
    /// Every stage works, whether it finds anything or not.
    Full,
}

impl Mode {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Mode::Lean => "lean",
            Mode::Full => "full",
        }
    }
}

/// What is asked for besides the scene.
#[derive(Debug, Clone, Copy)]
pub struct Asked {
    /// Whether stages may be left out.
    pub mode: Mode,
    /// True if rays are followed by code that is compiled for the stages a scene needs.
    pub by_stages: bool,
    /// Longest light path in edges; `None`: unlimited.
    pub max_depth: Option<u32>,
    /// The error (relMSE) that is good enough; `None`: none is.
    pub error_goal: Option<f64>,
    /// True if the method has a first pass.
    pub has_pass_one: bool,
    /// True if the first pass is shown as it is, however short the paths.
    pub shows_pass_one: bool,
    /// True if the method gathers.
    pub gathers: bool,
    /// True if form factors are made patch by patch, and for this camera only.
    pub by_patch: bool,
}

/// Edges of light straight from a lamp to a surface that is seen.
const DIRECT: u32 = 2;
/// What is left out may add this share of the error that is good enough.
const NEGLIGIBLE: f64 = 0.01;
/// Added to squared radiances where relative errors are measured: a pixel's squared error counts over at least this.
const FLOOR: f64 = 0.01;

/// One stage and what becomes of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Decision {
    /// Name of the stage.
    pub stage: &'static str,
    /// True if it is kept.
    pub kept: bool,
    /// Why.
    pub reason: String,
}

/// The stages of a render.
#[derive(Debug, Clone)]
pub struct Plan {
    /// What the code that follows rays must hold.
    pub needs: Needs,
    /// True if pass one is solved.
    pub pass_one: bool,
    /// True if pass one solves one channel for the three.
    pub one_channel: bool,
    /// Longest light path in edges: as asked, or shorter where what is longer is below a hundredth of the error that is good enough.
    pub max_depth: Option<u32>,
    /// True if there may be light.
    pub light: bool,
    /// True if rays gather at diffuse surfaces, if the method gathers.
    pub gather: bool,
    /// Sides of triangles (front, back) whose light cannot count in the picture; `None` if there are none.
    pub idle: Option<Vec<[bool; 2]>>,
    /// True if pass one does nothing for those.
    pub leaves_idle: bool,
    /// All of it with its reasons.
    pub decisions: Vec<Decision>,
}

/// True if the scene needs a stage, and why.
type Verdict = (bool, String);

impl Plan {
    /// Decides for a scene.
    pub fn new(world: &World, asked: &Asked) -> Plan {
        let scene = world.scene();
        let (interreflection, limit) = (interreflection(scene, asked), depth(asked));
        // Nothing that follows needs to know why paths are short.
        let is_cut = asked.mode == Mode::Lean && !interreflection.0;
        let max_depth = if is_cut { Some(DIRECT) } else { asked.max_depth };
        let asked = &Asked { max_depth, ..*asked };
        let (specular, distant, textures) = (specular(scene), distant(scene), textures(scene));
        let open = specular.0 || distant.0;
        let simple = !specular.0 && !textures.0;
        let parts = parts::parts(world, asked, specular.0);
        let verdicts = [
            ("recursion", specular),
            ("texture-coordinates", textures),
            ("distant-light", distant),
            ("visibility", visibility(world, open)),
            ("curvature", curvature(world, simple)),
            ("light", light(scene)),
            ("pass-one", pass_one(scene, asked)),
            ("three-channels", channels(scene)),
            ("gather", gather(world, asked, &parts)),
            ("dark-surfaces", parts::dark(&parts)),
            ("unseen-surfaces", parts::unseen(&parts)),
            ("shadow-rays", shadow_rays(world, asked)),
            ("light-choice", choice(world)),
            ("depth-limit", limit),
            ("interreflection", interreflection),
        ];
        let is_needed = |name: &str| verdicts.iter().any(|(stage, (needed, _))| *stage == name && *needed);
        let full = asked.mode == Mode::Full;
        let kept = |name: &str| full || is_needed(name);
        let follows = |name: &str| !asked.by_stages || kept(name);
        let needs = Needs {
            specular: follows("recursion"),
            uv: follows("texture-coordinates"),
            distant: follows("distant-light"),
            visibility: follows("visibility"),
            curved: follows("curvature"),
            colour: follows("three-channels"),
        }
        .held();
        let (pass_one, one_channel, gather) =
            (asked.has_pass_one && kept("pass-one"), !kept("three-channels"), asked.gathers && kept("gather"));
        let decide = |(stage, (needed, reason)): (&'static str, Verdict)| {
            // Neither is work that could be done to no effect.
            let optional = !matches!(stage, "light-choice" | "depth-limit");
            let held = match stage {
                "recursion" => needs.specular,
                "texture-coordinates" => needs.uv,
                "distant-light" => needs.distant,
                "visibility" => needs.visibility,
                "curvature" => needs.curved,
                _ => false,
            };
            if held && !needed && !full {
                return Decision {
                    stage,
                    kept: true,
                    reason: format!("there is no code without it for the rest, though {reason}"),
                };
            }
            let forced = full && !needed && optional;
            let asked_for = match stage {
                "pass-one" => asked.has_pass_one,
                "gather" => asked.gathers || world.partition().leaves_some(),
                "dark-surfaces" | "unseen-surfaces" => asked.has_pass_one,
                "shadow-rays" => !world.partition().has_no_shadow_rays(),
                _ => true,
            };
            let reason = if forced && asked_for { format!("not needed, but --plan full: {reason}") } else { reason };
            Decision { stage, kept: asked_for && (needed || forced), reason }
        };
        let is_idle = |verdict: Verdict| !verdict.0;
        let idle = parts.as_ref().ok().filter(|_| is_idle(parts::dark(&parts)) || is_idle(parts::unseen(&parts)));
        Plan {
            needs,
            idle: idle.map(Regions::idle),
            leaves_idle: !full,
            pass_one,
            one_channel,
            max_depth,
            light: kept("light"),
            gather,
            decisions: verdicts.into_iter().map(decide).collect(),
        }
    }
}

impl Plan {
    /// Tells a world what is left out.
    pub fn apply(&self, world: &mut World) {
        world.leave_out(self.needs, self.one_channel);
        if let Some(idle) = &self.idle {
            world.leave_idle(idle.clone(), self.leaves_idle);
        }
        if !self.light {
            world.forget_lights();
        }
    }
}

fn specular(scene: &Scene) -> Verdict {
    match scene.first_specular() {
        Some(shape) => (true, format!("the surface of {} does not reflect diffusely only", shape.id)),
        None => (false, "every surface reflects diffusely only".to_owned()),
    }
}

fn textures(scene: &Scene) -> Verdict {
    match scene.first_textured() {
        Some(shape) => (true, format!("{} may differ from place to place", shape.id)),
        None => (false, "every surface is the same all over".to_owned()),
    }
}

fn distant(scene: &Scene) -> Verdict {
    if scene.has_distant_light() {
        (true, "light comes from infinitely far away".to_owned())
    } else {
        (false, "no surroundings and no sun".to_owned())
    }
}

fn visibility(world: &World, open: bool) -> Verdict {
    if open {
        (true, "a surface is specular or light comes from outside".to_owned())
    } else if world.is_convex_room() {
        (false, "all surfaces lie on a convex hull: nothing hides a light".to_owned())
    } else {
        (true, "surfaces may hide lights".to_owned())
    }
}

fn curvature(world: &World, simple: bool) -> Verdict {
    if !simple {
        (true, "surfaces are not all alike all over and diffuse".to_owned())
    } else if world.is_plain() {
        (false, "every surface is flat: its normal and reflectance are known beforehand".to_owned())
    } else {
        (true, "a surface is curved, has normals at its vertices, is a blend, or there are too many".to_owned())
    }
}

fn light(scene: &Scene) -> Verdict {
    if scene.may_emit() {
        (true, "something shines".to_owned())
    } else {
        (false, "nothing shines: the picture is black".to_owned())
    }
}

fn pass_one(scene: &Scene, asked: &Asked) -> Verdict {
    if !asked.has_pass_one {
        (false, "the method has none".to_owned())
    } else if !scene.may_emit() {
        (false, "nothing emits".to_owned())
    } else if !scene.has_diffuse() {
        (false, "no surface is diffuse".to_owned())
    } else if !asked.shows_pass_one && asked.max_depth.is_some_and(|d| d <= 2) {
        (false, "paths of two edges meet no second diffuse surface".to_owned())
    } else {
        (true, "diffuse surfaces light each other".to_owned())
    }
}

fn channels(scene: &Scene) -> Verdict {
    if scene.is_grey() {
        (false, "all reflectances and emissions are grey: one channel stands for three".to_owned())
    } else {
        (true, "something is coloured".to_owned())
    }
}

/// Rays to lights.
fn shadow_rays(world: &World, asked: &Asked) -> Verdict {
    if asked.max_depth.is_some_and(|d| d < DIRECT) && !asked.shows_pass_one {
        (false, "within one edge only what shines is seen".to_owned())
    } else if !world.partition().has_no_shadow_rays() {
        (true, "lights are found by rays to them".to_owned())
    } else {
        (false, "no light is left to rays towards it".to_owned())
    }
}

fn gather(world: &World, asked: &Asked, parts: &Result<Regions, &'static str>) -> Verdict {
    let scene = world.scene();
    let partition = world.partition();
    let by_shadow_rays = || {
        let mut emitters = scene.shapes.iter().enumerate().filter(|(_, shape)| shape.emits());
        scene.environment.is_none() && emitters.all(|(i, _)| partition.found_by_shadow_rays(i))
    };
    if !asked.gathers {
        match partition.leaves_some() {
            true => (true, "one ray at a surface looks for large emitters where no solution holds them".to_owned()),
            false => (false, "the read-out does not gather".to_owned()),
        }
    } else if !scene.may_emit() {
        (false, "nothing emits".to_owned())
    } else if !scene.has_diffuse() {
        (false, "no surface is diffuse".to_owned())
    } else if asked.max_depth.is_some_and(|d| d <= 2) && by_shadow_rays() {
        (false, "within two edges shadow rays find all light".to_owned())
    } else if let Some(verdict) = parts::glow(world, asked, parts) {
        verdict
    } else {
        (true, "diffuse surfaces receive light that shadow rays do not find".to_owned())
    }
}

fn choice(world: &World) -> Verdict {
    match world.partition().shadow_lights().len() {
        n @ 0..=1 => (false, format!("shadow rays have {n} lights to choose from")),
        n => (true, format!("shadow rays may choose among {n} lights")),
    }
}

/// Light of three edges or more, where all of it is below the error asked for. The only stage that changes the picture: by less than
/// its reason says.
fn interreflection(scene: &Scene, asked: &Asked) -> Verdict {
    let Some(goal) = asked.error_goal else { return (true, "no --error says what is negligible".to_owned()) };
    if !(asked.has_pass_one && asked.gathers) {
        return (true, "only what gathers over a first pass leaves it out".to_owned());
    }
    if asked.shows_pass_one || asked.max_depth.is_some_and(|d| d <= DIRECT) {
        return (true, "no more than what was asked for".to_owned());
    }
    let Some(radiance) = scene.interreflection_bound() else {
        return (true, "there is no bound on what surfaces may add to each other".to_owned());
    };
    let error = radiance * radiance / FLOOR;
    let said = format!("light of three edges or more adds at most {radiance:.1e} to a pixel, relMSE {error:.1e}");
    if error <= NEGLIGIBLE * goal {
        (false, format!("{said}: below a hundredth of --error {goal}"))
    } else {
        (true, format!("{said}: that is not below a hundredth of --error {goal}"))
    }
}

fn depth(asked: &Asked) -> Verdict {
    match asked.max_depth {
        Some(n) => (true, format!("paths end after {n} edges; what is cut is counted")),
        None => (false, "paths end by themselves".to_owned()),
    }
}
