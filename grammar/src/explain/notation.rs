//! Characters, operators, arrows and units of other notations.

use super::{Piece, Wreck};
use crate::diagnostic::Diagnostic;
use crate::scan::Kind;

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
            "\u{a0}" => ("there is a no-break space here".to_string(), "write an ordinary space"),
            "#" => ("`#` begins no comment".to_string(), "a comment begins with `//`"),
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
            let (left, right) = (self.word(self.before()), self.word(self.at + 2));
            let span = self.scan.span_of(self.at).to(self.scan.span_of(self.at + 1));
            let help = format!("half arrows point to the right: write `{right} -> {left}`");
            Diagnostic::error("syntax::arrow", span, "`<-` is no bond").help(help)
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
            (":", "=", _) if self.adjacent(self.before()) => (self.before(), "`:=` sets nothing", "write `=`"),
            (_, ":", "=") if self.adjacent(self.at) => (self.at, "`:=` sets nothing", "write `=`"),
            ("<", ">", _) => (self.before(), "`<>` is no comparison", "write `!=`"),
            (_, "=", _) if self.in_condition() => {
                (self.at, "`=` compares nothing", "two values are compared with `==`")
            }
            _ => return None,
        };
        Some(self.error("syntax::operator", index, message).help(help))
    }

    /// The token lies between an `if` and its `then` or body.
    pub(super) fn in_condition(&self) -> bool {
        let words = (self.range.start..self.at).rev().map(|index| self.word(index));
        words.into_iter().find(|word| matches!(*word, "if" | "then" | "else" | "{" | "=")) == Some("if")
    }

    /// `5 kg m`, `5  kg`.
    pub(super) fn spaced_unit(&self) -> Option<Diagnostic> {
        let word = self.word(self.at);
        if self.kind(self.at) != Some(Kind::Word) || crate::limit::is_keyword(word) || self.scan.tokens[self.at].first {
            return None;
        }
        // what shows that the word is a name and no unit
        if matches!(self.word(self.at + 1), "(" | "[" | "." | ":" | "=" | "->" | "||>" | "->|" | "|->") {
            return None;
        }
        let before = self.before();
        if self.kind(before) == Some(Kind::Number) && before != self.at {
            let message = format!("more than one space between `{}` and its unit `{word}`", self.word(before));
            let help = format!("write `{} {word}`", self.word(before));
            return Some(self.error("syntax::unit", self.at, message).help(help));
        }
        let start = self.number_before(before);
        let unit = self.kind(start) == Some(Kind::Number) && start < before && self.kind(before) == Some(Kind::Word);
        unit.then(|| {
            let span = self.scan.span_of(start).to(self.scan.span_of(self.at));
            let message = format!("`{}`: a unit has no spaces inside", self.scan.slice(span));
            let left = self.scan.slice(self.scan.span_of(start + 1).to(self.scan.span_of(before)));
            let help = format!("join its symbols with `*` or `/`: `{} {left}*{word}`", self.word(start));
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
        let help = super::exponent(self.word(symbol), power)?;
        let message = format!("`{power}` is no exponent of a unit: a fraction is written in parentheses");
        Some(self.error("syntax::exponent", self.at, message).help(format!("write `{help}`")))
    }

    /// Back from a token over the symbols and operators of a unit: its number, if it is one.
    fn number_before(&self, mut index: usize) -> usize {
        while index > self.range.start
            && (self.kind(index) == Some(Kind::Word) || matches!(self.word(index), "*" | "/" | "^"))
            && !crate::limit::is_keyword(self.word(index))
        {
            index -= 1;
        }
        index
    }
}
