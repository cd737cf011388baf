//! Specialisation constants: the numbers in which scenes of the same code shape differ, kept apart from the code, so
//! that one routine does for all of them.

use bond_runtime::double_double::DoubleDouble;
use bond_runtime::energy::PortResponse;
use bond_runtime::exponential::Linear;
use bond_runtime::ir::Program;
use bond_runtime::scene::{Cluster, Probes, Properties, Respond, Scene, Stepper};
use bond_runtime::simulate::{Options, Start};

/// The numbers of a scene that are in `Memory::Data`, and where.
pub(super) struct SpecialisationConstants<'a> {
    /// All of them, in order.
    pub(super) data: Vec<f64>,
    programs: Vec<(&'a Program, u32)>,
    /// By cluster.
    responses: Vec<[u32; 3]>,
}

impl<'a> SpecialisationConstants<'a> {
    /// Those of a scene.
    pub(super) fn new(scene: &'a Scene, start: &Start) -> Self {
        let mut it = Self { data: Vec::new(), programs: Vec::new(), responses: Vec::new() };
        for (c, s) in scene.clusters.iter().zip(&start.clusters) {
            for program in of(c) {
                it.programs.push((program, it.data.len() as u32));
                it.data.extend(program.numbers().into_iter().map(|n| n.1));
            }
            it.responses.push(PortResponse::ALL.map(|which| {
                let at = it.data.len() as u32;
                it.data.extend(s.response(which));
                at
            }));
        }
        it
    }

    /// Where the numbers of one of the scene's programs begin.
    pub(super) fn program(&self, program: &Program) -> Option<u32> {
        self.programs.iter().find(|p| std::ptr::eq(p.0, program)).map(|p| p.1)
    }

    /// Where those of a cluster's answer begin.
    pub(super) fn response(&self, cluster: usize, which: PortResponse) -> u32 {
        self.responses[cluster][which as usize]
    }
}

/// The programs of a cluster that a routine is made of.
fn of(c: &Cluster) -> impl Iterator<Item = &Program> {
    let respond = c.respond.iter().flat_map(Respond::programs);
    [&c.step.program, &c.instant].into_iter().chain(respond)
}

/// What scenes of the same code shape have in common, as bytes: where it is the same, so are their routines but for
/// their numbers. None where it cannot be told.
pub fn code_shape(scene: &Scene, options: &Options) -> Option<Vec<u8>> {
    let mut common = scene.clone();
    common.probes = Probes::default();
    common.energy = 0.0;
    common.inputs.iter_mut().for_each(|i| i.value = 0.0);
    for c in &mut common.clusters {
        c.initial.fill(0.0);
        c.sizes.fill(0.0);
        c.guards.iter_mut().for_each(|g| (g.program, g.branch) = (Program::default(), None));
        c.stored = Program::default();
        (c.fastest_period, c.fastest_turn) = (None, 0.0);
        c.instant = c.instant.code_shape();
        c.entries.iter_mut().for_each(|e| {
            (e.floor, e.faintest, e.least) = (0.0, 0.0, f64::from(u8::from(e.least != 0.0)));
            e.work.iter_mut().for_each(|w| (w.initial, w.least) = (0.0, 0.0));
        });
        if let Some(r) = &mut c.respond {
            r.program = r.program.code_shape();
            r.fallback.iter_mut().for_each(|p| *p = p.code_shape());
        }
        c.step.why = "".into();
        // Where there is another stepper to fall back on, there is no routine.
        c.step.fallback.iter_mut().for_each(|f| **f = Stepper::new("", Properties::default(), Program::default()));
        c.step.glance = None;
        c.step.program = c.step.program.code_shape();
        c.step.linear.iter_mut().for_each(shape);
    }
    let mut bytes = common.to_bytes().ok()?;
    for x in [options.step, options.tolerance, Some(options.default_step), options.longest] {
        bytes.push(u8::from(x.is_some()));
        bytes.extend(x.unwrap_or(0.0).to_le_bytes());
    }
    Some(bytes)
}

/// Leaves the sizes of a linear system.
fn shape(linear: &mut Linear) {
    linear.a.fill(DoubleDouble::default());
    let lists = [&mut linear.means, &mut linear.forms, &mut linear.squares, &mut linear.drifts];
    lists.into_iter().flatten().for_each(|l| l.fill(DoubleDouble::default()));
}
