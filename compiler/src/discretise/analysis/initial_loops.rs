//! Where loops start: their solution at the first instant, found here so that no user has to guess it.
//!
//! Newton's method on the homotopy F(z) - (1 - s) F(z_0) = 0 from s = 0, where z_0 solves it, to s = 1: for monotone
//! laws that path never turns back (Ortega and Rheinboldt, Iterative Solution of Nonlinear Equations, chapter 7). From
//! other starts too, since a loop may have several solutions, and then the model does not say which one it is in.

use crate::discretise::cluster::Cluster;
use crate::expression::{Expr, Symbol};
use crate::model::{Model, Signal};
use crate::structure::Form;
use bond_grammar::diagnostic::Diagnostic;
use nalgebra::{DMatrix, DVector};
use rustc_hash::FxHashMap;

/// More unknowns of loops than this start from 0.
const LARGEST: usize = 128;
/// Loops up to this size are tried from several starts.
const SEVERAL: usize = 24;
/// Rounds of Newton's method: from far up an exponential each goes down by one of its units, and there are some 700.
const ROUNDS: usize = 800;
/// A residual that is less is 0, in any unit: where rounding hides the slope of a law, as of `exp(x) - 1` at 0, the way
/// to it has no end.
const NOTHING: f64 = 1e-60;
/// Where else to start where nothing is found from 0, which may have no value, as of a temperature: so many times what
/// is known in the equations, whatever the unknown is.
const ELSEWHERE: [f64; 8] = [1.0, 300.0, 1e-3, 1e3, 1e5, 10.0, 1e-6, -1.0];

struct System<'a> {
    model: &'a Model,
    unknowns: &'a [Symbol],
    place: FxHashMap<Symbol, usize>,
    known: &'a FxHashMap<Symbol, f64>,
    /// Whether multipliers of constraints are among the unknowns, of which any may be 0: residuals that are rounding
    /// say that all are found.
    constrained: bool,
    residuals: Vec<Expr>,
    slopes: Vec<(usize, usize, Expr)>,
}

