//! Whole numbers: `floor`, `ceil`, `round`, `mod`, and the jumps that they make.

use crate::common::{close, end, finish, probe, start, with};
use bond::internal::OptionsInternals;
use bond::{Options, Steps};
use bond_compiler::discretise::Accuracy;

/// A model of nothing but probes.
fn values(probes: &[(&str, f64)], head: &str) {
    let list: String = probes.iter().enumerate().map(|(i, (e, _))| format!("probe p{i} = {e}\n")).collect();
    let compiled = with(Options::new(), &format!("model M {{ {head}\n {list} }}"));
    for (i, (text, value)) in probes.iter().enumerate() {
        close(end(&compiled, Steps::new(), 1.0, &format!("p{i}")), *value, 1e-14, text);
    }
}

#[test]
fn values_are_those_of_their_definitions() {
    let known = [
        ("floor(-1.5)", -2.0),
        ("floor(2)", 2.0),
        ("ceil(-1.5)", -1.0),
        ("ceil(1.2)", 2.0),
        ("round(-1.5)", -1.0),
        ("round(2.5)", 3.0),
        ("mod(7, 3)", 1.0),
        ("mod(-1 s, 3 s)/(1 s)", 2.0),
        ("mod(7 m, -3 m)/(1 m)", -2.0),
        ("floor(1e300)", 1e300),
    ];
    values(&known, "");
    // The same of what moves: z is 1 at the end.
    let moving = [
        ("floor(-1.5*z)", -2.0),
        ("ceil(-1.5*z)", -1.0),
        ("round(2.5*z)", 3.0),
        ("mod(-z, 3)", 2.0),
        ("mod(t, 0.3 s)/(1 s)", 0.1),
        ("floor(floor(2.5*z)/2)", 1.0),
    ];
    values(&moving, "state z = 0 { dz = 1 Hz }");
    // Known before the run, it chooses what is built.
    let built = "model M { Se:u = 1 V  1:v  u -> v
        for i in 1..5 { if mod(i, 2) == 0 { R:r[i] = 1 Ohm  v -> r[i] } else { R:s[i] = 10 Ohm  v -> s[i] } }
        probe i = v.f }";
    close(end(&with(Options::new(), built), Steps::new(), 1.0, "i"), 1.0 / 32.0, 1e-14, "two of 1 Ohm, three of 10");
}

/// A chopper and a ramp into a coil with resistance, by their closed forms at the end of a period.
#[test]
fn jumps_in_time_are_met() {
    let (r, l, period, duty) = (2.0, 1e-3, 50e-6, 0.4);
    let decay = |t: f64| f64::exp(-r * t / l);
    let (mut chopped, mut ramp) = (0.0, 0.0);
    for _ in 0..20 {
        chopped = (24.0 / r - (24.0 / r - chopped) * decay(duty * period)) * decay((1.0 - duty) * period);
        // i' = (24 t/T - r i)/l
        let slope = 24.0 / period / r;
        ramp = (ramp + slope * l / r) * decay(period) + slope * (period - l / r);
    }
    for (source, wanted) in [("if mod(t, T) < 0.4*T then 24 V else 0 V", chopped), ("24 V * mod(t, T)/T", ramp)] {
        let text = format!(
            "model M(T = 50 us) {{ Se:u = {source}  I:l = 1 mH  R:r = 2 Ohm  u -> 1:v -> l, r  probe i = l.f }}"
        );
        for method in ["", "gonzalez", "collocation6", "radau", "rk45", "dop853"] {
            let options = if method.is_empty() { Options::new() } else { Options::new().method(method) };
            let steps = Steps::tolerance(1e-8);
            close(end(&with(options, &text), steps, 20.0 * period, "i"), wanted, 1e-5, &format!("{source}, {method}"));
        }
    }
}

/// What states switch: a flow that grows by 1 at each whole number takes 1 + 1/2 + 1/3 + 1/4 s to come to 4.
#[test]
fn jumps_of_states_are_met() {
    let text = "model M { state z = 0 { dz = 1 Hz * (1 + floor(z)) }  probe x = z }";
    for method in ["gonzalez", "collocation4", "radau", "rk4", "dop853"] {
        let compiled = with(Options::new().method(method), text);
        close(end(&compiled, Steps::tolerance(1e-8), 25.0 / 12.0, "x"), 4.0, 1e-7, method);
    }
}

