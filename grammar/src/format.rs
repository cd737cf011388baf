//! The canonical layout of a file.
//!
//! Comments keep their place between statements, fields and parameters, trailing ones stay trailing. A comment within a
//! statement moves to the line before it. Blank lines stay, at most one in a row.

use crate::ast::*;
use crate::bracket::Brackets;
use crate::print;
use crate::scan::Scan;
use crate::source::{SourceId, Sources, Span};

/// Columns that a line should not exceed.
const WIDTH: usize = 100;

/// Formats a file that was read without errors. Text that could not be read would be lost.
///
/// # Panics
/// If the id comes from another `Sources`.
pub fn format(sources: &Sources, id: SourceId, file: &File) -> String {
    let text = &sources.get(id).text;
    let scan = Scan::new(id, text);
    let brackets = Brackets::balanced(&scan);
    let mut layout = Layout { scan, brackets, out: String::new(), inside: false };
    layout.sequence(&file.items, 0, text.len(), 0);
    if !layout.out.is_empty() {
        layout.out.push('\n');
    }
    layout.out
}

/// Writes a text line by line; the last line is open until the next piece begins.
struct Layout<'a> {
    scan: Scan<'a>,
    brackets: Brackets,
    out: String,
    /// An item has been written.
    inside: bool,
}

/// Something that gets lines of its own in a sequence.
trait Piece {
    fn span(&self) -> Span;
    /// Byte ranges within it whose comments it places itself.
    fn regions(&self, layout: &Layout) -> Vec<(usize, usize)>;
    fn write(&self, layout: &mut Layout, indent: usize);
}

