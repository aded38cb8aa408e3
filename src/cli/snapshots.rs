//! `--snapshots-cpu`: the picture at chosen processor times of one run, so that its error can be plotted against time.

use super::report::rays;
use std::path::{Path, PathBuf};
use twopass::film::io::{Header, WriteError, write_exr};
use twopass::film::{Film, Layer};
use twopass::integrator::drive::Clocks;
use twopass::run_report::SnapshotReport;
use twopass::world::walk::RayCounts;

/// Writes OUT.0001.exr, OUT.0002.exr ... when their times come; numbers follow the list of times.
///
/// A picture is written after the pass that ends nearest to its time. If one pass meets several times, only the last of them gets a
/// picture: the same picture twice would say nothing. Writing is excluded from the clocks.
pub struct Snapshots<'a> {
    clocks: &'a Clocks,
    stem: PathBuf,
    times: &'a [f64],
    /// How many times have been met.
    met: usize,
    /// Clock after the pass before.
    last_cpu: Option<f64>,
    /// Rays of pass two after the last pass seen.
    last_rays: u64,
    taken: Vec<SnapshotReport>,
    failure: Option<WriteError>,
}

impl<'a> Snapshots<'a> {
    /// `times` ascend; `exr` is the final picture's file.
    pub fn new(clocks: &'a Clocks, exr: &Path, times: &'a [f64]) -> Self {
        let stem = exr.with_extension("");
        Self { clocks, stem, times, met: 0, last_cpu: None, last_rays: 0, taken: Vec::new(), failure: None }
    }

    /// Looks at the film after a pass.
    pub fn look(&mut self, film: &Film, counts: &RayCounts) {
        if self.times.is_empty() {
            return;
        }
        let (wall_s, cpu_s) = (self.clocks.wall(), self.clocks.cpu());
        let half_pass = self.last_cpu.map_or(0.0, |last| 0.5 * (cpu_s - last));
        let met = self.times.iter().take_while(|t| cpu_s + half_pass >= **t).count();
        self.last_rays = rays(counts);
        if met > self.met {
            self.met = met;
            // What it takes to make a picture of the film is part of this one, but of none that follows.
            self.clocks.exclude(|| {
                let before = self.clocks.read();
                film.develop();
                let after = self.clocks.read();
                self.write(film, wall_s + after.0 - before.0, cpu_s + after.1 - before.1);
            });
        }
        self.last_cpu = Some(cpu_s);
    }

    fn write(&mut self, film: &Film, wall_s: f64, cpu_s: f64) {
        let path = PathBuf::from(format!("{}.{:04}.exr", self.stem.display(), self.met));
        let header = Header::default().text("complete", "false").number("samples", film.n_passes().into());
        let written = write_exr(&path, &[Layer::main(film.image())], &header.number("cpuSeconds", cpu_s));
        if let Err(error) = written {
            self.failure.get_or_insert(error);
            return;
        }
        self.taken.push(SnapshotReport {
            file: path.display().to_string(),
            asked_cpu_s: self.times[self.met - 1],
            samples_per_pixel: film.n_passes().into(),
            wall_s,
            cpu_s,
            rays: self.last_rays,
            estimated_relmse: film.estimated_relmse(),
        });
    }

    /// What was written; `all_rays` are those of both passes of the whole run, from which the snapshots get their share of pass one.
    ///
    /// # Errors
    /// The first write that failed.
    pub fn finish(self, all_rays: u64) -> Result<Vec<SnapshotReport>, WriteError> {
        let pass_one = all_rays - self.last_rays.min(all_rays);
        match self.failure {
            Some(error) => Err(error),
            None => Ok(self.taken.into_iter().map(|s| SnapshotReport { rays: s.rays + pass_one, ..s }).collect()),
        }
    }
}
