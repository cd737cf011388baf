//! Electric machines and transducers: Kirchhoff on the one side, Newton on the other, the same power on both sides of
//! what joins them.

use super::{System, hand};

pub(super) fn systems() -> Vec<System> {
    let mut list = motors();
    list.extend(controlled());
    list.extend(transducers());
    list
}

fn motors() -> Vec<System> {
    vec![
        System {
            name: "dc_drive",
            states: &[("coil.p", -0.2, 0.2), ("rotor.p", -1.0, 1.0)],
            until: 1.0,
            // The drum turns with gear w, the weight rises with radius gear w:
            // one inertia J = J_rotor + gear^2 (J_drum + m radius^2), whose momentum J w is the state.
            by_hand: |x| {
                let lever = x["gear"] * x["radius"];
                let inertia = x["J_rotor"] + x["gear"].powi(2) * x["J_drum"] + x["m"] * lever * lever;
                let (i, w) = (x["coil.p"] / x["l"], x["rotor.p"] / inertia);
                hand(
                    [
                        ("coil.p", x["u"] - x["r"] * i - x["K"] * w),
                        ("rotor.p", x["K"] * i - x["b"] * w - lever * x["m"] * x["g"]),
                    ],
                    0.5 * x["l"] * i * i + 0.5 * inertia * w * w,
                )
            },
        },
        System {
            name: "dc_generator",
            states: &[("armature_coil.p", -0.1, 0.1), ("field.p", -20.0, 20.0)],
            until: 1.0,
            // The armature's current feeds the field and the load; the load's resistance sets the terminals' voltage.
            by_hand: |x| {
                let (i, field) = (x["armature_coil.p"] / x["l_a"], x["field.p"] / x["l_f"]);
                let terminals = x["load"] * (i - field);
                let induced = x["M"] * x["i_s"] * (field / x["i_s"]).tanh() * x["w"];
                hand(
                    [
                        ("armature_coil.p", induced - x["r_a"] * i - terminals),
                        ("field.p", terminals - x["r_f"] * field),
                    ],
                    0.5 * x["l_a"] * i * i + 0.5 * x["l_f"] * field * field,
                )
            },
        },
        System {
            name: "pm_motor",
            states: &[("d.p", -0.1, 0.1), ("q.p", -0.1, 0.1), ("rotor.p", -1.0, 1.0)],
            until: 1.0,
            // Park's equations: l_d i_d' = u_d - r i_d + n w l_q i_q, l_q i_q' = u_q - r i_q - n w (l_d i_d + flux),
            // J w' = n (flux i_q + (l_d - l_q) i_d i_q) - b w
            by_hand: |x| {
                let (id, iq, w) = (x["d.p"] / x["l_d"], x["q.p"] / x["l_q"], x["rotor.p"] / x["J"]);
                let turn = x["n"] * w;
                hand(
                    [
                        ("d.p", x["u_d"] - x["r"] * id + turn * x["l_q"] * iq),
                        ("q.p", x["u_q"] - x["r"] * iq - turn * (x["l_d"] * id + x["flux"])),
                        ("rotor.p", x["n"] * (x["flux"] * iq + (x["l_d"] - x["l_q"]) * id * iq) - x["b"] * w),
                    ],
                    0.5 * (x["l_d"] * id * id + x["l_q"] * iq * iq + x["J"] * w * w),
                )
            },
        },
        System {
            name: "induction_motor",
            states: &[
                ("axis_a.s", -1.0, 1.0),
                ("axis_a.r", -1.0, 1.0),
                ("axis_b.s", -1.0, 1.0),
                ("axis_b.r", -1.0, 1.0),
                ("shaft.p", -3.0, 3.0),
            ],
            until: 0.1,
            // With complex fluxes s and r: s' = u e^(jwt) - rs i_s, r' = -rr i_r + j n w r;
            // J w' = n Im(r conj(i_r)) - b w. The currents: s = ls i_s + m i_r, r = m i_s + lr i_r.
            by_hand: |x| {
                let det = x["ls"] * x["lr"] - x["m"] * x["m"];
                let stator = |s: f64, r: f64| (x["lr"] * s - x["m"] * r) / det;
                let rotor = |s: f64, r: f64| (x["ls"] * r - x["m"] * s) / det;
                let (sa, ra, sb, rb) = (x["axis_a.s"], x["axis_a.r"], x["axis_b.s"], x["axis_b.r"]);
                let (isa, isb, ira, irb) = (stator(sa, ra), stator(sb, rb), rotor(sa, ra), rotor(sb, rb));
                let turn = x["n"] * x["shaft.p"] / x["J"];
                let (sin, cos) = (x["w"] * x.t).sin_cos();
                hand(
                    [
                        ("axis_a.s", x["u"] * cos - x["rs"] * isa),
                        ("axis_b.s", x["u"] * sin - x["rs"] * isb),
                        ("axis_a.r", -x["rr"] * ira - turn * rb),
                        ("axis_b.r", -x["rr"] * irb + turn * ra),
                        ("shaft.p", x["n"] * (rb * ira - ra * irb) - x["b"] * x["shaft.p"] / x["J"]),
                    ],
                    0.5 * (sa * isa + ra * ira + sb * isb + rb * irb) + 0.5 * x["shaft.p"].powi(2) / x["J"],
                )
            },
        },
    ]
}

