//! Throughput of the interpreter: steps of the damped oscillator, samples of the virtual wall, steps of a ladder of 100 cells.
//!
//! `cargo bench -p bond` prints the time of one step and the steps a second; `docs/performance.md` keeps the figures. A dependent
//! multiply-add chain is timed beside them, so that figures of different machines can be set in proportion.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;

const OSCILLATOR: &str = "
model Oscillator {
  C:spring { stiffness = 100 N/m;  q0 = 1 m }
  I:mass = 1 kg
  R:damper = 0.5 N*s/m
  1:v -> spring, mass, damper
}";

const WALL: &str = "
model Wall(k = 1000 N/m, b = 30 N*s/m, gap = 0.1 m) {
  port tip
  C:spring { H = if q > 0 then 0.5*k*q^2 else 0;  q0 = -gap }
  R:damper { e = if spring.q > 0 then b*f else 0 }
  tip -> 1:contact -> spring, damper
}
model VirtualWall {
  Se:hand = 5 N
  I:handle = 1 kg
  sampled at 25 Hz { Wall:wall }
  hand -> 1:v -> handle
  v ||> wall.tip
}";

const LADDER: &str = "
model Ladder(n = 100) {
  Se:u = 1 V
  R:load = 1 Ohm
  for k in 1..n {
    I:l[k] = 10 mH
    C:c[k] = 10 mF
    1:s[k] -> l[k]
    s[k] -> 0:p[k] -> c[k]
  }
  u -> s[1]
  for k in 2..n { p[k-1] -> s[k] }
  p[n] -> load
}";

fn compile(text: &str, method: Option<&str>) -> bond::Compiled {
    let mut options = bond::Options::new();
    if let Some(m) = method {
        options = options.method(m);
    }
    match options.compile_str("bench.bond", text) {
        Ok(c) => c,
        Err(e) => panic!("{e}"),
    }
}

fn steps(c: &mut Criterion) {
    let mut group = c.benchmark_group("interpreter");
    group.throughput(Throughput::Elements(1000));
    group.bench_function("multiply-add chain, 1000 links", |b| {
        b.iter(|| (0..1000).fold(black_box(1.0f64), |x, _| x * 0.999 + 0.5));
    });
    let cases = [
        ("damped oscillator, gonzalez, 1000 steps", OSCILLATOR, Some("gonzalez"), 1e-3),
        ("damped oscillator, exact, 1000 steps", OSCILLATOR, None, 1e-3),
        ("virtual wall, matched, 1000 samples", WALL, None, 0.04),
        ("ladder of 100 cells, gonzalez, 1000 steps", LADDER, Some("gonzalez"), 1e-3),
    ];
    for (name, text, method, h) in cases {
        let compiled = compile(text, method);
        group.bench_function(name, |b| {
            let mut sim = match compiled.simulate(bond::Steps::fixed(h)) {
                Ok(sim) => sim,
                Err(e) => panic!("{e}"),
            };
            let mut t = 0.0;
            b.iter(|| {
                t += 1000.0 * h;
                sim.advance(black_box(t))
            });
        });
    }
    group.finish();
}

criterion_group!(benches, steps);
criterion_main!(benches);
