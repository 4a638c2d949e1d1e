//! The topics of a recording, and which of its images are read.

use std::{collections::BTreeMap, error::Error, fs::File, io::Read, ops::ControlFlow, path::Path};

use dataflow::did_you_mean;
use lake::recording::{ScanError, ScannedMessage, scan};
use schemas::ros2::{
    CameraInfo, Cdr, CdrReader, CompressedImage, Header, Image, Message, PointCloud2, TfMessage,
};

use crate::{
    bop::MAX_VIEWS,
    camera_info,
    depth_message::{self, is_depth},
    error::Fault,
    transforms::{nanoseconds, plain},
};

/// Most topics that a message names.
const MAX_NAMED: usize = 12;
/// How what Zstandard compressed begins (RFC 8878, §3.1.1).
const ZSTD: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];

/// The topics of a recording, by their names.
pub(crate) struct Topics(BTreeMap<String, Topic>);

/// A topic.
pub(crate) struct Topic {
    pub(crate) message_type: String,
    pub(crate) content: Content,
    /// The frame of its first message, if that has images or points.
    frame: String,
    /// Of each message in the order of the file, if they have images or points.
    times: Vec<Times>,
}

/// What the messages of a topic are for.
#[derive(PartialEq)]
pub(crate) enum Content {
    /// Depth images.
    Depths,
    /// Clouds of points.
    Points,
    /// Cameras; the first one.
    Camera(Box<CameraInfo>),
    /// Transforms between frames.
    Transforms,
    /// Messages that are compressed one by one.
    Compressed,
    /// Something else, in words.
    Other(String),
}

/// When a message was recorded, and the time of what it has, in nanoseconds.
struct Times {
    recorded_ns: i64,
    stamp_ns: i64,
}

/// A chosen image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Chosen {
    /// Its number, from 0 in the order of time.
    pub(crate) number: u32,
    /// Its place among the topic's messages in the file.
    pub(crate) place: usize,
    /// Its time in nanoseconds.
    pub(crate) stamp_ns: i64,
}

impl Topics {
    /// Lists the topics of a recording.
    ///
    /// # Errors
    ///
    /// Fails if the file is no whole recording, or is empty.
    pub(crate) fn list(path: &Path) -> Result<Self, Fault> {
        let mut topics: BTreeMap<String, Topic> = BTreeMap::new();
        let read = scan(path, |message| {
            if !topics.contains_key(message.topic) {
                topics.insert(message.topic.to_owned(), Topic::of(message));
            }
            if let Some(topic) = topics.get_mut(message.topic) {
                topic.count(message);
            }
            ControlFlow::Continue(())
        });
        read.map_err(|err| unread(path, &err))?;
        if topics.is_empty() {
            let hint = "record while the camera publishes, e.g. with `ros2 bag record -s mcap -a`";
            return Err(Fault::new("has no messages", hint));
        }
        Ok(Self(topics))
    }

    /// Returns the topic whose images or points are read: the one of the option, or else the only one of depth images, or
    /// else the only one of points.
    pub(crate) fn choose(&self, option: Option<&str>) -> Result<(&str, &Topic), Fault> {
        if let Some(name) = option {
            return self.named(name);
        }
        for content in [Content::Depths, Content::Points] {
            let mut of_content = self.0.iter().filter(|(_, topic)| topic.content == content);
            match (of_content.next(), of_content.next()) {
                (Some((name, topic)), None) => return Ok((name, topic)),
                (Some((first, _)), Some(_)) => {
                    let what = match content {
                        Content::Depths => "depth images",
                        _ => "clouds",
                    };
                    let names = self.names(|topic| topic.content == content);
                    return Err(Fault::new(
                        format!("has several topics of {what}: {names}"),
                        format!("choose one, e.g. `topic = \"{first}\"`"),
                    ));
                }
                (None, _) => {}
            }
        }
        let is_compressed = |topic: &Topic| topic.content == Content::Compressed;
        let hint = if self.0.values().any(is_compressed) {
            "record anew, without `--compression-mode message`"
        } else {
            "record a topic of depth images, of `16UC1` or `32FC1`, with its `camera_info`"
        };
        let found = self.described();
        let problem = format!("has neither depth images nor clouds, but {found}");
        Err(Fault::new(problem, hint))
    }

