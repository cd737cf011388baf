//! The difference between two texts, line by line.

use similar::{ChangeTag, TextDiff};

/// Equal lines that are shown around a change.
const CONTEXT: usize = 2;

/// Deleted lines with `-`, added ones with `+`, and some equal ones around them.
pub fn lines(old: &str, new: &str) -> String {
    let (a, b): (Vec<&str>, Vec<&str>) = (old.lines().collect(), new.lines().collect());
    let diff = TextDiff::from_slices(&a, &b);
    let mut out = String::new();
    for group in diff.grouped_ops(CONTEXT) {
        if group.first().is_some_and(|op| op.old_range().start > 0) {
            out.push_str("  ...\n");
        }
        for change in group.iter().flat_map(|op| diff.iter_changes(op)) {
            let mark = match change.tag() {
                ChangeTag::Equal => ' ',
                ChangeTag::Delete => '-',
                ChangeTag::Insert => '+',
            };
            out.push_str(&format!("{mark} {}\n", change.value()));
        }
    }
    out
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
