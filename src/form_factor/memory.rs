//! How much memory pass one will take, known before it is taken.

use super::{FormFactorMethod, FormFactorSettings};

/// Bytes of a patch without its form factors: its pieces, means, parts of the solution and what the solver keeps of it.
const PER_PATCH: f64 = 900.0;
/// Bytes of an entry of a row while it is made symmetric, the most that it takes: as measured and transposed in f32, averaged in f64, and
/// the result.
const PER_ENTRY: f64 = 40.0;
/// Bytes of a link: as found, and in the order of its first node; single rows, which only some solvers ask for, need those of its second as well.
const PER_LINK: f64 = 28.0;
/// Bytes of a patch in the tree of groups.
const PER_LEAF: f64 = 700.0;
/// Links of a patch at a tolerance of 1e-3: of furnished rooms 190 were counted at most.
const LINKS: f64 = 240.0;
/// They grow with this power of the inverse tolerance.
const LINKS_POWER: f64 = 0.4;
/// Pixels of a hemicube that find different patches, at most.
const SEEN_BY_HEMICUBE: f64 = 8192.0;

/// Most bytes that pass one takes over `patches` patches, besides the scene: an upper estimate from counts, not a promise.
pub fn predicted(patches: f64, settings: &FormFactorSettings) -> f64 {
    let n = patches;
    let factors = match settings.method {
        FormFactorMethod::RayCast => {
            // A ray finds one patch at most; averaging fills both directions.
            let rays = (0.25 / (settings.tolerance * settings.tolerance)).clamp(16.0, 65536.0) * 2.0;
            // Half of a pair.
            let of_pairs = if settings.in_pairs { 4.0 * rays } else { 0.0 };
            n * (n.min(2.0 * rays) * PER_ENTRY + of_pairs)
        }
        FormFactorMethod::Analytic => n * n * PER_ENTRY,
        FormFactorMethod::Hemicube => n * n.min(SEEN_BY_HEMICUBE) * PER_ENTRY,
        FormFactorMethod::Hierarchical => {
            let links = LINKS * (1e-3 / settings.tolerance).powf(LINKS_POWER);
            n * (links.min(0.5 * n) * PER_LINK + PER_LEAF)
        }
    };
    // In a room with a mirrored wall every patch may see every other in it.
    let rooms = if settings.virtual_rooms.is_some() { n * n * PER_ENTRY } else { 0.0 };
    factors + rooms + n * PER_PATCH
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(method: FormFactorMethod, patches: f64) -> f64 {
        predicted(
            patches,
            &FormFactorSettings {
                method,
                tolerance: method.default_tolerance(),
                shadow_rays: 32.0,
                extended: true,
                virtual_rooms: None,
                in_pairs: false,
                seed: 0,
            },
        )
    }

    /// What is dense grows with the square of the patches, links with their number: 1e5 patches in 1 GiB, 1e6 in a tenth of what rows need.
    #[test]
    fn links_are_what_fits_a_million_patches() {
        let gib = 1024.0_f64.powi(3);
        assert!(of(FormFactorMethod::Hierarchical, 1e5) < gib);
        assert!(of(FormFactorMethod::Analytic, 1e5) > 300.0 * gib);
        assert!((of(FormFactorMethod::Analytic, 2e5) / of(FormFactorMethod::Analytic, 1e5) - 4.0).abs() < 0.01);
        assert!((of(FormFactorMethod::Hierarchical, 2e6) / of(FormFactorMethod::Hierarchical, 1e6) - 2.0).abs() < 0.01);
        assert!(of(FormFactorMethod::RayCast, 1e6) > 5.0 * of(FormFactorMethod::Hierarchical, 1e6));
    }
}
