//! Multiport fields, entropy, dependent storages, loops and set-valued laws: closed forms, orders and conservation.

use crate::common::{advance, close, end, errors, finish, probe, start, text, with};
use bond::internal::{CompiledInternals, SimulationInternals, StepsInternals};
use bond::{Options, Steps};

/// A linear field of resistors gives the explicit form with its skew part in J, whatever causality its ports get.
#[test]
fn a_field_of_resistors_takes_every_causality() {
    // e = R f imposed on both, on one, on none of the ports; what is given, against the matrix solved by hand.
    let field = "R(a, b):pair = [[2 Ohm, 1 Ohm], [-0.5 Ohm, 1 Ohm]]";
    let cases = [
        ("Sf:x = 3 A; Sf:y = 5 A", "pair.a.e", 2.0 * 3.0 + 1.0 * 5.0),
        ("Sf:x = 3 A; Sf:y = 5 A", "pair.b.e", -0.5 * 3.0 + 5.0),
        ("Se:x = 3 V; Se:y = 5 V", "pair.a.f", (3.0 - 5.0) / 2.5),
        ("Se:x = 3 V; Se:y = 5 V", "pair.b.f", (2.0 * 5.0 + 0.5 * 3.0) / 2.5),
        ("Sf:x = 3 A; Se:y = 5 V", "pair.b.f", 5.0 + 0.5 * 3.0),
        ("Sf:x = 3 A; Se:y = 5 V", "pair.a.e", 2.0 * 3.0 + 6.5),
    ];
    for (sources, signal, wanted) in cases {
        let model = format!("model M {{ {sources}; {field}; x -> pair.a; y -> pair.b; probe p = {signal} }}");
        close(end(&text(&model), Steps::fixed(0.1), 0.2, "p"), wanted, 1e-12, signal);
    }
}

/// Coupled coils against the matrix exponential of their equations L di/dt = u - R i.
#[test]
fn coupled_coils_follow_their_matrix() {
    let compiled = text(
        "model M { Se:u = 1 V; R:r1 = 1 Ohm; R:r2 = 2 Ohm; I(a, b):coils = [[4 H, 1 H], [1 H, 2 H]]
           u -> 1:first -> r1, coils.a; 1:second -> r2, coils.b; probe i1 = first.f; probe i2 = second.f }",
    );
    let l = nalgebra::Matrix2::new(4.0, 1.0, 1.0, 2.0);
    let a = -l.try_inverse().expect("a regular matrix") * nalgebra::Matrix2::new(1.0, 0.0, 0.0, 2.0);
    let rest = nalgebra::Vector2::new(1.0, 0.0);
    let wanted = rest - (a * 0.7).exp() * rest;
    for (name, i) in [("i1", 0), ("i2", 1)] {
        close(end(&compiled, Steps::fixed(0.7), 0.7, name), wanted[i], 1e-12, name);
    }
}

/// A double pendulum as one energy of two angles and two momenta: order 2, and the energy to rounding.
#[test]
fn a_double_pendulum_is_one_field() {
    let compiled = with(
        Options::new().method("gonzalez"),
        "model D(m = 1 kg, l = 1 m, g = 9.81 m/s^2) {
           IC(I p1, I p2, C q1, C q2):arm {
             H = (p1^2 + 2*p2^2 - 2*p1*p2*cos(q1 - q2)) / (2*m*l^2*(1 + sin(q1 - q2)^2)) - m*g*l*(2*cos(q1) + cos(q2))
             q1_0 = 1 rad; q2_0 = 0.5 rad }
           1:w1 -> arm.p1, arm.q1; 1:w2 -> arm.p2, arm.q2
           probe h = arm.H; probe q1 = arm.q1; probe q2 = arm.q2 }",
    );
    let at = |h: f64, name: &str| end(&compiled, Steps::fixed(h), 2.0, name);
    for name in ["q1", "q2"] {
        let [a, b, c] = [4e-3, 2e-3, 1e-3].map(|h| at(h, name));
        let order = ((a - b) / (b - c)).log2();
        close(order, 2.0, 0.1, name);
    }
    let mut sim = start(&compiled, Steps::fixed(1e-2));
    let h = probe(&mut sim, "h");
    for k in 1..=20 {
        advance(&mut sim, f64::from(k) * 5.0);
        close(probe(&mut sim, "h"), h, 1e-11 * h.abs(), "energy");
    }
}

