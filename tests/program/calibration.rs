//! `pipeline calibrate` finds a camera's pose, and refuses measurements that give none.

use std::process::{Command, Output};

use nalgebra::{Matrix3, Point3, Vector3};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::program::{
    bench::{put, stderr, stdout},
    commands::pipeline,
};

const FOLDER: &str = "crates/robotics/calibration/tests/golden";

/// The program on a file of this text.
fn calibrated(text: &str, arguments: &[&str]) -> Output {
    let folder = TempDir::new().unwrap();
    put(&folder.path().join("measured.json"), text);
    Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(folder.path())
        .args(["calibrate", "measured.json"])
        .args(arguments)
        .output()
        .unwrap()
}

fn golden(name: &str) -> Value {
    let path = format!("{}/{FOLDER}/{name}.json", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let list = value.as_array().unwrap().iter();
    let list: Vec<f64> = list.map(|it| it.as_f64().unwrap()).collect();
    list.try_into().unwrap()
}

#[test]
fn poses_of_shipped_measurements_are_printed_for_people_and_programs() {
    for (name, pose, board) in [
        ("fixed", "base_from_camera", "flange_from_board"),
        ("wrist", "flange_from_camera", "base_from_board"),
        ("points", "base_from_camera", ""),
    ] {
        let file = format!("{FOLDER}/{name}.json");
        let text = pipeline(&["calibrate", &file]);
        assert_eq!(text.status.code(), Some(0), "{}", stderr(&text));
        let text = stdout(&text);
        for part in [pose, board, "12 measurements", "largest", "leave one out"] {
            assert!(text.contains(part), "{name}: no `{part}` in\n{text}");
        }
        assert!(
            text.lines().all(|line| line.chars().count() <= 80),
            "{text}"
        );

        let answer = pipeline(&["calibrate", &file, "--format", "json"]);
        assert_eq!(answer.status.code(), Some(0));
        assert_eq!(stderr(&answer), "");
        let answer: Value = serde_json::from_slice(&answer.stdout).unwrap();
        let truth: [f64; 16] = numbers(&golden("golden")[name]["scipy"]);
        let position: [f64; 3] = numbers(&answer[pose]["position_m"]);
        for (found, idx) in position.iter().zip([3, 7, 11]) {
            assert!((found - truth[idx]).abs() < 1e-6, "{name}: {answer}");
        }
        assert_eq!(answer["measurements"], 12);
        assert_eq!(answer["residual"]["each"].as_array().unwrap().len(), 12);
        assert!(answer["residual"]["rms_mm"].as_f64().unwrap() < 2.0);
        assert!(answer["leave_one_out"]["rms_mm"].as_f64().unwrap() < 3.0);
        assert_eq!(
            answer["residual"].get("rms_deg").is_some(),
            name != "points"
        );
        assert_eq!(answer.get("cam_R_w2c").is_some(), name != "wrist");
    }
}

/// Of `scene_camera.json`, whose world then is the robot's base.
#[test]
fn the_world_of_views_is_the_base() {
    let file = format!("{FOLDER}/points.json");
    let answer = pipeline(&["calibrate", &file, "--format", "json"]);
    let answer: Value = serde_json::from_slice(&answer.stdout).unwrap();
    let rotation = Matrix3::from_row_slice(&numbers::<9>(&answer["cam_R_w2c"]));
    let offset_mm = Vector3::from(numbers::<3>(&answer["cam_t_w2c"]));
    for point in golden("points")["points"].as_array().unwrap() {
        let in_base = Point3::from(numbers::<3>(&point["in_base_m"]));
        let in_camera = Vector3::from(numbers::<3>(&point["in_camera_m"]));
        let seen = rotation * in_base.coords + offset_mm * 1e-3;
        assert!((seen - in_camera).norm() < 3e-3, "{seen} {in_camera}");
    }
}

#[test]
fn measurements_that_disagree_are_printed_and_fail() {
    let mut file = golden("points");
    file["points"][4]["in_base_m"][2] = json!(0.4);
    let text = file.to_string();
    let output = calibrated(&text, &[]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stdout(&output).contains("base_from_camera"));
    let said = stderr(&output);
    for part in [
        "error: the measurements of `measured.json` disagree by",
        "mm RMS, more than 5 mm",
        "hint: measurement 5 has the largest residual",
        "--max-error-mm",
    ] {
        assert!(said.contains(part), "no `{part}` in\n{said}");
    }
    assert_eq!(
        calibrated(&text, &["--max-error-mm", "200"]).status.code(),
        Some(0)
    );
    for wrong in ["0", "-1", "NaN", "inf", "5mm"] {
        let output = calibrated(&text, &[&format!("--max-error-mm={wrong}")]);
        assert_eq!(output.status.code(), Some(2), "{wrong}");
    }
}

#[test]
fn few_measurements_are_warned_of() {
    let mut file = golden("fixed");
    file["poses"].as_array_mut().unwrap().truncate(3);
    let output = calibrated(&file.to_string(), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("warn   3 measurements are hardly checked"));
    assert!(!stdout(&output).contains("leave one out"));
    let quiet = calibrated(&file.to_string(), &["--quiet"]);
    assert_eq!(stderr(&quiet), "");
}

/// A file of measurements, changed.
fn changed(name: &str, change: impl FnOnce(&mut Value)) -> String {
    let mut file = golden(name);
    change(&mut file);
    file.to_string()
}

/// Changes every number of a field.
fn each(file: &mut Value, list: &str, path: &[&str], change: impl Fn(usize, f64) -> f64) {
    for entry in file[list].as_array_mut().unwrap() {
        let field = path.iter().fold(entry, |at, key| &mut at[*key]);
        for (idx, number) in field.as_array_mut().unwrap().iter_mut().enumerate() {
            *number = json!(change(idx, number.as_f64().unwrap()));
        }
    }
}

#[test]
fn odd_files_end_in_an_error_with_the_reason_and_a_hint() {
    let board = ["camera_from_board", "position_m"];
    for (text, parts) in [
        (
            String::new(),
            [
                "`measured.json` gives no calibration: the file does not hold measurements",
                "hint: write `{",
            ],
        ),
        (
            "{\"points\": [".to_owned(),
            ["EOF while parsing a list at line 1 column 12", "hint: "],
        ),
        (
            "x,y,z\n1,2,3\n".to_owned(),
            ["expected value at line 1 column 1", "hint: "],
        ),
        (
            "{}".to_owned(),
            [
                "the file has neither, expected `points` or `poses`",
                "hint: ",
            ],
        ),
        (
            changed("fixed", |file| file["camera"] = json!(null)),
            ["`camera` is missing", "if the camera stands still"],
        ),
        (
            changed("fixed", |file| file["unit"] = json!("mm")),
            [
                "unknown field `unit`, expected one of `camera`, `points`, `poses`",
                "hint: ",
            ],
        ),
        (
            changed("fixed", |file| {
                file["poses"][3]["base_from_flange"]["quaternion_xyzw"][0] = json!(3);
            }),
            [
                "pose 4: base_from_flange.quaternion_xyzw: quaternion",
                "w last, of length 1",
            ],
        ),
        (
            changed("fixed", |file| {
                file["poses"][3]["base_from_flange"]["position_m"] = json!([1, 2]);
            }),
            [
                "pose 4: base_from_flange.position_m: it has 2 numbers, expected 3",
                "in meters",
            ],
        ),
        (
            changed("points", |file| file["points"][0]["in_base_m"] = json!("a")),
            [
                "point 1: in_base_m: it is `\"a\"`, expected 3 numbers",
                "hint: give x, y and z",
            ],
        ),
        (
            changed("points", |file| {
                file["points"].as_array_mut().unwrap().truncate(2);
            }),
            [
                "there are 2 measurements, and at least 3 are needed",
                "hint: 4 are checked",
            ],
        ),
        (
            changed("points", |file| {
                file["points"][7] = file["points"][2].clone();
            }),
            [
                "`in_base_m` of measurements 3 and 8 is the same",
                "hint: remove one",
            ],
        ),
        (
            changed("points", |file| {
                each(file, "points", &["in_base_m"], |idx, it| {
                    if idx == 0 { it } else { 0.1 }
                });
            }),
            [
                "the points of `in_base_m` lie on a line",
                "hint: touch points",
            ],
        ),
        (
            changed("points", |file| {
                each(file, "points", &["in_camera_m"], |_, it| it * 1e3);
            }),
            [
                "`in_camera_m` is up to",
                "divide points in millimeters by 1000",
            ],
        ),
        (
            changed("points", |file| {
                each(file, "points", &["in_camera_m"], |idx, it| {
                    if idx == 1 { -it } else { it }
                });
            }),
            [
                "the points are mirrored",
                "x is right, y down and z forward",
            ],
        ),
        (
            changed("wrist", |file| {
                each(file, "poses", &board, |_, it| it * 1e3);
            }),
            [
                "`camera_from_board` is up to",
                "divide poses in millimeters by 1000",
            ],
        ),
        (
            changed("wrist", |file| {
                each(file, "poses", &board, |_, it| it * 1.25);
            }),
            ["the board seems 0.8", "hint: measure a square"],
        ),
        (
            changed("wrist", |file| file["camera"] = json!("fixed")),
            [
                "`base_from_flange` or `camera_from_board` inverted",
                "write `\"camera\": \"wrist\"`",
            ],
        ),
        (
            changed("wrist", |file| {
                for entry in file["poses"].as_array_mut().unwrap() {
                    entry["base_from_flange"]["quaternion_xyzw"]
                        .as_array_mut()
                        .unwrap()
                        .rotate_right(1);
                }
            }),
            [
                "with quaternions as wxyz of `base_from_flange`",
                "some programs write w first",
            ],
        ),
        (
            changed("wrist", |file| {
                for entry in file["poses"].as_array_mut().unwrap() {
                    entry["base_from_flange"]["quaternion_xyzw"] = json!([0, 0, 0, 1]);
                }
            }),
            [
                "the flange turns by up to 0.0° about",
                "hint: tilt the flange",
            ],
        ),
    ] {
        let output = calibrated(&text, &[]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert_eq!(stdout(&output), "", "{said}");
        for part in parts {
            assert!(said.contains(part), "no `{part}` in\n{said}");
        }
    }
}

#[test]
fn a_file_that_cannot_be_read_is_named() {
    let missing = pipeline(&[
        "calibrate",
        "crates/robotics/calibration/tests/golden/fixd.json",
    ]);
    let said = stderr(&missing);
    assert_eq!(missing.status.code(), Some(1));
    assert!(said.contains("there is no such file or folder"), "{said}");
    assert!(
        said.contains("did you mean `crates/robotics/calibration/tests/golden/fixed.json`?"),
        "{said}"
    );
    let folder = pipeline(&["calibrate", "crates"]);
    assert!(
        stderr(&folder).contains("`crates`: it is a folder"),
        "{}",
        stderr(&folder)
    );
    let large = calibrated(&" ".repeat(5 << 20), &[]);
    assert!(
        stderr(&large).contains("more than 4 MiB"),
        "{}",
        stderr(&large)
    );
}
