//! Steps that are fitted to a tolerance: their error, their events, what lies within them, and how they end.

use crate::common::{advance, close, end, example, finish, probe, start, text, with};
use bond::internal::{CompiledInternals, OptionsInternals, SimulationInternals};
use bond::{Options, Steps, Summary};
use bond_compiler::discretise::Accuracy;

/// An ellipse of eccentricity 0.6 about a sun with mu = 1, from where it is nearest: half axis 1, period 2 pi.
const KEPLER: &str = "model Kepler {
  I:planet_x = 1 kg
  I:planet_y { inertia = 1 kg; f0 = 2 m/s }
  C(x, y):sun { H = -(1 N*m^2)/sqrt(x^2 + y^2); x_0 = 0.4 m; y_0 = 0 m }
  1:vx -> planet_x, sun.x
  1:vy -> planet_y, sun.y
  probe x = sun.x
  probe y = sun.y
  probe px = planet_x.p
  probe py = planet_y.p
}";

/// How far a planet is from where it was, after a period.
fn missed(method: &str, tolerance: f64) -> (f64, u64) {
    let compiled = with(Options::new().method(method), KEPLER);
    let mut sim = start(&compiled, Steps::tolerance(tolerance));
    finish(&mut sim, std::f64::consts::TAU);
    let off = [("x", 0.4), ("y", 0.0), ("px", 0.0), ("py", 2.0)].map(|(name, wanted)| probe(&mut sim, name) - wanted);
    (off[0].hypot(off[1]).max(off[2].hypot(off[3]) / 2.0), sim.summary().regions[0].steps)
}

#[test]
fn a_planet_returns() {
    for (method, most) in [("rk45", 1000), ("dop853", 150)] {
        let (off, steps) = missed(method, 1e-10);
        assert!(off <= 1e-9 && steps < most, "{method}: off by {off:e} after {steps} steps");
    }
}

/// With the tolerance the error of a run falls as that of a step does, each by its order.
#[test]
fn errors_fall_with_the_tolerance() {
    let orders =
        [("dop853", 8.0), ("rk45", 5.0), ("rk4", 4.0), ("gonzalez", 2.0), ("euler", 1.0), ("symplectic_euler", 1.0)];
    for (method, order) in orders {
        let tolerances = if order > 1.0 { [1e-6, 1e-9] } else { [1e-5, 1e-7] };
        let [a, b] = tolerances.map(|x| missed(method, x));
        let found = (a.0 / b.0).ln() / (b.1 as f64 / a.1 as f64).ln();
        assert!(found > order - 0.4, "{method}: order {found} of {a:?} and {b:?}");
    }
}

/// A ball on a floor that is a spring where it is met: flight, half a swing about its rest, flight. With the height `h`
/// that it falls from, where it is after a time.
const BALL: &str = "model Ball {
  Se:weight = -9.81 N
  I:mass = 1 kg
  C:floor { H = (20 kN/m)*min(q, 0 m)^2/2; q0 = 0.1 m }
  weight -> 1:fall -> mass, floor
  probe x = floor.q
  probe energy = mass.H + floor.H + (9.81 N)*floor.q
}";

fn ball(t: f64) -> f64 {
    let (h, g, w) = (0.1f64, 9.81f64, 20e3f64.sqrt());
    let flight = (2.0 * h / g).sqrt();
    let v = g * flight;
    let contact = 2.0 * (std::f64::consts::PI - (v * w / g).atan()) / w;
    let t = t % (2.0 * flight + contact);
    if t < flight {
        h - 0.5 * g * t * t
    } else if t < flight + contact {
        let s = w * (t - flight);
        -g / (w * w) * (1.0 - s.cos()) - v / w * s.sin()
    } else {
        let back = 2.0 * flight + contact - t;
        h - 0.5 * g * back * back
    }
}

/// The largest error at rows over two seconds, seven bounces, and the ledger.
fn bounced(method: &str, tolerance: f64) -> (f64, Summary) {
    let compiled = with(Options::new().method(method), BALL);
    let mut sim = start(&compiled, Steps::tolerance(tolerance));
    let mut worst: f64 = 0.0;
    for k in 1..=97 {
        let t = f64::from(k) * 2.0 / 97.0;
        advance(&mut sim, t);
        worst = worst.max((probe(&mut sim, "x") - ball(t)).abs());
    }
    finish(&mut sim, 2.0);
    (worst, sim.summary())
}

