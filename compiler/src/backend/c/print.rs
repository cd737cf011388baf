//! A routine as a C function, statement by statement.

use super::double_buffer;
use crate::backend::code::{Bound, Cond, Memory, Number, Op, Picked, Place, Routine, Span, Stmt, Value, visit};
use crate::backend::if_conversion::is_comparison;
use crate::backend::standalone::Late;
use bond_runtime::ir::{Binary, Unary};
use std::collections::BTreeSet;
use std::fmt::Write;

/// What functions need besides themselves: names of helpers of [`super::helpers`].
pub(super) type Needs = BTreeSet<&'static str>;

/// The letter that a memory goes by.
pub(super) fn letter(memory: Memory) -> char {
    match memory {
        Memory::State => 'x',
        Memory::Input => 'u',
        Memory::Table => 'c',
        Memory::Next => 'n',
        Memory::Output => 'y',
        Memory::Scratch => 's',
        Memory::Data => 'd',
    }
}

/// The body of a function whose memories are pointers named as [`letter`] says; returns 0, or why it failed. Its
/// systems are numbered from `first` on.
pub(super) fn body(routine: &Routine, first: usize, late: &[Late], needs: &mut Needs) -> String {
    let mut out = String::new();
    let used = Used::of(routine);
    for v in &used.vars {
        let _ = writeln!(out, "    bond_real m{v} = 0;");
    }
    for i in &used.indices {
        let _ = writeln!(out, "    unsigned long i{i};");
    }
    let words = Words { numbers: &routine.numbers, lane_words: None, late, tables: &routine.tables, needs };
    let mut printer = Printer { words, first, out, loops: Vec::new(), count: 0 };
    printer.block(&routine.body, 1);
    let mut out = printer.out;
    if !matches!(routine.body.last(), Some(Stmt::Fail(_))) {
        out.push_str("    return 0;\n");
    }
    out
}

/// The memories that a routine looks at.
pub(super) fn memories(routine: &Routine) -> Vec<Memory> {
    let used = Used::of(routine);
    Memory::ALL.into_iter().filter(|m| used.memories.contains(&letter(*m))).collect()
}

/// What a routine uses.
#[derive(Default)]
struct Used {
    vars: BTreeSet<u32>,
    indices: BTreeSet<u32>,
    memories: BTreeSet<char>,
}

impl Used {
    fn of(routine: &Routine) -> Self {
        let mut used = Self::default();
        visit(&routine.body, &mut |s| {
            used.vars.extend(s.sets().map(|var| var.0));
            used.memories.extend(s.place().map(|p| letter(p.memory)));
            match s {
                Stmt::Let(_, Op::Get(var)) => {
                    used.vars.insert(var.0);
                }
                Stmt::For(i, ..) | Stmt::Span(Span { index: i, .. }, _) => {
                    used.indices.insert(i.0);
                }
                Stmt::Solve { .. } => {
                    used.memories.insert(letter(Memory::Scratch));
                }
                _ => {}
            }
        });
        used
    }
}

struct Printer<'a> {
    words: Words<'a>,
    first: usize,
    out: String,
    /// The endless loops around, and how many there were.
    loops: Vec<Around>,
    count: u32,
}

/// An endless loop.
struct Around {
    number: u32,
    /// How many loops that count are around within it.
    spans: u32,
    /// What has a label that is asked for.
    labels: BTreeSet<&'static str>,
}

/// Where a loop begins or ends.
fn bound(bound: Bound) -> String {
    match bound {
        Bound::Known(i) => i.to_string(),
        Bound::Past(i, 0) => format!("i{}", i.0),
        Bound::Past(i, more) => format!("i{} + {more}", i.0),
        Bound::Table(at, i) => format!("g[{at} + i{}]", i.0),
    }
}

/// How values, places and conditions are written.
pub(super) struct Words<'a> {
    /// The numbers that values are.
    pub(super) numbers: &'a [Option<Number>],
    /// Where several scenes are done side by side: how.
    pub(super) lane_words: Option<LaneWords<'a>>,
    /// States that are at `p0`, ..., and where the new ones go, at `q0`, ...
    pub(super) late: &'a [Late],
    /// Places that do not run evenly.
    pub(super) tables: &'a [u32],
    /// Helpers that are called.
    pub(super) needs: &'a mut Needs,
}

/// How scenes that are done side by side are written: the number of the lane is `l`, the block `b->x`.
pub(super) struct LaneWords<'a> {
    /// How many lanes there are.
    pub(super) lanes: &'a str,
    /// Values that are conditions.
    pub(super) flags: &'a BTreeSet<Value>,
}

