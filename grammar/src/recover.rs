//! Reads a text that the grammar refused: item by item, statement by statement.
//!
//! Cutting goes by brackets, by words that only begin statements, and by line starts. Each slice is then read by the
//! strict grammar, so a text is never accepted here that the grammar would refuse; and it is read as a row of
//! statements first, so that where a cut is missing or too many, what the grammar would accept is not refused.

use crate::ast::{If, Item, Sampled, Statement, StatementKind};
use crate::bracket::{Brackets, is_strong_start};
use crate::diagnostic::Diagnostic;
use crate::explain::{self, Piece, Refused};
use crate::limit::MAX_ERRORS;
use crate::read::Reader;
use crate::scan::{Kind, Scan};
use std::ops::Range;

/// Most pieces, each of which looks like a statement, that are tried together as one statement.
const MAX_PIECES: usize = 4;

/// Most tokens that may be read without success as rows of statements: nested blocks are read again at each depth.
const MAX_WASTED_TOKENS: usize = 1_000_000;

/// Reads the items of a file; and whether some of them could not be read.
pub(crate) fn file(reader: &mut Reader) -> (Vec<Item>, bool) {
    let brackets = Brackets::guess(reader.scan);
    let count = reader.scan.tokens.len();
    reader.errors.extend(brackets.errors(reader.scan, 0..count));
    let mut recovery = Recovery { scan: reader.scan, reader, brackets, lost: Vec::new(), gaps: false, vain: 0 };
    let items = recovery.items(count);
    let gaps = recovery.gaps;
    let errors = &mut reader.errors;
    errors.sort_by_key(|error| error.labels.first().map_or(0, |label| label.span.start));
    errors.dedup();
    errors.truncate(MAX_ERRORS);
    if errors.is_empty() {
        let message = "this text cannot be read";
        errors.push(Diagnostic::error("syntax::unreadable", reader.scan.span_of(0), message));
    }
    (items, gaps)
}

struct Recovery<'r, 'a> {
    scan: &'a Scan<'a>,
    reader: &'r mut Reader<'a>,
    brackets: Brackets,
    /// Names that the statements declare which could not be read.
    lost: Vec<String>,
    /// An item could not be read.
    gaps: bool,
    /// Tokens that were read in vain.
    vain: usize,
}

impl Recovery<'_, '_> {
    fn items(&mut self, count: usize) -> Vec<Item> {
        let mut items = Vec::new();
        let mut start = 0;
        while start < count {
            let mut end = self.step(start, count);
            while end < count && !self.starts_item(end) {
                end = self.step(end, count);
            }
            let before = items.len();
            self.item(start..end, &mut items);
            self.gaps |= items.len() == before;
            start = end;
        }
        items
    }

    /// The token after this one, or after the bracket that it opens.
    fn step(&self, index: usize, end: usize) -> usize {
        (self.brackets.closing(index).unwrap_or(index) + 1).min(end)
    }

    fn starts_item(&self, index: usize) -> bool {
        let first = self.scan.tokens[index].first || matches!(self.scan.word(index - 1), "}" | ";");
        match self.scan.word(index) {
            "model" => first || is_strong_start(self.scan, index),
            "use" => first && self.scan.word(index + 1) != "=",
            "let" => first && is_strong_start(self.scan, index),
            _ => false,
        }
    }

    fn bytes(&self, range: &Range<usize>) -> (usize, usize) {
        let start = self.scan.span_of(range.start).start as usize;
        let end = if range.is_empty() { start } else { self.scan.span_of(range.end - 1).end as usize };
        (start, end)
    }

    /// Keeps what was read, or says why it was not.
    fn keep<T>(&mut self, piece: Piece, range: Range<usize>, read: Result<T, Refused>) -> Option<T> {
        match read {
            Ok(value) => Some(value),
            Err(refused) => {
                self.reader.errors.push(explain::refused(self.scan, piece, range, refused));
                None
            }
        }
    }