/// The order survives contact: that of the steps, not that of stepping over a kink.
#[test]
fn a_ball_keeps_its_order_through_contact() {
    let usual = &[1e-5, 1e-7, 1e-9][..];
    // At looser tolerances order 8 has so few steps a phase that chance decides.
    for (method, order, tolerances) in
        [("gonzalez", 2.0, usual), ("rk4", 4.0, usual), ("rk45", 5.0, usual), ("dop853", 8.0, &[1e-8, 1e-13])]
    {
        let found: Vec<(f64, Summary)> = tolerances.iter().map(|x| bounced(method, *x)).collect();
        for pair in found.windows(2) {
            let steps = |s: &Summary| s.regions[0].steps as f64;
            let by_steps = (pair[0].0 / pair[1].0).ln() / (steps(&pair[1].1) / steps(&pair[0].1)).ln();
            assert!(by_steps > order - 0.5, "{method}: order {by_steps}, errors {:e} and {:e}", pair[0].0, pair[1].0);
        }
        let (off, summary) = &found[found.len() - 1];
        // Seven falls: in and out of contact.
        let region = &summary.regions[0];
        assert_eq!(region.events, 13, "{method}");
        let most = if method == "gonzalez" { 2e-6 } else { 2e-7 };
        assert!(*off < most, "{method}: off by {off:e}");
        assert_eq!(summary.passive, method == "gonzalez");
    }
}

/// A body that falls from rest, bounces and loses nothing comes back after twice the time: by a third of that and five
/// times as long its steps would end next to the switch, on one side or the other by rounding alone.
#[test]
fn a_switch_next_to_the_end_of_a_step_is_met() {
    let drop = |height: f64, push: f64| {
        with(
            Options::new().method("collocation4"),
            &format!(
                "model Drop {{
               Se:u = {push} N
               I:m = 0.265 kg
               C:w {{ H = (625 N/m)*(1 m^2)*max(q/(1 m), 0)^2.5; q0 = -{height} m }}
               u -> 1:v -> m, w
             }}"
            ),
        )
    };
    for k in 0..60 {
        let height = 0.2 + 0.0123456789 * f64::from(k);
        for push in [9.81, 16.441_732_7] {
            let compiled = drop(height, push);
            for tolerance in [1e-3, 1e-5, 1e-7] {
                let mut sim = start(&compiled, Steps::tolerance(tolerance));
                finish(&mut sim, 1.0);
                assert!(sim.summary().passive, "{height} {push} {tolerance:e}");
            }
        }
    }
}

/// Where another law holds the last step says nothing of the next one: the iteration does not start by it. And few
/// steps are taken on the way to a switch, though the parabola foretells that of a contact too soon.
#[test]
fn bounces_take_few_steps_and_iterations() {
    let contact = "model Contact {
       Se:hand = 5 N
       I:mass = 1 kg
       C:wall { H = if q > 0 then (50 kN/m)*q^2 else 0 J; q0 = -0.1 m }
       R:damper { e = if wall.q > 0 then (30 N*s/m)*f else 0 N }
       hand -> 1:v -> mass, wall, damper
     }";
    for (method, most) in [("gonzalez", 800), ("collocation4", 180), ("collocation6", 120), ("collocation8", 100)] {
        let compiled = with(Options::new().method(method), contact);
        let mut sim = start(&compiled, Steps::tolerance(1e-5));
        finish(&mut sim, 2.0);
        let summary = sim.summary();
        let region = &summary.regions[0];
        assert!(region.events == 18 && region.rejected <= 3, "{method}: {region:?}");
        assert!(region.steps < most && region.newton_iterations < 4 * region.steps, "{method}: {region:?}");
    }
}

/// A mass that a hand pushes against a spring and a damper which only push back: with the damper the force jumps where
/// they are met.
const PUSHED: &str = "model Contact {
  Se:hand = 5 N
  I:mass = 1 kg
  C:wall { H = if q > 0 then (50 kN/m)*q^2 else 0 J; q0 = -0.1 m }
  R:damper { e = if wall.q > 0 then (30 N*s/m)*f else 0 N }
  hand -> 1:v -> mass, wall, damper
  probe x = wall.q
}";

/// An explicit step ends by stages that look at its end, or beyond: what they would see behind a switch does not spoil
/// the step to there, and no steps creep up to it.
#[test]
fn explicit_steps_keep_to_one_law() {
    for (method, most) in [("rk4", 300), ("rk45", 180), ("dop853", 90)] {
        let compiled = with(Options::new().method(method), PUSHED);
        let mut sim = start(&compiled, Steps::tolerance(1e-6));
        finish(&mut sim, 2.0);
        let summary = sim.summary();
        let region = &summary.regions[0];
        assert!(region.events == 18 && region.rejected <= 2 && region.steps < most, "{method}: {region:?}");
    }
    // The error is that of the tolerance then.
    let at = |method: &str, tolerance: f64| {
        let compiled = with(Options::new().method(method), PUSHED);
        end(&compiled, Steps::tolerance(tolerance), 2.0, "x")
    };
    let wanted = at("collocation8", 1e-13);
    close(at("dop853", 1e-10), wanted, 1e-9, "dop853");
    close(at("rk45", 1e-9), wanted, 1e-7, "rk45");
}

/// A law may have no value beyond its switch, as a root of what is cut off there: then it looks for itself.
#[test]
fn explicit_steps_meet_what_is_cut_off() {
    let model = "model Hertz {
       C:c { H = 4 J * max(q/(1 m), 0)^2.5; q0 = -0.3 m }
       C:k = 1 m/N
       I:i { inertia = 1 kg; f0 = 1 m/s }
       1:v -> c, k, i
       probe x = i.p
     }";
    let at = |method: &str, tolerance: f64| {
        let compiled = with(Options::new().method(method), model);
        end(&compiled, Steps::tolerance(tolerance), 8.0, "x")
    };
    let wanted = at("collocation8", 1e-12);
    for method in ["rk4", "rk45", "dop853"] {
        close(at(method, 1e-8), wanted, 1e-5, method);
    }
}

