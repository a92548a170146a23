//! Tables as Parquet files, with the columns and types of the Python module's tables: a CSV file
//! that is whole becomes one beside it.

use std::path::Path;

use crate::failure::UsageError;

/// Says how to get Parquet files from a program that was built without them.
///
/// # Errors
///
/// [`UsageError`] without the cargo feature `parquet`.
pub(crate) fn check() -> Result<(), UsageError> {
    if cfg!(feature = "parquet") {
        return Ok(());
    }
    Err(UsageError(
        "--format parquet: this program was built without it: build it with the cargo feature `parquet` \
         (`cargo install kurs-cli --features parquet`), or write Parquet from Python (`kurs.batch.run`)"
            .into(),
    ))
}

/// Writes `directory/stem.parquet` with the rows of `directory/stem.csv`.
#[cfg(not(feature = "parquet"))]
pub(crate) fn write(_: &Path, _: &str) -> anyhow::Result<()> {
    Ok(check()?)
}

#[cfg(feature = "parquet")]
pub(crate) use of_rows::write;

#[cfg(feature = "parquet")]
mod of_rows {
    use std::sync::Arc;

    use ::parquet::basic::Compression;
    use ::parquet::column::writer::ColumnWriter;
    use ::parquet::data_type::ByteArray;
    use ::parquet::errors::ParquetError;
    use ::parquet::file::properties::WriterProperties;
    use ::parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
    use ::parquet::schema::parser::parse_message_type;
    use anyhow::{Context, anyhow};

    use super::Path;
    use crate::embedded::Column;
    use crate::output::OutputFile;

    /// Rows that are held at a time: some megabytes.
    const GROUP: usize = 1 << 16;

    /// Writes `directory/stem.parquet` with the rows of `directory/stem.csv`.
    pub(crate) fn write(directory: &Path, stem: &str) -> anyhow::Result<()> {
        let source = directory.join(format!("{stem}.csv"));
        let mut rows = csv::Reader::from_path(&source)?;
        let names: Vec<String> = rows.headers()?.iter().map(str::to_owned).collect();
        let schema = parse_message_type(&message_type(stem, &names))?;
        let target = OutputFile::create(directory, &format!("{stem}.parquet"))?;
        let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
        let mut file = SerializedFileWriter::new(target, Arc::new(schema), Arc::new(properties))?;
        let mut row = csv::StringRecord::new();
        loop {
            let mut columns: Vec<Column> = names.iter().map(|name| Column::named(name)).collect();
            let mut held = 0;
            while held < GROUP && rows.read_record(&mut row)? {
                for ((column, name), field) in columns.iter_mut().zip(&names).zip(&row) {
                    column
                        .push(field)
                        .ok_or_else(|| anyhow!("{name} is `{field}`"))
                        .with_context(|| format!("{}: cannot become Parquet", source.display()))?;
                }
                held += 1;
            }
            if held == 0 {
                break;
            }
            let mut group = file.next_row_group()?;
            for column in columns {
                let writer = group.next_column()?.context("a column for every name")?;
                write_column(writer, column)?;
            }
            group.close()?;
        }
        file.into_inner()?.finish()
    }

    /// The columns in the words of Parquet.
    fn message_type(stem: &str, names: &[String]) -> String {
        let field = |name: &String| match Column::named(name) {
            Column::Reals(_) => format!("optional double {name};"),
            Column::Integers(_) => format!("required int64 {name};"),
            Column::Times(_) => format!("required int64 {name} (TIMESTAMP(NANOS,false));"),
            Column::Words { .. } => format!("optional binary {name} (STRING);"),
        };
        let fields: Vec<String> = names.iter().map(field).collect();
        format!("message {stem} {{ {} }}", fields.join(" "))
    }

    fn write_column(
        mut writer: SerializedColumnWriter<'_>,
        column: Column,
    ) -> Result<(), ParquetError> {
        match (writer.untyped(), column) {
            (ColumnWriter::DoubleColumnWriter(writer), Column::Reals(values)) => {
                let is_there: Vec<i16> = values.iter().map(|v| i16::from(!v.is_nan())).collect();
                let known: Vec<f64> = values.into_iter().filter(|v| !v.is_nan()).collect();
                writer.write_batch(&known, Some(&is_there), None)?;
            }
            (
                ColumnWriter::Int64ColumnWriter(writer),
                Column::Integers(values) | Column::Times(values),
            ) => {
                writer.write_batch(&values, None, None)?;
            }
            (ColumnWriter::ByteArrayColumnWriter(writer), Column::Words { codes, words, .. }) => {
                let words: Vec<ByteArray> =
                    words.iter().map(|word| ByteArray::from(word.as_str())).collect();
                let is_there: Vec<i16> = codes.iter().map(|code| i16::from(*code >= 0)).collect();
                let place = |code: &i32| usize::try_from(*code).ok();
                let known: Vec<ByteArray> =
                    codes.iter().filter_map(place).map(|at| words[at].clone()).collect();
                writer.write_batch(&known, Some(&is_there), None)?;
            }
            _ => return Err(ParquetError::General("the schema has another column here".into())),
        }
        writer.close()
    }

    #[cfg(test)]
    mod tests {
        use super::*;
        use ::parquet::file::reader::{FileReader, SerializedFileReader};
        use ::parquet::record::RowAccessor;

        #[test]
        fn rows_come_back() {
            let folder = tempfile::tempdir().unwrap();
            let text = "time_gpst,gps_week,status,heading_deg\n\
                        2024-03-10T00:00:00.200,2305,fixed,40.125\n\
                        2024-03-10T00:00:00.400,2305,lost,\n";
            std::fs::write(folder.path().join("attitude.csv"), text).unwrap();
            write(folder.path(), "attitude").unwrap();
            let file = std::fs::File::open(folder.path().join("attitude.parquet")).unwrap();
            let reader = SerializedFileReader::new(file).unwrap();
            let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
            assert_eq!(rows.len(), 2);
            assert_eq!(rows[0].get_long(1).unwrap(), 2305);
            assert_eq!(rows[0].get_string(2).unwrap(), "fixed");
            assert_eq!(rows[0].get_double(3).unwrap(), 40.125);
            assert!(rows[1].get_double(3).is_err(), "not available is null");
            assert_eq!(rows[1].get_string(2).unwrap(), "lost");
            assert_eq!(rows[0].get_long(0).unwrap(), 1_710_028_800_200_000_000);

            std::fs::write(folder.path().join("attitude.csv"), "gps_week\nx\n").unwrap();
            let error = format!("{:#}", write(folder.path(), "attitude").unwrap_err());
            assert!(error.ends_with("cannot become Parquet: gps_week is `x`"), "{error}");
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "the old one stays");
        }
    }
}
