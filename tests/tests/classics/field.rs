//! Fields: Lagrange where the kinetic energy depends on the angle, and forces as gradients of energies that several
//! states share.

use super::{System, hand};

pub(super) fn systems() -> Vec<System> {
    let mut list = swinging();
    list.extend(orbits());
    list.extend(electric());
    list
}

fn swinging() -> Vec<System> {
    vec![
        System {
            name: "double_pendulum",
            states: &[("arms.p1", -5.0, 5.0), ("arms.p2", -3.0, 3.0), ("arms.a1", -4.0, 4.0), ("arms.a2", -4.0, 4.0)],
            until: 1.0,
            // L = (m1 + m2) l1^2 w1^2/2 + m2 l2^2 w2^2/2 + m2 l1 l2 w1 w2 cos(a1 - a2) - weights;
            // p = dL/dw is solved for w, and p' = dL/da.
            by_hand: |x| {
                let (a1, a2, p1, p2) = (x["arms.a1"], x["arms.a2"], x["arms.p1"], x["arms.p2"]);
                let (sum, m2, l1, l2, g) = (x["m1"] + x["m2"], x["m2"], x["l1"], x["l2"], x["g"]);
                let (sin, cos) = (a1 - a2).sin_cos();
                let (i11, i12, i22) = (sum * l1 * l1, m2 * l1 * l2 * cos, m2 * l2 * l2);
                let det = i11 * i22 - i12 * i12;
                let (w1, w2) = ((i22 * p1 - i12 * p2) / det, (i11 * p2 - i12 * p1) / det);
                let turn = m2 * l1 * l2 * w1 * w2 * sin;
                hand(
                    [
                        ("arms.p1", -turn - sum * g * l1 * a1.sin()),
                        ("arms.p2", turn - m2 * g * l2 * a2.sin()),
                        ("arms.a1", w1),
                        ("arms.a2", w2),
                    ],
                    0.5 * (i11 * w1 * w1 + i22 * w2 * w2)
                        + i12 * w1 * w2
                        + sum * g * l1 * (1.0 - a1.cos())
                        + m2 * g * l2 * (1.0 - a2.cos()),
                )
            },
        },
        System {
            name: "crane_trolley",
            states: &[("crane.p", -300.0, 300.0), ("crane.s", -900.0, 900.0), ("crane.a", -3.0, 3.0)],
            until: 2.0,
            // L = (M + m) v^2/2 + m l^2 w^2/2 + m l v w cos(a) + m g l cos(a): p' = F - b v,
            // s' = -m l v w sin(a) - m g l sin(a)
            by_hand: |x| {
                let (big, m, l, a) = (x["trolley"], x["load"], x["len"], x["crane.a"]);
                let (sin, cos) = a.sin_cos();
                let (i11, i12, i22) = (big + m, m * l * cos, m * l * l);
                let det = i11 * i22 - i12 * i12;
                let (p, s) = (x["crane.p"], x["crane.s"]);
                let (v, w) = ((i22 * p - i12 * s) / det, (i11 * s - i12 * p) / det);
                let drive = if x.t < 1.0 { x["push"] } else { 0.0 };
                hand(
                    [
                        ("crane.p", drive - x["b"] * v),
                        ("crane.s", -m * l * v * w * sin - m * x["g"] * l * sin),
                        ("crane.a", w),
                    ],
                    0.5 * (i11 * v * v + i22 * w * w) + i12 * v * w + m * x["g"] * l * (1.0 - cos),
                )
            },
        },
    ]
}

fn orbits() -> Vec<System> {
    vec![
        System {
            name: "henon_heiles",
            states: &[("mass_x.p", -1.0, 1.0), ("mass_y.p", -1.0, 1.0), ("field.x", -1.0, 1.0), ("field.y", -1.0, 1.0)],
            until: 1.0,
            // m x'' = -k x - 2 c x y, m y'' = -k y - c (x^2 - y^2)
            by_hand: |s| {
                let (x, y, k, c) = (s["field.x"], s["field.y"], s["k"], s["c"]);
                let (vx, vy) = (s["mass_x.p"] / s["m"], s["mass_y.p"] / s["m"]);
                hand(
                    [
                        ("mass_x.p", -k * x - 2.0 * c * x * y),
                        ("mass_y.p", -k * y - c * (x * x - y * y)),
                        ("field.x", vx),
                        ("field.y", vy),
                    ],
                    0.5 * s["m"] * (vx * vx + vy * vy) + 0.5 * k * (x * x + y * y) + c * (x * x * y - y.powi(3) / 3.0),
                )
            },
        },
        System {
            name: "kepler",
            states: &[("planet_x.p", -1.0, 1.0), ("planet_y.p", -1.0, 1.0), ("sun.x", -2.0, 2.0), ("sun.y", -2.0, 2.0)],
            until: 1.0,
            // Newton's gravity: r'' = -mu r/|r|^3
            by_hand: |s| {
                let (x, y, m) = (s["sun.x"], s["sun.y"], s["m"]);
                let (vx, vy) = (s["planet_x.p"] / m, s["planet_y.p"] / m);
                let r = x.hypot(y);
                let pull = s["mu"] * m / r.powi(3);
                hand(
                    [("planet_x.p", -pull * x), ("planet_y.p", -pull * y), ("sun.x", vx), ("sun.y", vy)],
                    0.5 * m * (vx * vx + vy * vy) - s["mu"] * m / r,
                )
            },
        },
    ]
}

