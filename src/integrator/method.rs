//! The closed list of methods, and what is to be said of each.

use super::ambient::{AmbientCaching, AmbientSettings};
use super::bidirectional::{Bidirectional, Heuristic};
use super::light_tracer::LightTracer;
use super::metropolis::{Metropolis, MetropolisSettings};
use super::photon::{PhotonMapper, Sppm};
use super::{Integrator, IntegratorSettings, PathFilter, ReadOut, TwoPass, path, radiosity_view};
use crate::radiosity::{Interpolation, RadiosityField};
use crate::world::lamps::Lamps;
use crate::world::plane_mirrors::PlaneMirrors;
use crate::world::{Stages, World};
use serde::{Deserialize, Serialize};
use std::marker::PhantomData;
use std::sync::Arc;

/// Probability with which `two-pass-unbiased` puts right what a gather ray reads.
const RESIDUAL: f64 = 0.5;

/// The closed list of methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Both passes, final gather (the default).
    TwoPass,
    /// Both passes, the first as a control variate of the second.
    TwoPassUnbiased,
    /// Both passes as in the classic papers: Whitted's recursion, shadow rays, stored radiosity.
    TwoPassWhitted,
    /// Both passes with virtual rooms behind flat mirrors.
    TwoPassPlanar,
    /// Both passes with extended form factors.
    TwoPassGeneral,
    /// Pass two alone: Whitted's recursion and shadow rays.
    WhittedOnly,
    /// Pass one alone.
    Radiosity,
    /// Path tracing: no first pass.
    Path,
    /// Particles from the lamps.
    Light,
    /// Walks from both ends.
    Bidirectional,
    /// Final gather over photon maps.
    PhotonMap,
    /// Photons anew in each pass, on shrinking disks.
    Sppm,
    /// Irradiance caching of bounce upon bounce, without a first pass.
    IrradianceCache,
    /// Chains of paths.
    Metropolis,
}

/// What becomes of a method's error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// Some of it stays, however long it runs.
    Biased,
    /// All of it vanishes in the limit.
    Consistent,
    /// It is zero in the mean of many runs, however short they are.
    Unbiased,
}

impl ErrorKind {
    /// As the table has it.
    pub fn name(self) -> &'static str {
        match self {
            ErrorKind::Biased => "biased",
            ErrorKind::Consistent => "consistent",
            ErrorKind::Unbiased => "unbiased",
        }
    }
}

/// A method's row in the table of `--list-methods`.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// Name on the command line.
    pub name: &'static str,
    /// Light paths carried, as a pattern in Heckbert's notation [Heckbert90]: L lamp, D diffuse or rough, S ideal, M ideal
    /// and flat, E eye.
    pub paths: &'static str,
    /// What becomes of its error.
    pub error: ErrorKind,
    /// True if what costs most holds for any view.
    pub view_independent: bool,
    /// One sentence.
    pub about: &'static str,
    /// Who published it, as keys of `REFERENCES.md`.
    pub citation: &'static str,
}

