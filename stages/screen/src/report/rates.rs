//! Success rates of candidates over all objects, with intervals by resampling objects.

use std::collections::BTreeMap;

use charts::{Captions, Estimate, Estimates, intervals};
use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, Mean, OptionsUsed, Outcome, Output, Partition, Scope,
    Sum, Summary, Unit,
};
use lake::{ReadInputs, WriteArtifact};
use schemas::{
    Table,
    candidates::ObjectSplit,
    rates::{ALL_ORIGINS, Rate, SuccessRates},
    success::{Success, Successes},
};
use simulation::{Approach, ObjectMass, Protocol, ProtocolName, SceneConfig};
use statistics::{MeanInterval, bootstrap_mean};

use crate::{Screen, ScreenConfig};

dataflow::metrics! {
    /// Metrics of all objects together.
    pub struct RatesMetrics {
        /// Number of objects.
        objects_n: Sum,
        /// Mean over objects of the share of candidates that succeed.
        candidate_rate_mean: Mean,
        /// Lower end of its 95 % interval.
        candidate_rate_low: Mean,
        /// Upper end of its 95 % interval.
        candidate_rate_high: Mean,
        /// Mean over objects of the share of draws that succeed.
        draw_rate_mean: Mean,
        /// Lower end of its 95 % interval.
        draw_rate_low: Mean,
        /// Upper end of its 95 % interval.
        draw_rate_high: Mean,
        /// The approach, by its place among all: 0 follow, 1 open, 2 at the grasp.
        approach_n: Mean,
        /// Squeeze of the joints beyond their final positions, in radians.
        squeeze_rad: Mean,
        /// The protocol, by its place among all, from 0 for this project's own.
        protocol_n: Mean,
    }
}

/// The report `rates`: how often candidates succeed over all objects.
pub struct RatesReport;

impl Output for RatesReport {
    type Stage = Screen;
    type Metrics = RatesMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = SuccessRates::NAME;
    const SCHEMA: &'static str = SuccessRates::VERSION;
    const PARTITION: &'static str = SuccessRates::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::Only(&["protocol", "scene"]);
    const LINE: Option<Line<RatesMetrics>> = Some(line);

    fn units(_config: &ScreenConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        Ok(units(scope))
    }

    /// Makes the table and its chart.
    fn make(
        config: &ScreenConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<RatesMetrics>, BoxedDiagnostic> {
        let successes: Successes = inputs.one()?;
        let config = &config.resolved();
        let rates = rates(&successes, config);
        cx.write(&rates)?;
        cx.write_chart("objects_mean", chart(&rates))?;
        Ok(Outcome::Made(RatesMetrics::of(
            &successes,
            &config.protocol,
        )))
    }
}

/// One unit for each table of successes, of which there is one.
fn units(scope: &Scope) -> Vec<Unit> {
    let successes = scope.partitions(Successes::NAME).iter();
    let unit = |all: &Partition| {
        Unit::new(&all.key)
            .reading(Successes::NAME, [&all.key])
            .only_files(Successes::NAME, [lake::table::FILE])
    };
    successes.map(unit).collect()
}

/// Counts of one object.
#[derive(Clone, Copy, Default)]
struct Counts {
    candidates: i64,
    draws: i64,
    successes: i64,
}

/// Counts by object.
#[derive(Default)]
struct ByObject<'a>(BTreeMap<&'a str, Counts>);

impl<'a> ByObject<'a> {
    fn add(&mut self, row: &'a Success) {
        let counts = self.0.entry(&row.object).or_default();
        counts.candidates += row.verdicts.total_count();
        counts.draws += row.draws_n;
        counts.successes += row.verdicts.success_count();
    }

    fn sum(&self, number: fn(&Counts) -> i64) -> i64 {
        self.0.values().map(number).sum()
    }

    /// Returns the means over the objects of the shares of candidates and of draws that succeed.
    fn means(&self) -> [MeanInterval; 2] {
        [
            self.mean(|counts| counts.candidates),
            self.mean(|counts| counts.draws),
        ]
    }

    /// Returns the mean over the objects of the share that succeeds of what is counted; objects with
    /// nothing of it are left out.
    fn mean(&self, of: fn(&Counts) -> i64) -> MeanInterval {
        let counted = self.0.values().filter(|counts| of(counts) > 0);
        let shares = counted.map(|counts| counts.successes as f64 / of(counts) as f64);
        bootstrap_mean(&shares.collect::<Vec<f64>>())
    }
}

