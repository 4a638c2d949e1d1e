//! `pipeline query`

use std::path::Path;

use lake::Lake;
use polars::{prelude::*, sql::SQLContext};

use crate::{
    arguments::{QueryArgs, QueryFormat},
    command_line::Program,
    outcome::{Outcome, Trouble},
    report,
};

/// Answers a question in SQL over the tables of the newest run's pipeline.
pub(crate) fn query(program: &Program, args: &QueryArgs) -> Result<Outcome, Trouble> {
    let lake = Lake::open(&program.lake);
    let tables = lake.tables()?;
    if tables.is_empty() {
        return Err(Trouble::usage(
            format!("no tables in the lake `{}`", lake.root().display()),
            "make some with `pipeline run pipelines/cgf.toml`, or name another lake with `--lake DIR`",
        ));
    }
    let failed = |err: PolarsError| {
        Trouble::failed(err, Some(format!("the tables are: {}", tables.join(", "))))
    };
    let mut context = SQLContext::new();
    for newest in lake.newest_tables()? {
        context.register(&newest.table, scan(&newest.folder).map_err(failed)?);
    }
    for (name, folder) in lake.history_tables()? {
        context.register(&name, scan(&folder).map_err(failed)?);
    }
    let answer = context.execute(&args.sql).and_then(LazyFrame::collect);
    let mut answer = answer.map_err(failed)?;
    let bytes = match args.format {
        QueryFormat::Table => table(&answer).into_bytes(),
        QueryFormat::Csv => {
            let mut bytes = Vec::new();
            CsvWriter::new(&mut bytes)
                .finish(&mut answer)
                .map_err(failed)?;
            bytes
        }
        QueryFormat::Json => {
            let mut bytes = Vec::new();
            let mut writer = JsonWriter::new(&mut bytes).with_json_format(JsonFormat::JsonLines);
            writer.finish(&mut answer).map_err(failed)?;
            bytes
        }
        QueryFormat::Parquet => {
            let mut bytes = Vec::new();
            ParquetWriter::new(&mut bytes)
                .finish(&mut answer)
                .map_err(failed)?;
            bytes
        }
    };
    report::data(&bytes);
    Ok(Outcome::Done)
}

fn scan(folder: &Path) -> PolarsResult<LazyFrame> {
    let pattern = format!("{}/**/*.parquet", folder.display());
    let options = ScanArgsParquet {
        hive_options: HiveOptions::new_enabled(),
        ..ScanArgsParquet::default()
    };
    LazyFrame::scan_parquet(PlRefPath::new(pattern), options)
}

/// The answer in aligned columns, numbers to the right.
fn table(answer: &DataFrame) -> String {
    let columns = answer.columns();
    let mut rows = vec![
        columns
            .iter()
            .map(|column| column.name().to_string())
            .collect::<Vec<_>>(),
    ];
    for row in 0..answer.height() {
        rows.push(columns.iter().map(|column| cell(column, row)).collect());
    }
    let right: Vec<usize> = columns
        .iter()
        .enumerate()
        .filter(|(_, column)| column.dtype().is_primitive_numeric())
        .map(|(idx, _)| idx)
        .collect();
    report::columns(&rows, &right)
}

fn cell(column: &Column, row: usize) -> String {
    match column.get(row) {
        Ok(AnyValue::Null) | Err(_) => "-".to_owned(),
        Ok(AnyValue::String(text)) => text.to_owned(),
        Ok(AnyValue::Float64(number)) => format!("{number:.4}"),
        Ok(value) => value.to_string(),
    }
}
