//! Back ends give the same numbers, to the last bit. What leaves this program as C or objects is tested in `emitted`.

use crate::common::{all_scenes, cases, file, stop, with};
use bond::internal::{Code, CompiledInternals, SimulationInternals, StepsInternals};
use bond::{Compiled, Options, Simulation, Steps};
use bond_compiler::backend::code::Stmt;
use bond_compiler::backend::native::{JIT, Jit, Shared};
use bond_compiler::backend::{lower, standalone};
use bond_runtime::interpreter::Interpret;
use bond_runtime::ir::{Array, Binary, Builder, Knee, Newton, Program, Slot, Unary, Value};
use bond_runtime::kernel::{Backend, Failure, Kernel};
use bond_runtime::options::NewtonOptions;
use bond_runtime::scene::Scene;
use bond_runtime::simulate::{self, BlockMaker, BlockRoutine, Places, Start};
use bond_runtime::solve::newton::MAX_KNEES;
use proptest::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Rows of a run.
const ROWS: u32 = 60;

/// What a run shows, as bits, and how it ended.
fn run(compiled: &Compiled, code: Code, steps: Steps, end: f64) -> (Vec<Vec<u64>>, String) {
    let settings = &compiled.stages().model.settings;
    let options = steps.resolve(settings, end, settings.every).unwrap_or_else(|e| panic!("{e}"));
    let mut rows = Vec::new();
    let mut sim = match Simulation::on(code.backend(), compiled.scene(), &options, []) {
        Ok(sim) => sim,
        Err(e) => return (rows, e.to_string()),
    };
    for k in 1..=ROWS {
        if let Err(e) = sim.advance(f64::from(k) * end / f64::from(ROWS)) {
            return (rows, e.to_string());
        }
        match sim.probes() {
            Ok(p) => rows.push(p.iter().map(|x| x.to_bits()).collect()),
            Err(e) => return (rows, e.to_string()),
        }
    }
    (rows, format!("{:?}", sim.summary()))
}

#[test]
fn machine_code_gives_the_interpreters_bits_on_every_model() {
    let mut compiled_ones = 0;
    for (title, path, scene) in all_scenes() {
        let compiled = file(&path, Options::new().model(&scene));
        let end = stop(&compiled).min(1.0);
        for steps in [Steps::new(), Steps::fixed(end / 300.0)] {
            let interpreted = run(&compiled, Code::Interpreted, steps, end);
            let native = run(&compiled, Code::Native, steps, end);
            assert_eq!(native, interpreted, "{title} {scene} {steps:?}");
        }
        compiled_ones += compiled.scene().clusters.iter().filter(|c| lower(&c.step.program).is_some()).count();
    }
    assert!(compiled_ones > 100, "{compiled_ones} step programs have a plain form");
}

/// Machine code that goes through whole stretches from the first on, and counts: intervals gone, and stretches that
/// failed.
struct Eager;

static GONE: AtomicU64 = AtomicU64::new(0);
static FAILED: AtomicU64 = AtomicU64::new(0);

struct Counted(Box<dyn BlockRoutine>);

impl BlockRoutine for Counted {
    fn places(&self) -> &Places {
        self.0.places()
    }

    fn run(&mut self, block: &mut [f64], intervals: u64, notes: &mut [f64]) -> (u64, usize) {
        let (gone, noted) = self.0.run(block, intervals, notes);
        GONE.fetch_add(gone, Ordering::Relaxed);
        FAILED.fetch_add(u64::from(gone < intervals), Ordering::Relaxed);
        (gone, noted)
    }
}

impl Backend for Eager {
    fn kernel(&self, program: &Program) -> Box<dyn Kernel> {
        JIT.kernel(program)
    }

    fn block_maker(&self) -> Option<BlockMaker> {
        let make = |scene: &Scene, options: &simulate::Options, start: &Start| -> Option<Box<dyn BlockRoutine>> {
            Some(Box::new(Counted((JIT.block_maker()?.make)(scene, options, start)?)))
        };
        Some(BlockMaker { make: Arc::new(make), worth: 0 })
    }
}

/// A run that looks at rows, is saved on the way and goes on from there, and whose inputs change.
struct Shown<'a> {
    sim: simulate::Simulation<'a>,
    scene: &'a Scene,
    backend: &'a dyn Backend,
    end: f64,
    /// What it shows, as bits, and how it ended, where it did.
    bits: Vec<u64>,
    ended: Option<String>,
}

