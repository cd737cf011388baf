//! Exponential laws and resistors far shorter than a step: passive steppers go on at any step, with the balance kept.
//! So does the exact one, whatever the time constants of a line.

use crate::common::{cases, close, finish, probe, start, with};
use bond::internal::OptionsInternals;
use bond::{Options, Steps, Summary};
use bond_compiler::discretise::Accuracy;
use proptest::prelude::*;

const METHODS: [&str; 5] = ["gonzalez", "collocation4", "collocation8", "collocation12", "radau"];

fn ran(text: &str, method: &str, step: f64, end: f64) -> Summary {
    ran_by(Options::new(), text, method, step, end)
}

/// The same, where the compiler is told the step.
fn told(text: &str, method: &str, step: f64, end: f64) -> Summary {
    ran_by(Options::new().step(step), text, method, step, end)
}

fn ran_by(options: Options, text: &str, method: &str, step: f64, end: f64) -> Summary {
    let compiled = with(options.method(method), text);
    let mut sim = start(&compiled, Steps::fixed(step));
    sim.finish(end).unwrap_or_else(|e| panic!("{method}, steps of {step:e} s: {e}\n{text}"));
    sim.summary()
}

fn assert_passive(text: &str, method: &str, step: f64, end: f64) {
    let summary = told(text, method, step, end);
    // A voltage of many thermal ones is known to its rounding, and what flows to as many times that.
    assert!(summary.worst_step <= 1e-11, "{method}, {step:e} s: off by {:e}\n{text}", summary.worst_step);
    let gave = summary.reasons.iter().find(|why| why.contains("gave"));
    assert!(gave.is_none(), "{method}, {step:e} s: {gave:?}\n{text}");
}

/// A junction diode.
fn diode(name: &str, saturation: f64, thermal: f64) -> String {
    format!("R:{name} {{ f = ({saturation:e} A)*(exp(e/({thermal} V)) - 1) }}")
}

/// Between a source and a load: a rectifier with a choke, a clipper, a rectifier without storages of its own, two
/// diodes one after the other.
fn circuit(kind: u8, [volts, rate]: [f64; 2], [r, l, c, c2, load]: [f64; 5], diodes: [&str; 2]) -> String {
    let [d, d2] = diodes;
    let rest = match kind {
        0 => format!(
            "I:l = {l:e} H  C:c = {c:e} F  C:c2 = {c2:e} F  {d}  R:load = {load:e} Ohm
  s -> 1:m -> r, l
  m -> 0:n -> c
  n -> 1:dd -> d
  dd -> 0:o -> c2, load"
        ),
        1 => format!(
            "I:l = {l:e} H  C:c {{ compliance = {c:e} F; q0 = {:e} C }}  {d}
  R:d2 {{ f = (1e-9 A)*sinh(e/(0.05 V)) }}
  s -> 1:m -> r, l
  m -> 0:n -> c, d, d2",
            0.3 * c
        ),
        2 => format!(
            "C:c = {c:e} F  {d}  R:load = {load:e} Ohm
  s -> 1:m -> r, d
  m -> 0:n -> c, load"
        ),
        _ => format!(
            "C:c = {c:e} F  C:c2 = {c2:e} F  C:c3 = {:e} F  {d}  {d2}  R:load = {load:e} Ohm
  s -> 1:m -> r
  m -> 0:n -> c
  n -> 1:dd -> d
  dd -> 0:o -> c2
  o -> 1:de -> d2
  de -> 0:p -> c3, load",
            2.0 * c2
        ),
    };
    format!("model M {{\n  Se:s = ({volts:e} V)*sin(({rate:e} rad/s)*t)  R:r = {r:e} Ohm\n  {rest}\n}}")
}

