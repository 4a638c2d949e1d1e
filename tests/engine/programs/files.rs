//! What a program puts in place of files and folders: nothing of the user's leaves its place, and what the lake
//! keeps is its own.

use std::{
    fs,
    os::unix::fs::{MetadataExt, PermissionsExt},
    path::Path,
};

use super::{TABLE, fails, is_whole, numbers, place, place_of, table, texts};
use crate::engine::place::{Place, put, stderr, stdout, well};

/// A place with a script that writes its table well after what `script` does; `USER` in it is a folder of the
/// user's with one file.
fn place_with(script: &str) -> Place {
    let place = place("true");
    let columns = vec![("length_m", numbers(&[1.5])), ("name", texts(&["a"]))];
    let path = table(&place, columns);
    let user = place.path("user");
    fs::create_dir_all(&user).unwrap();
    put(&user.join("thesis.txt"), b"the only copy");
    let script = script.replace("USER", &user.display().to_string());
    let script = format!("{script}\ncp {path} out/part.parquet\n");
    put(&place.path("break.sh"), script.as_bytes());
    place
}

fn thesis(place: &Place) -> std::path::PathBuf {
    place.path("user").join("thesis.txt")
}

#[test]
fn a_folder_that_is_replaced_by_a_link_gives_nothing_away() {
    for (script, name) in [
        ("rmdir out; ln -s USER out", "`out`"),
        ("rm -r in; ln -s USER in", "`in`"),
        ("rm -r tmp; ln -s USER tmp", "`tmp`"),
        (
            "mv out o; mkdir elsewhere; ln -s ../USER out; rm -r o",
            "`out`",
        ),
        ("here=$PWD; cd ..; mv job j; ln -s USER job; cd j", "`job`"),
    ] {
        let place = place_with(script);
        let ran = place.command("run", &[]).output().unwrap();
        assert_eq!(ran.status.code(), Some(1), "{script}: {}", stderr(&ran));
        assert_eq!(
            fs::read(thesis(&place)).unwrap(),
            b"the only copy",
            "{script}"
        );
        if name != "`job`" && !script.contains("elsewhere") {
            let said = stderr(&ran);
            assert!(
                said.contains(&format!("removed the folder {name}")),
                "{said}"
            );
        }
        is_whole(&place);
    }
}

/// The files named so below the lake's folder of bytes or tables.
fn kept(folder: &Path, found: &mut Vec<fs::Metadata>) {
    for entry in fs::read_dir(folder).unwrap().flatten() {
        let metadata = fs::symlink_metadata(entry.path()).unwrap();
        if metadata.is_dir() {
            kept(&entry.path(), found);
        } else {
            found.push(metadata);
        }
    }
}

#[test]
fn the_lake_shares_no_file_with_the_user_and_keeps_no_special_right() {
    let place = place_with(
        "ln USER/thesis.txt out/thesis.txt; cp /bin/true out/tool; chmod 6755 out/tool; echo x > out/hidden; \
         chmod 0 out/hidden",
    );
    well(place.command("run", &[]));
    let user = fs::metadata(thesis(&place)).unwrap();
    assert_eq!(
        (user.nlink(), user.permissions().mode() & 0o200),
        (1, 0o200)
    );
    let mut files = Vec::new();
    kept(&place.lake(), &mut files);
    for file in files.iter().filter(|file| file.is_file()) {
        assert_ne!(file.ino(), user.ino());
        assert_eq!(file.permissions().mode() & 0o7000, 0);
    }
    // A change of the user's own file is none of the lake's.
    put(&thesis(&place), b"another text!");
    let verified = place.bare(&place.lake(), "verify").output().unwrap();
    assert_eq!(verified.status.code(), Some(0), "{}", stdout(&verified));
}

#[test]
fn the_time_limit_holds_for_reading_what_was_written() {
    let place = place_with("truncate -s 4000G out/huge.bin");
    let began = std::time::Instant::now();
    fails(
        &place,
        &["--set", "lines.timeout_s=2"],
        &[
            "wrote `out/huge.bin` of 4294967 MB",
            "of 2 s (`timeout_s`)",
            "write less",
        ],
    );
    assert!(began.elapsed().as_secs() < 60);
}

#[test]
fn a_script_that_cannot_start_says_what_is_wrong_with_its_first_line() {
    for (first_line, parts) in [
        (
            "#!/bin/sh\r\n",
            ["ends with a carriage return", "sed -i 's/\\r$//'"],
        ),
        (
            "#!/usr/bin/env sh\r\n",
            ["ends with a carriage return", "sed -i 's/\\r$//'"],
        ),
        (
            "#!/opt/none/python3 -u\n",
            [
                "names the interpreter `/opt/none/python3`",
                "install the interpreter",
            ],
        ),
        ("import sys\n", ["names no interpreter", "begin it with"]),
    ] {
        let place = place_of(
            &TABLE.replace(r#"["sh", "SCRIPT"]"#, r#"["SCRIPT"]"#),
            first_line,
        );
        let executable = fs::Permissions::from_mode(0o755);
        fs::set_permissions(place.path("break.sh"), executable).unwrap();
        fails(&place, &[], &parts);
    }
}
