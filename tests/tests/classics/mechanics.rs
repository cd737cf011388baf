//! Masses, springs, shafts and gears: Newton's second law, mass by mass.

use super::{System, hand};

/// p^2/(2 m)
fn kinetic(p: f64, m: f64) -> f64 {
    p * p / (2.0 * m)
}

/// k q^2/2
fn elastic(k: f64, q: f64) -> f64 {
    0.5 * k * q * q
}

pub(super) fn systems() -> Vec<System> {
    let mut list = rows();
    list.extend(cars());
    list.extend(shafts());
    list
}

/// Masses in a row.
fn rows() -> Vec<System> {
    vec![
        System {
            name: "mass_spring_damper",
            states: &[("mass.p", -1.0, 1.0), ("spring.q", -0.1, 0.1)],
            until: 1.0,
            // m x'' = push - k x - b x'
            by_hand: |x| {
                let (v, q) = (x["mass.p"] / x["m"], x["spring.q"]);
                let energy = kinetic(x["mass.p"], x["m"]) + elastic(x["k"], q);
                hand([("mass.p", x["push"] - x["k"] * q - x["b"] * v), ("spring.q", v)], energy)
            },
        },
        System {
            name: "two_masses",
            states: &[("first.p", -1.0, 1.0), ("second.p", -1.0, 1.0), ("inner.q", -0.1, 0.1), ("outer.q", -0.1, 0.1)],
            until: 1.0,
            // m1 x1'' = -k1 x1 + F, m2 x2'' = pull - F, F = k2 (x2 - x1) + b (x2' - x1')
            by_hand: |x| {
                let (v1, v2) = (x["first.p"] / x["m1"], x["second.p"] / x["m2"]);
                let force = x["k2"] * x["outer.q"] + x["b"] * (v2 - v1);
                hand(
                    [
                        ("inner.q", v1),
                        ("first.p", force - x["k1"] * x["inner.q"]),
                        ("outer.q", v2 - v1),
                        ("second.p", x["pull"] - force),
                    ],
                    kinetic(x["first.p"], x["m1"])
                        + kinetic(x["second.p"], x["m2"])
                        + elastic(x["k1"], x["inner.q"])
                        + elastic(x["k2"], x["outer.q"]),
                )
            },
        },
        System {
            name: "vibration_absorber",
            states: &[("machine.p", -1.0, 1.0), ("absorber.p", -1.0, 1.0), ("mount.q", -0.01, 0.01), ("neck.q", -0.1, 0.1)],
            until: 1.0,
            // m1 x1'' = F sin(w t) - k1 x1 - b1 x1' - k2 (x1 - x2), m2 x2'' = k2 (x1 - x2), k2 = m2 w^2
            by_hand: |x| {
                let (v1, v2) = (x["machine.p"] / x["m1"], x["absorber.p"] / x["m2"]);
                let k2 = x["m2"] * x["w"] * x["w"];
                let (shaking, neck) = (x["amplitude"] * (x["w"] * x.t).sin(), k2 * x["neck.q"]);
                hand(
                    [
                        ("machine.p", shaking - x["k1"] * x["mount.q"] - x["b1"] * v1 - neck),
                        ("mount.q", v1),
                        ("neck.q", v1 - v2),
                        ("absorber.p", neck),
                    ],
                    kinetic(x["machine.p"], x["m1"])
                        + kinetic(x["absorber.p"], x["m2"])
                        + elastic(x["k1"], x["mount.q"])
                        + elastic(k2, x["neck.q"]),
                )
            },
        },
        System {
            name: "accelerometer",
            states: &[("mass.p", -1e-3, 1e-3), ("spring.q", -1e-4, 1e-4)],
            until: 1.0,
            // m x'' = k s + b s' with the stretch s' = case's velocity - x'
            by_hand: |x| {
                let v = x["mass.p"] / x["m"];
                let rate = x["a"] * (x["w"] * x.t).sin() - v;
                let energy = kinetic(x["mass.p"], x["m"]) + elastic(x["k"], x["spring.q"]);
                hand([("spring.q", rate), ("mass.p", x["k"] * x["spring.q"] + x["b"] * rate)], energy)
            },
        },
        System {
            name: "double_well",
            states: &[("mass.p", -4.0, 4.0), ("valleys.q", -3.0, 3.0)],
            until: 1.0,
            // m x'' = a x - b x^3 - d x'
            by_hand: |x| {
                let (q, v) = (x["valleys.q"], x["mass.p"] / x["m"]);
                let force = x["a"] * q - x["b"] * q.powi(3) - x["d"] * v;
                let energy = kinetic(x["mass.p"], x["m"]) + x["b"] * q.powi(4) / 4.0 - x["a"] * q * q / 2.0;
                hand([("mass.p", force), ("valleys.q", v)], energy)
            },
        },
        System {
            name: "muscle",
            states: &[("load.p", -2.0, 2.0), ("passive_spring.q", -0.1, 0.1), ("tendon.q", -0.005, 0.008)],
            until: 2.0,
            // The fibre shortens with the tension that the active force does not hold: b v_fibre = T - active;
            // the tendon takes up the rest of the length, m v' = m g - k x - T.
            by_hand: |x| {
                let v = x["load.p"] / x["m"];
                let (q, f, l) = (x["tendon.q"], x["f_tendon"], x["l_tendon"]);
                let tension = f * (q / l).exp_m1();
                let active = if x.t > 1.0 { x["active"] } else { 0.0 };
                hand(
                    [
                        ("load.p", x["m"] * x["g"] - x["k"] * x["passive_spring.q"] - tension),
                        ("passive_spring.q", v),
                        ("tendon.q", v - (tension - active) / x["b"]),
                    ],
                    kinetic(x["load.p"], x["m"])
                        + elastic(x["k"], x["passive_spring.q"])
                        + f * (l * (q / l).exp_m1() - q),
                )
            },
        },
    ]
}

