//! Machine code for many scenes of one code shape: it is made once, and takes the numbers in which they differ from its
//! data.

use super::jit::{Code, Compiled, JIT, WORTH_INTERVALS, Whole};
use crate::backend::standalone::{self, BlockConstants};
use crate::backend::{is_large, lower_apart};
use bond_runtime::interpreter::Interpreter;
use bond_runtime::ir::Program;
use bond_runtime::kernel::{Backend, Kernel};
use bond_runtime::scene::Scene;
use bond_runtime::simulate::{BlockMaker, BlockRoutine, Options, Places, Start};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// At most this many code shapes are known; what comes later is interpreted.
const MAX_SHAPES: usize = 64;

/// Compiles each code shape of a program or scene once; the numbers of a run are those of code made for it alone, to
/// the last bit. Large programs, which have no such form, are compiled each for itself.
///
/// To be used by many threads at once: who asks for what another is just compiling waits for it.
#[derive(Default)]
pub struct Shared {
    kernels: Shapes<Program, Code>,
    stretches: Arc<Shapes<Vec<u8>, Known>>,
    /// Intervals of one scene that are worth it.
    worth: u64,
}

/// Code for the scenes of a code shape.
struct Known {
    code: Arc<Code>,
    places: Places,
}

/// What is known of code shapes: each with its key, and None where it has no code.
type Shapes<K, V> = Mutex<Vec<(K, Option<Arc<V>>)>>;

/// The code for a scene, and its own numbers.
fn find(
    list: &Shapes<Vec<u8>, Known>,
    scene: &Scene,
    options: &Options,
    start: &Start,
) -> Option<(Arc<Known>, BlockConstants)> {
    let make = || {
        let standalone::BlockProgram { mut run, places, .. } = standalone::block_program(scene, options, start, true)?;
        run.data.clear();
        Some(Known { code: Arc::new(Code::new(run)?), places })
    };
    let known = known(list, standalone::code_shape(scene, options)?, make)?;
    let own = BlockConstants::new(scene, start, &known.places)?;
    Some((known, own))
}

impl Shared {
    /// Nothing yet, for so many scenes.
    pub fn new(scenes: u64) -> Self {
        Self { worth: WORTH_INTERVALS / scenes.max(1), ..Self::default() }
    }

    /// How many code shapes of programs it knows, and of scenes.
    pub fn shapes(&self) -> (usize, usize) {
        (lock(&self.kernels).len(), lock(&self.stretches).len())
    }
}

fn lock<T>(list: &Mutex<T>) -> MutexGuard<'_, T> {
    list.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What is known under a key, made where it is not.
fn known<K: PartialEq, V>(list: &Shapes<K, V>, key: K, make: impl FnOnce() -> Option<V>) -> Option<Arc<V>> {
    let mut list = lock(list);
    if let Some((_, found)) = list.iter().find(|(k, _)| *k == key) {
        return found.clone();
    }
    if list.len() >= MAX_SHAPES {
        return None;
    }
    let made = make().map(Arc::new);
    list.push((key, made.clone()));
    made
}

impl Backend for Shared {
    fn kernel(&self, program: &Program) -> Box<dyn Kernel> {
        if is_large(program) {
            return JIT.kernel(program);
        }
        let make = || {
            let mut routine = lower_apart(program)?;
            routine.data.clear();
            Code::new(routine)
        };
        match known(&self.kernels, program.code_shape(), make) {
            Some(code) => {
                let data = program.numbers().into_iter().map(|n| n.1).collect();
                Box::new(Compiled::of(program, code, data))
            }
            None => Box::new(Interpreter::new(program)),
        }
    }

    fn block_maker(&self) -> Option<BlockMaker> {
        let list = self.stretches.clone();
        let make = move |scene: &Scene, options: &Options, start: &Start| -> Option<Box<dyn BlockRoutine>> {
            let (known, own) = find(&list, scene, options, start)?;
            Some(Box::new(Whole::new(known.code.clone(), own)))
        };
        Some(BlockMaker { make: Arc::new(make), worth: self.worth })
    }
}
