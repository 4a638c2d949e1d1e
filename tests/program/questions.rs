//! SQL queries: every format, fitting to the screen, and errors.

use std::{env, fs, process::Output, sync::OnceLock};

use serde_json::Value;

use crate::program::{
    bench::{Bench, stderr, stdout},
    python::{program_at, python},
};

/// A lake with demonstrations; the tests share it.
fn bench() -> &'static Bench {
    static LAKE: OnceLock<Bench> = OnceLock::new();
    LAKE.get_or_init(|| {
        let bench = Bench::new();
        bench.run_well(&["--until", "ingest"]);
        bench
    })
}

fn ask(arguments: &[&str], columns: Option<&str>) -> Output {
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_pipeline"));
    command.env_remove("COLUMNS");
    if let Some(columns) = columns {
        command.env("COLUMNS", columns);
    }
    command
        .arg("query")
        .args(arguments)
        .arg("--lake")
        .arg(bench().lake())
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
            &["no column `d.objct`", "did you mean `object`?"],
        ),
        (
            "select o.split from objects o join demonstrations d on o.object = d.object",
            &[
                "no column `o.split`",
                "hint: the columns are: center_of_mass_m",
            ],
        ),
        (
            "select x.object from demonstrations d",
            &["no table `x` in `from`", "or its short name"],
        ),
        (
            "select zzz from objects",
            &["no column `zzz`", "the columns are: ", "mass_kg"],
        ),
        ("selct 1", &["cannot parse the SQL", "Column: 1", "hint: "]),
        (
            "select foo(object) from objects",
            &["cannot answer the question", "no function `foo`"],
        ),
        (
            "select count_(object) from objects",
            &["no function `count_`", "did you mean `count`?"],
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
        "select object from objects where count(*) > 1",
        "select 9223372036854775807 + 1",
        "select sum(n) from (values (9223372036854775807), (1)) as t(n)",
        "select -9223372036854775807 - 2",
        "select 5000000000 * 5000000000",
        "select 2 ^ 3",
        "select 7 // 2",
        "select 5 % 0",
        "select cast(2.5 as int)",
        "select cast('x' as double)",
        "select date 'someday'",
        "select object from objects tablesample (10 percent)",
        "select object from objects a full join demonstrations b using (object)",
        "select object, object as object from objects",
        "select lag(mass_kg) from objects",
        "select median(object) from objects",
        "select * from objects where object in (select mass_kg from objects)",
        "select * from objects where mass_kg in (1, 'x')",
        "select * from objects where mass_kg between 'a' and 'b'",
        "select * from objects where 1 = true",
        "select (select mass_kg from objects) as mass",
        "select extract(nothing from date '2024-01-01')",
        "select * from objects order by 100",
        "select * from generate_series(1, 3)",
    ] {
        let output = ask(&[sql], None);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{sql}: {text}");
        assert!(text.starts_with("error: "), "{sql}: {text}");
        assert!(text.contains("\nhint: "), "{sql}: {text}");
        assert_eq!(text.lines().count(), 2, "{sql}: {text}");
        assert_eq!(stdout(&output), "", "{sql}");
        for word in INSIDE {
            assert!(!text.contains(word), "{sql}: {text}");
        }
    }
}

/// Words of the engine, which mean nothing to who asks.
const INSIDE: [&str; 14] = [
    "Expr",
    "Plan",
    "Physical",
    "Logical",
    "DataFusion",
    "Arrow",
    "Int64",
    "Utf8",
    "Float64",
    "Date32",
    "Some(",
    "::",
    "schema",
    "UDF",
];

