//! Answers as bytes.

use std::fs;

use datafusion::arrow::array::{Array, ArrayRef, RecordBatch};

use super::{
    page::{ColumnWidth, Page, fit},
    value_text,
};
use crate::report::{self, LEFT_OUT, cut};

/// A table for people.
pub(super) struct Printed {
    pub(super) text: String,
    /// Notes on what did not fit, one line each.
    pub(super) left_out: Vec<String>,
}

/// Aligned columns that fit the page, numbers to the right.
pub(super) fn table(answer: &RecordBatch, page: Page) -> Printed {
    let n_rows = answer.num_rows();
    let (first, last) = page.rows_of(n_rows);
    let n_hidden = n_rows - first - last;
    let mut left_out = Vec::new();
    if n_hidden > 0 {
        left_out.push(format!(
            "{n_hidden} of {n_rows} rows left out; `--format csv` prints all"
        ));
    }
    let mut columns: Vec<(Vec<String>, bool)> = named(answer)
        .map(|(name, column)| {
            let shown = (0..first).chain(n_rows - last..n_rows);
            let mut cells: Vec<String> = shown
                .map(|row| value_text::cell(column, row, page.elements()))
                .collect();
            if n_hidden > 0 {
                cells.insert(first, LEFT_OUT.to_owned());
            }
            if column.data_type().is_floating() {
                align_points(&mut cells);
            }
            cells.insert(0, name.to_owned());
            (cells, column.data_type().is_numeric())
        })
        .collect();
    if let Some(width) = page.width {
        let hidden = fit_columns(&mut columns, width);
        if !hidden.is_empty() {
            left_out.push(format!(
                "columns left out: {}; name fewer in the question, or use `--format csv`",
                hidden.join(", ")
            ));
        }
    }
    let right: Vec<usize> = columns
        .iter()
        .enumerate()
        .filter(|(_, (_, is_number))| *is_number)
        .map(|(idx, _)| idx)
        .collect();
    let n_lines = columns.first().map_or(0, |(cells, _)| cells.len());
    let lines: Vec<Vec<String>> = (0..n_lines)
        .map(|line| {
            let cells = columns.iter().filter_map(|(cells, _)| cells.get(line));
            cells.cloned().collect()
        })
        .collect();
    Printed {
        text: report::columns(&lines, &right),
        left_out,
    }
}

/// Pads numbers so that their decimal points align when they are right-aligned.
fn align_points(cells: &mut [String]) {
    let after = |cell: &String| cell.find(['.', 'e']).map_or(0, |at| cell.len() - at);
    let longest = cells.iter().map(after).max().unwrap_or(0);
    for cell in cells {
        let blanks = longest - after(cell);
        cell.push_str(&" ".repeat(blanks));
    }
}

/// Cuts cells and drops columns until a line fits, and returns the names of the dropped columns.
fn fit_columns(columns: &mut Vec<(Vec<String>, bool)>, width: usize) -> Vec<String> {
    let length = |text: &String| text.chars().count();
    let wishes: Vec<ColumnWidth> = columns
        .iter()
        .map(|(cells, is_number)| {
            let widest = |cells: &[String]| cells.iter().map(length).max().unwrap_or(0);
            match cells.split_first() {
                Some((name, numbers)) if *is_number => {
                    ColumnWidth::numbers(length(name), widest(numbers))
                }
                _ => ColumnWidth::text(widest(cells)),
            }
        })
        .collect();
    let widths = fit(&wishes, width);
    let dropped = columns.split_off(widths.len());
    for ((cells, _), width) in columns.iter_mut().zip(widths) {
        for cell in cells {
            *cell = cut(cell, width);
        }
    }
    if let Some((first, _)) = dropped.first() {
        let marks = vec![LEFT_OUT.to_owned(); first.len()];
        columns.push((marks, false));
    }
    let names = dropped
        .into_iter()
        .filter_map(|(cells, _)| cells.into_iter().next());
    names.collect()
}

/// The columns with their names.
fn named(answer: &RecordBatch) -> impl Iterator<Item = (&str, &ArrayRef)> {
    let fields = answer.schema_ref().fields().iter();
    fields
        .map(|field| field.name().as_str())
        .zip(answer.columns())
}