/// The same double pendulum from its masses in Cartesian form, derivative causality and all, moves as the field does.
#[test]
fn masses_on_rods_move_as_the_field_of_their_angles() {
    let cartesian = text(
        "model D(m = 1 kg, l = 1 m, g = 9.81 m/s^2) {
           C:q1 { H = 0; q0 = 1 rad }
           C:q2 { H = 0; q0 = 0.5 rad }
           1:w1 -> q1
           1:w2 -> q2
           TF:x1 = l*cos(q1.q); TF:y1 = l*sin(q1.q)
           TF:x2 = l*cos(q2.q); TF:y2 = l*sin(q2.q)
           I:mx1 = m; I:my1 = m; I:mx2 = m; I:my2 = m
           Se:g1 = -m*g; Se:g2 = -m*g
           w1 -> x1 -> 1:vx1 -> mx1
           w1 -> y1 -> 1:vy1 -> my1
           g1 -> vy1
           w2 -> x2 -> 0:dx -> 1:vx2 -> mx2
           vx1 -> dx
           w2 -> y2 -> 0:dy -> 1:vy2 -> my2
           vy1 -> dy
           g2 -> vy2
           probe a = q1.q; probe b = q2.q
           probe e = 0.5*m*(vx1.f^2 + vy1.f^2 + vx2.f^2 + vy2.f^2) - m*g*l*(2*cos(q1.q) + cos(q2.q)) }",
    );
    let field = text(
        "model D(m = 1 kg, l = 1 m, g = 9.81 m/s^2) {
           IC(I p1, I p2, C q1, C q2):arm {
             H = (p1^2 + 2*p2^2 - 2*p1*p2*cos(q1 - q2)) / (2*m*l^2*(1 + sin(q1 - q2)^2)) - m*g*l*(2*cos(q1) + cos(q2))
             q1_0 = 1 rad; q2_0 = 0.5 rad }
           1:w1 -> arm.p1, arm.q1; 1:w2 -> arm.p2, arm.q2
           probe a = arm.q1; probe b = arm.q2 }",
    );
    for name in ["a", "b"] {
        // Richardson: both are of order 2.
        let limit = |c: &bond::Compiled| {
            let [x, y] = [1e-3, 5e-4].map(|h| end(c, Steps::fixed(h), 1.5, name));
            y + (y - x) / 3.0
        };
        close(limit(&cartesian), limit(&field), 1e-7, name);
    }
}

/// Constraint and energy of dependent storages over many steps: nothing drifts.
#[test]
fn ratios_that_change_keep_constraint_and_energy() {
    let pendulum = text(
        "model P(m = 1 kg, l = 1 m) {
           C:th { H = 0; q0 = 3 rad }
           C:lift { H = 9.81 N * q; q0 = 10 m }
           TF:x = l*cos(th.q); TF:y = l*sin(th.q)
           I:mx = m; I:my = m
           1:w -> th
           w -> x -> 1:vx -> mx
           w -> y -> 1:vy -> my, lift
           probe e = 0.5*m*(vx.f^2 + vy.f^2) + 9.81 N * lift.q
           probe off = vx.f^2 + vy.f^2 - (l*w.f)^2 }",
    );
    let crank = text(
        "model Crank(r = 0.1 m, l = 0.3 m) {
           I:J { inertia = 0.01 kg*m^2; f0 = 20 rad/s }
           C:th { H = 0; q0 = 0.3 rad }
           TF:crank = -r*sin(th.q) - r^2*sin(th.q)*cos(th.q)/sqrt(l^2 - r^2*sin(th.q)^2)
           I:piston = 0.5 kg
           1:w -> J, th
           w -> crank -> 1:v -> piston
           probe e = 0.5 * 0.01 kg*m^2 * w.f^2 + 0.5 * 0.5 kg * v.f^2
           probe off = v.f + (r*sin(th.q) + r^2*sin(th.q)*cos(th.q)/sqrt(l^2 - r^2*sin(th.q)^2))*w.f }",
    );
    for (compiled, step, scale) in [(&pendulum, 1e-2, 9.81), (&crank, 1e-3, 2.0)] {
        let mut sim = start(compiled, Steps::fixed(step));
        let e = probe(&mut sim, "e");
        for k in 1..=10 {
            advance(&mut sim, f64::from(k) * 1e4 * step);
            close(probe(&mut sim, "off"), 0.0, 1e-10 * scale, "constraint");
        }
        let ledger = sim.summary();
        assert!(ledger.worst_step < 1e-12, "{:?}", ledger.reasons);
        assert!(ledger.total < 1e-10, "{}", ledger.total);
        // The crank's energy is one H; the pendulum's height is counted beside it, to order 2.
        let drift = (probe(&mut sim, "e") - e).abs();
        assert!(drift <= if step < 2e-3 { 1e-10 } else { 1e-2 } * scale, "the energy is off by {drift}");
    }
}

