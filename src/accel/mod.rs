//! Nearest-hit and any-hit queries over a [`Soup`], by one of several engines.
//!
//! Every engine obeys the same rules, held by `tests/laws/accel_conformance.rs`:
//! - both sides of a triangle count, and so do its edges and vertices;
//! - of hits at equal t, the primitive with the lowest index is reported (Embree: any of them);
//! - a ray that is not [valid](Ray::is_valid) hits nothing, and nothing behind a ray's origin is hit;
//! - [`Accel::occluded`] agrees with [`Accel::intersect`].
//!
//! Coordinates may reach 1e15 in magnitude; beyond that the products of the f32 triangle test overflow and hits are lost.

#[cfg(test)]
mod binary;
mod brute_force;
mod bvh;
#[cfg(feature = "embree")]
pub mod embree;
#[cfg(feature = "embree")]
mod embree_sys;
mod pages;
mod query;
mod wide;
mod widest;

pub use widest::{Work, widest};

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use crate::geometry::{Hit, Ray, Soup};

/// What every acceleration structure answers. Nothing more: points, normals and uv are found again from (ray, primitive) by one
/// routine of `world`, so that all engines give the same picture.
pub trait Accel: Send + Sync {
    /// The nearest hit with t in (`t_min`, `t_max`).
    fn intersect(&self, ray: &Ray) -> Option<Hit>;

    /// True if anything lies in (`t_min`, `t_max`).
    fn occluded(&self, ray: &Ray) -> bool;

    /// The same as [`occluded`](Self::occluded); `known` keeps what it takes to answer faster for rays to come that are like this one.
    fn occluded_as_known(&self, ray: &Ray, known: &mut KnownOccluders) -> bool {
        let _ = known;
        self.occluded(ray)
    }

    /// The nearest hits of many rays, each the same as by [`intersect`](Self::intersect).
    ///
    /// Worth while where neighbours in `rays` are alike: camera rays of one tile, shadow rays from or to one place.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn intersect_batch(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len(), "one hit for each ray");
        rays.iter().zip(hits).for_each(|(ray, hit)| *hit = self.intersect(ray));
    }

    /// For many rays, the same as [`occluded`](Self::occluded).
    ///
    /// # Panics
    /// If the slices differ in length.
    fn occluded_batch(&self, rays: &[Ray], occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "one answer for each ray");
        rays.iter().zip(occluded).for_each(|(ray, answer)| *answer = self.occluded(ray));
    }

    /// Memory that the engine holds beside the [`Soup`], in bytes.
    fn memory_bytes(&self) -> usize;
}

/// Where in an engine the last rays that were hidden met something: what hides one ray often hides the next [Haines86].
#[derive(Debug, Clone, Copy, Default)]
pub struct KnownOccluders {
    /// In the engine's own terms, the last one first.
    places: [u32; KNOWN],
    len: usize,
}

/// Places that are known at a time: each costs a ray as much as a leaf of the tree does.
const KNOWN: usize = 2;

impl KnownOccluders {
    /// True if `hides` holds at one of the places, which is then the first.
    #[inline]
    fn any(&mut self, hides: impl FnMut(&u32) -> bool) -> bool {
        let found = self.places[..self.len].iter().position(hides);
        if let Some(at) = found {
            self.places[..=at].rotate_right(1);
        }
        found.is_some()
    }

    /// A place more, instead of the one that was of no use for longest.
    #[inline]
    fn add(&mut self, place: u32) {
        self.len = (self.len + 1).min(KNOWN);
        self.places[..self.len].rotate_right(1);
        self.places[0] = place;
    }
}

/// The engines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AccelKind {
    /// Trees built by obvhs, traversed by this crate's kernel. Needs no system library.
    #[default]
    Obvhs,
    /// Intel Embree 3, robust mode (cargo feature `embree`).
    Embree,
    /// Every primitive for every ray, in f64: the oracle, and what a renderer without bounding volumes costs.
    BruteForce,
}

impl AccelKind {
    /// All engines, also those that this build lacks.
    pub const ALL: [AccelKind; 3] = [AccelKind::Obvhs, AccelKind::Embree, AccelKind::BruteForce];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            AccelKind::Obvhs => "obvhs",
            AccelKind::Embree => "embree",
            AccelKind::BruteForce => "brute-force",
        }
    }

    /// True if this build holds the engine.
    pub fn is_available(self) -> bool {
        self != AccelKind::Embree || cfg!(feature = "embree")
    }
}

impl fmt::Display for AccelKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for AccelKind {
    type Err = AccelError;

    fn from_str(name: &str) -> Result<Self, AccelError> {
        let found = AccelKind::ALL.into_iter().find(|kind| kind.name() == name);
        found.ok_or_else(|| AccelError::Unknown { name: name.to_owned() })
    }
}

/// Why there is no engine.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AccelError {
    /// No engine has this name.
    #[error("unknown acceleration structure \"{name}\": expected obvhs, embree or brute-force")]
    Unknown {
        /// What was asked for.
        name: String,
    },
    /// Asked for Embree in a build without it.
    #[error(
        "this build has no Embree: install Debian's libembree-dev (version 3) and build again with `cargo build --release \
         --features embree`, or use `--accel obvhs`"
    )]
    EmbreeMissing,
    /// Embree refused.
    #[error("Embree: {message}")]
    Embree {
        /// Its own words.
        message: String,
    },
    /// More primitives than 32-bit indices can name.
    #[error("{count} primitives, but at most {limit} are supported")]
    TooManyPrimitives {
        /// Number of primitives.
        count: usize,
        /// The bound.
        limit: usize,
    },
}

/// Builds the engine `kind` over `soup`.
///
/// # Errors
/// [`AccelError::EmbreeMissing`] in a build without the feature; [`AccelError::TooManyPrimitives`] beyond 2^27.
pub fn build(soup: Arc<Soup>, kind: AccelKind) -> Result<Box<dyn Accel>, AccelError> {
    // Packed leaves are named by 27 bits.
    const LIMIT: usize = 1 << 27;
    if soup.len() > LIMIT {
        return Err(AccelError::TooManyPrimitives { count: soup.len(), limit: LIMIT });
    }
    match kind {
        AccelKind::Obvhs => Ok(Box::new(wide::Wide::new(soup))),
        AccelKind::BruteForce => Ok(Box::new(brute_force::BruteForce::new(soup))),
        #[cfg(feature = "embree")]
        AccelKind::Embree => Ok(Box::new(embree::Embree::new(soup, embree::Mode::Robust)?)),
        #[cfg(not(feature = "embree"))]
        AccelKind::Embree => Err(AccelError::EmbreeMissing),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip_and_an_unknown_one_is_refused() {
        for kind in AccelKind::ALL {
            assert_eq!(kind.to_string().parse(), Ok(kind));
        }
        assert!("bvh".parse::<AccelKind>().is_err());
    }

    #[test]
    #[cfg(not(feature = "embree"))]
    fn a_build_without_embree_says_how_to_get_it() {
        let error = build(Arc::new(Soup::default()), AccelKind::Embree).err().expect("no Embree here");
        assert!(error.to_string().contains("libembree-dev") && error.to_string().contains("--features embree"), "{error}");
    }
}
