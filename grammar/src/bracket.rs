//! Which bracket closes which, where some are missing.

use crate::diagnostic::Diagnostic;
use crate::limit::MAX_ERRORS;
use crate::scan::Scan;
use std::ops::Range;

/// Partners of a text's brackets.
pub(crate) struct Brackets {
    /// By token: the other bracket of its pair.
    partner: Vec<Option<usize>>,
    /// Opened and never closed, in order of place.
    unclosed: Vec<usize>,
    /// Closing what nobody opened, in order of place.
    stray: Vec<usize>,
    /// Names of models whose opening brace is missing.
    headless: Vec<usize>,
    /// Braces whose closing one stands further left: where a missing brace probably belongs.
    slanted: Vec<usize>,
}

/// An open bracket.
struct Open {
    token: usize,
    /// It holds fields or an expression, so no statement can begin in it.
    inner: bool,
}

/// A statement with its own brace begins here, one that no expression or field can contain.
pub(crate) fn is_strong_start(scan: &Scan, index: usize) -> bool {
    let (next, third) = (scan.word(index + 1), scan.word(index + 2));
    match scan.word(index) {
        "let" => scan.is_name(index + 1) && matches!(third, "=" | "(" | "["),
        "probe" | "input" | "output" | "state" => scan.is_name(index + 1) && matches!(third, "=" | "["),
        "for" => scan.is_name(index + 1) && third == "in",
        "port" => scan.is_name(index + 1),
        "simulate" => next == "{",
        "sampled" => matches!(next, "at" | "every"),
        "active" => scan.starts_element(index + 1),
        "expect" => scan.is_name(index + 1),
        "model" => scan.is_name(index + 1) && matches!(third, "{" | "("),
        _ => scan.starts_element(index),
    }
}

/// A model seems to begin here, with another word in the place of `model`.
pub(crate) fn is_misspelt_model(scan: &Scan, index: usize) -> bool {
    scan.is_name(index) && scan.is_name(index + 1) && matches!(scan.word(index + 2), "{" | "(")
}

/// A model seems to begin here, without the word: `Name {` or `Name(...) {`.
pub(crate) fn is_bare_model(scan: &Scan, index: usize) -> bool {
    let name = scan.is_name(index) && !matches!(scan.word(index), "model" | "simulate");
    let mut body = index + 1;
    let mut depth = 0u32;
    while matches!(scan.word(body), "(") || depth > 0 {
        match scan.word(body) {
            "(" => depth += 1,
            ")" => depth -= 1,
            "" | "{" | "}" => return false,
            _ => {}
        }
        body += 1;
    }
    name && scan.word(body) == "{"
}

impl Brackets {
    /// Pairs the brackets of a text that the grammar has read, so that none is missing.
    pub fn balanced(scan: &Scan) -> Self {
        Self::pair(scan, false)
    }

    /// Pairs the brackets of a text in which some may be missing: words that begin statements and stand first on their
    /// lines tell where.
    pub fn guess(scan: &Scan) -> Self {
        Self::pair(scan, true)
    }

    fn pair(scan: &Scan, guess: bool) -> Self {
        let count = scan.tokens.len();
        let mut brackets = Brackets {
            partner: vec![None; count],
            unclosed: Vec::new(),
            stray: Vec::new(),
            headless: Vec::new(),
            slanted: Vec::new(),
        };
        let mut stack: Vec<Open> = Vec::new();
        let mut block = false; // the statement that began last has a body of statements
        let mut range = false; // it is a `for`, whose range may be written `1:n`
        for index in 0..count {
            let word = scan.word(index);
            let first = guess && scan.tokens[index].first;
            let headless = word == "model" && first && scan.is_name(index + 1) && begins_line(scan, index + 2);
            if word == "model" && first && (headless || is_strong_start(scan, index)) {
                brackets.unclosed.extend(stack.drain(..).map(|open| open.token));
            } else if first && is_strong_start(scan, index) {
                while let Some(open) = stack.pop_if(|open| open.inner) {
                    brackets.unclosed.push(open.token);
                }
            }
            if headless {
                // Its body is taken to begin after the name.
                brackets.headless.push(index + 1);
                stack.push(Open { token: index + 1, inner: false });
                continue;
            }
            let starts = index == 0 || scan.ends_operand(index - 1) || matches!(scan.word(index - 1), ";" | "{");
            match word {
                "model" | "for" | "sampled" if is_strong_start(scan, index) => (block, range) = (true, word == "for"),
                // `for i = 1:n {`
                "for" if guess && first && scan.is_name(index + 1) => (block, range) = (true, true),
                "sample" | "sampled" | "sampling" if first => block = true,
                "if" if starts => block = true,
                "else" if index > 0 && scan.word(index - 1) == "}" => block = true,
                "let" | "probe" | "input" | "output" | "state" | "port" | "simulate" | "expect"
                    if is_strong_start(scan, index) =>
                {
                    block = false;
                }
                // One in a head, `Car(m: 1 kg)`, is its own mistake.
                ":" => block &= range || stack.last().is_some_and(|open| open.inner),
                // What is meant for a model holds statements, too.
                _ if guess
                    && stack.is_empty()
                    && first
                    && (is_misspelt_model(scan, index) || is_bare_model(scan, index)) =>
                {
                    block = true;
                }
                "(" | "[" => stack.push(Open { token: index, inner: true }),
                "{" => {
                    stack.push(Open { token: index, inner: !block });
                    range = false;
                }
                ")" | "]" | "}" => brackets.close(scan, &mut stack, index),
                _ => {}
            }
        }
        brackets.unclosed.extend(stack.iter().map(|open| open.token));
        brackets.unclosed.sort_unstable();
        // What is not closed either has no body.
        let (headless, partner) = (std::mem::take(&mut brackets.headless), &brackets.partner);
        brackets.unclosed.retain(|token| headless.binary_search(token).is_err());
        brackets.headless = headless.into_iter().filter(|token| partner[*token].is_some()).collect();
        brackets
    }

