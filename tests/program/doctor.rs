//! `pipeline doctor` says what is ready and what is missing.

use std::{fs, net::TcpListener};

use crate::program::{
    bench::{Bench, put, stderr, stdout},
    commands::{done, pipeline},
};

#[test]
fn doctor_finds_everything_ready_and_leaves_nothing_behind() {
    let bench = Bench::new();
    let report = done(&bench, "doctor", &[]);
    assert!(!bench.lake().exists());
    assert!(
        report.lines().all(|line| line.starts_with("ok ")),
        "{report}"
    );
    for subject in [
        "lake",
        "hard links",
        "locks",
        "compute",
        "ingest",
        "retarget",
        "train",
        "sample",
        "screen",
        "dispatch",
        "robot cell",
    ] {
        let has_line = report.lines().any(|line| line[9..].starts_with(subject));
        assert!(has_line, "{subject}: {report}");
    }
}

/// The report of a failed `doctor`, and its stderr.
fn missing(arguments: &[&str]) -> (String, String) {
    let output = Bench::new().command("doctor", arguments).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", stdout(&output));
    (stdout(&output), stderr(&output))
}

#[test]
fn doctor_names_what_is_missing_and_what_to_do() {
    let folder = tempfile::TempDir::new().unwrap();
    let hand = |stage: &str, urdf: &str| {
        let file = include_str!("../../data/hands/allegro_right.toml");
        let path = folder.path().join(format!("{stage}.toml"));
        put(&path, &file.replace("../robots/allegro_right.urdf", urdf));
        format!("{stage}.hand={}", path.display())
    };
    let (report, hints) = missing(&[
        "--set",
        "ingest.root=no/such/folder",
        "--set",
        &hand("train", "such.urdf"),
        "--set",
        &hand("dispatch", "other.urdf"),
    ]);
    for (stage, says) in [
        ("ingest", "no/such/folder"),
        ("train", "such.urdf"),
        ("dispatch", "other.urdf"),
    ] {
        let line = report.lines().find(|line| line[9..].starts_with(stage));
        let line = line.unwrap();
        assert!(
            line.starts_with("missing ") && line.contains(says),
            "{line}"
        );
    }
    assert!(hints.contains("hint: unpack the dataset"), "{hints}");
    assert!(
        hints.contains("`pipelines/cgf.toml` cannot run: 3 missing"),
        "{hints}"
    );
    assert!(report.contains("\nok       retarget "), "{report}");
}

#[test]
fn doctor_asks_a_real_cell_whether_it_is_there() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let cell = format!("dispatch.cell=tcp/{}", listener.local_addr().unwrap());
    let report = done(&Bench::new(), "doctor", &["--set", &cell]);
    assert!(report.contains("\nunset    robot cell"), "{report}");
    assert!(report.contains("--execute"), "{report}");
    drop(listener);
    let (report, hints) = missing(&["--set", &cell]);
    assert!(report.contains("\nmissing  robot cell"), "{report}");
    assert!(hints.contains("dispatch.cell=simulated"), "{hints}");
}

