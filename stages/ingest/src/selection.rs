//! Selection of recordings: hand, subjects, objects and the dataset's own splits.
//!
//! Splits s0 to s3: Chao et al., *DexYCB: A Benchmark for Capturing Hand Grasping of Objects*, 2021,
//! section 4. The split by objects: Ye et al., *Learning Continuous Grasping Function with a
//! Dexterous Hand from Human Demonstrations*, 2023, section IV.

use std::collections::{BTreeMap, BTreeSet};

use dataflow::nearest;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    config::IngestConfig,
    error::IngestError,
    reader::{About, ListedRecording},
    ycb,
};

/// Recordings of one subject with one object, in the order of their names.
const TRIALS: usize = 5;

/// A part of `DexYCB`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// Every recording.
    #[default]
    All,
    /// s0: the first four of each five trials.
    S0Train,
    /// s0: the fifth trials of subjects 1 and 2.
    S0Val,
    /// s0: the fifth trials of subjects 3 to 10.
    S0Test,
    /// s1, unseen subjects: subjects 1 to 6 and 10.
    S1Train,
    /// s1: subject 7.
    S1Val,
    /// s1: subjects 8 and 9.
    S1Test,
    /// s2, unseen views: the first six cameras of every recording.
    S2Train,
    /// s2: the seventh camera.
    S2Val,
    /// s2: the eighth camera.
    S2Test,
    /// s3, unseen objects: all but those of the other two.
    S3Train,
    /// s3: tomato soup can and foam brick.
    S3Val,
    /// s3: pudding box, bleach cleanser and wood block.
    S3Test,
    /// The 15 objects on which the paper trains.
    PaperTrain,
    /// The 5 objects that the paper holds out.
    PaperUnseen,
}

/// The cameras of a recording that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Cameras {
    /// Number of the first one in the recording's list.
    pub(crate) first: usize,
    /// Number after that of the last one.
    pub(crate) end: usize,
}

impl Cameras {
    /// Every camera.
    pub(crate) const ALL: Self = Self {
        first: 0,
        end: usize::MAX,
    };

    /// Says whether the camera of this number is among them.
    pub(crate) fn holds(self, number: usize) -> bool {
        (self.first..self.end).contains(&number)
    }
}

/// Decision on a listed recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Selection {
    /// It is read, as these cameras saw it.
    Take(Cameras),
    /// It is left out, for this reason.
    Leave(String),
}

impl Selection {
    /// Says whether it is read.
    pub(crate) fn is_taken(&self) -> bool {
        matches!(self, Self::Take(_))
    }
}

/// Decides for every listed recording, in their order.
///
/// One whose description cannot be used is taken, so that it is reported.
///
/// # Errors
///
/// Fails if an option names nothing that there is, or a split cannot be told in this subset.
pub(crate) fn choose(
    config: &IngestConfig,
    listed: &[ListedRecording],
) -> Result<Vec<Selection>, IngestError> {
    check_names(config, listed)?;
    let trials = if matches!(config.split, Split::S0Train | Split::S0Val | Split::S0Test) {
        trials(listed)?
    } else {
        BTreeMap::new()
    };
    Ok(listed
        .iter()
        .map(|recording| match &recording.about {
            None => Selection::Take(Cameras::ALL),
            Some(about) => choice(config, about, trials.get(recording.key.as_str()).copied()),
        })
        .collect())
}

fn choice(config: &IngestConfig, about: &About, trial: Option<usize>) -> Selection {
    // Reasons do not name what the options hold: they stay true when those change.
    if about.hand != config.hand && !config.mirror {
        return Selection::Leave(format!("{} hand", about.hand.as_str()));
    }
    let named = |names: &[String], name: &str| names.is_empty() || names.iter().any(|n| n == name);
    if !named(&config.subjects, &about.subject) {
        return Selection::Leave(format!("subject `{}` is not in `subjects`", about.subject));
    }
    if !named(&config.objects, &about.object) {
        return Selection::Leave(format!("object `{}` is not in `objects`", about.object));
    }
    let cameras = match config.split {
        Split::S2Train => Cameras { first: 0, end: 6 },
        Split::S2Val => Cameras { first: 6, end: 7 },
        Split::S2Test => Cameras { first: 7, end: 8 },
        _ => Cameras::ALL,
    };
    if in_split(config.split, about, trial) {
        Selection::Take(cameras)
    } else {
        Selection::Leave("not in `split`".to_owned())
    }
}

