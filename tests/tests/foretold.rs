//! Where the iterations of `gonzalez` steps begin, and how soon they end.

use crate::common::{finish, start, with};
use bond::{Compiled, Options, Steps};

/// By the method whose iterations are counted.
fn text(model: &str) -> Compiled {
    with(Options::new().method("gonzalez"), model)
}

/// A mass on a spring of the third degree.
fn duffing(q0: f64, more: &str) -> String {
    format!(
        "model Duffing {{
           C:spring {{ e = 1 N/m * q + 1 N/m^3 * q^3;  q0 = {q0} m }}
           I:mass = 1 kg
           1:v -> spring, mass
           {more}
           probe q = spring.q
         }}"
    )
}

/// Steps that are short beside the motion are done by what is foretold and two updates, also where a change goes
/// through 0, and keep the balance.
#[test]
fn smooth_steps_are_done_at_once() {
    for (q0, more) in
        [(1.0, ""), (1.5, ""), (1.0, "R:b = 0.05 N*s/m  v -> b"), (0.2, "Se:u = 0.3 N * sin(1 rad/s * t)  u -> v")]
    {
        let compiled = text(&duffing(q0, more));
        let mut sim = start(&compiled, Steps::fixed(0.05));
        finish(&mut sim, 2000.0);
        let summary = sim.summary();
        let region = &summary.regions[0];
        assert_eq!(region.steps, 40_000);
        // One count is two evaluations; the first steps have nothing to foretell from.
        assert!(region.newton_iterations < 40_040, "{q0} {more}: {}", region.newton_iterations);
        assert!(summary.worst_step <= 1e-14 && summary.total <= 1e-13, "{} {}", summary.worst_step, summary.total);
    }
}

/// Steps of other lengths, and such as are too long to be foretold, come to the same motion.
#[test]
fn other_steps_take_longer_and_keep_the_balance() {
    for step in [0.5, 1.0, 3.0, 20.0] {
        let compiled = text(&duffing(1.0, ""));
        let mut sim = start(&compiled, Steps::fixed(step));
        finish(&mut sim, 2000.0 * step);
        let summary = sim.summary();
        assert!(summary.passive && summary.worst_step <= 1e-13, "{step}: {}", summary.worst_step);
        let each = summary.regions[0].newton_iterations as f64 / summary.regions[0].steps as f64;
        assert!(each < 12.0, "{step}: {each}");
    }
}

/// What rounding took from the states is left out of the first residual, where nothing is lost, and nowhere else.
#[test]
fn carries_wait_for_nobody() {
    let program = |more: &str| text(&duffing(1.0, more)).show("program");
    let small = |text: &str| text.lines().filter(|l| l.trim_start().starts_with("small ")).count();
    assert_eq!(small(&program("")), 2);
    assert_eq!(small(&program("R:b = 0.05 N*s/m  v -> b")), 0);
}