/// Ten to the power of something.
fn decades(from: f64, to: f64) -> impl Strategy<Value = f64> {
    (from..to).prop_map(|x| 10f64.powf(x))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(60), ..ProptestConfig::default() })]

    /// From steps that follow the source to a few a period, and some of many thermal voltages.
    #[test]
    fn diodes_take_any_step(
        kind in 0u8..4,
        source in (decades(0.0, 2.5), decades(0.0, 3.0)),
        parts in (decades(-2.0, 2.0), decades(-4.0, 0.0), decades(-6.0, -1.0), decades(-6.0, -1.0), decades(0.0, 4.0)),
        laws in (decades(-14.0, -6.0), decades(-14.0, -6.0), prop::sample::select(vec![0.025, 0.05, 0.1])),
        method in prop::sample::select(METHODS.to_vec()),
        steps in prop::sample::select(vec![7.0, 23.0, 60.0, 111.0, 300.0, 1000.0]),
    ) {
        let (d, d2) = (diode("d", laws.0, laws.2), diode("d2", laws.1, 0.05));
        let parts = [parts.0, parts.1, parts.2, parts.3, parts.4];
        let text = circuit(kind, [source.0, source.1], parts, [&d, &d2]);
        let end = 20.0 / source.1;
        assert_passive(&text, method, end / steps, end);
    }
}

/// What a diode and a resistor make of a battery, where all has come to rest: `V = R i + Vt log(1 + i/Is)`.
#[test]
fn a_diode_settles_at_its_working_point() {
    for (volts, ohms) in [(0.3f64, 100.0), (5.0, 1.0), (-7.0, 10.0), (300.0, 0.01)] {
        let text = format!(
            "model M {{
  Se:s = {volts} V
  R:r = {ohms} Ohm
  {}
  C:c = 1e-5 F
  s -> 1:m -> r
  m -> 0:n -> c, d
  probe v = c.e
}}",
            diode("d", 1e-12, 0.025)
        );
        // In the current, from both sides.
        let voltage = |i: f64| 0.025 * (i / 1e-12).ln_1p();
        let (mut low, mut high) = (-1e-12, (volts / ohms).max(0.0));
        for _ in 0..2000 {
            let i = 0.5 * (low + high);
            *(if voltage(i) + ohms * i < volts { &mut low } else { &mut high }) = i;
        }
        let wanted = if volts < 0.0 { volts + ohms * 1e-12 } else { volts - ohms * low };
        // Radau's method damps at any step, the others where steps are short.
        let settled = 60.0 * ohms * 1e-5;
        let ways =
            [("radau", Steps::fixed(settled)), ("radau", Steps::tolerance(1e-6)), ("gonzalez", Steps::tolerance(1e-6))];
        for (method, steps) in ways {
            let compiled = with(Options::new().method(method), &text);
            let mut sim = start(&compiled, steps);
            finish(&mut sim, 10.0 * settled);
            let v = probe(&mut sim, "v");
            let off = (v - wanted).abs() / volts.abs().max(1.0);
            assert!(off <= 1e-6, "{volts} V, {ohms} Ohm, {method}: {v} and {wanted}");
        }
    }
}

