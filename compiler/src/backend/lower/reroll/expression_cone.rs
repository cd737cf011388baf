//! A result with all that it is made of.

use super::{Reroller, Root};
use crate::backend::code::{Memory, Place};
use crate::backend::lower::writer::{At, scratch};
use bond_runtime::ir::{self, Binary, Op, Unary};

/// What a cone is made of at its bottom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Leaf {
    Number(f64),
    Place(Memory, u32),
}

/// A part of a cone; others are named by their number in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Part {
    /// A number.
    Number,
    /// What is loaded from a memory.
    Load(u8),
    Unary(Unary, u32),
    Binary(Binary, u32, u32),
    Select(u32, u32, u32),
}

/// A cone: its shape, which groups share, and what differs between their members.
pub(super) struct Cone {
    /// The parts, in an order in which they can be computed; the last is the result. Then the memory of the result.
    pub(super) shape: (Vec<Part>, u8),
    pub(super) leaves: Vec<Leaf>,
    pub(super) to: Place,
}

impl Cone {
    pub(super) fn new(reroller: &Reroller<'_>, root: &Root) -> Self {
        let mut cone = Self { shape: (Vec::new(), memory(root.to.memory)), leaves: Vec::new(), to: root.to.clone() };
        let own = reroller.kept[root.value.0 as usize].is_some_and(|at| root.to == scratch(at, At::One(0)));
        let mut known: Vec<(ir::Value, u32)> = Vec::new();
        let top = cone.part(reroller, root.value, own, &mut known);
        if root.negative {
            cone.shape.0.push(Part::Unary(Unary::Neg, top));
        }
        cone
    }

    /// The number of a value's part; `own` where it is computed though it is a result.
    fn part(&mut self, reroller: &Reroller<'_>, v: ir::Value, own: bool, known: &mut Vec<(ir::Value, u32)>) -> u32 {
        if let Some(&(_, part)) = known.iter().find(|k| k.0 == v) {
            return part;
        }
        let part = match (reroller.kept[v.0 as usize], reroller.ops[v.0 as usize]) {
            (Some(at), _) if !own => self.leaf(Leaf::Place(Memory::Scratch, at)),
            (_, Op::Const(x)) => self.leaf(Leaf::Number(x)),
            (_, Op::Load(slot)) => {
                let (memory, base) = reroller.places[slot.array as usize];
                self.leaf(Leaf::Place(memory, base + slot.index))
            }
            (_, Op::Unary(f, a)) => Part::Unary(f, self.part(reroller, a, false, known)),
            (_, Op::Binary(f, a, b)) => {
                let a = self.part(reroller, a, false, known);
                Part::Binary(f, a, self.part(reroller, b, false, known))
            }
            (_, Op::Select(c, a, b)) => {
                let c = self.part(reroller, c, false, known);
                let a = self.part(reroller, a, false, known);
                Part::Select(c, a, self.part(reroller, b, false, known))
            }
        };
        self.shape.0.push(part);
        let number = self.shape.0.len() as u32 - 1;
        known.push((v, number));
        number
    }

    fn leaf(&mut self, leaf: Leaf) -> Part {
        self.leaves.push(leaf);
        match leaf {
            Leaf::Number(_) => Part::Number,
            Leaf::Place(m, _) => Part::Load(memory(m)),
        }
    }
}

/// The number of a memory.
fn memory(m: Memory) -> u8 {
    Memory::ALL.iter().position(|x| *x == m).unwrap_or(0) as u8
}
