//! "Did you mean": the nearest known name or existing file.

use std::{env, fs, path::Path};

/// Returns the hint for a missing file or folder: a near name in its folder, if there is one, and
/// the folder that the path is relative to.
pub fn missing(path: &Path) -> String {
    let near = near_path(path).map_or_else(String::new, |near| format!("did you mean `{near}`? "));
    if path.is_absolute() {
        return format!("{near}it is an absolute path");
    }
    let here = env::current_dir();
    let here = here.map_or_else(
        |_| "the current folder".to_owned(),
        |here| format!("`{}`", here.display()),
    );
    format!("{near}the path is taken relative to {here}")
}

/// Returns the path with its first missing component replaced by a near existing name.
fn near_path(path: &Path) -> Option<String> {
    if path.exists() {
        return None;
    }
    let mut above = path.ancestors().skip(1);
    let there = above.find(|above| above.as_os_str().is_empty() || above.is_dir())?;
    let missing = path.strip_prefix(there).ok()?;
    let word = missing.iter().next()?.to_str()?;
    let folder = if there.as_os_str().is_empty() {
        Path::new(".")
    } else {
        there
    };
    let entries = fs::read_dir(folder).ok()?.flatten();
    let mut names: Vec<String> = entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect();
    names.sort();
    let only_ending = || {
        let begins = format!("{word}.");
        names
            .iter()
            .find(|name| name.starts_with(&begins))
            .map(String::as_str)
    };
    let near = nearest(word, names.iter().map(String::as_str)).or_else(only_ending)?;
    let below: std::path::PathBuf = missing.iter().skip(1).collect();
    let path = there.join(near).join(below);
    Some(path.to_string_lossy().trim_end_matches('/').to_owned())
}

/// Returns the candidate nearest to `word`, if it is near enough to be a misspelling of it: by
/// insertions, deletions, replacements and swaps of neighbors (optimal string alignment; Boytsov,
/// *Indexing methods for approximate dictionary searching*, 2011, §2.2).
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let largest = word.chars().count().max(3) / 3;
    candidates
        .into_iter()
        .map(|candidate| (strsim::osa_distance(word, candidate), candidate))
        .filter(|&(distance, _)| distance <= largest.max(1))
        .min()
        .map(|(_, candidate)| candidate)
}

/// Returns the hint that names the candidate nearest to a misspelled word, if one is near.
pub fn did_you_mean<'a>(
    word: &str,
    candidates: impl IntoIterator<Item = &'a str>,
) -> Option<String> {
    nearest(word, candidates).map(|near| format!("did you mean `{near}`?"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_path_gets_the_near_one_that_is_there() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir_all(folder.path().join("data/robots")).unwrap();
        fs::File::create(folder.path().join("data/robots/allegro_right.urdf")).unwrap();
        for (path, near) in [
            (
                "data/robots/allegro_rigt.urdf",
                Some("data/robots/allegro_right.urdf"),
            ),
            (
                "data/robot/allegro_right.urdf",
                Some("data/robots/allegro_right.urdf"),
            ),
            ("dat/robots", Some("data/robots")),
            (
                "data/robots/allegro_right",
                Some("data/robots/allegro_right.urdf"),
            ),
            ("data/robots/shadow.urdf", None),
        ] {
            let near = near.map(|near| folder.path().join(near).to_string_lossy().into_owned());
            assert_eq!(near_path(&folder.path().join(path)), near, "{path}");
        }
        let here = env::current_dir().unwrap();
        let relative = missing(Path::new("srcc/lib.rs"));
        assert_eq!(
            relative,
            format!(
                "did you mean `src/lib.rs`? the path is taken relative to `{}`",
                here.display()
            )
        );
    }

    #[test]
    fn finds_a_misspelling() {
        let keys = ["kl_weight", "epochs", "latent_dim"];
        assert_eq!(nearest("kl_wieght", keys), Some("kl_weight"));
        assert_eq!(nearest("epoch", keys), Some("epochs"));
    }

    #[test]
    fn dissimilar_names_get_no_suggestion() {
        assert_eq!(nearest("root", ["kl_weight", "epochs"]), None);
    }
}
