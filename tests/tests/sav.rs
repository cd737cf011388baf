//! The non-iterative step: its order, its balance, and how far the energy that it keeps is from H.

use crate::common::{close, file, finish, models, probe, start, with};
use bond::internal::{Code, CompiledInternals, SimulationInternals};
use bond::{Compiled, Options, Simulation, Steps, Summary};

/// A circuit whose capacitor and resistor are not linear, driven.
const CIRCUIT: &str = "\
model Circuit(r = 0.4 Ohm, r3 = 0.3 Ohm/A^2, c = 1 F, s = 0.8 V/C^3) {
  Se:u = 1.5 V * cos(2 rad/s * t)
  I:coil = 1 H
  C:cap { H = q^2/(2*c) + s*q^4/4; q0 = 0.2 C }
  R:res { e = r*f + r3*f^3 }
  u -> 1:i -> coil, cap, res
  probe q = cap.q
  probe p = coil.p
}
";

/// A mass on a hardening spring, in a drag that grows with the cube of the speed.
const DRAG: &str = "\
model Drag(k = 1 N/m, k3 = 1 N/m^3, b = 0.3 N*s/m, b3 = 0.5 N*s^3/m^3) {
  C:spring { H = k*q^2/2 + k3*q^4/4; q0 = 1 m }
  I:mass = 1 kg
  R:drag { e = b*f + b3*f^3 }
  1:v -> spring, mass, drag
  probe q = spring.q
  probe p = mass.p
}
";

/// The chain of Fermi, Pasta, Ulam and Tsingou in its first mode.
const CHAIN: &str = "\
model Chain(n = 32, k = 1 N/m, a = 0.25 N/m^2, b = 0.7 N/m^3) {
  for i in 1..n { I:m[i] { inertia = 1 kg; f0 = 0.9 m/s * sin(pi*i/(n+1)) } 1:v[i] }
  for i in 1..n+1 { C:s[i] { H = k*q^2/2 + a*q^3/3 + b*q^4/4 } 0:j[i] }
  for i in 1..n { v[i] -> m[i]; j[i] -> v[i]; v[i] -> j[i+1] }
  for i in 1..n+1 { j[i] -> s[i] }
  Sf:left = 0 m/s
  Sf:right = 0 m/s
  left -> j[1]
  j[n+1] -> right
}
";

fn options() -> Options {
    Options::new().method("sav")
}

fn classic(name: &str) -> Compiled {
    file(&models().join("classics").join(format!("{name}.bond")), options())
}

fn last(compiled: &Compiled, h: f64, stop: f64) -> (Vec<f64>, Summary) {
    let mut sim = start(compiled, Steps::fixed(h));
    finish(&mut sim, stop);
    let values = sim.probes().unwrap_or_else(|e| panic!("{e}")).to_vec();
    (values, sim.summary())
}

/// What the energy that is kept was off H by at most, J.
fn off(summary: &Summary) -> f64 {
    summary.regions[0].modified.expect("it keeps an energy of its own").max_difference
}

#[test]
fn it_has_order_two() {
    let cases = [
        ("pendulum", classic("pendulum"), 2.0, 0.0125),
        ("Henon and Heiles", classic("henon_heiles"), 10.0, 0.05),
        ("Kepler", classic("kepler"), 3.0, 0.00625),
        ("circuit", with(options(), CIRCUIT), 4.0, 0.025),
        ("drag", with(options(), DRAG), 3.0, 0.02),
    ];
    for (name, compiled, stop, h) in cases {
        let runs: Vec<(Vec<f64>, Summary)> = (0..4).map(|k| last(&compiled, h / f64::from(1 << k), stop)).collect();
        let errors: Vec<f64> = runs
            .windows(2)
            .map(|w| w[0].0.iter().zip(&w[1].0).take(2).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max))
            .collect();
        for e in errors.windows(2) {
            let order = (e[0] / e[1]).log2();
            assert!((order - 2.0).abs() <= 0.1, "{name}: order {order} of {errors:?}");
        }
        // What is kept comes nearer to H at least as fast.
        for w in runs.windows(2) {
            assert!(off(&w[0].1) > 3.5 * off(&w[1].1), "{name}: {} to {}", off(&w[0].1), off(&w[1].1));
        }
    }
}