impl System<'_> {
    fn at<'z>(&'z self, z: &'z DVector<f64>) -> impl Fn(Symbol) -> f64 + 'z {
        move |s| match self.place.get(&s) {
            Some(i) => z[*i],
            None => self.known.get(&s).copied().unwrap_or(0.0),
        }
    }

    fn residual(&self, z: &DVector<f64>) -> DVector<f64> {
        DVector::from_vec(self.model.pool.eval_all(&self.residuals, &self.at(z)))
    }

    /// Whether each residual is no more than what its terms are rounded by: nothing more can be known of it.
    fn is_rounding(&self, z: &DVector<f64>, r: &DVector<f64>) -> bool {
        let at = self.at(z);
        self.residuals.iter().zip(r.iter()).all(|(e, r)| self.model.pool.is_rounding(*e, *r, &at))
    }

    fn jacobian(&self, z: &DVector<f64>) -> DMatrix<f64> {
        let n = self.unknowns.len();
        let all: Vec<Expr> = self.slopes.iter().map(|t| t.2).collect();
        let mut j = DMatrix::zeros(n, n);
        for ((r, c, _), x) in self.slopes.iter().zip(self.model.pool.eval_all(&all, &self.at(z))) {
            j[(*r, *c)] = x;
        }
        j
    }

    /// Newton's method, halved while that does not make the residual less; whether it got there.
    fn newton(&self, z: &mut DVector<f64>, off: &DVector<f64>, rounds: usize) -> bool {
        let mut r = self.residual(z) - off;
        // The least update, beside the unknowns, and how many since have not been much less.
        let (mut least, mut stalls) = (f64::INFINITY, 0);
        for _ in 0..rounds {
            let may_rest = self.constrained || z.iter().all(|x| *x == 0.0);
            if r.iter().all(|x| x.abs() < NOTHING) || (may_rest && self.is_rounding(z, &r)) {
                return true;
            }
            let slopes = self.jacobian(z);
            // By an infinite slope nothing would be missing.
            let told = slopes.iter().all(|x| x.is_finite());
            let lu = slopes.lu();
            let Some(d) = lu.solve(&r).filter(|d| d.iter().all(|x| x.is_finite())) else {
                return false;
            };
            if told && d.iter().zip(z.iter()).all(|(d, z)| d.abs() <= 1e-14 * z.abs()) {
                // Rounding is all that is left.
                *z -= d;
                return true;
            }
            let beside = d.iter().zip(z.iter()).filter(|(d, _)| **d != 0.0).map(|(d, z)| (d / z).abs());
            let step = beside.fold(0.0, f64::max);
            (least, stalls) = if step < 0.5 * least { (step, 0) } else { (least, stalls + 1) };
            if told && stalls >= self.model.settings.thresholds.newton.stalls && step <= 1e-9 && self.isolated(z) {
                // What is left of an unknown may be no more than the rounding of what it is a difference of.
                return true;
            }
            let (size, mut part) = (r.norm(), 1.0);
            loop {
                let next = &*z - &d * part;
                let after = self.residual(&next) - off;
                // Residuals have units; what they ask of the unknowns, beside the unknowns' sizes, has none.
                let less = || {
                    let sizes = z.iter().zip(next.iter()).map(|(a, b)| a.abs().max(b.abs()));
                    let asked = |d: &DVector<f64>| -> f64 {
                        d.iter().zip(sizes.clone()).filter(|(d, _)| **d != 0.0).map(|(d, s)| (d / s).powi(2)).sum()
                    };
                    lu.solve(&after).is_some_and(|left| asked(&left) < asked(&d) * (1.0 - 0.5 * part))
                };
                if after.norm() < size || (part < 1e-9 && after.norm().is_finite()) || less() {
                    *z = next;
                    r = after;
                    break;
                }
                part *= 0.5;
                if part < 1e-12 {
                    // Rounding may be all that is left.
                    return d.iter().zip(z.iter()).all(|(d, z)| d.abs() <= 1e-9 * z.abs());
                }
            }
        }
        false
    }

    /// The solution that the path from `start` leads to.
    fn follow(&self, start: DVector<f64>) -> Option<DVector<f64>> {
        let mut z = start.clone();
        let none = DVector::zeros(z.len());
        if self.newton(&mut z, &none, ROUNDS) {
            return Some(z);
        }
        let mut z = start;
        let first = self.residual(&z);
        if !first.iter().all(|x| x.is_finite()) {
            return None;
        }
        let (mut s, mut step) = (0.0f64, 0.125f64);
        for _ in 0..200 {
            if s >= 1.0 {
                return Some(z);
            }
            let next = (s + step).min(1.0);
            let mut trial = z.clone();
            if self.newton(&mut trial, &(&first * (1.0 - next)), 40) {
                z = trial;
                s = next;
                step *= 2.0;
            } else {
                step *= 0.25;
                if step < 1e-9 {
                    return None;
                }
            }
        }
        None
    }

    /// Whether a solution stands alone.
    fn isolated(&self, z: &DVector<f64>) -> bool {
        let j = self.jacobian(z);
        let rows: Vec<f64> = j.row_iter().map(|r| r.amax()).collect();
        if rows.iter().any(|x| *x == 0.0 || !x.is_finite()) {
            return false;
        }
        let scaled = DMatrix::from_fn(j.nrows(), j.ncols(), |r, c| j[(r, c)] / rows[r]);
        let singular = scaled.singular_values();
        singular.min() > 1e-9 * singular.max()
    }
}