/// A number with the digits that read back to it.
pub(super) fn number(n: Number) -> String {
    match n {
        Number::Tolerance(x) => {
            // What is small beside rounding of 53 bits is as small beside that of 24 where the exponents are in their
            // ratio.
            let single = libm::pow(x, libm::log(f64::from(f32::EPSILON)) / libm::log(f64::EPSILON));
            format!("BOND_SMALL({x:?}, {:?})", single as f32)
        }
        Number::Plain(x) if x.is_nan() => "BOND_NAN".into(),
        Number::Plain(x) if x.is_infinite() => if x > 0.0 { "BOND_INFINITY" } else { "(-BOND_INFINITY)" }.into(),
        Number::Plain(x) if x == 0.0 && x.is_sign_positive() => "BOND_R(0.0)".into(),
        // What bounds doubles is to bound single numbers, too.
        Number::Plain(x) if x.abs() > f64::from(f32::MAX) => {
            format!("BOND_SMALL({x:?}, {:?})", f32::MAX.copysign(x as f32))
        }
        Number::Plain(x) => format!("BOND_R({x:?})"),
    }
}

impl Printer<'_> {
    fn line(&mut self, depth: usize, text: &str) {
        for _ in 0..depth {
            self.out.push_str("    ");
        }
        self.out.push_str(text);
        self.out.push('\n');
    }

    fn block(&mut self, body: &[Stmt], depth: usize) {
        for s in body {
            match s {
                Stmt::Let(v, op) => {
                    let e = self.words.op(op);
                    self.line(depth, &format!("const bond_real v{} = {e};", v.0));
                }
                Stmt::Set(m, v) => self.line(depth, &format!("m{} = {};", m.0, self.words.of(*v))),
                Stmt::Store(p, v) => {
                    let place = self.words.place(p);
                    self.line(depth, &format!("{place} = {};", self.words.of(*v)));
                }
                Stmt::If(c, yes, no) => {
                    let c = self.words.cond(c);
                    self.line(depth, &format!("if {} {{", wrapped(&c)));
                    self.block(yes, depth + 1);
                    if !no.is_empty() {
                        self.line(depth, "} else {");
                        self.block(no, depth + 1);
                    }
                    self.line(depth, "}");
                }
                Stmt::Loop(body) => self.repeat(body, depth),
                Stmt::Break => self.leave(depth, "break", "end"),
                Stmt::Continue => self.leave(depth, "continue", "next"),
                Stmt::For(i, from, to, body) => {
                    self.line(depth, &format!("for (i{0} = {from}; i{0} < {to}; ++i{0}) {{", i.0));
                    self.block(body, depth + 1);
                    self.line(depth, "}");
                }
                Stmt::Span(span, body) => {
                    let (i, from, to) = (span.index.0, bound(span.from), bound(span.to));
                    let head = match span.back {
                        false => format!("for (i{i} = {from}; i{i} < {to}; ++i{i}) {{"),
                        true => format!("for (i{i} = {to}; i{i}-- > {from};) {{"),
                    };
                    self.line(depth, &head);
                    if let Some(around) = self.loops.last_mut() {
                        around.spans += 1;
                    }
                    self.block(body, depth + 1);
                    if let Some(around) = self.loops.last_mut() {
                        around.spans -= 1;
                    }
                    self.line(depth, "}");
                }
                Stmt::Solve { system, matrix, vector, row, same } => {
                    let system = self.first + *system as usize;
                    let same = same.map_or("0".into(), |v| format!("{} != 0", self.words.of(v)));
                    let call = format!("bond_solve_{system}(s + {matrix}, s + {vector}, s, {same})");
                    self.line(depth, &format!("m{} = {call};", row.0));
                }
                Stmt::Count(v) => self.unused(depth, *v),
                // Who runs a scene by itself reads no notes.
                Stmt::Note(list) => list.iter().for_each(|v| self.unused(depth, *v)),
                Stmt::Fail(reason) => {
                    reason.values().into_iter().for_each(|v| self.unused(depth, v));
                    self.line(depth, &format!("return BOND_{};", reason.name()));
                }
            }
        }
    }

    fn repeat(&mut self, body: &[Stmt], depth: usize) {
        self.count += 1;
        self.loops.push(Around { number: self.count, spans: 0, labels: BTreeSet::new() });
        self.line(depth, "for (;;) {");
        self.block(body, depth + 1);
        let Some(Around { number, labels, .. }) = self.loops.pop() else { return };
        if labels.contains("next") {
            self.line(depth, &format!("next{number}:;"));
        }
        self.line(depth, "}");
        if labels.contains("end") {
            self.line(depth, &format!("end{number}:;"));
        }
    }

    /// Leaves the innermost endless loop, from within loops that count inside it by a label.
    fn leave(&mut self, depth: usize, word: &str, label: &'static str) {
        match self.loops.last_mut().filter(|around| around.spans > 0) {
            Some(around) => {
                around.labels.insert(label);
                let to = format!("goto {label}{};", around.number);
                self.line(depth, &to);
            }
            None => self.line(depth, &format!("{word};")),
        }
    }

    /// Says that a value is left alone on purpose.
    fn unused(&mut self, depth: usize, v: Value) {
        if self.words.numbers[v.0 as usize].is_none() {
            self.line(depth, &format!("(void)v{};", v.0));
        }
    }
}

