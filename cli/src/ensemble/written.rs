//! How the parameters of an ensemble are written: `PATH=...`, and numbers in the same unit.

use bond::internal::Quantity;
use bond_compiler::units::Dimension;

/// Splits an argument into the path of a parameter, in the form that models use, and its values.
///
/// # Errors
/// In a few words, what is missing; `example` is what follows the `=`.
pub fn assignment<'a>(text: &'a str, example: &str) -> Result<(String, &'a str), String> {
    let (path, rest) = text.split_once('=').ok_or_else(|| format!("write it as PATH={example}"))?;
    match (path.trim(), rest.trim()) {
        ("", _) => Err("the name of the parameter is missing".into()),
        (path, "") => Err(format!("the values are missing; write it as {path}={example}")),
        (path, rest) => Ok((crate::input::path(path), rest)),
    }
}

/// The unit that numbers have in common. A plain 0 is 0 in every unit.
///
/// # Errors
/// In words, where two are in different units, or one has a unit and the other has none.
pub fn unit(list: &[Quantity]) -> Result<Option<Dimension>, String> {
    let mut known = list.iter().filter(|(x, d)| d.is_some() || *x != 0.0).map(|(_, d)| *d);
    let first = known.next().flatten();
    match known.find(|d| *d != first) {
        None => Ok(first.or_else(|| list.iter().find_map(|(_, d)| *d))),
        Some(other) => match (first, other) {
            (Some(a), Some(b)) => Err(format!("the numbers are in {a} and in {b}; give all in one unit")),
            (_, _) => Err("one number has a unit and another has none; give it to all, or write all in SI".into()),
        },
    }
}

/// Without spaces: what is the same to the reader is the same text.
pub fn plain(text: &str) -> String {
    text.split_whitespace().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_those_of_all() {
        let read = |list: &[&str]| unit(&list.iter().map(|t| bond::internal::quantity(t).unwrap()).collect::<Vec<_>>());
        assert_eq!(read(&["1 kg", "2 g", "0"]), Ok(Some(Dimension::KILOGRAM)));
        assert_eq!(read(&["0", "2 g"]), Ok(Some(Dimension::KILOGRAM)));
        assert_eq!(read(&["0", "2", "3"]), Ok(None));
        assert_eq!(read(&["0", "0 kg"]), Ok(Some(Dimension::KILOGRAM)));
        assert!(read(&["1 kg", "2 m"]).unwrap_err().contains("kg and in m"));
        assert!(read(&["1 kg", "2"]).is_err() && read(&["2", "1 kg"]).is_err());
    }
}