/// A detent gives its energy back, at any step: H is the antiderivative of a staircase.
#[test]
fn a_staircase_keeps_energy() {
    let text = "model M { I:m { inertia = 1 kg; f0 = 3 m/s }  C:c { e = 1 N * floor(q/(1 m)) }  1:v -> m, c
        probe x = c.q  probe stored = c.H  probe total = c.H + m.H }";
    let compiled = with(Options::new().method("gonzalez"), text);
    for h in [1e-3, 0.03, 1.0] {
        let mut sim = start(&compiled, Steps::fixed(h));
        finish(&mut sim, 10.0);
        let summary = sim.summary();
        assert!(summary.passive && summary.worst_step <= 1e-12, "{h}: {summary:?}");
        let (x, stored) = (probe(&mut sim, "x"), probe(&mut sim, "stored"));
        let n = x.floor();
        close(stored, n * x - n * (n + 1.0) / 2.0, 1e-12, "H");
        close(probe(&mut sim, "total"), 4.5, 1e-12, "all");
    }
}

/// A wall by an encoder of 1 mm: the force is that of the sample's whole millimetres.
#[test]
fn an_encoder_tells_whole_steps() {
    let text = "model M(res = 1 mm) {
        I:m { inertia = 1 kg; f0 = 0.1 m/s }  Se:motor = -force  motor -> 1:v -> m
        let x = integral(v.f, 0 m)
        sampled at 1 kHz { state seen = 0 m { next = res*floor(x/res) } }
        let force = 100 N/m * seen
        probe steps = seen/res  probe off = mod(x, res)/res
    }";
    let compiled = with(Options::new(), text);
    let mut sim = start(&compiled, Steps::new());
    finish(&mut sim, 0.05);
    let (steps, off) = (probe(&mut sim, "steps"), probe(&mut sim, "off"));
    assert!((steps - steps.round()).abs() < 1e-9 && steps >= 4.0 && (0.0..1.0).contains(&off), "{steps}, {off}");
}

/// What stands on a whole number, odd or even, is that number throughout.
#[test]
fn whole_arguments_keep_their_value() {
    let sources = [
        ("floor(u)", 1.0),
        ("mod(floor(t/(0.1 s)), 2)", 0.5),
        ("round(min(t/(0.1 s), 0.5) + 2)", 2.95),
        ("mod(n, 2)", 0.5),
    ];
    for (source, speed) in sources {
        let text = format!(
            "model M {{ input u = 1  sampled every 0.1 s {{ state n = 0 {{ next = n + 1 }} }}
               Se:s = 1 N * {source}  I:m = 1 kg  s -> 1:v -> m  probe speed = v.f }}"
        );
        for method in ["gonzalez", "collocation6", "radau", "rk4", "rk45", "dop853"] {
            let compiled = with(Options::new().method(method), &text);
            close(end(&compiled, Steps::tolerance(1e-8), 1.0, "speed"), speed, 1e-6, &format!("{source}, {method}"));
        }
    }
}

/// A window that closes where the turn ends is met, however narrow: the guard of its condition changes its sign twice,
/// the second time by a jump. Each of 20 pulses of 1 kV and 100 ns leaves 0.1 mV*s in a coil; the same over the last
/// part of each turn of a disk, and over the first part of turns that go backwards.
#[test]
fn windows_at_the_end_of_a_turn() {
    for tolerance in [None, Some(1e-4), Some(1e-9)] {
        let options = || tolerance.map_or(Options::new(), |x| Options::new().accuracy(Accuracy::Tolerance(x)));
        let steps = || tolerance.map_or(Steps::new(), Steps::tolerance);
        let pulses = "model Pulses(d = 100 ns) {
          Se:u = if mod(t, 1 ms) > 1 ms - d then 1 kV else 0
          I:l = 1 mH
          u -> 1:i -> l
          probe flux = l.p
          simulate { stop = 20.5 ms }
        }";
        // A step that ends at the jump itself, to rounding, has passed the window too.
        for pulses in [pulses.to_string(), pulses.replace("mod(t,", "mod(t + 0.3 ms,")] {
            let flux = end(&with(options(), &pulses), steps(), 20.5e-3, "flux");
            close(flux, 2e-3, 1e-9, "pulses at the end of each millisecond");
        }
        let both = "mod(a, 1) < 1e-5 or mod(a, 1) > 1 - 1e-5";
        let windows = [
            (1.0, "mod(a, 1) > 1 - 1e-5", 1e-5),
            (-1.0, "mod(a, 1) < 1e-5", 1e-5),
            (1.0, both, 2e-5),
            (-1.0, both, 2e-5),
        ];
        for (speed, window, kick) in windows {
            let turns = format!(
                "model Turns {{
                  state a = 0.5 {{ da = {speed} Hz }}
                  Se:u = if {window} then 1 N else 0
                  I:m = 1 kg
                  u -> 1:v -> m
                  probe p = m.p
                  simulate {{ stop = 20 s }}
                }}"
            );
            let p = end(&with(options(), &turns), steps(), 20.0, "p");
            close(p, 20.0 * kick, 1e-9, &format!("{window} at {speed} turns a second"));
        }
    }
}