/// Cars on their springs.
fn cars() -> Vec<System> {
    vec![
        System {
            name: "quarter_car",
            states: &[("tyre.q", -0.02, 0.05), ("wheel.p", -50.0, 50.0), ("spring.q", -0.1, 0.3), ("body.p", -300.0, 300.0)],
            until: 10.0,
            // The strut pushes body and wheel apart, S = k s + b s'; the tyre pushes the wheel up.
            by_hand: |x| {
                let (wheel, body) = (x["wheel.p"] / x["wheel_mass"], x["body.p"] / x["body_mass"]);
                let pi = std::f64::consts::PI;
                let on_bump = x.t > 5.0 && x.t < 6.0;
                let road = if on_bump { pi * x["bump"] * (2.0 * pi * x.t).sin() } else { 0.0 };
                let strut = x["k"] * x["spring.q"] + x["b"] * (wheel - body);
                hand(
                    [
                        ("tyre.q", road - wheel),
                        ("wheel.p", x["k_tyre"] * x["tyre.q"] - strut - x["wheel_mass"] * x["g"]),
                        ("spring.q", wheel - body),
                        ("body.p", strut - x["body_mass"] * x["g"]),
                    ],
                    kinetic(x["wheel.p"], x["wheel_mass"])
                        + kinetic(x["body.p"], x["body_mass"])
                        + elastic(x["k"], x["spring.q"])
                        + elastic(x["k_tyre"], x["tyre.q"]),
                )
            },
        },
        System {
            name: "half_car",
            states: &[
                ("front_tyre.q", -0.02, 0.05),
                ("rear_tyre.q", -0.02, 0.05),
                ("front_wheel.p", -50.0, 50.0),
                ("rear_wheel.p", -50.0, 50.0),
                ("front_spring.q", -0.1, 0.3),
                ("rear_spring.q", -0.1, 0.3),
                ("body.p", -500.0, 500.0),
                ("turn.p", -500.0, 500.0),
            ],
            until: 7.0,
            // A corner of the body moves with v + a w in front and v - b w behind; the struts turn the body by their levers.
            by_hand: |x| {
                let (v, w) = (x["body.p"] / x["body_mass"], x["turn.p"] / x["J"]);
                let (front, rear) = (x["front_wheel.p"] / x["wheel_mass"], x["rear_wheel.p"] / x["wheel_mass"]);
                let (s1, s2) = (front - (v + x["a"] * w), rear - (v - x["b"] * w));
                let f1 = x["k"] * x["front_spring.q"] + x["d"] * s1;
                let f2 = x["k"] * x["rear_spring.q"] + x["d"] * s2;
                let road = if x.t > 6.0 && x.t < 6.1 { 0.4 } else { 0.0 };
                hand(
                    [
                        ("front_tyre.q", road - front),
                        ("front_wheel.p", x["k_tyre"] * x["front_tyre.q"] - f1),
                        ("front_spring.q", s1),
                        ("rear_tyre.q", -rear),
                        ("rear_wheel.p", x["k_tyre"] * x["rear_tyre.q"] - f2),
                        ("rear_spring.q", s2),
                        ("body.p", f1 + f2 - x["body_mass"] * x["g"]),
                        ("turn.p", x["a"] * f1 - x["b"] * f2),
                    ],
                    kinetic(x["body.p"], x["body_mass"])
                        + kinetic(x["turn.p"], x["J"])
                        + kinetic(x["front_wheel.p"], x["wheel_mass"])
                        + kinetic(x["rear_wheel.p"], x["wheel_mass"])
                        + elastic(x["k"], x["front_spring.q"])
                        + elastic(x["k"], x["rear_spring.q"])
                        + elastic(x["k_tyre"], x["front_tyre.q"])
                        + elastic(x["k_tyre"], x["rear_tyre.q"]),
                )
            },
        },
    ]
}

