//! The system over rooms: one unknown for each room and channel, the level of its light [Nicolaides87].

use super::rooms::{self, MOST_ROOMS};
use super::sets::{Sets, divided};
use super::system::RadiositySystem;
use crate::math::Rgb;

/// Bytes that the images of rooms may take: where there are very many patches there are fewer rooms.
const MOST_BYTES: usize = 1 << 29;

/// W, its image F rho W, and the inverse of Wᵀ D (I - F rho) W, where the columns of W are 1 in one room of one set and 0 elsewhere, and D
/// are the weights of the inner product. A vector over rooms has `MOST_ROOMS` places for each set.
pub(super) struct Coarse {
    /// Rooms in all sets together.
    pub rooms: u32,
    /// Products with the form factors that this took.
    pub gathers: u32,
    room_of: Vec<u8>,
    /// F rho w for the k-th rooms of all sets at once: between sets no light passes.
    images: Vec<Vec<Rgb>>,
    /// By set: the inverse, by rows, by channel.
    inverses: Vec<Vec<Rgb>>,
    /// Sum of the weights of each room.
    mass: Vec<Rgb>,
    weight: Vec<Rgb>,
}

impl Coarse {
    /// Finds the rooms and sets up their system; `weight`: of each patch in the inner product.
    pub fn new(system: &RadiositySystem<'_>, sets: &Sets, weight: Vec<Rgb>) -> Self {
        let mut room_of = vec![0; system.len()];
        let (mut count, mut most) = (0, 1);
        let affordable = (MOST_BYTES / (size_of::<Rgb>() * system.len().max(1))).clamp(1, MOST_ROOMS);
        for set in &sets.members {
            let (rooms, n) = rooms::find(system, set);
            set.iter().zip(rooms).for_each(|(&i, room)| room_of[i] = room.min(affordable as u8 - 1));
            (count, most) = (count + n.min(affordable), most.max(n.min(affordable)));
        }
        let mut coarse =
            Self { rooms: count as u32, gathers: 0, room_of, images: Vec::new(), inverses: Vec::new(), mass: Vec::new(), weight };
        coarse.mass = coarse.project(sets, &vec![Rgb::WHITE; system.len()]);
        // The images of all rooms of a set add up to its row sums, which are known.
        let mut last = sets.row_reflectance.clone();
        coarse.images = vec![vec![Rgb::BLACK; system.len()]; most - 1];
        if most > 1 {
            let mut lit = vec![Rgb::BLACK; system.len()];
            sets.members.iter().flatten().for_each(|&i| lit[i] = system.rho[i]);
            coarse.gathers = system.form_factors.gather_groups(&lit, &coarse.room_of, &mut coarse.images);
        }
        for image in &coarse.images {
            last.iter_mut().zip(image).for_each(|(last, image)| *last = *last - *image);
        }
        coarse.images.push(last);
        coarse.inverses = sets.members.iter().map(|set| inverse(&coarse.matrix(set))).collect();
        coarse
    }

    /// Wᵀ D r.
    pub fn project(&self, sets: &Sets, r: &[Rgb]) -> Vec<Rgb> {
        let mut sums = vec![Rgb::BLACK; sets.members.len() * MOST_ROOMS];
        for (s, set) in sets.members.iter().enumerate() {
            set.iter().for_each(|&i| sums[s * MOST_ROOMS + usize::from(self.room_of[i])] += self.weight[i] * r[i]);
        }
        sums
    }

    /// (A W)ᵀ D r with A = I - F rho: by the symmetry of A in the inner product this is Wᵀ D A r, without a product.
    pub fn project_image(&self, sets: &Sets, r: &[Rgb]) -> Vec<Rgb> {
        let mut sums = self.project(sets, r);
        for (s, set) in sets.members.iter().enumerate() {
            for (k, image) in self.images.iter().enumerate() {
                let sum: Rgb = set.iter().map(|&i| self.weight[i] * image[i] * r[i]).sum();
                sums[s * MOST_ROOMS + k] = sums[s * MOST_ROOMS + k] - sum;
            }
        }
        sums
    }

    /// The solution over rooms.
    pub fn solve(&self, right: &[Rgb]) -> Vec<Rgb> {
        let n = self.images.len();
        let mut out = vec![Rgb::BLACK; right.len()];
        for (s, inverse) in self.inverses.iter().enumerate() {
            let at = s * MOST_ROOMS;
            for k in 0..n {
                out[at + k] = (0..n).map(|l| inverse[k * n + l] * right[at + l]).sum();
            }
        }
        out
    }

    /// x += W y.
    pub fn add(&self, sets: &Sets, x: &mut [Rgb], y: &[Rgb]) {
        for (s, set) in sets.members.iter().enumerate() {
            set.iter().for_each(|&i| x[i] += y[s * MOST_ROOMS + usize::from(self.room_of[i])]);
        }
    }

