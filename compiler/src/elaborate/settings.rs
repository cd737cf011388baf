//! `simulate`, `expect` and `--set`.

use super::{Elaborator, Entity, Mode, ScopeId, told};
use crate::Options;
use crate::model::{BondId, ElementId, Expectation, ExpectationKind, Kind, Meeting, OnePort, Settings};
use crate::units::Dimension;
use bond_grammar::ast::{self, ExprKind};
use bond_grammar::diagnostic::Diagnostic;

impl<'a> Elaborator<'a> {
    /// Keeps the values of `--set`, so that each parameter finds its own when it is declared.
    pub(super) fn pending_overrides(&mut self, options: &Options) {
        self.overrides = options.set.iter().map(|(p, x, d)| (p.clone(), (*x, *d))).collect();
    }

    pub(super) fn make_settings(&mut self) -> Settings {
        let mut settings = Settings::default();
        let all = std::mem::take(&mut self.simulate);
        if let [first, second, ..] = &all[..]
            && let (Some(a), Some(b)) = (first.0.first(), second.0.first())
        {
            self.errors.push(
                Diagnostic::error("elaborate::twice", b.span, "there are two `simulate` blocks")
                    .label(a.span, "is in the first")
                    .help("put all settings into one"),
            );
        }
        for (fields, scope) in all {
            for (i, field) in fields.iter().enumerate() {
                let name = &field.name();
                if let Some(first) = fields[..i].iter().find(|f| f.name() == *name) {
                    self.errors.push(
                        Diagnostic::error("elaborate::twice", field.span, format!("`{name}` is set twice"))
                            .label(first.span, "is the first")
                            .help("keep one"),
                    );
                    continue;
                }
                match name.as_str() {
                    "stop" => settings.stop = self.positive(&field.value, scope, "stop"),
                    "step" => {
                        settings.step = self.positive(&field.value, scope, "step");
                        settings.step_at = Some(field.span);
                    }
                    "every" => {
                        settings.every = self.positive(&field.value, scope, "every");
                        settings.every_at = Some(field.span);
                    }
                    "tolerance" => {
                        settings.tolerance =
                            self.constant(&field.value, scope, Dimension::DIMENSIONLESS, "the tolerance");
                        if settings.tolerance.is_some_and(|t| !(1e-14..1.0).contains(&t)) {
                            self.errors.push(
                                Diagnostic::error(
                                    "elaborate::simulate",
                                    field.value.span,
                                    "the tolerance must lie between 1e-14, which is rounding, and 1",
                                )
                                .help("such as `tolerance = 1e-6`"),
                            );
                        }
                    }
                    "method" => match &field.value.kind {
                        ExprKind::Path(p) if p.segments.len() == 1 && p.segments[0].index.is_empty() => {
                            settings.method = Some((p.segments[0].name.text.clone(), p.span));
                        }
                        _ => {
                            let e = Diagnostic::error("elaborate::simulate", field.value.span, "the method is a name")
                                .help("such as `method = gonzalez`");
                            self.errors.push(e);
                        }
                    },
                    _ => {
                        let known = ["stop", "step", "method", "tolerance", "every"];
                        let mut e = Diagnostic::error(
                            "elaborate::simulate",
                            field.span,
                            format!("`simulate` has no setting `{name}`"),
                        );
                        e = match super::meant(name, &known) {
                            Some(n) => e.help(format!("did you mean `{n}`?")),
                            None => e.help(format!("the settings are {}", known.join(", "))),
                        };
                        self.errors.push(e);
                    }
                }
            }
        }
        settings
    }

    fn positive(&mut self, e: &'a ast::Expr, scope: ScopeId, name: &str) -> Option<f64> {
        let x = self.constant(e, scope, Dimension::SECOND, &format!("`{name}`"))?;
        if x > 0.0 && x.is_finite() {
            return Some(x);
        }
        self.errors.push(
            Diagnostic::error(
                "elaborate::simulate",
                e.span,
                format!("`{name}` is {} s, and must be positive", told(x)),
            )
            .help(format!("such as `{name} = 10 s`")),
        );
        None
    }