/// A motor with its controller.
fn controlled() -> Vec<System> {
    vec![System {
        name: "pi_motor",
        states: &[("coil.p", -0.02, 0.02), ("rotor.p", -0.2, 0.2), ("z", -5.0, 5.0)],
        until: 6.0,
        // The supply gives kp (w_set - w) + z with z' = ki (w_set - w); z stores no energy.
        by_hand: |x| {
            let (i, w) = (x["coil.p"] / x["l"], x["rotor.p"] / x["J"]);
            let missing = x["w_set"] - w;
            let load = if x.t > 3.0 { x["load"] } else { 0.0 };
            hand(
                [
                    ("coil.p", x["kp"] * missing + x["z"] - x["r"] * i - x["K"] * w),
                    ("rotor.p", x["K"] * i - x["b"] * w - load),
                    ("z", x["ki"] * missing),
                ],
                0.5 * (x["l"] * i * i + x["J"] * w * w),
            )
        },
    }]
}

fn transducers() -> Vec<System> {
    vec![
        System {
            name: "loudspeaker",
            states: &[
                ("coil.p", -1e-3, 1e-3),
                ("cone.p", -0.02, 0.02),
                ("suspension.q", -5e-3, 5e-3),
                ("box.q", -1e-4, 1e-4),
            ],
            until: 0.1,
            // Force Bl i, voltage Bl v; the cone presses area v into the box.
            by_hand: |x| {
                let (i, v) = (x["coil.p"] / x["l"], x["cone.p"] / x["m"]);
                let drive = x["u"] * (2.0 * std::f64::consts::PI * x["freq"] * x.t).sin();
                let flow = x["area"] * v;
                let pressure = x["box.q"] / x["c_box"] + x["r_box"] * flow;
                let force = x["Bl"] * i - x["k"] * x["suspension.q"] - x["b"] * v - x["area"] * pressure;
                hand(
                    [
                        ("coil.p", drive - x["r"] * i - x["Bl"] * v),
                        ("cone.p", force),
                        ("suspension.q", v),
                        ("box.q", flow),
                    ],
                    0.5 * (x["l"] * i * i + x["m"] * v * v + x["k"] * x["suspension.q"].powi(2))
                        + x["box.q"].powi(2) / (2.0 * x["c_box"]),
                )
            },
        },
        System {
            name: "piezo_stack",
            states: &[("plates.q", -2e-4, 2e-4), ("tip.p", -0.05, 0.05), ("ceramic.q", -3e-5, 3e-5)],
            until: 1.0,
            // The lead's current charges the plates and follows the stroke with alpha v; the voltage pushes with alpha
            // u.
            by_hand: |x| {
                let (volt, v) = (x["plates.q"] / x["c"], x["tip.p"] / x["m"]);
                let current = (x["u"] - volt) / x["r"];
                let force = x["alpha"] * volt - x["k"] * x["ceramic.q"] - x["b"] * v;
                hand(
                    [("plates.q", current - x["alpha"] * v), ("tip.p", force), ("ceramic.q", v)],
                    0.5 * (x["c"] * volt * volt + x["m"] * v * v + x["k"] * x["ceramic.q"].powi(2)),
                )
            },
        },
    ]
}
