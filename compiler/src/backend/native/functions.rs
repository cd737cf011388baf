//! The functions that compiled code calls: those of numbers that no machine instruction gives.

use bond_runtime::eval;
use bond_runtime::ir::{Binary, Unary};

/// The name under which compiled code finds a function; None where an instruction or a few do it.
pub(super) fn unary(f: Unary) -> Option<&'static str> {
    (f.is_library() || f == Unary::Floor).then(|| f.symbol())
}

/// The same for functions of two values.
pub(super) fn binary(f: Binary) -> Option<&'static str> {
    match f {
        Binary::Pow => Some("bond_pow"),
        Binary::Atan2 => Some("bond_atan2"),
        Binary::Add
        | Binary::Sub
        | Binary::Mul
        | Binary::Div
        | Binary::Min
        | Binary::Max
        | Binary::Lt
        | Binary::Le
        | Binary::Eq
        | Binary::And
        | Binary::Or => None,
    }
}

extern "C" fn pow(a: f64, b: f64) -> f64 {
    eval::binary(Binary::Pow, a, b)
}

extern "C" fn atan2(a: f64, b: f64) -> f64 {
    eval::binary(Binary::Atan2, a, b)
}

/// Names and addresses of the functions of two values.
pub(super) const TWO: &[(Binary, extern "C" fn(f64, f64) -> f64)] = &[(Binary::Pow, pow), (Binary::Atan2, atan2)];

/// Sine and cosine of one number, as two numbers.
#[repr(C)]
pub(super) struct SinCos(f64, f64);

/// The name of the function that gives both.
pub(super) const SIN_COS: &str = "bond_sincos";

/// See [`SIN_COS`].
pub(super) extern "C" fn sin_cos(x: f64) -> SinCos {
    let (sine, cosine) = eval::turn(x);
    SinCos(sine, cosine)
}

/// The name of the function that solves large systems: context, system, matrix entries, right side; gives -1 or a row.
pub(super) const SOLVE: &str = "bond_solve";

/// The name of a function in the system's `libm`.
pub(super) fn libm(name: &'static str) -> &'static str {
    name.strip_prefix("bond_").unwrap_or(name)
}
