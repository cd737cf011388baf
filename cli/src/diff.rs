//! Line by line, what differs between two texts.

/// Larger texts are compared only at their ends.
const MAX_CELLS: usize = 4_000_000;

/// Lines that are gone with `-`, new ones with `+`, up to two equal ones around them.
pub fn lines(old: &str, new: &str) -> String {
    let (a, b): (Vec<&str>, Vec<&str>) = (old.lines().collect(), new.lines().collect());
    let head = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    let tail = a[head..].iter().rev().zip(b[head..].iter().rev()).take_while(|(x, y)| x == y).count();
    let (middle_a, middle_b) = (&a[head..a.len() - tail], &b[head..b.len() - tail]);
    let mut marked: Vec<(char, &str)> = a[..head].iter().map(|l| (' ', *l)).collect();
    marked.extend(changes(middle_a, middle_b));
    marked.extend(a[a.len() - tail..].iter().map(|l| (' ', *l)));
    let near = |i: usize| marked[i.saturating_sub(2)..(i + 3).min(marked.len())].iter().any(|m| m.0 != ' ');
    let mut out = String::new();
    let mut skipped = false;
    for (i, (mark, line)) in marked.iter().enumerate() {
        if near(i) {
            if skipped {
                out.push_str("  ...\n");
            }
            out.push_str(&format!("{mark} {line}\n"));
        }
        skipped = !near(i);
    }
    out
}

fn changes<'a>(a: &[&'a str], b: &[&'a str]) -> Vec<(char, &'a str)> {
    let (n, m) = (a.len(), b.len());
    if n.saturating_mul(m) > MAX_CELLS {
        return a.iter().map(|l| ('-', *l)).chain(b.iter().map(|l| ('+', *l))).collect();
    }
    // Length of the longest common rest.
    let mut rest = vec![0u32; (n + 1) * (m + 1)];
    let at = |i: usize, j: usize| i * (m + 1) + j;
    for i in (0..n).rev() {
        for j in (0..m).rev() {
            rest[at(i, j)] =
                if a[i] == b[j] { rest[at(i + 1, j + 1)] + 1 } else { rest[at(i + 1, j)].max(rest[at(i, j + 1)]) };
        }
    }
    let (mut i, mut j) = (0, 0);
    let mut list = Vec::new();
    while i < n || j < m {
        if i < n && j < m && a[i] == b[j] {
            list.push((' ', a[i]));
            i += 1;
            j += 1;
        } else if j == m || (i < n && rest[at(i + 1, j)] >= rest[at(i, j + 1)]) {
            list.push(('-', a[i]));
            i += 1;
        } else {
            list.push(('+', b[j]));
            j += 1;
        }
    }
    list
}

#[cfg(test)]
mod tests {
    use super::lines;

    #[test]
    fn what_changed() {
        assert_eq!(lines("a\nb\nc\n", "a\nx\nc\n"), "  a\n- b\n+ x\n  c\n");
        assert_eq!(lines("a\n", "a\n"), "");
        assert_eq!(lines("", "a\n"), "+ a\n");
    }
}
