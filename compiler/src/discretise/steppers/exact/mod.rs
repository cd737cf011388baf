//! The exact step of a linear cluster: the matrix exponential, inputs held, energies integrated exactly.
//!
//! With w = (x, xi), where xi are what drives the sources (constants, powers of t, sines, exponentials; anything else
//! as its cubic through four Gauss nodes of the step), dw/dt = A w; x+ = E w, means and energies are linear and
//! quadratic forms in w.

mod drive;
mod rows;

use crate::discretise::cluster::{Cluster, missing, verified};
use crate::discretise::equations::accounts::Accounts;
use crate::discretise::equations::inputs::{self, Inputs};
use crate::discretise::equations::ledger;
use crate::discretise::steppers::label::{Label, Refusal, Step};
use crate::expression::{Lowering, Symbol};
use crate::model::{Law, Model};
use crate::structure::{ColumnId, Form};
use bond_grammar::diagnostic::Diagnostic;
use bond_runtime::double_double::DoubleDouble;
use bond_runtime::exponential::{Layout, Linear};
use bond_runtime::ir::{Array, Builder, Inst, Program, Slot, Unary, Value};
use bond_runtime::scene::{Entries, Properties, Stepper};
use drive::{Drive, drive_value};
use rows::{Rows, add_product, rows};

/// The step, and whether a source is not followed by it, but replaced by a cubic that is something else.
pub(crate) struct Exact {
    pub(crate) step: Step,
    pub(crate) strays: bool,
}

/// The step of a cluster.
pub(crate) fn step(label: Label, c: &mut Cluster, model: &mut Model, form: &Form) -> Result<Step, Refusal> {
    let why = match c.has_moving_source_driven_storage(&model.pool) {
        true => "one of its storages follows a moving source",
        false => "it is not linear with a quadratic energy, or too large",
    };
    write(label, c, model, form)?.map(|e| e.step).ok_or_else(|| Refusal::Unfit(why.into()))
}

/// Writes the step; `None` where the cluster cannot be stepped so.
pub(crate) fn write(
    label: Label,
    c: &Cluster,
    model: &mut Model,
    form: &Form,
) -> Result<Option<Exact>, Vec<Diagnostic>> {
    let Some(rows) = rows(c, model, form) else { return Ok(None) };
    let size = rows.linear.n + rows.linear.m;
    let forms = c.nodes.len() + rows.integrals.iter().filter(|i| i.is_err()).count();
    if forms * size * size > 2_000_000 || forms * size * size * size > 60_000_000 {
        return Ok(None);
    }
    let time = c.time.ok_or_else(Vec::new)?;
    let strays = rows.system.strays(&model.pool);
    let cubic = rows.system.drives.iter().any(|d| matches!(d, Drive::Cubic(..)));
    let (program, linear, entries) = program(c, model, form, &rows, time, true)?;
    let (glance, glance_linear, _) = self::program(c, model, form, &rows, time, false)?;
    let order = if cubic { 4 } else { 0 };
    let label = Label { properties: Properties { order, ..label.properties }, ..label };
    let stepper = |program, linear, glance| Stepper { linear: Some(linear), glance, ..label.stepper(program) };
    let glance = stepper(glance, glance_linear, None);
    Ok(Some(Exact { step: (stepper(program, linear, Some(Box::new(glance))), entries), strays }))
}

/// Whether a cluster is linear but for what its probes integrate.
pub(crate) fn takes_states(c: &Cluster, model: &mut Model, form: &Form) -> bool {
    !c.integrals.is_empty() && is_linear(c, model, form)
}

/// Whether a cluster is linear, whatever its probes integrate.
pub(crate) fn is_linear(c: &Cluster, model: &mut Model, form: &Form) -> bool {
    let bare = Cluster { integrals: Vec::new(), ..c.clone() };
    rows(&bare, model, form).is_some()
}

