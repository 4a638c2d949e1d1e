//! The file format of a pipeline's newest state.

use std::{collections::BTreeMap, path::Path, sync::Arc};

use dataflow::{Digest, FileRef, NodeName, RecordOutcome, Stamp};

use super::{Newest, NewestOf, PublishedFile, pipeline_of};
use crate::{
    LakeError, atomic,
    codec::{Reader, Writer},
    folder::Folder,
};

/// Format version, so that a program does not misread the file of another one.
const VERSION: u64 = 4;

const MADE: u64 = 0;
const SKIPPED: u64 = 1;
const FILTERED: u64 = 2;

impl Newest {
    /// Reads the file; an unusable one counts as missing.
    pub(crate) fn read(path: &Path) -> Result<Self, LakeError> {
        let bytes = atomic::read_if_there(path)?.unwrap_or_default();
        let mut newest = parse(path, &bytes).unwrap_or_default();
        let units = newest.units.values().flat_map(BTreeMap::values);
        let current = units.filter(|unit| unit.current);
        newest.current = current.map(|unit| unit.fingerprint).collect();
        Ok(newest)
    }

    /// Whether bytes are an intact state of the pipeline that the file is named after.
    pub(crate) fn is_whole(path: &Path, bytes: &[u8]) -> bool {
        parse(path, bytes).is_some()
    }

    /// Writes the file, with the stamps of its units' records and blobs.
    pub(crate) fn write(
        &self,
        folder: &Folder,
        path: &Path,
        record: impl Fn(&Digest) -> Option<Stamp>,
        blob: impl Fn(&Digest) -> Option<Stamp>,
    ) -> Result<(), LakeError> {
        let mut writer = Writer::new(VERSION);
        writer.text(&pipeline_at(path));
        writer.number(self.units.len() as u64);
        for (node, units) in &self.units {
            writer.text(node.stage.as_str());
            writer.text(node.artifact.as_str());
            let known: Vec<_> = units
                .iter()
                .filter_map(|(partition, unit)| {
                    let outcome = self.outcomes.get(&unit.fingerprint)?;
                    Some((partition, unit, outcome))
                })
                .collect();
            writer.number(known.len() as u64);
            for (partition, unit, outcome) in known {
                writer.text(partition.as_str());
                writer.digest(&unit.fingerprint);
                writer.number(u64::from(unit.current));
                write_outcome(&mut writer, outcome);
            }
            let published = self.published.get(node);
            writer.number(published.map_or(0, BTreeMap::len) as u64);
            for (path, file) in published.into_iter().flatten() {
                writer.text(path);
                writer.digest(&file.digest);
                writer.digest(&file.fingerprint);
                writer.stamp(file.stamp);
            }
        }
        let (mut records, mut blobs) = (BTreeMap::new(), BTreeMap::new());
        for unit in self.units.values().flat_map(BTreeMap::values) {
            records.extend(record(&unit.fingerprint).map(|stamp| (unit.fingerprint, stamp)));
            let outcome = self.outcomes.get(&unit.fingerprint);
            let files = outcome.and_then(|outcome| outcome.files());
            let files = files.into_iter().flat_map(BTreeMap::values);
            blobs.extend(files.filter_map(|file| Some((file.digest, blob(&file.digest)?))));
        }
        for stamps in [records, blobs] {
            writer.number(stamps.len() as u64);
            for (digest, stamp) in stamps {
                writer.digest(&digest);
                writer.stamp(stamp);
            }
        }
        writer.write(folder, path)
    }
}

/// The pipeline of a state file.
fn pipeline_at(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    pipeline_of(&name).to_owned()
}

fn parse(path: &Path, bytes: &[u8]) -> Option<Newest> {
    let mut reader = Reader::of(bytes, VERSION)?;
    if reader.text()? != pipeline_at(path) {
        return None;
    }
    let mut newest = Newest::default();
    for _ in 0..reader.number()? {
        let node = NodeName {
            stage: reader.text()?.parse().ok()?,
            artifact: reader.text()?.parse().ok()?,
        };
        let units = reader.each(|reader| {
            let partition = reader.text()?.parse().ok()?;
            let unit = NewestOf {
                fingerprint: reader.digest()?,
                current: reader.number()? == 1,
            };
            let outcome = Arc::new(outcome(reader)?);
            newest.outcomes.insert(unit.fingerprint, outcome);
            Some((partition, unit))
        })?;
        let published = reader.each(|reader| {
            let path = reader.text()?.to_owned();
            let file = PublishedFile {
                digest: reader.digest()?,
                fingerprint: reader.digest()?,
                stamp: reader.stamp()?,
            };
            Some((path, file))
        })?;
        newest.units.insert(node.clone(), units);
        newest.published.insert(node, published);
    }
    newest.records = reader.each(|reader| Some((reader.digest()?, reader.stamp()?)))?;
    newest.stamps = reader.each(|reader| Some((reader.digest()?, reader.stamp()?)))?;
    Some(newest)
}

