//! What the models of a file say of themselves: docs, ports, parameters, inputs, outputs, probes.

use bond_compiler::elaborate::{Files, Loader, elaborate, load};
use bond_compiler::model::{Kind, Model as Flat};
use bond_compiler::units::DisplayUnit;
use bond_grammar::ast::{self, Chain, Definition, End, Expr, ExprKind, File, Item, Model, Statement, StatementKind};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::{SourceId, Sources};
use serde::Serialize;

/// A file of models: one of the bundled library, or a user's.
#[derive(Serialize)]
pub struct Document {
    /// `std.electrical`, or the path of the file.
    pub name: String,
    /// Its doc, a line each.
    pub doc: Vec<String>,
    /// Its models in order.
    pub components: Vec<Component>,
}

/// A model, as one who uses it wants to know it.
#[derive(Serialize)]
pub struct Component {
    /// Its name.
    pub name: String,
    /// Its doc, a line each.
    pub doc: Vec<String>,
    /// Its ports in order.
    pub ports: Vec<Port>,
    /// Its parameters in order.
    pub parameters: Vec<Parameter>,
    /// The signals that it is given, in order. The field is not written where there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub inputs: Vec<Parameter>,
    /// The signals that others read of it, in order. The field is not written where there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub outputs: Vec<Probe>,
    /// What it gives to read.
    pub probes: Vec<Probe>,
}

/// A port.
#[derive(Serialize)]
pub struct Port {
    /// Its name.
    pub name: String,
    /// Its doc, a line each.
    pub doc: Vec<String>,
    /// Which way the half arrow runs.
    pub arrow: Option<Arrow>,
    /// Unit of its effort, where the model by itself fixes it.
    pub effort: Option<String>,
    /// Unit of its flow, where the model by itself fixes it.
    pub flow: Option<String>,
}

/// Which way the half arrow of a port runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Arrow {
    /// `x -> part.port`
    In,
    /// `part.port -> x`
    Out,
}

/// A parameter, or an input.
#[derive(Serialize)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// Its doc, a line each.
    pub doc: Vec<String>,
    /// Its default as written; `None` if it must be given.
    pub default: Option<String>,
    /// Its unit, if known.
    pub unit: Option<String>,
    /// The default in SI.
    pub value: Option<f64>,
}

/// A named output.
#[derive(Serialize)]
pub struct Probe {
    /// Its name.
    pub name: String,
    /// Its doc, a line each.
    pub doc: Vec<String>,
    /// Its unit, if known.
    pub unit: Option<String>,
}

/// Reads a source that is shown as `name`. Models that do not elaborate by themselves are described without units.
///
/// # Errors
/// A text that cannot be read, or uses what is not there.
pub fn document(
    name: &str,
    sources: &mut Sources,
    id: SourceId,
    loader: &mut dyn Loader,
) -> Result<Document, Vec<Diagnostic>> {
    let mut errors = Vec::new();
    let files = load(sources, id, loader, &mut errors);
    if !errors.is_empty() {
        return Err(errors);
    }
    let Some(file) = files.list.first() else { return Err(errors) };
    let components = models(file).map(|m| component(sources, id, &files, m)).collect();
    Ok(Document { name: name.to_string(), doc: file.docs.clone(), components })
}

fn models(file: &File) -> impl Iterator<Item = &Model> {
    file.items.iter().filter_map(|item| match item {
        Item::Model(m) => Some(m),
        Item::Use(_) | Item::Function(_) => None,
    })
}

