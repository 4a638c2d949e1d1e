//! Aborting a process: stored results stay, and its run is marked as interrupted.

use std::fs;

use dataflow::RunStatus;

use crate::{LakeError, atomic, folder::names_in, history, lake::Lake, register::Run, views};

impl Lake {
    /// Drops the units in flight and marks the run as interrupted. Returns the number of units
    /// dropped, and a guard: nothing is stored while it lives.
    pub fn abort(&self) -> (impl Sized + '_, usize) {
        let (guard, n_dropped) = self.in_flight.abort();
        let mine = atomic::process_name();
        let staging = self.folder.staging();
        for name in names_in(&staging).unwrap_or_default() {
            if name.starts_with(&mine) {
                let _gone = fs::remove_file(staging.join(name));
            }
        }
        let run = self.register.current().take();
        if let Some(run) = run {
            // If this fails, the imminent death of the run's process marks it as interrupted too.
            let _noted = self.note_interrupted(run);
        }
        self.leave();
        (guard, n_dropped)
    }

    /// Records an interrupted run.
    fn note_interrupted(&self, run: Run) -> Result<(), LakeError> {
        let mut record = run.record.clone();
        record.status = RunStatus::Interrupted;
        record.units = self.register.units(&run)?;
        let units = history::with_outcomes(self, record.units.clone())?;
        let history = history::keep(self, &run, &record, &units)?;
        self.register.end(run, record, history)?;
        views::write(self)
    }
}
