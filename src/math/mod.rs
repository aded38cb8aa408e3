//! Vectors (from glam), orthonormal frames, compensated sums, colour triples, warps and the sampler.

pub mod rgb;
pub mod sampler;
mod series;
pub mod warp;

pub use glam::{DAffine3, DMat3, DMat4, DVec2, DVec3, Mat3, Vec2, Vec3, Vec3A, Vec4};
pub use rgb::Rgb;
pub use sampler::{Change, Proposal, Sampler, SamplerKind};

/// Orthonormal right-handed frame whose third axis is a given unit normal.
///
/// Construction without a square root and without a pole (Duff et al. 2017, "Building an Orthonormal Basis, Revisited",
/// listing 3).
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// First tangent.
    pub s: Vec3,
    /// Second tangent.
    pub t: Vec3,
    /// Normal.
    pub n: Vec3,
}

impl Frame {
    /// Frame around the unit vector `n`.
    #[inline]
    pub fn new(n: Vec3) -> Self {
        let sign = 1.0_f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Self { s: Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), t: Vec3::new(b, sign + n.y * n.y * a, -n.y), n }
    }

    /// From frame coordinates to world coordinates.
    #[inline]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.s * v.x + self.t * v.y + self.n * v.z
    }

    /// From world coordinates to frame coordinates.
    #[inline]
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.s), v.dot(self.t), v.dot(self.n))
    }
}

/// Sum with a running compensation (Neumaier 1974): error of about two roundings, whatever the number of terms.
#[derive(Debug, Clone, Copy, Default)]
pub struct CompensatedSum {
    sum: f64,
    compensation: f64,
}

impl CompensatedSum {
    /// Adds one term.
    #[inline]
    pub fn add(&mut self, value: f64) {
        let sum = self.sum + value;
        self.compensation += if self.sum.abs() >= value.abs() { (self.sum - sum) + value } else { (value - sum) + self.sum };
        self.sum = sum;
    }

    /// The sum so far.
    #[inline]
    pub fn value(self) -> f64 {
        self.sum + self.compensation
    }
}

impl FromIterator<f64> for CompensatedSum {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut sum = Self::default();
        values.into_iter().for_each(|value| sum.add(value));
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_orthonormal_and_right_handed() {
        let normals = [Vec3::X, -Vec3::X, Vec3::Z, -Vec3::Z, Vec3::new(0.3, -0.5, -0.81).normalize()];
        for n in normals {
            let frame = Frame::new(n);
            for (name, value, want) in [
                ("s.t", frame.s.dot(frame.t), 0.0),
                ("s.n", frame.s.dot(n), 0.0),
                ("|s|", frame.s.length(), 1.0),
                ("|t|", frame.t.length(), 1.0),
                ("(s x t).n", frame.s.cross(frame.t).dot(n), 1.0),
            ] {
                assert!((value - want).abs() < 1e-6, "{name} of {n}: {value}, expected {want}");
            }
        }
    }

    #[test]
    fn compensated_sum_keeps_small_terms() {
        let sum: CompensatedSum = [1.0, 1e100, 1.0, -1e100].into_iter().collect();
        assert_eq!(sum.value(), 2.0);
    }
}
