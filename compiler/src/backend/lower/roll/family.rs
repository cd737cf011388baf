//! Cones of one shape as loops.

use super::cone::{Cone, Leaf, Part};
use crate::backend::code::{Index, Memory, Place, Stmt, Value};
use crate::backend::lower::writer::Writer;
use rustc_hash::FxHashMap;

/// Fewer members are written out.
const FEW: usize = 4;
/// Even stretches of a family are worth loops of their own where they are so long on average,
const STRETCH: usize = 16;
/// and so few.
const STRETCHES: usize = 8;

/// Writes cones that do not need one another, family by family, in order of their first members.
pub(super) fn write(w: &mut Writer, cones: Vec<Cone>) {
    let mut number: FxHashMap<(Vec<Part>, u8), usize> = FxHashMap::default();
    let mut families: Vec<Vec<Cone>> = Vec::new();
    for mut cone in cones {
        let shape = std::mem::take(&mut cone.shape);
        match number.get(&shape) {
            Some(&k) => families[k].push(cone),
            None => {
                cone.shape.clone_from(&shape);
                number.insert(shape, families.len());
                families.push(vec![cone]);
            }
        }
    }
    for mut family in families {
        let parts = std::mem::take(&mut family[0].shape.0);
        family.sort_by_key(|c| c.to.base);
        let stretches = stretches(&family);
        if stretches.len() <= 1 + (family.len() / STRETCH).min(STRETCHES) {
            let mut from = 0;
            for n in stretches {
                members(w, &parts, &family[from..from + n]);
                from += n;
            }
        } else {
            members(w, &parts, &family);
        }
    }
}

/// Lengths of the stretches over which all places run evenly.
fn stretches(family: &[Cone]) -> Vec<usize> {
    let places = |c: &Cone| -> Vec<i64> {
        let of = |l: &Leaf| match l {
            Leaf::Number(_) => 0,
            Leaf::Place(_, at) => i64::from(*at),
        };
        std::iter::once(i64::from(c.to.base)).chain(c.leaves.iter().map(of)).collect()
    };
    let mut list = Vec::new();
    let mut from = 0;
    while from < family.len() {
        let mut n = 1;
        let mut last = places(&family[from]);
        let mut stride: Option<Vec<i64>> = None;
        while let Some(next) = family.get(from + n) {
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

/// Writes members of a family.
fn members(w: &mut Writer, parts: &[Part], family: &[Cone]) {
    if family.len() < FEW {
        for cone in family {
            member(w, parts, &cone.to, |w, k| match cone.leaves[k] {
                Leaf::Number(x) => w.number(x),
                Leaf::Place(m, at) => w.load(Place::new(m, at)),
            });
        }
        return;
    }
    let index = w.index();
    let to = along(w, index, family[0].to.memory, family.iter().map(|c| c.to.base).collect());
    let leaves: Vec<Result<f64, Place>> = (0..family[0].leaves.len())
        .map(|k| match family[0].leaves[k] {
            Leaf::Number(x) => {
                let numbers = family.iter().map(|c| match c.leaves[k] {
                    Leaf::Number(x) => x,
                    Leaf::Place(..) => 0.0,
                });
                let numbers: Vec<f64> = numbers.collect();
                if numbers.iter().all(|y| y.to_bits() == x.to_bits()) {
                    return Ok(x);
                }
                let base = w.data.len() as u32;
                w.data.extend(numbers);
                Err(Place { memory: Memory::Data, base, along: vec![(index, 1)], through: None })
            }
            Leaf::Place(m, _) => {
                let places = family.iter().map(|c| match c.leaves[k] {
                    Leaf::Place(_, at) => at,
                    Leaf::Number(_) => 0,
                });
                Err(along(w, index, m, places.collect()))
            }
        })
        .collect();
    w.open();
    member(w, parts, &to, |w, k| match &leaves[k] {
        Ok(x) => w.number(*x),
        Err(place) => w.load(place.clone()),
    });
    let body = w.close();
    w.push(Stmt::For(index, 0, family.len() as u32, body));
}

/// The place of each member: counted where they run evenly, else looked up.
fn along(w: &mut Writer, index: Index, memory: Memory, places: Vec<u32>) -> Place {
    let stride = places[1].checked_sub(places[0]);
    let even = stride.filter(|s| places.windows(2).all(|p| p[1].checked_sub(p[0]) == Some(*s)));
    match even {
        Some(0) => Place::new(memory, places[0]),
        Some(stride) => Place { memory, base: places[0], along: vec![(index, stride)], through: None },
        None => {
            let at = w.tables.len() as u32;
            w.tables.extend(places);
            Place { memory, base: 0, along: Vec::new(), through: Some((at, index)) }
        }
    }
}

/// Writes one member.
fn member(w: &mut Writer, parts: &[Part], to: &Place, mut leaf: impl FnMut(&mut Writer, usize) -> Value) {
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
    if let Some(v) = values.last() {
        w.push(Stmt::Store(to.clone(), *v));
    }
}