/// A source that switches does so at its instant, whatever little it is beside what was before.
#[test]
fn steps_that_look_at_their_end_meet_a_source_that_switches() {
    let model = "model Coil {
       Sf:s = if t > 1 s then 10 uA else -10 uA
       I:l = 1 H
       R:b = 1 uOhm
       s -> 0:n -> l, b
       probe p = l.p
     }";
    for method in ["rk45", "dop853", "radau"] {
        let compiled = with(Options::new().method(method), model);
        let p = end(&compiled, Steps::tolerance(1e-5), 3.0, "p");
        // p' = R (i - p / L)
        let (slow, rate) = (10e-6 * 1e-6, 1e-6f64);
        let turn = -slow * (1.0 - (-rate).exp()) / rate;
        let wanted = turn * (-2.0 * rate).exp() + slow * (1.0 - (-2.0 * rate).exp()) / rate;
        assert!((p - wanted).abs() <= 1e-4 * wanted.abs(), "{method}: {p:e}, not {wanted:e}");
    }
}

/// Steps end at kinks, so that methods of high order take fewer of them, where a tolerance is told that is not loose;
/// where laws have roots, the one that damps, and in a large region none.
#[test]
fn kinks_are_taken_with_high_order_where_that_is_asked_for() {
    let taken = |tolerance: f64, model: &str| {
        let compiled = with(Options::new().accuracy(Accuracy::Tolerance(tolerance)), model);
        let mut sim = start(&compiled, Steps::tolerance(tolerance));
        finish(&mut sim, 2.0);
        (compiled.scene().clusters[0].step.name.to_string(), probe(&mut sim, "x"), sim.summary())
    };
    let (stepper, x, summary) = taken(1e-9, BALL);
    assert_eq!((stepper.as_str(), summary.passive, summary.regions[0].events), ("collocation8", true, 13));
    close(x, ball(2.0), 1e-7, "the ball");
    assert!(summary.regions[0].steps < 500, "{} steps", summary.regions[0].steps);
    for (tolerance, method, off) in [(1e-6, "collocation8", 1e-5), (1e-4, "gonzalez", 0.1), (1e-2, "gonzalez", 0.1)] {
        let (stepper, x, summary) = taken(tolerance, BALL);
        assert_eq!((stepper.as_str(), summary.passive, summary.regions[0].events), (method, true, 13), "{tolerance:e}");
        close(x, ball(2.0), off, "the ball");
    }
    let valves = |n: u32| {
        format!(
            "model Valves {{
               for i in 1..{n} {{
                 C:tank[i] {{ compliance = 1 F; q0 = if i == 1 then 1 C else 0 C }}
                 R:hole[i] {{ f = sign(e)*sqrt(abs(e)/(1 V))*(1 A) }}
                 0:level[i] -> tank[i]
                 if i < {n} {{ level[i] -> 1:pipe[i] -> hole[i], level[i + 1] }} else {{ level[i] -> hole[i] }}
               }}
               probe x = tank[1].q
             }}"
        )
    };
    let (stepper, x, _) = taken(1e-9, &valves(1));
    // sqrt(q) = 1 - t/2
    assert_eq!(stepper, "radau");
    assert!(x.abs() < 1e-8, "{x}");
    assert_eq!(taken(1e-9, &valves(12)).0, "radau");
    assert_eq!(taken(1e-9, &valves(30)).0, "gonzalez");
}

/// The integral of |cos| has a kink at each zero; the circuit beside it is linear, and no probe makes it less exact.
#[test]
fn kinks_of_what_a_probe_integrates_are_met() {
    let circuit = |probe: &str| {
        format!(
            "model Ring {{
               I:l {{ inertia = 1 H; f0 = 1 A }}
               C:c {{ stiffness = 2500 V/C }}
               1:m -> l, c
               probe i = m.f
               {probe}
             }}"
        )
    };
    let compiled = text(&circuit(
        "probe charge = integral(abs(m.f), 0 C)
         probe late = integral(if t > 0.33333 s then m.f else 0 A, 0 C)
         probe up = integral(if m.f > 0.6 A then 1 else 0, 0 s)",
    ));
    assert_eq!(compiled.scene().clusters[0].step.name, "collocation8");
    let mut sim = start(&compiled, Steps::tolerance(1e-9));
    finish(&mut sim, 2.0);
    let (w, turned) = (50.0f64, 100.0f64);
    let half_turns = (turned / std::f64::consts::PI).round();
    let sign = if half_turns % 2.0 == 0.0 { 1.0 } else { -1.0 };
    close(probe(&mut sim, "charge"), (2.0 * half_turns + sign * turned.sin()) / w, 1e-8, "charge");
    close(probe(&mut sim, "late"), (turned.sin() - (w * 0.33333).sin()) / w, 1e-8, "late");
    // The current is above 0.6 A for acos(0.6) on both sides of each full turn, of which the sixteenth is not over.
    let up = 32.0 * 0.6f64.acos() + turned - 16.0 * std::f64::consts::TAU;
    close(probe(&mut sim, "up"), up / w, 1e-8, "up");
    close(probe(&mut sim, "i"), turned.cos(), 1e-6, "i");
    assert_eq!(text(&circuit("")).scene().clusters[0].step.name, "exact");
}

