//! Recordings: MCAP files of ROS 2 messages that ROS 2 tools, Foxglove and Rerun open as they are. Those of others are
//! read too, with [`scan()`].
//!
//! Equal messages give equal bytes: there is no clock, no host and no library version in the file,
//! and compression runs on one thread. Times are nanoseconds as the caller counts them; motions
//! begin at [`schemas::ros2::motion::START_NS`].

mod scan;

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::{self, BufWriter, Write},
    ops::ControlFlow,
    path::{Path, PathBuf},
};

use mcap::{
    Attachment, Compression, McapError, Summary, WriteOptions, Writer,
    read::{MessageStream, Options, attachment, metadata},
    records::{MessageHeader, Metadata},
    sans_io::LinearReaderOptions,
};
use schemas::ros2::{
    CdrError, Message,
    motion::{
        JOINT_STATES, MARKERS, ROBOT_DESCRIPTION, RecordingScene, START_NS, SceneStep, TF,
        TF_STATIC,
    },
};

pub use scan::{ScanError, ScannedMessage, scan};

use crate::{LakeError, atomic::io_error};

/// Name of the metadata record that says where the recording comes from.
const METADATA: &str = "pipeline";

/// Uncompressed size of a chunk: what a viewer loads to show one moment.
const CHUNK_BYTES: u64 = 256 * 1024;

/// Largest factor by which a part of a recording may be larger than the whole file, which is compressed, and the length
/// that any part may have.
const COMPRESSION: usize = 64;
const LONGEST_BYTES: usize = 16 << 20;

/// A recording being written.
pub struct Recording {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    channels: BTreeMap<String, Channel>,
}

/// One topic of a recording being written.
struct Channel {
    id: u16,
    message_type: &'static str,
    n_messages: u32,
}

/// Whether late subscribers get the topic's last message.
#[derive(Clone, Copy)]
enum Durability {
    Volatile,
    TransientLocal,
}

impl Recording {
    /// Starts a recording at `path`; `about` is its metadata, e.g. `object = 003_cracker_box`.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be written.
    pub fn create(path: &Path, about: &BTreeMap<String, String>) -> Result<Self, LakeError> {
        let file = File::create(path).map_err(io_error("write", path))?;
        let mut writer = WriteOptions::new()
            .profile("ros2")
            .library("pipeline")
            .compression(Some(Compression::Zstd))
            // Compressed frames of several threads depend on timing.
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES))
            .create(BufWriter::new(file))
            .map_err(|source| writing(path, source))?;
        writer
            .write_metadata(&Metadata {
                name: METADATA.to_owned(),
                metadata: about.clone(),
            })
            .map_err(|source| writing(path, source))?;
        Ok(Self {
            path: path.to_owned(),
            writer,
            channels: BTreeMap::new(),
        })
    }

    /// Writes a message; a topic holds one type.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be written.
    ///
    /// # Panics
    ///
    /// If the topic already holds messages of another type.
    pub fn write<M: Message>(
        &mut self,
        topic: &str,
        time_ns: i64,
        message: &M,
    ) -> Result<(), LakeError> {
        self.write_with(topic, time_ns, message, Durability::Volatile)
    }

    /// Writes a latched message, such as a robot's description: players send it to late
    /// subscribers.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be written.
    ///
    /// # Panics
    ///
    /// If the topic already holds messages of another type.
    pub fn write_latched<M: Message>(
        &mut self,
        topic: &str,
        time_ns: i64,
        message: &M,
    ) -> Result<(), LakeError> {
        self.write_with(topic, time_ns, message, Durability::TransientLocal)
    }

    fn write_with<M: Message>(
        &mut self,
        topic: &str,
        time_ns: i64,
        message: &M,
        durability: Durability,
    ) -> Result<(), LakeError> {
        if !self.channels.contains_key(topic) {
            let id = self
                .add_channel::<M>(topic, durability)
                .map_err(|source| writing(&self.path, source))?;
            let channel = Channel {
                id,
                message_type: M::TYPE,
                n_messages: 0,
            };
            self.channels.insert(topic.to_owned(), channel);
        }
        let Some(channel) = self.channels.get_mut(topic) else {
            unreachable!("the channel `{topic}` was added");
        };
        assert_eq!(channel.message_type, M::TYPE, "type of topic `{topic}`");
        let time = u64::try_from(time_ns)
            .map_err(|source| writing(&self.path, McapError::Io(io::Error::other(source))))?;
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.n_messages,
            log_time: time,
            publish_time: time,
        };
        channel.n_messages += 1;
        self.writer
            .write_to_known_channel(&header, &message.to_cdr())
            .map_err(|source| writing(&self.path, source))
    }

    fn add_channel<M: Message>(
        &mut self,
        topic: &str,
        durability: Durability,
    ) -> Result<u16, McapError> {
        let schema = self
            .writer
            .add_schema(M::TYPE, "ros2msg", M::definition().as_bytes())?;
        let about = BTreeMap::from([
            ("offered_qos_profiles".to_owned(), qos(durability)),
            ("topic_type_hash".to_owned(), M::HASH.to_owned()),
        ]);
        self.writer.add_channel(schema, topic, "cdr", &about)
    }

    /// Writes the static scene: the hand's description, its fixed links and the object's mesh.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be written.
    pub fn write_scene<Root>(&mut self, scene: &RecordingScene<'_, Root>) -> Result<(), LakeError> {
        self.attach("robot.urdf", "application/xml", scene.urdf.as_bytes())?;
        self.write_latched(ROBOT_DESCRIPTION, START_NS, &scene.description())?;
        self.write_latched(TF_STATIC, START_NS, &scene.fixed())?;
        self.write_latched(MARKERS, START_NS, &scene.shapes())
    }

    /// Writes one moment: joint positions and the poses of the robot's links and of the object.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be written.
    pub fn write_step<Root>(
        &mut self,
        scene: &RecordingScene<'_, Root>,
        step: &SceneStep<'_, Root>,
    ) -> Result<(), LakeError> {
        self.write(JOINT_STATES, step.time_ns(), &scene.state(step))?;
        self.write(TF, step.time_ns(), &scene.poses(step))
    }

    /// Attaches a file, e.g. a robot's URDF.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be written.
    pub fn attach(&mut self, name: &str, media_type: &str, bytes: &[u8]) -> Result<(), LakeError> {
        self.writer
            .attach(&Attachment {
                log_time: 0,
                create_time: 0,
                name: name.to_owned(),
                media_type: media_type.to_owned(),
                data: bytes.into(),
            })
            .map_err(|source| writing(&self.path, source))
    }

    /// Completes the recording: an unfinished one lacks messages, though it opens.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be written.
    pub fn finish(mut self) -> Result<(), LakeError> {
        self.writer
            .finish()
            .map_err(|source| writing(&self.path, source))?;
        self.writer
            .into_inner()
            .flush()
            .map_err(io_error("write", &self.path))
    }
}

