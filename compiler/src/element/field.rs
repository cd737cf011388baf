//! Multiport fields. Storages: one H of all states, each port's co-energy variable its derivative, so that the field is
//! reciprocal by construction. Resistors: a matrix, whose symmetric part must not give power, or a law a port.

use super::fields::Fields;
use crate::elaborate::{Elaborator, Typed, Unit};
use crate::expression::{Expr, Pool, Symbol};
use crate::model::{BondId, ElementId, Kind, Law, Resistor, Signal, Storage, Variable};
use crate::structure::inverse;
use crate::units::Dimension;
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;
use nalgebra::DMatrix;

/// Largest part of a matrix by which its symmetric part may be off, or below 0.
pub(super) const ROUNDING: f64 = 1e-12;

impl<'a> Elaborator<'a> {
    /// The law of one port of a field. What is wrong with the field is said with its first port.
    pub(crate) fn field_law(&mut self, id: ElementId, field: usize, scope: usize) -> Option<Law> {
        let f = &self.fields[field];
        let (ast, members) = (f.ast, f.members.clone());
        let place = members.iter().position(|m| *m == id)?;
        let bonds: Vec<BondId> = members.iter().map(|m| self.only_bond(*m)).collect::<Option<_>>()?;
        let (errors, asked) = (self.errors.len(), self.equations.len());
        // A field is of several domains: it says none of them by itself.
        let owner = self.owner.take();
        let law = match ast.kind.text.as_str() {
            "R" => self.resistor_field(ast, scope, field, &bonds).map(|mut l| Law::Resistor(l.swap_remove(place))),
            "TL" => self.line_laws(ast, scope, field, &bonds).map(|mut l| Law::Resistor(l.swap_remove(place))),
            "RS" => self.entropy_source(ast, scope, field, &bonds).map(|mut l| Law::Resistor(l.swap_remove(place))),
            _ => self.storage_field(ast, scope, field, &bonds).map(|mut l| Law::Storage(l.swap_remove(place))),
        };
        self.owner = owner;
        if place > 0 {
            self.errors.truncate(errors);
            self.equations.truncate(asked);
        }
        law
    }

    fn kind_of(&self, id: ElementId) -> Kind {
        self.elements[id.at()].kind
    }

    /// Units of a port's state and co-energy variable.
    fn state_units(&self, kind: Kind, bond: BondId) -> (Unit, Unit) {
        let d = self.bond_domain(bond);
        let (effort, flow) = (Unit::effort(d), Unit::flow(d));
        let second = Unit::known(Dimension::SECOND);
        if kind == Kind::C { (flow.mul(&second), effort) } else { (effort.mul(&second), flow) }
    }

