//! Newton's method and linear equations as statements: `bond_runtime::solve::iteration` on a [`Recorder`].

use super::recorder::{Changing, Recorded, Recorder};
use super::writer::{At, ELIMINATED, UNROLLED, Vector, Writer, scratch};
use super::{Local, Lower, eliminate};
use crate::backend::code::{Cond, Reason, Stmt, Value, Var};
use bond_runtime::ir::{self, Array, Slot};
use bond_runtime::machine::{Flow, Machine, Number, Variable};
use bond_runtime::solve::iteration::{DONE, Equations, Iteration, Method, Places, SINGULAR};
use bond_runtime::solve::linear::Matrix;

/// The equations of an iteration, which `compute` writes: it gives the residual, and the entries of the matrix or the
/// update, unless they are in memory by then.
pub(super) struct Statements<'n, F> {
    newton: &'n ir::Newton,
    compute: F,
    residual: Vector,
    entries: Vec<Value>,
    /// Where the matrix and the solution of a large system are.
    matrix: u32,
    solution: u32,
}

impl<'n, F: FnMut(&Recorder, bool) -> (Vector, Vec<Value>)> Statements<'n, F> {
    /// Equations with their matrix from a place of the scratch on, where they are many.
    pub(super) fn new(w: &mut Writer, newton: &'n ir::Newton, matrix: Option<u32>, compute: F) -> Self {
        let n = newton.residual.len();
        let solution = if n > ELIMINATED { w.room(n) } else { 0 };
        let matrix = matrix.unwrap_or_else(|| if n > ELIMINATED { w.room(newton.jacobian.len()) } else { 0 });
        Self { newton, compute, residual: Vector::Memory(0), entries: Vec::new(), matrix, solution }
    }

    /// Writes the whole iteration. Gives whether it went well, where it has a flag.
    pub(super) fn write<'r>(mut self, m: &'r Recorder, places: Places<&'r Recorder>) -> Option<Value> {
        let (newton, method) = (self.newton, Method::of(self.newton));
        let it = Iteration::new(m, &method, places);
        // Statements leave nothing.
        let _ = it.run(&mut self);
        if !(newton.affine && newton.flag.is_some()) {
            it.counted(&mut self);
        }
        let good = it.end.get().equals(m.number(DONE));
        if newton.flag.is_some() {
            return Some(m.select(good, m.number(1.0), m.number(0.0)).value);
        }
        m.only(!good, || {
            let fail = |why: Reason| m.with(|w| w.push(Stmt::Fail(why)));
            if newton.affine {
                return fail(Reason::Singular(it.row.get().value));
            }
            m.only(it.end.get().equals(m.number(SINGULAR)), || fail(Reason::Singular(it.row.get().value)));
            let (worst, change) = it.worst();
            let worst = m.number(f64::from(newton.unknowns)) + worst;
            fail(Reason::NoConvergence(newton.limit, worst.value, change.value));
        });
        None
    }
}

impl<'r, F: FnMut(&Recorder, bool) -> (Vector, Vec<Value>)> Equations<&'r Recorder> for Statements<'_, F> {
    fn evaluate(&mut self, m: &'r Recorder, coarse: bool) -> Flow {
        (self.residual, self.entries) = (self.compute)(m, coarse);
        if self.newton.residual.len() > ELIMINATED && self.newton.update.is_empty() {
            m.with(|w| store(w, self.matrix, &self.entries));
        }
        Ok(())
    }

    fn residual(&self) -> Vector {
        self.residual.clone()
    }

    fn entry(&self, m: &'r Recorder, k: usize) -> Recorded<'r> {
        m.value(self.entries[k])
    }

    fn is_finite(&self, m: &'r Recorder) -> Cond {
        if self.newton.residual.len() > ELIMINATED {
            let matrix = Vector::Memory(self.matrix);
            return m.all(self.newton.jacobian.len(), |i| m.at(&matrix, i).is_finite());
        }
        Cond::all(m.with(|w| self.entries.iter().map(|x| w.finite(*x)).collect::<Vec<_>>()))
    }

    fn solve(&mut self, m: &'r Recorder, row: &Changing<'r>) -> Vector {
        let (newton, n, solution) = (self.newton, self.newton.residual.len(), Vector::Memory(self.solution));
        if !newton.update.is_empty() {
            return m.with(|w| match n > UNROLLED {
                true => {
                    store(w, self.solution, &self.entries);
                    solution
                }
                false => Vector::Vars(self.entries.iter().map(|v| w.holding(*v)).collect()),
            });
        }
        let undetermined = newton.undetermined;
        if n > ELIMINATED {
            m.each(n, |i| m.put(&solution, i, m.at(&self.residual, i)));
            let pattern = newton.jacobian.iter().map(|e| (e.0, e.1)).collect();
            let kind = if undetermined { Matrix::Undetermined } else { Matrix::Changing };
            m.with(|w| {
                let system = w.system(n, pattern, kind);
                let (matrix, vector) = (self.matrix, self.solution);
                w.push(Stmt::Solve { system, matrix, vector, row: row.var, same: None });
            });
            return solution;
        }
        let right: Vec<Value> = (0..n).map(|i| m.at(&self.residual, At::One(i)).value).collect();
        let places = newton.jacobian.iter().zip(&self.entries);
        let entries: Vec<(u32, u32, Value)> = places.map(|(e, v)| (e.0, e.1, *v)).collect();
        eliminate::solve(m, &entries, right, row, undetermined)
    }

    fn count(&mut self, m: &'r Recorder, iterations: Recorded<'r>) {
        m.with(|w| w.push(Stmt::Count(iterations.value)));
    }
}

