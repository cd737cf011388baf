//! Limits on size, nesting and the height of expressions, checked before anything recursive reads a text.

use crate::diagnostic::Diagnostic;
use crate::scan::{Kind, Scan};
use crate::source::Span;

/// Brackets, `if`s and prefix operators inside one another.
pub const NESTING: usize = 100;

/// Height of an expression's tree; a sum of n operands has height n.
pub const HEIGHT: usize = 1000;

/// Bytes of a text.
pub const BYTES: usize = 16 << 20;

/// Errors that are reported per text.
pub const MAX_ERRORS: usize = 100;

/// What is open: a bracket, with what it contains so far.
#[derive(Default)]
struct Frame {
    /// `if`s and `not`s that take the rest of the expression.
    loose: usize,
    /// Signs and powers in a row.
    tight: usize,
    /// Height of the present expression.
    height: usize,
    /// Greatest height of the finished ones.
    highest: usize,
}

impl Frame {
    fn finish(&mut self) {
        self.highest = self.highest.max(self.height);
        *self = Frame { highest: self.highest, ..Frame::default() };
    }
}

/// That a text is larger than [`BYTES`].
pub(crate) fn too_large(span: Span) -> Diagnostic {
    let message = format!("this text has more than {} MB", BYTES >> 20);
    Diagnostic::error("syntax::too_large", Span { end: span.start, ..span }, message)
}

/// The first place where a text is nested too deep, or an expression too long.
pub(crate) fn check(scan: &Scan) -> Result<(), Diagnostic> {
    let mut frames = vec![Frame::default()];
    let mut depth = 0; // of all frames together
    for index in 0..scan.tokens.len() {
        let word = scan.word(index);
        let after_operand = index > 0 && scan.ends_operand(index - 1);
        let member = index > 0 && scan.word(index - 1) == ".";
        match word {
            "(" | "[" | "{" => {
                frames.push(Frame::default());
                depth += 1;
            }
            ")" | "]" | "}" => {
                if frames.len() > 1
                    && let Some(mut frame) = frames.pop()
                {
                    depth -= 1 + frame.loose + frame.tight;
                    frame.finish();
                    if let Some(outer) = frames.last_mut() {
                        outer.height = outer.height.max(frame.highest + 1);
                    }
                }
            }
            _ => {}
        }
        let Some(frame) = frames.last_mut() else { return Ok(()) };
        let before = frame.loose + frame.tight;
        let connects = matches!(word, "then" | "else" | "and" | "or" | "not");
        match scan.tokens[index].kind {
            Kind::Sign => match word {
                "^" => {
                    frame.tight += 1;
                    frame.height += 1;
                }
                "-" | "!" if !after_operand => {
                    frame.tight += 1;
                    frame.height += 1;
                }
                "+" | "-" | "*" | "/" | "<" | ">" | "==" | "!=" | "<=" | ">=" => {
                    frame.tight = 0;
                    frame.height += 1;
                }
                "=" | "," | ";" | ":" | ".." => frame.finish(),
                _ => {}
            },
            Kind::Word if member => {}
            Kind::Word if matches!(word, "if" | "not") => {
                if word == "if" && after_operand {
                    frame.finish();
                }
                frame.loose += 1;
                frame.height += 1;
            }
            Kind::Word if connects => {
                frame.tight = 0;
                frame.height += 1;
            }
            Kind::Word | Kind::Number | Kind::Text | Kind::OpenText | Kind::Strange => {
                let unit = scan.kind(index.wrapping_sub(1)) == Some(Kind::Number);
                if after_operand && !(unit && scan.tokens[index].kind == Kind::Word && !is_keyword(word)) {
                    frame.finish();
                }
            }
        }
        depth = depth + frame.loose + frame.tight - before;
        if depth > NESTING {
            let message = format!("nested too deep: at most {NESTING} brackets, `if`s and signs inside one another");
            let help = "name an inner part with `let` and use the name";
            return Err(Diagnostic::error("syntax::too_deep", scan.span_of(index), message).help(help));
        }
        if frame.height > HEIGHT {
            let message = format!("this expression is too long: at most {HEIGHT} operators");
            let help = "split it: name a part with `let` and use the name";
            return Err(Diagnostic::error("syntax::too_long", scan.span_of(index), message).help(help));
        }
    }
    Ok(())
}

/// A word that begins a statement or a part of one, and is therefore never a unit.
pub(crate) fn is_keyword(word: &str) -> bool {
    const WORDS: &[&str] = &[
        "if",
        "then",
        "else",
        "and",
        "or",
        "not",
        "for",
        "in",
        "at",
        "every",
        "hold",
        "budget",
        "method",
        "within",
        "model",
        "port",
        "use",
        "sampled",
        "input",
        "output",
        "let",
        "probe",
        "state",
        "simulate",
        "expect",
        "passive",
        "active",
        "latency",
        "resolution",
        "true",
        "false",
    ];
    WORDS.contains(&word)
}
