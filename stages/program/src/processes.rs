//! The processes of a program: its process group, and those that left it.
//!
//! On Linux a process that begins a session of its own is found by its environment, in which every process
//! of a unit has the unit's folder. Elsewhere only the group is known.

use std::{collections::BTreeSet, fs, path::Path};

use rustix::process::{Pid, Signal, kill_process, kill_process_group};

/// Variable with the unit's folder in the environment of all its processes.
pub(crate) const VARIABLE: &str = "PIPELINE_UNIT";

/// The processes of one unit.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Processes {
    /// The first one, which leads the group.
    leader: i32,
    /// When that began: none of the others began before.
    since: u64,
    /// `PIPELINE_UNIT=FOLDER`.
    mark: Vec<u8>,
}

/// A process, as far as it matters here.
struct ProcessInfo {
    pid: i32,
    group: i32,
    parent: i32,
    /// When it began, in ticks since the machine did.
    began: u64,
    resident_bytes: u64,
}

impl Processes {
    /// Takes the processes of a leader that was started with this folder in its environment.
    pub(crate) fn of(leader: u32, folder: &Path) -> Option<Self> {
        let leader = i32::try_from(leader).ok()?;
        Some(Self {
            leader,
            since: info(leader).map_or(0, |found| found.began),
            mark: format!("{VARIABLE}={}", folder.display()).into_bytes(),
        })
    }

    /// Kills all of them.
    pub(crate) fn kill(&self) {
        if let Some(leader) = Pid::from_raw(self.leader) {
            // What has ended cannot be killed.
            let _ended = kill_process_group(leader, Signal::KILL);
        }
        for found in living() {
            if self.is_marked(&found)
                && let Some(pid) = Pid::from_raw(found.pid)
            {
                let _ended = kill_process(pid, Signal::KILL);
            }
        }
    }

    /// Whether one of them lives, the leader left out.
    pub(crate) fn others_live(&self) -> bool {
        living().any(|found| {
            found.pid != self.leader && (found.group == self.leader || self.is_marked(&found))
        })
    }

    /// Returns the memory that all of them hold, in bytes.
    pub(crate) fn resident_bytes(&self) -> u64 {
        let all: Vec<ProcessInfo> = living().collect();
        let mut family = BTreeSet::from([self.leader]);
        // Children that left the group, too: at most as many rounds as there are generations.
        loop {
            let before = family.len();
            let new = all
                .iter()
                .filter(|found| found.group == self.leader || family.contains(&found.parent));
            let new: Vec<i32> = new.map(|found| found.pid).collect();
            family.extend(new);
            if family.len() == before {
                break;
            }
        }
        let members = all.iter().filter(|found| family.contains(&found.pid));
        members.map(|found| found.resident_bytes).sum()
    }

    fn is_marked(&self, found: &ProcessInfo) -> bool {
        if found.began < self.since {
            // A machine of many users has thousands of them.
            return false;
        }
        let environment = fs::read(format!("/proc/{}/environ", found.pid)).unwrap_or_default();
        environment
            .split(|byte| *byte == 0)
            .any(|variable| variable == self.mark)
    }
}

/// Lists the living processes; none where there is no `/proc`.
fn living() -> impl Iterator<Item = ProcessInfo> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    entries.filter_map(|entry| info(entry.file_name().to_str()?.parse().ok()?))
}

/// Returns a process, if it lives.
fn info(pid: i32) -> Option<ProcessInfo> {
    let text = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name, in parentheses, may hold anything.
    let (_, after) = text.rsplit_once(')')?;
    let words: Vec<&str> = after.split_whitespace().collect();
    // state, parent, group, …; the 22nd word of the whole is the time, the 24th the number of resident pages.
    let number = |idx: usize| words.get(idx)?.parse().ok();
    let (state, parent, group) = (*words.first()?, number(1)?, number(2)?);
    let (began, pages): (u64, u64) = (words.get(19)?.parse().ok()?, words.get(21)?.parse().ok()?);
    let is_dead = matches!(state, "Z" | "X" | "x");
    (!is_dead).then(|| ProcessInfo {
        pid,
        group,
        parent,
        began,
        resident_bytes: pages * rustix::param::page_size() as u64,
    })
}
