//! Making a folder's recordings when they are missing or out of date: whole or not at all.

use std::{
    collections::BTreeSet,
    fs::{self, File},
    io,
    path::{Path, PathBuf},
};

use rayon::prelude::*;

use crate::{
    DemonstratorError, Recipe,
    body::Body,
    files::{TERMS_FILE, subject_folder, write, write_recording, write_shared},
    objects::OBJECT_KINDS,
    scene,
};

/// The recipe's file in a folder of made-up recordings.
pub const RECIPE_FILE: &str = "recipe.toml";
/// Names the recipe and code that made the recordings; written last.
const STAMP_FILE: &str = ".made";
/// Recordings in the making.
const MAKING_FOLDER: &str = ".making";
/// Held while recordings are checked and made.
const LOCK_FILE: &str = ".lock";

/// Outcome of [`ensure_sample`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleOutcome {
    /// The folder has no recipe: its recordings are not ours to make.
    NoRecipe,
    /// The recordings were made by this recipe and code before.
    Kept,
    /// The recordings were made now.
    Written {
        /// Number of recordings.
        sequences: usize,
        /// Number of frames in all of them.
        frames: usize,
    },
}

/// Makes the recordings of the folder's `recipe.toml` where they are missing or were made by another
/// recipe or other code; equal recipes give equal bytes on any number of threads.
///
/// `code` stands for the sources of this crate and of what it links: recordings of another are made again.
/// Recordings that this recipe made are left alone, edited or not. A folder without a recipe, such
/// as the real dataset, is not touched. Work in progress lies in `.making` and moves into place at
/// the end; what an interrupted call leaves is made again by the next.
///
/// # Errors
///
/// Fails if the recipe makes no sense, an object cannot be grasped, or files cannot be written.
pub fn ensure_sample(root: &Path, code: &str) -> Result<SampleOutcome, DemonstratorError> {
    let recipe_path = root.join(RECIPE_FILE);
    if !recipe_path.is_file() {
        return Ok(SampleOutcome::NoRecipe);
    }
    let text = fs::read_to_string(&recipe_path).map_err(failed("read", &recipe_path))?;
    let recipe = Recipe::from_toml(&text)?;
    let lock_path = root.join(LOCK_FILE);
    let lock = File::create(&lock_path).map_err(failed("write", &lock_path))?;
    lock.lock().map_err(failed("lock", &lock_path))?;

    let [recipe_digest, code_digest] =
        [&*text, code].map(|text| blake3::hash(text.as_bytes()).to_hex());
    let made_by = format!("recipe {recipe_digest}\ncode {code_digest}\n");
    let stamp_path = root.join(STAMP_FILE);
    let stamp = fs::read_to_string(&stamp_path).unwrap_or_default();
    if stamp.starts_with(&made_by) {
        return Ok(SampleOutcome::Kept);
    }
    let making = root.join(MAKING_FOLDER);
    remove(&making)?;
    let made = make_all(&recipe, &making)?;
    replace(root, &making, &stamp, &made_by)?;
    Ok(made)
}

/// Makes all recordings in a folder of their own.
fn make_all(recipe: &Recipe, making: &Path) -> Result<SampleOutcome, DemonstratorError> {
    let bodies: Vec<Body> = OBJECT_KINDS.par_iter().map(Body::new).collect();
    write_shared(making, &bodies, recipe.subjects)?;
    let sequences = bodies.len() * recipe.sequences_per_object;
    let frames = (0..sequences)
        .into_par_iter()
        .map(|recording| {
            let scene = scene::make(recipe, &bodies, recording)?;
            write_recording(making, &bodies, recording, &scene)?;
            Ok(scene.frames.len())
        })
        .collect::<Result<Vec<usize>, DemonstratorError>>()?;
    Ok(SampleOutcome::Written {
        sequences,
        frames: frames.iter().sum(),
    })
}

/// Moves the new recordings into place, over those of older recipes.
fn replace(
    root: &Path,
    making: &Path,
    old_stamp: &str,
    made_by: &str,
) -> Result<(), DemonstratorError> {
    let mut names = BTreeSet::new();
    for entry in fs::read_dir(making).map_err(failed("read", making))? {
        names.insert(
            entry
                .map_err(failed("read", making))?
                .file_name()
                .to_string_lossy()
                .into_owned(),
        );
    }
    // From here on the folder is ours to clear, also for a call after an interruption.
    let old = old_stamp
        .lines()
        .filter_map(|line| line.strip_prefix("entry "));
    let ours: BTreeSet<String> = old
        .filter(|name| is_ours(name))
        .map(str::to_owned)
        .chain(names.clone())
        .collect();
    let listed = |names: &BTreeSet<String>| {
        let entries: Vec<String> = names.iter().map(|name| format!("entry {name}")).collect();
        entries.join("\n") + "\n"
    };
    write_stamp(root, &format!("unfinished\n{}", listed(&ours)))?;
    for name in &ours {
        remove(&root.join(name))?;
    }
    for name in &names {
        let (from, to) = (making.join(name), root.join(name));
        fs::rename(&from, &to).map_err(failed("move", &from))?;
    }
    remove(making)?;
    write_stamp(root, &format!("{made_by}{}", listed(&names)))
}

/// Says whether a name in a stamp is one that this generator could have given.
fn is_ours(name: &str) -> bool {
    let subject = (0..10_000).any(|idx| subject_folder(idx) == name);
    subject || ["calibration", "models", TERMS_FILE].contains(&name)
}

fn write_stamp(root: &Path, text: &str) -> Result<(), DemonstratorError> {
    let beside = root.join(".made.new");
    write(&beside, text.as_bytes())?;
    fs::rename(&beside, root.join(STAMP_FILE)).map_err(failed("move", &beside))
}

/// Removes a folder or a file, if there is one.
fn remove(path: &Path) -> Result<(), DemonstratorError> {
    let removed = match fs::remove_dir_all(path) {
        Err(err) if err.kind() == io::ErrorKind::NotADirectory => fs::remove_file(path),
        removed => removed,
    };
    match removed {
        Err(err) if err.kind() != io::ErrorKind::NotFound => Err(failed("remove", path)(err)),
        _ => Ok(()),
    }
}

fn failed(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> DemonstratorError {
    let path: PathBuf = path.to_owned();
    move |source| DemonstratorError::File {
        action,
        path,
        source,
    }
}
