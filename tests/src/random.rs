//! Random connected bond graphs, for tests and for the ablation of thresholds. All of it is mechanical, so that every
//! unit fits.

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use std::fmt::Write;

/// A junction, hung on one before it.
#[derive(Clone, Debug)]
pub struct Junction {
    /// Of the same kind as its parent, which mostly makes dependent storages.
    like: bool,
    parent: prop::sample::Index,
    /// 0..=4 a bond, 5 a TF, 6 a GY, 7 a double bar
    link: u8,
    backward: bool,
    /// Where it lies behind a double bar: 0 continuous, else sampled, with a rate and a hold.
    rate: u8,
    ratio: u8,
}

/// A 1-port element on a junction.
#[derive(Clone, Debug)]
pub struct Part {
    kind: u8,
    at: prop::sample::Index,
    backward: bool,
    value: u8,
    curved: bool,
    /// Whatever its kind, also where it makes a conflict or a dependent storage.
    odd: bool,
}

fn rarely() -> impl Strategy<Value = bool> {
    prop::bool::weighted(0.1)
}

/// Any junction.
pub fn junction() -> impl Strategy<Value = Junction> {
    (rarely(), any::<prop::sample::Index>(), 0u8..8, any::<bool>(), 0u8..6, 1u8..9)
        .prop_map(|(like, parent, link, backward, rate, ratio)| Junction { like, parent, link, backward, rate, ratio })
}

/// Any part.
pub fn part() -> impl Strategy<Value = Part> {
    (0u8..13, any::<prop::sample::Index>(), any::<bool>(), 1u8..10, prop::bool::weighted(0.3), rarely())
        .prop_map(|(kind, at, backward, value, curved, odd)| Part { kind, at, backward, value, curved, odd })
}

/// A multiport field, or a transformer whose ratio a storage's state moves.
#[derive(Clone, Debug)]
pub struct Field {
    kind: u8,
    at: (prop::sample::Index, prop::sample::Index),
    backward: bool,
    value: u8,
}

/// Any field.
pub fn field() -> impl Strategy<Value = Field> {
    (0u8..8, any::<(prop::sample::Index, prop::sample::Index)>(), any::<bool>(), 1u8..10)
        .prop_map(|(kind, at, backward, value)| Field { kind, at, backward, value })
}

/// Declares the fields between junctions of one block, and bonds them.
fn write_fields(
    fields: &[Field],
    block: &[usize],
    inside: &mut [String],
    bonds: &mut String,
    states: &[(usize, String)],
) {
    for (i, f) in fields.iter().enumerate() {
        let (a, b) = (f.at.0.index(block.len()), f.at.1.index(block.len()));
        if block[a] != block[b] {
            continue;
        }
        let v = f64::from(f.value);
        let state = states.iter().filter(|s| s.0 == block[a]).nth(usize::from(f.value) % 3).map(|s| s.1.as_str());
        let text = match (f.kind, state) {
            (0, _) => format!("C(a, b):f{i} {{ H = {v} N/m * (a^2 + a*b + b^2); a_0 = 0.1 m }}"),
            (1, _) => format!("C(a, b):f{i} {{ H = {v} N/m * (a^2 + b^2) + 1 N/m^3 * a^2*b^2; b_0 = 0.2 m }}"),
            (2, _) => format!("I(a, b):f{i} = [[{v} kg, {} kg], [{} kg, {v} kg]]", 0.4 * v, 0.4 * v),
            (3, _) => format!(
                "IC(I a, C b):f{i} {{ H = 0.5*a^2/({v} kg + 1 kg/m^2 * b^2) + 1 N/m * b^2; a_0 = 0.3 N*s; b_0 = 0.1 m }}"
            ),
            (4, _) => format!("R(a, b):f{i} = [[{v} N*s/m, 1.5 N*s/m], [-1 N*s/m, 1 N*s/m]]"),
            (5, _) => format!(
                "R(a, b):f{i} {{ a.e = {v} N*s/m * (a.f - b.f); b.e = {v} N*s/m * (b.f - a.f) + 0.1 N*s^3/m^3 * b.f^3 }}"
            ),
            (6, Some(state)) => {
                inside[block[a]].push_str(&format!("    TF:m{i} = 1 + 0.3 m^-1 * {state}\n"));
                let _ = writeln!(bonds, "  j{a} -> m{i} -> j{b}");
                continue;
            }
            _ => {
                inside[block[a]].push_str(&format!(
                    "    R:s{i} {{ e = {v} N * min(max(s, -1), 1) + 0.01 N * s; f = (s - min(max(s, -1), 1)) * 1 m/s + 0.01 m/s * s }}\n"
                ));
                let _ = writeln!(bonds, "  j{a} -> s{i}");
                continue;
            }
        };
        inside[block[a]].push_str(&format!("    {text}\n"));
        let _ = if f.backward {
            writeln!(bonds, "  f{i}.a -> j{a}\n  j{b} -> f{i}.b")
        } else {
            writeln!(bonds, "  j{a} -> f{i}.a\n  j{b} -> f{i}.b")
        };
    }
}