fn electric() -> Vec<System> {
    vec![
        System {
            name: "coupled_coils",
            states: &[("coils.a", -0.1, 0.1), ("coils.b", -0.05, 0.05)],
            until: 0.1,
            // a = l1 i1 + m i2, b = m i1 + l2 i2; a' = u - r1 i1, b' = -r2 i2
            by_hand: |x| {
                let (l1, l2, m) = (x["l1"], x["l2"], x["m"]);
                let det = l1 * l2 - m * m;
                let i1 = (l2 * x["coils.a"] - m * x["coils.b"]) / det;
                let i2 = (l1 * x["coils.b"] - m * x["coils.a"]) / det;
                let source = x["u"] * (2.0 * std::f64::consts::PI * x["freq"] * x.t).sin();
                hand(
                    [("coils.a", source - x["r1"] * i1), ("coils.b", -x["r2"] * i2)],
                    0.5 * (l1 * i1 * i1 + l2 * i2 * i2) + m * i1 * i2,
                )
            },
        },
        System {
            name: "electrostatic_actuator",
            states: &[
                ("plates.q", -1e-10, 1e-10),
                ("plates.x", -1e-6, 1e-6),
                ("plate.p", -1e-9, 1e-9),
                ("suspension.q", -1e-6, 1e-6),
            ],
            until: 1.0,
            // A charge on two plates pulls them together with q^2/(2 epsilon area), whatever the gap;
            // c = epsilon area/(gap - x)
            by_hand: |x| {
                let (q, slope) = (x["plates.q"], x["epsilon"] * x["area"]);
                let volt = q * (x["gap"] - x["plates.x"]) / slope;
                let v = x["plate.p"] / x["m"];
                let pull = q * q / (2.0 * slope);
                let force = pull - x["k"] * x["suspension.q"] - x["b"] * v;
                hand(
                    [("plates.q", (x["u"] - volt) / x["r"]), ("plates.x", v), ("plate.p", force), ("suspension.q", v)],
                    0.5 * q * volt + 0.5 * x["m"] * v * v + 0.5 * x["k"] * x["suspension.q"].powi(2),
                )
            },
        },
        System {
            name: "electromagnet",
            states: &[
                ("magnet.flux", -1.0, 1.0),
                ("magnet.x", 0.0, 4e-3),
                ("armature.p", -0.01, 0.01),
                ("spring.q", -4e-3, 0.0),
            ],
            until: 1.0,
            // l(x) = c/(rest + x): u = r i + (l i)'; the pull is -i^2/2 dl/dx
            by_hand: |x| {
                let gap = x["rest"] + x["magnet.x"];
                let (l, slope) = (x["c"] / gap, -x["c"] / (gap * gap));
                let (i, v) = (x["magnet.flux"] / l, x["armature.p"] / x["m"]);
                let force = 0.5 * i * i * slope - x["k"] * x["spring.q"] - x["b"] * v;
                hand(
                    [("magnet.flux", x["u"] - x["r"] * i), ("magnet.x", v), ("armature.p", force), ("spring.q", v)],
                    0.5 * l * i * i + 0.5 * x["m"] * v * v + 0.5 * x["k"] * x["spring.q"].powi(2),
                )
            },
        },
        System {
            name: "levitation",
            states: &[("magnet.flux", -0.05, 0.05), ("magnet.x", 0.0, 2e-2), ("ball.p", -0.02, 0.02)],
            until: 1.0,
            // As of the relay; the voltage is r i_0 + kp (x - gap0) + kd x', with the pull of i_0 at gap0 the weight.
            by_hand: |x| {
                let gap = x["rest"] + x["magnet.x"];
                let (i, v) = (x["magnet.flux"] * gap / x["c"], x["ball.p"] / x["m"]);
                let rest = (x["rest"] + x["gap0"]) * (2.0 * x["m"] * x["g"] / x["c"]).sqrt();
                let supply = x["r"] * rest + x["kp"] * (x["magnet.x"] - x["gap0"]) + x["kd"] * v;
                let pull = x["c"] * i * i / (2.0 * gap * gap);
                hand(
                    [("magnet.flux", supply - x["r"] * i), ("magnet.x", v), ("ball.p", x["m"] * x["g"] - pull)],
                    x["c"] * i * i / (2.0 * gap) + 0.5 * x["m"] * v * v,
                )
            },
        },
    ]
}
