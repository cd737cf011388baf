//! The verdict: who may give energy, what was drawn at a place, and what a hold makes of the energy inside.

use crate::common::{advance, errors, finish, start, text};
use bond::internal::CompiledInternals;
use bond::{Compiled, Steps, Summary};
use bond_runtime::scene::{Scene, Steering};

/// A handle that is pushed for a second, and what a computer holds against it.
fn handle(sampled: &str, more: &str) -> String {
    format!(
        "model Steered(m = 1 kg, b = 3 N*s/m, K = 1000 N/m, T = 10 ms) {{
           I:handle {{ inertia = m }}
           R:own = b
           C:place {{ H = 0; q0 = 0.01 m }}
           Se:hand = if t < 1 s then 20*sin(t*(8 s^-1))*(1 N) else 0 N
           {sampled}
           1:v -> handle, own, place
           hand -> v
           {more}
           probe x = place.q
           expect passive at hand
           simulate {{ stop = 5 s }}
         }}"
    )
}

/// The wall as it is mostly written, and variants that hide what it reads.
const WALLS: [(&str, &str, &str); 7] = [
    ("plain", "sampled every T { Se:wall = -K*place.q }", "wall -[bar]||> v"),
    ("lagged", "sampled every T hold lagged { Se:wall = -K*place.q }", "wall -[bar]||> v"),
    ("let", "let pull = -K*place.q  sampled every T { Se:wall = pull }", "wall -[bar]||> v"),
    ("memory", "sampled every T { state z = 0 m { next = place.q }  Se:wall = -K*z }", "wall -[bar]||> v"),
    ("integral", "let far = integral(handle.f, 0.01 m)  sampled every T { Se:wall = -K*far }", "wall -[bar]||> v"),
    (
        "two",
        "sampled every T { Se:wall = -0.5*K*place.q  MSe:more = -0.5*K*place.q  1:w  wall, more -> w }",
        "w -[bar]||> v",
    ),
    ("damped", "sampled every T { Se:wall = -K*place.q  R:soft = 1 N*s/m  1:w -> soft  wall -> w }", "w -[bar]||> v"),
];

fn steered(scene: &Scene) -> Vec<(String, Steering)> {
    let of = scene.clusters.iter().flat_map(|c| &c.entries);
    of.flat_map(|e| e.steered.iter().map(|(i, s)| (e.supplied[*i].0.clone(), *s))).collect()
}

/// What the double bar let into the holder, at its least and at its most, and how it came out.
fn let_in(compiled: &Compiled, stop: f64) -> (f64, f64, Summary) {
    let mut sim = start(compiled, Steps::new());
    let (mut least, mut most) = (0.0f64, 0.0f64);
    let mut k = 0;
    while f64::from(k) * 0.01 < stop {
        k += 1;
        advance(&mut sim, f64::from(k) * 0.01);
        let crossed = sim.summary().bars[0].holder;
        (least, most) = (least.min(crossed), most.max(crossed));
    }
    (least, most, sim.summary())
}

/// Under the budget a steered source returns at most what was put in, wherever it hides what it reads.
#[test]
fn a_steered_wall_returns_what_it_was_given() {
    for (what, sampled, bar) in WALLS {
        let compiled = text(&handle(sampled, bar));
        let list = steered(compiled.scene());
        assert!(!list.is_empty() && list.iter().all(|s| s.1 == Steering::Drawing), "{what}: {list:?}");
        let (least, most, summary) = let_in(&compiled, 5.0);
        assert!(most > 0.05, "{what}: it was not pushed: {most}");
        assert!(least > -0.02 * most, "{what}: {least} of {most}");
        let listed: Vec<_> = summary.regions.iter().flat_map(|r| &r.steered).map(|s| s.name.clone()).collect();
        assert_eq!(listed, list.into_iter().map(|s| s.0).collect::<Vec<_>>(), "{what}");
        // Its share is that of the source, not of what crossed.
        let wall = summary.regions.iter().find(|r| !r.steered.is_empty()).unwrap();
        let shares: f64 = wall.sources.iter().map(|s| s.energy).sum();
        assert!((shares - wall.supplied).abs() <= 1e-12 * most, "{what}: {shares} of {}", wall.supplied);
    }
}

/// A wall that holds the speed: it gives nothing before it was given something.
#[test]
fn a_steered_speed_returns_what_it_was_given() {
    let compiled = text(
        "model M(T = 10 ms) {
           C:spring = 0.001 m/N
           R:leak = 0.5 N*s/m
           I:mass { inertia = 1 kg; f0 = 0.1 m/s }
           C:place { H = 0; q0 = 0.01 m }
           0:e -> spring, leak
           1:v -> mass, place, e
           sampled every T { Sf:wall = -(20 s^-1)*place.q }
           wall -[bar]||> e
           probe x = place.q
         }",
    );
    assert_eq!(steered(compiled.scene()), [("wall".to_string(), Steering::Drawing)]);
    let (least, most, summary) = let_in(&compiled, 5.0);
    let start: f64 = summary.regions.iter().map(|r| r.h_initial).sum();
    assert!(least >= -0.02 * most.max(1e-9 * start), "{least} of {most}");
}

