//! Checks that a program means something.

use super::{Array, Inst, Knee, Newton, Op, Program, Slot, Solve, Value};
use crate::solve::newton::MAX_KNEES;
use thiserror::Error;

/// What is wrong with a program. Such a program is a mistake of whoever made it, never of a user.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Invalid {
    /// A value is used where it is not known.
    #[error("{0} is used before it is defined, or outside of the iteration that defines it")]
    Unknown(Value),
    /// A value is defined twice.
    #[error("{0} is defined twice")]
    Twice(Value),
    /// A value's number is not below the program's count of values.
    #[error("{0} is beyond the program's count of values")]
    Beyond(Value),
    /// A slot, or the last of several, lies outside of its array.
    #[error("{0} and the {1} slots from there on are not all in the array")]
    OutOfRange(Slot, u32),
    /// An array that is not read is read.
    #[error("{0} is read, but only written to")]
    NotRead(Slot),
    /// A slot of the scratch is read before this run wrote to it: what stands there is of the run before.
    #[error("{0} is read before it is written")]
    NotYetWritten(Slot),
    /// An array that is not written is written.
    #[error("{0} is written, but only read from")]
    NotWritten(Slot),
    /// A slot of the new state is written twice, or inside an iteration.
    #[error("{0} is written more than once")]
    Again(Slot),
    /// A slot of the new state is not written.
    #[error("{0} is never written")]
    Missing(Slot),
    /// A matrix or quadratic form reads what it writes.
    #[error("the product written from {0} on reads what it writes")]
    Overlap(Slot),
    /// The lists of an iteration have different lengths.
    #[error("the iteration at {0} has lists of different lengths")]
    Lengths(Slot),
    /// A Jacobian's entry is outside of the matrix, or not after the one before it.
    #[error("entry {1}, {2} of the Jacobian of the iteration at {0} is out of range or out of order")]
    Jacobian(Slot, u32, u32),
    /// The flag of an iteration is not in `Local`, or is one of its unknowns.
    #[error("the flag {0} is not a slot of w, or is an unknown")]
    Flag(Slot),
}

impl Program {
    /// Checks it: each value is defined once, before its uses, and not used outside of the iteration that defines it;
    /// slots are in range, in arrays that may be read or written there; each slot of `Next` is written exactly once,
    /// and each slot of `Local` before it is read, so that no run reads what the one before left; what is said at
    /// [`Newton`] and the other instructions holds.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn verify(&self) -> Result<(), Invalid> {
        let mut check = Check {
            program: self,
            defined: vec![Life::Unborn; self.values as usize],
            next: vec![false; self.size(Array::Next)],
            local: vec![false; self.size(Array::Local)],
            depth: 0,
        };
        check.block(&self.body)?;
        match check.next.iter().position(|w| !w) {
            Some(index) => Err(Invalid::Missing(Slot::new(Array::Next, index))),
            None => Ok(()),
        }
    }
}

/// What is known of a value.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Life {
    Unborn,
    Known,
    Gone,
}

/// A walk through a program.
struct Check<'a> {
    program: &'a Program,
    defined: Vec<Life>,
    /// Which slots of these arrays are written.
    next: Vec<bool>,
    local: Vec<bool>,
    depth: usize,
}