impl<'a> Shown<'a> {
    fn new(
        compiled: &'a Compiled,
        backend: &'a dyn Backend,
        options: &simulate::Options,
        end: f64,
    ) -> Result<Self, simulate::Error> {
        let scene = compiled.scene();
        let sim = simulate::Simulation::on(backend, scene, options, Vec::new())?;
        Ok(Self { sim, scene, backend, end, bits: Vec::new(), ended: None })
    }

    /// The instant of a row: they do not lie on the steps' grid, and are close together and far apart.
    fn at(&self, row: u32) -> f64 {
        let at = if row.is_multiple_of(2) { f64::from(row) } else { f64::from(row) + 0.93 };
        at * self.end / f64::from(ROWS)
    }

    /// What happens before a row.
    fn before(&mut self, row: u32) {
        if row == ROWS / 2 {
            let saved = self.sim.save().unwrap_or_else(|e| panic!("{e}"));
            let resumed = simulate::Simulation::resume(self.backend, self.scene, &saved, Vec::new());
            self.sim = resumed.unwrap_or_else(|e| panic!("{e}"));
        }
        if row == ROWS / 3 {
            let inputs = self.scene.inputs.iter().enumerate();
            inputs.for_each(|(i, input)| self.sim.set_input(i, 0.9 * input.value + 0.01));
        }
    }

    fn row(&mut self, row: u32) {
        if let Err(e) = self.sim.advance(self.at(row)) {
            self.ended = Some(format!("{e}\n{:?}", self.sim.summary()));
            return;
        }
        match self.sim.probes() {
            Ok(p) => self.bits.extend(p.iter().map(|x| x.to_bits())),
            Err(e) => self.ended = Some(e.to_string()),
        }
        for r in &self.sim.summary().regions {
            let numbers =
                [r.h_final, r.h_max, r.supplied, r.dissipated, r.leaked, r.tank, r.debt_max, r.worst_step, r.total];
            self.bits.extend(numbers.iter().map(|x| x.to_bits()));
            self.bits.extend(r.sources.iter().chain(&r.resistors).map(|e| e.energy.to_bits()));
            self.bits.extend([r.steps, r.newton_iterations, r.leaps]);
        }
    }

    fn end(mut self) -> (Vec<u64>, String) {
        let ended = self.ended.unwrap_or_else(|| {
            let end = self.sim.finish(self.end * 1.05).map_or_else(|e| e.to_string(), |()| String::new());
            format!("{end}{:?}", self.sim.summary())
        });
        (self.bits, ended)
    }
}

/// What a run shows, and how it ended.
fn stretched(compiled: &Compiled, backend: &dyn Backend, options: &simulate::Options, end: f64) -> (Vec<u64>, String) {
    let mut shown = match Shown::new(compiled, backend, options, end) {
        Ok(shown) => shown,
        Err(e) => return (Vec::new(), e.to_string()),
    };
    for row in 1..=ROWS {
        if shown.ended.is_some() {
            break;
        }
        shown.before(row);
        shown.row(row);
    }
    shown.end()
}

/// What is held for a mass depends on the mass, by beta, which each scene of a make has for itself.
#[test]
fn scenes_of_one_make_are_answered_each_in_its_own_way() {
    let text = "model M(m = 1 kg) {
        I:cart { inertia = m; f0 = 1 m/s }  C:spring { stiffness = 50 N/m }  1:v -> cart, spring
        sampled at 1 kHz { C:wall { stiffness = 500 N/m }  R:d = 10 N*s/m  1:w -> wall, d }
        v ||> w
        probe x = spring.q  probe f = wall.e
    }";
    let list = ["1.3 kg", "0.7 kg", "1.7 kg"].map(|m| with(Options::new().set("m", m), text));
    each_has_its_own(&list);
    // What a region has to give is counted from the least that its energy can be.
    let text = "model M(a = 0.1 J) {
        I:cart { inertia = 1.1 kg; f0 = 0.3 m/s }  1:v -> cart
        sampled at 100 Hz { C:detent { H = -a*cos(q/(0.1 m)); q0 = 0.02 m }  R:d = 0.1 N*s/m  1:w -> detent, d }
        v ||> w
        probe x = detent.q  probe f = cart.f
    }";
    each_has_its_own(&["0.03 J", "0.11 J", "0.37 J"].map(|a| with(Options::new().set("a", a), text)));
}

/// So long they run, s.
const END: f64 = 6.0;

