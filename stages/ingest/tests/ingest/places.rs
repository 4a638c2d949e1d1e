//! Wrong things in a file's place: each is reported at once, with its path and what to do,
//! for every kind of file that a dataset has.

use std::{
    error::Error,
    fs::{self, File, Permissions},
    os::unix::{ffi::OsStrExt as _, fs::PermissionsExt as _},
    path::{Path, PathBuf},
    process::Command,
    sync::mpsc,
    thread,
    time::Duration,
};

use dataflow::{BoxedDiagnostic, Outcome, Stage};
use stage_ingest::{AddedMesh, Format, Ingest, IngestConfig};
use tempfile::TempDir;

use crate::{
    bench::{Bench, config},
    dataset,
    hand_model::models,
    rig::{OBJECT, Rig},
    tracks::tracks,
};

/// Longer than any of these takes, even on a busy machine: a pipe that is opened is waited for forever.
const SOON: Duration = Duration::from_mins(1);

/// Something in a file's place.
type Bad = (&'static str, fn(&Path), &'static str);

/// Kinds of wrong files, each with its message.
const BADS: [Bad; 6] = [
    (
        "a folder",
        |path| fs::create_dir(path).unwrap(),
        "is a folder: put the file there",
    ),
    (
        "a named pipe",
        |path| assert!(Command::new("mkfifo").arg(path).status().unwrap().success()),
        "is a named pipe: put the file there",
    ),
    (
        "a link to nothing",
        |path| std::os::unix::fs::symlink("no/such/file", path).unwrap(),
        "is a link to nothing: put the file there",
    ),
    (
        "a socket",
        |path| drop(std::os::unix::net::UnixListener::bind(path).unwrap()),
        "is a socket: put the file there",
    ),
    (
        "2 GB",
        |path| File::create(path).unwrap().set_len(2 << 30).unwrap(),
        "has 2147483648 bytes, more than the ",
    ),
    (
        UNREADABLE,
        |path| {
            fs::write(path, "secret").unwrap();
            fs::set_permissions(path, Permissions::from_mode(0o0)).unwrap();
        },
        "give yourself the right to, e.g. with `chmod ",
    ),
];
const UNREADABLE: &str = "a file without the right to read it";

/// Says whether rights are asked for at all: the system's administrator has all of them.
fn rights_count() -> bool {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    File::create(&path).unwrap();
    fs::set_permissions(&path, Permissions::from_mode(0o0)).unwrap();
    let counts = File::open(&path).is_err();
    if !counts {
        eprintln!("skipped: {UNREADABLE}, as this user may read every file");
    }
    counts
}

/// A dataset with its options, and folders that must live as long.
struct Set {
    config: IngestConfig,
    _folders: Vec<TempDir>,
}

impl Set {
    fn dexycb() -> Self {
        let (root, models) = (
            dataset(&Rig {
                cameras: 1,
                ..Rig::default()
            }),
            models(),
        );
        let mut config = config(root.path());
        config.mano_models = Some(models.path().to_owned());
        let added = root.path().join("brick.obj");
        let mesh = root.path().join("models").join(OBJECT.0);
        fs::copy(mesh.join("textured_simple.obj"), &added).unwrap();
        let added = AddedMesh {
            file: added,
            mass_kg: 0.2,
        };
        config.meshes.insert("brick".to_owned(), added);
        Self {
            config,
            _folders: vec![root, models],
        }
    }

    fn tracks() -> Self {
        let root = tempfile::tempdir().unwrap();
        tracks(root.path());
        let mut config = config(root.path());
        config.format = Format::Tracks;
        Self {
            config,
            _folders: vec![root],
        }
    }
}

/// Everything that is said, soon, of what cannot be used; the files that would have been digested.
fn said(config: IngestConfig) -> (String, Vec<PathBuf>) {
    let (tell, told) = mpsc::channel();
    thread::spawn(move || {
        let said = match Bench::until(config, "demonstrations") {
            Ok(bench) => {
                let reasons = bench.outcomes.values().filter_map(|outcome| match outcome {
                    Outcome::Skipped { reason } => Some(reason.clone()),
                    Outcome::Made(_)
                    | Outcome::Labeled(..)
                    | Outcome::Provisional(_)
                    | Outcome::Filtered { .. } => None,
                });
                let files = bench.units.values().flatten().flat_map(|unit| &unit.files);
                let files = files.map(|file| file.path.clone()).collect();
                (reasons.collect::<Vec<_>>().join("\n"), files)
            }
            Err(err) => (whole(&err), Vec::new()),
        };
        let _nobody_waits_any_more = tell.send(said);
    });
    told.recv_timeout(SOON).expect("it waits for something")
}

/// An error with its causes and its hint.
fn whole(err: &BoxedDiagnostic) -> String {
    let mut text = err.to_string();
    let mut cause = err.source();
    while let Some(err) = cause {
        text = format!("{text}: {err}");
        cause = err.source();
    }
    format!("{text}\nhint: {}", err.hint().unwrap_or_default())
}

