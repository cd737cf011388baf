//! What two numbers side by side do, each to the bits that it has alone.

use bond_runtime::ir::{Binary, Unary};
use cranelift_codegen::ir::condcodes::FloatCC;
use cranelift_codegen::ir::{self, Endianness, InstBuilder, MemFlagsData, types};
use cranelift_frontend::FunctionBuilder;

/// When two numbers go side by side.
#[derive(Clone, Copy, Debug)]
pub(super) struct VectorOptions {
    /// Statements of straight-line code at least; shorter code stays as it is.
    pub(super) straight_statements: usize,
    /// What two divisions or roots in one instruction save, in instructions: they take as long as one.
    pub(super) slow_gain: i64,
    /// Turns of a loop at least; shorter loops stay as they are.
    pub(super) turns: u32,
    /// Turns from which on a loop goes on by several pairs at a time,
    pub(super) long: u32,
    /// and how many.
    pub(super) unrolled: u32,
}

impl Default for VectorOptions {
    fn default() -> Self {
        Self { straight_statements: 8, slow_gain: 4, turns: 8, long: 64, unrolled: 2 }
    }
}

/// The same word in both.
pub(super) fn constant(b: &mut FunctionBuilder, kind: ir::Type, word: u64) -> ir::Value {
    let both = [word.to_le_bytes(), word.to_le_bytes()].concat();
    let pool = b.func.dfg.constants.insert(ir::ConstantData::from(both));
    b.ins().vconst(kind, pool)
}

/// A number in each.
pub(super) fn numbers(b: &mut FunctionBuilder, both: [f64; 2]) -> ir::Value {
    let both = both.map(|x| x.to_bits().to_le_bytes()).concat();
    let pool = b.func.dfg.constants.insert(ir::ConstantData::from(both));
    b.ins().vconst(types::F64X2, pool)
}

/// The same number in both.
pub(super) fn number(b: &mut FunctionBuilder, x: f64) -> ir::Value {
    constant(b, types::F64X2, x.to_bits())
}

/// The first where the mask is on, else the second.
pub(super) fn choose(b: &mut FunctionBuilder, mask: ir::Value, x: ir::Value, y: ir::Value) -> ir::Value {
    let mask = b.ins().bitcast(types::F64X2, MemFlagsData::new().with_endianness(Endianness::Little), mask);
    b.ins().bitselect(mask, x, y)
}

/// The number where the mask is on, else 0.
pub(super) fn only(b: &mut FunctionBuilder, mask: ir::Value, x: ir::Value) -> ir::Value {
    let flags = MemFlagsData::new().with_endianness(Endianness::Little);
    let mask = b.ins().bitcast(types::F64X2, flags, mask);
    b.ins().band(mask, x)
}

/// A function that is no call, and of numbers.
pub(super) fn unary(b: &mut FunctionBuilder, f: Unary, x: ir::Value) -> ir::Value {
    match f {
        Unary::Neg => b.ins().fneg(x),
        Unary::Abs => b.ins().fabs(x),
        Unary::Sqrt => b.ins().sqrt(x),
        Unary::Sign => {
            let [zero, one, minus] = [0.0, 1.0, -1.0].map(|x| number(b, x));
            let above = b.ins().fcmp(FloatCC::GreaterThan, x, zero);
            let below = b.ins().fcmp(FloatCC::LessThan, x, zero);
            let none = b.ins().fcmp(FloatCC::Equal, x, zero);
            let rest = choose(b, none, zero, x);
            let rest = choose(b, below, minus, rest);
            choose(b, above, one, rest)
        }
        _ => x,
    }
}

/// What a function of two numbers is.
pub(super) enum Kind {
    /// A number, by this.
    Number(fn(&mut FunctionBuilder, ir::Value, ir::Value) -> ir::Value),
    /// A comparison.
    Compared(FloatCC),
    /// Of two conditions: both, or one.
    Joined { both: bool },
    /// A call.
    Call,
}

/// See [`Kind`].
pub(super) fn binary(f: Binary) -> Kind {
    match f {
        Binary::Add => Kind::Number(|b, x, y| b.ins().fadd(x, y)),
        Binary::Sub => Kind::Number(|b, x, y| b.ins().fsub(x, y)),
        Binary::Mul => Kind::Number(|b, x, y| b.ins().fmul(x, y)),
        Binary::Div => Kind::Number(|b, x, y| b.ins().fdiv(x, y)),
        Binary::Min => Kind::Number(|b, x, y| b.ins().fmin(x, y)),
        Binary::Max => Kind::Number(|b, x, y| b.ins().fmax(x, y)),
        Binary::Lt => Kind::Compared(FloatCC::LessThan),
        Binary::Le => Kind::Compared(FloatCC::LessThanOrEqual),
        Binary::Eq => Kind::Compared(FloatCC::Equal),
        Binary::And => Kind::Joined { both: true },
        Binary::Or => Kind::Joined { both: false },
        Binary::Pow | Binary::Atan2 => Kind::Call,
    }
}