/// Asserts that scenes that share their code have the numbers that each has alone.
fn each_has_its_own(list: &[Compiled]) {
    let shared = Shared::new(u64::MAX);
    let options: Vec<_> = list
        .iter()
        .map(|c| Steps::new().resolve(&c.stages().model.settings, END, None).unwrap_or_else(|e| panic!("{e}")))
        .collect();
    let alone: Vec<_> = list.iter().zip(&options).map(|(c, o)| stretched(c, &Interpret, o, END)).collect();
    for ((c, o), alone) in list.iter().zip(&options).zip(&alone) {
        assert_eq!(stretched(c, &shared, o, END), *alone);
    }
    assert!(shared.shapes().1 == 1 && alone[0] != alone[1]);
}

/// Asserts that a run by stretches is that by the interpreter; whether there are such.
fn same_by_stretches(title: &str, compiled: &Compiled, h: f64, end: f64) -> bool {
    let settings = &compiled.stages().model.settings;
    let options = Steps::fixed(h).resolve(settings, end, settings.every).unwrap_or_else(|e| panic!("{e}"));
    let start = simulate::Simulation::on(&Interpret, compiled.scene(), &options, Vec::new()).map(|sim| sim.start());
    let whole = start.is_ok_and(|start| standalone::block_program(compiled.scene(), &options, &start, false).is_some());
    let interpreted = stretched(compiled, &Interpret, &options, end);
    for backend in [&Eager as &dyn Backend, &Shared::new(u64::MAX)] {
        let native = stretched(compiled, backend, &options, end);
        assert_eq!(native, interpreted, "{title} at {h} s, as a whole: {whole}");
    }
    whole
}

#[test]
fn whole_stretches_give_the_interpreters_bits() {
    let mut stretches = 0;
    for (title, path, scene) in all_scenes() {
        let compiled = file(&path, Options::new().model(&scene));
        let shortest = compiled.scene().clusters.iter().filter_map(|c| c.period).fold(f64::INFINITY, f64::min);
        let stop = stop(&compiled);
        // Some hundreds of intervals.
        let end = if shortest.is_finite() { 600.0 * shortest } else { stop.min(1.0) };
        for h in [stop / 3000.0, end / 777.0] {
            stretches += u32::from(same_by_stretches(&format!("{title} {scene}"), &compiled, h, end));
        }
    }
    // Steps that have no solution, and are halved; a source that is no number from some time on.
    let failing = [
        "model A { Se:u = sin(3 rad/s * t) * 3 N  I:m { inertia = 0.1 kg; f0 = 1 m/s }  R:dry { e = if f > 0 then 2 N else -2 N }
                   1:v -> m, dry  u -> v  probe f = m.f }",
        "model A { Se:u = 1 N * sqrt(0.8 - t / (1 s))  I:m = 1 kg  C:s { e = q^3 * (1 N/m^3) }  1:v -> m, s  u -> v  probe f = m.f }",
    ];
    for text in failing {
        let compiled = with(Options::new().method("gonzalez"), text);
        for h in [1e-3, 2e-2] {
            assert!(same_by_stretches(text, &compiled, h, 1.0), "{text}");
        }
    }
    // Of one rate: several are stepped by the runtime.
    let below = with(Options::new(), &crate::emitted::FROM_BELOW.replace("100 Hz", "200 Hz"));
    assert!(same_by_stretches("from below", &below, 1e-3, 3.0));
    let (gone, failed) = (GONE.load(Ordering::Relaxed), FAILED.load(Ordering::Relaxed));
    assert!(stretches > 100 && gone > 20_000 && failed > 1, "{stretches} runs, {gone} intervals, {failed} failures");
}

#[test]
fn scenes_of_one_make_share_their_code() {
    let models = [
        ("examples/duffing.bond", "Duffing", ["k=2.3 N/m", "k=3.7 N/m", "k=0.4 N/m"], "gonzalez"),
        ("examples/duffing.bond", "Duffing", ["k3=2.2 N/m^3", "k3=0.3 N/m^3", "k3=7 N/m^3"], "collocation4"),
        (
            "examples/virtual_wall.bond",
            "VirtualWall",
            ["wall.k=800 N/m", "wall.k=750 N/m", "wall.k=90 N/m"],
            "gonzalez",
        ),
        (
            "examples/quarter_car.bond",
            "QuarterCar",
            ["body_mass=410 kg", "body_mass=290 kg", "body_mass=333 kg"],
            "exact",
        ),
        ("examples/diode_clipper.bond", "DiodeClipper", ["i_s=1.3 nA", "i_s=3.1 nA", "i_s=7 nA"], "collocation4"),
        ("classics/double_pendulum.bond", "DoublePendulum", ["l1=0.7 m", "l1=1.2 m", "l1=1.3 m"], "gonzalez"),
    ];
    for (name, model, sets, method) in models {
        let (path, shared) = (crate::common::models().join(name), Shared::new(u64::MAX));
        let mut shapes = None;
        for set in sets {
            let (key, value) = set.split_once('=').unwrap_or_default();
            let compiled = file(&path, Options::new().model(model).method(method).set(key, value));
            let end = stop(&compiled).min(1.0);
            for steps in [Steps::fixed(end / 500.0), Steps::tolerance(1e-5)] {
                let options =
                    steps.resolve(&compiled.stages().model.settings, end, None).unwrap_or_else(|e| panic!("{e}"));
                let alone = stretched(&compiled, &Interpret, &options, end);
                assert_eq!(stretched(&compiled, &shared, &options, end), alone, "{name} {set} {steps:?}");
            }
            // What the first one needs is all that is ever compiled.
            assert_eq!(*shapes.get_or_insert(shared.shapes()), shared.shapes(), "{name} {set}");
        }
    }
}

