//! Steep laws of resistors: those whose slope is far larger at one place than at another, as that of a diode of two
//! lines, or of a contact that opens. What is steep makes much of the rounding of what it is given, so such a law is
//! solved for its argument where it rises the less so.
//!
//! Which of the two is less steep depends on the circuit. Beside a resistance Z, the law `e = r f` makes roundings
//! `r / Z` times as large, and `f = e / r` makes them `Z / r` times as large. So the law with the slopes `r_1` and
//! `r_2` is turned about where `r_1 r_2 > Z^2`.

use crate::elaborate::Elaborator;
use crate::expression::{Expr, Node, Symbol};
use crate::model::{Element, Law, Resistor, Variable};
use bond_runtime::ir::Binary;

/// How many times as steep a law is at one place as at another.
const STEEP: f64 = 1e3;

/// A product of resistances of one domain, and of how many.
#[derive(Clone, Copy, Default)]
struct Product {
    log: f64,
    count: f64,
}

impl Product {
    /// The square of their geometric mean. Where there are none, nothing says how large resistances are, and 0 has
    /// steep laws give flows.
    fn mean_square(self) -> f64 {
        if self.count > 0.0 { libm::exp(2.0 * self.log / self.count) } else { 0.0 }
    }
}

impl Elaborator<'_> {
    /// Solves steep laws for their arguments. How large resistances are is the geometric mean of those of the law's
    /// domain that are constant.
    pub(crate) fn turn_steep_laws(&mut self, laws: &mut [Option<Element>]) {
        let domains = self.domain_of.iter().max().map_or(0, |d| d + 1);
        let mut products = vec![Product::default(); domains];
        let mut domain_of = vec![None; laws.len()];
        for (bond, d) in self.bonds.iter().zip(&self.domain_of) {
            domain_of[bond.tail.at()] = Some(*d);
            domain_of[bond.head.at()] = Some(*d);
        }
        for (e, d) in laws.iter().zip(&domain_of) {
            let (Some(Element { law: Law::Resistor(r), .. }), Some(d)) = (e, *d) else { continue };
            let Some(k) = r.linear.and_then(|k| self.pool.constant(k)).filter(|k| *k > 0.0 && k.is_finite()) else {
                continue;
            };
            products[d].log += if r.gives == Variable::Effort { libm::log(k) } else { -libm::log(k) };
            products[d].count += 1.0;
        }
        for (e, d) in laws.iter_mut().zip(domain_of) {
            let (Some(Element { law: Law::Resistor(r), active: false, field: None, .. }), Some(d)) = (e, d) else {
                continue;
            };
            if r.curve.is_some() {
                continue;
            }
            let square = products[d].mean_square();
            let square = if r.gives == Variable::Effort { square } else { 1.0 / square };
            if let Some(output) = self.turned(r, square) {
                r.gives = r.gives.other();
                r.output = output;
                r.linear = r.linear.and_then(|_| self.pool.linear(output, r.argument)).map(|l| l.0);
            }
        }
    }

    /// A law solved for its argument, where it is steep and its slopes have a product above `square`.
    fn turned(&mut self, r: &Resistor, square: f64) -> Option<Expr> {
        match r.linear {
            Some(k) => self.turned_switch(k, r.argument, square),
            None => self.turned_lines(r.output, r.argument, square),
        }
    }

    /// The same of a resistance that is switched from one number to another.
    fn turned_switch(&mut self, k: Expr, argument: Symbol, square: f64) -> Option<Expr> {
        let (mut stack, mut least, mut most) = (vec![k], f64::INFINITY, 0.0f64);
        while let Some(e) = stack.pop() {
            match (self.pool.constant(e), self.pool.node(e)) {
                (Some(k), _) => (least, most) = (least.min(k), most.max(k)),
                (None, Node::Select(_, a, b)) => stack.extend([*a, *b]),
                (None, _) => return None,
            }
        }
        let x = self.pool.var(argument);
        (least > 0.0 && is_steep(least, most, square)).then(|| self.pool.div(x, k))
    }

    /// The same of a law that is one line to each side of rest.
    fn turned_lines(&mut self, law: Expr, argument: Symbol, square: f64) -> Option<Expr> {
        if self.pool.symbols(law).iter().any(|s| *s != argument) {
            return None;
        }
        let (x, zero) = (self.pool.var(argument), self.pool.zero());
        let pieces = self.pool.by_pieces(law, argument)?;
        let Node::Select(test, below, above) = *self.pool.node(pieces) else { return None };
        if *self.pool.node(test) != Node::Binary(Binary::Lt, x, zero) {
            return None;
        }
        let mut slope = |piece: Expr| {
            let (k, rest) = self.pool.linear(piece, argument)?;
            let size = self.pool.constant(k).filter(|k| *k > 0.0 && k.is_finite())?;
            self.pool.is_zero(rest).then_some((k, size))
        };
        let (above, below) = (slope(above)?, slope(below)?);
        if !is_steep(above.1.min(below.1), above.1.max(below.1), square) {
            return None;
        }
        let test = self.pool.binary(Binary::Lt, zero, x);
        let [above, below] = [above, below].map(|k| self.pool.div(x, k.0));
        Some(self.pool.select(test, above, below))
    }
}

/// Whether a law with these slopes, the least and the most, is steep, and the less so when it is solved for its
/// argument.
fn is_steep(least: f64, most: f64, square: f64) -> bool {
    most > STEEP * least && most * least > square
}

#[cfg(test)]
mod tests {
    use crate::elaborate::NoFiles;
    use crate::model::{Law, Variable};
    use bond_grammar::source::Sources;

    /// What the switch of a scene gives.
    fn gives(switch: &str, others: &str) -> Variable {
        let text = format!("model M {{ Se:u = 1 V  R:sw {switch}  C:c = 1 uF  {others} u -> 1:i -> sw, c }}");
        let mut sources = Sources::new();
        let id = sources.add("model.bond", text);
        let compiled = crate::compile(&mut sources, id, &mut NoFiles, &crate::Options::default()).expect("it compiles");
        let sw = compiled.stages.model.elements.iter().find(|e| e.name == "sw").expect("the switch");
        match &sw.law {
            Law::Resistor(r) => r.gives,
            other => panic!("{other:?}"),
        }
    }

    /// A switch of 1 Ohm and 1 MOhm is steep beside 1 kOhm either way; beside less it gives a flow, beside more an
    /// effort, however it is written.
    #[test]
    fn steep_laws_go_with_the_circuit() {
        let written = ["= if t < 1 ms then 1 Ohm else 1 MOhm", "{ conductance = if t < 1 ms then 1 S else 1 uS }"];
        for switch in written {
            assert_eq!(gives(switch, "R:r = 900 Ohm  i -> r"), Variable::Flow);
            assert_eq!(gives(switch, "R:r = 1100 Ohm  i -> r"), Variable::Effort);
            // The mean counts: 10 Ohm and 100 kOhm are as 1 kOhm.
            assert_eq!(gives(switch, "R:r = 10 Ohm  R:s = 90 kOhm  i -> r, s"), Variable::Flow);
            assert_eq!(gives(switch, "R:r = 10 Ohm  R:s = 110 kOhm  i -> r, s"), Variable::Effort);
            assert_eq!(gives(switch, ""), Variable::Flow);
        }
        // What is less steep stays as it is written.
        assert_eq!(gives("= if t < 1 ms then 1 kOhm else 900 kOhm", ""), Variable::Effort);
    }
}
