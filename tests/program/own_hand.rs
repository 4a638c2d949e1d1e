//! A hand that is not the project's: a URDF whose links collide with meshes, and the file that
//! `doctor` proposes for it, through the whole flow.

use std::{fs, path::Path, process::Command};

use nalgebra::{Point3, Vector3};
use serde_json::Value;
use tempfile::TempDir;

use crate::program::{
    bench::{Bench, put, stderr, stdout},
    commands::pipeline,
};

/// Collision shapes of the links.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Made {
    /// STL and OBJ files, found by relative paths and by a package's name, one of them in millimeters.
    OfMeshes,
    /// Boxes of the same sizes.
    OfBoxes,
}

/// A link that is a box: its name, middle, and sides in meters.
type Part = (&'static str, [f64; 3], [f64; 3]);

const PALM: Part = ("palm", [0.0, 0.0, 0.045], [0.026, 0.084, 0.09]);
const PROXIMAL: Part = ("proximal", [0.0, 0.0, 0.021], [0.014, 0.016, 0.042]);
const DISTAL: Part = ("distal", [0.0, 0.0, 0.02], [0.013, 0.015, 0.04]);

/// Links that move by one motor each: the name of the finger, and its origin.
const FINGERS: [(&str, [f64; 3]); 4] = [
    ("index", [0.0, 0.033, 0.095]),
    ("middle", [0.0, 0.011, 0.1]),
    ("ring", [0.0, -0.011, 0.095]),
    ("little", [0.0, -0.033, 0.088]),
];

/// A right hand with six motors, as many published ones: the second joint of each finger follows the
/// first. It is written with its meshes into a folder of its own.
struct Hand {
    folder: TempDir,
    made: Made,
}

impl Hand {
    fn new(made: Made) -> Self {
        let hand = Self {
            folder: TempDir::new().unwrap(),
            made,
        };
        let package = hand.folder.path().join("six_motors");
        for folder in ["urdf", "meshes"] {
            fs::create_dir_all(package.join(folder)).unwrap();
        }
        if made == Made::OfMeshes {
            put(&package.join("meshes/palm.stl"), &stl(&PALM, 1000.0));
            put(&package.join("meshes/proximal.obj"), &obj(&PROXIMAL));
            put(&package.join("urdf/distal.obj"), &obj(&DISTAL));
        }
        put(&hand.urdf(), &hand.described());
        // With the scale of a person's hand, which it has.
        let proposed = pipeline(&["doctor", "--robot", hand.urdf().to_str().unwrap()]);
        assert_eq!(proposed.status.code(), Some(0), "{}", stderr(&proposed));
        put(&hand.file(), &stdout(&proposed));
        hand
    }

    fn urdf(&self) -> std::path::PathBuf {
        self.folder.path().join("six_motors/urdf/hand.urdf")
    }

    fn file(&self) -> std::path::PathBuf {
        self.folder.path().join("hand.toml")
    }

    /// Links and joints of a finger, from where it bends.
    fn finger(&self, name: &str, on: &str, joint: &str, most: f64) -> String {
        let [proximal, distal, tip] =
            ["proximal", "distal", "tip"].map(|part| format!("{name}_{part}"));
        let limit =
            |upper: f64| format!(r#"<limit lower="0" upper="{upper}" effort="1" velocity="3"/>"#);
        link(self.made, &proximal, &PROXIMAL)
            + &link(self.made, &distal, &DISTAL)
            + &format!(
                r#"<link name="{tip}"/>
                <joint name="{name}" type="revolute">{joint}{}<parent link="{on}"/><child link="{proximal}"/></joint>
                <joint name="{name}_follows" type="revolute"><origin xyz="0 0 0.042"/><axis xyz="0 1 0"/>{}
                  <mimic joint="{name}" multiplier="1.05"/><parent link="{proximal}"/><child link="{distal}"/></joint>
                <joint name="{tip}" type="fixed"><origin xyz="0.0065 0 0.034"/><parent link="{distal}"/><child link="{tip}"/></joint>"#,
                limit(most),
                limit(1.6)
            )
    }

    fn described(&self) -> String {
        let fingers = FINGERS.map(|(name, [x, y, z])| {
            let joint = format!(r#"<origin xyz="{x} {y} {z}"/><axis xyz="0 1 0"/>"#);
            self.finger(name, "palm", &joint, 1.5)
        });
        // The thumb goes to the side and forward, and swings in front of the palm.
        let thumb = self.finger(
            "thumb",
            "thumb_base",
            r#"<origin xyz="0 0.012 0" rpy="-0.9 0 0"/><axis xyz="0 1 0"/>"#,
            0.8,
        );
        let base = link(Made::OfBoxes, "thumb_base", &("base", [0.0; 3], [0.012; 3]));
        let palm = link(self.made, "palm", &PALM);
        format!(
            r#"<robot name="six_motors"><link name="mount"/>{palm}
            <joint name="mounted" type="fixed"><parent link="mount"/><child link="palm"/></joint>
            {}{base}{thumb}
            <joint name="thumb_swing" type="revolute"><origin xyz="0.012 0.036 0.045"/><axis xyz="0 0 -1"/>
              <limit lower="0" upper="1.5" effort="1" velocity="3"/>
              <parent link="palm"/><child link="thumb_base"/></joint></robot>"#,
            fingers.concat()
        )
    }

    /// The setting that puts this hand into every stage of a file.
    fn setting(&self) -> String {
        format!("shared.hand={}", self.file().display())
    }
}

/// A link of the shape of a part.
fn link(made: Made, name: &str, part: &Part) -> String {
    let (shape, middle, sides) = part;
    let of = |numbers: &[f64; 3]| numbers.map(|x| x.to_string()).join(" ");
    let collision = match (made, *shape) {
        (Made::OfBoxes, _) => format!(
            r#"<origin xyz="{}"/><geometry><box size="{}"/></geometry>"#,
            of(middle),
            of(sides)
        ),
        (Made::OfMeshes, "palm") => r#"<geometry><mesh
            filename="package://six_motors/meshes/palm.stl" scale="0.001 0.001 0.001"/></geometry>"#
            .to_owned(),
        (Made::OfMeshes, "proximal") => {
            r#"<geometry><mesh filename="../meshes/proximal.obj"/></geometry>"#.to_owned()
        }
        (Made::OfMeshes, _) => r#"<geometry><mesh filename="distal.obj"/></geometry>"#.to_owned(),
    };
    let mass = 800.0 * sides.iter().product::<f64>();
    let [x, y, z] = sides.map(|side| side * side * mass / 12.0);
    format!(
        r#"<link name="{name}"><inertial><origin xyz="{}"/><mass value="{mass}"/>
           <inertia ixx="{}" iyy="{}" izz="{}"/></inertial><collision>{collision}</collision></link>"#,
        of(middle),
        y + z,
        x + z,
        x + y
    )
}

/// The corners of the triangles of a box, wound outward.
fn triangles((_, middle, sides): &Part) -> Vec<[Point3<f64>; 3]> {
    let half = Vector3::from(*sides) / 2.0;
    let corner = |k: usize| {
        let sign = |axis: usize| if k >> axis & 1 == 0 { -1.0 } else { 1.0 };
        let off = Vector3::new(sign(0), sign(1), sign(2)).component_mul(&half);
        Point3::from(Vector3::from(*middle) + off)
    };
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let split = quads
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    split.map(|triangle| triangle.map(corner)).collect()
}

fn stl(part: &Part, scale: f64) -> String {
    let facets = triangles(part).into_iter().map(|corners| {
        let vertices =
            corners.map(|c| format!("vertex {} {} {}\n", c.x * scale, c.y * scale, c.z * scale));
        format!(
            "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n",
            vertices.concat()
        )
    });
    format!("solid part\n{}endsolid part\n", facets.collect::<String>())
}

fn obj(part: &Part) -> String {
    let triangles = triangles(part);
    let corners = triangles.iter().flatten();
    let vertices = corners.map(|c| format!("v {} {} {}", c.x, c.y, c.z));
    let faces = (0..triangles.len()).map(|k| 3 * k);
    let faces = faces.map(|k| format!("f {} {} {}", k + 1, k + 2, k + 3));
    vertices.chain(faces).collect::<Vec<_>>().join("\n")
}

fn run(bench: &Bench, file: &str, settings: &[String]) -> std::process::Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
    program
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["run", file, "--lake"])
        .arg(bench.lake())
        .arg("--set")
        .arg(format!("ingest.root={}", bench.root().display()));
    for value in settings {
        program.args(["--set", value]);
    }
    program.output().unwrap()
}

/// Returns the share of the demonstrations repeated by a hand that hold.
fn replayed(hand: &Hand, bench: &Bench) -> f64 {
    let ran = run(bench, "pipelines/replay.toml", &[hand.setting()]);
    assert!(matches!(ran.status.code(), Some(0 | 3)), "{}", stderr(&ran));
    rate(bench, "demonstration")
}

/// Returns the share of a generator's newest motions that hold.
fn rate(bench: &Bench, generator: &str) -> f64 {
    let sql = format!("select success from rollouts where generator = '{generator}'");
    let asked = bench.ask(&["query", &sql, "--format", "json"]);
    assert!(asked.status.success(), "{}", stderr(&asked));
    let rows: Vec<Value> = stdout(&asked)
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert!(rows.len() >= 8, "{rows:?}");
    let held = rows.iter().filter(|row| row["success"] == true).count();
    held as f64 / rows.len() as f64
}

#[test]
fn a_hand_of_meshes_holds_about_as_often_as_one_of_boxes() {
    let [meshes, boxes] = [Made::OfMeshes, Made::OfBoxes].map(|made| {
        let hand = Hand::new(made);
        replayed(&hand, &Bench::new())
    });
    println!("of meshes {meshes:.2} succeed, of boxes {boxes:.2}");
    assert!(meshes > 0.4, "{meshes} of meshes, {boxes} of boxes");
    assert!(
        (meshes - boxes).abs() < 0.26,
        "{meshes} of meshes, {boxes} of boxes"
    );
}

#[test]
fn a_file_is_all_that_a_hand_needs() {
    let hand = Hand::new(Made::OfMeshes);
    let bench = Bench::new();
    let mut settings = vec![hand.setting()];
    for value in [
        "train.network.points=64",
        "train.training.epochs=120",
        "sample.per_object=64",
        "dispatch.listen=tcp/127.0.0.1:0",
    ] {
        settings.push(value.to_owned());
    }
    let ran = run(&bench, "pipelines/cgf.toml", &settings);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let held = rate(&bench, "refine");
    println!("{held:.2} of the sampled motions succeed");
    assert!(held > 0.05, "{held}");
    assert!(stdout(&ran).is_empty());

    // A mesh is an input: its change makes again what it decides, and nothing before it.
    let planned = |settings: &[String]| {
        let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        program
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args(["plan", "pipelines/cgf.toml", "--lake"])
            .arg(bench.lake())
            .arg("--set")
            .arg(format!("ingest.root={}", bench.root().display()));
        for value in settings {
            program.args(["--set", value]);
        }
        let output = program.output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        stdout(&output)
    };
    let before = planned(&settings);
    assert!(!before.contains("run "), "{before}");
    let thicker: Part = ("distal", DISTAL.1, [0.015, 0.015, 0.04]);
    let changed = hand.folder.path().join("six_motors/urdf/distal.obj");
    put(&changed, &obj(&thicker));
    let after = planned(&settings);
    let line = |output: &str| after.lines().find(|line| line.contains(output));
    let retargeted = line("retarget.trajectories").unwrap();
    assert!(
        retargeted.starts_with("run ") && retargeted.contains("file `distal.obj` changed"),
        "{after}"
    );
    for output in ["ingest.objects", "retarget.distance_fields"] {
        assert!(line(output).unwrap().starts_with("cached "), "{after}");
    }

    // One that is gone is an error that names it, never a hand that touches nothing.
    fs::remove_file(changed).unwrap();
    let gone = run(&bench, "pipelines/cgf.toml", &settings);
    assert_eq!(gone.status.code(), Some(1), "{}", stderr(&gone));
    let said = stderr(&gone);
    assert!(
        said.contains("collides with the mesh `distal.obj`, which is not there"),
        "{said}"
    );
    assert!(said.contains("hint: put it where the URDF says"), "{said}");
    check_doctor(&hand.urdf());
}

fn check_doctor(urdf: &Path) {
    let output = pipeline(&["doctor", "--robot", urdf.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    let report = stderr(&output);
    let line = report.lines().find(|line| line.starts_with("missing "));
    assert!(
        line.is_some_and(|line| line.contains("`distal.obj`, which is not there")),
        "{report}"
    );
    assert!(report.contains("cannot be used: 5 missing"), "{report}");
    // A proposal can be had nevertheless.
    assert!(stdout(&output).contains("keypoint = \"index_tip\""));
}
