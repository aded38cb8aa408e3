//! A picture against the references of its scene.

use super::plan::ScenePlan;
use super::row::Row;
use super::store::Digest;
use crate::film::io::{ReadError, read_exr, read_mask};
use crate::film::{Image, Mask};
use crate::metrics::{Comparison, Metrics, MetricsError, compare};
use std::path::Path;

/// The references and masks of a scene.
pub struct Judge {
    references: Vec<Image>,
    mask: Option<Mask>,
    emitters: Option<Mask>,
    size: (usize, usize),
    /// Digest of all files that it judges by.
    pub digest: Digest,
}

/// Why references are of no use.
#[derive(Debug, thiserror::Error)]
pub enum JudgeError {
    /// One cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// They do not fit each other or the size of the pictures.
    #[error("scene {scene}: {error}")]
    Fit {
        /// The scene's name.
        scene: String,
        /// What does not fit.
        error: MetricsError,
    },
}

impl Judge {
    /// Reads the references of a scene whose pictures have `size` pixels.
    ///
    /// # Errors
    /// [`JudgeError`] if one cannot be read or has another size.
    pub fn read(scene: &ScenePlan, size: (usize, usize)) -> Result<Judge, JudgeError> {
        let references: Vec<Image> = scene.references.iter().map(|path| read_exr(path)).collect::<Result<_, _>>()?;
        let mask = |path: &Option<std::path::PathBuf>| path.as_deref().map(read_mask).transpose();
        let (mask, emitters) = (mask(&scene.mask)?, mask(&scene.emitters)?);
        let mut digest = Digest::default();
        let files = scene.references.iter().chain(&scene.mask).chain(&scene.emitters);
        files.for_each(|path| digest.add(&std::fs::read(path).unwrap_or_default()));
        let judge = Judge { references, mask, emitters, size, digest };
        // A black picture of the right size shows whether the others fit it.
        match judge.compare(&Image::new(size.0, size.1)) {
            Some(Err(error)) => Err(JudgeError::Fit { scene: scene.name.clone(), error }),
            _ => Ok(judge),
        }
    }

    fn compare(&self, image: &Image) -> Option<Result<Metrics, MetricsError>> {
        let a = self.references.first()?;
        let (mask, emitters) = (self.mask.as_ref(), self.emitters.as_ref());
        Some(compare(&Comparison { image, a, b: self.references.get(1), left_out: mask, emitters }))
    }

    /// The references' own relmse: that of their mean, whose cross product with their two errors is minus the squared error.
    pub fn reference_relmse(&self) -> Option<f64> {
        let [a, b] = &self.references[..] else { return None };
        let mut mean = a.clone();
        mean.pixels_mut().iter_mut().zip(b.pixels()).for_each(|(m, b)| *m = std::array::from_fn(|c| 0.5 * (m[c] + b[c])));
        Some(-self.compare(&mean)?.ok()?.relmse)
    }

    /// Reads a picture and fills in the row's errors.
    ///
    /// # Errors
    /// Why it cannot be judged, in a sentence.
    pub fn judge(&self, path: &Path, row: &mut Row) -> Result<Image, String> {
        if !path.exists() {
            return Err("it wrote no picture".to_owned());
        }
        let image = read_exr(path).map_err(|error| error.kind.to_string())?;
        let (width, height) = (image.width(), image.height());
        if (width, height) != self.size {
            return Err(format!("its picture has {width}x{height} pixels, expected {}x{}", self.size.0, self.size.1));
        }
        if let Some(at) = image.pixels().iter().position(|p| !p.iter().all(|v| v.is_finite())) {
            return Err(format!("its picture is not finite at column {}, row {}", at % width, at / width));
        }
        match self.compare(&image) {
            None => {}
            Some(Err(error)) => return Err(error.to_string()),
            Some(Ok(metrics)) => fill(row, &metrics),
        }
        Ok(image)
    }
}

fn fill(row: &mut Row, metrics: &Metrics) {
    row.relmse = Some(metrics.relmse);
    row.relmse_se = Some(metrics.relmse_se);
    row.trimmed_relmse = metrics.trimmed_relmse;
    row.relmse_off_emitters = metrics.relmse_off_emitters;
    [row.mean_ratio_r, row.mean_ratio_g, row.mean_ratio_b] = metrics.mean_ratio.map(Some);
    row.block9_rms = Some(metrics.block9_rms);
    (row.flip_ldr, row.flip_hdr) = (Some(metrics.flip_ldr), Some(metrics.flip_hdr));
}