const SPECIAL: [f64; 14] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    -2.5,
    3.0,
    1e-310,
    -1e300,
    1e300,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::NAN,
    f64::EPSILON,
];

/// What the back ends make of a program; any NaN is the same.
fn outputs(program: &Program, state: &[f64], input: &[f64]) -> [Vec<u64>; 3] {
    assert_eq!(program.verify(), Ok(()), "{program}");
    let shared = Shared::default();
    let backends: [&dyn Backend; 3] = [&Interpret, &JIT, &shared];
    backends.map(|backend| {
        let kernel = backend.kernel(program);
        let mut work = kernel.workspace();
        let result = kernel.run(state, input, &[], &mut work);
        let bits = |x: &f64| if x.is_nan() { u64::MAX } else { x.to_bits() };
        let mut list: Vec<u64> = match result {
            Ok(()) => work.output.iter().chain(&work.next).map(bits).collect(),
            Err(e) => format!("{e:?}").bytes().map(u64::from).collect(),
        };
        list.push(work.newton_iterations);
        list
    })
}

#[test]
fn each_op_means_the_same_at_special_values() {
    let mut b = Builder::new("ops");
    let (x, y) = (b.slot(Array::Input), b.slot(Array::Input));
    let (p, q) = (b.load(x), b.load(y));
    let mut values: Vec<Value> = Unary::ALL.iter().map(|f| b.unary(*f, p)).collect();
    values.extend(Binary::ALL.iter().map(|f| b.binary(*f, p, q)));
    values.push(b.select(p, q, p));
    for k in [-3.0, -0.5, 0.5, 1.5, 2.0, 5.0, 0.3] {
        let k = b.number(k);
        values.push(b.binary(Binary::Pow, p, k));
    }
    for v in values {
        let slot = b.slot(Array::Output);
        b.store(slot, v);
    }
    let program = b.finish();
    for x in SPECIAL {
        for y in SPECIAL {
            let [one, other, shared] = outputs(&program, &[], &[x, y]);
            assert!(one == other && one == shared, "at {x:e}, {y:e}: {one:?}, {other:?}, {shared:?}");
        }
    }
}

/// One of all ops, by a pick.
fn op(b: &mut Builder, pool: &[Value], (f, i, j, k): (u8, u8, u8, u8)) -> Value {
    let at = |i: u8| pool[usize::from(i) % pool.len()];
    match usize::from(f) % (Unary::ALL.len() + 2 * Binary::ALL.len() + 1) {
        f if f < Unary::ALL.len() => b.unary(Unary::ALL[f], at(i)),
        f if f < Unary::ALL.len() + 2 * Binary::ALL.len() => {
            b.binary(Binary::ALL[(f - Unary::ALL.len()) / 2], at(i), at(j))
        }
        _ => b.select(at(i), at(j), at(k)),
    }
}

