//! `pipeline stages`

use dataflow::{Kind, Wiring, did_you_mean};

use crate::{
    arguments::StagesArgs,
    command_line::Program,
    commands::query::page::Page,
    outcome::{CommandError, CommandOutcome},
    report::{self, Line},
};

/// Longest type with a column of its own; a longer list of names follows the option's description.
const MAX_TYPE_WIDTH: usize = 60;

/// Lists the kinds of stages, or the options of one.
pub(crate) fn stages(program: &Program, args: &StagesArgs) -> Result<CommandOutcome, CommandError> {
    let kinds = program.kinds;
    let text = match &args.kind {
        None => overview(kinds),
        Some(name) => {
            let kind = kinds.iter().find(|kind| kind.name == name).ok_or_else(|| {
                let near = did_you_mean(name, kinds.iter().map(|kind| kind.name));
                let all = || "`pipeline stages` lists every kind".to_owned();
                let hint = near.unwrap_or_else(all);
                CommandError::usage(format!("no kind of stage `{name}`"), hint)
            })?;
            options(kind, Page::of_stdout().width)
        }
    };
    let lines: Vec<Line> = text.lines().map(Line::plain).collect();
    report::lines(&lines)?;
    Ok(CommandOutcome::Done)
}

/// Inputs or outputs in a line of the overview: as many as fit a narrow terminal.
const NAMES_IN_A_LINE: usize = 4;

fn overview(kinds: &[Kind]) -> String {
    let mut rows = Vec::new();
    for kind in kinds {
        let outputs = &kind.outputs;
        let mut makes: Vec<&str> = outputs.iter().map(|output| output.artifact).collect();
        rows.push(vec![kind.name.to_owned(), kind.about.to_owned()]);
        if kind.wiring == Wiring::Free {
            rows.push(vec![String::new(), "reads  any".to_owned()]);
            makes = vec!["any"];
        }
        for (verb, names) in [("reads", kind.all_inputs()), ("makes", makes)] {
            for names in names.chunks(NAMES_IN_A_LINE) {
                rows.push(vec![String::new(), format!("{verb}  {}", names.join(", "))]);
            }
        }
    }
    format!(
        "{}\n`pipeline stages KIND` lists a kind's options.\n",
        report::columns(&rows, &[])
    )
}

fn options(kind: &Kind, width: Option<usize>) -> String {
    let mut text = format!("{}: {}\n\n", kind.name, kind.about);
    for input in &kind.inputs {
        text.push_str(&format!("inputs.{input} = \"STAGE.{input}\"\n"));
    }
    for input in kind.optional_inputs {
        text.push_str(&format!("inputs.{input} = \"STAGE.{input}\" (optional)\n"));
    }
    if kind.wiring == Wiring::Free {
        text.push_str("inputs.NAME = \"STAGE.ARTIFACT\", any number of them\n");
        text.push_str("makes one artifact, named by `makes`\n");
    }
    let named = kind
        .outputs
        .iter()
        .filter(|_| kind.wiring == Wiring::Declared);
    for output in named {
        text.push_str(&format!(
            "makes `{}`, one partition per {}, schema {}\n",
            output.artifact, output.partition, output.schema
        ));
    }
    let mut rows = vec![report::header(["option", "type", "default", "about"])];
    for option in kind.options() {
        let default = match option.default {
            Some(default) => default,
            None if option.required => "required".to_owned(),
            None => "-".to_owned(),
        };
        let (value, mut about) = if option.value.len() > MAX_TYPE_WIDTH {
            let about = format!("{}: {}", option.about, option.value);
            ("name".to_owned(), about)
        } else {
            (option.value, option.about)
        };
        if let Some(range) = option.range {
            about += &format!(" [{range}]");
        }
        rows.push(vec![option.key, value, default, about]);
    }
    rows.push(vec![
        "max_skipped_fraction".to_owned(),
        "number".to_owned(),
        "0.2".to_owned(),
        "Share of items that may be skipped before the stage fails.".to_owned(),
    ]);
    rows.push(vec![
        "resources".to_owned(),
        "table".to_owned(),
        "-".to_owned(),
        "Of a unit on another machine: `cores`, `memory_gb`, `gpus`, `time_min`, `partition`, `account`, `qos`, \
         `constraint`, `gres`, `environment`.".to_owned(),
    ]);
    text.push('\n');
    let table = report::columns(&rows, &[]);
    match width {
        Some(width) if table.lines().any(|line| line.chars().count() > width) => {
            text.push_str(&below(&rows, width));
        }
        _ => text.push_str(&table),
    }
    if let Some(example) = kind.example {
        text.push_str(&format!("\n{example}"));
    }
    text
}

/// The layout of options if their table is too wide: each description is below its option.
fn below(rows: &[Vec<String>], width: usize) -> String {
    const INDENT: usize = 4;
    let mut text = String::new();
    for row in rows.iter().skip(1) {
        let [option, value, default, about] = row.as_slice() else {
            continue;
        };
        let default = match default.as_str() {
            "required" | "-" => default.clone(),
            // Breaks between the values of a table.
            default => format!("default {}", default.replace(",\"", ", \"")),
        };
        let head = format!("{option}: {value}, {default}");
        text.push_str(&format!(
            "{}\n",
            report::wrapped(&head, width.saturating_sub(INDENT)).join("\n    ")
        ));
        for line in report::wrapped(about, width.saturating_sub(INDENT)) {
            text.push_str(&format!("{:INDENT$}{line}\n", ""));
        }
    }
    text
}
