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

/// At most two lobes: reflection first, then transmission.
#[derive(Debug, Clone, Copy, Default)]
pub struct Lobes {
    lobes: [Option<Lobe>; 2],
}

impl Lobes {
    fn new(reflection: Lobe, transmission: Option<Lobe>) -> Self {
        let visible = |lobe: &Lobe| !lobe.weight.is_black();
        Self { lobes: [Some(reflection).filter(visible), transmission.filter(visible)] }
    }

    /// The lobes that carry light.
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = &Lobe> {
        self.lobes.iter().flatten()
    }

    /// One lobe chosen by its share of power with the uniform number `u`, and the probability of that choice.
    #[inline]
    pub fn choose(&self, u: f32) -> Option<(Lobe, f64)> {
        match self.lobes {
            [Some(a), Some(b)] => {
                let p = a.power / (a.power + b.power);
                Some(if f64::from(u) < p { (a, p) } else { (b, 1.0 - p) })
            }
            [Some(a), None] | [None, Some(a)] => Some((a, 1.0)),
            [None, None] => None,
        }
    }
}

fn mirrored(wo: Vec3) -> Vec3 {
    Vec3::new(-wo.x, -wo.y, wo.z)
}

fn reflection(wo: Vec3, factor: Rgb) -> Lobe {
    Lobe { wi: mirrored(wo), weight: factor, power: factor.mean(), transmits: false }
}

/// Mirror of a metal. The back (wo.z <= 0) is black.
#[inline]
pub fn conductor(wo: Vec3, index: Option<(Rgb, Rgb)>, reflectance: Rgb) -> Lobes {
    if wo.z <= 0.0 {
        return Lobes::default();
    }
    let fresnel = index.map_or(Rgb::WHITE, |(eta, k)| fresnel::conductor(f64::from(wo.z), eta, k));
    Lobes::new(reflection(wo, reflectance * fresnel), None)
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

/// Reflection and straight transmission of a plate, with all reflections inside it: R' = R + T²R/(1 - R²), T' = 1 - R'.
#[inline]
pub fn thin_dielectric(wo: Vec3, eta: f64, reflectance: Rgb, transmittance: Rgb) -> Lobes {
    let (r, _) = fresnel::dielectric(f64::from(wo.z.abs()), eta);
    // The geometric series with T = 1 - R gives R' = 2R/(1 + R).
    let r = if r < 1.0 { 2.0 * r / (1.0 + r) } else { 1.0 };
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
        let lobes = dielectric(at_degrees(70.0), 1.5, Rgb::WHITE, Rgb::WHITE);
        let n = 10_000;
        let mean = (0..n).filter_map(|i| lobes.choose((i as f32 + 0.5) / n as f32)).map(|(lobe, p)| lobe.power / p).sum::<f64>()
            / f64::from(n);
        assert!((mean - 1.0).abs() < 1e-3, "reflected and transmitted power sum to {mean}");
    }
}
