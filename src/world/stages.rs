//! Which stages of light transport the code that follows rays contains.
//!
//! A stage that a scene does not need is not asked about at every ray: the functions that follow rays are compiled once for each
//! useful set of stages, and [`Needs::choose`] picks the set once per render.

/// A set of stages, known when the code is compiled.
pub trait Stages: Copy + Send + Sync + 'static {
    /// Lobes that are not diffuse: mirrors, glass, gloss, and the recursion through them.
    const SPECULAR: bool;
    /// Texture coordinates, and tangents along them.
    const UV: bool;
    /// Light from infinitely far away: suns, the surroundings, and what is shared with rays that find them.
    const DISTANT: bool;
    /// The test whether something stands between a point and a light.
    const VISIBILITY: bool;
    /// Spheres, and normals interpolated between vertices.
    const CURVED: bool;
    /// Three channels; without, one stands for all.
    const COLOUR: bool;
    /// Every surface is flat and of one diffuse reflectance: a hit is what [`super::flat`] knows of its triangle.
    const PLAIN: bool = !(Self::SPECULAR || Self::UV || Self::CURVED || Self::DISTANT);
    /// In a plain convex room the wall that a ray meets follows from their planes.
    const HULL: bool = Self::PLAIN && !Self::VISIBILITY;
}

/// The sets of stages, by bits: 1 specular, 2 texture coordinates, 4 distant light, 8 visibility, 16 curved, 32 colour.
#[derive(Debug, Clone, Copy)]
pub struct Kept<const BITS: u8>;

impl<const BITS: u8> Stages for Kept<BITS> {
    const SPECULAR: bool = BITS & 1 != 0;
    const UV: bool = BITS & 2 != 0;
    const DISTANT: bool = BITS & 4 != 0;
    const VISIBILITY: bool = BITS & 8 != 0;
    const CURVED: bool = BITS & 16 != 0;
    const COLOUR: bool = BITS & 32 != 0;
}

/// Nothing is left out.
pub type All = Kept<63>;

/// What a scene needs, known when it has been read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Needs {
    /// As [`Stages::SPECULAR`].
    pub specular: bool,
    /// As [`Stages::UV`].
    pub uv: bool,
    /// As [`Stages::DISTANT`].
    pub distant: bool,
    /// As [`Stages::VISIBILITY`]; only ever left out where nothing is specular and no light is distant.
    pub visibility: bool,
    /// As [`Stages::CURVED`]; only ever left out where nothing is specular and no texture is read.
    pub curved: bool,
    /// As [`Stages::COLOUR`]; only ever left out of rays with all but the visibility.
    pub colour: bool,
}

/// Work that is compiled for every set of stages.
pub trait ByStages {
    /// What it gives.
    type Output;

    /// Does it with these stages.
    fn run<K: Stages>(self) -> Self::Output;
}

impl Needs {
    /// Everything.
    pub const ALL: Needs = Needs { specular: true, uv: true, distant: true, visibility: true, curved: true, colour: true };

    /// Does `work` by the smallest of the compiled sets that holds the stages needed.
    pub fn choose<W: ByStages>(self, work: W) -> W::Output {
        match self.held().bits() {
            PLAIN_GREY_HULL => work.run::<Kept<PLAIN_GREY_HULL>>(),
            PLAIN_HULL => work.run::<Kept<PLAIN_HULL>>(),
            PLAIN => work.run::<Kept<PLAIN>>(),
            DIFFUSE => work.run::<Kept<DIFFUSE>>(),
            TEXTURED => work.run::<Kept<TEXTURED>>(),
            SPECULAR => work.run::<Kept<SPECULAR>>(),
            INDOORS => work.run::<Kept<INDOORS>>(),
            OUTDOORS => work.run::<Kept<OUTDOORS>>(),
            _ => work.run::<All>(),
        }
    }

    /// As [`Stages::PLAIN`].
    pub fn is_plain(self) -> bool {
        !(self.specular || self.uv || self.curved || self.distant)
    }

    /// What the smallest of the compiled sets holds that has all that is needed.
    pub fn held(self) -> Needs {
        let needed = self.bits();
        Self::of_bits(SETS.into_iter().find(|set| needed & !set == 0).unwrap_or(u8::MAX))
    }

    fn bits(self) -> u8 {
        let Needs { specular, uv, distant, visibility, curved, colour } = self;
        let flags = [specular, uv, distant, visibility, curved, colour];
        flags.into_iter().enumerate().fold(0, |bits, (k, flag)| bits | u8::from(flag) << k)
    }

    fn of_bits(bits: u8) -> Self {
        let [specular, uv, distant, visibility, curved, colour] = [1, 2, 4, 8, 16, 32].map(|b| bits & b != 0);
        Self { specular, uv, distant, visibility, curved, colour }
    }
}

/// Flat grey walls of a convex room.
const PLAIN_GREY_HULL: u8 = 0;
/// Flat walls of a convex room.
const PLAIN_HULL: u8 = 32;
/// Flat walls of one reflectance each.
const PLAIN: u8 = 40;
/// Diffuse surfaces of any shape.
const DIFFUSE: u8 = 56;
/// The same with textures.
const TEXTURED: u8 = 58;
/// Mirrors, glass and gloss without textures.
const SPECULAR: u8 = 57;
/// All but suns and surroundings.
const INDOORS: u8 = 59;
/// All but specular surfaces.
const OUTDOORS: u8 = 62;

/// The sets that code is compiled for, smallest first; each takes its share of the time that a build takes, so there are not all.
const SETS: [u8; 9] = [PLAIN_GREY_HULL, PLAIN_HULL, PLAIN, DIFFUSE, TEXTURED, SPECULAR, INDOORS, OUTDOORS, 63];

#[cfg(test)]
mod tests {
    use super::*;

    struct Which;

    impl ByStages for Which {
        type Output = u8;

        fn run<K: Stages>(self) -> u8 {
            let held = [K::SPECULAR, K::UV, K::DISTANT, K::VISIBILITY, K::CURVED, K::COLOUR];
            held.into_iter().enumerate().fold(0, |bits, (k, flag)| bits | u8::from(flag) << k)
        }
    }

    /// Whatever is needed is in the code that runs; no compiled set lies between the two.
    #[test]
    fn the_code_chosen_holds_what_is_needed() {
        for bits in 0..64_u8 {
            let needs = Needs::of_bits(bits);
            assert_eq!(needs.bits(), bits);
            let held = needs.choose(Which);
            assert_eq!(held & bits, bits);
            assert_eq!(needs.held().bits(), held);
            assert!(SETS.into_iter().all(|set| set & bits != bits || set & held != set || set == held), "{bits} by {held}");
        }
    }
}
