//! The interpreter against a direct reading of the program, and what it promises of its runs.

use bond_runtime::ir::{Array, Binary, Builder, Inst, Newton, Program, Slot, Unary, Value};
use bond_runtime::options::NewtonOptions;
use bond_runtime::{Failure, Interpreter, Kernel};

/// `n[0] = sqrt(x[0])` by Newton's method, from 1.
fn root(flag: bool) -> Program {
    let mut b = Builder::new("root");
    let (x, n) = (b.slot(Array::State), b.slot(Array::Next));
    let (u, flag_slot) = (b.slot(Array::Local), b.slot(Array::Local));
    let y = b.slot(Array::Output);
    let a = b.load(x);
    let one = b.number(1.0);
    b.store(u, one);
    b.open(u, 1);
    let v = b.load(u);
    let square = b.mul(v, v);
    let r = b.sub(square, a);
    let two = b.number(2.0);
    let j = b.mul(two, v);
    b.close(Newton {
        unknowns: u.index,
        rounding: None,
        body: Vec::new(),
        residual: vec![r],
        jacobian: vec![(0, 0, j)],
        weight: vec![one],
        scale: vec![one],
        cold: Vec::new(),
        small: Vec::new(),
        knees: Vec::new(),
        options: NewtonOptions::DEFAULT,
        limit: 50,
        update: Vec::new(),
        left: NewtonOptions::DEFAULT.rounding,
        affine: false,
        undetermined: false,
        corners: false,
        flag: flag.then_some(flag_slot),
    });
    let v = b.load(u);
    b.store(n, v);
    let f = b.load(flag_slot);
    b.store(y, f);
    b.finish()
}

/// An update that the unknown does not show stands in its rest alone: the residual that it is had from has seen what
/// rounding took in the update before.
#[test]
fn rests_are_what_the_residual_tells() {
    for small in [false, true] {
        let mut b = Builder::new("rest");
        let (x, y, z) = (b.slot(Array::State), b.slot(Array::State), b.slot(Array::State));
        let (u, rest) = (b.slot(Array::Local), b.slot(Array::Local));
        let (next, left) = (b.slot(Array::Next), b.slot(Array::Next));
        let (x, y, z) = (b.load(x), b.load(y), b.load(z));
        let one = b.number(1.0);
        b.store(u, x);
        b.open(u, 1);
        let v = b.load(u);
        // u = y + z, of which z has no place beside y.
        let off = b.sub(v, y);
        let r = b.sub(off, z);
        b.close(Newton {
            unknowns: u.index,
            rounding: Some(rest.index),
            body: Vec::new(),
            residual: vec![r],
            jacobian: vec![(0, 0, one)],
            weight: vec![one],
            scale: vec![one],
            cold: vec![x],
            small: if small { vec![z] } else { Vec::new() },
            knees: Vec::new(),
            options: NewtonOptions::DEFAULT,
            limit: 50,
            update: Vec::new(),
            left: NewtonOptions::DEFAULT.rounding,
            affine: false,
            undetermined: false,
            corners: false,
            flag: None,
        });
        let (v, rest) = (b.load(u), b.load(rest));
        b.store(next, v);
        b.store(left, rest);
        let kernel = Interpreter::new(&b.finish());
        let mut work = kernel.workspace();
        let y = 1.0 / 3.0;
        for k in 1..100 {
            let (x, z) = (y * (1.0 + 1e-4 * f64::from(k)), 1e-19 * f64::from(k));
            assert_eq!(kernel.run(&[x, y, z], &[], &[], &mut work), Ok(()));
            let off = (work.next[0] - y) + work.next[1] - z;
            assert!(off.abs() <= 1e-32, "from {x}, small {small}: {off:e}");
        }
    }
}

