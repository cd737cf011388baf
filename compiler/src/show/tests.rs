use super::{As, Shown, What, show};
use crate::{causality, elaborate, graph, structure};
use bond_grammar::source::Sources;

/// All that is asked for of one model.
fn shown(text: &str, wanted: &[(What, As)]) -> Vec<Result<String, String>> {
    let mut sources = Sources::new();
    let id = sources.add("model.bond", text);
    let mut errors = Vec::new();
    let files = elaborate::load(&mut sources, id, &mut elaborate::NoFiles, &mut errors);
    let tell = |e: Vec<bond_grammar::diagnostic::Diagnostic>| -> String {
        e.iter().map(|d| d.render(&sources)).collect::<Vec<_>>().join("\n")
    };
    let mut model = elaborate::elaborate(&sources, id, &files, &elaborate::Options::default(), errors)
        .map_err(tell)
        .unwrap_or_else(|e| panic!("{e}"));
    let graph = graph::build(&model);
    let causality = causality::assign(&mut model, &graph).map_err(tell).unwrap_or_else(|e| panic!("{e}"));
    let form = structure::build(&mut model, &graph, &causality).map_err(tell).unwrap_or_else(|e| panic!("{e}"));
    let mut list = Vec::new();
    for (what, format) in wanted {
        let shown = Shown { model: &mut model, graph: &graph, causality: &causality, form: &form, programs: &[] };
        list.push(show(shown, *what, *format));
    }
    list
}

/// Every combination, for looking at: `BOND_SHOW=model.bond BOND_SHOW_OUT=folder cargo test look`.
#[test]
fn look() {
    let (Ok(file), Ok(out)) = (std::env::var("BOND_SHOW"), std::env::var("BOND_SHOW_OUT")) else { return };
    let text = std::fs::read_to_string(&file).unwrap_or_default();
    let stem = std::path::Path::new(&file).file_stem().map(|s| s.to_string_lossy().to_string()).unwrap_or_default();
    let all: Vec<(What, As)> = What::ALL.iter().flat_map(|w| As::ALL.map(|a| (*w, a))).collect();
    for ((what, format), result) in all.iter().zip(shown(&text, &all)) {
        let name = format!("{out}/{stem}.{}.{}", what.name(), format.name());
        if let Ok(text) = result {
            std::fs::write(name, text).unwrap_or_default();
        }
    }
}
