//! Paths of the meshes that a URDF names.

use std::path::{Path, PathBuf};

/// Returns the path of the mesh that a URDF names `file`; `None` if it does not exist.
///
/// A path is relative to the URDF's folder. `package://name/rest` is `rest` in a folder `name` in the
/// URDF's folder or one above it, or else `rest` in the URDF's folder or the one above it: a package's
/// folder may have another name. Where there is no such file, `\` separates folders as on Windows.
pub fn find(file: &str, urdf: &Path) -> Option<PathBuf> {
    let found = |file: &str| {
        candidates(file, urdf)
            .into_iter()
            .find(|path| path.is_file())
    };
    found(file).or_else(|| found(&file.replace('\\', "/")))
}

fn candidates(file: &str, urdf: &Path) -> Vec<PathBuf> {
    let folder = urdf.parent().unwrap_or(Path::new(""));
    if let Some(path) = file.strip_prefix("file://") {
        return vec![folder.join(path)];
    }
    let Some(in_package) = ["package://", "model://"]
        .iter()
        .find_map(|scheme| file.strip_prefix(scheme))
    else {
        return vec![folder.join(file)];
    };
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    let named = absolute.ancestors().map(|above| above.join(in_package));
    let below = in_package.split_once('/').map(|(_, below)| below);
    let near = absolute.ancestors().take(2);
    let unnamed = below.map(|below| near.map(move |above| above.join(below)));
    named.chain(unnamed.into_iter().flatten()).collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn meshes_are_found_however_a_urdf_names_them() {
        let folder = tempfile::tempdir().unwrap();
        let put = |path: &str| {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::File::create(&path).unwrap();
            path
        };
        let urdf = put("work/hand_pkg/urdf/hand.urdf");
        let palm = put("work/hand_pkg/meshes/palm.stl");
        let beside = put("work/hand_pkg/urdf/meshes/finger.obj");
        let other = put("work/arm_pkg/meshes/palm.stl");
        for (file, expected) in [
            ("package://hand_pkg/meshes/palm.stl", Some(&palm)),
            ("model://hand_pkg/meshes/palm.stl", Some(&palm)),
            ("package://arm_pkg/meshes/palm.stl", Some(&other)),
            // The folder has another name than the package.
            ("package://renamed/meshes/palm.stl", Some(&palm)),
            ("package://renamed/meshes/finger.obj", Some(&beside)),
            ("meshes/finger.obj", Some(&beside)),
            ("./meshes/finger.obj", Some(&beside)),
            (r"meshes\finger.obj", Some(&beside)),
            (r".\meshes\finger.obj", Some(&beside)),
            (r"package://hand_pkg\meshes\palm.stl", Some(&palm)),
            (r"meshes\palm.stl", None),
            (&palm.display().to_string(), Some(&palm)),
            (&format!("file://{}", palm.display()), Some(&palm)),
            ("meshes/palm.stl", None),
            ("package://hand_pkg/meshes/none.stl", None),
            ("package://hand_pkg", None),
            ("package://", None),
            // A folder is not a mesh.
            ("meshes", None),
            ("", None),
        ] {
            let same = |path: &Path| path.canonicalize().unwrap();
            let found = find(file, &urdf).as_deref().map(same);
            assert_eq!(found, expected.map(|path| same(path)), "{file}");
        }
        let above = find("../meshes/palm.stl", &urdf).unwrap();
        assert_eq!(above.canonicalize().unwrap(), palm.canonicalize().unwrap());
    }
}