    fn storage_field(
        &mut self,
        ast: &'a ast::Element,
        scope: usize,
        field: usize,
        bonds: &[BondId],
    ) -> Option<Vec<Storage>> {
        let (members, ports) = (self.fields[field].members.clone(), self.fields[field].ports.clone());
        let name = ast.name.text.clone();
        let starts: Vec<String> = ports.iter().map(|p| format!("{p}_0")).collect();
        let others: Vec<&str> = starts.iter().map(String::as_str).collect();
        let laws: &[&str] = match ast.kind.text.as_str() {
            "C" => &["compliance", "stiffness", "H"],
            "I" => &["inertia", "H"],
            _ => &["H"],
        };
        let fields = Fields::read(self, ast, laws[0], laws, &others)?;
        let symbols: Vec<Symbol> = members.iter().map(|m| self.signal(Signal::State(*m))).collect();
        let units: Vec<(Unit, Unit)> =
            members.iter().zip(bonds).map(|(m, b)| self.state_units(self.kind_of(*m), *b)).collect();
        let energy = if let Some(value) = fields.get("H") {
            let before = self.locals.len();
            for ((p, s), u) in ports.iter().zip(&symbols).zip(&units) {
                let expr = self.pool.var(*s);
                self.locals.push((p.clone(), Typed { expr, unit: u.0.clone() }));
            }
            let typed = self.with_signals(value, scope);
            self.locals.truncate(before);
            let typed = typed?;
            for (i, b) in bonds.iter().enumerate() {
                let needed = self.energy_unit(*b);
                let found = if i == 0 { typed.unit.clone() } else { self.energy_unit(bonds[0]) };
                let about = if i == 0 { "the energy of" } else { "the power on the ports of" };
                self.require((&found, value.span), needed, None, format!("{about} `{name}`"), 2);
            }
            self.own_states_only(typed.expr, &symbols, value, &name)?;
            self.sound(typed.expr, value, "energy", &name)?;
            typed.expr
        } else {
            let short = laws[0];
            let stiff = fields.get("stiffness").is_some();
            let value = fields.get(short).or_else(|| fields.get("stiffness"))?;
            let what = if stiff { "stiffness" } else { short };
            let entry = |i: usize, j: usize| {
                let (state, co) = (&units[i].0, &units[j].1);
                if stiff { units[i].1.div(&units[j].0) } else { state.div(co) }
            };
            let m = self.square(value, scope, ports.len(), &format!("the {what} of `{name}`"), &entry)?;
            self.symmetric_positive(&m, value, &name, what)?;
            let k = if stiff { m } else { inverse(&mut self.pool, &m)? };
            self.quadratic(&k, &symbols)
        };
        let mut list: Vec<Storage> = Vec::new();
        for (i, (m, s)) in members.iter().zip(&symbols).enumerate() {
            self.energies_set(*m, energy);
            let coenergy = self.pool.derivative(energy, *s);
            let given = fields.get(&starts[i]);
            let mut initial = 0.0;
            if let Some(value) = given {
                let typed = self.with_constants(value, scope)?;
                let about = format!("`{}` of `{name}`", starts[i]);
                self.require((&typed.unit, value.span), units[i].0.clone(), None, about, 2);
                initial = self.number(&typed, value)?;
                self.finite(typed.expr, value, &name)?;
            }
            list.push(Storage {
                state: *s,
                energy,
                coenergy,
                linear: None,
                initial,
                explicit: given.is_some(),
                bounded: false,
                massless: false,
            });
        }
        let start: Vec<f64> = list.iter().map(|s| s.initial).collect();
        let bounded = self.is_bounded(energy, &symbols, &start);
        list.iter_mut().for_each(|s| s.bounded = bounded);
        Some(list)
    }

    fn resistor_field(
        &mut self,
        ast: &'a ast::Element,
        scope: usize,
        field: usize,
        bonds: &[BondId],
    ) -> Option<Vec<Resistor>> {
        let (members, ports) = (self.fields[field].members.clone(), self.fields[field].ports.clone());
        let n = members.len();
        let braces = ast.fields.iter().flat_map(|f| &f.0).any(|f| f.path.len() == 2);
        if braces {
            return self.resistor_laws(ast, scope, field, bonds);
        }
        let name = ast.name.text.clone();
        let fields = Fields::read(self, ast, "resistance", &["resistance", "conductance"], &[])?;
        let resistance = fields.get("resistance").is_some();
        let value = fields.get("resistance").or_else(|| fields.get("conductance"))?;
        let (what, gives) = if resistance { ("resistance", Variable::Effort) } else { ("conductance", Variable::Flow) };
        let domain = |this: &Self, i: usize| this.bond_domain(bonds[i]);
        let domains: Vec<usize> = (0..n).map(|i| domain(self, i)).collect();
        let entry = |i: usize, j: usize| match gives {
            Variable::Effort => Unit::effort(domains[i]).div(&Unit::flow(domains[j])),
            Variable::Flow => Unit::flow(domains[i]).div(&Unit::effort(domains[j])),
        };
        let m = self.square(value, scope, n, &format!("the {what} of `{name}`"), &entry)?;
        let verdict = self.dissipates(&m);
        if verdict == Some(false) && !ast.active {
            self.errors.push(
                Diagnostic::error(
                    "elaborate::law",
                    value.span,
                    format!(
                        "the {what} matrix of `{name}` gives power: its symmetric part is not positive semi-definite"
                    ),
                )
                .help(format!(
                    "correct the matrix; one that gives power must say so: `active R({}):{name}`",
                    ports.join(", ")
                )),
            );
            return None;
        }
        let arguments: Vec<Symbol> = members.iter().map(|m| self.argument(*m)).collect();
        let mut list = Vec::new();
        for (i, row) in m.into_iter().enumerate() {
            let terms: Vec<Expr> = row
                .iter()
                .zip(&arguments)
                .map(|(k, a)| {
                    let a = self.pool.var(*a);
                    self.pool.mul(*k, a)
                })
                .collect();
            let output = self.pool.sum(&terms);
            list.push(Resistor {
                argument: arguments[i],
                output,
                gives,
                written: gives,
                curve: None,
                row: Some(row),
                linear: None,
                dissipative: verdict,
            });
        }
        Some(list)
    }

