//! The exact step of a linear cluster: the matrix exponential, inputs held, energies integrated exactly.
//!
//! With w = (x, xi), where xi are what drives the sources (constants, powers of t, sines, exponentials; anything else
//! as its cubic through four Gauss nodes of the step), dw/dt = A w; x+ = E w, means and energies are linear and
//! quadratic forms in w.

mod drive;
mod rows;

use super::accounts::Accounts;
use super::cluster::{Cluster, missing, verified};
use super::write;
use crate::expression::{Lowering, Symbol};
use crate::model::{Law, Model};
use crate::structure::{ColumnId, Form};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::double_double::DoubleDouble;
use bond_runtime::exponential::{Layout, Linear};
use bond_runtime::ir::{Array, Builder, Inst, Slot, Unary};
use bond_runtime::scene::{Entries, Stepper};
use drive::{Drive, drive_value};
use rows::{Rows, add_product, rows};

/// The step, and whether a source is not followed by it, but replaced by a cubic that is something else.
pub(super) struct Exact {
    pub(super) step: (Stepper, Vec<Entries>),
    pub(super) strays: bool,
}

/// Writes the step; `None` where the cluster cannot be stepped so.
pub(super) fn write(c: &Cluster, model: &mut Model, form: &Form) -> Result<Option<Exact>, Vec<Diagnostic>> {
    let Some(mut rows) = rows(c, model, form) else { return Ok(None) };
    let size = rows.linear.n + rows.linear.m;
    let forms = c.nodes.len() + rows.integrals.iter().filter(|i| i.is_err()).count();
    if forms * size * size > 2_000_000 || forms * size * size * size > 60_000_000 {
        return Ok(None);
    }
    let time = c.time.ok_or_else(Vec::new)?;
    let strays = rows.system.strays(&model.pool);
    let cubic = rows.system.drives.iter().any(|d| matches!(d, Drive::Cubic(..)));
    let (program, linear, entries) = program(c, model, form, &mut rows, time, true)?;
    let (glance, glance_linear, _) = self::program(c, model, form, &mut rows, time, false)?;
    let order = if cubic { 4 } else { 0 };
    let stepper = |program, linear, glance| Stepper {
        linear: Some(linear),
        glance,
        ..Stepper::new("exact", order, true, program)
    };
    let glance = stepper(glance, glance_linear, None);
    Ok(Some(Exact { step: (stepper(program, linear, Some(Box::new(glance))), entries), strays }))
}

/// Whether a cluster is linear but for what its probes integrate.
pub(super) fn takes_states(c: &Cluster, model: &mut Model, form: &Form) -> bool {
    let bare = Cluster { integrals: Vec::new(), ..c.clone() };
    !c.integrals.is_empty() && rows(&bare, model, form).is_some()
}

