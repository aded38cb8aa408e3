//! Stored rows of form factors: sparse, f32 entries, sums in f64.

use super::ray_pairs::{Met, RayPairs};
use super::{Closure, FormFactors};
use crate::math::Rgb;
use rayon::prelude::*;

/// Sparse rows by patch. Two parts: what is seen directly, and what is seen through mirrors and glass (extended form factors,
/// [Sillion89]), which is coloured.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct FormFactorMatrix {
    pub(super) start: Vec<usize>,
    pub(super) column: Vec<u32>,
    pub(super) factor: Vec<f32>,
    /// Closes each row exactly in f64 over its rounded entries: a bright room amplifies what is missing by 1/(1 - rho).
    pub(super) row_scale: Vec<f64>,
    /// Factor of each column in f64; 1 where the entries are form factors. Where they are transports S_ij, the same bits in both directions,
    /// F_ij = (d_i / A_i) S_ij d_j is reciprocal whatever the rounding of S.
    pub(super) column_scale: Vec<f64>,
    pub(super) specular_start: Vec<usize>,
    pub(super) specular_column: Vec<u32>,
    pub(super) specular_factor: Vec<[f32; 3]>,
    /// Quality before correction.
    pub closure: Closure,
    /// What pairs of rays met, if that was asked for; never kept in a file.
    #[serde(skip)]
    pub(super) pairs: RayPairs,
}

/// One row as it is measured.
#[derive(Debug, Clone, Default)]
pub struct Row {
    /// Patches seen directly, with their form factor, by rising patch.
    pub direct: Vec<(u32, f32)>,
    /// Patches seen through specular surfaces, by rising patch.
    pub specular: Vec<(u32, [f32; 3])>,
    /// What pairs of rays met.
    pub pairs: Vec<[Met; 2]>,
}

impl FormFactorMatrix {
    /// Puts rows together.
    pub fn from_rows(rows: Vec<Row>) -> Self {
        let mut matrix = Self { start: vec![0], specular_start: vec![0], ..Self::default() };
        matrix.column.reserve(rows.iter().map(|r| r.direct.len()).sum());
        matrix.factor.reserve(matrix.column.capacity());
        for row in rows {
            matrix.column.extend(row.direct.iter().map(|e| e.0));
            matrix.factor.extend(row.direct.iter().map(|e| e.1));
            matrix.specular_column.extend(row.specular.iter().map(|e| e.0));
            matrix.specular_factor.extend(row.specular.iter().map(|e| e.1));
            matrix.pairs.push(row.pairs);
            matrix.row_scale.push(1.0);
            matrix.column_scale.push(1.0);
            matrix.start.push(matrix.column.len());
            matrix.specular_start.push(matrix.specular_column.len());
        }
        matrix
    }

    /// What pairs of rays met, if that was asked for.
    pub fn pairs(&self) -> Option<&RayPairs> {
        (!self.pairs.is_empty()).then_some(&self.pairs)
    }

    /// Number of entries above zero, those through specular surfaces included.
    pub fn n_nonzero(&self) -> usize {
        self.column.len() + self.specular_column.len()
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        8 * self.column.len() + 16 * self.specular_column.len() + 32 * self.len() + self.pairs.memory_bytes()
    }

    /// Entries (j, F_ij) of row i that are seen directly.
    #[inline]
    pub fn direct(&self, i: usize) -> impl Iterator<Item = (usize, f64)> {
        let range = self.start[i]..self.start[i + 1];
        let scale = self.row_scale[i];
        let entries = self.column[range.clone()].iter().zip(&self.factor[range]);
        entries.map(move |(j, f)| (*j as usize, f64::from(*f) * scale * self.column_scale[*j as usize]))
    }

    /// Entries (j, F_ij) of row i that are seen through specular and glossy surfaces.
    #[inline]
    pub fn specular(&self, i: usize) -> impl Iterator<Item = (usize, Rgb)> {
        let range = self.specular_start[i]..self.specular_start[i + 1];
        self.specular_column[range.clone()].iter().zip(&self.specular_factor[range]).map(|(j, f)| (*j as usize, Rgb::from(*f)))
    }

    /// Sum of the direct entries of row i.
    pub fn direct_sum(&self, i: usize) -> f64 {
        self.direct(i).map(|(_, f)| f).sum()
    }

    /// out_i = sum_j F_ij x_j over what is seen directly, in parallel.
    pub fn gather_direct(&self, x: &[Rgb], out: &mut [Rgb]) {
        let x = self.scaled(x);
        out.par_iter_mut().enumerate().with_min_len(64).for_each(|(i, out)| *out = self.direct_product(i, &x));
    }

