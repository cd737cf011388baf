//! How sampled walls feel: what a hand meets there against what is written, and how stiff they may be.
//!
//! `cargo bench -p bond --bench fidelity` writes the tables and pictures of `docs/theory/fidelity.md` anew; the words
//! stay. With `-- --only NAME` one table alone, by the name in its mark, and its picture.

mod chart;
mod error;
mod felt;
mod limit;
#[path = "../hard/table.rs"]
mod table;
mod wall;

use bond::internal::PictureFormat;
use limit::Asked;
use std::path::{Path, PathBuf};
use wall::{FRICTION, MASS, PERIOD};

/// The tables with pictures, by name, and what is asked of the walls.
const LIMITS: [(&str, &str, Asked); 3] = [
    ("slow", "A hand leads the handle slowly: passive below the curves", Asked::Passive(limit::SLOWLY)),
    ("shaken", "A hand shakes the handle: passive below the curves", Asked::Passive(limit::SHAKEN)),
    ("free", "The handle is let go: it settles below the curves", Asked::Settles),
];

/// What is the same in all runs.
fn setup() -> String {
    let rows = vec![
        vec!["period".into(), "T".into(), table::time(PERIOD)],
        vec!["mass of the handle".into(), "m".into(), format!("{MASS} kg")],
        vec![
            "damping of the walls in the first two sections".into(),
            "b".into(),
            format!("{} sqrt(k m)", felt::DAMPING),
        ],
        vec!["the device's own friction in the third section".into(), "b".into(), format!("{FRICTION} N s/m")],
        vec!["push".into(), "F".into(), format!("{} N", felt::BASE)],
    ];
    table::table(&["what", "sign", "value"], &rows)
}

/// A file, written whole.
fn put(path: &Path, bytes: &[u8]) -> Result<(), String> {
    let beside = path.with_extension("part");
    std::fs::write(&beside, bytes).map_err(|e| format!("{}: {e}", beside.display()))?;
    std::fs::rename(&beside, path).map_err(|e| format!("{}: {e}", path.display()))
}

/// A table of limits; its picture goes into the folder.
fn limits(folder: &Path, name: &str, title: &str, asked: Asked) -> Result<String, String> {
    let curves = limit::curves(asked)?;
    let drawing = chart::chart(title, &curves, asked != Asked::Settles);
    put(&folder.join(name).with_extension("svg"), &drawing.bytes(PictureFormat::Svg)?)?;
    Ok(limit::limits(asked, &curves))
}

fn write(only: Option<&str>) -> Result<(), String> {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/theory");
    let (path, folder): (PathBuf, PathBuf) = (docs.join("fidelity.md"), docs.join("fidelity"));
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut page = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let wanted = |name: &str| only.is_none_or(|o| o == name);
    let mut section = |name: &str, text: &dyn Fn() -> Result<String, String>| {
        if wanted(name) {
            eprintln!("{name}");
            page = table::replaced(&page, &path, name, &text()?)?;
        }
        Ok::<(), String>(())
    };
    section("setup", &|| Ok(setup()))?;
    section("felt", &felt::slow)?;
    section("rest", &felt::constant)?;
    for (name, push) in error::PUSHES {
        section(name, &|| error::errors(push))?;
    }
    for (name, title, asked) in LIMITS {
        section(name, &|| limits(&folder, name, title, asked))?;
    }
    put(&path, page.as_bytes())
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let at = arguments.iter().position(|a| a == "--only");
    if let Err(e) = write(at.and_then(|i| arguments.get(i + 1)).map(String::as_str)) {
        eprintln!("{e}");
        std::process::exit(1);
    }
}
