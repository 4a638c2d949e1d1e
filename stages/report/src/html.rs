//! The page: one file that needs no other and no network.

use crate::{
    Gathered, Motion, ReportError,
    embed::embedded,
    numbers::words,
    render::Head,
    table::{Cell, DataTable, Section},
};

/// How it looks.
const STYLE: &str = include_str!("../page/page.css");
/// Reads and draws `.glb` files.
const PLAYER: &str = include_str!("../page/player.js");
/// Filters, buttons and keys.
const CONTROLS: &str = include_str!("../page/controls.js");

/// Writes the page.
pub(crate) fn page(
    head: &Head,
    sections: &[Section],
    gathered: &Gathered,
) -> Result<String, ReportError> {
    let mut body = String::new();
    for (idx, section) in sections.iter().enumerate() {
        body.push_str(&of_section(section));
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
    let links: String = contents
        .iter()
        .map(|(id, title)| format!("<li><a href=\"#{id}\">{}</a></li>", escaped(title)))
        .collect();
    let below: String = head
        .below
        .iter()
        .map(|line| format!("<p>{}</p>\n", escaped(line)))
        .collect();
    let mut scripts = String::new();
    for (idx, motion) in gathered.motions.iter().enumerate() {
        let data = embedded(&motion.glb)?;
        scripts.push_str(&format!(
            "<script type=\"text/plain\" id=\"glb-{idx}\">{data}</script>\n"
        ));
    }
    let title = escaped(&head.title);
    let headline = escaped(&head.headline);
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <title>{title}</title>\n<link rel=\"icon\" href=\"data:,\">\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
         <header>\n<h1>{title}</h1>\n<p class=\"headline\" id=\"headline\">{headline}</p>\n{below}\
         <nav aria-label=\"Sections\"><ul>{links}</ul></nav>\n</header>\n<main>\n{body}</main>\n\
         {scripts}<script>\n{PLAYER}</script>\n<script>\n{CONTROLS}</script>\n</body>\n</html>\n"
    ))
}

fn of_section(section: &Section) -> String {
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
    for table in &section.tables {
        text.push_str(&of_table(table));
    }
    text.push_str("</section>\n");
    text
}

fn of_table(table: &DataTable) -> String {
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
            let shown = of_cell(cell);
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

fn of_cell(cell: &Cell) -> String {
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
        Cell::Text(_) | Cell::Number(..) | Cell::Missing => shown,
    }
}

