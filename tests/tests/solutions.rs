//! Runs against solutions in closed form.

use crate::common::{advance, close, example, finish, probe, start, text, trace, with};
use bond::{Options, Steps};

const OSCILLATOR: &str = "model Oscillator(k = 100 N/m, b = 0.5 N*s/m) {
  I:mass = 1 kg
  C:spring { stiffness = k;  q0 = 1 m }
  R:drag = b
  1:v -> mass, spring, drag
  probe x = spring.q
  probe p = mass.p
}";

/// x and p of the oscillator.
fn oscillator(t: f64) -> (f64, f64) {
    let (a, w) = (0.25, (100.0f64 - 0.0625).sqrt());
    let e = (-a * t).exp();
    (e * ((w * t).cos() + a / w * (w * t).sin()), -e * 100.0 / w * (w * t).sin())
}

#[test]
fn exact_on_the_damped_oscillator() {
    let compiled = text(OSCILLATOR);
    for step in [0.001, 0.01, 0.1, 1.0] {
        let mut sim = start(&compiled, Steps::fixed(step));
        for k in 1..=200 {
            let t = f64::from(k) * 0.1;
            advance(&mut sim, t);
            let (x, p) = oscillator(t);
            let envelope = (-0.25 * t).exp();
            close(probe(&mut sim, "x"), x, 1e-12 * envelope, &format!("x at {t} with steps of {step}"));
            close(probe(&mut sim, "p"), p, 1e-11 * envelope, &format!("p at {t} with steps of {step}"));
        }
    }
}

/// Between two steps, too.
#[test]
fn exact_at_instants_between_steps() {
    let compiled = text(OSCILLATOR);
    let mut sim = start(&compiled, Steps::fixed(0.3));
    for k in 1..=100 {
        let t = f64::from(k) * 0.071;
        advance(&mut sim, t);
        close(probe(&mut sim, "x"), oscillator(t).0, 1e-12, &format!("x at {t}"));
    }
}

/// The implicit midpoint rule, as computed by others.
#[test]
fn gonzalez_is_the_midpoint_rule_where_the_energy_is_quadratic() {
    let compiled = with(Options::new().method("gonzalez"), OSCILLATOR);
    let mut sim = start(&compiled, Steps::fixed(1e-3));
    finish(&mut sim, 10.0);
    close(probe(&mut sim, "x"), 0.068322154122243, 1e-12, "x");
    close(probe(&mut sim, "p"), 0.438308226834454, 1e-12, "p");
}

/// m v' + b v = F(t), m = 2, b = 3.
fn driven(force: &str, solution: impl Fn(f64) -> f64) {
    let compiled = text(&format!(
        "model Driven {{
          Se:force = {force}
          I:mass = 2 kg
          R:drag = 3 N*s/m
          force -> 1:v -> mass, drag
          probe speed = mass.f
        }}"
    ));
    for step in [0.01, 0.1, 0.7] {
        for (t, v) in trace(&compiled, Steps::fixed(step), 0.35, 40, "speed") {
            let wanted = solution(t);
            close(v, wanted, 1e-12 * wanted.abs().max(1.0), &format!("{force}: v at {t} with steps of {step}"));
        }
    }
}

#[test]
fn exact_driven_by_a_constant() {
    driven("6 N", |t| 2.0 * (1.0 - (-1.5 * t).exp()));
}

#[test]
fn exact_driven_by_a_sine() {
    // v = F/(b^2 + m^2 w^2) (b sin - m w cos + m w exp(-b t/m)), w = 5
    let size = 4.0 / (9.0 + 100.0);
    driven("4 N * sin(t*5 rad/s)", |t| {
        size * (3.0 * (5.0 * t).sin() - 10.0 * (5.0 * t).cos() + 10.0 * (-1.5 * t).exp())
    });
}

#[test]
fn exact_driven_by_an_exponential() {
    // v = F/(b - m c) (exp(-c t) - exp(-b t/m)), c = 0.5
    driven("4 N * exp(-t*0.5 Hz)", |t| 2.0 * ((-0.5 * t).exp() - (-1.5 * t).exp()));
}

/// At resonance with the system's own decay the solution has a factor t.
#[test]
fn exact_driven_at_its_own_rate() {
    driven("4 N * exp(-t*1.5 Hz)", |t| 2.0 * t * (-1.5 * t).exp());
}

