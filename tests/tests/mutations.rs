//! Valid models with something knocked out or put in: whatever comes, nothing panics.

use crate::common::{RUN, cases, texts};
use bond::{Options, Steps};
use proptest::prelude::*;

/// Words and signs that mean something.
const PIECES: [&str; 45] = [
    "->",
    "||>",
    "{",
    "}",
    "(",
    ")",
    "=",
    "model M {",
    "port p",
    "for i in 1..3 {",
    "if 1 > 0 {",
    "1 N",
    "q",
    "e",
    ".",
    ",",
    ";",
    "I:",
    "C:x",
    "0",
    "1:",
    "-1",
    "^",
    "*",
    "/ 0",
    "sqrt(",
    "integral(",
    "t",
    "expect",
    "probe x =",
    "sampled at 10 Hz {",
    "[",
    "]",
    "->|",
    "\"",
    "//",
    "1e400",
    "TF:t = 0",
    "let f(x) =",
    "f(q)",
    "[1, 2]",
    "table(q, [0, 1, 2], [0, 1, 3])",
    "table2(q, t, [0, 1, 2], [0, 1], [[0, 1, 3], [0, 2, 4]])",
    "delay(v.f, 10 ms)",
    "a[2]",
];

#[derive(Clone, Debug)]
enum Change {
    Remove(usize, usize),
    Insert(usize, usize),
    Swap(usize, usize),
}

fn change() -> impl Strategy<Value = Change> {
    prop_oneof![
        (any::<usize>(), 1usize..12).prop_map(|(at, n)| Change::Remove(at, n)),
        (any::<usize>(), 0..PIECES.len()).prop_map(|(at, p)| Change::Insert(at, p)),
        (any::<usize>(), any::<usize>()).prop_map(|(a, b)| Change::Swap(a, b)),
    ]
}

/// Words, signs and blanks of a text.
fn tokens(text: &str) -> Vec<String> {
    let mut list: Vec<String> = Vec::new();
    let mut word = false;
    for c in text.chars() {
        let letter = c.is_alphanumeric() || c == '_';
        match list.last_mut() {
            Some(last) if letter && word => last.push(c),
            _ => list.push(c.to_string()),
        }
        word = letter;
    }
    list
}

fn changed(text: &str, changes: &[Change]) -> String {
    let mut list = tokens(text);
    for c in changes {
        let n = list.len().max(1);
        match *c {
            Change::Remove(at, count) => {
                let at = at % n;
                list.drain(at..(at + count).min(list.len()));
            }
            Change::Insert(at, p) => list.insert((at % n).min(list.len()), format!(" {} ", PIECES[p])),
            Change::Swap(a, b) if !list.is_empty() => list.swap(a % n, b % n),
            Change::Swap(..) => {}
        }
    }
    list.concat()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(400), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_panics(which in any::<prop::sample::Index>(), changes in prop::collection::vec(change(), 1..6)) {
        let all: Vec<_> = RUN.iter().flat_map(|folder| texts(folder)).collect();
        let (_, text) = &all[which.index(all.len())];
        let text = changed(text, &changes);
        match Options::new().compile_str("mutated.bond", text.as_str()) {
            Ok(compiled) => {
                for what in bond_compiler::show::What::ALL {
                    compiled.show(what.name());
                }
                if let Ok(mut sim) = compiled.simulate(Steps::fixed(1e-3)) {
                    let _ = sim.finish(5e-3);
                }
            }
            Err(errors) => {
                prop_assert!(!errors.list().is_empty());
                for d in errors.list() {
                    prop_assert!(!d.message.is_empty());
                    d.render(errors.sources());
                }
            }
        }
    }
}
