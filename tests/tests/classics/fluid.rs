//! Liquids and sound: balances of volume, and momentum of what moves in pipes.

use super::{Hand, System, hand};

/// Flow through a hole for a pressure: gain times its root, with its sign.
fn orifice(gain: f64, pressure: f64) -> f64 {
    gain * pressure.signum() * pressure.abs().sqrt()
}

pub(super) fn systems() -> Vec<System> {
    let mut list = hydraulics();
    list.extend(pipes());
    list
}

fn hydraulics() -> Vec<System> {
    vec![
        System {
            name: "three_tanks",
            states: &[("first.q", 1e-4, 2e-2), ("second.q", 1e-4, 2e-2), ("third.q", 1e-4, 2e-2)],
            until: 1.0,
            // Torricelli: v = sqrt(2 p/rho) through each hole; pressure at the bottom rho g level
            by_hand: |x| {
                let stiff = x["rho"] * x["g"] / x["area"];
                let p = [stiff * x["first.q"], stiff * x["second.q"], stiff * x["third.q"]];
                let gain = x["hole"] * (2.0 / x["rho"]).sqrt();
                let (f1, f2, f3) = (orifice(gain, p[0] - p[1]), orifice(gain, p[1] - p[2]), orifice(gain, p[2]));
                hand(
                    [("first.q", x["tap"] - f1), ("second.q", f1 - f2), ("third.q", f2 - f3)],
                    (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) / (2.0 * stiff),
                )
            },
        },
        System {
            name: "accumulator",
            states: &[("bag.q", -1e-4, 7e-4), ("line.p", -5e3, 5e3)],
            until: 40.0,
            // Gas at constant temperature: (p + p0) (v0 - q) = p0 v0; its work from the filling on is the energy.
            by_hand: |x| {
                let (q, v0, p0) = (x["bag.q"], x["v0"], x["p0"]);
                let pressure = p0 * v0 / (v0 - q) - p0;
                let flow = x["line.p"] / x["inertance"];
                let pump = x["q_pump"] * if x.t < 20.0 { 1.0 + (x["w"] * x.t).sin() } else { 1.0 };
                hand(
                    [("bag.q", pump - flow), ("line.p", pressure - x["r"] * flow)],
                    p0 * v0 * (v0 / (v0 - q)).ln() - p0 * q + 0.5 * x["inertance"] * flow * flow,
                )
            },
        },
        System {
            name: "pump_relief",
            states: &[("hose.q", 0.0, 2e-5), ("rotor.p", -5.0, 15.0)],
            until: 1.0,
            // What the pump gives compresses the hose, leaks, blows off and turns the motor, D for a radian.
            by_hand: |x| {
                let (p, w) = (x["hose.q"] / x["oil"], x["rotor.p"] / x["J"]);
                let relief = x["g_open"] * (p - x["p_open"]).max(0.0);
                hand(
                    [
                        ("hose.q", x["q_pump"] - x["leak"] * p - relief - x["D"] * w),
                        ("rotor.p", x["D"] * p - x["b"] * w - x["load"]),
                    ],
                    0.5 * x["oil"] * p * p + 0.5 * x["J"] * w * w,
                )
            },
        },
        System {
            name: "hydraulic_servo",
            states: &[("chamber_a.q", -2e-7, 1.4e-6), ("chamber_b.q", -2e-7, 1.4e-6), ("piston.p", -50.0, 50.0)],
            until: 1.0,
            // The spool joins a with the supply and b with the tank, then the other way about.
            by_hand: |x| {
                let (a, b) = (x["chamber_a.q"] / x["oil"], x["chamber_b.q"] / x["oil"]);
                let v = x["piston.p"] / x["m"];
                let (gain, supply) = (x["gain"], x["p_supply"]);
                let (into_a, out_of_b) = if x.t < 0.5 {
                    (orifice(gain, supply - a), orifice(gain, b))
                } else {
                    (-orifice(gain, a), -orifice(gain, supply - b))
                };
                hand(
                    [
                        ("chamber_a.q", into_a - x["area"] * v),
                        ("chamber_b.q", x["area"] * v - out_of_b),
                        ("piston.p", x["area"] * (a - b) - x["b"] * v),
                    ],
                    0.5 * x["oil"] * (a * a + b * b) + 0.5 * x["m"] * v * v,
                )
            },
        },
        System {
            name: "surge_tank",
            states: &[("water.p", -8e6, 8e6), ("shaft.q", 900.0, 1900.0)],
            until: 20.0,
            // The column of water in the tunnel: rho length/tunnel q' = rho g (lake - level) - k q |q|
            by_hand: |x| {
                let (rho, g) = (x["rho"], x["g"]);
                let inertance = rho * x["length"] / x["tunnel"];
                let (flow, level) = (x["water.p"] / inertance, x["shaft.q"] / x["tank"]);
                let turbine = if x.t < 10.0 { x["q"] } else { 0.0 };
                hand(
                    [
                        ("water.p", rho * g * (x["head"] - level) - x["k"] * flow * flow.abs()),
                        ("shaft.q", flow - turbine),
                    ],
                    0.5 * inertance * flow * flow + 0.5 * rho * g * x["tank"] * level * level,
                )
            },
        },
        System {
            name: "windkessel",
            states: &[("blood.p", -300.0, 300.0), ("vessels.q", 0.0, 3e-4)],
            until: 5.0,
            // z and l lie side by side: what the coil does not take goes through z, and its pressure drop drives the
            // coil.
            by_hand: |x| {
                let heart = x["peak"] * (x["w"] * x.t).sin().max(0.0);
                let (flow, pressure) = (x["blood.p"] / x["l"], x["vessels.q"] / x["c"]);
                hand(
                    [("blood.p", x["z"] * (heart - flow)), ("vessels.q", heart - pressure / x["r"])],
                    0.5 * x["l"] * flow * flow + 0.5 * x["c"] * pressure * pressure,
                )
            },
        },
    ]
}

