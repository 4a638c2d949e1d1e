//! Success rates of each object's candidates, by generator and origin.

use std::collections::{BTreeMap, BTreeSet};

use charts::{Captions, Estimate, Estimates, intervals};
use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, OptionsUsed, Outcome, Output, Scope, Sum, Summary, Unit,
};
use diversity::{ComparedMotion, Diversity};
use lake::{LakeError, WriteArtifact, table};
use schemas::{
    Table,
    candidates::{Candidate, Candidates, DrawSource, ObjectSplit, Origin},
    draws::{Draw, Draws},
    rollouts::{Rollout, Rollouts, Verdict},
    success::{Success, Successes},
};

use crate::{Screen, ScreenConfig, ScreenError};

/// Key of the one partition.
const ALL: &str = "all";

dataflow::metrics! {
    /// Metrics of all candidates together.
    pub struct SuccessMetrics {
        /// Number of objects.
        objects_n: Sum,
        /// Number of candidates.
        candidates_n: Sum,
        /// Number of draws made for them, refused ones included.
        draws_n: Sum,
        /// Number of candidates that succeed.
        accepted_n: Sum,
        /// Steps of control that physics took.
        control_steps_n: Sum,
        /// Number of candidates that touched the object.
        touched_n: Sum,
        /// Number of those that would exceed a joint's limit.
        limit_n: Sum,
        /// Number of those that would go through the table.
        table_n: Sum,
        /// Number of those that the hand cannot execute.
        infeasible_n: Sum,
    }
    derived {
        candidate_rate: Self::candidate_rate,
        draw_rate: Self::draw_rate,
    }
}

/// The report `success`: how often candidates succeed.
pub struct SuccessReport;

impl Output for SuccessReport {
    type Stage = Screen;
    type Metrics = SuccessMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = Successes::NAME;
    const SCHEMA: &'static str = Successes::VERSION;
    const PARTITION: &'static str = Successes::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::NONE;
    const LINE: Option<Line<SuccessMetrics>> = Some(line);

    fn units(_config: &ScreenConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        Ok(units(scope))
    }

    /// Makes the table and its chart.
    fn make(
        _config: &ScreenConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<SuccessMetrics>, BoxedDiagnostic> {
        let mut rows = Vec::new();
        let mut touched_n = 0;
        for artifact in inputs.artifacts(Rollouts::NAME) {
            let mut given = inputs.artifacts(Candidates::NAME).iter();
            let given = given.find(|given| given.key == artifact.key);
            let given = given.ok_or(LakeError::MissingInput {
                what: Candidates::NAME,
            })?;
            let rollouts: Rollouts = table::read(artifact)?;
            touched_n += rollouts.iter().filter(|rollout| touched(rollout)).count();
            let draws = table::read_draws(given)?;
            rows.extend(of_object(&rollouts, &table::read(given)?, &draws)?);
        }
        cx.write(&rows)?;
        cx.write_chart("rates", chart(&rows))?;
        Ok(Outcome::Made(SuccessMetrics::of(&rows, touched_n)))
    }
}

/// One unit, of all objects whose candidates were screened.
fn units(scope: &Scope) -> Vec<Unit> {
    let screened = scope.partitions(Rollouts::NAME).iter();
    let keys: Vec<&str> = screened.map(|rollouts| rollouts.key.as_str()).collect();
    if keys.is_empty() {
        return Vec::new();
    }
    let file = [lake::table::FILE];
    let unit = Unit::new(ALL)
        .reading(Rollouts::NAME, keys.clone())
        .only_files(Rollouts::NAME, file)
        .reading(Candidates::NAME, keys)
        .only_files(Candidates::NAME, [lake::table::FILE, Draws::FILE]);
    vec![unit]
}

/// Says whether the hand touched the object, as far as its figures tell: it moved it, or was in contact
/// with it when it was to be lifted.
fn touched(rollout: &Rollout) -> bool {
    match rollout.verdict {
        Verdict::Limit | Verdict::Table | Verdict::Infeasible => false,
        Verdict::NotGrasped | Verdict::Diverged => {
            rollout.measures.contacts_n > Some(0) || rollout.measures.penetration_m > Some(0.0)
        }
        Verdict::Held
        | Verdict::EarlyContact
        | Verdict::KnockedOver
        | Verdict::Slipped
        | Verdict::TooDeep
        | Verdict::Overloaded
        | Verdict::Dropped => true,
    }
}

/// Says how often candidates succeed, of whichever object.
fn line(summary: &Summary<SuccessMetrics>) -> String {
    let all = &summary.metrics;
    let [by_candidate, by_draw] = [all.candidate_rate(), all.draw_rate()].map(|rate| 100.0 * rate);
    let mut line = format!("{by_candidate:.1} % of candidates succeed, {by_draw:.1} % of samples");
    if all.touched_n == 0.0 && all.candidates_n > 0.0 {
        line += &untouched(all);
    }
    line
}

/// Says what became of motions of which none touched its object.
fn untouched(all: &SuccessMetrics) -> String {
    let became = [
        (all.limit_n, "would exceed a joint's limit"),
        (all.table_n, "would go through the table"),
        (all.infeasible_n, "cannot be executed"),
        (
            all.candidates_n - all.limit_n - all.table_n - all.infeasible_n,
            "closed beside it",
        ),
    ];
    let became: Vec<String> = became
        .iter()
        .filter(|(n, _)| *n > 0.0)
        .map(|(n, what)| format!("{n:.0} {what}"))
        .collect();
    format!("; no motion touched the object: {}", became.join(", "))
}

/// Key of a motion's row: its generator, its origin, the split of the object.
type Key<'a> = (&'a str, Origin, Option<ObjectSplit>);

