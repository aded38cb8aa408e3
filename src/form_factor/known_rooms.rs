//! Rooms that a solver has found in form factors: they depend on nothing else, so that who keeps form factors can keep them as well.

use serde::{Deserialize, Serialize};
use std::sync::Mutex;

/// Sets of patches whose rooms are kept; there are few, unless many closed bodies are lit from within.
const MOST_SETS: usize = 64;

/// Rooms by set of patches.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct KnownRooms(Mutex<Vec<Rooms>>);

#[derive(Debug, Clone, Serialize, Deserialize)]
struct Rooms {
    patches: Vec<u32>,
    /// Of each of these.
    room_of: Vec<u8>,
    count: u8,
}

impl KnownRooms {
    /// The room of each patch of a set and the number of rooms, if they are known; `most`: there are no more rooms than that in a set.
    pub fn get(&self, patches: &[usize], most: usize) -> Option<(Vec<u8>, usize)> {
        let known = self.0.lock().ok()?;
        let is_it = |rooms: &&Rooms| {
            rooms.patches.len() == patches.len() && rooms.patches.iter().zip(patches).all(|(a, b)| *a as usize == *b)
        };
        let rooms = known.iter().find(is_it)?;
        // A file may say anything.
        let makes_sense = rooms.room_of.len() == patches.len()
            && (1..=most).contains(&usize::from(rooms.count))
            && rooms.room_of.iter().all(|room| *room < rooms.count);
        makes_sense.then(|| (rooms.room_of.clone(), usize::from(rooms.count)))
    }

    /// Keeps the rooms of a set.
    pub fn keep(&self, patches: &[usize], (room_of, count): (&[u8], usize)) {
        if let Ok(mut known) = self.0.lock()
            && known.len() < MOST_SETS
        {
            let patches = patches.iter().map(|&i| i as u32).collect();
            known.push(Rooms { patches, room_of: room_of.to_vec(), count: count as u8 });
        }
    }
}

impl Clone for KnownRooms {
    fn clone(&self) -> Self {
        Self(Mutex::new(self.0.lock().map(|known| known.clone()).unwrap_or_default()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rooms_are_known_of_the_same_patches_only_and_if_they_make_sense() {
        let known = KnownRooms::default();
        known.keep(&[3, 4, 7], (&[0, 1, 0], 2));
        let back: KnownRooms = postcard::from_bytes(&postcard::to_stdvec(&known).expect("plain numbers")).expect("as written");
        assert_eq!(back.get(&[3, 4, 7], 8), Some((vec![0, 1, 0], 2)));
        assert_eq!([back.get(&[3, 4, 8], 8), back.get(&[3, 4], 8), back.get(&[3, 4, 7], 1)], [None, None, None]);
        // A room that is not there; fewer rooms than patches.
        known.keep(&[1, 2], (&[0, 2], 2));
        known.keep(&[5, 6], (&[0], 1));
        assert_eq!([known.get(&[1, 2], 8), known.get(&[5, 6], 8)], [None, None]);
    }
}
