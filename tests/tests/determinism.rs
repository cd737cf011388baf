//! The same text gives the same bytes: what is shown, and what is computed.

use crate::common::{all_scenes, file, start, stop};
use bond::{Compiled, Options, Steps};
use bond_compiler::show::{As, What};

/// All that can be shown.
fn shown(compiled: &Compiled) -> String {
    let mut all = String::new();
    for what in What::ALL {
        for format in As::ALL {
            match compiled.show_as(what.name(), format.name()) {
                Ok(text) => all.push_str(&text),
                Err(why) => all.push_str(&why),
            }
            all.push('\n');
        }
    }
    all
}

/// A tenth of the run as rows of bits, and the ledger at its end.
fn rows(compiled: &Compiled) -> String {
    let mut sim = start(compiled, Steps::new());
    let mut all = String::new();
    for k in 0..=100 {
        let t = f64::from(k) * stop(compiled) / 1000.0;
        if let Err(e) = sim.advance(t) {
            return format!("{all}{e}");
        }
        let row: Vec<String> =
            sim.probes().map(|p| p.iter().map(|x| x.to_bits().to_string()).collect()).unwrap_or_default();
        all.push_str(&row.join(","));
        all.push('\n');
    }
    format!("{all}{:?}", sim.summary())
}

#[test]
fn two_compilations_and_runs_are_alike() {
    for (title, path, scene) in all_scenes() {
        let first = file(&path, Options::new().model(&scene));
        let second = file(&path, Options::new().model(&scene));
        assert!(shown(&first) == shown(&second), "{title}: two compilations show different things");
        // Showing changes nothing.
        let run = rows(&first);
        assert!(run == rows(&second), "{title}: two runs differ");
        assert!(run == rows(&first), "{title}: a second run of one compilation differs");
    }
}
