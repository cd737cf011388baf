//! Runs programs without compiling them to machine code.
//!
//! A program becomes flat code on registers, one after the other in memory; constants get registers of their own that
//! are filled once. Registers are used again when their value is dead, so that large programs stay in the cache.

mod code;
mod translate;

use crate::eval;
use crate::ir::Program;
use crate::kernel::{Backend, Failure, Kernel, Workspace};
use crate::solve::{linear, newton};
use code::Code;
use std::cell::Cell;
use std::ops::Range;

/// A program as code for the machine in this file.
#[derive(Clone, Debug)]
pub struct Interpreter {
    program: Program,
    code: Vec<Code>,
    main: Range<usize>,
    loops: Vec<Loop>,
    plans: Vec<newton::Plan>,
    linear: Vec<Linear>,
    /// The first registers, which hold the constants.
    constants: Vec<f64>,
    registers: usize,
}

/// An iteration: where its code is and which registers its numbers come in.
#[derive(Clone, Debug, Default)]
struct Loop {
    body: Range<usize>,
    residual: Vec<u32>,
    jacobian: Vec<u32>,
    weight: Vec<u32>,
    scale: Vec<u32>,
    cold: Vec<u32>,
    small: Vec<u32>,
}

/// Linear equations: where the unknowns are, and which registers the numbers come in.
#[derive(Clone, Debug)]
struct Linear {
    unknowns: usize,
    right: Vec<u32>,
    matrix: Vec<u32>,
    flag: Option<usize>,
    system: linear::System,
}

impl Interpreter {
    /// Translates a program.
    ///
    /// # Panics
    /// Where the program does not pass [`Program::verify`].
    pub fn new(program: &Program) -> Self {
        translate::translate(program)
    }
}

/// Runs every program without compiling it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Interpret;

impl Backend for Interpret {
    fn kernel(&self, program: &Program) -> Box<dyn Kernel> {
        Box::new(Interpreter::new(program))
    }
}

impl Kernel for Interpreter {
    fn program(&self) -> &Program {
        &self.program
    }

    fn run(&self, state: &[f64], input: &[f64], table: &[f64], work: &mut Workspace) -> Result<(), Failure> {
        let mut machine = Machine { interpreter: self, state, input, table, work };
        machine.run(self.main.clone())?;
        work.check()
    }

    fn workspace(&self) -> Workspace {
        // Behind the registers there is room for a matrix.
        let room = self.linear.iter().map(|l| l.matrix.len()).max().unwrap_or(0);
        let mut work = Workspace::new(&self.program, &self.plans, self.registers + room);
        work.systems = self.linear.iter().map(|l| l.system.clone()).collect();
        work.registers[..self.constants.len()].copy_from_slice(&self.constants);
        work
    }
}

/// A run.
struct Machine<'a> {
    interpreter: &'a Interpreter,
    state: &'a [f64],
    input: &'a [f64],
    table: &'a [f64],
    work: &'a mut Workspace,
}

