//! The text form of a program: one line an instruction, the body of an iteration indented.

use super::{Array, Inst, Newton, Op, Program, Slot, Solve, Value};
use std::fmt::{Display, Formatter, Result};

impl Display for Value {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        write!(f, "v{}", self.0)
    }
}

impl Display for Slot {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        write!(f, "{}[{}]", self.array.letter(), self.index)
    }
}

impl Display for Op {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match self {
            Op::Const(x) => write!(f, "const {x:?}"),
            Op::Load(slot) => write!(f, "load {slot}"),
            Op::Unary(u, a) => write!(f, "{} {a}", u.name()),
            Op::Binary(b, x, y) => write!(f, "{} {x} {y}", b.name()),
            Op::Select(c, a, b) => write!(f, "select {c} {a} {b}"),
        }
    }
}

impl Display for Program {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        writeln!(f, "program {:?}", self.name)?;
        for array in Array::ALL {
            if self.size(array) > 0 {
                writeln!(f, "  {}", Line(array, self.size(array)))?;
            }
        }
        for (slot, name) in &self.names {
            writeln!(f, "  {slot} is {name}")?;
        }
        block(f, &self.body, 1)
    }
}

/// The size of an array.
struct Line(Array, usize);

impl Display for Line {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let what = match self.0 {
            Array::State => "state",
            Array::Next => "next state",
            Array::Input => "input",
            Array::Table => "table",
            Array::Local => "scratch",
            Array::Output => "output",
        };
        write!(f, "{}[{}] {what}", self.0.letter(), self.1)
    }
}

fn block(f: &mut Formatter<'_>, body: &[Inst], depth: usize) -> Result {
    let indent = "  ".repeat(depth);
    for inst in body {
        match inst {
            Inst::Let(v, op) => writeln!(f, "{indent}{v} = {op}")?,
            Inst::Store(slot, v) => writeln!(f, "{indent}{slot} = {v}")?,
            Inst::Newton(newton) => iteration(f, newton, depth)?,
            Inst::Solve(solve) => system(f, solve, &indent)?,
            Inst::MatVec { to, table, from, rows, cols, low } => {
                let low = if *low { " twice" } else { "" };
                writeln!(f, "{indent}{to} = matrix c[{table}] {rows}x{cols}{low} times {from}")?;
            }
            Inst::Quad { to, table, from, n, root } => {
                let form = if *root { "squares" } else { "form" };
                writeln!(f, "{indent}{to} = {form} c[{table}] {n} of {from}")?;
            }
        }
    }
    Ok(())
}

fn system(f: &mut Formatter<'_>, solve: &Solve, indent: &str) -> Result {
    let first = Slot { array: Array::Local, index: solve.unknowns };
    let what = if solve.is_complex() { " complex" } else { "" };
    write!(f, "{indent}solve {first} {}{what}", solve.size())?;
    if let Some(flag) = solve.flag {
        write!(f, " flag {flag}")?;
    }
    writeln!(f)?;
    for (i, b) in solve.right.iter().enumerate() {
        writeln!(f, "{indent}  b[{i}] = {b}")?;
    }
    for (i, (row, column, v)) in solve.matrix.iter().enumerate() {
        write!(f, "{indent}  A[{row}, {column}] = {v}")?;
        match solve.imaginary.get(i) {
            Some(im) => writeln!(f, ", {im}")?,
            None => writeln!(f)?,
        }
    }
    Ok(())
}