#[test]
fn exact_driven_by_a_polynomial() {
    // v' + a v = t^2, a = 1.5
    let a: f64 = 1.5;
    driven("2 N/s^2 * t^2", |t| t * t / a - 2.0 * t / a.powi(2) + 2.0 / a.powi(3) * (1.0 - (-a * t).exp()));
}

#[test]
fn exact_driven_by_a_sum() {
    let a: f64 = 1.5;
    driven("2 N/s * t + 4 N * exp(-t*0.5 Hz) - 1 N", |t| {
        (t / a - (1.0 - (-a * t).exp()) / a.powi(2)) + 2.0 * ((-0.5 * t).exp() - (-a * t).exp())
            - (1.0 - (-a * t).exp()) / 3.0
    });
}

/// A quarter car against itself at another step: `exact` has no error to differ by.
#[test]
fn exact_does_not_depend_on_the_step() {
    let compiled = text(
        "model Bumps {
          Sf:road = 0.18 m/s * cos(t*9 rad/s)
          C:tyre { stiffness = 200 kN/m }
          I:wheel = 40 kg
          C:spring { stiffness = 18 kN/m }
          R:shock = 1.2 kN*s/m
          I:body = 320 kg
          road -> 0:patch -> tyre
          patch -> 1:vu -> wheel
          vu -> 0:strut -> 1:rel -> spring, shock
          strut -> 1:vs -> body
          probe v = body.f
        }",
    );
    let coarse = trace(&compiled, Steps::fixed(0.1), 0.1, 50, "v");
    for ((t, a), (_, b)) in coarse.into_iter().zip(trace(&compiled, Steps::fixed(1e-3), 0.1, 50, "v")) {
        close(a, b, 1e-12, &format!("v at {t}"));
    }
}

/// Stiffness ratio 1e12.
#[test]
fn exact_on_a_stiff_system() {
    let compiled = text(
        "model Stiff {
          C:slow { compliance = 1 F;  e0 = 1 V }
          C:fast { compliance = 1e-12 F;  e0 = 2 V }
          R:link = 1 Ohm
          R:leak = 1 Ohm
          0:a -> slow, leak
          a -> 1:m -> link, 0:b
          b -> fast
          probe u = slow.e
          probe w = fast.e
        }",
    );
    // u' = -u - (u - w), 1e-12 w' = u - w: after the fast part w = u + 1e-12 u', u = u1 exp(-l t) with l near 1.
    for (t, u) in trace(&compiled, Steps::fixed(0.1), 0.1, 50, "u") {
        close(u, (1.0 + 1e-12) * (-t).exp(), 3e-12, &format!("u at {t}"));
    }
}

/// The free fall of the pendulum's cousin: the discrete gradient has no error on a constant force.
#[test]
fn gonzalez_has_no_error_on_free_fall() {
    let compiled = with(
        Options::new().method("gonzalez"),
        "model Fall { Se:weight = 9.81 N  I:mass = 1 kg  weight -> 1:v -> mass  probe x = integral(v.f, 0 m) }",
    );
    for (t, x) in trace(&compiled, Steps::fixed(0.01), 0.5, 10, "x") {
        close(x, 4.905 * t * t, 1e-12 * x, &format!("x at {t}"));
    }
}

/// v' = -b v^2/m is solved by v0/(1 + b v0 t/m). The tolerance is for a step; at order 2 its error goes with h^3, and
/// that of the run with h^2.
#[test]
fn adaptive_steps_meet_their_tolerance() {
    let path = crate::common::models().join("elements/R_law.bond");
    let compiled = crate::common::file(&path, Options::new());
    for tolerance in [1e-4, 1e-6, 1e-8] {
        let mut sim = start(&compiled, Steps::tolerance(tolerance).longest(5.0));
        finish(&mut sim, 5.0);
        let v =
            sim.state("drag").or_else(|| sim.state("mass.p")).or_else(|| sim.state("mass")).unwrap_or(f64::NAN) / 2.0;
        close(v, 4.0 / 6.0, 2.0 * tolerance.powf(2.0 / 3.0), &format!("v at a tolerance of {tolerance}"));
        let steps = sim.summary().regions[0].steps;
        assert!(steps < 20_000, "{steps} steps at a tolerance of {tolerance}");
    }
}