/// No step ends within an impact without its events: a few steps a flight, and each contact is met.
#[test]
fn hertz_is_met() {
    let compiled = text(
        "use std.contact
         model Drop {
           Se:weight = 9.81 N
           I:mass = 1 kg
           Hertz:plate(gap = 0.1 m)
           weight -> 1:fall -> mass
           fall -> plate.tip
           probe x = integral(fall.f, 0 m)
         }",
    );
    let mut sim = start(&compiled, Steps::tolerance(1e-6));
    let mut highest = f64::INFINITY;
    for k in 1..=2000 {
        advance(&mut sim, f64::from(k) * 1e-3);
        let x = probe(&mut sim, "x");
        assert!(x < 0.1026, "{x} at {k} ms is through the plate");
        if k > 143 {
            highest = highest.min(x);
        }
    }
    // Nothing is lost: it comes back to where it fell from.
    close(highest, 0.0, 1e-4, "highest");
    let summary = sim.summary();
    let region = &summary.regions[0];
    assert!(summary.passive && region.events == 14 && region.steps < 2500, "{region:?}");
}

/// Thrown up just against a ceiling that it touches for 28 ms: within one step of free flight, which is exact however
/// long.
#[test]
fn a_touch_within_a_step_is_met() {
    for above in [1e-3f64, 1e-5] {
        let v = (2.0 * 9.81 * (0.5 + above)).sqrt();
        let compiled = text(&format!(
            "model Throw {{
               Se:weight = -9.81 N
               I:mass {{ inertia = 1 kg; f0 = {v} m/s }}
               C:ceiling {{ H = (1 kN/m)*max(q - 0.5 m, 0 m)^2/2; q0 = 0 m }}
               weight -> 1:rise -> mass, ceiling
               probe x = ceiling.q
             }}"
        ));
        let mut sim = start(&compiled, Steps::tolerance(1e-8));
        finish(&mut sim, 0.6);
        let region = sim.summary().regions.swap_remove(0);
        assert!(region.events == 2, "{above}: {region:?}");
    }
}

/// A body that stands on the kink of a law, and one that leaves it.
#[test]
fn standing_on_a_kink() {
    for (f0, wanted) in [("0 m/s", 0.0), ("1 m/s", 1.0), ("-1 m/s", -0.1 * (10.0f64).sin())] {
        let compiled = text(&format!(
            "model Stand {{
               I:mass {{ inertia = 1 kg; f0 = {f0} }}
               C:floor {{ H = (100 N/m)*min(q, 0 m)^2/2; q0 = 0 m }}
               1:v -> mass, floor
               probe x = floor.q
             }}"
        ));
        let stop = if f0 == "-1 m/s" { 0.2 } else { 1.0 };
        let wanted = if f0 == "-1 m/s" { -0.1 * (10.0f64 * stop).sin() } else { wanted };
        close(end(&compiled, Steps::tolerance(1e-9), stop, "x"), wanted, 1e-5, f0);
    }
}

const SWING: &str = "model Swing {
  I:mass = 1 kg
  C:spring { stiffness = 100 N/m; q0 = 1 m }
  1:v -> mass, spring
  probe x = spring.q
  probe energy = mass.H + spring.H
  probe way = integral(abs(v.f), 0 m)
}";

/// What is looked at within a step is a step of the method to there, and looking changes no step.
#[test]
fn rows_within_steps() {
    for (method, within) in [("gonzalez", 2e-4), ("rk45", 1e-6), ("dop853", 1e-6)] {
        let compiled = with(Options::new().method(method), SWING);
        let mut blind = start(&compiled, Steps::tolerance(1e-7));
        finish(&mut blind, 5.0);
        let mut seen = start(&compiled, Steps::tolerance(1e-7));
        for k in 1..5000 {
            let t = f64::from(k) * 1e-3;
            advance(&mut seen, t);
            close(probe(&mut seen, "x"), (10.0 * t).cos(), within, &format!("{method}: x at {t}"));
            let (shown, booked) = (probe(&mut seen, "energy"), seen.summary().regions[0].h_final);
            close(booked, shown, 1e-12, &format!("{method}: the ledger at {t}"));
            close(seen.state("spring.q").unwrap_or(f64::NAN), probe(&mut seen, "x"), 0.0, "the state");
        }
        finish(&mut seen, 5.0);
        let (a, b) = (blind.summary(), seen.summary());
        assert_eq!(a.regions[0].h_final.to_bits(), b.regions[0].h_final.to_bits(), "{method}");
        assert_eq!(a.regions[0].steps, b.regions[0].steps, "{method}");
        assert!(a.regions[0].steps < 10_000, "{method}: {} steps", a.regions[0].steps);
    }
}

