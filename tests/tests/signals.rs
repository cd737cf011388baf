//! Signals that no bond carries: inputs from outside, and signal states, against closed forms and recurrences by hand.

use crate::common::{advance, close, finish, probe, start, text, with};
use bond::internal::{CompiledInternals, OptionsInternals};
use bond::{Compiled, InputSignal, Options, Simulation, Steps};
use bond_compiler::discretise::Accuracy;
use nalgebra::{DMatrix, DVector};

const FILTER: &str = "model Filter {
  input u = 2 V
  Se:source = u
  R:r = 2 Ohm
  C:c { compliance = 0.25 F; e0 = 1 V }
  source -> 1:i -> r, c
  probe v = c.e
  probe given = u
  probe area = integral(u, 0 V*s)
  probe energy = integral(u*i.f, 0 J)
}";

/// Rows at instants that no step meets, with a jump within a microsecond.
const ROWS: [(f64, f64); 6] = [(0.1, 1.0), (0.533, 5.0), (0.533001, -3.0), (1.271, -3.0), (1.8, 4.0), (2.37, 0.5)];

fn signal(rows: &[(f64, f64)], hold: bool) -> InputSignal {
    let (t, x): (Vec<f64>, Vec<f64>) = rows.iter().copied().unzip();
    InputSignal::table(&t, &x, hold).unwrap_or_else(|e| panic!("{e}"))
}

fn fed<'a>(compiled: &'a Compiled, steps: Steps, name: &str, signal: InputSignal) -> Simulation<'a> {
    compiled.simulate_with(steps, [(name.to_string(), signal)]).unwrap_or_else(|e| panic!("{e}"))
}

/// v' = (u - v)/tau, tau = 0.5 s, from 1 V, in closed form from row to row.
fn filter(rows: &[(f64, f64)], hold: bool, until: f64) -> f64 {
    let tau = 0.5;
    let (mut v, mut at) = (1.0, 0.0);
    // Before the first row its value, after the last one that.
    let mut all = vec![(0.0, rows[0].1)];
    all.extend(rows);
    all.push((f64::INFINITY, rows[rows.len() - 1].1));
    for pair in all.windows(2) {
        let ((from, a), (to, next)) = (pair[0], pair[1]);
        let slope = if hold || to.is_infinite() { 0.0 } else { (next - a) / (to - from) };
        let end = to.min(until);
        let (s, a) = (end - at, a + slope * (at - from));
        // a + b (s - tau) solves it; the rest decays.
        let gone = -(-s / tau).exp_m1();
        v += (a - v) * gone + slope * (s - tau * gone);
        at = end;
        if end == until {
            break;
        }
    }
    v
}

#[test]
fn exact_takes_a_table_without_error() {
    let compiled = text(FILTER);
    for hold in [false, true] {
        for step in [0.3, 0.07, 0.011] {
            let mut sim = fed(&compiled, Steps::fixed(step), "u", signal(&ROWS, hold));
            for k in 1..=90 {
                let t = f64::from(k) * 0.0333;
                advance(&mut sim, t);
                let what = format!("v at {t}, steps of {step}, hold {hold}");
                close(probe(&mut sim, "v"), filter(&ROWS, hold, t), 1e-12, &what);
            }
            finish(&mut sim, 3.0);
            let summary = sim.summary();
            let region = &summary.regions[0];
            assert_eq!((&*region.stepper, region.order), ("exact", 0));
            assert!(summary.passive && summary.worst_step <= 1e-12, "{:e} {:?}", summary.worst_step, summary.reasons);
            // The source's energy is the integral of u i, which an integral computes by itself.
            close(probe(&mut sim, "energy"), region.supplied, 1e-12, "energy supplied");
        }
    }
}

/// A capacitor behind a resistor of no account takes what the table says, and its energy is what was given.
#[test]
fn exact_follows_a_table_over_any_number_of_time_constants() {
    for ohms in [1e-3, 1e-6, 1e-9] {
        let compiled = text(&format!(
            "model Follower {{
  input u = 0 V
  Se:s = u
  R:r = {ohms:e} Ohm
  C:c = 1 uF
  s -> 1:m -> r
  m -> 0:n -> c
  probe v = n.e
  simulate {{ stop = 3 s }}
}}"
        ));
        for step in [0.3, 0.011] {
            let mut sim = fed(&compiled, Steps::fixed(step), "u", signal(&ROWS, false));
            finish(&mut sim, 1.5);
            close(probe(&mut sim, "v"), -3.0 + 7.0 * 0.229 / 0.529, 1e-6, "the voltage between two rows");
            finish(&mut sim, 3.0);
            let summary = sim.summary();
            assert_eq!(summary.regions[0].stepper, "exact");
            assert!(summary.passive, "{ohms:e} Ohm, {step} s: {:?}", summary.reasons);
            assert!(summary.worst_step <= 1e-13, "{ohms:e} Ohm, {step} s: off by {:e}", summary.worst_step);
        }
    }
}

/// The integral of the table itself: trapezoids, or rectangles.
#[test]
fn a_table_is_integrated_exactly() {
    for method in ["exact", "gonzalez", "rk4"] {
        let compiled = with(Options::new().method(method), FILTER);
        for hold in [false, true] {
            let mut area = 0.1 + 0.63 * 0.5;
            for pair in ROWS.windows(2) {
                let mean = if hold { pair[0].1 } else { 0.5 * (pair[0].1 + pair[1].1) };
                area += mean * (pair[1].0 - pair[0].0);
            }
            let mut sim = fed(&compiled, Steps::fixed(0.07), "u", signal(&ROWS, hold));
            finish(&mut sim, 3.0);
            close(probe(&mut sim, "area"), area, 1e-12, &format!("{method}, hold {hold}"));
        }
    }
}

/// Steps that end at rows keep their order over jumps and kinks, whatever the grid.
#[test]
fn jumps_and_kinks_cost_no_order() {
    for (method, order, steps) in [("gonzalez", 2.0, [0.04, 0.02, 0.01]), ("rk4", 4.0, [0.1, 0.05, 0.025])] {
        let compiled = with(Options::new().method(method), FILTER);
        for hold in [false, true] {
            let errors: Vec<f64> = steps
                .iter()
                .map(|h| {
                    let mut sim = fed(&compiled, Steps::fixed(*h), "u", signal(&ROWS, hold));
                    finish(&mut sim, 2.2);
                    (probe(&mut sim, "v") - filter(&ROWS, hold, 2.2)).abs()
                })
                .collect();
            for pair in errors.windows(2) {
                let found = (pair[0] / pair[1]).log2();
                assert!((found - order).abs() < 0.35, "{method}, hold {hold}: order {found} of {errors:?}");
            }
        }
    }
}

