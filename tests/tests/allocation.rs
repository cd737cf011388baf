//! Stepping, sampling and looking allocate nothing once the first of each is over: tables and buffers are there by then.

use crate::common::{file, models};
use bond::{Options, Steps};

#[test]
fn nothing_is_allocated_in_a_step() {
    let cases = [
        ("examples/virtual_wall.bond", Some("VirtualWall"), 0.04),
        ("examples/virtual_wall.bond", Some("Lagged"), 0.04),
        ("examples/virtual_wall.bond", Some("Ray"), 0.04),
        ("examples/mass_spring_sampled.bond", None, 0.5),
        ("examples/two_computers.bond", None, 0.01),
        ("examples/pendulum.bond", None, 0.01),
        ("examples/diode_clipper.bond", None, 1e-6),
        ("examples/quarter_car.bond", None, 0.01),
        ("examples/pid_motor.bond", Some("Continuous"), 0.001),
        ("examples/pid_motor.bond", Some("Sampled"), 0.001),
    ];
    for (name, scene, h) in cases {
        let mut options = Options::new();
        if let Some(scene) = scene {
            options = options.model(scene);
        }
        let compiled = file(&models().join(name), options);
        let mut sim = compiled.simulate(Steps::fixed(h)).unwrap_or_else(|e| panic!("{name}: {e}"));
        let inputs: Vec<String> = compiled.inputs().iter().map(|i| i.to_string()).collect();
        let mut rows = 0.0;
        let mut run = |from: u32, to: u32| {
            for k in from..=to {
                for (i, input) in inputs.iter().enumerate() {
                    sim.set_input(input, f64::from(k % 7 + i as u32)).unwrap_or_else(|e| panic!("{name}: {e}"));
                }
                sim.advance(f64::from(k) * h).unwrap_or_else(|e| panic!("{name}: {e}"));
                rows += sim.probes().map_or(f64::NAN, |p| p.iter().sum::<f64>());
            }
        };
        run(1, 60);
        let counted = allocation_counter::measure(|| run(61, 200));
        assert_eq!(counted.count_total, 0, "{name} {scene:?}: {} allocations in 140 steps", counted.count_total);
        assert!(rows.is_finite(), "{name}");
    }
}