/// Sound in tubes.
fn pipes() -> Vec<System> {
    vec![
        System {
            name: "helmholtz",
            states: &[("neck.p", -0.1, 0.1), ("bottle.q", -1e-6, 1e-6)],
            until: 1.0,
            // The slug of air in the neck: rho len area v' = area p - area^2 r v; the bottle:
            // p = -rho c^2 (volume drawn out)/volume
            by_hand: |x| {
                let (inertance, stiff) = (x["rho"] * x["len"] / x["area"], x["rho"] * x["c"].powi(2) / x["volume"]);
                let (flow, pressure) = (x["neck.p"] / inertance, stiff * x["bottle.q"]);
                hand(
                    [("neck.p", pressure - x["r"] * flow), ("bottle.q", -flow)],
                    0.5 * inertance * flow * flow + pressure * pressure / (2.0 * stiff),
                )
            },
        },
        System {
            name: "vocal_tract",
            states: &[("outside.p", -1.0, 1.0), ("slug.p", -1.0, 1.0), ("spring.q", -1e-8, 1e-8)],
            until: 1.0,
            // Each piece: its air is pressed by what comes and does not go on, its slug is pushed by the pressures at
            // its ends.
            by_hand: |x| {
                let (n, m) = (x["n"] as usize, 2 * x["n"] as usize);
                let front = |i: usize| i > n;
                let length = |i: usize| if front(i) { x["l_front"] } else { x["l_back"] };
                let area = |i: usize| if front(i) { x["front"] } else { x["back"] };
                let loss = |i: usize| if front(i) { x["loss"] / 10.0 } else { x["loss"] };
                let mass = |i: usize| x["rho"] * length(i) / area(i);
                let soft = |i: usize| area(i) * length(i) / (x["rho"] * x["c"].powi(2));
                let flow = |i: usize| if i == 0 { x["glottis"] } else { x.of("slug", i, "p") / mass(i) };
                // The open air: its mass and its resistance side by side.
                let outside = x["outside.p"] / 5e2;
                let mouth = x["air"] * (flow(m) - outside);
                let pressure = |i: usize| if i > m { mouth } else { x.of("spring", i, "q") / soft(i) };
                let slug = |i: usize| (format!("slug[{i}].p"), pressure(i) - pressure(i + 1) - loss(i) * flow(i));
                let spring = |i: usize| (format!("spring[{i}].q"), flow(i - 1) - flow(i));
                let stored = |i: usize| 0.5 * mass(i) * flow(i).powi(2) + 0.5 * soft(i) * pressure(i).powi(2);
                let sea = ("outside.p".to_string(), mouth);
                Hand {
                    rates: (1..=m).map(slug).chain((1..=m).map(spring)).chain([sea]).collect(),
                    energy: (1..=m).map(stored).sum::<f64>() + 0.5 * 5e2 * outside * outside,
                }
            },
        },
    ]
}
