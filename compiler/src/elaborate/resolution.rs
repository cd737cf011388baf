//! What the regions of computers read in steps, and hold late: resolutions of double bars, latencies of sampled blocks.

use super::{Elaborator, ScopeId, Unit, told};
use crate::model::BondId;
use crate::units::Dimension;
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;

impl<'a> Elaborator<'a> {
    /// Finds the resolutions that double bars give. A bond's unit is known by then, but not yet what is held there.
    pub(super) fn make_resolutions(&mut self) {
        for raw in 0..self.raw_bonds.len() {
            let (Some((value, scope)), Some(bond)) = (self.raw_bonds[raw].resolution, self.merged[raw]) else {
                continue;
            };
            let displacement = Unit::flow(self.bond_domain(bond)).mul(&Unit::known(Dimension::SECOND));
            let Some(typed) = self.as_constant(value, scope) else { continue };
            // What the elements say of the domain is believed before what an encoder says.
            self.require((&typed.unit, value.span), displacement, None, "the resolution of the double bar", 3);
            let Some(x) = self.number(&typed, value) else { continue };
            if !(x > 0.0 && x.is_finite()) {
                let message = format!("the resolution of the double bar is {}, and must be positive", told(x));
                let help = "give the step in which the motion is read, or leave it out where that is exact";
                self.errors.push(Diagnostic::error("elaborate::value", value.span, message).help(help));
                continue;
            }
            self.check_encoder(bond, value);
            self.bonds[bond.at()].resolution = Some(x);
        }
    }

    /// A motion is read in steps where a continuous region moves.
    fn check_encoder(&mut self, bond: BondId, value: &ast::Expr) {
        let bond = &self.bonds[bond.at()];
        let [tail, head] = [bond.tail, bond.head].map(|end| &self.elements[end.at()]);
        if bond.sampled && tail.sampling.is_some() && head.sampling.is_some() {
            let message = format!("`{}` and `{}` are both sampled, and exchange numbers", tail.name, head.name);
            let error = Diagnostic::error("elaborate::resolution", value.span, message).label(bond.span, "joins them");
            self.errors.push(error.help("give the resolution where a continuous region, or the outside, moves"));
        }
    }

    /// The latency of a sampled block, s.
    pub(super) fn latency(&mut self, latency: &'a ast::Expr, scope: ScopeId, period: f64) -> f64 {
        let Some(x) = self.constant(latency, scope, Dimension::SECOND, "the latency") else { return 0.0 };
        if (0.0..=period).contains(&x) {
            return x;
        }
        let (message, help) = if x < 0.0 {
            (format!("the latency is {} s, and nothing is held before it is known", told(x)), "give 0 s or more".into())
        } else {
            (
                format!("the latency is {} s, longer than the period of {} s", told(x), told(period)),
                format!("give at most {} s, or sample less often", told(period)),
            )
        };
        self.errors.push(Diagnostic::error("elaborate::latency", latency.span, message).help(help));
        0.0
    }
}