/// A dependent mass shows its true force.
#[test]
fn dependent_storages_show_their_true_effort() {
    let compiled = text(
        "model Lever {
          I:left = 3 kg
          C:spring { stiffness = 200 N/m;  q0 = 0.05 m }
          TF:lever = 2.5
          I:right = 0.5 kg
          1:v1 -> left, spring, lever
          lever -> 1:v2 -> right
          probe x = spring.q
          probe force = right.e
          probe ratio = v2.f - 2.5*v1.f
        }",
    );
    let (m, k) = (3.0 + 2.5 * 2.5 * 0.5, 200.0f64);
    let w = (k / m).sqrt();
    let mut sim = start(&compiled, Steps::fixed(0.01));
    for i in 1..=100 {
        let t = f64::from(i) * 0.05;
        advance(&mut sim, t);
        close(probe(&mut sim, "x"), 0.05 * (w * t).cos(), 1e-13, &format!("x at {t}"));
        let acceleration = -2.5 * 0.05 * w * w * (w * t).cos();
        close(probe(&mut sim, "force"), 0.5 * acceleration, 1e-11, &format!("force at {t}"));
        assert_eq!(probe(&mut sim, "ratio"), 0.0);
    }
}

/// A source that switches at a time of its own, between two steps of `exact`.
#[test]
fn sources_that_switch_are_met() {
    let cases = [
        ("Se:u = if t < 0.50037 s then 10 V else 0", 0.861_736_254_043_6),
        ("Se:u = if t > 0.3001 s and t < 0.3041 s then 10 V else 0 V", {
            let charge = |t: f64| 10.0 * (1.0 - (-(1.0 - t) / 5.0f64).exp());
            charge(0.3001) - charge(0.3041)
        }),
    ];
    for (source, exact) in cases {
        let compiled = crate::common::text(&format!(
            "model M {{ {source}  R:r = 1 Ohm  I:coil = 5 H  u -> 1:i -> r, coil  probe x = coil.f }}"
        ));
        for h in [0.1, 0.01, 0.0037] {
            let mut sim = compiled.simulate(bond::Steps::fixed(h)).unwrap_or_else(|e| panic!("{e}"));
            sim.finish(1.0).unwrap_or_else(|e| panic!("{e}"));
            let x = sim.probe("x").unwrap_or(f64::NAN);
            // A pulse shorter than a sixteenth of a step may be missed.
            if h < 0.06 {
                crate::common::close(x, exact, 1e-11, &format!("{source} at {h}"));
            }
            assert!(sim.summary().worst_step <= 1e-12);
        }
    }
}

/// What the sources of a sampled region put in may come out.
#[test]
fn a_sampled_source_is_let_through() {
    let compiled = crate::common::text(
        "model M { C:m = 1 F  R:b = 1 Ohm  0:v -> m, b  sampled at 100 Hz { Sf:s = 3 A }  s ||> v  probe e = m.e }",
    );
    let mut sim = compiled.simulate(bond::Steps::new()).unwrap_or_else(|e| panic!("{e}"));
    sim.finish(2.0).unwrap_or_else(|e| panic!("{e}"));
    crate::common::close(sim.probe("e").unwrap_or(f64::NAN), 3.0 * (1.0 - (-2.0f64).exp()), 1e-9, "a held flow");
}

/// Resistors whose value reads signals run in either causality.
#[test]
fn modulated_resistors_run_either_way() {
    for (value, exact) in [("1 Ohm + 1 Ohm/s * t", 1.0), ("1 Ohm + 1 Ohm/V^2 * cc.e^2", 1.574_357_12)] {
        let compiled = crate::common::text(&format!(
            "model M {{ C:cc {{ compliance = 1 F; e0 = 2 V }}  MR:r = {value}  0:n -> cc, r  probe v = cc.e }}"
        ));
        let mut sim = compiled.simulate(bond::Steps::fixed(1e-4)).unwrap_or_else(|e| panic!("{e}"));
        sim.finish(1.0).unwrap_or_else(|e| panic!("{e}"));
        crate::common::close(sim.probe("v").unwrap_or(f64::NAN), exact, 1e-8, value);
    }
}

