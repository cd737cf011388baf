//! Characters, operators, arrows and units of other notations.

use super::{Piece, Wreck};
use crate::diagnostic::Diagnostic;
use crate::scan::{Kind, Scan};

impl Wreck<'_> {
    /// A character that the language does not have, an open string.
    pub(super) fn strange(&self) -> Option<Diagnostic> {
        let index =
            self.range.clone().find(|&index| matches!(self.kind(index), Some(Kind::Strange | Kind::OpenText)))?;
        let word = self.word(index);
        if self.kind(index) == Some(Kind::OpenText) {
            let error = self.error("syntax::text", index, "this text in quotes does not end on its line");
            return Some(error.help("add the closing `\"`"));
        }
        let (message, help) = match word {
            "→" => ("`→` is no arrow of the language".to_string(), "write `->`"),
            "·" | "×" => (format!("`{word}` is no operator"), "write `*`"),
            "÷" => (format!("`{word}` is no operator"), "write `/`"),
            "²" | "³" | "¹" => (format!("`{word}` is no exponent"), "write `^2`, `^3`"),
            "−" | "–" | "—" => (format!("`{word}` is no minus sign"), "write `-`"),
            "≤" => ("`≤` is no comparison".to_string(), "write `<=`"),
            "≥" => ("`≥` is no comparison".to_string(), "write `>=`"),
            "≠" => ("`≠` is no comparison".to_string(), "write `!=`"),
            "&" => ("`&` is no operator".to_string(), "write `and`"),
            "√" => ("`√` is no operator".to_string(), "write `sqrt(x)`"),
            "∞" => (
                "there is no infinite number".to_string(),
                "leave the bound out, or write one that is never met, `1e9`",
            ),
            "%" => {
                ("`%` is no operator".to_string(), "a comment begins with `//`; a percentage is a hundredth, `0.05`")
            }
            "\u{a0}" => ("there is a no-break space here".to_string(), "write an ordinary space"),
            "#" => return Some(no_comment(self.scan, index)),
            "?" => ("`?` is no operator".to_string(), "a choice is written `if t > 1 s then 5 N else 0`"),
            "'" => ("single quotes mean nothing".to_string(), "a path is written in double quotes"),
            _ => (format!("the character {:?} means nothing here", word.chars().next().unwrap_or(' ')), "remove it"),
        };
        Some(self.error("syntax::character", index, message).help(help))
    }

    /// Arrows of other notations.
    pub(super) fn arrow(&self) -> Option<Diagnostic> {
        const WRONG: &[(&[&str], &str)] = &[
            (&["-", "->"], "->"),
            (&["-", "-", "->"], "->"),
            (&["==", ">"], "->"),
            (&["=", ">"], "->"),
            (&["|", "|", ">"], "||>"),
            (&["||>", ">"], "||>"),
            (&["|", ">"], "||>"),
            (&["-", ">"], "->"),
            (&["<", "-", ">"], "->"),
            (&["-", "-"], "->"),
            (&["->", ">"], "->"),
            (&["|-", ">"], "|->"),
            (&["|->", "|"], "|->"),
            (&["->", "|"], "->|"),
        ];
        if self.piece != Piece::Statement {
            return None;
        }
        let from = self.at.saturating_sub(2).max(self.range.start);
        for start in from..=self.at {
            for (row, right) in WRONG {
                if !row.iter().enumerate().all(|(offset, word)| self.word(start + offset) == *word) {
                    continue;
                }
                let end = start + row.len();
                let chain = start > self.range.start && (self.scan.is_name(end) || self.scan.starts_element(end));
                if !chain || end <= self.at || self.in_value(start) {
                    continue;
                }
                let span = self.scan.span_of(start).to(self.scan.span_of(end - 1));
                let message = format!("`{}` is no bond", self.scan.slice(span));
                return Some(Diagnostic::error("syntax::arrow", span, message).help(format!("write `{right}`")));
            }
        }
        let back = self.word(self.at) == "<" && self.word(self.at + 1) == "-" && !self.in_value(self.at);
        back.then(|| {
            let (left, right) = (self.end_before(self.at), self.end_after(self.at + 2));
            let span = self.scan.span_of(self.at).to(self.scan.span_of(self.at + 1));
            let help = format!("half arrows point to the right: write `{right} -> {left}`");
            Diagnostic::error("syntax::arrow", span, "`<-` is no bond").help(help)
        })
    }

    /// The end of a bond before a token, as written: `wall.tip`, `1:v`.
    fn end_before(&self, token: usize) -> &str {
        let mut start = token.max(self.range.start + 1) - 1;
        while start > self.range.start && !is_between(self.word(start - 1)) {
            start -= 1;
        }
        self.scan.slice(self.scan.span_of(start).to(self.scan.span_of(token.max(start + 1) - 1)))
    }

    /// The end of a bond that begins with a token.
    fn end_after(&self, token: usize) -> &str {
        let mut end = token;
        while !is_between(self.word(end + 1)) {
            end += 1;
        }
        if self.word(token).is_empty() {
            ""
        } else {
            self.scan.slice(self.scan.span_of(token).to(self.scan.span_of(end)))
        }
    }

    /// `/* ... */`, which is not a comment in this language.
    pub(super) fn block_comment(&self) -> Option<Diagnostic> {
        let index = [self.at, self.before()].into_iter().find(|i| opens_comment(self.scan, *i))?;
        Some(no_comment(self.scan, index))
    }

    /// `-[]->`, `-[1b]->`
    pub(super) fn bond_name(&self) -> Option<Diagnostic> {
        let before = self.before();
        let named = self.word(before) == "[" && before > self.range.start && self.word(before - 1) == "-";
        (named && self.at > before && self.piece == Piece::Statement && !self.in_value(before)).then(|| {
            let message = format!("the name of the bond is expected after `-[`, but {}", self.found());
            let help = "write `-[name]->`, with a name that begins with a letter; or `->`";
            self.error("syntax::name", self.at, message).help(help)
        })
    }

    /// Operators of other languages.
    pub(super) fn operator(&self) -> Option<Diagnostic> {
        let (before, at, after) = (self.word(self.before()), self.word(self.at), self.word(self.at + 1));
        let (index, message, help) = match (before, at, after) {
            ("*", "*", _) if self.adjacent(self.before()) => {
                (self.before(), "`**` is no operator", "a power is written `^`")
            }
            (_, "*", "*") if self.adjacent(self.at) => (self.at, "`**` is no operator", "a power is written `^`"),
            (_, "|", "|") if self.in_value(self.at) => (self.at, "`||` is no operator", "write `or`"),
            (_, "!", _) => (self.at, "`!` is no operator", "write `not`"),
            (":", "=", _) | (_, ":", "=") if self.nameless().is_some() => return self.nameless(),
            (":", "=", _) if self.adjacent(self.before()) => (self.before(), "`:=` sets nothing", "write `=`"),
            (_, ":", "=") if self.adjacent(self.at) => (self.at, "`:=` sets nothing", "write `=`"),
            ("<", ">", _) => (self.before(), "`<>` is no comparison", "write `!=`"),
            ("passive", "=", _) if self.is_expectation() => (self.at, "`=` compares nothing", "write `expect passive`"),
            (_, "=", _) if self.is_expectation() => {
                let help = "write `==`, or tell the instant: `expect x at 5 s = 0.005 m within 1e-6 m`";
                (self.at, "`=` compares nothing", help)
            }
            (_, "=", _) if self.in_condition() => {
                (self.at, "`=` compares nothing", "two values are compared with `==`")
            }
            _ => return None,
        };
        Some(self.error("syntax::operator", index, message).help(help))
    }

    /// `1,5 N`
    pub(super) fn decimal_comma(&self) -> Option<Diagnostic> {
        let comma = [self.at, self.before()].into_iter().find(|index| self.word(*index) == ",")?;
        let before = comma.checked_sub(1)?;
        let number = |index: usize| self.kind(index) == Some(Kind::Number);
        if !(number(before) && number(comma + 1) && self.adjacent(before) && self.adjacent(comma)) {
            return None;
        }
        // A list of numbers has more of them, or such as have a point.
        let digits = |index: usize| self.word(index).bytes().all(|c| c.is_ascii_digit());
        if !(digits(before) && digits(comma + 1)) || matches!(self.word(comma + 2), "," | "..") {
            return None;
        }
        let span = self.scan.span_of(before).to(self.scan.span_of(comma + 1));
        let mut end = comma + 1;
        let unit = end + 1;
        let named = matches!(self.word(unit + 1), "=" | ":" | "(" | "." | "[");
        if self.kind(unit) == Some(Kind::Word) && !self.scan.tokens[unit].first && !named {
            end = unit;
            while self.adjacent(end) && !is_between(self.word(end + 1)) {
                end += 1;
            }
        }
        let rest = self.scan.slice(self.scan.span_of(comma + 1).to(self.scan.span_of(end)));
        let message = format!("`{}` is no number", self.scan.slice(span));
        let help = format!("write `{}.{rest}`: the decimal sign is a point", self.word(before));
        Some(Diagnostic::error("syntax::number", span, message).help(help))
    }

    /// `R:= 5 Ohm`: the name of an element is missing.
    fn nameless(&self) -> Option<Diagnostic> {
        let start = self.range.start;
        let colon = self.word(start + 1) == ":" && self.word(start + 2) == "=";
        let here = (start + 1..=start + 2).contains(&self.at);
        let kind = self.word(start);
        (self.piece == Piece::Statement && colon && here && KINDS.contains(&kind)).then(|| {
            let message = format!("the name of the element is missing after `{kind}:`");
            self.error("syntax::name", start + 1, message).help(format!("write `{kind}:name = ...`"))
        })
    }

    /// `expect x = 1`, without an instant.
    fn is_expectation(&self) -> bool {
        self.word(self.range.start) == "expect" && !(self.range.start..self.at).any(|index| self.word(index) == "at")
    }

    /// The token lies between an `if` and its `then` or body.
    pub(super) fn in_condition(&self) -> bool {
        let words = (self.range.start..self.at).rev().map(|index| self.word(index));
        words.into_iter().find(|word| matches!(*word, "if" | "then" | "else" | "{" | "=")) == Some("if")
    }

    /// `5 kg m`, `5  kg`.
    pub(super) fn spaced_unit(&self) -> Option<Diagnostic> {
        let at = self.spaced();
        let word = self.word(at);
        if self.kind(at) != Some(Kind::Word) || crate::limit::is_keyword(word) || self.scan.tokens[at].first {
            return None;
        }
        // what shows that the word is a name and no unit
        if matches!(self.word(at + 1), "(" | "[" | "." | ":" | "=" | "->" | "||>" | "->|" | "|->") {
            return None;
        }
        let before = at.max(self.range.start + 1) - 1;
        for group in [at, before] {
            let number = group.max(self.range.start + 1) - 1;
            let grouped = self.word(group).starts_with('_') && self.kind(number) == Some(Kind::Number);
            if grouped && self.adjacent(number) {
                let span = self.scan.span_of(number).to(self.scan.span_of(group));
                let error = Diagnostic::error("syntax::number", span, "the digits of a number stand together");
                return Some(error.help(format!("write `{}`", self.scan.slice(span).replace('_', ""))));
            }
        }
        let power = self.is_power(before);
        if self.kind(before) == Some(Kind::Number) && before != at && !power {
            let message = format!("more than one space between `{}` and its unit `{word}`", self.word(before));
            let help = format!("write `{} {word}`", self.word(before));
            return Some(self.error("syntax::unit", at, message).help(help));
        }
        let start = self.number_before(before);
        let ends = power || self.kind(before) == Some(Kind::Word);
        let unit = self.kind(start) == Some(Kind::Number) && start < before && ends;
        unit.then(|| {
            let span = self.scan.span_of(start).to(self.scan.span_of(at));
            if let Some(meant) = misspelt(word) {
                let message = format!("`{word}` is neither a unit nor a word that may stand behind a value");
                return self.error("syntax::unit", at, message).help(format!("did you mean `{meant}`?"));
            }
            if self.word(self.range.start) == "sampled" && word.chars().count() > 4 {
                let message = format!("a clock has no `{word}`");
                let help = "behind it stand `hold NAME`, `budget ...` and `method NAME`; the first sample is at 0";
                return self.error("syntax::unit", at, message).help(help);
            }
            if matches!(word, "e" | "f" | "p" | "q" | "t" | "x") {
                let quantity = self.scan.slice(self.scan.span_of(start).to(self.scan.span_of(before)));
                let message = format!("an operator is missing between `{quantity}` and `{word}`");
                return self.error("syntax::operator", at, message).help(format!("write `{quantity} * {word}`"));
            }
            let message = format!("`{}`: a unit has no spaces inside", self.scan.slice(span));
            let left = self.scan.slice(self.scan.span_of(start + 1).to(self.scan.span_of(before)));
            let number = self.word(start);
            // `100k Ohm`
            let prefix = matches!(left, "p" | "n" | "u" | "µ" | "μ" | "m" | "k" | "M" | "G") && self.adjacent(start);
            let help = match prefix {
                true => format!("a prefix stands before its unit: `{number} {left}{word}`"),
                false => format!("join its symbols with `*` or `/`: `{number} {left}*{word}`"),
            };
            Diagnostic::error("syntax::unit", span, message).help(help)
        })
    }

    /// Where a word may stand apart from its unit: in braces it was read as the name of a field, so that only what
    /// follows it did not fit.
    fn spaced(&self) -> usize {
        let before = self.before();
        let field = self.open_bracket() == Some("{")
            && matches!(self.word(self.at), ";" | "," | "}" | "")
            && self.kind(before) == Some(Kind::Word);
        if field { before } else { self.at }
    }

    /// `5 N.m`
    pub(super) fn dotted_unit(&self) -> Option<Diagnostic> {
        let (dot, word) = (self.before(), self.word(self.at));
        let symbol = dot.checked_sub(1)?;
        let joined = self.word(dot) == "." && self.adjacent(symbol) && self.adjacent(dot);
        if !joined || self.kind(self.at) != Some(Kind::Word) || self.kind(symbol) != Some(Kind::Word) {
            return None;
        }
        let start = self.number_before(symbol);
        (self.kind(start) == Some(Kind::Number) && start < symbol).then(|| {
            let span = self.scan.span_of(start).to(self.scan.span_of(self.at));
            let (number, left) =
                (self.word(start), self.scan.slice(self.scan.span_of(start + 1).to(self.scan.span_of(symbol))));
            let message = format!("`{}`: units are not joined with `.`", self.scan.slice(span));
            let help = format!(
                "write `{number} {left}*{word}`; or, if `{left}.{word}` is a signal, the operator that is missing: `{number}*{left}.{word}`"
            );
            Diagnostic::error("syntax::unit", span, message).help(help)
        })
    }

    /// `5 m^0.5`.
    pub(super) fn exponent(&self) -> Option<Diagnostic> {
        let symbol = self.at.checked_sub(2)?;
        let start = self.number_before(symbol);
        if self.word(self.at - 1) != "^" || self.kind(start) != Some(Kind::Number) || start == symbol {
            return None;
        }
        let power = self.word(self.at);
        let (symbol, joined) = (self.word(symbol), symbol > start + 1);
        let help = format!("write `{}`", super::exponent(symbol, power)?);
        let message = format!("`{power}` is not an exponent of a unit: a fraction is written in parentheses");
        // What follows an operator may be a variable, whatever it looks like.
        let help = match joined {
            true => format!("{help}; if `{symbol}` is a variable, put a space before the operator, as in `6 V * x`"),
            false => help,
        };
        Some(self.error("syntax::exponent", self.at, message).help(help))
    }

    /// Back from a token over the symbols and operators of a unit: its number, if it is one.
    fn number_before(&self, mut index: usize) -> usize {
        while index > self.range.start
            && (self.kind(index) == Some(Kind::Word)
                || matches!(self.word(index), "*" | "/" | "^" | "(" | ")")
                || self.is_power(index))
            && !crate::limit::is_keyword(self.word(index))
        {
            index -= 1;
        }
        index
    }

    /// The token is the exponent of a unit, or its sign: `2` and `-` of `m^-2`.
    fn is_power(&self, index: usize) -> bool {
        let digits = |index: usize| self.kind(index) == Some(Kind::Number);
        let after = |index: usize, sign: &str| index > self.range.start && self.word(index - 1) == sign;
        let opens = |index: usize| after(index, "^") || after(index, "(") && after(index - 1, "^");
        let fraction = digits(index) && after(index, "/") && digits(index - 2) && self.is_power(index - 2);
        let signed = digits(index) && after(index, "-") && opens(index - 1);
        digits(index) && opens(index) || fraction || signed || self.word(index) == "-" && opens(index)
    }
}