/// Shafts, belts and gears.
fn shafts() -> Vec<System> {
    vec![
        System {
            name: "torsional_shaft",
            states: &[
                ("disc1.p", -30.0, 30.0),
                ("disc2.p", -30.0, 30.0),
                ("disc3.p", -30.0, 30.0),
                ("shaft1.q", -0.2, 0.2),
                ("shaft2.q", -0.2, 0.2),
            ],
            until: 1.0,
            // A piece of shaft passes on T = k (angle before - angle behind) + d times the rate of that.
            by_hand: |x| {
                let w = [x["disc1.p"] / x["J1"], x["disc2.p"] / x["J2"], x["disc3.p"] / x["J3"]];
                let t1 = x["k1"] * x["shaft1.q"] + x["d"] * (w[0] - w[1]);
                let t2 = x["k2"] * x["shaft2.q"] + x["d"] * (w[1] - w[2]);
                hand(
                    [
                        ("disc1.p", -t1),
                        ("disc2.p", t1 - t2),
                        ("disc3.p", t2),
                        ("shaft1.q", w[0] - w[1]),
                        ("shaft2.q", w[1] - w[2]),
                    ],
                    kinetic(x["disc1.p"], x["J1"])
                        + kinetic(x["disc2.p"], x["J2"])
                        + kinetic(x["disc3.p"], x["J3"])
                        + elastic(x["k1"], x["shaft1.q"])
                        + elastic(x["k2"], x["shaft2.q"]),
                )
            },
        },
        System {
            name: "geared_inertias",
            states: &[("first.p", -5.0, 5.0)],
            until: 1.0,
            // Seen from the first wheel: (J1 + ratio^2 J2) w' = torque - ratio^2 b w. The state is that momentum, J w.
            by_hand: |x| {
                let square = x["ratio"] * x["ratio"];
                let inertia = x["J1"] + square * x["J2"];
                let w = x["first.p"] / inertia;
                hand([("first.p", x["torque"] - square * x["b"] * w)], 0.5 * inertia * w * w)
            },
        },
        System {
            name: "rack_pinion",
            states: &[("pinion.p", -0.5, 0.5), ("spring.q", -0.2, 0.2)],
            until: 1.0,
            // v = r w: (J + m r^2) w' = torque - r k x. The state is that momentum.
            by_hand: |x| {
                let inertia = x["J"] + x["m"] * x["r"] * x["r"];
                let w = x["pinion.p"] / inertia;
                hand(
                    [("pinion.p", x["torque"] - x["r"] * x["k"] * x["spring.q"]), ("spring.q", x["r"] * w)],
                    0.5 * inertia * w * w + elastic(x["k"], x["spring.q"]),
                )
            },
        },
        System {
            name: "belt_drive",
            states: &[("small.p", -2.0, 2.0), ("large.p", -5.0, 5.0), ("pulling.q", -0.01, 0.01), ("returning.q", -0.01, 0.01)],
            until: 1.0,
            // A strand runs on to one pulley and off the other: it stretches by the difference of their rims.
            by_hand: |x| {
                let (w1, w2) = (x["small.p"] / x["J1"], x["large.p"] / x["J2"]);
                let slip = x["r1"] * w1 - x["r2"] * w2;
                let upper = x["k"] * x["pulling.q"] + x["d"] * slip;
                let lower = x["k"] * x["returning.q"] - x["d"] * slip;
                hand(
                    [
                        ("small.p", x["torque"] - x["r1"] * (upper - lower)),
                        ("pulling.q", slip),
                        ("returning.q", -slip),
                        ("large.p", x["r2"] * (upper - lower) - x["load"] * w2),
                    ],
                    kinetic(x["small.p"], x["J1"])
                        + kinetic(x["large.p"], x["J2"])
                        + elastic(x["k"], x["pulling.q"])
                        + elastic(x["k"], x["returning.q"]),
                )
            },
        },
    ]
}
