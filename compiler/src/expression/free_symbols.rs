//! Which symbols each expression has, as short sorted lists that many share.

use super::{Expr, Symbol};

/// Expressions with more symbols than this don't carry the list of them.
const FEW: usize = 16;

/// The list of each expression: where it starts, and its length, which is more than a few where there is no list.
#[derive(Clone, Debug, Default)]
pub(super) struct FreeSymbols {
    of: Vec<(u32, u32)>,
    lists: Vec<Symbol>,
}

impl FreeSymbols {
    /// All symbols of an expression, sorted; `None` where they are more than a few.
    pub(super) fn few(&self, e: Expr) -> Option<&[Symbol]> {
        let (first, len) = self.of[e.0 as usize];
        (len as usize <= FEW).then(|| &self.lists[first as usize..(first + len) as usize])
    }

    /// Whether it has none.
    pub(super) fn is_empty(&self, e: Expr) -> bool {
        self.of[e.0 as usize].1 == 0
    }

    /// Adds the list of the next expression, which is of this symbol or of none.
    pub(super) fn push(&mut self, s: Option<Symbol>) {
        self.of.push((self.lists.len() as u32, u32::from(s.is_some())));
        self.lists.extend(s);
    }

    /// Adds the list of the next expression, which has these children.
    pub(super) fn push_union(&mut self, children: impl Iterator<Item = Expr> + Clone) {
        // Mostly one child has all symbols that any has.
        let mut largest = (0, 0);
        for c in children.clone() {
            let of = self.of[c.0 as usize];
            if of.1 as usize > FEW {
                self.of.push(of);
                return;
            }
            if of.1 > largest.1 {
                largest = of;
            }
        }
        let mut all = [Symbol(0); FEW];
        let mut len = largest.1 as usize;
        all[..len].copy_from_slice(&self.lists[largest.0 as usize..(largest.0 + largest.1) as usize]);
        for c in children {
            let (first, count) = self.of[c.0 as usize];
            if (first, count) == largest {
                continue;
            }
            for s in &self.lists[first as usize..(first + count) as usize] {
                if let Err(i) = all[..len].binary_search(s) {
                    if len == FEW {
                        self.of.push((0, FEW as u32 + 1));
                        return;
                    }
                    all.copy_within(i..len, i + 1);
                    all[i] = *s;
                    len += 1;
                }
            }
        }
        if len == largest.1 as usize {
            self.of.push(largest);
        } else {
            self.of.push((self.lists.len() as u32, len as u32));
            self.lists.extend_from_slice(&all[..len]);
        }
    }
}
