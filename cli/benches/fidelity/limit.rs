//! The largest stiffness of a wall, by its damping (a K-B plot, or Z-width).

use super::table::table;
use super::wall::{Computed, FRICTION, HOLDS, Hold, PERIOD, Scene, Wall};

/// The stiffnesses among which the limit is looked for, N/m: decades, and how many each is divided into.
pub const STIFFNESS: (i32, i32) = (1, 7);
/// The dampings, N s/m.
pub const DAMPING: (i32, i32) = (-2, 3);
const PER_DECADE: i32 = 4;
/// How closely a limit is found, as a ratio.
const CLOSE: f64 = 1.005;
/// How many more dampings are tried where a curve falls out of the picture.
const FALLING: u32 = 6;
/// The turns of a hand that leads slowly, and of one that shakes, in samples.
pub const SLOWLY: u32 = 30;
pub const SHAKEN: u32 = 1;
/// How long a hand leads, and how long a handle that is let go is watched, in samples.
const LED: u32 = 300;
const FREE: u32 = 2000;

/// What is asked of a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Asked {
    /// That it is passive at a hand that turns after so many samples.
    Passive(u32),
    /// That a handle settles that is let go.
    Settles,
}

/// Where a curve ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Limit {
    /// No wall holds, however soft.
    Below,
    /// N/m
    At(f64),
    /// All walls hold.
    Above,
}

/// The limits of one hold.
pub struct Curve {
    /// The hold.
    pub hold: Hold,
    /// Whether with the budget.
    pub budget: bool,
    /// Dampings, N s/m, and limits.
    pub points: Vec<(f64, Limit)>,
}

/// Values in equal ratios.
fn grid((low, high): (i32, i32)) -> impl Iterator<Item = f64> {
    (low * PER_DECADE..=high * PER_DECADE).map(|i| 10f64.powf(f64::from(i) / f64::from(PER_DECADE)))
}

/// The first stiffness for which it does not hold, upwards from the softest.
fn first(mut holds: impl FnMut(f64) -> Result<bool, String>) -> Result<Limit, String> {
    let mut known = None;
    for k in grid(STIFFNESS) {
        if holds(k)? {
            known = Some(k);
            continue;
        }
        let Some(mut low) = known else { return Ok(Limit::Below) };
        let mut high = k;
        while high > CLOSE * low {
            let middle = (low * high).sqrt();
            if holds(middle)? {
                low = middle;
            } else {
                high = middle;
            }
        }
        return Ok(Limit::At((low * high).sqrt()));
    }
    Ok(Limit::Above)
}

/// The limits of each hold without the budget, then of each with it.
///
/// # Errors
/// In words.
pub fn curves(asked: Asked) -> Result<Vec<Curve>, String> {
    let mut list = Vec::new();
    for budget in [false, true] {
        for hold in HOLDS {
            let computed = Computed::Sampled(hold, budget);
            let scene = match asked {
                Asked::Passive(_) => Scene::led(computed),
                Asked::Settles => Scene::free(computed),
            };
            let at = |b: f64| {
                first(|k| match asked {
                    Asked::Passive(turn) => scene.passive(Wall { k, b }, turn, LED),
                    Asked::Settles => scene.settles(Wall { k, b }, FREE),
                })
            };
            list.push(Curve { hold, budget, points: points(at)? });
        }
    }
    Ok(list)
}

/// The limits at the dampings of the grid, and at some more where a curve falls out of the picture.
fn points(limit: impl Fn(f64) -> Result<Limit, String>) -> Result<Vec<(f64, Limit)>, String> {
    let mut list: Vec<(f64, Limit)> = Vec::new();
    for b in grid(DAMPING) {
        let found = limit(b)?;
        if let (Some((mut low, Limit::At(_))), Limit::Below) = (list.last().copied(), found) {
            let mut high = b;
            for _ in 0..FALLING {
                let middle = (low * high).sqrt();
                match limit(middle)? {
                    Limit::Below => high = middle,
                    passes => {
                        list.push((middle, passes));
                        low = middle;
                    }
                }
            }
            list.push((high, found));
        }
        if list.last().is_none_or(|p| p.0 < b) {
            list.push((b, found));
        }
    }
    Ok(list)
}

/// Colgate and Schenkel, for `lagged`: b = K T/2 + B solved for K, N/m.
pub fn colgate(damping: f64) -> f64 {
    2.0 * (FRICTION - damping) / PERIOD
}

/// What `lagged` and `predicted` come to with a hand that turns after so many samples: what the wall gives and what the
/// friction takes in half a turn are equal.
fn counted(hold: Hold, damping: f64, turn: u32) -> Option<f64> {
    let n = f64::from(turn);
    let taken = n * FRICTION + damping * (n - 2.0);
    match hold {
        Hold::Lagged => Some(2.0 * taken / (n * PERIOD)),
        Hold::Predicted => Some(taken / PERIOD),
        Hold::Matched => None,
    }
}

fn told(limit: Limit) -> String {
    match limit {
        Limit::Below => "none passes".into(),
        Limit::At(k) => stiffness(k),
        Limit::Above => "no limit".into(),
    }
}

/// Three digits.
fn stiffness(k: f64) -> String {
    let digits = 10f64.powf((k.log10().floor() - 2.0).max(0.0));
    format!("{}", (k / digits).round() * digits)
}

/// The limits at whole decades of the damping.
pub fn limits(asked: Asked, curves: &[Curve]) -> String {
    let mut head = vec!["B, N s/m".to_string()];
    head.extend(curves.iter().map(|c| format!("`{}`{}", c.hold, if c.budget { "" } else { ", budget off" })));
    if let Asked::Passive(_) = asked {
        head.extend([Hold::Lagged, Hold::Predicted].map(|h| format!("`{h}`, budget off, by the formula")));
    }
    let mut rows = Vec::new();
    for b in (DAMPING.0..=DAMPING.1).map(|k| 10f64.powi(k)) {
        let mut row = vec![format!("{b}")];
        let nearest =
            |c: &Curve| c.points.iter().find(|p| (p.0 / b - 1.0).abs() < 1e-9).map_or("-".into(), |p| told(p.1));
        row.extend(curves.iter().map(nearest));
        if let Asked::Passive(turn) = asked {
            let counted = [Hold::Lagged, Hold::Predicted].map(|h| counted(h, b, turn));
            row.extend(
                counted.into_iter().flatten().map(|k| if k > 0.0 { stiffness(k) } else { "none passes".into() }),
            );
        }
        rows.push(row);
    }
    table(&head.iter().map(String::as_str).collect::<Vec<_>>(), &rows)
}
