//! `a sin(x)^2 + a cos(x)^2 = a`.

use super::{Expr, Node, Number, Pool};
use bond_runtime::ir::Unary;

const TWO: Number = Number::Ratio(2, 1);

impl Pool {
    /// A sum in which squares of sine and cosine with one factor are taken together; other expressions as they are.
    pub fn pythagoras(&mut self, e: Expr) -> Expr {
        let Node::Sum(constant, terms) = self.node(e).clone() else { return e };
        let mut terms: Vec<(Expr, Number)> = terms.to_vec();
        let mut i = 0;
        while i < terms.len() {
            match self.partner(&terms, i) {
                Some((j, rest)) => {
                    let k = terms[i].1;
                    terms.retain({
                        let gone = [terms[i].0, terms[j].0];
                        move |t| !gone.contains(&t.0)
                    });
                    terms.push((rest, k));
                    i = 0;
                }
                None => i += 1,
            }
        }
        let constant = self.numeral(constant);
        terms.push((constant, Number::Ratio(1, 1)));
        self.combine(&terms)
    }

    /// The term with the square of a sine where this one has that of its cosine, and what is left of both.
    fn partner(&mut self, terms: &[(Expr, Number)], at: usize) -> Option<(usize, Expr)> {
        let (term, k) = terms[at];
        let (c, factors) = match self.node(term).clone() {
            Node::Product(c, factors) => (c, factors.to_vec()),
            _ => return None,
        };
        for (i, &(base, n)) in factors.iter().enumerate() {
            let Node::Unary(Unary::Cos, x) = *self.node(base) else { continue };
            if n != TWO {
                continue;
            }
            let mut others = factors.clone();
            others.remove(i);
            let rest = self.powers(&others);
            let rest = self.scale(rest, c);
            let sine = self.unary(Unary::Sin, x);
            let square = self.powi(sine, 2);
            let wanted = self.mul(rest, square);
            if let Some(j) = terms.iter().position(|t| *t == (wanted, k)) {
                return Some((j, rest));
            }
        }
        None
    }
}
