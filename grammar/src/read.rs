//! From slices of a text to pieces of its tree. The one module that touches raw pest pairs.

use crate::ast::*;
use crate::diagnostic::Diagnostic;
use crate::explain::Refused;
use crate::scan::{Kind, Scan};
use crate::source::Span;
use pest::Parser;
use pest::error::{ErrorVariant, InputLocation};
use pest::iterators::Pair;
use std::num::NonZeroUsize;

mod expression;

#[allow(missing_docs)]
mod generated {
    #[derive(pest_derive::Parser)]
    #[grammar = "bond.pest"]
    pub(super) struct BondParser;
}
use generated::{BondParser, Rule};

/// Reads slices of one text.
pub(crate) struct Reader<'a> {
    /// The text's tokens.
    pub scan: &'a Scan<'a>,
    /// What is wrong so far.
    pub errors: Vec<Diagnostic>,
    /// Whether a symbol is a unit.
    is_unit: &'a dyn Fn(&str) -> bool,
    /// Where the present slice begins.
    offset: usize,
}

/// Most rules that the grammar may try per text; a text of the greatest length needs less than half of them.
const MAX_CALLS: usize = 1_000_000_000;

impl<'a> Reader<'a> {
    /// A reader that has read nothing.
    pub fn new(scan: &'a Scan<'a>, is_unit: &'a dyn Fn(&str) -> bool) -> Self {
        // Global, and the same for everyone.
        pest::set_call_limit(NonZeroUsize::new(MAX_CALLS));
        Reader { scan, errors: Vec::new(), is_unit, offset: 0 }
    }

    /// Makes refusals name the furthest place that was reached, which costs time. Global, and never undone.
    pub fn tell_places() {
        pest::set_error_detail(true);
    }

