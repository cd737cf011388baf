//! Cars: Newton and Euler for body and wheels.

use super::mechanics::{elastic, kinetic};
use super::{System, hand};

pub(super) fn systems() -> Vec<System> {
    vec![
        System {
            name: "quarter_car",
            states: &[
                ("tyre.q", -0.02, 0.05),
                ("wheel.p", -50.0, 50.0),
                ("spring.q", -0.1, 0.3),
                ("body.p", -300.0, 300.0),
            ],
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
            // A corner of the body moves with v + a w in front and v - b w behind; the struts turn the body by their
            // levers.
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
        System {
            name: "vehicle_handling",
            states: &[("forward.p", 6000.0, 30000.0), ("lateral.p", -1000.0, 1000.0), ("yaw.p", -1000.0, 1000.0)],
            until: 1.0,
            // In axes that turn with the car: m (u' - v r) = X, m (v' + u r) = Y, J r' = N. A tyre's side force,
            // across its wheel, is stiffness times slip angle.
            by_hand: |x| {
                let (u, v, r) = (x["forward.p"] / x["m"], x["lateral.p"] / x["m"], x["yaw.p"] / x["J"]);
                let (sin, cos) = x["delta"].sin_cos();
                let front = -x["front"] * ((v + x["a"] * r) * cos - u * sin) / u;
                let rear = -x["rear"] * (v - x["b"] * r) / u;
                hand(
                    [
                        ("forward.p", x["m"] * v * r + x["drag"] * (x["u0"] - u) - front * sin),
                        ("lateral.p", -x["m"] * u * r + front * cos + rear),
                        ("yaw.p", x["a"] * front * cos - x["b"] * rear),
                    ],
                    0.5 * x["m"] * (u * u + v * v) + 0.5 * x["J"] * r * r,
                )
            },
        },
    ]
}