fn iteration(f: &mut Formatter<'_>, newton: &Newton, depth: usize) -> Result {
    let indent = "  ".repeat(depth);
    let n = newton.residual.len();
    let first = Slot { array: Array::Local, index: newton.unknowns };
    write!(f, "{indent}newton {first} {n} limit {}", newton.limit)?;
    if newton.affine {
        write!(f, " affine")?;
    }
    if newton.undetermined {
        write!(f, " open")?;
    }
    if newton.corners {
        write!(f, " corners")?;
    }
    if !newton.update.is_empty() {
        write!(f, " left {:e}", newton.left)?;
    }
    if let Some(index) = newton.rounding {
        write!(f, " rests {}", Slot { array: Array::Local, index })?;
    }
    if let Some(flag) = newton.flag {
        write!(f, " flag {flag}")?;
    }
    writeln!(f)?;
    block(f, &newton.body, depth + 1)?;
    for (i, r) in newton.residual.iter().enumerate() {
        writeln!(f, "{indent}  r[{i}] = {r}")?;
    }
    for (row, column, v) in &newton.jacobian {
        writeln!(f, "{indent}  J[{row}, {column}] = {v}")?;
    }
    for (i, d) in newton.update.iter().enumerate() {
        writeln!(f, "{indent}  d[{i}] = {d}")?;
    }
    for (i, (weight, scale)) in newton.weight.iter().zip(&newton.scale).enumerate() {
        writeln!(f, "{indent}  weight[{i}] = {weight}, scale[{i}] = {scale}")?;
    }
    for (i, x) in newton.cold.iter().enumerate() {
        writeln!(f, "{indent}  cold[{i}] = {x}")?;
    }
    for x in &newton.small {
        writeln!(f, "{indent}  small {x}")?;
    }
    for b in &newton.knees {
        writeln!(f, "{indent}  bend[{}] from {:?} by {:?}", b.unknown, b.knee, b.rate)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::ir::{Array, Builder, Inst, Newton, Slot, Unary};
    use crate::options::NewtonOptions;

    #[test]
    fn text_of_each_instruction() {
        let mut b = Builder::new("all of them");
        let (x, y) = (b.named(Array::State, "mass.p"), b.slot(Array::Output));
        let (w, flag) = (b.slots(Array::Local, 2), b.slot(Array::Local));
        let n = b.slot(Array::Next);
        b.slots(Array::Table, 4);
        let v = b.load(x);
        let s = b.unary(Unary::Sin, v);
        let c = b.select(v, s, v);
        b.store(w, c);
        b.store(Slot::new(Array::Local, w.index as usize + 1), s);
        b.push(Inst::Quad { to: y, table: 0, from: w, n: 2, root: false }, y, 1);
        let to = Slot::new(Array::Next, n.index as usize);
        b.push(Inst::MatVec { to, table: 0, from: w, rows: 1, cols: 2, low: true }, to, 1);
        let one = b.number(1.0);
        b.open(w, 1);
        let u = b.load(w);
        let r = b.sub(u, one);
        b.close(Newton {
            unknowns: w.index,
            rounding: None,
            body: Vec::new(),
            residual: vec![r],
            jacobian: vec![(0, 0, one)],
            weight: vec![one],
            scale: vec![v],
            cold: Vec::new(),
            small: Vec::new(),
            knees: Vec::new(),
            options: NewtonOptions::DEFAULT,
            limit: 9,
            update: Vec::new(),
            left: 0.0,
            affine: false,
            undetermined: false,
            corners: false,
            flag: Some(flag),
        });
        let program = b.finish();
        assert_eq!(program.verify(), Ok(()));
        let text = "\
program \"all of them\"
  x[1] state
  n[1] next state
  c[4] table
  w[3] scratch
  y[1] output
  x[0] is mass.p
  v0 = load x[0]
  v1 = sin v0
  v2 = select v0 v1 v0
  w[0] = v2
  w[1] = v1
  y[0] = form c[0] 2 of w[0]
  n[0] = matrix c[0] 1x2 twice times w[0]
  v3 = const 1.0
  newton w[0] 1 limit 9 flag w[2]
    v4 = load w[0]
    v5 = sub v4 v3
    r[0] = v5
    J[0, 0] = v3
    weight[0] = v3, scale[0] = v0
";
        assert_eq!(program.to_string(), text);
    }
}
