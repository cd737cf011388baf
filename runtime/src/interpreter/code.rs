//! The instructions of the interpreter's machine.

use crate::ir::{Array, Binary, Slot, Unary};

/// One instruction; `to`, `a`, `b`, `c`, `from` are registers.
#[derive(Clone, Debug)]
pub(super) enum Code {
    State {
        to: u32,
        slot: u32,
    },
    Input {
        to: u32,
        slot: u32,
    },
    Table {
        to: u32,
        slot: u32,
    },
    Local {
        to: u32,
        slot: u32,
    },
    StoreNext {
        slot: u32,
        from: u32,
    },
    StoreLocal {
        slot: u32,
        from: u32,
    },
    StoreOutput {
        slot: u32,
        from: u32,
    },
    Add {
        to: u32,
        a: u32,
        b: u32,
    },
    Sub {
        to: u32,
        a: u32,
        b: u32,
    },
    Mul {
        to: u32,
        a: u32,
        b: u32,
    },
    Div {
        to: u32,
        a: u32,
        b: u32,
    },
    /// `a b + c`, rounded twice, as are the two after it.
    MulAdd {
        to: u32,
        a: u32,
        b: u32,
        c: u32,
    },
    /// `a b - c`
    MulSub {
        to: u32,
        a: u32,
        b: u32,
        c: u32,
    },
    /// `c - a b`
    SubMul {
        to: u32,
        a: u32,
        b: u32,
        c: u32,
    },
    Neg {
        to: u32,
        a: u32,
    },
    Select {
        to: u32,
        c: u32,
        a: u32,
        b: u32,
    },
    Unary {
        f: Unary,
        to: u32,
        a: u32,
    },
    Binary {
        f: Binary,
        to: u32,
        a: u32,
        b: u32,
    },
    MatVec(Box<MatVec>),
    Quad(Box<Quad>),
    Newton(u32),
    /// Linear equations, by their number.
    Solve(u32),
}

/// The arrays of a run.
pub(super) struct Memory<'a> {
    pub state: &'a [f64],
    pub input: &'a [f64],
    pub table: &'a [f64],
    pub next: &'a mut [f64],
    pub output: &'a mut [f64],
    pub local: &'a mut [f64],
}

impl Memory<'_> {
    /// `count` numbers from a slot on.
    fn read(&self, slot: Slot, count: usize) -> &[f64] {
        let first = slot.index as usize;
        let array = match slot.array {
            Array::State => self.state,
            Array::Input => self.input,
            Array::Table => self.table,
            Array::Next => &*self.next,
            Array::Output => &*self.output,
            Array::Local => &*self.local,
        };
        &array[first..first + count]
    }

    /// Writes a slot. What is only read is left as it is; verified programs don't ask for that.
    fn write(&mut self, slot: Slot, offset: usize, value: f64) {
        let index = slot.index as usize + offset;
        match slot.array {
            Array::Next => self.next[index] = value,
            Array::Output => self.output[index] = value,
            Array::Local => self.local[index] = value,
            Array::State | Array::Input | Array::Table => {}
        }
    }
}

/// A matrix times a vector.
#[derive(Clone, Debug)]
pub(super) struct MatVec {
    pub to: Slot,
    pub table: usize,
    pub from: Slot,
    pub rows: usize,
    pub cols: usize,
    pub low: bool,
}

impl MatVec {
    /// Each row's sum is taken from left to right; the low-order sum is taken apart, and added at the end.
    pub fn run(&self, memory: &mut Memory<'_>) {
        let size = self.rows * self.cols;
        let table = memory.table;
        let matrix = &table[self.table..self.table + size * if self.low { 2 } else { 1 }];
        let (high, low) = matrix.split_at(size);
        for i in 0..self.rows {
            let row = i * self.cols..(i + 1) * self.cols;
            let vector = memory.read(self.from, self.cols);
            let mut sum = dot(&high[row.clone()], vector);
            if self.low {
                sum += dot(&low[row], vector);
            }
            memory.write(self.to, i, sum);
        }
    }
}

/// A quadratic form.
#[derive(Clone, Debug)]
pub(super) struct Quad {
    pub to: Slot,
    pub table: usize,
    pub from: Slot,
    pub n: usize,
    pub root: bool,
}

impl Quad {
    /// `Σ_i v_i (Σ_{j >= i} q_ij v_j)`, of a root `Σ_i (Σ_{j >= i} r_ij v_j)²`, both sums from left to right.
    pub fn run(&self, memory: &mut Memory<'_>) {
        let n = self.n;
        let (table, vector) = (&memory.table[self.table..], memory.read(self.from, n));
        let mut sum = -0.0; // what adds nothing, not even to -0
        let mut at = 0;
        for i in 0..n {
            if self.root {
                at += i;
            }
            let inner = dot(&table[at..at + n - i], &vector[i..]);
            sum += if self.root { inner } else { vector[i] } * inner;
            at += n - i;
        }
        memory.write(self.to, 0, sum);
    }
}

/// A sum of products, from left to right.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sum = -0.0; // what adds nothing, not even to -0
    for (a, b) in a.iter().zip(b) {
        sum += a * b;
    }
    sum
}
