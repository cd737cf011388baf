//! The partition of regions and signal states into clusters, which step as one.

use crate::discretise::cluster::{Carries, Cluster, Integral, Line, State};
use crate::discretise::delays::Spread;
use crate::expression::{Expr, Pool, Symbol};
use crate::graph::RegionId;
use crate::model::{Delayed, Model, Signal};
use crate::structure::{ColumnId, Form, Role};
use rustc_hash::{FxHashMap, FxHashSet};

/// What is never torn apart: a region, a signal state of continuous time, or all signal states of a sampled block.
#[derive(Default)]
struct Block {
    sampling: Option<usize>,
    region: Option<usize>,
    memories: Vec<usize>,
    integrals: Vec<usize>,
    delays: Vec<usize>,
}

/// The blocks: regions first, then signal states.
fn blocks(model: &Model, form: &Form) -> Vec<Block> {
    let regions = form.regions.iter().enumerate();
    let mut blocks: Vec<Block> =
        regions.map(|(i, r)| Block { sampling: r.sampling, region: Some(i), ..Block::default() }).collect();
    let mut of_sampling: FxHashMap<usize, usize> = FxHashMap::default();
    for (i, m) in model.memories.iter().enumerate() {
        match m.sampling.and_then(|s| of_sampling.get(&s)) {
            Some(at) => blocks[*at].memories.push(i),
            None => {
                of_sampling.extend(m.sampling.map(|s| (s, blocks.len())));
                blocks.push(Block { sampling: m.sampling, memories: vec![i], ..Block::default() });
            }
        }
    }
    blocks
}

/// All signals that a block reads, integrals apart; `columns` are those of each region.
fn reads(pool: &Pool, form: &Form, (columns, loops): (&[Vec<usize>], &[Vec<usize>]), block: &Block) -> Vec<Symbol> {
    let mut read: Vec<Expr> = block.memories.iter().map(|m| form.memories[*m]).collect();
    if let Some(i) = block.region {
        for (_, how) in &form.regions[i].resistors {
            read.extend(how.expressions());
        }
        read.extend(loops[i].iter().map(|l| form.loops[*l].value));
        for c in columns[i].iter().map(|c| &form.columns[*c]) {
            read.extend(c.row.iter().map(|t| t.1));
            if let Role::Source(v) = c.role {
                read.push(v);
            }
        }
    }
    read.into_iter().flat_map(|e| pool.symbols(e)).collect()
}

/// Ports that regions which hold together have at most: each of them answers to each.
const TOGETHER: usize = 12;

/// Regions that hold for other sampled ones of their period: such a sample is taken in an order, what answers first.
struct Ranks {
    /// By region, those that it holds for.
    held: FxHashMap<usize, Vec<usize>>,
    /// By the first of a set, its regions, where they are several.
    members: FxHashMap<usize, Vec<usize>>,
}

impl Ranks {
    fn new(model: &Model, form: &Form, bars: &[(usize, usize)]) -> Self {
        let period = |i: usize| form.regions[i].sampling.map(|s| model.samplings[s].period);
        let mut held: FxHashMap<usize, Vec<usize>> = FxHashMap::default();
        for &(holder, other) in bars.iter().filter(|b| period(b.1).is_some() && period(b.0) == period(b.1)) {
            held.entry(holder).or_default().push(other);
        }
        Self { held, members: FxHashMap::default() }
    }

    /// Whether one region waits for another, over however many: together they would wait for what waits for them.
    fn waits(&self, sets: &petgraph::unionfind::UnionFind<usize>, i: usize, j: usize) -> bool {
        let (mut seen, mut left) = (FxHashSet::default(), vec![sets.find(i)]);
        while let Some(set) = left.pop() {
            let alone = [set];
            for member in self.members.get(&set).map_or(&alone[..], Vec::as_slice) {
                for other in self.held.get(member).into_iter().flatten() {
                    let next = sets.find(*other);
                    if next == sets.find(j) {
                        return true;
                    }
                    if seen.insert(next) {
                        left.push(next);
                    }
                }
            }
        }
        false
    }

    /// Has two step as one.
    fn join(&mut self, sets: &mut petgraph::unionfind::UnionFind<usize>, i: usize, j: usize) {
        let [a, b] = [i, j].map(|i| sets.find(i));
        if !sets.union(i, j) {
            return;
        }
        let [mut all, more] = [a, b].map(|set| self.members.remove(&set).unwrap_or_else(|| vec![set]));
        all.extend(more);
        self.members.insert(sets.find(i), all);
    }
}

