//! The units of a program: which partitions it makes, and what each of them reads.

use dataflow::{BoxedDiagnostic, Scope, SourceFile, Unit};

use crate::{
    code,
    config::{ProgramConfig, Read},
    error::ProgramError,
};

/// Key of the only partition of a program that gathers.
const ALL: &str = "all";
/// The fact that tells a unit its name among several that are made of one.
pub(crate) const FAN_OUT: &str = "one of several, `fan_out`";
/// The fact that an input has no partition for a unit.
pub(crate) const LACKS: &str = "lacks its partition of";

/// Lists the units.
pub(crate) fn units(config: &ProgramConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
    let sources = code::sources(config)?;
    let mut units = Vec::new();
    let Some(each) = &config.each else {
        let mut unit = Unit::new(ALL);
        for input in scope.inputs() {
            let keys = scope
                .partitions(input)
                .iter()
                .map(|partition| &partition.key);
            unit = unit.reading(input, keys);
        }
        add(config, &sources, &unit, &mut units);
        return Ok(units);
    };
    if scope.partitions(each).is_empty() {
        return Err(ProgramError::NoPartitions {
            input: each.clone(),
        }
        .into());
    }
    for partition in scope.partitions(each) {
        let mut unit = Unit::new(&partition.key)
            .with_labels_of(partition)
            .reading(each, [&partition.key]);
        for input in scope.inputs().filter(|input| input != each) {
            let others = scope.partitions(input);
            let key = match config.read_of(input) {
                Read::All => {
                    unit = unit.reading(input, others.iter().map(|other| &other.key));
                    continue;
                }
                Read::Where(label) => {
                    let has_key = |other: &&dataflow::Partition| {
                        other.label(label) == Some(partition.key.as_str())
                    };
                    let keys: Vec<_> = others
                        .iter()
                        .filter(has_key)
                        .map(|other| &other.key)
                        .collect();
                    unit = if keys.is_empty() {
                        unit.with_fact(LACKS, input)
                    } else {
                        unit.reading(input, keys)
                    };
                    continue;
                }
                Read::Same => Some(partition.key.as_str()),
                Read::Label(label) => partition.label(label),
            };
            let other = others.iter().find(|other| Some(other.key.as_str()) == key);
            unit = match other {
                Some(other) => unit.reading(input, [&other.key]),
                // It is planned without, and skipped.
                None => unit.with_fact(LACKS, input),
            };
        }
        add(config, &sources, &unit, &mut units);
    }
    Ok(units)
}

/// Adds a unit with its files: itself, or one for each name that it is fanned out to.
fn add(config: &ProgramConfig, sources: &[SourceFile], unit: &Unit, units: &mut Vec<Unit>) {
    let with_files = |unit: Unit| sources.iter().cloned().fold(unit, Unit::with_file);
    if config.fan_out.is_empty() {
        units.push(with_files(unit.clone()));
        return;
    }
    for name in &config.fan_out {
        let mut one = unit.clone().with_fact(FAN_OUT, name);
        one.partition = match config.each {
            Some(_) => format!("{}-{name}", unit.partition),
            None => name.clone(),
        };
        units.push(with_files(one));
    }
}