impl Check<'_> {
    fn block(&mut self, body: &[Inst]) -> Result<(), Invalid> {
        for inst in body {
            match inst {
                Inst::Let(v, op) => {
                    match *op {
                        Op::Const(_) => {}
                        Op::Load(slot) => self.read(slot, 1)?,
                        Op::Unary(_, a) => self.known(a)?,
                        Op::Binary(_, a, b) => self.all([a, b])?,
                        Op::Select(c, a, b) => self.all([c, a, b])?,
                    }
                    self.define(*v)?;
                }
                Inst::Store(slot, v) => {
                    self.known(*v)?;
                    self.write(*slot, 1)?;
                }
                Inst::Newton(newton) => self.newton(newton)?,
                Inst::Solve(solve) => self.solve(solve)?,
                Inst::MatVec { to, table, from, rows, cols, low } => {
                    let entries = u64::from(*rows) * u64::from(*cols) * if *low { 2 } else { 1 };
                    self.table(*table, entries)?;
                    self.read(*from, *cols)?;
                    self.write(*to, *rows)?;
                    apart(*to, *rows, *from, *cols)?;
                }
                Inst::Quad { to, table, from, n, root } => {
                    let n64 = u64::from(*n);
                    self.table(*table, if *root { n64 * n64 } else { n64 * (n64 + 1) / 2 })?;
                    self.read(*from, *n)?;
                    self.write(*to, 1)?;
                    apart(*to, 1, *from, *n)?;
                }
            }
        }
        Ok(())
    }

    fn newton(&mut self, newton: &Newton) -> Result<(), Invalid> {
        let first = Slot { array: Array::Local, index: newton.unknowns };
        let n = newton.residual.len();
        if newton.weight.len() != n || newton.scale.len() != n || ![0, n].contains(&newton.cold.len()) {
            return Err(Invalid::Lengths(first));
        }
        let size = n as u32;
        self.read(first, size)?;
        flag_apart(first, size, newton.flag)?;
        let rounding = newton.rounding.map(|index| Slot { array: Array::Local, index });
        if let Some(rounding) = rounding {
            self.range(rounding, size)?;
            apart(rounding, size, first, size)?;
            if newton.affine || newton.flag.is_some_and(|f| (rounding.index..rounding.index + size).contains(&f.index))
            {
                return Err(Invalid::Lengths(first));
            }
        }
        self.all(newton.weight.iter().chain(&newton.scale).chain(&newton.cold).chain(&newton.small).copied())?;
        let own = newton.update.is_empty() || (newton.jacobian.is_empty() && !newton.affine);
        if !own || ![0, n].contains(&newton.update.len()) || !(0.0..1.0).contains(&newton.left) {
            return Err(Invalid::Lengths(first));
        }
        let sound = |b: &Knee| b.unknown < size && b.knee.is_finite() && b.rate.is_finite() && b.rate != 0.0;
        if !newton.knees.iter().all(sound) || (!newton.knees.is_empty() && n > MAX_KNEES) {
            return Err(Invalid::Lengths(first));
        }
        matrix(first, size, &newton.jacobian)?;
        self.depth += 1;
        self.block(&newton.body)?;
        self.depth -= 1;
        self.all(newton.residual.iter().copied())?;
        self.all(newton.jacobian.iter().map(|&(_, _, v)| v))?;
        self.all(newton.update.iter().copied())?;
        self.bury(&newton.body);
        rounding.map_or(Ok(()), |r| self.write(r, size))?;
        newton.flag.map_or(Ok(()), |f| self.write(f, 1))
    }

    fn solve(&mut self, solve: &Solve) -> Result<(), Invalid> {
        let first = Slot { array: Array::Local, index: solve.unknowns };
        let (numbers, entries) = (solve.right.len(), solve.matrix.len());
        let complex = solve.is_complex();
        if complex && (solve.imaginary.len() != entries || numbers % 2 != 0) {
            return Err(Invalid::Lengths(first));
        }
        flag_apart(first, numbers as u32, solve.flag)?;
        matrix(first, solve.size() as u32, &solve.matrix)?;
        self.all(solve.right.iter().copied())?;
        self.all(solve.values())?;
        self.write(first, numbers as u32)?;
        solve.flag.map_or(Ok(()), |f| self.write(f, 1))
    }

    /// Ends the lives of what a body defines.
    fn bury(&mut self, body: &[Inst]) {
        for inst in body {
            match inst {
                Inst::Let(v, _) => self.defined[v.0 as usize] = Life::Gone,
                Inst::Store(..) | Inst::Newton(_) | Inst::Solve(_) | Inst::MatVec { .. } | Inst::Quad { .. } => {}
            }
        }
    }

    fn define(&mut self, v: Value) -> Result<(), Invalid> {
        match self.defined.get_mut(v.0 as usize) {
            Some(life @ Life::Unborn) => {
                *life = Life::Known;
                Ok(())
            }
            Some(Life::Known | Life::Gone) => Err(Invalid::Twice(v)),
            None => Err(Invalid::Beyond(v)),
        }
    }

    fn known(&self, v: Value) -> Result<(), Invalid> {
        match self.defined.get(v.0 as usize) {
            Some(Life::Known) => Ok(()),
            Some(Life::Unborn | Life::Gone) => Err(Invalid::Unknown(v)),
            None => Err(Invalid::Beyond(v)),
        }
    }

    fn all(&self, values: impl IntoIterator<Item = Value>) -> Result<(), Invalid> {
        values.into_iter().try_for_each(|v| self.known(v))
    }

    fn range(&self, slot: Slot, count: u32) -> Result<(), Invalid> {
        if u64::from(slot.index) + u64::from(count) <= self.program.size(slot.array) as u64 {
            Ok(())
        } else {
            Err(Invalid::OutOfRange(slot, count))
        }
    }

    fn table(&self, first: u32, entries: u64) -> Result<(), Invalid> {
        let slot = Slot { array: Array::Table, index: first };
        let count = u32::try_from(entries).map_err(|_| Invalid::OutOfRange(slot, u32::MAX))?;
        self.range(slot, count)
    }

    fn read(&self, slot: Slot, count: u32) -> Result<(), Invalid> {
        match slot.array {
            Array::State | Array::Input | Array::Table => self.range(slot, count),
            Array::Local => {
                self.range(slot, count)?;
                match (slot.index..slot.index + count).find(|i| !self.local[*i as usize]) {
                    Some(index) => Err(Invalid::NotYetWritten(Slot { array: Array::Local, index })),
                    None => Ok(()),
                }
            }
            Array::Next | Array::Output => Err(Invalid::NotRead(slot)),
        }
    }

    fn write(&mut self, slot: Slot, count: u32) -> Result<(), Invalid> {
        self.range(slot, count)?;
        match slot.array {
            Array::State | Array::Input | Array::Table => Err(Invalid::NotWritten(slot)),
            Array::Output => Ok(()),
            Array::Local => {
                self.local[slot.index as usize..][..count as usize].fill(true);
                Ok(())
            }
            Array::Next => {
                for index in slot.index..slot.index + count {
                    let written = &mut self.next[index as usize];
                    if *written || self.depth > 0 {
                        return Err(Invalid::Again(Slot { array: Array::Next, index }));
                    }
                    *written = true;
                }
                Ok(())
            }
        }
    }
}

