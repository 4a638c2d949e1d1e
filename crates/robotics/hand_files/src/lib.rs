//! A robot hand from its files: the one that describes it, its URDF and its meshes.

mod complete;
mod error;
mod hand_file;

use std::path::{Path, PathBuf};

use dataflow::{BoxedDiagnostic, Form, Inputs, SourceFile, Unit};
use lake::{LakeError, ReadInputs};
use posture::{Hand, HandTable};
use robot::RobotModel;
use robot_meshes::LoadError;

pub use complete::{complete, urdf_of};
pub use error::HandFileError;
pub use hand_file::HandFile;

/// The points of a hand's file are fingerprinted by their parsed content; its drives and the joints that close
/// it are options of the stages that read them.
pub const HAND_TABLE: Form = Form {
    name: "hand table",
    of: |bytes| {
        let text = std::str::from_utf8(bytes).ok()?;
        let file: HandFile = text.parse().ok()?;
        Some(file.table.to_toml().into_bytes())
    },
};

/// The files of a hand that a unit reads: `hand`, `hand_table`, unless left out, and the meshes.
#[derive(Debug, Clone)]
pub struct HandFiles {
    urdf: SourceFile,
    table: Option<SourceFile>,
    meshes: Vec<SourceFile>,
}

impl HandFiles {
    /// Finds the meshes that a URDF names.
    ///
    /// # Errors
    ///
    /// Fails if the URDF cannot be read or a mesh is missing.
    pub fn of(urdf: &Path, table: &Path) -> Result<Self, HandFileError> {
        Ok(Self {
            table: Some(SourceFile::named("hand_table", table)),
            ..Self::without_table(urdf)?
        })
    }

    /// Finds the meshes that a URDF names; no hand table is read.
    ///
    /// # Errors
    ///
    /// Fails if the URDF cannot be read or a mesh is missing.
    pub fn without_table(urdf: &Path) -> Result<Self, LoadError> {
        Ok(Self {
            urdf: SourceFile::named("hand", urdf),
            table: None,
            meshes: robot_meshes::sources(urdf)?,
        })
    }

    /// Returns the units, each with these files among its own.
    pub fn added_to_each(&self, units: Vec<Unit>) -> Vec<Unit> {
        units.into_iter().map(|unit| self.added_to(unit)).collect()
    }

    /// Returns the unit with these files among its own.
    #[must_use]
    pub fn added_to(&self, unit: Unit) -> Unit {
        let mut unit = unit.with_file_of_form(self.urdf.clone(), robot_meshes::MODEL_FORM);
        if let Some(table) = &self.table {
            unit = unit.with_file_of_form(table.clone(), HAND_TABLE);
        }
        self.meshes.iter().cloned().fold(unit, Unit::with_file)
    }
}

/// Reads the hand of a unit that has the files of [`HandFiles::of`].
///
/// # Errors
///
/// Fails as [`load`] does, or if the unit reads no such file.
pub fn hand(inputs: &Inputs) -> Result<Hand, BoxedDiagnostic> {
    Ok(load(
        &inputs.source("hand")?.path,
        &inputs.source("hand_table")?.path,
    )?)
}

/// Reads the hand's model alone, of a unit that has the files of [`HandFiles::without_table`].
///
/// # Errors
///
/// Fails if the URDF or a mesh cannot be read, or if the unit reads no such file.
pub fn model(inputs: &Inputs) -> Result<RobotModel, BoxedDiagnostic> {
    Ok(robot_meshes::load(&inputs.source("hand")?.path)?.model)
}

/// Returns the path of the hand's URDF that a unit reads.
///
/// # Errors
///
/// Fails if the unit reads no such file.
pub fn urdf(inputs: &Inputs) -> Result<PathBuf, LakeError> {
    Ok(inputs.source("hand")?.path.clone())
}

/// Reads a hand and its table, and finds every link that the table names.
///
/// # Errors
///
/// Fails if a file cannot be read or used, or the hand lacks a link that the table names.
pub fn load(urdf: &Path, table: &Path) -> Result<Hand, HandFileError> {
    let of_urdf = |source| HandFileError::Hand {
        path: urdf.to_owned(),
        source,
    };
    let model = robot_meshes::load(urdf)?.model;
    Hand::check(&model).map_err(of_urdf)?;
    Hand::new(model, &load_table(table)?).map_err(of_urdf)
}

/// Reads the points of a hand's file.
///
/// # Errors
///
/// Fails if the file cannot be read or used.
pub fn load_table(path: &Path) -> Result<HandTable, HandFileError> {
    HandFile::read(path).map(|file| file.table)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use dataflow::Diagnostic;
    use schemas::demonstrations::Side;

    use super::*;

    const URDF: &str = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../data/robots/allegro_right.urdf"
    );
    const TABLE: &str = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../../data/hands/allegro_right.toml"
    );

    #[test]
    fn a_hand_and_its_table_are_loaded_together() {
        let hand = load(Path::new(URDF), Path::new(TABLE)).unwrap();
        assert_eq!(hand.model.dof(), 16);
        assert!(!hand.points.is_empty());
    }

    #[test]
    fn a_table_of_another_hand_is_the_fault_of_the_urdf_and_a_broken_one_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.toml");
        let table = fs::read_to_string(TABLE).unwrap();
        fs::write(&path, table.replace("link_15.0_tip", "thumb")).unwrap();
        let err = load(Path::new(URDF), &path).unwrap_err();
        assert!(matches!(err, HandFileError::Hand { .. }), "{err}");
        fs::write(&path, "side = 3").unwrap();
        let err = load(Path::new(URDF), &path).unwrap_err();
        assert!(matches!(err, HandFileError::HandTable { .. }), "{err}");
        let err = load(Path::new(URDF), &folder.path().join("none.toml")).unwrap_err();
        assert!(err.to_string().contains("none.toml"), "{err}");
        assert!(err.hint().unwrap().contains("set `hand`"));
    }

    #[test]
    fn the_hands_that_come_with_the_project_can_be_used() {
        let folder = Path::new(TABLE).parent().unwrap();
        let files = fs::read_dir(folder).unwrap();
        let paths = files.map(|entry| entry.unwrap().path());
        let paths = paths.filter(|path| path.extension().is_some_and(|end| end == "toml"));
        let mut n = 0;
        for path in paths {
            let file = HandFile::read(&path).unwrap();
            let is_left = path.to_string_lossy().contains("left");
            assert_eq!(file.table.side == Side::Left, is_left, "{}", path.display());
            n += 1;
        }
        assert!(n >= 5);
    }

    #[test]
    fn a_unit_reads_the_urdf_the_table_and_the_meshes() {
        let files = HandFiles::of(Path::new(URDF), Path::new(TABLE)).unwrap();
        let unit = files.added_to(Unit::new("can"));
        let names: Vec<&str> = unit.files.iter().map(|file| file.name.as_str()).collect();
        assert_eq!(names, ["hand", "hand_table"]);
    }
}
