//! Provenance of the run, and the command that repeats it.

use crate::{
    PageData,
    table::{Cell, DataTable, Section},
};

pub(crate) fn section(gathered: &PageData) -> Section {
    let mut section = Section::new("provenance", "Provenance");
    let run = &gathered.facts.run;
    let mut table = DataTable::new(
        "provenance",
        "How it was made",
        &[("what", "What"), ("value", "Value")],
    );
    let mut put = |what: &str, value: String| table.row([Cell::text(what), Cell::text(value)]);
    put("pipeline", run.pipeline.clone());
    put("seed", run.seed.to_string());
    put("program", format!("pipeline {}", env!("CARGO_PKG_VERSION")));
    put("the command that makes it again", gathered.facts.command());
    if run.overrides.iter().any(|given| given.ends_with("=…")) {
        put(
            "…",
            "a file or folder outside the lake, which counts by its content".to_owned(),
        );
    }
    section.tables.push(table);
    let mut inputs = DataTable::new(
        "inputs",
        "Inputs of this report: digests of their partitions and files",
        &[
            ("input", "Input"),
            ("from", "From"),
            ("digest", "Digest (BLAKE3)"),
        ],
    );
    for (input, digest) in &gathered.digests {
        let from = run.wired.get(input).cloned().unwrap_or_default();
        inputs.row([Cell::text(input), Cell::text(from), Cell::text(digest)]);
    }
    if !inputs.rows.is_empty() {
        section.tables.push(inputs);
    }
    let mut code = DataTable::new(
        "code",
        "Code of each output: digests of its sources and locked dependencies",
        &[("output", "Output"), ("digest", "Digest (BLAKE3)")],
    );
    for (output, digest) in &run.code {
        code.row([Cell::text(output), Cell::text(digest)]);
    }
    if !code.rows.is_empty() {
        section.tables.push(code);
    }
    section
}