/// A four-bar linkage, its two driven angles counted: the loop stays closed to order 2, the energy to rounding.
#[test]
fn a_four_bar_linkage_stays_closed() {
    let (a, b, c, d) = (0.1, 0.3, 0.25, 0.3);
    // Angles of coupler and rocker at crank angle 1, by the law of cosines.
    let (px, py): (f64, f64) = (d - a * 1f64.cos(), -a * 1f64.sin());
    let s = px.hypot(py);
    let base = py.atan2(px);
    let t3 = base + ((b * b + s * s - c * c) / (2.0 * b * s)).acos();
    let t4 = (a * 1f64.sin() + b * t3.sin()).atan2(a * 1f64.cos() + b * t3.cos() - d);
    let model = |h0: f64| {
        with(
            Options::new().method("gonzalez"),
            &format!(
                "model F(a = {a} m, b = {b} m, c = {c} m, d = {d} m) {{
               I:J2 {{ inertia = 0.01 kg*m^2; f0 = {h0} rad/s }}
               I:J4 = 0.02 kg*m^2
               I:J3 = 0.005 kg*m^2
               C:t2 {{ H = 0; q0 = 1 rad }}
               C:t3 {{ H = 0; q0 = {t3} rad }}
               C:t4 {{ H = 0; q0 = {t4} rad }}
               TF:r3 = a*sin(t4.q - t2.q)/(b*sin(t3.q - t4.q))
               TF:r4 = a*sin(t3.q - t2.q)/(c*sin(t3.q - t4.q))
               1:w2 -> J2, t2
               w2 -> r3 -> 1:w3 -> J3, t3
               w2 -> r4 -> 1:w4 -> J4, t4
               probe x = a*cos(t2.q) + b*cos(t3.q) - d - c*cos(t4.q)
               probe y = a*sin(t2.q) + b*sin(t3.q) - c*sin(t4.q)
               probe e = J2.P }}"
            ),
        )
    };
    let compiled = model(10.0);
    let off =
        |h: f64| end(&compiled, Steps::fixed(h), 1.0, "x").abs().max(end(&compiled, Steps::fixed(h), 1.0, "y").abs());
    let (coarse, fine) = (off(2e-3), off(1e-3));
    assert!(fine < 1e-5 && coarse / fine > 3.0, "{coarse:e} and {fine:e}");
    let mut sim = start(&compiled, Steps::fixed(1e-3));
    finish(&mut sim, 10.0);
    let ledger = sim.summary();
    assert!(ledger.passive && ledger.total < 1e-11, "{:?} {}", ledger.reasons, ledger.total);
    close(ledger.regions[0].h_final, ledger.regions[0].h_initial, 1e-11 * ledger.regions[0].h_initial, "H");
}

/// A nonlinear storage with a linear one in parallel is one nonlinear storage: against the merged element itself.
#[test]
fn a_linear_storage_beside_a_curved_one_is_merged() {
    let tied = with(
        Options::new().method("gonzalez"),
        "model T { C:a { H = 1 V/C^3 * q^4/4 + 1 V/C * q^2/2; q0 = 1 C }; C:b = 0.5 F; I:l = 1 H
           0:n -> l; a -> n; b -> n; probe v = n.e; probe q = b.q; probe i = l.f }",
    );
    let [x, y, z] = [4e-3, 2e-3, 1e-3].map(|h| end(&tied, Steps::fixed(h), 3.0, "v"));
    close(((x - y) / (y - z)).log2(), 2.0, 0.1, "order");
    // dv/dt (dqa/dv + C) = -i, di/dt = v, by a classical Runge-Kutta step in the charge of a.
    let rate = |q: f64, i: f64| {
        let slope = 3.0 * q * q + 1.0;
        (-i / (1.0 + 0.5 * slope), q * q * q + q)
    };
    let (mut q, mut i, h) = (1.0f64, 0.0f64, 1e-4);
    for _ in 0..30_000 {
        let k1 = rate(q, i);
        let k2 = rate(q + 0.5 * h * k1.0, i + 0.5 * h * k1.1);
        let k3 = rate(q + 0.5 * h * k2.0, i + 0.5 * h * k2.1);
        let k4 = rate(q + h * k3.0, i + h * k3.1);
        q += h / 6.0 * (k1.0 + 2.0 * k2.0 + 2.0 * k3.0 + k4.0);
        i += h / 6.0 * (k1.1 + 2.0 * k2.1 + 2.0 * k3.1 + k4.1);
    }
    close(z + (z - y) / 3.0, q * q * q + q, 1e-9, "v");
    close(end(&tied, Steps::fixed(1e-3), 3.0, "q"), 0.5 * (q * q * q + q), 1e-5, "charge of b");
    let mut sim = start(&tied, Steps::fixed(1e-2));
    finish(&mut sim, 100.0);
    assert!(sim.summary().passive && sim.summary().worst_step < 1e-13);
}

