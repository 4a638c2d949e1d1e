//! The messages of any recording, one at a time: memory grows with the longest message, not with the file.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, BufReader, Read},
    ops::ControlFlow,
    path::Path,
};

use mcap::{
    McapError, parse_record,
    records::Record,
    sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions},
};

/// Longest message that is read: a cloud of eight million points.
const LONGEST_MESSAGE_BYTES: usize = 256 << 20;

/// A message of a recording while it is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScannedMessage<'a> {
    /// Its topic.
    pub topic: &'a str,
    /// Full name of its type, e.g. `sensor_msgs/msg/Image`; empty if the recording has no schema of it.
    pub message_type: &'a str,
    /// How its bytes encode it, e.g. `cdr`.
    pub encoding: &'a str,
    /// When it was recorded, in nanoseconds.
    pub time_ns: i64,
    /// Its bytes.
    pub bytes: &'a [u8],
}

/// Why a recording cannot be scanned.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScanError {
    /// The file cannot be read.
    #[error("cannot be read")]
    Io(#[source] io::Error),
    /// The file begins in another way than MCAP files do.
    #[error("is not in MCAP format")]
    NotMcap,
    /// The file ends inside a recording.
    #[error("ends early")]
    CutOff,
    /// A chunk is compressed in a way that is not read here.
    #[error("is compressed with `{0}`, which is not read")]
    Compression(String),
    /// The file's bytes are not the ones that were written.
    #[error("is damaged")]
    Damaged(#[source] McapError),
}

/// Reads the messages of a recording in the order of the file, until `visit` breaks off.
///
/// Checksums are compared where the recording has some, each behind the messages that it is of: what is made of them
/// counts only if the whole scan succeeds.
///
/// # Errors
///
/// Fails if the file cannot be read, is no MCAP, is cut off or damaged.
pub fn scan(
    path: &Path,
    mut visit: impl FnMut(&ScannedMessage<'_>) -> ControlFlow<()>,
) -> Result<(), ScanError> {
    let file = File::open(path).map_err(ScanError::Io)?;
    let length = file.metadata().map_err(ScanError::Io)?.len();
    let options = LinearReaderOptions::default()
        .with_validate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(LONGEST_MESSAGE_BYTES);
    let mut topics = Topics::default();
    let mut records_n = 0_usize;
    let read = records(BufReader::new(file), length, options, |opcode, data| {
        records_n += 1;
        match parse_record(opcode, data)? {
            Record::Message { header, data } => Ok(visit(&topics.message(&header, &data)?)),
            record => {
                topics.declare(record);
                Ok(ControlFlow::Continue(()))
            }
        }
    });
    read.map_err(|source| match source {
        McapError::Io(source) => ScanError::Io(source),
        McapError::BadMagic if records_n == 0 => ScanError::NotMcap,
        McapError::BadMagic | McapError::UnexpectedEof => ScanError::CutOff,
        McapError::UnsupportedCompression(name) => ScanError::Compression(name),
        source => ScanError::Damaged(source),
    })
}

/// Reads the records of `length` bytes, those of chunks too, until `visit` breaks off. No record asks for more memory than
/// there are bytes, or than the options limit it to where it is compressed.
pub(super) fn records(
    mut bytes: impl Read,
    length: u64,
    options: LinearReaderOptions,
    mut visit: impl FnMut(u8, &[u8]) -> Result<ControlFlow<()>, McapError>,
) -> Result<(), McapError> {
    let mut reader = LinearReader::new_with_options(options);
    let mut left = length;
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(n) => {
                let n = n.min(usize::try_from(left).unwrap_or(usize::MAX));
                let read = bytes.read(reader.insert(n))?;
                reader.notify_read(read);
                left = left.saturating_sub(read as u64);
            }
            LinearReadEvent::Record { opcode, data } => {
                if visit(opcode, data)?.is_break() {
                    return Ok(());
                }
            }
        }
    }
    Ok(())
}

