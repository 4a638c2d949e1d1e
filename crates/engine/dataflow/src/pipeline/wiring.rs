//! The wires between the stages of a pipeline file.

use toml_edit::{InlineTable, Key, Value};

use super::{StageEntry, faults::Part, reader::FileReader};
use crate::{name::StageName, source::Location, stage::Wiring, suggestions::nearest};

impl FileReader<'_> {
    /// Checks that every input is wired to an output that exists and holds the right artifact.
    pub(super) fn check_wiring(&mut self, stages: &[StageEntry], tables: &InlineTable) {
        for stage in stages {
            let span = tables.key(stage.name.as_str()).and_then(Key::span);
            for input in stage.kind.inputs.iter().map(String::as_str) {
                let Some(node) = stage.inputs.get(input) else {
                    let offer = stages.iter().find(|other| {
                        other
                            .kind
                            .outputs
                            .iter()
                            .any(|output| output.artifact == input)
                    });
                    let hint = offer.map(|other| {
                        format!("write `inputs.{input} = \"{}.{input}\"`", other.name)
                    });
                    self.problem(
                        format!(
                            "stage `{}` has nothing wired to its input `{input}`",
                            stage.name
                        ),
                        span.clone(),
                        hint,
                    );
                    continue;
                };
                let written = self.wire(tables, &stage.name, input);
                if !tables.contains_key(node.stage.as_str()) {
                    let hint = nearest(node.stage.as_str(), tables.iter().map(|(name, _)| name))
                        .map(|near| format!("did you mean `{near}.{}`?", node.artifact));
                    self.problem_at(
                        format!(
                            "stage `{}` reads from an unknown stage `{}`",
                            stage.name, node.stage
                        ),
                        written,
                        hint,
                    );
                    continue;
                }
                // A stage with a faulty table has been reported already.
                let Some(maker) = stages.iter().find(|other| other.name == node.stage) else {
                    continue;
                };
                let outputs = maker.kind.outputs.iter();
                let outputs: Vec<&str> = outputs.map(|output| output.artifact).collect();
                if !outputs.contains(&node.artifact.as_str()) {
                    self.problem_at(
                        format!("stage `{}` makes no `{}`", node.stage, node.artifact),
                        written,
                        Some(format!("it makes: {}", outputs.join(", "))),
                    );
                } else if stage.kind.wiring == Wiring::Declared && node.artifact != *input {
                    self.problem_at(
                        format!(
                            "input `{input}` of stage `{}` wants `{input}`, and is wired to `{}`",
                            stage.name, node.artifact
                        ),
                        written,
                        None,
                    );
                }
            }
        }
    }

    /// The location of the wire of a stage's input, or else of the stage.
    pub(super) fn wire(
        &self,
        tables: &InlineTable,
        stage: &StageName,
        input: &str,
    ) -> Option<Location> {
        let stage = stage.as_str();
        let in_file = tables
            .get(stage)
            .and_then(|table| table.as_inline_table()?.get("inputs"))
            .and_then(|inputs| inputs.as_inline_table()?.get(input))
            .and_then(Value::span)
            .or_else(|| tables.key(stage).and_then(Key::span));
        let path = ["inputs".to_owned(), input.to_owned()];
        let given = self.in_set(Some(stage), &path, Part::Value);
        given.or_else(|| in_file.map(|span| self.location(span)))
    }
}
