//! The paper's tables beside this run's figures.
//!
//! The paper's numbers are those of Ye et al., *Learning Continuous Grasping Function with a Dexterous Hand from
//! Human Demonstrations*, RA-L 2023, tables I to V, as printed. A mark (≠) stands where the protocols differ, with
//! how each was measured.

use schemas::{
    candidates::ObjectSplit,
    executions::Outcome,
    rollouts::Verdict,
    smoothness::{Smoothness, Variation, Variations},
    tally::OutcomeClass,
};

use crate::{
    PageData,
    table::{Cell, DataTable, Section},
};

/// Table I: position; logarithm of velocity and of acceleration, of joints, then of links in space.
const SMOOTHNESS: [(&str, [f64; 6]); 4] = [
    ("GraspTTA + RRT", [3.40, 3.43, 6.47, 9.71, 3.95, 6.99]),
    ("GraspTTA + CEM-MPC", [7.42, 3.12, 5.54, 16.36, 3.48, 5.90]),
    ("CGF", [10.42, 2.06, 3.51, 6.69, 1.99, 3.47]),
    (
        "linear interpolation",
        [1.00, -3.58, -1.99, 1.96, 0.70, 1.38],
    ),
];
/// Table II: logarithm of the cost of a success of seen and of unseen objects.
const COST: [(&str, [f64; 2], &str); 3] = [
    ("GraspTTA + RRT", [5.30, 4.97], "collision checks"),
    ("GraspTTA + CEM-MPC", [5.85, 5.58], "environment steps"),
    ("CGF", [4.30, 4.19], "environment steps, 65 for each trial"),
];
/// Table III: success on the real robot in percent, of 20 trials each.
const REAL: [(&str, &str, &str, [f64; 4]); 6] = [
    ("011_banana", "Banana", "unseen", [10.0, 10.0, 60.0, 70.0]),
    (
        "021_bleach_cleanser",
        "Bleach cleanser",
        "unseen",
        [15.0, 10.0, 65.0, 85.0],
    ),
    (
        "010_potted_meat_can",
        "Potted meat can",
        "seen",
        [10.0, 15.0, 50.0, 70.0],
    ),
    (
        "005_tomato_soup_can",
        "Tomato soup can",
        "seen",
        [5.0, 5.0, 50.0, 80.0],
    ),
    (
        "006_mustard_bottle",
        "Mustard bottle",
        "seen",
        [5.0, 0.0, 65.0, 85.0],
    ),
    (
        "056_tennis_ball",
        "Ball",
        "unseen",
        [10.0, 15.0, 40.0, 65.0],
    ),
];

pub(crate) fn section(gathered: &PageData) -> Section {
    let mut section = Section::new("paper", "Beside the paper");
    section.say(
        "Figures of Ye et al. (Learning Continuous Grasping Function with a Dexterous Hand from Human \
         Demonstrations, RA-L 2023) as printed, and this run's. ≠ marks a figure of this run that was measured by \
         another protocol than the paper's; it says how where it is pointed at, and in the last column.",
    );
    if gathered.smoothness.is_empty() {
        section
            .say("Table I has the paper's figures alone: no `smoothness` is wired to this report.");
    }
    section.tables.push(smoothness(gathered));
    section.tables.push(cost(gathered));
    section.tables.push(real(gathered));
    section.say(
        "`pipeline run pipelines/studies/paper_tables.toml` makes all five tables of the paper, also IV (feedforward control) and \
         V (noise), beside planners.",
    );
    section
}

fn paper_number(number: f64) -> Cell {
    Cell::Number(number, format!("{number:.2}"))
}

/// Takes one definition of smoothness.
type Definition = fn(&Smoothness) -> &Variations;

fn smoothness(gathered: &PageData) -> DataTable {
    let mut table = DataTable::new(
        "paper_smoothness",
        "Table I, smoothness: total variation of position; log₁₀ of that of velocity and of acceleration",
        &[
            ("method", "Method"),
            ("joints_position", "Joints: position"),
            ("joints_velocity", "velocity"),
            ("joints_acceleration", "acceleration"),
            ("links_position", "Links: position"),
            ("links_velocity", "velocity"),
            ("links_acceleration", "acceleration"),
            ("how", "How it was measured"),
        ],
    );
    for (method, numbers) in SMOOTHNESS {
        let mut row = vec![Cell::text(method)];
        row.extend(numbers.map(paper_number));
        row.push(Cell::text("paper, table I"));
        table.row(row);
    }
    let motions: Vec<&Smoothness> = gathered
        .smoothness
        .values()
        .flatten()
        .map(|one| &one.drawn)
        .filter(|drawn| **drawn != Smoothness::default())
        .collect();
    if motions.is_empty() {
        return table;
    }
    let mean = |number: &dyn Fn(&Smoothness) -> f64| {
        motions.iter().map(|one| number(one)).sum::<f64>() / motions.len() as f64
    };
    let definitions: [(&str, &str, Definition); 2] = [
        (
            "this run, the paper's definition",
            "mean over all candidates of this run's objects; other objects, motions and count of steps",
            |one| &one.paper,
        ),
        (
            "this run, as the released code computes it",
            "the same, with the released code's mistakes",
            |one| &one.released,
        ),
    ];
    for (name, how, of) in definitions {
        let mut row = vec![Cell::text(name)];
        let spaces: [fn(&Variations) -> &Variation; 2] = [|all| &all.joints, |all| &all.cartesian];
        for space in spaces {
            let position = mean(&|one| space(of(one)).position);
            let velocity = mean(&|one| space(of(one)).velocity).log10();
            let acceleration = mean(&|one| space(of(one)).acceleration).log10();
            for number in [position, velocity, acceleration] {
                row.push(if number.is_finite() {
                    Cell::Marked(format!("{number:.2}"), how.to_owned())
                } else {
                    Cell::Missing
                });
            }
        }
        row.push(Cell::text(how));
        table.row(row);
    }
    table
}