fn component(sources: &Sources, id: SourceId, files: &Files, model: &Model) -> Component {
    // A parameter that must be given is 1 here, so that the rest has its units.
    let set = model.params.iter().filter(|p| p.default.is_none()).map(|p| (p.name.text.clone(), 1.0, None)).collect();
    let options =
        bond_compiler::Options { model: Some(model.name.text.clone()), set, ..bond_compiler::Options::default() };
    let flat = elaborate(sources, id, files, &options, Vec::new()).ok();
    let flat = flat.as_ref();
    let mut found = Component {
        name: model.name.text.clone(),
        doc: model.docs.clone(),
        ports: Vec::new(),
        parameters: Vec::new(),
        inputs: Vec::new(),
        outputs: Vec::new(),
        probes: Vec::new(),
    };
    for p in &model.params {
        let known = flat.and_then(|f| f.parameters.iter().find(|q| q.name == p.name.text));
        found.parameters.push(Parameter {
            name: p.name.text.clone(),
            doc: p.docs.clone(),
            default: p.default.as_ref().map(|e| sources.slice(e.span).to_string()),
            unit: known
                .and_then(|q| q.unit.as_ref())
                .map(ToString::to_string)
                .or_else(|| written(sources, p.default.as_ref()?)),
            value: known.filter(|_| p.default.is_some()).map(|q| q.value),
        });
    }
    ast::each_statement(&model.body, &mut |s| match &s.kind {
        StatementKind::Port(name, index, _) => {
            // Of a bundle, all entries are alike in most cases: the first stands for them.
            let entry = |e: &&bond_compiler::model::Element| {
                !index.is_empty() && e.name.strip_prefix(&name.text).is_some_and(|rest| rest.starts_with('['))
            };
            let first = flat.and_then(|f| f.elements.iter().find(entry)).map_or(&name.text, |e| &e.name);
            let (effort, flow) = units(flat, first);
            let arrow = arrow(&model.body, &name.text);
            let index: Vec<&str> = index.iter().map(|e| sources.slice(e.span)).collect();
            let index = if index.is_empty() { String::new() } else { format!("[{}]", index.join(", ")) };
            found.ports.push(Port { name: format!("{}{index}", name.text), doc: s.docs.clone(), arrow, effort, flow });
        }
        StatementKind::Probe(it) => found.probes.push(probe(flat, s, it)),
        StatementKind::Output(it) => found.outputs.push(probe(flat, s, it)),
        StatementKind::Input(it) => {
            let known = flat.and_then(|f| f.inputs.iter().find(|i| i.name == it.name.text));
            found.inputs.push(Parameter {
                name: it.name.text.clone(),
                doc: s.docs.clone(),
                default: Some(sources.slice(it.value.span).to_string()),
                unit: known
                    .and_then(|i| i.unit.as_ref())
                    .map(ToString::to_string)
                    .or_else(|| written(sources, &it.value)),
                value: known.map(|i| i.value),
            });
        }
        StatementKind::Element(_)
        | StatementKind::Chain(_)
        | StatementKind::Sampled(_)
        | StatementKind::For(_)
        | StatementKind::If(_)
        | StatementKind::Let(_)
        | StatementKind::Function(_)
        | StatementKind::State(..)
        | StatementKind::Simulate(_)
        | StatementKind::Expect(_) => {}
    });
    found
}

/// A probe or an output, whose statement has its doc.
fn probe(flat: Option<&Flat>, s: &Statement, it: &Definition) -> Probe {
    let unit = flat.and_then(|f| f.probes.iter().find(|p| p.name == it.name.text)?.unit.as_ref());
    Probe { name: it.name.text.clone(), doc: s.docs.clone(), unit: unit.map(|d| d.to_string()) }
}

/// The unit of a default that is a number, as written.
fn written(sources: &Sources, default: &Expr) -> Option<String> {
    match &default.kind {
        ExprKind::Number { unit: Some(unit), .. } => Some(sources.slice(unit.span).to_string()),
        ExprKind::Paren(inner) | ExprKind::Unary(_, inner) => written(sources, inner),
        ExprKind::Number { .. }
        | ExprKind::Bool(_)
        | ExprKind::Path(_)
        | ExprKind::Binary(..)
        | ExprKind::If(..)
        | ExprKind::Call(..)
        | ExprKind::List(_)
        | ExprKind::Range(..) => None,
    }
}

/// Units of effort and flow at a port of a model that was elaborated alone.
fn units(flat: Option<&Flat>, port: &str) -> (Option<String>, Option<String>) {
    let pair = flat.and_then(|f| {
        let (id, _) = f.ids().find(|(_, e)| e.kind == Kind::PORT && e.name == port)?;
        let at = f.bonds.iter().position(|b| b.tail == id || b.head == id)?;
        f.units.get(at).cloned()
    });
    let (effort, flow) = pair.unwrap_or((None, None));
    // Half a power of a unit: the model fixes their ratio alone, and is meant for pseudo bonds perhaps.
    let text = |d: Option<DisplayUnit>| d.map(|d| d.to_string()).filter(|unit| !unit.contains("^("));
    (text(effort), text(flow))
}

/// Which way the half arrow of a port runs, as its bond inside says.
fn arrow(body: &[Statement], port: &str) -> Option<Arrow> {
    let mut found = None;
    ast::each_statement(body, &mut |s| {
        if let StatementKind::Chain(chain) = &s.kind
            && found.is_none()
        {
            found = place(chain, port);
        }
    });
    found
}

/// A port at the start of a chain takes power from outside, one at the end gives it.
fn place(chain: &Chain, port: &str) -> Option<Arrow> {
    let names = |end: &End| match end {
        End::Path(path) => path.segments.len() == 1 && path.segments[0].name.text == port,
        End::Declare(_) => false,
    };
    let at = chain.groups.iter().position(|group| group.iter().any(names))?;
    Some(if at == 0 { Arrow::In } else { Arrow::Out })
}