    fn named(&self, name: &str) -> Result<(&str, &Topic), Fault> {
        let Some((name, topic)) = self.0.get_key_value(name) else {
            let near = did_you_mean(name, self.0.keys().map(String::as_str));
            let hint = near.unwrap_or_else(|| format!("it has {}", self.described()));
            return Err(Fault::new(format!("has no topic `{name}`"), hint));
        };
        match &topic.content {
            Content::Depths | Content::Points => Ok((name, topic)),
            other => Err(Fault::new(
                format!("has no depths on `{name}`, but {}", other.described()),
                match self.names(|topic| matches!(topic.content, Content::Depths | Content::Points))
                {
                    none if none.is_empty() => "record a topic of depth images".to_owned(),
                    names => format!("choose {names}"),
                },
            )),
        }
    }

    /// Returns the topic that has the cameras of a topic of images.
    pub(crate) fn camera_of(&self, images: &str) -> Result<&str, Fault> {
        let is_camera = |topic: &Topic| matches!(topic.content, Content::Camera(_));
        let beside = camera_info::topic_beside(images);
        if let Some((name, _)) = self.0.get_key_value(&beside).filter(|it| is_camera(it.1)) {
            return Ok(name);
        }
        let frame = self.0.get(images).map_or("", |topic| plain(&topic.frame));
        let is_own = |topic: &Topic| match &topic.content {
            Content::Camera(info) => plain(&info.header.frame_id) == frame && !frame.is_empty(),
            _ => false,
        };
        let mut own = self.0.iter().filter(|(_, topic)| is_own(topic));
        if let (Some((name, _)), None) = (own.next(), own.next()) {
            return Ok(name);
        }
        let other = match self.names(is_camera) {
            none if none.is_empty() => String::new(),
            names => format!(" (it has {names})"),
        };
        Err(Fault::new(
            format!("has no CameraInfo of the images on `{images}`{other}"),
            format!("record `{beside}` with them"),
        ))
    }

    /// Says whether it has transforms between frames.
    pub(crate) fn has_transforms(&self) -> bool {
        let mut topics = self.0.values();
        topics.any(|topic| topic.content == Content::Transforms)
    }

    fn names(&self, is_named: impl Fn(&Topic) -> bool) -> String {
        let named = self.0.iter().filter(|(_, topic)| is_named(topic));
        listed(named.map(|(name, _)| format!("`{name}`")))
    }

    fn described(&self) -> String {
        let described =
            |(name, topic): (&String, &Topic)| format!("`{name}` of {}", topic.content.described());
        listed(self.0.iter().map(described))
    }
}