#[test]
fn it_balances_at_any_step_with_one_solution() {
    // At 100 s a step is some fifty periods of each; the energy of a star's field has no lower bound, and lets it go.
    let cases = [
        (classic("pendulum"), 100.0),
        (classic("henon_heiles"), 1.0),
        (with(options(), CIRCUIT), 100.0),
        (with(options(), DRAG), 100.0),
    ];
    for (compiled, most) in cases {
        for h in [0.01, 1.0, most] {
            let (_, summary) = last(&compiled, h, 1000.0 * h);
            let region = &summary.regions[0];
            assert_eq!(region.stepper, "sav");
            assert_eq!((region.steps, region.newton_iterations), (1000, 1000), "h = {h}");
            assert!(summary.worst_step <= 1e-12 && summary.total <= 1e-12, "h = {h}: {}", summary.worst_step);
            assert!(region.passive_stepper && region.resistors.iter().all(|r| r.energy >= 0.0), "h = {h}");
            assert!(region.modified.is_some_and(|m| m.max_difference.is_finite()));
        }
    }
}

#[test]
fn what_it_keeps_does_not_drift_from_the_energy() {
    let compiled = classic("pendulum");
    let (mut sim, mut early) = (start(&compiled, Steps::fixed(0.01)), 0.0);
    for stop in [100.0, 1000.0] {
        finish(&mut sim, stop);
        let summary = sim.summary();
        assert!(summary.passive && summary.worst_step <= 1e-14 && summary.total <= 1e-13, "{}", summary.total);
        if early > 0.0 {
            assert!(off(&summary) <= 1.01 * early, "{} after {early}", off(&summary));
        }
        early = off(&summary);
    }
    let (_, summary) = last(&with(options(), CHAIN), 0.05, 500.0);
    assert!(
        summary.passive && summary.total <= 1e-13 && summary.regions[0].modified.is_some_and(|m| m.relative < 1e-3)
    );
}

/// Relative numbers are beside the largest energy there, however large or small that is.
#[test]
fn relative_numbers_are_beside_the_largest_energy() {
    for scale in [1.0, 1e-9, 1e9] {
        let compiled = with(
            options(),
            &format!(
                "model Swing {{
                   I:m {{ inertia = {scale:e} kg; f0 = 1.5 m/s }}
                   C:g {{ H = {scale:e} J * (1 - cos(q/(1 m))) }}
                   1:v -> m, g
                 }}"
            ),
        );
        let region = last(&compiled, 0.05, 20.0).1.regions.swap_remove(0);
        let modified = region.modified.expect("it keeps an energy of its own");
        assert!((region.h_max / scale - 1.125).abs() < 1e-12, "{region:?}");
        assert!((modified.relative * region.h_max / modified.max_difference - 1.0).abs() < 1e-4, "{region:?}");
    }
}

/// However far what it keeps went from H on the way, a force at rest is what the law says.
#[test]
fn at_rest_forces_are_right() {
    let compiled = classic("levitation");
    let mut sim = start(&compiled, Steps::fixed(5e-4));
    finish(&mut sim, 2.0);
    close(probe(&mut sim, "gap"), 0.008, 1e-9, "the gap");
    close(probe(&mut sim, "current"), 0.7003570517957, 1e-6, "the current");
}

/// What takes the kept energy back to H does not push to and fro where nothing moves.
#[test]
fn it_comes_to_rest() {
    let compiled = with(
        options(),
        "model Rest {
           Se:u = 2 V
           C:c { e = (1 V)*(q/(1 C))^3; q0 = 1 C }
           R:r = 1 Ohm
           I:l = 0.1 H
           u -> 1:m -> r, l, c
           probe q = c.q
         }",
    );
    let mut sim = start(&compiled, Steps::tolerance(1e-6));
    finish(&mut sim, 30.0);
    close(probe(&mut sim, "q"), 2f64.cbrt(), 1e-7, "q");
    let region = sim.summary().regions.swap_remove(0);
    assert!(region.steps < 1000, "{} steps", region.steps);
}

