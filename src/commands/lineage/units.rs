//! Lineage of one partition.

use std::collections::BTreeMap;

use dataflow::{Digest, NodeName, PartitionKey, UnitName, UnitRef};
use lake::{Lake, Provenance};
use serde::Serialize;

use super::{
    Direction,
    relations::{Read, Relations},
    tree::{Group, TreeNode},
};
use crate::{outcome::CommandError, report, timestamps};

/// One partition in the lineage.
#[derive(Serialize)]
pub(super) struct Member {
    output: String,
    partition: PartitionKey,
    /// Digest of everything that it depends on; `null` if it is not among the run's units.
    fingerprint: Option<Digest>,
    /// `made`, `skipped`, `filtered`, or `collected` if its record is no longer in the lake.
    result: &'static str,
    made: Option<MadeBy>,
    reads: Vec<Read>,
    /// Digests of its input files outside the lake, by name.
    files: BTreeMap<String, Digest>,
    #[serde(skip)]
    below: Vec<Group>,
    #[serde(skip)]
    direction: Direction,
}

/// When and by what a partition was made.
#[derive(Serialize)]
struct MadeBy {
    started: String,
    seconds: f64,
    program: String,
    host: String,
    #[serde(skip)]
    minute: String,
}

impl From<Provenance> for MadeBy {
    fn from(provenance: Provenance) -> Self {
        Self {
            started: timestamps::second(provenance.started_ns),
            seconds: provenance.took_s,
            program: provenance.program,
            host: provenance.host,
            minute: timestamps::minute(provenance.started_ns),
        }
    }
}

/// Lists the partition and its ancestors or descendants, each once.
pub(super) fn family(
    lake: &Lake,
    relations: &mut Relations,
    unit: &UnitRef,
    direction: Direction,
) -> Result<Vec<Member>, CommandError> {
    let key = UnitName::new(&unit.node, &unit.partition);
    let mut positions = BTreeMap::from([(key.clone(), 0)]);
    let mut keys = vec![key];
    let mut members = Vec::new();
    while let Some(unit) = keys.get(members.len()).cloned() {
        let mut member = member(lake, relations, &unit, direction)?;
        let relatives = match direction {
            Direction::Up => upward(&member.reads),
            Direction::Down => relations.readers(&unit)?,
        };
        for (other, partitions) in relatives {
            let mut group = Group {
                name: format!("of {other}"),
                members: Vec::new(),
            };
            for partition in partitions {
                let key = UnitName::new(&other, &partition);
                let position = *positions.entry(key.clone()).or_insert_with(|| {
                    keys.push(key);
                    keys.len() - 1
                });
                group.members.push(position);
            }
            member.below.push(group);
        }
        members.push(member);
    }
    Ok(members)
}

/// The partitions that one reads, by output.
fn upward(reads: &[Read]) -> Vec<(NodeName, Vec<PartitionKey>)> {
    let reads = reads.iter();
    let reads = reads.map(|read| (read.node.clone(), read.partitions.clone()));
    reads.collect()
}

fn member(
    lake: &Lake,
    relations: &Relations,
    unit: &UnitName,
    direction: Direction,
) -> Result<Member, CommandError> {
    let mut member = Member {
        output: unit.node.to_string(),
        partition: unit.partition.clone(),
        fingerprint: relations.fingerprint(unit),
        result: "collected",
        made: None,
        reads: Vec::new(),
        files: BTreeMap::new(),
        below: Vec::new(),
        direction,
    };
    let Some(fingerprint) = &member.fingerprint else {
        return Ok(member);
    };
    if let Some((record, provenance)) = lake.record_and_provenance(fingerprint)? {
        member.result = record.outcome.word();
        member.made = Some(MadeBy::from(provenance));
        member.reads = relations.reads(&unit.node, &record.fingerprint.inputs);
        member.files = record.fingerprint.files;
    }
    Ok(member)
}

impl Member {
    /// Returns its node of the tree.
    pub(super) fn node(&self) -> TreeNode {
        let what = match &self.made {
            Some(made) => format!(
                "{} {} UTC in {} by {} on `{}`",
                self.result,
                made.minute,
                report::duration(made.seconds),
                made.program,
                made.host
            ),
            None => self.result.to_owned(),
        };
        let files = self.files.iter();
        let leaf =
            |(name, digest): (&String, &Digest)| vec![format!("file {name}"), digest.short()];
        TreeNode {
            cells: vec![
                format!("{} {}", self.output, self.partition),
                self.fingerprint.map(Digest::short).unwrap_or_default(),
                what,
            ],
            groups: self.below.clone(),
            leaves: match self.direction {
                Direction::Up => files.map(leaf).collect(),
                Direction::Down => Vec::new(),
            },
        }
    }
}