#[test]
fn roots() {
    let kernel = Interpreter::new(&root(false));
    let mut work = kernel.workspace();
    for x in [2.0, 1e-6, 1e6] {
        assert_eq!(kernel.run(&[x], &[], &[], &mut work), Ok(()));
        assert!((work.next[0] - x.sqrt()).abs() <= 4e-16 * (1.0 + x.sqrt()));
    }
    assert!(work.newton_iterations > 10);
    assert!(matches!(kernel.run(&[-1.0], &[], &[], &mut work), Err(Failure::NoConvergence { .. })));
    let kernel = Interpreter::new(&root(true));
    let mut work = kernel.workspace();
    assert_eq!(kernel.run(&[4.0], &[], &[], &mut work), Ok(()));
    assert_eq!((work.next[0], work.output[0]), (2.0, 1.0));
    assert_eq!(kernel.run(&[-1.0], &[], &[], &mut work), Ok(()));
    assert_eq!(work.output[0], 0.0);
}

/// An iteration inside an iteration: `v^2 = a`, where `a` is such that `a + v = 6`.
#[test]
fn iterations_nest() {
    let mut b = Builder::new("nested");
    let n = b.slots(Array::Next, 2);
    let (a, v) = (b.slot(Array::Local), b.slot(Array::Local));
    let (one, two, six) = (b.number(1.0), b.number(2.0), b.number(6.0));
    let shape = |u: Slot, r: Value, j: Value| Newton {
        unknowns: u.index,
        rounding: None,
        body: Vec::new(),
        residual: vec![r],
        jacobian: vec![(0, 0, j)],
        weight: vec![one],
        scale: vec![one],
        cold: Vec::new(),
        small: Vec::new(),
        knees: Vec::new(),
        options: NewtonOptions::DEFAULT,
        limit: 50,
        update: Vec::new(),
        left: NewtonOptions::DEFAULT.rounding,
        affine: false,
        undetermined: false,
        corners: false,
        flag: None,
    };
    b.store(a, one);
    b.open(a, 1);
    let outer = b.load(a);
    b.store(v, one);
    b.open(v, 1);
    let inner = b.load(v);
    let square = b.mul(inner, inner);
    let r = b.sub(square, outer);
    let j = b.mul(two, inner);
    b.close(shape(v, r, j));
    let inner = b.load(v);
    let sum = b.add(outer, inner);
    let r = b.sub(sum, six);
    let twice = b.mul(two, inner);
    let slope = b.div(one, twice);
    let j = b.add(one, slope);
    b.close(shape(a, r, j));
    let (x, y) = (b.load(a), b.load(v));
    b.store(n, x);
    b.store(Slot::new(Array::Next, 1), y);
    let program = b.finish();
    assert_eq!(program.verify(), Ok(()));
    let kernel = Interpreter::new(&program);
    let mut work = kernel.workspace();
    assert_eq!(kernel.run(&[], &[], &[], &mut work), Ok(()));
    // The inner root belongs to the outer iterate before the last.
    assert!((work.next[0] - 4.0).abs() < 4e-15 && (work.next[1] - 2.0).abs() < 1e-8, "{:?}", work.next);
}

#[test]
fn products() {
    let mut b = Builder::new("products");
    b.slots(Array::State, 2);
    let n = b.slots(Array::Next, 2);
    let y = b.slots(Array::Output, 2);
    b.slots(Array::Table, 15);
    let x = Slot::new(Array::State, 0);
    b.push(Inst::MatVec { to: n, table: 0, from: x, rows: 2, cols: 2, low: true }, n, 2);
    b.push(Inst::Quad { to: y, table: 8, from: x, n: 2, root: false }, y, 1);
    let squares = Slot::new(Array::Output, 1);
    b.push(Inst::Quad { to: squares, table: 11, from: x, n: 2, root: true }, squares, 1);
    let program = b.finish();
    assert_eq!(program.verify(), Ok(()));
    let kernel = Interpreter::new(&program);
    let mut work = kernel.workspace();
    let table = [1.0, 2.0, 3.0, 4.0, 0.25, 0.0, 0.0, 0.5, 1.0, 2.0, 5.0, 1.0, 2.0, 0.0, 5.0];
    assert_eq!(kernel.run(&[1.0, 10.0], &[], &table, &mut work), Ok(()));
    assert_eq!(work.next, [21.25, 48.0]);
    assert_eq!(work.output, [1.0 + 20.0 + 500.0, 21.0 * 21.0 + 50.0 * 50.0]);
}

