//! First walk: makes the instances, expands `for` and `if`, declares every name, and notes the bonds.

use super::suggest::{foreign_kind, nearest};
use super::{Decl, Elaborator, Entity, Let, Param, ParamState, PortDecl, ScopeId, told};
use crate::element;
use crate::model::{ElementId, Exchange, Hold, Kind, Sampling};
use bond_grammar::ast::{
    self, Chain, Clock, Definition, Element as Decl_, End, Expr, ExprKind, Field, For, Model as ModelDecl, Name,
    Sampled, Statement, StatementKind,
};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::{Sources, Span};

impl<'a> Elaborator<'a> {
    /// Makes an instance of a model: its scope, its parameters, its names, its children, its bonds.
    pub(super) fn instantiate(
        &mut self,
        model: super::load::ModelRef,
        path: String,
        args: Option<(&'a [Field], ScopeId)>,
        sampling: Option<usize>,
        at: Span,
    ) -> Option<usize> {
        let decl = self.files.model(model)?;
        if let Some(i) = self.stack.iter().position(|m| *m == model) {
            let names: Vec<&str> =
                self.stack[i..].iter().filter_map(|m| self.files.model(*m)).map(|m| m.name.text.as_str()).collect();
            self.errors.push(
                Diagnostic::error(
                    "elaborate::recursion",
                    at,
                    format!(
                        "recursive model: `{}` contains itself ({} -> {})",
                        decl.name.text,
                        names.join(" -> "),
                        decl.name.text
                    ),
                )
                .label(decl.name.span, "is declared here")
                .help("a model cannot be a part of itself; take this instance out, or use `for` to repeat a part"),
            );
            return None;
        }
        if self.stack.len() >= self.limits.nesting {
            self.errors.push(Diagnostic::error(
                "elaborate::limit",
                at,
                format!("instances are nested more than {} deep", self.limits.nesting),
            ));
            return None;
        }
        self.stack.push(model);
        let instance = self.instances.len();
        let scope = self.new_scope(instance, None, None);
        let outer = args.map_or(instance, |(_, caller)| self.scopes[caller].instance);
        let mut made = super::Instance::new(model, path, scope, outer, at);
        if let Some((fields, caller)) = args {
            made.given = (fields, caller, sampling);
        }
        self.instances.push(made);
        self.declare_params(instance, decl, args, sampling);
        if instance == 0 {
            self.file_functions();
        }
        // A `let` of the model may be used by a `for` above it, and by the index of another one.
        let is_indexed = |s: &&Statement| matches!(&s.kind, StatementKind::Let(it) if !it.index.is_empty());
        for s in decl.body.iter().filter(|s| !is_indexed(s)).chain(decl.body.iter().filter(is_indexed)) {
            if let StatementKind::Let(it) = &s.kind {
                self.declare_let(scope, it, sampling);
            } else if let StatementKind::Function(f) = &s.kind {
                self.declare_function(scope, f);
            }
        }
        let mut chains = Vec::new();
        let two_ports = self.two_ports.len();
        self.block(&decl.body, scope, sampling, false, &mut chains);
        self.expand_two_ports(instance, two_ports);
        for (chain, scope) in chains {
            self.chain(chain, scope);
        }
        self.stack.pop();
        Some(instance)
    }

    fn declare_params(
        &mut self,
        instance: usize,
        decl: &'a ModelDecl,
        args: Option<(&'a [Field], ScopeId)>,
        sampling: Option<usize>,
    ) {
        let (args, caller) = args.unwrap_or((&[], 0));
        let scope = self.instances[instance].scope;
        let mut strange = false;
        let mut known: Vec<&str> = decl.params.iter().map(|p| p.name.text.as_str()).collect();
        let parameters = known.len();
        if !args.is_empty() {
            ast::each_statement(&decl.body, &mut |s| {
                if let StatementKind::Input(it) = &s.kind {
                    known.push(&it.name.text);
                }
            });
        }
        for arg in args {
            let name = &arg.path[0];
            if arg.path.len() != 1 || !known.contains(&name.text.as_str()) {
                let or_input = if known.len() > parameters { " or input" } else { "" };
                let mut error = Diagnostic::error(
                    "elaborate::parameter",
                    arg.span,
                    format!("`{}` has no parameter{or_input} `{}`", decl.name.text, arg.name()),
                )
                .label(decl.name.span, "is the model");
                error = match nearest(&name.text, known.iter().copied()) {
                    Some(n) => error.help(format!("did you mean `{n}`?")),
                    None if known.is_empty() => error.help("it has no parameters"),
                    None if known.len() == 1 => error.help(format!(
                        "its one parameter is `{0}`: write `{0} = {1}`",
                        known[0],
                        self.sources.slice(arg.value.span)
                    )),
                    None if parameters == known.len() => error.help(format!("its parameters are {}", known.join(", "))),
                    None => error.help(format!("its parameters and inputs are {}", known.join(", "))),
                };
                self.errors.push(error);
                strange = true;
            }
        }
        for (i, name) in known.iter().enumerate() {
            let of_name = |a: &&Field| a.path.len() == 1 && a.path[0].text == *name;
            let mut given = args.iter().filter(of_name);
            if let Some((first, second)) = given.next().zip(given.next())
                && !known[..i].contains(name)
            {
                let what = if i < parameters { "parameter" } else { "input" };
                let message = format!("the {what} `{name}` is given twice");
                let error = Diagnostic::error("elaborate::twice", second.span, message);
                self.errors.push(error.label(first.span, "is the first").help("keep one of them"));
            }
        }
        for p in &decl.params {
            let full = self.full_name(instance, &p.name.text);
            let given = args.iter().find(|a| a.path.len() == 1 && a.path[0].text == p.name.text);
            let value = match (given, &p.default) {
                (Some(field), _) => Some((&field.value, caller)),
                (None, Some(default)) => Some((default, scope)),
                (None, None) => None,
            };
            let index = self.params.len();
            let overridden = self.overrides.get(&full).copied();
            // What has no value may have been meant by the argument that fits no parameter.
            let meant = strange && value.is_none() && overridden.is_none();
            let state = if meant { ParamState::Done(None) } else { ParamState::New };
            let (span, given) = (p.name.span, given.is_some());
            self.params.push(Param { name: full, span, instance, sampling, value, given, state, overridden });
            self.declare(scope, p.name.text.clone(), Entity::Param(index), p.name.span);
        }
    }

    /// `wall.k` for `k` in the instance `wall`.
    pub(super) fn full_name(&self, instance: usize, name: &str) -> String {
        let path = &self.instances[instance].path;
        if path.is_empty() { name.to_string() } else { format!("{path}.{name}") }
    }

    /// Declares a name of the model that a scope stands in; whether it was free.
    pub(super) fn declare(&mut self, scope: ScopeId, key: String, entity: Entity, span: Span) -> bool {
        let names = &mut self.instances[self.scopes[scope].instance].names;
        let Some(known) = names.get_mut(&key) else {
            names.insert(key, (entity, span));
            return true;
        };
        if known.1 == span {
            // Nothing that names it means one of the rounds.
            known.0 = Entity::Missing;
            self.another_round(scope, &key, span);
            return false;
        }
        // A `let` is declared before what stands above it.
        let (first, second) = if span.start < known.1.start { (span, known.1) } else { (known.1, span) };
        let was = known.0;
        *known = (Entity::Missing, first);
        let mut error = twice(&key, first, second);
        // A junction is declared once, and then named: `1:v -> a`, `v -> b`.
        let text = &self.sources.get(second.source).text;
        let before = text.get(..second.start as usize).unwrap_or_default();
        let kind = before.strip_suffix(':').map(|text| &text[text.trim_end_matches(char::is_alphanumeric).len()..]);
        let is_value = matches!(was, Entity::Param(_) | Entity::Let(_) | Entity::Input(_));
        if let Some(kind) = kind.filter(|_| is_value) {
            let other = self.instances[self.scopes[scope].instance].free(&match key.to_lowercase() {
                lower if lower != key => lower,
                lower => format!("{lower}1"),
            });
            error = error.help(format!(
                "an element and a value cannot share a name: call the element `{kind}:{other}`, also in its bonds"
            ));
        } else if let Some(kind) = kind.filter(|kind| !kind.is_empty()) {
            let what = if matches!(kind, "0" | "1") { "junction" } else { "element" };
            error = error.help(format!(
                "if the same {what} is meant, name it: `{key}` without `{kind}:`; else rename one of them"
            ));
        }
        self.errors.push(error);
        false
    }

    /// Refuses a declaration that an earlier round of a `for` made already.
    fn another_round(&mut self, scope: ScopeId, key: &str, span: Span) {
        let name = key.split('[').next().unwrap_or(key);
        let mut variables = Vec::new();
        let mut at = Some(scope);
        while let Some(s) = at {
            variables.extend(self.scopes[s].loop_variable.as_ref().map(|(v, _)| v.as_str()));
            at = self.scopes[s].parent;
        }
        variables.reverse();
        let indexed = format!("{name}[{}]", variables.join(", "));
        let message = format!("`{key}` is declared in more than one round of its `for`");
        let hidden = variables.iter().find(|v| variables.iter().filter(|w| w == v).count() > 1);
        let help = match hidden {
            Some(v) => format!("the inner `{v}` hides the outer one: give one of the two `for`s another variable"),
            None => {
                let each = format!("index it: `{indexed}`");
                match self.kind_before(span) {
                    Some(kind) => format!(
                        "if all rounds share it, declare it once before the `for`, `{kind}:{name}`, and name it here, \
                         `{name}`; for one in each round {each}"
                    ),
                    None => each,
                }
            }
        };
        self.errors.push(Diagnostic::error("elaborate::twice", span, message).help(help));
        // What names it by an index follows from that.
        let instance = self.scopes[scope].instance;
        self.instances[instance].lost.insert(name.to_string());
    }

    /// The junction whose kind stands before a name: `0` of `0:plus`.
    fn kind_before(&self, name: Span) -> Option<char> {
        let before = self.sources.get(name.source).text.get(..name.start as usize)?.strip_suffix(':')?;
        before.chars().next_back().filter(|kind| matches!(kind, '0' | '1'))
    }

    /// Declares a name for an expression; its place among the `lets`, if the name was free.
    fn declare_let(&mut self, scope: ScopeId, it: &'a Definition, sampling: Option<usize>) -> Option<usize> {
        let index = self.lets.len();
        let name = self.declare_definition(scope, it, Entity::Let(index))?;
        let (value, state) = (&it.value, super::LetState::New);
        self.lets.push(Let { value, scope, sampling, input: None, output: None, state, name });
        Some(index)
    }

    /// Declares what a definition names, by its index if it has one; what it is called in its model, if that was free.
    pub(super) fn declare_definition(&mut self, scope: ScopeId, it: &'a Definition, entity: Entity) -> Option<String> {
        if it.index.is_empty() {
            return self.declare_signal(scope, &it.name, entity).then(|| self.looped(scope, &it.name.text));
        }
        let Some(key) = self.key(&it.name.text, &it.index, scope) else {
            self.lose_name(&it.name.text, scope);
            return None;
        };
        self.declare(scope, key.clone(), entity, it.name.span).then_some(key)
    }

    /// Declares a name that in a `for` belongs to the round; whether it was free.
    pub(super) fn declare_signal(&mut self, scope: ScopeId, name: &Name, entity: Entity) -> bool {
        let Some((variable, _)) = &self.scopes[scope].loop_variable else {
            return self.declare(scope, name.text.clone(), entity, name.span);
        };
        if *variable == name.text {
            let message = format!("`{variable}` is the variable of this `for`, and is declared again");
            self.errors.push(Diagnostic::error("elaborate::twice", name.span, message).help("rename one of them"));
            return false;
        }
        if let Some((_, first)) = self.scopes[scope].locals.get(&name.text) {
            self.errors.push(twice(&name.text, *first, name.span));
            return false;
        }
        self.scopes[scope].locals.insert(name.text.clone(), (entity, name.span));
        true
    }

    fn block(
        &mut self,
        body: &'a [Statement],
        scope: ScopeId,
        sampling: Option<usize>,
        inner: bool,
        chains: &mut Vec<(&'a Chain, ScopeId)>,
    ) {
        self.sampling = sampling;
        for s in body {
            if self.too_big(s.span) {
                return;
            }
            let instance = self.scopes[scope].instance;
            let scene = instance == 0;
            match &s.kind {
                StatementKind::Element(e) => self.element(e, scope, sampling),
                StatementKind::Chain(c) => {
                    for end in c.groups.iter().flatten() {
                        if let End::Declare(e) = end {
                            self.element(e, scope, sampling);
                        }
                    }
                    chains.push((c, scope));
                }
                StatementKind::Port(name, index, fields) => self.port((name, index), fields, scope, sampling),
                StatementKind::Sampled(block) => {
                    self.sampled(block, s.span, scope, sampling, chains);
                    self.sampling = sampling;
                }
                StatementKind::For(f) => self.rounds_of(f, s.span, scope, sampling, chains),
                StatementKind::If(c) => match self.choice(&c.condition, scope) {
                    Some(true) => self.block(&c.body, scope, sampling, true, chains),
                    Some(false) => self.block(c.otherwise.as_deref().unwrap_or(&[]), scope, sampling, true, chains),
                    None => {
                        self.lose(&c.body, scope);
                        self.lose(c.otherwise.as_deref().unwrap_or(&[]), scope);
                    }
                },
                StatementKind::Input(it) => self.input(it, scope, sampling),
                StatementKind::State(it, fields) => self.memory(it, fields, scope, sampling),
                StatementKind::Let(it) => {
                    if inner || self.scopes[scope].loop_variable.is_some() {
                        self.declare_let(scope, it, sampling);
                    }
                }
                StatementKind::Function(f) => {
                    if inner || self.scopes[scope].loop_variable.is_some() {
                        self.declare_function(scope, f);
                    }
                }
                StatementKind::Probe(it) => {
                    // A probe can be named like a `let`, in an `expect` above all.
                    let Some(value) = self.declare_let(scope, it, sampling) else { continue };
                    // A part's probes are for those who run the part alone.
                    if scene {
                        self.probes.push((self.lets[value].name.clone(), it.name.span, value));
                    }
                }
                StatementKind::Output(it) => {
                    let Some(value) = self.declare_let(scope, it, sampling) else { continue };
                    let name = self.lets[value].name.clone();
                    self.lets[value].output = Some(it.name.span);
                    // The outputs of the scene are for those who run it.
                    if scene {
                        self.probes.push((name, it.name.span, value));
                    } else {
                        self.instances[instance].outputs.push(name);
                        self.exchanged.push((value, Exchange::Output));
                    }
                }
                StatementKind::Simulate(fields) => {
                    if scene {
                        self.simulate.push((fields, scope));
                    }
                }
                StatementKind::Expect(e) => {
                    if scene {
                        self.expects.push((e, s.span, scope));
                    }
                }
            }
        }
    }

    /// The rounds of a `for`.
    fn rounds_of(
        &mut self,
        f: &'a For,
        span: Span,
        scope: ScopeId,
        sampling: Option<usize>,
        chains: &mut Vec<(&'a Chain, ScopeId)>,
    ) {
        let instance = self.scopes[scope].instance;
        let (from, to) = (self.integer(&f.from, scope), self.integer(&f.to, scope));
        let Some((from, to)) = from.zip(to) else {
            self.lose(&f.body, scope);
            return;
        };
        let most = self.limits.rounds;
        if self.rounds > most {
            return; // said of the `for` that ran too long
        }
        let rounds = if to < from { 0 } else { (to as i128 - from as i128 + 1) as u128 };
        if rounds > u128::from(most.saturating_sub(self.rounds)) {
            self.rounds = most + 1;
            let message = if rounds > u128::from(most) {
                format!("this `for` runs {rounds} times: too many (all loops together may run {most} times)")
            } else {
                format!("with this `for`, all loops together run more than {most} times")
            };
            self.errors.push(
                Diagnostic::error("elaborate::limit", f.from.span.to(f.to.span), message).help("lower the bound"),
            );
            return;
        }
        for s in f.body.iter().filter(|_| rounds == 0) {
            let name = match &s.kind {
                StatementKind::Element(e) => &e.name,
                StatementKind::Let(it)
                | StatementKind::Probe(it)
                | StatementKind::Input(it)
                | StatementKind::Output(it)
                | StatementKind::State(it, _) => &it.name,
                StatementKind::Chain(_)
                | StatementKind::Port(..)
                | StatementKind::Sampled(_)
                | StatementKind::For(_)
                | StatementKind::If(_)
                | StatementKind::Function(_)
                | StatementKind::Simulate(_)
                | StatementKind::Expect(_) => continue,
            };
            self.instances[instance].unmade.push((name.text.clone(), from, to));
        }
        self.rounds += rounds as u64;
        for i in from..=to {
            if self.rounds > most || self.too_big(span) {
                break;
            }
            if self.errors.len() > 200 {
                self.lose(&f.body, scope);
                break;
            }
            let inner_scope = self.new_scope(instance, Some(scope), Some((f.variable.text.clone(), i)));
            self.block(&f.body, inner_scope, sampling, true, chains);
        }
    }

    /// Keeps in mind what statements declare and bond that cannot be made, which is said.
    fn lose(&mut self, body: &[Statement], scope: ScopeId) {
        for s in body {
            match &s.kind {
                StatementKind::Element(e) => self.lose_name(&e.name.text, scope),
                StatementKind::Chain(c) => {
                    self.fray(scope);
                    for end in c.groups.iter().flatten() {
                        match end {
                            End::Declare(e) => self.lose_name(&e.name.text, scope),
                            End::Path(_) => {}
                        }
                    }
                    for (name, _) in c.arrows.iter().filter_map(|arrow| arrow.name.as_ref()) {
                        self.lose_name(&name.text, scope);
                    }
                }
                StatementKind::Port(name, ..) => self.lose_name(&name.text, scope),
                StatementKind::Let(it)
                | StatementKind::Probe(it)
                | StatementKind::Input(it)
                | StatementKind::Output(it)
                | StatementKind::State(it, _) => self.lose_name(&it.name.text, scope),
                StatementKind::Function(f) => self.lose_name(&f.name.text, scope),
                StatementKind::Sampled(block) => self.lose(&block.body, scope),
                StatementKind::For(f) => self.lose(&f.body, scope),
                StatementKind::If(c) => {
                    self.lose(&c.body, scope);
                    self.lose(c.otherwise.as_deref().unwrap_or(&[]), scope);
                }
                StatementKind::Simulate(_) | StatementKind::Expect(_) => {}
            }
        }
    }

    pub(super) fn lose_name(&mut self, name: &str, scope: ScopeId) {
        self.instances[self.scopes[scope].instance].lost.insert(name.to_string());
    }

    /// Keeps in mind that bonds of a scope's model could not be made.
    pub(super) fn fray(&mut self, scope: ScopeId) {
        self.instances[self.scopes[scope].instance].frayed = true;
    }

    /// A probe in a loop carries the loop's numbers: `x[3]`.
    pub(super) fn looped(&self, scope: ScopeId, name: &str) -> String {
        let mut numbers = Vec::new();
        let mut at = Some(scope);
        while let Some(s) = at {
            if let Some((_, i)) = &self.scopes[s].loop_variable {
                numbers.insert(0, i.to_string());
            }
            at = self.scopes[s].parent;
        }
        if numbers.is_empty() { name.to_string() } else { format!("{name}[{}]", numbers.join(",")) }
    }

    /// How many names of values there are.
    fn values(&self) -> usize {
        self.lets.len() + self.functions.count() + self.params.len() + self.inputs.len() + self.memories.len()
    }

    /// Whether there is too much of the model already, which is said once.
    pub(super) fn too_big(&mut self, span: Span) -> bool {
        let limits = &self.limits;
        let (what, help) = if self.elements.len() + self.raw_bonds.len() > limits.elements {
            (format!("{} elements and bonds", limits.elements), "lower the bounds of the loops")
        } else if self.instances.len() > limits.instances {
            let help = "models whose instances hold several instances each multiply; take some out, or lower the bounds of the loops";
            (format!("{} instances", limits.instances), help)
        } else if self.values() > limits.values {
            let help = "lower the bounds of the loops, or take names out of them";
            (format!("{} parameters, `let`s, probes, inputs and states", limits.values), help)
        } else {
            return false;
        };
        if !self.errors.iter().any(|e| e.code == "elaborate::limit") {
            let message = format!("the model has more than {what}");
            self.errors.push(Diagnostic::error("elaborate::limit", span, message).help(help));
        }
        true
    }

    fn element(&mut self, e: &'a Decl_, scope: ScopeId, sampling: Option<usize>) {
        match self.range(&e.name.text, &e.index, scope) {
            Some(None) => {}
            Some(Some(range)) => return self.bundle(e, range, scope, sampling),
            None => return self.lose_name(&e.name.text, scope),
        }
        match self.key(&e.name.text, &e.index, scope) {
            Some(key) => self.element_at(e, key, scope, sampling),
            None => self.lose_name(&e.name.text, scope),
        }
    }

    /// Declares one element, of this name in its model.
    pub(super) fn element_at(&mut self, e: &'a Decl_, key: String, scope: ScopeId, sampling: Option<usize>) {
        let name = self.full_name(self.scopes[scope].instance, &key);
        if !e.ports.is_empty() && matches!(e.kind.text.as_str(), "TF" | "MTF" | "GY" | "MGY") {
            self.matrix_two_port(e, key, name, scope, sampling);
            return;
        }
        if !e.ports.is_empty() || matches!(e.kind.text.as_str(), "RS" | "IC" | "TL") {
            self.field(e, key, name, scope, sampling);
            return;
        }
        let Some(kind) = element::ALL.iter().find(|(n, _)| *n == e.kind.text).map(|k| k.1) else {
            self.instance_or_unknown(e, &e.kind.text, key, name, scope, sampling);
            return;
        };
        if !e.args.is_empty() {
            self.errors.push(
                Diagnostic::error(
                    "elaborate::arguments",
                    e.span,
                    format!("`{name}` is an element, and takes no arguments in parentheses"),
                )
                .help(format!("write `{}:{} = value` or `{{ field = value }}`", e.kind.text, e.name.text)),
            );
        }
        if e.active && kind != Kind::R && !kind.is_source() {
            self.errors.push(
                Diagnostic::error(
                    "elaborate::active",
                    e.span,
                    format!("`{name}` cannot be active: only an `R` and a source can"),
                )
                .help("remove `active`"),
            );
        }
        let id = ElementId(self.elements.len() as u32);
        if self.declare(scope, key, Entity::Element(id), e.name.span) {
            let span = e.kind.span.to(e.name.span);
            self.elements.push(Decl { name, kind, ast: Some(e), scope, sampling, span, field: None });
        }
    }

    /// Declares a multiport field: each of its ports is an element.
    fn field(&mut self, e: &'a Decl_, key: String, name: String, scope: ScopeId, sampling: Option<usize>) {
        let kind = e.kind.text.as_str();
        let mut wrong = |span, what: String, help: &str| {
            self.errors.push(Diagnostic::error("elaborate::field_ports", span, what).help(help));
        };
        let mut sound = true;
        let (example, kinds): (_, Vec<Option<Kind>>) = match kind {
            "C" => ("`C(x, y):plate { H = ... }`", e.ports.iter().map(|_| Some(Kind::C)).collect()),
            "I" => ("`I(a, b):coils { H = ... }`", e.ports.iter().map(|_| Some(Kind::I)).collect()),
            "R" => ("`R(a, b):pair { a.e = ...; b.e = ... }`", e.ports.iter().map(|_| Some(Kind::R)).collect()),
            "RS" => ("`RS(r, th):heater = 10 Ohm`", e.ports.iter().map(|_| Some(Kind::R)).collect()),
            "TL" => {
                ("`TL(a, b):line { impedance = ...; delay = ... }`", e.ports.iter().map(|_| Some(Kind::R)).collect())
            }
            "IC" => {
                let of = |n: &Name| match n.text.as_str() {
                    "I" => Some(Kind::I),
                    "C" => Some(Kind::C),
                    _ => None,
                };
                ("`IC(I p, C q):arm { H = ... }`", e.ports.iter().map(|p| p.kind.as_ref().and_then(of)).collect())
            }
            _ => ("C, I, IC, R, RS and TL", vec![]),
        };
        if kinds.is_empty() && !e.ports.is_empty() {
            wrong(
                e.kind.span,
                format!("`{name}` (a `{kind}`) takes no list of ports"),
                &format!("the fields are {example}"),
            );
            sound = false;
        } else if e.ports.is_empty() || (matches!(kind, "RS" | "TL") && e.ports.len() != 2) {
            let what = match kind {
                "RS" => "two ports, the resistor's and the thermal one",
                "TL" => "two ports",
                _ => "its ports named",
            };
            wrong(e.kind.span, format!("`{name}` (a `{kind}`) needs {what}"), &format!("write {example}"));
            sound = false;
        }
        for (i, (p, k)) in e.ports.iter().zip(&kinds).enumerate() {
            if k.is_none() || (kind != "IC" && p.kind.is_some()) {
                let what = if kind == "IC" { "is neither `I` nor `C`" } else { "has a kind of its own" };
                wrong(
                    p.name.span,
                    format!("the port `{}` of `{name}` {what}", p.name.text),
                    &format!("write {example}"),
                );
                sound = false;
            }
            if let Some(index) = p.index.first() {
                let what = format!("the port `{}` of `{name}` has an index", p.name.text);
                wrong(index.span, what, "name its ports one by one; a `TF` or a `GY` takes bundles");
                sound = false;
            }
            if e.ports[..i].iter().any(|q| q.name.text == p.name.text) {
                wrong(p.name.span, format!("`{name}` has two ports `{}`", p.name.text), "rename one of them");
                sound = false;
            }
        }
        if !e.args.is_empty() {
            wrong(
                e.span,
                format!("`{name}` is a field, and takes no arguments in parentheses"),
                "give fields in braces",
            );
            sound = false;
        }
        if e.active && kind != "R" {
            wrong(e.span, format!("`{name}` cannot be active: only an `R` can"), "take `active` away");
            sound = false;
        }
        if !sound {
            self.declare(scope, key, Entity::Missing, e.name.span);
            return;
        }
        let field = self.fields.len();
        if !self.declare(scope, key, Entity::Field(field), e.name.span) {
            return;
        }
        let span = e.kind.span.to(e.name.span);
        let mut members = Vec::new();
        for (place, (p, kind)) in e.ports.iter().zip(kinds).enumerate() {
            let Some(kind) = kind else { continue };
            members.push(ElementId(self.elements.len() as u32));
            self.elements.push(Decl {
                name: format!("{name}.{}", p.name.text),
                kind,
                ast: Some(e),
                scope,
                sampling,
                span,
                field: Some((field, place)),
            });
        }
        let ports = e.ports.iter().map(|p| p.name.text.clone()).collect();
        self.fields.push(super::FieldDecl { name, ast: e, ports, members });
    }

    fn instance_or_unknown(
        &mut self,
        e: &'a Decl_,
        kind: &str,
        key: String,
        name: String,
        scope: ScopeId,
        sampling: Option<usize>,
    ) {
        let instance = self.scopes[scope].instance;
        let file = self.instances[instance].model.0;
        let meant = self.files.visible[file].get(kind).map_or(&[][..], Vec::as_slice);
        if meant.len() > 1 {
            self.errors.push(self.files.ambiguous(self.sources, "model", &e.kind, meant));
            self.declare(scope, key, Entity::Missing, e.name.span);
            return;
        }
        let Some(&model) = meant.first() else {
            self.declare(scope, key, Entity::Missing, e.name.span);
            if self.files.gaps[file] {
                return;
            }
            // Each instance of the model has it.
            if !self.unknown_kinds.insert(e.kind.span) {
                return;
            }
            let mut known: Vec<&str> = element::ALL.iter().map(|k| k.0).collect();
            known.extend(self.files.visible[file].keys().map(String::as_str));
            known.sort_unstable();
            let mut error = Diagnostic::error(
                "elaborate::kind",
                e.kind.span,
                format!("unknown element kind `{kind}` (of `{name}`)"),
            );
            let model = format!("model {kind}");
            let head = |text: &str| {
                let after = text.split(&model).skip(1);
                after.map(str::chars).any(|mut rest| matches!(rest.next(), Some('(' | ' ' | '{')))
            };
            let bundled = super::LIBRARY.iter().find(|(_, text)| head(text)).map(|(name, _)| *name);
            error = match nearest(kind, known) {
                _ if bundled.is_some() => {
                    let name = bundled.unwrap_or_default();
                    error.help(format!("the library has it: write `use std.{name}` at the head of the file"))
                }
                Some(n) => error.help(format!("did you mean `{n}:{}`?", e.name.text)),
                None if let Some(fix) = foreign_kind(kind, &e.name.text) => error.help(fix),
                None => error
                    .help("the kinds are Se, Sf, C, I, R, TF, GY, 0, 1, De, Df; a model of another file needs `use`"),
            };
            self.errors.push(error);
            return;
        };
        if e.value.is_some() || e.fields.is_some() || e.active {
            self.errors.push(
                Diagnostic::error(
                    "elaborate::arguments",
                    e.span,
                    format!("`{name}` is an instance of the model `{kind}`"),
                )
                .help(format!("give parameters in parentheses: `{kind}:{}(parameter = value)`", e.name.text)),
            );
        }
        let index = self.instances.len();
        if !self.declare(scope, key.clone(), Entity::Instance(index), e.name.span) {
            return;
        }
        if self.instantiate(model, name, Some((&e.args, scope)), sampling, e.span).is_none() {
            self.instances[instance].names.insert(key, (Entity::Missing, e.name.span));
        }
    }

    fn port(
        &mut self,
        (name, index): (&'a Name, &'a [Expr]),
        fields: &'a [Field],
        scope: ScopeId,
        sampling: Option<usize>,
    ) {
        let instance = self.scopes[scope].instance;
        if self.instances[instance].names.get(&name.text).is_some_and(|known| known.1 == name.span) {
            let message = format!("the port `{}` is declared in more than one round of its `for`", name.text);
            self.errors.push(Diagnostic::error("elaborate::twice", name.span, message).help(
                "declare all of them outside of the `for`, as a bundle, `port tip[1..3]`, or by names of their own",
            ));
            return;
        }
        let range = match self.range(&name.text, index, scope) {
            None => return self.lose_name(&name.text, scope),
            Some(None) if index.is_empty() => return self.port_at(name, name.text.clone(), fields, scope, sampling),
            Some(None) => {
                let of = self.sources.slice(index[0].span);
                let message = format!("the port `{}` has one index, and ports are indexed as bundles", name.text);
                let help = format!("for {of} ports write `port {}[1..{of}]`", name.text);
                self.errors.push(Diagnostic::error("elaborate::bundle", index[0].span, message).help(help));
                return self.lose_name(&name.text, scope);
            }
            Some(Some(range)) => range,
        };
        if self.declare_bundle(scope, &range, name.span) {
            for key in range.keys() {
                self.port_at(name, key, fields, scope, sampling);
            }
        }
    }

    /// Declares one port, of this name in its model.
    fn port_at(&mut self, name: &'a Name, key: String, fields: &'a [Field], scope: ScopeId, sampling: Option<usize>) {
        let instance = self.scopes[scope].instance;
        let full = self.full_name(instance, &key);
        if instance == 0 {
            // An open port of the scene is an element of its own.
            let id = ElementId(self.elements.len() as u32);
            if self.declare(scope, key, Entity::Element(id), name.span) {
                let span = name.span;
                self.elements.push(Decl {
                    name: full,
                    kind: Kind::PORT,
                    ast: None,
                    scope,
                    sampling,
                    span,
                    field: None,
                });
                self.open_ports.push((id, fields, scope));
                if fields.iter().any(|f| f.name() == "impedance") {
                    self.wave_ports.push(id);
                }
            }
            return;
        }
        self.inner_port(scope, key, name.span);
    }

    /// Declares a port of the instance that a scope is of; which one, if the name was free.
    pub(super) fn inner_port(&mut self, scope: ScopeId, key: String, span: Span) -> Option<usize> {
        let (port, instance) = (self.ports.len(), self.scopes[scope].instance);
        let name = self.full_name(instance, &key);
        let (inside, outside) = (Vec::new(), Vec::new());
        self.declare(scope, key, Entity::Port(port), span).then(|| {
            self.ports.push(PortDecl { name, span, inside, outside, instance });
            port
        })
    }

    fn sampled(
        &mut self,
        block: &'a Sampled,
        span: Span,
        scope: ScopeId,
        outer: Option<usize>,
        chains: &mut Vec<(&'a Chain, ScopeId)>,
    ) {
        if let Some(outer) = outer {
            self.errors.push(
                Diagnostic::error("elaborate::sampled", span, "a `sampled` block stands inside another one")
                    .label(self.samplings[outer].span, "is the outer one")
                    .help("place them beside each other and join them by `||>`"),
            );
            self.block(&block.body, scope, Some(outer), true, chains);
            return;
        }
        let period = match &block.clock {
            Clock::At(e) => {
                self.constant(e, scope, crate::units::Dimension::SECOND.pow(-1, 1), "the rate").map(|x| 1.0 / x)
            }
            Clock::Every(e) => self.constant(e, scope, crate::units::Dimension::SECOND, "the period"),
        };
        let (Clock::At(e) | Clock::Every(e)) = &block.clock;
        let clock = e.span;
        if let (Clock::At(e), Some(p)) = (&block.clock, period)
            && let Some(unit) = angular(e)
        {
            let turns = 1.0 / p / std::f64::consts::TAU;
            self.errors.push(
                Diagnostic::error(
                    "elaborate::period",
                    clock,
                    format!("samples are taken at a rate in Hz, and not in `{unit}`"),
                )
                .help(format!("write `at {} Hz` for one sample a turn", told(turns))),
            );
        }
        let period = match period {
            Some(p) if p > 0.0 && p.is_finite() => p,
            Some(p) => {
                self.errors.push(
                    Diagnostic::error(
                        "elaborate::period",
                        clock,
                        match &block.clock {
                            Clock::At(_) => format!("a rate of {} Hz cannot be run", told(1.0 / p)),
                            Clock::Every(_) => format!("a period of {} s cannot be run", told(p)),
                        },
                    )
                    .help("give a positive rate or period, such as `at 1 kHz` or `every 40 ms`"),
                );
                1.0
            }
            None => 1.0,
        };
        let hold = match &block.hold {
            None => Hold::default(),
            Some(n) => match Hold::ALL.iter().find(|h| h.name() == n.text) {
                Some(h) => *h,
                None => {
                    self.errors.push(
                        Diagnostic::error("elaborate::hold", n.span, format!("unknown hold `{}`", n.text)).help(
                            match nearest(&n.text, Hold::ALL.map(Hold::name)) {
                                Some(near) => format!("did you mean `{near}`?"),
                                None => "the holds are lagged, predicted and matched".into(),
                            },
                        ),
                    );
                    Hold::default()
                }
            },
        };
        let latency = block.latency.as_ref().map_or(0.0, |latency| self.latency(latency, scope, period));
        let id = self.samplings.len();
        self.samplings.push(Sampling {
            period,
            hold,
            hold_given: block.hold.is_some(),
            budget: block.budget.unwrap_or(true),
            method: block.method.as_ref().map(|n| n.text.clone()),
            latency,
            span: clock,
        });
        self.block(&block.body, scope, Some(id), true, chains);
    }

    /// The key of a name with its indices, `c[3]`.
    pub(super) fn key(&mut self, name: &str, index: &'a [Expr], scope: ScopeId) -> Option<String> {
        if index.is_empty() {
            return Some(name.to_string());
        }
        let numbers =
            index.iter().map(|e| self.integer(e, scope).map(|i| i.to_string())).collect::<Option<Vec<_>>>()?;
        Some(format!("{name}[{}]", numbers.join(",")))
    }
}

/// The instance that something of this path stands in.
pub(super) fn part(path: &str) -> &str {
    path.rsplit_once('.').map_or("", |(part, _)| part)
}

/// Where the values come from that some text in an instance names: the parameters that were given where an instance is
/// made, the outermost first; of a text that is but a name, its default too.
pub(super) fn given(params: &[Param<'_>], sources: &Sources, instance: &str, text: &str) -> Vec<(String, Span)> {
    let words: Vec<&str> = text.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
    let (mut found, mut outside) = (Vec::new(), Vec::new());
    for p in params {
        let at = part(&p.name);
        let name = p.name[at.len()..].trim_start_matches('.');
        let Some((value, _)) = p.value.filter(|_| at == instance && words.contains(&name)) else { continue };
        if p.given {
            outside.push((part(at), value.span));
        }
        if p.given || text.trim() == name {
            found.push((p.name.clone(), value.span));
        }
    }
    let mut all: Vec<(String, Span)> =
        outside.into_iter().flat_map(|(outer, span)| given(params, sources, outer, sources.slice(span))).collect();
    all.extend(found);
    all
}

/// A name that was declared before.
fn twice(key: &str, first: Span, second: Span) -> Diagnostic {
    Diagnostic::error("elaborate::twice", second, format!("`{key}` is declared twice"))
        .label(first, "is the first declaration")
        .help("a name is declared once in its model; rename one of them")
}

/// The unit of angle that a rate is written with: its number is that of radians, and not of turns.
fn angular(e: &Expr) -> Option<&str> {
    match &e.kind {
        ExprKind::Number { unit, .. } => {
            let symbols = unit.iter().flat_map(|u| &u.factors).map(|f| f.0.as_str());
            symbols.into_iter().find(|s| crate::units::ANGULAR.contains(s))
        }
        ExprKind::Paren(e) | ExprKind::Unary(_, e) => angular(e),
        ExprKind::Binary(_, a, b) => angular(a).or_else(|| angular(b)),
        ExprKind::Bool(_)
        | ExprKind::Path(_)
        | ExprKind::If(..)
        | ExprKind::Call(..)
        | ExprKind::List(_)
        | ExprKind::Range(..) => None,
    }
}
