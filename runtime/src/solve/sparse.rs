//! Sparse systems with a fixed pattern: analysed once, factored again and again without allocation.
//!
//! Pivots are fixed by the pattern alone: the diagonal, or a transversal where the diagonal has holes, in an order that
//! makes little fill. Rows and columns are scaled by powers of two first. That is sound for matrices whose symmetric
//! part is positive definite after scaling, and for most others; where it is not, the factorisation says so.

mod elimination;
mod line;
mod numeric;

pub use elimination::Elimination;
pub use line::Line;
pub use numeric::Numeric;

use super::order::{minimum_degree, transversal};

/// Shorter stretches of rows with one entry each, always as far from the diagonal, go by tables like all others.
const LINKS: usize = 8;

/// The plan for one pattern: order of elimination, and where the factors have entries.
#[derive(Clone, Debug)]
pub struct Symbolic {
    n: usize,
    /// By step: the row and the column of the pivot.
    row: Vec<u32>,
    column: Vec<u32>,
    /// Entries of the matrix by step of their row: index in the pattern, step of their column.
    starts: Vec<u32>,
    entries: Vec<(u32, u32)>,
    lower: Pattern,
    upper: Pattern,
    line: Option<Line>,
}

/// What a [`Symbolic`] knows, step by step of the elimination.
#[derive(Clone, Copy, Debug)]
pub struct Tables<'a> {
    /// The row of each step's pivot.
    pub row: &'a [u32],
    /// Its column.
    pub column: &'a [u32],
    /// By step, where the entries of its row begin.
    pub starts: &'a [u32],
    /// Index in the pattern, step of the column.
    pub entries: &'a [(u32, u32)],
    /// The lower factor.
    pub lower: &'a Pattern,
    /// The upper factor.
    pub upper: &'a Pattern,
    /// What it is besides, where it is one.
    pub line: Option<Line>,
}

/// The pattern of a triangle, row by row, without the diagonal.
#[derive(Clone, Debug, Default)]
pub struct Pattern {
    /// By row, where its entries begin.
    pub starts: Vec<usize>,
    /// By entry its column; in each row in ascending order.
    pub columns: Vec<u32>,
    /// All rows, in stretches.
    pub runs: Vec<Run>,
}

/// A stretch of rows. A line of cells has hardly anything but long ones, in which substitution needs no tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// First row.
    pub from: u32,
    /// The row after the last.
    pub to: u32,
    /// Where each row has one entry, always so far from the diagonal: how far. 0 where they differ.
    pub distance: u32,
}

impl Pattern {
    fn row(&self, i: usize) -> std::ops::Range<usize> {
        self.starts[i]..self.starts[i + 1]
    }

    /// Finds the stretches.
    fn cut(&mut self) {
        let n = self.starts.len() - 1;
        let mut runs: Vec<Run> = Vec::new();
        let distance = |i: usize| match self.columns[self.row(i)] {
            [column] => column.abs_diff(i as u32),
            _ => 0,
        };
        let mut i = 0;
        while i < n {
            let one = distance(i);
            let mut to = i + 1;
            while to < n && distance(to) == one {
                to += 1;
            }
            let one = if to - i < LINKS { 0 } else { one };
            match runs.last_mut() {
                Some(run) if run.distance == 0 && one == 0 => run.to = to as u32,
                Some(_) | None => runs.push(Run { from: i as u32, to: to as u32, distance: one }),
            }
            i = to;
        }
        self.runs = runs;
    }
}

impl Symbolic {
    /// Analyses a pattern of (row, column), each place at most once. Where a matrix is `kept` for many solutions, a
    /// line is looked for, whose factors take longer to make.
    ///
    /// # Errors
    /// A row for which there can be no pivot: every matrix of this pattern is singular.
    ///
    /// # Panics
    /// Where an entry is not within `n` rows and columns.
    pub fn analyse(n: usize, pattern: &[(u32, u32)], kept: bool) -> Result<Self, usize> {
        let row_of = transversal(n, pattern)?;
        let mut node_of_row = vec![0u32; n];
        for (column, &row) in row_of.iter().enumerate() {
            node_of_row[row as usize] = column as u32;
        }
        // Nodes are columns, each with the row of its pivot.
        let mut neighbours = vec![Vec::new(); n];
        for &(row, column) in pattern {
            let node = node_of_row[row as usize];
            if node != column {
                neighbours[node as usize].push(column);
                neighbours[column as usize].push(node);
            }
        }
        for list in &mut neighbours {
            list.sort_unstable();
            list.dedup();
        }
        let is_diagonal = row_of.iter().enumerate().all(|(column, row)| column == *row as usize);
        let line = Line::of(&neighbours).filter(|_| kept && is_diagonal);
        let column = match &line {
            Some(line) => line.order(),
            None => {
                let column = minimum_degree(neighbours.clone());
                let upper = fill(&column, &inverted(&column), &neighbours);
                by_level(&column, &upper)
            }
        };
        let step = inverted(&column);
        let mut upper = fill(&column, &step, &neighbours);
        let mut lower = transpose(&upper);
        upper.cut();
        lower.cut();
        let mut starts = vec![0u32; n + 1];
        for &(r, _) in pattern {
            starts[step[node_of_row[r as usize] as usize] as usize + 1] += 1;
        }
        for k in 0..n {
            starts[k + 1] += starts[k];
        }
        let mut entries = vec![(0, 0); pattern.len()];
        let mut at = starts.clone();
        for (index, &(r, c)) in pattern.iter().enumerate() {
            let place = &mut at[step[node_of_row[r as usize] as usize] as usize];
            entries[*place as usize] = (index as u32, step[c as usize]);
            *place += 1;
        }
        let row = column.iter().map(|&c| row_of[c as usize]).collect();
        Ok(Self { n, row, column, starts, entries, lower, upper, line })
    }