/// A capacitor on a source over next to no resistance, over steps of up to 1e9 times R C: it follows the source by
/// R C w, and each step balances.
#[test]
fn tight_resistors_keep_the_balance() {
    for law in ["C:c = 1.5e-6 F", "C:c { e = (6.9e5 V/C)*q + (1e12 V/C^3)*q^3 }"] {
        for ohms in [1e-6, 1e-4, 1e-2, 1.0] {
            let text = format!(
                "model M {{
  Se:s = (83 V)*sin((40 rad/s)*t)
  R:r = {ohms:e} Ohm
  {law}
  R:load = 100 Ohm
  s -> 1:m -> r
  m -> 0:n -> c, load
  simulate {{ stop = 0.5 s }}
}}"
            );
            for method in METHODS.into_iter().filter(|m| *m != "radau") {
                for step in [1e-5, 1e-3, 0.01, 0.1] {
                    let mut summaries = vec![ran(&text, method, step, 0.5)];
                    // Whoever tells the step has it only where the step is long.
                    summaries.extend((step >= 50.0 * ohms * 1.5e-6).then(|| told(&text, method, step, 0.5)));
                    for summary in summaries {
                        let what = format!("{law}, {ohms:e} Ohm, {method}, {step:e} s");
                        assert!(summary.worst_step <= 1e-12, "{what}: off by {:e}", summary.worst_step);
                        assert!(summary.total <= 1e-12, "{what}: {:e} in all", summary.total);
                        assert_eq!(summary.reasons, Vec::<String>::new(), "{what}");
                    }
                }
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(60), ..ProptestConfig::default() })]

    /// Lines whose time constants are 1e-16 of a step to many of it, driven by what moves, dies away, or follows them.
    #[test]
    fn exact_steps_balance_at_any_time_constant(
        source in 0u8..3,
        drive in (decades(-1.0, 2.5), decades(-1.0, 3.0)),
        cells in prop::collection::vec((decades(-6.0, 3.0), decades(-9.0, -3.0), 0u8..3), 1..4),
        steps in prop::sample::select(vec![5.0, 30.0, 1000.0]),
    ) {
        let (volts, rate) = drive;
        let source = match source {
            0 => format!("({volts:e} V)*sin(({rate:e} rad/s)*t)"),
            1 => format!("({volts:e} V)*exp(-({rate:e} rad/s)*t)"),
            _ => format!("{volts:e} V - 0.5*c0.e"),
        };
        let mut text = format!("model M {{\n  Se:s = {source}\n");
        let mut last = "s".to_string();
        for (k, (ohms, farads, kind)) in cells.iter().enumerate() {
            text += &format!("  R:r{k} = {ohms:e} Ohm  C:c{k} {{ compliance = {farads:e} F; q0 = {:e} C }}\n", 0.3 * farads);
            let (coil, load) = (*kind == 1, *kind == 2 || k + 1 == cells.len());
            text += &format!("  {last} -> 1:m{k} -> r{k}{}\n", if coil { format!(", l{k}") } else { String::new() });
            text += &format!("  m{k} -> 0:n{k} -> c{k}{}\n", if load { format!(", p{k}") } else { String::new() });
            text += &if coil { format!("  I:l{k} = 1e-3 H\n") } else { String::new() };
            text += &if load { format!("  R:p{k} = 50 Ohm\n") } else { String::new() };
            last = format!("n{k}");
        }
        text += "}";
        let end = 10.0 / rate;
        let summary = ran(&text, "exact", end / steps, end);
        prop_assert!(summary.worst_step <= 1e-13, "off by {:e}\n{text}", summary.worst_step);
        prop_assert!(summary.total <= 1e-12, "{:e} in all\n{text}", summary.total);
        prop_assert!(summary.reasons.is_empty(), "{:?}\n{text}", summary.reasons);
    }
}

/// Two masses that slide on each other as good as together: what one loses the other one gains, to the last digit.
#[test]
fn tight_dampers_keep_momentum() {
    let text = "model M {
  I:a { inertia = 1 kg; p0 = 3 N*s }
  I:b = 2 kg
  C:k { e = (100 N/m)*q + (1e4 N/m^3)*q^3 }
  R:oil = 1e9 N*s/m
  1:va -> a
  1:vb -> b, k
  va -> 0:d -> vb
  d -> oil
  probe v = va.f
  probe w = vb.f
  simulate { stop = 1 s }
}";
    for method in METHODS.into_iter().filter(|m| *m != "radau") {
        for step in [1e-4, 1e-2] {
            let compiled = with(Options::new().method(method), text);
            let mut sim = start(&compiled, Steps::fixed(step));
            finish(&mut sim, 1.0);
            let summary = sim.summary();
            assert!(summary.worst_step <= 1e-13, "{method}, {step:e} s: off by {:e}", summary.worst_step);
            assert_eq!(summary.reasons, Vec::<String>::new(), "{method}, {step:e} s");
        }
    }
}

