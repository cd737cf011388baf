//! Storages. `C`: dq/dt = f, e = dH/dq. `I`: dp/dt = e, f = dH/dp.

use super::fields::Fields;
use crate::elaborate::{Elaborator, Typed, Unit, told};
use crate::expression::{Expr, Node, Number, Sign, Symbol};
use crate::model::{BondId, ElementId, Kind, Signal, Storage};
use crate::units::Dimension;
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;

/// Where an energy is looked at to see whether it has a lower bound.
struct Search {
    /// Powers of 2 up to which an energy may fall without end.
    powers: u32,
    /// Powers of 2 from one look at whether it has values to the next.
    stride: u32,
    /// The power of 2 of the state that has to be reached where it falls without end.
    far: u32,
    /// Halvings of the way from the start to a state, on which it has to have values.
    halvings: u32,
    /// Pairs of states with directions between them.
    pairs: usize,
}

const SEARCH: Search = Search { powers: 1000, stride: 32, far: 100, halvings: 256, pairs: 66 };

impl<'a> Elaborator<'a> {
    /// A storage's energy and initial state.
    pub(crate) fn storage(
        &mut self,
        id: ElementId,
        ast: &'a ast::Element,
        scope: usize,
        kind: Kind,
        bond: BondId,
    ) -> Option<Storage> {
        let c = kind == Kind::C;
        let (state_name, law_name) = if c { ("q", "e") } else { ("p", "f") };
        let (short, laws, others): (_, &[&str], &[&str]) = if c {
            ("compliance", &["compliance", "stiffness", "H", "e"], &["q0", "e0"])
        } else {
            ("inertia", &["inertia", "H", "f"], &["p0", "f0"])
        };
        let name = self.elements[id.at()].name.clone();
        let fields = Fields::read(self, ast, short, laws, others)?;
        let d = self.bond_domain(bond);
        let (effort, flow) = (Unit::effort(d), Unit::flow(d));
        let second = Unit::known(Dimension::SECOND);
        // Unit of the state, of the co-energy variable, and of their ratio.
        let (state_unit, co_unit) = if c { (flow.mul(&second), effort) } else { (effort.mul(&second), flow) };
        let state = self.signal(Signal::State(id));
        let x = self.pool.var(state);
        let local = Typed { expr: x, unit: state_unit.clone() };
        let mut radius = None;
        let mut by_law = |this: &mut Self, law: Expr, value: &'a ast::Expr| {
            let law = this.pool.beyond_dead_zones(law);
            let (h, within) = this.energy_of_law(law, state);
            radius = Some((within, value)).filter(|r| r.0.is_finite());
            (h, law)
        };
        let (energy, coenergy, linear) = if let Some(value) = fields.get(short).or_else(|| fields.get("stiffness")) {
            let stiff = fields.get(short).is_none();
            let typed = self.with_signals(value, scope)?;
            let needed = if stiff { co_unit.div(&state_unit) } else { state_unit.div(&co_unit) };
            let what = if stiff { "stiffness" } else { short };
            self.require((&typed.unit, value.span), needed, None, format!("the {what} of `{name}`"), 1);
            self.positive_constant(typed.expr, value, &name, what)?;
            let k = if stiff {
                typed.expr
            } else {
                let one = self.pool.int(1);
                self.pool.div(one, typed.expr)
            };
            self.own_states_only(k, &[state], value, &name)?;
            let co = self.pool.mul(k, x);
            // One that depends on the state itself is a law.
            if self.pool.contains(k, state) {
                let (h, law) = by_law(self, co, value);
                (h, law, None)
            } else {
                let half = self.pool.ratio(1, 2);
                let square = self.pool.powi(x, 2);
                (self.pool.product(&[half, k, square]), co, Some(k))
            }
        } else {
            let (field, energy_given) = if fields.get("H").is_some() { ("H", true) } else { (law_name, false) };
            let value = fields.get(field)?;
            self.locals.push((state_name.to_string(), local));
            let typed = self.with_signals(value, scope);
            self.locals.pop();
            let typed = typed?;
            let needed = if energy_given { self.energy_unit(bond) } else { co_unit.clone() };
            let what = if energy_given { "energy" } else { "law" };
            self.require((&typed.unit, value.span), needed, None, format!("the {what} of `{name}`"), 2);
            self.own_states_only(typed.expr, &[state], value, &name)?;
            self.sound(typed.expr, value, what, &name)?;
            let (h, co) = if energy_given {
                (typed.expr, self.pool.derivative(typed.expr, state))
            } else {
                by_law(self, typed.expr, value)
            };
            let linear = self
                .pool
                .linear(co, state)
                .filter(|(_, rest)| self.pool.is_zero(*rest))
                .map(|l| l.0)
                // A storage without energy only keeps count, as of an angle that a ratio depends on.
                .filter(|k| !self.pool.is_zero(*k));
            // An energy without a lower bound, as of a pendulum that stands, runs, and is no linear storage.
            let linear = linear.filter(|k| !self.pool.constant(*k).is_some_and(|k| k < 0.0 && k.is_finite()));
            if let Some(k) = linear {
                self.positive_constant(k, value, &name, "stiffness")?;
            }
            (h, co, linear)
        };
        self.energies_set(id, energy);
        let bounded = self.is_bounded(energy, &[state], &[0.0]);
        let mut storage =
            Storage { state, energy, coenergy, linear, initial: 0.0, explicit: false, bounded, massless: false };
        self.initial_state(&mut storage, &fields, (scope, &name), (c, state_unit, co_unit))?;
        if let Some((radius, law)) = radius
            && radius <= 2.0 * storage.initial.abs()
        {
            self.errors.push(
                Diagnostic::error("elaborate::law", law.span, format!("no energy was found whose derivative is this \
                law of `{name}`"))
                    .help(format!("give the energy itself, `H = ...` in `{state_name}`; or a law that can be integrated, in pieces by `if` on `{state_name}`")),
            );
            return None;
        }
        Some(storage)
    }

    /// Sets the initial state of a storage, which is stated as such or as the co-energy variable at the start.
    fn initial_state(
        &mut self,
        storage: &mut Storage,
        fields: &Fields<'a>,
        (scope, name): (usize, &str),
        (c, state_unit, co_unit): (bool, Unit, Unit),
    ) -> Option<()> {
        let start = [(if c { "q0" } else { "p0" }, true), (if c { "e0" } else { "f0" }, false)];
        let mut given: Vec<_> =
            start.iter().filter_map(|(f, is_state)| Some((fields.get(f)?, *is_state, *f))).collect();
        given.sort_by_key(|(value, ..)| value.span.start);
        if let [first, second, ..] = given[..] {
            self.errors.push(
                Diagnostic::error(
                    "elaborate::twice",
                    second.0.span,
                    format!("`{name}` starts twice, by `{}` and `{}`", first.2, second.2),
                )
                .label(first.0.span, "is the first")
                .help("keep one of them"),
            );
            return None;
        }
        if let Some((value, is_state, field)) = given.first().copied() {
            let typed = self.with_constants(value, scope)?;
            let needed = if is_state { state_unit } else { co_unit };
            self.require((&typed.unit, value.span), needed, None, format!("`{field}` of `{name}`"), 2);
            let number = self.number(&typed, value)?;
            self.finite(typed.expr, value, name)?;
            storage.explicit = true;
            storage.initial = if is_state { number } else { self.state_at(storage, number, value, name)? };
        }
        Some(())
    }

    /// Linear storages and resistors have positive values.
    pub(super) fn positive_constant(&mut self, v: Expr, ast: &ast::Expr, name: &str, what: &str) -> Option<()> {
        let Some(x) = self.pool.constant(v) else { return Some(()) };
        if x > 0.0 && x.is_finite() && (1.0 / x).is_finite() {
            return Some(());
        }
        let help = if x < 0.0 && ["resistance", "conductance"].contains(&what) {
            let own = name.rsplit('.').next().and_then(|n| n.split('[').next()).unwrap_or(name);
            format!("a resistor that gives power must say so: `active R:{own}`")
        } else {
            "give a positive number".to_string()
        };
        let how = if x > 0.0 {
            format!("the {what} of `{name}` is {}, whose inverse is too large or too small to compute with", told(x))
        } else if x < 0.0 {
            format!("negative {what}: that of `{name}` is {}", told(x))
        } else {
            format!("the {what} of `{name}` is {}, and must be positive", told(x))
        };
        self.errors.push(Diagnostic::error("elaborate::value", ast.span, how).help(help));
        None
    }

    /// No number of an energy or of a storage's law is infinite or none, as `acos(2)`.
    pub(super) fn sound(&mut self, e: Expr, ast: &ast::Expr, what: &str, name: &str) -> Option<()> {
        let is_off = |node: &Node| match node {
            Node::Sum(n, parts) | Node::Product(n, parts) => {
                !n.is_finite() || parts.iter().any(|part| !part.1.is_finite())
            }
            Node::Number(n) => !n.is_finite(),
            Node::Symbol(_) | Node::Power(..) | Node::Unary(..) | Node::Binary(..) | Node::Select(..) => false,
        };
        if !self.pool.any_node(e, &is_off) {
            return Some(());
        }
        let message = format!(
            "a number in the {what} of `{name}` is infinite or undefined, such as a root of a \
        negative number"
        );
        self.errors.push(
            Diagnostic::error("elaborate::value", ast.span, message)
                .help("every constant part of it must be a finite number"),
        );
        None
    }

    pub(super) fn own_states_only(&mut self, e: Expr, states: &[Symbol], ast: &ast::Expr, name: &str) -> Option<()> {
        let others: Vec<Symbol> = self.pool.symbols(e).into_iter().filter(|s| !states.contains(s)).collect();
        let Some(first) = others.first() else { return Some(()) };
        let other = self.pool.name(*first).to_string();
        self.errors.push(
            Diagnostic::error("elaborate::energy", ast.span, format!("the energy of `{name}` depends on `{other}`, through which power would flow without a bond"))
                .help("a storage's energy depends on its own state and on parameters; model the other influence as a port of a multiport field"),
        );
        None
    }

    /// Whether H has a lower bound, as far as can be seen: by its sign or, of several states, as a quadratic form; else
    /// by looking far out and near 0, where the way from the start has values: `n*log(n/V)` has some where both are
    /// negative, which no gas gets to.
    pub(super) fn is_bounded(&mut self, energy: Expr, states: &[Symbol], start: &[f64]) -> bool {
        if matches!(self.pool.sign(energy, &|_| Sign::Unknown), Sign::Zero | Sign::Positive | Sign::NonNegative) {
            return true;
        }
        let n = states.len();
        if let Some(bounded) = (n > 1).then(|| self.is_bounded_form(energy, states)).flatten() {
            return bounded;
        }
        // In a number of directions, of which those between two states are the first to show a coupling; of one state,
        // both ways.
        let only = |i: usize, x: f64, j: usize, y: f64| -> Vec<f64> {
            (0..n).map(|k| f64::from(u8::from(k == i)) * x + f64::from(u8::from(k == j)) * y).collect()
        };
        let mut directions: Vec<Vec<f64>> = (0..n).map(|i| only(i, 1.0, i, 0.0)).collect();
        if n > 1 {
            let many = |k: usize| (0..n).map(|i| ((k * 37 + i * 101) % 19) as f64 / 9.0 - 1.0).collect();
            directions.extend((n..40).map(many));
            let pairs = (0..n).flat_map(|i| (0..i).map(move |j| (i, j))).take(SEARCH.pairs);
            let ratios = [1.0, -1.0, 0.5, -0.5, 2.0, -2.0];
            directions.extend(pairs.flat_map(|(i, j)| ratios.map(|x| only(i, 1.0, j, x))));
        }
        let at = |x: f64, along: &[f64]| {
            self.pool.eval(energy, &|s| states.iter().position(|t| *t == s).map_or(f64::NAN, |i| x * along[i]))
        };
        let between = |part: f64, x: f64, along: &[f64]| {
            let place = |i: usize| start[i] + part * (x * along[i] - start[i]);
            self.pool.eval(energy, &|s| states.iter().position(|t| *t == s).map_or(f64::NAN, place))
        };
        let begins = n > 1 && !between(0.0, 0.0, &directions[0]).is_nan();
        let reaches = |x: f64, along: &[f64]| {
            !begins || (0..SEARCH.halvings).all(|k| !between(libm::exp2(-f64::from(k)), x, along).is_nan())
        };
        let least = |xs: &[f64]| {
            let all = xs.iter().flat_map(|x| directions.iter().flat_map(move |d| [(*x, d), (-*x, d)]));
            all.fold(f64::INFINITY, |least, (x, d)| {
                let h = at(x, d);
                if h < least && reaches(x, d) { h } else { least }
            })
        };
        // Where it falls without end, its fall from one power of 2 to the next does not shrink: -log(x) has falls that
        // are alike.
        let falls = |along: &[f64], sign: f64| {
            let level = |k: u32| at(sign * libm::exp2(f64::from(k)), along);
            // Up to where it has values: looked for in strides, the last of which is gone through.
            let Search { powers, stride, far, .. } = SEARCH;
            let end = (0..powers).step_by(stride as usize).find(|k| !level(*k).is_finite()).unwrap_or(powers);
            let last = end.saturating_sub(stride);
            let end = (last..end).find(|k| !level(*k).is_finite()).unwrap_or(end);
            let values: Vec<f64> = (end.saturating_sub(8)..end).map(level).collect();
            let drops: Vec<f64> = values.windows(2).map(|w| w[0] - w[1]).collect();
            let falls = drops.len() == 7 && drops[0] > 1e-9 * level(0).abs();
            falls
                && drops.windows(2).all(|w| w[1] >= 0.5 * w[0])
                && reaches(sign * libm::exp2(f64::from(end.saturating_sub(1).min(far))), along)
        };
        if directions.iter().any(|d| falls(d, 1.0) || falls(d, -1.0)) {
            return false;
        }
        let near = least(&[0.0, 1e-3, 1e-2, 0.1, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0, 300.0, 1e3]);
        let (small, far, farther) = (least(&[1e-30, 1e-12, 1e-8]), least(&[1e5, 1e8, 1e12]), least(&[1e30]));
        let deepest = near - 1e3 * (1.0 + near.abs());
        // What is far below may be all there is, as the heat of a body of 1 GJ/K at 0 K.
        let levels_off = farther > f64::NEG_INFINITY && farther >= far - 1e-9 * far.abs();
        near > f64::NEG_INFINITY && small >= deepest && (levels_off || far.min(farther) >= deepest)
    }

    /// Whether a quadratic energy has a lower bound, by the eigenvalues of its matrix; `None` of another one, and on
    /// the border between the two.
    fn is_bounded_form(&mut self, energy: Expr, states: &[Symbol]) -> Option<bool> {
        let (pairs, _, _) = self.pool.quadratic(energy, states)?;
        let zero = self.pool.zero();
        let mut rows = vec![vec![zero; states.len()]; states.len()];
        for (i, j, x) in pairs {
            let half = self.pool.scale(x, Number::HALF);
            rows[i][j] = self.pool.add(rows[i][j], half);
            rows[j][i] = self.pool.add(rows[j][i], half);
        }
        let least = self.scaled(&rows)?.symmetric_eigenvalues().min();
        (least.abs() > super::field::ROUNDING).then_some(least > 0.0)
    }

    /// The state at which the co-energy variable has a value.
    fn state_at(&mut self, s: &Storage, target: f64, ast: &ast::Expr, name: &str) -> Option<f64> {
        if let Some(k) = s.linear.and_then(|k| self.pool.constant(k)) {
            return Some(target / k);
        }
        let goal = self.pool.float(target);
        let off = self.pool.sub(s.coenergy, goal);
        // Towards the side of the target first; where the law has no value at 0, far from there.
        let side = if target < 0.0 { -1.0 } else { 1.0 };
        let starts = [0.0, 1e-3, -1e-3, 1.0, -1.0, 1e-9, 1e3, -1e3].map(|x| side * x);
        let none = |_| f64::NAN;
        let found = |x| self.pool.root(off, s.state, x, &none).filter(|x| self.pool.is_told(off, s.state, *x, &none));
        if let Some(x) = starts.into_iter().find_map(found) {
            return Some(x);
        }
        self.errors.push(
            Diagnostic::error(
                "elaborate::initial",
                ast.span,
                format!("no state of `{name}` was found that gives {target}"),
            )
            .help("give the state itself, `q0` or `p0`"),
        );
        None
    }
}
