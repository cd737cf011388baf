//! Which expression a node is: a table of all nodes by what they are.

use super::{Expr, Node, Number};
use rustc_hash::FxHasher;
use std::hash::{Hash, Hasher};

/// Open addressing over the pool's list of nodes: a place holds 32 bits of a node's hash and its index from 1; 0 is
/// free. It grows without another look at the nodes.
#[derive(Clone, Debug, Default)]
pub(super) struct Known {
    places: Vec<u64>,
    count: usize,
}

impl Known {
    /// The first expression of this hash that `is` the one.
    pub(super) fn find(&self, hash: u32, is: impl Fn(Expr) -> bool) -> Option<Expr> {
        if self.places.is_empty() {
            return None;
        }
        let mask = self.places.len() - 1;
        let mut at = hash as usize & mask;
        loop {
            let place = self.places[at];
            if place == 0 {
                return None;
            }
            let e = Expr(place as u32 - 1);
            if (place >> 32) as u32 == hash && is(e) {
                return Some(e);
            }
            at = (at + 1) & mask;
        }
    }

    /// Adds an expression that is not there yet.
    pub(super) fn add(&mut self, hash: u32, e: Expr) {
        if self.count * 8 >= self.places.len() * 5 {
            let larger = vec![0; (self.places.len() * 2).max(64)];
            for place in std::mem::replace(&mut self.places, larger) {
                if place != 0 {
                    self.put(place);
                }
            }
        }
        self.count += 1;
        self.put(u64::from(hash) << 32 | u64::from(e.0 + 1));
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

fn folded(hasher: &FxHasher) -> u32 {
    let hash = hasher.finish();
    (hash ^ (hash >> 32)) as u32
}

/// The hash of a sum or a product.
pub(super) fn hash_of_pairs(is_sum: bool, c: Number, pairs: &[(Expr, Number)]) -> u32 {
    let mut hasher = FxHasher::default();
    u64::from(is_sum).hash(&mut hasher);
    c.hash(&mut hasher);
    for &(e, n) in pairs {
        e.hash(&mut hasher);
        if !n.is_one() {
            n.hash(&mut hasher);
        }
    }
    folded(&hasher)
}

/// The hash of a node.
pub(super) fn hash_of(node: &Node) -> u32 {
    match node {
        Node::Sum(c, pairs) => hash_of_pairs(true, *c, pairs),
        Node::Product(c, pairs) => hash_of_pairs(false, *c, pairs),
        Node::Number(_) | Node::Symbol(_) | Node::Power(..) | Node::Unary(..) | Node::Binary(..) | Node::Select(..) => {
            let mut hasher = FxHasher::default();
            node.hash(&mut hasher);
            folded(&hasher)
        }
    }
}
