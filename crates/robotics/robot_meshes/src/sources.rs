//! The files of which a robot's shapes are made.

use std::{collections::BTreeMap, path::Path};

use dataflow::{Form, SourceFile};

use crate::{LoadError, load::without_meshes, place, shapes};

/// The form of a URDF of which only the robot is read.
pub const MODEL_FORM: Form = Form {
    name: "robot",
    of: robot::canonical_model,
};
/// The form of a URDF that recordings show.
pub const URDF_FORM: Form = Form {
    name: "shown robot",
    of: robot::canonical_urdf,
};

/// Returns the meshes that the robot of a URDF collides with, each once and by the name that the URDF
/// gives it: what a unit reads beside the URDF.
///
/// # Errors
///
/// Fails if the URDF cannot be read or a mesh is not there.
pub fn sources(urdf: &Path) -> Result<Vec<SourceFile>, LoadError> {
    let (_, model) = without_meshes(urdf)?;
    let mut files: BTreeMap<String, SourceFile> = BTreeMap::new();
    for link in model.links() {
        for mesh in link.meshes.iter().filter(|mesh| mesh.is_collision) {
            let path = shapes::path(&link.name, mesh, urdf)?;
            let own = name(&mesh.file);
            // Two files of one name in different folders of a machine.
            let mut tried = (1..).map(|n| {
                if n == 1 {
                    own.clone()
                } else {
                    format!("{own} ({n})")
                }
            });
            let free = |name: &String| files.get(name).is_none_or(|file| file.path == path);
            if let Some(name) = tried.find(free) {
                files.insert(name.clone(), SourceFile::new(name, path));
            }
        }
    }
    Ok(files.into_values().collect())
}

/// Returns a mesh's name without a place on a machine.
fn name(file: &str) -> String {
    let path = place::plain(file);
    if Path::new(path).is_absolute() {
        let last = Path::new(path).file_name();
        return last.map_or_else(String::new, |last| last.to_string_lossy().into_owned());
    }
    path.to_owned()
}

#[cfg(test)]
mod tests {
    use std::{fs, path::PathBuf};

    use super::*;

    #[test]
    fn every_mesh_is_listed_once_and_no_name_tells_of_a_machine() {
        let folder = tempfile::tempdir().unwrap();
        let place = |path: &str| folder.path().join(path);
        let put = |path: &str| -> PathBuf {
            fs::create_dir_all(place(path).parent().unwrap()).unwrap();
            fs::File::create(place(path)).unwrap();
            place(path)
        };
        let [palm, one, two] = ["palm.stl", "one/tip.stl", "two/tip.stl"].map(put);
        let collision = |file: &str| {
            format!("<collision><geometry><mesh filename='{file}'/></geometry></collision>")
        };
        let drawn = "<visual><geometry><mesh filename='drawn.dae'/></geometry></visual>";
        let xml = format!(
            "<robot name='r'><link name='a'>{}{}{}{}{drawn}</link></robot>",
            collision("palm.stl"),
            collision("palm.stl"),
            collision(&one.display().to_string()),
            collision(&format!("file://{}", two.display())),
        );
        let urdf = put("hand.urdf");
        #[expect(
            clippy::disallowed_methods,
            reason = "a test's file may well be half a file"
        )]
        fs::write(&urdf, xml).unwrap();
        let listed = sources(&urdf).unwrap();
        let listed: Vec<(&str, &Path)> = listed
            .iter()
            .map(|file| (file.name.as_str(), file.path.as_path()))
            .collect();
        let expected = [
            ("palm.stl", palm.as_path()),
            ("tip.stl", one.as_path()),
            ("tip.stl (2)", two.as_path()),
        ];
        assert_eq!(listed, expected);
        fs::remove_file(&two).unwrap();
        assert!(matches!(sources(&urdf), Err(LoadError::Missing { .. })));
    }
}
