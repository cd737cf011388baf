//! Masses, springs and dampers: Newton's second law, mass by mass.

use super::{System, hand};

/// p^2/(2 m)
pub(super) fn kinetic(p: f64, m: f64) -> f64 {
    p * p / (2.0 * m)
}

/// k q^2/2
pub(super) fn elastic(k: f64, q: f64) -> f64 {
    0.5 * k * q * q
}

pub(super) fn systems() -> Vec<System> {
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
            states: &[
                ("machine.p", -1.0, 1.0),
                ("absorber.p", -1.0, 1.0),
                ("mount.q", -0.01, 0.01),
                ("neck.q", -0.1, 0.1),
            ],
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
