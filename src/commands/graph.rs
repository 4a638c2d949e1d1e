//! `pipeline graph`

mod drawings;
mod list;

use std::collections::BTreeMap;

use dataflow::{Node, NodeName, Pipeline, StageName, Store};
use lake::Lake;

use crate::{
    arguments::{GraphArgs, GraphFormat},
    command_line::Program,
    commands::pipeline_file,
    outcome::{CommandError, CommandOutcome},
    report,
};

/// Draws the graph of a pipeline.
pub(crate) fn graph(program: &Program, args: &GraphArgs) -> Result<CommandOutcome, CommandError> {
    let pipeline = pipeline_file::read_with(program.kinds, &args.file, &args.values)?;
    let mut n_partitions = BTreeMap::new();
    let lake = Lake::open(&program.lake);
    let units = lake
        .enter(&pipeline.name)
        .and_then(|()| lake.newest_units(&pipeline.name))
        .map_err(|err| CommandError::failed(err, None))?;
    for unit in units.into_iter().filter(|unit| unit.current) {
        *n_partitions.entry(unit.node).or_default() += 1;
    }
    let graph = Graph {
        pipeline: &pipeline,
        n_partitions,
    };
    let text = match args.format {
        GraphFormat::Text => list::text(&graph),
        GraphFormat::Dot => drawings::dot(&graph),
        GraphFormat::Mermaid => drawings::mermaid(&graph),
    };
    report::data(text.as_bytes())?;
    Ok(CommandOutcome::Done)
}

/// A pipeline, with the number of partitions of each output in the lake.
struct Graph<'a> {
    pipeline: &'a Pipeline,
    n_partitions: BTreeMap<NodeName, usize>,
}

impl Graph<'_> {
    /// The outputs of a stage in the order in which they are made.
    fn outputs_of<'s>(&'s self, stage: &'s StageName) -> impl Iterator<Item = &'s Node> {
        let nodes = self.pipeline.nodes.iter();
        nodes.filter(move |node| node.name.stage == *stage)
    }

    /// The partitions of an output in words, e.g. `20 partitions, one per sequence`.
    fn partitions(&self, node: &Node) -> String {
        let per = node.output.partition;
        match self.n_partitions.get(&node.name) {
            Some(1) => format!("1 partition, one per {per}"),
            Some(n) => format!("{n} partitions, one per {per}"),
            None => format!("one partition per {per}"),
        }
    }
}
