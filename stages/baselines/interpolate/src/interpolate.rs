//! The stage: one unit per object.

use dataflow::{
    BoxedDiagnostic, Context, Line, OptionsUsed, Outcome, Output, Outputs, Scope, Stage, Sum, Unit,
};
use lake::{SiblingTable, WriteArtifact};
use schemas::{
    Table,
    candidates::Candidates,
    draws::{Draw, Draws},
};

use crate::{
    InterpolateConfig,
    line::{line, remade},
};

/// Replaces each motion by the straight line between its ends.
pub struct Interpolate;

dataflow::metrics! {
    /// Metrics of an object's lines.
    pub struct InterpolateMetrics {
        /// Number of candidates.
        candidates: Sum,
    }
}

lake::inputs! {
    /// What a unit reads: an object's motions.
    pub struct InterpolateInputs {
        /// The motions.
        each candidates: Candidates [lake::table::FILE], "to interpolate";
    }
}

impl Stage for Interpolate {
    type Config = InterpolateConfig;

    const KIND: &'static str = "interpolate";
    const ABOUT: &'static str = "Replaces each motion by the straight line between its ends";
    const INPUTS: &'static [&'static str] = InterpolateInputs::INPUTS;
    const OUTPUTS: Outputs<Self> = &[&Self, &SiblingTable::<Self, Draws>::OUTPUT];
}

impl Output for Interpolate {
    type Stage = Self;
    type Metrics = InterpolateMetrics;
    type Inputs<'a> = InterpolateInputs;

    const ARTIFACT: &'static str = Candidates::NAME;
    const SCHEMA: &'static str = Candidates::VERSION;
    const PARTITION: &'static str = Candidates::PARTITION;
    const LINE: Option<Line<InterpolateMetrics>> = Some(|summary| {
        let candidates = summary.metrics.candidates;
        format!("{} objects → {candidates} straight lines", summary.n_made)
    });
    /// `objects` only chooses units.
    const OPTIONS: OptionsUsed = OptionsUsed::Except(&["objects"]);

    fn units(config: &InterpolateConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        Ok(InterpolateInputs::units(scope, &config.objects)?)
    }