/// Values of the loops' unknowns at the start. Where ideal laws in one loop leave open what lies between them, as
/// diodes with a threshold at rest, or frictions in series, it is as between equal leaks.
///
/// # Errors
/// Where there is no solution, or more than one, with the bonds.
pub(crate) fn guesses(c: &Cluster, model: &mut Model, form: &Form) -> Result<Vec<f64>, Vec<Diagnostic>> {
    let found = guesses_of(c, model, form);
    if found.is_ok() {
        return found;
    }
    let mut leaky = c.clone();
    for node in &mut leaky.nodes {
        let curve = |column| form.regions.iter().find_map(|r| r.leaky.get(&column)).copied();
        node.how = node.resistor().and_then(curve).unwrap_or(node.how);
    }
    match guesses_of(&leaky, model, form) {
        Ok(leaking) if is_near(c, model, form, &leaking) => Ok(leaking),
        Ok(_) | Err(_) => found,
    }
}

/// Whether ideal laws hold there: what flows is no leak.
fn is_near(c: &Cluster, model: &mut Model, form: &Form, guesses: &[f64]) -> bool {
    let flat = c.flat_at_instant(&mut model.pool, form);
    let at: FxHashMap<Symbol, f64> =
        known(c, model).into_iter().chain(c.loops.iter().copied().zip(guesses.iter().copied())).collect();
    let residuals = c.loop_residuals(&mut model.pool);
    c.loop_nodes().iter().zip(residuals).filter(|(n, _)| n.has_branches()).all(|(_, r)| {
        let r = model.pool.substitute(r, &flat);
        model.pool.eval(r, &|s| at.get(&s).copied().unwrap_or(0.0)).abs() <= model.settings.thresholds.start.ideal
    })
}

/// What is known at the start.
fn known(c: &Cluster, model: &Model) -> FxHashMap<Symbol, f64> {
    c.states
        .iter()
        .map(|s| (s.symbol, s.initial))
        .chain(c.integrals.iter().map(|i| (i.symbol, i.start)))
        .chain(c.inputs.iter().map(|i| (i.1, model.inputs[i.0].value)))
        .collect()
}

fn guesses_of(c: &Cluster, model: &mut Model, form: &Form) -> Result<Vec<f64>, Vec<Diagnostic>> {
    let n = c.loops.len();
    let mut all = vec![0.0; n];
    if n == 0 || n > LARGEST {
        return Ok(all);
    }
    let mut flat = c.flat_at_instant(&mut model.pool, form);
    let mut residuals: Vec<Expr> = c.residuals_in(&mut model.pool, &flat);
    let speeds = c.constraints_at_instant(model, form, &mut flat, &mut residuals)?;
    residuals.extend(speeds.residuals);
    let loops: Vec<Symbol> = c.loops.iter().copied().chain(speeds.unknowns).collect();
    all.resize(loops.len(), 0.0);
    let place: FxHashMap<Symbol, usize> = loops.iter().enumerate().map(|(i, s)| (*s, i)).collect();
    let reads: Vec<Vec<usize>> = residuals
        .iter()
        .map(|r| {
            let mut inside: Vec<usize> = model.pool.symbols(*r).iter().filter_map(|s| place.get(s).copied()).collect();
            inside.sort_unstable();
            inside
        })
        .collect();
    let (known, nodes) = (known(c, model), c.loop_nodes());
    // What shares no unknown is solved by itself: a law at its corner, where its slope is 0, says nothing of the
    // others.
    for block in blocks(&reads) {
        let own: FxHashMap<usize, usize> = block.iter().enumerate().map(|(k, i)| (*i, k)).collect();
        let mut slopes = Vec::new();
        for (k, i) in block.iter().enumerate() {
            for j in &reads[*i] {
                slopes.push((k, own[j], model.pool.derivative(residuals[*i], loops[*j])));
            }
        }
        let unknowns: Vec<Symbol> = block.iter().map(|i| loops[*i]).collect();
        let place = unknowns.iter().enumerate().map(|(k, s)| (*s, k)).collect();
        let residuals = block.iter().map(|i| residuals[*i]).collect();
        let constrained = block.iter().any(|i| nodes.get(*i).is_some_and(|n| n.constraint().is_some()));
        let system = System { model, unknowns: &unknowns, place, known: &known, constrained, residuals, slopes };
        let solution = system.solution(c).map_err(|wrong| {
            let curves = c.loop_nodes().iter().filter(|n| unknowns.contains(&n.unknown()) && n.has_branches()).count();
            let (what, help) = wrong.words(curves > 1);
            vec![complain(c, model, form, &unknowns, what, help)]
        })?;
        for (i, x) in block.iter().zip(solution.iter()) {
            all[*i] = *x;
        }
    }
    let place = |s: Symbol| loops.iter().position(|z| *z == s);
    for (i, k) in speeds.now.iter().filter_map(|(s, now)| Some((place(*s)?, place(*now)?))) {
        all[i] = all[k];
    }
    all.truncate(n);
    Ok(all)
}