/// A storage without energy counts an angle, and a ratio that follows it pulls a spring: x = l (sin th - sin th0).
#[test]
fn a_ratio_follows_a_counted_angle() {
    let compiled = with(
        Options::new().method("gonzalez"),
        "model Crank(l = 0.5 m) {
          I:rotor { inertia = 2 kg*m^2; f0 = 3 rad/s }
          C:th { H = 0; q0 = 1 rad }
          C:spring = 0.01 m/N
          TF:arm = l*cos(th.q/(1 rad))
          1:w -> rotor, th, arm
          arm -> spring
          probe angle = th.q
          probe x = spring.q
        }",
    );
    let off = |step: f64| {
        let mut sim = start(&compiled, Steps::fixed(step));
        advance(&mut sim, 2.0);
        let (angle, x) = (probe(&mut sim, "angle"), probe(&mut sim, "x"));
        assert!(sim.summary().worst_step <= 1e-12, "a step's balance with steps of {step}");
        (x - 0.5 * (angle.sin() - 1f64.sin())).abs()
    };
    let (coarse, fine) = (off(0.002), off(0.001));
    assert!((3.5..4.5).contains(&(coarse / fine)), "order 2 of the constraint: {coarse:e}, then {fine:e}");
    assert!(fine < 1e-5, "the constraint is off by {fine:e} m");
}

/// The transistor amplifier of the test set for initial value problem solvers (Mazzia and Magherini), at 0.2 s.
#[test]
fn the_transistor_amplifier_as_published() {
    let published = [
        ("y1", -0.556_214_501_226_270_9e-2),
        ("y2", 0.300_652_247_190_304_2e1),
        ("y3", 0.284_995_878_860_812_8e1),
        ("y4", 0.292_642_253_620_624_1e1),
        ("y5", 0.270_461_786_501_055_4e1),
        ("y6", 0.276_183_777_839_314_5e1),
        ("y7", 0.477_092_763_161_677_2e1),
        ("y8", 0.123_699_586_809_154_8e1),
    ];
    let compiled = example("transistor_amplifier", "TransistorAmplifier");
    let run = |h: f64| {
        let mut sim = start(&compiled, Steps::fixed(h));
        finish(&mut sim, 0.2);
        published.map(|(name, _)| probe(&mut sim, name))
    };
    // The step alone, and what it tends to.
    for ((name, wanted), found) in published.iter().zip(run(5e-7)) {
        close(found, *wanted, 1e-8, name);
    }
    let (coarse, fine) = (run(4e-6), run(2e-6));
    for (i, (name, wanted)) in published.iter().enumerate() {
        close(fine[i] + (fine[i] - coarse[i]) / 3.0, *wanted, 1e-11, name);
    }
}

/// Where a source and a storage come to balance across a loop of resistors, what flows is their rounding in the end:
/// the loop is solved to that, and the run goes on. Of q + q^3 = 1, q is 0.6823278038280193.
#[test]
fn loops_come_to_rest() {
    let washer = "model Washer {
      Se:push = 1 N
      R:line = 1 N*s/m
      C:washer { e = 1 N/m * q + 1 N/m^3 * q^3 }
      I:mass = 1 kg
      R:film = 1 N*s/m
      push -> 1:j -> line, washer
      j -> 0:k -> mass, film
      probe x = washer.q
    }";
    let two_loops = "model Flows {
      I:one { f = 0.34 kg^-1 * p + 1.28 m/s/(N*s)^3 * p^3;  p0 = 0.11 N*s }
      I:two = 1.58 kg
      I:three = 2.8 kg
      C:spring = 2.44 m/N
      R:first = 2.96 N*s/m
      R:second = 1.33 N*s/m
      R:third = 2.84 N*s/m
      TF:lever = 2
      one -> 0:a -> two
      a -> 0:b -> first, three
      b -> 1:c -> spring, second
      1:d -> third
      d -> lever -> c
      probe x = spring.q
    }";
    for method in ["gonzalez", "collocation4", "collocation8", "radau", "sav"] {
        let compiled = with(Options::new().method(method), washer);
        for steps in [Steps::tolerance(1e-7), Steps::fixed(0.1), Steps::fixed(3.0)] {
            // What sav keeps is another energy, off by the square of the step.
            if method == "sav" && steps == Steps::fixed(3.0) {
                continue;
            }
            let mut sim = start(&compiled, steps);
            for t in [20.0, 60.0, 100.0, 300.0] {
                finish(&mut sim, t);
            }
            close(probe(&mut sim, "x"), 0.6823278038280193, if method == "sav" { 1e-7 } else { 1e-9 }, method);
        }
        if method != "sav" {
            let compiled = with(Options::new().method(method), two_loops);
            let mut sim = start(&compiled, Steps::tolerance(1e-7));
            finish(&mut sim, 100.0);
            finish(&mut sim, 300.0);
            close(probe(&mut sim, "x"), 0.0, 1e-9, method);
        }
    }
}

