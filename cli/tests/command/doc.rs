use super::{Folder, OSCILLATOR, WRONG};
use bond_compiler::elaborate::LIBRARY;
use serde_json::Value;

const PART: &str = "\
//! Parts of mine.

/// A pump. It pumps.
///
///     Pump:p(n = 2)
model Pump(n, D = 2*1e-6 m^3) {
  /// What turns it.
  port shaft
  port oil

  TF:pistons = D
  R:slip = 1e9 Pa*s/m^3

  shaft -> pistons -> 0:out -> slip
  out -> oil

  /// How fast it turns.
  probe speed = n*pistons.in.f
}
";

#[test]
fn all_libraries_are_listed() {
    let here = Folder::new();
    let done = here.bond(&["doc"]).is(0, &["std.electrical: ", "\n  Diode ", "std.contact", "\n  Wall "], &[]);
    for (name, text) in LIBRARY {
        assert!(done.out.contains(&format!("std.{name}: ")), "{name}");
        let models = text.lines().filter(|l| l.starts_with("model ")).count();
        let listed = done.out.split("std.").find(|part| part.starts_with(name)).unwrap_or_default();
        assert_eq!(listed.lines().filter(|l| l.starts_with("  ")).count(), models, "{name}");
    }
    assert_eq!(here.bond(&["doc", "std"]).is(0, &[], &[]).out, done.out);
    assert!(done.out.lines().all(|line| line.chars().count() <= 130), "{}", done.out);
}

#[test]
fn a_library_is_told_in_full() {
    let here = Folder::new();
    let done = here.bond(&["doc", "std.mechanics"]).is(0, &["std.mechanics.Mass\n", "std.mechanics.Lever\n"], &[]);
    assert_eq!(here.bond(&["doc", "mechanics"]).out, done.out);
}

#[test]
fn a_component_is_told_with_ports_and_parameters() {
    let here = Folder::new();
    let out = here
        .bond(&["doc", "std.electrical.Diode"])
        .is(0, &["std.electrical.Diode\n", "Shockley", "Diode:rectifier", "-> in", "V, A", "25.85 mV"], &[])
        .out;
    assert!(!out.contains("Zener"), "{out}");
    for short in ["electrical.Diode", "Diode"] {
        assert_eq!(here.bond(&["doc", short]).out, out, "{short}");
    }
    here.bond(&["doc", "std.mechanics.Ground"]).is(0, &["hold", "N, m/s"], &[]);
    here.bond(&["doc", "std.mechanics.ForceSource"]).is(0, &["out ->", "N, m/s", "1 N"], &[]);
    here.bond(&["doc", "Lever"]).is(0, &["as bonded"], &[]);
}

#[test]
fn a_file_is_told_too() {
    let here = Folder::new().with("a.bond", PART).with("b.bond", OSCILLATOR).with("w.bond", WRONG);
    let told =
        ["Parts of mine.", "A pump. It pumps.", "must be given", "What turns it.", "Pa, m^3/s", "out ->", "N*m, rad/s"];
    let text = here.bond(&["doc", "a.bond"]).is(0, &told, &[]).out;
    assert_eq!(here.fed(&["doc", "-"], PART).out.replace("<stdin>", "a.bond"), text);
    here.bond(&["doc", "./b.bond"]).is(0, &["Oscillator", "100 N/m", "probes"], &[]);
    // Wrong values are for `bond check`; the names are there all the same.
    here.bond(&["doc", "w.bond"]).is(0, &["Wrong"], &[]);
}

#[test]
fn other_programs_read_json() {
    let here = Folder::new().with("a.bond", PART);
    let json = |args: &[&str]| -> Value { serde_json::from_str(&here.bond(args).is(0, &[], &[]).out).unwrap() };
    let all = json(&["doc", "--as", "json"]);
    assert_eq!(all["libraries"].as_array().unwrap().len(), LIBRARY.len());
    // Of every port of the library the reader learns the units and the half arrow, of every parameter its value in SI.
    for part in all["libraries"].as_array().unwrap().iter().flat_map(|l| l["components"].as_array().unwrap()) {
        for port in part["ports"].as_array().unwrap() {
            let units = port["effort"].is_string() && port["flow"].is_string();
            assert!(units || !port["doc"].as_array().unwrap().is_empty(), "{}: {port}", part["name"]);
            assert!(port["arrow"].is_string(), "{}: {port}", part["name"]);
        }
        for parameter in part["parameters"].as_array().unwrap() {
            assert!(parameter["value"].is_number(), "{}: {parameter}", part["name"]);
        }
    }
    let mine = json(&["doc", "a.bond", "--as", "json"]);
    let part = &mine["libraries"][0]["components"][0];
    assert_eq!(part["name"], "Pump");
    assert_eq!(part["doc"][2], "    Pump:p(n = 2)");
    assert_eq!(part["ports"][0]["arrow"], "in");
    assert_eq!(
        part["ports"][1],
        serde_json::json!({"name": "oil", "doc": [], "arrow": "out", "effort": "Pa", "flow": "m^3/s"})
    );
    assert_eq!(
        part["parameters"][0],
        serde_json::json!({"name": "n", "doc": [], "default": null, "unit": null, "value": null})
    );
    assert_eq!(
        part["parameters"][1],
        serde_json::json!({"name": "D", "doc": [], "default": "2*1e-6 m^3", "unit": "m^3/rad", "value": 2e-6})
    );
    assert_eq!(part["probes"][0]["name"], "speed");
    let diode = json(&["doc", "std.electrical.Diode", "--as", "json"]);
    assert_eq!(diode["libraries"][0]["components"].as_array().unwrap().len(), 1);
    assert_eq!(diode["libraries"][0]["components"][0]["parameters"][2]["value"], 25.85e-3);
}