#[test]
fn adaptive_steps_meet_the_rows() {
    let compiled = with(Options::new().method("gonzalez"), FILTER);
    for hold in [false, true] {
        let mut sim = fed(&compiled, Steps::tolerance(1e-7), "u", signal(&ROWS, hold));
        for k in 1..=12 {
            let t = f64::from(k) * 0.25;
            advance(&mut sim, t);
            close(probe(&mut sim, "v"), filter(&ROWS, hold, t), 2e-5, &format!("v at {t}, hold {hold}"));
        }
        let summary = sim.summary();
        assert!(summary.passive && summary.regions[0].steps < 20_000, "{} steps", summary.regions[0].steps);
    }
}

/// At an instant where a held table jumps, what is shown is that after the jump.
#[test]
fn inputs_show_what_holds_from_now_on() {
    let compiled = text(FILTER);
    let mut sim = fed(&compiled, Steps::fixed(0.1), "u", signal(&[(0.0, 1.0), (0.3, 2.0)], true));
    for (t, u) in [(0.0, 1.0), (0.2999, 1.0), (0.1 + 0.2, 2.0), (0.31, 2.0)] {
        advance(&mut sim, t);
        assert_eq!(probe(&mut sim, "given"), u, "at {t}");
    }
}

/// Set from a program, between two steps: the step under way has met the old value only.
#[test]
fn an_input_set_from_a_program() {
    for (method, within) in [("exact", 1e-13), ("gonzalez", 1e-4), ("rk4", 3e-9)] {
        let compiled = with(Options::new().method(method), FILTER);
        let mut sim = start(&compiled, Steps::fixed(0.01));
        let rows = [(0.0, 2.0), (0.3333, -1.0), (0.3377, 4.0), (0.9, 0.0)];
        for (t, u) in &rows[1..] {
            advance(&mut sim, *t);
            sim.set_input("u", *u).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(probe(&mut sim, "given"), *u);
        }
        advance(&mut sim, 1.5);
        close(probe(&mut sim, "v"), filter(&rows, true, 1.5), within, method);
        let unknown = sim.set_input("w", 0.0).map_err(|e| e.to_string());
        assert!(unknown.is_err_and(|e| e.contains("`w`") && e.contains("u")));
    }
}

/// An input that no table names keeps its default: u = 2 V.
#[test]
fn a_default_is_a_constant() {
    let compiled = text(FILTER);
    let mut sim = start(&compiled, Steps::fixed(0.1));
    finish(&mut sim, 1.0);
    close(probe(&mut sim, "v"), 2.0 - (-2.0f64).exp(), 1e-14, "v");
}

/// A source that switches where an input crosses a value, between rows and steps.
#[test]
fn switches_on_inputs_are_met() {
    let compiled = text(
        "model M { input u = 0  Se:s = if u > 0.37 then 3 V else 1 V  R:r = 1 Ohm  C:c = 1 F
          s -> 1:i -> r, c  probe v = c.e }",
    );
    // u crosses at 0.74 s: v = 1 - exp(-t), then towards 3.
    let at = |t: f64| 3.0 + (1.0 - (-0.74f64).exp() - 3.0) * (0.74 - t).exp();
    let mut sim = fed(&compiled, Steps::fixed(0.1), "u", signal(&[(0.0, 0.0), (2.0, 1.0)], false));
    finish(&mut sim, 1.5);
    close(probe(&mut sim, "v"), at(1.5), 1e-11, "v");
}

const MOTOR: &str = "model Motor(kp = 2 V*s/rad, ki = 8 V/rad, kd = 0.02 V*s^2/rad) {
  input wanted = 10 rad/s
  Se:amplifier = kp*error + ki*sum - kd*(w.f - slow)/(0.1 s)
  R:winding = 1 Ohm
  I:coil = 0.01 H
  GY:motor = 0.5 N*m/A
  I:rotor = 0.02 kg*m^2
  R:bearing = 0.01 N*m*s/rad
  amplifier -> 1:circuit -> winding, coil, motor
  motor -> 1:w -> rotor, bearing
  let error = wanted - w.f
  state sum = 0 { dsum = error }
  state slow = 1 rad/s { dz = (w.f - slow)/(0.1 s) }
  probe speed = w.f
  probe total = sum
}";

/// The same by hand: states coil.p, rotor.p, sum, slow; inputs wanted.
fn motor() -> (DMatrix<f64>, DVector<f64>) {
    let (l, j, k, b, r) = (0.01, 0.02, 0.5, 0.01, 1.0);
    let (kp, ki, kd) = (2.0, 8.0, 0.02 / 0.1);
    #[rustfmt::skip]
    let a = DMatrix::from_row_slice(4, 4, &[
        -r / l, (-k - kp - kd) / j, ki, kd,
        k / l, -b / j, 0.0, 0.0,
        0.0, -1.0 / j, 0.0, 0.0,
        0.0, 10.0 / j, 0.0, -10.0,
    ]);
    (a, DVector::from_column_slice(&[kp, 0.0, 1.0, 0.0]))
}

/// The solution at an instant, by the exponential of the matrix with the constant input as a state of its own.
fn solution(u: f64, start: [f64; 4], t: f64) -> DVector<f64> {
    let (a, b) = motor();
    let mut m = DMatrix::zeros(5, 5);
    m.view_mut((0, 0), (4, 4)).copy_from(&a);
    m.view_mut((0, 4), (4, 1)).copy_from(&b);
    let x = DVector::from_column_slice(&[start[0], start[1], start[2], start[3], u]);
    (m * t).exp() * x
}