/// A pendulum that stands, linearised: its energy falls to both sides without an end, so it runs away as cosh, and
/// nothing is claimed of it.
#[test]
fn an_energy_may_fall_without_an_end() {
    let compiled = text(
        "model Standing {
          I:wheel = 2 kg*m^2
          C:weight { H = -0.5 * 3 N*m * q^2;  q0 = 0.01 rad }
          1:w -> wheel, weight
          probe angle = weight.q
        }",
    );
    for (t, angle) in trace(&compiled, Steps::fixed(0.1), 0.5, 6, "angle") {
        close(angle, 0.01 * (1.5f64.sqrt() * t).cosh(), 1e-12, "angle");
    }
    assert!(!compiled.show("phs").contains("H is bounded below"));
}

/// A cart with a pole, that tips over the top: of the masses that the pole moves through sines and cosines its turning
/// does not follow where these pass 0, so that it is its own that is kept, whatever is declared first. By the equations
/// of Lagrange, solved to 1e-12.
#[test]
fn the_order_of_declaration_does_not_change_a_linkage() {
    let parts = [
        "I:cart = 1 kg",
        "I:mx { inertia = 1 kg; f0 = 5 m/s }",
        "I:my = 1 kg",
        "I:J { inertia = 0.01 kg*m^2; f0 = 5 rad/s }",
    ];
    for k in 0..24 {
        let mut rest = parts.to_vec();
        let order: Vec<&str> = [k / 6, (k / 2) % 3, k % 2, 0].into_iter().map(|i| rest.remove(i)).collect();
        let model = format!(
            "model CartPole {{
               {}
               C:th {{ H = 0 }}
               MTF:tx = 1 m * cos(th.q)
               MTF:ty = 1 m * sin(th.q)
               1:v -> cart
               v -> 0:s -> 1:vx -> mx
               1:om -> th, J, tx, ty
               tx -> s
               ty -> 1:vy -> my
               probe angle = th.q
               probe w = om.f
             }}",
            order.join("\n")
        );
        let compiled = crate::common::with(bond::Options::new().method("collocation8"), &model);
        let mut sim = crate::common::start(&compiled, bond::Steps::tolerance(1e-9));
        crate::common::finish(&mut sim, 1.0);
        crate::common::close(crate::common::probe(&mut sim, "angle"), 4.194943, 1e-6, &format!("the angle, {order:?}"));
        crate::common::close(crate::common::probe(&mut sim, "w"), 3.789946, 1e-6, &format!("the turning, {order:?}"));
        assert!(sim.summary().passive, "{order:?}");
    }
}

/// An arm of point masses on rods, of 1 kg and 0.5 m, 0.8 kg and 0.4 m, 0.6 kg and 0.3 m.
#[derive(Clone, Copy)]
struct Arm {
    links: usize,
    /// Whether the joints' own turning is what the graph has, and 0-junctions add it up; or that of the links.
    relative: bool,
    /// Whether the ratios are written from the masses to the links.
    reversed: bool,
    /// A cart of 2 kg under it.
    cart: bool,
    /// An inertia (kg m^2) on each link, a damper (N m s) or a spring (N m) at each joint but the first; none where 0.
    inertia: f64,
    damper: f64,
    spring: f64,
}

const ARM: Arm = Arm { links: 2, relative: true, reversed: false, cart: false, inertia: 0.0, damper: 0.0, spring: 0.0 };
const MASSES: [f64; 3] = [1.0, 0.8, 0.6];
const RODS: [f64; 3] = [0.5, 0.4, 0.3];
/// Where the links start, from where they hang.
const ANGLES: [f64; 3] = [1.2, 2.0, 0.5];

