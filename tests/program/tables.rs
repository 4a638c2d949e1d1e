//! Measured tables of READMEs: each comes from a query beside its README, which `cargo bench --bench tables`
//! answers.

#[path = "../benches/tables/query.rs"]
pub(crate) mod query;
#[path = "../benches/tables/readme.rs"]
pub(crate) mod readme;

use std::{
    collections::BTreeSet,
    fs,
    ops::Range,
    path::{Path, PathBuf},
};

use dataflow::Pipeline;
use hand_files::HandFile;
use serde_json::json;

use self::{query::Query, readme::Readme};
use crate::program::bench::put;

/// Headers of tables with percentages that no query makes, each with the reason.
const OTHERS: [(&str, &str); 4] = [
    ("| bench | figure | noise |", "how figures of benches vary"),
    (
        "| candidates | ours, each | `MuJoCo` to the end, each | times | ours, a step | `MuJoCo`, a step | times |",
        "`cargo bench --bench screening` and `--bench agreement` print it",
    ),
    (
        "| | all | unseen objects |",
        "`cargo bench --bench agreement` prints it",
    ),
    (
        "| | median | 99 % | 99.9 % | most |",
        "`cargo bench --bench cell` prints it",
    ),
];

#[test]
fn every_marker_names_a_query_and_every_query_has_one_marker() {
    let mut named = Vec::new();
    for readme in Readme::all().unwrap() {
        let tables = readme.tables();
        let queries = tables.into_iter().filter_map(|table| table.query);
        let before = named.len();
        named.extend(queries);
        let markers = readme
            .lines
            .iter()
            .filter(|line| line.starts_with("<!-- measured"));
        let n_markers = markers.count();
        assert_eq!(named.len() - before, n_markers, "{}", readme.path.display());
    }
    let n_named = named.len();
    let named: BTreeSet<PathBuf> = named.into_iter().collect();
    assert_eq!(named.len(), n_named, "a query makes two tables: {named:#?}");
    let folders: BTreeSet<_> = named.iter().map(|path| path.parent().unwrap()).collect();
    let files = folders
        .iter()
        .flat_map(|folder| fs::read_dir(folder).unwrap());
    let files = files.map(|entry| entry.unwrap().path());
    let queries: BTreeSet<PathBuf> = files
        .filter(|path| path.extension().is_some_and(|ending| ending == "sql"))
        .collect();
    assert_eq!(named, queries);
    assert!(n_named > 7);
}

#[test]
fn the_header_of_a_measured_table_has_the_columns_of_its_query() {
    for readme in Readme::all().unwrap() {
        for table in readme.tables() {
            let Some(path) = table.query else { continue };
            let query = Query::read(&path).unwrap();
            let header = query.table(&[]).unwrap();
            assert_eq!(readme.lines[table.lines][..2], header, "{}", path.display());
        }
    }
}

#[test]
fn a_table_of_percentages_is_measured_by_a_query_or_by_another_bench() {
    let mut others = BTreeSet::new();
    for readme in Readme::all().unwrap() {
        for table in readme.tables() {
            let lines = &readme.lines[table.lines];
            if table.query.is_none() && lines.iter().any(|line| line.contains('%')) {
                others.insert(lines[0].clone());
            }
        }
    }
    let known: BTreeSet<String> = OTHERS.map(|(header, _)| header.to_owned()).into();
    assert_eq!(others, known);
}

#[test]
fn every_command_of_a_query_names_a_file_and_options_that_there_are() {
    for readme in Readme::all().unwrap() {
        for path in readme.tables().into_iter().filter_map(|table| table.query) {
            let query = Query::read(&path).unwrap();
            assert!(!query.commands.is_empty(), "{}", path.display());
            for command in query.commands {
                let file = Path::new(&command[1]);
                let text = fs::read_to_string(file).unwrap();
                for values in query::variants(&command).unwrap() {
                    let read = Pipeline::parse(file, &text, &pipeline::kinds(), None, &values);
                    let fault = read.err();
                    assert!(
                        fault.is_none(),
                        "{}: {command:?}: {fault:?}",
                        path.display()
                    );
                }
            }
        }
    }
}

