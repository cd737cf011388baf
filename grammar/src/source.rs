//! Source texts and places in them.

/// A source text, by its position in a [`Sources`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SourceId(pub u32);

/// A half-open range of bytes of one source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Span {
    /// The source it lies in.
    pub source: SourceId,
    /// First byte.
    pub start: u32,
    /// One past the last byte.
    pub end: u32,
}

impl Span {
    /// The smallest span that covers both; `self` if they lie in different sources.
    pub fn to(self, other: Span) -> Span {
        if self.source != other.source {
            return self;
        }
        Span { source: self.source, start: self.start.min(other.start), end: self.end.max(other.end) }
    }
}

/// One source: its name as the user wrote it, and its text, which always ends with a newline.
#[derive(Clone, Debug)]
pub struct Source {
    /// Path or `<stdin>`.
    pub name: String,
    /// The text.
    pub text: String,
}

/// All sources of a compilation, in the order in which they were read.
#[derive(Clone, Debug, Default)]
pub struct Sources {
    list: Vec<Source>,
}

impl Sources {
    /// No sources.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a text. A missing newline at its end is added, and a byte order mark is removed.
    pub fn add(&mut self, name: impl Into<String>, text: impl Into<String>) -> SourceId {
        let mut text = text.into();
        if text.starts_with('\u{FEFF}') {
            text.drain(..'\u{FEFF}'.len_utf8());
        }
        if !text.ends_with('\n') {
            text.push('\n');
        }
        self.list.push(Source { name: name.into(), text });
        SourceId(self.list.len() as u32 - 1)
    }

    /// The source with this id.
    ///
    /// # Panics
    /// If the id comes from another `Sources`.
    pub fn get(&self, id: SourceId) -> &Source {
        &self.list[id.0 as usize]
    }

    /// All of them, in the order in which they were read.
    pub fn list(&self) -> &[Source] {
        &self.list
    }

    /// Line and column, both from 1, of the start of a span.
    pub fn position(&self, span: Span) -> (usize, usize) {
        let text = &self.get(span.source).text;
        let mut start = (span.start as usize).min(text.len());
        while !text.is_char_boundary(start) {
            start -= 1;
        }
        let head = &text[..start];
        let line = head.bytes().filter(|&b| b == b'\n').count() + 1;
        let column = head.chars().rev().take_while(|&c| c != '\n').count() + 1;
        (line, column)
    }

    /// The text of a span.
    pub fn slice(&self, span: Span) -> &str {
        self.get(span.source).text.get(span.start as usize..span.end as usize).unwrap_or("")
    }
}