/// A line of cells, each of which does the same with its two states, its neighbour's and an input, and adds something
/// to a sum: long enough to become loops. The states of a cell stand side by side, or far apart.
fn line(cells: usize, picks: &[(u8, u8, u8, u8)], numbers: &[f64], apart: bool) -> Program {
    let mut b = Builder::new("line");
    let [state, next] = [Array::State, Array::Next].map(|array| b.slots(array, 2 * cells));
    let (input, output) = (b.slot(Array::Input), b.slot(Array::Output));
    let at = |first: Slot, cell: usize, which: usize| {
        let place = if apart { which * cells + cell } else { 2 * cell + which };
        Slot::new(first.array, first.index as usize + place)
    };
    let mut sum = b.number(0.0);
    for k in 0..cells {
        let near = (k + 1).min(cells - 1);
        let mut pool: Vec<Value> = [(k, 0), (k, 1), (near, 0)].map(|(k, w)| b.load(at(state, k, w))).into();
        pool.push(b.load(input));
        pool.extend(numbers.iter().map(|x| b.number(*x)));
        for p in picks {
            let v = op(&mut b, &pool, *p);
            pool.push(v);
        }
        let last = pool.len();
        b.store(at(next, k, 0), pool[last - 1]);
        b.store(at(next, k, 1), pool[last - 2]);
        sum = b.add(sum, pool[last - 3]);
    }
    b.store(output, sum);
    b.finish()
}

/// A program of random ops over two states and an input, with an iteration on `n` unknowns; the first states get the
/// unknowns.
fn random(n: usize, picks: &[(u8, u8, u8, u8)], numbers: &[f64], weight: bool, own: bool) -> Program {
    let mut b = Builder::new("random");
    let states: Vec<Slot> = (0..n.max(2)).map(|_| b.slot(Array::State)).collect();
    let input = b.slot(Array::Input);
    let mut pool: Vec<Value> = states.iter().map(|s| b.load(*s)).collect();
    pool.push(b.load(input));
    pool.extend(numbers.iter().map(|x| b.number(*x)));
    for p in picks {
        let v = op(&mut b, &pool, *p);
        pool.push(v);
    }
    let unknowns = b.slots(Array::Local, n);
    let flag = b.slot(Array::Local);
    let rests = picks.len().is_multiple_of(2).then(|| b.slots(Array::Local, n));
    let slot = |i: usize| Slot::new(Array::Local, unknowns.index as usize + i);
    for i in 0..n {
        b.store(slot(i), pool[i % pool.len()]);
    }
    let (one, small) = (b.number(1.0), b.number(1e-3));
    let weights: Vec<Value> = (0..n).map(|i| if weight { one } else { pool[i % pool.len()] }).collect();
    let scales: Vec<Value> = (0..n).map(|i| b.unary(Unary::Abs, pool[(i + 1) % pool.len()])).collect();
    b.open(unknowns, n);
    let u: Vec<Value> = (0..n).map(|i| b.load(slot(i))).collect();
    let (mut residual, mut jacobian, mut update) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..n {
        // u_i + u_i^3/10 + coupling to the next + something of the pool
        let next = (i + 1) % n;
        let square = b.mul(u[i], u[i]);
        let (tenth, k) = (b.number(0.1), b.number(0.3 + 0.1 * i as f64));
        let cube = b.mul(square, u[i]);
        let cube = b.mul(tenth, cube);
        let mut r = b.add(u[i], cube);
        let c = b.mul(k, u[next]);
        r = b.add(r, c);
        let s = b.unary(Unary::Sin, pool[(3 * i + 1) % pool.len()]);
        r = b.sub(r, s);
        residual.push(r);
        let guess = b.number(1.5);
        update.push(b.div(r, guess));
        let three = b.number(0.3);
        let slope = b.mul(three, square);
        let slope = b.add(one, slope);
        let mut row = vec![(i as u32, slope)];
        if next == i {
            row[0].1 = b.add(slope, k);
        } else {
            row.push((next as u32, k));
        }
        row.sort_by_key(|r| r.0);
        jacobian.extend(row.into_iter().map(|(j, v)| (i as u32, j, v)));
    }
    let open = picks.len() % 5 > 1;
    if let (true, [.., before, last]) = (open, &mut residual[..]) {
        // It says what the row before says, so that an unknown is left open.
        let two = b.number(2.0);
        *last = b.mul(two, *before);
        let row = |i: usize| move |t: &&(u32, u32, Value)| t.0 as usize == i;
        let same: Vec<_> = jacobian.iter().filter(row(n - 2)).map(|t| (t.0 + 1, t.1, b.mul(two, t.2))).collect();
        jacobian.retain(|t| t.0 as usize != n - 1);
        jacobian.extend(same);
    }
    let knee = |p: &(u8, u8, u8, u8)| Knee {
        unknown: u32::from(p.1) % n as u32,
        knee: (f64::from(p.2) - 128.0) / 64.0,
        rate: (f64::from(p.3) - 127.5) / 8.0,
    };
    let knees = if n <= MAX_KNEES { picks.iter().take(picks.len() % 4).map(knee).collect() } else { Vec::new() };
    b.close(Newton {
        unknowns: unknowns.index,
        rounding: rests.map(|r| r.index),
        body: Vec::new(),
        residual,
        jacobian: if own { Vec::new() } else { jacobian },
        weight: weights,
        scale: if weight { vec![small; n] } else { scales },
        cold: Vec::new(),
        small: if picks.len().is_multiple_of(3) { vec![pool[1]] } else { Vec::new() },
        knees,
        options: NewtonOptions::DEFAULT,
        limit: 40,
        update: if own { update } else { Vec::new() },
        left: if own {
            1e-18
        } else if weight {
            NewtonOptions::DEFAULT.rounding
        } else {
            1e-20
        },
        affine: false,
        undetermined: open,
        corners: !own && picks.len() % 4 == 1,
        flag: Some(flag),
    });
    for s in 0..states.len() {
        let next = b.slot(Array::Next);
        let v = if s < n { b.load(slot(s)) } else { one };
        b.store(next, v);
    }
    let good = b.load(flag);
    let y = b.slot(Array::Output);
    b.store(y, good);
    for v in pool.iter().rev().take(6) {
        let slot = b.slot(Array::Output);
        b.store(slot, *v);
    }
    for rest in rests.into_iter().flat_map(|r| (0..n).map(move |i| Slot::new(Array::Local, r.index as usize + i))) {
        let (v, slot) = (b.load(rest), b.slot(Array::Output));
        b.store(slot, v);
    }
    b.finish()
}

