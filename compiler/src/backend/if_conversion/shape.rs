//! What blocks of statements come to, whatever the numbers.

use crate::backend::code::{Stmt, all};

/// Whether a block always comes to what has no form here; one turn of what repeats may have one.
pub(super) fn is_heavy(body: &[Stmt], turns: bool) -> bool {
    body.iter().any(|s| match s {
        Stmt::For(..) | Stmt::Span(..) | Stmt::Solve { .. } | Stmt::Fail(_) | Stmt::Continue => true,
        Stmt::Loop(body) => !turns && repeats(body) || is_heavy(body, turns),
        _ => false,
    })
}

/// Whether a loop may be run through more than once.
pub(super) fn repeats(body: &[Stmt]) -> bool {
    reaches_end(body) || begins_anew(body)
}

/// Whether the end of a block may be reached.
pub(super) fn reaches_end(body: &[Stmt]) -> bool {
    let passes =
        |s: &Stmt| if let Stmt::If(_, yes, no) = s { reaches_end(yes) || reaches_end(no) } else { !s.is_exit() };
    body.iter().all(passes)
}

/// Whether a loop's body begins it anew somewhere.
pub(super) fn begins_anew(body: &[Stmt]) -> bool {
    body.iter().any(|s| match s {
        Stmt::Continue => true,
        Stmt::If(_, yes, no) => begins_anew(yes) || begins_anew(no),
        _ => false,
    })
}

/// Whether a block fails somewhere.
pub(super) fn has_fail(body: &[Stmt]) -> bool {
    !all(body, &mut |s| !matches!(s, Stmt::Fail(_)))
}

/// Whether a block changes anything, or is left.
pub(super) fn has_effect(body: &[Stmt]) -> bool {
    !all(body, &mut |s| !matches!(s, Stmt::Set(..) | Stmt::Store(..) | Stmt::Break | Stmt::Continue))
}
