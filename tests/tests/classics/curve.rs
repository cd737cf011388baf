//! Laws with corners: dry friction and ideal diodes.

use super::{System, hand};

pub(super) fn systems() -> Vec<System> {
    vec![
        System {
            name: "stick_slip",
            states: &[("block.p", -0.5, 0.5), ("spring.q", -0.1, 0.1)],
            until: 1.0,
            // Coulomb: F against the speed, as long as there is one; m v' = k q - friction, q' = pull - v
            by_hand: |x| {
                let (v, q) = (x["block.p"] / x["m"], x["spring.q"]);
                hand(
                    [("block.p", x["k"] * q - x["F"] * v.signum()), ("spring.q", x["pull"] - v)],
                    0.5 * x["m"] * v * v + 0.5 * x["k"] * q * q,
                )
            },
        },
        System {
            name: "belt_friction",
            states: &[("mass.p", -0.5, 0.5), ("spring.q", -0.1, 0.1)],
            until: 1.0,
            // Coulomb: F towards the belt's speed as long as the two differ; m v' = friction - k x - b v
            by_hand: |x| {
                let (v, q) = (x["mass.p"] / x["m"], x["spring.q"]);
                let friction = x["F"] * (x["belt_speed"] - v).signum();
                hand(
                    [("mass.p", friction - x["k"] * q - x["b"] * v), ("spring.q", v)],
                    0.5 * x["m"] * v * v + 0.5 * x["k"] * q * q,
                )
            },
        },
        System {
            name: "ideal_rectifier",
            states: &[("cap.q", -0.016, 0.016)],
            until: 0.02,
            // The diode conducts where the mains is above the capacitor.
            by_hand: |x| {
                let mains = x["u"] * (2.0 * std::f64::consts::PI * x["freq"] * x.t).sin();
                let out = x["cap.q"] / x["c"];
                let current = ((mains - out) / x["r"]).max(0.0);
                hand([("cap.q", current - out / x["load"])], 0.5 * x["c"] * out * out)
            },
        },
    ]
}