/// A resistor whose law is not linear beside one that is, in a loop: once the circuit has settled, what is left of the
/// current is the rounding of the voltages.
#[test]
fn loops_of_resistors_settle() {
    let laws = [
        "x + 0.5*abs(x)",
        "x + 0.2*min(max(x/0.1, -1), 1)",
        "x + 0.5*tanh(x)",
        "x + 0.5*x^3",
        "x*abs(x)",
        "sinh(x)",
        "0.1*exp(x/0.1) - 0.1",
        "if x > 0 then 2.5*x else 0.1*x",
    ];
    for law in laws {
        for (given, ohms, size) in [(2.0, 1.0, 1.0), (0.3, 0.644, 1.5), (25.0, 0.2, 7.0)] {
            let end = 70.0 * size * (ohms + 1.5);
            let circuits = [
                format!(
                    "let law(x) = {law}
model M {{ Se:u = {given} V  R:line = {ohms} Ohm  C:c = {size} F  R:d {{ e = (1 V)*law(f/(1 A)) }}  u -> 1:m -> line, d, c }}"
                ),
                format!(
                    "let law(x) = {law}
model M {{ Sf:u = {given} A  R:line = {ohms} Ohm  I:l = {size} H  R:d {{ f = (1 A)*law(e/(1 V)) }}  u -> 0:m -> line, d, l }}"
                ),
            ];
            for text in circuits {
                let compiled = with(Options::new(), &text);
                let mut sim = start(&compiled, Steps::new());
                sim.finish(end).unwrap_or_else(|e| panic!("{e}\n{text}"));
                let summary = sim.summary();
                assert!(summary.passive, "{:?}\n{text}", summary.reasons);
                let region = &summary.regions[0];
                let each = region.newton_iterations as f64 / region.steps as f64;
                assert!(each < 25.0, "{each} iterations a step\n{text}");
            }
        }
    }
}

/// Two capacitors and a diode that is given far more than it ever keeps: what moves within 1e-60 s at the start is
/// seen, and the rest follows the closed form, `exp(-v/Vt) = 1 - (1 - exp(-v0/Vt)) exp(-k t)`.
#[test]
fn a_start_far_from_rest() {
    let (c1, c2, vt, is) = (0.05, 0.2, 0.2, 1e-5);
    let k = is * (1.0 / c1 + 1.0 / c2) / vt;
    for v0 in [2.0, 8.0, 12.0, 20.0, 30.0] {
        let text = format!(
            "model Far {{
              C:a {{ compliance = {c1} F; e0 = {v0} V }}
              C:b = {c2} F
              R:d {{ f = {is} A * (exp(e/({vt} V)) - 1) }}
              0:n -> a
              n -> 1:i -> d, b
              probe q = a.q
              simulate {{ stop = 1 s }}
            }}"
        );
        let y = 1.0 - (1.0 - f64::exp(-v0 / vt)) * f64::exp(-k);
        let wanted = (-vt * y.ln() + c1 * v0 / c2) / (1.0 / c1 + 1.0 / c2);
        let tried = [(None, 1e-6), (None, 1e-3), (None, 1e-8), (Some("gonzalez"), 1e-6), (Some("collocation6"), 1e-6)];
        for (method, tolerance) in tried {
            let options = Options::new().accuracy(Accuracy::Tolerance(tolerance));
            let compiled = with(method.iter().fold(options, |o, m| o.method(*m)), &text);
            let mut sim = start(&compiled, Steps::tolerance(tolerance));
            finish(&mut sim, 1.0);
            let what = format!("{v0} V at {tolerance:e}, {method:?}");
            close(probe(&mut sim, "q") / wanted, 1.0, (10.0 * tolerance).min(1e-3), &what);
            assert!(sim.summary().passive, "{what}: {:?}", sim.summary().reasons);
        }
    }
}