impl Arm {
    fn text(&self) -> String {
        let mut all = String::from("model Arm {\n");
        let mut add = |line: String| all += &(line + "\n");
        if self.cart {
            add("I:cart = 2 kg  1:vx -> cart".into());
        }
        let mut sum: Vec<String> = Vec::new();
        for i in 0..self.links {
            let before = if i > 0 && self.relative { ANGLES[i - 1] } else { 0.0 };
            add(format!("C:q{i} {{ H = 0; q0 = {} rad }}", ANGLES[i] - before));
            let joint = if i > 0 && self.relative { format!("d{i}") } else { format!("w{i}") };
            add(format!("1:{joint} -> q{i}"));
            sum.push(format!("q{i}.q"));
            let angle = if self.relative { sum.join(" + ") } else { format!("q{i}.q") };
            let parts = [("R", "b", self.damper, "N*m*s"), ("C", "k", self.spring, "rad/(N*m)")];
            let parts = || parts.iter().filter(|p| i > 0 && p.2 > 0.0);
            parts().for_each(|(kind, name, x, unit)| {
                add(format!("{kind}:{name}{i} = {} {unit}", if *kind == "C" { 1.0 / x } else { *x }));
            });
            if i > 0 && self.relative {
                add(format!("w{} -> 0:s{i} -> 1:w{i}  d{i} -> s{i}", i - 1));
                parts().for_each(|p| add(format!("d{i} -> {}{i}", p.1)));
            } else if i > 0 && parts().count() > 0 {
                add(format!("w{i} -> 0:s{i} -> w{}", i - 1));
                parts().for_each(|p| add(format!("s{i} -> {}{i}", p.1)));
            }
            if self.inertia > 0.0 {
                add(format!("I:j{i} = {} kg*m^2  w{i} -> j{i}", self.inertia));
            }
            add(format!("Se:g{i} = {} N", -9.81 * MASSES[i]));
            for (axis, along) in [("x", "cos"), ("y", "sin")] {
                let ratio = format!("{} m * {along}({angle})", RODS[i]);
                let (t, v) = (format!("t{axis}{i}"), format!("v{axis}{i}"));
                add(format!("I:m{axis}{i} = {} kg  1:{v} -> m{axis}{i}", MASSES[i]));
                add(format!("MTF:{t} = {}", if self.reversed { format!("1/({ratio})") } else { ratio }));
                let last = match i {
                    0 if axis == "x" && self.cart => Some("vx".to_string()),
                    0 => None,
                    _ => Some(format!("v{axis}{}", i - 1)),
                };
                let mut chain = match last {
                    Some(last) => vec![format!("{v} -> 0:z{axis}{i}"), format!("z{axis}{i} -> {last}")],
                    None => vec![],
                };
                let near = if chain.is_empty() { v } else { format!("z{axis}{i}") };
                chain.push(format!("{near} -> {t} -> w{i}"));
                for line in chain {
                    // Read from its end, a chain has all its arrows turned.
                    let turned: Vec<&str> = line.split(" -> ").collect::<Vec<_>>().into_iter().rev().collect();
                    add(if self.reversed { line } else { turned.join(" -> ") });
                }
            }
            add(format!("g{i} -> vy{i}  probe a{i} = {angle}"));
        }
        all + "}"
    }

    /// The angles of the links at a time, by the equations of Lagrange and the rule of Runge and Kutta.
    fn angles(&self, stop: f64) -> Vec<f64> {
        let n = self.links;
        let rate = |y: &[f64]| {
            let (q, w) = y.split_at(n + 1);
            let moved = |i: usize| MASSES[i..n].iter().sum::<f64>();
            let mut rows = vec![vec![0.0; n + 2]; n + 1];
            // The cart stands at the end; where there is none its place is held.
            rows[n][n] = if self.cart { 2.0 + moved(0) } else { 1.0 };
            for i in 0..n {
                for j in 0..n {
                    let m = moved(i.max(j)) * RODS[i] * RODS[j];
                    rows[i][j] = m * (q[i] - q[j]).cos();
                    rows[i][n + 1] -= m * (q[i] - q[j]).sin() * w[j] * w[j];
                }
                rows[i][i] += self.inertia;
                rows[i][n + 1] -= moved(i) * 9.81 * RODS[i] * q[i].sin();
                if self.cart {
                    rows[i][n] = moved(i) * RODS[i] * q[i].cos();
                    rows[n][i] = rows[i][n];
                    rows[n][n + 1] += moved(i) * RODS[i] * q[i].sin() * w[i] * w[i];
                }
            }
            for i in 1..n {
                let turned = q[i] - q[i - 1] - (ANGLES[i] - ANGLES[i - 1]);
                let torque = self.damper * (w[i] - w[i - 1]) + self.spring * turned;
                rows[i][n + 1] -= torque;
                rows[i - 1][n + 1] += torque;
            }
            for k in 0..=n {
                for i in 0..=n {
                    let part = rows[i][k] / rows[k][k];
                    if i != k {
                        (k..n + 2).for_each(|j| rows[i][j] -= part * rows[k][j]);
                    }
                }
            }
            let turning: Vec<f64> = (0..=n).map(|i| rows[i][n + 1] / rows[i][i]).collect();
            [w, &turning].concat()
        };
        let steps = 5000;
        let h = stop / f64::from(steps);
        let mut y = [&ANGLES[..n], &vec![0.0; n + 2]].concat();
        let plus = |y: &[f64], k: &[f64], h: f64| -> Vec<f64> { y.iter().zip(k).map(|(y, k)| y + h * k).collect() };
        for _ in 0..steps {
            let a = rate(&y);
            let b = rate(&plus(&y, &a, h / 2.0));
            let c = rate(&plus(&y, &b, h / 2.0));
            let d = rate(&plus(&y, &c, h));
            for (i, y) in y.iter_mut().enumerate() {
                *y += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]);
            }
        }
        y[..n].to_vec()
    }
}

