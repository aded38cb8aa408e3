//! Rooms: parts of a set of patches that exchange much light within and little between them, found from the form factors alone.
//!
//! What makes iterations slow in bright scenes is few shapes of light: one constant for each room, which loses little in a bounce. All else
//! halves with every bounce, as the spectrum of a cube's form factors shows. So it matters to know the rooms, and not to know them
//! exactly: a patch in the wrong one costs a step or two.
//!
//! Some patches are taken as landmarks, evenly by area. Where the light of a landmark is after eight bounces says in which room it is: in
//! one room the light of all landmarks is then spread alike. Every patch belongs to the room whose landmarks it sees most of.

use super::system::RadiositySystem;

/// A set of fewer patches is one room: its iterations cost nothing.
const FEWEST_PATCHES: usize = 48;
/// Landmarks of a set.
const LANDMARKS: usize = 96;
/// Neighbouring patches, by their numbers, are put together into so many bins, over which the light of landmarks is compared.
const BINS: usize = 768;
/// Most rooms of a set: each costs a product with the form factors and a vector.
pub(super) const MOST_ROOMS: usize = 8;
/// Two landmarks are in one room if less than this share of their light is in different places after the bounces.
const SAME_ROOM: f64 = 0.35;
/// The transport over two bounces is squared so often.
const SQUARINGS: u32 = 2;

/// Place of what is not in a set.
const NOWHERE: u32 = u32::MAX;

/// The room of each patch of `set`, from 0 without gaps, and the number of rooms. They are kept with form factors that can do so.
pub(super) fn find(system: &RadiositySystem<'_>, set: &[usize]) -> (Vec<u8>, usize) {
    let known = system.form_factors.known_rooms().filter(|_| set.len() >= FEWEST_PATCHES);
    if let Some(rooms) = known.and_then(|known| known.get(set, MOST_ROOMS)) {
        return rooms;
    }
    let (room_of, count) = find_anew(system, set);
    if let Some(known) = known {
        known.keep(set, (&room_of, count));
    }
    (room_of, count)
}

fn find_anew(system: &RadiositySystem<'_>, set: &[usize]) -> (Vec<u8>, usize) {
    let mut room_of = vec![0; set.len()];
    if set.len() < FEWEST_PATCHES {
        return (room_of, 1);
    }
    let landmarks = Landmarks::choose(system, set);
    let (room_of_landmark, rooms) = landmarks.group();
    if rooms == 1 {
        return (room_of, 1);
    }
    let mut place = vec![NOWHERE; system.len()];
    set.iter().enumerate().for_each(|(at, &i)| place[i] = at as u32);
    // What landmark a sends to patch i, as a share of all it sends, is to what i would see of it as the area of i is to that of a; landmarks
    // stand for equal areas, so that shares may be compared as they are.
    let mut seen = vec![[0.0_f32; MOST_ROOMS]; set.len()];
    system.form_factors.some_rows(&landmarks.patches(set), &mut |k, factor, entries| {
        let (factor, room) = (factor * system.area[set[landmarks.patch[k]]], room_of_landmark[k]);
        for (j, weight) in entries.iter().filter(|(j, _)| place[*j as usize] != NOWHERE) {
            seen[place[*j as usize] as usize][room] += (factor * weight) as f32;
        }
    });
    let mut used = [0_usize; MOST_ROOMS];
    for (room, seen) in room_of.iter_mut().zip(&seen) {
        *room = (0..rooms).fold(0, |best, r| if seen[r] > seen[best] { r } else { best }) as u8;
        used[usize::from(*room)] += 1;
    }
    // A room that no patch sees most of is none.
    let mut number = [0_u8; MOST_ROOMS];
    let mut count = 0;
    for room in 0..rooms {
        number[room] = count;
        count += u8::from(used[room] > 0);
    }
    room_of.iter_mut().for_each(|room| *room = number[usize::from(*room)]);
    (room_of, usize::from(count))
}

struct Landmarks {
    /// Place in the set.
    patch: Vec<usize>,
    /// Where the light of each is after some bounces: shares by landmark.
    spread: Vec<Vec<f64>>,
}