    pub(super) fn make_expectations(&mut self) -> Vec<Expectation> {
        let list = std::mem::take(&mut self.expects);
        list.into_iter()
            .filter_map(|(expect, span, scope)| {
                let text = self.sources.slice(span).split_whitespace().collect::<Vec<_>>().join(" ");
                let kind = match expect {
                    ast::Expect::Passive => ExpectationKind::Passive,
                    ast::Expect::PassiveAt(path) => ExpectationKind::PassiveAt(self.meeting(path, scope)?),
                    ast::Expect::At { value, time, target, tolerance: within } => {
                        let (value_, extremes) = self.expected(value, scope)?;
                        if !extremes.is_empty() {
                            self.wrong::<()>(
                                "elaborate::expect",
                                value.span,
                                "an extreme is over the whole run, not at an instant".to_string(),
                                "remove `at`, and compare it: `expect max(abs(x)) < 0.2 m`",
                            )?;
                        }
                        let time = self.constant(time, scope, Dimension::SECOND, "the instant")?;
                        if time < 0.0 || !time.is_finite() {
                            self.errors.push(
                                Diagnostic::error(
                                    "elaborate::expect",
                                    span,
                                    format!("there is no instant {} s", told(time)),
                                )
                                .help("the run starts at 0 s"),
                            );
                            return None;
                        }
                        let mut known = |e: &'a ast::Expr, about: &str| {
                            self.mode = Mode::Constant;
                            let typed = self.express(e, scope)?;
                            self.require((&typed.unit, e.span), value_.unit.clone(), Some(value.span), about, 3);
                            self.number(&typed, e)
                        };
                        let (target, tolerance) =
                            (known(target, "the expected value")?, known(within, "the tolerance")?);
                        if tolerance.is_nan() || tolerance < 0.0 {
                            self.wrong::<()>(
                                "elaborate::expect",
                                within.span,
                                format!("the tolerance is {}, and must not be negative", told(tolerance)),
                                "it is the allowed deviation to either side, as in `within 1e-6 m`",
                            )?;
                        }
                        ExpectationKind::At { value: value_.expr, time, target, tolerance }
                    }
                    ast::Expect::Holds(e) => {
                        if let Some(fix) = self.at_instant(e, scope) {
                            self.wrong::<()>("elaborate::expect", e.span, "a value has no arguments".into(), &fix)?;
                        }
                        let (typed, extremes) = self.expected(e, scope)?;
                        if !is_condition(e) {
                            self.errors.push(
                                Diagnostic::error("elaborate::expect", e.span, "this is a value, not a condition")
                                    .help("compare it, as in `expect max(abs(x)) < 0.2 m`"),
                            );
                            return None;
                        }
                        ExpectationKind::Holds { condition: typed.expr, extremes }
                    }
                };
                Some(Expectation { text, kind, span })
            })
            .collect()
    }

    /// Where a path says that something drives the scene: a source, an open port or a double bar, by the name of its
    /// bond or of an element that has no other.
    fn meeting(&mut self, path: &'a ast::Path, scope: ScopeId) -> Option<Meeting> {
        let drives = |this: &Self, id: ElementId| {
            matches!(this.elements[id.at()].kind, Kind::OnePort(OnePort::Source(_) | OnePort::Open))
        };
        let of_bond = |this: &Self, b: BondId| {
            let bond = &this.bonds[b.at()];
            match [bond.tail, bond.head].into_iter().find(|end| drives(this, *end)) {
                _ if bond.sampled => Some(Meeting::Bar(b)),
                end => end.map(Meeting::Element),
            }
        };
        let (_, name, entity, declared) = self.walk(path, scope)?;
        let found = match entity {
            Entity::Missing => return None,
            Entity::Element(id) if drives(self, id) => Some(Meeting::Element(id)),
            Entity::Element(id) => match self.bonds_of.get(id.at()).map(Vec::as_slice) {
                Some(&[bond]) => of_bond(self, bond),
                _ => None,
            },
            Entity::Bond(b) => self.merged.get(b).copied().flatten().and_then(|b| of_bond(self, b)),
            Entity::Instance(_)
            | Entity::Port(_)
            | Entity::Field(_)
            | Entity::Bundle(_)
            | Entity::Param(_)
            | Entity::Let(_)
            | Entity::Function(_)
            | Entity::Input(_)
            | Entity::Memory(_) => None,
        };
        if found.is_none() {
            let what = format!("`{name}` is no source, open port or double bar: nothing drives the scene there");
            let help = "name a source, such as `Se:hand`, an open port, or the bond of a double bar, \
                `wall -[bar]||> v`";
            self.errors.push(
                Diagnostic::error("elaborate::expect", path.span, what).label(declared, "is declared here").help(help),
            );
        }
        found
    }

    /// The fix for a value at an instant that is written as a call: `y(5 s) == 0.3 m`.
    fn at_instant(&self, e: &ast::Expr, scope: ScopeId) -> Option<String> {
        let ExprKind::Binary(ast::Binary::Eq, call, target) = &e.kind else { return None };
        let ExprKind::Call(name, args) = &call.kind else { return None };
        let names = &self.instances[self.scopes[scope].instance].names;
        let (Some((Entity::Let(_), _)), [at]) = (names.get(&name.text), &args[..]) else { return None };
        let unit = match &target.kind {
            ExprKind::Number { unit: Some(unit), .. } => format!(" {}", self.sources.slice(unit.span)),
            _ => String::new(),
        };
        let [at, target] = [at.span, target.span].map(|span| self.sources.slice(span));
        Some(format!(
            "write `expect {} at {at} = {target} within 1e-3{unit}`, with the allowed deviation after `within`",
            name.text
        ))
    }
}

/// Whether an expression is a comparison, or comparisons joined.
fn is_condition(e: &ast::Expr) -> bool {
    use ast::Binary as B;
    match &e.kind {
        ExprKind::Bool(_) => true,
        ExprKind::Paren(e) | ExprKind::Unary(ast::Unary::Not, e) => is_condition(e),
        ExprKind::Binary(op, _, _) => matches!(op, B::Lt | B::Le | B::Gt | B::Ge | B::Eq | B::Ne | B::And | B::Or),
        ExprKind::If(_, a, b) => is_condition(a) && is_condition(b),
        ExprKind::Number { .. }
        | ExprKind::Path(_)
        | ExprKind::Unary(ast::Unary::Neg, _)
        | ExprKind::Call(..)
        | ExprKind::List(_)
        | ExprKind::Range(..) => false,
    }
}