#[test]
fn doctor_notices_a_lake_that_cannot_be_written() {
    let folder = tempfile::tempdir().unwrap();
    put(&folder.path().join("file"), "no folder\n");
    let lake = folder.path().join("file/lake");
    let output = pipeline(&["doctor", "--lake", lake.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    let (report, hints) = (stdout(&output), stderr(&output));
    assert!(report.starts_with("missing  lake"), "{report}");
    assert!(hints.contains("--lake DIR"), "{hints}");
}

#[test]
fn doctor_reports_a_wrong_file_as_every_command_does() {
    let wrong = pipeline(&["doctor", "no/such.toml"]);
    assert_eq!(wrong.status.code(), Some(2));
    let several = pipeline(&["doctor", "--set", "seed=1,2"]);
    assert_eq!(several.status.code(), Some(2));
    assert!(
        stderr(&several).contains("one value"),
        "{}",
        stderr(&several)
    );
}

#[test]
fn doctor_describes_a_robot_and_proposes_its_hand() {
    let output = pipeline(&["doctor", "--robot", "data/robots/allegro_left.urdf"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report = stderr(&output);
    for says in [
        "`allegro_left`, root link `base_link`",
        "16 independent ones",
        "21 in 17 moving bodies, 0.973 kg together",
        "to `link_15.0_tip`, 160 mm: joint_12.0, joint_13.0, joint_14.0, joint_15.0",
        "cannot be at 0: its limits are 0.263 and 1.396",
    ] {
        assert!(report.contains(says), "{says}: {report}");
    }
    // What goes to a file is the table alone.
    let table: toml_edit::DocumentMut = stdout(&output).parse().unwrap();
    assert_eq!(table["side"].as_str(), Some("left"));
    let points = table["points"].as_array().unwrap();
    let followed: Vec<(&str, &str)> = points
        .iter()
        .map(|point| point.as_inline_table().unwrap())
        .map(|point| {
            let text = |key: &str| point[key].as_str().unwrap();
            (text("keypoint"), text("link"))
        })
        .collect();
    assert_eq!(
        followed,
        [
            ("thumb_tip", "link_15.0_tip"),
            ("index_tip", "link_3.0_tip"),
            ("middle_tip", "link_7.0_tip"),
            ("ring_tip", "link_11.0_tip"),
            ("thumb_pip", "link_14.0"),
            ("index_pip", "link_2.0"),
            ("middle_pip", "link_6.0"),
            ("ring_pip", "link_10.0"),
            ("wrist", "base_link"),
        ]
    );
}

#[test]
fn doctor_says_what_is_unphysical_in_a_robot() {
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("hand.urdf");
    let urdf = path.to_str().unwrap();
    put(
        &path,
        r#"<robot name="r"><link name="palm"><visual><geometry><mesh filename="package://hand/palm.stl"/></geometry></visual></link>
        <link name="a"><inertial><mass value="1"/><inertia ixx="1e-4" iyy="1e-4" izz="3e-4"/></inertial></link>
        <joint name="j" type="revolute"><parent link="palm"/><child link="a"/><axis xyz="0 0 1"/><limit lower="0" upper="0"/></joint></robot>"#,
    );
    let output = pipeline(&["doctor", "--robot", urdf]);
    assert_eq!(output.status.code(), Some(1));
    let report = stderr(&output);
    let rows: Vec<(&str, &str)> = report
        .lines()
        .filter_map(|line| line.split_once("  "))
        .map(|(word, rest)| (word, rest.trim_start()))
        .collect();
    for (word, says) in [
        ("wrong", "violates the triangle inequality"),
        ("doubtful", "is locked: its limits are both 0"),
        ("doubtful", "has no effort limit: 0 Nm"),
        ("note", "in physics it has that of all that it carries"),
        (
            "note",
            "is drawn with a mesh that is not there: `package://hand/palm.stl`",
        ),
        ("note", "has mass and nothing to collide with"),
        ("note", "has too few fingers and links"),
    ] {
        let is_said = rows.iter().any(|row| row.0 == word && row.1.contains(says));
        assert!(is_said, "{word} {says}: {report}");
    }
    assert!(report.contains("hint: give it its range"), "{report}");
    assert!(report.contains("1 physically impossible value"), "{report}");
    // A mesh in the package's own folder, above the URDF, is found.
    fs::create_dir(folder.path().join("hand")).unwrap();
    put(&folder.path().join("hand/palm.stl"), "solid");
    let report = stderr(&pipeline(&["doctor", "--robot", urdf]));
    assert!(!report.contains("palm.stl"), "{report}");
}

#[test]
fn doctor_names_links_without_inertia() {
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("hand.urdf");
    let described = fs::read_to_string("data/robots/allegro_right.urdf").unwrap();
    let mut without = described;
    for link in ["link_1.0", "link_2.0"] {
        let at = without.find(&format!("<link name=\"{link}\">")).unwrap();
        let start = at + without[at..].find("<inertial>").unwrap();
        let end = start + without[start..].find("</inertial>").unwrap() + "</inertial>".len();
        without.replace_range(start..end, "");
    }
    put(&path, &without);
    let output = pipeline(&["doctor", "--robot", path.to_str().unwrap()]);
    // It can be retargeted to, and its table is proposed.
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report = stderr(&output);
    let says = "each moves and has no inertia, nor has what is fixed to it: `screen` refuses it: \
                `link_1.0`, `link_2.0`";
    let line = report.lines().find(|line| line.contains(says));
    assert!(
        line.is_some_and(|line| line.starts_with("doubtful ")),
        "{report}"
    );
    assert!(
        report.contains("hint: give it an `<inertial>` with mass and inertia"),
        "{report}"
    );
}

#[test]
fn doctor_says_why_a_robot_cannot_be_read() {
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("hand.urdf");
    let urdf = path.to_str().unwrap();
    let refused = |says: &str, hint: &str| {
        let output = pipeline(&["doctor", "--robot", urdf]);
        assert_eq!(output.status.code(), Some(1), "{says}");
        assert_eq!(stdout(&output), "");
        assert!(
            stderr(&output).contains(says),
            "{says}: {}",
            stderr(&output)
        );
        assert!(
            stderr(&output).contains(hint),
            "{hint}: {}",
            stderr(&output)
        );
    };
    refused("cannot read `", "hint: give the path of a URDF");
    put(
        &path,
        "<!DOCTYPE robot><robot name='r'><link name='a'/></robot>",
    );
    refused("document type declaration", "hint: remove `<!DOCTYPE …>`");
    put(
        &path,
        "<robot name='r'><link name='a'/><link name='b'/></robot>",
    );
    refused("both have no parent", "hint: connect them by a joint");
    let both = pipeline(&["doctor", "pipelines/cgf.toml", "--robot", urdf]);
    assert_eq!(both.status.code(), Some(2));
}

#[test]
fn doctor_finds_the_side_of_published_hands() {
    let Some(folder) = measured_data::folder("urdf") else {
        return;
    };
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let output = pipeline(&["doctor", "--robot", path.to_str().unwrap()]);
        let report = stderr(&output);
        // With or without its meshes, the available facts are reported.
        let is_missing = report.lines().any(|line| line.starts_with("missing "));
        let is_wrong = report.lines().any(|line| line.starts_with("wrong "));
        let expected = i32::from(is_missing || is_wrong);
        assert_eq!(output.status.code(), Some(expected), "{report}");
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let side = ["left", "right"]
            .into_iter()
            .find(|side| name.contains(side));
        if let Some(side) = side {
            let table: toml_edit::DocumentMut = stdout(&output).parse().unwrap();
            assert_eq!(table["side"].as_str(), Some(side), "{name}");
            let scale = table["scale"].as_float().unwrap();
            assert!((0.9..1.2).contains(&scale), "{name}: {scale}");
        }
    }
}

#[test]
fn doctor_and_run_say_where_the_simulated_cell_differs_from_the_screen() {
    let bench = Bench::new();
    let report = done(&bench, "doctor", &["--set", "screen.scene.friction=0.3"]);
    let differences: Vec<&str> = report
        .lines()
        .filter(|line| line.starts_with("doubtful"))
        .collect();
    let [difference] = differences[..] else {
        panic!("{report}");
    };
    for value in [
        "`screen.scene.friction` is 0.3",
        "`dispatch.simulated.scene.friction` is 0.8",
    ] {
        assert!(difference.contains(value), "{difference}");
    }
    // A mass and a drive are told alike, by their keys.
    for (set, key) in [
        ("screen.scene.object_mass_kg=0.1", "object_mass_kg"),
        (
            "dispatch.simulated.scene.drive.torque_limit=0.5",
            "drive.torque_limit",
        ),
        ("screen.scene.table_friction=0.3", "table_friction"),
        (
            "screen.scene.object_density_kg_per_m3=500.0",
            "object_density_kg_per_m3",
        ),
        ("screen.scene.mass_scale=2.0", "mass_scale"),
    ] {
        let report = done(&bench, "doctor", &["--set", set]);
        assert!(report.contains(&format!("scene.{key}` is")), "{report}");
    }
    // By a protocol that leaves them open, so are fingers that touch each other.
    let set = "screen.scene.fingers_touch=true";
    let report = done(&bench, "doctor", &["--profile", "table_lift", "--set", set]);
    assert!(report.contains("scene.fingers_touch` is"), "{report}");
    // One value for both is no difference, nor are steps of another length.
    let report = done(&bench, "doctor", &["--set", "shared.friction=0.3"]);
    assert!(!report.contains("doubtful"), "{report}");
    let ran = bench.run(&["--set", "screen.scene.friction=0.3", "--until", "ingest"]);
    assert!(
        stderr(&ran).contains("warn   `screen.scene.friction` is 0.3"),
        "{}",
        stderr(&ran)
    );
}

#[test]
fn doctor_finds_a_device_and_tips_that_training_would_lack() {
    let (report, hints) = missing(&[
        "--set",
        "train.training.tips=[\"link_3.0_tip\",\"link_99\"]",
    ]);
    assert!(report.contains("missing  train"), "{report}");
    assert!(
        report.contains("the hand has no link `link_99`"),
        "{report}"
    );
    assert!(hints.contains("`training.tips`"), "{hints}");
    if cfg!(feature = "cuda") {
        return;
    }
    let cuda = ["--set", "train.training.device=\"cuda\""];
    let (report, hints) = missing(&cuda);
    assert!(
        report.contains("built without the feature `cuda`"),
        "{report}"
    );
    assert!(hints.contains("--features cuda"), "{hints}");
    // As a run finds it, before anything is made.
    let bench = Bench::new();
    let ran = bench.command("run", &cuda).output().unwrap();
    assert_eq!(ran.status.code(), Some(1), "{}", stderr(&ran));
    assert!(!bench.lake().join("units").exists());
}

#[test]
fn a_hand_with_the_drives_of_another_is_told() {
    let folder = tempfile::TempDir::new().unwrap();
    let allegro = include_str!("../../data/robots/allegro_right.urdf");
    assert!(allegro.contains("effort=\"0.7\""));
    let path = folder.path().join("other.urdf");
    let file = include_str!("../../data/hands/allegro_right.toml");
    let file = file.replace("../robots/allegro_right.urdf", "other.urdf");
    put(&folder.path().join("other.toml"), &file);
    let hand = format!("shared.hand={}", folder.path().join("other.toml").display());
    let told = |efforts: [&str; 2]| {
        let (first, others) = allegro.split_once("effort=\"0.7\"").unwrap();
        let others = others.replace("effort=\"0.7\"", &format!("effort=\"{}\"", efforts[1]));
        put(&path, &format!("{first}effort=\"{}\"{others}", efforts[0]));
        let report = done(&Bench::new(), "doctor", &["--set", &hand]);
        let row = report
            .lines()
            .find(|row| row.starts_with("doubtful  screen"));
        row.map(str::to_owned)
    };
    let row = told(["0.95", "0.95"]).unwrap();
    assert!(
        row.contains("with at most 0.7 Nm, and its URDF says 0.95 Nm"),
        "{row}"
    );
    let row = told(["0.3", "0.95"]).unwrap();
    assert!(row.contains("0.3 to 0.95 Nm"), "{row}");
    // Its own, or nothing that is known of them.
    for efforts in [["0.7", "0.7"], ["0.7", "0.95"], ["0", "0"], ["100", "1000"]] {
        assert_eq!(told(efforts), None, "{efforts:?}");
    }
}
