//! Felt against written: stiffness and damping by least squares, and where a push rests.

use super::table::{short, table};
use super::wall::{Computed, HOLDS, Interval, MASS, PERIOD, Push, Pushed, Scene, Wall, releases};

/// k T^2/m of the walls.
pub const RATIOS: [f64; 5] = [0.01, 0.1, 1.0, 10.0, 100.0];
/// The damping of the walls, as a part of sqrt(k m).
pub const DAMPING: f64 = 0.2;
/// The push that stays, N.
pub const BASE: f64 = 10.0;
/// The sine around it, N.
pub const SWING: f64 = 1.0;
/// Its period, in samples.
pub const SLOW: u32 = 200;
/// How long is pushed, in samples.
pub const LONG: u32 = 5000;
/// The end of it that counts, in samples: some periods of the sine.
const COUNTED: usize = 5 * SLOW as usize;
/// The last samples, over which a rest is a rest.
const RESTING: usize = 100;
/// What is off by less is at rest, as a part of F/k; and what of a force is left over by less fits.
const REST: f64 = 1e-9;
const FITS: f64 = 1e-6;

/// The wall of a ratio.
pub fn wall(ratio: f64) -> Wall {
    let k = ratio * MASS / (PERIOD * PERIOD);
    Wall { k, b: DAMPING * (k * MASS).sqrt() }
}

/// What a hand feels.
struct Felt {
    /// N/m
    k: f64,
    /// N s/m
    b: f64,
    /// What of the force's variation is left over, as a part.
    left: f64,
}

/// The k, b and c for which k x + b v + c is nearest to the force, over interval means.
fn fit(intervals: &[Interval]) -> Felt {
    let n = intervals.len() as f64;
    let mean = |of: fn(&Interval) -> f64| intervals.iter().map(of).sum::<f64>() / n;
    let (x, v, e) = (mean(|i| i.mean), mean(|i| i.speed), mean(|i| i.force));
    let (mut xx, mut xv, mut vv, mut xe, mut ve, mut ee) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for i in intervals {
        let (dx, dv, de) = (i.mean - x, i.speed - v, i.force - e);
        xx += dx * dx;
        xv += dx * dv;
        vv += dv * dv;
        xe += dx * de;
        ve += dv * de;
        ee += de * de;
    }
    let det = xx * vv - xv * xv;
    let (k, b) = ((xe * vv - ve * xv) / det, (ve * xx - xe * xv) / det);
    let left = (ee - k * xe - b * ve).max(0.0);
    Felt { k, b, left: (left / ee).sqrt() }
}

/// A ratio with three digits, also of small ones.
fn part(x: f64) -> String {
    if x.abs() >= 1e4 || !x.is_finite() { short(x) } else { format!("{:.3}", if x.abs() < 5e-4 { 0.0 } else { x }) }
}

/// A size, from which on it is told.
fn above(least: f64, x: f64) -> String {
    if x < least { format!("< {}", short(least)) } else { short(x) }
}

/// Felt over written.
fn felt(run: &Pushed, wall: Wall) -> [String; 3] {
    if run.grows {
        return ["grows".into(), "-".into(), "-".into()];
    }
    let end = &run.intervals[run.intervals.len() - COUNTED..];
    let f = fit(end);
    [part(f.k / wall.k), part(f.b / wall.b), above(FITS, f.left)]
}

/// Stiffness and damping felt, over those written.
///
/// # Errors
/// In words.
pub fn slow() -> Result<String, String> {
    let head = [
        "hold",
        "k T^2/m",
        "stiffness, budget off",
        "damping, budget off",
        "misfit, budget off",
        "stiffness",
        "damping",
        "misfit",
        "let go",
    ];
    let push = Push { base: BASE, swing: SWING, period: SLOW };
    let mut rows = Vec::new();
    for hold in HOLDS {
        let scenes = [false, true].map(|budget| Scene::pushed(Computed::Sampled(hold, budget)));
        for ratio in RATIOS {
            let wall = wall(ratio);
            let [without, with] = [scenes[0].push(wall, push, LONG)?, scenes[1].push(wall, push, LONG)?];
            let mut row = vec![format!("`{hold}`"), ratio.to_string()];
            row.extend(felt(&without, wall));
            row.extend(felt(&with, wall));
            row.push(short(releases(&with)));
            rows.push(row);
        }
    }
    Ok(table(&head, &rows))
}

/// The largest distance from F/k at the end of a push, as a part of F/k.
fn rest(run: &Pushed, wall: Wall) -> String {
    if run.grows {
        return "grows".into();
    }
    let end = &run.intervals[run.intervals.len() - RESTING..];
    above(REST, end.iter().map(|i| (i.x * wall.k / BASE - 1.0).abs()).fold(0.0, f64::max))
}

/// Where a constant push rests.
///
/// # Errors
/// In words.
pub fn constant() -> Result<String, String> {
    let head = ["hold", "k T^2/m", "from F/k, budget off", "from F/k", "let go"];
    let push = Push { base: BASE, swing: 0.0, period: SLOW };
    let mut rows = Vec::new();
    for hold in HOLDS {
        let scenes = [false, true].map(|budget| Scene::pushed(Computed::Sampled(hold, budget)));
        for ratio in RATIOS {
            let wall = wall(ratio);
            let [without, with] = [scenes[0].push(wall, push, LONG)?, scenes[1].push(wall, push, LONG)?];
            let (without, with, let_go) = (rest(&without, wall), rest(&with, wall), short(releases(&with)));
            rows.push(vec![format!("`{hold}`"), ratio.to_string(), without, with, let_go]);
        }
    }
    Ok(table(&head, &rows))
}
