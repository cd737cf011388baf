//! What lies on something else in a picture. Only the SVG is looked at, as a reader sees it.

/// A point, in pixels.
type Point = [f64; 2];

/// Lower and upper corner.
type Bounds = [Point; 2];

/// What a link consists of, or a node, or a box.
#[derive(Default)]
struct Group {
    class: String,
    id: String,
    /// Of a signal, where it comes from.
    from: Option<String>,
    /// Lines that bonds and signals run along.
    lines: Vec<[Point; 2]>,
    /// Causal strokes, bars, heads.
    signs: Vec<[Point; 2]>,
    texts: Vec<(String, Bounds)>,
    frames: Vec<(String, Bounds)>,
}

/// What is wrong with a picture, and how many lines cross.
#[derive(Debug, Default)]
pub struct Found {
    /// What lies on what.
    pub faults: Vec<String>,
    /// Lines that cross others with a clear angle.
    pub crossings: usize,
    /// The ids of nodes.
    pub nodes: Vec<String>,
    /// The ids of signals.
    pub signals: Vec<String>,
}

fn attribute<'t>(line: &'t str, key: &str) -> &'t str {
    let rest = line.split(&format!(" {key}=\"")).nth(1).unwrap_or_default();
    rest.split('"').next().unwrap_or_default()
}

fn number(line: &str, key: &str) -> f64 {
    attribute(line, key).parse().unwrap_or(f64::NAN)
}

fn points(line: &str) -> Vec<Point> {
    let point = |p: &str| {
        let (x, y) = p.split_once(',').unwrap_or_default();
        [x.parse().unwrap_or(f64::NAN), y.parse().unwrap_or(f64::NAN)]
    };
    attribute(line, "points").split(' ').map(point).collect()
}

/// A text without its tags.
fn plain(text: &str) -> String {
    let (mut out, mut inside) = (String::new(), false);
    for c in text.chars() {
        match c {
            '<' => inside = true,
            '>' if inside => inside = false,
            _ if !inside => out.push(c),
            _ => {}
        }
    }
    out.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"").replace("&amp;", "&")
}

fn groups(svg: &str, width: &dyn Fn(&str, f64) -> f64) -> Vec<Group> {
    let mut list: Vec<Group> = Vec::new();
    for line in svg.lines() {
        let class = attribute(line, "class");
        if line.starts_with("<g ") {
            list.push(Group { class: class.into(), id: attribute(line, "id").into(), ..Group::default() });
        }
        let Some(g) = list.last_mut() else { continue };
        let from = line.strip_prefix("<title>signal from ").and_then(|l| l.split(" to ").next());
        g.from = from.map(String::from).or(g.from.take());
        if line.starts_with("<line") || line.starts_with("<polyline") {
            let list = if line.starts_with("<line") {
                vec![[number(line, "x1"), number(line, "y1")], [number(line, "x2"), number(line, "y2")]]
            } else {
                points(line)
            };
            let sign = class.contains("stroke") || class.contains("bar");
            let to = if sign { &mut g.signs } else { &mut g.lines };
            to.extend(list.windows(2).map(|w| [w[0], w[1]]));
        } else if line.starts_with("<polygon") {
            let p = points(line);
            g.signs.extend([[p[0], p[1]], [p[1], p[2]], [p[2], p[0]]]);
        } else if line.starts_with("<rect") {
            let low = [number(line, "x"), number(line, "y")];
            let high = [low[0] + number(line, "width"), low[1] + number(line, "height")];
            g.frames.push((class.into(), [low, high]));
        } else if line.starts_with("<text") {
            let (head, tail) = line.split_once("<tspan").unwrap_or((line, ""));
            let size = if class.contains("small") { 11.0 } else { 14.0 };
            let first = plain(head);
            let second = if tail.is_empty() { String::new() } else { plain(&format!("<tspan{tail}")) };
            let half = 0.5 * (width(&first, size) + width(&second, 11.0));
            let (x, y) = (number(line, "x"), number(line, "y"));
            g.texts.push((first + &second, [[x - half, y - 0.74 * size], [x + half, y + 0.21 * size]]));
        }
    }
    list
}

fn meet(a: &Bounds, b: &Bounds) -> bool {
    (0..2).all(|k| a[0][k] < b[1][k] - 0.3 && b[0][k] < a[1][k] - 0.3)
}

fn crosses(b: &Bounds, [p, q]: [Point; 2]) -> bool {
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for k in 0..2 {
        let d = q[k] - p[k];
        if d.abs() < 1e-9 {
            if p[k] <= b[0][k] || p[k] >= b[1][k] {
                return false;
            }
            continue;
        }
        let (s, t) = ((b[0][k] - p[k]) / d, (b[1][k] - p[k]) / d);
        from = from.max(s.min(t));
        to = to.min(s.max(t));
    }
    from < to
}

