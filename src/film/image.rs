//! A picture of linear f32 values.

/// Linear radiance, three channels, row by row from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    width: usize,
    height: usize,
    pixels: Vec<[f32; 3]>,
}

impl Image {
    /// A black image.
    pub fn new(width: usize, height: usize) -> Self {
        Self::from_pixels(width, height, vec![[0.0; 3]; width * height])
    }

    /// An image of given pixels.
    ///
    /// # Panics
    /// If there are not `width * height` of them.
    pub fn from_pixels(width: usize, height: usize, pixels: Vec<[f32; 3]>) -> Self {
        assert_eq!(pixels.len(), width * height, "an image of {width}x{height} needs as many pixels");
        Self { width, height, pixels }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels.
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// All pixels, to be changed.
    pub fn pixels_mut(&mut self) -> &mut [[f32; 3]] {
        &mut self.pixels
    }

    /// The pixel in column `x` of row `y`.
    pub fn at(&self, x: usize, y: usize) -> [f32; 3] {
        self.pixels[y * self.width + x]
    }
}

impl Image {
    /// One channel as a plane.
    pub fn channel(&self, index: usize) -> super::layer::Plane {
        let values = self.pixels.iter().map(|p| p[index]).collect();
        super::layer::Plane::from_values(self.width, self.height, values)
    }

    /// Mean over the square of side `2 radius + 1` around each pixel, cut off at the border.
    pub fn box_filtered(&self, radius: usize) -> Image {
        let rows = |get: &dyn Fn(usize, usize) -> [f64; 3], n: usize, i: usize, k: usize| {
            let range = i.saturating_sub(radius)..(i + radius + 1).min(n);
            let count = range.len() as f64;
            let sum = range.fold([0.0; 3], |sum, j| {
                let v = get(j, k);
                [sum[0] + v[0], sum[1] + v[1], sum[2] + v[2]]
            });
            sum.map(|s| s / count)
        };
        let (w, h) = (self.width, self.height);
        let across: Vec<[f64; 3]> = (0..w * h).map(|i| rows(&|x, y| self.at(x, y).map(f64::from), w, i % w, i / w)).collect();
        let pixels = (0..w * h).map(|i| rows(&|y, x| across[y * w + x], h, i / w, i % w).map(|v| v as f32)).collect();
        Image::from_pixels(w, h, pixels)
    }
}
