//! Columns of tables, their names, and the cells of rows.

use std::collections::HashSet;

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Doubles.
    Number,
    /// Doubles that stay the same over many rows.
    Repeated,
    /// Whole numbers.
    Whole,
    /// Texts.
    Text,
}

/// A column: its name, and what it holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// The name.
    pub name: String,
    /// What it holds.
    pub kind: Kind,
}

impl Column {
    /// A column of this name.
    pub fn new(name: impl Into<String>, kind: Kind) -> Self {
        Self { name: name.into(), kind }
    }
}

/// Makes a name unique by appending `_`, and marks it as taken.
pub fn distinct(taken: &mut HashSet<String>, name: &str) -> String {
    let mut name = name.to_string();
    while !taken.insert(name.clone()) {
        name.push('_');
    }
    name
}

/// The columns behind that of the time, `t`, that has its name first.
pub fn over_time(names: &[&str]) -> Vec<String> {
    let mut taken = HashSet::from(["t".to_string()]);
    names.iter().map(|name| distinct(&mut taken, name)).collect()
}

/// One entry of a row.
#[derive(Clone, Copy, Debug)]
pub enum Cell<'a> {
    /// A double; NaN if there is no value.
    Number(f64),
    /// A whole number.
    Whole(u64),
    /// A text.
    Text(&'a str),
}