fn in_split(split: Split, about: &About, trial: Option<usize>) -> bool {
    // Numbers begin with 1: who has none is in no part that goes by them.
    let subject = subject_number(&about.subject).unwrap_or(0);
    let object = ycb::number(&about.object).unwrap_or(0);
    let is_last_trial = trial == Some(TRIALS - 1);
    match split {
        Split::All | Split::S2Train | Split::S2Val | Split::S2Test => true,
        Split::S0Train => !is_last_trial,
        Split::S0Val => is_last_trial && matches!(subject, 1 | 2),
        Split::S0Test => is_last_trial && subject > 2,
        Split::S1Train => matches!(subject, 1..=6 | 10),
        Split::S1Val => subject == 7,
        Split::S1Test => matches!(subject, 8 | 9),
        Split::S3Train => matches!(object, 1..=20) && !matches!(object, 4 | 8 | 12 | 16),
        Split::S3Val => matches!(object, 4 | 21),
        Split::S3Test => matches!(object, 8 | 12 | 16),
        Split::PaperTrain => matches!(object, 1..=9 | 15..=18 | 20 | 21),
        Split::PaperUnseen => matches!(object, 10..=14),
    }
}

/// Returns the number at the end of a subject's folder: 3 of `20200820-subject-03`.
fn subject_number(subject: &str) -> Option<u32> {
    subject.rsplit_once("subject-")?.1.parse().ok()
}

/// Numbers the trials of each subject with each object, from 0, by the recording's key.
fn trials(listed: &[ListedRecording]) -> Result<BTreeMap<&str, usize>, IngestError> {
    let mut groups: BTreeMap<(&str, &str), Vec<&str>> = BTreeMap::new();
    for recording in listed {
        if let Some(about) = &recording.about {
            let group = groups.entry((&about.subject, &about.object)).or_default();
            group.push(&recording.key);
        }
    }
    let mut trials = BTreeMap::new();
    for ((subject, object), keys) in groups {
        if keys.len() != TRIALS {
            return Err(IngestError::Trials {
                subject: subject.to_owned(),
                object: object.to_owned(),
                found: keys.len(),
            });
        }
        trials.extend(
            keys.into_iter()
                .enumerate()
                .map(|(trial, key)| (key, trial)),
        );
    }
    Ok(trials)
}

/// Refuses subjects and objects that nobody has.
fn check_names(config: &IngestConfig, listed: &[ListedRecording]) -> Result<(), IngestError> {
    let distinct = |of: fn(&About) -> &str| -> BTreeSet<&str> {
        let abouts = listed
            .iter()
            .filter_map(|recording| recording.about.as_ref());
        abouts.map(of).collect()
    };
    check_known(
        "subjects",
        &config.subjects,
        &distinct(|about| &about.subject),
    )?;
    check_known("objects", &config.objects, &distinct(|about| &about.object))
}

/// Refuses the first of an option's names that is not known.
pub(crate) fn check_known<'a>(
    key: &'static str,
    names: impl IntoIterator<Item = &'a String>,
    known: &BTreeSet<&str>,
) -> Result<(), IngestError> {
    let mut names = names.into_iter();
    match names.find(|name| !known.contains(name.as_str())) {
        None => Ok(()),
        Some(name) => Err(IngestError::UnknownName {
            key,
            name: name.clone(),
            near: nearest(name, known.iter().copied()).map(str::to_owned),
            known: known.iter().copied().map(str::to_owned).collect(),
        }),
    }
}
