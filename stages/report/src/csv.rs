//! A table as CSV (RFC 4180).

use crate::table::{Cell, DataTable};

/// Writes a table: numbers in full, an interval in two columns, words quoted where they must be.
pub(crate) fn csv(table: &DataTable) -> String {
    let is_interval = |idx: usize| {
        let mut cells = table.rows.iter().filter_map(|row| row.get(idx));
        cells.any(|cell| matches!(cell, Cell::Interval(..)))
    };
    let are_intervals: Vec<bool> = (0..table.columns.len()).map(is_interval).collect();
    let header = table.columns.iter().zip(&are_intervals);
    let header = header.map(|(column, is_interval)| match is_interval {
        true => format!("{0}_low,{0}_high", column.key),
        false => quoted(&column.key),
    });
    let mut text = header.collect::<Vec<_>>().join(",") + "\n";
    for row in &table.rows {
        let cells = row.iter().zip(&are_intervals);
        let cells = cells.map(|(cell, is_interval)| match cell {
            Cell::Number(number, _) => number.to_string(),
            Cell::Interval([low, high], _) => format!("{low},{high}"),
            Cell::Missing if *is_interval => ",".to_owned(),
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
