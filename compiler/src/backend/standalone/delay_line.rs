//! What is on its way in the delays of sampled clusters.
//!
//! Places are known before the run, so that nothing turns in a ring. A short delay is a row of numbers that move on by
//! one. A long one, of n periods, is a table of about √n columns: at each sample one of them moves on by one, the next
//! one at the next sample. So some 2 √n numbers are looked at.

use crate::backend::code::{Index, Memory, Op, Place, Stmt};
use crate::backend::lower::writer::Writer;
use crate::backend::standalone::block::Block;
use bond_runtime::scene::{self, Carried};

/// Delays of more periods than this are tables.
const ROW: usize = 64;

/// Places of a delay.
#[derive(Clone, Debug)]
pub(super) struct DelayLine {
    /// Whether what a step reports is delayed, or else a state; which one, and which input gets what it was.
    is_wave: bool,
    from: usize,
    input: usize,
    /// A row of numbers, to begin with.
    row: usize,
    length: usize,
    /// A table, after it: which column is the next one to move on, where the table is, its columns, and its rows.
    column: usize,
    table: usize,
    columns: usize,
    rows: usize,
}

impl DelayLine {
    /// Gives all delays of a cluster their places.
    pub(super) fn all(block: &mut Block, c: &scene::Cluster) -> Vec<Self> {
        let mut input = c.lines_at();
        let mut list = Vec::new();
        for line in &c.lines {
            let of = match line.carried {
                Carried::State { state, periods } => Some((false, state, periods)),
                Carried::Wave { output, periods } => Some((true, output, periods)),
                Carried::Leaving { .. } | Carried::Signal { .. } => None,
            };
            if let Some((is_wave, from, periods)) = of {
                let n = periods as usize;
                let columns = if n > ROW { n.isqrt() } else { 0 };
                let rows = n.checked_div(columns).unwrap_or(0);
                let length = n - columns * rows;
                list.push(Self {
                    is_wave,
                    from,
                    input,
                    row: block.put(&vec![line.start; length]),
                    length,
                    column: block.put(&[0.0]),
                    table: block.put(&vec![line.start; columns * rows]),
                    columns,
                    rows,
                });
            }
            input += line.carried.slots();
        }
        list
    }

    /// Moves on by a period; the places are those of the cluster's state, outputs and inputs. What leaves into a line
    /// is shortened to a part of it.
    pub(super) fn turn(
        &self,
        w: &mut Writer,
        (state, output, input): (usize, usize, usize),
        part: Option<crate::backend::code::Value>,
    ) {
        let mut x = w.kept(self.from + if self.is_wave { output } else { state });
        if let Some(part) = part.filter(|_| self.is_wave) {
            x = w.mul(part, x);
        }
        if self.length > 0 {
            let last = x;
            x = w.kept(self.row);
            if self.length > 1 {
                let i = w.index();
                let body = w.block(|w| {
                    let next = w.load(numbers(self.row + 1, [(i, 1)]));
                    w.push(Stmt::Store(numbers(self.row, [(i, 1)]), next));
                });
                w.push(Stmt::For(i, 0, self.length as u32 - 1, body));
            }
            w.keep(self.row + self.length - 1, last);
        }
        if self.columns > 0 {
            x = self.turn_table(w, x);
        }
        w.keep(input + self.input, x);
    }

    fn turn_table(&self, w: &mut Writer, x: crate::backend::code::Value) -> crate::backend::code::Value {
        let (found, one, zero) = (w.holding(x), w.number(1.0), w.number(0.0));
        let (now, columns) = (w.kept(self.column), w.number(self.columns as f64));
        let (i, j) = (w.index(), w.index());
        let stride = self.columns as u32;
        let body = w.block(|w| {
            let at = w.define(Op::Counter(i));
            let is_it = w.eq(at, now);
            w.when(is_it, |w| {
                let first = w.load(numbers(self.table, [(i, 1)]));
                w.set(found, first);
                let moves = w.block(|w| {
                    let next = w.load(numbers(self.table + self.columns, [(i, 1), (j, stride)]));
                    w.push(Stmt::Store(numbers(self.table, [(i, 1), (j, stride)]), next));
                });
                w.push(Stmt::For(j, 0, self.rows as u32 - 1, moves));
                let last = self.table + self.columns * (self.rows - 1);
                w.push(Stmt::Store(numbers(last, [(i, 1)]), x));
            });
        });
        w.push(Stmt::For(i, 0, stride, body));
        let next = w.add(now, one);
        let over = w.lt(next, columns);
        let next = w.select(over, next, zero);
        w.keep(self.column, next);
        w.get(found)
    }
}

/// Numbers of the block, by counters with their strides.
fn numbers<const N: usize>(base: usize, along: [(Index, u32); N]) -> Place {
    Place { along: along.to_vec(), ..Place::new(Memory::State, base as u32) }
}
