//! A run exported to Parquet has what its export to CSV has, read by the library that others read it with.
//!
//! A binary of its own, because it is built with the feature `parquet` only: `cargo test --release --features parquet --test parquet`.

// Each test binary uses a part of it.
#[allow(dead_code)]
#[path = "support.rs"]
mod support;

use std::fs::File;
use std::path::Path;

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use support::{Bench, circle_program, quadrant, run_with};

fn export(run: &Path, format: &str) {
    let file = format!("x.{format}");
    let exported = quadrant()
        .current_dir(run)
        .args(["runs", "export", ".", "--as", format, "--out", &file])
        .output()
        .expect("an export");
    assert!(exported.status.success(), "{exported:?}");
}

#[test]
fn an_export_to_parquet_has_the_same_columns_and_values_as_one_to_csv() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(5.0, 3000.0, (0.0, 0.0), 0.0));
    let run = run_with(bench.path(), &program, &[]);
    for format in ["csv", "parquet"] {
        export(&run.out, format);
    }
    let text = std::fs::read_to_string(run.out.join("x.csv")).expect("a table");
    let mut lines = text.lines().map(|line| line.split(','));
    let names: Vec<&str> = lines.next().expect("names").collect();
    let file = File::open(run.out.join("x.parquet")).expect("a file");
    let file = SerializedFileReader::new(file).expect("Parquet");
    let mut rows = file.get_row_iter(None).expect("rows");
    for line in lines {
        let row = rows.next().expect("a row").expect("a row");
        let found = row.get_column_iter().map(|(name, field)| {
            let value = match field {
                Field::Long(scan) => scan.to_string(),
                Field::Double(value) if value.is_finite() => value.to_string(),
                Field::Double(_) => String::new(),
                other => panic!("{name}: {other}"),
            };
            (name.as_str(), value)
        });
        let expected = line.map(String::from);
        assert!(found.eq(names.iter().copied().zip(expected)), "{row}");
    }
    assert!(rows.next().is_none());
}