/// The same from rest, where no state has a size: a source beside a diode and an empty capacitor.
#[test]
fn a_source_far_from_rest() {
    let text = "model Charged {
      Se:u = 12 V
      R:d { f = 1e-12 A * (exp(e/(25 mV)) - 1) }
      C:c = 1 uF
      u -> 1:i -> d, c
      probe v = c.e
      simulate { stop = 1 s }
    }";
    // exp(-w/Vt) = 1 - exp(-k t) for w = u - v, from w = u on.
    let wanted = 12.0 + 0.025 * (-f64::exp_m1(-1e-12 / (1e-6 * 0.025))).ln();
    for tolerance in [1e-2, 1e-3, 1e-4, 1e-6] {
        let options = Options::new().accuracy(Accuracy::Tolerance(tolerance));
        let compiled = with(options, text);
        let mut sim = start(&compiled, Steps::tolerance(tolerance));
        finish(&mut sim, 1.0);
        close(probe(&mut sim, "v") / wanted, 1.0, (10.0 * tolerance).min(1e-3), &format!("{tolerance:e}"));
    }
}

/// The same where the source jumps within the run: whatever ends just before that is seen from just past it. A jump
/// that no number has digits for is refused.
#[test]
fn a_jump_far_from_rest() {
    let jump = |volts: f64| {
        format!(
            "model Jump {{
              Se:u = if t > 1 ms then {volts} V else 0 V
              R:d {{ f = 1e-12 A * (exp(e/(25 mV)) - 1) }}
              C:c = 1 uF
              u -> 1:i -> d, c
              probe v = c.e
              simulate {{ stop = 3 ms }}
            }}"
        )
    };
    let options = [None, Some(1e-3), Some(1e-6)].map(|tolerance| {
        let options = tolerance.map_or(Options::new(), |x| Options::new().accuracy(Accuracy::Tolerance(x)));
        (options, tolerance.map_or(Steps::new(), Steps::tolerance))
    });
    for (options, steps) in options {
        for volts in [2.0, 3.0, 12.0, 16.0] {
            let compiled = with(options.clone(), &jump(volts));
            let mut sim = start(&compiled, steps);
            finish(&mut sim, 3e-3);
            // exp(-w/Vt) = 1 - exp(-k t) for w = u - v, from w = u on, where that is far.
            let wanted = volts + 0.025 * (-f64::exp_m1(-1e-12 * 2e-3 / (1e-6 * 0.025))).ln();
            close(probe(&mut sim, "v") / wanted, 1.0, 1e-3, &format!("{volts} V"));
            assert!(sim.summary().passive, "{:?}", sim.summary().reasons);
        }
        let compiled = with(options, &jump(30.0));
        let mut sim = start(&compiled, steps);
        let error = sim.finish(3e-3).expect_err("exp(1200) is no number").to_string();
        assert!(error.contains("a law moves it at once there"), "{error}");
    }
}

/// At the far end of a line of diodes next to nothing arrives, and less than a number has digits for: that is not
/// iterated.
#[test]
fn a_long_line_of_diodes() {
    let text = "model Line {
      Se:u = 1 V * sin(t * 1 Hz)
      for i in 1..800 {
        R:r[i] = 1 Ohm  C:c[i] = 1 mF  R:d[i] { f = 1 pA * (exp(e/(25 mV)) - 1) }
        1:j[i] -> r[i], 0:k[i]
        k[i] -> c[i], d[i]
      }
      u -> j[1]
      for i in 1..799 { k[i] -> j[i+1] }
      probe a = c[1].e
    }";
    let summary = ran(text, "gonzalez", 1e-3, 0.01);
    let region = &summary.regions[0];
    let (steps, iterations) = (region.steps, region.newton_iterations);
    assert!(iterations <= 4 * steps && steps == 10, "{steps} steps, {iterations} iterations");
}

