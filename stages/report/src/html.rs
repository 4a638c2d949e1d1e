//! The page: one file that needs no other and no network.

mod player;
mod tiles;

use charts::escaped;

use self::{player::motions, tiles::tiles};
use crate::{
    PageData, ReportError,
    embed::embedded,
    render::Head,
    table::{Cell, DataTable, Section},
};

/// Style sheet.
const STYLE: &str = include_str!("page/page.css");
/// Style of objects with pictures, on a page that has some.
const TILES_STYLE: &str = include_str!("page/tiles.css");
/// Reads and draws `.glb` files.
const PLAYER: &str = include_str!("page/player.js");
/// Filters, buttons and keys.
const CONTROLS: &str = include_str!("page/controls.js");

/// Writes the page.
pub(crate) fn page(
    head: &Head,
    sections: &[Section],
    gathered: &PageData,
) -> Result<String, ReportError> {
    let mut body = String::new();
    for (idx, section) in sections.iter().enumerate() {
        body.push_str(&section_html(section));
        // Motions stand after the result.
        if idx == 0 {
            body.push_str(&motions(gathered));
        }
    }
    let mut contents: Vec<(&str, &str)> = sections
        .iter()
        .map(|section| (section.id, section.title))
        .collect();
    contents.insert(1.min(contents.len()), ("motions", "Motions"));
    let links = contents.iter();
    let links =
        links.map(|(id, title)| format!("<li><a href=\"#{id}\">{}</a></li>", escaped(title)));
    let links = links.collect::<Vec<_>>().concat();
    let below = head.below.iter();
    let below = below.map(|line| format!("<p>{}</p>\n", escaped(line)));
    let below = below.collect::<Vec<_>>().concat();
    let mut scripts = String::new();
    for (idx, motion) in gathered.motions.iter().enumerate() {
        let data = embedded(&motion.glb)?;
        scripts.push_str(&format!(
            "<script type=\"text/plain\" id=\"glb-{idx}\">{data}</script>\n"
        ));
    }
    let has_tiles = sections.iter().any(|section| !section.tiles.is_empty());
    let tiles_style = if has_tiles { TILES_STYLE } else { "" };
    let title = escaped(&head.title);
    let headline = escaped(&head.headline);
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <title>{title}</title>\n<link rel=\"icon\" href=\"data:,\">\n<style>\n{STYLE}{tiles_style}</style>\n</head>\n<body>\n\
         <header>\n<h1>{title}</h1>\n<p class=\"headline\" id=\"headline\">{headline}</p>\n{below}\
         <nav aria-label=\"Sections\"><ul>{links}</ul></nav>\n</header>\n<main>\n{body}</main>\n\
         {scripts}<script>\n{PLAYER}</script>\n<script>\n{CONTROLS}</script>\n</body>\n</html>\n"
    ))
}

fn section_html(section: &Section) -> String {
    let id = section.id;
    let mut text = format!(
        "<section id=\"{id}\" aria-labelledby=\"{id}-title\">\n<h2 id=\"{id}-title\">{}</h2>\n",
        escaped(section.title)
    );
    for paragraph in &section.paragraphs {
        text.push_str(&format!("<p>{}</p>\n", with_code(paragraph)));
    }
    for (about, svg) in &section.charts {
        let about = escaped(about);
        let svg = svg.replacen(
            "<svg ",
            &format!("<svg role=\"img\" aria-label=\"{about}\" "),
            1,
        );
        text.push_str(&format!(
            "<figure tabindex=\"0\" role=\"group\" aria-label=\"{about}\">{svg}</figure>\n"
        ));
    }
    text.push_str(&tiles(&section.tiles));
    for table in &section.tables {
        text.push_str(&table_html(table));
    }
    text.push_str("</section>\n");
    text
}

fn table_html(table: &DataTable) -> String {
    let id = table.id;
    let caption = escaped(&table.caption);
    let mut text = format!(
        "<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-label=\"{caption}\">\n\
         <table id=\"table-{id}\">\n<caption>{caption}</caption>\n<thead><tr>"
    );
    let has_numbers = |idx: usize| {
        let mut cells = table.rows.iter().filter_map(|row| row.get(idx));
        cells.any(|cell| matches!(cell, Cell::Number(..)))
    };
    for (idx, column) in table.columns.iter().enumerate() {
        let class = if has_numbers(idx) {
            " class=\"number\""
        } else {
            ""
        };
        text.push_str(&format!(
            "<th scope=\"col\"{class}>{}</th>",
            escaped(&column.label)
        ));
    }
    text.push_str("</tr></thead>\n<tbody>\n");
    for row in &table.rows {
        text.push_str("<tr>");
        for (idx, cell) in row.iter().enumerate() {
            let shown = cell_html(cell);
            if idx == 0 {
                text.push_str(&format!("<th scope=\"row\">{shown}</th>"));
            } else if cell.is_number() || has_numbers(idx) {
                text.push_str(&format!("<td class=\"number\">{shown}</td>"));
            } else {
                text.push_str(&format!("<td>{shown}</td>"));
            }
        }
        text.push_str("</tr>\n");
    }
    text.push_str("</tbody>\n</table>\n</div>\n");
    text
}

fn cell_html(cell: &Cell) -> String {
    let shown = with_code(cell.shown());
    match cell {
        Cell::Link { filter, value, .. } => format!(
            "<button type=\"button\" class=\"link\" data-filter=\"{filter}\" data-value=\"{}\">{shown}</button>",
            escaped(value)
        ),
        Cell::Marked(_, how) => {
            let how = escaped(how);
            format!("{shown} <abbr class=\"mark\" title=\"{how}\">≠</abbr>")
        }
        Cell::Text(_) | Cell::Number(..) | Cell::Interval(..) | Cell::Missing => shown,
    }
}

/// Returns text with the parts between backticks as code.
fn with_code(text: &str) -> String {
    let parts = text.split('`').enumerate();
    parts
        .map(|(idx, part)| {
            if idx % 2 == 1 {
                format!("<code>{}</code>", escaped(part))
            } else {
                escaped(part)
            }
        })
        .collect()
}
