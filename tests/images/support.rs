//! A scene rendered and judged; what fails is written to a folder.

use std::path::{Path, PathBuf};
use twopass::film::io::{Header, read_exr, write_exr, write_png_bytes};
use twopass::film::{Image, Layer, Mask};
use twopass::integrator::drive::{Budget, Clocks, Snapshot};
use twopass::integrator::{Method, ReadOut};
use twopass::load::{LoadOptions, load_scene};
use twopass::math::SamplerKind;
use twopass::metrics::{Comparison, Metrics, compare, false_colour};
use twopass::pipeline::{RenderSettings, Rendered, render};
use twopass::progress::silent;
use twopass::run_report::process_cpu_seconds;

/// What is rendered.
pub struct Shot {
    pub scene: &'static str,
    pub spp: u32,
    /// Predicted error at which it stops before.
    pub error: Option<f64>,
    pub seed: u64,
    pub sampler: SamplerKind,
    pub method: Method,
    pub read_out: Option<ReadOut>,
    pub defines: Vec<(&'static str, &'static str)>,
    /// Pixels that do not count.
    pub left_out: Option<Mask>,
}

impl Shot {
    /// One sample per pixel by the default method.
    pub fn new(scene: &'static str) -> Self {
        Self {
            scene,
            spp: 1,
            error: None,
            seed: 0,
            sampler: SamplerKind::Sobol,
            method: Method::TwoPass,
            read_out: None,
            defines: Vec::new(),
            left_out: None,
        }
    }
}

/// Renders a scene of the project as its file says, but for `shot`.
pub fn rendered(shot: &Shot) -> Rendered {
    rendered_with(shot, &mut |_, _, _| {})
}

/// As [`rendered`]; `snapshot` sees the film after every pass.
pub fn rendered_with(shot: &Shot, snapshot: &mut Snapshot<'_>) -> Rendered {
    let defines = shot.defines.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
    let file = root().join("scenes").join(shot.scene).join("scene.xml");
    let scene = load_scene(&file, &LoadOptions { defines, ..LoadOptions::default() }).expect("the scene loads").scene;
    let budget = Budget { spp: Some(shot.spp), error: shot.error, ..Budget::default() };
    let Shot { method, read_out, seed, sampler, .. } = *shot;
    let settings = RenderSettings { method, read_out, seed, sampler, budget, ..RenderSettings::default() };
    render(scene, &settings, &Clocks::start(process_cpu_seconds), &mut silent, snapshot).expect("renders")
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

pub fn reference_folder(scene: &str) -> PathBuf {
    root().join("reference").join(scene)
}

/// Both independent halves of a scene's reference.
pub fn reference(scene: &str) -> [Image; 2] {
    ["A.exr", "B.exr"].map(|half| read_exr(&reference_folder(scene).join(half)).expect("the reference is there"))
}

/// A picture beside its reference.
pub struct Case {
    pub name: String,
    pub image: Image,
    pub reference: [Image; 2],
    pub left_out: Option<Mask>,
    pub bad_samples: u64,
}

impl Case {
    /// Renders `shot` and reads its reference.
    pub fn of(shot: Shot) -> Self {
        let film = rendered(&shot).film;
        let read_out = shot.read_out.map_or(String::new(), |r| format!("-{r:?}"));
        let name = format!("{}-{}{read_out}", shot.scene, shot.method.name());
        let case = Self {
            name,
            image: film.image(),
            reference: reference(shot.scene),
            left_out: shot.left_out,
            bad_samples: film.bad_samples().0,
        };
        println!("{}: {:?}", case.name, case.metrics());
        case
    }

    /// The largest relmse allowed.
    pub fn relmse_at_most(&self, bound: f64) {
        let relmse = self.metrics().relmse;
        self.check(relmse <= bound, &format!("relmse {relmse:.3e}, expected at most {bound:.1e}"));
    }

    /// Each channel's mean within a share of the reference's.
    pub fn means_within(&self, tolerance: f64) {
        let ratio = self.metrics().mean_ratio;
        let good = ratio.iter().all(|r| (r - 1.0).abs() <= tolerance);
        self.check(good, &format!("means over the reference's {ratio:.4?}, expected 1 within {tolerance}"));
    }

    /// Fails with `message` unless `good`, and says where the evidence is.
    pub fn check(&self, good: bool, message: &str) {
        if !good {
            let folder = self.write_evidence(message);
            panic!("{}: {message}; picture, error and figures in {}", self.name, folder.display());
        }
    }

    pub fn metrics(&self) -> Metrics {
        compare(&self.comparison()).expect("picture and reference are comparable")
    }

    fn comparison(&self) -> Comparison<'_> {
        let [a, b] = &self.reference;
        Comparison { image: &self.image, a, b: Some(b), left_out: self.left_out.as_ref(), emitters: None }
    }

    fn write_evidence(&self, message: &str) -> PathBuf {
        let folder = std::env::temp_dir().join("twopass-images").join(&self.name);
        std::fs::create_dir_all(&folder).expect("the temporary folder can be written");
        write_exr(&folder.join("image.exr"), &[Layer::main(self.image.clone())], &Header::default()).expect("writes");
        let error = false_colour::error_picture(&self.comparison()).expect("picture and reference are comparable");
        write_png_bytes(&folder.join("error.png"), self.image.width(), self.image.height(), &error).expect("writes");
        std::fs::write(folder.join("figures.txt"), format!("{message}\n{:#?}\n", self.metrics())).expect("writes");
        folder
    }
}
