//! Second walk: laws, outputs, settings, units.

use super::expand::{given, part};
use super::infer::Units;
use super::{Broken, Elaborator, Entity, Inference, Mode, ScopeId, Typed, Unit, Value};
use crate::Options;
use crate::expression::Expr;
use crate::model::{
    BondId, Element, ElementId, Field, Input, Kind, Law, Memory, Model, OnePort, Parameter, Part, Probe, Signal,
    TransmissionLine,
};
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;
use rustc_hash::FxHashSet;

impl<'a> Elaborator<'a> {
    pub(super) fn finish(mut self, decl: &'a ast::Model) -> Result<Model, Broken> {
        self.domain_of = self.domains();
        self.energies = vec![None; self.elements.len()];
        self.mode = Mode::Signals;
        let mut laws = self.laws();
        self.check_two_ports();
        self.turn_steep_laws(&mut laws);
        // What was wrong where an energy was read, and was told at no other place.
        if self.errors.is_empty() && laws.iter().any(Option::is_none) {
            self.errors.append(&mut self.untold);
        }
        self.make_resolutions();
        let mut memories = self.make_memories();
        let inputs = self.make_inputs();
        let mut whole = self.errors.is_empty();
        let probes = self.make_probes();
        let expectations = self.make_expectations();
        let settings = self.make_settings();
        memories.extend(self.make_held());
        let said = self.errors.len();
        for p in 0..self.params.len() {
            let span = self.params[p].span;
            self.param_value(p, span);
        }
        whole &= self.errors.len() == said;
        self.check_unused();
        let units = self.solve_units();
        self.forget_misread();
        self.forget_followers();
        if !whole {
            return Err(Broken { errors: self.errors, model: None });
        }
        let known = |u: &Unit| units.display(u);
        let exchanged = self.exchanges(&known);
        let remarks = self.told_remarks();
        let parts = self.parts();
        let parameters = self
            .params
            .iter()
            .flat_map(|p| match &p.state {
                super::ParamState::Done(Some(value)) => self.listed(&p.name, value),
                super::ParamState::Done(None) | super::ParamState::New | super::ParamState::Open => Vec::new(),
            })
            .map(|(p, unit)| Parameter { unit: known(&unit), ..p })
            .collect();
        let probes = probes
            .into_iter()
            .map(|(name, span, t)| Probe { name, value: t.expr, unit: known(&t.unit), span })
            .collect();
        let inputs = inputs.into_iter().map(|(i, unit)| Input { unit: known(&unit), ..i }).collect();
        let (delays, of_delays) = self.make_delays();
        // Each at its number.
        let mut memories: Vec<(Memory, Unit)> = memories.into_iter().chain(of_delays).collect();
        memories.sort_by_key(|(m, _)| match self.signals.get(&m.symbol) {
            Some(Signal::Memory(number)) => *number,
            _ => usize::MAX,
        });
        let memories = memories.into_iter().map(|(m, unit)| Memory { unit: known(&unit), ..m }).collect();
        let bond_units = self.domain_of.iter().map(|&d| (known(&Unit::effort(d)), known(&Unit::flow(d)))).collect();
        let pseudo = self.domain_of.iter().map(|&d| units.pseudo[d]).collect();
        let is_line = |f: &&super::FieldDecl<'_>| f.ast.kind.text == "TL";
        let line = |name: &str, ends: Vec<ElementId>| TransmissionLine { name: name.into(), ends };
        let whole = self.fields.iter().filter(is_line).map(|f| line(&f.name, f.members.clone()));
        // Half lines come after these.
        let half = self.wave_ports.iter().map(|id| line(&self.elements[id.at()].name, vec![*id]));
        let lines = whole.chain(half).collect();
        self.fields.retain(|f| f.ast.kind.text != "TL");
        let model = Model {
            lines,
            name: decl.name.text.clone(),
            docs: decl.docs.clone(),
            span: decl.span,
            pool: self.pool,
            elements: laws.into_iter().flatten().collect(),
            bonds: self.bonds,
            fields: self
                .fields
                .into_iter()
                .map(|f| Field {
                    kind: f.ast.kind.text.clone(),
                    name: f.name,
                    members: f.members,
                    span: f.ast.kind.span.to(f.ast.name.span),
                })
                .collect(),
            samplings: self.samplings,
            integrals: self.integrals,
            inputs,
            memories,
            parts,
            bundles: self.entries,
            exchanged,
            delays,
            probes,
            expectations,
            settings,
            parameters,
            signals: self.signals,
            units: bond_units,
            pseudo,
            remarks,
        };
        if self.errors.is_empty() {
            return Ok(model);
        }
        Err(Broken { errors: self.errors, model: Some(Box::new(model)) })
    }