/// The player with its list of motions.
fn motions(gathered: &Gathered) -> String {
    let mut text = String::from(
        "<section id=\"motions\" aria-labelledby=\"motions-title\">\n<h2 id=\"motions-title\">Motions</h2>\n",
    );
    let all = &gathered.motions;
    if all.is_empty() {
        text.push_str(
            "<p>No rollout of this run has a recording: nothing was screened, or <code>recorded_per_object</code> of \
             the screen is 0.</p>\n</section>\n",
        );
        return text;
    }
    let rollouts_n = gathered.rollouts.values().flatten().count();
    text.push_str(&format!(
        "<p>{} of {} recorded rollouts, of {rollouts_n}: one of each reason for failing, a success of each object, near \
         misses. Blue: the hand. Purple, transparent: where its joints were commanded. Orange: the object. Red: contacts, \
         larger with more force. Drag to turn, with the right button or Shift to shift, scroll to zoom.</p>\n",
        all.len(),
        gathered.recorded_n
    ));
    let select = |id: &str, label: &str, values: Vec<(String, String)>| {
        let options: String = values
            .iter()
            .map(|(value, shown)| {
                format!(
                    "<option value=\"{}\">{}</option>",
                    escaped(value),
                    escaped(shown)
                )
            })
            .collect();
        format!(
            "<label for=\"{id}\">{label} <select id=\"{id}\"><option value=\"\">all</option>{options}</select></label>\n"
        )
    };
    let distinct = |of: &dyn Fn(&Motion) -> (String, String)| -> Vec<(String, String)> {
        let mut values: Vec<(String, String)> = all.iter().map(of).collect();
        values.sort();
        values.dedup();
        values
    };
    text.push_str("<div class=\"filters\">\n");
    text.push_str(&select(
        "filter-object",
        "Object",
        distinct(&|one| (one.object.clone(), one.object.clone())),
    ));
    text.push_str(&select(
        "filter-verdict",
        "Verdict",
        distinct(&|one| (one.verdict.clone(), words(&one.verdict))),
    ));
    let standing = |one: &Motion| {
        let word = one.standing.as_str();
        (word.to_owned(), word.to_owned())
    };
    text.push_str(&select("filter-standing", "Standing", distinct(&standing)));
    text.push_str(&select(
        "filter-generator",
        "Generator",
        distinct(&|one| (one.generator.clone(), one.generator.clone())),
    ));
    text.push_str("<span id=\"shown-count\" role=\"status\"></span>\n</div>\n");
    text.push_str(
        "<div class=\"player\">\n<div class=\"stage\">\n\
         <canvas id=\"view\" width=\"960\" height=\"600\" role=\"img\" tabindex=\"0\" \
         aria-label=\"The motion in three dimensions\"></canvas>\n\
         <p id=\"no-webgl\" hidden>This browser draws no 3D (WebGL 2 is missing or switched off).</p>\n\
         <p id=\"motion-name\" role=\"status\"></p>\n\
         <div class=\"controls\">\n\
         <button type=\"button\" id=\"previous\" title=\"Previous motion (P)\">Previous</button>\n\
         <button type=\"button\" id=\"play\" title=\"Play or pause (space)\">Play</button>\n\
         <button type=\"button\" id=\"next\" title=\"Next motion (N)\">Next</button>\n\
         <label for=\"scrub\" class=\"grow\">Time <input type=\"range\" id=\"scrub\" min=\"0\" max=\"1\" step=\"0.001\" value=\"0\"></label>\n\
         <output id=\"time\" for=\"scrub\">0.00 s</output>\n\
         <label for=\"speed\">Speed <select id=\"speed\"><option value=\"0.1\">0.1</option><option value=\"0.25\">0.25</option>\
         <option value=\"0.5\">0.5</option><option value=\"1\" selected>1</option><option value=\"2\">2</option></select></label>\n\
         <label for=\"camera\">View <select id=\"camera\"><option value=\"oblique\">oblique</option><option value=\"front\">front</option>\
         <option value=\"side\">side</option><option value=\"top\">top</option></select></label>\n\
         <label for=\"ghost\"><input type=\"checkbox\" id=\"ghost\" checked> Command</label>\n\
         <label for=\"contacts\"><input type=\"checkbox\" id=\"contacts\" checked> Contacts</label>\n\
         <label for=\"follow\"><input type=\"checkbox\" id=\"follow\" checked> Follow</label>\n\
         </div>\n\
         <p class=\"keys\">Keys: space plays, N and P change the motion, comma and point step, \
         arrow keys turn the view while it is in focus.</p>\n\
         </div>\n<ol id=\"list\">\n",
    );
    for (idx, motion) in all.iter().enumerate() {
        let standing = motion.standing.as_str();
        text.push_str(&format!(
            "<li><button type=\"button\" id=\"motion-{idx}\" class=\"motion {}\" data-idx=\"{idx}\" data-id=\"{}\" data-object=\"{}\" \
             data-verdict=\"{}\" data-standing=\"{standing}\" data-generator=\"{}\" data-recording=\"{}\">\
             <span>{}</span> <span class=\"verdict\">{}</span></button></li>\n",
            standing.replace(' ', "-"),
            escaped(&motion.id),
            escaped(&motion.object),
            escaped(&motion.verdict),
            escaped(&motion.generator),
            escaped(motion.recording.as_deref().unwrap_or_default()),
            escaped(&motion.id),
            escaped(&words(&motion.verdict)),
        ));
    }
    text.push_str("</ol>\n</div>\n</section>\n");
    text
}

/// Text with what stands between backticks as code.
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

/// Text that HTML takes as text, in elements and in quoted attributes.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '&' => escaped.push_str("&amp;"),
            '"' => escaped.push_str("&quot;"),
            character => escaped.push(character),
        }
    }
    escaped
}