/// Sampled regions that hold for the same cluster at the same instants and in the same way: what one holds is part of
/// what the others are answered, so that they find it together. Not by the construction along a line, which is of one
/// level set; not where one waits for the other at a sample, or `reads` its signals there, or the outside is held for
/// too.
fn hold_together(
    model: &Model,
    form: &Form,
    reads: &FxHashSet<(usize, usize)>,
    sets: &mut petgraph::unionfind::UnionFind<usize>,
) {
    let region = |c: ColumnId| form.column(c).region.at();
    let mut bars: Vec<(usize, usize)> = form.bars.iter().map(|b| (region(b.holder), region(b.held))).collect();
    bars.sort_unstable();
    let is_open = |c: &&crate::structure::Column| matches!(c.role, Role::Open(_));
    let open: FxHashSet<usize> = form.columns.iter().filter(is_open).map(|c| c.region.at()).collect();
    let alone = |i: &usize| {
        let ray = form.regions[*i].sampling.is_some_and(|s| model.samplings[s].method.as_deref() == Some("ray"));
        ray || open.contains(i)
    };
    let mut ranks = Ranks::new(model, form, &bars);
    let mut ports: FxHashMap<usize, usize> = FxHashMap::default();
    bars.iter().for_each(|b| *ports.entry(b.0).or_default() += 1);
    let alike = |i: usize, j: usize| {
        let way = |i: usize| {
            let s = &model.samplings[form.regions[i].sampling?];
            Some((s.period, s.hold, s.budget, &s.method))
        };
        way(i).is_some() && way(i) == way(j)
    };
    // By what they hold for, the regions that do so far, and how many ports they have.
    let mut groups: Vec<(usize, Vec<usize>, usize)> = Vec::new();
    for &(holder, other) in &bars {
        let (root, more) = (sets.find(other), ports[&holder]);
        if more > TOGETHER || alone(&holder) {
            continue;
        }
        let joined = |i: usize, j: usize| {
            let bound = |i: usize, j: usize| reads.contains(&(i, j)) || ranks.waits(sets, i, j);
            bound(i, j) || bound(j, i)
        };
        let fits = |(of, members, count): &&mut (usize, Vec<usize>, usize)| {
            *of == root
                && (members.contains(&holder) || count + more <= TOGETHER)
                && members.iter().all(|m| *m == holder || alike(*m, holder) && !joined(*m, holder))
        };
        match groups.iter_mut().find(fits) {
            Some((_, members, _)) if members.contains(&holder) => {}
            Some((_, members, count)) => {
                // Who holds for several may be with others already.
                let (own, theirs) = (sets.find(holder), sets.find(members[0]));
                if own == holder || own == theirs {
                    ranks.join(sets, members[0], holder);
                    members.push(holder);
                    *count += more;
                }
            }
            None => groups.push((root, vec![holder], more)),
        }
    }
}

/// Gives each delay to a block, and says what it reads there: a sampled one to that of its signal state, another to the
/// first continuous block that its signal reads, or else to the first that there is. A sampled one by a single period
/// is its signal state.
fn place_delays(
    model: &Model,
    (form, spread): (&Form, &[Spread]),
    pool: &Pool,
    blocks: &mut Vec<Block>,
    owner: &mut FxHashMap<Symbol, usize>,
) -> Vec<(usize, Vec<Symbol>)> {
    let mut list = Vec::new();
    for (i, (d, signal)) in model.delays.iter().zip(&form.delays).enumerate().filter(|(_, (d, _))| !d.is_state()) {
        let read = pool.symbols(*signal);
        let fits = |b: &usize| d.periods.is_some() || blocks[*b].sampling.is_none();
        let home = read.iter().filter_map(|s| owner.get(s).copied()).find(fits);
        let home = home.or_else(|| (0..blocks.len()).find(|b| blocks[*b].sampling.is_none()));
        let home = home.unwrap_or_else(|| {
            blocks.push(Block::default());
            blocks.len() - 1
        });
        owner.extend(spread[i].0.iter().copied().chain([d.symbol]).map(|s| (s, home)));
        blocks[home].delays.push(i);
        list.push((home, read));
    }
    list
}

/// A delay of a cluster with these states.
fn line(
    model: &Model,
    (form, spread): (&Form, &[Spread]),
    pool: &Pool,
    (k, states): (usize, &[State]),
) -> Option<Line> {
    let (d, signal) = (&model.delays[k], form.delays[k]);
    let carries = match d.periods {
        Some(_) if d.of == Delayed::Leaving => Carries::Leaving(signal),
        Some(n) if d.of == Delayed::Wave => Carries::Wave(signal, n),
        Some(n) => Carries::State(states.iter().position(|s| pool.symbols(signal) == [s.symbol])?, n),
        None => Carries::Signal(signal, d.time),
    };
    let (coefficients, value) = spread[k].clone();
    Some(Line { symbol: d.symbol, name: d.name.clone(), coefficients, value, start: d.start, carries })
}