/// Ops without functions, of which vectors have none, where they are to be so.
fn tamed(picks: &[(u8, u8, u8, u8)], plain: bool) -> Vec<(u8, u8, u8, u8)> {
    let count = Unary::ALL.len() + 2 * Binary::ALL.len() + 1;
    let calls = |f: usize| match Unary::ALL.get(f) {
        Some(f) => !matches!(f, Unary::Neg | Unary::Abs | Unary::Sign | Unary::Sqrt | Unary::Not),
        None => matches!(Binary::ALL.get((f - Unary::ALL.len()) / 2), Some(Binary::Pow | Binary::Atan2)),
    };
    let tame =
        |p: &(u8, u8, u8, u8)| if plain && calls(usize::from(p.0) % count) { (p.0 % 4, p.1, p.2, p.3) } else { *p };
    picks.iter().map(tame).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(300), ..ProptestConfig::default() })]

    /// Loops, turn by turn and two turns at a time.
    #[test]
    fn random_families_give_the_same_bits(
        cells in 300usize..340,
        picks in prop::collection::vec(any::<(u8, u8, u8, u8)>(), 10..20),
        numbers in prop::collection::vec(prop_oneof![-3.0..3.0f64, prop::sample::select(SPECIAL.to_vec())], 1..5),
        state in prop::collection::vec(-2.0..2.0f64, 680),
        (plain, apart) in any::<(bool, bool)>(),
    ) {
        let picks = tamed(&picks, plain);
        let program = line(cells, &picks, &numbers, apart);
        let [one, other, shared] = outputs(&program, &state[..2 * cells], &[0.7]);
        prop_assert_eq!(&one, &other);
        prop_assert_eq!(one, shared);
    }

    /// Cells so few that they stay straight code, of which much goes side by side.
    #[test]
    fn random_rows_give_the_same_bits(
        cells in 2usize..14,
        picks in prop::collection::vec(any::<(u8, u8, u8, u8)>(), 4..30),
        numbers in prop::collection::vec(prop_oneof![-3.0..3.0f64, prop::sample::select(SPECIAL.to_vec())], 1..5),
        state in prop::collection::vec(prop_oneof![9 => -2.0..2.0f64, 1 => prop::sample::select(SPECIAL.to_vec())], 28),
        (plain, apart) in any::<(bool, bool)>(),
    ) {
        let program = line(cells, &tamed(&picks, plain), &numbers, apart);
        let [one, other, shared] = outputs(&program, &state[..2 * cells], &[0.7]);
        prop_assert_eq!(&one, &other);
        prop_assert_eq!(one, shared);
    }

    /// Random straight code with an iteration, small enough to be written out or not.
    #[test]
    fn random_programs_give_the_same_bits(
        n in prop_oneof![1usize..=8, 9usize..=20],
        picks in prop::collection::vec(any::<(u8, u8, u8, u8)>(), 0..60),
        numbers in prop::collection::vec(prop_oneof![-3.0..3.0f64, prop::sample::select(SPECIAL.to_vec())], 1..5),
        state in prop::collection::vec(-2.0..2.0f64, 20),
        weight in any::<bool>(),
        own in any::<bool>(),
    ) {
        let program = random(n, &picks, &numbers, weight, own);
        let [one, other, shared] = outputs(&program, &state, &[0.7]);
        prop_assert_eq!(&one, &other);
        prop_assert_eq!(one, shared);
    }
}

