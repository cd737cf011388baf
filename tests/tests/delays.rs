//! Delays: whole periods in sampled blocks, the solution's own past in continuous time.

use crate::common::{advance, close, end, errors, finish, probe, start, text, with};
use bond::internal::{Code, CompiledInternals, OptionsInternals, SimulationInternals, StepsInternals};
use bond::{InputSignal, Options, Simulation, Steps};
use bond_compiler::discretise::Accuracy;

/// Programs for steps that are fitted to a tolerance.
fn fitted(tolerance: f64) -> Options {
    Options::new().accuracy(Accuracy::Tolerance(tolerance))
}

/// The sum of the method of steps for x' = -x(t - 1), x = 1 until 0.
fn by_steps(t: f64) -> f64 {
    let mut sum = 1.0;
    let mut factorial = 1.0;
    for k in 1..=(t.floor() as i32 + 1) {
        factorial *= f64::from(k);
        let u = t - f64::from(k - 1);
        sum += (-1f64).powi(k) * u.powi(k) / factorial;
    }
    sum
}

const LAST: &str = "model M {
  state x = 1 { dx = -delay(x, 1 s, 1)*1 Hz }
  probe y = x
  probe was = delay(x, 1 s, 1)
}";

/// To 1e-10 at tight tolerances, at instants that no step meets, over many delays; and what is read is the past.
#[test]
fn the_method_of_steps() {
    let compiled = with(fitted(1e-12), LAST);
    let mut sim = start(&compiled, Steps::tolerance(1e-12));
    for k in 1..=90 {
        let t = f64::from(k) * 0.0837;
        advance(&mut sim, t);
        close(probe(&mut sim, "y"), by_steps(t), 1e-10, "y");
        let was = if t <= 1.0 { 1.0 } else { by_steps(t - 1.0) };
        close(probe(&mut sim, "was"), was, 1e-10, "was");
    }
}

/// x' = -5 x(t - 1/2) + sin(t), which bends over every step: errors fall with the order of the method, in fixed steps
/// that meet the delay and in such that do not.
#[test]
fn as_good_as_the_method() {
    let model = "model M {
      state x = 1 { dx = -2*delay(x, 0.5 s, 1)*1 Hz + sin(3*t/1 s)*1 Hz }
      Se:push = 1 N * delay(x, 0.3 s)
      I:mass = 1 kg
      push -> mass
      probe y = x
      probe p = mass.p
    }";
    let exact = {
        let compiled = with(fitted(1e-13).method("collocation12"), model);
        ["y", "p"].map(|name| end(&compiled, Steps::tolerance(1e-13), 2.3, name))
    };
    for (method, order) in [("gonzalez", 2), ("collocation4", 4), ("collocation6", 6), ("rk4", 4), ("collocation8", 8)]
    {
        let compiled = with(Options::new().method(method), model);
        let error = |h: f64| {
            let found = ["y", "p"].map(|name| end(&compiled, Steps::fixed(h), 2.3, name));
            found.iter().zip(&exact).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
        };
        let (coarse, fine) = (error(0.1), error(0.05));
        let found = (coarse / fine.max(1e-15)).log2();
        let least = f64::from(order) - 0.5;
        assert!(found > least || fine < 1e-12, "{method}: {coarse:e} {fine:e}, order {found}");
    }
}

/// At any tolerance the error is about that, with a delay that is shorter than steps would be, too.
#[test]
fn errors_follow_the_tolerance() {
    let model = |delay: f64| {
        format!(
            "model M {{
               state x = 1 {{ dx = -(x + 0.5*delay(x, {delay} s, 1))*1 Hz }}
               probe y = x
             }}"
        )
    };
    for delay in [0.01, 0.7] {
        let exact = end(&with(fitted(1e-13), &model(delay)), Steps::tolerance(1e-13), 3.0, "y");
        for tolerance in [1e-4, 1e-6, 1e-9] {
            let compiled = with(fitted(tolerance), &model(delay));
            let found = end(&compiled, Steps::tolerance(tolerance), 3.0, "y");
            assert!((found - exact).abs() < 20.0 * tolerance, "{delay} {tolerance}: {found} {exact}");
        }
    }
}

/// What jumps arrives as a jump: an input, what a computer holds, and time.
#[test]
fn jumps_arrive_a_delay_later() {
    let compiled = text(
        "model M {
           input u = 0
           state a = 0 s { da = delay(u, 0.25 s) }
           sampled every 0.1 s { state n = 0 { next = n + 1 } }
           state b = 0 s { db = delay(n, 0.33 s) }
           state c = 0 s { dc = delay(if t < 0.2 s then 0 else 1, 0.5 s) }
           probe x = a
           probe y = b
           probe z = c
         }",
    );
    let table = InputSignal::table(&[0.0, 0.3, 0.55], &[1.0, -2.0, 0.0], true).unwrap_or_else(|e| panic!("{e}"));
    let mut sim =
        compiled.simulate_with(Steps::tolerance(1e-9), [("u".to_string(), table)]).unwrap_or_else(|e| panic!("{e}"));
    let ramp = |t: f64| t.max(0.0);
    for k in 1..=60 {
        let t = f64::from(k) * 0.0211;
        advance(&mut sim, t);
        let given = ramp(t - 0.25) - 3.0 * ramp(t - 0.55) + 2.0 * ramp(t - 0.8);
        close(probe(&mut sim, "x"), given, 1e-12, "an input");
        let counted: f64 = (1..20).map(|k| ramp(t - 0.33 - 0.1 * f64::from(k))).sum();
        close(probe(&mut sim, "y"), counted, 1e-12, "a count");
        close(probe(&mut sim, "z"), ramp(t - 0.7), 1e-9, "time");
    }
}

