//! The linear model of a scene around a state: dx/dt = A x + B u, y = C x + D u.

use crate::Stages;
use crate::expression::{Expr, Pool, Symbol};
use crate::rates::Point;
use crate::structure::{Form, Region};
use nalgebra::DMatrix;
use rustc_hash::FxHashMap;
use serde_json::{Value, json};

/// The matrices, with names.
#[derive(Clone, Debug)]
pub struct Linearized {
    /// Energy states, signal states, then integrals; of those that constraints tie the independent ones.
    pub states: Vec<String>,
    /// The scene's inputs, open ports, and what sampled regions hold at the others' bonds; then sampled signal states
    /// and what else of samples is read between them.
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

/// A row of derivatives of what is named.
fn finite(row: Row, name: &str) -> Result<Row, String> {
    if row.values().all(|k| k.is_finite()) {
        return Ok(row);
    }
    Err(format!(
        "`{name}` has no finite slope there, such as a root at 0: linearize elsewhere, by `--at` or other starts"
    ))
}

/// Linearizes what is continuous at a time and at values of the states (energy and signal states by name, then
/// integrals). What is given from outside is at its default. What is sampled stands still: by its values, the others
/// are driven.
///
/// # Errors
/// In words, where loops of resistors cannot be solved at that state.
pub fn linearize(stages: &mut Stages, time: f64, states: &dyn Fn(&str) -> Option<f64>) -> Result<Linearized, String> {
    let point = Point::new(stages, time, states)?;
    let (model, form) = (&mut stages.model, &stages.form);
    let (columns, looped) = (&point.columns, &point.looped);
    let place: FxHashMap<Symbol, usize> = columns.iter().enumerate().map(|(i, c)| (c.0, i)).collect();
    let row: FxHashMap<usize, usize> = looped.iter().enumerate().map(|(k, i)| (*i, k)).collect();
    let n = looped.len();
    // Rows over what is varied: states, then inputs. Definitions in order, loops at once.
    let varied: FxHashMap<Symbol, usize> = point
        .states
        .iter()
        .map(|s| s.1)
        .chain(point.inputs.iter().map(|i| i.1))
        .enumerate()
        .map(|(k, s)| (s, k))
        .collect();
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
            let d = point.value(pool, d);
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
    // What is sampled does not follow; what of it is read is varied by itself.
    let still = |i: usize| point.still[i];
    for &i in point.order.iter().filter(|i| !still(**i)) {
        rows[i] = total(&mut model.pool, &rows, columns[i].1, &|_| false);
    }
    if n > 0 {
        let mut loops = point.loops.clone();
        for k in (0..n).filter(|k| still(looped[*k])) {
            loops.row_mut(k).fill(0.0);
            loops.column_mut(k).fill(0.0);
            loops[(k, k)] = 1.0;
        }
        let width = varied.len();
        let mut right = DMatrix::<f64>::zeros(n, width);
        for (k, &i) in looped.iter().enumerate().filter(|(_, i)| !still(**i)) {
            for (j, x) in total(&mut model.pool, &rows, columns[i].1, &waits_for_loop) {
                right[(k, j)] = x;
            }
        }
        let solved = point.solve_loops(&loops, &right).ok_or_else(|| point.singular(&model.pool))?;
        for (k, &i) in looped.iter().enumerate() {
            rows[i] = (0..width).map(|j| (j, solved[(k, j)])).filter(|t| t.1 != 0.0).collect();
        }
    }
    let probes = form.probes.clone();
    let (nx, nu, ny) = (point.states.len(), point.inputs.len(), probes.len());
    let mut result = Linearized {
        states: point.states.iter().map(|s| s.0.clone()).collect(),
        inputs: point.inputs.iter().map(|i| i.0.clone()).collect(),
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
    for (i, (name, _, e)) in point.states.iter().enumerate() {
        let row = finite(total(&mut model.pool, &rows, *e, &|_| false), name)?;
        fill(&mut result.a, &mut result.b, i, row);
    }
    for (i, e) in probes.iter().enumerate() {
        let row = finite(total(&mut model.pool, &rows, *e, &|_| false), &model.probes[i].name)?;
        fill(&mut result.c, &mut result.d, i, row);
    }
    result.outputs = model.probes.iter().map(|p| p.name.clone()).collect();
    let mut tied = Vec::new();
    for tie in point.ties.clone() {
        let mut row = DMatrix::zeros(1, nx);
        let found = total(&mut model.pool, &rows, tie, &|_| false);
        found.into_iter().filter(|t| t.0 < nx).for_each(|(k, x)| row[(0, k)] = x);
        tied.push(row);
    }
    if !tied.is_empty() {
        let bends: Vec<f64> = point.states.iter().map(|s| bend(&point, &mut model.pool, form, s.1)).collect();
        result.eliminate(tied, &bends);
    }
    Ok(result)
}

/// How strongly the energy bends along a state; 0 where it has none.
fn bend(point: &Point, pool: &mut Pool, form: &Form, state: Symbol) -> f64 {
    let of = |r: &Region| r.states.iter().position(|s| s.symbol == state);
    let Some((r, i)) = form.regions.iter().find_map(|r| Some((r, of(r)?))) else { return 0.0 };
    let group = r.groups.iter().find_map(|g| Some(g.coenergy[g.states.iter().position(|s| *s == i)?]));
    let slope = group.map(|z| pool.derivative(z, state));
    slope.map_or(0.0, |slope| point.value(pool, slope).abs())
}

impl Linearized {
    /// Takes the states out that constraints tie: these are combinations of the others. Each constraint takes the one
    /// out that stands in it most, in the units in which the energy is half the sum of squares.
    fn eliminate(&mut self, mut tied: Vec<DMatrix<f64>>, bends: &[f64]) {
        let n = self.states.len();
        // By state, what it is a combination of.
        let mut of: Vec<Option<DMatrix<f64>>> = vec![None; n];
        while let Some(mut row) = tied.pop() {
            let size = row.amax();
            for (i, by) in of.iter().enumerate() {
                if let Some(by) = by {
                    let k = row[(0, i)];
                    row[(0, i)] = 0.0;
                    row += by * k;
                }
            }
            let share = |i: &usize| if bends[*i] > 0.0 { row[(0, *i)].abs() / bends[*i].sqrt() } else { 0.0 };
            let free = (0..n).filter(|i| of[*i].is_none());
            let Some(pivot) = free.max_by(|i, j| share(i).total_cmp(&share(j))) else { break };
            // What is rounding alone says nothing.
            if share(&pivot) == 0.0 || row[(0, pivot)].abs() <= 1e-12 * size {
                continue;
            }
            let own = row[(0, pivot)];
            row[(0, pivot)] = 0.0;
            row /= -own;
            for by in of.iter_mut().flatten() {
                let k = by[(0, pivot)];
                by[(0, pivot)] = 0.0;
                *by += &row * k;
            }
            of[pivot] = Some(row);
        }
        let kept: Vec<usize> = (0..n).filter(|i| of[*i].is_none()).collect();
        let all = DMatrix::from_fn(n, kept.len(), |i, k| match &of[i] {
            Some(by) => by[(0, kept[k])],
            None => f64::from(u8::from(i == kept[k])),
        });
        self.a = self.a.select_rows(&kept) * &all;
        self.b = self.b.select_rows(&kept);
        self.c = &self.c * &all;
        self.states = kept.iter().map(|i| self.states[*i].clone()).collect();
    }
}