/// How long steps are is told by who runs, not by the model alone.
#[test]
fn tight_resistors_are_found_for_the_steps_that_are_asked_for() {
    let text = "model M {
  Se:u = 12 V  R:r = 1 uOhm  R:l = 10 Ohm
  C:c { H = 0.5*(1e3 V/C)*q^2 + 0.25*(1e6 V/C^3)*q^4 }
  u -> 1:s -> r
  s -> 0:p -> c, l
  simulate { stop = 1 us }
}";
    for options in [Options::new().step(1.0), Options::new().stop(100.0)] {
        let compiled = with(options.method("gonzalez"), text);
        let mut sim = start(&compiled, Steps::fixed(1.0));
        finish(&mut sim, 100.0);
        let summary = sim.summary();
        assert!(summary.worst_step <= 1e-13, "off by {:e}", summary.worst_step);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(60), ..ProptestConfig::default() })]

    /// Dry friction as a steep curve that saturates, over steps that know nothing of its width: updates go from one
    /// side of it to the other. Each step has its solution, and finds it.
    #[test]
    fn steep_friction_takes_any_step(
        bodies in (decades(-2.0, 1.0), decades(-1.0, 1.0), any::<bool>()),
        spring in (decades(0.0, 4.0), 0.01..1.0),
        friction in (decades(-1.0, 2.0), decades(-6.0, -2.0), 0usize..4),
        push in (decades(-1.0, 2.3), 0usize..3),
        step in prop::sample::select(vec![1e-3, 5e-3, 2e-2]),
    ) {
        let (mass, ratio, two) = bodies;
        let law = |force: f64| {
            let shape = ["tanh(x)", "x/sqrt(x^2 + 1)", "0.6*atan(x)", "tanh(x) + 1e-3*x"][friction.2];
            let shape = shape.replace('x', &format!("(f/({:e} m/s))", friction.1));
            format!("{{ e = ({force:e} N)*({shape}) }}")
        };
        let wave = ["0", "1", "sin((10 rad/s)*t)"][push.1];
        let head = format!(
            "I:m = {mass:e} kg  C:k {{ stiffness = {:e} N/m; q0 = {} m }}  R:fr {}  Se:push = ({:e} N)*{wave}",
            spring.0, spring.1, law(friction.0), push.0
        );
        let rest = match two {
            true => format!(
                "I:m2 = {:e} kg  R:fr2 {}
  push -> 1:v -> m, fr
  v -> 0:s -> 1:rel -> k
  s -> 1:v2 -> m2, fr2",
                mass * ratio, law(0.3 * friction.0)
            ),
            false => "push -> 1:v -> m, k, fr".into(),
        };
        let summary = ran(&format!("model M {{\n  {head}\n  {rest}\n}}"), "gonzalez", step, 2.0);
        prop_assert!(summary.passive, "{:?}", summary.reasons);
    }
}

/// Two bodies that a spring throws apart, and that come to stick one after the other: each update that is made for the
/// one takes the other across its friction.
#[test]
fn bodies_come_to_stick_one_after_the_other() {
    let friction = |force: f64| format!("{{ e = ({force:e} N)*tanh(f/(2.595143363601363e-6 m/s)) }}");
    let text = format!(
        "model M {{
  I:m = 1.1744418471609683e-2 kg  I:m2 = 2.2036492476278192e-2 kg
  C:k {{ stiffness = 6.766555360491171e1 N/m; q0 = 0.9915229095513435 m }}
  R:fr {}  R:fr2 {}
  1:v -> m, fr
  v -> 0:s -> k
  s -> 1:v2 -> m2, fr2
}}",
        friction(11.867352274751266),
        friction(3.5602056824253796)
    );
    assert!(ran(&text, "gonzalez", 0.02, 2.0).passive);
}

