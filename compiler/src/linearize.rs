//! The linear model of a scene around a state: dx/dt = A x + B u, y = C x + D u.

use crate::Compiled;
use crate::expression::{Expr, Symbol};
use crate::structure::{ColumnId, Output, Role};
use nalgebra::DMatrix;
use rustc_hash::FxHashMap;
use serde_json::{Value, json};

/// The matrices, with names.
#[derive(Clone, Debug)]
pub struct Linearized {
    /// Energy states, then integrals.
    pub states: Vec<String>,
    /// The scene's inputs, open ports, and what sampled regions hold at the others' bonds.
    pub inputs: Vec<String>,
    /// Probes.
    pub outputs: Vec<String>,
    /// State matrix.
    pub a: DMatrix<f64>,
    /// Input matrix.
    pub b: DMatrix<f64>,
    /// Output matrix.
    pub c: DMatrix<f64>,
    /// Feed-through.
    pub d: DMatrix<f64>,
}

impl Linearized {
    /// As JSON, matrices row by row.
    pub fn to_json(&self) -> Value {
        let rows = |m: &DMatrix<f64>| -> Vec<Vec<f64>> { m.row_iter().map(|r| r.iter().copied().collect()).collect() };
        json!({
            "states": self.states, "inputs": self.inputs, "outputs": self.outputs,
            "A": rows(&self.a), "B": rows(&self.b), "C": rows(&self.c), "D": rows(&self.d),
        })
    }
}

/// Evaluates definitions whose symbols all have values, until none is left that can be.
fn settle(pool: &crate::expression::Pool, columns: &[(Symbol, Expr)], at: &mut FxHashMap<Symbol, f64>) {
    let defined: FxHashMap<Symbol, usize> = columns.iter().enumerate().map(|(i, c)| (c.0, i)).collect();
    let mut waits: Vec<usize> = Vec::with_capacity(columns.len());
    let mut users: Vec<Vec<usize>> = vec![Vec::new(); columns.len()];
    for (i, (_, e)) in columns.iter().enumerate() {
        let needs: Vec<usize> = pool.symbols(*e).iter().filter_map(|s| defined.get(s).copied()).collect();
        waits.push(needs.len());
        for j in needs {
            users[j].push(i);
        }
    }
    let mut ready: Vec<usize> = (0..columns.len()).filter(|i| waits[*i] == 0).collect();
    while let Some(i) = ready.pop() {
        let x = pool.eval(columns[i].1, &|s| at.get(&s).copied().unwrap_or(0.0));
        at.insert(columns[i].0, x);
        for &j in &users[i] {
            waits[j] -= 1;
            if waits[j] == 0 {
                ready.push(j);
            }
        }
    }
}