impl Machine<'_> {
    /// Runs a stretch of code.
    fn run(&mut self, range: Range<usize>) -> Result<(), Failure> {
        let interpreter = self.interpreter;
        let mut code = &interpreter.code[range];
        loop {
            let done = self.straight(code);
            match code.get(done) {
                Some(Code::Newton(k)) => self.newton(*k as usize)?,
                Some(Code::Solve(k)) => self.solve(*k as usize)?,
                Some(_) | None => return Ok(()),
            }
            code = &code[done + 1..];
        }
    }

    /// Runs up to the next iteration, or to the end; returns how far it came.
    fn straight(&mut self, code: &[Code]) -> usize {
        let (state, input, table) = (self.state, self.input, self.table);
        let Workspace { next, output, local, registers, .. } = &mut *self.work;
        let r = &mut registers[..];
        for (done, instruction) in code.iter().enumerate() {
            match *instruction {
                Code::State { to, slot } => r[to as usize] = state[slot as usize],
                Code::Input { to, slot } => r[to as usize] = input[slot as usize],
                Code::Table { to, slot } => r[to as usize] = table[slot as usize],
                Code::Local { to, slot } => r[to as usize] = local[slot as usize],
                Code::StoreNext { slot, from } => next[slot as usize] = r[from as usize],
                Code::StoreLocal { slot, from } => local[slot as usize] = r[from as usize],
                Code::StoreOutput { slot, from } => output[slot as usize] = r[from as usize],
                Code::Add { to, a, b } => r[to as usize] = r[a as usize] + r[b as usize],
                Code::Sub { to, a, b } => r[to as usize] = r[a as usize] - r[b as usize],
                Code::Mul { to, a, b } => r[to as usize] = r[a as usize] * r[b as usize],
                Code::Div { to, a, b } => r[to as usize] = r[a as usize] / r[b as usize],
                Code::MulAdd { to, a, b, c } => r[to as usize] = r[a as usize] * r[b as usize] + r[c as usize],
                Code::MulSub { to, a, b, c } => r[to as usize] = r[a as usize] * r[b as usize] - r[c as usize],
                Code::SubMul { to, a, b, c } => r[to as usize] = r[c as usize] - r[a as usize] * r[b as usize],
                Code::Neg { to, a } => r[to as usize] = -r[a as usize],
                Code::Select { to, c, a, b } => {
                    r[to as usize] = eval::select(r[c as usize], r[a as usize], r[b as usize]);
                }
                Code::Unary { f, to, a } => r[to as usize] = eval::unary(f, r[a as usize]),
                Code::Binary { f, to, a, b } => r[to as usize] = eval::binary(f, r[a as usize], r[b as usize]),
                Code::MatVec(ref m) => m.run(&mut code::Memory { state, input, table, next, output, local }),
                Code::Quad(ref q) => q.run(&mut code::Memory { state, input, table, next, output, local }),
                Code::Newton(_) | Code::Solve(_) => return done,
            }
        }
        code.len()
    }

    /// Solves linear equations.
    fn solve(&mut self, k: usize) -> Result<(), Failure> {
        let linear = &self.interpreter.linear[k];
        let Workspace { local, registers, systems, newton_iterations, .. } = &mut *self.work;
        let (registers, matrix) = registers.split_at_mut(self.interpreter.registers);
        let unknowns = &mut local[linear.unknowns..linear.unknowns + linear.right.len()];
        gather(unknowns, &linear.right, registers);
        gather(matrix, &linear.matrix, registers);
        let result = systems[k].solve(matrix, unknowns, false).map_err(|row| Failure::Singular { row });
        match linear.flag {
            Some(slot) => {
                local[slot] = if result.is_ok() { 1.0 } else { 0.0 };
                Ok(())
            }
            None => {
                *newton_iterations += 1;
                result.map(|_| ())
            }
        }
    }

    /// Runs an iteration.
    fn newton(&mut self, k: usize) -> Result<(), Failure> {
        let interpreter = self.interpreter;
        let (shape, plan) = (&interpreter.loops[k], &interpreter.plans[k]);
        // Taken out for the time, so that the body may use the workspace; an empty one costs nothing.
        let mut scratch = std::mem::take(&mut self.work.newtons[k]);
        gather(&mut scratch.weight, &shape.weight, &self.work.registers);
        gather(&mut scratch.scale, &shape.scale, &self.work.registers);
        gather(&mut scratch.cold, &shape.cold, &self.work.registers);
        gather(&mut scratch.small, &shape.small, &self.work.registers);
        let places = plan.unknowns..plan.unknowns + plan.method.n;
        scratch.unknowns.copy_from_slice(&self.work.local[places.clone()]);
        let small = std::mem::take(&mut scratch.small);
        let mut count = 0;
        let mut body = Body { machine: self, shape, unknowns: places.clone(), small: &small };
        let result = newton::solve(plan, &mut scratch, &mut count, &mut body);
        self.work.local[places].copy_from_slice(&scratch.unknowns);
        if let Some(first) = plan.rounding {
            self.work.local[first..first + plan.method.n].copy_from_slice(&scratch.rounding);
        }
        scratch.small = small;
        self.work.newtons[k] = scratch;
        self.work.newton_iterations += count;
        match plan.flag {
            Some(slot) => {
                self.work.local[slot] = if result.is_ok() { 1.0 } else { 0.0 };
                Ok(())
            }
            None => result,
        }
    }
}

/// The equations of an iteration, computed by its body.
struct Body<'a, 'b> {
    machine: &'a mut Machine<'b>,
    shape: &'a Loop,
    /// Where the body reads the unknowns.
    unknowns: Range<usize>,
    /// See [`crate::ir::Newton::small`].
    small: &'a [f64],
}

impl newton::System for Body<'_, '_> {
    fn evaluate(
        &mut self,
        unknowns: &[Cell<f64>],
        residual: &mut [f64],
        jacobian: &mut [f64],
        coarse: bool,
    ) -> Result<(), Failure> {
        let slots = &mut self.machine.work.local[self.unknowns.clone()];
        slots.iter_mut().zip(unknowns).for_each(|(slot, u)| *slot = u.get());
        if coarse {
            for k in &self.shape.small {
                self.machine.work.registers[*k as usize] = -0.0;
            }
        }
        let result = self.machine.run(self.shape.body.clone());
        gather(residual, &self.shape.residual, &self.machine.work.registers);
        gather(jacobian, &self.shape.jacobian, &self.machine.work.registers);
        if coarse {
            for (k, x) in self.shape.small.iter().zip(self.small) {
                self.machine.work.registers[*k as usize] = *x;
            }
        }
        result
    }
}

/// Copies registers out.
fn gather(to: &mut [f64], from: &[u32], registers: &[f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = registers[*from as usize];
    }
}