#[test]
fn refusals_say_why() {
    let compiled = file(&crate::common::models().join("hard/irrational_rates.bond"), Options::new());
    let settings = &compiled.stages().model.settings;
    let options = Steps::new().resolve(settings, 1.0, None).unwrap_or_else(|e| panic!("{e}"));
    let why = standalone::module(compiled.scene(), &options).map(|_| ()).unwrap_err();
    assert!(why.contains("have no common measure"), "{why}");
}

/// A line of cells with curved storages and resistors, a binary tree, or a square grid; the latter two are linear.
pub fn large(kind: &str, n: usize, method: &str) -> Compiled {
    let text = match kind {
        "line" => format!(
            "model Line(n = {n}) {{
               Se:u = sin(3 rad/s * t) * 1 V
               for k in 1..n {{
                 I:l[k] = 10 mH * (1 + 0.1*sin(k))
                 C:c[k] {{ H = q^2/(2 * 10 mF) + q^4 * 1e8 V/C^3 }}
                 R:r[k] {{ e = 0.1 V * tanh(f / 1 A) }}
                 1:s[k] -> l[k], r[k]
                 s[k] -> 0:p[k] -> c[k]
               }}
               u -> s[1]
               for k in 2..n {{ p[k-1] -> s[k] }}
               probe last = c[1].q
             }}"
        ),
        "tree" => format!(
            "model Tree(n = {n}) {{
               Se:u = sin(3 rad/s * t) * 1 V
               R:load = 1 Ohm
               for k in 1..2*n+1 {{
                 I:l[k] = 10 mH
                 C:c[k] = 10 mF
                 1:s[k] -> l[k]
                 s[k] -> 0:p[k] -> c[k]
               }}
               u -> s[1]
               for k in 1..n {{ p[k] -> s[2*k]  p[k] -> s[2*k+1] }}
               p[2*n+1] -> load
               probe last = c[2*n+1].q
             }}"
        ),
        _ => format!(
            "model Mesh(m = {n}) {{
               Se:u = sin(3 rad/s * t) * 1 V
               R:in = 1 Ohm
               for i in 1..m {{
                 for j in 1..m {{
                   C:c[i,j] = 10 mF * (1 + 0.01*i)
                   R:r[i,j] = 10 Ohm
                   0:p[i,j] -> c[i,j], r[i,j]
                 }}
               }}
               for i in 1..m {{ for j in 2..m {{ I:h[i,j] = 10 mH  p[i,j-1] -> 1:a[i,j] -> p[i,j]  a[i,j] -> h[i,j] }} }}
               for i in 2..m {{ for j in 1..m {{ I:w[i,j] = 10 mH  p[i-1,j] -> 1:b[i,j] -> p[i,j]  b[i,j] -> w[i,j] }} }}
               u -> 1:feed -> in
               feed -> p[1,1]
               probe far = c[m,m].q
             }}"
        ),
    };
    Options::new().method(method).compile_str(kind, text).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn families_become_loops() {
    let cases = [
        ("line", 300, 4, "gonzalez"),
        ("tree", 300, 4, "gonzalez"),
        ("mesh", 16, 2, "gonzalez"),
        ("tree", 100, 4, "collocation6"),
        ("mesh", 16, 2, "collocation4"),
    ];
    for (kind, n, times, method) in cases {
        let size = |n: usize| {
            let compiled = large(kind, n, method);
            let program = &compiled.scene().clusters[0].step.program;
            lower(program).map_or(usize::MAX, |r| r.size())
        };
        let (one, other) = (size(n), size(n * times));
        // The two ends of a line are the same at any length; a grid's borders and a tree's levels add a little.
        assert!(
            one < 3000 && (other as f64) < 1.3 * one as f64,
            "{kind}: {one} statements, {other} for {times} times the size"
        );
        let compiled = large(kind, n, method);
        let interpreted = run(&compiled, Code::Interpreted, Steps::fixed(1e-3), 0.1);
        assert_eq!(interpreted.0.len(), ROWS as usize, "{kind}: {}", interpreted.1);
        assert_eq!(run(&compiled, Code::Native, Steps::fixed(1e-3), 0.1), interpreted, "{kind}");
    }
}

