//! The junction structure: every bond's effort and flow as a combination of the columns' outputs.
//!
//! Each bond variable is defined once, by the element that gives it. The definitions are taken in the order of their
//! dependence; where they form a loop (junctions in a ring), the loop's linear system is solved symbolically.

use super::{Column, ColumnId, Role, Row};
use crate::causality::Causality;
use crate::expression::{Expr, Pool};
use crate::graph::BondGraph;
use crate::model::{BondId, ElementId, Kind, Law, Model, Variable};
use bond_grammar::diagnostic::Diagnostic;
use petgraph::Graph;
use petgraph::graph::NodeIndex;
use rustc_hash::FxHashMap;

/// The mend for bonds in a loop that leave a variable free.
const FREE: &str = "open the loop, or put an element into it that determines the missing variable; a circuit without \
a reference voltage needs a ground, `Se:ground = 0 V` bonded to one of its 0-junctions";

/// Rows of all bond variables.
pub(super) struct Rows {
    rows: Vec<Row>,
}

impl Rows {
    /// The row of a bond's variable as seen from one of its ends.
    pub(super) fn get(&self, model: &Model, bond: BondId, end: ElementId, variable: Variable) -> &Row {
        &self.rows[model.place(bond, end, variable)]
    }
}

enum Term {
    Variable(usize),
    Column(ColumnId),
}

/// Sum of rows times coefficients.
pub(super) fn combine<'r>(pool: &mut Pool, terms: impl IntoIterator<Item = (Expr, &'r Row)>) -> Row {
    let mut sums: FxHashMap<ColumnId, Vec<Expr>> = FxHashMap::default();
    for (k, row) in terms {
        for &(c, a) in row {
            let x = pool.mul(k, a);
            sums.entry(c).or_default().push(x);
        }
    }
    let mut row: Row = sums.into_iter().map(|(c, xs)| (c, pool.sum(&xs))).collect();
    row.retain(|(_, x)| !pool.is_zero(*x));
    row.sort_unstable_by_key(|t| t.0);
    row
}

/// Solves the junction structure and fills in the columns' rows.
pub(super) fn rows(
    model: &mut Model,
    graph: &BondGraph,
    causality: &Causality,
    columns: &mut [Column],
) -> Result<Rows, Vec<Diagnostic>> {
    let mut pool = std::mem::take(&mut model.pool);
    let result = solve(model, graph, causality, columns, &mut pool);
    model.pool = pool;
    result
}

fn solve(
    model: &Model,
    graph: &BondGraph,
    causality: &Causality,
    columns: &mut [Column],
    pool: &mut Pool,
) -> Result<Rows, Vec<Diagnostic>> {
    let count = 4 * model.bonds.len();
    let mut definitions: Vec<Vec<(Term, Expr)>> = Vec::with_capacity(count);
    definitions.resize_with(count, Vec::new);
    let one = pool.int(1);
    for (i, c) in columns.iter().enumerate() {
        let near = if c.role == Role::Bar { model.bond(c.bond).other(c.element) } else { c.element };
        let at = model.place(c.bond, near, c.gives);
        let k = pool.int(c.sign_of(c.gives));
        definitions[at].push((Term::Column(ColumnId(i as u32)), k));
    }
    for (id, e) in model.ids() {
        let bonds = &graph.bonds_of[id.at()];
        let at = |b: BondId, v: Variable| model.place(b, id, v);
        let points_in = |b: BondId| model.bond(b).head == id;
        match (e.kind, &e.law) {
            (Kind::Zero | Kind::One, _) => {
                let (common, summed) = if e.kind == Kind::Zero {
                    (Variable::Effort, Variable::Flow)
                } else {
                    (Variable::Flow, Variable::Effort)
                };
                let Some(&giver) = bonds.iter().find(|b| causality.gives(model, **b, id) == summed) else { continue };
                for &b in bonds.iter().filter(|b| **b != giver) {
                    definitions[at(b, common)].push((Term::Variable(at(giver, common)), one));
                    let k = pool.int(if points_in(b) == points_in(giver) { -1 } else { 1 });
                    definitions[at(giver, summed)].push((Term::Variable(at(b, summed)), k));
                }
            }
            (Kind::Tf | Kind::Gy, Law::Ratio(v)) => {
                let (Some(&into), Some(&out)) =
                    (bonds.iter().find(|b| points_in(**b)), bonds.iter().find(|b| !points_in(**b)))
                else {
                    continue;
                };
                let inverse = pool.div(one, *v);
                for &b in bonds {
                    let other = if b == into { out } else { into };
                    let gives = causality.gives(model, b, id);
                    let (from, k) = match (e.kind, gives, b == into) {
                        (Kind::Tf, Variable::Effort, true) => (at(other, Variable::Effort), *v),
                        (Kind::Tf, Variable::Effort, false) => (at(other, Variable::Effort), inverse),
                        (Kind::Tf, Variable::Flow, true) => (at(other, Variable::Flow), inverse),
                        (Kind::Tf, Variable::Flow, false) => (at(other, Variable::Flow), *v),
                        (_, Variable::Effort, _) => (at(other, Variable::Flow), *v),
                        (_, Variable::Flow, _) => (at(other, Variable::Effort), inverse),
                    };
                    definitions[at(b, gives)].push((Term::Variable(from), k));
                }
            }
            (
                Kind::Se
                | Kind::Sf
                | Kind::C
                | Kind::I
                | Kind::R
                | Kind::De
                | Kind::Df
                | Kind::Port
                | Kind::Tf
                | Kind::Gy,
                _,
            ) => {}
        }
    }
    let rows = Rows { rows: substitute(model, &definitions, pool)? };
    for c in columns.iter_mut() {
        let near = if c.role == Role::Bar { model.bond(c.bond).other(c.element) } else { c.element };
        let row = rows.get(model, c.bond, near, c.gives.other());
        let k = pool.int(c.sign_of(c.gives.other()));
        c.row = combine(pool, [(k, row)]);
    }
    Ok(rows)
}

