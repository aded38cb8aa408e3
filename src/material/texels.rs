//! The values of an image, in as few bytes as hold them exactly.

use std::sync::Arc;

/// Linear values of an image's pixels, three channels each, row by row; shared by all users of the file.
///
/// Files with eight bits a channel keep their codes, a quarter of the bytes, with the value of each code.
#[derive(Debug, Clone)]
pub struct Texels(Store);

#[derive(Debug, Clone)]
enum Store {
    Codes(Arc<Codes>),
    Values(Arc<Vec<[f32; 3]>>),
}

#[derive(Debug)]
struct Codes {
    /// Three bytes a texel.
    bytes: Vec<u8>,
    /// What each code stands for.
    values: [f32; 256],
}

impl Texels {
    /// Texels of three codes each, with what each code stands for.
    ///
    /// # Panics
    /// If the number of codes is no multiple of three.
    pub fn of_codes(bytes: Vec<u8>, values: [f32; 256]) -> Self {
        assert!(bytes.len().is_multiple_of(3), "three codes a texel");
        Self(Store::Codes(Arc::new(Codes { bytes, values })))
    }

    /// Number of texels.
    pub fn len(&self) -> usize {
        match &self.0 {
            Store::Codes(codes) => codes.bytes.len() / 3,
            Store::Values(values) => values.len(),
        }
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Texel `index`.
    #[inline]
    pub fn at(&self, index: usize) -> [f32; 3] {
        match &self.0 {
            Store::Codes(codes) => {
                let texel = &codes.bytes[3 * index..3 * index + 3];
                [0, 1, 2].map(|channel| codes.values[usize::from(texel[channel])])
            }
            Store::Values(values) => values[index],
        }
    }

    /// All texels in turn.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = [f32; 3]> {
        (0..self.len()).map(|index| self.at(index))
    }

    /// True if both are the same texels in memory.
    pub fn is_shared_with(&self, other: &Self) -> bool {
        match (&self.0, &other.0) {
            (Store::Codes(a), Store::Codes(b)) => Arc::ptr_eq(a, b),
            (Store::Values(a), Store::Values(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }
}

impl From<Vec<[f32; 3]>> for Texels {
    fn from(values: Vec<[f32; 3]>) -> Self {
        Self(Store::Values(Arc::new(values)))
    }
}

impl FromIterator<[f32; 3]> for Texels {
    fn from_iter<I: IntoIterator<Item = [f32; 3]>>(values: I) -> Self {
        values.into_iter().collect::<Vec<_>>().into()
    }
}
