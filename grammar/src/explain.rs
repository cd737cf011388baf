//! Explains, in a modeller's words, why the grammar refused a slice of text, and suggests a fix.

use crate::bracket::{is_bare_model, is_misspelt_model};
use crate::diagnostic::Diagnostic;
use crate::scan::{Kind, Scan, is_symbol_start};
use std::ops::Range;

mod notation;
mod statement;

/// The rule by which a slice was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Piece {
    /// `use ...`
    Use,
    /// `let f(x) = value` outside of models.
    Function,
    /// `model Name(params)`
    ModelHead,
    /// A statement without a body of statements.
    Statement,
    /// `for i in 1..n`
    ForHead,
    /// `if condition`
    IfHead,
    /// `sampled at 25 Hz`
    SampledHead,
    /// An expression alone.
    Value,
}

/// Where the grammar gave up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Refused {
    /// The byte up to which the text made sense.
    pub at: usize,
    /// Whether the text was too large, and not wrong.
    pub limit: bool,
}

/// Words that begin a statement.
const STATEMENTS: &[&str] =
    &["let", "probe", "input", "output", "state", "port", "for", "if", "sampled", "simulate", "expect", "active"];

/// A refused slice, and the place at which it was refused.
struct Wreck<'a> {
    scan: &'a Scan<'a>,
    piece: Piece,
    range: Range<usize>,
    /// The token that did not fit; the end of the range where the slice ended too early.
    at: usize,
}

/// The grammar's call limit was reached.
pub(crate) fn limit_reached(scan: &Scan, at: usize) -> Diagnostic {
    let span = scan.span_of(scan.token_at(at));
    let error = Diagnostic::error("syntax::too_deep", span, "this text is too large or nested too deep to be read");
    error.help("split it into several models or files")
}

/// `for`, `if`, `else` or `sampled` without `{ ... }`.
pub(crate) fn no_body(scan: &Scan, head: Range<usize>) -> Diagnostic {
    let word = scan.word(head.start);
    let span = scan.span_of(head.end.max(head.start + 1) - 1);
    let message = format!("after this `{word}` its body is missing");
    if word == "if" && head.clone().any(|index| scan.word(index) == "else") {
        let error = Diagnostic::error("syntax::if", scan.span_of(head.start), "a value is chosen by `then` and `else`");
        return error.help("write `if condition then value else value`");
    }
    Diagnostic::error("syntax::body", span, message).help("write its statements between `{` and `}`")
}

/// That a text without bonds is written in the language of another tool, with what stands for its parts here.
pub(crate) fn other_language(scan: &Scan) -> Option<Diagnostic> {
    let count = scan.tokens.len();
    if (0..count).any(|index| matches!(scan.word(index), "->" | "||>" | "->|" | "|->")) {
        return None;
    }
    let begins = |index: &usize| scan.tokens[*index].first;
    let modelica = |index: &usize| match scan.word(*index) {
        "Modelica" => scan.word(index + 1) == ".",
        "equation" | "algorithm" => begins(index) && scan.kind(index + 1) == Some(Kind::Word),
        "end" => begins(index) && scan.kind(index + 1) == Some(Kind::Word) && matches!(scan.word(index + 2), ";" | ""),
        _ => false,
    };
    let sidops = |index: &usize| {
        matches!(scan.word(*index), "equations" | "variables" | "parameters")
            && begins(index)
            && scan.kind(index + 1) == Some(Kind::Word)
    };
    let (tool, at) = (0..count)
        .find(modelica)
        .map(|at| ("Modelica", at))
        .or_else(|| (0..count).find(sidops).map(|at| ("20-sim", at)))?;
    let message = format!("this looks like text of {tool}, which has other statements");
    let help = match tool {
        "Modelica" => {
            "write components as elements, `Resistor R1(R=10)` as `R:R1 = 10 Ohm`; what `connect` joins as bonds to a \
             junction, `1:loop -> R1, C1`; `der(x) = f` as the law of a storage or as `state x = 0 { dx = f }`; and \
             the whole in `model Name { ... }`. `bond new NAME` makes a model to begin with"
        }
        _ => {
            "write parameters in the head, `model Name(R = 10 Ohm) { ... }`; variables as `let x = ...`; equations as \
             laws of elements, `R:r { e = R*f }`, which bonds join, `1:loop -> r, c`. `bond new NAME` makes a model to \
             begin with"
        }
    };
    Some(Diagnostic::error("syntax::language", scan.span_of(at), message).help(help))
}