#[test]
fn what_engines_answer_differently_has_one_answer() {
    const ROWS: &str = "(values (1, 1, 'x'), (1, 2, 'y'), (2, 5, null), (3, 5, 'z')) as t(a, n, s)";
    for (sql, rows) in [
        // A join with a condition on one side keeps the rows that it does not meet.
        (
            "select t.a, u.b from {t} left join (values (1), (2)) as u(b) on t.a = u.b and t.n > 1 order by 1, t.n",
            "1,\n1,1\n2,2\n3,\n",
        ),
        (
            "select t.a, u.b from {t} right join (values (1), (9)) as u(b) on t.a = u.b and t.n > 1 order by 2",
            "1,1\n,9\n",
        ),
        (
            "select t.a, u.b from {t} full join (values (1), (9)) as u(b) on t.a = u.b and u.b > 5 order by 1, t.n, 2",
            "1,\n1,\n2,\n3,\n,1\n,9\n",
        ),
        // A condition on columns of one name on both sides of a join.
        (
            "with a(k, g) as (values (1, 'a'), (2, 'b'), (3, 'c')), b(k, g) as (values (1, 'zz'), (5, 'q'), (6, 'q'), \
             (7, 'q'), (8, 'q'), (9, 'q')) select a.k from b right join a on a.k = b.k \
             where case when a.k < 3 then b.g || a.g else a.g end < 'd' and a.k > 0",
            "3\n",
        ),
        // A condition without columns on a total, which has a row where there is none below.
        (
            "select n from (select count(*) as n from {t}) u where 1 = 0",
            "",
        ),
        // Aggregates of aggregates, over a window.
        (
            "select a, count(*) * 1.0 / sum(count(*)) over () as share from {t} group by a order by a",
            "1,0.5\n2,0.25\n3,0.25\n",
        ),
        ("select sum(n) over () as s from {t} limit 1", "13\n"),
        // Ties have one value.
        (
            "select n, sum(n) over (order by n) as s from {t} order by n",
            "1,1\n2,3\n5,13\n5,13\n",
        ),
        // No row where nothing is true.
        ("select 1 as a where false", ""),
        ("select 1 as a where null = null", ""),
        ("select null = null as a", "\"\"\n"),
        (
            "select count(*) as n from {t} where a not in (1, null)",
            "0\n",
        ),
        // Places in a window are whole numbers like others.
        (
            "select n from (select n - 9 as n from {t} union all select rank() over (order by n) from {t}) u order by 1",
            "-8\n-7\n-4\n-4\n1\n2\n3\n3\n",
        ),
        (
            "select ntile(2) over (order by n) as c from {t} union all select coalesce(null, n) from {t} order by 1",
            "1\n1\n1\n2\n2\n2\n5\n5\n",
        ),
        // One that is no number comes after all others, whatever it was computed from.
        (
            "select sum(v) as s from (values (1, 1e0 / 0), (1, -1e0 / 0), (2, 5e0)) as w(k, v) group by k order by s",
            "5.0\nNaN\n",
        ),
        // A large number that leaves a window takes no digits with it.
        (
            "select sum(v) over (order by k rows between current row and 1 following) as s from \
             (values (1, 1e16), (2, 0.1), (3, 0.2)) as w(k, v) order by k desc",
            "0.2\n0.30000000000000004\n1e16\n",
        ),
        (
            "select avg(v) over (order by k rows between 1 preceding and current row) as s from \
             (values (1, 1e0 / 0), (2, 1.0), (3, 3.0)) as w(k, v) order by k",
            "inf\ninf\n2.0\n",
        ),
        // Two lists of one column, of which one has a null or the column has.
        (
            "select n from {t} where a not in (7, 8, null) or a not in (1) order by n",
            "5\n5\n",
        ),
        (
            "select n from {t} where s not in ('x', 'p') or s not in ('z') order by n",
            "1\n2\n5\n",
        ),
        (
            "select n from {t} where a in (1, 2) and a not in (9, null)",
            "",
        ),
        (
            "select s, not (s in ('x', 'p') and s in ('y', 'q')) as m from {t} order by s",
            "x,true\ny,true\nz,true\n,\n",
        ),
        (
            "select s, (s = 'x' or s = 'p') and (s = 'y' or s = 'q') as m from {t} order by s",
            "x,false\ny,false\nz,false\n,\n",
        ),
        (
            "select v, not ((v = 1 or v = 2) and v in (3, 4)) as m from (values (1.5), (null)) as w(v) order by v",
            "1.5,true\n,\n",
        ),
        (
            "select s, not (regexp_like(s, '^(x|p)$') and s in ('y', 'q')) as m from {t} order by s",
            "x,true\ny,true\nz,true\n,\n",
        ),
        (
            "select n from (select * from {t} where a in (1, 3)) u where a not in (3, null)",
            "",
        ),
        // Dates.
        ("select extract(dow from date '2024-01-07') as d", "0\n"),
        ("select date '2024-03-01' - date '2024-02-01' as d", "29\n"),
        ("select date '2024-01-31' + 1 as d", "2024-02-01\n"),
        (
            "select date '2024-03-01' - interval '2 hours' as t",
            "2024-02-29T22:00:00\n",
        ),
        (
            "select date_trunc('month', timestamp '2024-05-17 10:11:12') as d",
            "2024-05-01T00:00:00\n",
        ),
        // Groups.
        (
            "select a from {t} group by a order by count(*) desc, a",
            "1\n2\n3\n",
        ),
        ("select min(n), max(n) from {t}", "1,5\n"),
        ("select count(*) as n from {t} having count(*) > 3", "4\n"),
        ("select count(*) as n from {t} having count(*) > 4", ""),
        (
            "select median(a), quantile_cont(a, 0.5) from {t}",
            "1.5,1.5\n",
        ),
        ("select avg(s is null) as share from {t}", "0.25\n"),
        // Numbers.
        ("select 1 / 2 as a, 7 % 4 as b, -7 % 4 as c", "0.5,3,-3\n"),
        (
            "select 1 / 0 as a, -1 / 0 as b, 0 / 0 as c",
            "inf,-inf,NaN\n",
        ),
        (
            "select 0.0 = -0.0 as a, count(distinct z) as n from (values (0.0), (-0.0)) as t(z) group by 1",
            "true,1\n",
        ),
        ("select 9 < '10' as a", "true\n"),
        (
            "select cast(0.1 as varchar) as a, cast(1e20 as varchar) as b, cast(3e0 as int) as c",
            "0.1,1e+20,3\n",
        ),
        // Missing values come last, whichever way.
        ("select s from {t} order by s desc", "z\ny\nx\n\"\"\n"),
    ] {
        let sql = sql.replace("{t}", ROWS);
        let said = answer(&[&sql, "--format", "csv"]);
        let (_, said) = said.split_once('\n').unwrap();
        assert_eq!(said, rows, "{sql}");
    }
    let infinity = answer(&[
        "select 1 / 0 as a, -1 / 0 as b, 0 / 0 as c",
        "--format",
        "json",
    ]);
    assert_eq!(
        infinity,
        "{\"a\":\"Infinity\",\"b\":\"-Infinity\",\"c\":\"NaN\"}\n"
    );
    let names = answer(&[
        "select min(step), max(step), count(*) from demonstrations",
        "--format",
        "csv",
    ]);
    assert!(
        names.starts_with("min(step),max(step),count(*)\n"),
        "{names}"
    );
    let tables = answer(&["show tables", "--format", "csv"]);
    for table in ["objects", "demonstrations", "runs"] {
        assert!(tables.lines().any(|line| line == table), "{tables}");
    }
}

