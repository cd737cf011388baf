//! A cell of a grid for each node: most bonds run level or upright to the next cell, no bond runs through a node, few
//! cross, and what stands in one box is apart from the rest. Nodes move to better cells one by one, in rounds, as in
//! Freivalds and Glagolevs (2014), "Graph compact orthogonal layout algorithm".

use super::diagram::Diagram;
use super::stress;
use rustc_hash::FxHashMap;

/// A column and a row.
pub(crate) type Cell = [i32; 2];

/// What a drawing costs, in lengths of a bond to the next cell.
struct Costs {
    /// A cell of height; a column is wider than a row is high.
    row: f64,
    /// A bond that is neither level nor upright.
    slanted: f64,
    /// A bond that runs through a node.
    through: f64,
    /// Two bonds that cross.
    crossing: f64,
    /// Two bonds of one node with a small angle between them.
    narrow: f64,
    /// A node in a box that is not its own.
    foreign: f64,
    /// A way that leads through a node, but not straight.
    bend: f64,
    /// A cell of a signal's length.
    signal: f64,
}

const COSTS: Costs =
    Costs { row: 0.85, slanted: 1.0, through: 7.0, crossing: 4.0, narrow: 3.0, foreign: 6.0, bend: 0.8, signal: 0.35 };

/// Half of what a label takes of a cell's width and height.
const LABEL: [f64; 2] = [0.42, 0.22];

/// Rounds over all nodes, and the pairs of lines that they look at, at most.
const ROUNDS: usize = 60;
/// See [`ROUNDS`].
const PAIRS: usize = 100_000_000;

struct Line {
    ends: [usize; 2],
    /// Whether it is a bond, and no signal.
    is_bond: bool,
}

struct Board<'a> {
    diagram: &'a Diagram,
    lines: Vec<Line>,
    of: Vec<Vec<usize>>,
    at: Vec<Cell>,
    taken: FxHashMap<Cell, usize>,
    /// The boxes of each node, from the innermost.
    groups: Vec<Vec<usize>>,
    members: Vec<Vec<usize>>,
    /// The outermost corners of each box.
    bounds: Vec<[i32; 4]>,
}

/// The cells of all nodes, from 0 on.
pub(crate) fn place(diagram: &Diagram) -> Vec<Cell> {
    let n = diagram.nodes.len();
    if n == 0 {
        return Vec::new();
    }
    let mut board = Board::new(diagram);
    if board.begin_chain() {
        board.improve(ROUNDS, 0.0, 0);
        board.compact();
        return board.at;
    }
    board.begin();
    let work = board.lines.len().max(1) * n * 40;
    let rounds = (PAIRS / work).clamp(3, ROUNDS);
    let start: Vec<(usize, Cell)> = board.at.iter().copied().enumerate().collect();
    let all: Vec<usize> = (0..n).collect();
    let mut best: Option<(f64, Vec<Cell>)> = None;
    let trials = (PAIRS / (work * rounds)).clamp(1, TRIALS.len());
    for (seed, heat) in TRIALS[..trials].iter().enumerate() {
        board.put(&start);
        board.improve(rounds, *heat, seed as u64);
        board.compact();
        board.improve(rounds / 3 + 2, 0.0, 0);
        board.compact();
        let cost = board.total(&all);
        if best.as_ref().is_none_or(|b| cost < b.0 - 1e-9) {
            best = Some((cost, board.at.clone()));
        }
    }
    if let Some((_, at)) = best {
        board.put(&at.into_iter().enumerate().collect::<Vec<_>>());
    }
    board.fold();
    board.compact();
    board.at
}

/// How much noise each trial begins with: the first ones keep to the first places.
const TRIALS: [f64; 6] = [0.6, 1.2, 1.2, 2.0, 3.0, 4.0];

impl<'a> Board<'a> {
    fn new(diagram: &'a Diagram) -> Self {
        let n = diagram.nodes.len();
        let mut of = vec![Vec::new(); n];
        let mut lines = Vec::new();
        for l in &diagram.links {
            of[l.tail].push(lines.len());
            of[l.head].push(lines.len());
            lines.push(Line { ends: [l.tail, l.head], is_bond: l.bonds.is_some() });
        }
        let mut members = vec![Vec::new(); diagram.groups.len()];
        let groups: Vec<Vec<usize>> = diagram
            .nodes
            .iter()
            .map(|node| std::iter::successors(node.group, |g| diagram.groups[*g].parent).collect())
            .collect();
        for (i, list) in groups.iter().enumerate() {
            list.iter().for_each(|g: &usize| members[*g].push(i));
        }
        let bounds = vec![[0; 4]; members.len()];
        Board { diagram, lines, of, at: vec![[0, 0]; n], taken: FxHashMap::default(), groups, members, bounds }
    }