/// What is left of an unknown at the start may be the rounding of what it is a difference of.
#[test]
fn steep_loops_find_their_start() {
    let text = "model M {
  Se:src = 0.612 V  R:b0 = 45 Ohm  R:b1 = 832 Ohm  R:b2 = 4.6 Ohm  I:l = 0.128 H
  R:a0 { e = 16.5 V * tanh(f/(0.981 mA)) + 1.72 Ohm * f }
  R:a1 { e = 16.5 V * tanh(f/(0.981 mA)) + 4.45 Ohm * f }
  R:a2 { e = 16.5 V * tanh(f/(0.981 mA)) + 1.31 Ohm * f }
  src -> 1:s0 -> a0
  s0 -> 0:p0 -> b0
  p0 -> 1:s1 -> a1
  s1 -> 0:p1 -> b1
  p1 -> 1:s2 -> a2
  s2 -> 0:p2 -> b2, l
}";
    let summary = ran(text, "gonzalez", 1e-3, 0.1);
    assert!(summary.passive, "{:?}", summary.reasons);
}

/// A law that is run backwards, as a diode's by the current that is pushed through it, is solved along its exponential
/// however far that jumps, and near rest to the last digit.
#[test]
fn a_diode_takes_what_current_it_is_given() {
    let model = |current: &str| {
        format!(
            "model A {{
               Sf:f = {current}
               R:d {{ f = (1e-12 A)*(exp(e/(25 mV)) - 1) }}
               f -> d
               probe u = d.e
             }}"
        )
    };
    for method in METHODS {
        for amperes in [1e-15, 1e-9, 1.0, 1e6] {
            let compiled =
                with(Options::new().method(method), &model(&format!("if t < 0.1 s then 0 A else {amperes:e} A")));
            let mut sim = start(&compiled, Steps::fixed(0.01));
            finish(&mut sim, 0.2);
            let (u, wanted) = (probe(&mut sim, "u"), 0.025 * f64::ln_1p(amperes / 1e-12));
            assert!((u - wanted).abs() <= 1e-12 * wanted, "{method}, {amperes:e} A: {u} V, not {wanted}");
        }
    }
    // Across a double bar, where the current jumps from nothing at the start.
    let sampled = "model A {
       Se:f = 10 V
       R:rs = 5 Ohm
       f -> 1:i -> rs
       sampled every 0.1 ms { R:d { f = (1e-12 A)*(exp(e/(25 mV)) - 1) } }
       i ||> d
       probe u = d.e
     }";
    let compiled = with(Options::new(), sampled);
    let mut sim = start(&compiled, Steps::fixed(1e-4));
    finish(&mut sim, 0.01);
    let u = probe(&mut sim, "u");
    assert!(((10.0 - u) / 5.0 - 1e-12 * (u / 0.025).exp_m1()).abs() <= 1e-9, "{u} V");
    assert!(sim.summary().passive);
}

/// What dies away through a diode goes to rest: `exp(x) - 1` keeps its digits there.
#[test]
fn what_dies_away_through_a_diode_comes_to_rest() {
    let model = "model A {
       I:coil { inertia = 1 H; f0 = 1 A }
       R:d { f = 1 A * (exp(e/(1 V)) - 1) + 0.01 A/V * e }
       1:v -> coil, d
       probe i = coil.f
     }";
    for tolerance in [1e-6, 1e-9, 1e-12] {
        let compiled = with(Options::new().method("collocation8"), model);
        let mut sim = start(&compiled, Steps::tolerance(tolerance));
        finish(&mut sim, 200.0);
        let (summary, i) = (sim.summary(), probe(&mut sim, "i"));
        assert!(summary.passive && summary.regions[0].steps < 200, "{tolerance:e}: {summary:?}");
        assert!(i.abs() < 1e-15, "{tolerance:e}: {i:e} A");
    }
}

