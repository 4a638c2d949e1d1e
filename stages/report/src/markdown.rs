//! The report for reviews of code: one sentence or table after another, without motions.

use crate::{
    render::Head,
    table::{DataTable, Section},
};

/// Writes the report.
pub(crate) fn markdown(head: &Head, sections: &[Section]) -> String {
    let mut text = format!(
        "# {}\n\n**{}**\n",
        plain(&head.title),
        plain(&head.headline)
    );
    for line in &head.below {
        text.push_str(&format!("{}\n", plain(line)));
    }
    for section in sections {
        text.push_str(&format!("\n## {}\n", section.title));
        for paragraph in &section.paragraphs {
            text.push_str(&format!("\n{}\n", plain(paragraph)));
        }
        for table in &section.tables {
            text.push_str(&format!("\n{}:\n\n{}", plain(&table.caption), rows(table)));
        }
    }
    text
}

fn rows(table: &DataTable) -> String {
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let labels = table.columns.iter().map(|column| plain(&column.label));
    let mut text = line(labels.collect());
    text.push_str(&line(vec!["---".to_owned(); table.columns.len()]));
    for row in &table.rows {
        let cells = row.iter().map(|cell| {
            let mark = if matches!(cell, crate::table::Cell::Marked(..)) {
                " ≠"
            } else {
                ""
            };
            plain(cell.shown()) + mark
        });
        text.push_str(&line(cells.collect()));
    }
    text
}

/// Text that Markdown takes as text.
fn plain(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    for character in text.chars() {
        if "\\|*<>[]`".contains(character) {
            plain.push('\\');
        }
        plain.push(if character == '\n' { ' ' } else { character });
    }
    plain
}