/// Text outside of all models.
pub(crate) fn outside(scan: &Scan, range: Range<usize>) -> Diagnostic {
    let found = scan.word(range.start);
    let span = scan.span_of(range.start);
    if found == "#" || notation::opens_comment(scan, range.start) {
        return notation::no_comment(scan, range.start);
    }
    if near(found, &["model", "use"]).is_some_and(|word| word != found) {
        let word = near(found, &["model", "use"]).unwrap_or("model");
        let message = format!("`{found}` cannot begin a declaration of a file");
        return Diagnostic::error("syntax::outside", span, message).help(format!("did you mean `{word}`?"));
    }
    let function = found == "def" && scan.word(range.start + 2) == "(";
    if let Some(help) = statement::foreign(if function { "function" } else { found }) {
        let message = format!("`{found}` cannot begin a declaration of a file");
        return Diagnostic::error("syntax::outside", span, message).help(help);
    }
    if is_misspelt_model(scan, range.start) && found != "model" {
        let message = format!("`{found}` cannot begin a declaration of a file");
        let help = format!("a model begins with `model`: `model {} ...`", scan.word(range.start + 1));
        return Diagnostic::error("syntax::outside", span, message).help(help);
    }
    if is_bare_model(scan, range.start) {
        let message = format!("`{found}` stands outside of any model");
        let help = format!(
            "a model begins with `model`: `model {found}{}`",
            if scan.word(range.start + 1) == "{" { " { ... }" } else { "(...) { ... }" }
        );
        return Diagnostic::error("syntax::outside", span, message).help(help);
    }
    let message = format!("`{found}` stands outside of any model");
    let help = "a file holds `use` lines, functions `let f(x) = ...` and models; write the statement inside `model Name { ... }`";
    Diagnostic::error("syntax::outside", span, message).help(help)
}

/// Whether a word begins a statement of another tool, for which there is a suggested fix.
pub(crate) fn is_foreign(word: &str) -> bool {
    statement::foreign(word).is_some()
}

/// Says why a slice was refused.
pub(crate) fn refused(scan: &Scan, piece: Piece, range: Range<usize>, refused: Refused) -> Diagnostic {
    if refused.limit {
        return limit_reached(scan, refused.at);
    }
    let at = scan.token_at(refused.at).clamp(range.start, range.end);
    let wreck = Wreck { scan, piece, range, at };
    let checks = [
        Wreck::block_comment,
        Wreck::strange,
        Wreck::reserved_name,
        Wreck::arrow,
        Wreck::bond_name,
        Wreck::operator,
        Wreck::decimal_comma,
        Wreck::colon,
        Wreck::spaced_unit,
        Wreck::dotted_unit,
        Wreck::exponent,
        Wreck::equals,
        Wreck::chain_value,
        Wreck::list,
        Wreck::assignment,
        Wreck::positional,
        Wreck::declaration_first,
        Wreck::head,
        Wreck::misspelt,
        Wreck::operand,
        Wreck::parts,
    ];
    // `1 to n` is not a number with a unit.
    let first = (piece == Piece::ForHead).then(|| wreck.head()).flatten();
    first.or_else(|| checks.iter().find_map(|check| check(&wreck))).unwrap_or_else(|| wreck.unexpected())
}

