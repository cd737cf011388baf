//! A source text as miette wants it, with its lines found once: a file may have thousands of errors.

use miette::{MietteError, MietteSpanContents, SourceCode, SourceSpan, SpanContents};
use std::borrow::Cow;

/// A text as it may go to a terminal: what would steer that is a question mark, of as many bytes.
pub fn shown(text: &str) -> Cow<'_, str> {
    let steers = |c: char| c.is_control() && !matches!(c, '\n' | '\r' | '\t');
    if !text.contains(steers) {
        return text.into();
    }
    let each = |c: char| match c.len_utf8() {
        _ if !steers(c) => c,
        1 => '?',
        _ => '\u{bf}',
    };
    text.chars().map(each).collect::<String>().into()
}

/// A named text. Lines end at `\n` alone, columns are letters, as everywhere else.
#[derive(Debug)]
pub struct Text<'a> {
    name: &'a str,
    text: Cow<'a, str>,
    /// The byte at which each line starts.
    starts: Vec<usize>,
}

impl<'a> Text<'a> {
    /// Finds the lines.
    pub fn new(name: &'a str, text: &'a str) -> Self {
        let starts = std::iter::once(0)
            .chain(text.match_indices('\n').map(|(i, _)| i + 1))
            .filter(|i| *i < text.len().max(1))
            .collect();
        Self { name, text: shown(text), starts }
    }

    /// The line, from 0, of a byte.
    fn line(&self, at: usize) -> usize {
        self.starts.partition_point(|s| *s <= at).saturating_sub(1)
    }

    /// The byte after a line.
    fn end(&self, line: usize) -> usize {
        self.starts.get(line + 1).copied().unwrap_or(self.text.len())
    }

    /// The line on which a byte is.
    pub fn around(&self, at: usize) -> &str {
        let line = self.line(at);
        &self.text[self.starts.get(line).copied().unwrap_or(0)..self.end(line)]
    }

    /// Byte range to draw of a span: within the text, on letters, at most `tall` lines.
    pub fn clamp(&self, start: usize, end: usize, tall: usize) -> (usize, usize) {
        let start = self.floor(start.min(self.text.len().saturating_sub(1)));
        let end = self.floor(end).max(start);
        let (first, last) = (self.line(start), self.line(end.saturating_sub(1).max(start)));
        let end = if last - first > tall { self.end(first) } else { end };
        (start, start + self.text[start..end].trim_end().len())
    }

    /// The start of the letter that a byte belongs to.
    fn floor(&self, at: usize) -> usize {
        let mut at = at.min(self.text.len());
        while !self.text.is_char_boundary(at) {
            at -= 1;
        }
        at
    }
}

impl SourceCode for Text<'_> {
    fn read_span<'b>(
        &'b self,
        span: &SourceSpan,
        before: usize,
        after: usize,
    ) -> Result<Box<dyn SpanContents<'b> + 'b>, MietteError> {
        let (start, end) = (span.offset(), span.offset().saturating_add(span.len()));
        if end > self.text.len() || !self.text.is_char_boundary(start) || !self.text.is_char_boundary(end) {
            return Err(MietteError::OutOfBounds);
        }
        let (first, last) = (self.line(start), self.line(end.saturating_sub(1).max(start)));
        // Without context, the contents start at the span itself.
        let line = first.saturating_sub(before);
        let line_start = self.starts.get(line).copied().unwrap_or(0);
        let from = if before == 0 { start } else { line_start };
        let to = if after == 0 { end } else { self.end((last + after).min(self.starts.len().saturating_sub(1))) };
        Ok(Box::new(MietteSpanContents::new_named(
            self.name.to_string(),
            &self.text.as_bytes()[from..to],
            (from, to - from).into(),
            line,
            self.text[line_start..from].chars().count(),
            last + after + 1 - line,
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places() -> Result<(), MietteError> {
        let text = Text::new("a", "one\ntwö x\nthree\n");
        let at = text.read_span(&(9, 1).into(), 0, 0)?;
        assert_eq!((at.line(), at.column(), at.data()), (1, 4, &b"x"[..]));
        let around = text.read_span(&(9, 1).into(), 1, 1)?;
        assert_eq!((around.line(), around.column(), around.data().len()), (0, 0, 17));
        assert_eq!(text.around(9), "twö x\n");
        assert_eq!(text.clamp(9, 99, 10), (9, 16));
        assert_eq!(text.clamp(7, 7, 10), (6, 6));
        assert_eq!(text.clamp(0, 17, 1), (0, 3));
        assert_eq!(text.clamp(99, 100, 1), (16, 16));
        assert_eq!(Text::new("", "").clamp(3, 4, 1), (0, 0));
        assert!(text.read_span(&(90, 1).into(), 1, 1).is_err());
        Ok(())
    }
}