/// A capacitor loop with a source: the divided voltage at once, then the closed form; the source's charge is in the
/// ledger.
#[test]
fn storages_follow_sources() {
    let compiled = with(
        Options::new().method("gonzalez"),
        "model L { Se:u = 10 V * cos(100 Hz * t); C:c1 = 1 uF; C:c2 = 2 uF; R:r = 1 kOhm
           u -> 1:s -> c1; s -> 0:n -> c2, r; probe v = c2.e; probe i = u.f; probe q1 = c1.q; probe q2 = c2.q }",
    );
    // v' (C1 + C2) + v/R = C1 u'. c1 starts without charge, so that v starts at u.
    let (c1, c, r, w, t) = (1e-6, 3e-6, 1e3, 100.0, 0.05);
    let tau: f64 = r * c;
    let x = w * tau;
    // v = A cos + B sin + D exp(-t/tau), from v' = (c1/c) u' - v/tau
    let k = 10.0 * c1 / c;
    let (a, b) = (k * x * x / (1.0 + x * x), -k * x / (1.0 + x * x));
    let wanted = |t: f64| a * (w * t).cos() + b * (w * t).sin() + (10.0 - a) * (-t / tau).exp();
    let [p, q, s] = [4e-5, 2e-5, 1e-5].map(|h| end(&compiled, Steps::fixed(h), t, "v"));
    close(((p - q) / (q - s)).log2(), 2.0, 0.1, "order");
    close(s + (s - q) / 3.0, wanted(t), 1e-8, "v");
    let mut sim = start(&compiled, Steps::fixed(1e-4));
    close(probe(&mut sim, "v"), 10.0, 1e-12, "v at the start");
    finish(&mut sim, 100.0);
    let ledger = sim.summary();
    assert!(ledger.passive, "{:?}", ledger.reasons);
    close(probe(&mut sim, "q1") / 1e-6 + probe(&mut sim, "v"), 10.0 * (100.0 * 100f64).cos(), 1e-9, "loop of voltages");
}

/// First and second law of a heater and of heat between two bodies.
#[test]
fn entropy_never_falls() {
    let compiled = text(
        "model H(c = 100 J/K, g = 2 W/K) {
           Se:u = 10 V * sin(1 Hz * t); RS(r, th):heater = 5 Ohm
           C:a { H = c * 300 K * exp(q/c) }; C:b { H = c * 250 K * exp(q/c) }
           R(x, y):wall { x.f = g*(x.e - y.e)/x.e; y.f = g*(y.e - x.e)/y.e }
           u -> heater.r; heater.th -> 0:Ta; a -> Ta -> wall.x; b -> 0:Tb -> wall.y
           probe s = a.q + b.q; probe Ta_ = Ta.e; probe Tb_ = Tb.e }",
    );
    for steps in [Steps::fixed(0.5), Steps::fixed(20.0), Steps::tolerance(1e-6)] {
        let mut sim = start(&compiled, steps);
        let mut s = probe(&mut sim, "s");
        for k in 1..=50 {
            advance(&mut sim, 20.0 * f64::from(k));
            let next = probe(&mut sim, "s");
            assert!(next >= s - 1e-12 * s.abs(), "entropy fell from {s} to {next}");
            s = next;
        }
        let ledger = sim.summary();
        assert!(ledger.passive, "{:?}", ledger.reasons);
        let region = &ledger.regions[0];
        let produced: f64 = region.produced.iter().map(|p| p.entropy).sum();
        assert_eq!(region.produced.len(), 2);
        // The bodies' entropy is what was produced, and their energy what the source put in.
        close(produced, s, 1e-9 * s, "entropy");
        close(region.h_final - region.h_initial, region.supplied, 1e-9 * region.h_final, "energy");
    }
}

