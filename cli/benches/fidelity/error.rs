//! How far the motion is from that at the same wall in continuous time.

use super::felt::{BASE, RATIOS, wall};
use super::table::{short, table};
use super::wall::{Computed, HOLDS, Push, Pushed, Scene, releases};

/// How long is pushed, in samples.
pub const LONG: u32 = 1200;

/// What is pushed, and by which name: a constant force, and sines of 60 and 20 samples around 0.
pub const PUSHES: [(&str, Push); 3] = [
    ("constant", Push { base: BASE, swing: 0.0, period: 60 }),
    ("sine of 60", Push { base: 0.0, swing: BASE, period: 60 }),
    ("sine of 20", Push { base: 0.0, swing: BASE, period: 20 }),
];

/// The root of the mean square of the distance at the samples, as a part of that of the motion; None if it grows.
fn error(run: &Pushed, reference: &Pushed) -> Option<f64> {
    let pairs = || run.intervals.iter().zip(&reference.intervals);
    let apart: f64 = pairs().map(|(a, b)| (a.x - b.x) * (a.x - b.x)).sum();
    let size: f64 = pairs().map(|(_, b)| b.x * b.x).sum();
    (!run.grows).then(|| (apart / size).sqrt())
}

/// A part of the motion.
fn told(error: Option<f64>) -> String {
    error.map_or("grows".into(), short)
}

/// One push at each wall by each hold.
///
/// # Errors
/// In words.
pub fn errors(push: Push) -> Result<String, String> {
    let head = ["hold", "k T^2/m", "error, budget off", "error", "with over without", "let go"];
    let continuous = Scene::pushed(Computed::Continuously);
    let mut rows = Vec::new();
    for hold in HOLDS {
        let scenes = [false, true].map(|budget| Scene::pushed(Computed::Sampled(hold, budget)));
        for ratio in RATIOS {
            let wall = wall(ratio);
            let reference = continuous.push(wall, push, LONG)?;
            let [without, with] = [scenes[0].push(wall, push, LONG)?, scenes[1].push(wall, push, LONG)?];
            let [off, on] = [&without, &with].map(|run| error(run, &reference));
            let times = off.zip(on).map_or("-".into(), |(off, on)| short(on / off));
            let let_go = short(releases(&with));
            rows.push(vec![format!("`{hold}`"), ratio.to_string(), told(off), told(on), times, let_go]);
        }
    }
    Ok(table(&head, &rows))
}
