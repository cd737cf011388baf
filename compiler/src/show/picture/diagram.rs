//! What a picture is of: nodes, bonds and signals between them, and boxes round some of the nodes.

use super::geometry::Point;

/// How a node is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shape {
    /// An element: its kind and name.
    Element,
    /// A junction: `0` or `1`, and its name in small letters.
    Junction,
    /// An open port: its name in italics.
    Open,
    /// A part that is not looked into, or something that makes signals of signals: a box.
    Block,
    /// What comes from outside: a box with round ends.
    Input,
    /// Something short that a signal starts from, `t`.
    Tag,
}

/// A node.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    /// What it is called by links and tests; no two nodes share it.
    pub id: String,
    /// What is shown when the pointer rests on it.
    pub title: String,
    /// How it is drawn.
    pub shape: Shape,
    /// `TF`, `1`, the model of a part; empty where there is none.
    pub kind: String,
    /// Its name.
    pub name: String,
    /// Whether a storage in it is in derivative causality.
    pub derivative: bool,
    /// The innermost group that it stands in.
    pub group: Option<usize>,
}

/// The bonds of a link.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bonds {
    /// How many there are: more than one are drawn as a double line.
    pub size: usize,
    /// Of those that have a stroke, how many have it at the tail and how many at the head.
    pub strokes: [usize; 2],
    /// `||>`
    pub sampled: bool,
    /// Whether one of them leads to a storage in derivative causality.
    pub derivative: bool,
}

/// A line from one node to another.
#[derive(Clone, Debug)]
pub(crate) struct Link {
    /// What it is called by links and tests; no two links share it.
    pub id: String,
    /// What is shown when the pointer rests on it.
    pub title: String,
    /// The node where it starts.
    pub tail: usize,
    /// The node where it ends.
    pub head: usize,
    /// Its bonds; nothing of a signal.
    pub bonds: Option<Bonds>,
    /// What is written at its middle, on the side of the effort and on that of the flow.
    pub labels: [String; 2],
    /// The names of the ports at its ends.
    pub ports: [String; 2],
}

/// A box round nodes.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    /// What is written at it.
    pub name: String,
    /// The path of the part that it is; empty of a region.
    pub path: String,
    /// The one that it stands in.
    pub parent: Option<usize>,
    /// Whether it is a sampled region, which is shaded.
    pub sampled: bool,
}

/// A diagram.
#[derive(Clone, Debug, Default)]
pub(crate) struct Diagram {
    /// Its name.
    pub name: String,
    /// Its nodes.
    pub nodes: Vec<Node>,
    /// Its bonds and signals.
    pub links: Vec<Link>,
    /// Its boxes, each after the one that it stands in.
    pub groups: Vec<Group>,
}

/// The sizes of letters, in pixels.
pub(crate) const LETTERS: f64 = 14.0;
/// The same of names beside lines and under kinds.
pub(crate) const SMALL: f64 = 11.0;

impl Node {
    /// Its parts as they are written in a row: text, size, whether it is bold.
    pub(crate) fn runs(&self) -> Vec<(String, f64)> {
        match self.shape {
            Shape::Junction => vec![(self.kind.clone(), LETTERS), (format!(":{}", self.name), SMALL)],
            Shape::Open | Shape::Tag => vec![(self.name.clone(), LETTERS)],
            Shape::Element | Shape::Block | Shape::Input if self.kind.is_empty() => vec![(self.name.clone(), LETTERS)],
            Shape::Element | Shape::Block | Shape::Input => vec![(format!("{}:{}", self.kind, self.name), LETTERS)],
        }
    }

    /// What is written at it.
    pub(crate) fn label(&self) -> String {
        self.runs().into_iter().map(|(text, _)| text).collect()
    }

    /// Half its width and half its height.
    pub(crate) fn half(&self) -> Point {
        let width: f64 = self.runs().iter().map(|(text, size)| super::font::width(text, *size)).sum();
        match self.shape {
            Shape::Element | Shape::Junction | Shape::Open | Shape::Tag => [0.5 * width + 1.0, 8.5],
            Shape::Block | Shape::Input => [0.5 * width + 9.0, 14.0],
        }
    }
}
