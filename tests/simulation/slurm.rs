//! A scheduler with two nodes, which is asked by the commands of Slurm and runs workers.

use std::{
    collections::BTreeMap,
    io,
    path::PathBuf,
    sync::{Arc, Mutex, OnceLock, atomic::AtomicBool},
    time::Duration,
};

use clock::{Process, World, lock};
use dataflow::{Event, WorkItemRunner};
use depot::Depot;
use lake::Lake;

use super::{Old, below, chance, depot::OfflineAfterOne, seen::Seen, stages};
use crate::{commands::worker::Worker, outages};

/// Nodes, and jobs that one of them runs at once.
const N_NODES: u64 = 2;
const AT_ONCE: usize = 2;

/// Time for which a worker tries to send.
const DAY: Duration = Duration::from_hours(24);

/// Longest time of an answer and in the queue, in milliseconds.
const ANSWER_MS: u64 = 800;
const QUEUE_MS: u64 = 8_000;

/// A scheduler.
pub(super) struct Slurm {
    pub(super) seen: Arc<Seen>,
    pub(super) depot: Arc<dyn Depot>,
    /// Where workers have their lakes.
    pub(super) folder: PathBuf,
    pub(super) old: Old,
    /// Until when it fails now and then, and kills jobs.
    pub(super) faults_end: Duration,
    pub(super) jobs: Mutex<BTreeMap<(String, usize), Job>>,
    pub(super) lakes: Mutex<Vec<PathBuf>>,
}

/// A job of an array.
pub(super) enum Job {
    Waiting {
        from: Duration,
    },
    Running {
        node: u64,
        process: Process,
        outcome: Arc<OnceLock<bool>>,
    },
    Over {
        node: u64,
        state: &'static str,
    },
}

impl Slurm {
    fn has_faults(&self) -> bool {
        self.seen.time() < self.faults_end
    }

    /// Answers a command.
    pub(super) fn ask(&self, words: &[String], _script: &str) -> io::Result<String> {
        clock::sleep(Duration::from_millis(below(ANSWER_MS)));
        let value = |flag: &str| words.iter().find_map(|word| word.strip_prefix(flag));
        let name = value("--name=")
            .or(value("--job-name="))
            .unwrap_or_default();
        let is_lost = self.has_faults() && chance(8);
        if is_lost && chance(50) {
            return Err(io::Error::other("the controller does not answer"));
        }
        let said = match words[0].as_str() {
            "sbatch" => {
                let last: usize = value("--array=0-").unwrap().parse().unwrap();
                for idx in 0..=last {
                    let from = self.seen.time() + Duration::from_millis(below(QUEUE_MS));
                    let job = Job::Waiting { from };
                    lock(&self.jobs).insert((name.to_owned(), idx), job);
                }
                self.seen.log(&format!("sbatch {name} {}", last + 1));
                "17\n".to_owned()
            }
            "squeue" => self.queue(&name.split(',').collect::<Vec<_>>()),
            "scancel" => {
                self.seen.log(&format!("scancel {name}"));
                for ((of, _), job) in lock(&self.jobs).iter_mut() {
                    if of == name {
                        self.end(job, "CANCELLED");
                    }
                }
                String::new()
            }
            "scontrol" => "MaxArraySize = 1001\n".to_owned(),
            other => panic!("{other}"),
        };
        if is_lost {
            return Err(io::Error::other("the answer is lost"));
        }
        Ok(said)
    }

    fn queue(&self, names: &[&str]) -> String {
        let jobs = lock(&self.jobs);
        let asked = jobs
            .iter()
            .filter(|((name, _), _)| names.contains(&name.as_str()));
        asked
            .map(|((name, idx), job)| match job {
                Job::Waiting { .. } => format!("{name}|{idx}|PENDING||Resources\n"),
                Job::Running { node, .. } => format!("{name}|{idx}|RUNNING|node{node}|None\n"),
                Job::Over { node, state } => format!("{name}|{idx}|{state}|node{node}|None\n"),
            })
            .collect()
    }

    /// Ends a job, and kills its worker.
    fn end(&self, job: &mut Job, state: &'static str) {
        let node = match job {
            Job::Over { .. } => return,
            Job::Waiting { .. } => 0,
            Job::Running { node, process, .. } => {
                self.seen.killed(process.name());
                process.kill();
                *node
            }
        };
        *job = Job::Over { node, state };
    }

    /// Notes the jobs that have ended, and begins others on free nodes; kills one now and then.
    pub(super) fn go_on(self: &Arc<Self>, world: &World) {
        let mut jobs = lock(&self.jobs);
        for job in jobs.values_mut() {
            if let Job::Running {
                node,
                process,
                outcome,
            } = job
                && process.is_over()
            {
                let state = match outcome.get() {
                    Some(true) => "COMPLETED",
                    _ => "FAILED",
                };
                *job = Job::Over { node: *node, state };
            } else if matches!(job, Job::Running { .. }) && self.has_faults() && below(4000) < 5 {
                let states = ["FAILED", "PREEMPTED", "NODE_FAIL", "CANCELLED"];
                self.end(job, states[below(4) as usize]);
            }
        }
        for node in 1..=N_NODES {
            let is_here = |job: &&Job| matches!(job, Job::Running { node: on, .. } if *on == node);
            let n_running = jobs.values().filter(is_here).count();
            let now = self.seen.time();
            let next = jobs
                .iter_mut()
                .filter(|(_, job)| matches!(job, Job::Waiting { from } if *from <= now));
            for ((name, idx), job) in next.take(AT_ONCE.saturating_sub(n_running)) {
                let outcome = Arc::new(OnceLock::new());
                let process = self.work(world, node, &format!("{name}/{idx}"), &outcome);
                *job = Job::Running {
                    node,
                    process,
                    outcome,
                };
            }
        }
    }

    /// Starts the worker of a job.
    fn work(
        self: &Arc<Self>,
        world: &World,
        node: u64,
        job: &str,
        outcome: &Arc<OnceLock<bool>>,
    ) -> Process {
        let mut lakes = lock(&self.lakes);
        let folder = self.folder.join(format!("worker{}", lakes.len()));
        lakes.push(folder.clone());
        let mut depot = Arc::clone(&self.depot);
        if self.old == Old::LinkOffline {
            let is_offline = AtomicBool::new(false);
            depot = Arc::new(OfflineAfterOne { depot, is_offline });
        }
        let (job, outcome) = (job.to_owned(), Arc::clone(outcome));
        let seen = Arc::clone(&self.seen);
        world.start(&format!("node{node}"), move || {
            let lake = Lake::open(&folder).with_depot(&depot, &outages::worker_sharing(DAY));
            let lake = Arc::new(lake);
            let kinds = stages::kinds();
            let worker = Worker {
                runner: WorkItemRunner::new(&kinds, lake.as_ref(), 1),
                lake: &lake,
                events: &|_: &Event| {},
                sends: true,
                began: clock::now(),
                limit: OnceLock::new(),
            };
            let result = worker.job(&job);
            lake.leave();
            seen.ended();
            outcome.set(result.is_ok()).unwrap();
        })
    }
}
