//! Pieces of a tree as text on one line, with the places where a line that is too long may be broken.

use crate::ast::*;

/// A space at which a line may be broken.
pub(crate) const BREAK: char = '\u{1}';

/// `use ...`
pub(crate) fn used(used: &Use) -> String {
    match &used.target {
        UseTarget::File(path) => format!("use \"{path}\""),
        UseTarget::Library(names) => format!("use {}", dotted(names)),
    }
}

fn dotted(names: &[Name]) -> String {
    names.iter().map(|name| name.text.as_str()).collect::<Vec<_>>().join(".")
}

fn list<T>(items: &[T], separator: &str, show: impl Fn(&T) -> String) -> String {
    items.iter().map(show).collect::<Vec<_>>().join(&format!("{separator}{BREAK}"))
}

/// `k = 2 N/m`
pub(crate) fn param(param: &Param, source: &str) -> String {
    match &param.default {
        Some(value) => format!("{} = {}", param.name.text, expr(value, source)),
        None => param.name.text.clone(),
    }
}

/// `let f(x, y) = x*y`
pub(crate) fn function(it: &Function, source: &str) -> String {
    let arguments = list(&it.arguments, ",", |name| name.text.clone());
    format!("let {}({arguments}) = {}", it.name.text, expr(&it.value, source))
}

/// `a.e = 2 N`
pub(crate) fn field(field: &Field, source: &str) -> String {
    format!("{} = {}", dotted(&field.path), expr(&field.value, source))
}

fn fields(fields: &[Field], source: &str) -> String {
    match fields {
        [] => " {}".to_string(),
        _ => format!(" {{ {} }}", list(fields, ";", |item| field(item, source))),
    }
}

fn body(statements: &[Statement], source: &str) -> Option<String> {
    match statements {
        [] => Some(" {}".to_string()),
        [statement] => Some(format!(" {{ {} }}", one_line(statement, source)?)),
        _ => None,
    }
}

/// A statement on one line; nothing where several statements would come to stand on it.
pub(crate) fn one_line(statement: &Statement, source: &str) -> Option<String> {
    let head = head(statement, source);
    let rest = match &statement.kind {
        StatementKind::Element(Element { fields: Some((list, _)), .. })
        | StatementKind::State(_, list)
        | StatementKind::Simulate(list) => fields(list, source),
        StatementKind::Port(_, _, list) if !list.is_empty() => fields(list, source),
        StatementKind::For(For { body: statements, .. }) | StatementKind::Sampled(Sampled { body: statements, .. }) => {
            body(statements, source)?
        }
        StatementKind::If(choice) => {
            let otherwise = match choice.otherwise.as_deref() {
                None => String::new(),
                Some([Statement { kind: StatementKind::If(_), .. }]) => return None,
                Some(statements) => format!(" else{}", body(statements, source)?),
            };
            body(&choice.body, source)? + &otherwise
        }
        StatementKind::Element(_)
        | StatementKind::Port(..)
        | StatementKind::Chain(_)
        | StatementKind::Input(_)
        | StatementKind::Output(_)
        | StatementKind::Let(_)
        | StatementKind::Function(_)
        | StatementKind::Probe(_)
        | StatementKind::Expect(_) => String::new(),
    };
    Some(head + &rest)
}

/// A statement without its braces.
pub(crate) fn head(statement: &Statement, source: &str) -> String {
    let sets = |word: &str, it: &Definition| {
        format!("{word} {}{} = {}", it.name.text, index(&it.index, source), expr(&it.value, source))
    };
    match &statement.kind {
        StatementKind::Element(element) => self::element(element, source),
        StatementKind::Chain(chain) => self::chain(chain, source),
        StatementKind::Port(name, entries, _) => format!("port {}{}", name.text, index(entries, source)),
        StatementKind::Sampled(sampled) => self::sampled(sampled, source),
        StatementKind::For(repeat) => {
            let from = tight(&repeat.from, source);
            let space = if from.ends_with('.') { " " } else { "" };
            format!("for {} in {from}{space}..{}", repeat.variable.text, tight(&repeat.to, source))
        }
        StatementKind::If(choice) => if_head(choice, source),
        StatementKind::Input(it) => sets("input", it),
        StatementKind::Output(it) => sets("output", it),
        StatementKind::Let(it) => sets("let", it),
        StatementKind::Function(it) => function(it, source),
        StatementKind::Probe(it) => sets("probe", it),
        StatementKind::State(it, _) => sets("state", it),
        StatementKind::Simulate(_) => "simulate".to_string(),
        StatementKind::Expect(Expect::Passive) => "expect passive".to_string(),
        StatementKind::Expect(Expect::PassiveAt(at)) => format!("expect passive at {}", path(at, source)),
        StatementKind::Expect(Expect::Holds(value)) => format!("expect {}", expr(value, source)),
        StatementKind::Expect(Expect::At { value, time, target, tolerance }) => {
            let show = |value| expr(value, source);
            let (value, time, target) = (show(value), show(time), show(target));
            format!("expect {value} at {time} ={BREAK}{target}{BREAK}within {}", show(tolerance))
        }
    }
}

