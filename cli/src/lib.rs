//! `bond` as a library.