/// Stick and slip on a moving belt: sticks to the closed form's force, slips at Fc; converges; never gives energy.
#[test]
fn friction_sticks_and_slips() {
    let compiled = text(
        "model S(Fc = 1 N, k = 10 N/m, v0 = 0.1 m/s) {
           Sf:belt = v0; I:m = 1 kg; C:spring { stiffness = k }
           R:dry { e = Fc * min(max(s, -1), 1); f = (s - min(max(s, -1), 1)) * 1 m/s }
           1:v -> m, spring; belt -> 0:F -> dry; F -> v
           probe x = spring.q; probe v_ = v.f; probe force = dry.e }",
    );
    // Starting at rest the block slips, F = Fc: x = Fc/k (1 - cos w t) until its speed is the belt's.
    let w = 10f64.sqrt();
    let stuck = ((0.1 * w / 1.0) * (10.0 / 10.0)).asin() / w;
    close(
        end(&compiled, Steps::fixed(1e-3), 0.5 * stuck, "x"),
        0.1 * (1.0 - (0.5 * w * stuck).cos()),
        1e-7,
        "slipping",
    );
    let mut sim = start(&compiled, Steps::fixed(1e-3));
    advance(&mut sim, stuck + 0.2);
    // The mean over a step is the belt's speed; its ends keep what the step into sticking left, of order h.
    close(probe(&mut sim, "v_"), 0.1, 5e-4, "sticking");
    finish(&mut sim, 100.0);
    let ledger = sim.summary();
    assert!(ledger.passive, "{:?}", ledger.reasons);
    // The block oscillates between sticking and slipping without end, or rests in balance; its force never exceeds Fc.
    assert!(probe(&mut sim, "force").abs() <= 1.0 + 1e-12);
    let [a, b, c] = [2e-3, 1e-3, 5e-4].map(|h| end(&compiled, Steps::fixed(h), 5.0, "x"));
    assert!((b - c).abs() < 0.75 * (a - b).abs() + 1e-8, "{a} {b} {c}");
}

/// A rectifier of ideal diodes with on and off slopes, and one of Shockley diodes: the peak less the drops, energy
/// closed.
#[test]
fn rectifiers_find_their_own_start() {
    let bridge = |law: fn(&str) -> String| {
        format!(
            "model B {{
               Se:u = 20 V * sin(314 Hz * t); R:rs = 1 Ohm; C:c = 100 uF; R:load = 1 kOhm
               {} {} {} {}
               u -> 1:src -> rs; 0:a; 0:b; 0:p
               src -> a; b -> src
               a -> 1:j1 -> p; j1 -> d1; b -> 1:j2 -> p; j2 -> d2
               d3 -> a; d4 -> b; p -> c, load
               probe v = c.e }}",
            law("d1"),
            law("d2"),
            law("d3"),
            law("d4")
        )
    };
    let ideal =
        |n: &str| format!("R:{n} {{ e = (min(s, 0) + 0.01*max(s, 0)) * 1 V; f = (max(s, 0) + 1e-9*min(s, 0)) * 1 A }}");
    let shockley = |n: &str| match n {
        "d1" | "d2" => format!("R:{n} {{ f = 1 nA * (exp(e / 50 mV) - 1) }}"),
        _ => format!("R:{n} {{ f = 1 nA * (1 - exp(-e / 50 mV)) }}"),
    };
    for (law, drop) in [(ideal as fn(&str) -> String, 0.0), (shockley, 2.0)] {
        let compiled = text(&bridge(law));
        let mut sim = start(&compiled, Steps::fixed(1e-5));
        finish(&mut sim, 0.015);
        let v = probe(&mut sim, "v");
        assert!((18.0 - drop..20.0 - 0.5 * drop).contains(&v), "{v}");
        let ledger = sim.summary();
        assert!(ledger.passive, "{:?}", ledger.reasons);
    }
}

