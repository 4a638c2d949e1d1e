//! Why files cannot be used: all of them, or those of one image or object.

use std::{io, path::PathBuf};

use dataflow::Diagnostic;
use depth_view::ViewError;

/// The format of a recording that was compressed as a whole.
pub(crate) const COMPRESSED: &str = "compressed as a whole";

/// Why nothing can be read at the option `path`.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ViewsError {
    /// Nothing is there.
    #[error("no scene and no cloud at `{}`", path.display())]
    Nothing {
        /// The option.
        path: PathBuf,
    },
    /// What is there has no layout that is read.
    #[error("neither a scene in BOP layout, nor a cloud of points, nor a recording in MCAP format: `{}`", path.display())]
    Neither {
        /// The option.
        path: PathBuf,
        /// What is read, nearby.
        near: Option<PathBuf>,
    },
    /// A recording is in another format.
    #[error("the recording is {}, and MCAP alone is read: `{}`", form, file.display())]
    OtherRecording {
        /// What programs that convert it are given: the file, or its folder.
        recording: PathBuf,
        /// The file.
        file: PathBuf,
        /// Its format.
        form: &'static str,
    },
    /// A recording was split into several files.
    #[error("the recording has {} files, at most 1 is read: `{}`", parts.len(), folder.display())]
    SeveralRecordings {
        /// Its folder.
        folder: PathBuf,
        /// The files.
        parts: Vec<PathBuf>,
    },
    /// A file that lists the images or their objects cannot be used.
    #[error("{problem}, in `{}`", folder.display())]
    List {
        /// The scene's folder.
        folder: PathBuf,
        /// What is wrong with which file.
        problem: String,
        /// What to do.
        hint: String,
    },
    /// A folder cannot be listed.
    #[error("cannot list the folder `{}`", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// The scene has no image of a number that is asked for.
    #[error("`images` has {image}, and the scene has no such image")]
    NoImage {
        /// The number.
        image: u32,
        /// Least and greatest number that there is.
        range: [u32; 2],
    },
    /// There are more images than views of an object are kept in memory.
    #[error("{found} images are chosen, at most {most} are read as views of an object")]
    ManyImages {
        /// Number of images.
        found: usize,
        /// The greatest number.
        most: usize,
        /// Some of them, evenly spread.
        spread: Vec<u32>,
    },
    /// No mask and no entry names an object in the chosen images.
    #[error("no object in {found} images of `{}`", folder.display())]
    NoObjects {
        /// The scene's folder.
        folder: PathBuf,
        /// Number of images.
        found: usize,
    },
}

impl Diagnostic for ViewsError {
    fn hint(&self) -> Option<String> {
        Some(match self {
            Self::Nothing { path } => dataflow::missing(path),
            Self::Neither {
                near: Some(near), ..
            } => format!("set `path` to `{}`", near.display()),
            Self::Neither { .. } => {
                "set `path` to a folder with `scene_camera.json` and `depth`, or to a `.ply`, `.npy` or `.mcap`"
                    .to_owned()
            }
            Self::OtherRecording { file, form, .. } if *form == COMPRESSED => {
                format!("unpack it with `zstd -d {}`", file.display())
            }
            Self::OtherRecording { recording, .. } => format!(
                "convert it with `ros2 bag convert`, or with `rosbags-convert --src {} --dst {}_mcap --dst-storage \
                 mcap`",
                recording.display(),
                recording.with_extension("").display()
            ),
            Self::SeveralRecordings { parts, .. } => {
                let first = parts.first().map_or_else(String::new, |part| part.display().to_string());
                format!("set `path` to one of them, e.g. `{first}`")
            }
            Self::List { hint, .. } => hint.clone(),
            Self::Folder { .. } => return None,
            Self::NoImage {
                range: [least, most],
                ..
            } => format!("its images are from {least} to {most}"),
            Self::ManyImages { spread, .. } => {
                let numbers: Vec<String> = spread.iter().map(ToString::to_string).collect();
                format!("choose some, e.g. `images = [{}]`", numbers.join(", "))
            }
            Self::NoObjects { .. } => {
                "choose other `images`, or remove the empty `mask_visib`, `mask` or `scene_gt.json`"
                    .to_owned()
            }
        })
    }
}

/// Why an image, or the images of an object together, cannot be used. It ends as a text: nothing tells one reason from
/// another but a reader.
#[derive(Debug, thiserror::Error)]
#[error("{problem}")]
pub(crate) struct Fault {
    problem: String,
    /// What to do.
    pub(crate) hint: String,
}

impl Fault {
    /// Says what is wrong, and what to do.
    pub(crate) fn new(problem: impl Into<String>, hint: impl Into<String>) -> Self {
        Self {
            problem: problem.into(),
            hint: hint.into(),
        }
    }

    /// A file that has other bytes than were written.
    pub(crate) fn damaged(what: &str) -> Self {
        Self::new(
            format!("is damaged ({what})"),
            "copy it again, or write it anew",
        )
    }

    /// A file that is shorter than it says.
    pub(crate) fn cut_off() -> Self {
        Self::new("ends early", "copy it again, or write it anew")
    }

    /// A file of another kind or content.
    pub(crate) fn unsupported(found: impl std::fmt::Display, expected: &str) -> Self {
        let problem = format!("has {found}, expected {expected}");
        Self::new(problem, format!("write it as {expected}"))
    }

    /// Names the file that the problem is of.
    pub(crate) fn in_file(self, name: &str) -> Self {
        Self::new(format!("`{name}` {}", self.problem), self.hint)
    }

    /// Names the topic that the problem is of.
    pub(crate) fn on_topic(self, topic: &str) -> Self {
        Self::new(format!("on `{topic}`: {}", self.problem), self.hint)
    }

    /// Returns the reason for which an image of this number is left out.
    pub(crate) fn of_image(&self, image: u32) -> String {
        format!("image {image:06}: {}", self.reason())
    }

    /// Returns what is wrong and what to do, as the reason for which an image or object is skipped.
    pub(crate) fn reason(&self) -> String {
        format!("{}; {}", self.problem, self.hint)
    }
}

impl From<ViewError> for Fault {
    fn from(err: ViewError) -> Self {
        let hint = match err {
            ViewError::OutOfView => "choose an image that shows the whole object",
            ViewError::NoObject { .. } => "give a mask, or `table` if it is another",
            _ => "give `table`, or show more of it",
        };
        Self::new(err.to_string(), hint)
    }
}