/// Dry friction along its curve goes from one side to the other, however little asks for it.
#[test]
fn friction_turns_where_its_speed_is_given() {
    let law = "R:dry { e = min(max(s, -1), 1) * 1 N; f = (s - min(max(s, -1), 1)) * 1 m/s }";
    let plain = format!("model A {{ Sf:f = 1 m/s * cos(2 rad/s * t)  {law}  f -> dry  probe e = dry.e }}");
    let sampled = format!(
        "model A {{ Sf:f = 1 m/s * cos(2 rad/s * t)  sampled every 5 ms {{ {law} }}  f ||> dry  probe e = dry.e }}"
    );
    for text in [plain, sampled] {
        let compiled = with(Options::new(), &text);
        let mut sim = start(&compiled, Steps::fixed(0.005));
        for k in 1..40 {
            let t = f64::from(k) * 0.125;
            finish(&mut sim, t);
            let (e, wanted) = (probe(&mut sim, "e"), (2.0 * t).cos().signum());
            // The sampled one knows the speed of an interval before.
            if (2.0 * t).cos().abs() > 0.03 {
                assert!(e == wanted, "{e} N at {t} s, not {wanted}\n{text}");
            }
        }
        assert!(sim.summary().passive, "{text}");
    }
}

/// Friction by a logistic, whose exponential is beyond all numbers at any speed that a body has: the same as by `tanh`.
#[test]
fn logistics_are_hyperbolic_tangents() {
    let slides = |law: &str, f0: f64| {
        format!(
            "model Slides {{
               I:m {{ inertia = 1 kg; f0 = {f0} m/s }}
               C:k {{ stiffness = 50 N/m; q0 = 0.2 m }}
               Se:push = 3 N * sin(9 Hz * t)
               R:friction {{ e = {law} }}
               push -> 1:v -> m, k, friction
               probe x = k.q
             }}"
        )
    };
    let tanh = "1 N * tanh(f/(2e-5 m/s))";
    for f0 in [0.0, 1.0, -1.0] {
        let end = |law: &str, tolerance: f64| {
            let options = Options::new().accuracy(bond_compiler::discretise::Accuracy::Tolerance(tolerance));
            let compiled = crate::common::with(options, &slides(law, f0));
            crate::common::end(&compiled, Steps::tolerance(tolerance), 5.0, "x")
        };
        let exact = end(tanh, 1e-9);
        for law in ["1 N * (2/(1 + exp(-f/(1e-5 m/s))) - 1)", "1 N * (1 - 2/(1 + exp(f/(1e-5 m/s))))"] {
            for tolerance in [1e-4, 1e-6, 1e-8] {
                crate::common::close(
                    end(law, tolerance),
                    exact,
                    (20.0 * tolerance).max(1e-3),
                    &format!("{law}, {f0}, {tolerance:e}"),
                );
            }
        }
    }
}

/// Laws in which what is left near 0 is the rounding of a number taken off: what they are asked for there is no more
/// exact than that, and a mass that starts at rest and is pushed moves.
#[test]
fn laws_that_cancel_at_rest() {
    for law in [
        "1.8 m/s * log(1 + e/(1 N))",
        "1.8 m/s * sign(e)*log(1 + abs(e)/(1 N))",
        "2 m/s * sign(e)*(1 - 1/(1 + abs(e)/(1 N)))",
        "3 m/s * sign(e)*(sqrt(abs(e)/(1 N) + 0.01) - 0.1)",
    ] {
        let scene = format!(
            "model Cancels {{
              Se:push = 0.62 N/s * t
              I:m = 1 kg
              R:r {{ f = {law} }}
              push -> 1:w -> m, r
              probe v = m.f
              simulate {{ stop = 1 s }}
            }}"
        );
        let compiled = with(Options::new(), &scene);
        for steps in [Steps::new(), Steps::fixed(1e-2)] {
            let mut sim = start(&compiled, steps);
            finish(&mut sim, 1.0);
            let v = probe(&mut sim, "v");
            assert!(v > 0.1 && v < 0.31 && sim.summary().passive, "{law}: {v}, {:?}", sim.summary().reasons);
        }
    }
}
