//! A functional mock-up unit: the scene in C, around it the functions of FMI 2.0 for co-simulation, and the description
//! by which other tools know what it has.
//!
//! Source: Functional Mock-up Interface for Model Exchange and Co-Simulation, version 2.0.

mod description;

use super::c;
use super::code::{Reason, Routine};
use super::emitter::{Archive, Emitted, Emitter, Request};
use super::standalone::StandaloneModule;
use bond_runtime::envelope::digest;
use bond_runtime::scene::Scene;
use std::fmt::Write;

/// Functional mock-up units.
pub const EMITTER: Emitter = Emitter {
    name: "fmu",
    about: "A functional mock-up unit for co-simulation (FMI 2.0)",
    extension: "fmu",
    has_header: false,
    emit,
};

fn emit(r: &Request<'_>) -> Result<Emitted, String> {
    let fmu = Fmu::new(r.scene, r.unit, r.name, r.stop);
    let options = c::Options { prefix: "bond".into(), header: "scene.h".into(), single: true, begin: true };
    let (scene, header) = (c::source(r.unit, &options), c::header(r.unit, &options));
    let of =
        |first: &str| digest([first, &scene, &fmu.source("", "scene.h"), &fmu.description("")].concat().as_bytes());
    let guid = format!("{{{:016x}{:016x}}}", of("a"), of("b"));
    let slave = fmu.source(&guid, "scene.h");
    Ok(Emitted::Archive(Archive {
        about: "FMI 2.0 for co-simulation",
        files: vec![("modelDescription.xml", fmu.description(&guid))],
        sources: vec![("scene.c", scene), ("scene.h", header), ("slave.c", slave)],
        library: fmu.identifier,
    }))
}

/// The functions, the same for all units.
const SLAVE: &str = include_str!("slave.c");

/// Numbers of a ledger that are variables, in the order of `slave.c`: name, unit, what it is.
const BOOKED: [(&str, &str, &str); 6] = [
    ("supplied", "J", "energy in by sources and ports"),
    ("dissipated", "J", "energy lost in resistors"),
    ("leaked", "J", "energy that holding over an interval added"),
    ("residual", "J", "what the balance was off by in all"),
    ("worst", "1", "the worst balance of a step, of the energy in it"),
    ("debt_max", "J", "the most that a sampled region gave beyond what it had"),
];

/// What a variable is to the outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Causality {
    Independent,
    Input,
    Output,
    Local,
}

/// A variable; its place in the list is its value reference.
#[derive(Clone, Debug)]
struct Variable {
    name: String,
    causality: Causality,
    /// As text; None where it is not determined.
    unit: Option<String>,
    /// In words.
    about: String,
    /// What an input is until it is set.
    start: Option<f64>,
}

/// A unit on its way.
#[derive(Clone, Debug)]
struct Fmu<'a> {
    unit: &'a StandaloneModule,
    /// A name in C.
    identifier: String,
    /// When a simulation would end, s.
    stop: Option<f64>,
    variables: Vec<Variable>,
}

impl<'a> Fmu<'a> {
    /// Of a scene and its unit. `name` gives the identifier that files of machine code have; `stop`, s, is when a
    /// simulation ends that says nothing else.
    fn new(scene: &Scene, unit: &'a StandaloneModule, name: &str, stop: Option<f64>) -> Self {
        Self { unit, identifier: identifier(name), stop, variables: description::variables(scene, unit) }
    }

    /// `modelDescription.xml`. `guid` is what tells this unit from others.
    fn description(&self, guid: &str) -> String {
        description::text(self, guid)
    }

    /// The C that joins the scene, whose header is `header`, with the interface. `guid` as above.
    fn source(&self, guid: &str, header: &str) -> String {
        let mut out = format!("/* A bond scene as a functional mock-up unit. */\n#include \"{header}\"\n\n");
        let has = |routine: &Option<Routine>| u8::from(routine.is_some());
        let (run, begin) = (has(&self.unit.run), has(&self.unit.begin));
        let _ = writeln!(out, "#define FMU_GUID \"{guid}\"\n#define FMU_RUN {run}\n#define FMU_BEGIN {begin}");
        let open = &self.unit.open;
        let held = open.iter().map(|o| u8::from(o.held).to_string());
        let held: Vec<String> = held.chain(open.is_empty().then(|| "0".into())).collect();
        let _ = writeln!(out, "/* Whether a sampled region holds a port; what inputs are until they are set. */");
        let _ = writeln!(out, "static const unsigned char is_held[] = {{ {} }};", held.join(", "));
        let start = self.variables.iter().filter_map(|v| v.start).map(|x| format!("{x:?}"));
        let start: Vec<String> = start.collect();
        let start = if start.is_empty() { "0".to_string() } else { start.join(", ") };
        let _ = writeln!(out, "static const double start_of[] = {{ {start} }};");
        let why: Vec<String> = Reason::ALL.iter().map(|(_, why)| format!("{why:?}")).collect();
        let _ =
            writeln!(out, "/* Why a commit failed. */\nstatic const char *const why[] = {{ {} }};\n", why.join(", "));
        out + SLAVE
    }
}

/// A name in C that is like this one.
fn identifier(name: &str) -> String {
    let letters = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' });
    let name: String = letters.collect();
    if name.starts_with(|c: char| c.is_ascii_alphabetic()) { name } else { format!("unit_{name}") }
}

#[cfg(test)]
mod tests {
    use super::identifier;

    #[test]
    fn identifiers_are_names_in_c() {
        assert_eq!(identifier("virtual wall-2"), "virtual_wall_2");
        assert_eq!(identifier("2nd"), "unit_2nd");
        assert_eq!(identifier(""), "unit_");
        assert_eq!(identifier("größe"), "gr__e");
    }
}