    /// The parts of the scene, which have paths.
    fn parts(&self) -> Vec<Part> {
        let of = |i: &super::Instance<'_>| {
            let kind = i.kind.or_else(|| self.files.model(i.model).map(|m| m.name.text.as_str()));
            Part { name: i.path.clone(), kind: kind.unwrap_or_default().to_string(), matrix: i.kind.is_some() }
        };
        self.instances.iter().filter(|i| !i.path.is_empty()).map(of).collect()
    }

    /// The units that follow from all equations; what contradicts them is an error.
    fn solve_units(&mut self) -> Units {
        let domains = self.domain_of.iter().max().map_or(0, |d| d + 1);
        let mut inference = Inference::new(domains, self.limits.equations);
        for e in std::mem::take(&mut self.equations) {
            inference.equate(e);
        }
        let (elements, functions, params, sources) = (&self.elements, &self.functions, &self.params, self.sources);
        let (scopes, instances, lets) = (&self.scopes, &self.instances, &self.lets);
        inference.solve(
            std::mem::take(&mut self.angles),
            &mut self.errors,
            &super::domain::Names {
                element: &|id| elements.get(id.at()).map_or("", |e| &e.name),
                function: &|f| functions.name(f),
                given: &|e| {
                    let owner = e.owner.and_then(|id| elements.get(id.at()));
                    let text = sources.slice(e.found.1);
                    let given = owner.map(|o| given(params, sources, part(&o.name), text));
                    let alone = text.trim().chars().all(|c| c.is_alphanumeric() || c == '_');
                    (given.unwrap_or_default(), alone)
                },
                text: &|span| sources.slice(span),
                misread: &|e, off| {
                    let owner = e.owner.and_then(|id| elements.get(id.at()));
                    let instance = &instances[owner.map_or(0, |o| scopes[o.scope].instance)];
                    let known = |name: &str| {
                        // The parameter of a curve.
                        let fields = owner.and_then(|o| o.ast?.fields.as_ref()).map_or(&[][..], |f| &f.0);
                        if name == "s" && ["e", "f"].iter().all(|law| fields.iter().any(|f| f.name() == *law)) {
                            return true;
                        }
                        let value = match instance.names.get(name).map(|n| n.0) {
                            Some(Entity::Param(p)) => match &params[p].state {
                                super::ParamState::Done(value) => value.as_ref(),
                                super::ParamState::New | super::ParamState::Open => None,
                            },
                            Some(Entity::Let(l)) => match &lets[l].state {
                                super::LetState::Done(value) => value.as_ref(),
                                super::LetState::New | super::LetState::Open => None,
                            },
                            _ => return false,
                        };
                        let of = match value {
                            Some(Value::Scalar(Typed { unit: Unit::Form(d, _, _), .. })) => Some(*d),
                            _ => None,
                        };
                        // Where both are known, it has to explain what the whole is off by.
                        let ratio = of.zip(crate::units::lookup(name)).map(|(of, (_, unit))| of.div(unit));
                        off.zip(ratio).is_none_or(|(off, ratio)| off == ratio || off.mul(ratio).is_one())
                    };
                    super::unknown::misread(sources.slice(e.found.1), &known)
                },
            },
        )
    }

    /// Takes the errors of units out where the grammar refused what is written: it may not be what was meant.
    fn forget_misread(&mut self) {
        let place = |e: &Diagnostic| e.labels.first().map(|l| l.span);
        let refused: Vec<Span> =
            self.errors.iter().filter(|e| e.code.starts_with("syntax::")).filter_map(place).collect();
        let meet = |a: Span, b: Span| a.source == b.source && a.start < b.end && b.start < a.end;
        self.errors.retain(|e| {
            !e.code.starts_with("units::") || !e.labels.iter().any(|l| refused.iter().any(|part| meet(l.span, *part)))
        });
    }

    /// Takes the errors of units out that stand in the bundled library alone, where others are of what was given to it.
    fn forget_followers(&mut self) {
        let sources = self.sources;
        let own = |e: &Diagnostic| e.labels.iter().any(|l| !sources.get(l.span.source).name.starts_with("std/"));
        let is_unit = |e: &Diagnostic| e.code.starts_with("units::");
        if self.errors.iter().any(|e| is_unit(e) && own(e)) {
            self.errors.retain(|e| !is_unit(e) || own(e));
        }
    }

    /// Bonds that meet at junctions share their units: the domain of each bond.
    fn domains(&self) -> Vec<usize> {
        let mut sets = petgraph::unionfind::UnionFind::<usize>::new(self.bonds.len());
        for (i, decl) in self.elements.iter().enumerate() {
            if decl.kind.is_junction() {
                for pair in self.bonds_of.get(i).map(Vec::as_slice).unwrap_or(&[]).windows(2) {
                    sets.union(pair[0].at(), pair[1].at());
                }
            }
        }
        let mut number = vec![usize::MAX; self.bonds.len()];
        let mut count = 0;
        (0..self.bonds.len())
            .map(|b| {
                let root = sets.find(b);
                if number[root] == usize::MAX {
                    number[root] = count;
                    count += 1;
                }
                number[root]
            })
            .collect()
    }

    /// Where a user finds an element: its declaration or, within the bundled library, that of the part that it is of.
    fn place(&self, scope: ScopeId, mut span: Span) -> Span {
        let mut instance = self.scopes[scope].instance;
        while self.sources.get(span.source).name.starts_with("std/") && instance != self.instances[instance].outer {
            span = self.instances[instance].span;
            instance = self.instances[instance].outer;
        }
        span
    }

    /// The part of the scene that a scope stands in: where the outermost instance around it is declared.
    fn part_of_scene(&self, scope: ScopeId) -> Option<Span> {
        let mut instance = self.scopes[scope].instance;
        while instance != 0 && self.instances[instance].outer != 0 {
            instance = self.instances[instance].outer;
        }
        (instance != 0).then(|| self.instances[instance].span)
    }

    /// The element with its law; `None` where that cannot be made (which is said).
    pub(super) fn law(&mut self, id: ElementId) -> Option<Element> {
        let decl = &self.elements[id.at()];
        let (kind, ast, scope, span) = (decl.kind, decl.ast, decl.scope, decl.span);
        self.sampling = decl.sampling;
        let bonds = self.bonds_of.get(id.at()).cloned().unwrap_or_default();
        let field = decl.field;
        let law = match (kind, ast) {
            (_, Some(_)) if field.is_some() => self.field_law(id, field?.0, scope)?,
            // Those of two-ports by matrices.
            (Kind::Junction(_), None) => Law::Junction,
            (Kind::Junction(_), Some(ast)) => {
                self.no_value(ast, "a junction");
                Law::Junction
            }
            (Kind::OnePort(OnePort::Detector(_)), Some(ast)) => {
                self.no_value(ast, "a detector");
                Law::Source(self.pool.int(0))
            }
            (Kind::OnePort(OnePort::Open), _) => {
                let fields = self.open_ports.iter().find(|p| p.0 == id).map(|p| (p.1, p.2));
                let (fields, scope) = fields?;
                self.open_port(id, (fields, scope), bonds.first().copied()?)?
            }
            (Kind::OnePort(OnePort::Source(_)), Some(ast)) => {
                Law::Source(self.source(ast, scope, kind, bonds.first().copied()?)?)
            }
            (Kind::OnePort(OnePort::Storage(_)), Some(ast)) => {
                Law::Storage(self.storage(id, ast, scope, kind, bonds.first().copied()?)?)
            }
            (Kind::OnePort(OnePort::Resistor), Some(ast)) => {
                Law::Resistor(self.resistor(id, ast, scope, bonds.first().copied()?)?)
            }
            (Kind::TwoPort(kind), Some(ast)) => {
                let into = bonds.iter().copied().find(|b| self.bonds[b.at()].head == id)?;
                let out = bonds.iter().copied().find(|b| self.bonds[b.at()].tail == id)?;
                Law::Ratio(self.ratio(id, (ast, scope), kind, into, out)?)
            }
            (Kind::OnePort(OnePort::Multiplier(_)), Some(_)) | (Kind::OnePort(_) | Kind::TwoPort(_), None) => {
                return None;
            }
        };
        let decl = &self.elements[id.at()];
        let active = ast.is_some_and(|a| a.active);
        let (name, sampling) = (decl.name.clone(), decl.sampling);
        let is_line = |f: usize| self.fields[f].ast.kind.text == "TL";
        let before = |f: usize, lines: bool| (0..f).filter(|f| is_line(*f) == lines).count();
        let half = self.wave_ports.iter().position(|x| *x == id).map(|k| before(self.fields.len(), true) + k);
        let line = field.filter(|f| is_line(f.0)).map(|f| before(f.0, true)).or(half);
        let field = field.filter(|f| !is_line(f.0)).map(|f| (before(f.0, false), f.1));
        let (span, part) = (self.place(scope, span), self.part_of_scene(scope));
        Some(Element { name, kind, law, sampling, active, added: false, span, part, field, line })
    }

    fn no_value(&mut self, ast: &ast::Element, what: &str) {
        if ast.value.is_some() || ast.fields.is_some() || !ast.args.is_empty() {
            self.errors.push(
                Diagnostic::error(
                    "elaborate::value",
                    ast.span,
                    format!("`{}` is {what}, and takes no value", ast.name.text),
                )
                .help("take the value away"),
            );
        }
    }

    /// H of a storage, made now if it was not before.
    pub(crate) fn energy(&mut self, id: ElementId) -> Option<Expr> {
        if let Some(e) = self.energies[id.at()] {
            return Some(e);
        }
        if self.asked.contains(&id) {
            self.circular = true;
            return None;
        }
        self.circular &= !self.asked.is_empty();
        self.asked.push(id);
        let (before, asked) = (self.errors.len(), self.equations.len());
        let (mode, sampling, locals) = (self.mode, self.sampling, std::mem::take(&mut self.locals));
        let law = self.law(id);
        self.asked.pop();
        self.mode = mode;
        self.sampling = sampling;
        self.locals = locals;
        let found = self.errors.split_off(before); // said when its turn comes
        self.untold.extend(found);
        self.equations.truncate(asked);
        match law?.law {
            Law::Storage(s) => {
                self.energies[id.at()] = Some(s.energy);
                Some(s.energy)
            }
            Law::Source(_) | Law::Resistor(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) | Law::Multiplier => None,
        }
    }

    fn make_probes(&mut self) -> Vec<(String, Span, Typed)> {
        let list = std::mem::take(&mut self.probes);
        self.mode = Mode::Outputs;
        let mut probes = Vec::new();
        for (name, span, value) in list {
            // Of an array, each entry is an output.
            let Some(value) = self.let_value(value, span) else { continue };
            let all = value.leaves().into_iter().map(|(index, t)| (format!("{name}{index}"), span, t.clone()));
            probes.extend(all);
        }
        probes
    }

    /// Looks at the `let`s of the scene that nothing has asked for: what is wrong with them is to be said, but nothing
    /// that they name, as an `integral`, is to be worked out in a run.
    fn check_unused(&mut self) {
        let of_scene = |l: &super::Let| self.scopes[l.scope].instance == 0 && matches!(l.state, super::LetState::New);
        let unused: Vec<usize> = (0..self.lets.len()).filter(|l| of_scene(&self.lets[*l])).collect();
        if unused.is_empty() {
            return;
        }
        let (pool, integrals, held) = (self.pool.clone(), self.integrals.len(), self.held.len());
        let delays = self.delays.len();
        let (signals, symbol_of) = (self.signals.clone(), self.symbol_of.clone());
        self.mode = Mode::Outputs;
        // Each as it is written, then what further rounds of loops make of it.
        let mut seen = FxHashSet::default();
        let (first, further): (Vec<usize>, Vec<usize>) =
            unused.into_iter().partition(|l| seen.insert(self.lets[*l].value.span));
        let (written, mut spent) = (first.len(), 0);
        for (i, l) in first.into_iter().chain(further).enumerate() {
            if i >= written && spent > self.limits.unused {
                break;
            }
            let span = self.lets[l].value.span;
            let numbers = self.let_value(l, span).map_or(0, |v| v.leaves().len());
            spent += numbers + (span.end - span.start) as usize;
        }
        (self.pool, self.signals, self.symbol_of) = (pool, signals, symbol_of);
        self.integrals.truncate(integrals);
        self.held.truncate(held);
        self.delays.truncate(delays);
    }

    /// Says which `--set` met no parameter.
    pub(super) fn unknown_overrides(&mut self, options: &Options, at: Span) {
        for (path, ..) in &options.set {
            let part = path.split(['.', '[']).next().unwrap_or(path).to_string();
            let wrong = matches!(self.instances[0].names.get(&part), Some((Entity::Missing, _)));
            if wrong || self.is_lost(0, &part) || self.params.iter().any(|p| p.name == *path) {
                continue;
            }
            if let Some((array, _)) =
                path.split_once('[').filter(|(_, rest)| rest.ends_with(']') && !rest.contains('.'))
                && let Some(p) = self.params.iter().position(|p| p.name == array)
            {
                let span = self.params[p].span;
                let (message, help) = match self.param_value(p, span) {
                    Some(Value::Scalar(_)) => {
                        (format!("`{array}` is a number, and no array"), format!("write --set {array}=VALUE"))
                    }
                    _ => (
                        format!("an entry of the array `{array}` cannot be set by itself"),
                        "change the array in the file, or give its entries by parameters of their own".into(),
                    ),
                };
                let message = format!("--set {path}: {message}");
                self.errors.push(Diagnostic::error("elaborate::set", span, message).help(help));
                continue;
            }
            if let Some(l) = self.lets.iter().position(|l| l.input.is_some() && l.name == *path) {
                let message = format!("--set {path}: `{path}` is an input of a part, and is given where the part is");
                let error = Diagnostic::error("elaborate::set", self.lets[l].value.span, message);
                self.errors.push(error.help("change what it is given there"));
                continue;
            }
            if let Some(input) = self.inputs.iter().find(|i| i.name == *path) {
                let message = format!("--set {path}: `{path}` is an input, and no parameter");
                let help = format!(
                    "give it by `--input FILE.csv`, with the columns t and {path}; or change its default, `input \
                    {path} = ...`"
                );
                self.errors.push(Diagnostic::error("elaborate::set", input.span, message).help(help));
                continue;
            }
            let names: Vec<String> = self.params.iter().map(|p| p.name.clone()).collect();
            let mut error =
                Diagnostic::error("elaborate::set", at, format!("--set {path}: there is no parameter `{path}`"));
            if let Some(fix) = self.as_parameter(path) {
                self.errors.push(error.help(fix));
                continue;
            }
            error = match super::nearest(path, names.iter().map(String::as_str)) {
                Some(n) => error.help(format!("did you mean `{n}`?")),
                None if names.is_empty() => error.help("the scene has no parameters"),
                None => error.help(format!("the parameters are {}", names.join(", "))),
            };
            self.errors.push(error);
        }
    }

    /// How the value of an element of the scene becomes a parameter.
    fn as_parameter(&self, path: &str) -> Option<String> {
        let Some((Entity::Element(id), _)) = self.instances[0].names.get(path) else { return None };
        let ast = self.elements.get(id.at())?.ast?;
        let value = self.sources.slice(ast.value.as_ref()?.span);
        let (kind, name) = (&ast.kind.text, self.instances[0].free(&format!("{path}_value")));
        Some(format!(
            "`{path}` is an element, and --set sets parameters: write `{name} = {value}` in the head of the model and \
             `{kind}:{path} = {name}`, and set `{name}`"
        ))
    }

    /// A symbol for the argument of an element's law.
    pub(crate) fn argument(&mut self, id: ElementId) -> crate::expression::Symbol {
        self.signal(Signal::Argument(id))
    }

    pub(crate) fn bond_domain(&self, bond: BondId) -> usize {
        self.domain_of[bond.at()]
    }
}
