//! Storages that constraints tie: coils in series, a varactor on a supply, arms whose length is given by time, by
//! integrals and by efforts, cranks that are driven, chains of pendulums. Their order, what they keep, and numbers that
//! were found by other means.

use crate::common::{advance, close, end, errors, models, probe, read, start, with};
use bond::{Compiled, Options, Steps};

fn fine(text: &str) -> Compiled {
    with(Options::new().method("collocation8"), text)
}

/// Two iron-core coils in series: one current, two storages, neither quadratic. `scale` has all inductances and times
/// so many times as large.
fn coils(scale: f64, order: [&str; 2]) -> String {
    let [first, second] = order;
    format!(
        "model Series {{
          Se:u = (40 V)*sin(2*pi*t/({scale}*20 ms))
          I:{first}
          I:{second}
          R:r = 3 Ohm
          u -> 1:mesh -> a, b, r
          probe i = r.f
          probe off = a.f - b.f
        }}"
    )
    .replace("LA", &format!("({scale}*50 mH)"))
    .replace("LB", &format!("({scale}*20 mH)"))
    .replace("SA", &format!("({scale}*60 mWb)"))
    .replace("SB", &format!("({scale}*80 mWb)"))
}

const A: &str = "a { H = 0.5*p^2/LA*(1 + 0.25*(p/SA)^6) }";
const B: &str = "b { H = 0.5*p^2/LB*(1 + 0.25*(p/SB)^6) }";

/// The current at 0.1 s, by the method of Runge and Kutta on the flux of one coil, with the other one's as a root.
const CURRENT: f64 = -3.142036849100319;

/// What a fixed method leaves of the error when the step is halved is its order; the constraint holds at each end.
#[test]
fn tied_coils_have_the_order_of_the_method() {
    let text = coils(1.0, [A, B]);
    for (method, order, step) in
        [("gonzalez", 2, 5e-4), ("collocation4", 4, 5e-4), ("collocation6", 6, 1e-3), ("collocation8", 8, 2e-3)]
    {
        let compiled = with(Options::new().method(method), &text);
        let errors = [step, step / 2.0, step / 4.0].map(|h| {
            let mut sim = start(&compiled, Steps::fixed(h));
            advance(&mut sim, 0.1);
            close(probe(&mut sim, "off"), 0.0, 2e-14, &format!("{method}: the constraint at {h}"));
            (probe(&mut sim, "i") - CURRENT).abs()
        });
        let found = (errors[0] / errors[2]).log2() / 2.0;
        assert!(found > f64::from(order) - 0.3, "{method} has order {found}: {errors:?}");
    }
}

/// By any step, however long, the balance is rounding, and what puts the end on the constraint takes energy.
#[test]
fn any_step_is_passive() {
    for model in [coils(1.0, [A, B]), DRIVEN.to_string(), VARACTOR.to_string(), chain(3)] {
        for method in ["gonzalez", "collocation4", "collocation8"] {
            let compiled = with(Options::new().method(method), &model);
            for h in [1e-4, 1e-3, 7e-3, 5e-2] {
                let mut sim = start(&compiled, Steps::fixed(h));
                // A long step of many turns may have no solution; what was taken until then counts.
                for k in 1..=20 {
                    if sim.advance(f64::from(k) * h).is_err() {
                        break;
                    }
                }
                let summary = sim.summary();
                assert!(summary.worst_step < 1e-12, "{method} at {h}: {} in {model}", summary.worst_step);
                assert!(summary.passive, "{method} at {h}: {model}");
            }
        }
    }
}

/// In another order of declaration, and in other sizes, the same.
#[test]
fn neither_order_nor_size_counts() {
    for scale in [1e-6, 1.0, 1e6] {
        for order in [[A, B], [B, A]] {
            let compiled = fine(&coils(scale, order));
            let i = end(&compiled, Steps::tolerance(1e-11), 0.1 * scale, "i");
            close(i, CURRENT, 1e-9, &format!("coils {scale} times as large"));
        }
    }
}

/// A supply imposes the voltage of a capacitance that is not linear: q is the root of q + q^3 = u.
const VARACTOR: &str = "model Varactor {
  Se:u = 2 V + (1 V)*sin(3 rad/s * t)
  C:c { H = 0.5*(1 V/C)*q^2 + 0.25*(1 V/C^3)*q^4 }
  u -> c
  probe i = c.f
  probe charge = c.q
}";

#[test]
fn a_varactor_on_a_supply() {
    let (u, rate) = (2.0 + 3.0f64.sin(), 3.0 * 3.0f64.cos());
    let mut q = u;
    for _ in 0..60 {
        q -= (q + q * q * q - u) / (1.0 + 3.0 * q * q);
    }
    for method in ["gonzalez", "collocation8", "radau"] {
        let compiled = with(Options::new().method(method), VARACTOR);
        let mut sim = start(&compiled, Steps::fixed(0.125));
        advance(&mut sim, 1.0);
        close(probe(&mut sim, "charge"), q, 1e-14, method);
        close(probe(&mut sim, "i"), rate / (1.0 + 3.0 * q * q), 1e-14, method);
    }
}

