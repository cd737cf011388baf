//! What other tools read of a unit: `modelDescription.xml`.

use super::{BOOKED, Causality, Fmu, Variable};
use crate::backend::standalone::StandaloneModule;
use crate::units::{self, Dimension, DisplayUnit};
use bond_runtime::scene::Scene;
use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesEnd, BytesStart, Event};
use std::collections::BTreeMap;
use std::io;

/// All variables, in the order of their value references, which `slave.c` knows too.
pub(super) fn variables(scene: &Scene, unit: &StandaloneModule) -> Vec<Variable> {
    let mut taken = Vec::new();
    let mut list = Vec::new();
    let mut add = |name: &str, causality, unit: Option<&str>, about: String, start| {
        let mut name: String = name.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        while taken.contains(&name) {
            name.push('_');
        }
        taken.push(name.clone());
        let unit = unit.filter(|u| *u != "1").map(str::to_string);
        list.push(Variable { name, causality, unit, about, start });
    };
    add("time", Causality::Independent, Some("s"), "time".into(), None);
    let end = |takes_flow| if takes_flow { ("f", "flow") } else { ("e", "effort") };
    let way = |held| if held { "their product is the power that the outside puts in" } else { "along the half arrow" };
    for (o, p) in scene.open.iter().zip(&unit.open) {
        let (letter, what) = end(o.takes_flow);
        let rate = o.moved.as_deref().map(rate);
        let about = format!("{what} that the outside gives at the port; {}", way(p.held));
        add(&format!("{}.{letter}", o.name), Causality::Input, rate.as_deref(), about, Some(0.0));
    }
    for i in &scene.inputs {
        add(&i.name, Causality::Input, i.unit.as_deref(), "signal given from outside".into(), Some(i.value));
    }
    for (o, p) in scene.open.iter().zip(&unit.open) {
        let (letter, what) = end(!o.takes_flow);
        let kind = if p.held { "held over the interval; " } else { "mean over the last interval, " };
        let about = format!("{what} that the scene gives at the port, {kind}{}", way(p.held));
        add(&format!("{}.{letter}", o.name), Causality::Output, o.unit.as_deref(), about, None);
    }
    for (name, unit) in scene.probes.names.iter().zip(&scene.probes.units) {
        add(name, Causality::Output, unit.as_deref(), "probe".into(), None);
    }
    add("ledger.energy", Causality::Local, Some("J"), "energy stored in all regions".into(), None);
    for r in &unit.regions {
        for (name, unit, about) in BOOKED {
            add(&format!("ledger.{}.{name}", r.name), Causality::Local, Some(unit), about.into(), None);
        }
    }
    list
}

/// The unit of what is moved, per second.
fn rate(moved: &str) -> String {
    match units::read(moved) {
        Some(u) => DisplayUnit::new(u.dimension, (u.reading.radians, 1)).div(&Dimension::SECOND.into()).to_string(),
        None => Dimension::HERTZ.to_string(),
    }
}

/// The text.
pub(super) fn text(fmu: &Fmu, guid: &str) -> String {
    let mut writer = Writer::new_with_indent(Vec::new(), b' ', 2);
    // Writing into memory does not fail.
    let _ = write(&mut writer, fmu, guid);
    String::from_utf8_lossy(&writer.into_inner()).into_owned() + "\n"
}

type Out = Writer<Vec<u8>>;

/// An element without content.
fn empty(w: &mut Out, name: &str, attributes: &[(&str, &str)]) -> io::Result<()> {
    w.write_event(Event::Empty(BytesStart::new(name).with_attributes(attributes.iter().copied())))
}

/// An element and what is in it.
fn element(
    w: &mut Out,
    name: &str,
    attributes: &[(&str, &str)],
    within: impl FnOnce(&mut Out) -> io::Result<()>,
) -> io::Result<()> {
    w.write_event(Event::Start(BytesStart::new(name).with_attributes(attributes.iter().copied())))?;
    within(w)?;
    w.write_event(Event::End(BytesEnd::new(name)))
}

