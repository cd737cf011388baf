//! The words of the command line, before they are read as options.

use std::ffi::OsString;

/// The words that this program was called with. `--step -1e-3` becomes `--step=-1e-3`: a word that begins as a negative
/// number is the value of the option before it, so that it is told what such a value has to be.
pub fn words() -> Vec<OsString> {
    joined(std::env::args_os())
}

fn joined(words: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut list: Vec<OsString> = Vec::new();
    let mut options = true;
    for word in words {
        match list.last_mut() {
            Some(before) if options && is_negative(&word) && takes(before) => {
                before.push("=");
                before.push(word);
            }
            Some(_) | None => {
                options &= word != "--";
                list.push(word);
            }
        }
    }
    list
}

/// Whether a word may be a negative number.
fn is_negative(word: &OsString) -> bool {
    let bytes = word.as_encoded_bytes();
    bytes.starts_with(b"-") && bytes.get(1).is_some_and(|b| b.is_ascii_digit() || *b == b'.')
}

/// Whether a word is a long option without its value.
fn takes(word: &OsString) -> bool {
    let bytes = word.as_encoded_bytes();
    bytes.starts_with(b"--") && bytes.len() > 2 && !bytes.contains(&b'=')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn negative_numbers_are_values() {
        let join = |text: &str| {
            let words = joined(text.split(' ').map(OsString::from));
            words.iter().map(|w| w.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
        };
        for (text, wanted) in [
            ("run a --step -1e-3", "run a --step=-1e-3"),
            ("run a --step -.5ms --stop 1", "run a --step=-.5ms --stop 1"),
            ("run a --step=1 -2", "run a --step=1 -2"),
            ("run a --step -- -1", "run a --step -- -1"),
            ("run - -o -", "run - -o -"),
            ("--step -1 -2", "--step=-1 -2"),
        ] {
            assert_eq!(join(text), wanted);
        }
    }
}