/// Replaces variables by their definitions, dependences first.
fn substitute(model: &Model, definitions: &[Vec<(Term, Expr)>], pool: &mut Pool) -> Result<Vec<Row>, Vec<Diagnostic>> {
    let mut needs: Graph<(), ()> = Graph::with_capacity(definitions.len(), 2 * definitions.len());
    for _ in definitions {
        needs.add_node(());
    }
    for (i, terms) in definitions.iter().enumerate() {
        for (t, _) in terms {
            if let Term::Variable(j) = t {
                needs.add_edge(NodeIndex::new(i), NodeIndex::new(*j), ());
            }
        }
    }
    let mut rows: Vec<Row> = vec![Vec::new(); definitions.len()];
    let one = pool.int(1);
    // Components come with those first on which others depend.
    for component in petgraph::algo::kosaraju_scc(&needs) {
        let members: Vec<usize> = component.iter().map(|n| n.index()).collect();
        let position: FxHashMap<usize, usize> = members.iter().enumerate().map(|(i, m)| (*m, i)).collect();
        let n = members.len();
        let mut matrix: Vec<Vec<Option<Expr>>> = Vec::new();
        let mut right: Vec<Row> = Vec::new();
        for &m in &members {
            let mut own = vec![None; if n > 1 { n } else { 0 }];
            let mut known: Vec<(Expr, Row)> = Vec::new();
            for (t, k) in &definitions[m] {
                match t {
                    Term::Column(c) => known.push((*k, vec![(*c, one)])),
                    Term::Variable(v) => match position.get(v) {
                        Some(&p) if n > 1 => {
                            let minus = pool.neg(*k);
                            own[p] = Some(match own[p] {
                                Some(x) => pool.add(x, minus),
                                None => minus,
                            });
                        }
                        _ => known.push((*k, rows[*v].clone())),
                    },
                }
            }
            if n > 1 {
                let p = position[&m];
                own[p] = Some(match own[p] {
                    Some(x) => pool.add(x, one),
                    None => one,
                });
            }
            matrix.push(own);
            right.push(combine(pool, known.iter().map(|(k, r)| (*k, r))));
        }
        if n == 1 {
            rows[members[0]] = right.swap_remove(0);
            continue;
        }
        let solved = (n <= 64).then(|| eliminate(pool, matrix, right)).flatten();
        let Some(solved) = solved else {
            let mut bonds: Vec<usize> = members.iter().map(|m| m / 4).collect();
            bonds.sort_unstable();
            bonds.dedup();
            let names: Vec<&str> = bonds.iter().map(|b| model.bonds[*b].name.as_str()).collect();
            let mut error = Diagnostic::error(
                "structure::loop",
                model.bonds[bonds[0]].span,
                format!(
                    "the graph is not determined: the bonds {} form a loop that leaves a variable free",
                    names.join(", ")
                ),
            );
            for b in bonds.iter().skip(1).take(16) {
                error = error.label(model.bonds[*b].span, "is in the loop");
            }
            return Err(vec![error.help(FREE)]);
        };
        for (m, row) in members.iter().zip(solved) {
            rows[*m] = row;
        }
    }
    Ok(rows)
}

/// A pivot that is no more than this is none.
const NOTHING: f64 = 1e-9;

/// Gauss-Jordan elimination with rows of outputs on the right side; `None` if singular.
fn eliminate(pool: &mut Pool, mut a: Vec<Vec<Option<Expr>>>, mut right: Vec<Row>) -> Option<Vec<Row>> {
    let n = a.len();
    let size = |pool: &Pool, e: Option<Expr>| -> f64 {
        let Some(e) = e else { return 0.0 };
        let x = pool.eval(e, &|s| 0.37 + 0.21 * f64::from(s.0 % 11)).abs();
        if x.is_finite() { x } else { 0.0 }
    };
    for k in 0..n {
        // A number before what may pass 0.
        let rank = |i: &usize| {
            let (known, size) = (a[*i][k].is_some_and(|e| pool.constant(e).is_some()), size(pool, a[*i][k]));
            (known && size >= NOTHING, size)
        };
        let order = |a: (bool, f64), b: (bool, f64)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1));
        let pivot = (k..n).max_by(|i, j| order(rank(i), rank(j)))?;
        if size(pool, a[pivot][k]) < NOTHING {
            return None;
        }
        a.swap(k, pivot);
        right.swap(k, pivot);
        let one = pool.int(1);
        let inverse = {
            let p = a[k][k]?;
            pool.div(one, p)
        };
        for entry in a[k].iter_mut().flatten() {
            *entry = pool.mul(*entry, inverse);
        }
        right[k] = combine(pool, [(inverse, &right[k])]);
        for i in (0..n).filter(|i| *i != k) {
            let Some(factor) = a[i][k].filter(|f| !pool.is_zero(*f)) else { continue };
            let minus = pool.neg(factor);
            for j in 0..n {
                if let Some(x) = a[k][j] {
                    let t = pool.mul(minus, x);
                    a[i][j] = Some(match a[i][j] {
                        Some(y) => pool.add(y, t),
                        None => t,
                    });
                }
            }
            right[i] = combine(pool, [(one, &right[i]), (minus, &right[k])]);
        }
    }
    Some(right)
}