/// The motions of a row.
#[derive(Default)]
struct Group<'a> {
    draws_n: i64,
    rollouts: Vec<(&'a Rollout, &'a Candidate)>,
}

fn key<'a>(generator: &'a str, source: &DrawSource) -> Key<'a> {
    (generator, source.origin, source.object_split)
}

/// Returns one row for each generator and origin of an object's draws, in the order of their names.
fn of_object(
    rollouts: &[Rollout],
    given: &Candidates,
    draws: &[Draw],
) -> Result<Vec<Success>, ScreenError> {
    let resolved: BTreeMap<&str, &Candidate> = given
        .candidates
        .iter()
        .map(|candidate| (candidate.candidate_id.as_str(), candidate))
        .collect();
    let mut groups: BTreeMap<Key, Group> = BTreeMap::new();
    for rollout in rollouts {
        let name = rollout.candidate_id.as_str();
        let candidate = *resolved
            .get(name)
            .ok_or_else(|| ScreenError::UnknownCandidate {
                partition: given.object.clone(),
                candidate: name.to_owned(),
            })?;
        let key = key(&rollout.generator, &candidate.source);
        let kept = groups.entry(key).or_default();
        kept.rollouts.push((rollout, candidate));
    }
    let judged: BTreeMap<&str, &str> = rollouts
        .iter()
        .map(|rollout| (rollout.candidate_id.as_str(), rollout.generator.as_str()))
        .collect();
    for draw in draws {
        let id = draw.candidate_id.as_str();
        let generator = judged.get(id).copied().unwrap_or(&draw.generator);
        groups
            .entry(key(generator, &draw.source))
            .or_default()
            .draws_n += 1;
    }
    let row = |(key, group): (Key, Group)| group.row(&given.object, key);
    Ok(groups.into_iter().map(row).collect())
}

impl Group<'_> {
    fn row(&self, object: &str, (generator, origin, object_split): Key) -> Success {
        let rollouts = || self.rollouts.iter().map(|(rollout, _)| rollout);
        let held = self
            .rollouts
            .iter()
            .filter(|(r, _)| r.verdict == Verdict::Held);
        let grasps: Vec<ComparedMotion> = held.map(|(_, candidate)| grasp(candidate)).collect();
        let diversity = Diversity::of(&grasps);
        let spread = (diversity.compared_n > 0).then_some(diversity.at_grasp);
        Success {
            object: object.to_owned(),
            generator: generator.to_owned(),
            origin,
            object_split,
            verdicts: rollouts().map(|r| (r.verdict, 1)).collect(),
            draws_n: self.draws_n,
            control_steps_n: rollouts()
                .map(|r| i64::from(r.measures.control_steps_n))
                .sum(),
            spread_palm_m: spread.map(|spread| spread.palm_m),
            spread_palm_rad: spread.map(|spread| spread.palm_rad),
            spread_q_rad: spread.map(|spread| spread.q_rad),
            // No count in memory is larger than the largest `i64`.
            spread_n: i64::try_from(diversity.compared_n).unwrap_or(i64::MAX),
        }
    }
}

