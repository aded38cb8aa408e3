//! Spectra to linear sRGB, as Mitsuba's variants with three channels do it.

use crate::math::Rgb;

/// Linear sRGB of light with the same power at all wavelengths and Y = 1.
pub(super) const EQUAL_ENERGY: Rgb = srgb([1.0, 1.0, 1.0]);

/// Shortest and longest wavelength of the table, and its step [nm].
const SHORTEST: f64 = 360.0;
const LONGEST: f64 = 830.0;
const STEP: f64 = 5.0;

/// Integral of the table's second column over wavelength [nm], by its interpolation: what makes Y = 1 of a spectrum of 1.
const Y_INTEGRAL: f64 = 106.750_259_399_414_06;

/// Points at which a spectrum is read.
const POINTS: usize = 1000;

/// Linear sRGB of light whose power is given at some wavelengths [nm], two or more and growing, and linear between them; none
/// outside. Colours beyond the sRGB gamut lose their negative parts; the second value tells.
pub(super) fn light(samples: &[(f64, f64)]) -> (Rgb, bool) {
    let mut xyz = [0.0; 3];
    for i in 0..POINTS {
        let wavelength = SHORTEST + (LONGEST - SHORTEST) * i as f64 / (POINTS - 1) as f64;
        let power = interpolate(samples, wavelength);
        let observer = observer(wavelength);
        (0..3).for_each(|k| xyz[k] += power * observer[k]);
    }
    let rgb = srgb(xyz.map(|v| v * (LONGEST - SHORTEST) / (POINTS as f64 * Y_INTEGRAL)));
    (rgb.map(|v| v.max(0.0)), rgb.min() < 0.0)
}

fn interpolate(samples: &[(f64, f64)], at: f64) -> f64 {
    let above = samples.partition_point(|s| s.0 <= at);
    match (above.checked_sub(1).map(|i| samples[i]), samples.get(above)) {
        (Some((a, left)), Some((b, right))) => left + (right - left) * (at - a) / (b - a),
        (Some((a, last)), None) if a == at => last,
        _ => 0.0,
    }
}

fn observer(wavelength: f64) -> [f64; 3] {
    let t = (wavelength - SHORTEST) / STEP;
    let i = (t as usize).min(OBSERVER.len() - 2);
    let t = t - i as f64;
    [0, 1, 2].map(|k| OBSERVER[i][k] * (1.0 - t) + OBSERVER[i + 1][k] * t)
}

/// XYZ to linear sRGB (IEC 61966-2-1 primaries, with the digits that Mitsuba uses).
const fn srgb([x, y, z]: [f64; 3]) -> Rgb {
    Rgb::new(
        3.240_479 * x - 1.537_150 * y - 0.498_535 * z,
        -0.969_256 * x + 1.875_991 * y + 0.041_556 * z,
        0.055_648 * x - 0.204_043 * y + 1.057_311 * z,
    )
}

