//! Acceleration of Gauss-Seidel by a Krylov method: BiCGStab [Vorst92] on the fixed point of the sweep.
//!
//! A sweep is the affine map x -> M x + g. Its slowest modes are pockets of white patches that hardly see out; there are few of them, so
//! that a Krylov space finds them in tens of steps where plain sweeps need thousands. Each channel is its own system; the three
//! walk side by side, since they share the form factors.

use crate::math::Rgb;

/// Relative residual at which it stops; what is left is swept away.
const REDUCTION: f64 = 1e-7;

/// Improves `x` towards the fixed point of `sweep` by at most `steps` steps of two sweeps each.
///
/// `sweep(x, true)` does x -> M x + g in place, `sweep(x, false)` x -> M x. A channel that breaks down keeps the best it has.
pub(super) fn accelerate(x: &mut [Rgb], steps: u32, mut sweep: impl FnMut(&mut [Rgb], bool)) {
    let n = x.len();
    // r = g - (I - M) x
    let mut r = x.to_vec();
    sweep(&mut r, true);
    r.iter_mut().zip(x.iter()).for_each(|(r, x)| *r = *r - *x);
    let shadow = r.clone();
    let (mut p, mut v) = (vec![Rgb::BLACK; n], vec![Rgb::BLACK; n]);
    let (mut rho, mut alpha, mut omega) = (Rgb::WHITE, Rgb::WHITE, Rgb::WHITE);
    let first = dot(&r, &r);
    for _ in 0..steps {
        let next = dot(&shadow, &r);
        let beta = divided(next, rho) * divided(alpha, omega);
        rho = next;
        for ((p, r), v) in p.iter_mut().zip(&r).zip(&v) {
            *p = *r + beta * (*p - omega * *v);
        }
        apply(&p, &mut v, &mut sweep);
        alpha = divided(rho, dot(&shadow, &v));
        let s: Vec<Rgb> = r.iter().zip(&v).map(|(r, v)| *r - alpha * *v).collect();
        let mut t = vec![Rgb::BLACK; n];
        apply(&s, &mut t, &mut sweep);
        omega = divided(dot(&t, &s), dot(&t, &t));
        for (i, x) in x.iter_mut().enumerate() {
            *x += alpha * p[i] + omega * s[i];
            r[i] = s[i] - omega * t[i];
        }
        let left = dot(&r, &r);
        let settled = |c: usize| left[c] <= REDUCTION * REDUCTION * first[c] || left[c].is_nan() || rho[c] == 0.0;
        if (0..3).all(settled) {
            return;
        }
    }
}

/// out = (I - M) y.
fn apply(y: &[Rgb], out: &mut Vec<Rgb>, sweep: &mut impl FnMut(&mut [Rgb], bool)) {
    out.clear();
    out.extend_from_slice(y);
    sweep(out, false);
    out.iter_mut().zip(y).for_each(|(o, y)| *o = *y - *o);
}

fn dot(a: &[Rgb], b: &[Rgb]) -> Rgb {
    a.iter().zip(b).map(|(a, b)| *a * *b).sum()
}

/// Quotient per channel; 0 where it does not exist, which leaves that channel where it is.
fn divided(a: Rgb, b: Rgb) -> Rgb {
    let quotient = |a: f64, b: f64| {
        let q = a / b;
        if q.is_finite() { q } else { 0.0 }
    };
    Rgb::new(quotient(a.r, b.r), quotient(a.g, b.g), quotient(a.b, b.b))
}