/// The program of a step, its table and the ledger's entries; without a ledger for a look between two steps.
fn program(
    c: &Cluster,
    model: &mut Model,
    form: &Form,
    rows: &Rows,
    time: Symbol,
    with_ledger: bool,
) -> Result<(Program, Linear, Vec<Entries>), Vec<Diagnostic>> {
    let mut b = Builder::new(c.title(form, if with_ledger { "exact step" } else { "exact glance" }));
    let entries = c.reserve(model, &mut b, form);
    let inputs = inputs::inputs(&mut b, c, form, model);
    let from = store_drives(c, model, rows, time, &mut b, &inputs)?;
    let accounts = c.accounts(model, form);
    let ledger: Vec<(&Entries, &Accounts)> =
        if with_ledger { entries.iter().zip(&accounts).collect() } else { Vec::new() };
    let plan = Plan::new(c, model, form, rows, &ledger);
    let layout = Layout::of(&plan.linear);
    b.slots(Array::Table, layout.size());
    let (n, size) = (plan.linear.n, plan.linear.n + plan.linear.m);
    let next = product(&mut b, layout.exponential(), from, (n, size), true);
    let means = product(&mut b, layout.mean(0), from, (plan.linear.means.len(), size), false);
    let writing = Writing { plan: &plan, layout: &layout, from, next, means, size };
    writing.store_forms(&mut b, &inputs);
    for i in 0..c.ports.len() {
        let m = writing.mean(&mut b, i);
        b.store(Slot::new(Array::Output, i), m);
    }
    writing.store_steady(&mut b, form, rows, &ledger, &inputs);
    b.slots(Array::Next, c.slots());
    let values = writing.store_states(&mut b, c, &inputs);
    writing.store_integrals(&mut b, rows, &inputs);
    for (i, z) in inputs.guesses.iter().enumerate() {
        b.store(Slot::new(Array::Next, n + c.integrals.len() + i), *z);
    }
    if with_ledger {
        ledger::energies(c, (model, form), &mut b, (&values, &[]), &inputs, &entries)?;
    }
    Ok((verified(model, b.finish())?, plan.linear, entries))
}

/// Stores w at the start of the step: states, then what drives the sources.
fn store_drives(
    c: &Cluster,
    model: &mut Model,
    rows: &Rows,
    time: Symbol,
    b: &mut Builder,
    inputs: &Inputs,
) -> Result<Slot, Vec<Diagnostic>> {
    let mut lowering = Lowering::new(inputs.env.iter().copied());
    let from = b.slots(Array::Local, rows.linear.n + rows.linear.m);
    for (i, x) in inputs.states.iter().enumerate() {
        b.store(offset(from, i), *x);
    }
    for (i, d) in rows.system.drives.iter().enumerate() {
        let e = drive_value(model, d, &rows.system.given, (time, c.h.unwrap_or(time)));
        let v = lowering.lower(&model.pool, b, e).map_err(|s| missing(model, s))?;
        b.store(offset(from, rows.system.n + i), v);
    }
    Ok(from)
}

fn offset(first: Slot, i: usize) -> Slot {
    Slot { index: first.index + i as u32, ..first }
}

/// Some rows of the table times w; `low` has the exponential's low parts too.
fn product(b: &mut Builder, table: usize, from: Slot, (rows, cols): (usize, usize), low: bool) -> Slot {
    let to = b.slots(Array::Local, rows);
    if rows > 0 {
        let (table, rows32, cols) = (table as u32, rows as u32, cols as u32);
        b.push(Inst::MatVec { to, table, from, rows: rows32, cols, low }, to, rows);
    }
    to
}

/// What the table of a step has, and which outputs are made of it.
struct Plan {
    linear: Linear,
    /// Ports and constant sources; the first means are of what answers them.
    steady: Vec<ColumnId>,
    /// The first mean of sources that may come to rest: of what each gives, and of what answers it.
    first_moving: usize,
    /// The first mean of a linear integral.
    first_integral: usize,
    /// Outputs that are quadratic forms, in order.
    forms: Vec<Slot>,
    /// Outputs of sources that may come to rest, by the place of their means.
    drifts: Vec<(usize, Slot)>,
    /// Outputs that are sums of squares, with the sign.
    squares: Vec<(Slot, f64)>,
}