    /// x by column, times the factor of the column, in four lanes.
    fn scaled(&self, x: &[Rgb]) -> Vec<[f64; 4]> {
        x.iter().zip(&self.column_scale).map(|(x, scale)| [x.r * scale, x.g * scale, x.b * scale, 0.0]).collect()
    }

    /// Row i of the direct part times x as [`Self::scaled`] has it. Four sums side by side: one alone would wait for each addition.
    fn direct_product(&self, i: usize, x: &[[f64; 4]]) -> Rgb {
        let range = self.start[i]..self.start[i + 1];
        let (columns, factors) = (&self.column[range.clone()], &self.factor[range]);
        let mut sums = [[0.0; 4]; 4];
        let mut add = |lane: usize, j: u32, f: f32| {
            let (sum, x, f) = (&mut sums[lane], &x[j as usize], f64::from(f));
            (0..4).for_each(|c| sum[c] += x[c] * f);
        };
        let (fours, rest) = columns.as_chunks::<4>();
        let (four_factors, rest_factors) = factors.as_chunks::<4>();
        for (j, f) in fours.iter().zip(four_factors) {
            (0..4).for_each(|lane| add(lane, j[lane], f[lane]));
        }
        rest.iter().zip(rest_factors).for_each(|(&j, &f)| add(0, j, f));
        let sum = |c: usize| (sums[0][c] + sums[1][c]) + (sums[2][c] + sums[3][c]);
        Rgb::new(sum(0), sum(1), sum(2)) * self.row_scale[i]
    }

    /// As [`FormFactors::gather`], of what is equal in all channels: the same bits by a third of the products.
    pub fn gather_grey(&self, x: &[Rgb], out: &mut [Rgb]) {
        let x: Vec<f64> = x.iter().map(|x| x.r).collect();
        out.par_iter_mut().enumerate().with_min_len(64).for_each(|(i, out)| {
            let direct = self.direct(i).fold(0.0, |sum, (j, f)| sum + x[j] * f);
            let specular = self.specular(i).fold(0.0, |sum, (j, f)| sum + x[j] * f.r);
            *out = Rgb::grey(direct + specular);
        });
    }

    /// Measures reciprocity, then makes the direct part symmetric in A_i F_ij and scales it back to the row sums it had.
    ///
    /// Each pair is averaged with weights inverse to the variances of its two estimates, A_i S_ij / `rays`_i. The scaling is a symmetric Sinkhorn iteration D S D: averaging alone would destroy closure, which
    /// a bright room amplifies by 1/(1 - rho). A last step brings every row to its sum exactly.
    /// Rows that cannot count (`is_idle`) are scaled like the others, and do not say when it is enough.
    pub fn symmetrise(&mut self, area: &[f64], rays: &[f64], is_idle: impl Fn(usize) -> bool + Sync) {
        let weight_of: Vec<f64> = rays.iter().zip(area).map(|(n, a)| n / a).collect();
        let target: Vec<f64> = (0..self.len()).map(|i| self.direct_sum(i)).collect();
        let transposed = self.transposed();
        let mut rows = Vec::with_capacity(self.len());
        let (mut defect, mut weight) = (0.0, 0.0);
        for i in 0..self.len() {
            let mut row = Vec::new();
            let mut own = self.direct(i).peekable();
            let mut other = transposed[i].iter().peekable();
            while own.peek().is_some() || other.peek().is_some() {
                let j = own.peek().map_or(usize::MAX, |e| e.0).min(other.peek().map_or(usize::MAX, |e| e.0 as usize));
                let f_ij = own.next_if(|e| e.0 == j).map_or(0.0, |e| e.1);
                let f_ji = other.next_if(|e| e.0 as usize == j).map_or(0.0, |e| f64::from(e.1));
                let (ours, theirs) = (area[i] * f_ij, area[j] * f_ji);
                let (w_i, w_j) = (weight_of[i], weight_of[j]);
                let symmetric = (ours * w_i + theirs * w_j) / (w_i + w_j);
                defect += (ours - theirs) * (ours - theirs) / symmetric;
                weight += symmetric;
                row.push((j as u32, symmetric));
            }
            rows.push(row);
        }
        self.closure.reciprocity_defect = if weight > 0.0 { (defect / weight).sqrt() } else { 0.0 };
        let scale = sinkhorn(&rows, &target, area, (60, 1e-7), &is_idle);
        let (mut start, mut column, mut factor) = (vec![0], Vec::new(), Vec::new());
        let mut sums = Vec::with_capacity(rows.len());
        for (i, row) in rows.iter().enumerate() {
            let scaled = |(j, s): &(u32, f64)| s * scale[i] * scale[*j as usize] / area[i];
            sums.push(row.iter().map(scaled).sum());
            column.extend(row.iter().map(|e| e.0));
            factor.extend(row.iter().map(|e| scaled(e) as f32));
            let stored: f64 = factor[start[i]..].iter().map(|f| f64::from(*f)).sum();
            self.row_scale[i] = if stored > 0.0 { target[i] / stored } else { 1.0 };
            start.push(column.len());
        }
        let counting = (0..sums.len()).filter(|i| !is_idle(*i));
        self.closure.corrected_defect = Closure::mean_defect(counting.map(|i| (area[i], sums[i], target[i])));
        (self.start, self.column, self.factor) = (start, column, factor);
    }