impl Method {
    /// All methods, in the order of `--list-methods`.
    pub const ALL: [Method; 14] = [
        Method::TwoPass,
        Method::TwoPassUnbiased,
        Method::TwoPassWhitted,
        Method::TwoPassPlanar,
        Method::TwoPassGeneral,
        Method::WhittedOnly,
        Method::Radiosity,
        Method::Path,
        Method::Light,
        Method::Bidirectional,
        Method::PhotonMap,
        Method::Sppm,
        Method::IrradianceCache,
        Method::Metropolis,
    ];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// What is to be said of it.
    pub fn row(self) -> Row {
        let row =
            |name, paths, error, view_independent, about, citation| Row { name, paths, error, view_independent, about, citation };
        use ErrorKind::{Biased, Consistent, Unbiased};
        match self {
            Method::TwoPass => row(
                "two-pass",
                "L(S|D)*E",
                Biased,
                false,
                "radiosity, then shadow rays and an irradiance cache that gathers it, both refined as time passes",
                "Wallace87, Ward88",
            ),
            Method::TwoPassUnbiased => row(
                "two-pass-unbiased",
                "L(S|D)*E",
                Unbiased,
                false,
                "final gather whose rays put the stored radiosity right by random paths: no error but noise",
                "Wallace87, Lafortune94",
            ),
            Method::TwoPassWhitted => row(
                "two-pass-whitted",
                "L(S|D)*E",
                Biased,
                true,
                "radiosity, then Whitted's recursion with shadow rays and stored radiosity; shows the patches",
                "Wallace87, Sillion89",
            ),
            Method::TwoPassPlanar => row(
                "two-pass-planar",
                "L(M*D)*S*E",
                Biased,
                true,
                "radiosity in the scene and the virtual rooms of its flat mirrors (M), then Whitted's recursion that shows it; light by \
                 curved mirrors and glass reaches the eye, but no other surface",
                "Wallace87",
            ),
            Method::TwoPassGeneral => row(
                "two-pass-general",
                "L(S|D)*E",
                Biased,
                true,
                "radiosity with extended form factors, by way of any mirror and glass, then Whitted's recursion that shows it",
                "Sillion89",
            ),
            Method::WhittedOnly => row(
                "whitted-only",
                "LD?S*E",
                Biased,
                false,
                "Whitted's recursion with shadow rays; all other light is a constant, 0 by default",
                "Whitted80",
            ),
            Method::Radiosity => row(
                "radiosity",
                "LD*E",
                Biased,
                true,
                "pass one alone, interpolated between its patches; mirrors and glass are black",
                "Goral84, Cohen85",
            ),
            Method::Path => row(
                "path",
                "L(S|D)*E",
                Unbiased,
                false,
                "one random path a sample, lent to neighbours, no first pass; poor at caustics of small lamps",
                "Kajiya86, Veach95, Bekaert02",
            ),
            Method::Light => row(
                "light",
                "L((S|D)*D)?E",
                Unbiased,
                false,
                "particles from the lamps, seen by the camera where they meet surfaces; what mirrors and glass show is black",
                "Dutre93",
            ),
            Method::Bidirectional => row(
                "bidirectional",
                "L(S|D)*E",
                Unbiased,
                false,
                "walks from camera and lamps, vertices of one connected with well chosen ones of the other",
                "Lafortune93, Veach97, Georgiev12, Popov15, Bekaert02",
            ),
            Method::PhotonMap => row(
                "photon-map",
                "L(S|D)*E",
                Biased,
                true,
                "maps of photons, of all and of caustics; shadow rays and final gather; more photons as time passes",
                "Jensen96, Christensen99",
            ),
            Method::Sppm => row(
                "sppm",
                "L(S|D)*E",
                Consistent,
                false,
                "new photons in each pass, on disks that shrink; shadow rays",
                "Hachisuka09, Knaus11",
            ),
            Method::IrradianceCache => row(
                "irradiance-cache",
                "L(S|D)*E",
                Biased,
                false,
                "irradiance gathered at few points, bounce upon bounce, no first pass: the way of Radiance",
                "Ward88, Ward92",
            ),
            Method::Metropolis => row(
                "metropolis",
                "L(S|D)*E",
                Unbiased,
                false,
                "chains of paths made as by bidirectional, each a small change of the one before",
                "Veach97, Kelemen02, Hachisuka14",
            ),
        }
    }

    /// The read-out it uses unless told otherwise; `None` if it has no first pass to read.
    pub fn read_out(self) -> Option<ReadOut> {
        match self {
            Method::TwoPass => Some(ReadOut::Progressive),
            Method::TwoPassUnbiased => Some(ReadOut::FinalGather),
            Method::TwoPassWhitted => Some(ReadOut::DirectStored),
            Method::Radiosity | Method::TwoPassPlanar | Method::TwoPassGeneral => Some(ReadOut::Stored),
            Method::WhittedOnly
            | Method::Path
            | Method::Light
            | Method::Bidirectional
            | Method::PhotonMap
            | Method::Sppm
            | Method::IrradianceCache
            | Method::Metropolis => None,
        }
    }

    /// True if another read-out of pass one may be chosen.
    pub fn has_read_outs(self) -> bool {
        matches!(self, Method::TwoPass | Method::TwoPassWhitted)
    }

    /// True if its form factors carry light by way of mirrors and glass.
    pub fn extends_form_factors(self) -> bool {
        !matches!(self, Method::Radiosity | Method::TwoPassPlanar)
    }

