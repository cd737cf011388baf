//! The bond graph as a picture, drawn as on a whiteboard.

use super::arrow::{Arrow, escape};
use super::layout::{Drawing, Point, place};
use super::size::SIZES;
use super::{Shown, What, name, node, region};
use crate::graph::Region;
use crate::model::{Bond, Element, Kind, Model, OnePort};
use rustc_hash::FxHashMap;
use std::fmt::Write;

const STYLE: &str = "text{font-family:'DejaVu Sans',Verdana,Helvetica,Arial,sans-serif;font-size:14px;fill:#111}\
.node{text-anchor:middle}.junction{font-weight:bold}.sub{font-size:11px;font-weight:normal;fill:#555}\
.name{font-size:11px;text-anchor:middle;fill:#555}.label{font-size:11px;fill:#31588c;text-anchor:middle}\
.bond{stroke:#111;stroke-width:1.4}.stroke{stroke:#111;stroke-width:2.2}.bar{stroke:#31588c;stroke-width:2}\
.sampled{fill:#e4ecf7;stroke:#e4ecf7;stroke-linejoin:round}";

/// What stands at a node: the kind, and the name where it fits.
fn label(model: &Model, e: &Element) -> String {
    match e.kind {
        Kind::PORT => e.name.clone(),
        _ => {
            let (kind, name) = node::title(model, e);
            format!("{kind}:{name}")
        }
    }
}

fn width(text: &str, size: f64) -> f64 {
    // Capitals and wide letters make up for the narrow ones.
    text.chars()
        .map(|c| {
            if "ilj.:,'|[]()I".contains(c) {
                0.42
            } else if "mwMW@".contains(c) {
                0.97
            } else {
                0.65
            }
        })
        .sum::<f64>()
        * size
}

/// The picture; `graph` without causal strokes.
///
/// # Errors
/// More elements than can be read.
pub(super) fn text(shown: &Shown<'_>, what: What) -> Result<String, String> {
    let model = &*shown.model;
    if model.elements.len() > SIZES.picture {
        return Err(format!(
            "a picture of {} elements is too large to be read (the most is {}); `dot` takes it",
            model.elements.len(),
            SIZES.picture
        ));
    }
    let nodes = node::nodes(model);
    let labels: Vec<String> = nodes.first.iter().map(|id| label(model, model.element(*id))).collect();
    let sizes: Vec<Point> = labels.iter().map(|l| [0.5 * width(l, 14.0), 8.5]).collect();
    let drawn = || model.bonds.iter().enumerate().filter(|(_, b)| !node::hidden(model, b));
    let ends = |b: &Bond| (nodes.of[b.tail.at()], nodes.of[b.head.at()]);
    let bonds: Vec<(usize, usize, f64)> =
        drawn().map(|(_, b)| (ends(b).0, ends(b).1, if b.sampled { 2.0 } else { 1.0 })).collect();
    let parts: Vec<usize> = nodes.first.iter().map(|id| shown.graph.region_of[id.at()].at()).collect();
    let x = place(&Drawing { sizes: &sizes, bonds: &bonds, parts: &parts });
    let mut body = String::new();
    let mut bounds = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    let mut cover = |p: Point, half: Point| {
        for k in 0..2 {
            bounds[k] = bounds[k].min(p[k] - half[k]);
            bounds[k + 2] = bounds[k + 2].max(p[k] + half[k]);
        }
    };
    let lines: Vec<(Point, Point)> = drawn().map(|(_, b)| (x[ends(b).0], x[ends(b).1])).collect();
    let mut names = String::new();
    for r in shown.graph.regions.iter().filter(|r| r.sampling.is_some()) {
        let mut inside: Vec<usize> = r.elements.iter().map(|e| nodes.of[e.at()]).collect();
        inside.dedup();
        shade((shown, r, &inside), (&x, &sizes, &lines), (&mut body, &mut names), &mut cover);
    }
    let mut between: FxHashMap<(usize, usize), usize> = FxHashMap::default();
    for (i, b) in drawn() {
        // Bonds between the same two lie beside each other.
        let (from, to) = ends(b);
        let pair = (from.min(to), from.max(to));
        let count = drawn().filter(|(_, other)| {
            let (s, t) = ends(other);
            (s.min(t), s.max(t)) == pair
        });
        let (count, at) = (count.count(), between.entry(pair).or_default());
        let d = [x[pair.1][0] - x[pair.0][0], x[pair.1][1] - x[pair.0][1]];
        let length = libm::hypot(d[0], d[1]).max(1e-6);
        let aside = 26.0 * (*at as f64 - 0.5 * (count as f64 - 1.0)) / length;
        *at += 1;
        let end = |i: usize| ([x[i][0] - aside * d[1], x[i][1] + aside * d[0]], sizes[i]);
        let stroke = if what == What::Graph { b.stroke } else { shown.causality.strokes.get(i).copied() };
        let arrow = Arrow {
            tail: end(ends(b).0),
            head: end(ends(b).1),
            stroke,
            sampled: b.sampled,
            name: node::bond_name(model, b),
        };
        arrow.svg(&mut body);
    }
    for (i, id) in nodes.first.iter().enumerate() {
        cover(x[i], sizes[i]);
        draw(model, model.element(*id), x[i], &mut body);
    }
    body.push_str(&names);
    if model.elements.is_empty() {
        bounds = [0.0; 4];
    }
    let (w, h) = (bounds[2] - bounds[0] + 2.0 * SIZES.margin, bounds[3] - bounds[1] + 2.0 * SIZES.margin);
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w:.0}\" height=\"{h:.0}\" viewBox=\"{:.1} {:.1} {w:.1} {h:.1}\">\n",
        bounds[0] - SIZES.margin,
        bounds[1] - SIZES.margin
    );
    let _ = writeln!(text, "<title>{}</title>\n<style>{STYLE}</style>", escape(&model.name));
    let _ = writeln!(
        text,
        "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{w:.1}\" height=\"{h:.1}\" fill=\"white\"/>",
        bounds[0] - SIZES.margin,
        bounds[1] - SIZES.margin
    );
    text.push_str(&body);
    text.push_str("</svg>\n");
    Ok(text)
}

