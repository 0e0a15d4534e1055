//! Rows of a log as Apache Parquet: <https://parquet.apache.org/docs/file-format/>.

use std::io;
use std::sync::Arc;

use parquet::basic::{Compression, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{DoubleType, Int64Type};
use parquet::errors::Result;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

use super::export::{Out, ScanRows, Sheet};

/// Rows that are kept in memory and written together.
const GROUP_ROWS: usize = 1 << 17;

/// Columns that wait for the rest of their group: scans; time and the values of the axes, NaN where nothing is known.
type Group = (Vec<i64>, Vec<Vec<f64>>);

/// A row each scan; `names` of the columns behind scan and time.
pub(super) fn parquet(out: Out<'_>, names: Vec<String>) -> io::Result<Sheet<'_>> {
    let names: Vec<String> = std::iter::once("time_s".into()).chain(names).collect();
    let mut group: Group = (Vec::new(), vec![Vec::new(); names.len()]);
    let mut writer = begin(out, &names)?;
    Ok(Box::new(move |rows: Option<&ScanRows>| {
        let Some(rows @ [(_, scan, first), ..]) = rows else {
            if !group.0.is_empty() {
                write(&mut writer, &mut group)?;
            }
            writer.finish()?;
            return Ok(());
        };
        group.0.push(*scan as i64);
        let of_axes = rows
            .iter()
            .flat_map(|(.., row)| bytemuck::cast_ref::<_, [f64; 9]>(row).iter().skip(1));
        let values = std::iter::once(&first.time_s).chain(of_axes);
        for (column, value) in group.1.iter_mut().zip(values) {
            column.push(*value);
        }
        if group.0.len() >= GROUP_ROWS {
            write(&mut writer, &mut group)?;
        }
        Ok(())
    }))
}

type Writer<'f> = SerializedFileWriter<Out<'f>>;

fn begin<'f>(out: Out<'f>, names: &[String]) -> Result<Writer<'f>> {
    let column = |name: &str, kind: Physical| {
        let column = Type::primitive_type_builder(name, kind);
        column
            .with_repetition(Repetition::REQUIRED)
            .build()
            .map(Arc::new)
    };
    let values = names.iter().map(|name| column(name, Physical::DOUBLE));
    let columns = std::iter::once(column("scan", Physical::INT64)).chain(values);
    let columns = columns.collect::<Result<Vec<_>>>()?;
    let schema = Type::group_type_builder("run")
        .with_fields(columns)
        .build()?;
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_created_by(concat!("quadrant ", env!("CARGO_PKG_VERSION")).into())
        .build();
    SerializedFileWriter::new(out, Arc::new(schema), Arc::new(properties))
}

/// Writes the group, and empties it.
fn write(writer: &mut Writer<'_>, group: &mut Group) -> Result<()> {
    let mut rows = writer.next_row_group()?;
    if let Some(mut column) = rows.next_column()? {
        column
            .typed::<Int64Type>()
            .write_batch(&group.0, None, None)?;
        column.close()?;
    }
    for values in &group.1 {
        if let Some(mut column) = rows.next_column()? {
            column
                .typed::<DoubleType>()
                .write_batch(values, None, None)?;
            column.close()?;
        }
    }
    rows.close()?;
    group.0.clear();
    group.1.iter_mut().for_each(Vec::clear);
    Ok(())
}