/// Quality of service as rosbag2 records it from bag version 9 on.
fn qos(durability: Durability) -> String {
    let (depth, durability) = match durability {
        Durability::Volatile => (10, "volatile"),
        Durability::TransientLocal => (1, "transient_local"),
    };
    let forever = "    sec: 9223372036\n    nsec: 854775807\n";
    format!(
        "- history: keep_last\n  depth: {depth}\n  reliability: reliable\n  durability: {durability}\n  \
         deadline:\n{forever}  lifespan:\n{forever}  liveliness: automatic\n  \
         liveliness_lease_duration:\n{forever}  avoid_ros_namespace_conventions: false\n"
    )
}

/// The contents of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Contents {
    /// The metadata given to [`Recording::create`].
    pub about: BTreeMap<String, String>,
    /// The messages in the order in which they were written.
    pub messages: Vec<RecordedMessage>,
    /// The bytes of each attachment, by name.
    pub attachments: BTreeMap<String, Vec<u8>>,
}

impl Contents {
    /// Iterates over the messages of one topic.
    pub fn topic(&self, topic: &str) -> impl Iterator<Item = &RecordedMessage> {
        self.messages.iter().filter(move |m| m.topic == topic)
    }
}

/// A message of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordedMessage {
    /// Its topic.
    pub topic: String,
    /// Full name of its type, e.g. `sensor_msgs/msg/JointState`.
    pub message_type: String,
    /// When it was recorded, in nanoseconds.
    pub time_ns: i64,
    /// Its bytes.
    pub cdr: Vec<u8>,
}

impl RecordedMessage {
    /// Decodes the message; `None` if it is of another type.
    ///
    /// # Errors
    ///
    /// Fails if the bytes are not a message of the type.
    pub fn decode<M: Message>(&self) -> Option<Result<M, CdrError>> {
        (self.message_type == M::TYPE).then(|| M::from_cdr(&self.cdr))
    }
}

/// Reads a whole recording and checks it: checksums, end and number of messages.
///
/// # Errors
///
/// Fails if the file cannot be read, is cut off or damaged.
pub fn read(path: &Path) -> Result<Contents, LakeError> {
    let bytes = fs::read(path).map_err(io_error("read", path))?;
    parse(&bytes).map_err(|source| LakeError::Mcap {
        action: "read",
        path: path.to_owned(),
        source,
    })
}

/// Checks every checksum and every length of a recording, before memory is asked for what a damaged one says.
fn check(bytes: &[u8]) -> Result<(), McapError> {
    let longest = bytes.len().saturating_mul(COMPRESSION).max(LONGEST_BYTES);
    let options = LinearReaderOptions::default()
        .with_prevalidate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(longest);
    scan::records(bytes, bytes.len() as u64, options, |_, _| {
        Ok(ControlFlow::Continue(()))
    })
}