impl Layout<'_> {
    /// The byte after the first `{` at or after a byte, and the byte of the brace that closes it.
    fn braces(&self, after: u32) -> (usize, usize) {
        let mut open = self.scan.token_at(after as usize);
        while open < self.scan.tokens.len() && self.scan.word(open) != "{" {
            open += 1;
        }
        let close = self.brackets.closing(open).unwrap_or(open);
        (self.scan.span_of(open).end as usize, self.scan.span_of(close).start as usize)
    }

    fn column(&self) -> usize {
        let line = self.out.rfind('\n').map_or(0, |newline| newline + 1);
        self.out[line..].chars().count()
    }

    /// Begins a line, after a blank one where the source has one between the two bytes.
    fn begin(&mut self, blank: bool, indent: usize) {
        if !self.out.is_empty() {
            let opened = self.out.ends_with(['{', '(']);
            self.out.push_str(if blank && !opened { "\n\n" } else { "\n" });
        }
        self.out.push_str(&" ".repeat(indent));
    }

    /// Writes text. If it is too long, breakable spaces become line breaks, the outermost ones first.
    fn wrap(&mut self, text: &str, hang: usize) {
        let mut rest = text;
        loop {
            let room = WIDTH.saturating_sub(self.column());
            let Some(at) = break_within(rest, room) else { break };
            self.out.push_str(&rest[..at].replace(print::BREAK, " "));
            self.out.push('\n');
            self.out.push_str(&" ".repeat(hang));
            rest = &rest[at + print::BREAK.len_utf8()..];
        }
        self.out.push_str(&rest.replace(print::BREAK, " "));
    }

    /// A text fits on the present line.
    fn fits(&self, text: &str) -> bool {
        self.column() + text.chars().count() <= WIDTH
    }

    /// Writes pieces and the comments around them, between two bytes.
    fn sequence<T: Piece>(&mut self, pieces: &[T], from: usize, to: usize, indent: usize) {
        let mut previous = from;
        for piece in pieces {
            let span = piece.span();
            previous = self.comments(previous, span.start as usize, indent, true);
            let mut blank = self.blank(previous, span.start as usize);
            let regions = piece.regions(self);
            for text in self.hoisted(span, &regions) {
                self.begin(blank, indent);
                self.out.push_str(&text);
                blank = false;
            }
            self.begin(blank, indent);
            piece.write(self, indent);
            self.inside = true;
            previous = span.end as usize;
        }
        self.comments(previous, to, indent, false);
    }

    fn blank(&self, from: usize, to: usize) -> bool {
        self.scan.text[from..to].bytes().filter(|&byte| byte == b'\n').count() > 1
    }

    /// Writes the comments between two pieces; the end of the last one.
    fn comments(&mut self, from: usize, to: usize, indent: usize, piece_follows: bool) -> usize {
        let mut previous = from;
        let first = self.scan.comments.partition_point(|comment| (comment.span.start as usize) < from);
        let last = self.scan.comments.partition_point(|comment| (comment.span.start as usize) < to);
        for index in first..last {
            let Comment { text, span } = self.scan.comments[index].clone();
            let start = span.start as usize;
            if !self.out.is_empty() && !self.scan.text[previous..start].contains('\n') {
                self.out.push(' ');
                self.out.push_str(&text);
            } else {
                self.begin(self.blank(previous, start), indent);
                let doc = text.starts_with("///") && piece_follows && !self.is_doc(span);
                let file_doc = text.starts_with("//!") && !self.inside && self.scan.token_at(start) > 0;
                self.out.push_str(&if doc || file_doc { plain(&text) } else { text });
            }
            previous = span.end as usize;
        }
        previous
    }

    /// A `///` comment is the doc of what follows it: alone on its line, and no `;` after it.
    fn is_doc(&self, span: Span) -> bool {
        let line = self.scan.text[..span.start as usize].rfind('\n').map_or(0, |newline| newline + 1);
        let alone = self.scan.text[line..span.start as usize].trim().is_empty();
        alone && self.scan.word(self.scan.token_at(span.end as usize)) != ";"
    }

    /// Comments within a span that have no place of their own, as plain comments.
    fn hoisted(&self, span: Span, regions: &[(usize, usize)]) -> Vec<String> {
        let first = self.scan.comments.partition_point(|comment| comment.span.start < span.start);
        let inside = self.scan.comments[first..].iter().take_while(|comment| comment.span.start < span.end);
        let placed = |at: usize| regions.iter().any(|&(from, to)| (from..to).contains(&at));
        inside.filter(|comment| !placed(comment.span.start as usize)).map(|comment| plain(&comment.text)).collect()
    }

    /// A comment lies between the bytes.
    fn commented(&self, from: usize, to: usize) -> bool {
        let first = self.scan.comments.partition_point(|comment| (comment.span.start as usize) < from);
        self.scan.comments.get(first).is_some_and(|comment| (comment.span.start as usize) < to)
    }

    /// Writes ` { ... }`, a piece a line.
    fn block<T: Piece>(&mut self, pieces: &[T], (from, to): (usize, usize), indent: usize) {
        self.out.push_str(" {");
        if !pieces.is_empty() || self.commented(from, to) {
            self.sequence(pieces, from, to, indent + 2);
            self.begin(false, indent);
        }
        self.out.push('}');
    }

    /// Writes an `if` and its `else`s.
    fn choice(&mut self, choice: &If, indent: usize) {
        let head = print::if_head(choice, self.scan.text);
        self.wrap(&head, indent + 4);
        let braces = self.braces(choice.condition.span.end);
        self.block(&choice.body, braces, indent);
        let Some(otherwise) = &choice.otherwise else { return };
        self.out.push_str(" else");
        match self.chained(choice) {
            Some(next) => {
                self.out.push(' ');
                self.choice(next, indent);
            }
            None => {
                let braces = self.braces(braces.1 as u32);
                self.block(otherwise, braces, indent);
            }
        }
    }

    /// The `if` of an `else if`.
    fn chained<'s>(&self, choice: &'s If) -> Option<&'s If> {
        let braces = self.braces(choice.condition.span.end);
        let after = self.scan.token_at(braces.1 + 1) + 1;
        match choice.otherwise.as_deref() {
            Some([Statement { kind: StatementKind::If(next), .. }]) if self.scan.word(after) == "if" => Some(next),
            Some(_) | None => None,
        }
    }

    fn choice_regions(&self, choice: &If) -> Vec<(usize, usize)> {
        let braces = self.braces(choice.condition.span.end);
        let mut regions = vec![braces];
        match self.chained(choice) {
            Some(next) => regions.extend(self.choice_regions(next)),
            None if choice.otherwise.is_some() => regions.push(self.braces(braces.1 as u32)),
            None => {}
        }
        regions
    }

    /// Between which bytes a statement's own braces lie, if it has any.
    fn statement_braces(&self, statement: &Statement) -> Option<(usize, usize)> {
        let after = match &statement.kind {
            StatementKind::Element(element) => element.fields.as_ref().map(|(_, span)| span.start),
            StatementKind::Port(name, _, fields) => (!fields.is_empty()).then_some(name.span.end),
            StatementKind::State(it, _) => Some(it.value.span.end),
            StatementKind::Simulate(_) => Some(statement.span.start),
            StatementKind::For(repeat) => Some(repeat.to.span.end),
            StatementKind::Sampled(Sampled { clock: Clock::At(value) | Clock::Every(value), .. }) => {
                Some(value.span.end)
            }
            StatementKind::If(choice) => Some(choice.condition.span.end),
            StatementKind::Chain(_)
            | StatementKind::Input(_)
            | StatementKind::Output(_)
            | StatementKind::Let(_)
            | StatementKind::Function(_)
            | StatementKind::Probe(_)
            | StatementKind::Expect(_) => None,
        };
        after.map(|after| self.braces(after))
    }
}

