//! Cones of one shape as loops.

use super::expression_cone::{Cone, Leaf, Part};
use super::sum::Total;
use crate::backend::code::{Index, Memory, Place, Reason, Stmt, Value, Var};
use crate::backend::lower::writer::Writer;
use rustc_hash::{FxHashMap, FxHashSet};

/// Watches numbers that have to be finite: 0 times each is added up.
pub(super) struct Watch {
    memory: Memory,
    /// From this place on, up to and without that one.
    from: u32,
    to: u32,
    /// But for these.
    left: FxHashSet<u32>,
    /// Numbers elsewhere that are finite only where those are.
    instead: Vec<Place>,
    /// Of what is written out, one by one.
    few: Var,
    /// Of each loop, with its turns.
    loops: Vec<(Total, usize)>,
}

impl Watch {
    pub(super) fn new(w: &mut Writer, memory: Memory, base: u32, size: usize) -> Self {
        Self {
            memory,
            from: base,
            to: base + size as u32,
            left: FxHashSet::default(),
            instead: Vec::new(),
            few: w.starting(0.0),
            loops: Vec::new(),
        }
    }

    /// Whether what is stored in a place is watched.
    pub(super) fn holds(&self, place: &Place) -> bool {
        place.memory == self.memory && (self.from..self.to).contains(&place.base) && !self.left.contains(&place.base)
    }

    /// Watches these places no more, but numbers elsewhere that tell of them.
    pub(super) fn leave(&mut self, places: FxHashSet<u32>, instead: Vec<Place>) {
        self.left = places;
        self.instead = instead;
    }

    /// What its loops are added up in.
    pub(super) fn totals(&self) -> impl Iterator<Item = &Total> {
        self.loops.iter().map(|l| &l.0)
    }

    /// Fails where a number was not finite.
    pub(super) fn check(&self, w: &mut Writer) {
        let (zero, few) = (w.number(0.0), w.get(self.few));
        let parts: Vec<Value> = self.loops.iter().map(|(total, turns)| total.value(w, *turns)).collect();
        let sum = parts.into_iter().fold(few, |sum, x| w.add(sum, x));
        let sum = self.instead.iter().fold(sum, |sum, place| {
            let x = w.load(place.clone());
            let term = w.mul(zero, x);
            w.add(sum, term)
        });
        let sound = w.eq(sum, zero);
        w.when(sound.not(), |w| w.push(Stmt::Fail(Reason::NotFinite)));
    }
}

/// Writes cones that do not need one another, group by group, in order of their first members.
pub(super) fn write(w: &mut Writer, watch: &mut Watch, cones: Vec<Cone>) {
    let mut number: FxHashMap<(Vec<Part>, u8), usize> = FxHashMap::default();
    let mut groups: Vec<Vec<Cone>> = Vec::new();
    for mut cone in cones {
        let shape = std::mem::take(&mut cone.shape);
        match number.get(&shape) {
            Some(&k) => groups[k].push(cone),
            None => {
                cone.shape.clone_from(&shape);
                number.insert(shape, groups.len());
                groups.push(vec![cone]);
            }
        }
    }
    for mut group in groups {
        let parts = std::mem::take(&mut group[0].shape.0);
        group.sort_by_key(|c| c.to.base);
        for group in by_numbers(group, w.loops.number_lists) {
            let stretches = stretches(&group);
            if stretches.len() <= 1 + (group.len() / w.loops.stretch).min(w.loops.stretches) {
                let mut from = 0;
                for n in stretches {
                    members(w, watch, &parts, &group[from..from + n]);
                    from += n;
                }
            } else {
                members(w, watch, &parts, &group);
            }
        }
    }
}

/// A group by the numbers of its members, where these are at most so many lists; else as it is.
fn by_numbers(group: Vec<Cone>, most: usize) -> Vec<Vec<Cone>> {
    let numbers = |c: &Cone| -> Vec<u64> {
        let of = |l: &Leaf| match l {
            Leaf::Number(x) => Some(x.to_bits()),
            Leaf::Place(..) => None,
        };
        c.leaves.iter().filter_map(of).collect()
    };
    let mut known: FxHashMap<Vec<u64>, usize> = FxHashMap::default();
    let mut which = Vec::with_capacity(group.len());
    for cone in &group {
        let next = known.len();
        let k = *known.entry(numbers(cone)).or_insert(next);
        if k == most {
            return vec![group];
        }
        which.push(k);
    }
    let mut lists: Vec<Vec<Cone>> = (0..known.len()).map(|_| Vec::new()).collect();
    group.into_iter().zip(which).for_each(|(cone, k)| lists[k].push(cone));
    lists
}

