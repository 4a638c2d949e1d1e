//! The stage of `own_stages/logged.rs`, written as a lab would, works as every other stage.

use std::collections::BTreeMap;

use dataflow::Artifact;
use schemas::trials::AllTrials;

use crate::engine::place::{Place, stderr};

const PIPELINE: &str = r"
[stages.bench]
kind = 'logged'
objects.can = [2, 1]
objects.mug = [0, 4]
";

#[test]
fn a_stage_of_one_file_makes_typed_tables_and_is_told_once() {
    let place = Place::new(PIPELINE);
    let said = stderr(&place.run_well(&[]));
    assert!(said.contains("7 trials by hand"), "{said}");
    let table = "tables/trials/pipeline=own/stage=bench/dispatching=all/part.parquet";
    let artifact = Artifact {
        key: "all".parse().unwrap(),
        labels: BTreeMap::new(),
        files: BTreeMap::from([(lake::table::FILE.to_owned(), place.lake().join(table))]),
    };
    let trials: AllTrials = lake::table::read(&artifact).unwrap();
    let outcomes = &trials[0].outcomes;
    assert_eq!((outcomes.total_count(), outcomes.success_count()), (3, 2));
    let again = stderr(&place.run_well(&[]));
    assert!(again.contains("cached"), "{again}");
}