/// A ratio that depends on the flow it sets: the quadratic's root.
#[test]
fn a_ratio_in_its_own_loop_is_solved() {
    let compiled = text(
        "model M { Se:u = 10 V; R:ri = 2 Ohm; TF:t = 1 + 0.1 A^-1 * ro.f; R:ro = 3 Ohm
           u -> 1:a -> ri; a -> t -> ro; probe i = ro.f }",
    );
    // f_out = n f_in, e_in = n e_out, n = 1 + 0.1 f_out: 10 = 2 f/n + 3 f n with f the output flow
    let i = end(&compiled, Steps::fixed(0.1), 0.2, "i");
    let n = 1.0 + 0.1 * i;
    close(2.0 * i / n + 3.0 * i * n, 10.0, 1e-12, "the loop");
}

/// A free rigid body as a ring of gyrators: the energy and the Casimir, momentum's square, are both quadratic and kept.
#[test]
fn a_ring_of_gyrators_keeps_its_casimir() {
    let compiled = text(
        "model Top { I:x { inertia = 1 kg*m^2; f0 = 0.01 rad/s }; I:y { inertia = 2 kg*m^2; f0 = 1 rad/s }
           I:z { inertia = 3 kg*m^2; f0 = 0.02 rad/s }
           GY:gz = z.p; GY:gx = x.p; GY:gy = y.p
           1:wx -> x; 1:wy -> y; 1:wz -> z
           wx -> gz -> wy; wy -> gx -> wz; wz -> gy -> wx
           probe c = x.p^2 + y.p^2 + z.p^2; probe wy_ = wy.f }",
    );
    let mut sim = start(&compiled, Steps::fixed(0.01));
    let c = probe(&mut sim, "c");
    let mut least = 1.0f64;
    for k in 1..=100 {
        advance(&mut sim, f64::from(k));
        close(probe(&mut sim, "c"), c, 1e-12 * c, "Casimir");
        least = least.min(probe(&mut sim, "wy_"));
    }
    assert!(least < -0.9, "it tumbles about its middle axis: {least}");
    let h = &sim.summary().regions[0];
    close(h.h_final, h.h_initial, 1e-12 * h.h_initial, "energy");
}

/// A field whose energy is not quadratic starts as what is tied to one of its ports says.
#[test]
fn a_field_starts_with_what_is_tied_to_it() {
    let compiled = text(
        "model M {
           IC(I L, C r):arm { H = L^2/(2*(1 kg*m^2 + 1 kg * r^2)) + 20 N/m * r^2/2; r_0 = 0.5 m }
           I:motor { inertia = 0.02 kg*m^2; f0 = 10 rad/s }
           R:b = 1 N*s/m
           1:w -> arm.L, motor
           1:v -> arm.r, b
           probe turn = arm.L
           probe speed = w.f
         }",
    );
    let mut sim = start(&compiled, Steps::fixed(1e-3));
    close(probe(&mut sim, "turn"), 12.5, 1e-14, "angular momentum of the arm");
    close(probe(&mut sim, "speed"), 10.0, 1e-14, "speed");
    finish(&mut sim, 1.0);
    assert!(sim.summary().worst_step <= 1e-12);
}

/// Stated starts of tied storages: each alone, both where they agree; the clash is refused (models/invalid).
#[test]
fn tied_storages_start_together() {
    let gear = |small: &str, large: &str| {
        text(&format!(
            "model G {{ I:small {{ inertia = 1 kg*m^2{small} }}; I:large {{ inertia = 4 kg*m^2{large} }}
               TF:gear = 0.5; 1:a -> small; a -> gear -> 1:b -> large; probe w = small.f; probe v = large.f }}"
        ))
    };
    for (small, large) in [("; f0 = 2 rad/s", ""), ("", "; f0 = 1 rad/s"), ("; f0 = 2 rad/s", "; f0 = 1 rad/s")] {
        let compiled = gear(small, large);
        close(end(&compiled, Steps::fixed(0.1), 0.0, "w"), 2.0, 1e-14, "small");
        close(end(&compiled, Steps::fixed(0.1), 0.0, "v"), 1.0, 1e-14, "large");
    }
}