impl Landmarks {
    fn choose(system: &RadiositySystem<'_>, set: &[usize]) -> Self {
        let total: f64 = set.iter().map(|&i| system.area[i]).sum();
        let (mut patch, mut bin_of, mut bin_area) = (Vec::with_capacity(LANDMARKS), vec![BINS; system.len()], vec![0.0; BINS]);
        let mut before = 0.0;
        for (at, &i) in set.iter().enumerate() {
            let middle = (before + 0.5 * system.area[i]) / total;
            before += system.area[i];
            let bin = ((middle * BINS as f64) as usize).min(BINS - 1);
            bin_of[i] = bin;
            bin_area[bin] += system.area[i];
            if middle * LANDMARKS as f64 >= patch.len() as f64 + 0.5 {
                patch.push(at);
            }
        }
        let mut landmarks = Self { patch, spread: Vec::new() };
        // The last one is for what is not in the set.
        let mut light = vec![vec![0.0; BINS + 1]; landmarks.patch.len()];
        system.form_factors.some_rows(&landmarks.patches(set), &mut |k, factor, entries| {
            entries.iter().for_each(|(j, weight)| light[k][bin_of[*j as usize]] += factor * weight);
        });
        // Two bounces: from one landmark to a bin and on to the other, by reciprocity.
        let meet = |a: &[f64], b: &[f64]| -> f64 {
            a.iter().zip(b).zip(&bin_area).map(|((a, b), area)| if *area > 0.0 { a * b / area } else { 0.0 }).sum()
        };
        let mut spread: Vec<Vec<f64>> = light.iter().map(|a| light.iter().map(|b| meet(a, b)).collect()).collect();
        normalise(&mut spread);
        for _ in 0..SQUARINGS {
            spread = squared(&spread);
        }
        landmarks.spread = spread;
        landmarks
    }

    /// As patches.
    fn patches(&self, set: &[usize]) -> Vec<usize> {
        self.patch.iter().map(|&at| set[at]).collect()
    }

    /// Room of each landmark and the number of rooms.
    fn group(&self) -> (Vec<usize>, usize) {
        let apart = |a: &[f64], b: &[f64]| 0.5 * a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>();
        let mut leaders: Vec<Vec<f64>> = Vec::new();
        for spread in &self.spread {
            if leaders.len() < MOST_ROOMS && leaders.iter().all(|leader| apart(leader, spread) > SAME_ROOM) {
                leaders.push(spread.clone());
            }
        }
        let nearest = |leaders: &[Vec<f64>], spread: &[f64]| {
            let distances = leaders.iter().map(|leader| apart(leader, spread));
            distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(room, _)| room)
        };
        // A leader was the first of its room, by chance beside a door, perhaps: the mean of the room is a better one.
        let of_leaders: Vec<usize> = self.spread.iter().map(|s| nearest(&leaders, s)).collect();
        for (room, leader) in leaders.iter_mut().enumerate() {
            let mine: Vec<&Vec<f64>> = self.spread.iter().zip(&of_leaders).filter(|(_, r)| **r == room).map(|(s, _)| s).collect();
            for (k, mean) in leader.iter_mut().enumerate() {
                *mean = mine.iter().map(|s| s[k]).sum::<f64>() / mine.len().max(1) as f64;
            }
        }
        (self.spread.iter().map(|s| nearest(&leaders, s)).collect(), leaders.len().max(1))
    }
}

/// Scales every row to the sum 1; one without light keeps what it has to itself.
fn normalise(rows: &mut [Vec<f64>]) {
    for (at, row) in rows.iter_mut().enumerate() {
        let sum: f64 = row.iter().sum();
        if sum > 0.0 {
            row.iter_mut().for_each(|v| *v /= sum);
        } else {
            row[at] = 1.0;
        }
    }
}

fn squared(rows: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let times = |row: &Vec<f64>| {
        let mut out = vec![0.0; row.len()];
        for (share, next) in row.iter().zip(rows) {
            out.iter_mut().zip(next).for_each(|(o, n)| *o += share * n);
        }
        out
    };
    rows.iter().map(times).collect()
}
