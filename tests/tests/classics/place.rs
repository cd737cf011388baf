//! Random times and states.

use super::System;
use bond::Compiled;
use bond::internal::CompiledInternals;
use std::collections::BTreeMap;
use std::ops::Index;

/// A place to compare at: parameters as in the file, states by name.
pub(super) struct At {
    pub(super) t: f64,
    pub(super) values: BTreeMap<String, f64>,
}

impl Index<&str> for At {
    type Output = f64;

    fn index(&self, name: &str) -> &f64 {
        self.values.get(name).unwrap_or_else(|| panic!("there is no state or parameter `{name}`"))
    }
}

impl At {
    /// `name[i].q`
    pub(super) fn of(&self, name: &str, i: usize, state: &str) -> f64 {
        self[&format!("{name}[{i}].{state}")]
    }
}

/// Numbers in [0, 1) from a seed (splitmix64).
pub(super) struct Dice(pub(super) u64);

impl Dice {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

/// `cap.q` of `cap[1].q`
pub(super) fn plain(name: &str) -> String {
    let mut depth = 0;
    let keep = |c: &char| {
        depth += i32::from(*c == '[');
        let inside = depth > 0;
        depth -= i32::from(*c == ']');
        !inside
    };
    name.chars().filter(keep).collect()
}

/// A time and a state at random.
pub(super) fn place(system: &System, compiled: &Compiled, dice: &mut Dice) -> Result<At, String> {
    let stages = compiled.stages();
    let mut values: BTreeMap<String, f64> = stages.model.parameters.iter().map(|p| (p.name.clone(), p.value)).collect();
    for (name, _) in states(compiled) {
        let short = plain(&name);
        let bounds = system.states.iter().find(|s| s.0 == short);
        let (_, low, high) = bounds.ok_or_else(|| format!("`{name}` has no bounds"))?;
        values.insert(name, dice.between(*low, *high));
    }
    Ok(At { t: dice.between(0.0, system.until), values })
}

/// The states of the compiled form, those of signals too: name and start.
pub(super) fn states(compiled: &Compiled) -> Vec<(String, f64)> {
    let stages = compiled.stages();
    let energy = stages.form.regions.iter().flat_map(|r| &r.states).map(|s| (s.name.clone(), s.initial));
    energy.chain(stages.model.memories.iter().map(|m| (m.name.clone(), m.start))).collect()
}