/// A computer reads a delayed signal of continuous time at its samples.
#[test]
fn a_sampled_block_reads_a_delay() {
    let compiled = text(
        "model M {
           let was = delay(sin(t/1 s), 0.25 s)
           sampled every 0.1 s { state s = 0 { next = was } }
           probe read = s
           probe later = was
         }",
    );
    let mut sim = start(&compiled, Steps::new());
    for k in 1..=40 {
        let t = f64::from(k) * 0.1;
        advance(&mut sim, t);
        let was = |t: f64| if t < 0.25 { 0.0 } else { (t - 0.25).sin() };
        close(probe(&mut sim, "read"), was(t - 0.1), 1e-9, "read");
        close(probe(&mut sim, "later"), was(t), 1e-9, "later");
    }
}

/// Looking, saving and going on change no bit, with steps under way and much that is on its way.
#[test]
fn looking_and_saving_change_nothing() {
    let model = "model M {
      Se:push = 1 N * delay(mass.f*1 s/1 m, 0.37 s, 1)
      R:rub = 0.5 N*s/m
      I:mass = 1 kg
      push -> 1:v -> mass, rub
      sampled every 0.05 s { state z = 0 N*s { next = delay(mass.p, 0.2 s) - delay(z, 0.35 s)/2 } }
      probe p = mass.p
      probe zz = z
    }";
    let compiled = text(model);
    let bits = |sim: &mut Simulation<'_>| [probe(sim, "p"), probe(sim, "zz")].map(f64::to_bits);
    for steps in [Steps::new(), Steps::fixed(0.02), Steps::tolerance(1e-9)] {
        let mut plain = start(&compiled, steps);
        let mut looked = start(&compiled, steps);
        advance(&mut plain, 3.0);
        for k in 1..=300 {
            advance(&mut looked, f64::from(k) * 0.01);
            bits(&mut looked);
            if k % 37 == 0 {
                let saved = looked.save().unwrap_or_else(|e| panic!("{e}"));
                looked = compiled.resume(&saved).unwrap_or_else(|e| panic!("{e}"));
                assert_eq!(looked.save().ok(), Some(saved));
            }
        }
        finish(&mut plain, 4.0);
        finish(&mut looked, 4.0);
        assert_eq!(bits(&mut plain), bits(&mut looked));
    }
    let scene = compiled.scene();
    let steps = Steps::new().resolve(&compiled.stages().model.settings, 4.0, None).unwrap_or_else(|e| panic!("{e}"));
    let [native, interpreted] = [Code::Native, Code::Interpreted].map(|code| {
        let mut sim = Simulation::on(code.backend(), scene, &steps, []).unwrap_or_else(|e| panic!("{e}"));
        finish(&mut sim, 4.0);
        bits(&mut sim)
    });
    assert_eq!(native, interpreted);
}

/// Ten thousand periods cost a step what one costs.
#[test]
fn long_delays_cost_no_more() {
    let model = |periods: u32| {
        let time = f64::from(periods) * 1e-3;
        format!(
            "model M {{ sampled every 1 ms {{ state n = 0 {{ next = n + 1 }} let d = delay(n, {time} s) }} probe x = d }}"
        )
    };
    let seconds = |periods: u32| {
        let compiled = text(&model(periods));
        let mut sim = start(&compiled, Steps::new());
        let began = std::time::Instant::now();
        advance(&mut sim, 30.0);
        let past = f64::from(30_000 - periods).max(0.0);
        close(probe(&mut sim, "x"), past, 0.0, "x");
        began.elapsed().as_secs_f64()
    };
    let (short, long) = (seconds(10).min(seconds(10)), seconds(10_000).min(seconds(10_000)));
    assert!(long < 5.0 * short + 0.01, "{long} s, and {short} s of ten periods");
}

/// A delay of a law's own variables, and one that is not whole.
#[test]
fn what_is_refused() {
    let all = errors("model M { Se:u = 1 V R:r { f = delay(e, 1 s)*1 A/V } u -> r }");
    assert!(all.list()[0].message.contains("`e`"), "{all}");
    let all = errors("model M(T = delay(t, 1 s)) { Se:u = 1 V R:r = 1 Ohm u -> r }");
    assert_eq!(all.list()[0].code, "elaborate::constant", "{all}");
    let all = errors("model M { C:c { H = delay(q, 1 s)^2*1 J/C^2 } I:i = 1 H c -> i }");
    assert!(!all.list().is_empty());
}
