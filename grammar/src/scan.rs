//! A text cut into tokens by hand: comments, limits on nesting and length, statement boundaries.
//!
//! It is coarser than the grammar (a unit is a row of words and operators here) and never fails, so it can look at
//! a text before the grammar does, and at the ruins after the grammar has refused it.

use crate::ast::Comment;
use crate::source::{SourceId, Span};

/// What a token is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Letters and digits.
    Word,
    /// A number without its unit.
    Number,
    /// A text in quotes.
    Text,
    /// A text whose closing quote is missing on its line.
    OpenText,
    /// An operator, a bracket, an arrow.
    Sign,
    /// A character that the language does not know.
    Strange,
}

/// A token. Comments are not tokens.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Token {
    /// What it is.
    pub kind: Kind,
    /// First byte.
    pub start: usize,
    /// One past its last byte.
    pub end: usize,
    /// It is the first one on its line.
    pub first: bool,
}

/// A text's tokens and comments.
pub(crate) struct Scan<'a> {
    /// The text.
    pub text: &'a str,
    /// Its id.
    pub source: SourceId,
    /// In order of place.
    pub tokens: Vec<Token>,
    /// In order of place.
    pub comments: Vec<Comment>,
}

/// The signs of more than one character, longest first.
const SIGNS: &[&str] = &["||>", "|->", "->|", "->", "|-", "==", "!=", "<=", ">=", ".."];

/// A letter of a name.
pub(crate) fn is_letter(c: char) -> bool {
    c.is_ascii_alphabetic() || c == '_' || matches!(c, '\u{B5}' | '\u{386}' | '\u{388}'..='\u{3FF}' | '\u{2126}')
}

/// A character that may begin a unit's symbol.
pub(crate) fn is_symbol_start(c: char) -> bool {
    is_letter(c) || c == '°' || c == '%'
}

impl<'a> Scan<'a> {
    /// Cuts a text.
    pub fn new(source: SourceId, text: &'a str) -> Self {
        let mut scan = Scan { text, source, tokens: Vec::new(), comments: Vec::new() };
        let mut at = 0;
        let mut first = true;
        while let Some(c) = text[at..].chars().next() {
            let rest = &text[at..];
            if matches!(c, ' ' | '\t' | '\r' | '\n' | '\u{FEFF}') {
                first |= c == '\n';
                at += c.len_utf8();
            } else if rest.starts_with("//") {
                let line = rest.split('\n').next().unwrap_or(rest).trim_end();
                scan.comments.push(Comment { text: line.to_string(), span: scan.span(at, at + line.len()) });
                at += rest.find('\n').unwrap_or(rest.len());
            } else {
                let (kind, length) = token(rest, c);
                scan.tokens.push(Token { kind, start: at, end: at + length, first });
                first = false;
                at += length;
            }
        }
        scan
    }

    /// A span of this text.
    pub fn span(&self, start: usize, end: usize) -> Span {
        Span { source: self.source, start: start as u32, end: end as u32 }
    }

    /// The span of a token; the end of the text if there is none.
    pub fn span_of(&self, index: usize) -> Span {
        match self.tokens.get(index) {
            Some(token) => self.span(token.start, token.end),
            None => self.span(self.text.len().saturating_sub(1), self.text.len()),
        }
    }

