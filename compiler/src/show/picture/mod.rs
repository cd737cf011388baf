//! Pictures of bond graphs, as on a whiteboard.
//!
//! `build` makes a diagram of the model. `grid` gives each node a cell, begun by `stress`. `spread`
//! makes pixels of cells, by the widths of texts in `font`. `scene` draws links, straight where the way is free, else
//! by `route`, and finds places for names. `svg`, `tikz` and `dot` write it down.

mod build;
mod control;
mod diagram;
mod dot;
mod font;
mod geometry;
mod grid;
mod route;
mod scene;
mod spread;
mod stress;
mod svg;
mod tikz;

use super::{Shown, What};
pub(super) use diagram::Diagram;
use scene::Scene;

/// Nodes of a picture that can be read.
const MAX_NODES: usize = 2000;

/// The width of a text in pixels in the font of the pictures, at a size of the font in pixels.
pub fn text_width(text: &str, size: f64) -> f64 {
    font::width(text, size)
}

/// The nodes, bonds and signals that are drawn; `graph` has no causal strokes but asserted ones.
pub(super) fn diagram(shown: &Shown<'_>, what: What) -> Diagram {
    build::diagram(shown, what)
}

/// The drawing for Graphviz.
pub(super) fn dot(shown: &Shown<'_>, what: What) -> String {
    dot::text(&diagram(shown, what))
}

/// The picture as SVG.
///
/// # Errors
/// More nodes than can be read.
pub(super) fn svg(shown: &Shown<'_>, what: What) -> Result<String, String> {
    let diagram = diagram(shown, what);
    scene(&diagram).map(|scene| svg::text(&diagram, &scene))
}

/// The picture for LaTeX.
///
/// # Errors
/// More nodes than can be read.
pub(super) fn tikz(shown: &Shown<'_>, what: What) -> Result<String, String> {
    scene(&diagram(shown, what)).map(|scene| tikz::text(&scene))
}

fn scene(diagram: &Diagram) -> Result<Scene, String> {
    let count = diagram.nodes.len();
    if count > MAX_NODES {
        return Err(format!(
            "a picture of {count} nodes is too large to be read (the most is {MAX_NODES}); `--depth 0` draws each part \
             as a box, and `dot` takes it"
        ));
    }
    Ok(scene::scene(diagram))
}
