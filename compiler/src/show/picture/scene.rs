//! A picture as lines, boxes and texts at their places: bonds straight where the way is free, else with corners; then
//! signals; then names where nothing else is.

use super::diagram::{Bonds, Diagram, Link, SMALL, Shape};
use super::font::width;
use super::geometry::{Point, Rect, Segment, along, apart, cross, distance, length, minus, unit};
use super::grid;
use super::route::{End, Field};
use super::spread::{LENGTHS, frames, spread};
use std::collections::BTreeMap;

/// Something that is drawn.
#[derive(Clone, Debug)]
pub(crate) enum Mark {
    /// A line through points.
    Line(Vec<Point>, &'static str),
    /// A filled area.
    Area(Vec<Point>, &'static str),
    /// A box, with how round its corners are.
    Frame(Rect, f64, &'static str),
    /// A dot where signals part.
    Dot(Point),
    /// A text in a row: its middle, its parts with their sizes.
    Text(Point, Vec<(String, f64)>, &'static str),
}

/// What belongs together.
#[derive(Clone, Debug)]
pub(crate) struct Item {
    /// Its id; none of a box.
    pub id: String,
    /// What is shown when the pointer rests on it.
    pub title: String,
    /// `box`, `bond`, `signal` or `node`.
    pub class: &'static str,
    /// What is drawn, in order.
    pub marks: Vec<Mark>,
}

/// A picture.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scene {
    /// Its upper left corner.
    pub low: Point,
    /// Its width and height.
    pub size: Point,
    /// What is drawn, from the back.
    pub items: Vec<Item>,
}

/// Half of a causal stroke, a double bar and the distance of the lines of a bundle, and the barb of a half arrow.
struct Signs {
    stroke: f64,
    bar: f64,
    double: f64,
    barb: [f64; 2],
    /// The head of a signal: its length and half its width.
    head: [f64; 2],
}

const SIGNS: Signs = Signs { stroke: 6.5, bar: 11.0, double: 2.0, barb: [10.0, 6.5], head: [8.0, 3.2] };

/// By how much a slanted bond is shorter at its two ends, the least first.
const SHORTER: [[f64; 2]; 13] = [
    [0.0, 0.0],
    [0.0, 4.0],
    [7.0, 0.0],
    [0.0, 7.0],
    [4.0, 4.0],
    [7.0, 7.0],
    [14.0, 0.0],
    [0.0, 14.0],
    [12.0, 12.0],
    [20.0, 0.0],
    [0.0, 20.0],
    [20.0, 7.0],
    [7.0, 20.0],
];

/// By how much farther apart nodes are where some line finds no way.
const WIDER: [f64; 5] = [1.25, 1.5, 2.0, 2.5, 3.0];

/// How near lines and labels may come to one another.
const CLEAR: f64 = 3.0;

/// A drawn link.
struct Path {
    points: Vec<Point>,
    /// Whether it is a bond, and no signal.
    is_bond: bool,
    /// Around the signs at its ends.
    zones: Vec<Segment>,
    /// The bars at its middle.
    bars: Option<Segment>,
    /// What its signs are drawn by.
    signs: Vec<Segment>,
}

impl Path {
    fn segments(&self) -> impl Iterator<Item = Segment> {
        self.points.windows(2).map(|w| [w[0], w[1]])
    }
}

/// Where everything is.
struct Drawn {
    nodes: Vec<Rect>,
    frames: Vec<Rect>,
    paths: Vec<Path>,
    /// The titles of boxes, in their order.
    titles: Vec<Rect>,
    /// The texts at each link.
    names: Vec<(usize, String, Rect)>,
    /// How many lines found no way, and texts no place.
    lost: usize,
}

/// The picture of a diagram.
pub(crate) fn scene(diagram: &Diagram) -> Scene {
    let cells = grid::place(diagram);
    let drawn = drawn(diagram, &cells);
    let mut scene = Scene::default();
    let item = |id: &str, title: &str, class, marks| Item { id: id.into(), title: title.into(), class, marks };
    for (g, r) in diagram.groups.iter().zip(&drawn.frames).filter(|(_, r)| is_drawn(r)) {
        let class = if g.sampled { "sampled" } else { "part" };
        scene.items.push(item("", &g.name, "box", vec![Mark::Frame(*r, 8.0, class)]));
    }
    let first = scene.items.len();
    for (l, path) in diagram.links.iter().zip(&drawn.paths) {
        let class = if l.bonds.is_some() { "bond" } else { "signal" };
        scene.items.push(item(&l.id, &l.title, class, signs(l, path)));
    }
    branches(diagram, &drawn.paths, &mut scene);
    for (i, text, at) in &drawn.names {
        scene.items[first + i].marks.push(Mark::Text(at.middle, vec![(text.clone(), SMALL)], "name"));
    }
    for (n, r) in diagram.nodes.iter().zip(&drawn.nodes) {
        let mut marks = Vec::new();
        match n.shape {
            Shape::Block => marks.push(Mark::Frame(*r, 2.0, "block")),
            Shape::Input => marks.push(Mark::Frame(*r, r.half[1], "block")),
            Shape::Element | Shape::Junction | Shape::Open | Shape::Tag => {}
        }
        let class = match (n.shape, n.derivative) {
            (_, true) => "derivative",
            (Shape::Junction, false) => "junction",
            (Shape::Open | Shape::Tag, false) => "open",
            (Shape::Element | Shape::Block | Shape::Input, false) => "element",
        };
        marks.push(Mark::Text(r.middle, n.runs(), class));
        scene.items.push(item(&n.id, &n.title, "node", marks));
    }
    let boxes = diagram.groups.iter().zip(&drawn.frames).filter(|(_, r)| is_drawn(r));
    for ((g, _), at) in boxes.zip(&drawn.titles) {
        let text = Mark::Text(at.middle, vec![(g.name.clone(), SMALL)], "label");
        scene.items.push(item("", "", "box", vec![text]));
    }
    let names = drawn.names.iter().map(|n| &n.2);
    let frames = drawn.frames.iter().filter(|r| is_drawn(r));
    frame(&mut scene, drawn.nodes.iter().chain(&drawn.titles).chain(names).chain(frames), &drawn.paths);
    scene
}

/// Whether a box has anything in it.
fn is_drawn(r: &Rect) -> bool {
    r.half[0] > 0.0 && r.half[0] < 1e300
}

/// Everything at its place: farther apart where some line finds no way, or some text no place.
fn drawn(diagram: &Diagram, cells: &[grid::Cell]) -> Drawn {
    let mut best = drawn_at(diagram, cells, 1.0);
    for scale in WIDER {
        if best.lost == 0 {
            break;
        }
        let next = drawn_at(diagram, cells, scale);
        if next.lost < best.lost {
            best = next;
        }
    }
    best
}

fn drawn_at(diagram: &Diagram, cells: &[grid::Cell], scale: f64) -> Drawn {
    let nodes = spread(diagram, cells, scale);
    let frames = frames(diagram, &nodes);
    let (paths, mut lost) = paths(diagram, &nodes, &frames);
    let mut labels: Vec<Rect> = Vec::new();
    for (g, r) in diagram.groups.iter().zip(&frames).filter(|(_, r)| is_drawn(r)) {
        let (at, price) = title(&g.name, *r, (&nodes, &paths, &labels, &frames));
        lost += usize::from(price >= 1.0);
        labels.push(at);
    }
    let titles = labels.clone();
    let mut names = Vec::new();
    for (i, l) in diagram.links.iter().enumerate() {
        for (text, wish) in wishes(l, &paths[i]) {
            let half = [0.5 * width(&text, SMALL) + 1.0, 5.5];
            let (middle, price) = spot(&wish, half, (&nodes, &paths, &labels, &frames), i);
            lost += usize::from(price >= 1.0);
            labels.push(Rect { middle, half });
            names.push((i, text, Rect { middle, half }));
        }
    }
    Drawn { nodes, frames, paths, titles, names, lost }
}

/// Dots where a signal leaves the way that it shares with one from the same node.
fn branches(diagram: &Diagram, paths: &[Path], scene: &mut Scene) {
    let from = scene.items.len() - paths.len();
    let signals = |tail: usize| {
        let of = move |(_, l): &(usize, &Link)| l.bonds.is_none() && l.tail == tail;
        diagram.links.iter().enumerate().filter(of).map(|(i, _)| i)
    };
    for (i, l) in diagram.links.iter().enumerate().filter(|(_, l)| l.bonds.is_none()) {
        let mut last: Option<Point> = None;
        for pair in paths[i].points.windows(2) {
            let on = |p: Point| signals(l.tail).any(|j| j != i && paths[j].segments().any(|s| distance(p, s) < 0.1));
            // The ways are shared from the start on: what is left last is where they part.
            let d = minus(pair[1], pair[0]);
            let steps = length(d).ceil().max(1.0);
            for k in 0..=steps as usize {
                let p = along(pair[0], d, k as f64 / steps);
                if on(p) {
                    last = Some(p);
                }
            }
        }
        let ends = [paths[i].points[0], paths[i].points[paths[i].points.len() - 1]];
        if let Some(p) = last.filter(|p| ends.iter().all(|e| length(minus(*e, *p)) > 3.0)) {
            scene.items[from + i].marks.push(Mark::Dot(p));
        }
    }
}

/// The edges of the whole picture.
fn frame<'a>(scene: &mut Scene, all: impl Iterator<Item = &'a Rect>, paths: &[Path]) {
    let mut b = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    let mut cover = |p: Point, half: Point| {
        for k in 0..2 {
            b[k] = b[k].min(p[k] - half[k]);
            b[k + 2] = b[k + 2].max(p[k] + half[k]);
        }
    };
    all.filter(|r| r.half[0] >= 0.0).for_each(|r| cover(r.middle, r.half));
    paths.iter().flat_map(|p| &p.points).for_each(|p| cover(*p, [SIGNS.stroke; 2]));
    if b[0] > b[2] {
        b = [0.0; 4];
    }
    scene.low = [b[0] - LENGTHS.margin, b[1] - LENGTHS.margin];
    scene.size = [b[2] - b[0] + 2.0 * LENGTHS.margin, b[3] - b[1] + 2.0 * LENGTHS.margin];
}

/// The lines of all links, and how many of them found no way.
fn paths(diagram: &Diagram, nodes: &[Rect], frames: &[Rect]) -> (Vec<Path>, usize) {
    let links = &diagram.links;
    let mut of_pair: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for (i, l) in links.iter().enumerate().filter(|(_, l)| l.bonds.is_some()) {
        of_pair.entry((l.tail.min(l.head), l.tail.max(l.head))).or_default().push(i);
    }
    let mut done: Vec<Option<Path>> = links.iter().map(|_| None).collect();
    let mut straight: Vec<(f64, usize, Path)> = Vec::new();
    for ((a, b), list) in &of_pair {
        let d = unit(minus(nodes[*b].middle, nodes[*a].middle));
        for (k, &i) in list.iter().enumerate() {
            // Bonds between the same two lie beside each other.
            let aside = 24.0 * (k as f64 - 0.5 * (list.len() as f64 - 1.0));
            let shift = |r: Rect| Rect { middle: [r.middle[0] - aside * d[1], r.middle[1] + aside * d[0]], ..r };
            let (from, to) = (shift(nodes[links[i].tail]), shift(nodes[links[i].head]));
            let path = direct(&links[i], from, to, [LENGTHS.air; 2]);
            let slant = minus(to.middle, from.middle);
            let slanted = slant[0].abs() > 0.5 && slant[1].abs() > 0.5;
            straight.push((length(slant) + if slanted { 1e4 } else { 0.0 }, i, path));
        }
    }
    straight.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut left = Vec::new();
    for (_, i, path) in straight {
        // Where signs of neighbours are in the way, a slanted bond begins or ends a little farther out.
        let ends = [path.points[0], path.points[1]];
        let slanted = (0..2).all(|k| (ends[0][k] - ends[1][k]).abs() > 0.5);
        let options = if slanted { &SHORTER[..] } else { &SHORTER[..1] };
        let shorter = |by: &[f64; 2]| {
            let u = unit(minus(ends[1], ends[0]));
            with_signs(&links[i], vec![along(ends[0], u, by[0]), along(ends[1], u, -by[1])])
        };
        let free = |p: &Path| is_free(p, &links[i], nodes, done.iter().flatten());
        match options.iter().map(shorter).find(free) {
            Some(path) => done[i] = Some(path),
            None => left.push((i, path)),
        }
    }
    let mut b = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    for r in nodes.iter().chain(frames.iter().filter(|r| r.half[0] > 0.0 && r.half[0] < 1e300)) {
        for k in 0..2 {
            b[k] = b[k].min(r.middle[k] - r.half[k] - 64.0);
            b[k + 2] = b[k + 2].max(r.middle[k] + r.half[k] + 64.0);
        }
    }
    if links.is_empty() {
        return (Vec::new(), 0);
    }
    let mut lost = 0;
    let whole =
        Rect { middle: [0.5 * (b[0] + b[2]), 0.5 * (b[1] + b[3])], half: [0.5 * (b[2] - b[0]), 0.5 * (b[3] - b[1])] };
    let mut field = Field::new(whole);
    nodes.iter().for_each(|r| field.block(r.grown(6.0)));
    done.iter().flatten().for_each(|p| occupy(&mut field, p, None));
    for (i, path) in left {
        let l = &links[i];
        let long = if l.bonds.as_ref().is_some_and(|b| b.sampled) { 24.0 } else { 16.0 };
        let stroke = l.bonds.as_ref().is_some_and(|b| b.strokes[0] > 0);
        let tail = End { lead: long, sign: if stroke { 0.0 } else { -1.0 } };
        let ends = [tail, End { lead: 16.0, sign: SIGNS.barb[0] }];
        let way = field.route((nodes[l.tail], nodes[l.head]), ends, LENGTHS.air, None);
        lost += usize::from(way.is_none());
        let path = way.map_or(path, |points| with_signs(l, points));
        occupy(&mut field, &path, None);
        done[i] = Some(path);
    }
    let mut signals: Vec<usize> = (0..links.len()).filter(|i| links[*i].bonds.is_none()).collect();
    let far = |i: &usize| length(minus(nodes[links[*i].tail].middle, nodes[links[*i].head].middle));
    signals.sort_by(|a, b| far(a).total_cmp(&far(b)).then(a.cmp(b)));
    for i in signals {
        let l = &links[i];
        let ends = [End { lead: 4.0, sign: -1.0 }, End { lead: 12.0, sign: 0.0 }];
        let way = field.route((nodes[l.tail], nodes[l.head]), ends, 2.0, Some(l.tail));
        lost += usize::from(way.is_none());
        let path = match way {
            Some(points) => with_signs(l, points),
            None => direct(l, nodes[l.tail], nodes[l.head], [LENGTHS.air; 2]),
        };
        occupy(&mut field, &path, Some(l.tail));
        done[i] = Some(path);
    }
    (done.into_iter().flatten().collect(), lost)
}

/// Takes the place of a line from others.
fn occupy(field: &mut Field, path: &Path, node: Option<usize>) {
    path.segments().for_each(|s| field.line(s, node));
    field.draw(&path.signs, node);
    for z in path.zones.iter().chain(&path.bars) {
        let middle = [0, 1].map(|k| 0.5 * (z[0][k] + z[1][k]));
        let half = [0, 1].map(|k| 0.5 * (z[0][k] - z[1][k]).abs() + SIGNS.stroke + 2.0);
        field.block(Rect { middle, half });
    }
}

/// The straight line between two labels.
fn direct(l: &Link, from: Rect, to: Rect, air: [f64; 2]) -> Path {
    let u = unit(minus(to.middle, from.middle));
    let a = from.grown(air[0]).leave(from.middle, u);
    let b = to.grown(air[1]).leave(to.middle, [-u[0], -u[1]]);
    with_signs(l, vec![a, b])
}

fn with_signs(l: &Link, points: Vec<Point>) -> Path {
    let n = points.len();
    let ends = [(points[0], points[1]), (points[n - 1], points[n - 2])];
    let (mut zones, mut bars) = (Vec::new(), None);
    match &l.bonds {
        Some(bonds) => {
            if bonds.strokes[0] > 0 {
                zones.push([ends[0].0, along(ends[0].0, unit(minus(ends[0].1, ends[0].0)), 2.0)]);
            }
            zones.push([ends[1].0, along(ends[1].0, unit(minus(ends[1].1, ends[1].0)), SIGNS.barb[0])]);
            if bonds.sampled {
                let (p, u) = longest(&points);
                bars = Some([along(p, [-u[1], u[0]], -SIGNS.bar), along(p, [-u[1], u[0]], SIGNS.bar)]);
            }
        }
        None => zones.push([ends[1].0, along(ends[1].0, unit(minus(ends[1].1, ends[1].0)), SIGNS.head[0])]),
    }
    let mut path = Path { points, is_bond: l.bonds.is_some(), zones, bars, signs: Vec::new() };
    let drawn = signs(l, &path);
    let lines = drawn.iter().filter_map(|m| match m {
        Mark::Line(list, _) | Mark::Area(list, _) => Some(list),
        Mark::Dot(_) | Mark::Frame(..) | Mark::Text(..) => None,
    });
    path.signs = lines.flat_map(|list| list.windows(2).map(|w| [w[0], w[1]])).collect();
    path
}

/// The middle of the longest stretch, and its direction.
fn longest(points: &[Point]) -> (Point, Point) {
    let mut best = ([0.0; 2], [1.0, 0.0], -1.0);
    for w in points.windows(2) {
        let d = minus(w[1], w[0]);
        if length(d) > best.2 + 1e-6 {
            best = (along(w[0], d, 0.5), unit(d), length(d));
        }
    }
    (best.0, best.1)
}

/// Whether a straight bond meets nothing that is there: labels, signs of others, lines along it.
fn is_free<'a>(path: &Path, l: &Link, nodes: &[Rect], others: impl Iterator<Item = &'a Path>) -> bool {
    let line = [path.points[0], path.points[1]];
    if length(minus(line[1], line[0])) < 24.0 {
        return false;
    }
    for (i, r) in nodes.iter().enumerate() {
        let own = i == l.tail || i == l.head;
        if !own && r.grown(CLEAR + 1.0).crossed(line) {
            return false;
        }
        let reach = SIGNS.stroke + CLEAR;
        if own && path.signs.iter().any(|s| r.crossed(*s)) {
            return false;
        }
        if !own && path.zones.iter().chain(&path.bars).any(|z| r.grown(reach).crossed(*z)) {
            return false;
        }
    }
    let near = SIGNS.stroke + CLEAR;
    for o in others {
        for s in o.segments() {
            if path.zones.iter().chain(&path.bars).any(|z| apart(*z, s) < near) {
                return false;
            }
            let (u, v) = (unit(minus(line[1], line[0])), unit(minus(s[1], s[0])));
            if apart(line, s) < 6.0 && cross(u, v).abs() < 0.35 {
                return false;
            }
        }
        let mut theirs = o.zones.iter().chain(&o.bars);
        if theirs.any(|z| apart(*z, line) < near || path.zones.iter().any(|y| apart(*y, *z) < near + SIGNS.stroke)) {
            return false;
        }
    }
    true
}

/// Which side of a line is that of the flow: below it, or right of it.
fn flow_side(u: Point) -> Point {
    if u[0] > 0.3 || (u[0].abs() <= 0.3 && u[1] < 0.0) { [-u[1], u[0]] } else { [u[1], -u[0]] }
}

/// The lines and signs of a link.
fn signs(l: &Link, path: &Path) -> Vec<Mark> {
    let points = &path.points;
    let n = points.len();
    let (first, last) = (points[0], points[n - 1]);
    let out = unit(minus(last, points[n - 2]));
    let Some(bonds) = &l.bonds else {
        let base = along(last, out, -SIGNS.head[0]);
        let side = [-out[1], out[0]];
        let corner = |by: f64| along(base, side, by);
        let mut shaft = points.clone();
        shaft[n - 1] = along(last, out, -SIGNS.head[0] + 1.0);
        let head = vec![last, corner(SIGNS.head[1]), corner(-SIGNS.head[1])];
        return vec![Mark::Line(shaft, "signal"), Mark::Area(head, "head")];
    };
    let class = if bonds.derivative { "line derivative" } else { "line" };
    let mut marks = Vec::new();
    let outer = if bonds.size > 1 { SIGNS.double } else { 0.0 };
    if bonds.size > 1 {
        marks.extend([-outer, outer].map(|by| Mark::Line(beside(points, by), class)));
    } else {
        marks.push(Mark::Line(points.clone(), class));
    }
    let side = flow_side(out);
    let barb = along(along(last, out, -SIGNS.barb[0]), side, SIGNS.barb[1] + outer);
    marks.push(Mark::Line(vec![along(last, side, outer), barb], class));
    strokes(bonds, [(first, unit(minus(points[1], first))), (last, out)], &mut marks);
    if bonds.sampled {
        let (p, u) = longest(points);
        let across = [-u[1], u[0]];
        for by in [-3.0, 3.0] {
            let q = along(p, u, by);
            marks.push(Mark::Line(vec![along(q, across, -SIGNS.bar), along(q, across, SIGNS.bar)], "bar"));
        }
    }
    marks
}

/// The causal strokes. Where those of a bundle stand at both ends, each end has half a stroke.
fn strokes(bonds: &Bonds, ends: [(Point, Point); 2], marks: &mut Vec<Mark>) {
    let class = if bonds.derivative { "stroke derivative" } else { "stroke" };
    let reach = SIGNS.stroke + if bonds.size > 1 { SIGNS.double } else { 0.0 };
    let mixed = bonds.strokes[0] > 0 && bonds.strokes[1] > 0;
    for (count, (p, u)) in bonds.strokes.iter().zip(ends) {
        if *count == 0 {
            continue;
        }
        let side = flow_side(u);
        let to = if mixed { SIGNS.double } else { reach };
        marks.push(Mark::Line(vec![along(p, side, -reach), along(p, side, to)], class));
    }
}

/// A line beside a line with square corners.
fn beside(points: &[Point], by: f64) -> Vec<Point> {
    let n = points.len();
    (0..n)
        .map(|i| {
            let normal = |a: usize, b: usize| {
                let u = unit(minus(points[b], points[a]));
                [-u[1], u[0]]
            };
            let p = points[i];
            match i {
                0 => along(p, normal(0, 1), by),
                _ if i + 1 == n => along(p, normal(n - 2, n - 1), by),
                _ => along(along(p, normal(i - 1, i), by), normal(i, i + 1), by),
            }
        })
        .collect()
}

/// Places that a text may have, the best first: a point on the line, and the way off it.
type Wish = Vec<(Point, Point)>;

/// The texts of a link, with where they are wanted.
fn wishes(l: &Link, path: &Path) -> Vec<(String, Wish)> {
    let mut list = Vec::new();
    let stretches: Vec<Segment> = {
        let mut all: Vec<Segment> = path.segments().collect();
        all.sort_by(|a, b| length(minus(b[1], b[0])).total_cmp(&length(minus(a[1], a[0]))));
        all
    };
    for (k, text) in l.labels.iter().enumerate().filter(|t| !t.1.is_empty()) {
        let mut wish = Vec::new();
        for s in &stretches {
            let d = minus(s[1], s[0]);
            let flow = flow_side(unit(d));
            let own = if k == 0 { [-flow[0], -flow[1]] } else { flow };
            for side in [own, [-own[0], -own[1]]] {
                for t in [0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8] {
                    wish.push((along(s[0], d, t), side));
                }
            }
        }
        list.push((text.clone(), wish));
    }
    let n = path.points.len();
    for (text, (p, q)) in
        l.ports.iter().zip([(path.points[0], path.points[1]), (path.points[n - 1], path.points[n - 2])])
    {
        if text.is_empty() {
            continue;
        }
        let u = unit(minus(q, p));
        let side = flow_side(u);
        let reach = 0.5 * width(text, SMALL) + 3.0;
        let along_x = if u[0].abs() > 0.5 { reach } else { 9.0 };
        let at = |by: f64| along(p, u, by);
        let mut wish = Vec::new();
        for by in [along_x, along_x + 8.0, along_x + 16.0] {
            wish.push((at(by), [-side[0], -side[1]]));
            wish.push((at(by), side));
        }
        list.push((text.clone(), wish));
    }
    list
}

/// The first wish where a text meets nothing; else where it meets the least.
fn spot(wish: &Wish, half: Point, around: Around<'_>, own: usize) -> (Point, f64) {
    let paths = around.1;
    let mut best = ([0.0; 2], f64::MAX);
    let base = if paths[own].is_bond { 3.5 } else { 2.5 };
    for far in [0.0, 3.0, 6.0] {
        for (k, (p, side)) in wish.iter().enumerate() {
            let off = base + far + side[0].abs() * half[0] + side[1].abs() * half[1];
            let r = Rect { middle: along(*p, *side, off), half };
            let price = price(r, around) + 1e-3 * (k as f64 + 10.0 * far);
            if price < best.1 {
                best = (r.middle, price);
            }
        }
        if best.1 < 1.0 {
            break;
        }
    }
    best
}

/// Nodes, lines, texts and boxes.
type Around<'a> = (&'a [Rect], &'a [Path], &'a [Rect], &'a [Rect]);

/// How much a text would lie on.
fn price(r: Rect, (nodes, paths, labels, frames): Around<'_>) -> f64 {
    let grown = r.grown(1.0);
    let mut price = frames.iter().filter(|f| f.meets(grown) && !f.covers(grown)).count() as f64;
    price += 3.0 * nodes.iter().chain(labels).filter(|o| o.meets(grown)).count() as f64;
    for p in paths {
        price += p.signs.iter().filter(|s| grown.crossed(**s)).count() as f64;
    }
    price
}

/// Where the title of a box stands: in a corner of it, where the fewest lines run.
fn title(text: &str, r: Rect, around: Around<'_>) -> (Rect, f64) {
    let half = [0.5 * width(text, SMALL), 5.5];
    let top = r.middle[1] - r.half[1] + 9.0;
    let bottom = r.middle[1] + r.half[1] + 9.0;
    let left = r.middle[0] - r.half[0] + half[0] + 7.0;
    let free = r.half[0] - half[0] - 7.0;
    let mut best = (Rect { middle: [left, top], half }, f64::MAX);
    let mut places = vec![[left, top], [left + 2.0 * free.max(0.0), top]];
    for y in [top, r.middle[1] - r.half[1] - 8.0, bottom] {
        // Farther and farther from the middle, as far as half of it is outside.
        for k in 0..12 {
            let step = if k % 2 == 0 { 1.0 } else { -1.0 } * f64::from((k + 1) / 2) / 6.0;
            places.push([r.middle[0] + step * (free.max(0.0) + half[0]), y]);
        }
    }
    // Beside a box that is too narrow.
    for side in [1.0, -1.0] {
        for y in [0.0, 0.5, 1.0, 0.25, 0.75].map(|t| top + t * (bottom - 18.0 - top)) {
            places.push([r.middle[0] + side * (r.half[0] + half[0] + 4.0), y]);
        }
    }
    for (k, middle) in places.into_iter().enumerate() {
        let at = Rect { middle, half };
        let price = price(at, around) + 1e-3 * k as f64;
        if price < best.1 {
            best = (at, price);
        }
    }
    best
}
