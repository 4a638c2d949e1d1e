//! Programs that break a rule: each ends in an error that says what, where and what to do, nothing of it is
//! kept but its log, none of its processes lives on, and the lake is whole.

mod files;
mod limits;
mod named;

use std::{fs, sync::Arc};

use arrow_array::{ArrayRef, Float64Array, Int64Array, RecordBatch, StringArray};

use crate::engine::{
    place::{CHAIN, Place, put, stderr, stdout, well},
    program_maps::Maps,
};

/// A program `break.sh` that makes a table of one row for each part.
const TABLE: &str = r#"
[stages.split]
kind = "split"
root = "INPUTS"

[stages.lines]
kind = "program"
command = ["sh", "SCRIPT"]
inputs.parts = "split.parts"
each = "parts"
makes = "lines"
partition = "part"
timeout_s = 20
columns.name = { type = "text" }
columns.length_m = { type = "number", unit = "m" }

[stages.lines.options]
asked = 1
"#;

/// A place with a script and two parts.
fn place(script: &str) -> Place {
    place_of(TABLE, script)
}

fn place_of(pipeline: &str, script: &str) -> Place {
    let place = Place::with_inputs("", 2);
    let path = place.path("break.sh");
    put(&path, script.as_bytes());
    let inputs = place.inputs().display().to_string();
    let text = pipeline
        .replace("INPUTS", &inputs)
        .replace("SCRIPT", &path.display().to_string());
    put(&place.pipeline(), format!("seed = 7\n{text}").as_bytes());
    place
}

/// Writes a table for a script to copy.
fn table(place: &Place, columns: Vec<(&str, ArrayRef)>) -> String {
    let folder = place.path("table");
    fs::create_dir_all(&folder).unwrap();
    let batch = RecordBatch::try_from_iter(columns).unwrap();
    lake::table::write_batch(&folder, &batch).unwrap();
    folder.join(lake::table::FILE).display().to_string()
}

fn texts(values: &[&str]) -> ArrayRef {
    Arc::new(StringArray::from(values.to_vec()))
}

fn numbers(values: &[f64]) -> ArrayRef {
    Arc::new(Float64Array::from(values.to_vec()))
}

/// Runs, and expects an error that has these parts; then the lake is whole.
fn fails(place: &Place, flags: &[&str], parts: &[&str]) -> String {
    let ran = place.command("run", flags).output().unwrap();
    let said = stderr(&ran);
    assert_eq!(ran.status.code(), Some(1), "{said}");
    for part in ["error: stage `lines` failed at `p00", "hint: "]
        .iter()
        .chain(parts)
    {
        assert!(said.contains(part), "`{part}` is not in:\n{said}");
    }
    is_whole(place);
    said
}