    fn item(&mut self, range: Range<usize>, items: &mut Vec<Item>) {
        let start = self.bytes(&range).0;
        match self.scan.word(range.start) {
            "use" if !self.brackets.broken(range.clone()) => {
                let (range, rest) = self.own(range, |reader, start, end| reader.one_use(start, end).err());
                let (start, end) = self.bytes(&range);
                let read = self.reader.one_use(start, end);
                items.extend(self.keep(Piece::Use, range, read));
                self.outside(rest);
            }
            // a `let` without arguments is a value, and belongs into a model
            "let" if self.scan.word(range.start + 2) == "(" && !self.brackets.broken(range.clone()) => {
                let (range, rest) = self.own(range, |reader, start, end| reader.one_function(start, end).err());
                let (start, end) = self.bytes(&range);
                let read = self.reader.one_function(start, end);
                items.extend(self.keep(Piece::Function, range, read));
                self.outside(rest);
            }
            "model" => {
                let mut open = range.start;
                let headless = self.brackets.is_headless(range.start + 1);
                while open < range.end && self.scan.word(open) != "{" && !(headless && open > range.start) {
                    open = self.step(open, range.end);
                }
                let head = range.start..open + usize::from(headless);
                let mut model = None;
                if !self.brackets.broken(head.clone()) {
                    let (start, end) = self.bytes(&head);
                    let read = self.reader.one_model_head(start, end);
                    model = self.keep(Piece::ModelHead, head, read);
                    if headless {
                        let name = self.scan.word(open);
                        let message = format!("the body of `{name}` is not opened");
                        let error = Diagnostic::error("syntax::body", self.scan.span_of(open), message);
                        self.reader.errors.push(error.help(format!("add the `{{`: `model {name} {{`")));
                    } else if open == range.end && model.is_some() {
                        let span = self.scan.span_of(range.end - 1);
                        let error = Diagnostic::error("syntax::body", span, "this model has no body");
                        self.reader.errors.push(error.help("write its statements between `{` and `}`"));
                    }
                }
                let close = self.brackets.closing(open).unwrap_or(range.end).max(open);
                let body = self.statements((open + 1).min(close)..close);
                let mut lost = std::mem::take(&mut self.lost);
                lost.sort_unstable();
                lost.dedup();
                if let Some(mut model) = model {
                    model.body = body;
                    model.lost = lost;
                    model.span = self.scan.span(start, self.scan.span_of(close.min(range.end - 1)).end as usize);
                    items.push(Item::Model(model));
                }
                self.outside(close + 1..range.end);
            }
            _ => self.outside(range),
        }
    }

    /// What of a slice is one item, and what comes after it: where it is refused at a word that begins a line, and
    /// whole without that, the word begins something else.
    fn own(
        &mut self,
        range: Range<usize>,
        refused: impl Fn(&mut Reader, usize, usize) -> Option<Refused>,
    ) -> (Range<usize>, Range<usize>) {
        let told = self.reader.errors.len();
        let (start, end) = self.bytes(&range);
        let at = refused(self.reader, start, end).map(|r| self.scan.token_at(r.at));
        let cut = at.filter(|at| range.contains(at) && *at > range.start && self.scan.tokens[*at].first);
        let cut = cut.filter(|at| {
            let (start, end) = self.bytes(&(range.start..*at));
            refused(self.reader, start, end).is_none()
        });
        self.reader.errors.truncate(told);
        let cut = cut.unwrap_or(range.end);
        (range.start..cut, cut..range.end)
    }