    /// How many unknowns.
    pub fn size(&self) -> usize {
        self.n
    }

    /// Its tables, for back ends that factor by themselves.
    pub fn tables(&self) -> Tables<'_> {
        Tables {
            row: &self.row,
            column: &self.column,
            starts: &self.starts,
            entries: &self.entries,
            lower: &self.lower,
            upper: &self.upper,
            line: self.line,
        }
    }

    /// How many entries the factors have.
    pub fn fill(&self) -> usize {
        self.n + self.lower.columns.len() + self.upper.columns.len()
    }

    /// The entries of the matrix in the row of a step: index in the pattern, step of the column.
    fn entries(&self, k: usize) -> &[(u32, u32)] {
        &self.entries[self.starts[k] as usize..self.starts[k + 1] as usize]
    }
}

/// By column: its step.
fn inverted(column: &[u32]) -> Vec<u32> {
    let mut step = vec![0; column.len()];
    for (k, &c) in column.iter().enumerate() {
        step[c as usize] = k as u32;
    }
    step
}

/// The same elimination in an order in which steps that do not wait for one another stand side by side: by how many lie
/// below them in the tree of elimination, where a step's parent is the first that needs it.
fn by_level(column: &[u32], upper: &Pattern) -> Vec<u32> {
    let mut level = vec![0u32; column.len()];
    for k in 0..column.len() {
        if let Some(&parent) = upper.columns[upper.row(k)].first() {
            level[parent as usize] = level[parent as usize].max(level[k] + 1);
        }
    }
    let mut steps: Vec<usize> = (0..column.len()).collect();
    steps.sort_by_key(|k| level[*k]);
    steps.into_iter().map(|k| column[k]).collect()
}

/// The pattern of the upper factor of a symmetric pattern: each row's own entries, and those of the rows whose first
/// entry it is.
fn fill(order: &[u32], step: &[u32], neighbours: &[Vec<u32>]) -> Pattern {
    let n = order.len();
    let mut pattern = Pattern { starts: vec![0], ..Pattern::default() };
    let mut children: Vec<Vec<u32>> = vec![Vec::new(); n];
    let mut mark = vec![u32::MAX; n];
    for k in 0..n as u32 {
        let start = pattern.columns.len();
        mark[k as usize] = k;
        for &c in &neighbours[order[k as usize] as usize] {
            let j = step[c as usize];
            if j > k && mark[j as usize] != k {
                mark[j as usize] = k;
                pattern.columns.push(j);
            }
        }
        for child in std::mem::take(&mut children[k as usize]) {
            for at in pattern.row(child as usize) {
                let j = pattern.columns[at];
                if mark[j as usize] != k {
                    mark[j as usize] = k;
                    pattern.columns.push(j);
                }
            }
        }
        pattern.columns[start..].sort_unstable();
        if let Some(&parent) = pattern.columns.get(start) {
            children[parent as usize].push(k);
        }
        pattern.starts.push(pattern.columns.len());
    }
    pattern
}

/// The pattern of the lower factor.
fn transpose(upper: &Pattern) -> Pattern {
    let n = upper.starts.len() - 1;
    let mut starts = vec![0usize; n + 1];
    for &j in &upper.columns {
        starts[j as usize + 1] += 1;
    }
    for k in 0..n {
        starts[k + 1] += starts[k];
    }
    let mut columns = vec![0; upper.columns.len()];
    let mut at = starts.clone();
    for i in 0..n {
        for &j in &upper.columns[upper.row(i)] {
            columns[at[j as usize]] = i as u32;
            at[j as usize] += 1;
        }
    }
    Pattern { starts, columns, runs: Vec::new() }
}

#[cfg(test)]
mod tests;