    /// Reads a slice by a rule of the grammar.
    fn read(&mut self, rule: Rule, start: usize, end: usize) -> Result<Pair<'a, Rule>, Refused> {
        self.offset = start;
        match BondParser::parse(rule, &self.scan.text[start..end]) {
            Ok(mut pairs) => pairs.next().ok_or(Refused { at: start, limit: false }),
            Err(error) => {
                let located = match error.location {
                    InputLocation::Pos(at) | InputLocation::Span((at, _)) => at,
                };
                let furthest = error.parse_attempts().map_or(located, |attempts| attempts.max_position.max(located));
                let limit = matches!(error.variant, ErrorVariant::CustomError { .. });
                Err(Refused { at: (start + furthest).min(end), limit })
            }
        }
    }

    /// Reads all of the text as a file.
    pub fn whole_file(&mut self) -> Result<Vec<Item>, Refused> {
        let pair = self.read(Rule::file, 0, self.scan.text.len())?;
        Ok(self.file(pair))
    }

    /// Reads all of the text as one expression.
    pub fn whole_expr(&mut self) -> Result<Option<Expr>, Refused> {
        let pair = self.read(Rule::one_expr, 0, self.scan.text.len())?;
        Ok(pair.into_inner().next().map(|pair| self.expr(pair)))
    }

    /// Reads a `use` from a slice.
    pub fn one_use(&mut self, start: usize, end: usize) -> Result<Item, Refused> {
        let pair = self.read(Rule::one_use, start, end)?;
        Ok(Item::Use(self.use_item(inner(pair))))
    }

    /// Reads a function of the file from a slice.
    pub fn one_function(&mut self, start: usize, end: usize) -> Result<Item, Refused> {
        let pair = self.read(Rule::one_function, start, end)?;
        Ok(Item::Function(self.function(inner(pair))))
    }

    /// Reads `model Name(params)` from a slice; its body is empty.
    pub fn one_model_head(&mut self, start: usize, end: usize) -> Result<Model, Refused> {
        let pair = self.read(Rule::one_model_head, start, end)?;
        Ok(self.model_head(inner(pair)))
    }

    /// Reads a statement from a slice.
    pub fn one_statement(&mut self, start: usize, end: usize) -> Result<Statement, Refused> {
        let pair = self.read(Rule::one_statement, start, end)?;
        Ok(self.statement(inner(pair)))
    }

    /// Reads a row of statements from a slice.
    pub fn statements(&mut self, start: usize, end: usize) -> Result<Vec<Statement>, Refused> {
        let pair = self.read(Rule::statements, start, end)?;
        let rows = children(pair).filter(|pair| pair.as_rule() == Rule::statement);
        Ok(rows.map(|pair| self.statement(pair)).collect())
    }

    /// Reads the part before the `{` of a `for`; its body is empty.
    pub fn one_for_head(&mut self, start: usize, end: usize) -> Result<For, Refused> {
        let pair = self.read(Rule::one_for_head, start, end)?;
        Ok(self.for_head(inner(pair)))
    }

    /// Reads the part before the `{` of an `if`: the condition.
    pub fn one_if_head(&mut self, start: usize, end: usize) -> Result<Expr, Refused> {
        let pair = self.read(Rule::one_if_head, start, end)?;
        Ok(self.expr(inner(inner(pair))))
    }

    /// Reads the part before the `{` of a `sampled`; its body is empty.
    pub fn one_sampled_head(&mut self, start: usize, end: usize) -> Result<Sampled, Refused> {
        let pair = self.read(Rule::one_sampled_head, start, end)?;
        Ok(self.sampled_head(inner(pair)))
    }

    fn span(&self, pair: &Pair<Rule>) -> Span {
        let span = pair.as_span();
        let (start, end) = (self.offset + span.start(), self.offset + span.end());
        self.scan.span(start, self.scan.trim_end(start, end))
    }

    fn name(&self, pair: &Pair<Rule>) -> Name {
        Name { text: pair.as_str().to_string(), span: self.span(pair) }
    }

    fn file(&mut self, pair: Pair<Rule>) -> Vec<Item> {
        let mut items = Vec::new();
        for pair in children(pair) {
            match pair.as_rule() {
                Rule::use_item => items.push(Item::Use(self.use_item(pair))),
                Rule::model => items.push(Item::Model(self.model(pair))),
                Rule::function => items.push(Item::Function(self.function(pair))),
                _ => {}
            }
        }
        items
    }

    fn use_item(&mut self, pair: Pair<Rule>) -> Use {
        let span = self.span(&pair);
        let target = inner(pair);
        let target = match target.as_rule() {
            Rule::string => UseTarget::File(target.as_str().trim_matches('"').to_string()),
            _ => UseTarget::Library(children(target).map(|pair| self.name(&pair)).collect()),
        };
        Use { target, span }
    }

    fn function(&mut self, pair: Pair<Rule>) -> Function {
        let span = self.span(&pair);
        let docs = self.scan.docs_before(span.start as usize);
        let mut parts = children(pair);
        let name = self.name(&next(&mut parts));
        let arguments = next(&mut parts).into_inner().map(|pair| self.name(&pair)).collect();
        Function { docs, name, arguments, value: self.expr(next(&mut parts)), span }
    }

    /// `let x = expr`, or with arguments a function.
    fn let_stmt(&mut self, pair: Pair<Rule>) -> StatementKind {
        if pair.clone().into_inner().any(|part| part.as_rule() == Rule::arguments) {
            return StatementKind::Function(self.function(pair));
        }
        StatementKind::Let(self.definition(inner(pair)))
    }

    fn definition(&mut self, pair: Pair<Rule>) -> Definition {
        let mut parts = children(pair).peekable();
        let name = self.name(&next(&mut parts));
        let index = self.indices_ahead(&mut parts);
        Definition { name, index, value: self.expr(next(&mut parts)) }
    }

    fn model(&mut self, pair: Pair<Rule>) -> Model {
        let span = self.span(&pair);
        let mut parts = children(pair);
        let mut model = self.model_head(next(&mut parts));
        model.body = self.block(next(&mut parts));
        model.span = span;
        model
    }

    fn model_head(&mut self, pair: Pair<Rule>) -> Model {
        let span = self.span(&pair);
        let docs = self.scan.docs_before(span.start as usize);
        let mut parts = children(pair);
        let name = self.name(&next(&mut parts));
        let params = parts.flat_map(children).map(|pair| self.param(pair)).collect();
        Model { docs, name, params, body: Vec::new(), lost: Vec::new(), span }
    }

    fn param(&mut self, pair: Pair<Rule>) -> Param {
        let span = self.span(&pair);
        let docs = self.scan.docs_before(span.start as usize);
        let mut parts = children(pair);
        let name = self.name(&next(&mut parts));
        Param { docs, name, default: parts.next().map(|pair| self.expr(pair)), span }
    }

    fn block(&mut self, pair: Pair<Rule>) -> Vec<Statement> {
        children(pair).map(|pair| self.statement(pair)).collect()
    }

    fn statement(&mut self, pair: Pair<Rule>) -> Statement {
        let span = self.span(&pair);
        let docs = self.scan.docs_before(span.start as usize);
        let pair = inner(pair);
        let rule = pair.as_rule();
        let kind = match rule {
            Rule::if_stmt => self.if_stmt(pair),
            Rule::declared_stmt => self.declared_stmt(pair),
            Rule::path_stmt => self.path_stmt(pair),
            Rule::let_stmt => self.let_stmt(pair),
            _ => {
                let mut parts = children(pair);
                match rule {
                    Rule::for_stmt => {
                        let head = self.for_head(next(&mut parts));
                        StatementKind::For(For { body: self.block(next(&mut parts)), ..head })
                    }
                    Rule::sampled_stmt => {
                        let head = self.sampled_head(next(&mut parts));
                        StatementKind::Sampled(Sampled { body: self.block(next(&mut parts)), ..head })
                    }
                    Rule::port_stmt => {
                        let name = self.name(&next(&mut parts));
                        let mut parts = parts.peekable();
                        let index = self.indices_ahead(&mut parts);
                        let fields = parts.next().map_or_else(Vec::new, |pair| self.fields(pair));
                        StatementKind::Port(name, index, fields)
                    }
                    Rule::simulate_stmt => StatementKind::Simulate(self.fields(next(&mut parts))),
                    Rule::expect_stmt => StatementKind::Expect(self.expect(parts)),
                    _ => {
                        let it = self.definition(next(&mut parts));
                        match rule {
                            Rule::state_stmt => StatementKind::State(it, self.fields(next(&mut parts))),
                            Rule::input_stmt => StatementKind::Input(it),
                            Rule::output_stmt => StatementKind::Output(it),
                            _ => StatementKind::Probe(it),
                        }
                    }
                }
            }
        };
        Statement { docs, kind, span }
    }

    fn for_head(&mut self, pair: Pair<Rule>) -> For {
        let mut parts = children(pair);
        let variable = self.name(&next(&mut parts));
        let from = self.expr(next(&mut parts));
        let to = self.expr(next(&mut parts));
        For { variable, from, to, body: Vec::new() }
    }

    fn if_stmt(&mut self, pair: Pair<Rule>) -> StatementKind {
        let mut parts = children(pair);
        let condition = self.expr(inner(next(&mut parts)));
        let body = self.block(next(&mut parts));
        let otherwise = parts.next().map(|pair| match pair.as_rule() {
            Rule::if_stmt => {
                let span = self.span(&pair);
                vec![Statement { docs: Vec::new(), kind: self.if_stmt(pair), span }]
            }
            _ => self.block(pair),
        });
        StatementKind::If(If { condition, body, otherwise })
    }

    fn sampled_head(&mut self, pair: Pair<Rule>) -> Sampled {
        let mut parts = children(pair);
        let at = next(&mut parts).as_rule() == Rule::kw_at;
        let value = self.expr(next(&mut parts));
        let clock = if at { Clock::At(value) } else { Clock::Every(value) };
        let mut sampled = Sampled { clock, hold: None, budget: None, method: None, latency: None, body: Vec::new() };
        for pair in parts {
            let (rule, span) = (pair.as_rule(), self.span(&pair));
            let twice = match rule {
                Rule::hold => sampled.hold.replace(self.name(&inner(pair))).is_some(),
                Rule::method => sampled.method.replace(self.name(&inner(pair))).is_some(),
                Rule::latency => sampled.latency.replace(self.expr(inner(pair))).is_some(),
                _ => sampled.budget.replace(self.name(&inner(pair)).text == "on").is_some(),
            };
            if twice {
                let word = self.scan.slice(span).split_whitespace().next().unwrap_or("");
                let message = format!("`{word}` is given twice for this sampled region");
                self.errors.push(Diagnostic::error("syntax::twice", span, message).help("keep one of them"));
            }
        }
        sampled
    }

    fn expect<'p>(&mut self, mut parts: impl Iterator<Item = Pair<'p, Rule>>) -> Expect {
        let first = next(&mut parts);
        if first.as_rule() == Rule::passive {
            let Some(at) = parts.next() else { return Expect::Passive };
            return Expect::PassiveAt(self.path(next(&mut children(at).filter(|pair| pair.as_rule() != Rule::kw_at))));
        }
        let value = self.expr(first);
        let Some(at) = parts.next() else { return Expect::Holds(value) };
        let mut parts = children(at).filter(|pair| pair.as_rule() != Rule::kw_at);
        let time = self.expr(next(&mut parts));
        let target = self.expr(next(&mut parts));
        let tolerance = self.expr(next(&mut parts));
        Expect::At { value, time, target, tolerance }
    }

    fn fields(&mut self, pair: Pair<Rule>) -> Vec<Field> {
        children(pair).map(|pair| self.field(pair)).collect()
    }

    fn field(&mut self, pair: Pair<Rule>) -> Field {
        let span = self.span(&pair);
        let mut parts = children(pair);
        let path = next(&mut parts).into_inner().map(|pair| self.name(&pair)).collect();
        Field { path, value: self.expr(next(&mut parts)), span }
    }

    fn declared_stmt(&mut self, pair: Pair<Rule>) -> StatementKind {
        let span = self.span(&pair);
        let mut parts = children(pair);
        let mut element = self.declared(next(&mut parts));
        let tail = next(&mut parts);
        if tail.as_rule() == Rule::chain_tail {
            return StatementKind::Chain(self.chain(End::Declare(element), tail));
        }
        element.span = span;
        for pair in children(tail) {
            match pair.as_rule() {
                Rule::args => element.args = self.fields(pair),
                Rule::fields => {
                    let span = self.span(&pair);
                    element.fields = Some((self.fields(pair), span));
                }
                _ => element.value = Some(self.expr(pair)),
            }
        }
        StatementKind::Element(element)
    }

    fn path_stmt(&mut self, pair: Pair<Rule>) -> StatementKind {
        let mut parts = children(pair);
        let path = self.path(next(&mut parts));
        self.not_after_number(&path);
        let first = End::Path(path);
        StatementKind::Chain(self.chain(first, next(&mut parts)))
    }

    /// Refuses `Se:u = 5 V -> R:r`, where the eye takes the first end of the bond for a unit.
    fn not_after_number(&mut self, path: &Path) {
        let start = path.span.start as usize;
        let Some(before) = self.scan.token_at(start).checked_sub(1) else { return };
        let number = self.scan.kind(before) == Some(Kind::Number);
        if number
            && self.scan.text[..start].strip_suffix(' ').is_some_and(|head| head.len() == self.scan.tokens[before].end)
        {
            let message = format!(
                "`{}` stands where the unit of `{}` would stand",
                path.segments[0].name.text,
                self.scan.word(before)
            );
            let help = "end the declaration with `;`, or write the bond on a line of its own";
            self.errors.push(Diagnostic::error("syntax::chain", path.span, message).help(help));
        }
    }

    fn declared(&mut self, pair: Pair<Rule>) -> Element {
        let span = self.span(&pair);
        let mut parts = children(pair).peekable();
        let active = parts.next_if(|pair| pair.as_rule() == Rule::kw_active).is_some();
        let kind = self.name(&next(&mut parts));
        let mut ports = Vec::new();
        if let Some(pair) = parts.next_if(|pair| pair.as_rule() == Rule::ports) {
            for pair in children(pair) {
                let mut parts = children(pair).peekable();
                let first = self.name(&next(&mut parts));
                let second = parts.next_if(|pair| pair.as_rule() == Rule::name).map(|pair| self.name(&pair));
                let (kind, name) = match second {
                    Some(name) => (Some(first), name),
                    None => (None, first),
                };
                ports.push(FieldPort { kind, name, index: self.indices(parts) });
            }
        }
        let name = self.name(&next(&mut parts));
        let index = self.indices(parts);
        Element { active, kind, ports, name, index, args: Vec::new(), value: None, fields: None, span }
    }

    fn chain(&mut self, first: End, tail: Pair<Rule>) -> Chain {
        let mut groups = vec![vec![first]];
        let (mut arrows, mut resolution) = (Vec::new(), None);
        for pair in children(tail) {
            match pair.as_rule() {
                Rule::arrow => arrows.push(self.arrow(pair)),
                Rule::ends => groups.push(children(pair).map(|pair| self.end(pair)).collect()),
                Rule::resolution => resolution = self.resolution(pair, &arrows),
                _ => {
                    let end = self.end(pair);
                    groups[0].push(end);
                }
            }
        }
        Chain { groups, arrows, resolution }
    }

    /// The resolution of a chain, one of whose arrows has to be a double bar.
    fn resolution(&mut self, pair: Pair<Rule>, arrows: &[Arrow]) -> Option<Expr> {
        let span = self.span(&pair);
        let value = self.expr(inner(pair));
        if arrows.iter().any(|arrow| arrow.sampled) {
            return Some(value);
        }
        let message = "a resolution is given for plain bonds";
        let help = "a sampled region reads a motion in steps at its double bar: write it behind `v ||> wall`";
        self.errors.push(Diagnostic::error("syntax::resolution", span, message).help(help));
        None
    }

    fn end(&mut self, pair: Pair<Rule>) -> End {
        match pair.as_rule() {
            Rule::declared => End::Declare(self.declared(pair)),
            _ => End::Path(self.path(pair)),
        }
    }

    fn arrow(&mut self, pair: Pair<Rule>) -> Arrow {
        let span = self.span(&pair);
        let mut arrow = Arrow { sampled: false, stroke: None, name: None, span };
        for pair in children(pair) {
            match pair.as_rule() {
                Rule::sampled_arrow => arrow.sampled = true,
                Rule::bond_name => {
                    let mut parts = children(pair);
                    let name = self.name(&next(&mut parts));
                    arrow.name = Some((name, self.indices(parts)));
                }
                Rule::tail_stroke => arrow.stroke = Some(Stroke::Tail),
                _ => {
                    if arrow.stroke.replace(Stroke::Head).is_some() {
                        let message = "this bond has a causal stroke at both ends";
                        let help = "a bond has one stroke: `|->` at its tail or `->|` at its head";
                        self.errors.push(Diagnostic::error("syntax::two_strokes", span, message).help(help));
                    }
                }
            }
        }
        arrow
    }
}