    /// x += F rho W y.
    pub fn add_image(&self, sets: &Sets, x: &mut [Rgb], y: &[Rgb]) {
        for (s, set) in sets.members.iter().enumerate() {
            for (k, image) in self.images.iter().enumerate() {
                let y = y[s * MOST_ROOMS + k];
                if !y.is_black() {
                    set.iter().for_each(|&i| x[i] += y * image[i]);
                }
            }
        }
    }

    /// Takes from the residual `r` of `x` what lies in the span of W: x += W y, r -= A W y, with y the solution over rooms.
    pub fn correct(&self, sets: &Sets, x: &mut [Rgb], r: &mut [Rgb]) {
        let y = self.solve(&self.project(sets, r));
        let minus: Vec<Rgb> = y.iter().map(|y| Rgb::BLACK - *y).collect();
        self.add(sets, x, &y);
        self.add_image(sets, r, &y);
        self.add(sets, r, &minus);
    }

    /// The solution over rooms for what one more bounce of light leaves: if x has the residual `r`, that of x + r is r - A r, and what of it lies in
    /// the span of W is known without a product by symmetry ([`Self::project_image`]).
    pub fn level_after_bounce(&self, sets: &Sets, r: &[Rgb]) -> Vec<Rgb> {
        let (own, image) = (self.project(sets, r), self.project_image(sets, r));
        self.solve(&own.into_iter().zip(image).map(|(own, image)| own - image).collect::<Vec<Rgb>>())
    }

    /// z = r + W (solution over rooms of r) - W (mean of r in each room): the preconditioner of the methods without symmetry. What is
    /// constant in a room is solved for, the rest left as it is.
    pub fn precondition(&self, sets: &Sets, r: &[Rgb]) -> Vec<Rgb> {
        let sums = self.project(sets, r);
        let mut y = self.solve(&sums);
        y.iter_mut().zip(sums.iter().zip(&self.mass)).for_each(|(y, (sum, mass))| *y = *y - divided(*sum, *mass));
        let mut z = r.to_vec();
        self.add(sets, &mut z, &y);
        z
    }

    /// Wᵀ D A W of one set, by rows.
    fn matrix(&self, set: &[usize]) -> Vec<Rgb> {
        let n = self.images.len();
        let mut matrix = vec![Rgb::BLACK; n * n];
        for &i in set {
            let row = usize::from(self.room_of[i]);
            for (k, image) in self.images.iter().enumerate() {
                let own = if k == row { Rgb::WHITE } else { Rgb::BLACK };
                matrix[row * n + k] += self.weight[i] * (own - image[i]);
            }
        }
        matrix
    }
}

/// Inverse of a small matrix, by channel. Rooms that do not exist, or reflect nothing, have rows of zeros: so has the result.
fn inverse(matrix: &[Rgb]) -> Vec<Rgb> {
    let n = matrix.len().isqrt();
    let mut out = vec![[0.0; 3]; n * n];
    for channel in 0..3 {
        let mut left: Vec<f64> = matrix.iter().map(|v| v[channel]).collect();
        let mut right: Vec<f64> = (0..n * n).map(|k| if k / n == k % n { 1.0 } else { 0.0 }).collect();
        let largest = (0..n).map(|k| left[k * n + k].abs()).fold(0.0, f64::max);
        // Gauss-Jordan without exchanges: the matrix is that of an M-matrix over groups, so diagonals dominate.
        let is_there: Vec<bool> = (0..n).map(|k| left[k * n + k] > 1e-14 * largest).collect();
        for k in (0..n).filter(|&k| is_there[k]) {
            let pivot = left[k * n + k];
            for c in 0..n {
                left[k * n + c] /= pivot;
                right[k * n + c] /= pivot;
            }
            for r in (0..n).filter(|&r| r != k && is_there[r]) {
                let factor = left[r * n + k];
                for c in 0..n {
                    left[r * n + c] -= factor * left[k * n + c];
                    right[r * n + c] -= factor * right[k * n + c];
                }
            }
        }
        for (k, out) in out.iter_mut().enumerate() {
            let there = is_there[k / n] && is_there[k % n] && right[k].is_finite();
            out[channel] = if there { right[k] } else { 0.0 };
        }
    }
    out.into_iter().map(Rgb::from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_undoes_and_leaves_out_rooms_that_are_none() {
        // [[4, -1, 0], [-2, 5, 0], [0, 0, 0]]: by hand the inverse of the upper left part is [[5, 1], [2, 4]]/18.
        let matrix = [4.0, -1.0, 0.0, -2.0, 5.0, 0.0, 0.0, 0.0, 0.0].map(Rgb::grey);
        let want = [5.0, 1.0, 0.0, 2.0, 4.0, 0.0, 0.0, 0.0, 0.0].map(|v| v / 18.0);
        for (got, want) in inverse(&matrix).iter().zip(want) {
            assert!((got.g - want).abs() < 1e-15, "{got:?}, expected {want}");
        }
    }
}