    /// Cells near the places of the least stress, junctions first.
    fn begin(&mut self) {
        let n = self.at.len();
        let bonded: Vec<bool> = self.of.iter().map(|l| l.iter().any(|l| self.lines[*l].is_bond)).collect();
        let mut edges = Vec::new();
        for (link, line) in self.diagram.links.iter().zip(&self.lines) {
            let [a, b] = line.ends;
            let border = if self.groups[a] == self.groups[b] { 0.0 } else { 1.0 };
            match &link.bonds {
                Some(bonds) => edges.push((a, b, 1.0 + if bonds.sampled { 1.0 } else { border })),
                // Signals hold those alone that no bond holds.
                None if !(bonded[a] && bonded[b]) => edges.push((a, b, 1.5)),
                None => {}
            }
        }
        let x = stress::place(n, &edges);
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by_key(|i| std::cmp::Reverse(self.of[*i].len()));
        for i in order {
            let want = [(x[i][0] * 1.15).round() as i32, (x[i][1] * 1.15).round() as i32];
            let mut cell = want;
            'search: for radius in 0..=n as i32 {
                let mut best = f64::MAX;
                for dx in -radius..=radius {
                    for dy in -radius..=radius {
                        let c = [want[0] + dx, want[1] + dy];
                        if dx.abs().max(dy.abs()) != radius || self.taken.contains_key(&c) {
                            continue;
                        }
                        let off = libm::hypot(f64::from(c[0]) - 1.15 * x[i][0], f64::from(c[1]) - 1.15 * x[i][1]);
                        if off < best - 1e-9 {
                            (best, cell) = (off, c);
                        }
                    }
                }
                if best < f64::MAX {
                    break 'search;
                }
            }
            self.at[i] = cell;
            self.taken.insert(cell, i);
        }
        (0..self.members.len()).for_each(|g| self.bound(g));
    }

    /// Whether without its leaves the graph is a long chain: then it is laid in rows, each read against the one above
    /// it, with the leaves above and below.
    fn begin_chain(&mut self) -> bool {
        let n = self.at.len();
        let near: Vec<Vec<usize>> = (0..n)
            .map(|i| {
                let ends = self.of[i].iter().map(|l| self.lines[*l].ends);
                let mut all: Vec<usize> = ends.map(|e| e[usize::from(e[0] == i)]).collect();
                all.sort_unstable();
                all.dedup();
                all
            })
            .collect();
        let core: Vec<Vec<usize>> =
            near.iter().map(|list| list.iter().copied().filter(|j| near[*j].len() > 1).collect()).collect();
        let inner: Vec<usize> = (0..n).filter(|i| near[*i].len() > 1).collect();
        let ends: Vec<usize> = inner.iter().copied().filter(|i| core[*i].len() == 1).collect();
        if inner.len() < CHAIN || ends.len() != 2 || inner.iter().any(|i| core[*i].len() > 2) {
            return false;
        }
        let (mut chain, mut before) = (vec![ends[0]], usize::MAX);
        while let Some(next) = core[chain[chain.len() - 1]].iter().copied().find(|j| *j != before) {
            before = chain[chain.len() - 1];
            chain.push(next);
        }
        if chain.len() != inner.len() || !self.members.is_empty() {
            return false;
        }
        // A row of a chain takes three rows of the grid, and a column is about 1.5 times as wide as a row is high.
        let rows = (chain.len() as f64 / 3.6).sqrt().max(1.0) as usize;
        let width = chain.len().div_ceil(rows) as i32;
        let cell = |k: usize| {
            let (row, along) = (k as i32 / width, k as i32 % width);
            [if row % 2 == 0 { along } else { width - 1 - along }, 3 * row]
        };
        for (k, &i) in chain.iter().enumerate() {
            self.at[i] = cell(k);
            self.taken.insert(cell(k), i);
        }
        for (k, &i) in chain.iter().enumerate() {
            let c = cell(k);
            let (first, last) = (k as i32 % width == 0 && k > 0, (k as i32 + 1) % width == 0 && k + 1 < chain.len());
            let out = if c[0] == 0 { [-1, 0] } else { [1, 0] };
            let (up, down) = ([0, -1], [0, 1]);
            let mut sides = match (first, last) {
                (true, _) => vec![down, out],
                (_, true) => vec![up, out],
                _ if k == 0 => vec![[-1, 0], up, down],
                _ if k + 1 == chain.len() => vec![if k as i32 / width % 2 == 0 { [1, 0] } else { [-1, 0] }, down, up],
                _ if k % 2 == 0 => vec![up, down],
                _ => vec![down, up],
            };
            sides.extend([[-1, -1], [1, 1], [-1, 1], [1, -1], [-2, -1], [2, 1], [-2, 1], [2, -1]]);
            for &leaf in near[i].iter().filter(|j| near[**j].len() == 1) {
                let free = sides.iter().map(|d| [c[0] + d[0], c[1] + d[1]]).find(|p| !self.taken.contains_key(p));
                let spare = [c[0], 3 * chain.len() as i32 + leaf as i32];
                self.at[leaf] = free.unwrap_or(spare);
                self.taken.insert(self.at[leaf], leaf);
            }
        }
        // What nothing joins stands below.
        for i in (0..n).filter(|i| near[*i].is_empty()) {
            self.at[i] = [i as i32, 3 * rows as i32 + 3];
            self.taken.insert(self.at[i], i);
        }
        true
    }

    fn bound(&mut self, g: usize) {
        let mut b = [i32::MAX, i32::MAX, i32::MIN, i32::MIN];
        for &i in &self.members[g] {
            for k in 0..2 {
                b[k] = b[k].min(self.at[i][k]);
                b[k + 2] = b[k + 2].max(self.at[i][k]);
            }
        }
        self.bounds[g] = b;
    }

    fn put(&mut self, moves: &[(usize, Cell)]) {
        for (i, _) in moves {
            if self.taken.get(&self.at[*i]) == Some(i) {
                self.taken.remove(&self.at[*i]);
            }
        }
        for (i, cell) in moves {
            self.at[*i] = *cell;
            self.taken.insert(*cell, *i);
        }
        for (i, _) in moves {
            for k in 0..self.groups[*i].len() {
                self.bound(self.groups[*i][k]);
            }
        }
    }

    /// What a node costs where it is.
    fn cost(&self, i: usize) -> f64 {
        let mut cost = 0.0;
        for &l in &self.of[i] {
            cost += self.line_cost(l, i);
        }
        cost += self.bend(i);
        for &l in &self.of[i] {
            let ends = self.lines[l].ends;
            cost += self.bend(ends[usize::from(ends[0] == i)]);
        }
        let p = self.at[i];
        for line in self.lines.iter().filter(|l| l.is_bond && !l.ends.contains(&i)) {
            let [a, b] = line.ends.map(|e| self.at[e]);
            if runs_through(a, b, p) {
                cost += COSTS.through;
            }
        }
        for (g, b) in self.bounds.iter().enumerate() {
            if self.groups[i].contains(&g) {
                let inside = |j: &usize| !self.groups[*j].contains(&g) && within(*b, self.at[*j]);
                cost += COSTS.foreign * (0..self.at.len()).filter(inside).count() as f64;
            } else if within(*b, p) {
                cost += COSTS.foreign;
            }
        }
        cost
    }

    /// What it costs that no way leads straight through a node: between neighbours that others hang at.
    fn bend(&self, i: usize) -> f64 {
        let p = self.at[i];
        let mut ways: Vec<[i32; 2]> = Vec::new();
        for &l in &self.of[i] {
            let ends = self.lines[l].ends;
            let j = ends[usize::from(ends[0] == i)];
            if self.lines[l].is_bond && self.of[j].len() > 1 {
                let q = self.at[j];
                ways.push([
                    (q[0] - p[0]).signum() * i32::from(q[1] == p[1]),
                    (q[1] - p[1]).signum() * i32::from(q[0] == p[0]),
                ]);
            }
        }
        let straight = |a: &[i32; 2]| *a != [0, 0] && ways.contains(&[-a[0], -a[1]]);
        if ways.len() < 2 || ways.iter().any(straight) { 0.0 } else { COSTS.bend }
    }

    /// What a line of a node costs.
    fn line_cost(&self, l: usize, i: usize) -> f64 {
        let line = &self.lines[l];
        let [a, b] = line.ends.map(|e| self.at[e]);
        let (dx, dy) = (f64::from((a[0] - b[0]).abs()), f64::from((a[1] - b[1]).abs()));
        let length = dx + COSTS.row * dy;
        if !line.is_bond {
            return COSTS.signal * length;
        }
        let slanted = dx > 0.0 && dy > 0.0;
        let mut cost = length + 0.3 * (length - 1.0).max(0.0);
        if slanted {
            cost += COSTS.slanted + if dx > 1.0 || dy > 1.0 { 0.6 } else { 0.0 };
        }
        // Who stands in between.
        let (low, high) = ([a[0].min(b[0]), a[1].min(b[1])], [a[0].max(b[0]), a[1].max(b[1])]);
        if dx + dy > 1.0 {
            let cells = (i64::from(high[0] - low[0]) + 1) * (i64::from(high[1] - low[1]) + 1);
            if cells <= 2 * self.at.len() as i64 {
                for x in low[0]..=high[0] {
                    for y in low[1]..=high[1] {
                        let hit = self.taken.get(&[x, y]).is_some_and(|j| !line.ends.contains(j));
                        if hit && runs_through(a, b, [x, y]) {
                            cost += COSTS.through;
                        }
                    }
                }
            } else {
                cost += COSTS.through;
            }
        }
        for (k, other) in self.lines.iter().enumerate() {
            if k == l || !other.is_bond {
                continue;
            }
            let [c, d] = other.ends.map(|e| self.at[e]);
            if c[0].max(d[0]) < low[0]
                || c[0].min(d[0]) > high[0]
                || c[1].max(d[1]) < low[1]
                || c[1].min(d[1]) > high[1]
            {
                continue;
            }
            let shared = line.ends.iter().find(|e| other.ends.contains(e));
            match shared {
                Some(s) if *s == i || line.ends.contains(s) => {
                    let p = self.at[*s];
                    let far = |ends: [usize; 2]| self.at[if ends[0] == *s { ends[1] } else { ends[0] }];
                    if is_narrow(p, far(line.ends), far(other.ends)) {
                        cost += COSTS.narrow;
                    }
                }
                _ => {
                    if cross(a, b, c, d) {
                        cost += COSTS.crossing;
                    }
                }
            }
        }
        cost
    }

    fn total(&self, moved: &[usize]) -> f64 {
        moved.iter().map(|i| self.cost(*i)).sum()
    }

    /// Tries moves; keeps the one that is the best by more than the noise.
    fn best(&mut self, options: &[Vec<(usize, Cell)>], noise: &mut dyn FnMut() -> f64) -> bool {
        let mut best: Option<(f64, usize)> = None;
        for (k, moves) in options.iter().enumerate() {
            let moved: Vec<usize> = moves.iter().map(|m| m.0).collect();
            let back: Vec<(usize, Cell)> = moved.iter().map(|i| (*i, self.at[*i])).collect();
            let before = self.total(&moved);
            self.put(moves);
            let gain = before - self.total(&moved) + noise();
            self.put(&back);
            if gain > 1e-9 && best.is_none_or(|b| gain > b.0 + 1e-9) {
                best = Some((gain, k));
            }
        }
        if let Some((_, k)) = best {
            self.put(&options[k]);
        }
        best.is_some()
    }

    fn improve(&mut self, rounds: usize, heat: f64, seed: u64) {
        let n = self.at.len();
        let mut seed = 0x9e37_79b9_7f4a_7c15u64 ^ (seed << 20);
        let mut random = move || {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        for round in 0..rounds {
            // Cooled to nothing by two thirds of the rounds.
            let t = heat * (1.0 - 1.5 * round as f64 / rounds as f64).max(0.0);
            let mut noise = || if t > 0.0 { t * (random() - 0.75) } else { 0.0 };
            let mut any = false;
            for i in 0..n {
                let options = self.options(i);
                any |= self.best(&options, &mut noise);
                let leaves = self.leaves(i);
                if self.of[i].len() > 1 && !leaves.is_empty() {
                    let options = self.shifts(i, leaves);
                    any |= self.best(&options, &mut noise);
                }
            }
            for g in 0..self.members.len() {
                let rest = self.members[g].clone();
                if rest.len() < 2 || rest.len() * n > 20_000 {
                    continue;
                }
                let options = self.shifts(rest[0], rest[1..].to_vec());
                any |= self.best(&options, &mut noise);
            }
            if !any && t == 0.0 {
                break;
            }
        }
    }

    /// The nodes that hang at a node alone.
    fn leaves(&self, i: usize) -> Vec<usize> {
        let other = |l: &usize| self.lines[*l].ends[usize::from(self.lines[*l].ends[0] == i)];
        let mut all: Vec<usize> = self.of[i].iter().map(other).filter(|j| self.of[*j].len() == 1).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// A node with others, moved by a cell or two.
    fn shifts(&self, i: usize, with: Vec<usize>) -> Vec<Vec<(usize, Cell)>> {
        let mut all = with;
        all.push(i);
        let mut options = Vec::new();
        for d in
            [[1, 0], [-1, 0], [0, 1], [0, -1], [2, 0], [-2, 0], [0, 2], [0, -2], [1, 1], [-1, 1], [1, -1], [-1, -1]]
        {
            let to = |j: &usize| [self.at[*j][0] + d[0], self.at[*j][1] + d[1]];
            let free = |j: &usize| self.taken.get(&to(j)).is_none_or(|k| all.contains(k));
            if all.iter().all(free) {
                options.push(all.iter().map(|j| (*j, to(j))).collect());
            }
        }
        // Turned about, so that what hangs above hangs below.
        let p = self.at[i];
        for k in 0..2 {
            let to = |j: &usize| {
                let mut c = self.at[*j];
                c[k] = 2 * p[k] - c[k];
                c
            };
            if all.iter().all(|j| self.taken.get(&to(j)).is_none_or(|k| all.contains(k))) {
                options.push(all.iter().map(|j| (*j, to(j))).collect());
            }
        }
        options
    }

    /// Cells for a node: near where it is, and near its neighbours. One that is taken is changed with.
    fn options(&self, i: usize) -> Vec<Vec<(usize, Cell)>> {
        let p = self.at[i];
        let mut cells: Vec<Cell> = Vec::new();
        let mut near = |c: Cell, reach: &[[i32; 2]]| {
            for d in reach {
                let cell = [c[0] + d[0], c[1] + d[1]];
                if cell != p && !cells.contains(&cell) {
                    cells.push(cell);
                }
            }
        };
        const RING: [[i32; 2]; 8] = [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, 1], [1, -1], [-1, -1]];
        const FAR: [[i32; 2]; 4] = [[2, 0], [-2, 0], [0, 2], [0, -2]];
        near(p, &RING);
        let mut middle = [0, 0];
        for l in &self.of[i] {
            let ends = self.lines[*l].ends;
            let q = self.at[ends[usize::from(ends[0] == i)]];
            near(q, &RING);
            near(q, &FAR);
            middle = [middle[0] + q[0], middle[1] + q[1]];
        }
        let count = self.of[i].len() as i32;
        if count > 1 {
            near([middle[0].div_euclid(count), middle[1].div_euclid(count)], &[[0, 0], [1, 0], [0, 1], [1, 1]]);
        }
        let of = |c: Cell| match self.taken.get(&c) {
            Some(&j) => vec![(i, c), (j, p)],
            None => vec![(i, c)],
        };
        cells.into_iter().map(of).collect()
    }

    /// Takes out empty columns and rows, and moves halves together where that costs nothing.
    fn compact(&mut self) {
        let n = self.at.len();
        for k in 0..2 {
            let mut used: Vec<i32> = self.at.iter().map(|c| c[k]).collect();
            used.sort_unstable();
            used.dedup();
            let moves: Vec<(usize, Cell)> = (0..n)
                .map(|i| {
                    let mut c = self.at[i];
                    c[k] = used.partition_point(|u| *u < c[k]) as i32;
                    (i, c)
                })
                .collect();
            self.put(&moves);
        }
        if n > 200 {
            return;
        }
        let all: Vec<usize> = (0..n).collect();
        for k in 0..2 {
            let mut line = 1;
            while self.at.iter().any(|c| c[k] >= line) {
                let back: Vec<(usize, Cell)> = all.iter().map(|i| (*i, self.at[*i])).collect();
                let moves: Vec<(usize, Cell)> = back
                    .iter()
                    .map(|(i, c)| {
                        let mut c = *c;
                        c[k] -= i32::from(c[k] >= line);
                        (*i, c)
                    })
                    .collect();
                let mut cells: Vec<Cell> = moves.iter().map(|m| m.1).collect();
                cells.sort_unstable();
                cells.dedup();
                if cells.len() == n {
                    let before = self.total(&all);
                    self.put(&moves);
                    if self.total(&all) < before {
                        continue;
                    }
                    self.put(&back);
                }
                line += 1;
            }
        }
    }

    /// Folds a long strip into rows, each read against the one above it.
    fn fold(&mut self) {
        let size = |k: usize, at: &[Cell]| at.iter().map(|c| c[k]).max().map_or(1, |m| m + 1);
        let (columns, rows) = (size(0, &self.at), size(1, &self.at));
        // A cell is about twice as wide as high.
        let bands = (f64::from(2 * columns) / (1.8 * f64::from(rows + 1))).sqrt().round() as i32;
        if columns < FOLD || bands < 2 {
            return;
        }
        let cut = |c: i32| {
            let over = |l: &&Line| {
                let [a, b] = l.ends.map(|e| self.at[e][0]);
                (a < c) != (b < c)
            };
            self.lines.iter().filter(over).count()
        };
        let (mut cuts, width) = (vec![0], columns / bands);
        for band in 1..bands {
            let about = band * columns / bands;
            let best = (about - width / 5..=about + width / 5).min_by_key(|c| (cut(*c), (c - about).abs()));
            cuts.extend(best.filter(|c| *c > cuts[cuts.len() - 1]));
        }
        cuts.push(columns);
        let widest = cuts.windows(2).map(|w| w[1] - w[0]).max().unwrap_or(0);
        let to = |c: Cell| {
            let band = cuts.partition_point(|x| *x <= c[0]).saturating_sub(1);
            let along = c[0] - cuts[band];
            // The end of a row is over the start of the next.
            let x = if band % 2 == 0 { widest - (cuts[band + 1] - cuts[band]) + along } else { widest - 1 - along };
            let x = if band == 0 { widest - (cuts[1] - cuts[0]) + along } else { x };
            [if band % 2 == 0 && band > 0 { along } else { x }, c[1] + band as i32 * (rows + 1)]
        };
        let moves: Vec<(usize, Cell)> = (0..self.at.len()).map(|i| (i, to(self.at[i]))).collect();
        self.put(&moves);
        self.improve(8, 0.0, 0);
    }
}

