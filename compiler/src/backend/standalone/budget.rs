//! The budget within the interval, for a run within this program: an interval in which somebody may have to let go
//! fails, so that it is gone through step by step.

use super::Writing;
use crate::backend::code::{Reason, Stmt, Value, Var};
use crate::backend::lower::writer::Writer;
use bond_runtime::energy::interval;
use bond_runtime::machine::Machine;
use bond_runtime::scene::Bar;

/// What is left must be more than this part of what there is to give: rounding must not decide otherwise than the run
/// step by step does.
const CLOSE: f64 = 1e-6;

/// What a holder has to give, as work or as heat.
type Account = (usize, bool);

/// W of an account by the bars of one continuous cluster.
pub(super) struct Drawn {
    account: Account,
    bars: Vec<usize>,
    /// W and its rate at the end of the last step, and the least until then.
    now: Var,
    rate: Var,
    least: Var,
}

impl Writing<'_> {
    /// Whether what is drawn at a bar must not be more than its holder has to give.
    fn is_guarded(&self, bar: &Bar) -> bool {
        let holder = &self.scene.clusters[bar.holder.0];
        self.full && holder.budget && holder.period.is_some()
    }

    fn account(&self, bar: &Bar) -> Account {
        let held = self.clusters[bar.holder.0].layout.held.iter().find(|p| p.port == bar.holder.1);
        (bar.holder.0, held.is_some_and(|p| p.is_thermal))
    }

    /// What a continuous cluster draws, at the start of an interval.
    pub(super) fn watch(&mut self, mut w: Writer, i: usize) -> Result<(Writer, Vec<Drawn>), String> {
        let bars = self.scene.bars.iter().enumerate();
        let guarded = bars.filter(|(_, b)| b.other.0 == i && self.is_guarded(b)).map(|(k, b)| (k, self.account(b)));
        let mut list: Vec<Drawn> = Vec::new();
        for (bar, account) in guarded.collect::<Vec<_>>() {
            match list.iter_mut().find(|d| d.account == account) {
                Some(drawn) => drawn.bars.push(bar),
                None => {
                    let [now, rate, least] = [0; 3].map(|_| w.starting(0.0));
                    list.push(Drawn { account, bars: vec![bar], now, rate, least });
                }
            }
        }
        if list.is_empty() {
            return Ok((w, list));
        }
        let t = w.kept(self.time);
        let state = self.clusters[i].state;
        w = self.flows(w, i, (t, state))?;
        for d in &list {
            let [_, rate] = self.drawn(&mut w, i, d);
            w.set(d.rate, rate);
        }
        Ok((w, list))
    }

    /// The same after a step of length `h` to `t`.
    pub(super) fn watch_step(
        &mut self,
        mut w: Writer,
        i: usize,
        list: &[Drawn],
        (t, h, state): (Value, f64, usize),
    ) -> Result<Writer, String> {
        if list.is_empty() {
            return Ok(w);
        }
        w = self.flows(w, i, (t, state))?;
        for d in list {
            let [y, g] = self.drawn(&mut w, i, d);
            let (x, f, length, so_far) = (w.get(d.now), w.get(d.rate), w.number(h), w.get(d.least));
            let (fall, rise) = (w.mul(f, length), w.mul(g, length));
            let least = self.on(&mut w, i, |m, _| {
                let least = interval::least_between(m, [x, fall, y, rise].map(|x| m.value(x)));
                bond_runtime::energy::smaller(m, m.value(so_far), least).value
            });
            w.set(d.least, least);
            w.set(d.now, y);
            w.set(d.rate, g);
        }
        Ok(w)
    }

    /// Has the cluster's ports say what goes out now.
    fn flows(&mut self, mut w: Writer, i: usize, (t, state): (Value, usize)) -> Result<Writer, String> {
        let (c, place) = (&self.scene.clusters[i], self.clusters[i].clone());
        w.keep(place.input, t);
        self.latch(&mut w, i);
        self.program(w, &c.instant, state, 0, place.input, place.seen, &c.name)
    }

    /// W by some bars of a cluster, and its rate.
    fn drawn(&self, w: &mut Writer, i: usize, d: &Drawn) -> [Value; 2] {
        let (c, place) = (&self.scene.clusters[i], &self.clusters[i]);
        let mut sums = [w.number(0.0); 2];
        for b in &d.bars {
            let port = self.scene.bars[*b].other.1;
            let held = w.kept(place.input + c.ports[port].input);
            for (sum, at) in sums.iter_mut().zip([place.moved + port, place.seen + c.ports[port].instant]) {
                let x = w.kept(at);
                let x = w.mul(held, x);
                *sum = w.add(*sum, x);
            }
        }
        sums
    }

    /// Fails where a holder may have more drawn from it in the interval than it has to give.
    pub(super) fn within_budget(&self, w: &mut Writer, list: &[Drawn]) {
        let mut accounts: Vec<Account> = list.iter().map(|d| d.account).collect();
        accounts.sort_unstable();
        accounts.dedup();
        for account in accounts {
            let mut sum = w.number(0.0);
            for d in list.iter().filter(|d| d.account == account) {
                let least = w.get(d.least);
                sum = w.add(sum, least);
            }
            self.require_left(w, account, sum);
        }
    }

    /// Fails where an account has no more left than is close to nothing, after so much went in.
    fn require_left(&self, w: &mut Writer, (holder, is_heat): Account, went_in: Value) {
        let room = self.on(w, holder, |m, block| {
            let zero = Machine::number(m, 0.0);
            let rooms = interval::rooms(m, block, &self.clusters[holder].layout, [zero; 2]);
            rooms[usize::from(is_heat)].value
        });
        let part = w.number(1.0 - CLOSE);
        let room = w.mul(part, room);
        let left = w.add(went_in, room);
        let zero = w.number(0.0);
        let short = w.lt(left, zero);
        // Whoever runs it takes any reason for the same.
        w.when(short, |w| w.push(Stmt::Fail(Reason::NotFinite)));
    }

    /// Fails where a cluster that exchanges with other sampled ones gave more than it had to give.
    pub(super) fn within_all_budgets(&self, w: &mut Writer, i: usize) {
        let is_sampled = |i: usize| self.scene.clusters[i].period.is_some();
        let exchanges = |b: &Bar| (b.holder.0 == i || b.other.0 == i) && is_sampled(b.other.0);
        if !(self.full && self.scene.clusters[i].budget && self.scene.bars.iter().any(exchanges)) {
            return;
        }
        let short = self.on(w, i, |m, block| interval::is_short(m, block, &self.clusters[i].layout));
        w.when(short, |w| w.push(Stmt::Fail(Reason::NotFinite)));
    }
}
