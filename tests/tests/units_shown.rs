//! Units as they are shown: in what people say of a domain, everywhere, and so that they can be written in a model.

use super::common::{self, file};
use super::emitted::emit;
use bond::internal::CompiledInternals;
use bond::{Compiled, Options};
use bond_compiler::backend;
use bond_compiler::backend::emitter::{Emitted, Request};
use bond_compiler::expression::Node;
use bond_compiler::model::Signal;
use bond_compiler::units::{self, Dimension, DisplayUnit};
use bond_runtime::scene::Scene;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// All models that compile by themselves: title, path, model.
fn all() -> Vec<(String, PathBuf, String)> {
    let mut list = common::all_scenes();
    list.extend(common::scenes_of("hard"));
    list
}

/// The domain of a bond, by the dimensions of its pair.
fn domain(pair: &(Option<DisplayUnit>, Option<DisplayUnit>)) -> String {
    use Dimension as D;
    let (Some(effort), Some(flow)) = pair else { return "undetermined".into() };
    let pair = (effort.dimension, flow.dimension);
    let known = [
        ("translation", D::NEWTON, D::METRE.div(D::SECOND)),
        ("rotation", D::JOULE, D::HERTZ),
        ("electrical", D::VOLT, D::AMPERE),
        ("magnetic", D::AMPERE, D::VOLT),
        ("hydraulic", D::PASCAL, D::VOLUME.div(D::SECOND)),
        ("thermal", D::KELVIN, D::WATT.div(D::KELVIN)),
        ("thermal, pseudo", D::KELVIN, D::WATT),
    ];
    known.iter().find(|(_, e, f)| (*e, *f) == pair).map_or("other", |k| k.0).into()
}

/// A role in a domain, with each unit that is shown for it.
type Shown = BTreeMap<(String, &'static str), BTreeSet<String>>;

/// What the quantities of bonds are shown in, and the parameters of elements there.
fn collect(shown: &mut Shown, compiled: &Compiled) {
    let mut add = |pair: &(Option<DisplayUnit>, Option<DisplayUnit>), role, unit: Option<String>| {
        if let Some(unit) = unit {
            shown.entry((domain(pair), role)).or_default().insert(unit);
        }
    };
    for pair in &compiled.stages().model.units {
        let (effort, flow) = pair;
        add(pair, "effort", effort.as_ref().map(ToString::to_string));
        add(pair, "flow", flow.as_ref().map(ToString::to_string));
        if let (Some(e), Some(f)) = pair {
            add(pair, "displacement", Some(f.seconds().to_string()));
            add(pair, "momentum", Some(e.seconds().to_string()));
            add(pair, "power", Some(e.mul(f).to_string()));
            add(pair, "energy", Some(e.mul(f).seconds().to_string()));
            add(pair, "R", Some(e.div(f).to_string()));
            add(pair, "1/R", Some(f.div(e).to_string()));
            add(pair, "I", Some(e.seconds().div(f).to_string()));
            add(pair, "C", Some(f.seconds().div(e).to_string()));
            add(pair, "1/C", Some(e.div(&f.seconds()).to_string()));
        }
    }
}

/// All units in a value of JSON: of quantities, and the pairs of bonds.
fn of_json(value: &Value, list: &mut BTreeSet<String>) {
    match value {
        Value::Object(fields) => {
            let keys: &[&str] = if fields.contains_key("tail") { &["effort", "flow"] } else { &["unit"] };
            list.extend(keys.iter().filter_map(|key| Some(fields.get(*key)?.as_str()?.to_string())));
            fields.values().for_each(|value| of_json(value, list));
        }
        Value::Array(items) => items.iter().for_each(|v| of_json(v, list)),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {}
    }
}

/// All units in brackets at the ends of lines, as `show` prints them.
fn of_text(text: &str, list: &mut BTreeSet<String>) {
    let ends = text.lines().filter_map(|l| l.strip_suffix(']')?.rsplit_once(" [")).map(|(_, units)| units);
    list.extend(ends.flat_map(|units| units.split(", ")).filter(|u| *u != "?").map(str::to_string));
}

/// All units of a scene, which are those of a run: its summary, its plots, its columns.
fn of_scene(scene: &Scene, list: &mut BTreeSet<String>) {
    list.extend(scene.probes.units.iter().flatten().cloned());
    list.extend(scene.inputs.iter().filter_map(|i| i.unit.clone()));
    list.extend(scene.open.iter().flat_map(|o| [o.unit.clone(), o.moved.clone()]).flatten());
    list.extend(scene.waves.iter().filter_map(|w| w.unit.clone()));
}

/// An FMU's description of a scene.
fn description(compiled: &Compiled) -> Option<String> {
    let (unit, _) = emit(compiled, 1e-3).ok()?;
    let request = Request { scene: compiled.scene(), unit: &unit, name: "it", prefix: "", header: "", stop: Some(1.0) };
    match (backend::fmu::EMITTER.emit)(&request).ok()? {
        Emitted::Archive(archive) => Some(archive.files[0].1.clone()),
        Emitted::File(..) | Emitted::WithHeader(..) => None,
    }
}

/// All units of an FMU's description.
fn of_fmu(compiled: &Compiled, list: &mut BTreeSet<String>) {
    let text = description(compiled).unwrap_or_default();
    list.extend(text.split("<Real unit=\"").skip(1).filter_map(|t| t.split('"').next()).map(str::to_string));
}

/// What a domain's quantities are shown in, over all models: none in two ways, torques in N*m, angular speeds in rad/s.
#[test]
fn domains_have_their_units() {
    let mut shown = Shown::new();
    for (_, path, model) in all() {
        collect(&mut shown, &file(&path, Options::new().model(model)));
    }
    let of = |domain: &str, role: &'static str| {
        shown.get(&(domain.to_string(), role)).into_iter().flatten().map(String::as_str).collect::<Vec<_>>()
    };
    for (role, unit) in [
        ("effort", "N*m"),
        ("flow", "rad/s"),
        ("displacement", "rad"),
        ("momentum", "N*m*s"),
        ("power", "W"),
        ("energy", "J"),
        ("R", "N*m*s/rad"),
        ("I", "kg*m^2"),
        ("1/C", "N*m/rad"),
    ] {
        assert_eq!(of("rotation", role), [unit], "{role}");
    }
    let text: Vec<String> = shown
        .iter()
        .filter(|((domain, _), _)| domain != "other" && domain != "undetermined")
        .map(|((domain, role), units)| {
            assert_eq!(units.len(), 1, "{domain}, {role}: {units:?}");
            format!("{domain}, {role}: {}", units.iter().cloned().collect::<Vec<_>>().join(" or "))
        })
        .collect();
    insta::assert_snapshot!("domains", text.join("\n"));
}