/// Units don't matter: the same swing with its mass in another place of the scale.
#[test]
fn units_do_not_matter() {
    let scaled = |m: f64| {
        let scene = format!(
            "model Swing {{
               I:mass = {m:e} kg
               C:spring {{ stiffness = {:e} N/m; q0 = 1 m }}
               R:drag = {m:e} N*s/m
               1:v -> mass, spring, drag
               probe x = spring.q
             }}",
            100.0 * m
        );
        let compiled = with(Options::new().method("gonzalez"), &scene);
        let mut sim = compiled.simulate(Steps::tolerance(1e-6)).unwrap_or_else(|e| panic!("{e}"));
        finish(&mut sim, 1.0);
        (probe(&mut sim, "x"), sim.summary().regions[0].steps)
    };
    let (a, b) = (scaled(1.0), scaled(1e-9));
    close(a.0, b.0, 1e-9, "x");
    assert_eq!(a.1, b.1);
}

/// A source that switches at known times, also for less than a step, of a mass that is at rest before.
#[test]
fn switches_in_time_are_met() {
    let compiled = with(
        Options::new().method("gonzalez"),
        "model Pulse {
           Se:push = if t > 0.4321 s then (if t < 0.4322 s then 1 kN else 0 N) else 0 N
           I:mass = 1 kg
           push -> 1:v -> mass
           probe speed = v.f
         }",
    );
    let mut sim = start(&compiled, Steps::tolerance(1e-6));
    finish(&mut sim, 10.0);
    close(probe(&mut sim, "speed"), 0.1, 1e-9, "speed");
    let region = sim.summary().regions.swap_remove(0);
    assert!(region.events == 2 && region.steps < 200, "{region:?}");
}

/// An integral that only a probe reads is watched too: of a speed that grows evenly each step is exact, of its square
/// none is.
#[test]
fn integrals_are_watched() {
    let compiled = with(
        Options::new().method("gonzalez"),
        "model Fall { Se:weight = 1 N  I:mass = 1 kg  weight -> 1:v -> mass  probe s = integral(v.f^2, 0 m^2/s) }",
    );
    close(end(&compiled, Steps::tolerance(1e-8), 3.0, "s"), 9.0, 1e-3, "s");
}

/// At rest until a source jumps, at an instant that a step ends just past: i = u/r (1 - exp(-r t/l)).
#[test]
fn a_jump_is_met_at_rest() {
    let text = "model M {
      Se:u = if t < 1 ms then 0 V else 10 V
      I:l = 4 mH
      R:r = 2 Ohm
      u -> 1:p -> r, l
      probe i = p.f
    }";
    let wanted = 5.0 * (1.0 - (-2f64).exp());
    for method in ["gonzalez", "collocation6", "radau", "rk4", "rk45", "dop853"] {
        for tolerance in [1e-5, 1e-8, 1e-10] {
            let compiled = with(Options::new().method(method), text);
            close(end(&compiled, Steps::tolerance(tolerance), 5e-3, "i"), wanted, 1e3 * tolerance, method);
        }
    }
}

/// Friction that turns over within a thousandth of the speed: a step over the reversal is not taken for a good one. The
/// value is that on which steppers of four kinds agree at tolerances below 1e-10.
#[test]
fn steep_friction_turns_over() {
    let text = "model M {
      Se:F = 3 N * sin(4 Hz * t)
      R:r { e = 0.5 N * tanh(f/(1e-3 m/s)) }
      I:m = 1 kg
      C:k { stiffness = 5 N/m }
      F -> 1:v -> r, m, k
      probe speed = v.f
    }";
    for (method, most) in [
        ("gonzalez", 1e-4),
        ("collocation4", 1e-5),
        ("collocation8", 1e-5),
        ("radau", 1e-5),
        ("rk45", 1e-4),
        ("dop853", 1e-4),
    ] {
        let compiled = with(Options::new().method(method), text);
        close(end(&compiled, Steps::tolerance(1e-6), 2.0, "speed"), 0.37461563, most, method);
    }
}

/// Where there is no state, the energies tell how long a step may be, by every method that takes it.
#[test]
fn energies_without_states() {
    let text = "model M { Se:u = 10 V * sin(t/1 s)  C:c = 1 F  R:r = 1 Ohm  u -> 0:n -> c, r }";
    let lost = 50.0 * (10.0 - 0.5 * 20f64.sin());
    let region = |compiled: &bond::Compiled| {
        let mut sim = start(compiled, Steps::tolerance(1e-8));
        finish(&mut sim, 10.0);
        sim.summary().regions.swap_remove(0)
    };
    let found = region(&with(Options::new(), text));
    close(found.dissipated, lost, 1e-3, "lost");
    close(found.supplied, lost + 50.0 * 10f64.sin().powi(2), 1e-3, "supplied");
    let text = "model M { Sf:u = 1 A * sin(t/1 s)  R:r { e = 3 V/A * f }  u -> r }";
    for method in ["collocation8", "radau", "rk45", "dop853"] {
        let found = region(&with(Options::new().method(method), text));
        close(found.dissipated, 1.5 * (10.0 - 0.5 * 20f64.sin()), 1e-4, method);
    }
}