#[test]
fn wrong_file_type_is_refused_at_once() {
    let rights_count = rights_count();
    let sequence = Rig::sequence(Path::new(""));
    let label = Rig::label(Path::new(""), 5);
    let meta = sequence.join("meta.yml");
    let poses = sequence.join("pose.npz");
    let mesh = Path::new("models")
        .join(OBJECT.0)
        .join("textured_simple.obj");
    let track = Path::new("20200709-subject-01/first try");
    let dexycb = |path: &Path| (Set::dexycb as fn() -> Set, path.to_owned());
    let tracks = |path: &str| (Set::tracks as fn() -> Set, track.join(path));
    let files = [
        dexycb(&label),
        dexycb(&meta),
        dexycb(&poses),
        dexycb(Path::new(
            "calibration/extrinsics_20200702_151821/extrinsics.yml",
        )),
        dexycb(Path::new("calibration/mano_x/mano.yml")),
        dexycb(&mesh),
        dexycb(Path::new("brick.obj")),
        dexycb(Path::new("MANO_RIGHT.pkl")),
        tracks("track.yml"),
        tracks("track.npz"),
    ];
    for (set, name) in &files {
        for (what, put, expected) in &BADS {
            if *what == UNREADABLE && !rights_count {
                continue;
            }
            let Set { config, _folders } = set();
            let folder = match &config.mano_models {
                Some(models) if name.ends_with("MANO_RIGHT.pkl") => models,
                _ => &config.root,
            };
            let path = folder.join(name);
            fs::remove_file(&path).unwrap();
            put(&path);
            let (said, read) = said(config);
            let name = name.to_str().unwrap();
            for part in [*expected, name] {
                assert!(
                    said.contains(part),
                    "{what} at `{name}`: no `{part}` in `{said}`"
                );
            }
            assert!(
                !read.contains(&path),
                "{what} at `{name}` would be digested"
            );
        }
    }
}

#[test]
fn unreadable_folder_is_named() {
    if !rights_count() {
        return;
    }
    let closed = [
        (
            Rig::sequence(Path::new("")),
            "20200709-subject-01/20200709_141754",
        ),
        (
            Rig::label(Path::new(""), 5).parent().unwrap().to_owned(),
            "836212060125",
        ),
        (PathBuf::from("20200709-subject-01"), "20200709-subject-01"),
    ];
    for (folder, name) in closed {
        let Set { config, _folders } = Set::dexycb();
        let folder = config.root.join(folder);
        let rights = |mode| fs::set_permissions(&folder, Permissions::from_mode(mode)).unwrap();
        rights(0);
        let (said, _) = said(config);
        rights(0o755);
        for part in [name, "give yourself the right to, e.g. with `chmod "] {
            assert!(said.contains(part), "no `{part}` in `{said}`");
        }
    }
}

#[test]
fn non_utf8_name_is_refused() {
    use std::ffi::OsStr;
    let sequence = Rig::sequence(Path::new(""));
    let label = Rig::label(Path::new(""), 5);
    let names: [(&Path, &[u8], &str); 3] = [
        (
            &label,
            b"labels_\xff00005.npz",
            "`20200709-subject-01/20200709_141754/836212060125/labels_\u{fffd}00005.npz`",
        ),
        (
            &sequence,
            b"20200709_\xff41754",
            "`20200709-subject-01/20200709_\u{fffd}41754`",
        ),
        (
            sequence.parent().unwrap(),
            b"subject-\xff",
            "`subject-\u{fffd}/20200709_141754`",
        ),
    ];
    for (path, name, shown) in names {
        let Set { config, _folders } = Set::dexycb();
        let path = config.root.join(path);
        fs::rename(&path, path.with_file_name(OsStr::from_bytes(name))).unwrap();
        let (said, _) = said(config);
        let expected = format!("the name of {shown} is not UTF-8: rename it");
        assert!(said.contains(&expected), "no `{expected}` in `{said}`");
    }
}

#[test]
fn wrong_dataset_root_is_refused_with_the_right_one() {
    let outer = tempfile::tempdir().unwrap();
    let root = outer.path().join("download/dexycb");
    Rig {
        cameras: 1,
        ..Rig::default()
    }
    .write(&root);
    let tracked = outer.path().join("mine/recordings");
    tracks(&tracked);
    let subject = "20200709-subject-01";
    for (wrong, right, format) in [
        (outer.path().to_owned(), &root, Format::DexYcb),
        (outer.path().join("download"), &root, Format::DexYcb),
        (root.join(subject), &root, Format::DexYcb),
        (Rig::sequence(&root), &root, Format::DexYcb),
        (outer.path().to_owned(), &tracked, Format::Tracks),
        (outer.path().join("mine"), &tracked, Format::Tracks),
        (tracked.join(subject), &tracked, Format::Tracks),
        (
            tracked.join(subject).join("first try"),
            &tracked,
            Format::Tracks,
        ),
    ] {
        let mut config = config(&wrong);
        config.format = format;
        let err = Ingest::prepare(&config).unwrap_err();
        let hint = format!(
            "the dataset's root seems to be `{}`: set `root` to that",
            right.display()
        );
        assert_eq!(err.hint().unwrap(), hint, "{}", wrong.display());
    }
    // A file in the root's place.
    let err =
        Ingest::prepare(&config(&root.join("models/../calibration/mano_x/mano.yml"))).unwrap_err();
    assert!(
        whole(&err).contains("set `root` to the folder"),
        "{}",
        whole(&err)
    );
}
