//! A picture for LaTeX: a `tikzpicture`, in which a pixel is 0.75 points, as on a screen.

use super::diagram::LETTERS;
use super::geometry::Point;
use super::scene::{Mark, Scene};
use std::fmt::Write;

const STYLES: &str = "line/.style={line width=1pt}, stroke/.style={line width=1.6pt}, signal/.style={line width=0.6pt}, \
bar/.style={line width=1.5pt, blue!50!black}, derivative/.style={red!75!black}, part/.style={gray, dashed, rounded corners=5pt}, \
sampled/.style={draw=none, fill=blue!8, rounded corners=5pt}, block/.style={fill=white, line width=0.7pt}, \
head/.style={fill=black}, every node/.style={inner sep=0pt}";

/// Text that LaTeX sets as it is.
fn escape(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '\\' => out.push_str(r"\textbackslash{}"),
            '_' | '&' | '%' | '#' | '$' | '{' | '}' => out.extend(['\\', c]),
            '^' => out.push_str(r"\^{}"),
            '~' => out.push_str(r"\~{}"),
            '∫' => out.push_str(r"$\int$"),
            _ => out.push(c),
        }
    }
    out
}

/// The text that LaTeX reads; it needs the package `tikz`.
pub(crate) fn text(scene: &Scene) -> String {
    let mut text = String::from("% \\usepackage{tikz}\n\\begin{tikzpicture}[x=0.75pt, y=-0.75pt, font=\\sffamily,\n");
    let _ = writeln!(text, "  {STYLES}]");
    for m in scene.items.iter().flat_map(|item| &item.marks) {
        mark(m, &mut text);
    }
    text.push_str("\\end{tikzpicture}\n");
    text
}

fn path(points: &[Point]) -> String {
    points.iter().map(|p| format!("({:.1},{:.1})", p[0], p[1])).collect::<Vec<_>>().join(" -- ")
}

fn mark(m: &Mark, text: &mut String) {
    let _ = match m {
        Mark::Line(list, class) => writeln!(text, "  \\draw[{}] {};", class.replace(' ', ", "), path(list)),
        Mark::Area(list, class) => writeln!(text, "  \\fill[{class}] {} -- cycle;", path(list)),
        Mark::Dot(p) => writeln!(text, "  \\fill ({:.1},{:.1}) circle [radius=1.5pt];", p[0], p[1]),
        Mark::Frame(r, round, class) => writeln!(
            text,
            "  \\draw[{class}, rounded corners={:.1}pt] ({:.1},{:.1}) rectangle ({:.1},{:.1});",
            0.75 * round,
            r.middle[0] - r.half[0],
            r.middle[1] - r.half[1],
            r.middle[0] + r.half[0],
            r.middle[1] + r.half[1]
        ),
        Mark::Text(p, runs, class) => {
            let set = |(run, size): &(String, f64)| {
                let size = if *size < LETTERS { r"\scriptsize " } else { r"\small " };
                format!("{{{size}{}}}", escape(run))
            };
            let color = if *class == "derivative" { "[derivative] " } else { "" };
            let all: String = runs.iter().map(set).collect();
            writeln!(text, "  \\node {color}at ({:.1},{:.1}) {{{all}}};", p[0], p[1])
        }
    };
}
