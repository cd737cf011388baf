use super::*;
use crate::backend::code::{Place, Reason, Stmt, Var};
use bond_runtime::eval;

/// Numbers of a routine that runs: values, variables, and the block.
struct Run<'a> {
    numbers: &'a [Option<Number>],
    values: Vec<f64>,
    vars: Vec<f64>,
    block: Vec<f64>,
    turns: usize,
}

impl<'a> Run<'a> {
    fn new(numbers: &'a [Option<Number>], vars: u32, block: &[f64]) -> Self {
        let values = numbers.iter().map(|n| n.map_or(f64::NAN, Number::value)).collect();
        Self { numbers, values, vars: vec![0.0; vars as usize], block: block.to_vec(), turns: 0 }
    }

    fn of(&self, v: Value) -> f64 {
        self.values[v.0 as usize]
    }

    fn cond(&self, c: &Cond) -> bool {
        match c {
            Cond::Known(b) => *b,
            Cond::True(a) => self.of(*a) != 0.0,
            Cond::Lt(a, b) => self.of(*a) < self.of(*b),
            Cond::Le(a, b) => self.of(*a) <= self.of(*b),
            Cond::Eq(a, b) => self.of(*a) == self.of(*b),
            Cond::Finite(a) => self.of(*a).is_finite(),
            Cond::Not(c) => !self.cond(c),
            Cond::All(list) => list.iter().all(|c| self.cond(c)),
            Cond::Any(list) => list.iter().any(|c| self.cond(c)),
        }
    }

    fn define(&mut self, v: Value, op: &Op) {
        assert!(self.numbers[v.0 as usize].is_none());
        self.values[v.0 as usize] = match op {
            Op::Load(p) => self.block[p.base as usize],
            Op::Get(var) => self.vars[var.0 as usize],
            Op::Unary(f, a) => eval::unary(*f, self.of(*a)),
            Op::Binary(f, a, b) => eval::binary(*f, self.of(*a), self.of(*b)),
            Op::Select(c, a, b) => self.of(if self.cond(c) { *a } else { *b }),
            Op::InverseScale(a) => eval::inverse_scale(self.of(*a)),
            Op::Counter(_) => unreachable!("these routines have no loops over tables"),
        };
    }

    /// The statement that a block ends with, where that is not its end.
    fn go(&mut self, body: &[Stmt]) -> Option<Stmt> {
        for s in body {
            let end = match s {
                Stmt::Let(v, op) => {
                    self.define(*v, op);
                    None
                }
                Stmt::Set(var, v) => {
                    self.vars[var.0 as usize] = self.of(*v);
                    None
                }
                Stmt::Store(p, v) => {
                    self.block[p.base as usize] = self.of(*v);
                    None
                }
                Stmt::If(c, yes, no) => self.go(if self.cond(c) { yes } else { no }),
                Stmt::Loop(body) => loop {
                    self.turns += 1;
                    match self.go(body) {
                        Some(Stmt::Break) => break None,
                        None | Some(Stmt::Continue) => {}
                        end => break end,
                    }
                },
                end => Some(end.clone()),
            };
            if end.is_some() {
                return end;
            }
        }
        None
    }
}

const N: [f64; 5] = [0.0, 1.0, 2.0, 0.5, 100.0];

fn routine(body: Vec<Stmt>, values: usize, vars: u32) -> Routine {
    let numbers = N.iter().map(|x| Some(Number::Plain(*x))).chain((0..values).map(|_| None)).collect();
    let (systems, data, tables) = (Vec::new(), Vec::new(), Vec::new());
    Routine { name: String::new(), body, numbers, vars, indices: 0, scratch: 0, systems, data, tables }
}

fn v(k: u32) -> Value {
    Value(N.len() as u32 + k)
}

fn at(k: u32) -> Place {
    Place::new(Memory::State, k)
}

/// Asserts that a lane form does what a routine does, or says that it does not; how often it does.
fn same(routine: &Routine, form: &LaneForm) -> usize {
    let mut quick = 0;
    for k in 0..400 {
        let block = [f64::from(k % 21) * 0.25 - 2.0, f64::from(k / 21) * 0.25 - 2.0, 7.0];
        let (mut plain, mut flat) =
            (Run::new(&routine.numbers, routine.vars, &block), Run::new(&form.numbers, 0, &block));
        let end = plain.go(&routine.body);
        form.body.iter().for_each(|l| flat.define(l.value, &l.op));
        if flat.cond(&form.slow) {
            continue;
        }
        assert_eq!(end, None, "{block:?} does not fail");
        let writes: Vec<(u32, f64)> = form.writes.iter().map(|(at, v)| (*at, flat.of(*v))).collect();
        writes.into_iter().for_each(|(at, x)| flat.block[at as usize] = x);
        let bits = |list: &[f64]| list.iter().map(|x| x.to_bits()).collect::<Vec<u64>>();
        assert_eq!(bits(&plain.block), bits(&flat.block), "{block:?}");
        quick += 1;
    }
    quick
}