/// The last step of a motion, without the others.
fn grasp(candidate: &Candidate) -> ComparedMotion<'_> {
    ComparedMotion {
        table_from_object: candidate.table_from_object,
        steps: vec![candidate.motion.grasp()],
    }
}

impl SuccessMetrics {
    fn of(rows: &[Success], touched_n: usize) -> Self {
        let sum = |number: &dyn Fn(&Success) -> i64| rows.iter().map(number).sum::<i64>() as f64;
        Self {
            objects_n: objects(rows).len() as f64,
            candidates_n: sum(&|row| row.verdicts.total_count()),
            draws_n: sum(&|row| row.draws_n),
            accepted_n: sum(&|row| row.verdicts.success_count()),
            control_steps_n: sum(&|row| row.control_steps_n),
            touched_n: touched_n as f64,
            limit_n: sum(&|row| row.verdicts.count(Verdict::Limit)),
            table_n: sum(&|row| row.verdicts.count(Verdict::Table)),
            infeasible_n: sum(&|row| row.verdicts.count(Verdict::Infeasible)),
        }
    }

    /// Share of the candidates that succeed.
    fn candidate_rate(&self) -> f64 {
        self.accepted_n / self.candidates_n.max(1.0)
    }

    /// Share of the draws that succeed.
    fn draw_rate(&self) -> f64 {
        self.accepted_n / self.draws_n.max(1.0)
    }
}

/// The objects of the rows, each once, in their order.
fn objects(rows: &[Success]) -> Vec<String> {
    let mut objects: Vec<String> = rows.iter().map(|row| row.object.clone()).collect();
    objects.dedup();
    objects
}

/// Draws how often the candidates of each object succeed, with the interval of each share.
fn chart(rows: &[Success]) -> Option<String> {
    let objects = objects(rows);
    let rows = || rows.iter().filter(|row| row.verdicts.total_count() > 0);
    let key = |row: &Success| (row.generator.clone(), row.origin);
    let keys: BTreeSet<(String, Origin)> = rows().map(key).collect();
    let estimate = |row: &Success| {
        let [low, high] = row.verdicts.interval().map(|end| 100.0 * end);
        Estimate {
            value: 100.0 * row.verdicts.rate().unwrap_or_default(),
            low,
            high,
        }
    };
    let series = keys.iter().map(|one| Estimates {
        name: format!("{}, {}", one.0, one.1.as_str()),
        values: rows()
            .filter(|row| key(row) == *one)
            .map(|row| (row.object.clone(), estimate(row)))
            .collect(),
    });
    let series: Vec<Estimates> = series.collect();
    let title = match &series[..] {
        [only] => format!("Candidates that succeed, by object ({})", only.name),
        _ => "Candidates that succeed, by object".to_owned(),
    };
    let captions = Captions {
        title: &title,
        x: "share of the candidates, with its 95 % interval [%]",
        y: "",
    };
    intervals(&captions, &objects, &series)
}

#[cfg(test)]
mod tests {
    use dataflow::{Metrics, Partition};
    use motion::{HandRates, Step};
    use nalgebra::{Isometry3, Vector3};
    use schemas::{draws::Refusal, rollouts::Measures};
    use spatial::Pose;

    use super::*;

    /// A motion for an object tilted by `tilt_rad`, that ends at `x`, turned by `angle` about z, its joints at `q`.
    fn motion(name: &str, tilt_rad: f64, x: f64, angle: f64, q: f64) -> Candidate {
        let step = |time_s: f64, x: f64, q: f64| Step {
            time_s,
            frame_from_palm: Pose::new(Isometry3::new(
                Vector3::new(x, 0.0, 0.1),
                Vector3::z() * angle,
            )),
            q_rad: vec![q, q],
            rates: HandRates::zero(2),
        };
        Candidate {
            candidate_id: name.to_owned(),
            generator: "whatever".to_owned(),
            source: DrawSource::replayed("a"),
            latent: Vec::new(),
            table_from_object: Pose::new(Isometry3::rotation(Vector3::x() * tilt_rad)),
            limit_excess_rad: 0.0,
            depth_m: None,
            residual_m2: None,
            motion: motion::Motion::new(&["j", "k"], vec![step(0.0, 9.0, 9.0), step(1.0, x, q)])
                .unwrap(),
        }
    }