/// The lake has what was made before and nothing of the program.
fn is_whole(place: &Place) {
    let verified = place.bare(&place.lake(), "verify").output().unwrap();
    assert_eq!(
        verified.status.code(),
        Some(0),
        "{}{}",
        stdout(&verified),
        stderr(&verified)
    );
    assert!(!place.lake().join("tables/lines").exists());
    let left: Vec<_> = fs::read_dir(place.lake().join("staging"))
        .into_iter()
        .flatten()
        .flatten()
        .collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn a_good_program_is_run_once_for_each_part() {
    let script = "printf 'progress 0.5 half\\n'; cp \"$(cat TABLE)\" out/part.parquet";
    let place = place(script);
    let path = table(
        &place,
        vec![("length_m", numbers(&[1.5])), ("name", texts(&["a"]))],
    );
    let script = script.replace("\"$(cat TABLE)\"", &path);
    put(&place.path("break.sh"), script.as_bytes());
    let said = stderr(&place.run_well(&[]));
    assert!(
        said.contains("2 made by a program of your own, 2 rows"),
        "{said}"
    );
    let again = stderr(&place.run_well(&[]));
    assert!(again.contains("cached"), "{again}");
    let query = "select part, name, length_m from lines order by part";
    let mut rows = place.bare(&place.lake(), "query");
    rows.args(["--format", "csv", query]);
    let rows = stdout(&well(rows));
    assert_eq!(
        rows.lines().collect::<Vec<_>>(),
        ["part,name,length_m", "p000,a,1.5", "p001,a,1.5"]
    );
    let mut one = place.bare(&place.lake(), "inspect");
    one.args(["lines.lines", "p000"]);
    let one = stdout(&well(one));
    assert!(one.contains("\nlog ") && one.contains("/logs/"), "{one}");
    // An edit of the script and an option are named as causes.
    put(
        &place.path("break.sh"),
        format!("{script} # edited").as_bytes(),
    );
    let plan = stdout(&well(
        place.command("plan", &["--set", "lines.options.asked=2"]),
    ));
    for part in ["break.sh` changed", "`options.asked` changed from 1 to 2"] {
        assert!(plan.contains(part), "{plan}");
    }
    // The limits decide nothing, nor does a default that is written out.
    put(&place.path("break.sh"), script.as_bytes());
    for same in ["lines.timeout_s=9", "lines.read.parts=\"same\""] {
        let plan = stdout(&well(place.command("plan", &["--set", same])));
        assert!(!plan.contains("run "), "{same}: {plan}");
    }
}

#[test]
fn programs_publish_equal_bytes_with_any_number_of_jobs() {
    let place = Place::with_inputs(&Maps::Programs.of(CHAIN), 9);
    let one = place.undisturbed(&["--jobs", "1"]);
    for flags in [&["--jobs", "8"][..], &["--jobs", "8", "--processes"]] {
        assert_eq!(place.undisturbed(flags), one, "{flags:?}");
    }
    // The same as the stages that they stand for.
    let stages = Place::with_inputs(CHAIN, 9).undisturbed(&["--jobs", "8"]);
    let data = |published: &std::collections::BTreeMap<String, String>| -> Vec<(String, String)> {
        let of_maps = published.iter().filter(|(name, _)| name.contains("second"));
        of_maps.map(|(a, b)| (a.clone(), b.clone())).collect()
    };
    assert!(!data(&one).is_empty(), "{one:?}");
    assert_eq!(data(&one), data(&stages));
}

#[test]
fn a_program_that_fails_says_what_it_printed_and_where_its_log_is() {
    let place = place("echo to stdout; echo 'no such can' >&2; exit 1");
    let said = fails(
        &place,
        &[],
        &["`sh ", "ended with exit code 1", "no such can", "logs/"],
    );
    let log = said
        .split('`')
        .find(|word| word.contains("/logs/"))
        .unwrap();
    assert_eq!(fs::read_to_string(log).unwrap().lines().count(), 2);
    let silent = place_of(TABLE, "exit 7");
    fails(
        &silent,
        &["--processes"],
        &["ended with exit code 7, and printed nothing"],
    );
    let killed = place_of(TABLE, "kill -SEGV $$");
    fails(&killed, &[], &["was ended by signal 11"]);
}

#[test]
fn a_script_that_is_not_there_is_named_as_it_was_written() {
    let place = place("true");
    let flags = ["--set", "lines.command=[\"sh\",\"brake.sh\"]"];
    fails(
        &place,
        &flags,
        &["`command` names `brake.sh`, and there is no such file here"],
    );
}

#[test]
fn a_program_reads_the_partitions_that_its_own_one_labels() {
    const PIPELINE: &str = r#"
[stages.split]
kind = "split"
root = "INPUTS"

[stages.group]
kind = "group"
inputs.parts = "split.parts"

[stages.lines]
kind = "program"
command = ["sh", "SCRIPT"]
inputs.groups = "group.groups"
inputs.parts = "split.parts"
each = "groups"
read.parts = "where:group"
makes = "lines"
columns.name = { type = "text" }
max_skipped_fraction = 1.0
"#;
    let place = place_of(PIPELINE, "echo it reads $(ls in/parts); exit 3");
    place.input("p002", b"b2");
    let run = || place.command("run", &[]).output().unwrap();
    let skipped = |partition: &str| {
        let mut skipped = place.bare(&place.lake(), "inspect");
        skipped.args(["lines.lines", "--skipped"]);
        let text = stdout(&well(skipped));
        let line = text.lines().find(|line| line.contains(partition));
        line.unwrap_or_else(|| panic!("{text}")).to_owned()
    };
    run();
    assert!(skipped("a ").contains("it reads p000 p001"));
    assert!(skipped("b ").contains("it reads p002"));
    // What another group has changes nothing here.
    place.input("p002", b"b3");
    place.run_well(&["--until", "group"]);
    let plan = stdout(&well(place.command("plan", &[])));
    assert!(plan.contains("cached  lines.lines   1 of 2"), "{plan}");
    assert!(plan.contains("run     lines.lines   `b`"), "{plan}");
}

#[test]
fn a_program_that_is_not_there_says_how_to_name_one() {
    let pipeline = TABLE.replace(r#"["sh", "SCRIPT"]"#, r#"["no_such_simulator", "--fast"]"#);
    let place = place_of(&pipeline, "");
    fails(
        &place,
        &[],
        &[
            "cannot start `no_such_simulator`",
            "install `no_such_simulator`, put it on PATH",
        ],
    );
}

#[test]
fn a_program_that_writes_nothing_or_half_a_file_is_refused() {
    let nothing = place("true");
    fails(&nothing, &[], &["there is no `out/part.parquet`"]);
    let half = place("true");
    let path = table(
        &half,
        vec![("length_m", numbers(&[1.5])), ("name", texts(&["a"]))],
    );
    put(
        &half.path("break.sh"),
        format!("head -c 300 {path} > out/part.parquet").as_bytes(),
    );
    fails(
        &half,
        &[],
        &["which is not a whole Parquet file", "close the file"],
    );
    let folder = place("mkdir out/part.parquet");
    fails(
        &folder,
        &[],
        &["wrote `out/part.parquet`, which is a folder"],
    );
    let link = place("ln -s /etc/passwd out/part.parquet");
    fails(&link, &[], &["wrote `out/part.parquet`, which is a link"]);
}

#[test]
fn wrong_columns_and_cells_are_named_with_column_type_and_row() {
    let good = || ("name", texts(&["a", "b"]));
    let integers: ArrayRef = Arc::new(Int64Array::from(vec![1, 2]));
    let null: ArrayRef = Arc::new(Float64Array::from(vec![Some(1.0), None]));
    let cases: Vec<(Vec<(&str, ArrayRef)>, &str)> = vec![
        (vec![good()], "column `length_m` (float64) is missing"),
        (
            vec![good(), ("lenght_m", numbers(&[1.0, 2.0]))],
            "there is no column `lenght_m`, did you mean `length_m`?",
        ),
        (
            vec![good(), ("length_m", integers)],
            "column `length_m` is int64, expected float64",
        ),
        (
            vec![good(), ("length_m", numbers(&[1.0, f64::NAN]))],
            "column `length_m` is NaN in row 1, expected a finite number",
        ),
        (
            vec![good(), ("length_m", null)],
            "column `length_m` is null in row 1",
        ),
    ];
    for (columns, message) in cases {
        let is_cell = message.contains(" in row ");
        let hint =
            ["columns of `template.parquet`", "every row needs a value"][usize::from(is_cell)];
        let place = place("true");
        let path = table(&place, columns);
        put(
            &place.path("break.sh"),
            format!("cp {path} out/part.parquet").as_bytes(),
        );
        fails(
            &place,
            &[],
            &[
                "wrote `out/part.parquet`, which is not `lines/1`",
                message,
                hint,
            ],
        );
    }
}

#[test]
fn a_row_too_many_is_named() {
    // A program makes rows, and another one has one row for each of them.
    let pipeline = r#"
[stages.split]
kind = "split"
root = "INPUTS"

[stages.rows]
kind = "program"
command = ["sh", "-c", "cp ROWS out/part.parquet"]
inputs.parts = "split.parts"
each = "parts"
makes = "rows"
columns.name = { type = "text" }

[stages.lines]
kind = "program"
command = ["sh", "SCRIPT"]
inputs.rows = "rows.rows"
each = "rows"
makes = "lines"
one_row_per = "rows.name"
columns.name = { type = "text" }
"#;
    for (made, message) in [
        (
            &["a", "b", "c"][..],
            "has `c` in row 2, expected nothing: 3 rows for the 2 of `rows`",
        ),
        (&["a"], "has nothing in row 1, expected `b`"),
        (&["b", "a"], "has `b` in row 0, expected `a`"),
    ] {
        let place = place_of(pipeline, "true");
        let rows = table(&place, vec![("name", texts(&["a", "b"]))]);
        let kept = place.path("rows.parquet");
        fs::copy(&rows, &kept).unwrap();
        let text = fs::read_to_string(place.pipeline()).unwrap();
        put(
            &place.pipeline(),
            text.replace("ROWS", &kept.display().to_string()).as_bytes(),
        );
        let path = table(&place, vec![("name", texts(made))]);
        put(
            &place.path("break.sh"),
            format!("cp {path} out/part.parquet").as_bytes(),
        );
        fails(&place, &[], &["column `name`", message]);
    }
}

#[test]
fn a_program_that_writes_where_it_may_not_is_refused() {
    for (script, message) in [
        ("echo x > result.txt", "wrote `result.txt` beside `out`"),
        (
            "echo x > ../result.txt",
            "wrote `../result.txt`, outside its folder",
        ),
        ("echo x > in/result.txt", "wrote into `in`"),
        (
            "for part in in/parts/*; do echo x > $part/more; done",
            "wrote into `in`",
        ),
    ] {
        fails(&place(script), &[], &[message, "`out`"]);
    }
    for script in [
        "for part in in/parts/*/data.bin; do chmod u+w $part; echo x >> $part; done",
        "rm -f in/parts/*/data.bin",
        "for part in in/parts/*/data.bin; do rm -f $part; ln -s /etc/passwd $part; done",
        "mv in/parts/*/data.bin out/part.parquet",
        "rm -f job.json",
    ] {
        fails(
            &place(script),
            &[],
            &["changed its input `", "inputs are for reading"],
        );
    }
    let code = place("echo '#' >> SELF; cp TABLE out/part.parquet");
    let path = table(
        &code,
        vec![("length_m", numbers(&[1.5])), ("name", texts(&["a"]))],
    );
    let script = code.path("break.sh").display().to_string();
    put(
        &code.path("break.sh"),
        format!("echo '#' >> {script}; cp {path} out/part.parquet\n").as_bytes(),
    );
    let ran = code.command("run", &[]).output().unwrap();
    assert!(
        stderr(&ran).contains("while it changed; nothing of it is kept"),
        "{}",
        stderr(&ran)
    );
    is_whole(&code);
}

#[test]
fn a_program_may_skip_a_part_and_says_why() {
    let place = place("echo progress 0.1; echo 'it is too short' >&2; exit 3");
    let ran = place
        .command("run", &["--set", "lines.max_skipped_fraction=1.0"])
        .output()
        .unwrap();
    assert_eq!(ran.status.code(), Some(3), "{}", stderr(&ran));
    let mut skipped = place.bare(&place.lake(), "inspect");
    skipped.args(["lines.lines", "--skipped"]);
    let skipped = stdout(&well(skipped));
    assert!(skipped.contains("it is too short"), "{skipped}");
}

#[test]
fn a_wrong_table_is_refused_where_it_stands() {
    let place = place("true");
    let set = |value: &str| {
        let ran = place.command("plan", &["--set", value]).output().unwrap();
        assert_eq!(ran.status.code(), Some(2), "{value}: {}", stderr(&ran));
        stderr(&ran)
    };
    for (value, message) in [
        ("lines.command=[]", "`command` names no program"),
        (
            "lines.each=\"part\"",
            "names the input `part`, which is not wired: did you mean `parts`?",
        ),
        (
            "lines.read.parts=\"some\"",
            "must be `same`, `all`, `label:NAME` or `where:NAME`",
        ),
        ("lines.timeout_s=0", "`timeout_s` is 0.0"),
        ("lines.memory_mb=1", "`memory_mb` is 1"),
        (
            "lines.one_row_per=\"parts.names\"",
            "`columns` has no `names`",
        ),
        ("lines.fan_out=[\"a\",\"a\"]", "has `a` twice"),
        ("lines.columns.name.type=\"float\"", "must be"),
        ("lines.commnd=[\"x\"]", "did you mean `command`?"),
        ("lines.columns={}", "a table of its own needs `columns`"),
    ] {
        let said = set(value);
        assert!(said.contains(message), "{value}: {said}");
        assert!(said.contains("--> "), "{said}");
    }
    place.run_well(&["--until", "split"]);
    let missing = place
        .command("plan", &["--set", "lines.code=[\"none/*.py\"]"])
        .output()
        .unwrap();
    let said = stderr(&missing);
    assert!(
        said.contains("`code` names `none/*.py`, which is no file here"),
        "{said}"
    );
}