/// Energies of many elements, and what watches that their states are finite, are added up several at once.
#[test]
fn no_turn_of_a_long_loop_waits_for_another() {
    fn waits(body: &[Stmt]) -> bool {
        body.iter().any(|s| match s {
            Stmt::For(_, from, to, inner) if to - from >= 128 => inner.iter().any(|s| matches!(s, Stmt::Set(..))),
            s => s.inner().into_iter().any(waits),
        })
    }
    for (kind, n, method) in [("tree", 300, "gonzalez"), ("mesh", 16, "gonzalez"), ("tree", 300, "collocation4")] {
        let routine = lower(&large(kind, n, method).scene().clusters[0].step.program).unwrap();
        assert!(!waits(&routine.body), "{kind} by {method}");
    }
}

/// A state that is not a finite number is told, whether an energy shows it, or a sum that it does not make infinite;
/// where only the energy overflows, the step is done.
#[test]
fn states_that_overflow_are_told() {
    let cells = 3000;
    for below in [false, true] {
        let mut b = Builder::new("overflow");
        let [state, next] = [Array::State, Array::Next].map(|array| b.slots(array, cells));
        let output = b.slot(Array::Output);
        let two = b.number(2.0);
        let mut sum = b.number(0.0);
        for k in 0..cells {
            let [from, to] = [state, next].map(|first| Slot::new(first.array, first.index as usize + k));
            let x = b.load(from);
            let x = b.binary(Binary::Mul, two, x);
            b.store(to, x);
            let term = if below { b.binary(Binary::Div, two, x) } else { b.binary(Binary::Mul, x, x) };
            sum = b.add(sum, term);
        }
        b.store(output, sum);
        let program = b.finish();
        assert!(lower(&program).is_some_and(|r| r.size() < cells), "a loop");
        for at in [0, 1, 1500, 2999] {
            for (x, fails) in [(f64::INFINITY, true), (f64::NAN, true), (1.5e308, true), (1e200, false)] {
                let mut state = vec![1.0; cells];
                state[at] = x;
                let slot = Slot::new(Array::Next, at);
                for backend in [&Interpret as &dyn Backend, &JIT] {
                    let kernel = backend.kernel(&program);
                    let result = kernel.run(&state, &[], &[], &mut kernel.workspace());
                    let wanted = if fails { Err(Failure::NotFinite { slot }) } else { Ok(()) };
                    assert_eq!(result, wanted, "{x} in cell {at}, below: {below}");
                }
            }
        }
    }
}

/// Whether a system is told that its matrix is what it was.
pub fn keeps(body: &[Stmt]) -> bool {
    let one = |s: &Stmt| matches!(s, Stmt::Solve { same: Some(_), .. }) || s.inner().into_iter().any(keeps);
    body.iter().any(one)
}

/// The matrix of a large linear region is made and factored only where the length of the step changes.
#[test]
fn matrices_are_kept_as_long_as_the_step() {
    for (method, n) in [("gonzalez", 300), ("collocation6", 300)] {
        let compiled = large("tree", n, method);
        let routine = lower(&compiled.scene().clusters[0].step.program);
        assert!(routine.is_some_and(|r| keeps(&r.body)), "{method} keeps the matrix");
        for steps in [Steps::fixed(1e-3), Steps::tolerance(1e-3), Steps::tolerance(1e-6)] {
            let interpreted = run(&compiled, Code::Interpreted, steps, 0.1);
            assert_eq!(interpreted.0.len(), ROWS as usize, "{method}: {}", interpreted.1);
            assert_eq!(run(&compiled, Code::Native, steps, 0.1), interpreted, "{method}");
        }
    }
}

/// Programs that differ in names alone have one code between them.
#[test]
fn equal_programs_are_compiled_once() {
    let text = "model Two {
      for i in 1..2 { I:m[i] { inertia = 1 kg; f0 = 1 m/s }  C:k[i] { e = 1 N/m * q + 1 N/m^3 * q^3 }  1:v[i] -> m[i], k[i] }
      probe a = m[1].f
      probe b = m[2].f
    }";
    let compiled = with(Options::new().method("gonzalez"), text);
    let [first, second] = [0, 1].map(|i| &compiled.scene().clusters[i].step.program);
    assert_ne!(first.names, second.names);
    let jit = Jit::new();
    let kernels = [first, second].map(|program| jit.kernel(program));
    assert_eq!(jit.shapes(), 1);
    let other = jit.kernel(&compiled.scene().clusters[0].instant);
    assert_eq!(jit.shapes(), 2);
    drop((kernels, other));
}
