//! Heat by true bonds, temperature and entropy flow: the first law for energies, the second for what is made.

use super::{System, hand};

/// Temperature and energy of a body of heat capacity c at an entropy counted from T0: s = c log(T/T0).
fn body(s: f64, c: f64, t0: f64) -> (f64, f64) {
    let t = t0 * (s / c).exp();
    (t, c * t)
}

pub(super) fn systems() -> Vec<System> {
    vec![
        System {
            name: "two_bodies",
            states: &[("warm.q", -60.0, 120.0), ("cool.q", -60.0, 120.0)],
            until: 1.0,
            // Heat g (T1 - T2) leaves the one and reaches the other; entropy is heat over temperature.
            by_hand: |x| {
                let ((t1, h1), (t2, h2)) = (body(x["warm.q"], x["c"], x["T0"]), body(x["cool.q"], x["c"], x["T0"]));
                let heat = x["g"] * (t1 - t2);
                hand([("warm.q", -heat / t1), ("cool.q", heat / t2)], h1 + h2)
            },
        },
        System {
            name: "heater",
            states: &[("choke.p", -0.5, 0.5), ("water.q", -100.0, 600.0)],
            until: 1.0,
            // r i^2 heats the water: T s' = r i^2
            by_hand: |x| {
                let (t, h) = body(x["water.q"], x["c"], x["T0"]);
                let i = x["choke.p"] / x["l"];
                hand([("choke.p", x["u"] - x["r"] * i), ("water.q", x["r"] * i * i / t)], 0.5 * x["l"] * i * i + h)
            },
        },
        System {
            name: "gas_piston",
            states: &[("piston.p", -2.0, 2.0), ("gas.v", -1.5e-3, 2e-3), ("gas.s", -0.5, 0.5), ("wall.q", -50.0, 50.0)],
            until: 1.0,
            // An ideal gas: T v^(k-1) exp(-s/n_cv) stays, p v = n R T with n R = (k - 1) n_cv. gas.v counts from v0.
            by_hand: |x| {
                let v = x["v0"] + x["gas.v"];
                let t = x["T0"] * (x["v0"] / v).powf(x["k"] - 1.0) * (x["gas.s"] / x["n_cv"]).exp();
                let pressure = (x["k"] - 1.0) * x["n_cv"] * t / v;
                let (t_wall, h_wall) = body(x["wall.q"], x["c_wall"], x["T0"]);
                let u = x["piston.p"] / x["m"];
                let heat = x["h"] * (t - t_wall);
                let force = x["area"] * (pressure - x["p_out"]) - x["m"] * x["g"] - x["b"] * u;
                hand(
                    [("piston.p", force), ("gas.v", x["area"] * u), ("gas.s", -heat / t), ("wall.q", heat / t_wall)],
                    0.5 * x["m"] * u * u + x["n_cv"] * t + h_wall,
                )
            },
        },
    ]
}
