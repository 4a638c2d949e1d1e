//! Recordings: MCAP files of ROS 2 messages, read and stored.

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use ::lake::recording::{Contents, read};
use dataflow::Diagnostic;
use pyo3::{
    prelude::*,
    types::{PyAny, PyBytes, PyDict},
};
use schemas::ros2::json_of;

use crate::{
    arrays::{self, Rows},
    error::{self, failed, wrong},
    object::Object,
};

/// Coordinates of the 21 landmarks of a hand.
const LANDMARKS: [usize; 2] = [21, 3];
/// Folder of a dataset that has its objects' meshes.
const MODELS: &str = "models";
/// Rates of cameras that film a hand, in images per second.
const RATES_HZ: std::ops::RangeInclusive<f64> = 1.0..=10_000.0;

/// A recording: messages of ROS 2 in an MCAP file, in the order in which they were written.
///
/// Iterating over it gives `(topic, time, message)`: the time in seconds, and the message as a dict with the fields of its
/// ROS 2 type.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Recording {
    path: PathBuf,
    contents: Arc<Contents>,
}

#[pymethods]
impl Recording {
    /// Opens a recording, and checks that it is whole.
    #[new]
    pub(crate) fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let contents = py.detach(|| read(&path));
        let contents = contents.map_err(|err| failed(&err, err.hint()))?;
        Ok(Self {
            path,
            contents: Arc::new(contents),
        })
    }

    /// The file.
    #[getter]
    fn path(&self) -> &Path {
        &self.path
    }

    /// What it is about, such as its `object` and `candidate_id`.
    #[getter]
    fn about(&self) -> BTreeMap<String, String> {
        self.contents.about.clone()
    }

    /// The number of messages of each topic.
    #[getter]
    fn topics(&self) -> BTreeMap<&str, usize> {
        let mut topics = BTreeMap::new();
        for message in &self.contents.messages {
            *topics.entry(message.topic.as_str()).or_default() += 1;
        }
        topics
    }

    /// Iterates over all messages.
    fn __iter__(&self) -> Messages {
        Messages {
            contents: Arc::clone(&self.contents),
            next: Mutex::new(0),
            topic: None,
        }
    }

    /// Iterates over the messages of a topic, such as "`/joint_states`".
    fn messages(&self, topic: String) -> PyResult<Messages> {
        let topics = self.topics();
        if !topics.contains_key(topic.as_str()) {
            let all: Vec<&str> = topics.into_keys().collect();
            return Err(wrong(
                format!("there is no topic `{topic}` in `{}`", self.path.display()),
                &format!("it has: {}", all.join(", ")),
            ));
        }
        Ok(Messages {
            topic: Some(topic),
            ..self.__iter__()
        })
    }

    fn __len__(&self) -> usize {
        self.contents.messages.len()
    }

    fn __repr__(&self) -> String {
        format!(
            "<pipeline.Recording `{}`, {} messages>",
            self.path.display(),
            self.contents.messages.len()
        )
    }
}

/// An iterator over the messages of a recording.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Messages {
    contents: Arc<Contents>,
    next: Mutex<usize>,
    topic: Option<String>,
}

#[pymethods]
impl Messages {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<(String, f64, Bound<'py, PyAny>)>> {
        let wanted = self.topic.as_deref();
        let message = {
            let mut next = self.next.lock().unwrap_or_else(PoisonError::into_inner);
            let left = self.contents.messages.iter().enumerate().skip(*next);
            let mut left =
                left.filter(|(_, message)| wanted.is_none_or(|topic| message.topic == topic));
            let Some((place, message)) = left.next() else {
                return Ok(None);
            };
            *next = place + 1;
            message
        };
        let fields = json_of(&message.message_type, &message.cdr).ok_or_else(|| {
            wrong(
                format!(
                    "`{}` holds messages of the type `{}`",
                    message.topic, message.message_type
                ),
                "read this topic with a reader of ROS 2, e.g. `mcap-ros2-support`",
            )
        })?;
        let fields = fields.map_err(|err| failed(&err, None))?.to_string();
        let fields = py.import("json")?.call_method1("loads", (fields,))?;
        Ok(Some((
            message.topic.clone(),
            message.time_ns as f64 / 1e9,
            fields,
        )))
    }
}