    /// `{ a.e = ...; b.f = ... }`: a law a port, in the other variables of all ports.
    fn resistor_laws(
        &mut self,
        ast: &'a ast::Element,
        scope: usize,
        field: usize,
        bonds: &[BondId],
    ) -> Option<Vec<Resistor>> {
        let (members, ports) = (self.fields[field].members.clone(), self.fields[field].ports.clone());
        let name = ast.name.text.clone();
        let mut given: Vec<Option<(Variable, &'a ast::Expr)>> = vec![None; ports.len()];
        let mut sound = true;
        for f in ast.fields.iter().flat_map(|f| &f.0) {
            let path: Vec<&str> = f.path.iter().map(|n| n.text.as_str()).collect();
            let place = ports.iter().position(|p| Some(p.as_str()) == path.first().copied());
            let variable = match path.get(1) {
                Some(&"e") => Some(Variable::Effort),
                Some(&"f") => Some(Variable::Flow),
                _ => None,
            };
            let (Some(place), Some(variable), 2) = (place, variable, path.len()) else {
                let error = Diagnostic::error(
                    "elaborate::field",
                    f.span,
                    format!("`{name}` (a field of R) has no field `{}`", path.join(".")),
                );
                let list: Vec<String> = ports.iter().map(|p| format!("`{p}.e` or `{p}.f`")).collect();
                self.errors.push(error.help(format!("give {}", list.join(", "))));
                sound = false;
                continue;
            };
            if given[place].is_some() {
                self.errors.push(
                    Diagnostic::error(
                        "elaborate::twice",
                        f.span,
                        format!("`{name}` has two laws for `{}`", ports[place]),
                    )
                    .help("give its effort or its flow, and leave the other to the graph"),
                );
                sound = false;
            }
            given[place] = Some((variable, &f.value));
        }
        for (p, g) in ports.iter().zip(&given) {
            if g.is_none() && sound {
                self.errors.push(
                    Diagnostic::error("elaborate::value", ast.span, format!("`{name}` has no law for its port `{p}`"))
                        .help(format!("give `{p}.e = ...` in flows, or `{p}.f = ...` in efforts")),
                );
                sound = false;
            }
        }
        if !sound {
            return None;
        }
        let given: Vec<(Variable, &'a ast::Expr)> = given.into_iter().collect::<Option<_>>()?;
        let arguments: Vec<Symbol> = members.iter().map(|m| self.argument(*m)).collect();
        let before = self.locals.len();
        for (i, (p, (variable, _))) in ports.iter().zip(&given).enumerate() {
            let d = self.bond_domain(bonds[i]);
            let unit = if *variable == Variable::Effort { Unit::flow(d) } else { Unit::effort(d) };
            let expr = self.pool.var(arguments[i]);
            self.locals.push((format!("{p}.{}", variable.other().letter()), Typed { expr, unit }));
        }
        let laws: Vec<Option<Typed>> = given.iter().map(|(_, e)| self.with_signals(e, scope)).collect();
        self.locals.truncate(before);
        let laws: Vec<Typed> = laws.into_iter().collect::<Option<_>>()?;
        let mut terms = Vec::new();
        for (i, (law, (variable, value))) in laws.iter().zip(&given).enumerate() {
            let d = self.bond_domain(bonds[i]);
            let needed = if *variable == Variable::Effort { Unit::effort(d) } else { Unit::flow(d) };
            let about = format!("the law of `{name}` for `{}`", ports[i]);
            self.require((&law.unit, value.span), needed, None, about, 2);
            let x = self.pool.var(arguments[i]);
            terms.push(self.pool.mul(law.expr, x));
        }
        let power = self.pool.sum(&terms);
        let rows = self.coefficients(&laws, &arguments);
        let verdict = rows.as_ref().and_then(|m| self.dissipates(m)).or_else(|| self.takes_power(power, &arguments));
        if verdict == Some(false) && !ast.active {
            self.errors.push(
                Diagnostic::error(
                    "elaborate::law",
                    ast.span,
                    format!("the laws of `{name}` give power: at some values the sum of e f is below 0"),
                )
                .help(format!(
                    "the ports together must take power; a field that gives it must say so: `active R({}):{name}`",
                    ports.join(", ")
                )),
            );
            return None;
        }
        let list =
            laws.into_iter().zip(&given).zip(&arguments).enumerate().map(|(i, ((law, (gives, _)), argument))| {
                Resistor {
                    argument: *argument,
                    output: law.expr,
                    gives: *gives,
                    written: *gives,
                    curve: None,
                    row: rows.as_ref().map(|m| m[i].clone()),
                    linear: None,
                    dissipative: verdict,
                }
            });
        Some(list.collect())
    }

    /// The matrix of laws that are all linear in the arguments.
    fn coefficients(&mut self, laws: &[Typed], arguments: &[Symbol]) -> Option<Vec<Vec<Expr>>> {
        let mut list = Vec::new();
        for law in laws {
            let (linear, rest) = self.pool.affine(law.expr, arguments)?;
            if !self.pool.is_zero(rest) {
                return None;
            }
            let mut row = vec![self.pool.zero(); arguments.len()];
            linear.into_iter().for_each(|(j, k)| row[j] = k);
            list.push(row);
        }
        Some(list)
    }

    /// `RS(r, th):name = v`: the power e f lost at `r` leaves at `th` as the flow of entropy e f / T.
    fn entropy_source(
        &mut self,
        ast: &'a ast::Element,
        scope: usize,
        field: usize,
        bonds: &[BondId],
    ) -> Option<Vec<Resistor>> {
        let (members, name) = (self.fields[field].members.clone(), ast.name.text.clone());
        let mut first = self.resistor(members[0], ast, scope, bonds[0])?;
        let temperature = self.argument(members[1]);
        let d = self.bond_domain(bonds[1]);
        let power = self.energy_unit(bonds[0]).div(&self.energy_unit(bonds[1]));
        let about = format!("the power of `{name}` on its two ports (the thermal one is a true bond, K and W/K)");
        self.require((&power, ast.name.span), Unit::one(), None, about, 3);
        self.require(
            (&Unit::effort(d), ast.name.span),
            Unit::known(Dimension::KELVIN),
            None,
            format!("the effort at the thermal port of `{name}`"),
            3,
        );
        let loss = match first.curve {
            Some(c) => self.pool.mul(c.effort, c.flow),
            None => {
                let x = self.pool.var(first.argument);
                self.pool.mul(first.output, x)
            }
        };
        let t = self.pool.var(temperature);
        let entropy = self.pool.div(loss, t);
        let output = self.pool.neg(entropy);
        first.row = None;
        let second = Resistor {
            argument: temperature,
            output,
            gives: Variable::Flow,
            written: Variable::Flow,
            curve: None,
            row: None,
            linear: None,
            dissipative: first.dissipative,
        };
        Some(vec![first, second])
    }

    /// A square matrix of a size, each entry with its unit.
    fn square(
        &mut self,
        value: &'a ast::Expr,
        scope: usize,
        n: usize,
        about: &str,
        unit: &dyn Fn(usize, usize) -> Unit,
    ) -> Option<Vec<Vec<Expr>>> {
        let rows = self.matrix(value, scope)?;
        if rows.len() != n || rows.iter().any(|r| r.len() != n) {
            let size = format!("{} by {}", rows.len(), rows.first().map_or(0, Vec::len));
            let e = Diagnostic::error(
                "elaborate::matrix",
                value.span,
                format!("{about} is a matrix of {size}, and one of {n} by {n} is needed"),
            );
            self.errors.push(e.help(format!("give a row and a column for each port, such as {}", example(n))));
            return None;
        }
        let mut matrix = Vec::new();
        for (i, row) in rows.into_iter().enumerate() {
            let mut list = Vec::new();
            for (j, typed) in row.into_iter().enumerate() {
                let about = format!("entry [{}, {}] of {about}", i + 1, j + 1);
                self.require((&typed.unit, value.span), unit(i, j), None, about.clone(), 2);
                self.finite(typed.expr, value, &about)?;
                list.push(typed.expr);
            }
            matrix.push(list);
        }
        Some(matrix)
    }

    /// The matrix as numbers, scaled to a unit diagonal; `None` where an entry is no number.
    pub(super) fn scaled(&self, m: &[Vec<Expr>]) -> Option<DMatrix<f64>> {
        let n = m.len();
        let mut a = DMatrix::<f64>::zeros(n, n);
        for (i, row) in m.iter().enumerate() {
            for (j, e) in row.iter().enumerate() {
                a[(i, j)] = self.pool.constant(*e)?;
            }
        }
        let scale: Vec<f64> = (0..n).map(|i| if a[(i, i)] == 0.0 { 1.0 } else { a[(i, i)].abs().sqrt() }).collect();
        Some(DMatrix::from_fn(n, n, |i, j| a[(i, j)] / (scale[i] * scale[j])))
    }

    fn symmetric_positive(&mut self, m: &[Vec<Expr>], value: &ast::Expr, name: &str, what: &str) -> Option<()> {
        let words = self.words(value);
        let Some(a) = self.scaled(m) else {
            let e =
                Diagnostic::error("elaborate::constant", value.span, format!("`{words}` must be known before the run"));
            self.errors.push(e.help("write an energy H for what depends on states"));
            return None;
        };
        let skew = (&a - a.transpose()).amax();
        if skew > ROUNDING * a.amax() {
            let e = Diagnostic::error(
                "elaborate::matrix",
                value.span,
                format!("the {what} matrix of `{name}` is not symmetric: it has no energy"),
            );
            self.errors.push(e.help(
                "the entries on both sides of the diagonal are the same, since both are second derivatives of H",
            ));
            return None;
        }
        let least = a.symmetric_eigenvalues().min();
        if !(least > ROUNDING && least.is_finite()) {
            let e = Diagnostic::error(
                "elaborate::value",
                value.span,
                format!("the {what} matrix of `{name}` is not positive definite"),
            );
            self.errors.push(e.help(
                "of two coupled ports, the entry off the diagonal is at most the root of the product of those on it",
            ));
            return None;
        }
        Some(())
    }

    /// Whether a matrix takes power only: by the eigenvalues of its symmetric part where it is known.
    fn dissipates(&self, m: &[Vec<Expr>]) -> Option<bool> {
        let a = self.scaled(m)?;
        let s = (&a + a.transpose()) * 0.5;
        let size = a.amax();
        if !size.is_finite() {
            return None;
        }
        Some(s.symmetric_eigenvalues().min() >= -ROUNDING * size)
    }

    /// Whether the power of a field's laws is never below 0: it is 0, or by its sign; refuted by values.
    fn takes_power(&mut self, power: Expr, arguments: &[Symbol]) -> Option<bool> {
        use crate::expression::Sign;
        if self.pool.is_zero(power) || self.pool.sign(power, &|_| Sign::Unknown).is_nonnegative() {
            return Some(true);
        }
        if self.pool.symbols(power).iter().any(|s| !arguments.contains(s)) {
            return None;
        }
        // A law may be meant for temperatures, say, which are positive: beyond, values refute nothing.
        let sizes = [1e-3, 0.3, 1.0, 7.0, 300.0];
        let mut seed = 1u64;
        let mut draw = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) as f64 / f64::from(1u32 << 31)
        };
        let terms: Vec<Expr> = match self.pool.node(power).clone() {
            crate::expression::Node::Sum(_, list) => list.iter().map(|t| t.0).collect(),
            _ => vec![power],
        };
        let at = |pool: &Pool, e: Expr, point: &[f64]| {
            pool.eval(e, &|s| arguments.iter().position(|a| *a == s).map_or(f64::NAN, |i| point[i]))
        };
        for size in sizes {
            for _ in 0..40 {
                let point: Vec<f64> = arguments.iter().map(|_| size * draw()).collect();
                let p = at(&self.pool, power, &point);
                let most = terms.iter().map(|t| at(&self.pool, *t, &point).abs()).fold(0.0, f64::max);
                if p < -1e-9 * most && p.is_finite() {
                    return Some(false);
                }
            }
        }
        None
    }

    /// x^T K x / 2
    fn quadratic(&mut self, k: &[Vec<Expr>], symbols: &[Symbol]) -> Expr {
        let half = self.pool.ratio(1, 2);
        let mut terms = Vec::new();
        for (row, a) in k.iter().zip(symbols) {
            for (k, b) in row.iter().zip(symbols) {
                let (x, y) = (self.pool.var(*a), self.pool.var(*b));
                terms.push(self.pool.product(&[half, *k, x, y]));
            }
        }
        self.pool.sum(&terms)
    }

    /// The bond of a port; a port that is not bonded once is complained of elsewhere.
    fn only_bond(&self, id: ElementId) -> Option<BondId> {
        self.bonds_of.get(id.at())?.first().copied()
    }
}

fn example(n: usize) -> String {
    let row = vec!["..."; n].join(", ");
    format!("[{}]", vec![format!("[{row}]"); n].join(", "))
}