/// Whether a coupled energy has a lower bound is told by its matrix, whatever the sign of the coupling; of what is no
/// quadratic, by looking between the states too.
#[test]
fn coupled_energies_are_bounded_or_not() {
    let energies = [
        ("50 N/m * x^2 - 120 N/m * x*y + 50 N/m * y^2", false),
        ("50 N/m * x^2 + 120 N/m * x*y + 50 N/m * y^2", false),
        ("50 N/m * x^2 - 100.0001 N/m * x*y + 50 N/m * y^2", false),
        ("50 N/m * x^2 - 99.9999 N/m * x*y + 50 N/m * y^2", true),
        ("1 N/m * (x - y)^2", true),
        ("1 N/m * (x - 2*y)^2 - 1 uN/m * x*y", false),
        ("1 N/m^3 * (x^4 + y^4 - 3*x*y^3)", false),
        ("1 N/m^3 * (x^4 + y^4 - x*y^3)", true),
    ];
    for (h, bounded) in energies {
        let compiled = text(&format!(
            "model M {{ C(x, y):c {{ H = {h} }}  I:a = 1 kg  I:b = 1 kg  1:u -> a, c.x  1:w -> b, c.y  probe x = c.x }}"
        ));
        let mut sim = start(&compiled, Steps::new());
        finish(&mut sim, 0.1);
        assert_eq!(sim.summary().passive, bounded, "{h}: {:?}", sim.summary().reasons);
    }
}

/// A field that gives at one port and takes at another: 2 (e^t - 1) A, and all that is lost there.
#[test]
fn active_fields_give_and_take_by_exact_steps() {
    let compiled = text(
        "model M { Se:u = 2 V  active R(a, b):r = [[-1 Ohm, 0 Ohm], [0 Ohm, 2 Ohm]]  I:l = 1 H  I:k { inertia = 1 H; f0 = 1 A }
           u -> 1:v -> r.a, l  1:w -> k, r.b  probe i = l.f  probe j = k.f }",
    );
    let mut sim = start(&compiled, Steps::new());
    finish(&mut sim, 1.0);
    close(probe(&mut sim, "i"), 2.0 * (f64::exp(1.0) - 1.0), 1e-12, "i");
    close(probe(&mut sim, "j"), f64::exp(-2.0), 1e-12, "j");
    let summary = sim.summary();
    // The integral of -i^2 + 2 j^2.
    let e = f64::exp(1.0);
    let lost = -4.0 * ((e * e - 1.0) / 2.0 - 2.0 * (e - 1.0) + 1.0) + (1.0 - f64::exp(-4.0)) / 2.0;
    close(summary.regions[0].dissipated, lost, 1e-12, "lost");
    assert!(summary.worst_step < 1e-12 && !summary.passive, "{summary:?}");
}

/// Laws that are linear are the matrix that they make, whichever variables they give: the region is stepped without
/// error.
#[test]
fn linear_laws_of_a_field_are_a_matrix() {
    let ends = [
        "= [[2 Ohm, 1 Ohm], [1 Ohm, 3 Ohm]]",
        "{ a.e = 2 Ohm * a.f + 1 Ohm * b.f; b.e = 1 Ohm * a.f + 3 Ohm * b.f }",
        "{ a.f = a.e/2 Ohm - b.f/2; b.e = a.e/2 + 2.5 Ohm * b.f }",
        "{ a.f = 0.6 S * a.e - 0.2 S * b.e; b.f = 0.4 S * b.e - 0.2 S * a.e }",
    ]
    .map(|law| {
        let compiled = text(&format!(
            "model M {{ Se:u = 2 V  R(a, b):r {law}  I:l = 1 H  I:k {{ inertia = 2 H; f0 = 1 A }}
               u -> 1:v -> r.a, l  1:w -> k, r.b  probe i = l.f  probe j = k.f }}"
        ));
        let mut sim = start(&compiled, Steps::new());
        finish(&mut sim, 1.0);
        let summary = sim.summary();
        assert!(summary.regions[0].stepper == "exact" && summary.passive, "{law}: {summary:?}");
        [probe(&mut sim, "i"), probe(&mut sim, "j"), summary.regions[0].dissipated]
    });
    for (i, end) in ends.iter().enumerate() {
        (0..3).for_each(|k| close(end[k], ends[0][k], 1e-14, &format!("{i}, {k}")));
    }
    let gives =
        "model M { Se:u = 1 V  R(a, b):r { a.e = 2 Ohm * a.f + 5 Ohm * b.f; b.e = 3 Ohm * b.f } u -> r.a u -> r.b }";
    assert!(errors(gives).to_string().contains("the laws of `r` give power"));
}

