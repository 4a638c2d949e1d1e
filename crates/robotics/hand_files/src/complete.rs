//! Options that a stage takes from the file of its hand.

use std::path::{Path, PathBuf};

use dataflow::{Diagnostic, OptionFault, with_causes};
use toml_edit::{Array, InlineTable, Value};

use crate::{HandFile, HandFileError};

/// The option that names a hand: its file, or its URDF alone.
const HAND: &str = "hand";

/// Returns the values that the file of a stage's hand has for these options, by their last word: `hand_table`
/// (the file itself), `drive`, `flexion_joints`, `tips` and `tip_radius_m`, the mean over the tips. Its own
/// `hand` becomes the URDF. A stage whose hand is a URDF has no other.
///
/// # Errors
///
/// Fails if the hand's file cannot be used, or names no URDF.
pub fn complete(
    options: &mut InlineTable,
    of_hand: &[&'static str],
) -> Result<Vec<(&'static str, Value)>, OptionFault> {
    let mut values = Vec::new();
    let Some(path) = options.get(HAND).and_then(Value::as_str) else {
        return Ok(values);
    };
    let path = path.to_owned();
    if !is_hand_file(Path::new(&path)) {
        return Ok(values);
    }
    let (file, urdf) = read(Path::new(&path)).map_err(|err| {
        let hint = err.hint().map(|hint| format!("; {hint}"));
        OptionFault {
            key: HAND.to_owned(),
            problem: format!(
                "names a hand that cannot be used: {}{}",
                with_causes(&err),
                hint.unwrap_or_default()
            ),
        }
    })?;
    let tips = file.tips();
    for option in of_hand {
        let word = option.rsplit('.').next().unwrap_or(option);
        let value: Option<Value> = match word {
            "hand_table" => Some(path.clone().into()),
            "drive" => file.drive_table().map(Value::from),
            "flexion_joints" => {
                let joints = file.flexion_joints.as_ref();
                joints.map(|joints| joints.iter().collect::<Array>().into())
            }
            "tips" => Some(tips.iter().map(|(link, _)| *link).collect::<Array>().into()),
            "tip_radius_m" => mean(tips.iter().map(|(_, radius_m)| *radius_m)).map(Value::from),
            word => unreachable!("`{word}` is not of a hand"),
        };
        values.extend(value.map(|value| (*option, value)));
    }
    if let Some(hand) = options.get_mut(HAND) {
        *hand = urdf.to_string_lossy().into_owned().into();
    }
    Ok(values)
}

/// Returns the URDF of the hand that a path names: that of a hand's file, or the path itself.
///
/// # Errors
///
/// Fails if the hand's file cannot be used, or names no URDF.
pub fn urdf_of(path: &Path) -> Result<PathBuf, HandFileError> {
    if is_hand_file(path) {
        read(path).map(|(_, urdf)| urdf)
    } else {
        Ok(path.to_owned())
    }
}

fn is_hand_file(path: &Path) -> bool {
    path.extension().is_some_and(|end| end == "toml")
}

fn read(path: &Path) -> Result<(HandFile, PathBuf), HandFileError> {
    let file = HandFile::read(path)?;
    let urdf = file.urdf_from(path).ok_or_else(|| HandFileError::NoUrdf {
        path: path.to_owned(),
    })?;
    Ok((file, urdf))
}

/// The mean of numbers, exactly theirs if they are equal.
fn mean(mut numbers: impl Iterator<Item = f64>) -> Option<f64> {
    let first = numbers.next()?;
    let (n, above) = numbers.fold((1.0, 0.0), |(n, sum), number| {
        (n + 1.0, sum + (number - first))
    });
    Some(first + above / n)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    const OF_HAND: [&str; 5] = [
        "hand_table",
        "scene.drive",
        "scene.flexion_joints",
        "tips",
        "training.tip_radius_m",
    ];

    fn hand(text: &str) -> (tempfile::TempDir, String) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hand.toml");
        fs::write(&path, text).unwrap();
        (folder, path.to_string_lossy().into_owned())
    }

    const POINTS: &str = r#"
        side = "right"
        scale = 1.0
        points = [
            { keypoint = "thumb_tip", link = "t", weight = 1.0, tip_radius_m = 0.01 },
            { keypoint = "index_tip", link = "i", weight = 1.0, tip_radius_m = 0.02 },
            { keypoint = "wrist", link = "p", weight = 0.3 },
        ]
    "#;

    #[test]
    fn a_hand_has_the_values_that_its_file_has() {
        let (folder, path) = hand(&format!(
            "urdf = \"h.urdf\"\ndrive = {{ stiffness = 3.0 }}\nflexion_joints = [\"a\"]\n{POINTS}"
        ));
        let mut options = InlineTable::new();
        options.insert("hand", path.clone().into());
        let values = complete(&mut options, &OF_HAND).unwrap();
        let values = values.iter().map(|(key, value)| (*key, value.to_string()));
        let path_text = format!("\"{path}\"");
        let expected = [
            ("hand_table", path_text.as_str()),
            ("scene.drive", "{ stiffness = 3.0 }"),
            ("scene.flexion_joints", "[\"a\"]"),
            ("tips", "[\"i\", \"t\"]"),
            ("training.tip_radius_m", "0.015"),
        ];
        let expected = expected.map(|(key, text)| (key, text.to_owned()));
        assert_eq!(values.collect::<Vec<_>>(), expected);
        let urdf = folder.path().join("h.urdf");
        assert_eq!(options["hand"].as_str(), Some(urdf.to_str().unwrap()));
    }

    #[test]
    fn a_urdf_is_as_it_is_and_a_file_without_one_is_refused() {
        let mut options = InlineTable::new();
        options.insert("hand", "h.urdf".into());
        assert!(complete(&mut options, &OF_HAND).unwrap().is_empty());
        assert_eq!(options["hand"].as_str(), Some("h.urdf"));
        let (_folder, path) = hand(POINTS);
        options.insert("hand", path.into());
        let fault = complete(&mut options, &OF_HAND).unwrap_err();
        assert!(fault.problem.contains("names no URDF"), "{fault}");
        options.insert("hand", "none.toml".into());
        let fault = complete(&mut options, &OF_HAND).unwrap_err();
        assert!(fault.problem.contains("none.toml"), "{fault}");
    }
}
