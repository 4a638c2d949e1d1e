//! A scheduler: its commands, as command lines with names in braces, and the format of its answers.

use std::collections::BTreeMap;

use serde::Deserialize;

/// Commands of a scheduler for arrays of jobs, and the format of its answers.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Scheduler {
    /// Submits one array; [`Scheduler::script`] comes on its stdin. A word with a name that has no value
    /// here is left out.
    pub(crate) submit: Vec<String>,
    /// Words after the first one of `submit`, for a machine's own file, e.g. `--partition=main`.
    #[serde(default)]
    pub(crate) extra: Vec<String>,
    /// Script that the array's jobs run.
    pub(crate) script: String,
    /// Output of `submit`, with `{id}` in it.
    pub(crate) id: String,
    /// Name of a job's log among the logs.
    pub(crate) log: String,
    /// Folder of logs, that every machine sees [default: in the depot].
    pub(crate) logs: Option<String>,
    /// The program on the machines that make units [default: this one].
    pub(crate) program: Option<String>,
    /// Lists all jobs at once.
    pub(crate) query: Vec<String>,
    /// Separator between the columns of a line.
    pub(crate) separator: String,
    /// The columns: `name`, `index`, `state`, `host`, `reason`, or any other word.
    pub(crate) columns: Vec<String>,
    /// States of jobs that wait.
    pub(crate) waiting: Vec<String>,
    /// States of jobs that run; in any other state a job is over.
    pub(crate) running: Vec<String>,
    /// Reasons for which a job would wait for ever, and another like it might not.
    #[serde(default)]
    pub(crate) stuck: Vec<String>,
    /// Reasons for which no machine ever takes a job.
    #[serde(default)]
    pub(crate) impossible: Vec<String>,
    /// Words of a refused submission for which it would be refused again.
    #[serde(default)]
    pub(crate) refused: Vec<String>,
    /// States of jobs that were over when others needed their machine, or lost it: no fault of their own.
    #[serde(default)]
    pub(crate) displaced: Vec<String>,
    /// States of jobs that took more time than they had.
    #[serde(default)]
    pub(crate) out_of_time: Vec<String>,
    /// States of jobs that took more memory than they had, and words in their logs that say so.
    #[serde(default)]
    pub(crate) out_of_memory: Vec<String>,
    #[serde(default)]
    pub(crate) out_of_memory_logs: Vec<String>,
    /// Whether the other units of an output are made when one fails.
    #[serde(default = "default_true")]
    pub(crate) keep_going: bool,
    /// Words after the first one of `submit` by which nothing is submitted, and the answer says whether it could be.
    #[serde(default)]
    pub(crate) test: Vec<String>,
    /// Longest time in seconds from a job's start to the first sign of its worker: a scheduler that has lost
    /// its state may show jobs that no machine runs.
    #[serde(default = "default_begin_s")]
    pub(crate) begin_s: u64,
    /// Longest time in seconds without a heartbeat of a worker, which leaves five in it.
    #[serde(default = "default_heartbeat_timeout_s")]
    pub(crate) heartbeat_timeout_s: u64,
    /// Longest wait for the depot in minutes; read by `executors::depot_patience_min`.
    #[serde(default, rename = "depot_patience_min")]
    pub(crate) _depot_patience_min: Option<f64>,
    /// Cancels an array.
    pub(crate) cancel: Vec<String>,
    /// Prints the maximum number of jobs of an array.
    #[serde(default)]
    pub(crate) limit: Vec<String>,
    /// The word before that number, and ` = `.
    #[serde(default)]
    pub(crate) limit_key: String,
}

pub(crate) fn default_true() -> bool {
    true
}

fn default_begin_s() -> u64 {
    300
}

fn default_heartbeat_timeout_s() -> u64 {
    600
}

