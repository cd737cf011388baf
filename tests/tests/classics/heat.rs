//! Heat and diffusion: balances. On pseudo bonds the energy of the form is a pseudo energy, q^2/(2 c).

use super::{Hand, System, hand};

/// q^2/(2 c)
fn pseudo(q: f64, c: f64) -> f64 {
    q * q / (2.0 * c)
}

pub(super) fn systems() -> Vec<System> {
    vec![
        System {
            name: "heat_exchanger",
            states: &[("h1.q", 5e5, 8e5), ("h2.q", 5e5, 8e5), ("c1.q", 5e5, 8e5), ("c2.q", 5e5, 8e5)],
            until: 1.0,
            // A stream brings its capacity flow times the temperature before it, and takes that of the cell along.
            by_hand: |x| {
                let c = x["c"];
                let (h1, h2, c1, c2) = (x["h1.q"] / c, x["h2.q"] / c, x["c1.q"] / c, x["c2.q"] / c);
                let (q1, q2) = (x["wall"] * (h1 - c2), x["wall"] * (h2 - c1));
                hand(
                    [
                        ("h1.q", x["hot"] * (x["t_hot"] - h1) - q1),
                        ("h2.q", x["hot"] * (h1 - h2) - q2),
                        ("c1.q", x["cold"] * (x["t_cold"] - c1) + q2),
                        ("c2.q", x["cold"] * (c1 - c2) + q1),
                    ],
                    0.5 * c * (h1 * h1 + h2 * h2 + c1 * c1 + c2 * c2),
                )
            },
        },
        System {
            name: "cooling_fin",
            states: &[("piece.q", 1400.0, 2100.0)],
            until: 1.0,
            // Fourier along the fin, Newton's cooling at its sides.
            by_hand: |x| {
                let n = x["n"] as usize;
                let warm = |i: usize| if i == 0 { x["base"] } else { x.of("piece", i, "q") / x["c"] };
                let along = |i: usize| if i > n { 0.0 } else { x["g"] * (warm(i - 1) - warm(i)) };
                let rate = |i: usize| along(i) - along(i + 1) - x["h"] * (warm(i) - x["ambient"]);
                Hand {
                    rates: (1..=n).map(|i| (format!("piece[{i}].q"), rate(i))).collect(),
                    energy: (1..=n).map(|i| pseudo(x.of("piece", i, "q"), x["c"])).sum(),
                }
            },
        },
        System {
            name: "diffusion",
            states: &[("left.q", 0.0, 0.02), ("right.q", 0.0, 0.02)],
            until: 1.0,
            // Fick: the flow goes with the difference of the concentrations, amount over volume.
            by_hand: |x| {
                let flow = x["permeance"] * (x["left.q"] / x["v1"] - x["right.q"] / x["v2"]);
                let energy = pseudo(x["left.q"], x["v1"]) + pseudo(x["right.q"], x["v2"]);
                hand([("left.q", -flow), ("right.q", flow)], energy)
            },
        },
    ]
}