fn off(p: Point, [a, b]: [Point; 2]) -> f64 {
    let d = [b[0] - a[0], b[1] - a[1]];
    let square = d[0] * d[0] + d[1] * d[1];
    let t = if square > 0.0 { (((p[0] - a[0]) * d[0] + (p[1] - a[1]) * d[1]) / square).clamp(0.0, 1.0) } else { 0.0 };
    (p[0] - a[0] - t * d[0]).hypot(p[1] - a[1] - t * d[1])
}

/// Where two stretches cross.
fn crossing(a: [Point; 2], b: [Point; 2]) -> Option<Point> {
    let (u, v) = ([a[1][0] - a[0][0], a[1][1] - a[0][1]], [b[1][0] - b[0][0], b[1][1] - b[0][1]]);
    let det = u[0] * v[1] - u[1] * v[0];
    if det.abs() < 1e-9 {
        return None;
    }
    let w = [b[0][0] - a[0][0], b[0][1] - a[0][1]];
    let (s, t) = ((w[0] * v[1] - w[1] * v[0]) / det, (w[0] * u[1] - w[1] * u[0]) / det);
    let inside = (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t);
    inside.then(|| [a[0][0] + s * u[0], a[0][1] + s * u[1]])
}

fn apart(a: [Point; 2], b: [Point; 2]) -> f64 {
    if crossing(a, b).is_some() {
        return 0.0;
    }
    off(a[0], b).min(off(a[1], b)).min(off(b[0], a)).min(off(b[1], a))
}

/// Whether two stretches run along each other.
fn run_along(a: [Point; 2], b: [Point; 2]) -> bool {
    let (u, v) = ([a[1][0] - a[0][0], a[1][1] - a[0][1]], [b[1][0] - b[0][0], b[1][1] - b[0][1]]);
    let size = u[0].hypot(u[1]) * v[0].hypot(v[1]);
    (u[0] * v[1] - u[1] * v[0]).abs() < 0.3 * size
}

/// What lies on something else.
pub fn look(svg: &str, width: &dyn Fn(&str, f64) -> f64) -> Found {
    let groups = groups(svg, width);
    let mut found = Found::default();
    let fault = |found: &mut Found, words: String| found.faults.push(words);
    let texts: Vec<(usize, &String, &Bounds)> =
        groups.iter().enumerate().flat_map(|(i, g)| g.texts.iter().map(move |(t, b)| (i, t, b))).collect();
    for (k, (_, s, b)) in texts.iter().enumerate() {
        for (_, t, c) in &texts[..k] {
            if meet(b, c) {
                fault(&mut found, format!("text `{s}` on text `{t}`"));
            }
        }
        for (i, g) in groups.iter().enumerate() {
            if g.lines.iter().chain(&g.signs).any(|l| crosses(b, *l)) {
                fault(&mut found, format!("text `{s}` on {}", g.id));
            }
            for (class, [low, high]) in &g.frames {
                let corners = [*low, [high[0], low[1]], *high, [low[0], high[1]]];
                let on_edge = (0..4).any(|e| crosses(b, [corners[e], corners[(e + 1) % 4]]));
                if class != "sampled" && on_edge {
                    fault(&mut found, format!("text `{s}` on the edge of box {i} {}", g.id));
                }
            }
        }
    }
    let links: Vec<&Group> = groups.iter().filter(|g| g.class == "bond" || g.class == "signal").collect();
    for g in groups.iter().filter(|g| g.class == "node") {
        found.nodes.push(g.id.clone());
        for (_, b) in &g.frames {
            for l in &links {
                if l.lines.iter().any(|s| crosses(b, *s)) {
                    fault(&mut found, format!("{} through block {}", l.id, g.id));
                }
            }
        }
    }
    found.signals.extend(links.iter().filter(|g| g.class == "signal").map(|g| g.id.clone()));
    for (k, g) in links.iter().enumerate() {
        for h in &links[..k] {
            pair(g, h, &mut found);
        }
    }
    found
}

/// Two links: signs on lines or signs, lines along each other, lines that cross at an end.
fn pair(g: &Group, h: &Group, found: &mut Found) {
    for (a, b) in [(g, h), (h, g)] {
        if a.signs.iter().any(|s| b.lines.iter().any(|l| apart(*s, *l) < 1.5)) {
            found.faults.push(format!("a sign of {} on {}", a.id, b.id));
        }
    }
    if g.signs.iter().any(|s| h.signs.iter().any(|t| apart(*s, *t) < 1.5)) {
        found.faults.push(format!("signs of {} and {}", g.id, h.id));
    }
    let mut crossed = false;
    for s in &g.lines {
        for t in &h.lines {
            let near = apart(*s, *t);
            // Signals from one node may share the way.
            let shared = g.from.is_some() && g.from == h.from;
            if run_along(*s, *t) && near < 3.0 && !(shared && near < 0.2) {
                found.faults.push(format!("{} along {}", g.id, h.id));
                return;
            }
            crossed |= near == 0.0 && !shared;
        }
    }
    found.crossings += usize::from(crossed);
}
