//! Energies from laws.

use crate::elaborate::Elaborator;
use crate::expression::{Expr, Node, Pool, Symbol};
use bond_runtime::ir::{Binary, Unary};

/// How far the slope of a rule may be off the law, of the largest value of the law up to there.
const EXACT: f64 = 1e-12;

/// The law is looked at from one to the other power of two.
const OCTAVES: std::ops::Range<i32> = -100..100;

impl Elaborator<'_> {
    /// H with dH/dx the law, in closed form where there is one; and how far from 0 it is that. Else the rule of Gauss
    /// and Legendre with 20 nodes over [0, x], as far as its slope is seen to be the law; beyond that it is no number,
    /// so that a run stops there and does not go on with another energy.
    pub(super) fn energy_of_law(&mut self, law: Expr, x: Symbol) -> (Expr, f64) {
        if let Some(h) = self.pool.antiderivative(law, x) {
            return (h, f64::INFINITY);
        }
        let pool = &mut self.pool;
        let radius = radius(pool, law, x);
        let at = pool.var(x);
        let mut terms = Vec::new();
        for (s, weight) in rule() {
            let (s, weight) = (pool.float(s), pool.float(weight));
            let place = [(x, pool.mul(s, at))].into_iter().collect();
            let value = pool.substitute(law, &place);
            terms.push(pool.product(&[weight, at, value]));
        }
        let sum = pool.sum(&terms);
        let closed = pool.cancelling_antiderivative(law, x);
        // A form that cancels near 0 is taken from where both agree.
        let joint = closed.and_then(|h| Some((h, joint(pool, (h, sum), radius)?)));
        let (beyond, limit) = match joint {
            Some((h, 0.0)) => return (h, f64::INFINITY),
            Some((h, limit)) => (h, limit),
            None => (pool.float(f64::NAN), radius),
        };
        let (size, edge) = (pool.unary(Unary::Abs, at), pool.float(limit));
        let inside = pool.binary(Binary::Le, size, edge);
        (pool.select(inside, sum, beyond), if joint.is_some() { f64::INFINITY } else { radius })
    }
}

/// Where a closed form takes over from the rule: 0 where there is no rule, None where they nowhere agree.
fn joint(pool: &Pool, (closed, rule): (Expr, Expr), radius: f64) -> Option<f64> {
    if radius == 0.0 {
        return Some(0.0);
    }
    [0.25, 0.5, 1.0].map(|part| part * radius).into_iter().find(|place| {
        [*place, -place].iter().all(|x| {
            let values = pool.eval_all(&[closed, rule], &|_| *x);
            values[1].is_nan() || (values[0] - values[1]).abs() <= EXACT * values[1].abs()
        })
    })
}

/// How far from 0 the slope of the rule is the law.
fn radius(pool: &mut Pool, law: Expr, x: Symbol) -> f64 {
    let slope = pool.derivative(law, x);
    let mut places: Vec<f64> =
        OCTAVES.flat_map(|k| [1.0, 1.25, 1.5, 1.75].map(|s| s * libm::exp2(f64::from(k)))).collect();
    let turns: Vec<f64> = turns(pool, law, x).into_iter().map(f64::abs).collect();
    let first = turns.iter().copied().filter(|t| *t > 0.0).fold(f64::INFINITY, f64::min);
    places.extend(turns);
    places.sort_by(f64::total_cmp);
    let (mut radius, mut size) = (0.0, 0.0f64);
    for place in places {
        for x in [place, -place] {
            let value = pool.eval(law, &|_| x);
            size = size.max(value.abs());
            let parts = rule().map(|(s, weight)| {
                let at = pool.eval_all(&[law, slope], &|_| s * x);
                weight * (at[0] + s * x * at[1])
            });
            // Where the law itself is no number nothing is claimed.
            let close = (parts.sum::<f64>() - value).abs() <= EXACT * size || value.is_nan();
            if !close || value.is_infinite() {
                // Far from all that the law does, its own rounding ends it: nothing of it is reached.
                return if first.is_finite() && radius < 1e-3 * first { 0.0 } else { radius };
            }
        }
        radius = place;
    }
    radius
}

/// Where the argument of a function in the law is 0, and a little around: there a law may turn within a short way.
fn turns(pool: &mut Pool, law: Expr, x: Symbol) -> Vec<f64> {
    let zero = pool.zero();
    let mut places = Vec::new();
    for node in pool.dependents(law, &|s| s == x) {
        let arguments: Vec<Expr> = match pool.node(node) {
            Node::Unary(_, u) | Node::Power(u, _) => vec![*u],
            Node::Product(_, factors) => factors.iter().map(|f| f.0).collect(),
            Node::Number(_) | Node::Symbol(_) | Node::Sum(..) | Node::Binary(..) | Node::Select(..) => continue,
        };
        for u in arguments {
            let slope = pool.derivative(u, x);
            for root in pool.places(u, zero, x).unwrap_or_default() {
                let Some(root) = pool.constant(root).filter(|r| r.is_finite()) else { continue };
                let width = 1.0 / pool.eval(slope, &|_| root).abs();
                let near = [0.0, 0.25, 0.5, 1.0, 2.0, 4.0].map(|s| s * width);
                places.extend(near.iter().flat_map(|w| [root - w, root + w]).filter(|p| p.is_finite()));
            }
        }
    }
    places
}

/// Nodes and weights on [0, 1].
fn rule() -> impl Iterator<Item = (f64, f64)> {
    GAUSS_20.iter().flat_map(|(node, weight)| [0.5 + 0.5 * node, 0.5 - 0.5 * node].map(|s| (s, 0.5 * weight)))
}

/// Nodes (the positive half) and weights of the Gauss-Legendre rule of 20 points on [-1, 1] (Abramowitz and Stegun,
/// table 25.4).
const GAUSS_20: [(f64, f64); 10] = [
    (0.076_526_521_133_497_33, 0.152_753_387_130_725_85),
    (0.227_785_851_141_645_08, 0.149_172_986_472_603_75),
    (0.373_706_088_715_419_56, 0.142_096_109_318_382_05),
    (0.510_867_001_950_827_1, 0.131_688_638_449_176_63),
    (0.636_053_680_726_515, 0.118_194_531_961_518_42),
    (0.746_331_906_460_150_8, 0.101_930_119_817_240_44),
    (0.839_116_971_822_218_8, 0.083_276_741_576_704_75),
    (0.912_234_428_251_326, 0.062_672_048_334_109_06),
    (0.963_971_927_277_913_8, 0.040_601_429_800_386_94),
    (0.993_128_599_185_094_9, 0.017_614_007_139_152_118),
];