/// Linearizes the continuous regions at a time and at values of their states (energy states by name, then integrals).
///
/// # Errors
/// In words, where loops of resistors cannot be solved at that state.
pub fn linearize(
    compiled: &mut Compiled,
    time: f64,
    states: &dyn Fn(&str) -> Option<f64>,
) -> Result<Linearized, String> {
    let (model, form) = (&mut compiled.model, &compiled.form);
    let continuous: Vec<usize> = (0..form.regions.len()).filter(|r| form.regions[*r].sampling.is_none()).collect();
    let mut at: FxHashMap<Symbol, f64> = FxHashMap::default();
    for (s, signal) in &model.signals {
        if *signal == crate::model::Signal::Time {
            at.insert(*s, time);
        }
    }
    // States, and everything else as a definition: outputs of storages, sources and resistors.
    let mut symbols: Vec<Symbol> = Vec::new();
    let mut names = Vec::new();
    let mut rates: Vec<Expr> = Vec::new();
    let mut columns: Vec<(Symbol, Expr)> = Vec::new();
    let mut inputs: Vec<(String, Symbol)> = Vec::new();
    let input = |model: &mut crate::model::Model, c: ColumnId| {
        let terms: Vec<Expr> = form
            .column(c)
            .row
            .iter()
            .map(|(j, k)| {
                let z = model.pool.var(form.column(*j).out);
                model.pool.mul(*k, z)
            })
            .collect();
        model.pool.sum(&terms)
    };
    for (i, r) in form.regions.iter().enumerate() {
        for s in &r.states {
            at.insert(s.symbol, states(&s.name).unwrap_or(s.initial));
        }
        let here = continuous.contains(&i);
        for g in &r.groups {
            for (s, z) in g.states.iter().zip(&g.coenergy) {
                columns.push((form.column(r.states[*s].column).out, *z));
            }
        }
        for s in r.states.iter().filter(|_| here) {
            symbols.push(s.symbol);
            names.push(s.name.clone());
            rates.push(input(model, s.column));
        }
        for c in &r.inputs {
            let column = form.column(*c);
            match column.role {
                Role::Source(v) => columns.push((column.out, v)),
                Role::Bar | Role::Open(_) => {
                    at.insert(column.out, 0.0);
                    if here {
                        inputs.push((format!("{}.{}", column.name, column.gives.letter()), column.out));
                    }
                }
                Role::Storage | Role::Resistor | Role::Dependent => {}
            }
        }
        for (c, how) in &r.resistors {
            let out = form.column(*c).out;
            match how {
                Output::Explicit(e) => columns.push((out, *e)),
                Output::Implicit(e) => {
                    // z - (z - residual): its derivative is that of the residual.
                    let z = model.pool.var(out);
                    let e = model.pool.sub(z, *e);
                    columns.push((out, e));
                }
            }
        }
    }
    for (i, (integral, rate)) in model.integrals.iter().zip(&form.integrals).enumerate() {
        let name = format!("integral[{i}]");
        at.insert(integral.symbol, states(&name).unwrap_or(integral.start));
        symbols.push(integral.symbol);
        names.push(name);
        rates.push(*rate);
    }
    // Values of the definitions: those that depend on settled ones only, as far as that goes; then Newton's method for loops.
    let n = columns.len();
    settle(&model.pool, &columns, &mut at);
    for (z, _) in &columns {
        at.entry(*z).or_insert(1e-9);
    }
    let place: FxHashMap<Symbol, usize> = columns.iter().enumerate().map(|(i, c)| (c.0, i)).collect();
    let mut slopes: Vec<(usize, usize, Expr)> = Vec::new();
    for (i, (_, e)) in columns.iter().enumerate() {
        for s in model.pool.symbols(*e) {
            if let Some(&j) = place.get(&s) {
                slopes.push((i, j, model.pool.derivative(*e, s)));
            }
        }
    }
    let mut jacobian = DMatrix::<f64>::identity(n, n);
    for _ in 0..200 {
        let value = |at: &FxHashMap<Symbol, f64>, e: Expr| model.pool.eval(e, &|s| at.get(&s).copied().unwrap_or(0.0));
        let residual = nalgebra::DVector::from_fn(n, |i, _| at[&columns[i].0] - value(&at, columns[i].1));
        jacobian = DMatrix::identity(n, n);
        for (i, j, d) in &slopes {
            jacobian[(*i, *j)] -= value(&at, *d);
        }
        let step = jacobian.clone().lu().solve(&residual).ok_or("the loops of resistors are singular at this state")?;
        let (mut change, mut size) = (0.0f64, 0.0f64);
        for (i, (z, _)) in columns.iter().enumerate() {
            if let Some(x) = at.get_mut(z) {
                *x -= step[i];
                size = size.max(x.abs());
            }
            change = change.max(step[i].abs());
        }
        if change <= 1e-14 * size || change == 0.0 {
            break;
        }
    }
    let probes = form.probes.clone();
    let value = |model: &crate::model::Model, e: Expr| model.pool.eval(e, &|s| at.get(&s).copied().unwrap_or(0.0));
    let lu = jacobian.lu();
    // dz/dx = (1 - dg/dz)^-1 dg/dx
    let derivative = |model: &mut crate::model::Model, by: Symbol| -> Result<(Vec<f64>, Vec<f64>), String> {
        let direct = nalgebra::DVector::from_fn(n, |i, _| {
            let d = model.pool.derivative(columns[i].1, by);
            value(model, d)
        });
        let dz = lu.solve(&direct).ok_or("the loops of resistors are singular at this state")?;
        let total = |model: &mut crate::model::Model, e: Expr| {
            let own = model.pool.derivative(e, by);
            let mut sum = value(model, own);
            for s in model.pool.symbols(e) {
                if let Some(&j) = place.get(&s) {
                    let d = model.pool.derivative(e, s);
                    sum += value(model, d) * dz[j];
                }
            }
            sum
        };
        let states = rates.iter().map(|e| total(model, *e)).collect();
        let outputs = probes.iter().map(|e| total(model, *e)).collect();
        Ok((states, outputs))
    };
    let (nx, nu, ny) = (symbols.len(), inputs.len(), probes.len());
    let mut result = Linearized {
        states: names,
        inputs: inputs.iter().map(|i| i.0.clone()).collect(),
        outputs: vec![],
        a: DMatrix::zeros(nx, nx),
        b: DMatrix::zeros(nx, nu),
        c: DMatrix::zeros(ny, nx),
        d: DMatrix::zeros(ny, nu),
    };
    for (k, s) in symbols.iter().enumerate() {
        let (x, y) = derivative(model, *s)?;
        result.a.set_column(k, &nalgebra::DVector::from_vec(x));
        result.c.set_column(k, &nalgebra::DVector::from_vec(y));
    }
    for (k, (_, s)) in inputs.iter().enumerate() {
        let (x, y) = derivative(model, *s)?;
        result.b.set_column(k, &nalgebra::DVector::from_vec(x));
        result.d.set_column(k, &nalgebra::DVector::from_vec(y));
    }
    result.outputs = model.probes.iter().map(|p| p.name.clone()).collect();
    Ok(result)
}
