//! `pipeline inspect`

use dataflow::{NodeName, Record, RecordOutcome, UnitRef, nearest};
use lake::{Lake, table};

use crate::{
    arguments::InspectArgs,
    command_line::Program,
    outcome::{Outcome, Trouble},
    report,
};

/// Shows an artifact of the newest run.
pub(crate) fn inspect(program: &Program, args: &InspectArgs) -> Result<Outcome, Trouble> {
    let lake = Lake::open(&program.lake);
    let Some(run) = lake.newest_run()? else {
        return Err(Trouble::usage(
            format!("no run in the lake `{}`", lake.root().display()),
            "make one with `pipeline run pipelines/cgf.toml`, or name another lake with `--lake DIR`",
        ));
    };
    let (number, record) = (run.number, &run.record);
    let units: Vec<&UnitRef> = record
        .units
        .iter()
        .filter(|unit| Some(&unit.node) == NodeName::parse(&args.artifact).as_ref())
        .collect();
    if units.is_empty() {
        let mut known: Vec<String> = record
            .units
            .iter()
            .map(|unit| unit.node.to_string())
            .collect();
        known.dedup();
        let near = nearest(&args.artifact, known.iter().map(String::as_str));
        let hint = near.map_or_else(
            || format!("the newest run made: {}", known.join(", ")),
            |near| format!("did you mean `{near}`?"),
        );
        return Err(Trouble::usage(
            format!("no artifact `{}`", args.artifact),
            hint,
        ));
    }
    let mut results = Vec::new();
    for unit in units {
        let result = lake.record(&unit.fingerprint)?;
        results.extend(result.map(|record| (unit, record)));
    }
    let text = if args.skipped {
        left_out(&results)
    } else if let Some(partition) = &args.partition {
        let found = results
            .iter()
            .find(|(unit, _)| &unit.partition == partition);
        let (unit, record) = found.ok_or_else(|| {
            let near = nearest(
                partition,
                results.iter().map(|(unit, _)| unit.partition.as_str()),
            );
            Trouble::usage(
                format!("`{}` has no partition `{partition}`", args.artifact),
                near.map_or_else(
                    || format!("list them with `pipeline inspect {}`", args.artifact),
                    |near| format!("did you mean `{near}`?"),
                ),
            )
        })?;
        one(&lake, unit, record)?
    } else {
        format!(
            "{} of run {number}\n{}",
            args.artifact,
            overview(&lake, &results)?
        )
    };
    report::data(text.as_bytes());
    Ok(Outcome::Done)
}

fn left_out(results: &[(&UnitRef, Record)]) -> String {
    let mut rows = Vec::new();
    for (unit, record) in results {
        let (word, reason) = match &record.outcome {
            RecordOutcome::Made { .. } => continue,
            RecordOutcome::Skipped { reason } => ("skipped", reason),
            RecordOutcome::Filtered { reason } => ("filtered", reason),
        };
        rows.push(vec![
            word.to_owned(),
            unit.partition.clone(),
            reason.clone(),
        ]);
    }
    if rows.is_empty() {
        return "nothing was skipped or filtered\n".to_owned();
    }
    report::columns(&rows, &[])
}

fn overview(lake: &Lake, results: &[(&UnitRef, Record)]) -> Result<String, Trouble> {
    let mut text = String::new();
    let mut rows = vec![
        ["partition", "result", "rows", "figures"]
            .map(str::to_owned)
            .to_vec(),
    ];
    let mut columns = None;
    for (unit, record) in results {
        let (result, n_rows, figures) = match &record.outcome {
            RecordOutcome::Made { files, metrics, .. } => {
                let mut n_rows = String::new();
                if let Some(file) = files.get(table::FILE) {
                    let description = table::describe(&lake.file(file))?;
                    n_rows = description.rows.to_string();
                    columns.get_or_insert(description.columns);
                }
                let figures: Vec<String> = metrics
                    .iter()
                    .map(|(name, value)| format!("{name} {value:.4}"))
                    .collect();
                ("made", n_rows, figures.join(", "))
            }
            RecordOutcome::Skipped { reason } => ("skipped", String::new(), reason.clone()),
            RecordOutcome::Filtered { reason } => ("filtered", String::new(), reason.clone()),
        };
        rows.push(vec![
            unit.partition.clone(),
            result.to_owned(),
            n_rows,
            figures,
        ]);
    }
    if let Some(columns) = columns {
        let mut lines = vec![
            ["column", "type", "unit", "about"]
                .map(str::to_owned)
                .to_vec(),
        ];
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
fn one(lake: &Lake, unit: &UnitRef, record: &Record) -> Result<String, Trouble> {
    let mut rows = vec![
        vec!["partition".to_owned(), unit.partition.clone()],
        vec!["fingerprint".to_owned(), unit.fingerprint.to_string()],
    ];
    if let RecordOutcome::Made {
        files,
        labels,
        metrics,
    } = &record.outcome
    {
        for (name, file) in files {
            let path = lake.file(file);
            rows.push(vec![
                format!("file {name}"),
                format!("{} bytes, {}", file.size, path.display()),
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
                .map(|(name, value)| vec![format!("figure {name}"), value.to_string()]),
        );
    }
    let mut text = report::columns(&rows, &[]);
    let json = serde_json::to_string_pretty(&record.fingerprint)
        .map_err(|err| Trouble::failed(err, None))?;
    text.push_str(&format!("made of {json}\n"));
    if let Some(provenance) = lake.provenance(&unit.fingerprint)? {
        text.push_str(&format!(
            "made by {} on `{}` in {}\n",
            provenance.program,
            provenance.host,
            report::duration(provenance.took_s)
        ));
    }
    Ok(text)
}