/// Comma-separated values with a header; lists as JSON in one cell.
pub(super) fn csv(answer: &RecordBatch) -> anyhow::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(named(answer).map(|(name, _)| name))?;
    for row in 0..answer.num_rows() {
        for column in answer.columns() {
            writer.write_field(value_text::text(column, row))?;
        }
        writer.write_record(None::<&[u8]>)?;
    }
    Ok(writer.into_inner()?)
}

/// One JSON object per line.
pub(super) fn json_lines(answer: &RecordBatch) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    for row in 0..answer.num_rows() {
        let mut separator = b'{';
        for (name, column) in named(answer) {
            bytes.push(separator);
            separator = b',';
            serde_json::to_writer(&mut bytes, name)?;
            bytes.push(b':');
            serde_json::to_writer(&mut bytes, &value_text::json(column, row))?;
        }
        bytes.extend_from_slice(b"}\n");
    }
    Ok(bytes)
}

/// A Parquet file.
pub(super) fn parquet(answer: &RecordBatch) -> anyhow::Result<Vec<u8>> {
    let folder = tempfile::tempdir()?;
    lake::table::write_batch(folder.path(), answer)?;
    Ok(fs::read(folder.path().join(lake::table::FILE))?)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use datafusion::arrow::{
        array::{Float64Array, ListArray, StringArray},
        datatypes::Float64Type,
    };

    use super::*;

    fn answer() -> RecordBatch {
        let names: Vec<String> = (0..100)
            .map(|i| format!("a_rather_long_name_{i}"))
            .collect();
        let names: ArrayRef = Arc::new(StringArray::from(names));
        let numbers: Float64Array = (0..100).map(|i| Some(f64::from(i) / 8.0)).collect();
        let columns = [
            ("name", names.clone()),
            ("number", Arc::new(numbers)),
            ("again", names),
        ];
        RecordBatch::try_from_iter(columns).unwrap()
    }

    fn one(name: &str, column: ArrayRef) -> RecordBatch {
        RecordBatch::try_from_iter([(name, column)]).unwrap()
    }

    #[test]
    fn a_page_shows_the_first_and_last_rows_and_says_how_many_it_left_out() {
        let page = Page {
            width: None,
            rows: Some(4),
        };
        let printed = table(&answer(), page);
        let lines: Vec<&str> = printed.text.lines().collect();
        assert_eq!(lines.len(), 6, "{}", printed.text);
        assert!(lines[1].starts_with("a_rather_long_name_0 "), "{lines:?}");
        assert!(lines[3].starts_with('…'), "{lines:?}");
        assert!(lines[5].starts_with("a_rather_long_name_99 "), "{lines:?}");
        assert!(printed.left_out[0].starts_with("96 of 100 rows left out"));
    }

    #[test]
    fn no_line_is_wider_than_the_page() {
        for width in 1..60 {
            let page = Page {
                width: Some(width),
                rows: None,
            };
            let printed = table(&answer(), page);
            let widest = printed.text.lines().map(|line| line.chars().count()).max();
            assert!(widest.unwrap() <= width.max(4), "{width}\n{}", printed.text);
            assert_eq!(printed.text.lines().count(), 101);
        }
    }

    #[test]
    fn decimal_points_stand_below_each_other() {
        let rates = Float64Array::from(vec![0.75, 0.703_125, 12.0, 1.5e-6]);
        let answer = one("rate", Arc::new(rates));
        let text = table(&answer, Page::default()).text;
        assert_eq!(text, "     rate\n 0.75\n 0.703125\n12\n 1.5e-6\n", "{text}");
    }

    #[test]
    fn lists_in_csv_are_json() {
        let list = [Some([Some(0.1), Some(0.2)])];
        let list = ListArray::from_iter_primitive::<Float64Type, _, _>(list);
        let answer = one("list", Arc::new(list));
        let text = String::from_utf8(csv(&answer).unwrap()).unwrap();
        assert_eq!(text, "list\n\"[0.1,0.2]\"\n");
    }
}
