//! A FLIP map as a picture.

use crate::film::layer::Plane;

/// Three bytes a pixel in the magma palette (van der Walt, Smith 2015): black is 0, pale yellow 1. NaN is cyan.
pub fn magma_picture(map: &Plane) -> Vec<u8> {
    let colour = |v: f32| {
        let c = colorous::MAGMA.eval_continuous(f64::from(v.clamp(0.0, 1.0)));
        if v.is_nan() { [0, 255, 255] } else { [c.r, c.g, c.b] }
    };
    map.values().iter().flat_map(|&v| colour(v)).collect()
}