/// CIE 1931 standard observer of 2 degrees, from 360 to 830 nm by 5 nm: x, y, z (CIE 015:2018, table 6).
const OBSERVER: [[f64; 3]; 95] = [
    [0.0001299, 0.000003917, 0.0006061],
    [0.0002321, 0.000006965, 0.001086],
    [0.0004149, 0.00001239, 0.001946],
    [0.0007416, 0.00002202, 0.003486],
    [0.001368, 0.000039, 0.006450001],
    [0.002236, 0.000064, 0.01054999],
    [0.004243, 0.00012, 0.02005001],
    [0.00765, 0.000217, 0.03621],
    [0.01431, 0.000396, 0.06785001],
    [0.02319, 0.00064, 0.1102],
    [0.04351, 0.00121, 0.2074],
    [0.07763, 0.00218, 0.3713],
    [0.13438, 0.004, 0.6456],
    [0.21477, 0.0073, 1.03905],
    [0.2839, 0.0116, 1.3856],
    [0.3285, 0.01684, 1.62296],
    [0.34828, 0.023, 1.74706],
    [0.34806, 0.0298, 1.7826],
    [0.3362, 0.038, 1.77211],
    [0.3187, 0.048, 1.7441],
    [0.2908, 0.06, 1.6692],
    [0.2511, 0.0739, 1.5281],
    [0.19536, 0.09098, 1.28764],
    [0.1421, 0.1126, 1.0419],
    [0.09564, 0.13902, 0.8129501],
    [0.05795001, 0.1693, 0.6162],
    [0.03201, 0.20802, 0.46518],
    [0.0147, 0.2586, 0.3533],
    [0.0049, 0.323, 0.272],
    [0.0024, 0.4073, 0.2123],
    [0.0093, 0.503, 0.1582],
    [0.0291, 0.6082, 0.1117],
    [0.06327, 0.71, 0.07824999],
    [0.1096, 0.7932, 0.05725001],
    [0.1655, 0.862, 0.04216],
    [0.2257499, 0.9148501, 0.02984],
    [0.2904, 0.954, 0.0203],
    [0.3597, 0.9803, 0.0134],
    [0.4334499, 0.9949501, 0.008749999],
    [0.5120501, 1.0, 0.005749999],
    [0.5945, 0.995, 0.0039],
    [0.6784, 0.9786, 0.002749999],
    [0.7621, 0.952, 0.0021],
    [0.8425, 0.9154, 0.0018],
    [0.9163, 0.87, 0.001650001],
    [0.9786, 0.8163, 0.0014],
    [1.0263, 0.757, 0.0011],
    [1.0567, 0.6949, 0.001],
    [1.0622, 0.631, 0.0008],
    [1.0456, 0.5668, 0.0006],
    [1.0026, 0.503, 0.00034],
    [0.9384, 0.4412, 0.00024],
    [0.8544499, 0.381, 0.00019],
    [0.7514, 0.321, 0.0001],
    [0.6424, 0.265, 0.00004999999],
    [0.5419, 0.217, 0.00003],
    [0.4479, 0.175, 0.00002],
    [0.3608, 0.1382, 0.00001],
    [0.2835, 0.107, 0.0],
    [0.2187, 0.0816, 0.0],
    [0.1649, 0.061, 0.0],
    [0.1212, 0.04458, 0.0],
    [0.0874, 0.032, 0.0],
    [0.0636, 0.0232, 0.0],
    [0.04677, 0.017, 0.0],
    [0.0329, 0.01192, 0.0],
    [0.0227, 0.00821, 0.0],
    [0.01584, 0.005723, 0.0],
    [0.01135916, 0.004102, 0.0],
    [0.008110916, 0.002929, 0.0],
    [0.005790346, 0.002091, 0.0],
    [0.004109457, 0.001484, 0.0],
    [0.002899327, 0.001047, 0.0],
    [0.00204919, 0.00074, 0.0],
    [0.001439971, 0.00052, 0.0],
    [0.0009999493, 0.0003611, 0.0],
    [0.0006900786, 0.0002492, 0.0],
    [0.0004760213, 0.0001719, 0.0],
    [0.0003323011, 0.00012, 0.0],
    [0.0002348261, 0.0000848, 0.0],
    [0.0001661505, 0.00006, 0.0],
    [0.000117413, 0.0000424, 0.0],
    [0.00008307527, 0.00003, 0.0],
    [0.00005870652, 0.0000212, 0.0],
    [0.00004150994, 0.00001499, 0.0],
    [0.00002935326, 0.0000106, 0.0],
    [0.00002067383, 0.0000074657, 0.0],
    [0.00001455977, 0.0000052578, 0.0],
    [0.00001025398, 0.0000037029, 0.0],
    [0.00000722146, 0.0000026078, 0.0],
    [0.00000508587, 0.0000018366, 0.0],
    [0.00000358165, 0.0000012934, 0.0],
    [0.00000252253, 0.00000091093, 0.0],
    [0.00000177651, 0.00000064153, 0.0],
    [0.00000125114, 0.00000045181, 0.0],
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_energy_light_has_unit_luminance() {
        assert!((EQUAL_ENERGY.luminance() - 1.0).abs() < 1e-4, "{}", EQUAL_ENERGY.luminance());
        let (flat, beyond) = light(&[(300.0, 1.0), (900.0, 1.0)]);
        assert!(!beyond && (flat - EQUAL_ENERGY).map(f64::abs).max() < 5e-4, "{flat:?}");
    }

    #[test]
    fn a_spectrum_reaches_from_its_first_sample_to_its_last() {
        let samples = [(400.0, 1.0), (500.0, 3.0)];
        for (wavelength, want) in [(399.9, 0.0), (400.0, 1.0), (450.0, 2.0), (500.0, 3.0), (500.1, 0.0)] {
            assert_eq!(interpolate(&samples, wavelength), want, "{wavelength} nm");
        }
    }

    /// Values that Mitsuba 3.9.1 (variant scalar_rgb) gives as the radiance of an area emitter.
    #[test]
    fn spectra_have_the_colours_that_mitsuba_gives_them() {
        let cases = [
            (vec![(400.0, 1.0), (500.0, 2.0), (600.0, 3.0), (700.0, 1.0)], [3.273_304, 2.370_931, 1.252_526], false),
            (vec![(450.0, 0.0), (500.0, 2.0), (550.0, 0.0)], [0.0, 0.642_852_6, 0.364_197_3], true),
            (vec![(560.0, 0.0), (600.0, 4.0), (640.0, 0.0)], [3.159_687, 0.381_923_7, 0.0], true),
            (vec![(300.0, 1.0), (900.0, 1.0)], [1.204_884, 0.948_228_2, 0.909_266_8], false),
        ];
        for (samples, want, beyond) in cases {
            let (got, cut) = light(&samples);
            let error = (got - Rgb::from(want)).map(f64::abs).max();
            assert!(error < 1e-4 && cut == beyond, "{samples:?}: {got:?}, expected {want:?}");
        }
    }
}
