//! Gauss-Legendre nodes on [0, 1].

use std::sync::LazyLock;

/// Most nodes of a rule.
pub const MOST: usize = 16;

/// Nodes and weights of one rule.
#[derive(Debug, Clone, Copy)]
pub struct Rule {
    count: usize,
    at: [f64; MOST],
    weight: [f64; MOST],
}

static RULES: LazyLock<[Rule; MOST + 1]> = LazyLock::new(|| std::array::from_fn(Rule::new));

/// The rule of `n` nodes, exact for polynomials of degree 2n - 1; `n` from 1 to [`MOST`].
#[inline]
pub fn rule(n: usize) -> &'static Rule {
    &RULES[n]
}

impl Rule {
    /// Newton's iteration on the Legendre polynomial, from Tricomi's first approximation of its zeros.
    fn new(n: usize) -> Self {
        let mut rule = Self { count: n, at: [0.0; MOST], weight: [0.0; MOST] };
        for i in 0..n {
            let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..20 {
                let (mut p, mut before) = (1.0, 0.0);
                for k in 1..=n {
                    let k = k as f64;
                    (p, before) = (((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k, p);
                }
                slope = n as f64 * (x * p - before) / (x * x - 1.0);
                x -= p / slope;
            }
            rule.at[i] = 0.5 * (1.0 - x);
            rule.weight[i] = 1.0 / ((1.0 - x * x) * slope * slope);
        }
        rule
    }

    /// Pairs (node, weight).
    #[inline]
    pub fn nodes(&self) -> impl Iterator<Item = (f64, f64)> + Clone {
        self.at[..self.count].iter().copied().zip(self.weight[..self.count].iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_rule_integrates_the_powers_it_promises() {
        for n in 1..=MOST {
            for power in 0..2 * n as i32 {
                let got: f64 = rule(n).nodes().map(|(x, w)| w * x.powi(power)).sum();
                let want = 1.0 / f64::from(power + 1);
                assert!((got / want - 1.0).abs() < 1e-13, "{n} nodes, x^{power}: {got}, expected {want}");
            }
        }
    }
}
