//! The fingerprint of an ensemble: its inputs as lines of text, so that a difference between two can be named.

use super::setup::Setup;
use super::{job::Job, plan::Plan};
use crate::hash::Hash;
use bond::internal::StepsInternals;
use bond_grammar::source::Sources;
use std::fmt::Write;

/// Lines `what: value`, in a fixed order.
#[derive(Clone, Debug, PartialEq)]
pub struct Fingerprint(String);

impl Fingerprint {
    /// That of an ensemble: all that has a say in its results.
    pub fn new(setup: &Setup, job: &Job, scene: &str) -> Self {
        let mut text = String::new();
        let seconds = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x} s"));
        let set: Vec<String> = setup.set.iter().map(|(path, (x, _))| format!("{path}={x}")).collect();
        let at: Vec<String> = job.at.iter().map(f64::to_string).collect();
        let mut given = Hash::new();
        // Hashing cannot fail.
        let _ = write!(given, "{:?}", job.given);
        let input = if job.given.is_empty() { String::new() } else { format!("{:016x}", given.value()) };
        line(&mut text, "the version of bond", env!("CARGO_PKG_VERSION"));
        line(&mut text, "the text of the model", &format!("{:016x}", sources(job.text.sources())));
        line(&mut text, "--model", scene);
        line(&mut text, "--method", setup.method.unwrap_or_default());
        for (what, value) in setup.steps.given() {
            line(&mut text, what, &value.map_or_else(String::new, |x| x.to_string()));
        }
        line(&mut text, "--stop", &seconds(job.stop));
        line(&mut text, "--every", &seconds(job.every));
        line(&mut text, "--at", &at.join(","));
        line(&mut text, "--set", &set.join(" "));
        line(&mut text, "--without", &setup.without.join(","));
        line(&mut text, "--input", &input);
        plan(&mut text, &job.plan);
        Self(text)
    }

    /// One that was read.
    pub fn read(text: String) -> Self {
        Self(text)
    }

    /// Its lines.
    pub fn text(&self) -> &str {
        &self.0
    }

    /// How this one differs from an older one, in words; empty if it does not.
    pub fn against(&self, older: &Self) -> String {
        let lines = |f: &Self| -> Vec<(String, String)> {
            f.0.lines().filter_map(|l| l.split_once(": ")).map(|(a, b)| (a.to_string(), b.to_string())).collect()
        };
        let (now, before) = (lines(self), lines(older));
        let or_none = |x: &str| if x.is_empty() { "not given".to_string() } else { format!("`{x}`") };
        let mut list = Vec::new();
        for (what, value) in &now {
            match before.iter().find(|(w, _)| w == what) {
                Some((_, old)) if old == value => {}
                Some(_) if what == "the text of the model" || what == "--input" => {
                    list.push(format!("{} is another one", what));
                }
                Some((_, old)) => list.push(format!("{what} was {} and is {}", or_none(old), or_none(value))),
                None => list.push(format!("{what} is {}", or_none(value))),
            }
        }
        if list.is_empty() && self != older {
            list.push("it was written by another version of bond".into());
        }
        list.join("; ")
    }
}

fn line(text: &mut String, what: &str, value: &str) {
    let value = value.replace(['\n', '\r'], " ");
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{what}: {value}");
}

fn plan(text: &mut String, plan: &Plan) {
    for (what, value) in plan.written() {
        line(text, what, &value);
    }
}

/// Of all texts, with their lengths between them.
fn sources(sources: &Sources) -> u64 {
    let mut hash = Hash::new();
    for source in sources.list() {
        hash.add(&(source.text.len() as u64).to_le_bytes());
        hash.add(source.text.as_bytes());
    }
    hash.value()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_named() {
        let of = |text: &str| Fingerprint::read(text.into());
        let now = of("the text of the model: 1\n--stop: 2 s\n--set: \n");
        assert_eq!(now.against(&now), "");
        let older = of("the text of the model: 2\n--stop: \n--set: k=1\n");
        assert_eq!(
            now.against(&older),
            "the text of the model is another one; --stop was not given and is `2 s`; --set was `k=1` and is not given"
        );
        assert!(now.against(&of("--stop: 2 s\n")).contains("--set is not given"));
        assert!(now.against(&of(&format!("{}more: 1\n", now.text()))).contains("another version"));
    }
}