/// Stores a recording of a person's hand and an object in the layout `tracks`, which the stage `ingest` reads with
/// `format = "tracks"`.
///
/// `root` is the dataset's folder, `subject` and `sequence` name the recording in it. `landmarks` are `(n, 21, 3)` in
/// meters, as a `Retargeter` takes them, and `object_poses` `(n, 4, 4)` the poses of the object, both in one frame and at
/// `rate` images per second. `table` `(4, 4)` is the pose of the table in that frame, z up and z = 0 its surface; it may be
/// left out if other objects show it. `hand` is the side of the person's hand. The object's mesh is stored beside, unless it
/// is there. A recording that is there is replaced only with `overwrite`.
#[pyfunction]
#[pyo3(signature = (
    root, subject, sequence, object, landmarks, object_poses, *, rate=30.0, hand="right", table=None, overwrite=false
))]
#[expect(
    clippy::too_many_arguments,
    clippy::needless_pass_by_value,
    reason = "they are Python's, with names"
)]
pub(crate) fn save_recording(
    py: Python<'_>,
    root: PathBuf,
    subject: &str,
    sequence: &str,
    object: &Object,
    landmarks: &Bound<'_, PyAny>,
    object_poses: &Bound<'_, PyAny>,
    rate: f64,
    hand: &str,
    table: Option<&Bound<'_, PyAny>>,
    overwrite: bool,
) -> PyResult<()> {
    let shown = Rows::read("landmarks", landmarks, &LANDMARKS)?;
    let poses = Rows::read("object_poses", object_poses, &[4, 4])?;
    shown.check_as_many("landmarks", &poses, "object_poses")?;
    check_session((subject, sequence), &shown, rate, hand)?;
    let about = about(object, shown.len(), rate, hand, table)?;
    let mut numbers = Vec::with_capacity(7 * poses.len());
    for idx in 0..poses.len() {
        let pose = arrays::pose::<spatial::World, spatial::Object>("object_poses", poses.row(idx))?;
        numbers.extend(pose.to_array());
    }
    let folder = root.join(subject).join(sequence);
    fs::create_dir_all(&folder).map_err(|err| failed_at(&folder, &err))?;
    store_mesh(&root, object)?;
    let description = folder.join("track.yml");
    if description.exists() && !overwrite {
        return Err(wrong(
            format!("there is a recording `{}`", folder.display()),
            "pass another `sequence`, or `overwrite=True`",
        ));
    }
    let arrays = PyDict::new(py);
    let n = Some(shown.len());
    let all: Vec<f64> = (0..shown.len())
        .flat_map(|idx| shown.row(idx).to_vec())
        .collect();
    arrays.set_item("keypoints_m", arrays::array(py, &all, n, &LANDMARKS)?)?;
    arrays.set_item("world_from_object", arrays::array(py, &numbers, n, &[7])?)?;
    let archive = py.import("io")?.call_method0("BytesIO")?;
    py.import("numpy")?
        .call_method("savez", (&archive,), Some(&arrays))?;
    let archive = archive.call_method0("getvalue")?;
    // What makes the folder a recording is gone before its track changes, and comes last.
    if description.exists() {
        fs::remove_file(&description).map_err(|err| failed_at(&description, &err))?;
    }
    error::write(
        &folder.join("track.npz"),
        archive.cast::<PyBytes>()?.as_bytes(),
    )?;
    error::write(&description, about.as_bytes())
}

/// Checks what names a session and says of it.
fn check_session(
    (subject, sequence): (&str, &str),
    shown: &Rows,
    rate: f64,
    hand: &str,
) -> PyResult<()> {
    for (name, text) in [("subject", subject), ("sequence", sequence)] {
        let is_plain = !text.is_empty()
            && !text.starts_with('.')
            && text != MODELS
            && text
                .chars()
                .all(|c| c.is_ascii_alphanumeric() || "_-.".contains(c));
        if !is_plain {
            return Err(wrong(
                format!("`{name}` is {text:?}"),
                "pass a name of letters, digits, `_`, `-` and `.`, other than that of the folder `models`",
            ));
        }
    }
    if !["right", "left"].contains(&hand) {
        return Err(wrong(
            format!("`hand` is {hand:?}"),
            "pass \"right\" or \"left\"",
        ));
    }
    if !RATES_HZ.contains(&rate) {
        return Err(wrong(
            format!("`rate` is {rate}"),
            "pass images per second, from 1 to 10,000",
        ));
    }
    if !shown.is_batch || shown.len() < 2 {
        return Err(wrong(
            "there are fewer than two images".to_owned(),
            "pass landmarks (n, 21, 3) and poses (n, 4, 4) of two images or more",
        ));
    }
    Ok(())
}

/// Returns the description of a session, `track.yml`.
fn about(
    object: &Object,
    images: usize,
    rate: f64,
    hand: &str,
    table: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let mut about = format!(
        "object: {:?}\nhand: {hand}\nimages: {}\nrate_hz: {rate:?}\n",
        object.stored.name, images
    );
    if let Some(table) = table {
        let numbers = Rows::one("table", table, &[4, 4])?;
        arrays::pose::<spatial::World, spatial::Table>("table", &numbers)?;
        about += &format!("table: {:?}\n", &numbers[..12]);
    }
    Ok(about)
}

/// Stores an object's mesh in a dataset, unless it is there.
fn store_mesh(root: &Path, object: &Object) -> PyResult<()> {
    let folder = root.join(MODELS).join(&object.stored.name);
    fs::create_dir_all(&folder).map_err(|err| failed_at(&folder, &err))?;
    let mesh = folder.join("textured_simple.obj");
    let text = object.mesh().to_obj();
    if !mesh.exists() {
        error::write(&mesh, text.as_bytes())?;
    } else if fs::read(&mesh).is_ok_and(|there| there != text.as_bytes()) {
        return Err(wrong(
            format!(
                "`{}` is the mesh of another object of this name",
                mesh.display()
            ),
            "give the object a name of its own",
        ));
    }
    Ok(())
}

fn failed_at(path: &Path, err: &io::Error) -> PyErr {
    wrong(
        format!("`{}` cannot be written: {err}", path.display()),
        "pass a folder that can be written",
    )
}