/// A page: what is indented is an example, a name with marks of Markdown is itself, and empty columns are left out.
#[test]
fn a_library_is_a_page() {
    let here = Folder::new();
    let has = [
        "# std.contact\n\nContact",
        "\n## Wall\n\n",
        "\n\n```bond\nWall:wall(k = 5 kN/m, gap = 1 cm)\n",
        "| `k` | 1000 N/m |\n",
    ];
    let page = here.bond(&["doc", "std.contact", "--as", "markdown"]).is(0, &has, &[]).out;
    assert!(page.contains("| port | half arrow | effort, flow |\n| --- | --- | --- |\n| `tip` | -> in | N, m/s |\n"));
    assert!(page.contains("mu |N|") && !page.contains("\n\n\n"), "{page}");
}

#[test]
fn what_is_not_there_is_told() {
    let here = Folder::new().with("a.bond", "use \"none.bond\"\nmodel A { }\n").with("b.bond", "model A {");
    here.bond(&["doc", "std.electrical.Diod"]).is(2, &[], &["did you mean `std.electrical.Diode`?"]);
    here.bond(&["doc", "Capacitator"]).is(2, &[], &["did you mean `std.electrical.Capacitor`?"]);
    here.bond(&["doc", "std.electric"]).is(2, &[], &["did you mean `std.electrical`?"]);
    here.bond(&["doc", "std.electric.Diode"]).is(2, &[], &["did you mean `std.electrical.Diode`?"]);
    here.bond(&["doc", "std.qqqqqqq"]).is(2, &[], &["`bond doc` lists"]);
    here.bond(&["doc", ""]).is(2, &[], &["`bond doc` lists"]);
    here.bond(&["doc", "none.bond"]).is(2, &[], &["cannot read none.bond"]);
    here.bond(&["doc", "a.bond"]).is(1, &[], &["none.bond"]);
    here.bond(&["doc", "b.bond"]).is(1, &[], &["b.bond:1:"]);
    here.bond(&["doc", "--as", "pdf"]).is(2, &[], &["json"]);
}

/// Parameters have docs as ports and probes have.
#[test]
fn parameters_have_docs() {
    let text = "model Spring(\n  /// How stiff it is.\n  k = 1 N/m,\n  n,\n) {\n  port p\n  C:c { stiffness = k*n }\n  p -> c\n}\n";
    let here = Folder::new().with("a.bond", text);
    here.bond(&["doc", "a.bond"]).is(0, &["k  1 N/m", "How stiff it is.\n", "n  must be given"], &[]);
    let json = here.bond(&["doc", "a.bond", "--as", "json"]).is(0, &[], &[]).out;
    let json: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["libraries"][0]["components"][0]["parameters"][0]["doc"], serde_json::json!(["How stiff it is."]));
}

/// What a part is given and gives stands apart from what its run shows.
#[test]
fn inputs_and_outputs_are_told() {
    let text =
        "model Gain(k = 2 N/m) {\n  /// What comes in.\n  input x = 0 m\n  output F = k*x\n  probe seen = x\n}\n";
    let here = Folder::new().with("a.bond", text);
    let told = ["\n  inputs\n    x  0 m    What comes in.\n", "\n  outputs\n    F  N\n", "\n  probes\n    seen  m\n"];
    here.bond(&["doc", "a.bond"]).is(0, &told, &[]);
    let json = here.bond(&["doc", "a.bond", "--as", "json"]).is(0, &[], &[]).out;
    let json: Value = serde_json::from_str(&json).unwrap();
    let part = &json["libraries"][0]["components"][0];
    assert_eq!((&part["inputs"][0]["unit"], &part["outputs"][0]["unit"]), (&"m".into(), &"N".into()));
    here.bond(&["doc", "PID"]).is(0, &["inputs\n    want", "outputs\n    u", "What it asks for."], &[]);
}

/// A bundle of ports is one line, with its range.
#[test]
fn a_bundle_of_ports_is_told_with_its_range() {
    let leg = "model Leg(n = 3) {\n  /// The foot.\n  port tip[1..n]\n  C:c[1..n] = 1 mm/N\n  tip -> c\n}\n";
    let here = Folder::new().with("leg.bond", leg);
    let done = here.bond(&["doc", "leg.bond"]).is(0, &["tip[1..n]", "-> in", "N, m/s", "The foot."], &[]);
    assert_eq!(done.out.matches("tip[").count(), 1, "{}", done.out);
    here.bond(&["fmt", "--check", "leg.bond"]).is(0, &[], &[]);
}
