//! Stiff problems of signal states alone, against the reference solutions of the IVP test set (Mazzia and Magherini,
//! release 2.4; for van der Pol's with a stiffness of 1e-6).

use crate::common::{advance, close, probe, start, with};
use bond::{Options, Steps};

/// A problem: its model, its end, and its states there.
type Problem = (&'static str, f64, &'static [(&'static str, f64)]);

const PROBLEMS: [Problem; 4] = [
    (
        "model Robertson {
          state a = 1 { da = (-0.04*a + 1e4*b*c)*1 Hz }
          state b = 0 { db = (0.04*a - 1e4*b*c - 3e7*b^2)*1 Hz }
          state c = 0 { dc = 3e7*b^2*1 Hz }
          probe ya = a
          probe yb = b
          probe yc = c
          simulate { stop = 1e11 s }
        }",
        1e11,
        &[("ya", 2.083340149701255e-8), ("yb", 8.333360770334713e-14), ("yc", 0.999999979166505)],
    ),
    (
        "model Hires {
          state y1 = 1 { dy1 = (-1.71*y1 + 0.43*y2 + 8.32*y3 + 0.0007)*1 Hz }
          state y2 = 0 { dy2 = (1.71*y1 - 8.75*y2)*1 Hz }
          state y3 = 0 { dy3 = (-10.03*y3 + 0.43*y4 + 0.035*y5)*1 Hz }
          state y4 = 0 { dy4 = (8.32*y2 + 1.71*y3 - 1.12*y4)*1 Hz }
          state y5 = 0 { dy5 = (-1.745*y5 + 0.43*y6 + 0.43*y7)*1 Hz }
          state y6 = 0 { dy6 = (-280*y6*y8 + 0.69*y4 + 1.71*y5 - 0.43*y6 + 0.69*y7)*1 Hz }
          state y7 = 0 { dy7 = (280*y6*y8 - 1.81*y7)*1 Hz }
          state y8 = 0.0057 { dy8 = (-280*y6*y8 + 1.81*y7)*1 Hz }
          probe p1 = y1
          probe p4 = y4
          probe p6 = y6
          probe p8 = y8
          simulate { stop = 321.8122 s }
        }",
        321.8122,
        &[
            ("p1", 0.7371312573325668e-3),
            ("p4", 0.1175651343283149e-2),
            ("p6", 0.6238968252742796e-2),
            ("p8", 0.2850001604814231e-2),
        ],
    ),
    (
        "model Oregonator {
          state a = 1 { da = 77.27*(b + a*(1 - 8.375e-6*a - b))*1 Hz }
          state b = 2 { db = (c - (1 + a)*b)/77.27*1 Hz }
          state c = 3 { dc = 0.161*(a - c)*1 Hz }
          probe ya = a
          probe yb = b
          probe yc = c
          simulate { stop = 360 s }
        }",
        360.0,
        &[("ya", 1.000814870318523), ("yb", 1228.178521549917), ("yc", 132.0554942846706)],
    ),
    (
        "model VanDerPol {
          state a = 2 { da = b*1 Hz }
          state b = 0 { db = ((1 - a^2)*b - a)/1e-6*1 Hz }
          probe ya = a
          probe yb = b
          simulate { stop = 2 s }
        }",
        2.0,
        &[("ya", 1.706167732170483), ("yb", -0.8928097010247975)],
    ),
];

/// By the stepper that is chosen and by `radau`, whose first step is cut where it fails.
#[test]
fn stiff_signals() {
    for (text, stop, wanted) in PROBLEMS {
        for options in [Options::new(), Options::new().method("radau")] {
            let compiled = with(options, text);
            let mut sim = start(&compiled, Steps::tolerance(1e-8));
            advance(&mut sim, stop);
            for (name, value) in wanted {
                close(probe(&mut sim, name) / value, 1.0, 1e-6, &format!("{name} of {text}"));
            }
        }
    }
}

/// No option and a tolerance of 1e-6 are one: the same stepper, the same numbers.
#[test]
fn the_default_is_a_tolerance() {
    let kinked = "model M { I:m = 1 kg  C:c { H = if q > 0 m then 0.5*(1 N/m)*q^2 else 0 J; q0 = 1 m }  1:v -> m, c
                  probe x = c.q }";
    for text in [kinked, PROBLEMS[2].0] {
        let ends: Vec<f64> = [Steps::new(), Steps::tolerance(1e-6)]
            .into_iter()
            .map(|steps| {
                let compiled = with(Options::new(), text);
                let mut sim = start(&compiled, steps);
                advance(&mut sim, 1.0);
                probe(&mut sim, if text == kinked { "x" } else { "ya" })
            })
            .collect();
        assert_eq!(ends[0].to_bits(), ends[1].to_bits(), "{text}");
    }
}
