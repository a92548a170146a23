//! One output table, as CSV or JSON lines, written field by field into a file that is never half
//! there.

use std::fs::File;
use std::io::{Read as _, Write};
use std::path::Path;

use anyhow::Context;

use crate::output::OutputFile;

/// How rows are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum TableFormat {
    /// Comma-separated values with one header line, empty field for "not available".
    Csv,
    /// One JSON object a line, `null` for "not available".
    Jsonl,
}

/// A table in the making. The fields of a row come in the order of its columns.
#[derive(Debug)]
pub(crate) struct Table<W = OutputFile> {
    file: W,
    format: TableFormat,
    columns: &'static [&'static str],
    row: Vec<u8>,
    field: usize,
}

impl Table {
    /// Starts `directory/stem.csv` or `.jsonl`.
    pub(crate) fn create(
        directory: &Path,
        stem: &str,
        format: TableFormat,
        columns: &'static [&'static str],
    ) -> anyhow::Result<Self> {
        let extension = match format {
            TableFormat::Csv => "csv",
            TableFormat::Jsonl => "jsonl",
        };
        let mut file = OutputFile::create(directory, &format!("{stem}.{extension}"))?;
        if format == TableFormat::Csv {
            writeln!(file, "{}", columns.join(","))?;
        }
        Ok(Self { file, format, columns, row: Vec::new(), field: 0 })
    }

    /// Goes on with `directory/stem.csv`; one that has other columns is put aside.
    pub(crate) fn append(
        directory: &Path,
        stem: &str,
        columns: &'static [&'static str],
    ) -> anyhow::Result<Self> {
        let name = format!("{stem}.csv");
        let header = columns.join(",") + "\n";
        put_aside_if_other(&directory.join(&name), &header)?;
        let (mut file, is_begun) = OutputFile::append(directory, &name)?;
        if !is_begun {
            file.write_all(header.as_bytes())?;
        }
        Ok(Self { file, format: TableFormat::Csv, columns, row: Vec::new(), field: 0 })
    }

    /// Gives the file its name.
    pub(crate) fn finish(self) -> anyhow::Result<()> {
        self.file.finish()
    }
}

impl Table<Vec<u8>> {
    /// A table without a file; CSV has no header line.
    pub(crate) const fn in_memory(format: TableFormat, columns: &'static [&'static str]) -> Self {
        Self { file: Vec::new(), format, columns, row: Vec::new(), field: 0 }
    }

    /// The rows.
    pub(crate) fn into_text(self) -> Vec<u8> {
        self.file
    }

    /// The rows since the last call.
    pub(crate) fn take_text(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.file)
    }
}

impl<W: Write> Table<W> {
    /// A number with this many decimals; nothing for one that is missing or not finite.
    pub(crate) fn real(&mut self, value: Option<f64>, decimals: usize) {
        match value.filter(|v| v.is_finite()) {
            Some(value) => {
                self.start_field();
                write_decimal(&mut self.row, value, decimals);
            }
            None => self.nothing(),
        }
    }

    /// A whole number.
    pub(crate) fn integer(&mut self, value: i64) {
        self.start_field();
        write_digits(&mut self.row, value < 0, value.unsigned_abs(), 0);
    }

    /// A text; nothing for an empty one.
    pub(crate) fn text(&mut self, value: &str) {
        if value.is_empty() {
            return self.nothing();
        }
        self.start_field();
        match self.format {
            TableFormat::Csv if !value.contains([',', '"', '\n', '\r']) => {
                self.row.extend_from_slice(value.as_bytes());
            }
            TableFormat::Csv => {
                let _ = write!(self.row, "\"{}\"", value.replace('"', "\"\""));
            }
            TableFormat::Jsonl => {
                let _ = write!(self.row, "{}", serde_json::Value::from(value));
            }
        }
    }

    /// A field that is not available.
    fn nothing(&mut self) {
        self.start_field();
        if self.format == TableFormat::Jsonl {
            self.row.extend_from_slice(b"null");
        }
    }

    /// Separator, and for JSON the column's name.
    fn start_field(&mut self) {
        if self.field > 0 {
            self.row.push(b',');
        }
        if self.format == TableFormat::Jsonl {
            let _ = write!(self.row, "\"{}\":", self.columns[self.field]);
        }
        self.field += 1;
    }

    /// Writes the row, which must have a field for every column.
    pub(crate) fn end_row(&mut self) -> anyhow::Result<()> {
        assert_eq!(self.field, self.columns.len(), "a row has a field for every column");
        match self.format {
            TableFormat::Csv => self.row.push(b'\n'),
            TableFormat::Jsonl => {
                self.row.insert(0, b'{');
                self.row.extend_from_slice(b"}\n");
            }
        }
        self.file.write_all(&self.row)?;
        self.row.clear();
        self.field = 0;
        Ok(())
    }

