//! Where a lake lies, and what its partitions are called: questions are answered with what was made.

use std::{fs, path::Path};

use crate::engine::place::{CHAIN, Place, stdout, well};

const ROWS: &str = "select stage, part, name, bytes, sum from parts order by stage, part";

fn ask(place: &Place, lake: &Path, sql: &str) -> String {
    let mut query = place.bare(lake, "query");
    query.args([sql, "--format", "csv"]);
    stdout(&well(query))
}

#[test]
fn a_lake_is_read_wherever_it_lies() {
    let place = Place::with_inputs(CHAIN, 3);
    place.run_well(&[]);
    let expected = ask(&place, &place.lake(), ROWS);
    assert_eq!(expected.lines().count(), 7, "{expected}");
    for folder in [
        "results [v2]",
        "la*ke",
        "la?e",
        "{a,b}",
        "bytes=9",
        "part=none",
        "stage=first",
        "fingerprint=00",
        "a%20b",
        "run=7",
    ] {
        let lake = place.path(folder).join("lake");
        fs::create_dir_all(lake.parent().unwrap()).unwrap();
        // A lake beside it that the name as a pattern would find.
        fs::rename(place.lake(), &lake).unwrap();
        assert_eq!(ask(&place, &lake, ROWS), expected, "{folder}");
        let all = "select run, count(*) as n from all_parts group by run";
        assert_eq!(ask(&place, &lake, all), "run,n\n1,6\n", "{folder}");
        let runs = "select run, pipeline from runs";
        assert_eq!(
            ask(&place, &lake, runs),
            "run,pipeline\n1,own\n",
            "{folder}"
        );
        fs::rename(&lake, place.lake()).unwrap();
    }
}

#[test]
fn partitions_keep_their_names() {
    let place = Place::new(CHAIN);
    let names = [
        "mug[1]",
        "mug1",
        "a%2Fb",
        "a%20b",
        "__HIVE_DEFAULT_PARTITION__",
        "007",
        "7",
        "2024-01-01",
        "true",
        "null",
        "x*",
    ];
    for name in names {
        place.input(name, name.as_bytes());
    }
    place.run_well(&[]);
    for table in ["parts", "all_parts"] {
        let sql = format!(
            "select part, count(*) as n from {table} where stage = 'split' group by part order by part"
        );
        let said = ask(&place, &place.lake(), &sql);
        let mut expected: Vec<String> = names.iter().map(|name| format!("{name},1")).collect();
        expected.sort();
        let said: Vec<&str> = said.lines().skip(1).collect();
        assert_eq!(said, expected, "{table}");
    }
}
