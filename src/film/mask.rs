//! A set of pixels.

/// True or false a pixel, row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    width: usize,
    height: usize,
    values: Vec<bool>,
}

impl Mask {
    /// A mask of given values.
    ///
    /// # Panics
    /// If there are not `width * height` of them.
    pub fn from_values(width: usize, height: usize, values: Vec<bool>) -> Self {
        assert_eq!(values.len(), width * height, "a mask of {width}x{height} needs as many values");
        Self { width, height, values }
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// All values.
    pub fn values(&self) -> &[bool] {
        &self.values
    }
}
