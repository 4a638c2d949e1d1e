//! The stage: one unit per object.

use std::collections::BTreeMap;

use dataflow::{Code, Context, Input, Inputs, Labels, Made, Outcome, Output, Scope, Stage, Unit};
use lake::{ReadInputs, WriteArtifact};
use schemas::{Table, candidates::Candidates};

use crate::{InterpolateConfig, InterpolateError, line::line};

/// Replaces each motion by the straight line between its ends.
pub enum Interpolate {}

/// The artifact that it reads and makes.
const CANDIDATES: &str = "candidates";

impl Stage for Interpolate {
    type Config = InterpolateConfig;
    type Error = InterpolateError;

    const KIND: &'static str = "interpolate";
    const ABOUT: &'static str = "Replaces each motion by the straight line between its ends";
    const CODE: Code = dataflow::code!();
    const INPUTS: &'static [Input] = &[Input {
        name: CANDIDATES,
        artifact: CANDIDATES,
    }];
    const OUTPUTS: &'static [Output] = &[Output {
        artifact: CANDIDATES,
        schema: Candidates::VERSION,
        partition: "object",
        parallel: true,
    }];

    fn units(
        config: &InterpolateConfig,
        _output: &str,
        scope: &Scope,
    ) -> Result<Vec<Unit>, InterpolateError> {
        let keys = scope.partitions(CANDIDATES).iter().map(|given| &given.key);
        let keys: Vec<&String> = keys.collect();
        if keys.is_empty() {
            return Err(InterpolateError::NoCandidates);
        }
        if let Some(object) = config.objects.iter().find(|object| !keys.contains(object)) {
            return Err(InterpolateError::UnknownObject {
                object: object.clone(),
                known: keys.into_iter().cloned().collect(),
            });
        }
        let chosen =
            |object: &&String| config.objects.is_empty() || config.objects.contains(object);
        let units = keys.into_iter().filter(chosen).map(|object| {
            Unit::new(object)
                .reading(CANDIDATES, [object])
                .only_files(CANDIDATES, [lake::table::FILE])
        });
        Ok(units.collect())
    }

    fn foretell(
        _config: &InterpolateConfig,
        _output: &str,
        unit: &Unit,
        _scope: &Scope,
    ) -> Option<Labels> {
        Some(labels(&unit.partition))
    }

    /// `objects` only chooses units.
    fn decides(option: &str, _output: &str) -> bool {
        option != "objects"
    }

    fn run(
        _config: &InterpolateConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome, InterpolateError> {
        let given: Candidates = inputs.one()?;
        let mut lines = Vec::with_capacity(given.candidates.len());
        for motion in &given.candidates {
            match line(motion) {
                Ok(motion) => lines.push(motion),
                Err(err) => {
                    let name = &motion.candidate_id;
                    let reason = format!("candidate `{name}`: {err}");
                    return Ok(Outcome::Skipped { reason });
                }
            }
        }
        let n = lines.len() as f64;
        let lines = Candidates {
            candidates: lines,
            ..given
        };
        cx.write(&lines)?;
        Ok(Outcome::Made(Made {
            labels: labels(&lines.object),
            metrics: BTreeMap::from([("candidates".to_owned(), n)]),
        }))
    }
}

fn labels(object: &str) -> Labels {
    Labels::from([("object".to_owned(), object.to_owned())])
}

#[cfg(test)]
mod tests {
    use std::{fs, path::Path};

    use dataflow::{Advise, Artifact, Partition};
    use nalgebra::Isometry3;
    use schemas::candidates::{Candidate, Rates, Step};
    use spatial::Pose;

    use super::*;

    fn motion(name: &str, steps_n: u32) -> Candidate {
        let step = |number: u32| Step {
            time_s: f64::from(number),
            object_from_palm: Pose::new(Isometry3::translation(f64::from(number), 0.0, 0.0)),
            q_rad: vec![f64::from(number).powi(2)],
            rates: Rates::still(1),
        };
        Candidate {
            candidate_id: name.to_owned(),
            generator: "cgf".to_owned(),
            latent: Vec::new(),
            table_from_object: Pose::identity(),
            limit_excess_rad: 0.0,
            steps: (0..steps_n).map(step).collect(),
        }
    }