#[test]
fn exact_steps_a_closed_loop() {
    let compiled = text(MOTOR);
    for step in [0.2, 0.01] {
        let mut sim = start(&compiled, Steps::fixed(step));
        for k in 1..=20 {
            let t = f64::from(k) * 0.05;
            advance(&mut sim, t);
            let x = solution(10.0, [0.0, 0.0, 0.0, 1.0], t);
            close(probe(&mut sim, "speed"), x[1] / 0.02, 1e-9, &format!("speed at {t}"));
            close(probe(&mut sim, "total"), x[2], 1e-10, &format!("sum at {t}"));
        }
        finish(&mut sim, 1.0);
        let summary = sim.summary();
        assert_eq!(
            (&*summary.regions[0].stepper, summary.regions[0].order, summary.regions[0].states),
            ("exact", 0, 2)
        );
        assert!(summary.passive && summary.worst_step <= 1e-12, "{:e}", summary.worst_step);
    }
}

/// Over a million steps, most of them at rest, under a controller whose terms all but cancel.
#[test]
fn a_closed_loop_balances_over_a_million_steps() {
    let compiled = crate::common::example("pid_motor", "Continuous");
    let mut sim = start(&compiled, Steps::fixed(3e-3));
    finish(&mut sim, 3000.0);
    let summary = sim.summary();
    assert!(summary.regions[0].steps >= 1_000_000 && summary.regions[0].stepper == "exact");
    assert!(summary.worst_step <= 1e-12 && summary.total <= 5e-11, "{:e} {:e}", summary.worst_step, summary.total);
}

#[test]
fn other_methods_close_the_loop_with_their_order() {
    for (method, order, steps) in
        [("euler", 1.0, [1e-4, 5e-5, 2.5e-5]), ("gonzalez", 2.0, [4e-3, 2e-3, 1e-3]), ("rk4", 4.0, [8e-3, 4e-3, 2e-3])]
    {
        let compiled = with(Options::new().method(method), MOTOR);
        let wanted = solution(10.0, [0.0, 0.0, 0.0, 1.0], 0.4);
        let errors: Vec<f64> = steps
            .iter()
            .map(|h| {
                let mut sim = start(&compiled, Steps::fixed(*h));
                finish(&mut sim, 0.4);
                if method == "gonzalez" {
                    assert!(sim.summary().passive && sim.summary().worst_step <= 1e-12);
                }
                (probe(&mut sim, "total") - wanted[2]).abs()
            })
            .collect();
        for pair in errors.windows(2) {
            let found = (pair[0] / pair[1]).log2();
            assert!((found - order).abs() < 0.3, "{method}: order {found} of {errors:?}");
        }
    }
}

#[test]
fn linearize_has_inputs_and_signal_states() {
    let compiled = text(MOTOR);
    let l = compiled.linearize(0.0, &|_| None).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(l.inputs, ["wanted"]);
    assert_eq!(l.states, ["coil.p", "rotor.p", "sum", "slow"]);
    let (a, b) = motor();
    assert!((&l.a - a).abs().max() < 1e-12, "{}", l.a);
    assert!((l.b.column(0) - b).abs().max() < 1e-12, "{}", l.b);
    let compiled = with(
        Options::new().whole(),
        "model M { Se:s = w  input u = 3  input w = 1 V  R:r = 2 Ohm  s -> r
          probe y = u*r.f  state z = 2 { dz = u*z/(1 s) }  port p  C:c = 1 F  p -> c }",
    );
    let l = compiled.linearize(0.0, &|_| None).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(l.inputs, ["u", "w", "p.f"]);
    assert_eq!(l.states, ["c.q", "z"]);
    assert_eq!(l.d.row(0).iter().copied().collect::<Vec<_>>(), [0.5, 1.5, 0.0]);
    assert_eq!(l.b.row(1).iter().copied().collect::<Vec<_>>(), [2.0, 0.0, 0.0]);
    assert_eq!(l.a[(1, 1)], 3.0);
}

/// An `integral` that an element reads is solved with it, just as a state is.
#[test]
fn an_integral_that_is_read_is_a_state() {
    let plant = "Se:u = 3 V - 2 Hz * sum  R:r = 1 Ohm  C:c = 0.5 F  u -> 1:i -> r, c  probe v = c.e  probe s = sum";
    let by_integral = format!("model M {{ {plant}  let sum = integral(c.e, 0.1 V*s) }}");
    let by_state = format!("model M {{ {plant}  state sum = 0.1 V*s {{ dsum = c.e }} }}");
    for method in ["exact", "gonzalez", "euler", "symplectic_euler", "rk4", "rk45", "dop853"] {
        let ends = [&by_integral, &by_state].map(|text| {
            let compiled = with(Options::new().method(method), text);
            let mut sim = start(&compiled, Steps::fixed(0.05));
            finish(&mut sim, 2.0);
            (probe(&mut sim, "v"), probe(&mut sim, "s"))
        });
        assert_eq!(ends[0], ends[1], "{method}");
    }
    // v'' + 2 v' + 4 v = 0 where the source is differentiated: v' = 2 (3 - 2 s - v), s' = v.
    let compiled = text(&by_integral);
    let mut sim = start(&compiled, Steps::fixed(0.37));
    finish(&mut sim, 2.0);
    let w = 3f64.sqrt();
    let v = (-2.0f64).exp() * (2.0 * (3.0 - 0.2)) / w * (w * 2.0).sin();
    close(probe(&mut sim, "v"), v, 1e-13, "v");
}

/// In a sampled region too: with a shorter period it comes to the same as in continuous time.
#[test]
fn a_sampled_region_steps_its_integrals() {
    let plant = "Se:u = 3 V - 2 Hz * sum  R:r = 1 Ohm  C:c { compliance = 0.5 F; e0 = 1 V }  u -> 1:i -> r, c";
    // v' = 2 (3 - 2 s - v) is 3.6 V/s at the start.
    let w = 3f64.sqrt();
    let exact = (-1.0f64).exp() * (w.cos() + 4.6 / w * w.sin());
    for (method, order) in [("gonzalez", 2.0), ("ray", 1.0)] {
        let errors: Vec<f64> = [0.02, 0.01, 0.005]
            .iter()
            .map(|period| {
                let compiled = text(&format!(
                    "model M {{ sampled every {period} s method {method} {{ {plant} }}
                      let sum = integral(c.e, 0.1 V*s)  probe v = c.e }}"
                ));
                let mut sim = start(&compiled, Steps::new());
                finish(&mut sim, 1.0);
                assert!(sim.summary().worst_step <= 1e-12, "{:e}", sim.summary().worst_step);
                (probe(&mut sim, "v") - exact).abs()
            })
            .collect();
        for pair in errors.windows(2) {
            let found = (pair[0] / pair[1]).log2();
            assert!((found - order).abs() < 0.3, "{method}: order {found} of {errors:?}");
        }
    }
}