/// A capacitor across a source that reads a rotor: the rotor slows down by its brake alone.
#[test]
fn a_source_that_reads_the_scene() {
    let compiled = fine(
        "model M {
          I:rotor { inertia = 1 kg*m^2; f0 = 1 rad/s }
          R:brake = 0.1 N*m*s
          Se:generator = 5 V*s * rotor.f
          C:cap { compliance = 2 F; e0 = 5 V }
          1:w -> rotor, brake
          generator -> cap
          probe i = cap.f
        }",
    );
    close(end(&compiled, Steps::tolerance(1e-10), 1.0, "i"), -(-0.1f64).exp(), 1e-10, "the current");
}

/// A rotor with a mass on an arm, whose length is `arm`.
fn arm(arm: &str) -> String {
    format!(
        "model Arm {{
          I:J {{ inertia = 1 kg*m^2; f0 = 2 rad/s }}
          I:m = 1 kg
          C:turn {{ H = 0 }}
          C:k {{ stiffness = 3 N*m }}
          let angle = integral(w.f, 0 rad)
          TF:arm = {arm}
          1:w -> J, turn, k
          w -> arm -> 1:v -> m
          probe speed = J.f
        }}"
    )
}

/// Ratios of time, integrals and efforts as such of states, which are merged.
#[test]
fn what_ratios_read_does_not_count() {
    for (one, other) in [
        ("1 m + (0.1 m)*sin(angle)", "1 m + (0.1 m)*sin(turn.q)"),
        ("1 m + (0.1 m/(N*m))*k.e", "1 m + (0.1 m/(N*m))*((3 N*m)*k.q)"),
        ("1 m + (0.1 m)*sin(1 Hz * t)", "1 m + (0.1 m)*sin(clock.q)"),
    ] {
        let clock = "Sf:tick = 1 Hz\n C:clock { H = 0 }\n tick -> clock\n probe speed";
        let [one, other] = [one, other].map(|ratio| {
            let compiled = fine(&arm(ratio).replace("probe speed", clock));
            end(&compiled, Steps::tolerance(1e-11), 1.0, "speed")
        });
        close(one, other, 1e-10, "the speed");
    }
}

/// The ratio of time alone does work; the spring is without stiffness in the closed form: (J + m a^2) w^2 stays.
#[test]
fn an_arm_whose_length_is_given_by_time() {
    let compiled = fine(&arm("1 m + (0.1 m)*sin(1 Hz * t)").replace("stiffness = 3 N*m", "H = 0"));
    let a = 1.0 + 0.1 * 1.0f64.sin();
    let wanted = 2.0 * (2.0 / (1.0 + a * a)).sqrt();
    close(end(&compiled, Steps::tolerance(1e-11), 1.0, "speed"), wanted, 1e-10, "the speed");
}

/// A length that another region gives: no bond brings its power. There it is a swing, `sin(2 t)/2`.
#[test]
fn an_arm_whose_length_is_of_another_region() {
    let swing = "I:other { inertia = 1 kg; f0 = 1 m/s }
          C:place { stiffness = 4 N/m }
          1:swing -> other, place
          probe speed";
    let compiled = fine(&arm("1 m + 0.3*place.q").replace("stiffness = 3 N*m", "H = 0").replace("probe speed", swing));
    let a = 1.0 + 0.15 * 2.0f64.sin();
    let wanted = 2.0 * (2.0 / (1.0 + a * a)).sqrt();
    close(end(&compiled, Steps::tolerance(1e-11), 1.0, "speed"), wanted, 1e-10, "the speed");
}

/// A crank at a given speed moves a piston with dry friction and mass.
const DRIVEN: &str = "model Driven(r = 0.05 m, l = 0.15 m, w = 30 rad/s, Fc = 40 N, m = 0.5 kg) {
  Sf:drive = w
  C:angle { H = 0 }
  let a = angle.q
  TF:crank = r*sin(a) + r^2*sin(a)*cos(a)/sqrt(l^2 - r^2*sin(a)^2)
  R:rub { e = Fc*min(max(s, -1), 1); f = (s - min(max(s, -1), 1))*1 m/s }
  I:piston = m
  drive -> 1:turn -> angle, crank
  crank -> 1:slide -> rub, piston
  probe torque = drive.e
  probe heat = integral(rub.P, 0 J)
}";

/// The friction turns the way of the piston into heat; the torque is what d'Alembert's principle gives.
#[test]
fn a_driven_crank_with_friction_and_mass() {
    let (r, l, w, m, force): (f64, f64, f64, f64, f64) = (0.05, 0.15, 30.0, 0.5, 40.0);
    let place = |a: f64| r * (1.0 - a.cos()) + l - (l * l - (r * a.sin()).powi(2)).sqrt();
    let ratio = |a: f64| r * a.sin() + r * r * a.sin() * a.cos() / (l * l - (r * a.sin()).powi(2)).sqrt();
    let (turns, end) = ((w / std::f64::consts::TAU).floor(), w);
    // It has turned back on its way out.
    let way = 4.0 * r * turns + 4.0 * r - place(end);
    let h = 1e-5;
    let slope = (ratio(end + h) - ratio(end - h)) / (2.0 * h);
    let wanted = ratio(end) * (m * slope * w * w + force * ratio(end).signum());
    let compiled = fine(DRIVEN);
    let mut sim = start(&compiled, Steps::tolerance(1e-9));
    advance(&mut sim, 1.0);
    close(probe(&mut sim, "heat"), force * way, 1e-7, "the heat");
    close(probe(&mut sim, "torque"), wanted, 1e-7, "the torque");
}

