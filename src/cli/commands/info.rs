//! `twopass info`: what is in a scene.

use crate::cli::args::{Common, InfoArgs};
use crate::cli::exit::Failure;
use crate::cli::output::{print, short};
use crate::cli::scene_file;
use serde_json::{Map, Value};
use twopass::form_factor::{FormFactorMethod, memory};
use twopass::geometry::Bounds;
use twopass::math::DVec3;
use twopass::patch::{PatchMesh, PatchSettings};
use twopass::pipeline::{PassOneSettings, PipelineError, RenderSettings};
use twopass::plan::Plan;
use twopass::world::World;

/// Bytes of the film and of the file's layers for one pixel.
const BYTES_PER_PIXEL: usize = 360;

/// Runs the subcommand.
pub fn run(common: &Common, args: &InfoArgs) -> Result<(), Failure> {
    if common.report.is_some() {
        return Err(Failure::Usage("info makes no run report; its result is --json".to_owned()));
    }
    let loaded = scene_file::load(common, &args.scene, &args.source)?;
    let (hash, files) = (loaded.hash, loaded.files.len());
    let world = World::new(loaded.scene, common.accel).map_err(PipelineError::from)?;
    let settings = PatchSettings { patch_size: args.patch_size, ..PatchSettings::default() };
    let patches = PatchMesh::build(&world, &settings).map_err(PipelineError::from)?;
    let mut facts = facts(&world, &patches, hash, files);
    let plan = RenderSettings { plan: common.plan.into(), ..RenderSettings::default() }.plan_for(&world)?;
    facts.push(("plan", plan_lines(&plan)));
    print(&if args.json { json(facts) } else { lines(&facts) })
}

/// Everything that is said, by name, in the order in which it is said.
type Facts = Vec<(&'static str, Value)>;

fn facts(world: &World, patches: &PatchMesh, hash: u64, files: usize) -> Facts {
    let scene = world.scene();
    let film = &scene.film;
    let mut facts: Facts = vec![
        ("scene", scene.name.as_str().into()),
        ("hash", format!("{hash:016x}").into()),
        ("files", files.into()),
        ("shapes", scene.shapes.len().into()),
        ("triangles", scene.n_triangles().into()),
        ("spheres", scene.n_spheres().into()),
        ("materials", scene.materials.len().into()),
        ("material_names", scene.materials.iter().map(|m| m.name.as_str()).collect()),
        ("lights", scene.lights.len().into()),
        ("lights_by_shadow_rays", world.partition().shadow_lights().len().into()),
        ("power", scene.power().to_array().to_vec().into()),
        ("bounds", bounds(world.bounds(), scene.origin)),
        ("units", "lengths as in the file, linear sRGB".into()),
        ("width", film.width.into()),
        ("height", film.height.into()),
        ("sample_count", film.sample_count.into()),
        // null: unlimited.
        ("max_depth", film.max_depth.into()),
        ("patches", patches.len().into()),
        ("patch_size", patches.patch_size.into()),
    ];
    facts.extend(memory(world, patches));
    facts.push(("warnings", scene.warnings.iter().map(String::as_str).collect()));
    facts
}

/// What a render takes at most by each method of form factors, besides the scene itself [bytes].
fn memory(world: &World, patches: &PatchMesh) -> Facts {
    let film = &world.scene().film;
    let by = |method: FormFactorMethod| {
        let settings = PassOneSettings {
            form_factors: method,
            form_factor_tolerance: method.default_tolerance(),
            ..PassOneSettings::default()
        };
        memory::predicted(patches.len() as f64, &settings.form_factor_settings(0)) as u64
    };
    vec![
        ("memory_film", (film.width * film.height * BYTES_PER_PIXEL).into()),
        ("memory_ray_cast", by(FormFactorMethod::RayCast).into()),
        ("memory_analytic", by(FormFactorMethod::Analytic).into()),
        ("memory_hemicube", by(FormFactorMethod::Hemicube).into()),
        ("memory_hierarchical", by(FormFactorMethod::Hierarchical).into()),
    ]
}

/// A line for each stage: what becomes of it and why.
fn plan_lines(plan: &Plan) -> Value {
    let verb = |kept| if kept { "kept" } else { "left out" };
    plan.decisions.iter().map(|d| format!("{}: {}: {}", d.stage, verb(d.kept), d.reason)).collect()
}

/// Lower and upper corner in the file's coordinates.
fn bounds(bounds: Bounds, origin: DVec3) -> Value {
    if bounds.is_empty() {
        return Value::Null;
    }
    let corner = |v: twopass::math::Vec3| (v.as_dvec3() + origin).to_array();
    [corner(bounds.min), corner(bounds.max)].map(|c| c.to_vec()).to_vec().into()
}

fn json(facts: Facts) -> String {
    let object: Map<String, Value> = facts.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
    format!("{:#}\n", Value::Object(object))
}

/// `name value` lines; the values of a list are separated by blanks, warnings have a line each.
fn lines(facts: &Facts) -> String {
    let mut text = String::new();
    for (name, value) in facts {
        match (*name, value) {
            ("warnings" | "plan", Value::Array(said)) => {
                let name = name.trim_end_matches('s');
                said.iter().for_each(|line| text += &format!("{name} {}\n", plain(line)));
            }
            ("max_depth", Value::Null) => text += "max_depth unlimited\n",
            _ => text += &format!("{name} {}\n", plain(value)),
        }
    }
    text
}

fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(values) => values.iter().map(plain).collect::<Vec<_>>().join(" "),
        Value::Number(n) if n.is_f64() => n.as_f64().map_or_else(|| n.to_string(), short),
        Value::Null => "none".to_owned(),
        other => other.to_string(),
    }
}