    fn make(
        _config: &InterpolateConfig,
        InterpolateInputs { candidates: given }: InterpolateInputs,
        cx: &Context,
    ) -> Result<Outcome<InterpolateMetrics>, BoxedDiagnostic> {
        let mut lines = Vec::with_capacity(given.candidates.len());
        let mut draws = Draws::with_capacity(given.candidates.len());
        for motion in &given.candidates {
            match line(motion) {
                Ok(line) => {
                    draws.push(Draw::kept(&line));
                    lines.push(line);
                }
                Err(err) => {
                    let refused = remade(motion, motion.motion.clone());
                    draws.push(Draw::without_motion(&refused, err.to_string()));
                }
            }
        }
        let metrics = InterpolateMetrics {
            candidates: lines.len() as f64,
        };
        let lines = Candidates {
            candidates: lines,
            ..given
        };
        cx.write(&lines)?;
        cx.write(&draws)?;
        Ok(Outcome::Made(metrics))
    }
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeMap, fs, path::Path};

    use dataflow::{Artifact, Inputs, Partition};
    use motion::{HandRates, Motion, Step};
    use nalgebra::Isometry3;
    use schemas::{
        candidates::{Candidate, DrawSource},
        draws::Refusal,
    };
    use spatial::Pose;

    use super::*;

    /// A motion of steps `between_s` apart.
    fn motion(name: &str, steps_n: u32, between_s: f64) -> Candidate {
        let step = |number: u32| Step {
            time_s: between_s * f64::from(number),
            frame_from_palm: Pose::new(Isometry3::translation(f64::from(number), 0.0, 0.0)),
            q_rad: vec![f64::from(number).powi(2)],
            rates: HandRates::zero(1),
        };
        Candidate {
            candidate_id: name.to_owned(),
            generator: "cgf".to_owned(),
            source: DrawSource::replayed("a"),
            latent: Vec::new(),
            table_from_object: Pose::identity(),
            limit_excess_rad: 0.0,
            depth_m: None,
            residual_m2: None,
            motion: Motion::new(&["j"], (0..steps_n).map(step).collect()).unwrap(),
        }
    }

    fn artifact(folder: &Path) -> Artifact {
        let files = [lake::table::FILE, Draws::FILE];
        Artifact {
            key: "can".parse().unwrap(),
            labels: BTreeMap::new(),
            files: files
                .map(|file| (file.to_owned(), folder.join(file)))
                .into(),
        }
    }

    /// Runs the stage on these motions; its files lie in `folder/out`.
    fn run(motions: Vec<Candidate>, folder: &Path) -> Outcome<InterpolateMetrics> {
        let [given, out] = ["given", "out"].map(|name| folder.join(name));
        for folder in [&given, &out] {
            fs::create_dir(folder).unwrap();
        }
        let motions = Candidates {
            object: "can".to_owned(),
            joints: ["j".to_owned()].into(),
            candidates: motions,
        };
        lake::table::write(&given, &motions).unwrap();
        let artifacts = BTreeMap::from([(Candidates::NAME.to_owned(), vec![artifact(&given)])]);
        let inputs = Inputs::new(artifacts, Vec::new());
        let cx = Context::detached(&"can".parse().unwrap(), 0, &out);
        Interpolate::read_and_make(&InterpolateConfig::default(), &inputs, &cx).unwrap()
    }

    #[test]
    fn every_motion_of_an_object_becomes_a_line_in_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let motions = vec![motion("can-0", 5, 1.0), motion("can-1", 2, 1.0)];
        let Outcome::Made(made) = run(motions.clone(), folder.path()) else {
            panic!("not made");
        };
        assert_eq!(made.candidates, 2.0);
        let made = artifact(&folder.path().join("out"));
        let read: Candidates = lake::table::read(&made).unwrap();
        assert_eq!(*read.joints, ["j"]);
        for (found, given) in read.candidates.iter().zip(&motions) {
            assert_eq!(found.candidate_id, format!("{}-line", given.candidate_id));
            let [found, given] = [found, given].map(|one| &one.motion);
            assert_eq!(found.steps().len(), given.steps().len());
            assert_eq!(found.grasp().q_rad, given.grasp().q_rad);
        }
        // The joint of the first goes straight to 16, not along squares.
        assert_eq!(read.candidates[0].motion.steps()[1].q_rad, [4.0]);
    }

    #[test]
    fn a_motion_of_one_step_is_a_row_too() {
        let folder = tempfile::tempdir().unwrap();
        let motions = vec![motion("can-0", 3, 1.0), motion("can-1", 1, 1.0)];
        let outcome = run(motions, folder.path());
        assert!(matches!(outcome, Outcome::Made(made) if made.candidates == 2.0));
    }

    #[test]
    fn a_line_too_fast_for_numbers_is_a_draw_with_its_reason() {
        let folder = tempfile::tempdir().unwrap();
        let motions = vec![motion("can-0", 2, 1e-310), motion("can-1", 3, 1.0)];
        let outcome = run(motions, folder.path());
        assert!(matches!(outcome, Outcome::Made(made) if made.candidates == 1.0));
        let made = artifact(&folder.path().join("out"));
        let read: Candidates = lake::table::read(&made).unwrap();
        assert_eq!(read.candidates[0].candidate_id, "can-1-line");
        let draws: Draws = lake::table::read(&made).unwrap();
        let [refused, kept] = &draws[..] else {
            panic!("{draws:?}");
        };
        assert_eq!(refused.candidate_id, "can-0-line");
        assert_eq!(refused.refused, Some(Refusal::Motion));
        assert!(refused.fault.contains("not finite"), "{}", refused.fault);
        assert_eq!(kept, &Draw::kept(&read.candidates[0]));
    }

    #[test]
    fn objects_are_chosen_by_name() {
        let partition = |key: &str| Partition::new(key.parse().unwrap(), BTreeMap::new());
        let given = vec![partition("box"), partition("can")];
        let scope = Scope::new(BTreeMap::from([(Candidates::NAME.to_owned(), given)]));
        let units = |objects: &[&str], scope: &Scope| {
            let objects = objects.iter().map(|&name| name.to_owned()).collect();
            Interpolate::units(&InterpolateConfig { objects }, scope)
        };
        assert_eq!(units(&[], &scope).unwrap().len(), 2);
        let one = units(&["can"], &scope).unwrap();
        assert_eq!((one.len(), one[0].partition.as_str()), (1, "can"));
        assert_eq!(one[0].reads[Candidates::NAME], ["can"]);
        assert_eq!(one[0].labels.as_ref().unwrap()["object"], "can");
        let unknown = units(&["cup"], &scope).unwrap_err();
        assert!(unknown.to_string().contains("`cup`"));
        assert!(unknown.hint().unwrap().contains("box, can"));
        let nothing = units(&[], &Scope::default()).unwrap_err();
        assert_eq!(
            nothing.to_string(),
            "there are no candidates to interpolate"
        );
    }
}