fn program(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    rows: &mut Rows,
    time: Symbol,
    with_ledger: bool,
) -> Result<(bond_runtime::ir::Program, Linear, Vec<Entries>), Vec<Diagnostic>> {
    let mut linear = rows.linear.clone();
    let size = linear.n + linear.m;
    let mut b = Builder::new(c.title(form, if with_ledger { "exact step" } else { "exact glance" }));
    let entries = c.reserve(model, &mut b, form);
    let inputs = write::inputs(&mut b, c, form, model);
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let w = b.slots(Array::Local, size);
    let at = |k: usize| Slot { array: Array::Local, index: w.index + k as u32 };
    for (i, x) in inputs.states.iter().enumerate() {
        b.store(at(i), *x);
    }
    for (i, d) in rows.system.drives.clone().iter().enumerate() {
        let e = drive_value(model, d, &rows.system.given, (time, c.h.unwrap_or(time)));
        let v = lowering.lower(&model.pool, &mut b, e).map_err(|s| missing(model, s))?;
        b.store(at(rows.system.n + i), v);
    }
    // Means: what answers ports and constant sources, then linear integrals. The energy of a constant source is its
    // value times the integral of what answers it, which stays exact where two of them all but cancel.
    let steady: Vec<ColumnId> = c.ports.iter().copied().chain(rows.steady(c, form)).collect();
    linear.means = steady.iter().filter_map(|p| rows.inputs.get(p).cloned()).collect();
    // The energy of a source that may come to rest is h times the product of its mean and that of what answers, and a
    // form in how far both are from these: at rest that is a product of two numbers, and no form's rounding adds up.
    let moving: Vec<ColumnId> = rows.settling(c, form).into_iter().filter(|s| !steady.contains(s)).collect();
    let first_moving = linear.means.len();
    if with_ledger && !moving.is_empty() {
        for column in &moving {
            let pair = [rows.outputs.get(&form.column(*column).out), rows.inputs.get(column)];
            linear.means.extend(pair.iter().copied().flatten().cloned());
        }
    }
    let first_integral = linear.means.len();
    linear.means.extend(rows.integrals.iter().filter_map(|i| i.as_ref().ok().cloned()));
    let accounts: Vec<Accounts> = c.accounts(model, form);
    let mut quads: Vec<Slot> = Vec::new();
    let mut drifts: Vec<(usize, Slot)> = Vec::new();
    let mut sums: Vec<(Slot, f64)> = Vec::new();
    if with_ledger {
        for (e, account) in entries.iter().zip(&accounts) {
            let energy = |columns: &[ColumnId], sign: f64| {
                let mut m = vec![DoubleDouble::default(); size * size];
                for column in columns {
                    if let (Some(z), Some(i)) = (rows.outputs.get(&form.column(*column).out), rows.inputs.get(column)) {
                        add_product(&mut m, z, i, sign);
                    }
                }
                m
            };
            for ((_, slot), column) in e.supplied.iter().zip(&account.supplied) {
                let slot = Slot::new(Array::Output, *slot);
                if let Some(k) = moving.iter().position(|m| m == column) {
                    linear.drifts.push(energy(&[*column], -1.0));
                    drifts.push((k, slot));
                } else if !steady.contains(column) {
                    linear.forms.push(energy(&[*column], -1.0));
                    quads.push(slot);
                }
            }
            for ((_, slot), columns) in e.dissipated.iter().zip(&account.dissipated) {
                let slot = Slot::new(Array::Output, *slot);
                let is_active = |c: &ColumnId| model.element(form.column(*c).element).active;
                match columns[..] {
                    // An active resistor gives energy: minus a sum of squares.
                    [one] => {
                        let sign = if is_active(&one) && is_negative(model, form, one) { -1.0 } else { 1.0 };
                        linear.squares.push(energy(columns, sign));
                        sums.push((slot, sign));
                    }
                    // An active field may do both.
                    _ if columns.iter().any(is_active) => {
                        linear.forms.push(energy(columns, 1.0));
                        quads.push(slot);
                    }
                    _ => {
                        linear.squares.push(energy(columns, 1.0));
                        sums.push((slot, 1.0));
                    }
                }
            }
        }
    }
    let ledger_forms = linear.forms.len();
    linear.forms.extend(rows.integrals.iter().filter_map(|i| i.as_ref().err().cloned()));
    let layout = Layout::of(&linear);
    b.slots(Array::Table, layout.size());
    let n = linear.n;
    let next = b.slots(Array::Local, n);
    if n > 0 {
        let inst = Inst::MatVec {
            to: next,
            table: layout.exponential() as u32,
            from: w,
            rows: n as u32,
            cols: size as u32,
            low: true,
        };
        b.push(inst, next, n);
    }
    let means = b.slots(Array::Local, linear.means.len());
    if !linear.means.is_empty() {
        let inst = Inst::MatVec {
            to: means,
            table: layout.mean(0) as u32,
            from: w,
            rows: linear.means.len() as u32,
            cols: size as u32,
            low: false,
        };
        b.push(inst, means, linear.means.len());
    }
    let quad = |b: &mut Builder, to: Slot, table: usize, from: Slot, root: bool| {
        b.push(Inst::Quad { to, table: table as u32, from, n: size as u32, root }, to, 1);
    };
    for (k, (slot, sign)) in sums.iter().enumerate() {
        if *sign < 0.0 {
            let sum = b.slot(Array::Local);
            quad(&mut b, sum, layout.square(k), w, true);
            let sum = b.load(sum);
            let sum = b.unary(Unary::Neg, sum);
            b.store(*slot, sum);
        } else {
            quad(&mut b, *slot, layout.square(k), w, true);
        }
    }
    let mean = |b: &mut Builder, k: usize| b.load(Slot { array: Array::Local, index: means.index + k as u32 });
    for (k, slot) in quads.iter().enumerate() {
        quad(&mut b, *slot, layout.form(k), w, false);
    }
    if !drifts.is_empty() {
        let euler = b.slots(Array::Local, size);
        let (table, all) = (layout.euler() as u32, size as u32);
        b.push(Inst::MatVec { to: euler, table, from: w, rows: all, cols: all, low: false }, euler, size);
        for (drift, (k, slot)) in drifts.iter().enumerate() {
            let went = b.slot(Array::Local);
            quad(&mut b, went, layout.drift(drift), euler, false);
            let (z, i) = (mean(&mut b, first_moving + 2 * k), mean(&mut b, first_moving + 2 * k + 1));
            let power = b.mul(z, i);
            let (into, went) = (b.mul(inputs.h, power), b.load(went));
            let out = b.sub(went, into);
            b.store(*slot, out);
        }
    }
    for (i, _) in c.ports.iter().enumerate() {
        let m = mean(&mut b, i);
        b.store(Slot::new(Array::Output, i), m);
    }
    if with_ledger {
        for (e, account) in entries.iter().zip(&accounts) {
            for ((_, slot), column) in e.supplied.iter().zip(&account.supplied) {
                let Some(i) = steady.iter().position(|p| p == column) else { continue };
                let mut v = None;
                let row = rows.outputs.get(&form.column(*column).out).map(Vec::as_slice).unwrap_or(&[]);
                for (k, x) in row.iter().enumerate().filter(|(_, x)| x.high != 0.0) {
                    let (x, drive) = (b.number(x.high), b.load(at(k)));
                    let part = b.mul(x, drive);
                    v = Some(match v {
                        Some(v) => b.add(v, part),
                        None => part,
                    });
                }
                let v = v.unwrap_or_else(|| b.number(0.0));
                let m = mean(&mut b, i);
                let q = b.mul(inputs.h, m);
                let e = b.mul(v, q);
                let e = b.unary(Unary::Neg, e);
                b.store(Slot::new(Array::Output, *slot), e);
            }
        }
    }
    b.slots(Array::Next, c.slots());
    let mut values = Vec::new();
    for i in 0..n {
        // Of a state that stays much as it is, the rows give the change.
        let change = b.load(Slot { array: Array::Local, index: next.index + i as u32 });
        let keep = b.load(Slot::new(Array::Table, layout.keep() + i));
        let (base, carry) = (b.mul(keep, inputs.states[i]), b.load(inputs.carries[i]));
        let carry = b.mul(keep, carry);
        let (_, v, rest) = write::added(&mut b, base, change, carry);
        b.store(Slot::new(Array::Next, i), v);
        b.store(Slot::new(Array::Next, c.carry_at() + i), rest);
        values.push(v);
    }
    let (mut straight, mut squares) = (first_integral, ledger_forms);
    for (i, (start, kind)) in inputs.integrals.iter().zip(&rows.integrals).enumerate() {
        let change = match kind {
            Ok(_) => {
                let m = mean(&mut b, straight);
                straight += 1;
                b.mul(inputs.h, m)
            }
            Err(_) => {
                let slot = b.slot(Array::Local);
                quad(&mut b, slot, layout.form(squares), w, false);
                squares += 1;
                b.load(slot)
            }
        };
        let v = b.add(*start, change);
        b.store(Slot::new(Array::Next, n + i), v);
    }
    for (i, z) in inputs.guesses.iter().enumerate() {
        b.store(Slot::new(Array::Next, n + c.integrals.len() + i), *z);
    }
    if with_ledger {
        write::energies(c, model, &mut b, (&values, &[]), &inputs, &entries)?;
    }
    Ok((verified(model, b.finish())?, linear, entries))
}

/// Whether a linear resistor's value is below 0.
fn is_negative(model: &Model, form: &Form, column: ColumnId) -> bool {
    match &model.element(form.column(column).element).law {
        Law::Resistor(r) => r.linear.and_then(|k| model.pool.constant(k)).is_some_and(|k| k < 0.0),
        Law::Source(_) | Law::Storage(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) => false,
    }
}
