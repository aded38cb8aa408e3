//! Means of groups drawn towards those of the groups around them, as far as their difference may be noise.
//!
//! Light by gloss comes to some groups by one ray in thousands: one group finds it, those beside it do not, and a thousandth of the groups
//! holds more than half of the squared error. On the way down the tree the difference between the two parts of a node is kept in the share
//! 1 - c v/d² of it, d being the difference and v its variance: wavelets are shrunk so [Gao98]. What one part gives the other gets: totals stay.

/// Times the variance by which a difference must be larger than noise would make it.
const CERTAIN: f64 = 3.0;

/// What is known of a group.
#[derive(Debug, Clone, Copy)]
pub struct Estimate<const N: usize> {
    /// Means over the group.
    pub mean: [f64; N],
    /// The mean that decides, and its variance.
    pub level: f64,
    /// The variance of that.
    pub variance: f64,
    /// Weight of the group in means of several; 0: it has no part in it.
    pub area: f64,
}

/// A binary tree in preorder, of which each leaf is a group.
pub struct Branches {
    /// By node: the two below it as places in this list; `None`: a group.
    below: Vec<Option<[u32; 2]>>,
}

impl Branches {
    /// From whether each node is a group, in preorder.
    pub fn new(is_group: &[bool]) -> Self {
        let mut below = vec![None; is_group.len()];
        // From the end: the nodes below one are the last two that nobody holds yet, the first of them on top.
        let mut loose = Vec::new();
        for (at, is_group) in is_group.iter().enumerate().rev() {
            if !is_group && let (Some(first), Some(second)) = (loose.pop(), loose.pop()) {
                below[at] = Some([first, second]);
            }
            loose.push(at as u32);
        }
        Self { below }
    }

    /// `values` of the groups, each replaced by the mean over the smallest node above it that holds `fewest` groups or more.
    pub fn pool(&self, values: &[f64], fewest: u32) -> Vec<f64> {
        let mut sums = vec![(0.0, 1_u32); self.below.len()];
        let mut left = values.iter().rev();
        for (at, below) in self.below.iter().enumerate().rev() {
            sums[at] = match below {
                None => (left.next().copied().unwrap_or(0.0), 1),
                Some(parts) => {
                    let [a, b] = parts.map(|part| sums[part as usize]);
                    (a.0 + b.0, a.1 + b.1)
                }
            };
        }
        for (at, below) in self.below.iter().enumerate() {
            let (sum, count) = sums[at];
            for part in below.iter().flatten().map(|part| *part as usize) {
                if sums[part].1 < fewest {
                    sums[part] = (sum / f64::from(count) * f64::from(sums[part].1), sums[part].1);
                }
            }
        }
        let is_group = |(at, (sum, _)): (usize, (f64, u32))| self.below[at].is_none().then_some(sum);
        sums.into_iter().enumerate().filter_map(is_group).collect()
    }

    /// The means of `groups`, given in the tree's order, drawn together.
    pub fn shrink<const N: usize>(&self, groups: &[Estimate<N>]) -> Vec<[f64; N]> {
        let none = Estimate { mean: [0.0; N], level: 0.0, variance: 0.0, area: 0.0 };
        let mut known = vec![none; self.below.len()];
        let mut left = groups.iter().rev();
        for (at, below) in self.below.iter().enumerate().rev() {
            known[at] = match below {
                None => left.next().copied().unwrap_or(none),
                Some([a, b]) => join(&known[*a as usize], &known[*b as usize]),
            };
        }
        let mut drawn: Vec<[f64; N]> = known.iter().map(|e| e.mean).collect();
        for (at, below) in self.below.iter().enumerate() {
            let Some([first, second]) = below.map(|b| b.map(|k| k as usize)) else { continue };
            let (a, b) = (&known[first], &known[second]);
            let area = a.area + b.area;
            if area <= 0.0 {
                continue;
            }
            let kept = kept_share(a.level - b.level, a.variance + b.variance);
            let whole = drawn[at];
            let apart: [f64; N] = std::array::from_fn(|k| (a.mean[k] - b.mean[k]) * kept / area);
            drawn[first] = std::array::from_fn(|k| whole[k] + b.area * apart[k]);
            drawn[second] = std::array::from_fn(|k| whole[k] - a.area * apart[k]);
        }
        let is_group = |(at, mean): (usize, [f64; N])| self.below[at].is_none().then_some(mean);
        drawn.into_iter().enumerate().filter_map(is_group).collect()
    }
}

