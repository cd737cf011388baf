//! Who said what cannot be done: the command line, or a model.

use crate::stop::Stop;

/// Who said it, and so where it is mended.
#[derive(Clone, Copy, Debug)]
pub enum By<'a> {
    /// The command line: status 2.
    Line,
    /// A model, shown by this name: status 1.
    Model(&'a str),
}

impl By<'_> {
    /// The command line where it says one of the numbers that do not go together.
    pub fn unless(self, line: bool) -> Self {
        if line { By::Line } else { self }
    }

    /// A setting as it is written there.
    pub fn setting(self, name: &str) -> String {
        match self {
            By::Line => format!("--{name}"),
            By::Model(_) => format!("`{name}`"),
        }
    }

    /// Where it is written, where that is to be said, to be put behind it.
    pub fn place(self) -> &'static str {
        match self {
            By::Line => "",
            By::Model(_) => " in `simulate`",
        }
    }

    /// The end of the command.
    pub fn refuse(self, why: String) -> Stop {
        match self {
            By::Line => Stop::Usage(why),
            By::Model(name) => Stop::Model(format!("{name}: {why}")),
        }
    }
}
