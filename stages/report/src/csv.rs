//! A table as CSV (RFC 4180).

use crate::table::{Cell, DataTable};

/// Writes a table: numbers in full, words quoted where they must be.
pub(crate) fn csv(table: &DataTable) -> String {
    let header = table.columns.iter().map(|column| quoted(&column.key));
    let mut text = header.collect::<Vec<_>>().join(",") + "\n";
    for row in &table.rows {
        let cells = row.iter().map(|cell| match cell {
            Cell::Number(number, _) => number.to_string(),
            Cell::Missing => String::new(),
            Cell::Link { value, .. } => quoted(value),
            Cell::Text(_) | Cell::Marked(..) => quoted(cell.shown()),
        });
        text.push_str(&cells.collect::<Vec<_>>().join(","));
        text.push('\n');
    }
    text
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_whole_words_quoted_and_gaps_empty() {
        let mut table = DataTable::new(
            "t",
            "",
            &[("object", "Object"), ("rate", "Rate"), ("n", "n")],
        );
        table.row([
            Cell::text("a \"b\", c"),
            Cell::share(1.0 / 3.0),
            Cell::Missing,
        ]);
        let expected = "object,rate,n\n\"a \"\"b\"\", c\",0.3333333333333333,\n";
        assert_eq!(csv(&table), expected);
    }
}
