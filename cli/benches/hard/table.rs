//! Tables of the page.

use std::path::Path;

/// A table by its head and rows.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let mut out = line(head.iter().map(|h| (*h).to_string()).collect());
    out += &line(vec!["---".into(); head.len()]);
    for row in rows {
        out += &line(row.iter().map(|c| cell(c)).collect());
    }
    out
}

/// Text that may stand in a table.
fn cell(text: &str) -> String {
    text.replace('|', "/").replace('\n', " ")
}

/// A number with two digits.
pub fn short(x: f64) -> String {
    match x {
        0.0 => "0".into(),
        x if x.is_nan() => "NaN".into(),
        x if (1e-2..1e4).contains(&x.abs()) => {
            let text = format!(
                "{:.*}",
                if x.abs() >= 10.0 {
                    0
                } else if x.abs() >= 1.0 {
                    1
                } else {
                    3
                },
                x
            );
            text
        }
        x => format!("{x:.1e}"),
    }
}

/// A time, from s.
pub fn time(s: f64) -> String {
    match s {
        s if s < 1e-3 => format!("{} us", short(s * 1e6)),
        s if s < 1.0 => format!("{} ms", short(s * 1e3)),
        s => format!("{} s", short(s)),
    }
}

/// A page with the text between two of its marks made new.
///
/// # Errors
/// That the page has no such marks.
pub fn replaced(page: &str, path: &Path, name: &str, text: &str) -> Result<String, String> {
    let (from, to) = (format!("<!-- measured: {name} -->\n"), format!("<!-- end of {name} -->"));
    let gone = || format!("{} has no section `{name}`: it is between {} and {to}", path.display(), from.trim_end());
    let (before, rest) = page.split_once(&from).ok_or_else(gone)?;
    let (_, after) = rest.split_once(&to).ok_or_else(gone)?;
    Ok(format!("{before}{from}\n{text}\n{to}{after}"))
}
