//! Orders of elimination: a pivot for each row, and the order in which pivots make little fill.

/// No row, no column, no node.
const NONE: u32 = u32::MAX;

/// Gives each column a row in which it has an entry, the diagonal where there is one: `rows[column]`.
///
/// Rows left over get columns by augmenting paths (Duff, On algorithms for obtaining a maximum transversal, 1981).
///
/// # Errors
/// A row for which no column is left: every matrix of this pattern is singular.
///
/// # Panics
/// Where an entry is not within `n` rows and columns.
pub fn transversal(n: usize, pattern: &[(u32, u32)]) -> Result<Vec<u32>, usize> {
    let mut row_of = vec![NONE; n];
    for &(row, column) in pattern {
        if row == column {
            row_of[column as usize] = row;
        }
    }
    if row_of.iter().all(|&row| row != NONE) {
        return Ok(row_of);
    }
    let mut columns = vec![Vec::new(); n];
    for &(row, column) in pattern {
        columns[row as usize].push(column);
    }
    let mut taken = vec![false; n];
    for &row in &row_of {
        if row != NONE {
            taken[row as usize] = true;
        }
    }
    let mut seen = vec![NONE; n]; // by column: the row whose search came by last
    let mut path: Vec<(u32, usize)> = Vec::new(); // row, and how many of its columns were tried
    for start in 0..n as u32 {
        if taken[start as usize] {
            continue;
        }
        path.clear();
        path.push((start, 0));
        loop {
            let Some((row, tried)) = path.last_mut() else {
                return Err(start as usize);
            };
            let list = &columns[*row as usize];
            if *tried == 0
                && let Some(at) = list.iter().position(|&c| row_of[c as usize] == NONE)
            {
                *tried = at + 1;
                break;
            }
            match list.get(*tried) {
                Some(&column) => {
                    *tried += 1;
                    if seen[column as usize] != start {
                        seen[column as usize] = start;
                        let owner = row_of[column as usize];
                        path.push((owner, 0));
                    }
                }
                None => {
                    path.pop();
                }
            }
        }
        for &(row, tried) in &path {
            row_of[columns[row as usize][tried - 1] as usize] = row;
        }
    }
    Ok(row_of)
}

/// Nodes in lists by degree, first in, first out: so a chain is eliminated from both its ends.
struct Buckets {
    head: Vec<u32>,
    tail: Vec<u32>,
    next: Vec<u32>,
    previous: Vec<u32>,
    degree: Vec<u32>,
    least: usize,
}

impl Buckets {
    fn new(n: usize) -> Self {
        let none = vec![NONE; n + 1];
        let (next, previous) = (vec![NONE; n], vec![NONE; n]);
        Self { head: none.clone(), tail: none, next, previous, degree: vec![0; n], least: 0 }
    }

    fn insert(&mut self, node: u32, degree: usize) {
        let old = self.tail[degree];
        self.previous[node as usize] = old;
        self.next[node as usize] = NONE;
        match old {
            NONE => self.head[degree] = node,
            _ => self.next[old as usize] = node,
        }
        self.tail[degree] = node;
        self.degree[node as usize] = degree as u32;
        self.least = self.least.min(degree);
    }

    fn remove(&mut self, node: u32) {
        let (before, after) = (self.previous[node as usize], self.next[node as usize]);
        let degree = self.degree[node as usize] as usize;
        match before {
            NONE => self.head[degree] = after,
            _ => self.next[before as usize] = after,
        }
        match after {
            NONE => self.tail[degree] = before,
            _ => self.previous[after as usize] = before,
        }
    }

    /// A node of least degree, removed.
    fn pop(&mut self) -> Option<u32> {
        while self.least < self.head.len() {
            let node = self.head[self.least];
            if node != NONE {
                self.remove(node);
                return Some(node);
            }
            self.least += 1;
        }
        None
    }
}