/// A crank that its wheel turns through both dead centres, where the slider does not say how fast it turns; `angle` is
/// what the crank reads.
fn crank(angle: &str) -> String {
    format!(
        "model Crank(r = 0.3 m, l = 1 m) {{
          I:wheel {{ inertia = 1 kg*m^2; f0 = 5 rad/s }}
          C:turn {{ H = 0 }}
          let counted = integral(w.f, 0 rad)
          let a = {angle}
          TF:crank = r*sin(a) + r^2*sin(a)*cos(a)/sqrt(l^2 - r^2*sin(a)^2)
          I:slider = 2 kg
          1:w -> wheel, turn, crank
          crank -> 1:v -> slider
          probe speed = wheel.f
          probe place = turn.q
        }}"
    )
}

#[test]
fn a_crank_through_its_dead_centres() {
    let merged = fine(&crank("turn.q"));
    let tied = fine(&crank("counted"));
    assert!(tied.show("phs").contains("a multiplier at"), "{}", tied.show("phs"));
    for what in ["speed", "place"] {
        let wanted = end(&merged, Steps::tolerance(1e-11), 3.0, what);
        close(end(&tied, Steps::tolerance(1e-11), 3.0, what), wanted, 1e-9, what);
    }
}

/// A chain of so many pendulums: masses on rods without mass, from a wall.
fn chain(n: usize) -> String {
    read(&models().join("examples/pendulum_chain.bond")).replace("n = 8", &format!("n = {n}"))
}

/// Angles of the last rod and of the first one, by the method of Runge and Kutta on Lagrange's equations.
#[test]
fn chains_of_pendulums() {
    for (n, last, first) in [
        (2, -0.9174077695208056, -0.475011668693255),
        (4, -0.24305150159493744, -0.08102042362844904),
        (9, 0.9942966505782284, 0.21506694408738428),
    ] {
        let compiled = fine(&chain(n));
        let mut sim = start(&compiled, Steps::tolerance(1e-10));
        advance(&mut sim, 1.0);
        close(probe(&mut sim, "last"), last, 2e-10, &format!("the last of {n}"));
        close(probe(&mut sim, "first"), first, 2e-10, &format!("the first of {n}"));
    }
}

/// Each body of a long chain is tied to the one before it, not to all: so a step takes time in proportion to the links.
#[test]
fn constraints_of_a_chain_are_local() {
    let compiled = fine(&chain(40));
    let form = compiled.show("phs");
    let rows = form.lines().filter(|l| l.contains("a multiplier at"));
    let long = rows.filter(|l| l.matches(".f").count() > 3).collect::<Vec<_>>();
    assert!(long.is_empty(), "{long:?}");
}

/// A source pushes two masses of 1 kg and 2 kg apart at 3 m/s. Neither start is stated: what goes with the source, and
/// has the least energy, are 2 m/s and 1 m/s; in whatever order and size of masses.
#[test]
fn an_unstated_start_has_the_least_energy() {
    for (scale, order) in [(1.0, ["a", "b"]), (1.0, ["b", "a"]), (1e6, ["a", "b"]), (1e-6, ["b", "a"])] {
        let mass = |name: &str| {
            let kg = if name == "a" { scale } else { 2.0 * scale };
            format!("I:{name} {{ H = 0.5*p^2/({kg} kg) + 0.01*p^4/({kg} kg)/({kg} kg*m/s)^2 }}")
        };
        let compiled = fine(&format!(
            "model Apart {{
              Sf:apart = 3 m/s
              {}
              {}
              apart -> 0:n -> a, b
              probe lighter = a.f
              probe heavier = b.f
            }}",
            mass(order[0]),
            mass(order[1])
        ));
        let mut sim = start(&compiled, Steps::fixed(1e-3));
        close(probe(&mut sim, "lighter"), 2.0, 1e-12, "the lighter one");
        close(probe(&mut sim, "heavier"), 1.0, 1e-12, "the heavier one");
    }
}

/// Two coils in series that are said to carry 1 A and 2 A: the error names both, and the bond where they are tied.
#[test]
fn stated_starts_that_do_not_agree_are_told() {
    let text = coils(1.0, ["a { H = p^2/LA + p^4/LA/SA^2; f0 = 1 A }", "b { H = p^2/LB + p^4/LB/SB^2; f0 = 2 A }"]);
    let told = errors(&text).to_string();
    for word in ["structure::initial", "`a`, `b`", "`mesh -> b`", "state the start of one of them"] {
        assert!(told.contains(word), "no {word} in: {told}");
    }
}