#[test]
fn what_is_not_finite_is_told() {
    let mut b = Builder::new("inverse");
    let (x, n) = (b.slot(Array::State), b.slots(Array::Next, 2));
    let one = b.number(1.0);
    let v = b.load(x);
    let inverse = b.div(one, v);
    b.store(n, one);
    b.store(Slot::new(Array::Next, 1), inverse);
    let kernel = Interpreter::new(&b.finish());
    let mut work = kernel.workspace();
    assert_eq!(kernel.run(&[2.0], &[], &[], &mut work), Ok(()));
    let slot = Slot::new(Array::Next, 1);
    assert_eq!(kernel.run(&[0.0], &[], &[], &mut work), Err(Failure::NotFinite { slot }));
}

#[test]
fn runs_allocate_nothing() {
    let kernel = Interpreter::new(&root(false));
    let mut work = kernel.workspace();
    let info = allocation_counter::measure(|| {
        for k in 1..100 {
            assert_eq!(kernel.run(&[f64::from(k)], &[], &[], &mut work), Ok(()));
        }
        assert!(kernel.run(&[-1.0], &[], &[], &mut work).is_err());
    });
    assert_eq!(info.count_total, 0);
}

/// Random straight programs with loads and stores of scratch, against evaluation one by one without shared registers.
#[test]
fn random_programs() {
    let mut seed = 7u64;
    let mut below = move |n: usize| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((seed >> 33) as usize) % n
    };
    for _ in 0..500 {
        let mut b = Builder::new("random");
        b.slots(Array::State, 3);
        b.slots(Array::Local, 4);
        let n = b.slot(Array::Next);
        let state = [0.5, -1.25, 3.0];
        let mut local = [0.0; 4];
        let mut values: Vec<(Value, f64)> = Vec::new();
        for k in 0..4 {
            let zero = b.number(0.0);
            b.store(Slot::new(Array::Local, k), zero);
            values.push((zero, 0.0));
        }
        for _ in 0..below(60) + 3 {
            let pick = |k: usize| values[values.len() - 1 - k % values.len().min(9)];
            let (a, c, d) = (pick(below(2) * below(9)), pick(below(9)), pick(below(9)));
            let made = match below(7) {
                0 => {
                    let k = below(3);
                    (b.load(Slot::new(Array::State, k)), state[k])
                }
                1 => {
                    let k = below(4);
                    (b.load(Slot::new(Array::Local, k)), local[k])
                }
                2 => {
                    let k = below(4);
                    b.store(Slot::new(Array::Local, k), a.0);
                    local[k] = a.1;
                    a
                }
                3 => {
                    let f = Unary::ALL[below(Unary::ALL.len())];
                    (b.unary(f, a.0), bond_runtime::eval::unary(f, a.1))
                }
                4 | 5 => {
                    let count = if below(2) == 0 { 3 } else { Binary::ALL.len() };
                    let f = Binary::ALL[below(count)];
                    (b.binary(f, a.0, c.0), bond_runtime::eval::binary(f, a.1, c.1))
                }
                _ => (b.select(a.0, c.0, d.0), bond_runtime::eval::select(a.1, c.1, d.1)),
            };
            values.push(made);
        }
        let last = values[values.len() - 1];
        b.store(n, last.0);
        let program = b.finish();
        assert_eq!(program.verify(), Ok(()));
        let kernel = Interpreter::new(&program);
        let mut work = kernel.workspace();
        let _ = kernel.run(&state, &[], &[], &mut work);
        assert_eq!(work.local.map_bits(), local.to_vec().map_bits(), "{program}");
        assert_eq!(work.next.map_bits(), vec![last.1].map_bits(), "{program}");
    }
}

/// Bits, all NaNs being one.
trait Bits {
    fn map_bits(&self) -> Vec<u64>;
}

impl Bits for Vec<f64> {
    fn map_bits(&self) -> Vec<u64> {
        self.iter().map(|x| if x.is_nan() { f64::NAN.to_bits() } else { x.to_bits() }).collect()
    }
}