    /// Replaces the direct part by exchanges S_ij = A_i F_ij, given for i <= j, scaled symmetrically to the row sums of `target`; `None`: a
    /// row that keeps its own. Reciprocity holds by construction.
    pub fn set_exchanges(&mut self, upper: &[Vec<(u32, f64)>], area: &[f64], target: &[Option<f64>]) {
        let n = upper.len();
        // In units of the largest patch, so that f32 holds them in scenes of any size; rounded before they are closed, so that what closes
        // them knows their rounding.
        let unit = area.iter().copied().fold(0.0, f64::max);
        let mut rows: Vec<Vec<(u32, f64)>> = vec![Vec::new(); n];
        for (i, row) in upper.iter().enumerate() {
            for &(j, s) in row {
                let s = f64::from((s / unit) as f32);
                rows[i].push((j, s));
                if j as usize != i {
                    rows[j as usize].push((i as u32, s));
                }
            }
        }
        rows.par_iter_mut().for_each(|row| row.sort_unstable_by_key(|e| e.0));
        let area: Vec<f64> = area.iter().map(|a| a / unit).collect();
        let own = |i: usize| rows[i].iter().map(|e| e.1).sum::<f64>() / area[i];
        let target: Vec<f64> = (0..n).map(|i| target[i].unwrap_or_else(|| own(i))).collect();
        let scale = sinkhorn(&rows, &target, &area, (400, 1e-13), |_| false);
        (self.start, self.column, self.factor) = (vec![0], Vec::new(), Vec::new());
        let total = rows.iter().map(Vec::len).sum();
        self.column.reserve_exact(total);
        self.factor.reserve_exact(total);
        for row in &rows {
            self.column.extend(row.iter().map(|e| e.0));
            self.factor.extend(row.iter().map(|e| e.1 as f32));
            self.start.push(self.column.len());
        }
        self.row_scale = scale.iter().zip(&area).map(|(d, a)| d / a).collect();
        self.column_scale = scale;
        self.closure.reciprocity_defect = 0.0;
        self.closure.corrected_defect = Closure::mean_defect((0..n).map(|i| (area[i], self.direct_sum(i), target[i])));
    }

    /// Replaces what is seen by way of specular surfaces: entries (j, F_ij) by rising patch for each row.
    pub fn set_specular(&mut self, rows: &[Vec<(u32, Rgb)>]) {
        (self.specular_start, self.specular_column, self.specular_factor) = (vec![0], Vec::new(), Vec::new());
        for row in rows {
            self.specular_column.extend(row.iter().map(|e| e.0));
            self.specular_factor.extend(row.iter().map(|e| e.1.to_array().map(|v| v as f32)));
            self.specular_start.push(self.specular_column.len());
        }
    }

    fn transposed(&self) -> Vec<Vec<(u32, f32)>> {
        let mut rows = vec![Vec::new(); self.len()];
        for i in 0..self.len() {
            for k in self.start[i]..self.start[i + 1] {
                rows[self.column[k] as usize].push((i as u32, self.factor[k]));
            }
        }
        rows
    }
}

impl FormFactors for FormFactorMatrix {
    fn len(&self) -> usize {
        self.row_scale.len()
    }

    fn gather(&self, x: &[Rgb], out: &mut [Rgb]) {
        let scaled = self.scaled(x);
        out.par_iter_mut().enumerate().with_min_len(64).for_each(|(i, out)| {
            let direct = self.direct_product(i, &scaled);
            let specular: Rgb = self.specular(i).map(|(j, f)| x[j] * f).sum();
            *out = direct + specular;
        });
    }

    fn gather_groups(&self, x: &[Rgb], group: &[u8], out: &mut [Vec<Rgb>]) -> u32 {
        let sums = (0..self.len()).into_par_iter().with_min_len(64).map(|i| {
            let mut sums = vec![Rgb::BLACK; out.len()];
            let mut add = |j: usize, f: Rgb| {
                if let Some(sum) = sums.get_mut(usize::from(group[j])) {
                    *sum += x[j] * f;
                }
            };
            self.direct(i).for_each(|(j, f)| add(j, Rgb::grey(f)));
            self.specular(i).for_each(|(j, f)| add(j, f));
            sums
        });
        let sums: Vec<Vec<Rgb>> = sums.collect();
        for (g, out) in out.iter_mut().enumerate() {
            out.iter_mut().zip(&sums).for_each(|(out, sums)| *out = sums[g]);
        }
        1
    }