fn write(w: &mut Out, fmu: &Fmu, guid: &str) -> io::Result<()> {
    w.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let tool = concat!("bond ", env!("CARGO_PKG_VERSION"));
    let convention = if fmu.variables.iter().all(|v| is_structured(&v.name)) { "structured" } else { "flat" };
    let attributes = [
        ("fmiVersion", "2.0"),
        ("modelName", &fmu.unit.name),
        ("guid", guid),
        ("generationTool", tool),
        ("variableNamingConvention", convention),
        ("numberOfEventIndicators", "0"),
    ];
    element(w, "fmiModelDescription", &attributes, |w| {
        let attributes = [
            ("modelIdentifier", fmu.identifier.as_str()),
            ("canHandleVariableCommunicationStepSize", "true"),
            ("canGetAndSetFMUstate", "true"),
            ("canSerializeFMUstate", "true"),
        ];
        element(w, "CoSimulation", &attributes, |w| {
            element(w, "SourceFiles", &[], |w| {
                empty(w, "File", &[("name", "scene.c")])?;
                empty(w, "File", &[("name", "slave.c")])
            })
        })?;
        units(w, fmu)?;
        element(w, "LogCategories", &[], |w| {
            empty(w, "Category", &[("name", "logStatusDiscard")])?;
            empty(w, "Category", &[("name", "logStatusError")])
        })?;
        let (stop, step) = (fmu.stop.map(number), number(fmu.unit.interval));
        let stop = stop.as_deref().map(|s| ("stopTime", s));
        let experiment: Vec<_> =
            [("startTime", "0")].into_iter().chain(stop).chain([("stepSize", step.as_str())]).collect();
        empty(w, "DefaultExperiment", &experiment)?;
        element(w, "ModelVariables", &[], |w| {
            fmu.variables.iter().enumerate().try_for_each(|(i, v)| variable(w, i, v))
        })?;
        element(w, "ModelStructure", &[], |w| {
            let outputs: Vec<String> = (fmu.variables.iter().enumerate())
                .filter(|(_, v)| v.causality == Causality::Output)
                .map(|(i, _)| (i + 1).to_string())
                .collect();
            if outputs.is_empty() {
                return Ok(());
            }
            for list in ["Outputs", "InitialUnknowns"] {
                element(w, list, &[], |w| {
                    outputs.iter().try_for_each(|i| empty(w, "Unknown", &[("index", i.as_str())]))
                })?;
            }
            Ok(())
        })
    })
}

/// The units of the variables, by base units.
fn units(w: &mut Out, fmu: &Fmu) -> io::Result<()> {
    let used = fmu.variables.iter().filter_map(|v| v.unit.as_deref());
    let used: BTreeMap<&str, Option<units::Read>> = used.map(|u| (u, units::read(u))).collect();
    if used.is_empty() {
        return Ok(());
    }
    element(w, "UnitDefinitions", &[], |w| {
        used.iter().try_for_each(|(name, read)| {
            let whole = read.as_ref().and_then(|u| Some((u.dimension.whole()?, u.radians)));
            let Some((whole, radians)) = whole else { return empty(w, "Unit", &[("name", name)]) };
            // A torque is in N*m, and counts no radians there: these are as they are written.
            let radians = i16::try_from(radians).unwrap_or(0);
            let powers: Vec<(&str, String)> = whole
                .into_iter()
                .chain([("rad", radians)])
                .filter(|(_, n)| *n != 0)
                .map(|(base, n)| (base, n.to_string()))
                .collect();
            let powers: Vec<(&str, &str)> = powers.iter().map(|(base, n)| (*base, n.as_str())).collect();
            element(w, "Unit", &[("name", name)], |w| empty(w, "BaseUnit", &powers))
        })
    })
}

/// A variable, whose place is its value reference.
fn variable(w: &mut Out, place: usize, v: &Variable) -> io::Result<()> {
    let reference = place.to_string();
    let (causality, variability) = match v.causality {
        Causality::Independent => ("independent", "continuous"),
        Causality::Input => ("input", "continuous"),
        Causality::Output => ("output", "continuous"),
        Causality::Local => ("local", "continuous"),
    };
    let attributes = [
        ("name", v.name.as_str()),
        ("valueReference", &reference),
        ("description", &v.about),
        ("causality", causality),
        ("variability", variability),
    ];
    element(w, "ScalarVariable", &attributes, |w| {
        let start = v.start.map(number);
        let start = start.as_deref().map(|s| ("start", s));
        let unit = v.unit.as_deref().map(|u| ("unit", u));
        let attributes: Vec<(&str, &str)> = unit.into_iter().chain(start).collect();
        empty(w, "Real", &attributes)
    })
}

/// A number as XML has it.
fn number(x: f64) -> String {
    format!("{x:?}")
}

/// Whether a name is one of the structured convention: identifiers with indices between dots.
fn is_structured(name: &str) -> bool {
    name.split('.').all(|part| {
        let (word, index) = part.split_once('[').map_or((part, None), |(w, i)| (w, Some(i)));
        let mut letters = word.chars();
        let first = letters.next().is_some_and(|c| c.is_ascii_alphabetic() || c == '_');
        let digits =
            |i: &str| !i.is_empty() && i.split(',').all(|n| !n.is_empty() && n.chars().all(|c| c.is_ascii_digit()));
        first
            && letters.all(|c| c.is_ascii_alphanumeric() || c == '_')
            && index.is_none_or(|i| i.strip_suffix(']').is_some_and(digits))
    })
}