/// The kinds of elements.
const KINDS: &[&str] =
    &["Se", "Sf", "C", "I", "R", "TF", "GY", "De", "Df", "RS", "IC", "TL", "MSe", "MSf", "MTF", "MGY", "MR", "0", "1"];

/// The signs between two ends of bonds, and at the end of a chain.
fn is_between(word: &str) -> bool {
    matches!(word, "" | "->" | "||>" | "->|" | "|->" | "|-" | "|" | "-" | "<" | ">" | "," | ";" | "}")
}

/// Whether there is a `/*` here.
pub(super) fn opens_comment(scan: &Scan, index: usize) -> bool {
    let [start, next] = [index, index + 1].map(|i| scan.span_of(i));
    scan.word(index) == "/" && scan.word(index + 1) == "*" && start.end == next.start
}

/// What is said of a comment in another notation: `#` or `/*` at a token.
pub(super) fn no_comment(scan: &Scan, index: usize) -> Diagnostic {
    let open = opens_comment(scan, index);
    let (word, end) = if open { ("/*", index + 1) } else { (scan.word(index), index) };
    let span = scan.span_of(index).to(scan.span_of(end));
    let help = if open { "a comment begins with `//`, on each of its lines" } else { "a comment begins with `//`" };
    Diagnostic::error("syntax::character", span, format!("`{word}` begins no comment")).help(help)
}

/// The word that may have been meant behind a value, where this is all but one.
fn misspelt(word: &str) -> Option<String> {
    if matches!(word, "lagged" | "matched" | "predicted") {
        return Some(format!("hold {word}"));
    }
    let letters = |text: &str| {
        let mut list: Vec<char> = text.chars().collect();
        list.sort_unstable();
        list
    };
    // Letters in another order, or one of them too few, too many or wrong.
    let near = |meant: &&str| {
        let (a, b): (Vec<char>, Vec<char>) = (word.chars().collect(), meant.chars().collect());
        let head = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
        let tail = a[head..].iter().rev().zip(b[head..].iter().rev()).take_while(|(x, y)| x == y).count();
        let rest = (a.len() - head - tail).max(b.len() - head - tail);
        rest <= 1 || (a.len() > 3 && letters(word) == letters(meant))
    };
    let words = ["within", "then", "else", "hold", "budget", "method", "latency", "resolution"];
    (word.chars().count() > 3).then(|| words.iter().find(|meant| near(meant)).map(ToString::to_string))?
}