/// A block that is left in three places, branches that set and write, and one that fails.
#[test]
fn branches_and_exits_are_choices() {
    let [zero, one, two, half, _] = [0, 1, 2, 3, 4].map(Value);
    let body = vec![
        Stmt::Let(v(0), Op::Load(at(0))),
        Stmt::Let(v(1), Op::Load(at(1))),
        Stmt::Loop(vec![
            Stmt::Let(v(2), Op::Binary(Binary::Mul, v(0), v(1))),
            Stmt::If(Cond::Lt(v(2), zero), vec![Stmt::Set(Var(0), one), Stmt::Break], Vec::new()),
            Stmt::If(
                Cond::Lt(v(0), v(1)),
                vec![
                    Stmt::Set(Var(1), v(2)),
                    Stmt::If(Cond::Lt(one, v(2)), vec![Stmt::Set(Var(0), two), Stmt::Break], Vec::new()),
                    Stmt::Store(at(2), v(1)),
                ],
                vec![Stmt::Let(v(3), Op::Unary(Unary::Sqrt, v(0))), Stmt::Set(Var(1), v(3))],
            ),
            Stmt::Break,
        ]),
        Stmt::Let(v(4), Op::Get(Var(0))),
        Stmt::If(Cond::Eq(v(4), two), vec![Stmt::Store(at(1), half)], Vec::new()),
        Stmt::Let(v(5), Op::Get(Var(1))),
        Stmt::If(Cond::Lt(two, v(5)), vec![Stmt::Fail(Reason::NotFinite)], Vec::new()),
        Stmt::Store(at(0), v(5)),
    ];
    let routine = routine(body, 6, 2);
    let forms = lane_forms(&routine, ConversionOptions::default());
    let [form] = &forms[..] else { panic!("it has one form: {forms:?}") };
    let quick = same(&routine, form);
    assert!(quick > 300 && quick < 400, "{quick} of 400 are not slow");
    assert!(form.body.iter().any(|l| l.when.is_some()), "a root is taken where it is looked at");
}

/// An iteration in a branch is slow, or gone on with twice; who goes on further is slow. One that all begin has no
/// form.
#[test]
fn iterations_that_go_on_are_slow() {
    let [zero, one, _, half, _] = [0, 1, 2, 3, 4].map(Value);
    let turns = Stmt::Loop(vec![
        Stmt::Let(v(1), Op::Get(Var(0))),
        Stmt::Let(v(2), Op::Binary(Binary::Mul, v(1), half)),
        Stmt::Set(Var(0), v(2)),
        Stmt::If(Cond::Lt(v(2), one), vec![Stmt::Break], Vec::new()),
    ]);
    let start = [Stmt::Let(v(0), Op::Load(at(0))), Stmt::Set(Var(0), v(0))];
    let end = [Stmt::Let(v(3), Op::Get(Var(0))), Stmt::Store(at(2), v(3))];
    let branch = Stmt::If(Cond::Lt(zero, v(0)), vec![turns.clone()], Vec::new());
    let with = |s: Stmt| routine([&start[..], &[s], &end].concat(), 4, 1);
    assert_eq!(lane_forms(&with(turns), ConversionOptions::default()), Vec::new());
    let routine = with(branch);
    let forms = lane_forms(&routine, ConversionOptions::default());
    let [short, long] = &forms[..] else { panic!("it has two forms: {forms:?}") };
    assert!(same(&routine, short) > 150 && same(&routine, long) > 380);
    for (x, turns) in [(-1.0, 0), (0.5, 1), (1.0, 1), (3.9, 2), (4.0, 3), (64.0, 7)] {
        for (form, most) in [(short, 0), (long, 2)] {
            let mut run = Run::new(&form.numbers, 0, &[x, 0.0, 0.0]);
            form.body.iter().for_each(|l| run.define(l.value, &l.op));
            assert_eq!(run.cond(&form.slow), turns > most, "{x}");
        }
    }
}
