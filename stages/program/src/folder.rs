//! The folder of a unit: the program's inputs, and the check of its outputs.

use std::{
    fs::{self, File, Permissions},
    io::{self, BufReader, Read},
    os::unix::fs::{MetadataExt, PermissionsExt},
    path::{Path, PathBuf},
    time::Instant,
};

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use dataflow::{Context, Inputs};

use crate::{
    artifacts::KnownArtifact,
    code::FILES,
    config::ProgramConfig,
    error::ProgramError,
    job::{Job, JobFiles, JobInput},
};

/// Working folder of the program, inside the unit's own folder.
const FOLDER: &str = "job";
/// The description of the job.
const JOB: &str = "job.json";
/// An empty table with the columns to fill.
const TEMPLATE: &str = "template.parquet";
/// Inputs, by input and partition.
const IN: &str = "in";
/// The program's own files.
const OWN_FILES: &str = "files";
/// Outputs of the program.
const OUT: &str = "out";
/// For temporary files.
pub(crate) const TMP: &str = "tmp";

/// A unit's folder, filled.
pub(crate) struct JobFolder {
    path: PathBuf,
    given: Vec<InputFile>,
}

/// A file that the program was given.
struct InputFile {
    path: PathBuf,
    from: PathBuf,
    /// Size, node and time of its last change of any kind.
    stamp: [i64; 4],
}

/// Violation of the folder's rules by a program.
pub(crate) struct FolderViolation {
    pub(crate) problem: String,
    pub(crate) advice: &'static str,
}

impl JobFolder {
    /// Fills the folder of a unit.
    pub(crate) fn new(
        config: &ProgramConfig,
        known: Option<&KnownArtifact>,
        schema: Option<Schema>,
        inputs: &Inputs,
        cx: &Context,
        fan_out: Option<&str>,
    ) -> Result<Self, ProgramError> {
        let path =
            std::path::absolute(cx.folder().join(FOLDER)).map_err(ProgramError::at(cx.folder()))?;
        for name in [IN, OWN_FILES, OUT, TMP] {
            let folder = path.join(name);
            fs::create_dir_all(&folder).map_err(ProgramError::at(&folder))?;
        }
        let mut folder = Self {
            path,
            given: Vec::new(),
        };
        let mut job = Job::new(config, known, cx, fan_out);
        let has_template = schema.is_some();
        if has_template {
            job.output.template = Some(TEMPLATE.to_owned());
            job.output.table = Some(format!("{OUT}/{}", lake::table::FILE));
        }
        job.files = folder.give_own_files(config, inputs)?;
        for input in inputs.names() {
            let partitions = folder.give_partitions(input, inputs)?;
            job.inputs.insert(input.to_owned(), partitions);
        }
        if let Some(schema) = schema {
            folder.write_template(with_joints(schema, inputs)?)?;
        }
        let text = job.to_json();
        let at = folder.path.join(JOB);
        lake::write_atomic(&at, text.as_bytes())?;
        let stamp = stamp(&at).map_err(ProgramError::at(&at))?;
        folder.given.push(InputFile {
            from: at.clone(),
            path: at,
            stamp,
        });
        Ok(folder)
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Copies the files of the option `files`; returns the path in the folder of each.
    fn give_own_files(
        &mut self,
        config: &ProgramConfig,
        inputs: &Inputs,
    ) -> Result<JobFiles, ProgramError> {
        let mut files = JobFiles::new();
        for name in config.files.keys() {
            let source = format!("{FILES}{name}");
            let below = format!("{source}/");
            for file in inputs.files() {
                let at = match file.name.strip_prefix(&below) {
                    Some(rest) => format!("{OWN_FILES}/{name}/{rest}"),
                    None if file.name == source => {
                        let last = file.path.file_name().unwrap_or_default().to_string_lossy();
                        format!("{OWN_FILES}/{name}/{last}")
                    }
                    None => continue,
                };
                self.give(&file.path, &at)?;
                let is_folder = file.name != source;
                let told = if is_folder {
                    format!("{OWN_FILES}/{name}")
                } else {
                    at
                };
                files.insert(name.clone(), told);
            }
        }
        Ok(files)
    }

    /// Copies the artifacts of an input, and describes its partitions.
    fn give_partitions(
        &mut self,
        input: &str,
        inputs: &Inputs,
    ) -> Result<Vec<JobInput>, ProgramError> {
        let mut partitions = Vec::new();
        for artifact in inputs.artifacts(input) {
            let mut files = JobFiles::new();
            for (name, from) in &artifact.files {
                let at = format!("{IN}/{input}/{}/{name}", artifact.key);
                self.give(from, &at)?;
                files.insert(name.clone(), at);
            }
            partitions.push(JobInput {
                partition: artifact.key.to_string(),
                labels: artifact.labels.clone(),
                files,
            });
        }
        Ok(partitions)
    }

    /// Copies a file into the folder, read-only: changes of the copy do not reach the lake.
    fn give(&mut self, from: &Path, at: &str) -> Result<(), ProgramError> {
        let path = self.path.join(at);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(ProgramError::at(folder))?;
        }
        fs::copy(from, &path).map_err(ProgramError::at(&path))?;
        let read_only = Permissions::from_mode(0o444);
        fs::set_permissions(&path, read_only).map_err(ProgramError::at(&path))?;
        let stamp = stamp(&path).map_err(ProgramError::at(&path))?;
        self.given.push(InputFile {
            path,
            from: from.to_owned(),
            stamp,
        });
        Ok(())
    }

