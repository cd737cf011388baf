use super::{BLOWS_UP, Folder, OSCILLATOR, WRONG};
use bond::{Options, RunError, Steps, compile_file, compile_str};

#[test]
fn compile_show_and_step() {
    let here = Folder::new().with("a.bond", OSCILLATOR);
    let compiled = compile_file(here.0.join("a.bond")).unwrap();
    assert_eq!(compiled.probes(), ["x", "v"]);
    for what in ["all", "graph", "causality", "phs", "regions", "program"] {
        assert!(!compiled.show(what).is_empty());
    }
    assert!(compiled.show("nonsense").contains("phs"));
    assert!(compiled.show_as("graph", "svg").unwrap().contains("<svg"));
    let mut sim = compiled.simulate(Steps::new()).unwrap();
    assert_eq!(sim.probe("x"), Ok(0.1));
    sim.advance(0.25).unwrap();
    assert_eq!(sim.time(), 0.25);
    assert!(matches!(sim.probe("y"), Err(RunError::Unknown { .. })));
    assert!(matches!(sim.advance(f64::NAN), Err(RunError::Instant(_))));
    assert!(matches!(sim.finish(0.1), Err(RunError::Instant(_))));
    assert!(sim.report("hand", 1.0).is_err() && sim.held().is_empty());
    sim.finish(1.0).unwrap();
    let ledger = sim.summary();
    let region = &ledger.regions[0];
    assert!(ledger.passive && (region.h_initial - region.h_final - region.dissipated).abs() < 1e-13);
}

#[test]
fn options_are_read_when_compiling() {
    let last = |options: Options| {
        let compiled = options.compile_str("a.bond", OSCILLATOR).unwrap();
        let mut sim = compiled.simulate(Steps::tolerance(1e-9)).unwrap();
        sim.finish(0.3).unwrap();
        sim.probe("x").unwrap()
    };
    assert_eq!(last(Options::new().set("m", "4 kg")), last(Options::new().set("m", "4")));
    assert_ne!(last(Options::new().set("m", "4 kg")), last(Options::new()));
    assert!((last(Options::new().method("gonzalez")) - last(Options::new())).abs() < 1e-6);
    let wrong = |options: Options| options.compile_str("a.bond", OSCILLATOR).unwrap_err().to_string();
    assert!(wrong(Options::new().set("m", "heavy")).contains("`heavy` is no number"));
    assert!(wrong(Options::new().set("q", "1")).contains("there is no parameter"));
    assert!(wrong(Options::new().model("B")).contains("Oscillator"));
    assert!(wrong(Options::new().method("magic")).contains("magic"));
}

#[test]
fn errors_are_text_with_places() {
    let text = compile_str("dir/w.bond", WRONG).unwrap_err().to_string();
    assert!(text.contains("dir/w.bond:3:") && text.contains("dir/w.bond:4:"), "{text}");
    assert!(compile_file("/none/w.bond").unwrap_err().to_string().contains("cannot read"));
}

#[test]
fn failed_numerics_are_told() {
    let compiled = compile_str("b.bond", BLOWS_UP).unwrap();
    let mut sim = compiled.simulate(Steps::fixed(1e-3)).unwrap();
    assert!(matches!(sim.advance(2.0), Err(RunError::Numerics(_))));
    for steps in
        [Steps::fixed(0.0), Steps::fixed(f64::NAN), Steps::tolerance(-1.0), Steps::new().longest(f64::INFINITY)]
    {
        assert!(matches!(compiled.simulate(steps), Err(RunError::Value { .. })));
    }
}

#[test]
fn open_ports_hold_and_are_told_how_far_they_moved() {
    let text = "model Wall {
      sampled every 1 ms {
        port tip { inertia = 1 kg }
        C:spring = 0.001 m/N
        tip -> 1:v -> spring
      }
    }";
    let compiled = compile_str("w.bond", text).unwrap();
    let mut sim = compiled.simulate(Steps::new()).unwrap();
    for k in 1..=10 {
        sim.report("tip", 1e-4).unwrap();
        sim.advance(f64::from(k) * 1e-3).unwrap();
    }
    let (name, force) = sim.held()[0];
    assert_eq!(name, "tip");
    assert!((force.abs() - 1.0).abs() < 0.2, "{force}");
    assert!((sim.state("spring.q").unwrap().abs() - 1e-3).abs() < 1e-12);
    assert!(sim.summary().passive);
}