/// Returns one row for each generator, origin and split, and one for all origins together.
fn rates(successes: &[Success], config: &ScreenConfig) -> SuccessRates {
    let ScreenConfig {
        scene, protocol, ..
    } = config;
    let mut groups: BTreeMap<(&str, &str, Option<ObjectSplit>), ByObject> = BTreeMap::new();
    for row in successes {
        for origin in [ALL_ORIGINS, row.origin.as_str()] {
            let group = groups.entry((&row.generator, origin, row.object_split));
            group.or_default().add(row);
        }
    }
    let rate = |((generator, origin, object_split), objects): (_, ByObject)| {
        let [by_candidate, by_draw] = objects.means();
        let candidates_n = objects.sum(|counts| counts.candidates);
        let by_candidate = (candidates_n > 0).then_some(by_candidate);
        let (generator, origin): (&str, &str) = (generator, origin);
        Rate {
            generator: generator.to_owned(),
            origin: origin.to_owned(),
            object_split,
            protocol: protocol.name.as_str().to_owned(),
            approach: protocol.approach.as_str().to_owned(),
            squeeze_rad: protocol.squeeze_rad,
            friction: scene.friction,
            torque_limit_nm: scene.drive.torque_limit,
            object_mass: object_mass(scene),
            // No count in memory is larger than the largest `i64`.
            objects_n: i64::try_from(objects.0.len()).unwrap_or(i64::MAX),
            candidates_n,
            draws_n: objects.sum(|counts| counts.draws),
            successes_n: objects.sum(|counts| counts.successes),
            candidate_rate_mean: by_candidate.map(|mean| mean.mean),
            candidate_rate_low: by_candidate.map(|mean| mean.low),
            candidate_rate_high: by_candidate.map(|mean| mean.high),
            draw_rate_mean: by_draw.mean,
            draw_rate_low: by_draw.low,
            draw_rate_high: by_draw.high,
        }
    };
    groups.into_iter().map(rate).collect()
}

impl RatesMetrics {
    fn of(successes: &[Success], protocol: &Protocol) -> Self {
        let mut objects = ByObject::default();
        for row in successes {
            objects.add(row);
        }
        let [by_candidate, by_draw] = objects.means();
        Self {
            objects_n: objects.0.len() as f64,
            candidate_rate_mean: by_candidate.mean,
            candidate_rate_low: by_candidate.low,
            candidate_rate_high: by_candidate.high,
            draw_rate_mean: by_draw.mean,
            draw_rate_low: by_draw.low,
            draw_rate_high: by_draw.high,
            approach_n: f64::from(protocol.approach as u8),
            squeeze_rad: protocol.squeeze_rad,
            protocol_n: f64::from(protocol.name as u8),
        }
    }
}

/// Returns the masses of the objects in words.
fn object_mass(scene: &SceneConfig) -> String {
    let mass = match scene.object_mass() {
        ObjectMass::Measured => "measured".to_owned(),
        ObjectMass::Kilograms(mass_kg) => format!("{mass_kg} kg"),
        ObjectMass::Density(density) => format!("{density} kg/m³"),
    };
    if (scene.mass_scale - 1.0).abs() < f64::EPSILON {
        mass
    } else {
        format!("{mass}, times {}", scene.mass_scale)
    }
}

/// Says how often candidates succeed by object, and what of that was scripted.
fn line(summary: &Summary<RatesMetrics>) -> String {
    let all = &summary.metrics;
    let percent = |share: f64| 100.0 * share;
    let is = |number: u8, place: f64| (f64::from(number) - place).abs() < 0.5;
    let mut approaches = Approach::ALL.into_iter();
    let approach = approaches.find(|approach| is(*approach as u8, all.approach_n));
    let approach = approach.map_or("", Approach::as_str);
    let squeeze = (all.squeeze_rad > 0.0).then(|| format!("squeeze {} rad", all.squeeze_rad));
    let named = ProtocolName::ALL
        .into_iter()
        .find(|name| is(*name as u8, all.protocol_n));
    let protocol = match named {
        Some(name) if !name.is_own() => name.as_str().to_owned(),
        Some(ProtocolName::TableLift) | None => {
            let squeeze = squeeze.unwrap_or_else(|| "no scripted squeeze".to_owned());
            format!("{approach}, {squeeze}")
        }
        // A line has 100 columns: what is not said was not there.
        Some(name) => {
            let squeeze = squeeze.map_or(String::new(), |squeeze| format!(", {squeeze}"));
            format!("{}, {approach}{squeeze}", name.as_str())
        }
    };
    format!(
        "{} object{}: mean {:.1} % (95 % CI {:.0} to {:.0}); {}",
        all.objects_n,
        if is(1, all.objects_n) { "" } else { "s" },
        percent(all.candidate_rate_mean),
        percent(all.candidate_rate_low),
        percent(all.candidate_rate_high),
        protocol,
    )
}