    fn rollout(name: &str, generator: &str, verdict: Verdict) -> Rollout {
        Rollout {
            generator: generator.to_owned(),
            measures: Measures {
                control_steps_n: 100,
                ..Measures::default()
            },
            ..Rollout::unsimulated(&motion(name, 0.0, 0.0, 0.0, 0.0), verdict)
        }
    }

    /// The draws of the candidates that were judged, one each.
    fn kept(rollouts: &[Rollout]) -> Vec<Draw> {
        let candidates = given().candidates.into_iter();
        let judged = candidates.filter(|candidate| {
            let mut rollouts = rollouts.iter();
            rollouts.any(|rollout| rollout.candidate_id == candidate.candidate_id)
        });
        judged.map(|candidate| Draw::kept(&candidate)).collect()
    }

    fn given() -> Candidates {
        Candidates {
            object: "can".to_owned(),
            joints: ["j".to_owned(), "k".to_owned()].into(),
            candidates: vec![
                motion("a", 0.0, 0.02, 0.3, 0.2),
                motion("b", 0.0, 8.0, 3.0, 8.0),
                motion("c", 0.0, -0.02, -0.3, -0.2),
                // The can lies: there is nothing to compare it with.
                motion("d", 1.5, 7.0, 1.0, 7.0),
                motion("e", 0.0, 5.0, 1.0, 5.0),
            ],
        }
    }

    #[test]
    fn rows_are_by_generator_and_spread_is_that_of_the_grasps_that_hold() {
        let rollouts = [
            rollout("a", "cgf", Verdict::Held),
            rollout("b", "cgf", Verdict::Dropped),
            rollout("c", "cgf", Verdict::Held),
            rollout("d", "cgf", Verdict::Held),
            rollout("e", "another", Verdict::Table),
        ];
        let rows = of_object(&rollouts, &given(), &kept(&rollouts)).unwrap();
        let [another, cgf] = &rows[..] else {
            panic!("{rows:?}");
        };
        let names = [another, cgf].map(|row| (row.object.as_str(), row.generator.as_str()));
        assert_eq!(names, [("can", "another"), ("can", "cgf")]);
        assert_eq!(
            (cgf.verdicts.total_count(), cgf.verdicts.success_count()),
            (4, 3)
        );
        assert_eq!(cgf.verdicts.count(Verdict::Dropped), 1);
        assert_eq!(cgf.control_steps_n, 400);
        assert_eq!(cgf.spread_n, 2);
        let near = |found: f64, expected: f64| {
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        };
        near(cgf.spread_palm_m.unwrap(), 0.02);
        near(cgf.spread_palm_rad.unwrap(), 0.3);
        near(cgf.spread_q_rad.unwrap(), 0.2);
        assert_eq!((another.verdicts.success_count(), another.spread_n), (0, 0));
        assert_eq!(another.verdicts.count(Verdict::Table), 1);
        assert_eq!(another.control_steps_per_success(), None);
        assert_eq!(another.spread_palm_m, None);
        assert_eq!((another.draws_n, cgf.draws_n), (1, 4));
        let metrics = SuccessMetrics::of(&rows, 4);
        assert_eq!((metrics.touched_n, metrics.table_n), (4.0, 1.0));
        assert_eq!(metrics.objects_n, 1.0);
        assert_eq!((metrics.accepted_n, metrics.candidates_n), (3.0, 5.0));
        let figures = metrics.metric_values();
        assert_eq!(
            (figures["candidate_rate"], figures["draw_rate"]),
            (0.6, 0.6)
        );
        let svg = chart(&rows).unwrap();
        for name in ["can", "cgf, demonstration", "another, demonstration"] {
            assert!(svg.contains(&format!(">{name}</text>")), "{name}");
        }
    }