/// Entries are within the matrix of the system at `first`, in order.
fn matrix(first: Slot, size: u32, entries: &[(u32, u32, Value)]) -> Result<(), Invalid> {
    let mut before = None;
    for &(row, column, _) in entries {
        if row >= size || column >= size || before >= Some((row, column)) {
            return Err(Invalid::Jacobian(first, row, column));
        }
        before = Some((row, column));
    }
    Ok(())
}

/// The flag of who solves for unknowns is a slot of the scratch beside them.
fn flag_apart(first: Slot, size: u32, flag: Option<Slot>) -> Result<(), Invalid> {
    let is_unknown = |f: Slot| f.index >= first.index && f.index - first.index < size;
    match flag {
        Some(flag) if flag.array != Array::Local || is_unknown(flag) => Err(Invalid::Flag(flag)),
        Some(_) | None => Ok(()),
    }
}

/// Fails where two stretches share a slot.
fn apart(to: Slot, written: u32, from: Slot, read: u32) -> Result<(), Invalid> {
    let shared = to.array == from.array && to.index < from.index + read && from.index < to.index + written;
    if shared { Err(Invalid::Overlap(to)) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ir::{Binary, Builder, Unary};
    use crate::options::NewtonOptions;

    fn root() -> Program {
        let mut b = Builder::new("root");
        let (x, n) = (b.slot(Array::State), b.slot(Array::Next));
        let u = b.slot(Array::Local);
        let a = b.load(x);
        let one = b.number(1.0);
        b.store(u, one);
        b.open(u, 1);
        let v = b.load(u);
        let square = b.mul(v, v);
        let r = b.sub(square, a);
        let two = b.number(2.0);
        let j = b.mul(two, v);
        b.close(Newton {
            unknowns: u.index,
            rounding: None,
            body: Vec::new(),
            residual: vec![r],
            jacobian: vec![(0, 0, j)],
            weight: vec![one],
            scale: vec![one],
            cold: Vec::new(),
            small: Vec::new(),
            knees: Vec::new(),
            options: NewtonOptions::DEFAULT,
            limit: 50,
            update: Vec::new(),
            left: 0.0,
            affine: false,
            undetermined: false,
            corners: false,
            flag: None,
        });
        let v = b.load(u);
        b.store(n, v);
        b.finish()
    }

    fn of_root(program: &mut Program) -> &mut Newton {
        program
            .body
            .iter_mut()
            .find_map(|inst| match inst {
                Inst::Newton(n) => Some(n),
                Inst::Let(..) | Inst::Store(..) | Inst::Solve(_) | Inst::MatVec { .. } | Inst::Quad { .. } => None,
            })
            .unwrap()
    }

    #[test]
    fn good_programs_pass() {
        assert_eq!(root().verify(), Ok(()));
    }

    #[test]
    fn values_are_known_where_used() {
        let mut p = root();
        p.body.insert(0, Inst::Let(Value(p.values), Op::Unary(Unary::Neg, Value(0))));
        p.values += 1;
        assert_eq!(p.verify(), Err(Invalid::Unknown(Value(0))));
        let mut p = root();
        let inside = of_root(&mut p).residual[0];
        p.body.push(Inst::Let(Value(p.values), Op::Binary(Binary::Add, inside, inside)));
        p.values += 1;
        assert_eq!(p.verify(), Err(Invalid::Unknown(inside)));
        let mut p = root();
        let inside = of_root(&mut p).residual[0];
        of_root(&mut p).weight[0] = inside;
        assert_eq!(p.verify(), Err(Invalid::Unknown(inside)));
        let mut p = root();
        let twice = p.body[0].clone();
        p.body.push(twice);
        assert_eq!(p.verify(), Err(Invalid::Twice(Value(0))));
    }

    #[test]
    fn arrays_are_used_as_they_may() {
        let state = Slot::new(Array::State, 0);
        let mut p = root();
        p.body.push(Inst::Store(state, Value(0)));
        assert_eq!(p.verify(), Err(Invalid::NotWritten(state)));
        let next = Slot::new(Array::Next, 0);
        let mut p = root();
        p.body.push(Inst::Store(next, Value(0)));
        assert_eq!(p.verify(), Err(Invalid::Again(next)));
        let mut p = root();
        p.body.pop();
        assert_eq!(p.verify(), Err(Invalid::Missing(next)));
        let mut p = root();
        p.body.push(Inst::MatVec { to: state, table: 0, from: state, rows: 1, cols: 1, low: false });
        assert!(matches!(p.verify(), Err(Invalid::OutOfRange(..))));
    }

    #[test]
    fn scratch_is_written_before_it_is_read() {
        let local = |index| Slot::new(Array::Local, index);
        // A guess that no line of the program stores.
        let mut p = root();
        p.body.retain(|inst| !matches!(inst, Inst::Store(Slot { array: Array::Local, .. }, _)));
        assert_eq!(p.verify(), Err(Invalid::NotYetWritten(local(0))));
        // What an iteration leaves is not there yet within it.
        for flag in [true, false] {
            let mut p = root();
            p.sizes[Array::Local as usize] = 2;
            let (first, second) = (Value(p.values), Value(p.values + 1));
            p.values += 2;
            let newton = of_root(&mut p);
            match flag {
                true => newton.flag = Some(local(1)),
                false => newton.rounding = Some(1),
            }
            p.body.push(Inst::Let(first, Op::Load(local(1))));
            assert_eq!(p.verify(), Ok(()));
            of_root(&mut p).body.push(Inst::Let(second, Op::Load(local(1))));
            assert_eq!(p.verify(), Err(Invalid::NotYetWritten(local(1))));
        }
    }

    #[test]
    fn iterations_are_consistent() {
        let mut p = root();
        of_root(&mut p).scale.clear();
        assert!(matches!(p.verify(), Err(Invalid::Lengths(_))));
        for (unknown, knee, rate) in [(9, 0.0, 1.0), (0, f64::NAN, 1.0), (0, 0.0, 0.0), (0, 0.0, f64::INFINITY)] {
            let mut p = root();
            of_root(&mut p).knees.push(Knee { unknown, knee, rate });
            assert!(matches!(p.verify(), Err(Invalid::Lengths(_))));
        }
        let mut p = root();
        let j = of_root(&mut p).jacobian[0];
        of_root(&mut p).jacobian.push(j);
        assert!(matches!(p.verify(), Err(Invalid::Jacobian(..))));
    }
}
