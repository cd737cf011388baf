//! What a scene needs: what no probe, open port or expectation depends on does not run, and changes nothing.

use bond::internal::CompiledInternals;
use bond::{Compiled, Steps, compile_str};
use bond_runtime::scene::LeftOut;

/// Two circuits that nothing joins, a chain of signals from the first one to a third, and states that nobody reads.
fn model(outputs: &str) -> String {
    format!(
        "model Several {{\n  Se:a = 1 V; R:ra = 1 Ohm; C:ca = 2 F\n  a -> 1:one -> ra, ca\n  \
         Se:b = 2 V; R:rb {{ e = 3 V/A^3 * f^3 }}; I:lb = 1 H\n  b -> 1:two -> rb, lb\n  \
         state lag = 0 V {{ dlag = (ca.e - lag)/(1 s) }}\n  state more = 0 V*s {{ dmore = lag }}\n  \
         let gone = integral(lag, 0 V*s)\n  \
         MSe:c = lag + gone/(10 s); R:rc = 1 Ohm; C:cc = 1 F\n  c -> 1:three -> rc, cc\n{outputs}  \
         simulate {{ stop = 2 s; step = 10 ms }}\n}}\n"
    )
}

fn compiled(outputs: &str) -> Compiled {
    compile_str("several.bond", model(outputs)).unwrap()
}

fn left(outputs: &str) -> (Vec<String>, Vec<String>) {
    let LeftOut { regions, states } = compiled(outputs).scene().left_out.clone();
    (regions, states)
}

fn names(list: &[&str]) -> Vec<String> {
    list.iter().map(ToString::to_string).collect()
}

/// A signal is needed where what reads it is, an element where its region is.
#[test]
fn follows_what_is_read() {
    assert_eq!(left("  probe x = ca.e\n"), (names(&["two", "three"]), names(&["lag", "more"])));
    assert_eq!(left("  probe x = cc.e\n"), (names(&["two"]), names(&["more"])));
    assert_eq!(left("  probe x = lb.f\n"), (names(&["one", "three"]), names(&["lag", "more"])));
    assert_eq!(left("  probe x = more\n"), (names(&["two", "three"]), names(&[])));
    assert_eq!(left("  expect max(lag) < 1 V\n"), (names(&["two", "three"]), names(&["more"])));
    assert_eq!(left("  expect b.f < 3 A\n"), (names(&["one", "three"]), names(&["lag", "more"])));
    assert_eq!(left("  probe x = 2*t\n"), (names(&["one", "two", "three"]), names(&["lag", "more"])));
}

/// Nothing says what is needed where there is neither probe, port nor expectation; and what is expected of the ledger
/// is expected of every region.
#[test]
fn all_is_needed_where_nothing_says_what() {
    assert_eq!(left(""), (names(&[]), names(&[])));
    assert_eq!(left("  expect passive\n"), (names(&[]), names(&["more"])));
    assert_eq!(left("  probe x = ca.e\n  expect passive\n"), (names(&[]), names(&["more"])));
}

/// Both sides of a double bar are needed, and a region with an open port; states of one block each for itself.
#[test]
fn across_bars_and_ports() {
    let text = "model Held {\n  I:m = 1 kg; Se:push = 1 N\n  push -> 1:v -> m\n  \
        sampled at 100 Hz { 1:wall; C:k { stiffness = 10 N/m }; wall -> k }\n  v ||> wall\n  \
        sampled at 10 Hz { state seen = 0 m { next = k.q }; state other = 0 m { next = m.f*(1 s) } }\n  \
        port tip; R:rub = 1 N*s/m; 1:w; tip -> w -> rub\n  \
        Sf:alone = 1 m/s; R:r = 1 N*s/m; alone -> r\n  PROBE\n  simulate { stop = 1 s; step = 1 ms }\n}\n";
    let of = |probe: &str| compile_str("held.bond", text.replace("PROBE", probe)).unwrap().scene().left_out.clone();
    let out = |regions: &[&str], states: &[&str]| LeftOut { regions: names(regions), states: names(states) };
    assert_eq!(of("probe x = m.f"), out(&["alone"], &["seen", "other"]));
    assert_eq!(of("probe x = k.q"), out(&["alone"], &["seen", "other"]));
    assert_eq!(of("probe x = seen"), out(&["alone"], &["other"]));
    assert_eq!(of(""), out(&["v", "wall", "alone"], &["seen", "other"]));
    assert_eq!(of("probe x = r.e"), out(&["v", "wall"], &["seen", "other"]));
}

/// What runs is the model that never had the rest, to the last bit; what is shown has all of it, and says what does not
/// run.
#[test]
fn as_never_written() {
    let some = compiled("  probe x = ca.e\n");
    let text = "model Several {\n  Se:a = 1 V; R:ra = 1 Ohm; C:ca = 2 F\n  a -> 1:one -> ra, ca\n  \
        probe x = ca.e\n  simulate { stop = 2 s; step = 10 ms }\n}\n";
    let alone = compile_str("several.bond", text).unwrap();
    let end = |compiled: &Compiled| {
        let mut sim = compiled.simulate(Steps::new()).unwrap();
        sim.advance(2.0).unwrap();
        let summary = sim.summary();
        assert!(summary.passive && summary.regions.len() == 1);
        (sim.probe("x").unwrap().to_bits(), summary.regions[0].dissipated.to_bits())
    };
    assert_eq!(end(&some), end(&alone));
    assert_eq!(some.show("program"), alone.show("program"));
    assert_eq!(some.show("graph"), compiled("  probe x = ca.e\n  expect passive\n").show("graph"));
    let out = |text: &str| text.lines().filter(|l| l.contains("left out of runs")).count();
    assert_eq!((out(&some.show("all")), out(&some.show("regions"))), (4, 2));
    assert_eq!((out(&alone.show("all")), out(&alone.show("regions"))), (0, 0));
}

/// What is wrong with what does not run is said all the same.
#[test]
fn what_is_left_out_is_checked() {
    let wrong =
        model("  probe x = ca.e\n").replace("b -> 1:two -> rb, lb", "b -> 0:two; Se:d = 1 V; d -> two -> rb, lb");
    let errors = compile_str("several.bond", wrong).unwrap_err();
    assert!(errors.list().iter().any(|e| e.message.contains("`two`")), "{errors:?}");
}
