//! Typed reads and writes of stages: round trips, and errors for faulty input.

use std::{collections::BTreeMap, error::Error, fs, path::Path};

use dataflow::{Artifact, Context, Diagnostic, Inputs};
use lake::{LakeError, ReadArtifact, ReadInputs, WriteArtifact, table};
use schemas::{
    Table,
    latents::{LatentDimension, Latents},
    training::Training,
};

fn latents(kl_nats: f64) -> Latents {
    vec![LatentDimension {
        dimension: 0,
        kl_nats,
        mean_deviation: 0.9,
        deviation_mean: 0.4,
        active: true,
    }]
}

fn artifact(key: &str, folder: &Path) -> Artifact {
    let files = fs::read_dir(folder).unwrap().map(|file| {
        let path = file.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        (name, path)
    });
    Artifact {
        key: key.parse().unwrap(),
        labels: BTreeMap::new(),
        files: files.collect(),
    }
}

fn inputs(name: &str, artifacts: Vec<Artifact>) -> Inputs {
    Inputs::new(BTreeMap::from([(name.to_owned(), artifacts)]), Vec::new())
}

#[test]
fn written_artifact_is_read_by_type() {
    let folder = tempfile::tempdir().unwrap();
    let cx = Context::detached(&"cgf".parse().unwrap(), 7, folder.path());
    cx.write(&latents(0.5)).unwrap();
    cx.write_file("note.txt", "μ".as_bytes()).unwrap();
    let made = artifact("cgf", folder.path());
    assert_eq!(made.text("note.txt").unwrap(), "μ");
    assert_eq!(
        made.parsed("note.txt", |bytes| Some(bytes.to_vec()))
            .unwrap(),
        "μ".as_bytes()
    );
    let one = inputs(Latents::NAME, vec![made.clone()]);
    assert_eq!(one.one::<Latents>().unwrap(), latents(0.5));
    assert_eq!(one.optional::<Latents>().unwrap(), Some(latents(0.5)));
    assert_eq!(one.optional::<Training>().unwrap(), None);
    let two = inputs(Latents::NAME, vec![made.clone(), made]);
    assert_eq!(two.all::<Latents>().unwrap().len(), 2);
    for several in [two.one::<Latents>().map(Some), two.optional()] {
        let err = several.unwrap_err().to_string();
        assert_eq!(err, "the unit reads 2 partitions of latents, expected one");
    }
}

#[test]
fn unreadable_and_unwritable_tables_are_errors_with_a_hint() {
    let folder = tempfile::tempdir().unwrap();
    let check = |err: LakeError, said: &str, cause: Option<&str>, again: bool| {
        assert_eq!(err.to_string(), said);
        let source = err.source().map(ToString::to_string);
        assert_eq!(source.as_deref(), cause);
        let hint = err.hint();
        assert_eq!(hint.is_some_and(|hint| hint.contains("--fresh")), again);
    };
    let none = inputs(Latents::NAME, Vec::new());
    check(
        none.one::<Latents>().unwrap_err(),
        "the unit reads no latents",
        None,
        false,
    );
    check(
        none.source("hand").unwrap_err(),
        "the unit reads no hand",
        None,
        false,
    );
    check(
        table::read::<Latents>(&artifact("cgf", folder.path())).unwrap_err(),
        "artifact `cgf` has no file `part.parquet`",
        None,
        true,
    );
    let cx = Context::detached(&"cgf".parse().unwrap(), 7, folder.path());
    check(
        cx.write(&latents(f64::NAN)).unwrap_err(),
        "cannot make the table `latents`",
        Some("column `kl_nats` holds a number that is not finite in row 0"),
        false,
    );
    cx.write(&latents(0.5)).unwrap();
    check(
        table::read::<Training>(&artifact("cgf", folder.path())).unwrap_err(),
        "the table of `cgf` does not follow the schema of `training`",
        Some("table has schema `latents/1`, expected `training/3`"),
        true,
    );
    let gone = artifact("cgf", folder.path());
    fs::remove_file(folder.path().join(table::FILE)).unwrap();
    let err = gone
        .parsed(table::FILE, |bytes| Some(bytes.to_vec()))
        .unwrap_err();
    assert!(err.to_string().starts_with("cannot read `"), "{err}");
}