fn write_outcome(writer: &mut Writer, outcome: &RecordOutcome) {
    match outcome {
        RecordOutcome::Made {
            files,
            labels,
            metrics,
            provisional,
        } => {
            writer.number(MADE);
            writer.number(u64::from(*provisional));
            writer.number(files.len() as u64);
            for (name, file) in files {
                writer.text(name.as_str());
                writer.digest(&file.digest);
                writer.number(file.size);
            }
            writer.number(labels.len() as u64);
            for (label, value) in labels {
                writer.text(label);
                writer.text(value);
            }
            writer.number(metrics.len() as u64);
            for (metric, value) in metrics {
                writer.text(metric);
                writer.number(value.to_bits());
            }
        }
        RecordOutcome::Skipped { reason } => {
            writer.number(SKIPPED);
            writer.text(reason);
        }
        RecordOutcome::Filtered { reason } => {
            writer.number(FILTERED);
            writer.text(reason);
        }
    }
}

fn outcome(reader: &mut Reader) -> Option<RecordOutcome> {
    match reader.number()? {
        MADE => Some(RecordOutcome::Made {
            provisional: reader.number()? != 0,
            files: reader.each(|reader| {
                let name = reader.text()?.parse().ok()?;
                let file = FileRef {
                    digest: reader.digest()?,
                    size: reader.number()?,
                };
                Some((name, file))
            })?,
            labels: reader
                .each(|reader| Some((reader.text()?.to_owned(), reader.text()?.to_owned())))?,
            metrics: reader.each(|reader| {
                Some((reader.text()?.to_owned(), f64::from_bits(reader.number()?)))
            })?,
        }),
        SKIPPED => Some(RecordOutcome::Skipped {
            reason: reader.text()?.to_owned(),
        }),
        FILTERED => Some(RecordOutcome::Filtered {
            reason: reader.text()?.to_owned(),
        }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use dataflow::UnitRef;

    use super::*;

    #[test]
    fn written_table_round_trips() {
        let folder = tempfile::tempdir().unwrap();
        let lake = Folder::new(folder.path());
        std::fs::create_dir(lake.staging()).unwrap();
        let path = lake.newest().join("own.cache");
        let digest = Digest::of_bytes(b"bytes");
        let file = FileRef { digest, size: 5 };
        let outcomes = [
            RecordOutcome::Made {
                files: BTreeMap::from([("data.bin".parse().unwrap(), file)]),
                labels: BTreeMap::from([("group".to_owned(), "a".to_owned())]),
                metrics: BTreeMap::from([("loss".to_owned(), -0.25)]),
                provisional: true,
            },
            RecordOutcome::Skipped {
                reason: "too short".to_owned(),
            },
            RecordOutcome::Filtered {
                reason: "left out".to_owned(),
            },
        ];
        let node = NodeName::parse("split.parts").unwrap();
        let units = outcomes.into_iter().enumerate().map(|(number, outcome)| {
            let unit = UnitRef {
                node: node.clone(),
                partition: format!("p{number}").parse().unwrap(),
                fingerprint: Digest::of_bytes(&[0, 1, 2][number..]),
                made_now: true,
            };
            (unit, Arc::new(outcome))
        });
        let units: Vec<_> = units.collect();
        let stamp = Stamp::from([5, 17, -1, 0, 1_700_000_000, 999_999_999]);
        let published = PublishedFile {
            digest,
            fingerprint: Digest::of_bytes(b"unit"),
            stamp,
        };
        let published =
            BTreeMap::from([("files/own/split/parts/p0/data.bin".to_owned(), published)]);
        let mut newest = Newest::default();
        newest.merge_run(&units);
        newest.set_published(&node, published.clone());
        let stamp_of = |asked: &Digest| (*asked == digest).then_some(stamp);
        let record_of = |asked: &Digest| (*asked == units[0].0.fingerprint).then_some(stamp);
        newest.write(&lake, &path, record_of, stamp_of).unwrap();

        let there = Newest::read(&path).unwrap();
        assert_eq!(there.list(), newest.list());
        for (unit, outcome) in &units {
            assert_eq!(there.outcome(&unit.fingerprint), Some(outcome));
        }
        assert_eq!(there.published.get(&node), Some(&published));
        assert_eq!(there.stamps, [(digest, stamp)]);
        assert_eq!(there.records, [(units[0].0.fingerprint, stamp)]);
        assert!(!there.is_changed());

        let other = lake.newest().join("other.cache");
        std::fs::copy(&path, &other).unwrap();
        assert!(Newest::read(&other).unwrap().list().is_empty());
    }
}