/// A pulse of a hundredth of the run is not stepped over where there is no state to slow down for.
#[test]
fn a_pulse_without_states() {
    let text = "model M {
      Sf:u = 1 A
      MR:r = 1 Ohm - 1.2 Ohm * exp(-((t - 5 s)/20 ms)^2)
      u -> r
    }";
    let compiled = with(Options::new(), text);
    let mut sim = start(&compiled, Steps::new());
    finish(&mut sim, 10.0);
    let summary = sim.summary();
    assert!(!summary.passive, "{summary:?}");
}

/// A state that grows beyond all numbers ends the run by name, and what was computed stays.
#[test]
fn what_is_not_finite_ends_the_run() {
    for method in ["gonzalez", "rk4", "rk45", "dop853"] {
        let compiled =
            with(Options::new().method(method), "model Grow { state z = 1 { dz = z^2/(1 s) }  probe y = z }");
        let mut sim = start(&compiled, Steps::tolerance(1e-6));
        let error = sim.advance(2.0).expect_err("it goes on beyond infinity").to_string();
        assert!(error.contains("`z`"), "{method}: {error}");
        let (t, z) = (sim.time(), sim.state("z").unwrap_or(f64::NAN));
        assert!(z.is_finite() && z > 100.0, "{method}: z is {z} at {t}");
        assert!(sim.summary().regions.is_empty());
    }
}

/// An input that is set at a row holds from there, though the step that was planned goes further.
#[test]
fn inputs_end_a_planned_step() {
    for method in ["gonzalez", "rk45", "dop853"] {
        let compiled = with(
            Options::new().method(method),
            "model Fed { input push = 0 N  MSe:hand = push  I:mass = 1 kg  hand -> 1:v -> mass  probe speed = v.f }",
        );
        let mut sim = start(&compiled, Steps::tolerance(1e-6));
        advance(&mut sim, 1.0);
        sim.set_input("push", 3.0).unwrap_or_else(|e| panic!("{e}"));
        advance(&mut sim, 1.5);
        close(probe(&mut sim, "speed"), 1.5, 1e-12, "speed");
        sim.set_input("push", 0.0).unwrap_or_else(|e| panic!("{e}"));
        finish(&mut sim, 4.0);
        close(probe(&mut sim, "speed"), 1.5, 1e-12, "speed");
    }
}

/// The longest step is kept to.
#[test]
fn the_longest_step() {
    let compiled = example("pendulum", "Pendulum");
    let count = |steps: Steps| {
        let mut sim = start(&compiled, steps);
        finish(&mut sim, 10.0);
        sim.summary().regions[0].steps
    };
    let free = count(Steps::tolerance(1e-4));
    assert!(free < 1000, "{free}");
    assert!(count(Steps::tolerance(1e-4).longest(1e-3)) >= 20_000);
}

/// The semi-implicit method makes energy and takes it back; the explicit one makes ever more.
#[test]
fn symplectic_euler_keeps_near_its_energy() {
    let run = |method: &str| {
        let compiled = with(Options::new().method(method), SWING);
        let mut sim = start(&compiled, Steps::fixed(1e-3));
        let mut worst: f64 = 0.0;
        for k in 1..=100 {
            advance(&mut sim, f64::from(k));
            worst = worst.max((probe(&mut sim, "energy") / 50.0 - 1.0).abs());
        }
        assert!(!sim.summary().passive);
        worst
    };
    let (kept, grown) = (run("symplectic_euler"), run("euler"));
    assert!(kept < 6e-3 && grown > 100.0, "{kept} and {grown}");
}

/// A square wave: each of its switches is met, by steppers that look at the end of their step, too, and however many
/// there are. A switch of the source comes back from far.
#[test]
fn every_switch_of_a_wave_is_met() {
    let text = "model M {
      Se:u = if sin(2*pi*37 Hz * t) > 0.3 then 24 V else 12 V
      R:r { e = 0.8 Ohm * f + 1e-12 Ohm/A^2 * f^3 }
      I:l = 2 mH
      u -> 1:i -> r, l
      probe current = i.f
    }";
    for method in ["gonzalez", "collocation8", "radau", "rk4", "rk45", "dop853"] {
        let compiled = with(Options::new().method(method), text);
        let mut sim = start(&compiled, Steps::tolerance(1e-6));
        finish(&mut sim, 0.5);
        let (events, current) = (sim.summary().regions[0].events, probe(&mut sim, "current"));
        assert_eq!(events, 38, "{method}");
        close(current, 23.766_320_1, 2e-3, method);
    }
}