    /// The text of a span.
    pub fn slice(&self, span: Span) -> &'a str {
        self.text.get(span.start as usize..span.end as usize).unwrap_or("")
    }

    /// The text of a token; empty if there is none.
    pub fn word(&self, index: usize) -> &'a str {
        self.tokens.get(index).map_or("", |token| &self.text[token.start..token.end])
    }

    /// Its kind.
    pub fn kind(&self, index: usize) -> Option<Kind> {
        self.tokens.get(index).map(|token| token.kind)
    }

    /// The token is a word that may be a name.
    pub fn is_name(&self, index: usize) -> bool {
        self.kind(index) == Some(Kind::Word) && !is_reserved(self.word(index))
    }

    /// An operand may end with this token.
    pub fn ends_operand(&self, index: usize) -> bool {
        match self.kind(index) {
            Some(Kind::Word) => !is_reserved(self.word(index)) || matches!(self.word(index), "true" | "false"),
            Some(Kind::Number | Kind::Text | Kind::OpenText) => true,
            Some(Kind::Sign) => matches!(self.word(index), ")" | "]" | "}"),
            Some(Kind::Strange) | None => false,
        }
    }

    /// `KIND:name` or `KIND(ports):name` begins here.
    pub fn starts_element(&self, index: usize) -> bool {
        let junction = matches!(self.word(index), "0" | "1");
        if !junction && !self.is_name(index) {
            return false;
        }
        let mut colon = index + 1;
        if !junction && self.word(colon) == "(" {
            let limit = colon + 200;
            while colon < limit && !matches!(self.word(colon), ")" | "") {
                colon += 1;
            }
            colon += 1;
        }
        self.word(colon) == ":" && self.is_name(colon + 1)
    }

    /// Position of the first token that begins at or after a byte, or contains it.
    pub fn token_at(&self, byte: usize) -> usize {
        self.tokens.partition_point(|token| token.end <= byte)
    }

    /// A span's end with white space and comments before it cut off.
    pub fn trim_end(&self, start: usize, mut end: usize) -> usize {
        loop {
            let trimmed = start + self.text[start..end].trim_end_matches([' ', '\t', '\r', '\n', '\u{FEFF}']).len();
            let index = self.comments.partition_point(|comment| (comment.span.end as usize) < trimmed);
            match self.comments.get(index) {
                Some(comment) if (comment.span.start as usize) < trimmed && comment.span.start as usize >= start => {
                    end = comment.span.start as usize;
                }
                Some(_) | None => return trimmed,
            }
        }
    }

    /// The `///` lines directly before a byte, without the slashes.
    pub fn docs_before(&self, start: usize) -> Vec<String> {
        let mut docs = Vec::new();
        let mut below = start;
        let before = self.comments.partition_point(|comment| (comment.span.start as usize) < start);
        for comment in self.comments[..before].iter().rev() {
            let (from, to) = (comment.span.start as usize, comment.span.end as usize);
            let line = self.text[..from].rfind('\n').map_or(0, |newline| newline + 1);
            let alone = self.text[line..from].trim().is_empty();
            if !alone || !self.text[to..below].trim().is_empty() {
                break;
            }
            if let Some(doc) = doc(&comment.text, "///") {
                docs.push(doc);
            }
            below = from;
        }
        docs.reverse();
        docs
    }

    /// The `//!` lines before the first token.
    pub fn file_docs(&self) -> Vec<String> {
        let end = self.tokens.first().map_or(self.text.len(), |token| token.start);
        let head = self.comments.iter().take_while(|comment| (comment.span.start as usize) < end);
        head.filter_map(|comment| doc(&comment.text, "//!")).collect()
    }
}

/// The words of a doc comment with these slashes.
fn doc(comment: &str, slashes: &str) -> Option<String> {
    let rest = comment.strip_prefix(slashes)?;
    if rest.starts_with('/') {
        return None;
    }
    Some(rest.strip_prefix(' ').unwrap_or(rest).trim_end().to_string())
}

/// A word that may not be a name.
pub(crate) fn is_reserved(word: &str) -> bool {
    matches!(word, "if" | "then" | "else" | "and" | "or" | "not" | "true" | "false")
}

/// Kind and length of the token at the start of a text.
fn token(rest: &str, c: char) -> (Kind, usize) {
    let after = rest[c.len_utf8()..].chars().next();
    if is_symbol_start(c) {
        let end = rest.find(|c: char| !is_symbol_start(c) && !c.is_ascii_digit()).unwrap_or(rest.len());
        (Kind::Word, end)
    } else if c.is_ascii_digit() || c == '.' && after.is_some_and(|c| c.is_ascii_digit()) {
        (Kind::Number, number(rest))
    } else if c == '"' {
        let end = rest[1..].find(['"', '\n']).map_or(rest.len(), |at| at + 1);
        if rest[end..].starts_with('"') { (Kind::Text, end + 1) } else { (Kind::OpenText, end) }
    } else if let Some(sign) = SIGNS.iter().find(|sign| rest.starts_with(**sign)) {
        (Kind::Sign, sign.len())
    } else if "+-*/^<>=(){}[]:;,.|!".contains(c) {
        (Kind::Sign, 1)
    } else {
        (Kind::Strange, c.len_utf8())
    }
}

/// Length of the number at the start of a text.
fn number(rest: &str) -> usize {
    let bytes = rest.as_bytes();
    let digits = |from: usize| from + bytes[from..].iter().take_while(|b| b.is_ascii_digit()).count();
    let mut end = digits(0);
    if bytes.get(end) == Some(&b'.') {
        let next = rest[end + 1..].chars().next();
        if next.is_some_and(|c| c.is_ascii_digit()) {
            end = digits(end + 1);
        } else if end > 0 && next != Some('.') && !next.is_some_and(is_letter) {
            end += 1;
        }
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
        let stop = digits((end + 1 + sign).min(bytes.len()));
        if stop > end + 1 + sign {
            end = stop;
        }
    }
    end
}
