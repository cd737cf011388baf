//! The bond graph of a flat model, and its regions.

use crate::model::{Bond, BondId, ElementId, Model};
use bond_grammar::diagnostic::Diagnostic;
use petgraph::Graph;
use petgraph::graph::NodeIndex;
use std::fmt;

/// A region of the graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct RegionId(pub u32);

impl RegionId {
    /// As an index.
    pub fn at(self) -> usize {
        self.0 as usize
    }
}

/// A piece that is connected by plain bonds.
#[derive(Clone, Debug)]
pub struct Region {
    /// The instance it is, or the name of its first junction or element.
    pub name: String,
    /// Its elements in order of declaration.
    pub elements: Vec<ElementId>,
    /// The `sampled` block it stands in.
    pub sampling: Option<usize>,
}

/// Elements as nodes, bonds as edges from tail to head. Built once; node and edge indices are those of the model.
#[derive(Clone, Debug)]
pub struct BondGraph {
    /// The graph.
    pub graph: Graph<ElementId, BondId>,
    /// The regions, in order of their first element.
    pub regions: Vec<Region>,
    /// The region of each element.
    pub region_of: Vec<RegionId>,
    /// The bonds of each element.
    pub bonds_of: Vec<Vec<BondId>>,
}

/// Builds the graph and cuts every `||>`.
pub fn build(model: &Model) -> BondGraph {
    let mut graph = Graph::with_capacity(model.elements.len(), model.bonds.len());
    for (id, _) in model.ids() {
        graph.add_node(id);
    }
    let mut pieces = petgraph::unionfind::UnionFind::<usize>::new(model.elements.len());
    for (i, bond) in model.bonds.iter().enumerate() {
        graph.add_edge(NodeIndex::new(bond.tail.at()), NodeIndex::new(bond.head.at()), BondId(i as u32));
        if !bond.sampled {
            pieces.union(bond.tail.at(), bond.head.at());
        }
    }
    // A field is in one place, though its ports may be of different domains.
    for pair in model.fields.iter().flat_map(|f| f.members.windows(2)) {
        pieces.union(pair[0].at(), pair[1].at());
    }
    let mut number = vec![None; model.elements.len()];
    let mut regions: Vec<Region> = Vec::new();
    let mut region_of = Vec::with_capacity(model.elements.len());
    for (id, element) in model.ids() {
        let root = pieces.find(id.at());
        let region = *number[root].get_or_insert_with(|| {
            regions.push(Region { name: String::new(), elements: Vec::new(), sampling: element.sampling });
            RegionId(regions.len() as u32 - 1)
        });
        regions[region.at()].elements.push(id);
        region_of.push(region);
    }
    for r in &mut regions {
        r.name = name(model, &r.elements);
    }
    BondGraph { graph, regions, region_of, bonds_of: model.bonds_of() }
}

/// The instance that all elements belong to, else the first junction, else the first element.
fn name(model: &Model, elements: &[ElementId]) -> String {
    let Some(first) = elements.first() else { return String::new() };
    let prefix = |id: &ElementId| model.element(*id).name.rsplit_once('.').map(|p| p.0).unwrap_or("");
    let common = prefix(first);
    if !common.is_empty() && elements.iter().all(|e| prefix(e) == common) {
        return common.to_string();
    }
    let junction = elements.iter().find(|e| model.element(**e).kind.is_junction());
    model.element(*junction.unwrap_or(first)).name.clone()
}

impl BondGraph {
    /// Double bars whose ends plain bonds join as well: there is nothing between them to hold.
    pub fn bars_within(&self, model: &Model) -> Vec<Diagnostic> {
        let inside = |b: &&Bond| b.sampled && self.region_of[b.tail.at()] == self.region_of[b.head.at()];
        let error = |b: &Bond| {
            let (tail, head) = (&model.element(b.tail).name, &model.element(b.head).name);
            Diagnostic::error(
                "structure::bar",
                b.span,
                format!("the double bar {} joins two ends of one region: plain bonds lead from `{tail}` to `{head}` too", b.name),
            )
            .label(model.element(b.tail).span, "is joined to it by plain bonds")
            .help("make it a plain bond, `->`; or make every bond between the two parts a double bar, so that they are two regions")
        };
        model.bonds.iter().filter(inside).map(error).collect()
    }

    /// Checks that every edge joins the elements that its bond names.
    ///
    /// # Errors
    /// The bond that does not.
    pub fn validate(&self, model: &Model) -> Result<(), BondId> {
        for edge in self.graph.edge_indices() {
            let bond = self.graph[edge];
            let ends = self.graph.edge_endpoints(edge).map(|(a, b)| (self.graph[a], self.graph[b]));
            if ends != Some((model.bond(bond).tail, model.bond(bond).head)) {
                return Err(bond);
            }
        }
        Ok(())
    }
}

impl fmt::Display for BondGraph {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, r) in self.regions.iter().enumerate() {
            writeln!(f, "region {i} {}: {} elements", r.name, r.elements.len())?;
        }
        Ok(())
    }
}