/// The next part of a pair, which the grammar promises.
fn next<'a>(parts: &mut impl Iterator<Item = Pair<'a, Rule>>) -> Pair<'a, Rule> {
    parts.next().expect("the grammar gives this rule a further part")
}

/// The parts of a pair without its keywords; `at`, `every` and `active` stay, they mean something.
fn children(pair: Pair<Rule>) -> impl Iterator<Item = Pair<Rule>> {
    pair.into_inner().filter(|part| {
        !matches!(
            part.as_rule(),
            Rule::kw_budget
                | Rule::kw_else
                | Rule::kw_expect
                | Rule::kw_for
                | Rule::kw_hold
                | Rule::kw_if
                | Rule::kw_in
                | Rule::kw_input
                | Rule::kw_latency
                | Rule::kw_let
                | Rule::kw_method
                | Rule::kw_model
                | Rule::kw_output
                | Rule::kw_port
                | Rule::kw_probe
                | Rule::kw_resolution
                | Rule::kw_sampled
                | Rule::kw_simulate
                | Rule::kw_state
                | Rule::kw_then
                | Rule::kw_use
                | Rule::kw_within
        )
    })
}

/// The first part of a pair, which the grammar promises.
fn inner(pair: Pair<Rule>) -> Pair<Rule> {
    next(&mut children(pair))
}