/// Values of the names in braces.
#[derive(Debug, Clone, Default)]
pub(crate) struct Values(BTreeMap<&'static str, String>);

impl Values {
    pub(crate) fn with(mut self, name: &'static str, value: &dyn ToString) -> Self {
        self.0.insert(name, value.to_string());
        self
    }

    pub(crate) fn with_some(self, name: &'static str, value: Option<&dyn ToString>) -> Self {
        match value {
            Some(value) => self.with(name, value),
            None => self,
        }
    }

    /// Returns a text with the values in it; `None` if a name in braces has no value. Other braces stay.
    fn fill(&self, text: &str) -> Option<String> {
        const NAMES: [&str; 21] = [
            "name",
            "names",
            "id",
            "ids",
            "index",
            "last",
            "n",
            "logs",
            "cores",
            "memory_gb",
            "gpus",
            "time_min",
            "partition",
            "account",
            "qos",
            "constraint",
            "gres",
            "environment",
            "depot",
            "worker",
            "user",
        ];
        let mut filled = text.to_owned();
        for name in NAMES {
            let braced = format!("{{{name}}}");
            if filled.contains(&braced) {
                filled = filled.replace(&braced, self.0.get(name)?);
            }
        }
        Some(filled)
    }

    /// Returns the words whose names all have values.
    pub(crate) fn words(&self, words: &[String]) -> Vec<String> {
        words.iter().filter_map(|word| self.fill(word)).collect()
    }

    /// Returns the lines whose names all have values.
    pub(crate) fn lines(&self, text: &str) -> String {
        let lines = text.trim().lines().filter_map(|line| self.fill(line));
        lines.map(|line| line + "\n").collect()
    }
}

impl Scheduler {
    /// Returns the words of the submission.
    pub(crate) fn submission(&self, values: &Values) -> Vec<String> {
        let mut words = values.words(&self.submit);
        let at = words.len().min(1);
        words.splice(at..at, self.extra.iter().cloned());
        words
    }

    /// Finds the array's number in the output of the submission.
    pub(crate) fn id_in(&self, said: &str) -> Option<String> {
        let (before, after) = self.id.split_once("{id}").unwrap_or_default();
        let rest = match before {
            // A site may print a banner before.
            "" => said
                .trim()
                .lines()
                .next_back()
                .unwrap_or_default()
                .trim_start(),
            before => said.split_once(before)?.1,
        };
        let stop = after.chars().next();
        let is_end = |c: char| c.is_whitespace() || c == ';' || Some(c) == stop;
        let id = rest.split(is_end).next().unwrap_or_default();
        (!id.is_empty()).then(|| id.to_owned())
    }

    /// Finds the largest number of jobs of an array in the output of `limit`.
    pub(crate) fn limit_in(&self, said: &str) -> Option<usize> {
        let mut lines = said.lines().filter_map(|line| line.split_once('='));
        let (_, number) = lines.find(|(key, _)| key.trim() == self.limit_key)?;
        number.trim().parse().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Scheduler {
        toml_edit::de::from_str(include_str!("../executors/slurm.toml")).unwrap()
    }

    #[test]
    fn the_tables_are_whole() {
        for text in [
            include_str!("../executors/slurm.toml"),
            include_str!("../executors/pbs.toml"),
            include_str!("../executors/htcondor.toml"),
        ] {
            let table: Scheduler = toml_edit::de::from_str(text).unwrap();
            assert!(!table.submit.is_empty() && !table.query.is_empty());
        }
    }

    #[test]
    fn words_without_a_value_are_left_out_and_extra_words_come_first() {
        let values = Values::default()
            .with("name", &"pl1")
            .with("last", &3)
            .with("logs", &"/logs")
            .with("cores", &2)
            .with_some("gpus", None)
            .with_some("time_min", Some(&30));
        let mut table = table();
        table.extra = vec!["--partition=main".to_owned()];
        let words = table.submission(&values);
        assert_eq!(words[..2], ["sbatch", "--partition=main"]);
        assert!(words.contains(&"--array=0-3".to_owned()));
        assert!(words.contains(&"--time=30".to_owned()));
        assert!(
            !words
                .iter()
                .any(|word| word.contains("gpus") || word.contains('{'))
        );
    }

    #[test]
    fn numbers_are_found_in_what_is_said() {
        let mut table = table();
        assert_eq!(table.id_in("17;cluster\n"), Some("17".to_owned()));
        assert_eq!(table.id_in(""), None);
        let banner = "Welcome to the cluster\n\n4711;cluster\n";
        assert_eq!(table.id_in(banner), Some("4711".to_owned()));
        table.id = "submitted to cluster {id}.".to_owned();
        let said = "1 job(s) submitted to cluster 8.\n";
        assert_eq!(table.id_in(said), Some("8".to_owned()));
        let said = "MaxArraySize            = 1001\nMaxJobCount = 5\n";
        assert_eq!(table.limit_in(said), Some(1001));
    }
}
