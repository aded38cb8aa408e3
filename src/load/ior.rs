//! Indices of refraction by name.

use crate::math::Rgb;

/// Dielectrics at the sodium line, as Mitsuba names them (its `ior.h`; handbook values).
pub(super) const DIELECTRICS: [(&str, f64); 23] = [
    ("vacuum", 1.0),
    ("helium", 1.000_04),
    ("hydrogen", 1.000_13),
    ("air", 1.000_28),
    ("carbon dioxide", 1.000_45),
    ("water", 1.333),
    ("acetone", 1.36),
    ("ethanol", 1.361),
    ("carbon tetrachloride", 1.461),
    ("glycerol", 1.4729),
    ("benzene", 1.501),
    ("silicone oil", 1.520_45),
    ("bromine", 1.661),
    ("water ice", 1.31),
    ("fused quartz", 1.458),
    ("pyrex", 1.47),
    ("acrylic glass", 1.49),
    ("polypropylene", 1.49),
    ("bk7", 1.5046),
    ("sodium chloride", 1.544),
    ("amber", 1.55),
    ("pet", 1.575),
    ("diamond", 2.419),
];

/// A metal: its name, real part and imaginary part of the index in linear sRGB.
pub(super) type Metal = (&'static str, [f64; 3], [f64; 3]);

/// Metals by chemical symbol. Measured spectra reduced to RGB, as published with the Tungsten renderer
/// (Bitterli, ComplexIorData.hpp) and used by the scenes exported from it; six digits.
pub(super) const METALS: [Metal; 11] = [
    ("Ag", [0.155265, 0.116723, 0.138381], [4.82834, 3.12225, 2.14695]),
    ("Al", [1.65746, 0.880369, 0.521229], [9.22387, 6.26952, 4.837]),
    ("Au", [0.143119, 0.374957, 1.44248], [3.98316, 2.38572, 1.60322]),
    ("Cr", [4.36968, 2.9167, 1.6547], [5.20643, 4.23136, 3.75495]),
    ("Cu", [0.200438, 0.924033, 1.10221], [3.91295, 2.45285, 2.14219]),
    ("Hg", [2.39893, 1.44003, 0.909551], [6.32763, 4.37194, 3.42179]),
    ("Ir", [3.08641, 2.08218, 1.61789], [5.59215, 4.06718, 3.26726]),
    ("Mo", [4.4837, 3.52546, 2.77608], [4.11113, 3.42087, 3.1506]),
    ("Ni_palik", [2.36728, 1.66336, 1.46706], [4.49883, 3.05016, 2.34543]),
    ("Rh", [2.5858, 1.86019, 1.55443], [6.78229, 4.70295, 3.97609]),
    ("W", [4.3707, 3.3003, 2.99827], [3.50068, 2.60487, 2.27319]),
];

/// The index of a dielectric.
pub(super) fn dielectric(name: &str) -> Option<f64> {
    DIELECTRICS.iter().find(|(n, _)| n.eq_ignore_ascii_case(name)).map(|(_, ior)| *ior)
}

/// The complex index of a metal.
pub(super) fn metal(name: &str) -> Option<(Rgb, Rgb)> {
    METALS.iter().find(|(n, ..)| *n == name).map(|(_, eta, k)| ((*eta).into(), (*k).into()))
}
