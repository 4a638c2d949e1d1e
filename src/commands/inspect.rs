//! `pipeline inspect`

use dataflow::{Record, RecordOutcome, UnitRef};
use lake::{Lake, Provenance, Run, table};

use crate::{
    arguments::InspectArgs,
    command_line::Program,
    commands::lookup,
    label::Label,
    outcome::{CommandError, CommandOutcome},
    report,
    system_errors::in_words,
    timestamps,
};

/// Shows an artifact of a run.
pub(crate) fn inspect(
    program: &Program,
    args: &InspectArgs,
) -> Result<CommandOutcome, CommandError> {
    let lake = Lake::open(&program.lake);
    let run = lookup::run(&lake, args.run.as_deref())?;
    let (_, units) = lookup::units(&run, &args.artifact)?;
    let mut results = Vec::new();
    for &unit in &units {
        let result = lake.record(&unit.fingerprint)?;
        results.extend(result.map(|record| (unit, record)));
    }
    let n_collected = units.len() - results.len();
    if n_collected > 0 {
        program.say(
            Label::Note,
            format!(
                "{n_collected} partitions of `{}` were collected",
                args.artifact
            ),
        );
    }
    let text = if args.skipped {
        left_out(&results, &run)
    } else if let Some(partition) = &args.partition {
        let unit = lookup::unit(&units, run.number, &args.artifact, partition)?;
        match lake.record_and_provenance(&unit.fingerprint)? {
            Some((record, provenance)) => one(&lake, unit, &record, &provenance)?,
            None => format!("`{partition}` was collected; run {} had it\n", run.number),
        }
    } else {
        format!(
            "{} of run {}\n{}",
            args.artifact,
            run.number,
            overview(&lake, &results)?
        )
    };
    report::data(text.as_bytes())?;
    Ok(CommandOutcome::Done)
}

fn left_out(results: &[(&UnitRef, Record)], run: &Run) -> String {
    let mut rows = Vec::new();
    for (unit, record) in results {
        if let Some(reason) = record.outcome.reason() {
            rows.push(vec![
                record.outcome.word().to_owned(),
                unit.partition.to_string(),
                in_words(reason),
            ]);
        }
    }
    if rows.is_empty() {
        return format!("nothing was skipped or filtered in run {}\n", run.number);
    }
    report::columns(&rows, &[])
}

fn overview(lake: &Lake, results: &[(&UnitRef, Record)]) -> Result<String, CommandError> {
    let mut text = String::new();
    let mut rows = vec![report::header(["partition", "result", "rows", "metrics"])];
    let mut columns = None;
    for (unit, record) in results {
        let (result, n_rows, metrics) = match &record.outcome {
            RecordOutcome::Made { files, metrics, .. } => {
                let mut n_rows = String::new();
                if let Some(file) = files.get(table::FILE) {
                    let description = table::describe(&lake.file(file))?;
                    n_rows = description.rows.to_string();
                    columns.get_or_insert(description.columns);
                }
                let metrics: Vec<String> = metrics
                    .iter()
                    .map(|(name, value)| format!("{name} {value:.4}"))
                    .collect();
                ("made", n_rows, metrics.join(", "))
            }
            RecordOutcome::Skipped { reason } => ("skipped", String::new(), in_words(reason)),
            RecordOutcome::Filtered { reason } => ("filtered", String::new(), in_words(reason)),
        };
        rows.push(vec![
            unit.partition.to_string(),
            result.to_owned(),
            n_rows,
            metrics,
        ]);
    }
    if let Some(columns) = columns {
        let mut lines = vec![report::header(["column", "type", "unit", "about"])];
        lines.extend(columns.into_iter().map(|column| {
            vec![
                column.name,
                column.data_type,
                column.unit,
                column.description,
            ]
        }));
        text.push('\n');
        text.push_str(&report::columns(&lines, &[]));
    }
    text.push('\n');
    text.push_str(&report::columns(&rows, &[2]));
    Ok(text)
}

/// Everything about one partition.
fn one(
    lake: &Lake,
    unit: &UnitRef,
    record: &Record,
    provenance: &Provenance,
) -> Result<String, CommandError> {
    let mut rows = vec![
        vec!["partition".to_owned(), unit.partition.to_string()],
        vec!["fingerprint".to_owned(), unit.fingerprint.to_string()],
    ];
    if let RecordOutcome::Made {
        files,
        labels,
        metrics,
        ..
    } = &record.outcome
    {
        for (name, file) in files {
            let path = lake.file(file);
            let place = if path.exists() {
                path.display().to_string()
            } else {
                "not in the lake".to_owned()
            };
            rows.push(vec![
                format!("file {name}"),
                format!("{} bytes, {place}", file.size),
            ]);
        }
        rows.extend(
            labels
                .iter()
                .map(|(name, value)| vec![format!("label {name}"), value.clone()]),
        );
        rows.extend(
            metrics
                .iter()
                .map(|(name, value)| vec![format!("metric {name}"), value.to_string()]),
        );
    }
    if let Some(log) = lake.log(&unit.fingerprint) {
        rows.push(vec!["log".to_owned(), log.display().to_string()]);
    }
    let mut text = report::columns(&rows, &[]);
    let json = serde_json::to_string_pretty(&record.fingerprint)
        .map_err(|err| CommandError::failed(err, None))?;
    text.push_str(&format!("made of {json}\n"));
    text.push_str(&format!(
        "made at {} UTC by {} on `{}` in {}\n",
        timestamps::minute(provenance.started_ns),
        provenance.program,
        provenance.host,
        report::duration(provenance.took_s)
    ));
    Ok(text)
}