/// The text of a graph. All of it is mechanical, so that every unit fits.
pub fn text(
    junctions: &[Junction],
    parts: &[Part],
    loops: &[(prop::sample::Index, prop::sample::Index)],
    fields: &[Field],
) -> String {
    // The block each junction lies in: 0 is continuous.
    let mut block = vec![0usize];
    let mut heads: Vec<String> = vec![String::new()];
    let mut bonds = String::new();
    let mut inside: Vec<String> = vec![String::new()];
    let declare = |inside: &mut Vec<String>, block: usize, text: String| inside[block].push_str(&text);
    let mut zero = vec![false];
    declare(&mut inside, 0, "    1:j0\n".to_string());
    for (i, j) in junctions.iter().enumerate().skip(1) {
        let parent = j.parent.index(i);
        let mut here = block[parent];
        let (mut a, mut b) = (format!("j{parent}"), format!("j{i}"));
        if j.backward {
            std::mem::swap(&mut a, &mut b);
        }
        let _ = match j.link {
            7 => {
                // A continuous piece may border on sampled ones only.
                here = if block[parent] != 0 && j.rate == 0 {
                    // A continuous piece of its own needs no block.
                    0
                } else {
                    let period = ["0.01", "0.02", "0.05", "0.0314159", "0.1", "0.03"][usize::from(j.rate)];
                    let hold = ["", " hold lagged", " hold predicted", " hold matched"][usize::from(j.ratio) % 4];
                    heads.push(format!("  sampled every {period} s{hold} {{\n"));
                    inside.push(String::new());
                    heads.len() - 1
                };
                writeln!(bonds, "  {a} ||> {b}")
            }
            5 => {
                declare(&mut inside, here, format!("    TF:t{i} = {}\n", f64::from(j.ratio) * 0.5));
                writeln!(bonds, "  {a} -> t{i} -> {b}")
            }
            6 => {
                declare(&mut inside, here, format!("    GY:g{i} = {} N*s/m\n", f64::from(j.ratio) * 0.5));
                writeln!(bonds, "  {a} -> g{i} -> {b}")
            }
            _ => writeln!(bonds, "  {a} -> {b}"),
        };
        block.push(here);
        // A gyrator and a double bar join alike junctions as well as a bond joins unlike ones.
        zero.push((zero[parent] == j.like) == (j.link < 6));
        declare(&mut inside, here, format!("    {}:j{i}\n", if zero[i] { '0' } else { '1' }));
    }
    for (a, b) in loops {
        let (a, b) = (a.index(junctions.len()), b.index(junctions.len()));
        if a != b && block[a] == block[b] {
            let _ = writeln!(bonds, "  j{a} -> j{b}");
        }
    }
    let mut states: Vec<(usize, String)> = Vec::new();
    let mut full = vec![false; junctions.len()];
    for (i, p) in parts.iter().enumerate() {
        let at = p.at.index(junctions.len());
        let v = f64::from(p.value);
        // What gives the junction's common variable stands there once, if at all.
        let kind = match p.kind {
            k if p.odd => k,
            0 | 2 if zero[at] => 1,
            1 if !zero[at] => 2,
            3..=5 if zero[at] && std::mem::replace(&mut full[at], true) => 6,
            6..=8 if !zero[at] && std::mem::replace(&mut full[at], true) => 3,
            k => k,
        };
        // Starts that differ: those that cancel are tried in `ledger::flows_that_cancel`.
        let apart = 0.0123 * i as f64;
        let (name, law) = match (kind, p.curved) {
            (0, _) => ("Se", format!("= {v} N")),
            (1, _) => ("Sf", format!("= {} m/s", 0.1 * v)),
            (2, _) => ("Se", format!("= {v} N * sin(t*{v} rad/s)")),
            (3..=5, true) if p.value > 5 => ("C", format!("{{ H = {v} N/m * q^2 + 0.5 N/m^3 * q^4 }}")),
            (3..=5, _) => ("C", format!("{{ stiffness = {v} N/m;  q0 = {} m }}", 0.1 * v - 0.4 + apart)),
            (6..=8, true) if p.value > 5 => {
                ("I", format!("{{ H = 0.5*p^2/{v} kg + 0.1 s^2/(kg^3*m^2) * p^4;  p0 = {} N*s }}", 0.2 + apart))
            }
            (6..=8, _) => ("I", format!("= {v} kg")),
            (_, false) => ("R", format!("= {v} N*s/m")),
            (_, true) => ("R", format!("{{ e = {v} N*s/m * f + 0.3 N*s^3/m^3 * f^3 }}")),
        };
        if name == "C" {
            states.push((block[at], format!("e{i}.q")));
        }
        declare(&mut inside, block[at], format!("    {name}:e{i} {law}\n"));
        let _ = if p.backward { writeln!(bonds, "  e{i} -> j{at}") } else { writeln!(bonds, "  j{at} -> e{i}") };
    }
    write_fields(fields, &block, &mut inside, &mut bonds, &states);
    // A junction with nothing on it would often hang loose.
    for (i, j) in junctions.iter().enumerate() {
        if !j.like && !parts.iter().any(|p| p.at.index(junctions.len()) == i && p.kind > 2) {
            declare(&mut inside, block[i], format!("    R:loss{i} = {} N*s/m\n", j.ratio));
            let _ = writeln!(bonds, "  j{i} -> loss{i}");
        }
    }
    let mut all = String::from("model Random {\n");
    for (head, inside) in heads.iter().zip(&inside) {
        all.push_str(head);
        all.push_str(inside);
        if !head.is_empty() {
            all.push_str("  }\n");
        }
    }
    all + &bonds + "}\n"
}

/// A number of graphs, the same ones each time.
pub fn graphs(count: usize) -> Vec<String> {
    let mut runner = TestRunner::new_with_rng(Config::default(), TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let strategy = (
        prop::collection::vec(junction(), 1..11),
        prop::collection::vec(part(), 1..21),
        prop::collection::vec(field(), 0..3),
    );
    let graph = |_| {
        let (junctions, parts, fields) = strategy.new_tree(&mut runner).map(|t| t.current()).unwrap_or_default();
        text(&junctions, &parts, &[], &fields)
    };
    (0..count).map(graph).collect()
}