/// `if condition`
pub(crate) fn if_head(choice: &If, source: &str) -> String {
    format!("if {}", expr(&choice.condition, source))
}

fn sampled(sampled: &Sampled, source: &str) -> String {
    let mut text = match &sampled.clock {
        Clock::At(rate) => format!("sampled at {}", expr(rate, source)),
        Clock::Every(period) => format!("sampled every {}", expr(period, source)),
    };
    if let Some(hold) = &sampled.hold {
        text += &format!(" hold {}", hold.text);
    }
    if let Some(budget) = sampled.budget {
        text += if budget { " budget on" } else { " budget off" };
    }
    if let Some(method) = &sampled.method {
        text += &format!(" method {}", method.text);
    }
    if let Some(latency) = &sampled.latency {
        text += &format!(" latency {}", expr(latency, source));
    }
    text
}

fn index(index: &[Expr], source: &str) -> String {
    if index.is_empty() {
        return String::new();
    }
    let entries: Vec<String> = index.iter().map(|entry| tight(entry, source)).collect();
    format!("[{}]", entries.join(", "))
}

fn element(element: &Element, source: &str) -> String {
    let mut text = String::new();
    if element.active {
        text += "active ";
    }
    text += &element.kind.text;
    if !element.ports.is_empty() {
        let port = |port: &FieldPort| match &port.kind {
            Some(kind) => format!("{} {}{}", kind.text, port.name.text, index(&port.index, source)),
            None => port.name.text.clone() + &index(&port.index, source),
        };
        text += &format!("({})", list(&element.ports, ",", port));
    }
    text += &format!(":{}{}", element.name.text, index(&element.index, source));
    if !element.args.is_empty() {
        text += &format!("({})", list(&element.args, ",", |arg| field(arg, source)));
    }
    if let Some(value) = &element.value {
        text += &format!(" = {}", expr(value, source));
    }
    text
}

fn chain(chain: &Chain, source: &str) -> String {
    let end = |end: &End| match end {
        End::Path(path) => self::path(path, source),
        End::Declare(element) => self::element(element, source),
    };
    let mut text = String::new();
    for (position, group) in chain.groups.iter().enumerate() {
        if let Some(arrow) = position.checked_sub(1).and_then(|before| chain.arrows.get(before)) {
            text += &format!(" {}{BREAK}", self::arrow(arrow, source));
        }
        text += &list(group, ",", end);
    }
    if let Some(resolution) = &chain.resolution {
        text += &format!("{BREAK}resolution {}", expr(resolution, source));
    }
    text
}

fn arrow(arrow: &Arrow, source: &str) -> String {
    let name = arrow.name.as_ref().map(|(name, entries)| format!("-[{}{}]", name.text, index(entries, source)));
    let name = name.unwrap_or_default();
    match (arrow.sampled, arrow.stroke) {
        (true, _) => format!("{name}||>"),
        (false, Some(Stroke::Tail)) => format!("|{name}->"),
        (false, Some(Stroke::Head)) => format!("{name}->|"),
        (false, None) => format!("{name}->"),
    }
}

fn path(path: &Path, source: &str) -> String {
    let segment = |segment: &Segment| segment.name.text.clone() + &index(&segment.index, source);
    path.segments.iter().map(segment).collect::<Vec<_>>().join(".")
}

/// An expression, with spaces around sums.
pub(crate) fn expr(expr: &Expr, source: &str) -> String {
    let mut text = String::new();
    Printer { source, tight: false }.expr(expr, &mut text);
    text
}

/// An expression in an index or a range, where sums are written without spaces.
fn tight(expr: &Expr, source: &str) -> String {
    let mut text = String::new();
    Printer { source, tight: true }.expr(expr, &mut text);
    text
}

struct Printer<'a> {
    source: &'a str,
    tight: bool,
}

