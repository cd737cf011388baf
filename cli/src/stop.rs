//! Why a command ends early.

use bond::RunError;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Sources;

/// Why a command ends early, and with which status.
#[derive(Debug)]
pub enum Stop {
    /// Everything is said; only the status is left.
    Said(u8),
    /// The command line is wrong, or a file cannot be read or written: status 2.
    Usage(String),
    /// The model is wrong: status 1.
    Model(String),
    /// The model is wrong at a place of its text: status 1.
    Placed(Box<(Sources, Diagnostic)>),
    /// The numerics failed: status 3.
    Numerics(String),
    /// Nobody reads standard output any more: a quiet end.
    Pipe,
}

impl Stop {
    /// What it says, if anything is left to say.
    pub fn words(&self) -> Option<&str> {
        match self {
            Stop::Usage(why) | Stop::Model(why) | Stop::Numerics(why) => Some(why),
            Stop::Placed(placed) => Some(&placed.1.message),
            Stop::Said(_) | Stop::Pipe => None,
        }
    }

    /// The same, where all of it is said already.
    pub fn told(self) -> Self {
        match self {
            Stop::Usage(_) => Stop::Said(2),
            Stop::Model(_) | Stop::Placed(_) => Stop::Said(1),
            Stop::Numerics(_) => Stop::Said(3),
            other @ (Stop::Said(_) | Stop::Pipe) => other,
        }
    }
}

impl From<RunError> for Stop {
    fn from(e: RunError) -> Self {
        match e {
            RunError::Numerics(e) => Stop::Numerics(e.to_string()),
            _ => Stop::Usage(e.to_string()),
        }
    }
}

impl From<std::io::Error> for Stop {
    fn from(e: std::io::Error) -> Self {
        if e.kind() == std::io::ErrorKind::BrokenPipe { Stop::Pipe } else { Stop::Usage(format!("cannot write: {e}")) }
    }
}
