//! Circuits: Kirchhoff's laws, mesh by mesh and node by node.

use super::{Hand, System, hand};

/// x^2/(2 y): of a coil with its flux, of a capacitor with its charge.
fn stored(x: f64, y: f64) -> f64 {
    x * x / (2.0 * y)
}

pub(super) fn systems() -> Vec<System> {
    let mut list = linear();
    list.extend(ladders());
    list.extend(curved());
    list
}

fn linear() -> Vec<System> {
    vec![
        System {
            name: "rlc_series",
            states: &[("coil.p", -1e-3, 1e-3), ("cap.q", -1e-4, 1e-4)],
            until: 1.0,
            // l i' = u - r i - q/c, q' = i
            by_hand: |x| {
                let i = x["coil.p"] / x["l"];
                let mesh = x["u"] - x["r"] * i - x["cap.q"] / x["c"];
                hand([("coil.p", mesh), ("cap.q", i)], stored(x["coil.p"], x["l"]) + stored(x["cap.q"], x["c"]))
            },
        },
        System {
            name: "rlc_parallel",
            states: &[("coil.p", -1e-3, 1e-3), ("cap.q", -1e-4, 1e-4)],
            until: 1.0,
            // c u' = i - u/r - i_l, l i_l' = u
            by_hand: |x| {
                let u = x["cap.q"] / x["c"];
                let node = x["i"] - u / x["r"] - x["coil.p"] / x["l"];
                hand([("coil.p", u), ("cap.q", node)], stored(x["coil.p"], x["l"]) + stored(x["cap.q"], x["c"]))
            },
        },
        System {
            name: "wheatstone",
            states: &[("coil.p", -1e-3, 1e-3)],
            until: 1.0,
            // Nodes: (u - a)/r1 = a/r2 + i and (u - b)/r3 + i = b/r4; across: l i' = a - b - r_g i
            by_hand: |x| {
                let i = x["coil.p"] / x["l"];
                let a = (x["u"] / x["r1"] - i) / (1.0 / x["r1"] + 1.0 / x["r2"]);
                let b = (x["u"] / x["r3"] + i) / (1.0 / x["r3"] + 1.0 / x["r4"]);
                hand([("coil.p", a - b - x["r_g"] * i)], stored(x["coil.p"], x["l"]))
            },
        },
        System {
            name: "transformer",
            states: &[("primary_stray.p", -0.1, 0.1), ("core.p", -1.0, 1.0), ("secondary_stray.p", -1e-2, 1e-2)],
            until: 0.04,
            // The core's voltage drives what the primary brings, less the secondary's share and the core's current,
            // through r_core.
            by_hand: |x| {
                let i1 = x["primary_stray.p"] / x["l1"];
                let i2 = x["secondary_stray.p"] / x["l2"];
                let i_core = x["core.p"] / x["l_core"];
                let u_core = x["r_core"] * (i1 - i_core - i2 / x["ratio"]);
                let mains = x["u"] * (2.0 * std::f64::consts::PI * x["freq"] * x.t).sin();
                hand(
                    [
                        ("primary_stray.p", mains - x["r1"] * i1 - u_core),
                        ("core.p", u_core),
                        ("secondary_stray.p", u_core / x["ratio"] - (x["r2"] + x["load"]) * i2),
                    ],
                    0.5 * (x["l1"] * i1 * i1 + x["l2"] * i2 * i2 + x["l_core"] * i_core * i_core),
                )
            },
        },
        System {
            name: "boost_converter",
            states: &[("coil.p", -1e-3, 1e-3), ("cap.q", -0.02, 0.02)],
            until: 1.0,
            // For the part 1 - duty of a period the coil is connected with the output:
            // l i' = u - r i - (1 - duty) u_out, c u_out' = (1 - duty) i - u_out/load
            by_hand: |x| {
                let (i, u, on) = (x["coil.p"] / x["l"], x["cap.q"] / x["c"], 1.0 - x["duty"]);
                hand(
                    [("coil.p", x["u"] - x["r_l"] * i - on * u), ("cap.q", on * i - u / x["load"])],
                    stored(x["coil.p"], x["l"]) + stored(x["cap.q"], x["c"]),
                )
            },
        },
    ]
}

