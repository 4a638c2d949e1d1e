//! Outputs that publish a table which another output of the stage has written beside its own.

use std::{fs, marker::PhantomData};

use dataflow::{
    BoxedDiagnostic, ConfigOf, Context, Inputs, Line, OptionsUsed, Outcome, Output, Scope, Sum,
    Unit, counted,
};
use schemas::Table;

use crate::{ReadArtifact, ReadInputs, atomic::io_error, table};

/// The output that publishes the table `T`, which the output `O` writes into its artifacts as [`Table::FILE`]: one
/// computation makes both tables.
pub struct SiblingTable<O, T>(PhantomData<fn() -> (O, T)>);

impl<O, T> SiblingTable<O, T> {
    /// The output.
    pub const OUTPUT: Self = Self(PhantomData);
}

dataflow::metrics! {
    /// Metrics of a partition of such a table.
    pub struct SiblingMetrics {
        /// Number of its rows.
        rows_n: Sum,
    }
}

impl<O, T> Output for SiblingTable<O, T>
where
    O: Output,
    T: Table + 'static,
{
    type Stage = O::Stage;
    type Metrics = SiblingMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = T::NAME;
    const SCHEMA: &'static str = T::VERSION;
    const PARTITION: &'static str = T::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::NONE;
    const LINE: Option<Line<SiblingMetrics>> = Some(|summary| {
        format!(
            "{} of `{}`",
            counted(summary.metrics.rows_n, "row"),
            T::NAME
        )
    });

    fn units(_config: &ConfigOf<Self>, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let made = scope.partitions(O::ARTIFACT).iter();
        let unit = |made: &dataflow::Partition| {
            Unit::new(&made.key)
                .with_label(T::PARTITION, &made.key)
                .reading(O::ARTIFACT, [&made.key])
                .only_files(O::ARTIFACT, [T::FILE])
        };
        Ok(made.map(unit).collect())
    }

    fn make(
        _config: &ConfigOf<Self>,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<SiblingMetrics>, BoxedDiagnostic> {
        let path = inputs.artifact(O::ARTIFACT)?.path(T::FILE)?;
        let rows_n = table::describe(path)?.rows as f64;
        fs::copy(path, cx.folder().join(table::FILE)).map_err(io_error("copy", path))?;
        Ok(Outcome::Made(SiblingMetrics { rows_n }))
    }
}
