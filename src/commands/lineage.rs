//! `pipeline lineage`

mod outputs;
mod relations;
mod tree;
mod units;

use std::path::Path;

use lake::Lake;
use serde::Serialize;

use self::relations::Relations;
use crate::{
    arguments::LineageArgs,
    command_line::Program,
    commands::lookup,
    outcome::{CommandError, CommandOutcome},
    report,
};

/// The direction of lineage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Ancestors.
    Up,
    /// Descendants.
    Down,
}

/// The lineage for programs: its first member is the requested artifact.
#[derive(Serialize)]
struct Family<T> {
    run: u64,
    direction: Direction,
    members: Vec<T>,
}

/// Shows the ancestors or descendants of an artifact.
pub(crate) fn lineage(
    program: &Program,
    args: &LineageArgs,
) -> Result<CommandOutcome, CommandError> {
    match found(&program.lake, args)? {
        Found::Units(family) => report::answer(args.format, &family, |family| {
            tree::text(family.members.iter().map(units::Member::node))
        })?,
        Found::Outputs(family) => report::answer(args.format, &family, |family| {
            tree::text(family.members.iter().map(outputs::Member::node))
        })?,
    }
    Ok(CommandOutcome::Done)
}

/// Returns the ancestors or descendants of an artifact as JSON.
pub(crate) fn family(lake: &Path, args: &LineageArgs) -> Result<serde_json::Value, CommandError> {
    let json = match found(lake, args)? {
        Found::Units(family) => serde_json::to_value(family),
        Found::Outputs(family) => serde_json::to_value(family),
    };
    json.map_err(|err| CommandError::failed(err, None))
}

/// The lineage of one partition, or of a whole artifact.
enum Found {
    Units(Family<units::Member>),
    Outputs(Family<outputs::Member>),
}

fn found(lake: &Path, args: &LineageArgs) -> Result<Found, CommandError> {
    let lake = Lake::open(lake);
    let run = lookup::run(&lake, args.run.as_deref())?;
    let (node, units) = lookup::units(&run, &args.artifact)?;
    let direction = if args.down {
        Direction::Down
    } else {
        Direction::Up
    };
    let mut relations = Relations::new(&lake, &run.record);
    let number = run.number;
    let Some(partition) = &args.partition else {
        return Ok(Found::Outputs(Family {
            run: number,
            direction,
            members: outputs::family(&run.record, &relations, &node, direction)?,
        }));
    };
    let unit = lookup::unit(&units, number, &args.artifact, partition)?;
    Ok(Found::Units(Family {
        run: number,
        direction,
        members: units::family(&lake, &mut relations, unit, direction)?,
    }))
}
