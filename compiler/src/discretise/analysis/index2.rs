//! Index-2 constraints: branched laws, as those of ideal diodes and dry friction, between a storage and a moving
//! source. In the vertical branch the law is a constraint: the storage's state equals the source, as that of a
//! capacitor behind a conducting diode, or of a body that sticks to a belt.
//!
//! The law's other variable is then the rate that the source asks for (index 2: Brenan, Campbell and Petzold, 1996). A
//! symmetric method meets the constraint in the middle of each step. At the ends the state swings about the source by
//! the curvature of the source, and the law releases and engages in each step.

use crate::discretise::analysis::relay::{self, Piece};
use crate::discretise::cluster::{Cluster, Node};
use crate::expression::{Expr, Symbol};
use crate::model::Model;
use crate::structure::Form;
use nalgebra::{DMatrix, DVector};
use rustc_hash::FxHashMap;

/// More unknowns, pieces of a curve or combinations of pieces are not looked at.
const UNKNOWNS: usize = 24;
const PIECES: usize = 3;
const WAYS: usize = 729;
/// What is less than this part of the largest is rounding.
const NOTHING: f64 = 1e-9;
/// Instants at which sources are asked whether they move, as parts of the run.
const INSTANTS: [f64; 6] = [0.0, 0.618e-4, 0.618e-3, 0.618e-2, 0.0618, 0.618];

/// Whether the vertical branch of a law may constrain a storage to a moving source.
pub(crate) fn has_index2_constraint(c: &Cluster, model: &mut Model, form: &Form) -> bool {
    let bare: Vec<Node> = c.loop_nodes().into_iter().filter(|n| n.has_branches()).cloned().collect();
    if bare.is_empty() || c.loops.len() > UNKNOWNS {
        return false;
    }
    let pieces: Vec<Vec<Piece>> = bare.iter().map(|n| relay::pieces(c, model, n)).collect();
    let ways = pieces.iter().map(Vec::len).fold(1usize, usize::saturating_mul);
    if ways > WAYS || pieces.iter().any(|p| p.len() > PIECES) {
        return false;
    }
    let equations = Equations::new(c, model, form);
    (0..ways).any(|mut way| {
        let mut at = FxHashMap::default();
        for (node, pieces) in bare.iter().zip(&pieces) {
            at.insert(node.unknown(), pieces[way % pieces.len()].place);
            way /= pieces.len();
        }
        equations.constrain_states(c, model, &at)
    })
}

/// The slopes of what loops are solved for.
struct Equations {
    /// By equation and unknown.
    unknowns: Vec<Expr>,
    /// By equation and state.
    states: Vec<Expr>,
    /// By equation, time and inputs.
    moves: Vec<Expr>,
}

impl Equations {
    fn new(c: &Cluster, model: &mut Model, form: &Form) -> Self {
        let flat = c.flat_at_instant(&mut model.pool, form);
        let whole = c.residuals_in(&mut model.pool, &flat);
        let mut slopes = |by: &[Symbol]| -> Vec<Expr> {
            let pairs = whole.iter().flat_map(|e| by.iter().map(move |s| (*e, *s)));
            pairs.map(|(e, s)| model.pool.derivative(e, s)).collect()
        };
        let states: Vec<Symbol> = c.states.iter().map(|s| s.symbol).collect();
        let moves: Vec<Symbol> = c.time.into_iter().chain(c.inputs.iter().map(|i| i.1)).collect();
        Self { unknowns: slopes(&c.loops), states: slopes(&states), moves: slopes(&moves) }
    }

    /// Whether, on some pieces of the curves, the equations are rank-deficient in the unknowns and constrain states to
    /// what moves instead. Where they constrain what moves alone, no state can be on these pieces.
    fn constrain_states(&self, c: &Cluster, model: &Model, at: &FxHashMap<Symbol, f64>) -> bool {
        let n = c.loops.len();
        let start: FxHashMap<Symbol, f64> = c.states.iter().map(|s| (s.symbol, s.initial)).collect();
        let matrix = |list: &[Expr], t: f64| {
            let value = |s: Symbol| match at.get(&s).or_else(|| start.get(&s)) {
                Some(x) => *x,
                None if Some(s) == c.time => t,
                None => 0.0,
            };
            let values = model.pool.eval_all(list, &value);
            DMatrix::from_row_slice(n, list.len() / n, &values)
        };
        let mut unknowns = matrix(&self.unknowns, 0.0);
        let mut states = matrix(&self.states, 0.0);
        let mut moves: Vec<DMatrix<f64>> =
            INSTANTS.iter().map(|t| matrix(&self.moves, t * model.settings.end)).collect();
        if unknowns.iter().chain(&states).any(|x| !x.is_finite()) {
            return false;
        }
        for i in 0..n {
            let size = unknowns.row(i).amax();
            if size > 0.0 {
                unknowns.row_mut(i).unscale_mut(size);
                states.row_mut(i).unscale_mut(size);
                moves.iter_mut().for_each(|m| m.row_mut(i).unscale_mut(size));
            }
        }
        for mut column in unknowns.column_iter_mut() {
            let size = column.amax();
            if size > 0.0 {
                column.unscale_mut(size);
            }
        }
        // The combinations of equations in which no unknown is left.
        let open = without(&unknowns);
        if open.ncols() == 0 {
            return false;
        }
        let mut asked = open.tr_mul(&states);
        let rounding = NOTHING * states.amax();
        asked.iter_mut().filter(|x| x.abs() <= rounding).for_each(|x| *x = 0.0);
        moves.iter().filter(|m| m.iter().all(|x| x.is_finite())).any(|m| {
            let moved = open.tr_mul(m);
            let (most, least) = (m.amax(), NOTHING * m.amax());
            let alone = without(&asked).tr_mul(&moved);
            most > 0.0 && moved.amax() > least && alone.iter().all(|x| x.abs() <= least)
        })
    }
}

/// Columns that span the combinations of rows which are 0.
fn without(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let (n, m) = matrix.shape();
    // Square, so that all of the combinations are there.
    let mut square = DMatrix::zeros(n, n.max(m));
    square.columns_mut(0, m).copy_from(matrix);
    let svd = square.svd(true, false);
    let Some(left) = svd.u else { return DMatrix::zeros(n, 0) };
    let largest = svd.singular_values.amax();
    let columns: Vec<DVector<f64>> = (0..svd.singular_values.len())
        .filter(|i| svd.singular_values[*i] <= NOTHING * largest)
        .map(|i| left.column(i).into_owned())
        .collect();
    if columns.is_empty() { DMatrix::zeros(n, 0) } else { DMatrix::from_columns(&columns) }
}