    fn artifact(folder: &Path) -> Artifact {
        let file = lake::table::FILE;
        Artifact {
            key: "can".to_owned(),
            labels: BTreeMap::new(),
            files: BTreeMap::from([(file.to_owned(), folder.join(file))]),
        }
    }

    /// Runs the stage on these motions; its files lie in `folder/out`.
    fn run(motions: Vec<Candidate>, folder: &Path) -> Outcome {
        let [given, out] = ["given", "out"].map(|name| folder.join(name));
        for folder in [&given, &out] {
            fs::create_dir(folder).unwrap();
        }
        let motions = Candidates {
            object: "can".to_owned(),
            joints: vec!["j".to_owned()],
            candidates: motions,
        };
        lake::table::write(&given, &motions).unwrap();
        let artifacts = BTreeMap::from([(CANDIDATES.to_owned(), vec![artifact(&given)])]);
        let inputs = Inputs::new(artifacts, Vec::new());
        let cx = Context::detached(CANDIDATES, "can", 0, &out);
        Interpolate::run(&InterpolateConfig::default(), &inputs, &cx).unwrap()
    }

    #[test]
    fn every_motion_of_an_object_becomes_a_line_in_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let motions = vec![motion("can-0", 5), motion("can-1", 2)];
        let Outcome::Made(made) = run(motions.clone(), folder.path()) else {
            panic!("not made");
        };
        assert_eq!(made.metrics["candidates"], 2.0);
        assert_eq!(made.labels["object"], "can");
        let made = artifact(&folder.path().join("out"));
        let read: Candidates = lake::table::read(&made).unwrap();
        assert_eq!(read.joints, ["j"]);
        for (found, given) in read.candidates.iter().zip(&motions) {
            assert_eq!(found.candidate_id, format!("{}-line", given.candidate_id));
            let last = found.steps.last().unwrap();
            assert_eq!(found.steps.len(), given.steps.len());
            assert_eq!(last.q_rad, given.steps.last().unwrap().q_rad);
        }
        // The joint of the first goes straight to 16, not along squares.
        assert_eq!(read.candidates[0].steps[1].q_rad, [4.0]);
    }

    #[test]
    fn an_object_with_a_motion_of_one_step_is_skipped_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let outcome = run(vec![motion("can-0", 3), motion("can-1", 1)], folder.path());
        let Outcome::Skipped { reason } = outcome else {
            panic!("{outcome:?}");
        };
        assert!(reason.contains("`can-1`") && reason.contains("1 of at least 2 steps"));
    }

    #[test]
    fn objects_are_chosen_by_name() {
        let partition = |key: &str| Partition::new(key, BTreeMap::new());
        let given = vec![partition("box"), partition("can")];
        let scope = Scope::new(BTreeMap::from([(CANDIDATES.to_owned(), given)]));
        let units = |objects: &[&str], scope: &Scope| {
            let objects = objects.iter().map(|&name| name.to_owned()).collect();
            Interpolate::units(&InterpolateConfig { objects }, CANDIDATES, scope)
        };
        assert_eq!(units(&[], &scope).unwrap().len(), 2);
        let one = units(&["can"], &scope).unwrap();
        assert_eq!((one.len(), one[0].partition.as_str()), (1, "can"));
        assert_eq!(one[0].reads[CANDIDATES], ["can"]);
        let unknown = units(&["cup"], &scope).unwrap_err();
        assert!(unknown.to_string().contains("`cup`"));
        assert!(unknown.hint().unwrap().contains("box, can"));
        let nothing = units(&[], &Scope::default());
        assert!(matches!(nothing, Err(InterpolateError::NoCandidates)));
        assert!(!Interpolate::decides("objects", CANDIDATES));
    }
}
