//! Which points are on the front, and what to choose.

use super::point::{Point, TIMES_REFERENCE};

/// What to choose for an error.
pub struct Advice<'a> {
    /// It, relative.
    pub error: f64,
    /// The cheapest of those that kept the balance.
    pub passive: Option<&'a Point>,
    /// The cheapest of all, if it is another one.
    pub other: Option<&'a Point>,
}

/// Error and time of a point; an error below the accuracy of the reference counts as that accuracy.
pub fn place(p: &Point, reference: f64) -> Option<(f64, f64)> {
    p.result.as_ref().ok().map(|m| (m.error.max(TIMES_REFERENCE * reference), m.seconds))
}

/// The same with the largest error along the run: a small error at the end may be luck.
pub fn met(p: &Point, reference: f64) -> Option<(f64, f64)> {
    p.result.as_ref().ok().map(|m| (m.worst().max(TIMES_REFERENCE * reference), m.seconds))
}

/// Points with a larger error are never chosen, however cheap.
pub const LARGEST_USEFUL_ERROR: f64 = 1.0;

/// Marks the points of the front: for none of them is there another that is as exact and cheaper, or as cheap and more
/// exact.
pub fn mark(points: &mut [Point], reference: f64) {
    let places: Vec<Option<(f64, f64)>> = points.iter().map(|p| place(p, reference)).collect();
    for (i, p) in points.iter_mut().enumerate() {
        let Some((error, seconds)) = places[i] else { continue };
        let beaten = places.iter().enumerate().any(|(k, other)| {
            other.is_some_and(|(e, s)| {
                e <= error && s <= seconds && (e < error || s < seconds || (k < i && e == error && s == seconds))
            })
        });
        p.front = !beaten && error < LARGEST_USEFUL_ERROR;
    }
}

/// Decades of the error, from 0.1 down, as far as the points reach.
pub fn decades(points: &[Point], reference: f64) -> Vec<f64> {
    let reached = points.iter().filter_map(|p| met(p, reference)).map(|p| p.0).fold(f64::INFINITY, f64::min);
    (1..=15).map(|k| format!("1e-{k}").parse().unwrap_or(0.0)).take_while(|error| *error >= reached).collect()
}

/// What to choose, decade by decade.
pub fn advice(points: &[Point], reference: f64) -> Vec<Advice<'_>> {
    let cheapest = |error: f64, passive: bool| {
        let fits = points.iter().filter(|p| !passive || p.keeps());
        let fits = fits.filter_map(|p| met(p, reference).filter(|(e, _)| *e <= error).map(|(_, s)| (p, s)));
        fits.min_by(|a, b| a.1.total_cmp(&b.1)).map(|f| f.0)
    };
    let choose = |error: f64| Advice {
        error,
        passive: cheapest(error, true),
        other: cheapest(error, false).filter(|p| !p.keeps()),
    };
    decades(points, reference).into_iter().map(choose).collect()
}