    fn close(&mut self, scan: &Scan, stack: &mut Vec<Open>, index: usize) {
        let wanted = match scan.word(index) {
            ")" => "(",
            "]" => "[",
            _ => "{",
        };
        let reach = stack.iter().rev().take_while(|open| wanted == "{" || scan.word(open.token) != "{");
        let opened = |open: &Open| if self.is_headless(open.token) { "{" } else { scan.word(open.token) };
        let Some(skip) = reach.map(opened).position(|word| word == wanted) else {
            self.stray.push(index);
            return;
        };
        for open in stack.drain(stack.len() - skip..) {
            self.unclosed.push(open.token);
        }
        if let Some(open) = stack.pop() {
            self.partner[open.token] = Some(index);
            self.partner[index] = Some(open.token);
            if wanted == "{" && scan.tokens[index].first && indent(scan, index) < indent(scan, open.token) {
                self.slanted.push(open.token);
            }
        }
    }

    /// The bracket that closes this one.
    pub fn closing(&self, token: usize) -> Option<usize> {
        self.partner.get(token).copied().flatten().filter(|&partner| partner > token)
    }

    /// What is wrong with the brackets among these tokens.
    pub fn errors(&self, scan: &Scan, range: Range<usize>) -> Vec<Diagnostic> {
        let mut errors = Vec::new();
        for &token in self.unclosed.iter().filter(|token| range.contains(token)).take(MAX_ERRORS) {
            let opened = scan.word(token);
            let closing = match opened {
                "(" => ")",
                "[" => "]",
                _ => "}",
            };
            let slanted = self.slanted.iter().find(|&&slanted| opened == "{" && slanted > token);
            let at = slanted.copied().unwrap_or(token);
            let message = format!("this `{opened}` is never closed");
            let error = Diagnostic::error("syntax::unclosed", scan.span_of(at), message).here("opened here");
            errors.push(error.help(format!("add the `{closing}` that belongs to it")));
        }
        for &token in self.stray.iter().filter(|token| range.contains(token)).take(MAX_ERRORS) {
            let message = format!("this `{}` closes nothing", scan.word(token));
            let error = Diagnostic::error("syntax::stray", scan.span_of(token), message);
            errors.push(error.help("remove it, or add the bracket that should open before it"));
        }
        errors
    }

    /// This is the name of a model whose body is not opened.
    pub fn is_headless(&self, token: usize) -> bool {
        self.headless.binary_search(&token).is_ok()
    }

    /// The bracket closes what nobody opened.
    pub fn is_stray(&self, token: usize) -> bool {
        self.stray.binary_search(&token).is_ok()
    }

    /// Some bracket among these tokens has no partner.
    pub fn broken(&self, range: Range<usize>) -> bool {
        let among = |list: &[usize]| {
            let from = list.partition_point(|&token| token < range.start);
            list.get(from).is_some_and(|&token| token < range.end)
        };
        among(&self.unclosed) || among(&self.stray)
    }
}

/// A word other than an opening bracket begins a line here.
fn begins_line(scan: &Scan, index: usize) -> bool {
    scan.tokens.get(index).is_some_and(|token| token.first) && !matches!(scan.word(index), "{" | "(")
}

/// Columns before the first token of the token's line.
fn indent(scan: &Scan, token: usize) -> usize {
    let start = scan.tokens[token].start;
    let line = scan.text[..start].rfind('\n').map_or(0, |newline| newline + 1);
    scan.text[line..].bytes().take_while(|byte| matches!(byte, b' ' | b'\t')).count()
}
