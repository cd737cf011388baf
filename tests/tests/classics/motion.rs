//! Pendulums, bodies that turn, and orbits: Newton and Lagrange where the geometry moves.

use super::{System, hand};

pub(super) fn systems() -> Vec<System> {
    let mut list = pendulums();
    list.extend(bodies());
    list.extend(linkages());
    list
}

fn pendulums() -> Vec<System> {
    vec![
        System {
            name: "pendulum",
            states: &[("bob.p", -3.0, 3.0), ("weight.q", -7.0, 7.0)],
            until: 1.0,
            // m l^2 a'' = -m g l sin(a)
            by_hand: |x| {
                let (inertia, a) = (x["m"] * x["len"].powi(2), x["weight.q"]);
                let w = x["bob.p"] / inertia;
                let weight = x["m"] * x["g"] * x["len"];
                let energy = 0.5 * inertia * w * w + weight * (1.0 - a.cos());
                hand([("bob.p", -weight * a.sin()), ("weight.q", w)], energy)
            },
        },
        System {
            name: "coupled_pendulums",
            states: &[
                ("left.p", -3.0, 3.0),
                ("right.p", -3.0, 3.0),
                ("left_weight.q", -3.0, 3.0),
                ("right_weight.q", -3.0, 3.0),
                ("spring.q", -3.0, 3.0),
            ],
            until: 1.0,
            // The spring's twist s has s' = a1' - a2'; it pulls the two together.
            by_hand: |x| {
                let inertia = x["m"] * x["len"].powi(2);
                let weight = x["m"] * x["g"] * x["len"];
                let (w1, w2) = (x["left.p"] / inertia, x["right.p"] / inertia);
                let (a1, a2) = (x["left_weight.q"], x["right_weight.q"]);
                let torque = x["k"] * x["spring.q"];
                hand(
                    [
                        ("left.p", -weight * a1.sin() - torque),
                        ("left_weight.q", w1),
                        ("right.p", -weight * a2.sin() + torque),
                        ("right_weight.q", w2),
                        ("spring.q", w1 - w2),
                    ],
                    0.5 * inertia * (w1 * w1 + w2 * w2)
                        + weight * (2.0 - a1.cos() - a2.cos())
                        + 0.5 * x["k"] * x["spring.q"].powi(2),
                )
            },
        },
        System {
            name: "spring_pendulum",
            states: &[("mass_x.p", -1.0, 1.0), ("mass_y.p", -1.0, 1.0), ("band.q", -0.3, 0.3), ("angle.q", -4.0, 4.0)],
            until: 1.0,
            // Newton in x and y, the band's force along it; r' and r a' are the velocity's parts along and across.
            by_hand: |x| {
                let (vx, vy) = (x["mass_x.p"] / x["m"], x["mass_y.p"] / x["m"]);
                let (sin, cos) = x["angle.q"].sin_cos();
                let force = x["k"] * x["band.q"];
                hand(
                    [
                        ("mass_x.p", -force * sin),
                        ("mass_y.p", force * cos - x["m"] * x["g"]),
                        ("band.q", vx * sin - vy * cos),
                        ("angle.q", (vx * cos + vy * sin) / (x["len"] + x["band.q"])),
                    ],
                    0.5 * x["m"] * (vx * vx + vy * vy) + 0.5 * x["k"] * x["band.q"].powi(2),
                )
            },
        },
    ]
}

fn bodies() -> Vec<System> {
    vec![
        System {
            name: "rigid_body",
            states: &[("x.p", -4.0, 4.0), ("y.p", -4.0, 4.0), ("z.p", -4.0, 4.0)],
            until: 1.0,
            // Euler in the body's frame: J1 w1' = (J2 - J3) w2 w3, and round.
            by_hand: |x| {
                let j = [x["J1"], x["J2"], x["J3"]];
                let w = [x["x.p"] / j[0], x["y.p"] / j[1], x["z.p"] / j[2]];
                let torque = |a: usize, b: usize| (j[a] - j[b]) * w[a] * w[b];
                let energy = 0.5 * (j[0] * w[0] * w[0] + j[1] * w[1] * w[1] + j[2] * w[2] * w[2]);
                hand([("x.p", torque(1, 2)), ("y.p", torque(2, 0)), ("z.p", torque(0, 1))], energy)
            },
        },
        System {
            name: "rate_gyro",
            states: &[("gimbal.p", -1e-3, 1e-3), ("spring.q", -0.1, 0.1)],
            until: 0.3,
            // Turning the rotor's momentum L by the rate calls for the torque L rate across.
            by_hand: |x| {
                let (w, q) = (x["gimbal.p"] / x["J"], x["spring.q"]);
                let rate = if x.t > 0.1 { x["rate"] } else { 0.0 };
                let torque = x["L"] * rate - x["k"] * q - x["b"] * w;
                hand([("gimbal.p", torque), ("spring.q", w)], 0.5 * x["J"] * w * w + 0.5 * x["k"] * q * q)
            },
        },
    ]
}

/// Ratios that change with an angle, and masses that follow them.
fn linkages() -> Vec<System> {
    vec![
        System {
            name: "pendulum_cartesian",
            states: &[("angle.q", -7.0, 7.0), ("mass_x.p'", -3.0, 3.0)],
            until: 1.0,
            // On the circle: m len a'' = -m g sin(a). The state that the two masses share is the momentum along it,
            // m len a'.
            by_hand: |x| {
                let speed = x["mass_x.p'"] / x["m"];
                let fall = -x["m"] * x["g"] * x["angle.q"].sin();
                hand([("angle.q", speed / x["len"]), ("mass_x.p'", fall)], 0.5 * x["m"] * speed * speed)
            },
        },
        System {
            name: "slider_crank",
            states: &[("flywheel.p", -2.0, 2.0), ("angle.q", -4.0, 4.0), ("spring.q", -0.1, 0.1)],
            until: 1.0,
            // Piston at x(a) = r cos(a) + sqrt(rod^2 - r^2 sin(a)^2).
            // L = (J + m x'(a)^2) w^2/2 - k s^2/2 with the momentum p = (J + m x'^2) w as the state:
            // p' = m x' x'' w^2 - k s x'.
            by_hand: |s| {
                let (r, rod) = (s["r"], s["rod"]);
                let (sin, cos) = s["angle.q"].sin_cos();
                let root = (rod * rod - r * r * sin * sin).sqrt();
                let x1 = -r * sin - r * r * sin * cos / root;
                let x2 = -r * cos - r * r * (cos * cos - sin * sin) / root - (r * r * sin * cos).powi(2) / root.powi(3);
                let inertia = s["J"] + s["m"] * x1 * x1;
                let w = s["flywheel.p"] / inertia;
                let push = s["k"] * s["spring.q"];
                hand(
                    [("flywheel.p", s["m"] * x1 * x2 * w * w - push * x1), ("angle.q", w), ("spring.q", x1 * w)],
                    0.5 * inertia * w * w + 0.5 * s["k"] * s["spring.q"].powi(2),
                )
            },
        },
    ]
}
