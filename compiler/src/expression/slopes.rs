//! Derivatives that were taken before.

use super::pages::Pages;
use super::{Expr, Symbol};
use rustc_hash::FxHashMap;

const END: u32 = u32::MAX;

/// Of each expression the derivatives that are known: a short chain where it has few variables, so that what belongs to
/// neighbours lies close together.
#[derive(Clone, Default)]
pub(super) struct Slopes {
    first: Pages,
    /// Variable, derivative, and where the chain goes on.
    chains: Vec<(Symbol, Expr, u32)>,
    many: FxHashMap<(Expr, Symbol), Expr>,
}

impl std::fmt::Debug for Slopes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} derivatives", self.chains.len() + self.many.len())
    }
}

impl Slopes {
    /// The derivative of `e`, which has few variables or not.
    pub(super) fn get(&self, e: Expr, s: Symbol, is_few: bool) -> Option<Expr> {
        if !is_few {
            return self.many.get(&(e, s)).copied();
        }
        let mut at = self.first.get(e.0)?;
        while at != END {
            let (symbol, slope, next) = self.chains[at as usize];
            if symbol == s {
                return Some(slope);
            }
            at = next;
        }
        None
    }

    /// Remembers one that is not there yet.
    pub(super) fn insert(&mut self, e: Expr, s: Symbol, is_few: bool, slope: Expr) {
        if !is_few {
            self.many.insert((e, s), slope);
            return;
        }
        let next = self.first.get(e.0).unwrap_or(END);
        self.first.insert(e.0, self.chains.len() as u32);
        self.chains.push((s, slope, next));
    }
}
