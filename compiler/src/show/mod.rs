//! The printed forms of a compiled model: text, JSON, Graphviz, SVG, LaTeX.
//!
//! Everything here reads the stages before it and changes nothing but the pool, in which it makes the expressions that
//! it prints. The same model gives the same bytes on every run.

mod causality;
mod equation;
mod fact;
mod graph;
mod holonomic;
mod json;
mod json_form;
mod latex;
mod matrix;
mod modulation;
mod name;
mod node;
mod object;
mod phs;
mod picture;
mod region;
mod signal;
mod size;
mod sparse;
mod summary;
mod table;
#[cfg(test)]
mod tests;

pub use picture::text_width;

use crate::causality::Causality;
use crate::graph::BondGraph;
use crate::model::Model;
use crate::slice::Unneeded;
use crate::structure::Form;
use bond_runtime::ir::Program;

/// What is to be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum What {
    /// A readable summary of all.
    All,
    /// Elements, bonds, parameters.
    Graph,
    /// The causal strokes, and why each stands where it does.
    Causality,
    /// The port-Hamiltonian form of each region.
    Phs,
    /// The regions and the double bars between them.
    Regions,
    /// The step programs.
    Program,
}

impl What {
    /// All of them.
    pub const ALL: [What; 6] = [What::All, What::Graph, What::Causality, What::Phs, What::Regions, What::Program];

    /// As it is written on the command line.
    pub fn name(self) -> &'static str {
        match self {
            What::All => "all",
            What::Graph => "graph",
            What::Causality => "causality",
            What::Phs => "phs",
            What::Regions => "regions",
            What::Program => "program",
        }
    }
}

/// A format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum As {
    /// For people, in a terminal.
    Text,
    /// For programs.
    Json,
    /// For Graphviz.
    Dot,
    /// A picture.
    Svg,
    /// Formulas and pictures for LaTeX.
    Latex,
}

impl As {
    /// All of them.
    pub const ALL: [As; 5] = [As::Text, As::Json, As::Dot, As::Svg, As::Latex];

    /// As it is written on the command line.
    pub fn name(self) -> &'static str {
        match self {
            As::Text => "text",
            As::Json => "json",
            As::Dot => "dot",
            As::Svg => "svg",
            As::Latex => "latex",
        }
    }
}

/// What is written at the bonds of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Labels {
    /// The names that the model gives them.
    #[default]
    None,
    /// Their numbers, in the order of the model.
    Numbers,
    /// Their efforts and flows.
    Variables,
}

impl Labels {
    /// All of them.
    pub const ALL: [Labels; 3] = [Labels::None, Labels::Numbers, Labels::Variables];

    /// As it is written on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Labels::None => "none",
            Labels::Numbers => "numbers",
            Labels::Variables => "variables",
        }
    }
}

/// How a picture is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Picture {
    /// What is written at the bonds.
    pub labels: Labels,
    /// How many parts within parts are looked into; deeper ones are boxes.
    pub depth: usize,
}

impl Default for Picture {
    fn default() -> Self {
        Self { labels: Labels::None, depth: usize::MAX }
    }
}

/// Everything that can be shown of a compiled model.
pub struct Shown<'a> {
    /// The flat model; its pool takes the expressions that are made for printing.
    pub model: &'a mut Model,
    /// Its graph.
    pub graph: &'a BondGraph,
    /// Its strokes.
    pub causality: &'a Causality,
    /// Its port-Hamiltonian form.
    pub form: &'a Form,
    /// What of it is left out of what runs.
    pub unneeded: Option<&'a Unneeded>,
    /// The step programs.
    pub programs: &'a [Program],
    /// How pictures are drawn.
    pub picture: Picture,
}

/// Shows a part of a compiled model in a format.
///
/// `dot` and `svg` draw `graph` (without strokes), `causality` and `regions`, and take `all` for `causality`; `latex`
/// draws them too (with the package `tikz`), sets `phs`, and takes `all` for it.
///
/// # Errors
/// A combination that makes no sense, or a picture that would be too large, in words.
pub fn show(mut shown: Shown<'_>, what: What, format: As) -> Result<String, String> {
    let refuse = |what: &str| Err(format!("`{}` shows only {what}", format.name()));
    match (format, what) {
        (As::Text, What::All) => Ok(summary::text(&mut shown)),
        (As::Text, What::Graph) => Ok(graph::text(&shown)),
        (As::Text, What::Causality) => Ok(causality::text(&shown)),
        (As::Text, What::Phs) => Ok(phs::text(&mut shown)),
        (As::Text, What::Regions) => Ok(region::text(&shown)),
        (As::Text, What::Program) => Ok(programs(shown.programs)),
        (As::Json, _) => Ok(json::text(&mut shown, what)),
        (As::Dot, What::All | What::Graph | What::Causality | What::Regions) => Ok(picture::dot(&shown, what)),
        (As::Svg, What::All | What::Graph | What::Causality | What::Regions) => picture::svg(&shown, what),
        (As::Dot | As::Svg, What::Phs | What::Program) => refuse("`graph`, `causality` and `regions`"),
        (As::Latex, What::All | What::Phs) => Ok(latex::text(&mut shown)),
        (As::Latex, What::Graph | What::Causality | What::Regions) => picture::tikz(&shown, what),
        (As::Latex, What::Program) => refuse("`phs`, `graph`, `causality` and `regions`"),
    }
}

fn programs(all: &[Program]) -> String {
    if all.is_empty() {
        return "no programs\n".into();
    }
    all.iter().map(Program::to_string).collect::<Vec<_>>().join("\n")
}