#[test]
fn a_nonlinear_resistor_takes_power() {
    let (_, summary) = last(&with(options(), DRAG), 0.25, 50.0);
    let region = &summary.regions[0];
    assert!(summary.passive && region.dissipated > 0.0);
    // It comes to rest, where H is 0.
    assert!(region.h_final.abs() <= off(&summary) + 1e-6, "{} of {}", region.h_final, off(&summary));
    close(region.h_initial - region.h_final, region.dissipated, 1e-12, "what was lost");
}

#[test]
fn adaptive_steps_meet_what_is_asked_for() {
    for (name, wanted) in [("pendulum", "angle"), ("kepler", "x")] {
        let compiled = classic(name);
        let at = |tolerance: f64| {
            let mut sim = start(&compiled, Steps::tolerance(tolerance));
            finish(&mut sim, 3.0);
            assert!(sim.summary().worst_step <= 1e-12);
            probe(&mut sim, wanted)
        };
        close(at(1e-7), at(1e-10), 1e-3, name);
    }
}

#[test]
fn a_saved_run_goes_on_with_the_same_bits() {
    let compiled = classic("double_pendulum");
    let mut whole = start(&compiled, Steps::fixed(0.01));
    finish(&mut whole, 1.0);
    let bytes = whole.save().unwrap_or_else(|e| panic!("{e}"));
    let resumed = Simulation::resume(Code::default().backend(), compiled.scene(), &bytes, []);
    let mut second = resumed.unwrap_or_else(|e| panic!("{e}"));
    for sim in [&mut whole, &mut second] {
        finish(sim, 2.0);
    }
    assert!(whole.save().ok() == second.save().ok() && whole.summary() == second.summary());
}

#[test]
fn what_it_cannot_take_is_said_by_name() {
    let cases = [
        ("stick_slip", ["`friction` is a curve", "gonzalez"]),
        ("diode_rectifier", ["`diode` contains an exponential", "gonzalez"]),
        ("gas_piston", ["is a port of a field whose laws are not linear", "gonzalez"]),
    ];
    // Nor where there is no loop.
    let diode = "model Diode {
       I:l { inertia = 50 mH; f0 = 5 A }
       C:a = 10 mF
       R:d { f = 1e-9 A * (exp(e/0.025 V) - 1) }
       l -> 0:n -> a, d
     }";
    let Err(errors) = options().compile_text(&bond::Text::new("diode.bond", diode)) else { panic!("it compiles") };
    assert!(errors.to_string().contains("`d` contains an exponential"), "{errors}");
    for (name, words) in cases {
        let path = models().join("classics").join(format!("{name}.bond"));
        let Err(errors) = options().compile_file(&path) else { panic!("{name} compiles") };
        let text = errors.to_string();
        assert!(words.iter().all(|w| text.contains(w)), "{name}: {text}");
    }
}

/// A law that is to be solved for the flow: chords of one step after the other go to and fro about 2.160 V, and their
/// mean is none of it. It is refused by name, and taken where it is written the other way.
#[test]
fn laws_that_run_backwards_are_refused() {
    let circuit = |law: &str| {
        format!(
            "model M {{
              Se:u = 4 V
              R:valve {{ {law} }}
              R:load = 3 Ohm
              C:buffer = 10 mF
              u -> 1:a -> valve
              a -> 0:n -> buffer, load
            }}"
        )
    };
    let compile = |law: &str| Options::new().method("sav").compile_str("m.bond", circuit(law).as_str());
    let Err(errors) = compile("e = 1 Ohm * f + 3 Ohm/A^2 * f^3") else { panic!("it is taken") };
    assert!(errors.list().iter().any(|d| format!("{d:?}").contains("`valve`")), "{errors:?}");
    assert!(compile("f = 0.3 S * e + 0.1 A/V^3 * e^3").is_ok());
}