impl Plan {
    fn new(c: &Cluster, model: &Model, form: &Form, rows: &Rows, ledger: &[(&Entries, &Accounts)]) -> Self {
        let mut linear = rows.linear.clone();
        // Means: what answers ports and constant sources, then linear integrals. The energy of a constant source is its
        // value times the integral of what answers it, which stays exact where two of them all but cancel.
        let steady: Vec<ColumnId> = c.ports.iter().copied().chain(rows.steady(c, form)).collect();
        linear.means = steady.iter().filter_map(|p| rows.inputs.get(p).cloned()).collect();
        // The energy of a source that may come to rest is h times the product of its mean and that of what answers, and
        // a form in how far both are from these: at rest that is a product of two numbers, and no form's rounding adds
        // up.
        let moving: Vec<ColumnId> = match ledger {
            [] => Vec::new(),
            _ => rows.settling(c, form).into_iter().filter(|s| !steady.contains(s)).collect(),
        };
        let first_moving = linear.means.len();
        for column in &moving {
            let pair = [rows.outputs.get(&form.column(*column).out), rows.inputs.get(column)];
            linear.means.extend(pair.iter().copied().flatten().cloned());
        }
        let first_integral = linear.means.len();
        linear.means.extend(rows.integrals.iter().filter_map(|i| i.as_ref().ok().cloned()));
        let (forms, drifts, squares) = (Vec::new(), Vec::new(), Vec::new());
        let mut plan = Self { linear, steady, first_moving, first_integral, forms, drifts, squares };
        for (e, account) in ledger {
            plan.add_energies(model, form, rows, (e, account), &moving);
        }
        plan.linear.forms.extend(rows.integrals.iter().filter_map(|i| i.as_ref().err().cloned()));
        plan
    }

    /// Takes in the energies of a region that are forms: of sources that are not constant, and of resistors.
    fn add_energies(
        &mut self,
        model: &Model,
        form: &Form,
        rows: &Rows,
        (e, account): (&Entries, &Accounts),
        moving: &[ColumnId],
    ) {
        let size = self.linear.n + self.linear.m;
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
                self.linear.drifts.push(energy(&[*column], -1.0));
                self.drifts.push((k, slot));
            } else if !self.steady.contains(column) {
                self.linear.forms.push(energy(&[*column], -1.0));
                self.forms.push(slot);
            }
        }
        for ((_, slot), columns) in e.dissipated.iter().zip(&account.dissipated) {
            let slot = Slot::new(Array::Output, *slot);
            let is_active = |c: &ColumnId| model.element(form.column(*c).element).active;
            let sign = match columns[..] {
                // An active resistor gives energy: minus a sum of squares.
                [one] if is_active(&one) && is_negative(model, form, one) => Some(-1.0),
                [_] => Some(1.0),
                // An active field may do both.
                _ if columns.iter().any(is_active) => None,
                _ => Some(1.0),
            };
            if let Some(sign) = sign {
                self.linear.squares.push(energy(columns, sign));
                self.squares.push((slot, sign));
            } else {
                self.linear.forms.push(energy(columns, 1.0));
                self.forms.push(slot);
            }
        }
    }
}

/// What writes the program of a step: its plan, and where its values are.
struct Writing<'a> {
    plan: &'a Plan,
    layout: &'a Layout,
    /// w at the start of the step.
    from: Slot,
    /// The states at its end, or how they change.
    next: Slot,
    means: Slot,
    /// How many numbers w has.
    size: usize,
}

