//! Any text as a table of input signals.
//!
//! What is wrong is named with a line of the text. What is read goes through its rows: where the text is plain, a
//! second reader that is written here finds the same rows. A scene that is fed by it takes a few steps.
#![no_main]

use bond::internal::CompiledInternals;
use bond::{Compiled, Given, InputSignal, Steps};
use bond_fuzz::{scenes, seeds};
use libfuzzer_sys::fuzz_target;
use std::sync::OnceLock;

/// The inputs that tables may have.
const KNOWN: [&str; 3] = ["push", "u", "w[1,2]"];
/// Instants closer to one another than this part of themselves are one to a signal; twice what the signal takes.
const SAME: f64 = 2e-12;
/// Sizes of instants and values for which products and quotients keep their digits.
const USUAL: std::ops::Range<f64> = 1e-90..1e90;
/// The part of the values at the ends that one between them may be off by.
const ROUNDING: f64 = 1e-9;

/// A plain table: the instants, and by column the values.
struct Plain {
    instants: Vec<f64>,
    columns: Vec<(String, Vec<f64>)>,
}

/// Reads a table without quotes; `None` where something is wrong.
fn plain(text: &str) -> Option<Plain> {
    let is_blank = |c: char| c.is_whitespace() || c == '\u{feff}';
    let mut rows = text.lines().map(|l| l.trim_matches(is_blank)).filter(|l| !l.is_empty() && !l.starts_with('#'));
    let names: Vec<&str> = rows.next()?.split(',').map(str::trim).collect();
    let time = names.iter().position(|n| *n == "t")?;
    let known = |n: &&str| *n == "t" || KNOWN.contains(n);
    if !names.iter().all(|n| known(n) && names.iter().filter(|m| *m == n).count() == 1) {
        return None;
    }
    let cells = |row: &str| row.split(',').map(|c| c.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    let rows: Vec<Vec<f64>> = rows.map(cells).collect::<Option<_>>()?;
    let column = |i: usize| rows.iter().map(|row| row[i]).collect::<Vec<f64>>();
    if rows.is_empty() || rows.iter().any(|row| row.len() != names.len()) {
        return None;
    }
    let instants = column(time);
    if instants.windows(2).any(|t| t[0] >= t[1]) {
        return None;
    }
    let columns = (0..names.len()).filter(|i| *i != time).map(|i| (names[i].to_string(), column(i))).collect();
    Some(Plain { instants, columns })
}

fn is_usual(x: f64) -> bool {
    x == 0.0 || USUAL.contains(&x.abs())
}

/// Fails where a signal is not what its rows say.
fn check(signal: &InputSignal, t: &[f64], x: &[f64], hold: bool) {
    let last = t.len() - 1;
    let apart = |i: usize| i == last || t[i + 1] - t[i] > SAME * t[i].abs().max(t[i + 1].abs());
    for i in (0..t.len()).filter(|i| apart(*i)) {
        assert_eq!(signal.value(t[i]), x[i], "at row {i}");
    }
    let before = t[0] - 1.0 - t[0].abs();
    assert_eq!(signal.value(before), x[0], "before the first row");
    if apart(last) {
        assert_eq!(signal.value(t[last] + 1.0 + t[last].abs()), x[last], "after the last row");
    }
    for i in (0..last).filter(|i| apart(*i)) {
        let middle = 0.5 * t[i] + 0.5 * t[i + 1];
        let wanted = if hold { x[i] } else { 0.5 * x[i] + 0.5 * x[i + 1] };
        let numbers = [t[i], t[i + 1], t[i + 1] - t[i], x[i], x[i + 1], x[i + 1] - x[i]];
        let off = (signal.value(middle) - wanted).abs();
        let most = ROUNDING * x[i].abs().max(x[i + 1].abs());
        let resolved = middle + SAME * middle.abs() < t[i + 1] && middle - t[i] > 1e3 * f64::EPSILON * middle.abs();
        let slack = SAME * middle.abs() / (t[i + 1] - t[i]) * (x[i + 1] - x[i]).abs();
        if resolved && numbers.into_iter().all(is_usual) {
            assert!(off <= most + slack, "after row {i}: {} where {wanted} is wanted", signal.value(middle));
        }
    }
}

/// Feeds a scene.
fn feed(given: Vec<(String, InputSignal)>) {
    static SCENE: OnceLock<Compiled> = OnceLock::new();
    let compiled = SCENE.get_or_init(|| scenes::compiled(scenes::FED));
    let known = |name: &String| compiled.scene().inputs.iter().any(|i| i.name == *name);
    let given: Vec<_> = given.into_iter().filter(|g| known(&g.0)).collect();
    if given.is_empty() {
        return;
    }
    let Ok(mut sim) = compiled.simulate_with(Steps::fixed(5e-3), given) else { return };
    for k in 1..=6 {
        if sim.advance(f64::from(k) * 0.013).is_err() {
            return;
        }
        let finite = sim.probes().is_ok_and(|row| row.iter().all(|x| x.is_finite()));
        assert!(finite, "a step is taken that leaves no numbers");
    }
}

/// Looks at what was read.
fn read(table: &Given, plain: Option<&Plain>) {
    for hold in [false, true] {
        let Ok(signals) = table.signals(hold) else {
            assert!(!hold, "what holds its values changes too fast");
            continue;
        };
        for (name, signal) in &signals {
            for t in [0.0, -1.0, 0.5, 1e300, -1e300, f64::MAX, f64::MIN_POSITIVE] {
                let _ = signal.value(t);
            }
            if let Some(plain) = plain {
                let column = plain.columns.iter().find(|c| c.0 == *name).unwrap_or_else(|| panic!("no `{name}`"));
                check(signal, &plain.instants, &column.1, hold);
            }
        }
        feed(signals);
    }
}

fuzz_target!(
    init: {
        let tables = [
            "t,push\n0,1\n0.02,3\n0.05,-1\n",
            "# weather\n u , t, \"w[1,2]\" \n\n1, 0 ,2\r\n\"-3e1\" ,0.5,4\n",
            "\u{feff}push,t\n1e3,-5\n2e-9,1e-3\n0,1e-3\n",
            "t,u\n0,1e308\n\n1,-1e308\n",
            "t;u\n0;1,5\n",
            "t,u,push\n0,1,2\n1e-300,2,3\n1,inf,nan\n",
            "t,\"u\n0,1\n",
        ];
        let list = tables.iter().enumerate().map(|(i, t)| (format!("table-{i}"), t.as_bytes().to_vec()));
        seeds::write("csv", list);
    },
    |data: &[u8]| {
        let Ok(text) = std::str::from_utf8(data) else { return };
        let plain = (!text.contains('"')).then(|| plain(text));
        match Given::read(text, &KNOWN) {
            Ok(table) => {
                assert!(!matches!(plain, Some(None)), "a table is read that is none");
                read(&table, plain.flatten().as_ref());
            }
            Err(e) => {
                assert!(!matches!(plain, Some(Some(_))), "a table is refused: {e}");
                let lines = text.lines().count().max(1);
                assert!((1..=lines).contains(&e.line) && !e.message.is_empty(), "{e}: there are {lines} lines");
            }
        }
    }
);