/// An order of approximately least degree for a symmetric pattern: the nodes, first eliminated first.
///
/// `neighbours` lists each node's neighbours, both ways, without the node itself. After Amestoy, Davis and Duff, An
/// approximate minimum degree ordering algorithm, 1996, on a quotient graph with absorption of elements, without
/// supervariables. Nodes with very many neighbours come last.
///
/// # Panics
/// Where a neighbour is not a node.
pub fn minimum_degree(mut neighbours: Vec<Vec<u32>>) -> Vec<u32> {
    let n = neighbours.len();
    let dense = (10.0 * (n as f64).sqrt()).max(64.0) as usize;
    let mut gone: Vec<bool> = neighbours.iter().map(|list| list.len() > dense).collect();
    let mut last: Vec<u32> = (0..n as u32).filter(|&i| gone[i as usize]).collect();
    last.sort_by_key(|&i| (neighbours[i as usize].len(), i));
    let mut buckets = Buckets::new(n);
    for i in 0..n {
        if gone[i] {
            neighbours[i] = Vec::new();
            continue;
        }
        neighbours[i].retain(|&j| !gone[j as usize]);
        buckets.insert(i as u32, neighbours[i].len());
    }
    // An eliminated node is an element; its members are the nodes it made neighbours of each other.
    let mut elements: Vec<Vec<u32>> = vec![Vec::new(); n];
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); n];
    let mut absorbed = vec![false; n];
    let mut mark = vec![NONE; n]; // by node: the pivot it is a member of
    let mut outside = vec![(NONE, 0u32); n]; // by element: its members that are not the pivot's
    let mut order = Vec::with_capacity(n);
    while let Some(p) = buckets.pop() {
        gone[p as usize] = true;
        order.push(p);
        mark[p as usize] = p;
        let mut front = Vec::new();
        for j in std::mem::take(&mut neighbours[p as usize]) {
            if !gone[j as usize] && mark[j as usize] != p {
                mark[j as usize] = p;
                front.push(j);
            }
        }
        for e in std::mem::take(&mut elements[p as usize]) {
            if absorbed[e as usize] {
                continue;
            }
            absorbed[e as usize] = true;
            for j in std::mem::take(&mut members[e as usize]) {
                if mark[j as usize] != p {
                    mark[j as usize] = p;
                    front.push(j);
                }
            }
        }
        for &i in &front {
            elements[i as usize].retain(|&e| !absorbed[e as usize]);
            for &e in &elements[i as usize] {
                let count = &mut outside[e as usize];
                if count.0 != p {
                    *count = (p, members[e as usize].len() as u32);
                }
                count.1 -= 1;
            }
        }
        let rest = n - order.len();
        for &i in &front {
            let node = i as usize;
            neighbours[node].retain(|&j| mark[j as usize] != p && !gone[j as usize]);
            let mut degree = neighbours[node].len() + front.len() - 1;
            elements[node].retain(|&e| {
                let (_, count) = outside[e as usize];
                degree += count as usize;
                if count == 0 {
                    absorbed[e as usize] = true;
                }
                count > 0
            });
            elements[node].push(p);
            let old = buckets.degree[node] as usize;
            let degree = degree.min(old + front.len() - 1).min(rest.saturating_sub(1));
            buckets.remove(i);
            buckets.insert(i, degree);
        }
        members[p as usize] = front;
    }
    order.append(&mut last);
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transversals() {
        assert_eq!(transversal(2, &[(0, 0), (1, 1)]), Ok(vec![0, 1]));
        assert_eq!(transversal(2, &[(0, 1), (1, 0)]), Ok(vec![1, 0]));
        assert_eq!(transversal(3, &[(0, 0), (0, 1), (1, 0), (2, 2)]), Ok(vec![1, 0, 2]));
        assert_eq!(transversal(3, &[(0, 0), (1, 0), (2, 2), (2, 1)]), Err(1));
        // A ring that only works when every row moves on by one.
        let n = 50u32;
        let ring: Vec<_> =
            (0..n).flat_map(|i| [(i, (i + 1) % n)].into_iter().chain((i > 0).then_some((i, i)))).collect();
        let rows = transversal(n as usize, &ring);
        assert!(rows.is_ok_and(|rows| {
            let mut sorted = rows.clone();
            sorted.sort_unstable();
            sorted == (0..n).collect::<Vec<_>>() && rows.iter().enumerate().all(|(c, r)| ring.contains(&(*r, c as u32)))
        }));
    }

    #[test]
    fn orders_are_permutations_and_chains_have_no_fill() {
        let n = 1000u32;
        let chain = (0..n).map(|i| [i.wrapping_sub(1), i + 1].into_iter().filter(|&j| j < n).collect()).collect();
        let mut order = minimum_degree(chain);
        order.sort_unstable();
        assert_eq!(order, (0..n).collect::<Vec<_>>());
        let star = (0..n).map(|i| if i == 0 { (1..n).collect() } else { vec![0] }).collect();
        assert_eq!(minimum_degree(star).last(), Some(&0));
    }
}
