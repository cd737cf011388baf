//! The intern table: finds the expression that a node already is.

use super::{Expr, Node, Number};
use hashbrown::HashTable;
use rustc_hash::FxHasher;
use std::hash::{Hash, Hasher};

/// The expressions of a pool by the hashes of their nodes, which stay in the pool.
#[derive(Clone, Debug, Default)]
pub(super) struct InternTable(HashTable<(u32, Expr)>);

/// A hash in both halves, for the table looks at its first and its last bits.
fn widened(hash: u32) -> u64 {
    u64::from(hash) << 32 | u64::from(hash)
}

impl InternTable {
    /// The expression of this hash that `is` the one.
    pub(super) fn find(&self, hash: u32, is: impl Fn(Expr) -> bool) -> Option<Expr> {
        self.0.find(widened(hash), |entry| entry.0 == hash && is(entry.1)).map(|entry| entry.1)
    }

    /// Adds an expression that is not there yet.
    pub(super) fn add(&mut self, hash: u32, e: Expr) {
        self.0.insert_unique(widened(hash), (hash, e), |entry| widened(entry.0));
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