/// Stores values one after the other in the scratch.
fn store(w: &mut Writer, base: u32, values: &[Value]) {
    values.iter().enumerate().for_each(|(i, v)| w.push(Stmt::Store(scratch(base, At::One(i)), *v)));
}

/// Where the numbers of an iteration are, with room for what it keeps.
pub(super) fn places<'r>(
    w: &mut Writer,
    newton: &ir::Newton,
    (unknowns, rounding): (Vector, Option<Vector>),
    (weight, scale, cold): (Vector, Vector, Option<Vector>),
) -> Places<&'r Recorder> {
    let n = if newton.affine { 0 } else { newton.residual.len() };
    let begun = if n <= UNROLLED { n } else { 0 };
    let (room, update) = (w.vector(n), w.vector(n));
    Places { unknowns, rounding, weight, scale, cold, room, update, begun: (w.vector(begun), w.vector(begun)) }
}

impl Lower {
    pub(super) fn newton(&mut self, newton: &ir::Newton) {
        let n = newton.residual.len();
        let at = |first: u32| match &self.local {
            Local::Vars(vars) => Vector::Vars(vars[first as usize..first as usize + n].to_vec()),
            Local::Memory(base) => Vector::Memory(base + first),
        };
        let unknowns = (at(newton.unknowns), newton.rounding.map(at));
        let [weight, scale, cold] = [&newton.weight, &newton.scale, &newton.cold].map(|list| match newton.affine {
            true => Vec::new(),
            false => self.all(list),
        });
        let w = &mut self.w;
        let cold = (!cold.is_empty()).then(|| w.values(cold));
        let given = (w.values(weight), w.values(scale), cold);
        let places = places(w, newton, unknowns, given);
        let mut writer = std::mem::take(w);
        let equations = Statements::new(&mut writer, newton, None, |m, coarse| {
            m.with(|w| std::mem::swap(w, &mut self.w));
            let computed = self.compute(newton, coarse);
            m.with(|w| std::mem::swap(w, &mut self.w));
            computed
        });
        let recorder = Recorder::new(writer);
        let good = equations.write(&recorder, places);
        self.w = recorder.into_writer();
        if let (Some(flag), Some(x)) = (newton.flag, good) {
            self.write(flag, None, x);
        }
    }

    /// The residual, and the entries of the matrix or the update, at the unknowns as they are; `coarse` without what is
    /// next to nothing.
    fn compute(&mut self, newton: &ir::Newton, coarse: bool) -> (Vector, Vec<Value>) {
        let nothing = self.w.number(-0.0);
        let small = if coarse { &newton.small[..] } else { &[] };
        let kept: Vec<_> = small.iter().map(|v| self.values[v.0 as usize].replace(nothing)).collect();
        self.block(&newton.body);
        let residual = self.all(&newton.residual);
        let entries = newton.jacobian.iter().map(|e| &e.2).chain(&newton.update);
        let entries = self.all(entries);
        small.iter().zip(kept).for_each(|(v, x)| self.values[v.0 as usize] = x);
        (self.w.values(residual), entries)
    }

    /// Linear equations.
    pub(super) fn linear(&mut self, solve: &ir::Solve) {
        let right = self.all(&solve.right);
        let matrix: Vec<ir::Value> = solve.values().collect();
        let matrix = self.all(&matrix);
        let recorder = Recorder::new(std::mem::take(&mut self.w));
        let (row, numbers) = ((&recorder).variable(), right.len());
        let solution = if numbers > ELIMINATED || solve.is_complex() {
            recorder.with(|w| {
                let (entries, vector) = (w.room(matrix.len()), w.room(numbers));
                store(w, entries, &matrix);
                store(w, vector, &right);
                solved_for(w, solve, (entries, vector), row.var, None);
                Vector::Memory(vector)
            })
        } else {
            let entries: Vec<(u32, u32, Value)> =
                solve.matrix.iter().zip(matrix).map(|(&(i, j, _), v)| (i, j, v)).collect();
            eliminate::solve(&recorder, &entries, right, &row, false)
        };
        let row = row.var;
        let unknowns = (0..numbers).map(|i| (&recorder).at(&solution, At::One(i)).value).collect::<Vec<_>>();
        self.w = recorder.into_writer();
        for (i, x) in unknowns.into_iter().enumerate() {
            self.write(Slot { array: Array::Local, index: solve.unknowns + i as u32 }, None, x);
        }
        let good = ended(&mut self.w, solve, row);
        if let (Some(flag), Some(good)) = (solve.flag, good) {
            self.write(flag, None, good);
        }
    }
}

/// Solves linear equations with these places of the matrix and of the right side.
pub(super) fn solved_for(
    w: &mut Writer,
    solve: &ir::Solve,
    (matrix, vector): (u32, u32),
    row: Var,
    same: Option<Value>,
) {
    let system = w.system(solve.size(), solve.pattern(), solve.of());
    w.push(Stmt::Solve { system, matrix, vector, row, same });
}

/// Fails where linear equations were not solved, or says whether they were, where they have a flag.
pub(super) fn ended(w: &mut Writer, solve: &ir::Solve, row: Var) -> Option<Value> {
    let (row, zero, one) = (w.get(row), w.number(0.0), w.number(1.0));
    let solved = w.lt(row, zero);
    if solve.flag.is_some() {
        return Some(w.select(solved, one, zero));
    }
    w.push(Stmt::Count(one));
    w.when(solved.not(), |w| w.push(Stmt::Fail(Reason::Singular(row))));
    None
}