    #[test]
    fn every_draw_counts_for_the_origin_of_its_own_code() {
        let source = |origin: Origin, draw_n: u32| DrawSource {
            draw_n,
            origin,
            object_split: Some(ObjectSplit::Seen),
            ..DrawSource::replayed("a")
        };
        let mut given = given();
        let [a, b, ..] = &mut given.candidates[..] else {
            panic!("there are five");
        };
        a.source = source(Origin::Posterior, 3);
        b.source = source(Origin::Posterior, 1);
        let refused = |origin: Origin, draw_n: u32| Draw {
            source: source(origin, draw_n),
            ..Draw::refused(a, Refusal::Object)
        };
        let draws = [
            refused(Origin::Prior, 1),
            refused(Origin::Posterior, 2),
            Draw::kept(a),
            Draw::kept(b),
        ];
        let rollouts = [
            rollout("a", "cgf", Verdict::Held),
            rollout("b", "cgf", Verdict::Dropped),
        ];
        let rows = of_object(&rollouts, &given, &draws).unwrap();
        let counts = rows.iter().map(|row| {
            let verdicts = &row.verdicts;
            let counts = [
                verdicts.success_count(),
                verdicts.total_count(),
                row.draws_n,
            ];
            (row.origin, counts)
        });
        let expected = [(Origin::Prior, [0, 0, 1]), (Origin::Posterior, [1, 2, 3])];
        assert_eq!(counts.collect::<Vec<_>>(), expected);
        let all = SuccessMetrics::of(&rows, 2);
        assert_eq!(
            (all.candidates_n, all.draws_n, all.objects_n),
            (2.0, 4.0, 1.0)
        );
        let line = line(&Summary::made(&[all]));
        assert_eq!(line, "50.0 % of candidates succeed, 25.0 % of samples");
        // A row without a candidate has no share to draw.
        assert!(!chart(&rows).unwrap().contains("prior"));
    }

    #[test]
    fn a_rate_of_zero_without_a_touch_says_so() {
        let said = |rollouts: &[Rollout]| {
            let rows = of_object(rollouts, &given(), &kept(rollouts)).unwrap();
            let touched_n = rollouts.iter().filter(|rollout| touched(rollout)).count();
            line(&Summary::made(&[SuccessMetrics::of(&rows, touched_n)]))
        };
        let past = rollout("a", "cgf", Verdict::NotGrasped);
        let through = rollout("b", "cgf", Verdict::Table);
        let untouched = [past.clone(), past.clone(), through.clone()];
        let line = said(&untouched);
        let expected =
            "; no motion touched the object: 1 would go through the table, 2 closed beside it";
        assert!(line.ends_with(expected), "{line}");
        // One that was in contact, or moved the object, is another matter.
        let pressed = Rollout {
            measures: Measures {
                penetration_m: Some(1e-4),
                ..past.measures
            },
            ..past.clone()
        };
        for other in [
            pressed,
            rollout("c", "cgf", Verdict::KnockedOver),
            rollout("c", "cgf", Verdict::Held),
        ] {
            let line = said(&[past.clone(), other]);
            assert!(!line.contains("touched"), "{line}");
        }
    }

    #[test]
    fn a_rollout_of_no_candidate_is_refused() {
        let stray = rollout("z", "cgf", Verdict::Held);
        let err = of_object(&[stray], &given(), &[]).unwrap_err();
        assert!(err.to_string().contains("`z`"), "{err}");
    }

    #[test]
    fn one_unit_reads_all_rollouts() {
        let partition = |key: &str| Partition::new(key.parse().unwrap(), BTreeMap::new());
        let scope = Scope::new(BTreeMap::from([
            (
                Candidates::NAME.to_owned(),
                ["box", "can", "cup"].map(partition).to_vec(),
            ),
            (
                Rollouts::NAME.to_owned(),
                ["box", "can"].map(partition).to_vec(),
            ),
        ]));
        let units = units(&scope);
        assert_eq!(units.len(), 1);
        assert_eq!(units[0].reads[Rollouts::NAME], ["box", "can"]);
        assert_eq!(units[0].reads[Candidates::NAME], ["box", "can"]);
        assert_eq!(units[0].labels, Some(BTreeMap::new()));
        assert!(super::units(&Scope::default()).is_empty());
    }
}
