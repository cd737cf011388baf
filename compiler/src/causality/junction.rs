//! The junction structure under given strokes: every bond's effort and flow as a combination of what elements give.
//!
//! Each bond variable is defined once, by the element that gives it. The definitions are taken in the order of their
//! dependence; where they form a loop (junctions in a ring), the loop's linear equations are solved. The coefficients
//! are expressions in the form, and values at one place where only the pattern of the rows counts (`analysis`).

use super::{Causality, OPTIONS};
use crate::expression::{Expr, Pool};
use crate::graph::BondGraph;
use crate::model::{BondId, ElementId, Kind, Law, Model, TwoPort, Variable};
use petgraph::Graph;
use petgraph::graph::NodeIndex;
use rustc_hash::FxHashMap;
use std::hash::Hash;

/// Variables that a loop may have.
const MAX_LOOP: usize = 64;

/// What coefficients are made of.
pub trait Coefficients {
    /// A coefficient.
    type Of: Copy;
    /// A whole number.
    fn int(&mut self, n: i64) -> Self::Of;
    /// The ratio of a TF or GY.
    fn ratio(&mut self, ratio: Expr) -> Self::Of;
    /// -x
    fn neg(&mut self, x: Self::Of) -> Self::Of;
    /// The sum of all.
    fn sum(&mut self, terms: &[Self::Of]) -> Self::Of;
    /// x y
    fn mul(&mut self, x: Self::Of, y: Self::Of) -> Self::Of;
    /// x / y
    fn div(&mut self, x: Self::Of, y: Self::Of) -> Self::Of;
    /// Whether it is 0.
    fn is_zero(&self, x: Self::Of) -> bool;
    /// How large it is at a place where nothing is special, and whether it is so everywhere.
    fn size(&self, x: Self::Of) -> (bool, f64);
}

/// The value of an expression at a place where nothing is special.
pub(super) fn somewhere(pool: &Pool, e: Expr) -> f64 {
    pool.eval(e, &|s| 0.37 + 0.21 * f64::from(s.0 % 11))
}

/// Coefficients as expressions.
impl Coefficients for Pool {
    type Of = Expr;

    fn int(&mut self, n: i64) -> Expr {
        Pool::int(self, n)
    }

    fn ratio(&mut self, ratio: Expr) -> Expr {
        ratio
    }

    fn neg(&mut self, x: Expr) -> Expr {
        Pool::neg(self, x)
    }

    fn sum(&mut self, terms: &[Expr]) -> Expr {
        Pool::sum(self, terms)
    }

    fn mul(&mut self, x: Expr, y: Expr) -> Expr {
        Pool::mul(self, x, y)
    }

    fn div(&mut self, x: Expr, y: Expr) -> Expr {
        Pool::div(self, x, y)
    }

    fn is_zero(&self, x: Expr) -> bool {
        Pool::is_zero(self, x)
    }

    fn size(&self, x: Expr) -> (bool, f64) {
        let size = somewhere(self, x).abs();
        (self.constant(x).is_some(), if size.is_finite() { size } else { 0.0 })
    }
}

/// Coefficients of what is given, sorted by what gives it, none of them 0.
type Row<K, A> = Vec<(K, <A as Coefficients>::Of)>;

/// What something gives: the bond variable that it is, what gives it, and with which sign.
pub struct Given<K> {
    /// See [`Model::place`].
    pub place: usize,
    /// What gives it.
    pub by: K,
    /// 1 or -1.
    pub sign: i64,
}

/// Bonds in a loop that leaves a variable undetermined.
pub struct Undetermined(pub Vec<BondId>);

/// A variable's definition is a sum of these, times coefficients.
enum Term<K> {
    Variable(usize),
    Given(K),
}

/// Definitions of variables, by place.
type Definitions<K, A> = Vec<Vec<(Term<K>, <A as Coefficients>::Of)>>;