impl<'a> Wreck<'a> {
    fn word(&self, index: usize) -> &'a str {
        if self.range.contains(&index) { self.scan.word(index) } else { "" }
    }

    fn kind(&self, index: usize) -> Option<Kind> {
        if self.range.contains(&index) { self.scan.kind(index) } else { None }
    }

    /// The token before the one that did not fit.
    fn before(&self) -> usize {
        self.at.max(self.range.start + 1) - 1
    }

    /// Tokens follow one another without a gap.
    fn adjacent(&self, index: usize) -> bool {
        let end = self.scan.tokens.get(index).map(|token| token.end);
        end.is_some() && end == self.scan.tokens.get(index + 1).map(|token| token.start)
    }

    fn error(&self, code: &'static str, index: usize, message: impl Into<String>) -> Diagnostic {
        let last = self.range.end.max(1) - 1;
        Diagnostic::error(code, self.scan.span_of(index.min(last)), message)
    }

    /// The text at the place, for a message.
    fn found(&self) -> String {
        match self.word(self.at) {
            "" => "the statement ends".to_string(),
            word => format!("`{word}` stands there"),
        }
    }

    /// The token lies behind an `=` or in a bracket, so it belongs to an expression.
    fn in_value(&self, index: usize) -> bool {
        (self.range.start..index).any(|index| matches!(self.word(index), "=" | "(" | "{"))
            || matches!(self.word(self.range.start), "let" | "probe" | "input" | "output" | "state" | "expect")
    }

    /// The innermost bracket that is open at the place.
    fn open_bracket(&self) -> Option<&'a str> {
        let mut closed = 0;
        for index in (self.range.start..self.at).rev() {
            match self.word(index) {
                ")" | "]" | "}" => closed += 1,
                word @ ("(" | "[" | "{") => {
                    if closed == 0 {
                        return Some(word);
                    }
                    closed -= 1;
                }
                _ => {}
            }
        }
        None
    }

    /// A value is missing.
    fn operand(&self) -> Option<Diagnostic> {
        let before = self.before();
        if self.at == self.range.start {
            let message = format!("a value is expected, but {}", self.found());
            return (self.piece == Piece::Value).then(|| self.error("syntax::value", self.at, message));
        }
        let word = self.word(before);
        if word == "else" && self.word(self.at) == "{" {
            let error = self.error("syntax::if", before, "this `else` has no `if` before it");
            return Some(error.help("it follows the `}` of its `if` at once, without a `;`"));
        }
        if self.word(self.at) == "+" && matches!(word, "=" | "(" | "," | "+" | "-" | "*" | "/" | "then" | "else") {
            let message = format!("a value is expected after `{word}`, but {}", self.found());
            return Some(self.error("syntax::value", self.at, message).help("take the `+` away"));
        }
        let (what, help) = match word {
            "->" | "||>" | "->|" | "|->" => {
                ("an element, a junction or a port", "write what the bond leads to, such as `1:v`")
            }
            "+" | "-" | "*" | "/" | "^" | "<" | ">" | "<=" | ">=" | "==" | "!=" | "=" | "(" | "[" | "and" | "or"
            | "not" | "if" | "then" | "else" | "at" | "every" | "within" | ".." | "expect" | "latency" => {
                ("a value", "write a number with its unit, such as `5 N`, or an expression")
            }
            "," => ("a further entry", "write it, or remove the comma"),
            "." => ("a name", "name a part, as in `wall.tip`"),
            "hold" => ("a name", "the holds are lagged, predicted and matched"),
            "method" => ("a name", "the methods of a sampled region are gonzalez and ray"),
            "budget" => ("`on` or `off`", "write `budget off`"),
            _ => return None,
        };
        let message = format!("{what} is expected after `{word}`, but {}", self.found());
        let mut error = self.error("syntax::value", self.at, message).help(help);
        if self.kind(self.at) == Some(Kind::Text) {
            let bare = self.word(self.at).trim_matches('"');
            error = error.help(format!("quotes are for paths alone: write `{bare}`"));
        }
        Some(match self.word(self.at) {
            "" => error.here(format!("nothing follows `{word}`")),
            _ => error,
        })
    }

    /// `if` without `then`, without `else`.
    fn parts(&self) -> Option<Diagnostic> {
        let mut open = Vec::new();
        for index in self.range.start..self.at {
            match self.word(index) {
                "if" if self.piece != Piece::IfHead || index > self.range.start => open.push("then"),
                "then" | "else" => {
                    open.pop();
                    if self.word(index) == "then" {
                        open.push("else");
                    }
                }
                _ => {}
            }
        }
        let wanted = open.last()?;
        let message = format!("`{wanted}` is expected here, but {}", self.found());
        let error = self.error("syntax::if", self.at, message);
        let other = if *wanted == "else" { "; say what it is otherwise, such as `else 0`" } else { "" };
        Some(error.help(format!("a choice is written `if condition then value else value`{other}")))
    }

    fn unexpected(&self) -> Diagnostic {
        let what = match self.piece {
            Piece::Use => "`use` line",
            Piece::Function => "function",
            Piece::ModelHead => "head of a model",
            Piece::Statement => "statement",
            Piece::ForHead => "head of a `for`",
            Piece::IfHead => "condition",
            Piece::SampledHead => "head of a sampled region",
            Piece::Value => "expression",
        };
        let before = self.word(self.before());
        let message = match self.word(self.at) {
            "" => format!("this {what} is incomplete: something is missing after `{before}`"),
            word if self.at == self.range.start => format!("`{word}` begins no {what}"),
            word => format!("`{word}` does not fit after `{before}` in this {what}"),
        };
        let error = self.error("syntax::unexpected", self.at, message);
        if self.at > self.range.start && STATEMENTS.contains(&self.word(self.at)) {
            let word = self.word(self.at);
            let name = if matches!(word, "let" | "probe" | "input" | "output" | "state") { " name =" } else { "" };
            return error.help(format!("complete the statement that `{word}` begins: `{word}{name} ...`"));
        }
        let start = self.range.start;
        let given = self.word(start + 3) == "=" && self.before() > start + 3;
        if self.word(self.at) == "{" && self.scan.starts_element(start) && given {
            let value = self.scan.slice(self.scan.span_of(start + 4).to(self.scan.span_of(self.before())));
            return self.several(self.at + 1, value);
        }
        if matches!(self.word(self.at), ".." | ":") && self.open_bracket() == Some("[") {
            return error.help(
                "a range has two dots, and is the last index of a bundle, `C:cap[1..3] = c`, or that of a `for`",
            );
        }
        let chain = (self.range.start..self.at).any(|index| matches!(self.word(index), "->" | "||>" | "->|" | "|->"));
        if chain && self.scan.is_name(self.before()) && self.scan.is_name(self.at) && self.open_bracket().is_none() {
            return error
                .help(format!("elements of a list have commas between them: `{before}, {}`", self.word(self.at)));
        }
        if self.word(self.at) == "." && before == ")" {
            let open = (self.range.start..self.before()).rfind(|index| self.word(*index) == "(");
            let name = open.and_then(|open| open.checked_sub(1)).filter(|index| self.scan.is_name(*index));
            if let (Some(open), Some(name)) = (open, name) {
                let within = self.scan.slice(self.scan.span_of(open + 1).to(self.scan.span_of(self.before() - 1)));
                let (name, part) = (self.word(name), self.word(self.at + 1));
                return error.help(format!("an index stands in square brackets: `{name}[{within}].{part}`"));
            }
        }
        let follows = self.word(self.at) == "," && self.scan.starts_element(self.at + 1);
        if follows && self.piece == Piece::Statement && self.open_bracket().is_none() {
            return error.help("statements have no comma between them: write `;`, a space or a new line");
        }
        let operand = |index| self.scan.ends_operand(index) && self.range.contains(&index);
        let starts = self.word(self.at).starts_with(|c: char| is_symbol_start(c) || c.is_ascii_digit() || c == '(');
        let fits = self.at > self.range.start && operand(self.before()) && starts && self.in_value(self.at);
        let named = self.piece == Piece::ModelHead && self.kind(self.before()) == Some(Kind::Word);
        if fits && named && self.kind(self.at) == Some(Kind::Number) {
            return error.help(format!("a parameter is given with `=`: `{before} = {}`", self.word(self.at)));
        }
        let bracket = self.word(self.at) == "[" && self.word(self.at + 1) != "]";
        if bracket && self.kind(self.before()) == Some(Kind::Number) {
            let end = (self.at..self.range.end).find(|index| self.word(*index) == "]").unwrap_or(self.at + 1);
            let unit = self.scan.slice(self.scan.span_of(self.at + 1).to(self.scan.span_of(end.max(self.at + 2) - 1)));
            let unit = unit.strip_prefix("1/").map_or(unit.to_string(), |below| format!("{below}^-1"));
            return error.help(format!("a unit stands without brackets: `{before} {unit}`"));
        }
        if self.open_bracket() == Some("(") && self.word(self.at) == ";" && self.piece == Piece::Statement {
            return error.help("in parentheses commas stand between the arguments");
        }
        if fits
            && self.word(self.at) == "1"
            && self.word(self.at + 1) == "/"
            && self.kind(self.at + 2) == Some(Kind::Word)
        {
            let unit = self.word(self.at + 2);
            return error.help(format!("a unit has no `1/`: write `{before} {unit}^-1`"));
        }
        if fits {
            return error.help(format!("an operator is missing between `{before}` and `{}`", self.word(self.at)));
        }
        error
    }
}

