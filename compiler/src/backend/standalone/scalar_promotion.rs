//! Takes numbers of the block into variables: an interval reads the block at its start and writes it at its end, where
//! it did not fail. What fails has written nothing.

use crate::backend::code::{Memory, Op, Place, Stmt, Var, visit_mut};
use crate::backend::lower::writer::Writer;
use rustc_hash::FxHashSet;
use std::collections::{BTreeMap, BTreeSet};

/// What a routine does with the block.
#[derive(Default)]
pub(super) struct Uses {
    /// Places that are read before they are written.
    pub(super) read: BTreeSet<u32>,
    /// Places that are written.
    pub(super) written: BTreeSet<u32>,
    /// Whether places are found by counters or values, which variables are not.
    counted: bool,
}

impl Uses {
    /// Those of some statements.
    pub(super) fn of(body: &[Stmt]) -> Self {
        let mut uses = Self::default();
        uses.block(body, &mut FxHashSet::default());
        uses
    }

    fn place(&mut self, p: &Place) -> Option<u32> {
        if p.memory != Memory::State {
            return None;
        }
        self.counted |= !p.is_fixed();
        Some(p.base)
    }

    /// Goes through a block, at whose start some places are known to be written; whether its end is not reached.
    fn block(&mut self, body: &[Stmt], known: &mut FxHashSet<u32>) -> bool {
        for s in body {
            match s {
                Stmt::Let(_, Op::Load(p)) => {
                    if let Some(at) = self.place(p).filter(|at| !known.contains(at)) {
                        self.read.insert(at);
                    }
                }
                Stmt::Store(p, _) => {
                    if let Some(at) = self.place(p) {
                        self.written.insert(at);
                        known.insert(at);
                    }
                }
                Stmt::If(_, yes, no) => {
                    let (mut a, mut b) = (known.clone(), known.clone());
                    match (self.block(yes, &mut a), self.block(no, &mut b)) {
                        (true, true) => return true,
                        (true, false) => *known = b,
                        (false, true) => *known = a,
                        (false, false) => *known = a.intersection(&b).copied().collect(),
                    }
                }
                // Where a loop is left, nothing of it need have been written.
                Stmt::Loop(body) | Stmt::For(_, _, _, body) | Stmt::Span(_, body) => {
                    self.block(body, &mut known.clone());
                }
                s if s.is_exit() => return true,
                _ => {}
            }
        }
        false
    }
}

/// Statements whose numbers of the block are variables.
pub(super) struct Promoted {
    /// Reads the block.
    pub(super) before: Vec<Stmt>,
    pub(super) body: Vec<Stmt>,
    /// Writes what is kept of it.
    pub(super) after: Vec<Stmt>,
}

/// Promotes the places that statements use to variables; `kept` are those that are read later. None where places are
/// found by counters or values.
pub(super) fn promote(w: &mut Writer, body: &[Stmt], kept: &BTreeSet<u32>) -> Option<Promoted> {
    let uses = Uses::of(body);
    if uses.counted {
        return None;
    }
    let vars: BTreeMap<u32, Var> = uses.read.union(&uses.written).map(|at| (*at, w.var())).collect();
    // What is written in one interval and read in the next, or only in some branch, must be known to the first.
    let before = w.block(|w| {
        for (at, var) in &vars {
            if uses.read.contains(at) || kept.contains(at) {
                let x = w.load(Place::new(Memory::State, *at));
                w.set(*var, x);
            }
        }
    });
    let body = swapped(body, &vars);
    let after = w.block(|w| {
        for (at, var) in vars.iter().filter(|(at, _)| uses.written.contains(at) && kept.contains(at)) {
            let x = w.get(*var);
            w.push(Stmt::Store(Place::new(Memory::State, *at), x));
        }
    });
    Some(Promoted { before, body, after })
}

/// The statements with variables in the place of the block.
fn swapped(body: &[Stmt], vars: &BTreeMap<u32, Var>) -> Vec<Stmt> {
    let mut body = body.to_vec();
    visit_mut(&mut body, &mut |s| {
        let Some(var) = s.place().filter(|p| p.memory == Memory::State).and_then(|p| vars.get(&p.base)) else { return };
        match s {
            Stmt::Let(_, op) => *op = Op::Get(*var),
            Stmt::Store(_, x) => *s = Stmt::Set(*var, *x),
            _ => {}
        }
    });
    body
}
