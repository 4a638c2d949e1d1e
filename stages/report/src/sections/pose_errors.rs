//! Success where the object lies off its estimated pose.

use std::collections::BTreeMap;

use charts::{Captions, Estimate, Estimates, intervals};
use schemas::{
    Table,
    pose_errors::{PoseErrorTrial, PoseErrors},
    rollouts::Verdict,
};
use statistics::{MeanInterval, bootstrap_mean};

use crate::{
    PageData,
    numbers::signed,
    table::{Cell, DataTable, Section},
};

/// Motions under errors of one size.
struct OfSize {
    position_mm: f64,
    yaw_deg: f64,
    trials_n: i64,
    held_n: i64,
    /// Over the objects.
    mean: MeanInterval,
}

impl OfSize {
    fn name(&self) -> String {
        let Self {
            position_mm,
            yaw_deg,
            ..
        } = self;
        match (*position_mm > 0.0, *yaw_deg > 0.0) {
            (false, true) => format!("{yaw_deg:.0}°"),
            (true, true) => format!("{position_mm:.0} mm and {yaw_deg:.0}°"),
            (_, false) => format!("{position_mm:.0} mm"),
        }
    }
}

/// Returns the motions of all objects by the size of the error, in the order of their trials.
fn by_size(all: &BTreeMap<String, Vec<PoseErrorTrial>>) -> Vec<OfSize> {
    let mut sizes: Vec<(f64, f64)> = Vec::new();
    for trial in all.values().flatten() {
        let size = (trial.position_m, trial.yaw_rad);
        if !sizes.contains(&size) {
            sizes.push(size);
        }
    }
    let of_size = |size: (f64, f64)| {
        let counts = all.values().map(|trials| {
            let trials = trials.iter();
            let trials = trials.filter(|trial| (trial.position_m, trial.yaw_rad) == size);
            let held = trials
                .clone()
                .filter(|trial| trial.verdict == Verdict::Held);
            (signed(trials.count()), signed(held.count()))
        });
        let counts: Vec<(i64, i64)> = counts.filter(|(trials_n, _)| *trials_n > 0).collect();
        let shares = counts.iter().map(|(n, held_n)| *held_n as f64 / *n as f64);
        OfSize {
            position_mm: 1000.0 * size.0,
            yaw_deg: size.1.to_degrees(),
            trials_n: counts.iter().map(|(n, _)| n).sum(),
            held_n: counts.iter().map(|(_, held_n)| held_n).sum(),
            mean: bootstrap_mean(&shares.collect::<Vec<f64>>()),
        }
    };
    sizes.into_iter().map(of_size).collect()
}

pub(crate) fn section(gathered: &PageData) -> Section {
    let mut section = Section::new("pose_errors", "Errors of the object's pose");
    let sizes = by_size(&gathered.pose_errors);
    if !gathered.facts.run.wired.contains_key(PoseErrors::NAME) {
        section.say("No trials with the object off its estimated pose are wired to this report.");
        return section;
    }
    if sizes.is_empty() {
        section.say("No motion was tried with the object off its estimated pose in this run.");
        return section;
    }
    section.say(
        "Motions are executed as if the object lay in its estimated pose. It lies off that by the given distance, in \
         a direction on the table that is drawn for each motion, and is turned by the given angle, one way or the \
         other. Motions count whether the screen accepted them or not. The rate is the mean over the objects; its \
         interval is by resampling objects.",
    );
    let names: Vec<String> = sizes.iter().map(OfSize::name).collect();
    let estimate = |size: &OfSize| {
        let MeanInterval { mean, low, high } = size.mean;
        let [value, low, high] = [mean, low, high].map(|share| 100.0 * share);
        Estimate { value, low, high }
    };
    let series = Estimates {
        name: "motions".to_owned(),
        values: names
            .iter()
            .cloned()
            .zip(sizes.iter().map(estimate))
            .collect(),
    };
    let captions = Captions {
        title: "Motions that succeed, by the error of the object's pose",
        x: "mean share of the motions, with its 95 % interval [%]",
        y: "",
    };
    section.chart(
        "Share of the motions that succeed, by the error of the object's pose",
        intervals(&captions, &names, &[series]),
    );
    let mut table = DataTable::new(
        "by_pose_error",
        "Motions, accepted or not, by the error of the object's estimated pose",
        &[
            ("position_mm", "Position [mm]"),
            ("yaw_deg", "Yaw [°]"),
            ("rate", "Rate"),
            ("interval", "95 % interval"),
            ("successes_n", "Successes"),
            ("n", "Of"),
        ],
    );
    for size in &sizes {
        let number = |value: f64| Cell::Number(value.round(), format!("{value:.0}"));
        table.row([
            number(size.position_mm),
            number(size.yaw_deg),
            Cell::share(size.mean.mean),
            Cell::interval([size.mean.low, size.mean.high]),
            Cell::count(size.held_n),
            Cell::count(size.trials_n),
        ]);
    }
    section.tables.push(table);
    section
}

#[cfg(test)]
mod tests {
    use dataflow::RunFacts;

    use super::*;
    use crate::Facts;

    #[test]
    fn objects_count_alike_and_each_size_has_a_name() {
        let trial = |position_m, yaw_rad, verdict| PoseErrorTrial {
            candidate_id: "motion".to_owned(),
            position_m,
            yaw_rad,
            verdict,
            control_steps_n: 1,
        };
        let (held, lost) = (Verdict::Held, Verdict::NotGrasped);
        let gathered = PageData {
            pose_errors: [
                (
                    "box",
                    vec![trial(0.0, 0.0, held), trial(0.005, 0.0873, lost)],
                ),
                (
                    "can",
                    vec![
                        trial(0.0, 0.0, held),
                        trial(0.0, 0.0, held),
                        trial(0.0, 0.0, lost),
                        trial(0.0, 0.0, lost),
                        trial(0.005, 0.0873, held),
                    ],
                ),
            ]
            .map(|(object, trials)| (object.to_owned(), trials))
            .into(),
            facts: Facts {
                run: RunFacts {
                    wired: [("pose_errors".to_owned(), "screen.pose_errors".to_owned())].into(),
                    ..RunFacts::default()
                },
                ..Facts::default()
            },
            ..PageData::default()
        };
        let sizes = by_size(&gathered.pose_errors);
        let found = sizes
            .iter()
            .map(|size| (size.name(), size.held_n, size.trials_n, size.mean.mean));
        let expected = [
            ("0 mm".to_owned(), 3, 5, 0.75),
            ("5 mm and 5°".to_owned(), 1, 2, 0.5),
        ];
        assert_eq!(found.collect::<Vec<_>>(), expected);
        let page = section(&gathered);
        assert_eq!((page.charts.len(), page.tables[0].rows.len()), (1, 2));
        assert!(section(&PageData::default()).tables.is_empty());
    }
}
