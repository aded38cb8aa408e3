//! Ideal reflection and transmission: the Kr and Kt of Whitted's recursion. [Whitted80].

use super::fresnel;
use crate::math::{Rgb, Vec3};

/// One ideal specular direction.
#[derive(Debug, Clone, Copy)]
pub struct Lobe {
    /// Unit direction the light comes from, in the local frame.
    pub wi: Vec3,
    /// Radiance towards the viewer over radiance arriving from `wi`; includes Fresnel and, across a boundary, the n² scaling.
    pub weight: Rgb,
    /// Share of power: the Fresnel factor and tint without the n² scaling. At most 1 in sum; used to choose one lobe.
    pub power: f64,
    /// True if the light comes through the surface.
    pub transmits: bool,
}

impl Lobe {
    /// True if the light goes on in its direction, as through a plate or a hole: a shadow ray could take the same way.
    #[inline]
    pub fn goes_straight(&self, wo: Vec3) -> bool {
        self.transmits && self.wi == -wo
    }

    /// The lobe of a layer that covers the share `k` of the surface.
    #[inline]
    fn scaled(mut self, k: f64) -> Self {
        self.weight = self.weight * k;
        self.power *= k;
        self
    }
}

/// Largest number of ideal directions of one material.
const MOST: usize = 4;

/// The ideal directions of a material, at most four. Of a single boundary: reflection first, then transmission.
#[derive(Debug, Clone, Copy, Default)]
pub struct Lobes {
    lobes: [Option<Lobe>; MOST],
}

impl Lobes {
    fn new(reflection: Lobe, transmission: Option<Lobe>) -> Self {
        let mut lobes = Self::default();
        lobes.push(reflection);
        transmission.into_iter().for_each(|lobe| lobes.push(lobe));
        lobes
    }

    /// Adds a lobe if it carries light; one in a direction that is there already is merged with it. What does not fit is
    /// dropped: the reader admits no material with more directions.
    fn push(&mut self, lobe: Lobe) {
        if lobe.weight.is_black() {
            return;
        }
        if let Some(same) = self.lobes.iter_mut().flatten().find(|l| l.wi == lobe.wi) {
            same.weight += lobe.weight;
            same.power += lobe.power;
        } else if let Some(free) = self.lobes.iter_mut().find(|l| l.is_none()) {
            *free = Some(lobe);
        }
    }

    /// The lobes of two materials of which the first covers the share `1 - weight` of the surface.
    pub(super) fn blended(self, other: Self, weight: f64) -> Self {
        let mut lobes = Self::default();
        self.iter().for_each(|lobe| lobes.push(lobe.scaled(1.0 - weight)));
        other.iter().for_each(|lobe| lobes.push(lobe.scaled(weight)));
        lobes
    }

    /// The same seen in a frame whose third axis is turned round.
    pub(super) fn flipped(mut self) -> Self {
        self.lobes.iter_mut().flatten().for_each(|lobe| lobe.wi.z = -lobe.wi.z);
        self
    }

    /// The lobes that carry light.
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = &Lobe> {
        self.lobes.iter().flatten()
    }

    /// One lobe chosen by its share of power with the uniform number `u`, and the probability of that choice.
    #[inline]
    pub fn choose(&self, u: f32) -> Option<(Lobe, f64)> {
        let total: f64 = self.iter().map(|lobe| lobe.power).sum();
        let mut rest = f64::from(u) * total;
        let mut last = None;
        for lobe in self.iter() {
            last = Some((*lobe, lobe.power / total));
            if rest < lobe.power {
                break;
            }
            rest -= lobe.power;
        }
        last
    }
}

fn mirrored(wo: Vec3) -> Vec3 {
    Vec3::new(-wo.x, -wo.y, wo.z)
}

/// The lobe of light that passes straight through, as through a hole.
#[inline]
pub fn straight(wo: Vec3) -> Lobes {
    let lobe = Lobe { wi: -wo, weight: Rgb::WHITE, power: 1.0, transmits: true };
    Lobes { lobes: [Some(lobe), None, None, None] }
}

/// The mirror image of the viewer, with a `factor` on radiance. The back (wo.z <= 0) is black.
#[inline]
pub fn mirror(wo: Vec3, factor: Rgb) -> Lobes {
    if wo.z <= 0.0 { Lobes::default() } else { Lobes::new(reflection(wo, factor), None) }
}

fn reflection(wo: Vec3, factor: Rgb) -> Lobe {
    Lobe { wi: mirrored(wo), weight: factor, power: factor.mean(), transmits: false }
}

/// Mirror of a metal. The back (wo.z <= 0) is black.
#[inline]
pub fn conductor(wo: Vec3, index: Option<(Rgb, Rgb)>, reflectance: Rgb) -> Lobes {
    let fresnel = index.map_or(Rgb::WHITE, |(eta, k)| fresnel::conductor(f64::from(wo.z), eta, k));
    mirror(wo, reflectance * fresnel)
}

/// Reflection and refraction at a smooth boundary; `eta` is the index below the surface over that above.
///
/// Radiance scales with n²: what crosses from index n_i to n_o is multiplied by (n_o/n_i)² besides its transmittance.
#[inline]
pub fn dielectric(wo: Vec3, eta: f64, reflectance: Rgb, transmittance: Rgb) -> Lobes {
    let below = wo.z < 0.0;
    // Index of the far side over that of the viewer's side.
    let relative = if below { 1.0 / eta } else { eta };
    let (f, cos_t) = fresnel::dielectric(f64::from(wo.z.abs()), relative);
    let transmission = (f < 1.0).then(|| {
        let scale = 1.0 / relative;
        let z = if below { cos_t } else { -cos_t };
        let wi = Vec3::new(-wo.x * scale as f32, -wo.y * scale as f32, z as f32).normalize();
        let power = transmittance * (1.0 - f);
        Lobe { wi, weight: power * (scale * scale), power: power.mean(), transmits: true }
    });
    Lobes::new(reflection(wo, reflectance * f), transmission)
}