/// All units that any model shows, each of which can be written in a model; and a probe that reads a bond alone has the
/// unit of its bond.
#[test]
fn shown_units_can_be_written() {
    let mut shown = BTreeSet::new();
    for (title, path, model) in all() {
        let compiled = file(&path, Options::new().model(model));
        let stages = compiled.stages();
        let json = compiled.show_as("all", "json").map(|t| serde_json::from_str(&t).expect("it is JSON"));
        of_json(&json.unwrap_or(Value::Null), &mut shown);
        of_text(&compiled.show("graph"), &mut shown);
        of_scene(compiled.scene(), &mut shown);
        if title.starts_with("elements/") {
            of_fmu(&compiled, &mut shown);
        }
        for probe in &stages.model.probes {
            let Node::Symbol(symbol) = *stages.model.pool.node(probe.value) else { continue };
            let (bond, flow) = match stages.model.signals.get(&symbol) {
                Some(Signal::Effort(bond)) => (bond, false),
                Some(Signal::Flow(bond)) => (bond, true),
                _ => continue,
            };
            let pair = &stages.model.units[bond.at()];
            let unit = if flow { &pair.1 } else { &pair.0 };
            let text = |u: &Option<DisplayUnit>| u.as_ref().map(ToString::to_string);
            assert_eq!(text(&probe.unit), text(unit), "{title}: {}", probe.name);
        }
    }
    for unit in shown.iter().filter(|u| !matches!(u.as_str(), "1" | "dimensionless")) {
        let read = units::read(unit).unwrap_or_else(|| panic!("`{unit}` cannot be written"));
        assert_eq!(read.factor, 1.0, "`{unit}` is not of SI");
    }
    insta::assert_snapshot!("units", shown.into_iter().collect::<Vec<_>>().join("\n"));
}

