//! The linear model of a scene around a state: dx/dt = A x + B u, y = C x + D u.

use crate::Compiled;
use crate::expression::{Expr, Symbol};
use crate::structure::{Output, Role};
use nalgebra::DMatrix;
use rustc_hash::FxHashMap;
use serde_json::{Value, json};

/// The matrices, with names.
#[derive(Clone, Debug)]
pub struct Linearized {
    /// Energy states, signal states, then integrals.
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

/// Derivatives by what is varied, sorted.
type Row = std::collections::BTreeMap<usize, f64>;

const SINGULAR: &str = "the loops of resistors are singular at this state";

/// Evaluates definitions whose symbols all have values, until none is left that can be; gives their order.
fn settle(pool: &crate::expression::Pool, columns: &[(Symbol, Expr)], at: &mut FxHashMap<Symbol, f64>) -> Vec<usize> {
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
    let mut order = Vec::new();
    while let Some(i) = ready.pop() {
        order.push(i);
        let x = pool.eval(columns[i].1, &|s| at.get(&s).copied().unwrap_or(0.0));
        at.insert(columns[i].0, x);
        for &j in &users[i] {
            waits[j] -= 1;
            if waits[j] == 0 {
                ready.push(j);
            }
        }
    }
    order
}

/// Linearizes what is continuous at a time and at values of the states (energy and signal states by name, then integrals). What
/// is given from outside is at its default.
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
    for i in &model.inputs {
        at.insert(i.symbol, i.value);
        inputs.push((i.name.clone(), i.symbol));
    }
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
            rates.push(form.input(&mut model.pool, s.column));
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
                Output::Curve { parameter, out: value, residual, .. } => {
                    let s = model.pool.var(*parameter);
                    let e = model.pool.sub(s, *residual);
                    columns.push((*parameter, e));
                    columns.push((out, *value));
                }
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
    for (m, law) in model.memories.iter().zip(&form.memories) {
        at.insert(m.symbol, states(&m.name).unwrap_or(m.start));
        if m.sampling.is_none() {
            symbols.push(m.symbol);
            names.push(m.name.clone());
            rates.push(*law);
        }
    }
    for f in form.regions.iter().flat_map(|r| &r.following) {
        columns.push((form.column(f.column).out, f.rate));
    }
    for l in &form.loops {
        columns.push((l.unknown, l.value));
    }
    for (i, (integral, rate)) in model.integrals.iter().zip(&form.integrals).enumerate() {
        let name = format!("integral[{i}]");
        at.insert(integral.symbol, states(&name).unwrap_or(integral.start));
        symbols.push(integral.symbol);
        names.push(name);
        rates.push(*rate);
    }
    // Values of the definitions: those that depend on settled ones only, as far as that goes; then Newton's method for loops.
    let order = settle(&model.pool, &columns, &mut at);
    let settled: Vec<bool> = {
        let mut list = vec![false; columns.len()];
        order.iter().for_each(|i| list[*i] = true);
        list
    };
    let looped: Vec<usize> = (0..columns.len()).filter(|i| !settled[*i]).collect();
    for &i in &looped {
        at.entry(columns[i].0).or_insert(1e-9);
    }
    let place: FxHashMap<Symbol, usize> = columns.iter().enumerate().map(|(i, c)| (c.0, i)).collect();
    let row: FxHashMap<usize, usize> = looped.iter().enumerate().map(|(k, i)| (*i, k)).collect();
    let value = |pool: &crate::expression::Pool, at: &FxHashMap<Symbol, f64>, e: Expr| {
        pool.eval(e, &|s| at.get(&s).copied().unwrap_or(0.0))
    };
    let n = looped.len();
    let mut loops = DMatrix::<f64>::identity(n, n);
    let mut slopes: Vec<(usize, usize, Expr)> = Vec::new();
    for (k, &i) in looped.iter().enumerate() {
        for s in model.pool.symbols(columns[i].1) {
            if let Some(&j) = place.get(&s).and_then(|j| row.get(j)) {
                slopes.push((k, j, model.pool.derivative(columns[i].1, s)));
            }
        }
    }
    for _ in 0..if n == 0 { 0 } else { 200 } {
        let residual = nalgebra::DVector::from_fn(n, |k, _| {
            at[&columns[looped[k]].0] - value(&model.pool, &at, columns[looped[k]].1)
        });
        loops = DMatrix::identity(n, n);
        for (i, j, d) in &slopes {
            loops[(*i, *j)] -= value(&model.pool, &at, *d);
        }
        let step = loops.clone().lu().solve(&residual).ok_or(SINGULAR)?;
        let (mut change, mut size) = (0.0f64, 0.0f64);
        for (k, i) in looped.iter().enumerate() {
            if let Some(x) = at.get_mut(&columns[*i].0) {
                *x -= step[k];
                size = size.max(x.abs());
            }
            change = change.max(step[k].abs());
        }
        if change <= 1e-14 * size || change == 0.0 {
            break;
        }
    }
    // Rows over what is varied: states, then inputs. Definitions in order, loops at once.
    let varied: FxHashMap<Symbol, usize> =
        symbols.iter().copied().chain(inputs.iter().map(|i| i.1)).enumerate().map(|(k, s)| (s, k)).collect();
    let mut rows: Vec<Row> = vec![Row::default(); columns.len()];
    let total = |pool: &mut crate::expression::Pool, rows: &[Row], e: Expr, skip: &dyn Fn(usize) -> bool| -> Row {
        let mut sum = Row::default();
        for s in pool.symbols(e) {
            let k = varied.get(&s).copied();
            let j = place.get(&s).copied().filter(|j| k.is_none() && !skip(*j));
            if k.is_none() && j.is_none() {
                continue;
            }
            let d = pool.derivative(e, s);
            let d = pool.eval(d, &|s| at.get(&s).copied().unwrap_or(0.0));
            if let Some(k) = k {
                *sum.entry(k).or_default() += d;
            }
            for (k, x) in j.map(|j| &rows[j]).into_iter().flatten() {
                *sum.entry(*k).or_default() += d * x;
            }
        }
        sum
    };
    let waits_for_loop = |i: usize| row.contains_key(&i);
    for &i in &order {
        rows[i] = total(&mut model.pool, &rows, columns[i].1, &|_| false);
    }
    if n > 0 {
        let lu = loops.lu();
        let width = varied.len();
        let mut right = DMatrix::<f64>::zeros(n, width);
        for (k, &i) in looped.iter().enumerate() {
            for (j, x) in total(&mut model.pool, &rows, columns[i].1, &waits_for_loop) {
                right[(k, j)] = x;
            }
        }
        let solved = lu.solve(&right).ok_or(SINGULAR)?;
        for (k, &i) in looped.iter().enumerate() {
            rows[i] = (0..width).map(|j| (j, solved[(k, j)])).filter(|t| t.1 != 0.0).collect();
        }
    }
    let probes = form.probes.clone();
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
    let fill = |m: &mut DMatrix<f64>, n: &mut DMatrix<f64>, i: usize, row: Row| {
        for (k, x) in row {
            if k < nx {
                m[(i, k)] = x;
            } else {
                n[(i, k - nx)] = x;
            }
        }
    };
    for (i, e) in rates.iter().enumerate() {
        let row = total(&mut model.pool, &rows, *e, &|_| false);
        fill(&mut result.a, &mut result.b, i, row);
    }
    for (i, e) in probes.iter().enumerate() {
        let row = total(&mut model.pool, &rows, *e, &|_| false);
        fill(&mut result.c, &mut result.d, i, row);
    }
    result.outputs = model.probes.iter().map(|p| p.name.clone()).collect();
    Ok(result)
}