/// The integral of an integral.
#[test]
fn integrals_may_be_nested() {
    for method in ["exact", "gonzalez"] {
        let compiled = with(
            Options::new().method(method),
            "model M { Se:f = 2 N  I:m = 1 kg  f -> 1:v -> m  let x = integral(v.f, 1 m)  probe y = integral(x, 0 m*s) }",
        );
        let mut sim = start(&compiled, Steps::fixed(0.01));
        finish(&mut sim, 3.0);
        let within = if method == "exact" { 1e-13 } else { 1e-4 };
        close(probe(&mut sim, "y"), 3.0 + 27.0 / 3.0, within, method);
    }
}

/// A source that reads the flow it drives: 10 V less half an ohm, into 1 Ohm and 1 F.
#[test]
fn a_source_in_a_loop_with_what_it_drives() {
    let source = "model M { Se:u = 10 V - 0.5 Ohm * i.f  R:r = 1 Ohm  C:c = 1 F  u -> 1:i -> r, c  probe v = c.e }";
    for (method, within) in [("exact", 1e-13), ("gonzalez", 1e-4), ("rk4", 1e-8)] {
        let compiled = with(Options::new().method(method), source);
        let mut sim = start(&compiled, Steps::fixed(0.02));
        finish(&mut sim, 1.0);
        close(probe(&mut sim, "v"), 10.0 * (1.0 - (-1.0f64 / 1.5).exp()), within * 10.0, method);
        assert!(sim.summary().worst_step <= 1e-12, "{method}: {:e}", sim.summary().worst_step);
    }
}

/// z' = z (1 - z) from 0.1 is 1/(1 + 9 exp(-t)), without any element.
#[test]
fn a_signal_state_alone() {
    let text = "model M { state z = 0.1 { dz = z*(1 - z)/(1 s) }  probe y = z }";
    let exact = 1.0 / (1.0 + 9.0 * (-3.0f64).exp());
    for (method, order) in [("gonzalez", 2.0), ("rk4", 4.0)] {
        let compiled = with(Options::new().method(method), text);
        let errors: Vec<f64> = [0.2, 0.1]
            .iter()
            .map(|h| (crate::common::end(&compiled, Steps::fixed(*h), 3.0, "y") - exact).abs())
            .collect();
        assert!(((errors[0] / errors[1]).log2() - order).abs() < 0.2, "{method}: {errors:?}");
    }
    let compiled = with(Options::new(), text);
    close(crate::common::end(&compiled, Steps::tolerance(1e-8).longest(1.0), 3.0, "y"), exact, 1e-6, "adaptive");
}

/// A sampled PID moves a mass: against the recurrence by hand, with the mass stepped exactly between samples.
#[test]
fn a_sampled_controller_is_its_recurrence() {
    let compiled = text(
        "model Servo(T = 10 ms) {
          input wanted = 1 m
          Se:force = u
          I:mass = 2 kg
          force -> 1:v -> mass
          state x = 0.25 m { dx = v.f }
          sampled every T {
            state sum = 0 m*s { next = sum + T*(wanted - x) }
            state last = 0.25 m { next = x }
            state u = 0 N { next = 40 N/m * (wanted - x) + 5 N/(m*s) * sum - 15 N*s/m * (x - last)/T }
          }
          probe place = x
          probe push = u
          probe total = sum
        }",
    );
    let rows = [(0.0, 1.0), (0.5, 3.0), (1.5, 2.0)];
    let table = signal(&rows, false);
    let mut sim = fed(&compiled, Steps::new(), "wanted", table.clone());
    let (t, m) = (0.01, 2.0);
    let (mut x, mut v, mut sum, mut last, mut u, mut held) = (0.25, 0.0, 0.0, 0.25, 0.0, 0.0);
    for k in 0..300u32 {
        let now = f64::from(k) * t;
        advance(&mut sim, now);
        close(probe(&mut sim, "place"), x, 1e-12, &format!("x at {now}"));
        close(probe(&mut sim, "push"), u, 1e-10, &format!("u at {now}"));
        close(probe(&mut sim, "total"), sum, 1e-12, &format!("sum at {now}"));
        let error = table.value(now) - x;
        let next = 40.0 * error + 5.0 * sum - 15.0 * (x - last) / t;
        (sum, last) = (sum + t * error, x);
        x += t * v + t * t * u / (2.0 * m);
        v += t * u / m;
        (held, u) = (u, next);
    }
    assert!(sim.summary().passive);
    // In the middle of an interval what is held is held.
    advance(&mut sim, 2.995);
    close(probe(&mut sim, "push"), held, 1e-10, "u between samples");
}

/// Two computers at rates of their own read each other: each sees what the other had at its own last sample.
#[test]
fn controllers_at_two_rates_read_each_other() {
    let compiled = text(
        "model Two {
          sampled every 0.3 s { state a = 1 { next = 0.5*a + 0.25*b } }
          sampled every 0.2 s { state b = 2 { next = b - 0.125*a } }
          probe first = a
          probe second = b
        }",
    );
    let mut sim = start(&compiled, Steps::new());
    let (mut a, mut b) = (1.0f64, 2.0f64);
    // What each took of the other at its last sample.
    let (mut b_seen, mut a_seen) = (b, a);
    for tenth in 1..=60u32 {
        let (of_a, of_b) = (tenth % 3 == 0, tenth % 2 == 0);
        let next = (0.5 * a + 0.25 * b_seen, b - 0.125 * a_seen);
        if of_a {
            a = next.0;
        }
        if of_b {
            b = next.1;
        }
        if of_a {
            b_seen = b;
        }
        if of_b {
            a_seen = a;
        }
        advance(&mut sim, f64::from(tenth) * 0.1);
        assert_eq!((probe(&mut sim, "first"), probe(&mut sim, "second")), (a, b), "after {tenth} tenths of a second");
    }
}