/// The same swing with all energies 1e-30 times as large: they are small, but no rounding.
#[test]
fn faint_scenes_are_as_exact() {
    for (size, most) in [(1.0, 2e-5), (1e-30, 1e-3)] {
        let text = format!(
            "model M {{
              C:spring {{ e = {size} N/m * q + {size} N/m^3 * q^3; q0 = 1 m }}
              I:mass = {size} kg
              1:v -> spring, mass
              probe q = spring.q
            }}"
        );
        let compiled = with(Options::new().method("collocation8"), &text);
        close(end(&compiled, Steps::tolerance(1e-6), 10.0, "q"), 0.798_874_77, most, &format!("{size:e}"));
    }
}

/// A driven circuit without a linear element.
const RINGING: &str = "model Ringing {
  Se:src = 1.5 V * sin(2 Hz * t) * exp(-(0.1 Hz) * t) + 0.5 V
  C:cap { H = 0.5*q^2/(1 F) + 0.2 J/C^4 * q^4; q0 = 0.3 C }
  I:ind { H = 0.5*p^2/(1 H) + 0.1 J/Wb^4 * p^4; p0 = 0.2 Wb }
  R:res { e = 0.3 Ohm * f + 0.2 V/A^3 * f^3 }
  R:leak { f = 0.1 S * e + 0.05 A/V^3 * e^3 }
  src -> 1:loop -> ind, res
  loop -> 0:n -> cap, leak
  probe x = cap.q
}";

/// What is looked at within a step is as exact as where steps end: its error is not that of one step across both of the
/// halves that are kept, which is 2^order times theirs.
#[test]
fn rows_are_as_exact_as_step_ends() {
    let methods = [
        ("gonzalez", 1e-7),
        ("collocation4", 1e-9),
        ("collocation6", 1e-10),
        ("collocation8", 1e-10),
        ("collocation10", 1e-10),
        ("collocation12", 1e-10),
        ("radau", 1e-10),
        ("rk45", 1e-10),
        ("dop853", 1e-10),
    ];
    let instants: Vec<f64> = (1..=13).map(|k| f64::from(k) * 0.297).collect();
    let fine = with(Options::new().method("collocation12"), RINGING);
    let mut fine = start(&fine, Steps::fixed(0.01));
    let ringing: Vec<f64> = instants
        .iter()
        .map(|t| {
            advance(&mut fine, *t);
            probe(&mut fine, "x")
        })
        .collect();
    let flights: Vec<f64> = instants.iter().map(|t| ball(*t)).collect();
    for (method, tolerance) in methods {
        for (model, wanted) in [(RINGING, &ringing), (BALL, &flights)] {
            let compiled = with(Options::new().method(method), model);
            let mut sim = start(&compiled, Steps::tolerance(tolerance));
            let (mut on_way, mut ends) = (0.0f64, 0.0f64);
            for (t, x) in instants.iter().zip(wanted) {
                advance(&mut sim, *t);
                on_way = on_way.max((probe(&mut sim, "x") - x).abs());
                ends = ends.max((end(&compiled, Steps::tolerance(tolerance), *t, "x") - x).abs());
            }
            assert!(on_way <= 5.0 * ends.max(1e-14), "{method}: {on_way:e} at rows, {ends:e} where runs end");
        }
    }
}

/// The ledger at a row beyond the middle of a step is that of both steps to it; and a run that goes on from there has
/// the same bits.
#[test]
fn the_ledger_at_a_row_closes() {
    let compiled = with(Options::new().method("collocation8"), RINGING);
    let mut sim = start(&compiled, Steps::tolerance(1e-8));
    for k in 1..40 {
        advance(&mut sim, f64::from(k) * 0.0993);
        let region = sim.summary().regions.swap_remove(0);
        let (q, p) = (sim.state("cap.q").unwrap_or(f64::NAN), sim.state("ind.p").unwrap_or(f64::NAN));
        let h = 0.5 * q * q + 0.2 * q.powi(4) + 0.5 * p * p + 0.1 * p.powi(4);
        close(region.h_final, h, 1e-14, "what is held");
        close(region.h_final - region.h_initial, region.supplied - region.dissipated, 1e-12, "the balance");
        let bytes = sim.save().unwrap_or_else(|e| panic!("{e}"));
        let resumed = bond::Simulation::resume(bond::internal::Code::default().backend(), compiled.scene(), &bytes, []);
        let again = resumed.unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((again.state("cap.q"), again.summary()), (sim.state("cap.q"), sim.summary()));
    }
}

/// A jump that has no solution at rest: what was computed stays, to the last good step, and accuses nobody.
#[test]
fn a_run_that_fails_ends_where_it_got_to() {
    let compiled = text(
        "model Slide {
  I:m { inertia = 1 kg; f0 = 1 m/s }
  R:mu { e = (2 N)*sign(f) }
  R:b = 0.1 N*s/m
  1:v -> m, mu, b
  probe w = m.f
}",
    );
    let mut sim = start(&compiled, Steps::tolerance(1e-6));
    sim.advance(1.0).expect_err("sign has no value between -1 and 1");
    // m dv/dt = -2 N - 0.1 v
    let rest = 10.0 * (1.0f64 + 0.05).ln();
    assert!((sim.time() - rest).abs() < 1e-5, "at {} s", sim.time());
    assert!(probe(&mut sim, "w").abs() < 1e-5);
    let summary = sim.summary();
    assert!(summary.passive, "{:?}", summary.reasons);
    let region = &summary.regions[0];
    assert!(region.h_final < 1e-9 && (region.dissipated - 0.5).abs() < 1e-9, "{region:?}");
    // Steps across the jump have no solution, and each of them counts.
    assert!(region.rejected >= 5, "{region:?}");
}

