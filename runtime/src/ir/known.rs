//! The values that a block has already.

use super::{Binary, Unary, Value};
use rustc_hash::FxHasher;
use std::hash::{Hash, Hasher};

/// An op by its bits, so that it can be looked up.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Key {
    Const(u64),
    Unary(Unary, Value),
    Binary(Binary, Value, Value),
    Select(Value, Value, Value),
}

fn hash_of(key: Key) -> u32 {
    let mut hasher = FxHasher::default();
    key.hash(&mut hasher);
    let hash = hasher.finish();
    (hash ^ (hash >> 32)) as u32
}

/// Values by their ops. Open addressing: a place holds a hash and an index of the entries from 1; 0 is free.
#[derive(Default)]
pub(super) struct Known {
    places: Vec<u64>,
    entries: Vec<(Key, Value)>,
}

impl Known {
    /// The value of an op.
    pub(super) fn get(&self, key: Key) -> Option<Value> {
        if self.entries.is_empty() {
            return None;
        }
        let (hash, mask) = (hash_of(key), self.places.len() - 1);
        let mut at = hash as usize & mask;
        loop {
            let place = self.places[at];
            if place == 0 {
                return None;
            }
            let (other, value) = self.entries[place as u32 as usize - 1];
            if (place >> 32) as u32 == hash && other == key {
                return Some(value);
            }
            at = (at + 1) & mask;
        }
    }

    /// Adds an op that is not there yet.
    pub(super) fn insert(&mut self, key: Key, value: Value) {
        if self.entries.len() * 8 >= self.places.len() * 5 {
            let larger = vec![0; (self.places.len() * 2).max(64)];
            for place in std::mem::replace(&mut self.places, larger) {
                if place != 0 {
                    self.put(place);
                }
            }
        }
        self.entries.push((key, value));
        self.put(u64::from(hash_of(key)) << 32 | self.entries.len() as u64);
    }

    fn put(&mut self, place: u64) {
        let mask = self.places.len() - 1;
        let mut at = (place >> 32) as usize & mask;
        while self.places[at] != 0 {
            at = (at + 1) & mask;
        }
        self.places[at] = place;
    }
}