/// The correct form of a unit with a decimal exponent: `m^(1/2)` for `m` and `0.5`.
pub(crate) fn exponent(unit: &str, decimals: &str) -> Option<String> {
    let x: f64 = decimals.parse().ok().filter(|x: &f64| x.fract() != 0.0 && x.abs() < 100.0)?;
    let below = (2..=9).find(|below| (x * f64::from(*below)).fract() == 0.0)?;
    Some(format!("{unit}^({}/{below})", (x * f64::from(below)) as i32))
}

/// The word of a list that differs from this one by one letter added, dropped, changed or swapped.
fn near<'w>(word: &str, list: &[&'w str]) -> Option<&'w str> {
    let lower: Vec<char> = word.to_lowercase().chars().collect();
    let close = |right: &str| {
        let right: Vec<char> = right.chars().collect();
        let head = lower.iter().zip(&right).take_while(|(a, b)| a == b).count();
        let (a, b) = (&lower[head..], &right[head..]);
        let tail = a.iter().rev().zip(b.iter().rev()).take_while(|(a, b)| a == b).count();
        match (&a[..a.len() - tail], &b[..b.len() - tail]) {
            ([] | [_], [] | [_]) => true,
            ([x, y], [u, v]) => x == v && y == u,
            _ => false,
        }
    };
    list.iter().copied().find(|right| lower.len() > 3 && close(right))
}
