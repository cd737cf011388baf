//! Tables of input signals: CSV with the column `t` and one column per input.

use bond_compiler::elaborate::nearest;
use bond_runtime::simulate::{InputSignal, Unfit};
use thiserror::Error;

/// An error in a table.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("line {line}: {message}")]
pub struct TableError {
    /// The line, from 1.
    pub line: usize,
    /// In words.
    pub message: String,
}

/// A table: instants in s, and the values of inputs at them, in SI.
#[derive(Clone, Debug, PartialEq)]
pub struct Given {
    names: Vec<String>,
    /// The line of each row.
    lines: Vec<usize>,
    instants: Vec<f64>,
    /// By column.
    values: Vec<Vec<f64>>,
}

fn wrong<T>(line: usize, message: impl Into<String>) -> Result<T, TableError> {
    Err(TableError { line, message: message.into() })
}

/// A number of things, in words.
fn counted(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

impl Given {
    /// Reads a table whose columns are `t` and some of the inputs `known`. The header is the first line that is not
    /// empty; empty lines, and lines that begin with `#`, are skipped.
    ///
    /// # Errors
    /// The line that is wrong, and what is wrong with it.
    pub fn read(text: &str, known: &[&str]) -> Result<Self, TableError> {
        // A mark of the byte order stands wherever tables were put together, and is a blank.
        let is_blank = |c: char| c.is_whitespace() || c == '\u{feff}';
        let is_row = |row: &(usize, &str)| !row.1.is_empty() && !row.1.starts_with('#');
        let rows: Vec<(usize, &str)> =
            text.lines().enumerate().map(|(i, l)| (i + 1, l.trim_matches(is_blank))).filter(is_row).collect();
        let Some(&(head, first)) = rows.first() else { return wrong(1, "the table is empty; it begins with `t,...`") };
        // Quotes are closed in their line, so that a record is a line.
        let (mut lines, mut unquoted) = (String::new(), Ok(()));
        for (line, row) in &rows {
            match unpadded(row) {
                Ok(row) => lines.push_str(&row),
                Err(why) => {
                    unquoted = wrong(*line, why);
                    break;
                }
            }
            lines.push('\n');
        }
        let mut reader = csv::ReaderBuilder::new();
        // A carriage return within a line ends no record.
        let reader = reader.has_headers(false).flexible(true).terminator(csv::Terminator::Any(b'\n'));
        let reader = reader.trim(csv::Trim::All).from_reader(lines.as_bytes());
        let mut records = rows.iter().zip(reader.into_records()).map(|((line, _), record)| match record {
            Ok(record) => Ok((*line, record.iter().map(str::to_string).collect::<Vec<_>>())),
            Err(e) => wrong(*line, e.to_string()),
        });
        let Some(header) = records.next() else { return unquoted.and(wrong(head, "the table is empty")) };
        let header = header?.1;
        let Some(time) = header.iter().position(|c| c == "t") else {
            // As tables are written where the decimal sign is a comma.
            if first.contains(';') {
                return wrong(head, "columns are separated by commas, and not by `;`; the decimal sign is a point");
            }
            return wrong(head, "there is no column `t`, the time in seconds");
        };
        columns(head, &header, known)?;
        let names = header.iter().enumerate().filter(|(i, _)| *i != time).map(|(_, n)| n.clone()).collect();
        let values = vec![Vec::new(); header.len() - 1];
        let mut table = Self { names, lines: Vec::new(), instants: Vec::new(), values };
        for record in records {
            let (line, row) = record?;
            if row.len() != header.len() {
                return wrong(
                    line,
                    format!(
                        "this row has {}, and the header has {}",
                        counted(row.len(), "number"),
                        counted(header.len(), "column")
                    ),
                );
            }
            table.lines.push(line);
            let mut columns = table.values.iter_mut();
            for (i, (cell, name)) in row.iter().zip(&header).enumerate() {
                let x = match cell.parse::<f64>() {
                    Ok(x) if x.is_finite() => x,
                    Ok(_) | Err(_) => return wrong(line, format!("`{cell}` in the column `{name}` is not a number")),
                };
                if i == time {
                    if let Some(before) = table.instants.last().filter(|t| **t >= x) {
                        return wrong(line, format!("the time {x} s is not after {before} s, that of the row before"));
                    }
                    table.instants.push(x);
                } else if let Some(column) = columns.next() {
                    column.push(x);
                }
            }
        }
        unquoted?;
        if table.instants.is_empty() {
            return wrong(head, "there are no rows below the header");
        }
        Ok(table)
    }

    /// What each input is over time: linear between rows, or that of the row before where `hold` is set.
    ///
    /// # Errors
    /// A table whose numbers make no signal.
    pub fn signals(&self, hold: bool) -> Result<Vec<(String, InputSignal)>, TableError> {
        let one = |(name, values): (&String, &Vec<f64>)| match InputSignal::table(&self.instants, values, hold) {
            Ok(signal) => Ok((name.clone(), signal)),
            Err(Unfit::Steep(row)) => {
                let line = |row: usize| self.lines.get(row).copied().unwrap_or_default();
                let message = format!(
                    "the column `{name}` changes faster than double precision resolves from line {} to this one",
                    line(row)
                );
                wrong(line(row + 1), message)
            }
            Err(e) => wrong(1, format!("the column `{name}`: {e}")),
        };
        self.names.iter().zip(&self.values).map(one).collect()
    }
}

/// The columns must be inputs, each once.
fn columns(line: usize, header: &[String], known: &[&str]) -> Result<(), TableError> {
    for (i, name) in header.iter().enumerate() {
        if header[..i].contains(name) {
            return wrong(line, format!("there are two columns `{name}`"));
        }
        if name == "t" || known.contains(&name.as_str()) {
            continue;
        }
        let fix = match nearest(name, known.iter().copied()) {
            Some(near) => format!("did you mean `{near}`?"),
            None if known.is_empty() => "the model has none; declare one with `input name = default`".to_string(),
            None => format!("its inputs are {}", known.join(", ")),
        };
        return wrong(line, format!("the model has no input `{name}`; {fix}"));
    }
    Ok(())
}

/// A line without blanks beside its quotes, which stand around whole cells, as in `"u[1,2]"`; a quote in a cell is
/// doubled.
fn unpadded(line: &str) -> Result<String, String> {
    let parts: Vec<&str> = line.split('"').collect();
    let last = parts.len() - 1;
    if last % 2 == 1 {
        return Err("a quote is not closed in this line".into());
    }
    let mut all = Vec::new();
    for (i, part) in parts.into_iter().enumerate() {
        let within = i % 2 == 1;
        if within || part.is_empty() {
            all.push(part);
            continue;
        }
        let outside = part.trim();
        if i > 0 && !outside.starts_with(',') {
            return Err(format!("a comma is missing between a closing quote and `{outside}`"));
        }
        if i < last && !outside.ends_with(',') {
            let cell = outside.rsplit(',').next().unwrap_or(outside).trim();
            return Err(format!("`{cell}` has a quote inside; quotes enclose a whole cell"));
        }
        all.push(outside);
    }
    Ok(all.join("\""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_read() -> Result<(), TableError> {
        let table =
            Given::read("\u{feff}# weather\n u , t, \"w[1,2]\" \n\n1, 0 ,2\r\n\"-3e1\" ,0.5,4\n", &["u", "w[1,2]"])?;
        assert_eq!(table.instants, [0.0, 0.5]);
        let signals = table.signals(false)?;
        assert_eq!(signals[0].0, "u");
        assert_eq!(signals[1].0, "w[1,2]");
        assert_eq!((signals[0].1.value(0.25), signals[1].1.value(0.25)), (-14.5, 3.0));
        Ok(())
    }

    #[test]
    fn each_mistake_is_named_with_its_line() {
        let cases = [
            ("", 1, "empty"),
            ("time,u\n0,1\n", 1, "no column `t`"),
            ("t;u\n0;1,5\n", 1, "columns are separated by commas"),
            ("t,v\n0,1\n", 1, "no input `v`; its inputs are u"),
            ("t,u,u\n0,1,1\n", 1, "two columns `u`"),
            ("t,u\n", 1, "no rows"),
            ("t,u\n0,1\n1\n", 3, "this row has 1 number, and the header has 2 columns"),
            ("t,u\n0,1\n\n1,x\n", 4, "`x` in the column `u` is not a number"),
            ("t,u\n0,inf\n", 2, "not a number"),
            ("t,u\n0,1\n1,1\n1,2\n", 4, "not after 1 s"),
            ("t,\"u\n0,1\n", 1, "a quote is not closed"),
            ("t,u\n0,\"1\"2\n1,2\n", 2, "between a closing quote and `2`"),
            ("t,u\n0,1\n1,\"1\n", 3, "a quote is not closed"),
            ("t,u\n0,1\"2\"\n", 2, "quotes enclose a whole cell"),
            ("t,u\n0,\"1\"\"\n", 2, "a quote is not closed"),
            ("t,u\n0,\"1\"\"2\"\n", 2, "is not a number"),
            ("t,u\n0,1\r1,2\n2,3\n3,4\n", 2, "has 3 numbers"),
            ("t,u\r0,1\n1,2\n", 1, "no input"),
            ("#\n\u{feff}\n\u{feff}t,u\n0,x\n", 4, "is not a number"),
            (
                "t,u\n0,1e308\n\n1,-1e308\n",
                4,
                "the column `u` changes faster than double precision resolves from \
            line 2",
            ),
        ];
        for (text, line, words) in cases {
            match Given::read(text, &["u"]).and_then(|table| table.signals(false)) {
                Ok(_) => panic!("{text:?} is read"),
                Err(e) => assert!(e.line == line && e.message.contains(words), "{text:?}: {e}"),
            }
        }
    }
}