#[test]
fn hand_tables_of_the_ablation_differ_only_in_scale() {
    let table = |path: &str| HandFile::read(Path::new(path)).unwrap().table;
    let whole = table("data/hands/allegro_right.toml");
    for scale in ["1.0", "1.2"] {
        let path = format!("stages/retarget/tables/allegro_right_scale_{scale}.toml");
        let mut other = table(&path);
        assert_eq!(other.scale, scale.parse::<f64>().unwrap(), "{path}");
        other.scale = whole.scale;
        assert_eq!(other, whole, "{path}");
    }
}

#[test]
fn commands_columns_and_decimals_are_those_of_the_file() {
    let query = Query::parse(
        "-- What it shows.\n--\n-- pipeline run a.toml \\\n--   --set b.c=1\n-- pipeline run d.toml\n\n\
         with sums as (select a, b from all_t where run in (select run from runs))\n\
         select a as \"what\", round(100.0 * b, 1) as \"succeed, %\", b as n from sums order by what",
    )
    .unwrap();
    let expected = [&["run", "a.toml", "--set", "b.c=1"][..], &["run", "d.toml"]];
    assert_eq!(query.commands, expected);
    let over = query.over(&[3, 12]);
    assert!(
        over.contains("from all_t where run in (3, 12))\n"),
        "{over}"
    );
    let rows = [
        json!({"what": "seen", "succeed, %": 70.0, "n": 4}),
        json!({"what": "unseen", "succeed, %": -0.04, "n": null}),
    ];
    let table = query.table(&rows).unwrap();
    let expected = [
        "| what | succeed, % | n |",
        "| --- | --- | --- |",
        "| seen | 70.0 | 4 |",
        "| unseen | 0.0 | - |",
    ];
    assert_eq!(table, expected);
    let said = query.table(&[json!({"what": "seen", "n": 1})]).unwrap_err();
    assert!(said.starts_with("no `succeed, %` in {"), "{said}");
}

#[test]
fn a_query_without_named_columns_or_chosen_runs_is_refused() {
    let runs = "where run in (select run from runs)";
    for (sql, expected) in [
        (
            format!("select a + 1 from t {runs}"),
            "`a + 1` has no `as \"NAME\"`",
        ),
        (
            format!("select * from t {runs}"),
            "`*` has no `as \"NAME\"`",
        ),
        (
            format!("select a as a from t {runs}; select 1 as b"),
            "it is not one query",
        ),
        (
            "select a as a from t".to_owned(),
            "it nowhere says `run in (select run from runs)`",
        ),
    ] {
        assert_eq!(Query::parse(&sql).err().unwrap(), expected);
    }
}

#[test]
fn a_measured_table_is_replaced_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("README.md");
    let text = "# A\n\n| a |\n| --- |\n\n<!-- measured: tables/b.sql -->\n| b |\n| --- |\n| 1 |\n\nText.\n";
    put(&path, text);
    let mut readme = Readme::read(path.clone()).unwrap();
    let tables = readme.tables();
    let lines: Vec<Range<usize>> = tables.iter().map(|table| table.lines.clone()).collect();
    assert_eq!(lines, [2..4, 6..9]);
    assert_eq!(tables[0].query, None);
    assert_eq!(tables[1].query, Some(folder.path().join("tables/b.sql")));
    let rows = ["| b |", "| --- |", "| 2 |", "| 3 |"].map(str::to_owned);
    readme.replace(lines[1].clone(), rows.to_vec()).unwrap();
    let expected = text.replace("| 1 |", "| 2 |\n| 3 |");
    assert_eq!(fs::read_to_string(&path).unwrap(), expected);
}