    /// True if its rays are followed by code that is compiled for the stages a scene needs; the others hold all stages.
    pub fn is_by_stages(self) -> bool {
        matches!(self, Method::TwoPass | Method::TwoPassWhitted | Method::WhittedOnly | Method::Path)
    }

    /// The method at work on a scene, by code that holds the stages `K` where [`Self::is_by_stages`]. `field` is there if the method reads one and some path is long enough to need it.
    pub fn integrator<'a, K: Stages>(
        self,
        world: &'a World,
        field: Option<&'a RadiosityField>,
        settings: IntegratorSettings,
        methods: &MethodSettings,
    ) -> Box<dyn Integrator + 'a> {
        let ambient = methods.ambient;
        let stages = PhantomData;
        let tracer = |settings| TwoPass::<K> {
            world,
            field,
            settings,
            cache: None,
            caustics: None,
            ambient,
            below: None,
            residual: None,
            smooth: None,
            stages,
        };
        let two_pass = |settings, residual| Box::new(TwoPass { residual, ..tracer(settings) });
        let whitted = |settings| two_pass(settings, None);
        match self {
            Method::TwoPass | Method::TwoPassWhitted => {
                let is_shown = matches!(settings.read_out, ReadOut::Stored | ReadOut::DirectStored);
                let smooth = field.filter(|_| is_shown).map(|field| Arc::new(Interpolation::new(world, field)));
                Box::new(TwoPass { smooth, ..tracer(settings) })
            }
            Method::TwoPassUnbiased => two_pass(settings, Some(RESIDUAL)),
            Method::WhittedOnly => whitted(IntegratorSettings { read_out: ReadOut::DirectStored, ..settings }),
            Method::Radiosity => Box::new(radiosity_view::RadiosityView::new(world, field, settings)),
            Method::TwoPassPlanar | Method::TwoPassGeneral => {
                let smooth = field.map(|field| Arc::new(Interpolation::new(world, field)));
                Box::new(TwoPass { smooth, ..tracer(settings) })
            }
            Method::Path => {
                let filter = methods.paths.clone();
                // Only words with letters need to know which mirrors are flat.
                let mirrors = filter.as_ref().map(|_| PlaneMirrors::find(world));
                let lamps = Lamps::of(world);
                let lends = filter.is_none() && !methods.single_paths;
                Box::new(path::PathTracer::<K> { world, settings, filter, lends, mirrors, lamps, stages })
            }
            Method::Light => Box::new(LightTracer::new(world, settings)),
            Method::Bidirectional => Box::new(Bidirectional::new(world, settings, methods.heuristic)),
            Method::PhotonMap => Box::new(PhotonMapper::new(world, settings, methods.photons)),
            Method::Metropolis => Box::new(Metropolis::new(world, settings, methods.heuristic, methods.metropolis)),
            Method::IrradianceCache => Box::new(AmbientCaching::new(world, settings, methods.ambient_cache)),
            Method::Sppm => Box::new(Sppm::new(world, settings, methods.photons)),
        }
    }
}

/// How two-pass-planar works.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VirtualRoomSettings {
    /// Most mirrors in a row: 1, the scene's reflection in each mirror; 2, that of the reflections in the others as well.
    pub reflections: u32,
}

impl Default for VirtualRoomSettings {
    /// Between two facing mirrors a third reflection still matters, but rooms have one as a rule.
    fn default() -> Self {
        Self { reflections: 2 }
    }
}

/// What only single methods know.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MethodSettings {
    /// Of whitted-only: irradiance over pi [W/(m² sr)] that stands for all light between surfaces.
    pub ambient: f64,
    /// Of two-pass-planar.
    pub virtual_rooms: VirtualRoomSettings,
    /// Of bidirectional: how the ways to make a path share it.
    pub heuristic: Heuristic,
    /// Of photon-map and sppm: photons that leave the lamps, in the first round and in each pass; `None`: one for each pixel.
    pub photons: Option<u32>,
    /// Of irradiance-cache.
    pub ambient_cache: AmbientSettings,
    /// Of metropolis.
    pub metropolis: MetropolisSettings,
    /// Of path: which light paths count; `None`: all.
    pub paths: Option<PathFilter>,
    /// Of path: no pixel lends its paths to others.
    pub single_paths: bool,
}