/// From the Cartesian speeds of an arm's masses its turning follows by divisions that pass 0; it is the turning of its
/// joints that is kept, however that is written and whatever stands at the joints, be it an inertia that is a very
/// small number beside the masses. All ways have the numbers of Lagrange's equations, and come to them by the square of
/// the step.
#[test]
fn the_joints_of_an_arm_move_its_masses() {
    let arms = [
        ARM,
        Arm { reversed: true, ..ARM },
        Arm { damper: 0.01, ..ARM },
        Arm { spring: 1.0, ..ARM },
        Arm { damper: 0.01, relative: false, ..ARM },
        Arm { damper: 0.01, relative: false, reversed: true, ..ARM },
        Arm { spring: 1.0, relative: false, ..ARM },
        Arm { inertia: 1e-6, ..ARM },
        Arm { inertia: 1e-6, damper: 0.01, relative: false, ..ARM },
        Arm { cart: true, ..ARM },
        Arm { cart: true, damper: 0.01, relative: false, ..ARM },
        Arm { links: 3, damper: 0.02, ..ARM },
        Arm { links: 3, cart: true, relative: false, reversed: true, ..ARM },
    ];
    for arm in arms {
        let text = arm.text();
        let compiled = crate::common::with(Options::new().method("gonzalez"), &text);
        let shown = compiled.show("phs");
        assert!(!shown.contains(".p'"), "divided by a ratio: {text}");
        let wanted = arm.angles(0.5);
        let off = |steps: Steps| -> f64 {
            let mut sim = start(&compiled, steps);
            finish(&mut sim, 0.5);
            assert!(sim.summary().passive, "{text}");
            let each = wanted.iter().enumerate().map(|(i, a)| probe(&mut sim, &format!("a{i}")) - a);
            each.fold(0.0, |sum: f64, x| sum.max(x.abs()))
        };
        let [long, short] = [0.004, 0.001].map(|h| off(Steps::fixed(h)));
        assert!(long < 2e-3, "{long}: {text}");
        assert!((12.0..20.0).contains(&(long / short)), "not the square of the step, {long} and {short}: {text}");
        let fitted = off(Steps::tolerance(1e-8));
        assert!(fitted < 2e-5, "{fitted}: {text}");
    }
}

/// A junction that moves a spring by a ratio which changes, beside an arm: no inertia tells its speed, and it has none.
#[test]
fn what_no_inertia_moves_gets_none() {
    let arm = Arm { relative: false, damper: 0.01, ..ARM }.text();
    let compiled = text(&arm.replace(
        "model Arm {",
        "model Arm {
           C:angle { H = 0; q0 = 0.3 rad }  R:slow = 1 N*m*s  R:r = 200 N*s/m  Se:torque = 1 N*m
           MTF:x = 0.1 m * cos(angle.q)
           1:u -> angle, slow, x
           x -> r  torque -> u
           probe turned = angle.q",
    ));
    let mut sim = start(&compiled, Steps::tolerance(1e-8));
    finish(&mut sim, 0.5);
    // w (1 + 2 cos(a)^2) = 1
    let a = probe(&mut sim, "turned");
    let passed = |a: f64| 2.0 * a + (2.0 * a).sin() / 2.0;
    close(passed(a) - passed(0.3), 0.5, 1e-6, "turned");
    assert!(sim.summary().passive);
}