/// Lengths of the stretches over which all places run evenly.
fn stretches(group: &[Cone]) -> Vec<usize> {
    let places = |c: &Cone| -> Vec<i64> {
        let of = |l: &Leaf| match l {
            Leaf::Number(_) => 0,
            Leaf::Place(_, at) => i64::from(*at),
        };
        std::iter::once(i64::from(c.to.base)).chain(c.leaves.iter().map(of)).collect()
    };
    let mut list = Vec::new();
    let mut from = 0;
    while from < group.len() {
        let mut n = 1;
        let mut last = places(&group[from]);
        let mut stride: Option<Vec<i64>> = None;
        while let Some(next) = group.get(from + n) {
            let here = places(next);
            let step: Vec<i64> = here.iter().zip(&last).map(|(a, b)| a - b).collect();
            if step.iter().any(|s| *s < 0) || stride.as_ref().is_some_and(|s| *s != step) {
                break;
            }
            (stride, last) = (Some(step), here);
            n += 1;
        }
        list.push(n);
        from += n;
    }
    list
}

/// Writes members of a group.
fn members(w: &mut Writer, watch: &mut Watch, parts: &[Part], group: &[Cone]) {
    if group.len() < w.loops.members {
        for cone in group {
            let value = member(w, parts, &cone.to, |w, k| match cone.leaves[k] {
                Leaf::Number(x) => w.number(x),
                Leaf::Place(m, at) => w.load(Place::new(m, at)),
            });
            if let Some(v) = value.filter(|_| watch.holds(&cone.to)) {
                let (zero, before) = (w.number(0.0), w.get(watch.few));
                let term = w.mul(zero, v);
                let after = w.add(before, term);
                w.set(watch.few, after);
            }
        }
        return;
    }
    let index = w.index();
    let to = along(w, index, group[0].to.memory, group.iter().map(|c| c.to.base).collect());
    let leaves: Vec<Result<f64, Place>> = (0..group[0].leaves.len())
        .map(|k| match group[0].leaves[k] {
            Leaf::Number(x) => {
                let numbers = group.iter().map(|c| match c.leaves[k] {
                    Leaf::Number(x) => x,
                    Leaf::Place(..) => 0.0,
                });
                let numbers: Vec<f64> = numbers.collect();
                if numbers.iter().all(|y| y.to_bits() == x.to_bits()) {
                    return Ok(x);
                }
                let base = w.data.len() as u32;
                w.data.extend(numbers);
                Err(Place { along: vec![(index, 1)], ..Place::new(Memory::Data, base) })
            }
            Leaf::Place(m, _) => {
                let places = group.iter().map(|c| match c.leaves[k] {
                    Leaf::Place(_, at) => at,
                    Leaf::Number(_) => 0,
                });
                Err(along(w, index, m, places.collect()))
            }
        })
        .collect();
    let total = group.iter().any(|c| watch.holds(&c.to)).then(|| Total::of(w, group.len(), 0.0));
    w.open();
    let value = member(w, parts, &to, |w, k| match &leaves[k] {
        Ok(x) => w.number(*x),
        Err(place) => w.load(place.clone()),
    });
    if let (Some(total), Some(v)) = (&total, value) {
        let zero = w.number(0.0);
        let term = w.mul(zero, v);
        total.add(w, index, term);
    }
    let body = w.close();
    watch.loops.extend(total.map(|total| (total, group.len())));
    w.push(Stmt::For(index, 0, group.len() as u32, body));
}

/// The place of each member: counted where they run evenly, else looked up.
fn along(w: &mut Writer, index: Index, memory: Memory, places: Vec<u32>) -> Place {
    let stride = places[1].checked_sub(places[0]);
    let even = stride.filter(|s| places.windows(2).all(|p| p[1].checked_sub(p[0]) == Some(*s)));
    match even {
        Some(0) => Place::new(memory, places[0]),
        Some(stride) => Place { along: vec![(index, stride)], ..Place::new(memory, places[0]) },
        None => {
            let at = w.tables.len() as u32;
            w.tables.extend(places);
            Place { through: Some((at, index)), ..Place::new(memory, 0) }
        }
    }
}

/// Writes one member: its value.
fn member(
    w: &mut Writer,
    parts: &[Part],
    to: &Place,
    mut leaf: impl FnMut(&mut Writer, usize) -> Value,
) -> Option<Value> {
    let mut values: Vec<Value> = Vec::with_capacity(parts.len());
    let mut leaves = 0;
    for part in parts {
        let at = |k: u32| values[k as usize];
        let v = match *part {
            Part::Number | Part::Load(_) => {
                leaves += 1;
                leaf(w, leaves - 1)
            }
            Part::Unary(f, a) => w.unary(f, at(a)),
            Part::Binary(f, a, b) => w.binary(f, at(a), at(b)),
            Part::Select(c, a, b) => {
                let c = w.is_true(at(c));
                w.select(c, at(a), at(b))
            }
        };
        values.push(v);
    }
    let value = values.last().copied();
    w.push(Stmt::Store(to.clone(), value?));
    value
}
