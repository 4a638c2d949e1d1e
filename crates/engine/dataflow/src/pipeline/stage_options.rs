//! Options of a stage without a pipeline file, read as those of one.

use std::any::Any;

use toml_edit::InlineTable;

use super::faults::faults;
use crate::{error::Problem, kind::Kind};

impl Kind {
    /// Returns the options of a stage of this kind, whose table has nothing else, with what the file of its hand adds.
    ///
    /// # Errors
    ///
    /// Fails with the first fault of the table, and if options of this kind are not of type `C`.
    pub fn read_options<C: Any + Clone>(&self, mut table: InlineTable) -> Result<C, Problem> {
        let list = format!("`pipeline stages {}` lists every option", self.name);
        let problem = |message: String| Problem::new(message).hint(list.clone());
        self.complete(&mut table)
            .map_err(|fault| problem(fault.to_string()))?;
        let configured = self.configure(table.clone()).map_err(|fault| {
            let found = faults(self.name, self, &table).into_iter().next();
            found.map_or_else(
                || problem(format!("stage `{}`: {}", self.name, fault.message)),
                |fault| Problem::new(fault.message).hint(fault.hint),
            )
        })?;
        if let Some(fault) = configured.check().into_iter().next() {
            return Err(problem(format!("stage `{}`: {fault}", self.name)));
        }
        let options = configured.options().downcast_ref::<C>();
        let of_another_type = || problem(format!("`{}` has options of another type", self.name));
        options.cloned().ok_or_else(of_another_type)
    }
}
