//! A diagram for Graphviz: half arrows, causal strokes, boxes as clusters, double bars bold, bundles as double lines,
//! signals with open heads.

use super::diagram::{Diagram, Node, Shape};
use std::fmt::Write;

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n"))
}

/// The text that Graphviz reads.
pub(crate) fn text(diagram: &Diagram) -> String {
    let mut text = format!("digraph {} {{\n", quoted(&diagram.name));
    text.push_str("  graph [rankdir=LR, overlap=false, splines=line, nodesep=0.3];\n");
    text.push_str("  node [shape=plaintext, fontname=\"Helvetica\", margin=0.05, width=0, height=0];\n");
    text.push_str("  edge [fontname=\"Helvetica\", fontsize=10, arrowsize=0.9];\n");
    group(diagram, None, 1, &mut text);
    for l in &diagram.links {
        let (mut head, mut tail) = ("vee", "none");
        let mut more = String::new();
        match &l.bonds {
            Some(bonds) => {
                head = if bonds.strokes[1] > 0 { "teelnormal" } else { "lnormal" };
                tail = if bonds.strokes[0] > 0 { "tee" } else { "none" };
                let color = match (bonds.sampled, bonds.derivative) {
                    (true, _) => "#31588c",
                    (false, true) => "#c0392b",
                    (false, false) => "black",
                };
                let color = if bonds.size > 1 { format!("{color}:{color}") } else { color.to_string() };
                let width = if bonds.sampled { ", penwidth=3" } else { "" };
                let _ = write!(more, "{width}, color={}", quoted(&color));
            }
            None => more.push_str(", style=dashed, penwidth=0.7, constraint=false"),
        }
        let labels: Vec<&str> = l.labels.iter().filter(|l| !l.is_empty()).map(String::as_str).collect();
        if !labels.is_empty() {
            let _ = write!(more, ", label={}", quoted(&labels.join(", ")));
        }
        for (end, port) in ["taillabel", "headlabel"].iter().zip(&l.ports).filter(|p| !p.1.is_empty()) {
            let _ = write!(more, ", {end}={}", quoted(port));
        }
        let _ = writeln!(
            text,
            "  n{} -> n{} [dir=both, arrowhead={head}, arrowtail={tail}{more}, id={}, tooltip={}];",
            l.tail,
            l.head,
            quoted(&l.id),
            quoted(&l.title)
        );
    }
    text.push_str("}\n");
    text
}

/// The nodes and the boxes of a box, or of none.
fn group(diagram: &Diagram, of: Option<usize>, depth: usize, text: &mut String) {
    let indent = "  ".repeat(depth);
    for (i, n) in diagram.nodes.iter().enumerate().filter(|(_, n)| n.group == of) {
        let _ = writeln!(text, "{indent}n{i} [{}];", node(n));
    }
    for (i, g) in diagram.groups.iter().enumerate().filter(|(_, g)| g.parent == of) {
        let style = match g.sampled {
            true => "style=\"rounded,filled\"; fillcolor=\"#e8eef7\"; color=\"#8aa4c8\";",
            false => "style=\"rounded,dashed\"; color=\"#999999\";",
        };
        let label = quoted(&g.name);
        let _ = writeln!(text, "{indent}subgraph cluster_{i} {{");
        let _ = writeln!(text, "{indent}  label={label}; fontname=\"Helvetica\"; fontsize=10; {style}");
        group(diagram, Some(i), depth + 1, text);
        let _ = writeln!(text, "{indent}}}");
    }
}

fn node(n: &Node) -> String {
    let label = n.label();
    let more = match (n.shape, n.kind.trim_start_matches('M')) {
        (Shape::Junction, _) => ", fontname=\"Helvetica-Bold\"",
        (Shape::Block, _) => ", shape=box",
        (Shape::Input, _) => ", shape=box, style=rounded",
        (Shape::Tag, _) => "",
        (Shape::Open, _) | (_, "Se" | "Sf") => ", fontcolor=\"#9a3412\"",
        (_, "C" | "I" | "IC") => ", fontcolor=\"#1d4ed8\"",
        (_, "R" | "RS") => ", fontcolor=\"#15803d\"",
        (_, "TF" | "GY") => ", fontcolor=\"#6b21a8\"",
        (Shape::Element, _) => ", fontcolor=\"#57534e\"",
    };
    let margin = if matches!(n.shape, Shape::Block | Shape::Input) { ", margin=0.1" } else { "" };
    format!("label={}{more}{margin}, id={}, tooltip={}", quoted(&label), quoted(&n.id), quoted(&n.title))
}
