//! Paths of the meshes that a URDF names.

use std::path::{Path, PathBuf};

/// Returns the path of the mesh that a URDF names `file`; `None` if it does not exist.
///
/// A path is relative to the URDF's folder. `package://name/rest` is `rest` in a folder `name` in the
/// URDF's folder or one above it, or else `rest` in the URDF's folder or the one above it: a package's
/// folder may have another name. `file:` is what a URL of this machine says, or else relative to the URDF's folder.
/// Where there is no such file, `\` separates folders as on Windows, and `%20` is a blank as in URLs.
pub fn find(file: &str, urdf: &Path) -> Option<PathBuf> {
    let found = |file: &str| {
        candidates(file, urdf)
            .into_iter()
            .find(|path| path.is_file())
    };
    let slashed = file.replace('\\', "/");
    found(file)
        .or_else(|| found(&slashed))
        .or_else(|| found(&decoded(&slashed)?))
}

/// Returns advice for the name of a mesh that is on another machine.
pub(crate) fn advice(file: &str) -> Option<String> {
    let write = |problem: String| {
        let mut names = file.rsplit(['/', '\\']);
        let example = match (names.next(), names.next()) {
            (Some(last), Some(above)) => format!(", e.g. `{above}/{last}`"),
            _ => String::new(),
        };
        Some(format!(
            "{problem}: write its path relative to the URDF{example}"
        ))
    };
    if let Some(host) = other_host(file) {
        return write(format!(
            "`{host}` would be another machine, of which no file is read"
        ));
    }
    let path = in_url(file).unwrap_or(file);
    let mut letters = path.trim_start_matches(['/', '\\']).chars();
    let is_drive = letters
        .next()
        .is_some_and(|letter| letter.is_ascii_alphabetic())
        && letters.next() == Some(':')
        && letters
            .next()
            .is_none_or(|next| next == '\\' || next == '/');
    if is_drive || path.starts_with(r"\\") {
        return write("this is a path of Windows".to_owned());
    }
    let scheme = file
        .split_once("://")
        .map(|(scheme, _)| scheme.to_ascii_lowercase());
    match scheme.as_deref() {
        Some(scheme @ ("http" | "https" | "ftp")) => write(format!(
            "nothing is fetched by `{scheme}`, put the file beside the URDF"
        )),
        _ => None,
    }
}

/// Returns the name of a mesh without what only says that it is a file of this machine.
pub(crate) fn plain(file: &str) -> &str {
    in_url(file).unwrap_or(file)
}

/// The path of a `file:` URL of this machine.
fn in_url(file: &str) -> Option<&str> {
    let rest = without(file, "file:")?;
    let Some(place) = rest.strip_prefix("//") else {
        return Some(rest);
    };
    let local = without(place, "localhost").filter(|path| path.starts_with('/'));
    Some(local.unwrap_or(place))
}

/// The host of a `file:` URL of another machine.
fn other_host(file: &str) -> Option<&str> {
    let (host, _) = without(file, "file://")?.split_once('/')?;
    let is_other =
        !host.is_empty() && !host.eq_ignore_ascii_case("localhost") && !host.starts_with('.');
    is_other.then_some(host)
}

/// Removes the beginning of a URL, in capital letters or small ones.
fn without<'f>(file: &'f str, start: &str) -> Option<&'f str> {
    let (head, rest) = file.split_at_checked(start.len())?;
    head.eq_ignore_ascii_case(start).then_some(rest)
}

/// Returns a name with what stands as `%` and two digits in URLs; `None` if nothing does.
fn decoded(file: &str) -> Option<String> {
    let mut parts = file.split('%');
    let mut bytes = parts.next()?.as_bytes().to_vec();
    let mut has_any = false;
    for part in parts {
        let coded = part
            .split_at_checked(2)
            .and_then(|(digits, rest)| Some((u8::from_str_radix(digits, 16).ok()?, rest)));
        match coded {
            Some((byte, rest)) if byte != 0 => {
                bytes.push(byte);
                bytes.extend_from_slice(rest.as_bytes());
                has_any = true;
            }
            _ => {
                bytes.push(b'%');
                bytes.extend_from_slice(part.as_bytes());
            }
        }
    }
    String::from_utf8(bytes).ok().filter(|_| has_any)
}

fn candidates(file: &str, urdf: &Path) -> Vec<PathBuf> {
    let folder = urdf.parent().unwrap_or(Path::new(""));
    if let Some(path) = in_url(file) {
        return vec![folder.join(path)];
    }
    let Some(in_package) = ["package://", "model://"]
        .iter()
        .find_map(|scheme| without(file, scheme))
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
        let blank = put("work/hand_pkg/urdf/meshes/index tip\u{e4}.obj");
        let percent = put("work/hand_pkg/urdf/meshes/100%25.obj");
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
            // URLs of this machine, whatever their form.
            (&format!("file:{}", palm.display()), Some(&palm)),
            (&format!("FILE://{}", palm.display()), Some(&palm)),
            (&format!("file://localhost{}", palm.display()), Some(&palm)),
            (&format!("file://nas{}", palm.display()), None),
            ("file:meshes/finger.obj", Some(&beside)),
            ("file:../meshes/palm.stl", Some(&palm)),
            ("file://meshes/finger.obj", Some(&beside)),
            ("file:./meshes/finger.obj", Some(&beside)),
            ("Package://hand_pkg/meshes/palm.stl", Some(&palm)),
            ("meshes/index%20tip%C3%A4.obj", Some(&blank)),
            (r"meshes\index%20tip%c3%a4.obj", Some(&blank)),
            (
                "package://hand_pkg/urdf/meshes/index%20tip%C3%A4.obj",
                Some(&blank),
            ),
            ("file:meshes/index%20tip%C3%A4.obj", Some(&blank)),
            // A name with such signs of its own.
            ("meshes/100%25.obj", Some(&percent)),
            ("meshes/100%2525.obj", Some(&percent)),
            ("meshes/%zz.obj", None),
            ("meshes/%", None),
            (r"C:\hands\meshes\finger.obj", None),
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

    #[test]
    fn a_name_that_leads_to_another_machine_gets_advice() {
        for (file, part) in [
            (
                r"C:\hands\meshes\palm.stl",
                "a path of Windows: write its path relative to the URDF, e.g. `meshes/palm.stl`",
            ),
            ("c:/hands/palm.stl", "a path of Windows"),
            ("file:///C:/hands/palm.stl", "a path of Windows"),
            (r"\\nas\share\palm.stl", "a path of Windows"),
            (
                "file://nas/share/palm.stl",
                "`nas` would be another machine",
            ),
            (
                "https://lab.org/hand/palm.stl",
                "nothing is fetched by `https`",
            ),
        ] {
            let advice = advice(file).unwrap_or_else(|| panic!("{file}"));
            assert!(advice.contains(part), "{file}: {advice}");
        }
        for file in [
            "palm.stl",
            "meshes/c:palm.stl",
            "package://hand/palm.stl",
            "file:///x/palm.stl",
            "",
        ] {
            assert_eq!(advice(file), None, "{file}");
        }
    }
}
