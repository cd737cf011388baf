//! The scalar operations: one row per operation, with its name and what it computes.
//!
//! An operation is written in one row here. The compiler's facts about a function (derivative, parity, sign and so on)
//! are one row of `expression/unary.rs` in `bond-compiler`.

use crate::eval::functions;
use serde::{Deserialize, Serialize};

/// Who computes a function of one value on the back ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// Each back end has an instruction or a few for it.
    Instruction,
    /// A function of this name: of `libm` in C and object files, of `Math` in WebAssembly, of [`eval`](crate::eval)
    /// elsewhere. In the language its argument and its value have no unit.
    Library,
}

macro_rules! unary {
    ($($(#[$doc:meta])* $op:ident $name:literal $form:ident $meaning:expr,)+) => {
        /// Functions of one value.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[expect(missing_docs, reason = "the names say it")]
        pub enum Unary {
            $($(#[$doc])* $op,)+
        }

        impl Unary {
            /// All of them.
            pub const ALL: [Unary; [$($name),+].len()] = [$(Unary::$op),+];

            /// As it is written in the language and in the text form of a program.
            pub fn name(self) -> &'static str {
                match self {
                    $(Unary::$op => $name,)+
                }
            }

            /// Its value at `a`.
            #[inline]
            pub(crate) fn value(self, a: f64) -> f64 {
                match self {
                    $(Unary::$op => $meaning(a),)+
                }
            }

            /// The name under which machine code finds the function.
            pub fn symbol(self) -> &'static str {
                match self {
                    $(Unary::$op => concat!("bond_", $name),)+
                }
            }

            /// The function, for machine code to call.
            pub fn address(self) -> extern "C" fn(f64) -> f64 {
                match self {
                    $(Unary::$op => {
                        extern "C" fn value(a: f64) -> f64 {
                            $meaning(a)
                        }
                        value
                    })+
                }
            }

            fn form(self) -> Form {
                match self {
                    $(Unary::$op => Form::$form,)+
                }
            }
        }
    };
}

// A new row goes to the end: saved scenes hold an operation by its number.
unary! {
    Neg "neg" Instruction std::ops::Neg::neg,
    Abs "abs" Instruction f64::abs,
    /// -1, 0 or 1; `sign(0) = 0`, NaN stays NaN.
    Sign "sign" Instruction functions::sign,
    Sqrt "sqrt" Instruction f64::sqrt,
    Exp "exp" Library pxfm::f_exp,
    Log "log" Library pxfm::f_log,
    Sin "sin" Library libm::sin,
    Cos "cos" Library libm::cos,
    Tan "tan" Library libm::tan,
    Asin "asin" Library libm::asin,
    Acos "acos" Library libm::acos,
    Atan "atan" Library libm::atan,
    Sinh "sinh" Library functions::sinh,
    Cosh "cosh" Library pxfm::f_cosh,
    Tanh "tanh" Library libm::tanh,
    /// 1 where the value is 0, else 0.
    Not "not" Instruction functions::not,
    /// The largest whole number that is not above the value.
    Floor "floor" Instruction f64::floor,
}

impl Unary {
    /// Whether it is a function of a mathematical library on every back end, and not an instruction.
    pub fn is_library(self) -> bool {
        self.form() == Form::Library
    }
}

macro_rules! binary {
    ($($(#[$doc:meta])* $op:ident $name:literal $meaning:expr,)+) => {
        /// Functions of two values.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[expect(missing_docs, reason = "the names say it")]
        pub enum Binary {
            $($(#[$doc])* $op,)+
        }

        impl Binary {
            /// All of them.
            pub const ALL: [Binary; [$($name),+].len()] = [$(Binary::$op),+];

            /// As it is written in the text form of a program.
            pub fn name(self) -> &'static str {
                match self {
                    $(Binary::$op => $name,)+
                }
            }

            /// Its value at `a` and `b`.
            #[inline]
            pub(crate) fn value(self, a: f64, b: f64) -> f64 {
                match self {
                    $(Binary::$op => $meaning(a, b),)+
                }
            }
        }
    };
}

binary! {
    Add "add" std::ops::Add::add,
    Sub "sub" std::ops::Sub::sub,
    Mul "mul" std::ops::Mul::mul,
    Div "div" std::ops::Div::div,
    /// `a^b`; integer and half-integer exponents are products and roots.
    Pow "pow" functions::pow,
    /// The smaller; NaN if either is.
    Min "min" functions::min,
    /// The larger; NaN if either is.
    Max "max" functions::max,
    Atan2 "atan2" libm::atan2,
    /// Comparisons give 1 or 0, and 0 where either is NaN.
    Lt "lt" functions::less,
    Le "le" functions::less_or_equal,
    Eq "eq" functions::equal,
    And "and" functions::and,
    Or "or" functions::or,
}