    /// Text that is in no model.
    fn outside(&mut self, mut range: Range<usize>) {
        while range.start < range.end && self.scan.word(range.start) == ";" {
            range.start += 1;
        }
        if range.start >= range.end || self.brackets.broken(range.clone()) {
            return;
        }
        // A slice gets one error, except that each statement of another tool gets its own suggested fix.
        let scan = self.scan;
        let own = |index: &usize| scan.tokens[*index].first && explain::is_foreign(scan.word(*index));
        let more: Vec<usize> = (range.start + 1..range.end).filter(own).collect();
        for start in std::iter::once(range.start).chain(more) {
            self.reader.errors.push(explain::outside(scan, start..range.end));
        }
    }

    fn statements(&mut self, range: Range<usize>) -> Vec<Statement> {
        let mut statements = Vec::new();
        let mut start = range.start;
        while start < range.end {
            if self.scan.word(start) == ";" || self.brackets.is_stray(start) {
                start += 1;
                continue;
            }
            if let Some((row, end)) = self.row(start, range.end) {
                statements.extend(row);
                start = end;
                continue;
            }
            let end = self.cut(start, range.end);
            if let Some((statement, end)) = self.first_of_several(start..end) {
                statements.push(statement);
                start = end;
                continue;
            }
            match self.statement(start..end) {
                Some(statement) => statements.push(statement),
                None => self.lose(start..end),
            }
            start = end;
        }
        statements
    }

    /// Where the statement that begins here seems to end.
    fn cut(&self, start: usize, limit: usize) -> usize {
        let mut end = self.step(start, limit);
        let mut valued = self.scan.starts_element(start);
        while end < limit && self.scan.word(end) != ";" && !self.starts_statement(end, valued) {
            valued |= self.scan.word(end) == "=";
            end = self.step(end, limit);
        }
        end
    }

    /// The statements that begin here, if the grammar takes all up to a cut, and that cut. What looks like one
    /// statement may be several; and where the text breaks off at the first cut, this may stand within a statement.
    fn row(&mut self, start: usize, limit: usize) -> Option<(Vec<Statement>, usize)> {
        let mut end = start;
        for _ in 0..MAX_PIECES {
            end = self.cut(end, limit);
            if self.vain > MAX_WASTED_TOKENS || self.brackets.broken(start..end) {
                return None;
            }
            let (from, to) = self.bytes(&(start..end));
            match self.reader.statements(from, to) {
                Ok(row) => return Some((row, end)),
                Err(refused) => {
                    self.vain += end - start;
                    if refused.at < to || end == limit || self.scan.word(end) == ";" {
                        return None;
                    }
                }
            }
        }
        None
    }

    /// The first of several statements that seemed to be one, where the next one is whole too, and where that begins:
    /// what is wrong comes later.
    fn first_of_several(&mut self, range: Range<usize>) -> Option<(Statement, usize)> {
        if self.vain > MAX_WASTED_TOKENS || self.brackets.broken(range.clone()) {
            return None;
        }
        let next = self.refused_at(range.clone())?;
        let after = self.refused_at(next..range.end)?;
        self.whole(next..after)?;
        self.whole(range.start..next).map(|statement| (statement, next))
    }

    /// Reads a slice as one statement, without reporting errors.
    fn whole(&mut self, range: Range<usize>) -> Option<Statement> {
        let told = self.reader.errors.len();
        let (from, to) = self.bytes(&range);
        let read = self.reader.one_statement(from, to).ok();
        let good = self.reader.errors.len() == told;
        self.reader.errors.truncate(told);
        read.filter(|_| good)
    }

    /// The token at which a slice is refused as one statement, if not at its first one, nor for being too large.
    fn refused_at(&mut self, range: Range<usize>) -> Option<usize> {
        let (from, to) = self.bytes(&range);
        let told = self.reader.errors.len();
        let refused = self.reader.one_statement(from, to).err();
        self.reader.errors.truncate(told);
        let refused = refused.filter(|refused| !refused.limit)?;
        let at = self.scan.token_at(refused.at);
        self.vain += at.max(range.start) - range.start;
        (range.start < at && at < range.end).then_some(at)
    }

