//! A large nonlinear system, solved sparsely.

use bond_runtime::ir::{Array, Builder, Newton, Program, Slot};
use bond_runtime::{Interpreter, Kernel};

/// An implicit step of `n` cells in a row: `u_i + u_i³ + 3 (u_{i+1} - u_{i-1}) = x_i`.
fn ladder(n: usize) -> Program {
    let mut b = Builder::new("ladder");
    let state = b.slots(Array::State, n);
    let next = b.slots(Array::Next, n);
    let unknowns = b.slots(Array::Local, n);
    let at = |slot: Slot, i: usize| Slot::new(slot.array, slot.index as usize + i);
    let (one, three) = (b.number(1.0), b.number(3.0));
    let minus = b.number(-3.0);
    let x: Vec<_> = (0..n).map(|i| b.load(at(state, i))).collect();
    for (i, &x) in x.iter().enumerate() {
        b.store(at(unknowns, i), x);
    }
    b.open(unknowns, n);
    let u: Vec<_> = (0..n).map(|i| b.load(at(unknowns, i))).collect();
    let mut jacobian = Vec::new();
    let mut residual = Vec::new();
    for i in 0..n {
        let square = b.mul(u[i], u[i]);
        let cube = b.mul(square, u[i]);
        let mut r = b.add(u[i], cube);
        r = b.sub(r, x[i]);
        if i > 0 {
            let term = b.mul(minus, u[i - 1]);
            r = b.add(r, term);
            jacobian.push((i as u32, i as u32 - 1, minus));
        }
        let slope = b.mul(three, square);
        jacobian.push((i as u32, i as u32, b.add(one, slope)));
        if i + 1 < n {
            let term = b.mul(three, u[i + 1]);
            r = b.add(r, term);
            jacobian.push((i as u32, i as u32 + 1, three));
        }
        residual.push(r);
    }
    b.close(Newton {
        unknowns: unknowns.index,
        rounding: None,
        body: Vec::new(),
        residual,
        jacobian,
        weight: vec![one; n],
        scale: vec![one; n],
        cold: Vec::new(),
        small: Vec::new(),
        knees: Vec::new(),
        options: bond_runtime::options::NewtonOptions::DEFAULT,
        limit: 50,
        update: Vec::new(),
        left: 0.0,
        affine: false,
        undetermined: false,
        corners: false,
        flag: None,
    });
    for i in 0..n {
        let u = b.load(at(unknowns, i));
        b.store(at(next, i), u);
    }
    b.finish()
}

#[test]
fn ladders_are_solved_without_allocation() {
    for n in [17, 300, 20_000] {
        let program = ladder(n);
        assert_eq!(program.verify(), Ok(()));
        let kernel = Interpreter::new(&program);
        let mut work = kernel.workspace();
        let x: Vec<f64> = (0..n).map(|i| (i as f64 * 0.7).sin()).collect();
        let info = allocation_counter::measure(|| assert_eq!(kernel.run(&x, &[], &[], &mut work), Ok(())));
        assert_eq!(info.count_total, 0);
        assert!(work.newton_iterations < 12, "{}", work.newton_iterations);
        let u = |i: usize| work.next.get(i).copied().unwrap_or(0.0);
        for (i, x) in x.iter().enumerate() {
            let residual = u(i) + u(i).powi(3) + 3.0 * (u(i + 1) - u(i.wrapping_sub(1))) - x;
            assert!(residual.abs() < 1e-14, "{i}: {residual:e}");
        }
    }
}
