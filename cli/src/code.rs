//! How step programs are run.

use bond_runtime::interpreter::Interpret;
use bond_runtime::kernel::Backend;

/// How step programs are run. Both give the same numbers, to the last bit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Code {
    /// As machine code, where the crate is built with its feature `native` and the machine is known; else interpreted.
    #[default]
    Native,
    /// Interpreted: slower, and nothing is compiled before the first step.
    Interpreted,
}

impl Code {
    /// The back end.
    pub fn backend(self) -> &'static dyn Backend {
        match self {
            #[cfg(feature = "native")]
            Code::Native => &bond_compiler::backend::native::JIT,
            #[cfg(not(feature = "native"))]
            Code::Native => &Interpret,
            Code::Interpreted => &Interpret,
        }
    }

    /// A back end for this many scenes that mostly differ in numbers alone: it compiles their common code once. Threads
    /// may share it.
    pub fn shared(self, scenes: u64) -> Box<dyn Backend + Send + Sync> {
        match self {
            #[cfg(feature = "native")]
            Code::Native => Box::new(bond_compiler::backend::native::Shared::new(scenes)),
            #[cfg(not(feature = "native"))]
            Code::Native => Box::new(Interpret),
            Code::Interpreted => Box::new(Interpret),
        }
    }
}
