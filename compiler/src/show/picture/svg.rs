//! A picture as SVG.

use super::diagram::{Diagram, LETTERS, SMALL};
use super::geometry::Point;
use super::scene::{Mark, Scene};
use std::fmt::Write;

const STYLE: &str = "text{font-family:Helvetica,Arial,'Liberation Sans',sans-serif;font-size:14px;fill:#111;\
text-anchor:middle}.open{font-style:italic}.small{font-size:11px}.sub{fill:#555}.name{fill:#555}.label{fill:#31588c}\
text.derivative{fill:#c0392b}line,polyline{fill:none;stroke:#111}.line{stroke-width:1.4}.stroke{stroke-width:2.2}\
.derivative.line,.derivative.stroke{stroke:#c0392b}.signal{stroke-width:0.9}.head{fill:#111}\
.bar{stroke:#31588c;stroke-width:2}.block{fill:white;stroke:#111;stroke-width:1}\
.part{fill:none;stroke:#999;stroke-dasharray:5 3}.sampled{fill:#e4ecf7;stroke:none}";

/// Text that is safe in XML.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn points(list: &[Point]) -> String {
    list.iter().map(|p| format!("{:.1},{:.1}", p[0], p[1])).collect::<Vec<_>>().join(" ")
}

/// The text of the picture.
pub(crate) fn text(diagram: &Diagram, scene: &Scene) -> String {
    let ([x, y], [w, h]) = (scene.low, scene.size);
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w:.0}\" height=\"{h:.0}\" \
         viewBox=\"{x:.1} {y:.1} {w:.1} {h:.1}\">\n"
    );
    let _ = writeln!(text, "<title>{}</title>\n<style>{STYLE}</style>", escape(&diagram.name));
    let _ = writeln!(text, "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\" fill=\"white\"/>");
    for item in &scene.items {
        let id = if item.id.is_empty() { String::new() } else { format!(" id=\"{}\"", escape(&item.id)) };
        let _ = writeln!(text, "<g class=\"{}\"{id}>", item.class);
        if !item.title.is_empty() {
            let _ = writeln!(text, "<title>{}</title>", escape(&item.title));
        }
        item.marks.iter().for_each(|m| mark(m, &mut text));
        text.push_str("</g>\n");
    }
    text.push_str("</svg>\n");
    text
}

fn mark(m: &Mark, text: &mut String) {
    let _ = match m {
        Mark::Line(list, class) if list.len() == 2 => {
            let [a, b] = [list[0], list[1]];
            writeln!(
                text,
                "<line class=\"{class}\" x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\"/>",
                a[0], a[1], b[0], b[1]
            )
        }
        Mark::Line(list, class) => writeln!(text, "<polyline class=\"{class}\" points=\"{}\"/>", points(list)),
        Mark::Area(list, class) => writeln!(text, "<polygon class=\"{class}\" points=\"{}\"/>", points(list)),
        Mark::Dot(p) => writeln!(text, "<circle class=\"head\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"2\"/>", p[0], p[1]),
        Mark::Frame(r, round, class) => writeln!(
            text,
            "<rect class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" rx=\"{round:.0}\"/>",
            r.middle[0] - r.half[0],
            r.middle[1] - r.half[1],
            2.0 * r.half[0],
            2.0 * r.half[1]
        ),
        Mark::Text(p, runs, class) => {
            let size = runs.first().map_or(LETTERS, |r| r.1);
            let small = if size == SMALL { " small" } else { "" };
            let baseline = p[1] + 0.36 * size;
            let _ = write!(text, "<text class=\"{class}{small}\" x=\"{:.1}\" y=\"{baseline:.1}\">", p[0]);
            for (k, (run, _)) in runs.iter().enumerate() {
                let _ = match k {
                    0 => write!(text, "{}", escape(run)),
                    _ => write!(text, "<tspan class=\"small sub\">{}</tspan>", escape(run)),
                };
            }
            writeln!(text, "</text>")
        }
    };
}
