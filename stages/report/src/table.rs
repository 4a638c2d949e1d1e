//! A table as pages, reviews and programs read it: made once, written as HTML, Markdown and CSV; sections of tables.

/// A table.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct DataTable {
    /// Its file's name without the ending, and its anchor.
    pub(crate) id: &'static str,
    /// Description of its content.
    pub(crate) caption: String,
    pub(crate) columns: Vec<Column>,
    pub(crate) rows: Vec<Vec<Cell>>,
}

/// A column.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Column {
    /// Its name in CSV, with its unit.
    pub(crate) key: String,
    /// Its heading.
    pub(crate) label: String,
}

/// A cell.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Cell {
    /// Words.
    Text(String),
    /// A name by which motions can be shown: an object, or a reason for failing.
    Link {
        /// Filter to set: `object` or `verdict`.
        filter: &'static str,
        /// The value to filter by.
        value: String,
        /// The text shown.
        shown: String,
    },
    /// A number, and its text.
    Number(f64, String),
    /// The ends of an interval, and its text.
    Interval([f64; 2], String),
    /// A number of another protocol than the page's, or nothing to compare: with the reason.
    Marked(String, String),
    /// No value.
    Missing,
}

impl DataTable {
    pub(crate) fn new(id: &'static str, caption: &str, columns: &[(&str, &str)]) -> Self {
        let columns = columns.iter().map(|(key, label)| Column {
            key: (*key).to_owned(),
            label: (*label).to_owned(),
        });
        Self {
            id,
            caption: caption.to_owned(),
            columns: columns.collect(),
            rows: Vec::new(),
        }
    }

    pub(crate) fn row(&mut self, cells: impl Into<Vec<Cell>>) {
        self.rows.push(cells.into());
    }
}

impl Cell {
    pub(crate) fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    pub(crate) fn count(n: i64) -> Self {
        Self::Number(n as f64, crate::numbers::count(n))
    }

    pub(crate) fn share(share: f64) -> Self {
        Self::Number(share, crate::numbers::percent(share))
    }

    /// An interval of shares.
    pub(crate) fn interval(ends: [f64; 2]) -> Self {
        let [low, high] = ends.map(|end| 100.0 * end);
        // It does not break.
        let text = format!("{low:.1}\u{a0}to\u{a0}{high:.1}\u{a0}%");
        Self::Interval(ends, text)
    }

    /// Returns the cell's text.
    pub(crate) fn shown(&self) -> &str {
        match self {
            Self::Text(text)
            | Self::Number(_, text)
            | Self::Interval(_, text)
            | Self::Marked(text, _) => text,
            Self::Link { shown, .. } => shown,
            Self::Missing => "–",
        }
    }

    /// Whether the cell is aligned right.
    pub(crate) fn is_number(&self) -> bool {
        matches!(self, Self::Number(..) | Self::Missing)
    }
}

/// An object with its pictures.
#[derive(Debug, Clone)]
pub(crate) struct Tile {
    pub(crate) object: String,
    pub(crate) pictures: Vec<Picture>,
    /// Lines about it.
    pub(crate) lines: Vec<String>,
    /// Whether the player has a motion to it.
    pub(crate) has_motion: bool,
}

/// A picture.
#[derive(Debug, Clone)]
pub(crate) struct Picture {
    pub(crate) caption: &'static str,
    /// What it shows, for who does not see it.
    pub(crate) about: String,
    /// A PNG file.
    pub(crate) png: Vec<u8>,
}

/// A part of the page.
#[derive(Debug, Clone, Default)]
pub(crate) struct Section {
    /// Its anchor.
    pub(crate) id: &'static str,
    pub(crate) title: &'static str,
    /// Text, a sentence or some each.
    pub(crate) paragraphs: Vec<String>,
    /// Charts as SVG, each with its description.
    pub(crate) charts: Vec<(String, String)>,
    /// Objects with pictures, on the page alone.
    pub(crate) tiles: Vec<Tile>,
    pub(crate) tables: Vec<DataTable>,
}

impl Section {
    pub(crate) fn new(id: &'static str, title: &'static str) -> Self {
        Self {
            id,
            title,
            ..Self::default()
        }
    }

    pub(crate) fn say(&mut self, text: impl Into<String>) {
        self.paragraphs.push(text.into());
    }

    pub(crate) fn chart(&mut self, about: &str, svg: Option<String>) {
        self.charts.extend(svg.map(|svg| (about.to_owned(), svg)));
    }
}