/// What is not bounded is no claim: it is withdrawn by name, with what was given.
#[test]
fn what_is_not_bounded_is_named() {
    let walls = [
        ("budget off", "Se:wall", "steered `wall` under `budget off`", Steering::Unbounded),
        ("", "active Se:wall", "active `wall`", Steering::Active),
    ];
    for (budget, kind, why, steering) in walls {
        let sampled = format!("sampled every T {budget} {{ {kind} = -K*place.q }}");
        let compiled = text(&handle(&sampled, "wall -[bar]||> v").replace("20*sin", "0*sin"));
        assert_eq!(steered(compiled.scene()), [("wall".to_string(), steering)]);
        let (least, _, summary) = let_in(&compiled, 5.0);
        assert!(least < -100.0, "{why}: {least}");
        assert!(!summary.passive);
        let gave = summary.regions.iter().flat_map(|r| &r.steered).next().unwrap().energy;
        assert!((gave + summary.bars[0].holder).abs() < 1e-6 * gave, "{why}: {gave}");
        assert_eq!(summary.reasons, [format!("{why}, which gave {gave:.3e} J")]);
    }
}

/// Symbols are followed to their ends: what reads time, numbers and the outside alone is an own source.
#[test]
fn what_reads_the_scene_is_steered() {
    let rows = [
        ("-K*place.q", true),
        ("-K*x", true),
        ("-K*z", true),
        ("-(1 N*s/m)*speed", true),
        ("-(1 N*s/m)*w", true),
        ("0.1*own.e", true),
        ("-b*integral_of_speed", true),
        ("force", false),
        ("force*sin(t*(1 s^-1))", false),
        ("0.5*hand.e", false),
        ("given", false),
        ("clock*(1 N/s)", false),
        ("ramp*(1 N/s)", false),
        ("ramp*(1 N/s) - K*z", true),
    ];
    for (value, is) in rows {
        let text = format!(
            "model M(b = 3 N*s/m, K = 1000 N/m, force = 2 N) {{
               input given = 1 N
               input w = 1 m/s
               let x = place.q
               let speed = handle.f
               let ramp = integral(1, 0 s)
               let integral_of_speed = integral(handle.e, 0 N*s)/(1 kg)
               state z = 0 m {{ dz = handle.f }}
               state clock = 0 s {{ dclock = 1 }}
               I:handle = 1 kg  R:own = b  C:place {{ H = 0; q0 = 0 m }}
               Se:hand = sin(t*(3 s^-1))*(1 N)
               sampled at 100 Hz {{ Se:wall = {value} }}
               1:v -> handle, own, place
               hand -> v
               wall ||> v
               probe x_ = place.q
             }}"
        );
        let text = if value.ends_with("*w") { text.replace("input w = 1 m/s", "let w = z*(1 s^-1)") } else { text };
        let compiled = self::text(&text);
        assert_eq!(!steered(compiled.scene()).is_empty(), is, "{value}: {:?}", steered(compiled.scene()));
    }
    // In a continuous region it stands beside the verdict.
    let amplifier =
        text("model A { C:c = 1 F  R:r = 1 Ohm  Se:drive = 2 V - 0.5*c.e  drive -> 1:i -> r, c  probe u = c.e }");
    assert_eq!(steered(amplifier.scene()), [("drive".to_string(), Steering::Beside)]);
    let mut sim = start(&amplifier, Steps::new());
    finish(&mut sim, 5.0);
    let summary = sim.summary();
    assert!(summary.passive, "{:?}", summary.reasons);
    let supplied = summary.regions[0].supplied;
    assert!((summary.regions[0].steered[0].energy - supplied).abs() <= 1e-12 * supplied && supplied > 1.0);
}