/// Draws the objects' means with their intervals, by candidate and by draw.
fn chart(rates: &[Rate]) -> Option<String> {
    let name = |rate: &Rate| {
        let split = rate.object_split.map_or("", ObjectSplit::as_str);
        format!("{}, {} {split}", rate.generator, rate.origin)
            .trim_end()
            .to_owned()
    };
    let names: Vec<String> = rates.iter().map(name).collect();
    let series = |title: &str, ends: fn(&Rate) -> Option<[f64; 3]>| {
        let estimate = |rate: &Rate| {
            let [value, low, high] = ends(rate)?.map(|share| 100.0 * share);
            Some(Estimate { value, low, high })
        };
        Estimates {
            name: title.to_owned(),
            values: names
                .iter()
                .cloned()
                .zip(rates.iter().map(estimate))
                .filter_map(|(name, estimate)| Some((name, estimate?)))
                .collect(),
        }
    };
    let series = [
        series("by candidate", Rate::by_candidate),
        series("by sample", |rate| Some(rate.by_draw())),
    ];
    let captions = Captions {
        title: "Motions that succeed, mean over objects",
        x: "share with its 95 % interval by resampling objects [%]",
        y: "",
    };
    intervals(&captions, &names, &series)
}

#[cfg(test)]
mod tests {
    use schemas::{candidates::Origin, rollouts::Verdict};

    use super::*;

    fn config() -> ScreenConfig {
        let config = serde_json::json!({
            "hand": "hand.urdf",
            "scene": {"drive": {
                "stiffness": 20.0, "damping": 1.0, "torque_limit": 0.7, "armature": 0.001,
            }},
            "protocol": {"flexion_joints": ["j"], "approach": "follow"},
        });
        serde_json::from_value(config).unwrap()
    }

    fn protocol() -> Protocol {
        config().protocol
    }

    fn row(object: &str, origin: Origin, [held_n, failed_n, draws_n]: [i64; 3]) -> Success {
        Success {
            object: object.to_owned(),
            generator: "cgf".to_owned(),
            origin,
            object_split: Some(ObjectSplit::Seen),
            verdicts: [(Verdict::Held, held_n), (Verdict::Dropped, failed_n)]
                .into_iter()
                .collect(),
            draws_n,
            control_steps_n: 0,
            spread_palm_m: None,
            spread_palm_rad: None,
            spread_q_rad: None,
            spread_n: 0,
        }
    }

    #[test]
    fn rates_are_pooled_and_means_over_objects_by_candidate_and_by_draw() {
        let mut successes = vec![
            row("box", Origin::Prior, [1, 3, 16]),
            row("box", Origin::Posterior, [6, 0, 8]),
            row("can", Origin::Posterior, [10, 10, 40]),
            // All draws of the cup were refused but those from posteriors.
            row("cup", Origin::Prior, [0, 0, 4]),
        ];
        successes.push(Success {
            object_split: Some(ObjectSplit::Unseen),
            ..row("mug", Origin::Prior, [3, 1, 12])
        });
        let rates = rates(&successes, &config());
        let keys = rates
            .iter()
            .map(|rate| (rate.origin.as_str(), rate.object_split.unwrap().as_str()));
        let expected = [
            ("all", "seen"),
            ("all", "unseen"),
            ("posterior", "seen"),
            ("prior", "seen"),
            ("prior", "unseen"),
        ];
        assert_eq!(keys.collect::<Vec<_>>(), expected);
        let all = &rates[0];
        let counts = [
            all.objects_n,
            all.candidates_n,
            all.draws_n,
            all.successes_n,
        ];
        assert_eq!(counts, [3, 30, 68, 17]);
        // 7 of 10 of the box and 10 of 20 of the can; of draws 7 of 24, 10 of 40 and 0 of 4.
        assert!((all.candidate_rate_mean.unwrap() - 0.6).abs() < 1e-12);
        let by_draw = (7.0 / 24.0 + 0.25) / 3.0;
        assert!((all.draw_rate_mean - by_draw).abs() < 1e-12);
        let ends = [all.candidate_rate_low, all.candidate_rate_high].map(Option::unwrap);
        let expected = bootstrap_mean(&[0.7, 0.5]);
        assert_eq!(ends, [expected.low, expected.high]);
        let prior = &rates[3];
        assert_eq!(
            (prior.objects_n, prior.candidate_rate_mean),
            (2, Some(0.25))
        );
        assert_eq!((all.approach.as_str(), all.squeeze_rad), ("follow", 0.15));
        let svg = chart(&rates).unwrap();
        for name in ["cgf, all seen", "cgf, prior unseen", "by sample"] {
            assert!(svg.contains(&format!(">{name}</text>")), "{name}");
        }
    }