    fn row(&self, i: usize, visit: &mut dyn FnMut(usize, Rgb)) {
        self.direct(i).for_each(|(j, f)| visit(j, Rgb::grey(f)));
        self.specular(i).for_each(|(j, f)| visit(j, f));
    }

    fn is_reciprocal(&self) -> bool {
        self.specular_column.is_empty()
    }
}

/// Factors d so that sum_j d_i S_ij d_j = A_i target_i, by a damped fixed point. They stay within [1/2, 2]: an open scene need not
/// have an exact solution, and a row of few hits must not be blown up.
fn sinkhorn(
    rows: &[Vec<(u32, f64)>],
    target: &[f64],
    area: &[f64],
    (sweeps, close_enough): (u32, f64),
    is_idle: impl Fn(usize) -> bool + Sync,
) -> Vec<f64> {
    let mut d = vec![1.0; rows.len()];
    for _ in 0..sweeps {
        let ratio = |(i, row): (usize, &Vec<(u32, f64)>)| {
            let sum: f64 = row.iter().map(|(j, s)| s * d[*j as usize]).sum::<f64>() * d[i];
            if sum > 0.0 { area[i] * target[i] / sum } else { 1.0 }
        };
        let ratios: Vec<f64> = rows.par_iter().enumerate().with_min_len(64).map(ratio).collect();
        d.iter_mut().zip(&ratios).for_each(|(d, ratio)| *d = (*d * ratio.sqrt()).clamp(0.5, 2.0));
        let off = |(i, ratio): (usize, &f64)| if is_idle(i) { 0.0 } else { (ratio - 1.0).abs() };
        let worst = ratios.iter().enumerate().map(off).fold(0.0, f64::max);
        if worst < close_enough {
            break;
        }
    }
    d
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows that cannot count are scaled like the others and have no say in when it is enough: those that count have
    /// the same bits without them.
    #[test]
    fn rows_that_cannot_count_change_no_bit_of_others() {
        let calm = [vec![(1, 0.375), (2, 0.625)], vec![(0, 0.25), (2, 0.75)], vec![(0, 0.125), (1, 0.375), (2, 0.5)]];
        // A room of its own whose estimates disagree so much that it takes more sweeps.
        let noisy = [vec![(4, 0.9), (5, 0.1)], vec![(3, 0.02), (5, 0.98)], vec![(3, 0.7), (4, 0.01), (5, 0.29)]];
        let none: [Vec<(u32, f32)>; 3] = Default::default();
        let symmetric = |others: &[Vec<(u32, f32)>; 3], is_idle: fn(usize) -> bool| {
            let rows = calm.iter().chain(others).map(|direct| Row { direct: direct.clone(), ..Row::default() });
            let mut m = FormFactorMatrix::from_rows(rows.collect());
            m.symmetrise(&[1.0, 2.0, 4.0, 1.0, 1.0, 1.0], &[256.0; 6], is_idle);
            (0..3).flat_map(|i| m.direct(i).map(|(j, f)| (j, f.to_bits())).collect::<Vec<_>>()).collect::<Vec<_>>()
        };
        let idle = |i: usize| i > 2;
        assert_eq!(symmetric(&noisy, idle), symmetric(&none, idle));
        assert_ne!(symmetric(&noisy, |_| false), symmetric(&none, idle), "the others do not disagree enough to be seen");
    }

    #[test]
    fn symmetrising_keeps_row_sums_and_makes_transport_reciprocal() {
        // Three patches of a closed scene with noisy factors.
        let area = [1.0, 2.0, 4.0];
        let rows = [vec![(1, 0.375), (2, 0.625)], vec![(0, 0.25), (2, 0.75)], vec![(0, 0.125), (1, 0.375), (2, 0.5)]];
        let rows = rows.map(|direct| Row { direct, ..Row::default() });
        let mut m = FormFactorMatrix::from_rows(rows.to_vec());
        m.symmetrise(&area, &[256.0; 3], |_| false);
        assert!(m.closure.reciprocity_defect > 0.01, "the noise was not seen: {}", m.closure.reciprocity_defect);
        for i in 0..3 {
            assert!((m.direct_sum(i) - 1.0).abs() < 1e-7, "row {i} sums to {}", m.direct_sum(i));
            for (j, f) in m.direct(i) {
                let back = m.direct(j).find(|e| e.0 == i).map_or(0.0, |e| e.1);
                assert!((area[i] * f - area[j] * back).abs() < 1e-5, "{i} -> {j}: {} and {}", area[i] * f, area[j] * back);
            }
        }
    }
}