fn listed(items: impl Iterator<Item = String>) -> String {
    let items: Vec<String> = items.collect();
    let more = match items.len().saturating_sub(MAX_NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let shown = items.get(..MAX_NAMED).unwrap_or(&items);
    format!("{}{more}", shown.join(", "))
}

impl Topic {
    fn of(message: &ScannedMessage<'_>) -> Self {
        let header = header(message.bytes);
        Self {
            message_type: message.message_type.to_owned(),
            content: Content::of(message),
            frame: header.map_or_else(String::new, |header| header.frame_id),
            times: Vec::new(),
        }
    }

    fn count(&mut self, message: &ScannedMessage<'_>) {
        if !matches!(self.content, Content::Depths | Content::Points) {
            return;
        }
        let stamp = header(message.bytes).map_or(0, |header| nanoseconds(header.stamp));
        self.times.push(Times {
            recorded_ns: message.time_ns,
            // 0 is no time that a camera says.
            stamp_ns: if stamp == 0 { message.time_ns } else { stamp },
        });
    }

    /// Returns the images of these numbers, counted from 0 in the order in which they were recorded; without numbers the
    /// first one.
    pub(crate) fn chosen(&self, numbers: &[u32]) -> Result<Vec<Chosen>, Fault> {
        let mut numbers = match numbers {
            [] => vec![0],
            numbers => numbers.to_vec(),
        };
        numbers.sort_unstable();
        numbers.dedup();
        if numbers.len() > MAX_VIEWS {
            let problem = format!(
                "has {} chosen images, at most {MAX_VIEWS} are read",
                numbers.len()
            );
            return Err(Fault::new(problem, "choose fewer `images`"));
        }
        let mut places: Vec<usize> = (0..self.times.len()).collect();
        places.sort_by_key(|&place| self.times[place].recorded_ns);
        let chosen = |number: u32| {
            let place = usize::try_from(number).ok().and_then(|idx| places.get(idx));
            let place = *place.ok_or_else(|| {
                let last = self.times.len().saturating_sub(1);
                let problem = format!("has no image {number}, which `images` has");
                Fault::new(problem, format!("its images are from 0 to {last}"))
            })?;
            Ok(Chosen {
                number,
                place,
                stamp_ns: self.times[place].stamp_ns,
            })
        };
        numbers.into_iter().map(chosen).collect()
    }
}

impl Content {
    fn of(message: &ScannedMessage<'_>) -> Self {
        let message_type = message.message_type;
        if message_type.is_empty() {
            return Self::Other("messages without a schema".to_owned());
        }
        if message.encoding != "cdr" {
            let encoding = message.encoding;
            return Self::Other(format!("{message_type} encoded as `{encoding}`, not `cdr`"));
        }
        if message.bytes.starts_with(ZSTD) {
            return Self::Compressed;
        }
        let unread = |err| Self::Other(format!("{message_type} that cannot be decoded ({err})"));
        match message_type {
            Image::TYPE | CompressedImage::TYPE => {
                match depth_message::encoding(message_type, message.bytes) {
                    Ok(encoding) if is_depth(message_type, &encoding) => Self::Depths,
                    Ok(encoding) => Self::Other(format!("images of `{encoding}`")),
                    Err(err) => unread(err),
                }
            }
            CameraInfo::TYPE => match CameraInfo::from_cdr(message.bytes) {
                Ok(info) => Self::Camera(Box::new(info)),
                Err(err) => unread(err),
            },
            PointCloud2::TYPE => Self::Points,
            TfMessage::TYPE => Self::Transforms,
            other => Self::Other(other.to_owned()),
        }
    }

    fn described(&self) -> &str {
        match self {
            Self::Depths => "depth images",
            Self::Points => "clouds",
            Self::Camera(_) => CameraInfo::TYPE,
            Self::Transforms => TfMessage::TYPE,
            Self::Compressed => "messages that are compressed one by one",
            Self::Other(other) => other,
        }
    }
}

/// Returns the header with which messages of cameras begin.
pub(crate) fn header(cdr: &[u8]) -> Option<Header> {
    Header::decode(&mut CdrReader::new(cdr).ok()?).ok()
}

/// Says why a recording cannot be read.
pub(crate) fn unread(path: &Path, err: &ScanError) -> Fault {
    let hint = match err {
        ScanError::Io(_) => "make it readable",
        ScanError::NotMcap => return other_format(path),
        ScanError::CutOff => "copy it again, or save what it has with `mcap recover`",
        ScanError::Compression(_) => "compress it anew with `mcap compress --compression zstd`",
        _ => "copy it again, or record anew",
    };
    let cause = err
        .source()
        .map_or_else(String::new, |it| format!(" ({it})"));
    Fault::new(format!("{err}{cause}"), hint)
}

/// Says what a file is that is named as a recording and is none.
fn other_format(path: &Path) -> Fault {
    let mut start = Vec::new();
    if let Ok(file) = File::open(path) {
        // What cannot be read has no known start.
        let _ = file.take(64).read_to_end(&mut start);
    }
    let convert = "convert it with `ros2 bag convert` or `rosbags-convert --dst-storage mcap`";
    let (found, hint) = match start.as_slice() {
        [b'#', b'R', b'O', b'S', b'B', b'A', b'G', ..] => ("is a recording of ROS 1", convert),
        [b'S', b'Q', b'L', b'i', b't', b'e', b' ', ..] => {
            ("is a recording in SQLite format", convert)
        }
        start if start.starts_with(ZSTD) => {
            ("is compressed as a whole", "unpack it with `zstd -d`")
        }
        start if start.starts_with(crate::file::LFS_POINTER) => {
            ("is a pointer of Git LFS", "fetch it with `git lfs pull`")
        }
        _ => (
            "is not in MCAP format",
            "record with `ros2 bag record -s mcap`",
        ),
    };
    Fault::new(found, hint)
}
