//! Saved state of an interrupted training, and progress of a running one.

use std::{
    fs::{self, File},
    io::{self, Write},
    path::PathBuf,
    time::{Duration, Instant},
};

use cgf::{Epoch, Trainer};
use dataflow::{BoxedDiagnostic, Context};

use crate::TrainError;

/// The state between two epochs, in the unit's folder to resume from.
const STATE: &str = "state.safetensors";
/// The epochs that are done, one JSON object per line, beside it.
const CURVE: &str = "curve.jsonl";
/// Least time between two saved states.
const MIN_INTERVAL: Duration = Duration::from_secs(1);
/// Saving takes at most one part in this many of the time.
const SHARE: u32 = 50;

/// Saves the states of a training now and then.
pub(crate) struct Saver {
    state: PathBuf,
    curve: PathBuf,
    saved: Instant,
    pause: Duration,
}

impl Saver {
    /// Puts a training where an interrupted one was left, if there was one, and says what was found.
    pub(crate) fn resume(
        cx: &Context,
        trainer: &mut Trainer,
    ) -> Result<(Self, SavedTraining), BoxedDiagnostic> {
        let folder = cx.resume_folder();
        let saver = Self {
            state: folder.join(STATE),
            curve: folder.join(CURVE),
            saved: Instant::now(),
            pause: MIN_INTERVAL,
        };
        let found = match fs::read(&saver.state) {
            Err(err) if err.kind() == io::ErrorKind::NotFound => SavedTraining::Nothing,
            Err(err) => SavedTraining::Damaged(err.to_string()),
            Ok(bytes) => match trainer.restore(&bytes) {
                Ok(()) => SavedTraining::Epochs(trainer.curve().len()),
                Err(err) => SavedTraining::Damaged(err.to_string()),
            },
        };
        // Epochs after the state that was saved will be gone through again.
        let mut lines = Vec::new();
        for epoch in trainer.curve() {
            lines.extend(line(epoch).map_err(|err| saver.unwritten(err))?);
        }
        lake::write_atomic(&saver.curve, &lines)?;
        Ok((saver, found))
    }

    /// Notes an epoch that is done, and saves the state if it is time to.
    pub(crate) fn note(&mut self, trainer: &Trainer) -> Result<(), BoxedDiagnostic> {
        if let Some(epoch) = trainer.curve().last() {
            let written = File::options()
                .append(true)
                .create(true)
                .open(&self.curve)
                .and_then(|mut file| file.write_all(&line(epoch)?));
            written.map_err(|err| self.unwritten(err))?;
        }
        if self.saved.elapsed() >= self.pause {
            let started = Instant::now();
            lake::write_atomic(&self.state, &trainer.state().map_err(TrainError::from)?)?;
            self.saved = Instant::now();
            self.pause = MIN_INTERVAL.max(started.elapsed() * SHARE);
        }
        Ok(())
    }

    fn unwritten(&self, source: io::Error) -> TrainError {
        TrainError::Curve {
            path: self.curve.clone(),
            source,
        }
    }
}

/// Saved state of an interrupted training.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum SavedTraining {
    /// Nothing: the training is new.
    Nothing,
    /// So many epochs.
    Epochs(usize),
    /// A state that cannot be used, and why.
    Damaged(String),
}

fn line(epoch: &Epoch) -> io::Result<Vec<u8>> {
    let mut line = serde_json::to_vec(epoch)?;
    line.push(b'\n');
    Ok(line)
}

/// Says how long the rest of the epochs will take, if they take as long as those since `started`.
pub(crate) fn time_left(started: Instant, done: usize, left: usize) -> String {
    let seconds = started.elapsed().as_secs_f64() / done.max(1) as f64 * left as f64;
    let minutes = (seconds / 60.0).floor();
    if minutes >= 60.0 {
        format!(
            "{:.0} h {:02.0} min left",
            (minutes / 60.0).floor(),
            minutes % 60.0
        )
    } else if minutes >= 1.0 {
        format!("{minutes:.0} min {:02.0} s left", (seconds % 60.0).floor())
    } else {
        format!("{seconds:.0} s left")
    }
}