/// What a sampled region reads of outside is taken at its samples: a force held over each interval.
#[test]
fn a_sampled_source_takes_its_input_at_the_samples() {
    for method in ["gonzalez", "ray"] {
        let compiled = text(&format!(
            "model M {{ input u = 0 N  I:m = 2 kg  0:n -> m  sampled every 0.1 s budget off method {method} {{ Se:f = u }}
              f ||> n  probe p = m.p }}"
        ));
        let table = signal(&[(0.0, 0.0), (0.33, 3.3), (2.0, 1.0)], false);
        let mut sim = fed(&compiled, Steps::new(), "u", table.clone());
        let mut p = 0.0;
        for k in 0..30u32 {
            advance(&mut sim, f64::from(k) * 0.1);
            close(probe(&mut sim, "p"), p, 1e-12, &format!("{method}: p at sample {k}"));
            p += 0.1 * table.value(f64::from(k) * 0.1);
        }
        assert!(sim.summary().bars.iter().all(|b| b.difference == 0.0));
    }
}

/// And so is time: a ramp that is written out is held as one that is given.
#[test]
fn a_sampled_source_takes_time_at_the_samples() {
    for method in ["gonzalez", "ray"] {
        let compiled = text(&format!(
            "model M {{ I:m = 2 kg  0:n -> m
              sampled every 0.1 s budget off method {method} {{ Se:f = 1 N/s * t + (if t < 0.25 s then 0 N else 1 N) }}
              f ||> n  probe p = m.p }}"
        ));
        let mut sim = start(&compiled, Steps::new());
        let mut p = 0.0;
        for k in 0..30u32 {
            let t = f64::from(k) * 0.1;
            advance(&mut sim, t);
            close(probe(&mut sim, "p"), p, 1e-12, &format!("{method}: p at sample {k}"));
            p += 0.1 * (t + if t < 0.25 { 0.0 } else { 1.0 });
        }
    }
}

/// Inputs and states of a part have its path; those of a loop its numbers.
#[test]
fn paths_of_inputs_and_states() {
    let compiled = with(
        Options::new().whole(),
        "model Part { input u = 1  port p  Se:s = u*z  p -> 1:j  s -> j  state z = 1 V { dz = -z/(1 s) } }
         model M { Part:left  Part:right  R:a = 1 Ohm  R:b = 1 Ohm  a -> left.p  b -> right.p
           for i in 1..2 { input w = 2  state y = 0 { dy = w/(1 s) }  probe z = y } }",
    );
    assert_eq!(compiled.inputs(), ["left.u", "right.u", "w[1]", "w[2]"]);
    let l = compiled.linearize(0.0, &|_| None).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(l.states, ["left.z", "right.z", "y[1]", "y[2]"]);
    let mut sim = compiled.simulate(Steps::new()).unwrap_or_else(|e| panic!("{e}"));
    sim.set_input("w[2]", 5.0).unwrap_or_else(|e| panic!("{e}"));
    finish(&mut sim, 2.0);
    close(probe(&mut sim, "z[1]"), 4.0, 1e-13, "z[1]");
    close(probe(&mut sim, "z[2]"), 10.0, 1e-13, "z[2]");
}

#[test]
fn what_is_shown() {
    let compiled = text(
        "model Shown { input u = 1 V  Se:s = u + z  R:r = 2 Ohm  C:c = 1 F  s -> 1:i -> r, c
          state z = 0 { dz = (u - c.e)/(3 s) }
          sampled every 10 ms { state k = 0.5 { next = k/2 } } }",
    );
    insta::assert_snapshot!(compiled.show("all"));
    let json = compiled.show_as("phs", "json").unwrap_or_else(|e| panic!("{e}"));
    let json: serde_json::Value = serde_json::from_str(&json).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(json["regions"][0]["states"].as_array().map(Vec::len), Some(1));
    assert_eq!(json["inputs"][0]["name"], "u");
    assert_eq!(json["signal_states"][1]["next"], "k/2");
    assert_eq!(json["signal_states"][1]["period"], 0.01);
}

/// A force that rises evenly overcomes friction of 1 N at 1 s: v = (t - 1)^2/2 from there on.
#[test]
fn an_input_overcomes_friction() {
    let compiled = text(
        "model Stick(Fc = 1 N) {
          input u = 0 N
          Se:force = u
          I:m = 1 kg
          R:fr { e = Fc * min(max(s, -1), 1); f = (s - min(max(s, -1), 1)) * 1 m/s }
          force -> 1:v -> m, fr
          state x = 0 m { dx = v.f }
          probe speed = v.f
          probe place = x
        }",
    );
    let mut sim = fed(&compiled, Steps::fixed(0.01), "u", signal(&[(0.0, 0.0), (4.0, 4.0)], false));
    for k in 1..=10 {
        let t = 0.25 * f64::from(k);
        advance(&mut sim, t);
        let moved = (t - 1.0).max(0.0);
        close(probe(&mut sim, "speed"), moved.powi(2) / 2.0, 1e-12, &format!("speed at {t}"));
        close(probe(&mut sim, "place"), moved.powi(3) / 6.0, 2e-4, &format!("place at {t}"));
    }
    let summary = sim.summary();
    assert!(summary.passive && summary.worst_step <= 1e-12, "{:?}", summary.reasons);
}

/// Coupled coils and resistors with two ports, under a source that reads its own current: `exact` against `rk4`.
#[test]
fn fields_in_a_closed_loop() {
    let field = "model F {
      input u = 1 V
      Se:s = u - 0.5 Ohm * i1.f
      R(a, b):pair = [[2 Ohm, 1 Ohm], [1 Ohm, 3 Ohm]]
      I(p1, p2):coils { H = 1 H^-1 * (p1^2 + p1*p2 + p2^2) }
      s -> 1:i1 -> pair.a, coils.p1
      1:i2 -> pair.b, coils.p2
      state q = 0 C { dq = i2.f }
      probe x = i1.f
      probe y = q
    }";
    let ends = [("exact", 0.37), ("rk4", 1e-3)].map(|(method, step)| {
        let compiled = with(Options::new().method(method), field);
        let mut sim = fed(&compiled, Steps::fixed(step), "u", signal(&ROWS, false));
        finish(&mut sim, 2.5);
        let summary = sim.summary();
        assert!(method != "exact" || (summary.passive && summary.worst_step <= 1e-12), "{:e}", summary.worst_step);
        (probe(&mut sim, "x"), probe(&mut sim, "y"))
    });
    close(ends[0].0, ends[1].0, 1e-10, "current");
    close(ends[0].1, ends[1].1, 1e-10, "charge");
}

