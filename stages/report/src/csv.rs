//! A table as CSV (RFC 4180).

use crate::table::{Cell, DataTable};

/// Key of a column of intervals, two columns here.
const INTERVAL: &str = "interval";

/// Writes a table: numbers in full, an interval in two columns, words quoted where they must be.
pub(crate) fn csv(table: &DataTable) -> String {
    let header = table.columns.iter().map(|column| {
        if column.key == INTERVAL {
            format!("{INTERVAL}_low,{INTERVAL}_high")
        } else {
            quoted(&column.key)
        }
    });
    let mut text = header.collect::<Vec<_>>().join(",") + "\n";
    for row in &table.rows {
        let cells = row.iter().zip(&table.columns);
        let cells = cells.map(|(cell, column)| match cell {
            Cell::Number(number, _) => number.to_string(),
            Cell::Interval([low, high], _) => format!("{low},{high}"),
            Cell::Missing if column.key == INTERVAL => ",".to_owned(),
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
            &[
                ("object", "Object"),
                ("rate", "Rate"),
                ("interval", "95 %"),
                ("n", "n"),
            ],
        );
        table.row([
            Cell::text("a \"b\", c"),
            Cell::share(1.0 / 3.0),
            Cell::interval([0.25, 0.5]),
            Cell::Missing,
        ]);
        table.row([
            Cell::text("d"),
            Cell::Missing,
            Cell::Missing,
            Cell::count(2),
        ]);
        let expected = "object,rate,interval_low,interval_high,n\n\
                        \"a \"\"b\"\", c\",0.3333333333333333,0.25,0.5,\nd,,,,2\n";
        assert_eq!(csv(&table), expected);
    }
}
