//! The workspace's tests live in `tests/tests`, one file a stage. What other programs need of them is here.

pub mod random;