fn cost(gathered: &PageData) -> DataTable {
    let mut table = DataTable::new(
        "paper_cost",
        "Table II, log₁₀ of the cost of a success",
        &[
            ("method", "Method"),
            ("seen", "Seen objects"),
            ("unseen", "Unseen objects"),
            ("how", "How it was measured"),
        ],
    );
    for (method, [seen, unseen], unit) in COST {
        table.row([
            Cell::text(method),
            paper_number(seen),
            paper_number(unseen),
            Cell::text(format!("paper, table II: {unit}")),
        ]);
    }
    let how = "control steps of this project's screen, which ends a motion as soon as its verdict is certain; \
               samples that were refused before the screen cost none";
    let of = |split: ObjectSplit| {
        let rows = || {
            gathered
                .successes
                .iter()
                .filter(|row| row.object_split == Some(split))
        };
        let steps_n: i64 = rows().map(|row| row.control_steps_n).sum();
        let successes_n: i64 = rows().map(|row| row.verdicts.success_count()).sum();
        if successes_n == 0 || steps_n == 0 {
            return Cell::Missing;
        }
        let cost = (steps_n as f64 / successes_n as f64).log10();
        Cell::Marked(format!("{cost:.2}"), how.to_owned())
    };
    if !gathered.successes.is_empty() {
        table.row([
            Cell::text("this run"),
            of(ObjectSplit::Seen),
            of(ObjectSplit::Unseen),
            Cell::text(how),
        ]);
    }
    table
}

fn real(gathered: &PageData) -> DataTable {
    let mut table = DataTable::new(
        "paper_real",
        "Table III, success on the robot",
        &[
            ("object", "Object"),
            ("split", "Paper's split"),
            ("g_rrt", "GraspTTA + RRT"),
            ("g_cem_mpc", "GraspTTA + CEM-MPC"),
            ("gi_rrt", "GraspIt + RRT"),
            ("cgf", "CGF"),
            ("executed", "This run, executed"),
            ("screened", "This run, screened"),
            ("how", "How this run's were measured"),
        ],
    );
    for (name, label, split, numbers) in REAL {
        let executions = gathered.executions.get(name).map_or(&[][..], Vec::as_slice);
        let trials: Vec<_> = executions
            .iter()
            .filter(|one| one.outcome.is_trial())
            .collect();
        let succeeded_n = trials
            .iter()
            .filter(|one| one.outcome == Outcome::Succeeded)
            .count();
        let is_simulated = trials.iter().all(|one| one.simulated);
        let place = if is_simulated {
            "a simulated cell, not a robot"
        } else {
            "a robot cell"
        };
        let executed = if trials.is_empty() {
            Cell::Missing
        } else {
            let rate = 100.0 * succeeded_n as f64 / trials.len() as f64;
            let text = format!("{rate:.0} % ({succeeded_n} of {})", trials.len());
            Cell::Marked(text, format!("{place}; the most robust motions"))
        };
        let rollouts = gathered.rollouts.get(name).map_or(&[][..], Vec::as_slice);
        let held_n = rollouts
            .iter()
            .filter(|one| one.verdict == Verdict::Held)
            .count();
        let screened = if rollouts.is_empty() {
            Cell::Missing
        } else {
            let rate = 100.0 * held_n as f64 / rollouts.len() as f64;
            let text = format!("{rate:.0} % ({held_n} of {})", rollouts.len());
            Cell::Marked(
                text,
                "all candidates in simulation, which the paper chose its trials from".to_owned(),
            )
        };
        let how = match (trials.is_empty(), rollouts.is_empty()) {
            (true, true) => "not in this run".to_owned(),
            (false, _) => format!("executed: {place}; screened: all candidates in simulation"),
            (true, false) => "screened: all candidates in simulation".to_owned(),
        };
        let mut row = vec![Cell::text(label), Cell::text(split)];
        row.extend(numbers.map(|number| Cell::Number(number, format!("{number:.0} %"))));
        row.extend([executed, screened, Cell::text(how)]);
        table.row(row);
    }
    table
}
