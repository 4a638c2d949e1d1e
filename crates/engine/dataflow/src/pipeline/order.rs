//! The order in which the outputs of a pipeline are made.

use super::StageEntry;
use crate::{
    error::Problem,
    graph::Node,
    name::{ArtifactName, NodeName},
    source::{Location, Source},
};

/// Orders the stages so that each comes after what it reads, and lists their outputs.
///
/// Stages that do not depend on each other keep the order of the file. Fails with every circle of stages;
/// `place` locates a stage's wire of an input.
pub(super) fn order(
    stages: &[StageEntry],
    place: impl Fn(&StageEntry, &ArtifactName) -> Option<Location>,
) -> Result<Vec<Node>, Vec<Problem>> {
    let mut nodes = Vec::new();
    let mut placed = vec![false; stages.len()];
    let mut circles = Vec::new();
    while placed.contains(&false) {
        let next = stages.iter().enumerate().position(|(idx, stage)| {
            let mut sources = stage.inputs.values();
            !placed[idx]
                && sources.all(|source| maker(stages, source).is_some_and(|idx| placed[idx]))
        });
        let Some(idx) = next else {
            let circle = circle(stages, &placed);
            for wire in &circle {
                placed[wire.reader] = true;
            }
            circles.push(in_a_circle(stages, &circle, &place));
            continue;
        };
        placed[idx] = true;
        let stage = &stages[idx];
        let mut reads = stage.inputs.clone();
        for (output_idx, output) in stage.kind.outputs.iter().enumerate() {
            let name = NodeName {
                stage: stage.name.clone(),
                artifact: ArtifactName::declared(output.artifact),
            };
            nodes.push(Node {
                name: name.clone(),
                stage_idx: idx,
                output_idx,
                output: *output,
                reads: reads.clone(),
            });
            reads.insert(name.artifact.clone(), name);
        }
    }
    if circles.is_empty() {
        Ok(nodes)
    } else {
        Err(circles)
    }
}

/// The position of the stage that makes an output.
fn maker(stages: &[StageEntry], source: &NodeName) -> Option<usize> {
    stages.iter().position(|other| other.name == source.stage)
}

/// An input of a stage.
struct Wire<'a> {
    /// Position of the stage.
    reader: usize,
    input: &'a ArtifactName,
    source: &'a NodeName,
}

/// Finds stages each of which reads the next, and the last the first, among those that are not placed: each of
/// them reads another one.
fn circle<'a>(stages: &'a [StageEntry], placed: &[bool]) -> Vec<Wire<'a>> {
    let mut path: Vec<Wire<'a>> = Vec::new();
    let mut reader = placed.iter().position(|placed| !placed).unwrap_or(0);
    loop {
        if let Some(start) = path.iter().position(|wire| wire.reader == reader) {
            path.drain(..start);
            return path;
        }
        let mut inputs = stages[reader].inputs.iter();
        let next = inputs.find_map(|(input, source)| {
            let maker = maker(stages, source).filter(|maker| !placed[*maker])?;
            Some((input, source, maker))
        });
        let Some((input, source, maker)) = next else {
            return path;
        };
        path.push(Wire {
            reader,
            input,
            source,
        });
        reader = maker;
    }
}

/// Says which stages read each other, and where.
fn in_a_circle(
    stages: &[StageEntry],
    circle: &[Wire],
    place: impl Fn(&StageEntry, &ArtifactName) -> Option<Location>,
) -> Problem {
    let places: Vec<Option<Location>> = circle
        .iter()
        .map(|wire| place(&stages[wire.reader], wire.input))
        .collect();
    let first = places.iter().flatten().next().cloned();
    let said = circle.iter().zip(&places).map(|(wire, place)| {
        let line = match place.as_ref().map(|place| &place.source) {
            Some(Source::File { path, line }) => match first.as_ref().map(|first| &first.source) {
                Some(Source::File { path: same, .. }) if same == path => format!(" (line {line})"),
                _ => format!(" ({}:{line})", path.display()),
            },
            Some(Source::Argument) => " (`--set`)".to_owned(),
            None => String::new(),
        };
        format!(
            "`{}` reads `{}`{line}",
            stages[wire.reader].name, wire.source
        )
    });
    let said = said.collect::<Vec<_>>().join(", ");
    let message = match circle {
        [_] => format!("a stage reads what it makes itself: {said}"),
        _ => format!("stages read each other in a circle: {said}"),
    };
    let hint = "wire one of these inputs to a stage that is made before";
    Problem::new(message).at(first).hint(hint.to_owned())
}