/// Where to break a text to fit a number of columns: at the last of the outermost breakable spaces that fit, or at the
/// first one if none fits. None if it needs no break.
fn break_within(text: &str, room: usize) -> Option<usize> {
    let mut best: Option<(usize, usize)> = None;
    let mut depth = 0usize;
    for (column, (at, c)) in text.char_indices().enumerate() {
        if column >= room && best.is_some() {
            return if text.chars().nth(room).is_some() { best.map(|(at, _)| at) } else { None };
        }
        match c {
            '(' | '[' => depth += 1,
            ')' | ']' => depth = depth.saturating_sub(1),
            print::BREAK if column > room => return Some(at),
            print::BREAK if best.is_none_or(|(_, least)| depth <= least) => best = Some((at, depth)),
            _ => {}
        }
    }
    None
}

/// A doc comment that documents nothing, as a plain one.
fn plain(comment: &str) -> String {
    let words = comment.trim_start_matches('/');
    if comment.starts_with("//!") {
        format!("//{}", &words[1..])
    } else if comment.starts_with("///") {
        format!("//{words}")
    } else {
        comment.to_string()
    }
}

impl Piece for Item {
    fn span(&self) -> Span {
        match self {
            Item::Use(used) => used.span,
            Item::Model(model) => model.span,
            Item::Function(function) => function.span,
        }
    }

    fn regions(&self, layout: &Layout) -> Vec<(usize, usize)> {
        match self {
            Item::Use(_) | Item::Function(_) => Vec::new(),
            Item::Model(model) => {
                let body = layout.braces(model.name.span.end);
                let params = (model.name.span.end as usize, body.0);
                if model.params.is_empty() { vec![body] } else { vec![params, body] }
            }
        }
    }

