//! `pipeline lineage`

mod outputs;
mod relations;
mod tree;
mod units;

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
enum Direction {
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
    let lake = Lake::open(&program.lake);
    let run = lookup::run(&lake, args.run.as_deref())?;
    let (node, units) = lookup::units(&run, &args.artifact)?;
    let direction = if args.down {
        Direction::Down
    } else {
        Direction::Up
    };
    let mut relations = Relations::new(&lake, &run.record);
    let number = run.number;
    if let Some(partition) = &args.partition {
        let unit = lookup::unit(&units, number, &args.artifact, partition)?;
        let family = Family {
            run: number,
            direction,
            members: units::family(&lake, &mut relations, unit, direction)?,
        };
        report::answer(args.format, &family, |family| {
            tree::text(family.members.iter().map(units::Member::node))
        })?;
    } else {
        let family = Family {
            run: number,
            direction,
            members: outputs::family(&run.record, &relations, &node, direction)?,
        };
        report::answer(args.format, &family, |family| {
            tree::text(family.members.iter().map(outputs::Member::node))
        })?;
    }
    Ok(CommandOutcome::Done)
}