/// A rod of finite elements that is clamped by `Sf = 0`: 20 states, two of which the wall holds. Storages that follow a
/// constant source are stepped without error; by the modes of the clamped matrices, and by order 8.
#[test]
fn a_clamped_rod_is_stepped_exactly() {
    let rod = "model Rod(n = 10, m = 0.3 kg, k = 500 N/m) {
           Sf:wall = 0 m/s  wall -> 1:v[0]
           for i in 1..n {
             1:v[i]
             I(a, b):e[i] = [[m/3, m/6], [m/6, m/3]]
             C:s[i] { stiffness = k }
             v[i-1] -> e[i].a  v[i] -> e[i].b
             v[i-1] -> 0:f[i] -> v[i]  f[i] -> s[i]
           }
           Se:F = 10 N  F -> v[n]
           probe v3 = v[3].f
         }";
    let driven = "model Driven {
           Sf:drive = 0.3 m/s  I:a = 2 kg  I:b = 1 kg  C:k { stiffness = 40 N/m }  R:d = 0.5 N*s/m  TF:lever = 3
           drive -> 1:x -> a  x -> 0:n -> k  n -> 1:y -> d, lever  lever -> 1:z -> b
           probe v = z.f  probe force = drive.e  probe work = integral(drive.P, 0 J)
         }";
    let battery = "model Battery {
           Se:u = 5 V  C:c1 { compliance = 1 F; q0 = 1 C }  C:c2 = 2 F  R:r = 3 Ohm  I:l = 0.5 H
           u -> 1:loop -> c2  loop -> 0:n -> c1  n -> 1:branch -> r, l
           probe v = n.e  probe drawn = u.f  probe q2 = c2.q  probe given = integral(u.P, 0 J)
         }";
    close(end(&text(rod), Steps::new(), 5.0, "v3"), 0.358143, 2e-6, "v3");
    for model in [rod, driven, battery] {
        let (exact, high) = (text(model), with(Options::new().method("collocation8"), model));
        let (mut a, mut b) = (start(&exact, Steps::new()), start(&high, Steps::tolerance(1e-10)));
        finish(&mut a, 2.0);
        finish(&mut b, 2.0);
        let summary = a.summary();
        assert_eq!(summary.regions[0].stepper, "exact", "{model}");
        assert!(summary.passive && summary.worst_step < 1e-12 && summary.total < 1e-12, "{summary:?}");
        let names: Vec<String> = exact.scene().probes.names.clone();
        for name in names {
            close(probe(&mut a, &name), probe(&mut b, &name), 1e-7, &format!("{name} of {model}"));
        }
    }
}

/// A current goes on round two coils while a field of resistors lets the voltage die away to rounding. The number is of
/// an implicit Runge-Kutta method with tolerances of 1e-11.
#[test]
fn what_dies_away_in_a_field_is_rounding_of_what_goes_on() {
    let scene = "model Round {
      I:a = 0.4 H
      I:b { f = (p/(1 V*s)/0.38 + (p/(1 V*s))^3)*1 A; p0 = 0.4 V*s }
      R(a, b):r = [[1 Ohm, 0.5 Ohm], [0.5 Ohm, 2 Ohm]]
      0:n -> a, b
      n -> r.a, r.b
      probe ia = a.f
      simulate { stop = 10 s }
    }";
    for method in [None, Some("collocation4"), Some("radau")] {
        let compiled = with(method.into_iter().fold(Options::new(), |o, m| o.method(m)), scene);
        close(end(&compiled, Steps::new(), 10.0, "ia"), -0.51634802, 1e-3, "the current");
    }
}

/// Masses on one shaft, one by an exponential law whose size is far from 1 in SI units: the same motion in each.
#[test]
fn tied_storages_of_any_size() {
    for s in [1.0, 1e-3, 1e-6, 1e3] {
        let scene = format!(
            "model M(s = {s:e} N*s) {{
              Se:push = s/(1 s) * sin(2 Hz * t)
              I:m = 1 kg
              I:n {{ H = s^2/(1 kg) * cosh(p/s) }}
              R:r = 1 N*s/m
              push -> 1:v -> m, n, r
              probe x = v.f/s*1 kg
              simulate {{ stop = 1 s; tolerance = 1e-8 }}
            }}"
        );
        let compiled = with(Options::new(), &scene);
        let settings = &compiled.stages().model.settings;
        let options = Steps::new().resolve(settings, 1.0, None).unwrap();
        let mut sim = bond::Simulation::new(compiled.scene(), &options).unwrap();
        finish(&mut sim, 1.0);
        close(probe(&mut sim, "x"), 0.296001, 1e-5, &format!("{s:e}"));
    }
}
