//! Tables as Parquet files: doubles bit for bit, compressed, a column at a time.

use crate::column::{Cell, Column, Kind};
use crate::output::Sink;
use crate::stop::Stop;
use ::parquet::basic::{Compression, Encoding, LogicalType, Repetition, Type as Physical};
use ::parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use ::parquet::errors::{ParquetError, Result as Written};
use ::parquet::file::properties::WriterProperties;
use ::parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use ::parquet::schema::types::{ColumnPath, Type};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Entries of a group of rows, which is held in memory until it is written.
const NUMBERS_PER_GROUP: usize = 1 << 20;

/// A table that is being written, group by group.
pub struct Table {
    writer: SerializedFileWriter<Sink>,
    path: PathBuf,
    columns: Vec<Entries>,
    rows: usize,
    /// Rows of a group.
    most: usize,
}

/// What is not yet written of a column.
enum Entries {
    Numbers(Vec<f64>),
    Wholes(Vec<i64>),
    Texts(Vec<ByteArray>),
}

impl Table {
    /// A table with these columns.
    ///
    /// # Errors
    /// A file that cannot be made, or names of columns that Parquet cannot have.
    pub fn new(path: &Path, columns: &[Column]) -> Result<Self, Stop> {
        let sink = Sink::open(path)?;
        let failure = |e: ParquetError| unwritable(path, &e);
        let schema = schema(columns).map_err(failure)?;
        let writer = SerializedFileWriter::new(sink, schema, Arc::new(properties(columns))).map_err(failure)?;
        let entries = columns.iter().map(|c| match c.kind {
            Kind::Number | Kind::Repeated => Entries::Numbers(Vec::new()),
            Kind::Whole => Entries::Wholes(Vec::new()),
            Kind::Text => Entries::Texts(Vec::new()),
        });
        let most = (NUMBERS_PER_GROUP / columns.len().max(1)).clamp(1000, 1 << 16);
        Ok(Self { writer, path: path.to_path_buf(), columns: entries.collect(), rows: 0, most })
    }

    /// Adds a row, a cell a column.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn row<'a>(&mut self, cells: impl IntoIterator<Item = Cell<'a>>) -> Result<(), Stop> {
        for (column, cell) in self.columns.iter_mut().zip(cells) {
            match (column, cell) {
                (Entries::Numbers(list), Cell::Number(x)) => list.push(x),
                (Entries::Numbers(list), Cell::Whole(n)) => list.push(n as f64),
                (Entries::Numbers(list), Cell::Text(_)) => list.push(f64::NAN),
                (Entries::Wholes(list), Cell::Whole(n)) => list.push(i64::try_from(n).unwrap_or(i64::MAX)),
                (Entries::Wholes(list), Cell::Number(x)) => list.push(x as i64),
                (Entries::Wholes(list), Cell::Text(_)) => list.push(0),
                (Entries::Texts(list), Cell::Text(text)) => list.push(ByteArray::from(text)),
                (Entries::Texts(list), Cell::Number(x)) => list.push(ByteArray::from(x.to_string().as_str())),
                (Entries::Texts(list), Cell::Whole(n)) => list.push(ByteArray::from(n.to_string().as_str())),
            }
        }
        self.rows += 1;
        if self.rows == self.most { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), Stop> {
        self.rows = 0;
        let mut group = || -> Written<()> {
            let mut group = self.writer.next_row_group()?;
            for column in &mut self.columns {
                column.flush(&mut group)?;
            }
            group.close().map(drop)
        };
        group().map_err(|e| unwritable(&self.path, &e))
    }

    /// Ends it: the file is there now.
    ///
    /// # Errors
    /// What is left cannot be written.
    pub fn commit(mut self) -> Result<(), Stop> {
        if self.rows > 0 {
            self.flush()?;
        }
        self.writer.into_inner().map_err(|e| unwritable(&self.path, &e))?.commit()
    }
}

impl Entries {
    fn flush(&mut self, group: &mut SerializedRowGroupWriter<'_, Sink>) -> Written<()> {
        let Some(mut column) = group.next_column()? else {
            return Err(ParquetError::General("a column is missing".into()));
        };
        match self {
            Self::Numbers(list) => drop(column.typed::<DoubleType>().write_batch(list, None, None)?),
            Self::Wholes(list) => drop(column.typed::<Int64Type>().write_batch(list, None, None)?),
            Self::Texts(list) => drop(column.typed::<ByteArrayType>().write_batch(list, None, None)?),
        }
        match self {
            Self::Numbers(list) => list.clear(),
            Self::Wholes(list) => list.clear(),
            Self::Texts(list) => list.clear(),
        }
        column.close()
    }
}

fn schema(columns: &[Column]) -> Written<Arc<Type>> {
    let field = |c: &Column| {
        let (physical, logical) = match c.kind {
            Kind::Number | Kind::Repeated => (Physical::DOUBLE, None),
            Kind::Whole => (Physical::INT64, None),
            Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let made = Type::primitive_type_builder(&c.name, physical)
            .with_repetition(Repetition::REQUIRED)
            .with_logical_type(logical)
            .build()?;
        Ok(Arc::new(made))
    };
    let fields = columns.iter().map(field).collect::<Written<Vec<_>>>()?;
    Ok(Arc::new(Type::group_type_builder("bond").with_fields(fields).build()?))
}

/// Numbers that change in every row are split into their bytes, which compress well, where a dictionary would only make
/// them larger.
fn properties(columns: &[Column]) -> WriterProperties {
    let mut builder = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_created_by(concat!("bond version ", env!("CARGO_PKG_VERSION")).into());
    for c in columns.iter().filter(|c| c.kind == Kind::Number) {
        let path = ColumnPath::new(vec![c.name.clone()]);
        builder = builder
            .set_column_dictionary_enabled(path.clone(), false)
            .set_column_encoding(path, Encoding::BYTE_STREAM_SPLIT);
    }
    builder.build()
}

/// What it means that a table cannot be written.
fn unwritable(path: &Path, e: &ParquetError) -> Stop {
    let why = match e {
        ParquetError::External(inner) => inner.to_string(),
        other => other.to_string(),
    };
    Stop::Usage(format!("cannot write {}: {why}", path.display()))
}