    /// Keeps in mind what a statement that could not be read seems to declare.
    fn lose(&mut self, range: Range<usize>) {
        let scan = self.scan;
        for index in range.clone().skip(1).filter(|index| scan.is_name(*index)) {
            let before = scan.word(index - 1);
            let declared = matches!(before, ":" | "let" | "probe" | "input" | "output" | "state" | "port" | "for");
            // `R drag = ...`, `1 v -> ...`, without the colon
            let follows = matches!(scan.word(index + 1), "=" | "{" | "[") || is_arrow(scan.word(index + 1));
            let kind = index == range.start + 1 && follows || matches!(before, "0" | "1");
            // `Resistor R1(R = 10 Ohm)`, `parameter Real k = 2`
            let called = index == range.start + 1 && scan.word(index + 1) == "(";
            let foreign = explain::is_foreign(scan.word(range.start)) && scan.word(index + 1) == "=";
            if declared || kind || called || foreign {
                self.lost.push(scan.word(index).to_string());
            }
        }
    }

    /// Names, up to an arrow: `a, b[2], w.tip -> `.
    fn starts_chain(&self, mut index: usize) -> bool {
        let scan = self.scan;
        while scan.is_name(index) {
            index += 1;
            while scan.word(index) == "[" {
                index = self.step(index, scan.tokens.len());
            }
            match scan.word(index) {
                "," | "." => index += 1,
                word => return is_arrow(word) || word == "-" && scan.word(index + 1) == "[",
            }
        }
        false
    }

    /// A new statement begins here, as far as one can tell. Not called for the first one of a body. The one before it
    /// is `valued` where it declares an element or has an `=`.
    fn starts_statement(&self, index: usize, valued: bool) -> bool {
        let scan = self.scan;
        let (word, before) = (scan.word(index), scan.word(index - 1));
        let first = scan.tokens[index].first;
        let named = matches!(before, "let" | "probe" | "input" | "output" | "state" | "port");
        let joined = named || matches!(before, "," | "active" | "in") || is_arrow(before);
        let operand = scan.ends_operand(index - 1);
        if scan.starts_element(index) {
            return !joined && (first || operand);
        }
        if is_strong_start(scan, index) {
            let unit = scan.kind(index - 1) == Some(Kind::Number) && !first;
            return (first || operand) && !(unit && word == "expect");
        }
        let connects = matches!(
            word,
            "and"
                | "or"
                | "then"
                | "else"
                | "within"
                | "at"
                | "hold"
                | "budget"
                | "method"
                | "every"
                | "in"
                | "latency"
        );
        if scan.kind(index) == Some(Kind::Number) || word == ":" {
            return first && operand;
        }
        if scan.kind(index) != Some(Kind::Word) || connects {
            return false;
        }
        if word == "if" {
            return operand
                && !matches!(
                    before,
                    "let" | "probe" | "input" | "output" | "state" | "port" | "expect" | "every" | "at" | "in"
                );
        }
        let arrow = is_arrow(scan.word(index + 1)) || scan.word(index + 1) == "|-";
        // `Se:F = 1 N F -> m`; but `I mass -> v` lacks a colon, and `1 kg -> m` begins with a unit.
        let chain = valued && operand && scan.kind(index - 1) != Some(Kind::Number) && self.starts_chain(index);
        before == "}" || first && operand || first && arrow && !joined || chain
    }

    fn statement(&mut self, range: Range<usize>) -> Option<Statement> {
        let first = self.scan.word(range.start);
        let (start, end) = self.bytes(&range);
        let opens =
            || range.clone().any(|index| self.scan.word(index) == "{" && self.brackets.closing(index).is_some());
        let block = matches!(first, "for" | "if")
            || first == "sampled" && is_strong_start(self.scan, range.start)
            || matches!(first, "sample" | "sampled" | "sampling") && opens();
        if block {
            let kind = self.block(range)?;
            let span = self.scan.span(start, end);
            return Some(Statement { docs: self.scan.docs_before(start), kind, span });
        }
        if self.brackets.broken(range.clone()) {
            return None;
        }
        let read = self.reader.one_statement(start, end);
        self.keep(Piece::Statement, range, read)
    }

