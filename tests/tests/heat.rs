//! Heat in a sampled region can't be drawn as work, and is there for bars of temperature.

use crate::common::{finish, probe, start, text};
use bond::Steps;

/// A handle pushed by a hand against a sampled wall whose damper warms a block; rows of what the outside has (the
/// handle's energy, less what the hand put in), and the temperature of the block.
fn pushed(wall: &str, hold: &str, period: f64) -> (Vec<f64>, f64) {
    let compiled = text(&format!(
        "use std.thermal
model Heat {{
  Se:hand = 5 N
  I:handle = 1 kg
  sampled every {period} s hold {hold} {{
    {wall}
    Body:block(C = 100 J/K, T0 = 300 K)
    damper.th -> 0:room -> block.heat
  }}
  hand -> 1:v -> handle
  v ||> contact
  probe gain = 0.5*(1 kg)*v.f^2 - (5 N)*integral(v.f, 0 m)
  probe warm = room.e
  simulate {{ stop = 30 s }}
}}"
    ));
    let mut sim = start(&compiled, Steps::new());
    let rows = (0..=300).map(|k| {
        sim.advance(f64::from(k) * 0.1).expect("it runs");
        probe(&mut sim, "gain")
    });
    let rows = rows.collect();
    (rows, probe(&mut sim, "warm"))
}

/// Whatever the damper, the hold and the period: the spring starts empty, so the handle never has more than the hand
/// gave. What was dissipated may come back, for holds err, up to the most that the spring ever held; the heat of the
/// block, 30 000 J, may not.
#[test]
fn a_wall_gives_no_work_from_its_heat() {
    for damper in ["1 N*s/m", "30 N*s/m"] {
        for hold in ["lagged", "predicted", "matched"] {
            for (period, stiffness) in [(0.5, 400.0), (0.05, 400.0), (0.5, 10.0)] {
                let wall = format!(
                    "C:spring {{ stiffness = {stiffness} N/m }}
                     RS(r, th):damper = {damper}
                     1:contact -> spring, damper.r"
                );
                let (gains, warm) = pushed(&wall, hold, period);
                let largest = gains.iter().fold(0.0f64, |m, x| m.max(*x));
                let stake = gains.iter().fold(0.0f64, |m, x| m.max(-*x));
                assert!(largest <= 0.02 * stake, "{damper} {hold} {period}: {largest} J of {stake} J");
                assert!(warm > 300.0 && warm < 330.0, "{damper} {hold} {period}: {warm} K");
            }
        }
    }
}

/// A sampled body warms a colder one through a bar of temperature: it is its heat that it gives, and it may.
#[test]
fn heat_crosses_a_bar_of_temperature() {
    let run = |sampled: bool| {
        let (open, close, bar) = if sampled { ("sampled every 0.1 s {", "}", "||>") } else { ("", "", "->") };
        let compiled = text(&format!(
            "use std.thermal
model Warm {{
  {open}
    Body:hot(C = 100 J/K, T0 = 400 K)
    0:inside -> hot.heat
  {close}
  Conductor:wall(G = 5 W/K)
  Body:cold(C = 50 J/K, T0 = 300 K)
  1:path -> wall.a
  inside {bar} path
  wall.b_end -> 0:outside -> cold.heat
  probe t_hot = inside.e
  probe t_cold = outside.e
  simulate {{ stop = 20 s }}
  expect passive
}}"
        ));
        let mut sim = start(&compiled, Steps::new());
        finish(&mut sim, 20.0);
        let summary = sim.summary();
        assert!(summary.passive, "{:?}", summary.reasons);
        [probe(&mut sim, "t_hot"), probe(&mut sim, "t_cold")]
    };
    let ([hot, cold], [hot_sampled, cold_sampled]) = (run(false), run(true));
    assert!(hot < 370.0 && cold > 360.0, "{hot} {cold}");
    assert!((hot - hot_sampled).abs() < 0.1 && (cold - cold_sampled).abs() < 0.1, "{hot_sampled} {cold_sampled}");
}