/// Reflectance of a plate with all reflections inside it: the geometric series with T = 1 - R gives R' = 2R/(1 + R).
#[inline]
pub fn plate_reflectance(cos: f64, eta: f64) -> f64 {
    let (r, _) = fresnel::dielectric(cos, eta);
    if r < 1.0 { 2.0 * r / (1.0 + r) } else { 1.0 }
}

/// Reflection and straight transmission of a plate, with all reflections inside it: R' = R + T²R/(1 - R²), T' = 1 - R'.
#[inline]
pub fn thin_dielectric(wo: Vec3, eta: f64, reflectance: Rgb, transmittance: Rgb) -> Lobes {
    let r = plate_reflectance(f64::from(wo.z.abs()), eta);
    let through = transmittance * (1.0 - r);
    let transmission = Lobe { wi: -wo, weight: through, power: through.mean(), transmits: true };
    Lobes::new(reflection(wo, reflectance * r), Some(transmission))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_degrees(theta: f64) -> Vec3 {
        let (s, c) = theta.to_radians().sin_cos();
        Vec3::new(s as f32, 0.0, c as f32)
    }

    #[test]
    fn refraction_obeys_snell_both_ways() {
        for (eta, below) in [(1.5, false), (1.5, true), (1.33, false)] {
            let mut wo = at_degrees(30.0);
            if below {
                wo.z = -wo.z;
            }
            let lobes = dielectric(wo, eta, Rgb::WHITE, Rgb::WHITE);
            let t = lobes.iter().find(|l| l.transmits).expect("transmits");
            let (n_o, n_i) = if below { (eta, 1.0) } else { (1.0, eta) };
            let (left, right) = (n_o * f64::from(wo.x.abs()), n_i * f64::from(t.wi.x.abs()));
            assert!((left - right).abs() < 1e-6, "n sin: {left} and {right}");
            assert!(t.wi.z * wo.z < 0.0 && t.wi.x * wo.x < 0.0);
        }
    }

    #[test]
    fn beyond_the_critical_angle_all_is_reflected() {
        // Critical angles of 1.33, 1.5 and 2.42: 48.75347, 41.81031, 24.40747 degrees.
        for (eta, critical) in [(1.33, 48.753_47), (1.5, 41.810_31), (2.42, 24.407_47)] {
            let transmits = |theta: f64| {
                let wo = at_degrees(theta) * Vec3::new(1.0, 1.0, -1.0);
                dielectric(wo, eta, Rgb::WHITE, Rgb::WHITE).iter().any(|l| l.transmits)
            };
            assert!(transmits(critical - 0.01), "eta {eta} just below the critical angle");
            assert!(!transmits(critical + 0.01), "eta {eta} just above the critical angle");
        }
    }

    #[test]
    fn transmission_is_reciprocal_up_to_n_squared() {
        // Veach 1997, section 5.2: weight(o -> i)/n_o² = weight(i -> o)/n_i², and a round trip loses only (1 - F)².
        for degrees in [0.0, 20.0, 60.0] {
            let transmitted = |wo: Vec3| {
                let lobes = dielectric(wo, 1.5, Rgb::WHITE, Rgb::WHITE);
                *lobes.iter().find(|l| l.transmits).expect("transmits")
            };
            let into = transmitted(at_degrees(degrees));
            let back = transmitted(into.wi);
            let (ratio, want) = (back.weight.g / into.weight.g, 2.25 * 2.25);
            assert!((ratio / want - 1.0).abs() < 1e-5, "{degrees} degrees: ratio {ratio}, expected {want} within 1e-5");
            let power = into.weight.g * 2.25;
            assert!((into.power - power).abs() < 1e-12, "{degrees} degrees: power {}, expected {power}", into.power);
        }
    }

    #[test]
    fn the_plate_passes_what_the_slab_table_says() {
        // n = 1.5: (1 - R)/(1 + R) at 0, 30, 45, 60, 75, 80 degrees.
        let table =
            [(0.0, 0.923_077), (30.0, 0.920_266), (45.0, 0.904_327), (60.0, 0.836_232), (75.0, 0.596_092), (80.0, 0.441_229)];
        for (theta, want) in table {
            let lobes = thin_dielectric(at_degrees(theta), 1.5, Rgb::WHITE, Rgb::WHITE);
            let got = lobes.iter().find(|l| l.transmits).expect("transmits").weight.g;
            assert!((got - want).abs() < 2e-6, "{theta} degrees: {got}, expected {want}");
        }
    }

    #[test]
    fn choosing_a_lobe_keeps_the_mean() {
        let glass = |eta| dielectric(at_degrees(70.0), eta, Rgb::WHITE, Rgb::WHITE);
        let three = glass(1.5).blended(glass(1.3), 0.25);
        assert_eq!(three.iter().count(), 3, "both reflections are one");
        chosen_lobes_keep_the_mean(glass(1.5));
        chosen_lobes_keep_the_mean(three);
    }

    fn chosen_lobes_keep_the_mean(lobes: Lobes) {
        let n = 10_000;
        let mean = (0..n).filter_map(|i| lobes.choose((i as f32 + 0.5) / n as f32)).map(|(lobe, p)| lobe.power / p).sum::<f64>()
            / f64::from(n);
        assert!((mean - 1.0).abs() < 1e-3, "reflected and transmitted power sum to {mean}");
    }
}