/// What samples hold stands still between them, and time and inputs do not: w is 0.5, 1.5, ... for 0.3 s each.
#[test]
fn integrals_of_what_is_sampled() {
    let model = "model M {
        input u = 1
        sampled every 0.3 s { state w = 0.5 { next = w + 1 } }
        sampled every 0.1 s { state v = 0 { next = v + 1 } }
        probe one = integral(1, 0 s)
        probe wave = integral(sin(2 Hz * t), 0 s)
        probe ramp = integral(u, 0 s)
        probe both = integral(w*t, 0 s^2)
        probe held = integral(w, 0 s)
        probe fast = integral(v, 0 s)
        probe rates = integral(w*v, 0 s)
    }";
    let compiled = text(model);
    let mut sim = fed(&compiled, Steps::new(), "u", signal(&[(0.0, 0.0), (2.0, 2.0)], false));
    let held = |k: i32| 0.5 + f64::from(k);
    for t in [0.25, 1.0] {
        advance(&mut sim, t);
        // Over each tenth of a second, or what has gone of it.
        let parts = (0..10).map(|k| (k, 0.1 * f64::from(k), (0.1 * f64::from(k + 1)).min(t))).filter(|p| p.1 < p.2);
        let sum = |of: &dyn Fn(i32, f64, f64) -> f64| parts.clone().map(|(k, a, b)| of(k, a, b)).sum::<f64>();
        let wanted = [
            ("one", t),
            ("wave", (1.0 - f64::cos(2.0 * t)) / 2.0),
            ("ramp", t * t / 2.0),
            ("both", sum(&|k, a, b| held(k / 3) * (b * b - a * a) / 2.0)),
            ("held", sum(&|k, a, b| held(k / 3) * (b - a))),
            ("fast", sum(&|k, a, b| f64::from(k) * (b - a))),
            ("rates", sum(&|k, a, b| held(k / 3) * f64::from(k) * (b - a))),
        ];
        for (name, value) in wanted {
            close(probe(&mut sim, name), value, 1e-9, &format!("{name} at {t} s"));
        }
    }
    // One that a source reads: 1 N/s for 1 s, on 1 kg.
    let driven = text(
        "model M { sampled every 0.3 s { state w = 1 { next = w } }
           let force = integral(w, 0 s)  Se:s = 1 N/s * force  I:m = 1 kg  s -> 1:v -> m  probe f = v.f }",
    );
    let mut sim = start(&driven, Steps::new());
    finish(&mut sim, 1.0);
    close(probe(&mut sim, "f"), 0.5, 1e-12, "driven");
}

/// A computer's source of time is what it was at the sample, to whoever looks, and to another region.
#[test]
fn samples_hold_the_time() {
    let compiled = text(
        "model M {
           sampled every 0.1 s { Se:u = (2 V/s)*t  R:r = 1 Ohm  u -> r }
           sampled every 0.025 s { Se:w = u.e  R:q = 1 Ohm  w -> q }
           Se:s = u.e  R:p = 1 Ohm  s -> p
           probe ue = u.e  probe power = r.P  probe se = s.e  probe we = w.e
         }",
    );
    let mut sim = start(&compiled, Steps::new());
    for (t, e) in [(0.05, 0.0), (0.1, 0.2), (0.175, 0.2), (0.25, 0.4), (0.31, 0.6)] {
        advance(&mut sim, t);
        for (name, value) in [("ue", e), ("se", e), ("we", e), ("power", e * e)] {
            close(probe(&mut sim, name), value, 1e-12, &format!("{name} at {t} s"));
        }
    }
}

/// What counts whole numbers comes to whole numbers, whatever they are divided by, as numbers of the text or of
/// parameters: a 49th times 49 is less than 1.
#[test]
fn counters_count() {
    for n in [3, 6, 7, 14, 24, 28, 29, 49, 54, 68, 98, 103, 107, 112, 119] {
        let text = format!(
            "model Ring(N = {n}) {{
              sampled every 1 s {{
                state ring = 0 {{ next = mod(ring + 1, {n}) }}
                state half = 0 {{ next = mod(half*0.5 + 0.5, 0.5*{n})*2 }}
                state back = 0 {{ next = if mod(back + 1, N) == 0 then 0 else back + 1 }}
                state turns = 0 {{ next = floor((all + 1)/N) }}
                state all = 0 {{ next = all + 1 }}
              }}
              probe rings = ring
              probe halves = half
              probe backs = back
              probe all_turns = turns
              probe rest = mod(all, N)
              probe over = if all/{n} >= 1 then 1 else 0
              probe third = floor(all/{n} + 1/3 + (N - 1)/(3*N))
            }}"
        );
        let compiled = with(Options::new(), &text);
        let mut sim = start(&compiled, Steps::new());
        for k in 1..=2 * n + 1 {
            advance(&mut sim, f64::from(k));
            let (rest, turns) = (f64::from(k % n), f64::from(k / n));
            for (name, wanted) in
                [("rings", rest), ("halves", rest), ("backs", rest), ("rest", rest), ("all_turns", turns)]
            {
                assert_eq!(probe(&mut sim, name), wanted, "{name} of {n} at {k}");
            }
            assert_eq!(probe(&mut sim, "over"), f64::from(u8::from(k >= n)), "over {n} at {k}");
            let third = f64::from((3 * k + 2 * n - 1) / (3 * n));
            assert_eq!(probe(&mut sim, "third"), third, "third of {n} at {k}");
        }
    }
}

