//! Stepping, sampling and looking allocate nothing once the first of each is over: tables and buffers are there by
//! then.

use crate::common::{file, models};
use bond::internal::{Code, CompiledInternals, SimulationInternals, StepsInternals};
use bond::{Options, Simulation, Steps};
use bond_compiler::backend::lower;

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
        ("elements/delay_sampled.bond", None, 0.01),
        ("elements/delay.bond", None, 0.01),
    ];
    for (name, scene, h) in cases {
        let mut options = Options::new();
        if let Some(scene) = scene {
            options = options.model(scene);
        }
        let compiled = file(&models().join(name), options);
        // What has a plain form is run as machine code.
        let clusters = &compiled.scene().clusters;
        assert!(clusters.iter().all(|c| lower(&c.step.program).is_some()), "{name} has machine code");
        let settings = &compiled.stages().model.settings;
        let steps = Steps::fixed(h).resolve(settings, 200.0 * h, None).unwrap_or_else(|e| panic!("{name}: {e}"));
        for code in [Code::Native, Code::Interpreted] {
            let mut sim =
                Simulation::on(code.backend(), compiled.scene(), &steps, []).unwrap_or_else(|e| panic!("{name}: {e}"));
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
            let count = counted.count_total;
            assert_eq!(count, 0, "{name} {scene:?} {code:?}: {count} allocations in 140 steps");
            assert!(rows.is_finite(), "{name}");
        }
    }
}
