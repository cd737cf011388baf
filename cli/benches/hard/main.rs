//! The hard cases of `models/hard/`: what they come to here, and what ordinary integrators come to on the same
//! equations.
//!
//! `cargo bench -p bond --bench hard` prints the tables; with `-- --page` it writes those of
//! `docs/inside/hard-cases.md` anew, of which the runs without loss, 1e7 steps each, only with `--long`;
//! printed, and without it, they take 1e5.
//! `--only NAME` does one table alone, `--stepper NAME` prints those of long runs by one stepper, `--case FILE` prints
//! the comparison of one file.

mod case;
mod compared;
mod drift;
mod explicit;
mod field;
mod hostile;
mod implicit;
mod ours;
mod rival;
mod table;

use std::path::Path;

/// A table by its mark, and whether it takes long; None for a mark that there is not.
fn section(name: &str, long: bool, stepper: Option<&str>) -> Option<Result<String, String>> {
    let (steps, slow) = if long { (10_000_000, 10_000_000) } else { (100_000, 10_000) };
    Some(match name {
        "machine" => Ok(machine()),
        "failures" => hostile::failures(),
        "oscillator" => Ok(format!("{steps} steps.\n\n{}", drift::oscillator(steps, stepper))),
        "pendulum" | "swing" | "alpha" | "beta" | "rigid" | "henon" => drift::chain(name, steps, slow, stepper),
        "stiffness" => Ok(drift::stiffness(10_000)),
        "sampled" => Ok(hostile::sampled()),
        "hostile" => hostile::parameters(),
        _ => return None,
    })
}

/// What is quick, and what takes long, in the order of the page; `here` and `others` come together.
const QUICK: [&str; 6] = ["here", "failures", "stiffness", "sampled", "hostile", "machine"];
const LONG: [&str; 7] = ["oscillator", "swing", "pendulum", "alpha", "beta", "rigid", "henon"];

/// Tables by their marks.
fn tables(page: bool, long: bool, only: Option<&str>, stepper: Option<&str>) -> Result<Vec<(String, String)>, String> {
    let runs = QUICK.iter().chain(LONG.iter().filter(|_| long || !page || only.is_some()));
    let mut list = Vec::new();
    for name in runs.filter(|n| only.is_none_or(|o| o == **n)) {
        match section(name, long, stepper) {
            Some(text) => list.push(((*name).to_string(), text?)),
            None => {
                let (here, others) = compared::tables(None)?;
                list.extend([("here".into(), here), ("others".into(), others)]);
            }
        }
    }
    if list.is_empty() {
        return Err(format!("there is no such table; there is {} and {}", QUICK.join(", "), LONG.join(", ")));
    }
    Ok(list)
}

/// What it was measured on.
fn machine() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find(|l| l.starts_with("model name")).and_then(|l| l.split_once(':'));
    let model = model.map_or("an unknown processor", |(_, m)| m.trim());
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load.split_whitespace().next().unwrap_or("unknown");
    format!("Measured on {model}, load average {load} at the end.\n")
}

fn write(long: bool, only: Option<&str>) -> Result<(), String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/inside/hard-cases.md");
    let mut page = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    for (name, text) in tables(true, long, only, None)? {
        page = table::replaced(&page, &path, &name, &text)?;
    }
    let beside = path.with_extension("md.part");
    std::fs::write(&beside, page).map_err(|e| format!("{}: {e}", beside.display()))?;
    std::fs::rename(&beside, &path).map_err(|e| format!("{}: {e}", path.display()))
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let has = |option: &str| arguments.iter().any(|a| a == option);
    let value = |option: &str| {
        let at = arguments.iter().position(|a| a == option)?;
        arguments.get(at + 1).map(String::as_str)
    };
    let done = if has("--page") {
        write(has("--long"), value("--only"))
    } else if let Some(file) = value("--case") {
        compared::tables(Some(file)).map(|(here, others)| println!("{here}\n{others}"))
    } else {
        tables(false, has("--long"), value("--only"), value("--stepper"))
            .map(|list| list.iter().for_each(|(name, text)| println!("## {name}\n\n{text}")))
    };
    if let Err(e) = done {
        eprintln!("{e}");
        std::process::exit(1);
    }
}
