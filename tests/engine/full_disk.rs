//! Disks that are full, read-only, or several.

use std::{
    fs::{self, File},
    io::Write,
    os::unix::fs::{FileExt, MetadataExt, symlink},
    path::Path,
    process::{Command, Output},
};

use tempfile::TempDir;

use crate::engine::place::{CHAIN, Place, assert_same, program, published, put, stderr, well};

const MIB: u64 = 1 << 20;

/// A place whose files are large enough to fill something.
fn place() -> Place {
    let place = Place::on_disk(CHAIN);
    for number in 0_u8..3 {
        let file = File::create(place.inputs().join(format!("p{number}.txt"))).unwrap();
        { &file }.write_all(&[b'a' + number]).unwrap();
        file.write_all_at(b"z", MIB - 1).unwrap();
    }
    place
}

/// A shell script as root of its own user and mount namespace, with `$PROGRAM`, `$FILE` and `$LAKE`;
/// `None`, which is said, where the system allows no such thing.
fn in_namespace(place: &Place, script: &str) -> Option<Output> {
    let allowed = Command::new("unshare").args(["-rm", "true"]).status();
    if !allowed.is_ok_and(|status| status.success()) {
        println!("skipped: no user namespaces here");
        return None;
    }
    let mut shell = Command::new("unshare");
    shell.args(["-rm", "sh", "-euc", script]);
    Some(with_variables(shell, place).output().unwrap())
}

fn with_variables(mut shell: Command, place: &Place) -> Command {
    shell
        .env("PROGRAM", program())
        .env("FILE", place.pipeline())
        .env("LAKE", place.lake())
        .env("ROOM", place.path("room"));
    shell
}

/// A run failed as it should: it names the file that it could not write, and does not panic.
fn assert_clear(output: &Output, reason: &str) {
    let said = stderr(output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("error: "), "{said}");
    assert!(said.contains(reason), "{said}");
    assert!(!said.contains("panicked"), "{said}");
}

fn verify(place: &Place, lake: &Path) {
    well(place.bare(lake, "verify"));
}

#[test]
fn a_full_disk_is_an_error_and_harms_nothing() {
    let place = place();
    let expected = place.undisturbed(&[]);
    fs::create_dir(place.lake()).unwrap();
    // The files written until the disk was full are copied out of the namespace.
    let script = r#"
        mount -t tmpfs -o size=5m tmpfs "$LAKE"
        code=0; "$PROGRAM" run "$FILE" --lake "$LAKE" || code=$?
        cp -a "$LAKE" "$ROOM"
        exit $code"#;
    let Some(output) = in_namespace(&place, script) else {
        return;
    };
    assert_clear(&output, "no space left on the disk");
    let lake = place.path("room");
    verify(&place, &lake);
    well(place.command_in(&lake, "run", &[]));
    assert_same(&published(&lake), &expected, "");
    assert_eq!(leftovers(&lake), [""; 0]);
}

#[test]
fn next_run_removes_leftovers_of_a_dead_process() {
    let place = place();
    place.run_well(&[]);
    for arguments in [&[][..], &["--set", "first.add=9"]] {
        let staging = place.lake().join("staging");
        for file in ["4000000-1-7.new", "history-4000000-1/part.parquet"] {
            fs::create_dir_all(staging.join(file).parent().unwrap()).unwrap();
            put(&staging.join(file), b"half a file");
        }
        fs::create_dir(staging.join("ab".repeat(32))).unwrap();
        assert_eq!(leftovers(&place.lake()).len(), 3);
        place.run_well(arguments);
        assert_eq!(leftovers(&place.lake()), [""; 0], "{arguments:?}");
    }
}

/// Lists the staging folder of a lake.
fn leftovers(lake: &Path) -> Vec<String> {
    let entries = fs::read_dir(lake.join("staging")).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.collect()
}

#[test]
fn a_file_that_may_not_grow_is_an_error_and_harms_nothing() {
    let place = place();
    let expected = place.undisturbed(&[]);
    // Blocks of 512 bytes: files of up to half a MiB. The signal is ignored, so that the write fails.
    let mut shell = Command::new("sh");
    shell.args([
        "-c",
        r#"trap '' XFSZ; ulimit -f 1024; exec "$PROGRAM" run "$FILE" --lake "$LAKE""#,
    ]);
    let output = with_variables(shell, &place).output().unwrap();
    assert_clear(&output, "the file is larger than is allowed");
    verify(&place, &place.lake());
    place.run_well(&[]);
    assert_same(&place.published(), &expected, "");
}

#[test]
fn a_read_only_lake_can_be_read() {
    let place = place();
    place.run_well(&[]);
    let before = place.published();
    let script = r#"
        mount --bind "$LAKE" "$LAKE"
        mount -o remount,ro,bind "$LAKE"
        "$PROGRAM" plan "$FILE" --lake "$LAKE"
        "$PROGRAM" query "select count(*) as n from parts" --lake "$LAKE""#;
    let Some(output) = in_namespace(&place, script) else {
        return;
    };
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let script = r#"
        mount --bind "$LAKE" "$LAKE"
        mount -o remount,ro,bind "$LAKE"
        "$PROGRAM" run "$FILE" --lake "$LAKE" $VALUES"#;
    // With nothing to do it is done.
    let output = in_namespace(&place, &script.replace("$VALUES", "")).unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("nothing to run"));
    let output = in_namespace(&place, &script.replace("$VALUES", "--set first.add=9")).unwrap();
    assert_clear(&output, "the file system is read-only");
    assert_same(&place.published(), &before, "");
    verify(&place, &place.lake());
    place.run_well(&[]);
}

#[test]
fn blobs_may_lie_on_another_file_system() {
    let place = place();
    let here = fs::metadata(place.inputs()).unwrap().dev();
    let elsewhere = fs::metadata("/dev/shm").map(|metadata| metadata.dev());
    if !elsewhere.is_ok_and(|elsewhere| elsewhere != here) {
        println!("skipped: no other file system here");
        return;
    }
    let blobs = TempDir::new_in("/dev/shm").unwrap();
    fs::create_dir(place.lake()).unwrap();
    symlink(blobs.path(), place.lake().join("blobs")).unwrap();
    let output = place.command("run", &[]).output().unwrap();
    if output.status.code() == Some(0) {
        assert_same(&place.published(), &place.undisturbed(&[]), "");
        place.take_log();
        place.run_well(&[]);
        assert!(place.take_log().is_empty());
    } else {
        assert_clear(&output, "blobs");
        fs::remove_file(place.lake().join("blobs")).unwrap();
        place.run_well(&[]);
        assert_same(&place.published(), &place.undisturbed(&[]), "");
    }
    verify(&place, &place.lake());
}

#[test]
fn a_lake_may_lie_on_another_file_system() {
    let Ok(other) = TempDir::new_in("/dev/shm") else {
        println!("skipped: no other file system here");
        return;
    };
    let place = place();
    let lake = other.path().join("lake");
    well(place.command_in(&lake, "run", &[]));
    assert_same(&published(&lake), &place.undisturbed(&[]), "");
}