impl Words<'_> {
    /// A value, as a number.
    pub(super) fn of(&self, v: Value) -> String {
        match self.numbers[v.0 as usize] {
            Some(n) => number(n),
            None => format!("v{}", v.0),
        }
    }

    fn place(&mut self, p: &Place) -> String {
        if let Some(lane_words) = &self.lane_words {
            match p.memory {
                Memory::State => return format!("b->x[{}][l]", p.base),
                Memory::Input => return format!("u[{} * {} + l]", p.base, lane_words.lanes),
                Memory::Table | Memory::Next | Memory::Output | Memory::Scratch | Memory::Data => {}
            }
        }
        let first = double_buffer::first(p, self.tables);
        let part = double_buffer::parts(if p.memory == Memory::State { self.late } else { &[] });
        let part = part.map(|(name, k, r)| (format!("{name}{k}"), r)).find(|(_, r)| r.contains(&first));
        let (name, start) = part.map_or((letter(p.memory).to_string(), 0), |(name, r)| (name, r.start));
        let base = p.base as usize;
        let mut index = base.checked_sub(start).unwrap_or(base).to_string();
        for (i, stride) in &p.along {
            let _ = if *stride == 1 { write!(index, " + i{}", i.0) } else { write!(index, " + i{} * {stride}", i.0) };
        }
        if let Some((at, i)) = p.through {
            let _ = write!(index, " + g[{at} + i{}]", i.0);
        }
        if let Some(Picked { by, stride, count }) = p.picked {
            self.needs.insert("bond_place");
            let _ = write!(index, " + {stride} * bond_place({}, {count})", self.of(by));
        }
        if base < start {
            let _ = write!(index, " - {start}");
        }
        format!("{name}[{index}]")
    }

    /// How a value is computed.
    pub(super) fn op(&mut self, op: &Op) -> String {
        if self.lane_words.is_some() && is_comparison(op) {
            return format!("bond_pick({}, BOND_R(1.0), BOND_R(0.0))", self.truth(op));
        }
        let truth = |text: String| format!("({} ? BOND_R(1.0) : BOND_R(0.0))", wrapped(&text));
        match op {
            Op::Load(p) => self.place(p),
            Op::Get(m) => format!("m{}", m.0),
            Op::Counter(i) => format!("(bond_real)(long)i{}", i.0),
            Op::InverseScale(x) => {
                self.needs.insert("bond_scale");
                format!("bond_scale({})", self.of(*x))
            }
            Op::Unary(f, x) => {
                let a = self.of(*x);
                match f {
                    Unary::Neg => format!("-{a}"),
                    Unary::Abs => format!("BOND_M(fabs)({a})"),
                    Unary::Not => truth(format!("!{}", wrapped(&self.is_true(*x)))),
                    Unary::Sign => {
                        let name = self.helper("bond_sign", "bond_lane_sign");
                        format!("{name}({a})")
                    }
                    _ => format!("BOND_M({})({a})", f.name()),
                }
            }
            Op::Binary(f, x, y) => {
                let (a, b) = (self.of(*x), self.of(*y));
                match f {
                    Binary::Add => format!("{a} + {b}"),
                    Binary::Sub => format!("{a} - {b}"),
                    Binary::Mul => format!("{a} * {b}"),
                    Binary::Div => format!("{a} / {b}"),
                    Binary::Pow => format!("BOND_M(pow)({a}, {b})"),
                    Binary::Atan2 => format!("BOND_M(atan2)({a}, {b})"),
                    Binary::Min => {
                        let name = self.helper("bond_min", "bond_lane_min");
                        format!("{name}({a}, {b})")
                    }
                    Binary::Max => {
                        let name = self.helper("bond_max", "bond_lane_max");
                        format!("{name}({a}, {b})")
                    }
                    Binary::Lt => truth(format!("{a} < {b}")),
                    Binary::Le => truth(format!("{a} <= {b}")),
                    Binary::Eq => truth(format!("{a} == {b}")),
                    Binary::And => truth(self.cond(&Cond::All(vec![Cond::True(*x), Cond::True(*y)]))),
                    Binary::Or => truth(self.cond(&Cond::Any(vec![Cond::True(*x), Cond::True(*y)]))),
                }
            }
            Op::Select(c, a, b) => {
                let (c, a, b) = (self.cond(c), self.of(*a), self.of(*b));
                match self.lane_words.is_some() {
                    true => format!("bond_pick({c}, {a}, {b})"),
                    false => format!("{} ? {a} : {b}", wrapped(&c)),
                }
            }
        }
    }

    /// A helper, by itself or without branches.
    fn helper(&mut self, name: &'static str, in_lanes: &'static str) -> &'static str {
        let name = if self.lane_words.is_some() { in_lanes } else { name };
        self.needs.insert(name);
        name
    }

    fn is_true(&self, v: Value) -> String {
        match &self.lane_words {
            Some(lane_words) if lane_words.flags.contains(&v) => format!("v{}", v.0),
            Some(_) | None => self.whether(format!("{} != 0", self.of(v))),
        }
    }

    /// What a comparison comes to: a condition.
    pub(super) fn truth(&self, op: &Op) -> String {
        let all = |a: &Value, b: &Value| vec![Cond::True(*a), Cond::True(*b)];
        match op {
            Op::Select(c, ..) => self.cond(c),
            Op::Unary(_, a) => self.cond(&Cond::Not(Box::new(Cond::True(*a)))),
            Op::Binary(Binary::Lt, a, b) => self.cond(&Cond::Lt(*a, *b)),
            Op::Binary(Binary::Le, a, b) => self.cond(&Cond::Le(*a, *b)),
            Op::Binary(Binary::And, a, b) => self.cond(&Cond::All(all(a, b))),
            Op::Binary(Binary::Or, a, b) => self.cond(&Cond::Any(all(a, b))),
            Op::Binary(_, a, b) => self.cond(&Cond::Eq(*a, *b)),
            Op::Load(_) | Op::Get(_) | Op::Counter(_) | Op::InverseScale(_) => self.cond(&Cond::Known(false)),
        }
    }

    /// A comparison, as conditions are written here: true and false, or all bits and none, which numbers of several
    /// lanes are chosen with.
    fn whether(&self, c: String) -> String {
        if self.lane_words.is_some() { format!("BOND_IF({c})") } else { c }
    }

    /// A condition.
    pub(super) fn cond(&self, c: &Cond) -> String {
        match c {
            Cond::Known(b) => self.whether(u8::from(*b).to_string()),
            Cond::True(v) => self.is_true(*v),
            Cond::Lt(a, b) => self.whether(format!("{} < {}", self.of(*a), self.of(*b))),
            Cond::Le(a, b) => self.whether(format!("{} <= {}", self.of(*a), self.of(*b))),
            Cond::Eq(a, b) => self.whether(format!("{} == {}", self.of(*a), self.of(*b))),
            Cond::Finite(v) => self.whether(format!("BOND_M(fabs)({}) < BOND_INFINITY", self.of(*v))),
            Cond::Not(c) => format!("{}{}", if self.lane_words.is_some() { '~' } else { '!' }, wrapped(&self.cond(c))),
            Cond::All(list) | Cond::Any(list) => {
                let how = match (matches!(c, Cond::All(_)), self.lane_words.is_some()) {
                    (true, false) => " && ",
                    (false, false) => " || ",
                    (true, true) => " & ",
                    (false, true) => " | ",
                };
                let parts: Vec<String> = list.iter().map(|c| wrapped(&self.cond(c))).collect();
                parts.join(how)
            }
        }
    }
}

/// A table of whole numbers.
pub(super) fn table(out: &mut String, name: &str, list: &[u32]) {
    let _ = write!(out, "{name} = {{");
    if list.is_empty() {
        out.push_str(" 0");
    }
    for (i, x) in list.iter().enumerate() {
        out.push_str(if i % 24 == 0 { "\n    " } else { " " });
        let _ = write!(out, "{x},");
    }
    out.push_str("\n};\n");
}

/// A condition in parentheses.
pub(super) fn wrapped(c: &str) -> String {
    format!("({c})")
}