/// The topics that a recording has declared so far.
#[derive(Default)]
struct Topics {
    /// Names of types, by the numbers of their schemas.
    types: BTreeMap<u16, String>,
    /// Topics, by the numbers of their channels.
    channels: BTreeMap<u16, mcap::records::Channel>,
}

impl Topics {
    fn declare(&mut self, record: Record<'_>) {
        if let Record::Schema { header, .. } = record {
            self.types.insert(header.id, header.name);
        } else if let Record::Channel(channel) = record {
            self.channels.insert(channel.id, channel);
        }
    }

    fn message<'a>(
        &'a self,
        header: &mcap::records::MessageHeader,
        bytes: &'a [u8],
    ) -> Result<ScannedMessage<'a>, McapError> {
        let channel = self.channels.get(&header.channel_id);
        let unknown = McapError::UnknownChannel(header.sequence, header.channel_id);
        let channel = channel.ok_or(unknown)?;
        Ok(ScannedMessage {
            topic: &channel.topic,
            message_type: self.types.get(&channel.schema_id).map_or("", |name| name),
            encoding: &channel.message_encoding,
            // Three centuries after the epoch.
            time_ns: i64::try_from(header.log_time).unwrap_or(i64::MAX),
            bytes,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use schemas::ros2::{Message, Text};

    use super::*;
    use crate::recording::Recording;

    const TEXTS_N: i64 = 300;

    fn text(n: i64) -> Text {
        let data = format!("{n} ").repeat(200);
        Text { data }
    }

    fn recorded() -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("texts.mcap");
        let mut recording = Recording::create(&path, &BTreeMap::new()).unwrap();
        for n in 0..TEXTS_N {
            recording.write("/texts", n, &text(n)).unwrap();
        }
        recording.finish().unwrap();
        fs::read(&path).unwrap()
    }

    /// Scans a file of these bytes; the times of its messages, whose contents are checked.
    fn scanned(bytes: &[u8]) -> Result<Vec<i64>, ScanError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("texts.mcap");
        fs::write(&path, bytes).unwrap();
        let mut times_ns = Vec::new();
        scan(&path, |message| {
            let names = (message.topic, message.message_type, message.encoding);
            if names == ("/texts", Text::TYPE, "cdr") {
                assert_eq!(message.bytes, text(message.time_ns).to_cdr());
                times_ns.push(message.time_ns);
            }
            ControlFlow::Continue(())
        })?;
        Ok(times_ns)
    }

    #[test]
    fn messages_are_read_in_the_order_of_the_file_until_broken_off() {
        let bytes = recorded();
        let times_ns: Vec<i64> = (0..TEXTS_N).collect();
        assert_eq!(scanned(&bytes).unwrap(), times_ns);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("texts.mcap");
        // What comes behind the break is not looked at.
        fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        let mut left = 3;
        let read = scan(&path, |_| {
            left -= 1;
            if left == 0 {
                return ControlFlow::Break(());
            }
            ControlFlow::Continue(())
        });
        assert!(read.is_ok());
        assert_eq!(left, 0);
    }

    #[test]
    fn a_file_that_is_cut_off_or_damaged_is_an_error() {
        let bytes = recorded();
        for end in [0, 7, 8, bytes.len() / 2, bytes.len() - 1] {
            let read = scanned(&bytes[..end]);
            assert!(matches!(read, Err(ScanError::CutOff)), "cut at {end}");
        }
        let text = b"nothing that was recorded";
        assert!(matches!(scanned(text), Err(ScanError::NotMcap)));
        let mut other = bytes.clone();
        let zstd = other.windows(4).position(|word| word == b"zstd").unwrap();
        other[zstd..zstd + 4].copy_from_slice(b"none");
        let read = scanned(&other);
        assert!(matches!(read, Err(ScanError::Compression(name)) if name == "none"));
        let missing = scan(Path::new("nowhere.mcap"), |_| ControlFlow::Break(()));
        assert!(matches!(missing, Err(ScanError::Io(_))));
    }
}