/// Nodes of a chain, without those that hang at it, that is laid in rows.
const CHAIN: usize = 12;

/// Columns of a strip from which on it is folded.
const FOLD: i32 = 16;

fn within(b: [i32; 4], p: Cell) -> bool {
    (b[0]..=b[2]).contains(&p[0]) && (b[1]..=b[3]).contains(&p[1])
}

/// Whether the line between two cells runs through the label of a third.
fn runs_through(a: Cell, b: Cell, p: Cell) -> bool {
    if p == a
        || p == b
        || p[0] < a[0].min(b[0])
        || p[0] > a[0].max(b[0])
        || p[1] < a[1].min(b[1])
        || p[1] > a[1].max(b[1])
    {
        return false;
    }
    let f = |c: Cell| [f64::from(c[0] - p[0]), f64::from(c[1] - p[1])];
    super::geometry::Rect { middle: [0.0, 0.0], half: LABEL }.crossed([f(a), f(b)])
}

fn turn(o: Cell, a: Cell, b: Cell) -> i64 {
    let d = |p: Cell| [i64::from(p[0] - o[0]), i64::from(p[1] - o[1])];
    let (u, v) = (d(a), d(b));
    u[0] * v[1] - u[1] * v[0]
}

/// Whether two lines without a common end cross or touch.
fn cross(a: Cell, b: Cell, c: Cell, d: Cell) -> bool {
    let (p, q) = (turn(a, b, c).signum(), turn(a, b, d).signum());
    let (r, s) = (turn(c, d, a).signum(), turn(c, d, b).signum());
    p * q <= 0 && r * s <= 0
}

/// Whether two lines leave a node with less than about 20 degrees between them, as it is drawn.
fn is_narrow(p: Cell, a: Cell, b: Cell) -> bool {
    let d = |c: Cell| [f64::from(c[0] - p[0]) * 1.7, f64::from(c[1] - p[1])];
    let (u, v) = (d(a), d(b));
    let (dot, turn) = (u[0] * v[0] + u[1] * v[1], (u[0] * v[1] - u[1] * v[0]).abs());
    dot > 0.0 && turn < 0.36 * dot
}