fn draw(model: &Model, e: &Element, p: Point, text: &mut String) {
    let y = p[1] + 5.0;
    let name = escape(&e.name);
    let _ = match e.kind {
        Kind::Junction(_) => writeln!(
            text,
            "<text class=\"node junction\" x=\"{:.1}\" y=\"{y:.1}\">{}<tspan class=\"sub\">:{name}</tspan></text>",
            p[0],
            name::kind(e.kind)
        ),
        Kind::OnePort(OnePort::Open) => {
            writeln!(text, "<text class=\"node\" font-style=\"italic\" x=\"{:.1}\" y=\"{y:.1}\">{name}</text>", p[0])
        }
        Kind::OnePort(_) | Kind::TwoPort(_) => {
            let (kind, name) = node::title(model, e);
            let name = escape(&name);
            writeln!(text, "<text class=\"node\" x=\"{:.1}\" y=\"{y:.1}\">{kind}:{name}</text>", p[0])
        }
    };
}

/// A sampled region: the hull of its labels, shaded, and what it is above or below it, where fewer bonds run.
fn shade(
    (shown, r, inside): (&Shown<'_>, &Region, &[usize]),
    (x, sizes, lines): (&[Point], &[Point], &[(Point, Point)]),
    (text, names): (&mut String, &mut String),
    cover: &mut dyn FnMut(Point, Point),
) {
    let mut corners = Vec::new();
    for &i in inside {
        let (p, s) = (x[i], sizes[i]);
        for (sx, sy) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            corners.push([p[0] + sx * s[0], p[1] + sy * s[1]]);
        }
        cover(p, [s[0] + SIZES.padding, s[1] + SIZES.padding]);
    }
    let hull = hull(corners);
    let points: Vec<String> = hull.iter().map(|p| format!("{:.1},{:.1}", p[0], p[1])).collect();
    let _ = writeln!(
        text,
        "<polygon class=\"sampled\" stroke-width=\"{:.0}\" points=\"{}\"/>",
        2.0 * SIZES.padding,
        points.join(" ")
    );
    let label = format!("{}: {}", r.name, region::kind(shown, r));
    let half = [0.5 * width(&label, 11.0), 8.0];
    let edge =
        |k: usize, least: bool| hull.iter().map(|p| p[k]).fold(f64::NAN, if least { f64::min } else { f64::max });
    let middle = 0.5 * (edge(0, true) + edge(0, false));
    let places = [edge(1, true) - SIZES.padding - 10.0, edge(1, false) + SIZES.padding + 10.0].map(|y| [middle, y]);
    let crossed = |p: &Point| {
        let bonds = lines.iter().filter(|l| crosses(**l, *p, half)).count();
        let meets = |q: &Point, s: &Point| (0..2).all(|k| (q[k] - p[k]).abs() < s[k] + half[k]);
        bonds + 2 * x.iter().zip(sizes).filter(|(q, s)| meets(q, s)).count()
    };
    let at = if crossed(&places[1]) < crossed(&places[0]) { places[1] } else { places[0] };
    let _ =
        writeln!(names, "<text class=\"label\" x=\"{:.1}\" y=\"{:.1}\">{}</text>", at[0], at[1] + 4.0, escape(&label));
    cover(at, half);
}

/// Whether a line meets a rectangle.
fn crosses((a, b): (Point, Point), centre: Point, half: Point) -> bool {
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for k in 0..2 {
        let (start, d) = (a[k] - centre[k], b[k] - a[k]);
        if d.abs() < 1e-9 {
            if start.abs() > half[k] {
                return false;
            }
            continue;
        }
        let (s, t) = ((-half[k] - start) / d, (half[k] - start) / d);
        from = from.max(s.min(t));
        to = to.min(s.max(t));
    }
    from <= to
}

/// The convex hull, by Andrew's monotone chain.
fn hull(mut points: Vec<Point>) -> Vec<Point> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let turn = |o: Point, a: Point, b: Point| (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    let half = |points: &mut dyn Iterator<Item = Point>| {
        let mut chain: Vec<Point> = Vec::new();
        for p in points {
            while chain.len() >= 2 && turn(chain[chain.len() - 2], chain[chain.len() - 1], p) <= 0.0 {
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut all = half(&mut points.iter().copied());
    all.extend(half(&mut points.iter().rev().copied()));
    all
}