    fn write(&self, layout: &mut Layout, indent: usize) {
        match self {
            Item::Use(used) => layout.out.push_str(&print::used(used)),
            Item::Function(function) => layout.wrap(&print::function(function, layout.scan.text), indent + 4),
            Item::Model(model) => {
                layout.out.push_str(&format!("model {}", model.name.text));
                let body = layout.braces(model.name.span.end);
                let params = (model.name.span.end as usize, body.0);
                if layout.commented(params.0, params.1) && !model.params.is_empty() {
                    layout.out.push('(');
                    layout.sequence(&model.params, params.0, params.1, indent + 2);
                    layout.begin(false, indent);
                    layout.out.push(')');
                } else if !model.params.is_empty() {
                    let params: Vec<String> =
                        model.params.iter().map(|param| print::param(param, layout.scan.text)).collect();
                    let hang = layout.column() + 1;
                    let hang = if hang > 50 { indent + 4 } else { hang };
                    let separator = format!(",{}", print::BREAK);
                    layout.wrap(&format!("({}) {{", params.join(&separator)), hang);
                    layout.out.truncate(layout.out.len() - 2);
                }
                layout.block(&model.body, body, indent);
            }
        }
    }
}

impl Piece for Param {
    fn span(&self) -> Span {
        self.span
    }

    fn regions(&self, _: &Layout) -> Vec<(usize, usize)> {
        Vec::new()
    }

    fn write(&self, layout: &mut Layout, indent: usize) {
        let text = print::param(self, layout.scan.text);
        layout.wrap(&format!("{text},"), indent + 4);
    }
}

impl Piece for Field {
    fn span(&self) -> Span {
        self.span
    }

    fn regions(&self, _: &Layout) -> Vec<(usize, usize)> {
        Vec::new()
    }

    fn write(&self, layout: &mut Layout, indent: usize) {
        let text = print::field(self, layout.scan.text);
        layout.wrap(&text, indent + 4);
    }
}

impl Piece for Statement {
    fn span(&self) -> Span {
        self.span
    }

    fn regions(&self, layout: &Layout) -> Vec<(usize, usize)> {
        match &self.kind {
            StatementKind::If(choice) => layout.choice_regions(choice),
            StatementKind::Element(_)
            | StatementKind::Chain(_)
            | StatementKind::Port(..)
            | StatementKind::Sampled(_)
            | StatementKind::For(_)
            | StatementKind::Input(_)
            | StatementKind::Output(_)
            | StatementKind::Let(_)
            | StatementKind::Function(_)
            | StatementKind::Probe(_)
            | StatementKind::State(..)
            | StatementKind::Simulate(_)
            | StatementKind::Expect(_) => layout.statement_braces(self).into_iter().collect(),
        }
    }

    fn write(&self, layout: &mut Layout, indent: usize) {
        let source = layout.scan.text;
        let braces = layout.statement_braces(self);
        let block = matches!(self.kind, StatementKind::For(_) | StatementKind::If(_) | StatementKind::Sampled(_));
        let start = if block { self.span.start as usize } else { braces.map_or(0, |braces| braces.0) };
        let one_line = braces.is_none() || !source[start..self.span.end as usize].contains('\n');
        if one_line && let Some(text) = print::one_line(self, source) {
            if braces.is_none() {
                return layout.wrap(&text, indent + 4);
            }
            let text = text.replace(print::BREAK, " ");
            if layout.fits(&text) {
                return layout.out.push_str(&text);
            }
        }
        if let StatementKind::If(choice) = &self.kind {
            return layout.choice(choice, indent);
        }
        let head = print::head(self, source);
        layout.wrap(&head, indent + 4);
        let Some(braces) = braces else { return };
        match &self.kind {
            StatementKind::For(For { body, .. }) | StatementKind::Sampled(Sampled { body, .. }) => {
                layout.block(body, braces, indent);
            }
            StatementKind::Element(Element { fields: Some((fields, _)), .. })
            | StatementKind::Port(_, _, fields)
            | StatementKind::State(_, fields)
            | StatementKind::Simulate(fields) => layout.block(fields, braces, indent),
            StatementKind::Element(_)
            | StatementKind::If(_)
            | StatementKind::Chain(_)
            | StatementKind::Input(_)
            | StatementKind::Output(_)
            | StatementKind::Let(_)
            | StatementKind::Function(_)
            | StatementKind::Probe(_)
            | StatementKind::Expect(_) => {}
        }
    }
}