/// A folder with a file of values, beside no lake.
fn beside() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let csv = "name,weight_kg,found\n007,0.5,true\n025,,false\n";
    fs::write(folder.path().join("measured.csv"), csv).unwrap();
    folder
}

#[test]
fn only_the_lake_and_allowed_files_are_read() {
    let folder = beside();
    let file = folder.path().join("measured.csv");
    let (file, folder_path) = (file.display(), folder.path().display());
    let parquet = folder.path().join("few objects.parquet");
    let bytes = ask(
        &[
            "select object, mass_kg from objects order by object limit 2",
            "--format",
            "parquet",
        ],
        None,
    );
    fs::write(&parquet, bytes.stdout).unwrap();
    let parquet = parquet.display();
    for sql in [
        format!("select * from read_csv('{file}')"),
        format!("select * from '{file}'"),
        format!("select * from read_parquet('{parquet}')"),
        format!("select * from read_parquet('{folder_path}')"),
        "select * from read_parquet('/etc/passwd')".to_owned(),
        "select * from '../../../../etc/passwd'".to_owned(),
        "select * from read_parquet('https://example.org/a.parquet')".to_owned(),
        "select * from 's3://bucket/a.parquet'".to_owned(),
    ] {
        let output = ask(&[&sql], None);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{sql}: {text}");
        assert!(text.contains("is not in the lake"), "{sql}: {text}");
        assert!(text.contains("--allow-files"), "{sql}: {text}");
    }
    for (sql, rows) in [
        (
            format!("select * from read_csv('{file}') order by name"),
            "name,weight_kg,found\n007,0.5,true\n025,,false\n",
        ),
        (
            format!("select m.name from '{file}' as m where m.found"),
            "name\n007\n",
        ),
        (
            format!(
                "select count(*) as n from '{parquet}' a join objects b on a.object = b.object"
            ),
            "n\n2\n",
        ),
        (
            format!("select count(*) as n from read_parquet('{folder_path}')"),
            "n\n2\n",
        ),
    ] {
        for allowed in [folder.path().to_str().unwrap(), "."] {
            let arguments = [&sql, "--format", "csv", "--allow-files", allowed];
            let output = ask(&arguments, None);
            if allowed == "." {
                assert_eq!(output.status.code(), Some(2), "{sql}");
            } else {
                assert_eq!(stdout(&output), rows, "{sql}: {}", stderr(&output));
            }
        }
    }
    let missing = format!("select * from '{folder_path}/*.parquet'");
    let output = ask(
        &[&missing, "--allow-files", folder.path().to_str().unwrap()],
        None,
    );
    assert!(
        stderr(&output).contains("name the folder"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn long_questions_are_answered_or_refused() {
    for (sql, n) in [
        (format!("select 1{}", " + 1".repeat(120)), "121"),
        (
            format!(
                "select count(*) from objects where mass_kg = 0{}",
                " or mass_kg = 1".repeat(100)
            ),
            "0",
        ),
        (
            format!(
                "select count(*) from objects where mass_kg in (0{})",
                ", 1".repeat(20_000)
            ),
            "0",
        ),
        (format!("select {}1{}", "(".repeat(40), ")".repeat(40)), "1"),
    ] {
        let said = answer(&[&sql, "--format", "csv"]);
        assert_eq!(said.lines().last(), Some(n), "{sql:.80}");
    }
    for sql in [
        format!("select 1{}", " + 1".repeat(200)),
        format!("select {}1{}", "(".repeat(3000), ")".repeat(3000)),
        format!("select 1{}", " union all select 1".repeat(1100)),
    ] {
        let output = ask(&[&sql], None);
        assert_eq!(output.status.code(), Some(2), "{sql:.80}");
        assert!(
            stderr(&output).contains("within each other"),
            "{}",
            stderr(&output)
        );
    }
}

/// Statements that are compared, if `PIPELINE_STATEMENTS` does not say.
const STATEMENTS: &str = "150";

/// What is compared with DuckDB: equal rows or a refusal, never other rows.
#[test]
fn random_questions_are_answered_as_by_duckdb() {
    let Some(python) = python(&["duckdb", "pyarrow"]) else {
        return;
    };
    let count = env::var("PIPELINE_STATEMENTS").unwrap_or_else(|_| STATEMENTS.to_owned());
    let seed = env::var("PIPELINE_SEED").unwrap_or_else(|_| "1".to_owned());
    let mut compare = program_at(&python, "tests/program/questions/compare.py");
    compare
        .arg(env!("CARGO_BIN_EXE_pipeline"))
        .arg(bench().lake())
        .args([&count, &seed]);
    let ran = compare.output().unwrap();
    assert!(ran.status.success(), "{}", stderr(&ran));
    let said = stdout(&ran);
    println!("{said}");
    let counts: Value = serde_json::from_str(said.lines().last().unwrap()).unwrap();
    let number = |name: &str| counts[name].as_f64().unwrap_or(0.0);
    let asked = number("asked");
    assert!(asked >= count.parse::<f64>().unwrap() - 16.0, "{said}");
    assert_eq!((number("wrong"), number("rude")), (0.0, 0.0), "{said}");
    assert!(number("answered") >= 0.85 * asked, "{said}");
    for part in ["one-sided", "window", "having", "subquery", "date", "null"] {
        assert!(number(part) >= 0.1 * asked, "{part}: {said}");
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