fn parse(bytes: &[u8]) -> Result<Contents, McapError> {
    check(bytes)?;
    let summary = Summary::read(bytes)?.ok_or(McapError::UnexpectedEof)?;
    let stream = MessageStream::new_with_options(bytes, Options::ValidateChunkCrcs.into())?;
    let messages = stream
        .map(|message| {
            let message = message?;
            let schema = message.channel.schema.as_ref();
            Ok(RecordedMessage {
                topic: message.channel.topic.clone(),
                message_type: schema.map_or_else(String::new, |schema| schema.name.clone()),
                time_ns: i64::try_from(message.log_time)
                    .map_err(|source| McapError::Io(io::Error::other(source)))?,
                cdr: message.data.into_owned(),
            })
        })
        .collect::<Result<Vec<_>, McapError>>()?;
    let n_promised = summary.stats.as_ref().map(|stats| stats.message_count);
    if n_promised != Some(messages.len() as u64) {
        return Err(McapError::UnexpectedEof);
    }
    let mut about = BTreeMap::new();
    for index in &summary.metadata_indexes {
        let record = metadata(bytes, index)?;
        if record.name == METADATA {
            about = record.metadata;
        }
    }
    let attachments = summary
        .attachment_indexes
        .iter()
        .map(|index| {
            let file = attachment(bytes, index)?;
            Ok((file.name, file.data.into_owned()))
        })
        .collect::<Result<_, McapError>>()?;
    Ok(Contents {
        about,
        messages,
        attachments,
    })
}

fn writing(path: &Path, source: McapError) -> LakeError {
    LakeError::Mcap {
        action: "write",
        path: path.to_owned(),
        source,
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use schemas::ros2::{
        JointState,
        motion::{self, stamp_ns},
    };

    use super::*;

    const N_STATES: usize = 2000;

    fn state(step: usize) -> JointState {
        let q = step as f64 * 1e-3;
        motion::joint_state(
            stamp_ns(q),
            &["a".to_owned(), "b".to_owned()],
            &[q, q.sin()],
            &[1.0, q.cos()],
        )
    }

    fn record(path: &Path) {
        let about = BTreeMap::from([("object".to_owned(), "can".to_owned())]);
        let mut recording = Recording::create(path, &about).unwrap();
        recording
            .write_latched(
                ROBOT_DESCRIPTION,
                stamp_ns(0.0),
                &motion::robot_description("<robot/>"),
            )
            .unwrap();
        for step in 0..N_STATES {
            let time_ns = stamp_ns(step as f64 * 1e-3);
            recording
                .write(JOINT_STATES, time_ns, &state(step))
                .unwrap();
        }
        recording
            .attach("robot.urdf", "application/xml", b"<robot/>")
            .unwrap();
        recording.finish().unwrap();
    }

    fn recorded() -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("motion.mcap");
        record(&path);
        (folder, path)
    }

    #[test]
    fn written_table_round_trips() {
        let (_folder, path) = recorded();
        let contents = read(&path).unwrap();
        assert_eq!(contents.about["object"], "can");
        assert_eq!(contents.attachments["robot.urdf"], b"<robot/>");
        let states: Vec<JointState> = contents
            .topic(JOINT_STATES)
            .map(|message| message.decode().unwrap().unwrap())
            .collect();
        assert_eq!(states, (0..N_STATES).map(state).collect::<Vec<_>>());
    }

    /// Lengths in a damaged file ask for no more memory than there is.
    #[test]
    fn a_flipped_byte_is_found_before_what_it_says_is_believed() {
        let (_folder, path) = recorded();
        let whole = fs::read(&path).unwrap();
        for at in (0..whole.len()).step_by(211) {
            let mut damaged = whole.clone();
            damaged[at] ^= 0x80;
            if let Ok(contents) = parse(&damaged) {
                assert_eq!(contents.messages.len(), N_STATES + 1, "byte {at}");
            }
        }
    }

    #[test]
    fn equal_messages_give_equal_bytes() {
        let (folder, path) = recorded();
        let again = folder.path().join("again.mcap");
        record(&again);
        assert_eq!(fs::read(&path).unwrap(), fs::read(&again).unwrap());
    }

    #[test]
    fn a_truncated_recording_is_an_error() {
        let (_folder, path) = recorded();
        let bytes = fs::read(&path).unwrap();
        for end in [0, 8, bytes.len() / 2, bytes.len() - 8, bytes.len() - 1] {
            assert!(
                parse(&bytes[..end]).is_err(),
                "cut at {end} of {}",
                bytes.len()
            );
        }
    }

    #[test]
    fn flipped_bytes_in_a_chunk_are_an_error() {
        let (_folder, path) = recorded();
        let mut bytes = fs::read(&path).unwrap();
        let middle: Range<usize> = bytes.len() / 3..bytes.len() / 3 + 4;
        for byte in &mut bytes[middle] {
            *byte ^= 0x55;
        }
        assert!(parse(&bytes).is_err());
    }

    #[test]
    fn a_missing_file_is_an_error_that_names_it() {
        let err = read(Path::new("nowhere.mcap")).unwrap_err();
        assert_eq!(err.to_string(), "cannot read `nowhere.mcap`");
    }
}