/// What only samples and inputs move does not switch within a step: where no step is cut, as in what is built, it is
/// stepped exactly too.
#[test]
fn limits_of_what_is_held_are_no_switches() {
    let limited = |what: &str| {
        with(
            Options::new().accuracy(Accuracy::Uncut),
            &format!(
                "model Limited {{
                  input v = 3 V
                  sampled every 5 ms {{ state u = 0 V {{ next = u + 1 V }} }}
                  Se:source = {what}
                  R:r = 1 Ohm
                  I:l = 2 mH
                  source -> 1:i -> r, l
                  probe current = l.f
                }}"
            ),
        )
    };
    for what in ["min(u, 24 V)", "max(min(v, 24 V), -24 V)", "if u > v then 24 V else 0"] {
        let compiled = limited(what);
        let held = compiled.scene().clusters.iter().find(|c| c.period.is_none()).expect("the coil");
        assert_eq!((&*held.step.name, held.guards.is_none()), ("exact", true), "{what}");
    }
    let compiled = limited("if t < 7 ms then u else 0");
    let cut = compiled.scene().clusters.iter().find(|c| c.period.is_none()).expect("the coil");
    assert_eq!(cut.step.name, "gonzalez");
}

const PI: &str = "model Pi(Kp = 1 V/rad, Ki = 1 V/(rad*s)) {
  output u = Kp*(want - is) + Ki*sum
  input want = 0 rad
  input is = 0 rad
  state sum = 0 rad*s { dsum = want - is }
}
";

/// What moves: two shafts, each with a damper, driven by `first` and `second`.
const SHAFTS: &str = "
  for i in 1..2 {
    Se:drive[i] = (if i == 1 then first else second)*(1 N*m/V)
    I:rotor[i] = 0.5 kg*m^2
    R:bearing[i] = 0.2 N*m*s
    drive[i] -> 1:w[i] -> rotor[i], bearing[i]
    state angle[i] = 0.1*i { dangle = w[i].f }
  }
  input setpoint = 1 rad
  probe a = angle[1]
  probe b = angle[2]
  probe u = first
  simulate { stop = 4 s }
}";

/// A part is what stands in it: the same run as with the controllers written out, in whatever way they are made.
#[test]
fn a_part_is_what_stands_in_it() {
    let own = |i: u32| format!("state s{i} = 0 rad*s {{ dz = {i}*setpoint - angle[{i}] }}\n");
    let written = format!(
        "model M {{ {}{} let first = 2 V/rad * (setpoint - angle[1]) + s1*1 V/(rad*s)
         let second = 3 V/rad * (2*setpoint - angle[2]) + s2*0.5 V/(rad*s) {SHAFTS}",
        own(1),
        own(2)
    );
    let gains = ["Kp = 2 V/rad", "Kp = 3 V/rad, Ki = 0.5 V/(rad*s)"];
    let pair = |first: &str, second: &str| {
        format!(
            "Pi:{first}({}, want = setpoint, is = angle[1]) Pi:{second}({}, want = 2*setpoint, is = angle[2])",
            gains[0], gains[1]
        )
    };
    let outputs = "let first = p.u let second = q.u";
    let ways = [
        format!("{PI} model M {{ {} {outputs} {SHAFTS}", pair("p", "q")),
        // An array of parts, with what belongs to the round.
        format!(
            "{PI} model M {{ for i in 1..2 {{
               let aim = i*setpoint
               Pi:p[i](Kp = (1 + i)*1 V/rad, Ki = (if i == 1 then 1 else 0.5)*1 V/(rad*s), want = aim, is = angle[i])
             }} let first = p[1].u let second = p[2].u {SHAFTS}"
        ),
        // Parts in a part, which is given both places as an array.
        format!(
            "{PI} model Both {{ input place = [0 rad, 0 rad] input aim = 0 rad
               Pi:p({}, want = aim, is = place[1]) Pi:q({}, want = 2*aim, is = place[2])
               output u = [p.u, q.u] }}
             model M {{ let first = both.u[1] let second = both.u[2]
               Both:both(aim = setpoint, place = [angle[1], angle[2]]) {SHAFTS}",
            gains[0], gains[1]
        ),
    ];
    let run = |text: &str| {
        let compiled = with(Options::new(), text);
        let mut sim = fed(&compiled, Steps::new(), "setpoint", signal(&[(0.0, 1.0), (2.0, 1.5)], true));
        let mut seen = Vec::new();
        for k in 1..=8 {
            advance(&mut sim, 0.5 * f64::from(k));
            seen.extend(["a", "b", "u"].map(|name| probe(&mut sim, name)));
        }
        seen
    };
    let wanted = run(&written);
    for way in ways {
        let found = run(&way);
        for (x, y) in found.iter().zip(&wanted) {
            close(*x, *y, 1e-12, &way);
        }
    }
}

/// An input that the instance does not bind is one of the scene, by its path.
#[test]
fn an_input_that_is_not_given_is_of_the_scene() {
    let compiled = text(&format!(
        "{PI} model M {{ input far = [1 rad, 2 rad] Pi:p(is = far[2]) Pi:q(want = far[1]) probe y = p.u probe z = q.u }}"
    ));
    assert_eq!(compiled.inputs(), ["far[1]", "far[2]", "p.want", "q.is"]);
    let mut sim = start(&compiled, Steps::new());
    assert_eq!((probe(&mut sim, "y"), probe(&mut sim, "z")), (-2.0, 1.0));
    sim.set_input("p.want", 5.0).unwrap_or_else(|e| panic!("{e}"));
    sim.set_input("far[2]", 1.0).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(probe(&mut sim, "y"), 4.0);
    insta::assert_snapshot!(compiled.show("phs"));
}

/// Alone, a part is a scene: its outputs are written, and its inputs come from outside.
#[test]
fn a_part_alone() {
    let compiled = text(PI);
    assert_eq!(compiled.inputs(), ["want", "is"]);
    assert_eq!(compiled.probes(), ["u"]);
    let mut sim = fed(&compiled, Steps::new(), "want", signal(&[(0.0, 0.5)], true));
    finish(&mut sim, 2.0);
    close(probe(&mut sim, "u"), 0.5 + 0.5 * 2.0, 1e-14, "u");
}

/// Units are inferred and checked through what is given.
#[test]
fn units_of_what_parts_are_given() {
    let part = "model Twice(k = 2) { input x = 0 output y = k*x } ";
    let compiled = text(&format!("{part} model M {{ Twice:a(x = 3 m) Twice:b(k = 2 Hz, x = a.y) probe y = b.y }}"));
    let unit = compiled.stages().model.probes[0].unit.as_ref().map(|u| u.to_string());
    assert_eq!(unit.as_deref(), Some("m/s"));
    let wrong =
        crate::common::errors(&format!("{part} model M {{ Twice:a(x = 3 V) probe y = a.y + 1 N }}")).to_string();
    assert!(wrong.contains("wrong unit"), "{wrong}");
}