impl Writing<'_> {
    fn mean(&self, b: &mut Builder, k: usize) -> Value {
        b.load(offset(self.means, k))
    }

    fn quadratic(&self, b: &mut Builder, to: Slot, table: usize, from: Slot, root: bool) {
        b.push(Inst::Quad { to, table: table as u32, from, n: self.size as u32, root }, to, 1);
    }

    /// Stores the energies that are forms of w.
    fn store_forms(&self, b: &mut Builder, inputs: &Inputs) {
        for (k, (slot, sign)) in self.plan.squares.iter().enumerate() {
            if *sign < 0.0 {
                let sum = b.slot(Array::Local);
                self.quadratic(b, sum, self.layout.square(k), self.from, true);
                let sum = b.load(sum);
                let sum = b.unary(Unary::Neg, sum);
                b.store(*slot, sum);
            } else {
                self.quadratic(b, *slot, self.layout.square(k), self.from, true);
            }
        }
        for (k, slot) in self.plan.forms.iter().enumerate() {
            self.quadratic(b, *slot, self.layout.form(k), self.from, false);
        }
        if self.plan.drifts.is_empty() {
            return;
        }
        let euler = product(b, self.layout.euler(), self.from, (self.size, self.size), false);
        for (drift, (k, slot)) in self.plan.drifts.iter().enumerate() {
            let went = b.slot(Array::Local);
            self.quadratic(b, went, self.layout.drift(drift), euler, false);
            let first = self.plan.first_moving + 2 * k;
            let (z, i) = (self.mean(b, first), self.mean(b, first + 1));
            let power = b.mul(z, i);
            let (into, went) = (b.mul(inputs.h, power), b.load(went));
            let out = b.sub(went, into);
            b.store(*slot, out);
        }
    }

    /// Stores the energies of constant sources.
    fn store_steady(
        &self,
        b: &mut Builder,
        form: &Form,
        rows: &Rows,
        ledger: &[(&Entries, &Accounts)],
        inputs: &Inputs,
    ) {
        for (e, account) in ledger {
            for ((_, slot), column) in e.supplied.iter().zip(&account.supplied) {
                let Some(i) = self.plan.steady.iter().position(|p| p == column) else { continue };
                let mut v = None;
                let row = rows.outputs.get(&form.column(*column).out).map(Vec::as_slice).unwrap_or(&[]);
                for (k, x) in row.iter().enumerate().filter(|(_, x)| x.high != 0.0) {
                    let (x, drive) = (b.number(x.high), b.load(offset(self.from, k)));
                    let part = b.mul(x, drive);
                    v = Some(match v {
                        Some(v) => b.add(v, part),
                        None => part,
                    });
                }
                let v = v.unwrap_or_else(|| b.number(0.0));
                let m = self.mean(b, i);
                let q = b.mul(inputs.h, m);
                let e = b.mul(v, q);
                let e = b.unary(Unary::Neg, e);
                b.store(Slot::new(Array::Output, *slot), e);
            }
        }
    }

    /// Stores the states at the end of the step, and gives them.
    fn store_states(&self, b: &mut Builder, c: &Cluster, inputs: &Inputs) -> Vec<Value> {
        let mut values = Vec::new();
        for (i, x) in inputs.states.iter().enumerate() {
            // Of a state that stays much as it is, the rows give the change.
            let change = b.load(offset(self.next, i));
            let keep = b.load(Slot::new(Array::Table, self.layout.keep() + i));
            let (base, carry) = (b.mul(keep, *x), b.load(inputs.carries[i]));
            let carry = b.mul(keep, carry);
            let (_, v, rest) = inputs::added(b, base, change, carry);
            b.store(Slot::new(Array::Next, i), v);
            b.store(Slot::new(Array::Next, c.carry_at() + i), rest);
            values.push(v);
        }
        values
    }

    fn store_integrals(&self, b: &mut Builder, rows: &Rows, inputs: &Inputs) {
        let (mut straight, mut squares) = (self.plan.first_integral, self.plan.forms.len());
        for (i, (start, kind)) in inputs.integrals.iter().zip(&rows.integrals).enumerate() {
            let change = match kind {
                Ok(_) => {
                    let m = self.mean(b, straight);
                    straight += 1;
                    b.mul(inputs.h, m)
                }
                Err(_) => {
                    let slot = b.slot(Array::Local);
                    self.quadratic(b, slot, self.layout.form(squares), self.from, false);
                    squares += 1;
                    b.load(slot)
                }
            };
            let v = b.add(*start, change);
            b.store(Slot::new(Array::Next, self.plan.linear.n + i), v);
        }
    }
}

/// Whether a linear resistor's value is below 0.
fn is_negative(model: &Model, form: &Form, column: ColumnId) -> bool {
    match &model.element(form.column(column).element).law {
        Law::Resistor(r) => r.linear.and_then(|k| model.pool.constant(k)).is_some_and(|k| k < 0.0),
        Law::Source(_) | Law::Storage(_) | Law::Ratio(_) | Law::Junction | Law::Port(_) | Law::Multiplier => false,
    }
}