/// What a hold makes of a spring, felt at the hand: the handle's own friction b counts, and b > K T/2 is enough
/// (Colgate and Schenkel, 1997), though the wall by itself gives out more than it was given.
#[test]
fn friction_counts_where_a_hand_feels_it() {
    let sampled = "sampled every T hold lagged budget off { C:k { stiffness = K } }";
    for (friction, passive) in [("0.001 N*s/m", false), ("6 N*s/m", true), ("20 N*s/m", true)] {
        let scene =
            handle(sampled, "k -[bar]||> v  expect passive at bar").replace("b = 3 N*s/m", &format!("b = {friction}"));
        let compiled = text(&scene);
        let mut sim = start(&compiled, Steps::new());
        let (mut drawn, mut when) = (0.0f64, 0.0);
        for k in 1..=1000 {
            advance(&mut sim, f64::from(k) * 0.005);
            let of = sim.summary();
            let hand = of.regions.iter().flat_map(|r| &r.sources).find(|s| s.name == "hand").unwrap().energy;
            if -hand > drawn {
                (drawn, when) = (-hand, of.time);
            }
        }
        let summary = sim.summary();
        let [bar, hand] = &summary.watched[..] else { panic!("{:?}", summary.watched) };
        assert_eq!((hand.name.as_str(), bar.name.as_str()), ("hand", "bar"));
        assert_eq!(hand.broken.is_none(), passive, "{friction}: {hand:?}");
        assert!(bar.broken.is_some() && bar.drawn > 0.1, "{friction}: {bar:?}");
        assert_eq!(hand.stored, 0.0);
        // It is looked at in every step, so that it is no less than what samples show.
        assert!(hand.drawn >= drawn && hand.drawn <= 1.2 * drawn + 1e-9, "{friction}: {} of {drawn}", hand.drawn);
        if let Some((first, worst)) = hand.broken {
            assert!(
                first > 0.1 && first <= worst && (worst - when).abs() <= 0.005,
                "{friction}: {first} {worst} {when}"
            );
        }
    }
}

/// A spring may be emptied, and no more; between two rows, too. Heat and its entropies are not drawn as work.
#[test]
fn what_is_stored_may_be_drawn() {
    let spring = |more: &str| {
        format!(
            "model M {{
               C:spring {{ stiffness = 100 N/m; q0 = 0.1 m }}
               {more}
               Sf:hand = -0.2*sin(t*(2 s^-1))*(1 m/s)
               1:v -> spring
               hand -> v
               probe x = spring.q
               expect passive at hand
             }}"
        )
    };
    let warm = "C:body { e = 300 K * exp(q/(10 J/K)); q0 = 0 J/K }  RS(a, heat):r = 0.001 N*s/m  v -> r.a  r.heat -> 0:T -> body";
    for (what, more) in [("spring", ""), ("and heat", warm)] {
        let compiled = text(&spring(more));
        let mut sim = start(&compiled, Steps::tolerance(1e-6).longest(0.01));
        // At pi it is back where it began.
        finish(&mut sim, std::f64::consts::PI);
        let [hand] = &sim.summary().watched[..] else { panic!("{what}") };
        assert!((hand.stored - 0.5).abs() < 1e-12, "{what}: {hand:?}");
        assert!(hand.broken.is_none() && hand.drawn <= 0.5 && hand.drawn > 0.499, "{what}: {hand:?}");
        assert!(hand.net.abs() < 1e-3, "{what}: {hand:?}");
    }
    // What has a source of its own behind it is not passive there.
    let compiled = text(
        "model M {
           Se:battery = 12 V  R:inner = 1 Ohm  Sf:hand = -0.5 A
           battery -> 1:i -> inner  i -> 0:n  hand -> n
           probe u = n.e
           expect passive at hand
         }",
    );
    let mut sim = start(&compiled, Steps::new());
    finish(&mut sim, 1.0);
    let [hand] = &sim.summary().watched[..] else { panic!() };
    assert!((hand.drawn - 0.5 * 11.5).abs() < 1e-9 && hand.broken.is_some(), "{hand:?}");
}

/// A run that goes on from what was saved knows what was drawn before.
#[test]
fn what_was_drawn_is_saved() {
    let sampled = "sampled every T hold lagged budget off { C:k { stiffness = K } }";
    let compiled = text(&handle(sampled, "k -[bar]||> v  expect passive at bar"));
    let mut whole = start(&compiled, Steps::new());
    finish(&mut whole, 3.0);
    let mut first = start(&compiled, Steps::new());
    advance(&mut first, 1.0);
    let bytes = first.save().unwrap();
    let mut later = compiled.resume(&bytes).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(later.summary().watched, first.summary().watched);
    finish(&mut later, 3.0);
    assert_eq!(later.summary().watched, whole.summary().watched);
    assert!(whole.summary().watched[0].broken.is_some());
}