    fn write_template(&self, schema: Schema) -> Result<(), ProgramError> {
        let tmp = self.path.join(TMP);
        lake::table::write_batch(&tmp, &RecordBatch::new_empty(schema.into()))?;
        let at = self.path.join(TEMPLATE);
        fs::rename(tmp.join(lake::table::FILE), &at).map_err(ProgramError::at(&at))
    }

    /// Returns the program's violation of the folder's rules, if there is one.
    pub(crate) fn violation(&self) -> Result<Option<FolderViolation>, ProgramError> {
        const KNOWN: [&str; 6] = [IN, OWN_FILES, OUT, TMP, JOB, TEMPLATE];
        // A link would lead to files of the user's, which are not the program's to give away.
        for name in ["", IN, OWN_FILES, OUT, TMP] {
            let folder = self.path.join(name);
            let found = fs::symlink_metadata(&folder);
            if !found.is_ok_and(|found| found.is_dir()) {
                let name = if name.is_empty() { FOLDER } else { name };
                return Ok(Some(FolderViolation {
                    problem: format!(
                        "removed the folder `{name}`, or put something else in its place"
                    ),
                    advice: "write plain files into `out` itself",
                }));
            }
        }
        for entry in fs::read_dir(&self.path).map_err(ProgramError::at(&self.path))? {
            let name = entry.map_err(ProgramError::at(&self.path))?.file_name();
            let name = name.to_string_lossy();
            if !KNOWN.contains(&name.as_ref()) {
                return Ok(Some(FolderViolation {
                    problem: format!("wrote `{name}` beside `out`"),
                    advice: "write results into `out`, and files for the moment into the folder TMPDIR",
                }));
            }
        }
        // The unit's own folder, in which the artifact is put together.
        let above = self.path.parent().unwrap_or(&self.path);
        for entry in fs::read_dir(above).map_err(ProgramError::at(above))? {
            let name = entry.map_err(ProgramError::at(above))?.file_name();
            if name != FOLDER {
                return Ok(Some(FolderViolation {
                    problem: format!("wrote `../{}`, outside its folder", name.to_string_lossy()),
                    advice: "write results into `out`, and files for the moment into the folder TMPDIR",
                }));
            }
        }
        let n_given = self
            .given
            .iter()
            .filter(|given| given.path.starts_with(self.path.join(IN)));
        let n_found = count_files(&self.path.join(IN))?;
        for given in &self.given {
            let is_same = stamp(&given.path).is_ok_and(|now| now == given.stamp)
                // A link to it, or a look at its permissions, changes its stamp and not its bytes.
                || same_bytes(&given.path, &given.from).unwrap_or(false);
            let is_job = given.path == given.from;
            let is_there = given.path.is_file();
            if !is_same || (is_job && !is_there) {
                let name = given.path.strip_prefix(&self.path).unwrap_or(&given.path);
                return Ok(Some(FolderViolation {
                    problem: format!("changed its input `{}`", name.display()),
                    advice: "inputs are for reading: write the changed data into `out`",
                }));
            }
        }
        if n_found != n_given.count() {
            return Ok(Some(FolderViolation {
                problem: "wrote into `in`".to_owned(),
                advice: "inputs are for reading: write results into `out`",
            }));
        }
        Ok(None)
    }

    /// Lists the program's outputs: the regular files in `out`, by name.
    pub(crate) fn made(
        &self,
    ) -> Result<Result<Vec<(String, PathBuf)>, FolderViolation>, ProgramError> {
        let out = self.path.join(OUT);
        let mut made = Vec::new();
        for entry in fs::read_dir(&out).map_err(ProgramError::at(&out))? {
            let entry = entry.map_err(ProgramError::at(&out))?;
            let kind = entry.file_type().map_err(ProgramError::at(&out))?;
            let Ok(name) = entry.file_name().into_string() else {
                return Ok(Err(FolderViolation {
                    problem: "wrote a file whose name is not UTF-8".to_owned(),
                    advice: "name files in ASCII",
                }));
            };
            if !kind.is_file() {
                let what = if kind.is_dir() {
                    "a folder"
                } else {
                    "a link or a device"
                };
                return Ok(Err(FolderViolation {
                    problem: format!("wrote `out/{name}`, which is {what}"),
                    advice: "write plain files into `out` itself",
                }));
            }
            made.push((name, entry.path()));
        }
        made.sort();
        Ok(Ok(made))
    }

