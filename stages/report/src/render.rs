//! The files of a report.

use std::collections::BTreeMap;

use crate::{
    PageData, ReportError, csv, funnel, html, markdown, paper,
    sections::{
        compare, cost, failures, objects, pose_errors, provenance, result, training, views,
    },
    table::Section,
};

/// The files of a report, by name: `index.html`, `report.md` and the tables as CSV.
pub type Rendered = BTreeMap<String, Vec<u8>>;

/// Head of a report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Head {
    pub(crate) title: String,
    pub(crate) headline: String,
    /// Further lines.
    pub(crate) below: Vec<String>,
}

/// A run with its name.
#[derive(Debug, Clone)]
pub(crate) struct NamedRun<'a> {
    pub(crate) name: String,
    pub(crate) gathered: &'a PageData,
}

/// Writes the report of a run, or of several side by side, each with its name; sections are those of the first.
///
/// # Errors
///
/// Fails if a motion cannot be compressed.
pub fn render(runs: &[(String, PageData)]) -> Result<Rendered, ReportError> {
    let nothing = PageData::default();
    let main = runs.first().map_or(&nothing, |(_, gathered)| gathered);
    let named: Vec<NamedRun<'_>> = runs
        .iter()
        .map(|(name, gathered)| NamedRun {
            name: name.clone(),
            gathered,
        })
        .collect();
    let head = result::head(main);
    let result = Some(result::section(main));
    let sections: Vec<Section> = [result, compare::section(&named), views::section(main)]
        .into_iter()
        .flatten()
        .chain([
            objects::section(main),
            failures::section(main),
            pose_errors::section(main),
            funnel::section(main),
            training::section(main),
            paper::section(main),
            cost::section(main),
            provenance::section(main),
        ])
        .collect();
    let mut files = Rendered::new();
    for table in sections.iter().flat_map(|section| &section.tables) {
        files.insert(format!("{}.csv", table.id), csv::csv(table).into_bytes());
    }
    files.insert(
        "report.md".to_owned(),
        markdown::markdown(&head, &sections).into_bytes(),
    );
    files.insert(
        "index.html".to_owned(),
        html::page(&head, &sections, main)?.into_bytes(),
    );
    Ok(files)
}
