//! Named planes of one picture: what an EXR file holds beside the image itself.

use super::Image;

/// One f32 value a pixel, row by row from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Plane {
    /// A plane of given values.
    ///
    /// # Panics
    /// If there are not `width * height` of them.
    pub fn from_values(width: usize, height: usize, values: Vec<f32>) -> Self {
        assert_eq!(values.len(), width * height, "a plane of {width}x{height} needs as many values");
        Self { width, height, values }
    }

    /// All values.
    pub fn values(&self) -> &[f32] {
        &self.values
    }
}

/// What a layer holds, which decides the names of its channels.
#[derive(Debug, Clone, PartialEq)]
pub enum LayerData {
    /// Colour: channels R, G, B.
    Rgb(Image),
    /// A vector: channels X, Y, Z.
    Xyz(Image),
    /// One value, such as depth: channel Z.
    Z(Plane),
}

/// A named part of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Prefix of its channels, such as `direct` in `direct.R`; empty for the picture itself.
    pub name: String,
    /// Its pixels.
    pub data: LayerData,
}

impl Layer {
    /// The picture itself: channels R, G, B without a prefix.
    pub fn main(image: Image) -> Self {
        Self::rgb("", image)
    }

    /// A colour layer.
    pub fn rgb(name: impl Into<String>, image: Image) -> Self {
        Self { name: name.into(), data: LayerData::Rgb(image) }
    }

    /// A layer of vectors.
    pub fn xyz(name: impl Into<String>, image: Image) -> Self {
        Self { name: name.into(), data: LayerData::Xyz(image) }
    }

    /// A layer of single values.
    pub fn z(name: impl Into<String>, plane: Plane) -> Self {
        Self { name: name.into(), data: LayerData::Z(plane) }
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        match &self.data {
            LayerData::Rgb(image) | LayerData::Xyz(image) => (image.width(), image.height()),
            LayerData::Z(plane) => (plane.width, plane.height),
        }
    }

    /// Channel names with their values, in the order of the components.
    pub fn channels(&self) -> Vec<(String, Vec<f32>)> {
        let component = |image: &Image, c: usize| image.pixels().iter().map(|p| p[c]).collect();
        match &self.data {
            LayerData::Rgb(image) => self.channel_names(&["R", "G", "B"]).zip((0..3).map(|c| component(image, c))).collect(),
            LayerData::Xyz(image) => self.channel_names(&["X", "Y", "Z"]).zip((0..3).map(|c| component(image, c))).collect(),
            LayerData::Z(plane) => self.channel_names(&["Z"]).zip([plane.values.clone()]).collect(),
        }
    }

    fn channel_names<'a>(&'a self, components: &'a [&str]) -> impl Iterator<Item = String> + 'a {
        components.iter().map(|c| channel_name(&self.name, c))
    }
}

/// Name of a channel of a layer, as viewers expect it: `direct.R`, or `R` for the picture itself.
pub fn channel_name(layer: &str, component: &str) -> String {
    if layer.is_empty() { component.to_owned() } else { format!("{layer}.{component}") }
}