/// Sum of rows times coefficients.
pub fn combine<'r, K: Copy + Ord + Hash + 'r, A: Coefficients>(
    a: &mut A,
    terms: impl IntoIterator<Item = (A::Of, &'r Row<K, A>)>,
) -> Row<K, A>
where
    A::Of: 'r,
{
    let mut sums: FxHashMap<K, Vec<A::Of>> = FxHashMap::default();
    for (k, row) in terms {
        for &(c, x) in row {
            let x = a.mul(k, x);
            sums.entry(c).or_default().push(x);
        }
    }
    let mut row: Row<K, A> = sums.into_iter().map(|(c, xs)| (c, a.sum(&xs))).collect();
    row.retain(|(_, x)| !a.is_zero(*x));
    row.sort_unstable_by_key(|t| t.0);
    row
}

/// The rows of all bond variables, by place.
///
/// # Errors
/// A loop that leaves a variable undetermined.
pub fn rows<K: Copy + Ord + Hash, A: Coefficients>(
    a: &mut A,
    model: &Model,
    graph: &BondGraph,
    causality: &Causality,
    given: &[Given<K>],
) -> Result<Vec<Row<K, A>>, Undetermined> {
    let mut definitions: Definitions<K, A> = Vec::new();
    definitions.resize_with(4 * model.bonds.len(), Vec::new);
    let one = a.int(1);
    for g in given {
        let k = a.int(g.sign);
        definitions[g.place].push((Term::Given(g.by), k));
    }
    for (id, e) in model.ids() {
        match (e.kind, &e.law) {
            (Kind::Junction(common), _) => {
                junction(a, (model, graph), causality, (id, common), &mut definitions);
            }
            (Kind::TwoPort(two_port), Law::Ratio(v)) => {
                let bonds = &graph.bonds_of[id.at()];
                let points_in = |b: &&BondId| model.bond(**b).head == id;
                let ends = (bonds.iter().find(points_in), bonds.iter().find(|b| !points_in(b)));
                let (Some(&into), Some(&out)) = ends else { continue };
                let ratio = a.ratio(*v);
                let inverse = a.div(one, ratio);
                let at = |b: BondId, v: Variable| model.place(b, id, v);
                for &b in bonds {
                    let other = if b == into { out } else { into };
                    let gives = causality.gives(model, b, id);
                    let (from, k) = match (two_port, gives, b == into) {
                        (TwoPort::Transformer, Variable::Effort, true) => (at(other, Variable::Effort), ratio),
                        (TwoPort::Transformer, Variable::Effort, false) => (at(other, Variable::Effort), inverse),
                        (TwoPort::Transformer, Variable::Flow, true) => (at(other, Variable::Flow), inverse),
                        (TwoPort::Transformer, Variable::Flow, false) => (at(other, Variable::Flow), ratio),
                        (TwoPort::Gyrator, Variable::Effort, _) => (at(other, Variable::Flow), ratio),
                        (TwoPort::Gyrator, Variable::Flow, _) => (at(other, Variable::Effort), inverse),
                    };
                    definitions[at(b, gives)].push((Term::Variable(from), k));
                }
            }
            (Kind::OnePort(_) | Kind::TwoPort(_), _) => {}
        }
    }
    substitute(a, &definitions)
}

/// What a junction defines: what all its bonds have in common, and the sum of the other variable.
fn junction<K: Copy, A: Coefficients>(
    a: &mut A,
    (model, graph): (&Model, &BondGraph),
    causality: &Causality,
    (id, common): (ElementId, Variable),
    definitions: &mut Definitions<K, A>,
) {
    let summed = common.other();
    let bonds = &graph.bonds_of[id.at()];
    let at = |b: BondId, v: Variable| model.place(b, id, v);
    let points_in = |b: BondId| model.bond(b).head == id;
    let Some(&giver) = bonds.iter().find(|b| causality.gives(model, **b, id) == summed) else { return };
    let one = a.int(1);
    for &b in bonds.iter().filter(|b| **b != giver) {
        definitions[at(b, common)].push((Term::Variable(at(giver, common)), one));
        let k = a.int(if points_in(b) == points_in(giver) { -1 } else { 1 });
        definitions[at(giver, summed)].push((Term::Variable(at(b, summed)), k));
    }
}

/// Replaces variables by their definitions, dependences first.
fn substitute<K: Copy + Ord + Hash, A: Coefficients>(
    a: &mut A,
    definitions: &Definitions<K, A>,
) -> Result<Vec<Row<K, A>>, Undetermined> {
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
    let mut rows: Vec<Row<K, A>> = vec![Vec::new(); definitions.len()];
    let one = a.int(1);
    // Components come with those first on which others depend.
    for component in petgraph::algo::kosaraju_scc(&needs) {
        let members: Vec<usize> = component.iter().map(|n| n.index()).collect();
        let position: FxHashMap<usize, usize> = members.iter().enumerate().map(|(i, m)| (*m, i)).collect();
        let n = members.len();
        let mut matrix: Vec<Vec<Option<A::Of>>> = Vec::new();
        let mut right: Vec<Row<K, A>> = Vec::new();
        let add = |a: &mut A, x: &mut Option<A::Of>, y: A::Of| {
            *x = Some(x.map_or(y, |x| a.sum(&[x, y])));
        };
        for &m in &members {
            let mut own = vec![None; if n > 1 { n } else { 0 }];
            let mut known: Vec<(A::Of, Row<K, A>)> = Vec::new();
            for (t, k) in &definitions[m] {
                match t {
                    Term::Given(c) => known.push((*k, vec![(*c, one)])),
                    Term::Variable(v) => match position.get(v) {
                        Some(&p) if n > 1 => {
                            let minus = a.neg(*k);
                            add(a, &mut own[p], minus);
                        }
                        _ => known.push((*k, rows[*v].clone())),
                    },
                }
            }
            if n > 1 {
                add(a, &mut own[position[&m]], one);
            }
            matrix.push(own);
            right.push(combine(a, known.iter().map(|(k, r)| (*k, r))));
        }
        if n == 1 {
            rows[members[0]] = right.swap_remove(0);
            continue;
        }
        let Some(solved) = (n <= MAX_LOOP).then(|| eliminate(a, matrix, right)).flatten() else {
            let mut bonds: Vec<BondId> = members.iter().map(|m| BondId((m / 4) as u32)).collect();
            bonds.sort_unstable();
            bonds.dedup();
            return Err(Undetermined(bonds));
        };
        for (m, row) in members.iter().zip(solved) {
            rows[*m] = row;
        }
    }
    Ok(rows)
}

/// Gauss-Jordan elimination with rows on the right side; `None` if singular.
fn eliminate<K: Copy + Ord + Hash, A: Coefficients>(
    a: &mut A,
    mut matrix: Vec<Vec<Option<A::Of>>>,
    mut right: Vec<Row<K, A>>,
) -> Option<Vec<Row<K, A>>> {
    let n = matrix.len();
    let one = a.int(1);
    let size = |a: &A, x: Option<A::Of>| x.map_or(0.0, |x| a.size(x).1);
    // What each entry would be if nothing in its sum cancelled.
    let mut terms: Vec<Vec<f64>> = matrix.iter().map(|row| row.iter().map(|x| size(a, *x)).collect()).collect();
    for k in 0..n {
        let is_there = |i: usize, x: f64| x > 0.0 && x >= OPTIONS.rounding * terms[i][k];
        // A number before what may pass 0.
        let rank = |i: &usize| {
            let (known, size) = matrix[*i][k].map_or((false, 0.0), |x| a.size(x));
            (known && is_there(*i, size), size)
        };
        let order = |a: (bool, f64), b: (bool, f64)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1));
        let pivot = (k..n).max_by(|i, j| order(rank(i), rank(j)))?;
        let divisor = rank(&pivot).1;
        if !is_there(pivot, divisor) {
            return None;
        }
        matrix.swap(k, pivot);
        terms.swap(k, pivot);
        terms[k].iter_mut().for_each(|x| *x /= divisor);
        right.swap(k, pivot);
        let p = matrix[k][k]?;
        let inverse = a.div(one, p);
        for entry in matrix[k].iter_mut().flatten() {
            *entry = a.mul(*entry, inverse);
        }
        right[k] = combine(a, [(inverse, &right[k])]);
        for i in (0..n).filter(|i| *i != k) {
            let Some(factor) = matrix[i][k].filter(|f| !a.is_zero(*f)) else { continue };
            let minus = a.neg(factor);
            let part = size(a, Some(factor));
            for j in 0..n {
                terms[i][j] += part * terms[k][j];
                if let Some(x) = matrix[k][j] {
                    let t = a.mul(minus, x);
                    matrix[i][j] = Some(matrix[i][j].map_or(t, |y| a.sum(&[y, t])));
                }
            }
            right[i] = combine(a, [(one, &right[i]), (minus, &right[k])]);
        }
    }
    Some(right)
}