/// Unknowns that equations have in common, each block in order, the blocks by their first.
fn blocks(reads: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut sets = petgraph::unionfind::UnionFind::<usize>::new(reads.len());
    for (i, list) in reads.iter().enumerate() {
        for j in list {
            sets.union(i, *j);
        }
    }
    let mut found: Vec<Vec<usize>> = vec![Vec::new(); reads.len()];
    for (i, at) in sets.into_labeling().into_iter().enumerate() {
        found[at].push(i);
    }
    found.retain(|b| !b.is_empty());
    found.sort_by_key(|b| b[0]);
    found
}

/// What is wrong with the start of a block.
enum Wrong {
    None,
    Several,
}

impl Wrong {
    /// What to say of it, where several ideal laws are in it or not.
    fn words(&self, ideal: bool) -> (&'static str, &'static str) {
        match self {
            Wrong::None if ideal => (
                "no solution was found at the start",
                "check the laws: a flow into diodes that all block, or a force on what friction holds, has nowhere \
                to go; add a small leak, such as `f = max(s, 0)*1 A + 1 uA * min(s, 0)`, or a storage",
            ),
            Wrong::None => (
                "no solution was found at the start",
                "check the laws; a law that jumps where it should hold still, as friction written with `sign`, is better given as a curve, `{ e = ...; f = ... }` in `s`",
            ),
            Wrong::Several => (
                "it has more than one solution at the start",
                "the graph does not determine which one holds: put a storage into the loop, such as the small C or I \
                of the real part",
            ),
        }
    }
}

