//! Shafts, belts and gears: Euler's second law, wheel by wheel.

use super::mechanics::{elastic, kinetic};
use super::{System, hand};

pub(super) fn systems() -> Vec<System> {
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
            states: &[
                ("small.p", -2.0, 2.0),
                ("large.p", -5.0, 5.0),
                ("pulling.q", -0.01, 0.01),
                ("returning.q", -0.01, 0.01),
            ],
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