    /// Removes the folder.
    pub(crate) fn remove(self) -> Result<(), ProgramError> {
        fs::remove_dir_all(&self.path).map_err(ProgramError::at(&self.path))
    }
}

/// Bytes that are read in no time worth speaking of.
const SOON_READ_BYTES: u64 = 1 << 30;
/// Bytes between two looks at the clock.
const PIECE_BYTES: usize = 4 << 20;

/// Says which file cannot be read until this instant, if there is one: the lake reads each once more for its digest.
pub(crate) fn unread(
    made: &[(String, PathBuf)],
    timeout_s: f64,
    until: Instant,
) -> Result<Option<FolderViolation>, ProgramError> {
    let mut sizes = Vec::with_capacity(made.len());
    for (_, path) in made {
        sizes.push(
            fs::symlink_metadata(path)
                .map_err(ProgramError::at(path))?
                .len(),
        );
    }
    if sizes
        .iter()
        .fold(0, |sum: u64, size| sum.saturating_add(*size))
        <= SOON_READ_BYTES
    {
        return Ok(None);
    }
    let mut piece = vec![0; PIECE_BYTES];
    for ((name, path), size) in made.iter().zip(sizes) {
        let mut file = File::open(path).map_err(ProgramError::at(path))?;
        while file.read(&mut piece).map_err(ProgramError::at(path))? > 0 {
            if Instant::now() >= until {
                return Ok(Some(FolderViolation {
                    problem: format!(
                        "wrote `out/{name}` of {} MB, which cannot be read in what it left of {timeout_s} s \
                         (`timeout_s`)",
                        size / 1_000_000
                    ),
                    advice: "write less, or raise `timeout_s`",
                }));
            }
        }
    }
    Ok(None)
}

/// Takes a file that the program wrote: bytes of its own, for reading and writing alone.
///
/// A file with another name elsewhere is copied, so that nobody changes it there.
pub(crate) fn take(from: &Path, to: &Path) -> io::Result<()> {
    let found = fs::symlink_metadata(from)?;
    if found.nlink() > 1 {
        fs::copy(from, to)?;
    } else {
        fs::rename(from, to)?;
    }
    let plain = (found.mode() & 0o666) | 0o600;
    fs::set_permissions(to, Permissions::from_mode(plain))
}

/// Adds the joints' names to the template's metadata, if the inputs name them and agree.
fn with_joints(schema: Schema, inputs: &Inputs) -> Result<Schema, ProgramError> {
    let mut joints: Option<String> = None;
    for artifact in inputs.names().flat_map(|input| inputs.artifacts(input)) {
        let Some(table) = artifact.files.get(lake::table::FILE) else {
            continue;
        };
        let named = lake::table::describe(table)?
            .metadata
            .remove(schemas::JOINTS);
        match (&joints, named) {
            (_, None) => {}
            (None, named) => joints = named,
            (Some(known), Some(named)) if *known == named => {}
            (Some(_), Some(_)) => return Ok(schema),
        }
    }
    let mut metadata = schema.metadata.clone();
    metadata.extend(joints.map(|joints| (schemas::JOINTS.to_owned(), joints)));
    Ok(schema.with_metadata(metadata))
}

fn stamp(path: &Path) -> std::io::Result<[i64; 4]> {
    let metadata = fs::symlink_metadata(path)?;
    Ok([
        metadata.size().cast_signed(),
        metadata.ino().cast_signed(),
        metadata.ctime(),
        metadata.ctime_nsec(),
    ])
}

fn same_bytes(one: &Path, other: &Path) -> std::io::Result<bool> {
    if one == other || !fs::symlink_metadata(one)?.is_file() {
        return Ok(false);
    }
    let (one, other) = (File::open(one)?, File::open(other)?);
    if one.metadata()?.len() != other.metadata()?.len() {
        return Ok(false);
    }
    let (mut one, mut other) = (BufReader::new(one).bytes(), BufReader::new(other).bytes());
    loop {
        match (one.next().transpose()?, other.next().transpose()?) {
            (None, None) => return Ok(true),
            (a, b) if a != b => return Ok(false),
            _ => {}
        }
    }
}

fn count_files(folder: &Path) -> Result<usize, ProgramError> {
    let mut n_files = 0;
    for entry in fs::read_dir(folder).map_err(ProgramError::at(folder))? {
        let entry = entry.map_err(ProgramError::at(folder))?;
        let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
        n_files += if is_folder {
            count_files(&entry.path())?
        } else {
            1
        };
    }
    Ok(n_files)
}