impl System<'_> {
    /// Sizes of the unknowns: by the places nearest to 0 where their laws change their character, and by the farthest.
    fn sizes(&self) -> [DVector<f64>; 2] {
        let known = |s: Symbol| self.known.get(&s).copied().unwrap_or(0.0);
        let pairs = self.unknowns.iter().zip(&self.residuals);
        let extents: Vec<[f64; 2]> =
            pairs.map(|(z, r)| self.model.pool.landmarks(&[*r], *z, &known).extent()).collect();
        [0, 1].map(|k| DVector::from_iterator(extents.len(), extents.iter().map(|e| e[k])))
    }

    /// The sizes of what is known in the equations; 1 where nothing is.
    fn known_sizes(&self) -> Vec<f64> {
        let symbols = self.residuals.iter().flat_map(|r| self.model.pool.symbols(*r));
        let mut sizes: Vec<f64> =
            symbols.filter_map(|s| self.known.get(&s)).map(|x| x.abs()).filter(|x| *x > 0.0).collect();
        sizes.sort_by(f64::total_cmp);
        sizes.dedup();
        if sizes.is_empty() { vec![1.0] } else { sizes }
    }

    /// Its solution at the start of a cluster; 0 where it is not known what comes from elsewhere.
    fn solution(&self, c: &Cluster) -> Result<DVector<f64>, Wrong> {
        let n = self.unknowns.len();
        let first = self.follow(DVector::zeros(n));
        // What comes from elsewhere is not known here.
        let told = c.ports.is_empty()
            && c.inputs.is_empty()
            && c.foreign.is_empty()
            && self.residuals.iter().all(|r| {
                self.model.pool.symbols(*r).iter().all(|s| {
                    self.place.contains_key(s)
                        || self.known.contains_key(s)
                        || self.model.signals.get(s) == Some(&Signal::Time)
                        || self.model.pool.value(*s).is_some()
                })
            });
        if !told || n > SEVERAL {
            return Ok(first.unwrap_or_else(|| DVector::zeros(n)));
        }
        let mut found: Vec<DVector<f64>> = first.into_iter().collect();
        // Other starts: along the way to where the slopes at 0 point to, which has the units of the unknowns.
        let zero = DVector::zeros(n);
        let mut ways: Vec<DVector<f64>> = Vec::new();
        let [nearest, farthest] = self.sizes();
        for at in [zero.clone(), &nearest * 1e-3] {
            ways.extend(self.jacobian(&at).lu().solve(&self.residual(&at)).filter(|d| d.iter().all(|x| x.is_finite())));
        }
        ways.extend([-nearest, -farthest]);
        for way in ways {
            for part in [0.05, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0, 1.5, -0.5, -2.0] {
                let mut z = &way * -part;
                if self.newton(&mut z, &zero, 60) {
                    found.push(z);
                }
            }
        }
        if found.is_empty() {
            let known = self.known_sizes();
            let starts = ELSEWHERE.iter().flat_map(|part| known.iter().map(move |x| part * x));
            found.extend(starts.into_iter().find_map(|x| self.follow(DVector::from_element(n, x))));
        }
        // Between two solutions that stand alone the slopes turn over (the degree of the map); between two roundings of
        // one they do not.
        let apart = |a: &DVector<f64>, b: &DVector<f64>| {
            let first = self.jacobian(a).determinant().signum();
            (a - b).amax() > self.model.settings.thresholds.start.same * a.amax().max(b.amax())
                && (1..=32).any(|k| {
                    let way = f64::from(k) / 32.0;
                    self.jacobian(&(a * (1.0 - way) + b * way)).determinant().signum() == -first
                })
        };
        let Some(solution) = found.first().cloned() else { return Err(Wrong::None) };
        let other = found.iter().skip(1).find(|z| apart(z, &solution) && self.isolated(z));
        if other.is_some() && self.isolated(&solution) {
            return Err(Wrong::Several);
        }
        Ok(solution)
    }
}

fn complain(c: &Cluster, model: &Model, form: &Form, unknowns: &[Symbol], what: &str, help: &str) -> Diagnostic {
    let mut names: Vec<String> = Vec::new();
    let mut bonds = Vec::new();
    let mut elements = Vec::new();
    for node in c.loop_nodes().into_iter().filter(|n| unknowns.contains(&n.unknown())) {
        let bond = match node.resistor() {
            Some(column) => {
                names.push(format!("`{}`", form.column(column).name));
                Some(form.column(column).bond)
            }
            None => {
                names.push(format!("`{}`", model.pool.name(node.out)));
                let found = form.loops.iter().find(|l| l.unknown == node.out).map(|l| l.bond);
                let column = form.column_of.get(&node.out).filter(|_| found.is_none());
                elements.extend(column.map(|c| form.column(*c).element));
                found
            }
        };
        bonds.extend(bond);
    }
    let element = elements.first().map(|id| model.element(*id).span);
    let span = bonds.first().map(|b| model.bond(*b).span).or(element).unwrap_or(model.span);
    let mut error =
        Diagnostic::error("discretise::loop", span, format!("an algebraic loop through {}: {what}", names.join(", ")));
    for b in bonds.iter().take(16) {
        error = error.label(model.bond(*b).span, format!("the bond {} is in it", model.bond(*b).name));
    }
    error.help(help)
}
