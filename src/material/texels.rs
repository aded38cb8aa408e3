//! The values of an image, in as few bytes as hold them exactly.

use std::fmt;
use std::sync::Arc;

/// Linear values of an image's pixels, three channels each, row by row; shared by all users of the file.
///
/// Files with eight bits a channel keep their codes, a quarter of the bytes, with the value of each code.
#[derive(Clone)]
pub struct Texels(Store);

#[derive(Clone)]
enum Store {
    Codes(Arc<Codes>),
    Values(Arc<Vec<[f32; 3]>>),
}

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

/// Their number and a hash of all: what scenes are told apart by, of which millions of values would be slow to write.
impl fmt::Debug for Texels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut hash = blake3::Hasher::new();
        match &self.0 {
            Store::Codes(codes) => {
                hash.update(&codes.bytes);
                codes.values.iter().for_each(|v| _ = hash.update(&v.to_bits().to_le_bytes()));
            }
            Store::Values(values) => {
                let bytes: Vec<u8> = values.iter().flatten().flat_map(|v| v.to_bits().to_le_bytes()).collect();
                hash.update(&bytes);
            }
        }
        write!(f, "Texels({} {})", self.len(), hash.finalize())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_read_as_their_values() {
        let values = std::array::from_fn(|code| (code * code) as f32);
        let texels = Texels::of_codes(vec![0, 1, 255, 7, 8, 9], values);
        let want = [[0.0, 1.0, 65_025.0], [49.0, 64.0, 81.0]];
        assert_eq!((texels.len(), texels.at(1)), (2, want[1]));
        assert_eq!(texels.iter().collect::<Vec<_>>(), want);
        // Values without codes say the same.
        let plain: Texels = want.into_iter().collect();
        assert_eq!((plain.len(), plain.is_empty()), (2, false));
        assert_eq!(plain.iter().collect::<Vec<_>>(), want);
    }

    #[test]
    fn what_is_written_of_texels_tells_any_two_apart() {
        let values: [f32; 256] = std::array::from_fn(|code| code as f32);
        let mut others = values;
        others[200] = 200.5;
        let written = |texels: Texels| format!("{texels:?}");
        let whole = written(Texels::of_codes(vec![1, 2, 3, 4, 5, 6], values));
        assert_eq!(whole, written(Texels::of_codes(vec![1, 2, 3, 4, 5, 6], values)));
        assert_ne!(whole, written(Texels::of_codes(vec![1, 2, 3, 4, 5, 7], values)));
        assert_ne!(whole, written(Texels::of_codes(vec![1, 2, 3, 4, 5, 6], others)));
        assert_ne!(written(vec![[0.5, 0.5, 1.0]].into()), written(vec![[0.5, 0.5, 1.0 + f32::EPSILON]].into()));
        assert!(whole.len() < 100, "{whole}");
    }

    #[test]
    fn clones_share_their_texels() {
        let of_codes = || Texels::of_codes(vec![1, 2, 3], [0.5; 256]);
        let of_values = || Texels::from(vec![[0.5; 3]]);
        for (a, b) in [(of_codes(), of_codes()), (of_values(), of_values()), (of_codes(), of_values())] {
            assert!(a.is_shared_with(&a.clone()) && !a.is_shared_with(&b));
        }
    }
}