/// Good steps may be as short beside a run as they need to be, up to 1e10 of them.
#[test]
fn a_long_run_of_short_steps_goes_on() {
    let compiled = with(
        Options::new().method("gonzalez"),
        "model RC { C:c = 1 mF  R:r = 10 Ohm  Se:u = 10 V * sin(314.159 rad/s * t)  u -> 1:i -> c, r  probe x = c.e }",
    );
    let mut sim = compiled.simulate(Steps::tolerance(1e-6).longest(86.4)).unwrap_or_else(|e| panic!("{e}"));
    advance(&mut sim, 10.0);
    assert!(sim.summary().regions[0].steps > 100_000);
}

/// A leg of a converter as a transformer whose ratio switches: its edges are met, by time and by what a computer holds.
#[test]
fn switching_ratios_are_met() {
    // i' = (u - R i)/L with u = +-50 V: exactly, from edge to edge of a triangle from -1 to 1 at 10 kHz.
    let (mut i, mut t) = (0.0f64, 0.0f64);
    let (period, tau) = (1e-4, 1e-3);
    let mut go = |until: f64, u: f64| {
        i = u + (i - u) * (-(until - t) / tau).exp();
        t = until;
    };
    for k in 0..100 {
        // Below 0.3 until it has risen to that, and again once it has come back.
        let rise = period * (0.25 + 0.25 * 0.3);
        let begin = f64::from(k) * period;
        go(begin + rise, 50.0);
        go(begin + period - rise, -50.0);
        go(begin + period, 50.0);
    }
    let duty = ["let duty = 0.3", "sampled every 100 us { state held = 0.3 { next = held } } let duty = held"];
    for duty in duty {
        let compiled = text(&format!(
            "model Leg {{
              {duty}
              let tri = asin(sin(2*pi*10 kHz * t - pi/2))*2/pi
              Se:dc = 100 V
              TF:leg = 1/(if duty > tri then 0.5 else -0.5)
              R:r = 1 Ohm
              I:l = 1 mH
              dc -> leg -> 1:j -> r, l
              probe i = l.f
            }}"
        ));
        for tolerance in [1e-6, 1e-8] {
            let mut sim = start(&compiled, Steps::tolerance(tolerance));
            finish(&mut sim, 0.01);
            close(probe(&mut sim, "i"), i, 30.0 * tolerance.max(1e-6), duty);
            assert!(sim.summary().regions[0].events >= 199, "{duty}: {:?}", sim.summary().regions[0].events);
        }
    }
}

/// A block on a table, pushed ever more, and what counts its way from 0: while dry friction holds it, its speed is
/// rounding and so is the way. Free from 2 s on, it has moved (t - 2 s)^3/3 at 3 s.
#[test]
fn counters_of_what_rests() {
    for counter in ["C:x { H = 0 J }  v -> x  probe way = x.q", "state x = 0 m { dx = v.f }  probe way = x"] {
        let scene = format!(
            "model Block {{
              Se:push = 2 N/s * t
              I:m = 1 kg
              R:dry {{ e = 4 N * min(max(s, -1), 1); f = (s - min(max(s, -1), 1))*1 m/s }}
              push -> 1:v -> m, dry
              {counter}
              simulate {{ stop = 3 s }}
            }}"
        );
        for tolerance in [1e-6, 1e-7, 1e-8, 1e-9] {
            let compiled = with(Options::new().accuracy(Accuracy::Tolerance(tolerance)), &scene);
            let mut sim = start(&compiled, Steps::tolerance(tolerance));
            finish(&mut sim, 3.0);
            close(probe(&mut sim, "way"), 1.0 / 3.0, 1e-5, &format!("{counter} to {tolerance}"));
            assert!(sim.summary().passive, "{counter} to {tolerance}: {:?}", sim.summary().reasons);
        }
    }
}

/// An integral of next to nothing that swings fast is as exact as any: p' = -p, and the integral of p sin(200 t).
#[test]
fn integrals_of_next_to_nothing_are_exact() {
    for speed in [1.0, 1e-9, 1e-18] {
        let compiled = text(&format!(
            "model Small {{
  I:m {{ inertia = 1 kg; f0 = {speed:e} m/s }}
  R:r = 1 N*s/m
  1:v -> m, r
  probe w = integral(m.f*sin(200 rad/s * t), 0 m)
}}"
        ));
        let (rate, stop) = (200.0f64, 3.0f64);
        let (sin, cos) = (rate * stop).sin_cos();
        let wanted = (rate - (-stop).exp() * (sin + rate * cos)) / (1.0 + rate * rate);
        let found = end(&compiled, Steps::tolerance(1e-6), stop, "w") / speed;
        close(found, wanted, 1e-5 / rate, &format!("from {speed:e} m/s"));
    }
}