/// Share of a difference that is kept.
fn kept_share(difference: f64, variance: f64) -> f64 {
    let squared = difference * difference;
    if squared > CERTAIN * variance { 1.0 - CERTAIN * variance / squared } else { 0.0 }
}

/// Two groups as one.
fn join<const N: usize>(a: &Estimate<N>, b: &Estimate<N>) -> Estimate<N> {
    let area = a.area + b.area;
    let share = if area > 0.0 { a.area / area } else { 0.5 };
    let mix = |a: f64, b: f64| share * a + (1.0 - share) * b;
    Estimate {
        mean: std::array::from_fn(|k| mix(a.mean[k], b.mean[k])),
        level: mix(a.level, b.level),
        variance: share * share * a.variance + (1.0 - share) * (1.0 - share) * b.variance,
        area,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four groups, the third and fourth of which are one half.
    fn four() -> Branches {
        Branches::new(&[false, false, true, true, false, true, true])
    }

    fn group(mean: f64, variance: f64, area: f64) -> Estimate<1> {
        Estimate { mean: [mean], level: mean, variance, area }
    }

    fn total(groups: &[Estimate<1>], means: &[[f64; 1]]) -> f64 {
        groups.iter().zip(means).map(|(g, m)| g.area * m[0]).sum()
    }

    /// One ray in many has found all of it: its square is its variance.
    #[test]
    fn what_one_ray_found_is_spread_over_all() {
        let groups = [group(0.0, 0.0, 1.0), group(8.0, 64.0, 1.0), group(0.0, 0.0, 2.0), group(0.0, 0.0, 4.0)];
        let drawn = four().shrink(&groups);
        assert!(drawn.iter().all(|m| (m[0] - 1.0).abs() < 1e-12), "{drawn:?}");
    }

    #[test]
    fn what_is_certain_stays_and_totals_stay() {
        let certain = [group(1.0, 0.0, 1.0), group(8.0, 0.0, 3.0), group(2.0, 0.0, 2.0), group(5.0, 0.0, 0.5)];
        let drawn = four().shrink(&certain);
        assert!(drawn.iter().zip(&certain).all(|(m, g)| (m[0] - g.mean[0]).abs() < 1e-12), "{drawn:?}");
        let noisy = certain.map(|g| Estimate { variance: 0.7 * g.level, ..g });
        let drawn = four().shrink(&noisy);
        assert!((total(&noisy, &drawn) - total(&noisy, &certain.map(|g| g.mean))).abs() < 1e-12, "{drawn:?}");
        // 7 apart, by a variance of 6.3: 1 - 3 x 6.3 / 49 of it is kept.
        assert!((drawn[1][0] - drawn[0][0] - 7.0 * (1.0 - 18.9 / 49.0)).abs() < 1e-12, "{drawn:?}");
    }

    #[test]
    fn a_group_without_area_takes_and_gives_nothing() {
        let groups = [group(3.0, 9.0, 1.0), group(7.0, 0.0, 0.0), group(5.0, 9.0, 1.0), group(4.0, 9.0, 2.0)];
        let drawn = four().shrink(&groups);
        assert!((total(&groups, &drawn) - 16.0).abs() < 1e-12, "{drawn:?}");
    }

    #[test]
    fn values_are_pooled_over_the_smallest_node_that_is_large_enough() {
        let values = [1.0, 3.0, 5.0, 11.0];
        assert_eq!(four().pool(&values, 2), [2.0, 2.0, 8.0, 8.0]);
        assert_eq!(four().pool(&values, 4), [5.0; 4]);
        assert_eq!(four().pool(&values, 1), values);
    }
}