impl Printer<'_> {
    fn list(&self, items: &[Expr], text: &mut String) {
        for (position, item) in items.iter().enumerate() {
            if position > 0 {
                text.push(',');
                text.push(if self.tight { ' ' } else { BREAK });
            }
            self.expr(item, text);
        }
    }

    fn expr(&self, expr: &Expr, text: &mut String) {
        let space = if self.tight { ' ' } else { BREAK };
        match &expr.kind {
            ExprKind::Number { digits, unit } => {
                text.push_str(digits);
                if let Some(unit) = unit {
                    text.push(' ');
                    let (start, end) = (unit.span.start as usize, unit.span.end as usize);
                    text.push_str(self.source.get(start..end).unwrap_or(""));
                }
            }
            ExprKind::Bool(value) => text.push_str(if *value { "true" } else { "false" }),
            ExprKind::Path(path) => text.push_str(&self::path(path, self.source)),
            ExprKind::Unary(Unary::Neg, operand) => {
                text.push('-');
                self.expr(operand, text);
            }
            ExprKind::Unary(Unary::Not, operand) => {
                text.push_str("not ");
                self.expr(operand, text);
            }
            ExprKind::Binary(operator, left, right) => {
                self.expr(left, text);
                // `N-[` would begin a named bond
                let bracket = *operator == Binary::Sub && matches!(first_operand(right).kind, ExprKind::List(_));
                // What touches a unit, and is no part of it, is read so again; but `6 V*( m )` without its spaces is
                // another.
                let between = self.source.get(left.span.end as usize..right.span.start as usize);
                let grouped = matches!(first_operand(right).kind, ExprKind::Paren(_));
                let touches = between.is_some_and(|sign| sign.len() == 1) && !grouped;
                self.operator(*operator, ends_with_unit(left) && !touches, bracket, text);
                self.expr(right, text);
            }
            ExprKind::If(condition, then, otherwise) => {
                text.push_str("if ");
                self.expr(condition, text);
                text.push(space);
                text.push_str("then ");
                self.expr(then, text);
                text.push(space);
                text.push_str("else ");
                self.expr(otherwise, text);
            }
            ExprKind::Call(name, args) => {
                text.push_str(&name.text);
                text.push('(');
                self.list(args, text);
                text.push(')');
            }
            ExprKind::List(items) => {
                text.push('[');
                self.list(items, text);
                text.push(']');
            }
            ExprKind::Range(from, to) => {
                self.expr(from, text);
                // `1.` would take the first dot
                text.push_str(if text.ends_with('.') { " .." } else { ".." });
                self.expr(to, text);
            }
            ExprKind::Paren(inner) => {
                text.push('(');
                self.expr(inner, text);
                text.push(')');
            }
        }
    }

    fn operator(&self, operator: Binary, apart: bool, bracket: bool, text: &mut String) {
        let (sign, spaced) = match operator {
            Binary::Add => ("+", !self.tight),
            Binary::Sub => ("-", !self.tight || bracket),
            Binary::Mul => ("*", apart),
            Binary::Div => ("/", apart),
            Binary::Pow => ("^", apart),
            Binary::Lt => ("<", true),
            Binary::Le => ("<=", true),
            Binary::Gt => (">", true),
            Binary::Ge => (">=", true),
            Binary::Eq => ("==", true),
            Binary::Ne => ("!=", true),
            Binary::And => ("and", true),
            Binary::Or => ("or", true),
        };
        if spaced {
            text.push(' ');
        }
        text.push_str(sign);
        if spaced {
            text.push(if self.tight { ' ' } else { BREAK });
        }
    }
}

/// The operand that the text of an expression begins with.
fn first_operand(expr: &Expr) -> &Expr {
    match &expr.kind {
        ExprKind::Binary(_, first, _) => first_operand(first),
        ExprKind::Number { .. }
        | ExprKind::Bool(_)
        | ExprKind::Path(_)
        | ExprKind::Unary(..)
        | ExprKind::If(..)
        | ExprKind::Call(..)
        | ExprKind::List(_)
        | ExprKind::Range(..)
        | ExprKind::Paren(_) => expr,
    }
}

/// The text of an expression ends with a unit, which would swallow a `*` that follows without a space.
fn ends_with_unit(expr: &Expr) -> bool {
    match &expr.kind {
        ExprKind::Number { unit, .. } => unit.is_some(),
        ExprKind::Unary(_, last) | ExprKind::Binary(_, _, last) | ExprKind::If(_, _, last) => ends_with_unit(last),
        ExprKind::Bool(_)
        | ExprKind::Path(_)
        | ExprKind::Call(..)
        | ExprKind::List(_)
        | ExprKind::Range(..)
        | ExprKind::Paren(_) => false,
    }
}