fn ladders() -> Vec<System> {
    vec![
        System {
            name: "rc_ladder",
            states: &[("cap.q", -5e-6, 5e-6)],
            until: 1.0,
            // What comes by a resistor from the node before, less what leaves for the one behind.
            by_hand: |x| {
                let n = x["n"] as usize;
                let u = |i: usize| if i == 0 { x["u"] } else { x.of("cap", i, "q") / x["c"] };
                let current = |i: usize| if i > n { u(n) / x["load"] } else { (u(i - 1) - u(i)) / x["r"] };
                Hand {
                    rates: (1..=n).map(|i| (format!("cap[{i}].q"), current(i) - current(i + 1))).collect(),
                    energy: (1..=n).map(|i| 0.5 * x["c"] * u(i) * u(i)).sum(),
                }
            },
        },
        System {
            name: "transmission_line",
            states: &[("coil.p", -1e-5, 1e-5), ("cap.q", -2e-7, 2e-7)],
            until: 1.0,
            // The telegraph equations in pieces: l i' = u before - u behind - r i, c u' = i before - i behind - g u
            by_hand: |x| {
                let n = x["n"] as usize;
                let u = |i: usize| if i == 0 { x["u"] } else { x.of("cap", i, "q") / x["c"] };
                let i = |k: usize| if k > n { u(n) / x["load"] } else { x.of("coil", k, "p") / x["l"] };
                let coil = |k: usize| (format!("coil[{k}].p"), u(k - 1) - u(k) - x["r"] * i(k));
                let cap = |k: usize| (format!("cap[{k}].q"), i(k) - i(k + 1) - x["g"] * u(k));
                Hand {
                    rates: (1..=n).map(coil).chain((1..=n).map(cap)).collect(),
                    energy: (1..=n).map(|k| 0.5 * (x["l"] * i(k) * i(k) + x["c"] * u(k) * u(k))).sum(),
                }
            },
        },
    ]
}

fn curved() -> Vec<System> {
    vec![
        System {
            name: "van_der_pol",
            states: &[("coil.p", -2.0, 2.0), ("cap.q", -2.0, 2.0)],
            until: 1.0,
            // c u' = -i + g1 u - g3 u^3, l i' = u
            by_hand: |x| {
                let (u, i) = (x["cap.q"] / x["c"], x["coil.p"] / x["l"]);
                let energy = stored(x["coil.p"], x["l"]) + stored(x["cap.q"], x["c"]);
                hand([("coil.p", u), ("cap.q", -i + x["g1"] * u - x["g3"] * u.powi(3))], energy)
            },
        },
        System {
            name: "chua",
            states: &[("first.q", -5e-8, 5e-8), ("second.q", -2e-7, 2e-7), ("coil.p", -1e-4, 1e-4)],
            until: 1.0,
            // c1 u1' = (u2 - u1)/r - g(u1), c2 u2' = (u1 - u2)/r - i, l i' = u2; g has the slope ga within the kinks,
            // gb beyond
            by_hand: |x| {
                let (u1, u2) = (x["first.q"] / x["c1"], x["second.q"] / x["c2"]);
                let kink = x["kink"];
                let diode = if u1.abs() <= kink {
                    x["ga"] * u1
                } else {
                    x["ga"] * kink * u1.signum() + x["gb"] * (u1 - kink * u1.signum())
                };
                hand(
                    [
                        ("first.q", (u2 - u1) / x["r"] - diode),
                        ("second.q", (u1 - u2) / x["r"] - x["coil.p"] / x["l"]),
                        ("coil.p", u2),
                    ],
                    stored(x["first.q"], x["c1"]) + stored(x["second.q"], x["c2"]) + stored(x["coil.p"], x["l"]),
                )
            },
        },
        System {
            name: "diode_rectifier",
            states: &[("cap.q", 0.013, 0.016)],
            until: 0.02,
            // The mesh's current i: i = i_s (exp((u - u_out - r i)/v_t) - 1), found by halving;
            // c u_out' = i - u_out/load
            by_hand: |x| {
                let mains = x["u"] * (2.0 * std::f64::consts::PI * x["freq"] * x.t).sin();
                let out = x["cap.q"] / x["c"];
                let missing = |i: f64| x["i_s"] * ((mains - out - x["r"] * i) / x["v_t"]).exp_m1() - i;
                let (mut low, mut high) = (-x["i_s"], ((mains - out) / x["r"]).max(0.0));
                for _ in 0..200 {
                    let middle = 0.5 * (low + high);
                    if missing(middle) > 0.0 {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                hand([("cap.q", 0.5 * (low + high) - out / x["load"])], stored(x["cap.q"], x["c"]))
            },
        },
    ]
}
