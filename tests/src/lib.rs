//! The workspace's tests live in `tests/tests`, one file a stage.