/// Where nothing drives the scene there is nothing to look at, and an energy without a least value has no end.
#[test]
fn places_that_say_nothing_are_refused() {
    let scene = |at: &str| {
        format!(
            "model M {{ I:m = 1 kg  R:r = 1 N*s/m  Se:u = 1 N  1:v -> m, r  u -> v  probe x = m.f  expect passive at {at} }}"
        )
    };
    for at in ["m", "v", "r", "x"] {
        let text = errors(&scene(at)).to_string();
        assert!(text.contains("elaborate::expect") && text.contains("no source, open port or double bar"), "{text}");
    }
    assert!(errors(&scene("w")).to_string().contains("`w`"));
    text(&scene("u"));
    let falling =
        scene("u").replace("R:r = 1 N*s/m", "R:r = 1 N*s/m  C:height { e = -9.81 N }").replace("m, r", "m, r, height");
    let text = errors(&falling).to_string();
    assert!(text.contains("discretise::expect") && text.contains("no lower bound"), "{text}");
}

/// A wall that is far too stiff shows an energy that nobody put in; a soft one does not.
#[test]
fn what_a_hold_adds_inside_is_told_apart() {
    for (stiffness, hold, much) in [("30000 N/m", "hold lagged budget off", true), ("100 N/m", "", false)] {
        let sampled = format!("sampled every T {hold} {{ C:k {{ stiffness = K }} }}");
        let compiled = text(&handle(&sampled, "k -[bar]||> v").replace("K = 1000 N/m", &format!("K = {stiffness}")));
        let mut sim = start(&compiled, Steps::new());
        finish(&mut sim, 3.0);
        let summary = sim.summary();
        let wall = summary.regions.iter().find(|r| r.hold.is_some()).unwrap();
        assert_eq!(wall.leaks_much, much, "{stiffness}: {} of {}", wall.leaked, wall.h_max);
        assert_eq!(wall.leaked.abs() > 0.01 * wall.h_max, much, "{stiffness}");
        assert!(
            (wall.h_final - (wall.h_initial + wall.supplied - wall.dissipated + wall.leaked)).abs()
                <= 1e-9 * wall.h_max
        );
    }
}

/// A heavy top in the frame of its body: the energy is linear in the direction of gravity, whose length stays what it
/// is, so that there is a least one; that may be drawn, and no more.
#[test]
fn an_energy_may_be_bounded_by_what_can_be_reached() {
    let top = |more: &str| {
        format!(
            "model Top(mgl = 2 N*m) {{
               I:p1 {{ inertia = 1 kg*m^2; f0 = 0.1 rad/s }}
               I:p2 = 1 kg*m^2
               I:p3 {{ inertia = 0.5 kg*m^2; f0 = 5 rad/s }}
               C:n1 {{ H = 0; q0 = 0.6 }}
               C:n2 {{ H = 0; q0 = 0 }}
               C:n3 {{ H = mgl*q; q0 = 0.8 }}
               1:w1 -> p1  1:w2 -> p2  1:w3 -> p3
               MGY:g3 = p3.p  w1 -> g3 -> w2
               MGY:g1 = p1.p  w2 -> g1 -> w3
               MGY:g2 = p2.p  w3 -> g2 -> w1
               0:x1 -> n1  0:x2 -> n2  0:x3 -> n3
               MTF:a13 = n2.q  MTF:a12 = -n3.q  w3 -> a13 -> x1  w2 -> a12 -> x1
               MTF:a21 = n3.q  MTF:a23 = -n1.q  w1 -> a21 -> x2  w3 -> a23 -> x2
               MTF:a32 = n1.q  MTF:a31 = -n2.q  w2 -> a32 -> x3  w1 -> a31 -> x3
               {more}
               probe length = n1.q^2 + n2.q^2 + n3.q^2
             }}"
        )
    };
    let hand = "Se:hand = sin(t*(1 s^-1))*(1 N*m)  hand -> w1  R:air = 0.1 N*m*s  w2 -> air  expect passive at hand";
    let compiled = text(&top(hand));
    assert!(compiled.scene().excluded.is_empty(), "{:?}", compiled.scene().excluded);
    let mut sim = start(&compiled, Steps::new());
    finish(&mut sim, 10.0);
    let summary = sim.summary();
    assert!(summary.passive, "{:?}", summary.reasons);
    let [hand] = &summary.watched[..] else { panic!() };
    let stored = 0.005 + 6.25 + 2.0 * 0.8 + 2.0;
    assert!((hand.stored - stored).abs() < 1e-12 * stored && hand.broken.is_none(), "{hand:?}");
    // What falls without end has no least energy, though another state of the region goes round.
    for (what, changed) in [
        (
            "a weight",
            "C:height { e = -2 N }  I:m = 1 kg  1:v -> m, height  TF:r = 1 m  R:link = 1 N*s/m  w1 -> r -> 0:z -> v, link",
        ),
        ("a stretched direction", "MTF:b = n1.q  w1 -> b -> x1"),
    ] {
        let compiled = text(&top(changed));
        let named = |name: &str| compiled.scene().excluded.iter().any(|x| x.element.starts_with(name));
        assert!(named("height") || named("n3"), "{what}: {:?}", compiled.scene().excluded);
    }
}
