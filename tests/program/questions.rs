//! SQL queries: every format, fitting to the screen, and errors.

use std::{process::Output, sync::OnceLock};

use serde_json::Value;

use crate::bench::{Bench, stderr, stdout};

/// Asks a lake with demonstrations; the tests share it.
fn ask(arguments: &[&str], columns: Option<&str>) -> Output {
    static LAKE: OnceLock<Bench> = OnceLock::new();
    let bench = LAKE.get_or_init(|| {
        let bench = Bench::new();
        bench.run_well(&["--until", "ingest"]);
        bench
    });
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_pipeline"));
    command.env_remove("COLUMNS");
    if let Some(columns) = columns {
        command.env("COLUMNS", columns);
    }
    command
        .arg("query")
        .args(arguments)
        .arg("--lake")
        .arg(bench.lake())
        .output()
        .unwrap()
}

fn answer(arguments: &[&str]) -> String {
    let output = ask(arguments, None);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    stdout(&output)
}

const STEPS: &str = "select sequence, step, keypoints_m from demonstrations order by all";

#[test]
fn output_without_a_terminal_has_every_row() {
    let table = answer(&[STEPS]);
    let csv = answer(&[STEPS, "--format", "csv"]);
    let json = answer(&[STEPS, "--format", "json"]);
    let n_rows = json.lines().count();
    assert!(n_rows > 100);
    assert_eq!(table.lines().count(), n_rows + 1);
    assert_eq!(csv.lines().count(), n_rows + 1);
    assert!(!table.contains('…'), "{table:.300}");
}

#[test]
fn lists_are_readable_in_every_format() {
    let sql = "select rest_up as up from demonstrations limit 1";
    let table = answer(&[sql]);
    assert!(table.starts_with("up\n["), "{table}");
    let json: Value = serde_json::from_str(&answer(&[sql, "--format", "json"])).unwrap();
    let up = json["up"].as_array().unwrap();
    assert_eq!(up.len(), 3);
    let csv = answer(&[sql, "--format", "csv"]);
    let cell = csv.lines().nth(1).unwrap().trim_matches('"');
    assert_eq!(serde_json::from_str::<Vec<Value>>(cell).unwrap(), *up);
    let parquet = ask(&[sql, "--format", "parquet"], None).stdout;
    assert!(parquet.starts_with(b"PAR1") && parquet.ends_with(b"PAR1"));
}

#[test]
fn a_table_is_cut_to_the_width_of_the_terminal() {
    let sql = "select * from demonstrations limit 5";
    let output = ask(&[sql], Some("60"));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let table = stdout(&output);
    assert_eq!(table.lines().count(), 6);
    for line in table.lines() {
        assert!(line.chars().count() <= 60, "{line}");
        assert!(line.ends_with('…'), "{line}");
    }
    assert!(stderr(&output).contains("columns left out: "));
    let json = ask(&[sql, "--format", "json"], Some("60"));
    assert_eq!(stdout(&json), answer(&[sql, "--format", "json"]));
    let quiet = ask(&[sql, "--quiet"], Some("60"));
    assert_eq!(stderr(&quiet), "");
}

#[test]
fn a_question_may_begin_with_a_comment() {
    let sql = "select count(*) as n from objects";
    assert_eq!(answer(&[&format!("-- how many?\n{sql}")]), answer(&[sql]));
}

#[test]
fn small_and_large_numbers_keep_their_digits() {
    let sql = "select step * 0.000001 / 4 as small, step * 1.0e10 as large, step / 2.0 as half \
               from demonstrations where step = 1 limit 1";
    let table = answer(&[sql]);
    let cells: Vec<&str> = table.lines().nth(1).unwrap().split_whitespace().collect();
    assert_eq!(cells, ["2.5e-7", "1e10", "0.5"]);
}

#[test]
fn a_wrong_question_gets_the_near_name() {
    for (sql, says) in [
        (
            "select * from demonstration",
            &["no table `demonstration`", "did you mean `demonstrations`?"][..],
        ),
        (
            "select objct from demonstrations",
            &["no column `objct`", "did you mean `object`?"],
        ),
        (
            "select d.objct from demonstrations d",
            &["no column `objct`", "did you mean `object`?"],
        ),
        (
            "select zzz from objects",
            &["no column `zzz`", "the columns are: ", "mass_kg"],
        ),
        (
            "selct 1",
            &["cannot read the question", "Column: 1", "hint: "],
        ),
        (
            "select foo(object) from objects",
            &["cannot answer the question", "foo"],
        ),
    ] {
        let output = ask(&[sql], None);
        assert_eq!(output.status.code(), Some(2), "{sql}");
        let text = stderr(&output);
        for part in says {
            assert!(text.contains(part), "no `{part}` in:\n{text}");
        }
        assert_eq!(stdout(&output), "");
    }
}

#[test]
fn every_query_error_has_one_form() {
    for sql in [
        "delete from objects",
        "drop table objects",
        "truncate objects",
        "create table mine as select * from objects",
        "insert into objects select * from objects",
        "select 1; select 2",
        "",
        "select",
        "select * from",
        "select (1",
        "select * from objects where",
        "select foo(object) from objects",
        "select objct from objects",
        "select * from object",
        "select object, count(*) from demonstrations",
        "select object, stage from objects group by stage",
        "select cast(object as int) from objects",
        "select sum(object) * 2 from objects",
        "select object - 1 from objects",
        "select * from objects order by nothing",
        "select * from objects where mass_kg = 'heavy'",
        "select * from objects where object",
        "select * from objects a join demonstrations b on a.nothing = b.object",
        "select object from objects union all select 1, 2",
        "select substr(object) from objects",
        "select mass_kg over from objects limit many",
        "select * from read_parquet('no/such/file.parquet')",
        "select * from objects having count(*) > 1",
    ] {
        let output = ask(&[sql], None);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{sql}: {text}");
        assert!(text.starts_with("error: "), "{sql}: {text}");
        assert!(text.contains("\nhint: "), "{sql}: {text}");
        assert_eq!(text.lines().count(), 2, "{sql}: {text}");
        assert_eq!(stdout(&output), "", "{sql}");
    }
}

#[test]
fn questions_only_read() {
    for (sql, word) in [
        ("delete from objects", "DELETE"),
        ("drop table objects", "DROP"),
        ("truncate objects", "TRUNCATE"),
        ("create table mine as select * from objects", "CREATE"),
    ] {
        let output = ask(&[sql], None);
        assert_eq!(output.status.code(), Some(2), "{sql}");
        let says = format!("`{word}` is refused: questions read tables and change nothing");
        assert!(stderr(&output).contains(&says), "{}", stderr(&output));
    }
    for sql in [
        "select 1",
        "with a as (select object from objects) select * from a",
        "values (1, 2), (3, 4)",
        "show tables",
        "explain select object from objects",
    ] {
        assert!(!answer(&[sql]).is_empty(), "{sql}");
    }
}

#[test]
fn totals_beside_columns_name_the_columns_to_group_by() {
    let output = ask(&["select object, count(*) from demonstrations"], None);
    assert_eq!(output.status.code(), Some(2));
    let text = stderr(&output);
    assert!(text.contains("hint: add `group by object`"), "{text}");
    let grouped = "select object, count(*) as n from demonstrations group by object";
    assert!(answer(&[grouped]).lines().count() > 2);
}
