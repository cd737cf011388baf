//! The bond graph for Graphviz: half arrows, causal strokes, regions as clusters, double bars bold.

use super::{Shown, What, name, node, region};
use crate::model::{BondId, ElementId, Kind, OnePort};
use bond_grammar::ast::Stroke;
use std::fmt::Write;

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

/// The graph; `graph` without causal strokes.
pub(super) fn text(shown: &Shown<'_>, what: What) -> String {
    let model = &*shown.model;
    let nodes = node::nodes(model);
    let mut text = format!("digraph {} {{\n", quoted(&model.name));
    text.push_str("  graph [rankdir=LR, overlap=false, splines=line, nodesep=0.3];\n");
    text.push_str("  node [shape=plaintext, fontname=\"Helvetica\", margin=0.05, width=0, height=0];\n");
    text.push_str("  edge [fontname=\"Helvetica\", fontsize=10, arrowsize=0.9];\n");
    for (i, r) in shown.graph.regions.iter().enumerate() {
        // A cluster is drawn where there is something to tell apart.
        let cluster = shown.graph.regions.len() > 1 || r.sampling.is_some();
        let indent = if cluster { "    " } else { "  " };
        if cluster {
            let label = format!("{}\\n{}", r.name.replace('"', "\\\""), region::kind(shown, r));
            let _ = writeln!(
                text,
                "  subgraph cluster_{i} {{\n    label=\"{label}\"; fontname=\"Helvetica\"; fontsize=10;"
            );
            let style = match r.sampling {
                Some(_) => "style=\"rounded,filled\"; fillcolor=\"#e8eef7\"; color=\"#8aa4c8\";",
                None => "style=\"rounded,dashed\"; color=\"#bbbbbb\";",
            };
            let _ = writeln!(text, "    {style}");
        }
        for &id in r.elements.iter().filter(|id| nodes.first[nodes.of[id.at()]] == **id) {
            let _ = writeln!(text, "{indent}{}", label(shown, id));
        }
        if cluster {
            text.push_str("  }\n");
        }
    }
    for (i, b) in model.bonds.iter().enumerate().filter(|(_, b)| !node::hidden(model, b)) {
        let stroke = if what == What::Graph { b.stroke } else { shown.causality.strokes.get(i).copied() };
        let (mut head, mut tail) = ("lnormal", "none");
        match stroke {
            Some(Stroke::Head) => head = "teelnormal",
            Some(Stroke::Tail) => tail = "tee",
            None => {}
        }
        let mut more = String::new();
        if b.sampled {
            more.push_str(", penwidth=3, color=\"#31588c\"");
        }
        if let Some(n) = node::bond_name(model, b) {
            let _ = write!(more, ", label={}", quoted(n));
        }
        let _ = writeln!(
            text,
            "  n{} -> n{} [dir=both, arrowhead={head}, arrowtail={tail}{more}, tooltip={}];",
            nodes.first[nodes.of[b.tail.at()]].0,
            nodes.first[nodes.of[b.head.at()]].0,
            quoted(&name::bond(model, BondId(i as u32), stroke))
        );
    }
    text.push_str("}\n");
    text
}

fn label(shown: &Shown<'_>, id: ElementId) -> String {
    let e = shown.model.element(id);
    let more = match e.kind {
        Kind::Junction(_) => ", fontname=\"Helvetica-Bold\"",
        Kind::OnePort(OnePort::Source(_) | OnePort::Open | OnePort::Multiplier(_)) => ", fontcolor=\"#9a3412\"",
        Kind::OnePort(OnePort::Storage(_)) => ", fontcolor=\"#1d4ed8\"",
        Kind::OnePort(OnePort::Resistor) => ", fontcolor=\"#15803d\"",
        Kind::TwoPort(_) => ", fontcolor=\"#6b21a8\"",
        Kind::OnePort(OnePort::Detector(_)) => ", fontcolor=\"#57534e\"",
    };
    let text = match e.field {
        Some(_) => {
            let (kind, name) = node::title(shown.model, e);
            format!("{}{kind}:{name}", if e.active { "active " } else { "" })
        }
        None => name::element(e),
    };
    format!("n{} [label={}{more}];", id.0, quoted(&text))
}