    /// `for`, `if` and `sampled` with their bodies.
    fn block(&mut self, range: Range<usize>) -> Option<StatementKind> {
        let scan = self.scan;
        let word = scan.word(range.start);
        let mut open = range.start;
        while open < range.end && scan.word(open) != "{" {
            open = self.step(open, range.end);
        }
        let head = range.start..open;
        let (start, end) = self.bytes(&head);
        let close = self.brackets.closing(open).unwrap_or(range.end);
        let body = (open + 1).min(range.end)..close;
        if open == range.end {
            if !self.brackets.broken(head.clone()) {
                self.reader.errors.push(explain::no_body(scan, head));
            }
            return None;
        }
        let broken = self.brackets.broken(head.clone());
        let kind = match word {
            "for" => {
                let read = (!broken).then(|| self.reader.one_for_head(start, end));
                let head = read.and_then(|read| self.keep(Piece::ForHead, head, read));
                let body = self.statements(body);
                head.map(|head| StatementKind::For(crate::ast::For { body, ..head }))
            }
            "sample" | "sampling" => {
                let error = Diagnostic::error(
                    "syntax::statement",
                    scan.span_of(range.start),
                    format!("`{word}` cannot begin a statement"),
                );
                self.reader.errors.push(error.help("did you mean `sampled`?"));
                self.statements(body);
                None
            }
            "sampled" => {
                let read = (!broken).then(|| self.reader.one_sampled_head(start, end));
                let head = read.and_then(|read| self.keep(Piece::SampledHead, head, read));
                let body = self.statements(body);
                head.map(|head| StatementKind::Sampled(Sampled { body, ..head }))
            }
            _ => {
                let read = (!broken).then(|| self.reader.one_if_head(start, end));
                let condition = read.and_then(|read| self.keep(Piece::IfHead, head, read));
                let body = self.statements(body);
                if scan.word(close + 1) == "else" && close + 1 < range.end {
                    return self.otherwise(close + 2..range.end, condition.map(|condition| (condition, body)));
                }
                condition.map(|condition| StatementKind::If(If { condition, body, otherwise: None }))
            }
        };
        self.after(close + 1..range.end);
        kind
    }

    /// What follows `else`.
    fn otherwise(
        &mut self,
        range: Range<usize>,
        start: Option<(crate::ast::Expr, Vec<Statement>)>,
    ) -> Option<StatementKind> {
        let otherwise = if self.scan.word(range.start) == "if" && !range.is_empty() {
            let (start, end) = self.bytes(&range);
            let kind = self.block(range)?;
            vec![Statement { docs: Vec::new(), kind, span: self.scan.span(start, end) }]
        } else if self.scan.word(range.start) == "{" && !range.is_empty() {
            let close = self.brackets.closing(range.start).unwrap_or(range.end);
            let body = self.statements(range.start + 1..close);
            self.after(close + 1..range.end);
            body
        } else {
            self.reader.errors.push(explain::no_body(self.scan, range.start - 1..range.start));
            return None;
        };
        let (condition, body) = start?;
        Some(StatementKind::If(If { condition, body, otherwise: Some(otherwise) }))
    }

    /// Text between a body and the next statement, which is an error.
    fn after(&mut self, range: Range<usize>) {
        if range.start < range.end && !self.brackets.broken(range.clone()) {
            let at = self.scan.span_of(range.start).start as usize;
            let refused = Refused { at, limit: false };
            self.reader.errors.push(explain::refused(self.scan, Piece::Statement, range, refused));
        }
    }
}

fn is_arrow(word: &str) -> bool {
    matches!(word, "->" | "||>" | "->|" | "|->")
}