/// All clusters: sampled regions alone, or with those that hold for the same one at the same instants; continuous ones
/// with those whose signals they read or that read theirs. `apart`: whether none hold together.
pub(crate) fn partition(model: &mut Model, (form, spread): (&Form, &[Spread]), apart: bool) -> Vec<Cluster> {
    let mut blocks = blocks(model, form);
    let mut owner: FxHashMap<Symbol, usize> = FxHashMap::default();
    for (i, r) in form.regions.iter().enumerate() {
        owner.extend(r.states.iter().map(|s| (s.symbol, i)));
    }
    owner.extend(form.columns.iter().map(|c| (c.out, c.region.at())));
    owner.extend(form.loops.iter().map(|l| (l.unknown, l.region.at())));
    for (i, a) in blocks.iter().enumerate() {
        owner.extend(a.memories.iter().map(|m| (model.memories[*m].symbol, i)));
    }
    let mut pool = std::mem::take(&mut model.pool);
    let mut columns: Vec<Vec<usize>> = vec![Vec::new(); form.regions.len()];
    for (i, c) in form.columns.iter().enumerate() {
        columns[c.region.at()].push(i);
    }
    let mut loops: Vec<Vec<usize>> = vec![Vec::new(); form.regions.len()];
    for (i, l) in form.loops.iter().enumerate() {
        loops[l.region.at()].push(i);
    }
    let read_by: Vec<Vec<Symbol>> = blocks.iter().map(|a| reads(&pool, form, (&columns, &loops), a)).collect();
    // An integral belongs with the continuous block that it reads, or the one sampled region whose variables are all
    // that it reads; what else samples hold is integrated as it is held.
    let flowing = |s: &Symbol| matches!(model.signals.get(s), Some(Signal::Time | Signal::Input(_) | Signal::Slope(_)));
    let mut homes: Vec<usize> = Vec::new();
    for (integral, e) in model.integrals.iter().zip(&form.integrals) {
        let continuous = |i: &usize| blocks[*i].sampling.is_none();
        let symbols = pool.symbols(*e);
        let mut read: Vec<usize> = symbols.iter().filter_map(|s| owner.get(s).copied()).collect();
        read.sort_unstable();
        read.dedup();
        let home = match read[..] {
            [one] if blocks[one].region.is_some() && !symbols.iter().any(flowing) => Some(one),
            _ => read.iter().copied().find(continuous).or_else(|| (0..blocks.len()).find(continuous)),
        };
        let home = home.unwrap_or_else(|| {
            blocks.push(Block::default());
            blocks.len() - 1
        });
        owner.insert(integral.symbol, home);
        homes.push(home);
    }
    for (i, &home) in homes.iter().enumerate() {
        blocks[home].integrals.push(i);
    }
    let of_delays = place_delays(model, (form, spread), &pool, &mut blocks, &mut owner);
    let mut sets = petgraph::unionfind::UnionFind::<usize>::new(blocks.len());
    let mut solved: FxHashSet<Symbol> = FxHashSet::default();
    let mut reads: FxHashSet<(usize, usize)> = FxHashSet::default();
    let of_integrals = homes.iter().zip(&form.integrals).map(|(home, e)| (*home, pool.symbols(*e)));
    for (i, read) in read_by.into_iter().enumerate().chain(of_integrals).chain(of_delays) {
        for s in read {
            let Some(&j) = owner.get(&s) else { continue };
            solved.insert(s);
            reads.insert((i, j));
            if blocks[i].sampling.is_none() && blocks[j].sampling.is_none() {
                sets.union(i, j);
            }
        }
    }
    if !apart {
        hold_together(model, form, &reads, &mut sets);
    }
    let mut clusters: Vec<Cluster> = Vec::new();
    let mut cluster_of: FxHashMap<usize, usize> = FxHashMap::default();
    for (i, block) in blocks.iter().enumerate() {
        let at = *cluster_of.entry(sets.find(i)).or_insert(clusters.len());
        if at == clusters.len() {
            clusters.push(Cluster { sampling: block.sampling, ..Cluster::default() });
        }
        let c = &mut clusters[at];
        if let Some(region) = block.region {
            c.regions.push(RegionId(region as u32));
            c.add(&mut pool, form, region, &loops[region]);
        }
    }
    for (i, block) in blocks.iter().enumerate() {
        let Some(c) = cluster_of.get(&sets.find(i)).and_then(|at| clusters.get_mut(*at)) else { continue };
        for &m in &block.memories {
            let (m, rate) = (&model.memories[m], form.memories[m]);
            let (symbol, name) = (m.symbol, m.name.clone());
            c.states.push(State { symbol, name, column: None, initial: m.start, rate, jumps: m.sampling.is_some() });
        }
        block.delays.iter().for_each(|k| c.lines.extend(line(model, (form, spread), &pool, (*k, &c.states))));
        for &k in &block.integrals {
            let (integral, rate) = (&model.integrals[k], form.integrals[k]);
            let (symbol, start) = (integral.symbol, integral.start);
            // One that something else reads is solved with it.
            if solved.contains(&symbol) {
                let name = pool.name(symbol).to_string();
                c.states.push(State { symbol, name, column: None, initial: start, rate, jumps: false });
            } else {
                c.integrals.push(Integral { symbol, rate, start });
            }
        }
    }
    let time = model.signals.iter().find(|(_, s)| **s == Signal::Time).map(|s| *s.0);
    for c in &mut clusters {
        c.time = Some(time.unwrap_or_else(|| pool.symbol("t")));
        c.h = Some(pool.symbol("h"));
        c.delta = c.states.iter().map(|s| pool.symbol(&format!("d({})", s.name))).collect();
        c.blt_sort(&mut pool);
    }
    model.pool = pool;
    for c in &mut clusters {
        c.find_foreign(model, form);
    }
    clusters
}