/// A motor and its controller: each number has the unit that people say, also where it was written as if a radian were
/// none.
#[test]
fn gains_and_constants() {
    let text = "model Drive(kt = 0.05 N*m/A, inertia = 100 g*cm^2, b = 1e-5 N*m*s, k = 4 N*m, r = 10 cm, f = 50 Hz, \
        kp = 2 V, kd = 0.1 V*s, n = 5, w = 2*pi*f, limit = 300 rpm) {
        Se:supply = kp*(shaft.q - 1 rad) - kd*load.f
        1:i; R:ra = 1 Ohm; I:la = 1 mH; GY:motor = kt
        1:load; I:rotor = inertia; R:drag = b; C:shaft { stiffness = k }; TF:drum = r; 1:belt; I:mass = n*2 kg
        supply -> i; i -> ra; i -> la; i -> motor -> load; load -> rotor; load -> drag; load -> shaft
        load -> drum -> belt -> mass
        probe torque = k*shaft.q
        probe share = 1/2*drag.e
        probe energy = 1/2*inertia*load.f^2
        probe power = drag.e*load.f
        probe speed = r*load.f
        probe ratio = load.f/w
        probe end = kt*24 V/(1 Ohm*2e-5 N*m*s + kt^2)
        probe over = load.f - limit
        probe turned = integral(load.f, 0)
        simulate { stop = 1 s; }
    }";
    let compiled = common::text(text);
    let model = &compiled.stages().model;
    let parameters = model.parameters.iter().map(|p| (&p.name, &p.unit));
    let list = parameters.chain(model.probes.iter().map(|p| (&p.name, &p.unit)));
    let list: Vec<(&str, String)> =
        list.map(|(name, u)| (name.as_str(), u.as_ref().map(ToString::to_string).unwrap_or_default())).collect();
    let list: Vec<(&str, &str)> = list.iter().map(|(name, u)| (*name, u.as_str())).collect();
    assert_eq!(
        list,
        [
            ("kt", "N*m/A"),
            ("inertia", "kg*m^2"),
            ("b", "N*m*s/rad"),
            ("k", "N*m/rad"),
            ("r", "m"),
            ("f", "Hz"),
            ("kp", "V/rad"),
            ("kd", "V/(rad/s)"),
            ("n", "1"),
            ("w", "s^-1"),
            ("limit", "rad/s"),
            ("torque", "N*m"),
            ("share", "N*m"),
            ("energy", "J"),
            ("power", "W"),
            ("speed", "m/s"),
            ("ratio", "1"),
            ("end", "rad/s"),
            ("over", "rad/s"),
            ("turned", "rad"),
        ]
    );
}

/// FMI asks for base units, the radian among them: it counts where it is written, and a bare number has no unit.
#[test]
fn an_fmu_has_radians() {
    let text = "model Wheel(k = 4 N*m/rad) {
        port hand { inertia = 1 kg*m^2 }
        1:w; I:wheel = 1 kg*m^2; C:spring { stiffness = k }
        hand -> w; w -> wheel; w -> spring
        probe angle = spring.q
        probe torque = spring.e
        probe share = spring.H/(1 J)
        simulate { stop = 1 s }
    }";
    let text = description(&common::text(text)).expect("it has one");
    for (unit, base) in [
        ("rad", "rad=\"1\""),
        ("rad/s", "s=\"-1\" rad=\"1\""),
        ("N*m", "kg=\"1\" m=\"2\" s=\"-2\""),
        ("J", "kg=\"1\" m=\"2\" s=\"-2\""),
    ] {
        let lines: Vec<&str> = text.lines().skip_while(|l| l.trim() != format!("<Unit name=\"{unit}\">")).collect();
        assert_eq!(lines.get(1).map(|l| l.trim()), Some(&*format!("<BaseUnit {base}/>")), "{unit}");
    }
    let of = |name: &str| text.lines().skip_while(|l| !l.contains(&format!("name=\"{name}\""))).nth(1).map(str::trim);
    assert_eq!(of("angle"), Some("<Real unit=\"rad\"/>"));
    assert_eq!(of("torque"), Some("<Real unit=\"N*m\"/>"));
    assert_eq!(of("share"), Some("<Real/>"));
    assert_eq!(of("hand.f").map(|l| l.contains("rad/s") || l.contains("N*m")), Some(true));
}