    /// Hands all rows on to the system.
    pub(crate) fn flush(&mut self) -> anyhow::Result<()> {
        Ok(self.file.flush()?)
    }
}

/// Gives a table that begins with another header another name.
fn put_aside_if_other(path: &Path, header: &str) -> anyhow::Result<()> {
    let Ok(file) = File::open(path) else { return Ok(()) };
    let mut first = Vec::new();
    file.take(header.len() as u64).read_to_end(&mut first)?;
    if first.is_empty() || first == header.as_bytes() {
        return Ok(());
    }
    let other = (1..).map(|number| path.with_extension(format!("{number}.csv")));
    let free = other.into_iter().find(|path| !path.exists());
    std::fs::rename(path, free.unwrap_or_default())
        .with_context(|| format!("{}: has other columns and cannot be put aside", path.display()))
}

/// Writes `value` with this many decimals; through whole numbers where they can hold it, which is
/// several times faster than the exact way and the same but for ties.
fn write_decimal(text: &mut Vec<u8>, value: f64, decimals: usize) {
    /// Whole numbers below are exact in an `f64`.
    const EXACT: f64 = 9_007_199_254_740_992.0;
    const POWERS: [f64; 11] = [1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10];
    let scaled = POWERS.get(decimals).map_or(EXACT, |power| value.abs() * power + 0.5);
    if scaled >= EXACT {
        let _ = write!(text, "{value:.decimals$}");
        return;
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // below 2⁵³, and absolute
    let magnitude = scaled as u64;
    write_digits(text, value < 0.0 && magnitude > 0, magnitude, decimals);
}

/// Writes a whole number as a decimal fraction of which the last `decimals` digits are behind the
/// point.
fn write_digits(text: &mut Vec<u8>, is_negative: bool, magnitude: u64, decimals: usize) {
    let mut digits = [b'0'; 24];
    let mut start = digits.len();
    let mut rest = magnitude;
    while rest > 0 || digits.len() - start <= decimals {
        start -= 1;
        digits[start] = b'0' + (rest % 10) as u8;
        rest /= 10;
    }
    if is_negative {
        text.push(b'-');
    }
    let (whole, fraction) = digits[start..].split_at(digits.len() - decimals - start);
    text.extend_from_slice(whole);
    if !fraction.is_empty() {
        text.push(b'.');
        text.extend_from_slice(fraction);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(format: TableFormat) -> String {
        let folder = tempfile::tempdir().unwrap();
        let mut table = Table::create(folder.path(), "t", format, &["a", "b", "c"]).unwrap();
        table.text("x, \"y\"");
        table.real(Some(1.25), 3);
        table.integer(-7);
        table.end_row().unwrap();
        table.text("");
        table.real(Some(f64::NAN), 3);
        table.real(None, 1);
        table.end_row().unwrap();
        table.finish().unwrap();
        let file = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap();
        std::fs::read_to_string(file.path()).unwrap()
    }

    fn decimal(value: f64, decimals: usize) -> String {
        let mut text = Vec::new();
        write_decimal(&mut text, value, decimals);
        String::from_utf8(text).unwrap()
    }

    #[test]
    fn decimals_are_those_of_the_standard_library() {
        let values =
            [0.0, 0.5, -0.25, 1.0, -1e-9, 359.999_996, 1e9 / 7.0, -2.0 / 3.0, 1e17, 604_799.9];
        for value in values {
            for (decimals, unit) in [(0, 1.0), (3, 1e-3), (5, 1e-5), (9, 1e-9)] {
                let text = decimal(value, decimals);
                let exact = format!("{value:.decimals$}");
                let (found, wanted): (f64, f64) = (text.parse().unwrap(), exact.parse().unwrap());
                assert!((found - wanted).abs() <= 1.01 * unit, "{text} {exact}");
                assert_eq!(
                    text.split('.').nth(1).map(str::len),
                    exact.split('.').nth(1).map(str::len)
                );
            }
        }
        assert_eq!(
            (decimal(-12.345_67, 5), decimal(-0.000_04, 4)),
            ("-12.34567".into(), "0.0000".into())
        );
    }

    #[test]
    fn csv() {
        assert_eq!(written(TableFormat::Csv), "a,b,c\n\"x, \"\"y\"\"\",1.250,-7\n,,\n");
    }

    #[test]
    fn json_lines() {
        assert_eq!(
            written(TableFormat::Jsonl),
            "{\"a\":\"x, \\\"y\\\"\",\"b\":1.250,\"c\":-7}\n{\"a\":null,\"b\":null,\"c\":null}\n"
        );
    }
}