/// What grows exponentially at what is foretold says nothing of what it comes to: with steps of 10 s the middle of this
/// one lay where cosh is 1e120. It is refused by name, and taken where the growth is that of a power.
#[test]
fn energies_with_exponentials_are_refused() {
    let spring = |law: &str| {
        format!(
            "model M {{
              I:a = 1 kg
              C:s {{ {law}; q0 = 5 m }}
              R:d = 0.1 N*s/m
              1:v -> a, s, d
            }}"
        )
    };
    let compile = |law: &str| Options::new().method("sav").compile_str("m.bond", spring(law).as_str());
    for law in ["H = 1 J * (cosh(q/(1 m)) - 1)", "H = 1 J * (exp(q/(1 m)) - q/(1 m))", "e = 1 N * sinh(q/(1 m))"] {
        let Err(errors) = compile(law) else { panic!("`{law}` is taken") };
        assert!(errors.to_string().contains("`s` contains an exponential"), "{law}: {errors}");
    }
    for law in [
        "H = 1 J/m^4 * q^4",
        "e = 1 N * tanh(q/(1 m))",
        "H = 1 J * (1 - exp(-(q/(1 m))^2))",
        "e = if exp(q/(1 m)) > 3 then 3 N else 1 N",
    ] {
        assert!(compile(law).is_ok(), "{law}");
    }
}

/// The balance is that of what is kept. Where H itself goes beyond all that was given, the run is not passive, whatever
/// it held later; where steps are short it is.
#[test]
fn energy_from_nothing_is_seen() {
    let masses = "model Masses {
      I:a { inertia = 1 kg; p0 = 0.7 N*s }
      I:b { inertia = 3 kg; p0 = -0.2 N*s }
      C:s { H = (1 N/m)*(0.5*q^2 + 0.25/(1 m^2)*q^4); q0 = 1.5 m }
      C:t { H = (0.5 J)*(1 - cos(q/(1 m))); q0 = 2 m }
      C:u = 1 m/N
      1:va -> a, s
      1:vb -> b, t
      va -> 0:x -> vb
      x -> u
      expect passive
    }";
    let compiled = with(options(), masses);
    let (_, near) = last(&compiled, 0.01, 50.0);
    assert!(near.passive, "{:?}", near.reasons);
    let (_, far) = last(&compiled, 10.0, 2000.0);
    let grown = far.regions[0].modified.map_or(0.0, |m| m.relative_energy_excess);
    assert!(grown > 0.1 && far.worst_step <= 1e-12, "{grown} and {}", far.worst_step);
    assert!(
        !far.passive && far.reasons.iter().any(|r| r.contains("above what it had been given")),
        "{:?}",
        far.reasons
    );
}

/// Numbers that are none end the run in the step in which they arise.
#[test]
fn what_overflows_ends_the_run() {
    let compiled = with(
        options(),
        "model M {
          Se:u = 1e150 N * (t/(1 s))^4
          I:a = 1 kg
          C:s { H = 1 J/m^4 * q^4; q0 = 1 m }
          u -> 1:v -> a, s
        }",
    );
    let mut sim = start(&compiled, Steps::fixed(1e3));
    let mut failed = None;
    for k in 1..1000 {
        if let Err(e) = sim.advance(1e3 * f64::from(k)) {
            failed = Some(e.to_string());
            break;
        }
        let summary = sim.summary();
        let sound = |x: f64| x.is_finite();
        assert!(summary.regions.iter().all(|r| {
            sound(r.worst_step) && r.modified.is_none_or(|m| sound(m.max_difference) && sound(m.relative))
        }));
    }
    assert!(failed.is_some_and(|e| e.contains("not a finite number") || e.contains("not finite")), "it goes on");
}

/// A ratio that reads what is solved for stands where it was foretold, and so it does where powers are counted.
#[test]
fn a_source_behind_a_ratio_of_its_own_region() {
    let text = "model G(k = 1 V*s/A) {
      Sf:turbine = 150 rad/s
      MGY:arm = k*coil.f
      R:loss = 2 Ohm
      I:coil { inertia = 1 H; f0 = 10 mA }
      Se:battery = 3 V
      turbine -> arm -> 1:j -> loss, coil
      battery -> j
      probe i = coil.f
    }";
    // d(i)/dt = 148 i + 3
    let wanted = 0.01 * f64::exp(148.0 * 0.02) + 3.0 / 148.0 * f64::exp_m1(148.0 * 0.02);
    let compiled = with(options(), text);
    for (h, tolerance) in [(1e-3, 1e-2), (1e-4, 1e-4)] {
        let mut sim = start(&compiled, Steps::fixed(h));
        finish(&mut sim, 0.02);
        close(probe(&mut sim, "i") / wanted, 1.0, tolerance, &format!("{h:e} s"));
        assert!(sim.summary().worst_step <= 1e-14, "{h:e} s: {:?}", sim.summary().reasons);
    }
}