/// Each entry of an array is a state: a row of samples, and a vector that turns.
#[test]
fn arrays_of_states() {
    for row in [
        "sampled every 0.1 s { state z = [1 V, 2 V, 3 V] { next = [u, z[1], z[2]] } }",
        "sampled every 0.1 s { for i in 1..3 { state z[i] = i*1 V { next = if i == 1 then u else z[i-1] } } }",
        // In another order.
        "sampled every 0.1 s { for i in 1..3 { state z[4-i] = (4 - i)*1 V { next = if i == 3 then u else z[3-i] } } }",
    ] {
        let compiled = text(&format!("model M {{ let u = t*1 V/s {row} probe x = [z[1], z[2], z[3]] }}"));
        let mut sim = start(&compiled, Steps::new());
        let mut z = [1.0, 2.0, 3.0];
        for k in 0..20 {
            let t = 0.1 * f64::from(k);
            advance(&mut sim, t + 0.05);
            let seen = [1, 2, 3].map(|i| probe(&mut sim, &format!("x[{i}]")));
            for (x, y) in seen.iter().zip(z) {
                close(*x, y, 1e-14, &format!("{row} after {t}"));
            }
            z = [t, z[0], z[1]];
        }
    }
    let compiled = text(
        "model M { let w = [[0 Hz, -3 Hz], [3 Hz, 0 Hz]] state x = [1 m, 0 m] { dx = w*x }
           probe length = dot(x, x) probe y = x }",
    );
    let l = compiled.linearize(0.0, &|_| None).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(l.states, ["x[1]", "x[2]"]);
    let mut sim = start(&compiled, Steps::new());
    finish(&mut sim, 1.0);
    close(probe(&mut sim, "y[1]"), 3.0f64.cos(), 1e-13, "x[1]");
    close(probe(&mut sim, "y[2]"), 3.0f64.sin(), 1e-13, "x[2]");
    close(probe(&mut sim, "length"), 1.0, 1e-13, "length");
}

/// Outside of its block an output stands still from sample to sample, a sample late; inside it is there at once.
#[test]
fn an_output_of_a_computer_is_held() {
    let compiled = text(
        "model P(k = 2 Hz) { input u = 0 m output y = k*u }
         model M { state x = 1 m { dx = -p.y } let direct = x*5 Hz
           sampled every 0.1 s { P:p(u = x) state same = 0 m/s { next = p.y + direct*0 } state steps = 0 { dsteps = 1/period } }
           probe place = x probe speed = p.y probe inside = same probe count = steps }",
    );
    let mut sim = start(&compiled, Steps::new());
    let (mut x, mut y) = (1.0, 0.0);
    for k in 0..30 {
        let t = 0.1 * f64::from(k);
        advance(&mut sim, t + 0.05);
        close(probe(&mut sim, "speed"), y, 1e-13, "p.y");
        close(probe(&mut sim, "inside"), y, 1e-13, "the same by a state");
        close(probe(&mut sim, "place"), x - 0.05 * y, 1e-13, "x");
        close(probe(&mut sim, "count"), f64::from(k), 1e-12, "how many samples");
        (x, y) = (x - 0.1 * y, 2.0 * x);
    }
}

/// Two computers that read each other's outputs: each sees what the other gave, so that there is no circle.
#[test]
fn computers_that_read_each_other() {
    let compiled = text(
        "model Half { input u = 0 output y = 0.5*u + 1 }
         model M { sampled every 0.1 s { Half:a(u = b.y) } sampled every 0.1 s { Half:b(u = a.y) }
           probe y = a.y probe z = b.y }",
    );
    let mut sim = start(&compiled, Steps::new());
    let (mut a, mut b) = (0.0, 0.0);
    for k in 0..10 {
        advance(&mut sim, 0.1 * f64::from(k) + 0.05);
        assert_eq!((probe(&mut sim, "y"), probe(&mut sim, "z")), (a, b), "after sample {k}");
        (a, b) = (0.5 * b + 1.0, 0.5 * a + 1.0);
    }
}

/// What a message says of a signal that is given for a parameter is right.
#[test]
fn a_signal_for_a_parameter() {
    let scene = "model M { C:c = 1 F  R:r = 1 Ohm  Pi:pi(want = 1 V, is = c.e)  Se:u = pi.out  u -> 1:m -> r, c
        probe y = c.e simulate { stop = 1 s } }";
    let law = "state sum = 0 V*s { dsum = want - is } let out = kp*(want - is) + ki*sum }";
    let wrong = format!("model Pi(kp = 2, ki = 5 Hz, want = 0 V, is = 0 V) {{ {law} {scene}");
    let said = crate::common::errors(&wrong).to_string();
    assert!(said.contains("write `input is = 0 V`"), "{said}");
    let right = format!("model Pi(kp = 2, ki = 5 Hz, want = 0 V) {{ input is = 0 V {law} {scene}");
    let compiled = text(&right);
    let y = crate::common::end(&compiled, Steps::new(), 1.0, "y");
    // c' = u - c, u = 2 (1 - c) + 5 s, s' = 1 - c: e = 1 - c goes by e'' + 3 e' + 5 e = 0 with e(0) = 1 and e'(0) = -2.
    let w = 2.75f64.sqrt();
    close(y, 1.0 - (-1.5f64).exp() * (w.cos() - 0.5 / w * w.sin()), 1e-9, "y");
}

/// Rounds add up, by indices: a mean of any number of signals, given as an array.
#[test]
fn an_input_for_each_round() {
    let compiled = text(
        "model Mean(n = 2) { let total[0] = 0 V for i in 1..n { input x[i] = 0 V let total[i] = total[i-1] + x[i] }
           output y = total[n]/n }
         model M { Mean:m(n = 3, x = [1 V, 2 V, 6 V]) Mean:open(n = 2) probe y = m.y probe z = open.y }",
    );
    assert_eq!(compiled.inputs(), ["open.x[1]", "open.x[2]"]);
    let mut sim = start(&compiled, Steps::new());
    assert_eq!((probe(&mut sim, "y"), probe(&mut sim, "z")), (3.0, 0.0));
}