    #[test]
    fn the_line_names_the_mean_over_objects_and_the_script() {
        let objects = ["a", "b", "c", "d", "e", "f"];
        let rows: Vec<Success> = objects
            .iter()
            .zip([2, 9, 5, 4, 10, 7])
            .map(|(object, held_n)| row(object, Origin::Prior, [held_n, 10 - held_n, 20]))
            .collect();
        let said = |protocol: &Protocol| line(&Summary::made(&[RatesMetrics::of(&rows, protocol)]));
        let text = said(&protocol());
        let (begin, end) = (
            "6 objects: mean 61.7 % (95 % CI ",
            "); follow, squeeze 0.15 rad",
        );
        assert!(text.starts_with(begin) && text.ends_with(end), "{text}");
        // With its place, its stage and its time it fits 100 columns.
        assert!(text.chars().count() <= 72, "{text}");
        let open = Protocol {
            approach: Approach::Open,
            squeeze_rad: 0.0,
            ..protocol()
        };
        assert!(
            said(&open).ends_with("; open, no scripted squeeze"),
            "{}",
            said(&open)
        );
        let placed = Protocol {
            approach: Approach::AtGrasp,
            ..protocol()
        };
        assert!(said(&placed).ends_with("; at_grasp, squeeze 0.15 rad"));
        let every_contact = Protocol {
            name: ProtocolName::FullContact,
            squeeze_rad: 0.0,
            ..protocol()
        };
        assert!(said(&every_contact).ends_with("); full_contact, follow"));
        let published = Protocol {
            name: ProtocolName::DexgraspbenchForceClosure,
            ..protocol()
        };
        let text = said(&published);
        assert!(
            text.ends_with("; dexgraspbench_force_closure") && text.chars().count() <= 72,
            "{text}"
        );
    }

    #[test]
    fn rates_say_under_which_friction_torque_and_mass() {
        let successes = [row("box", Origin::Prior, [1, 3, 16])];
        let said = |name: ProtocolName| {
            let mut config = config();
            config.protocol.name = name;
            let rate = rates(&successes, &config.resolved()).remove(0);
            let place = rate.approach == "at_grasp";
            (rate.friction, rate.torque_limit_nm, rate.object_mass, place)
        };
        let own = said(ProtocolName::TableLift);
        assert_eq!(own, (1.0, 0.7, "measured".to_owned(), false));
        let tabletop = said(ProtocolName::DexgraspbenchTabletop);
        assert_eq!(tabletop, (0.6, 1000.0, "0.1 kg".to_owned(), true));
        let get_a_grip = said(ProtocolName::GetAGrip);
        assert_eq!(get_a_grip, (0.9, 15.0, "500 kg/m³".to_owned(), true));
    }

    #[test]
    fn one_unit_reads_the_table_of_successes() {
        let all = Partition::new("all".parse().unwrap(), BTreeMap::new());
        let scope = Scope::new(BTreeMap::from([(Successes::NAME.to_owned(), vec![all])]));
        let units = units(&scope);
        assert_eq!(units.len(), 1);
        assert_eq!(units[0].reads[Successes::NAME], ["all"]);
        assert!(super::units(&Scope::default()).is_empty());
    }
}
