//! Training on accepted motions beside the trajectories.

use std::path::Path;

use dataflow::BoxedDiagnostic;
use schemas::{
    candidates::{Candidate, Candidates, DrawSource},
    objects::APART_FROM,
    rollouts::{Rollout, Rollouts, Verdict},
};

use super::*;

/// A motion about an object that lies like this.
fn candidate(id: &str, up: Vector3<f64>) -> Candidate {
    let motion = trajectory(id, "can", up).motion;
    Candidate {
        candidate_id: id.to_owned(),
        generator: "refine".to_owned(),
        source: DrawSource::replayed("a"),
        latent: Vec::new(),
        table_from_object: rest(up).table_from_object(),
        limit_excess_rad: 0.0,
        depth_m: None,
        residual_m2: None,
        motion: motion
            .with_rates(|_| motion::HandRates::zero(JOINTS))
            .unwrap(),
    }
}

fn candidates(ups: &[Vector3<f64>]) -> Candidates {
    let drawn = ups.iter().enumerate();
    let candidates: Vec<Candidate> = drawn
        .map(|(idx, up)| candidate(&format!("can-{idx}"), *up))
        .collect();
    Candidates {
        object: "can".to_owned(),
        joints: candidates[0].motion.joints().clone(),
        candidates,
    }
}

fn rollouts(candidates: &Candidates, verdicts: &[Verdict]) -> Rollouts {
    let judged = candidates.candidates.iter().zip(verdicts);
    judged
        .map(|(candidate, verdict)| Rollout::unsimulated(candidate, *verdict))
        .collect()
}

/// The trajectories' inputs and these.
fn with_accepted(folder: &Path, candidates: &Candidates, rollouts: &Rollouts) -> Inputs {
    let object = candidates.object.as_str();
    let [of_candidates, of_rollouts] = ["candidates", "rollouts"].map(|name| folder.join(name));
    for folder in [&of_candidates, &of_rollouts] {
        std::fs::create_dir(folder).unwrap();
    }
    let mut by_name = BTreeMap::from([
        (
            "candidates".to_owned(),
            vec![artifact(&of_candidates, object, object, candidates)],
        ),
        (
            "rollouts".to_owned(),
            vec![artifact(&of_rollouts, object, object, rollouts)],
        ),
    ]);
    let given = inputs(folder);
    for name in ["objects", "trajectories"] {
        by_name.insert(name.to_owned(), given.artifacts(name).to_vec());
    }
    Inputs::new(by_name, vec![SourceFile::named("hand", &config().hand)])
}

fn made(inputs: &Inputs) -> Result<(Option<f64>, Vec<String>), BoxedDiagnostic> {
    let out = tempfile::tempdir().unwrap();
    let cx = Context::detached(&"cgf".parse().unwrap(), 7, out.path());
    let Outcome::Made(made) = Train::make(&config(), inputs, &cx)? else {
        panic!("nothing was made");
    };
    let file = |name: &str| out.path().join(name);
    let files = checkpoint::LAST;
    let cgf = Cgf::load(&file(files.weights), &file(files.description)).unwrap();
    let names = cgf.description().demonstrations.iter();
    Ok((made.accepted, names.map(|one| one.name.clone()).collect()))
}

#[test]
fn the_first_accepted_motions_are_learned_from_where_the_object_lies_as_recorded() {
    use Verdict::{Held, Slipped};
    let ups = [
        Vector3::z(),
        // In no trajectory does the can lie like this.
        Vector3::y(),
        Vector3::z(),
        Vector3::x(),
        Vector3::z(),
    ];
    let candidates = candidates(&ups);
    let rollouts = rollouts(&candidates, &[Slipped, Held, Held, Held, Held]);
    let folder = tempfile::tempdir().unwrap();
    let (accepted, names) = made(&with_accepted(folder.path(), &candidates, &rollouts)).unwrap();
    assert_eq!(accepted, Some(2.0));
    assert_eq!(names, ["a", "b", "c", "can-2", "can-3"]);
}

#[test]
fn a_candidate_without_rollout_is_an_error() {
    let candidates = candidates(&[Vector3::z(), Vector3::z()]);
    let rollouts = rollouts(&candidates, &[Verdict::Held]);
    let folder = tempfile::tempdir().unwrap();
    let err = made(&with_accepted(folder.path(), &candidates, &rollouts)).unwrap_err();
    assert!(err.to_string().contains("`can-1`"), "{err}");
    assert!(err.hint().unwrap().contains("inputs.rollouts"));
}

#[test]
fn accepted_motions_of_unseen_objects_are_not_read() {
    let partition = |key: &str| Partition::new(key.parse().unwrap(), BTreeMap::new());
    let of = |name: &str, keys: &[&str]| {
        let partitions = keys.iter().map(|key| partition(key)).collect();
        (name.to_owned(), partitions)
    };
    let known = |candidates: &[&str], rollouts: &[&str]| {
        let mut partitions =
            BTreeMap::from([of("candidates", candidates), of("rollouts", rollouts)]);
        for name in ["objects", "trajectories"] {
            partitions.insert(name.to_owned(), scope().partitions(name).to_vec());
        }
        Scope::new(partitions)
    };
    let mut config = config();
    let both = known(&["can", "tin"], &["can", "tin"]);
    let reads =
        |config: &TrainConfig| Train::units(config, &both).unwrap()[0].reads["rollouts"].clone();
    assert_eq!(reads(&config), ["can", "tin"]);
    config.unseen.unseen_objects = vec!["can".to_owned()];
    assert_eq!(reads(&config), ["tin"]);
    // A screen of other candidates is refused.
    let err = Train::units(&config, &known(&["can", "tin"], &["can"])).unwrap_err();
    assert!(err.to_string().contains("`tin`"), "{err}");
}

/// The scope of the trajectories with a generated object, on which a motion was accepted.
fn with_shape(apart_from: &str) -> Scope {
    let partition = |labels: &[(&str, &str)]| {
        let labels = labels
            .iter()
            .map(|(name, value)| ((*name).to_owned(), (*value).to_owned()));
        Partition::new("shape_00000".parse().unwrap(), labels.collect())
    };
    let mut partitions: BTreeMap<String, Vec<Partition>> = ["objects", "trajectories"]
        .map(|name| (name.to_owned(), scope().partitions(name).to_vec()))
        .into();
    let labels = [("object", "shape_00000"), (APART_FROM, apart_from)];
    partitions
        .entry("objects".to_owned())
        .or_default()
        .push(partition(&labels));
    for name in ["candidates", "rollouts"] {
        partitions.insert(name.to_owned(), vec![partition(&[])]);
    }
    Scope::new(partitions)
}

#[test]
fn a_generated_shape_is_read_if_it_was_kept_apart_from_every_unseen_object() {
    let mut config = config();
    config.unseen.unseen_objects = vec!["can".to_owned()];
    let unit = &Train::units(&config, &with_shape("can")).unwrap()[0];
    assert_eq!(unit.reads["rollouts"], ["shape_00000"]);
    assert!(unit.reads["objects"].contains(&"shape_00000".to_owned()));
    for apart_from in ["", "tin", "candle"] {
        let err = Train::units(&config, &with_shape(apart_from)).unwrap_err();
        assert!(err.to_string().contains("`shape_00000`"), "{err}");
        assert!(err.hint().unwrap().contains("unseen_fold"));
    }
}

#[test]
fn motions_on_a_generated_shape_are_learned_however_it_lies() {
    use Verdict::{Held, Slipped};
    let shaped = Candidates {
        object: "shape_00000".to_owned(),
        ..candidates(&[Vector3::z(), Vector3::y(), Vector3::x()])
    };
    let rollouts = rollouts(&shaped, &[Slipped, Held, Held]);
    let folder = tempfile::tempdir().unwrap();
    let given = with_accepted(folder.path(), &shaped, &rollouts);
    let surfaces = folder.path().join("shapes");
    std::fs::create_dir(&surfaces).unwrap();
    let shape = artifact(
        &surfaces,
        "shape_00000",
        "shape_00000",
        &surface("shape_00000"),
    );
    let names = ["candidates", "objects", "rollouts", "trajectories"];
    let mut by_name: BTreeMap<String, Vec<Artifact>> = names
        .map(|name| (name.to_owned(), given.artifacts(name).to_vec()))
        .into();
    by_name.entry("objects".to_owned()).or_default().push(shape);
    let inputs = Inputs::new(by_name, given.files().to_vec());
    let (accepted, names) = made(&inputs).unwrap();
    assert_eq!(accepted, Some(2.0));
    assert_eq!(names, ["a", "b", "c", "can-1", "can-2"]);
}

#[test]
fn a_motion_carried_over_from_an_unseen_object_is_an_error() {
    let candidates = candidates(&[Vector3::z()]);
    let rollouts = rollouts(&candidates, &[Verdict::Held]);
    let folder = tempfile::tempdir().unwrap();
    let inputs = with_accepted(folder.path(), &candidates, &rollouts);
    let mut config = config();
    config.unseen.unseen_objects = vec!["can".to_owned()];
    let out = tempfile::tempdir().unwrap();
    let cx = Context::detached(&"cgf".parse().unwrap(), 7, out.path());
    let err = Train::make(&config, &inputs, &cx).unwrap_err();
    assert!(
        err.to_string().contains("`can-0`") && err.to_string().contains("`a`"),
        "{err}"
    );
}

/// A checkpoint of the training in `folder`, as an artifact.
fn trained(folder: &Path, config: &TrainConfig) -> Artifact {
    let cx = Context::detached(&"cgf".parse().unwrap(), 7, folder);
    let given = tempfile::tempdir().unwrap();
    let Outcome::Made(_) = Train::make(config, &inputs(given.path()), &cx).unwrap() else {
        panic!("nothing was made");
    };
    trained_in(folder)
}

/// The checkpoint in a folder.
fn trained_in(folder: &Path) -> Artifact {
    let names = [checkpoint::LAST.weights, checkpoint::LAST.description];
    let files = names.map(|name| (name.to_owned(), folder.join(name)));
    Artifact {
        key: "cgf".parse().unwrap(),
        labels: BTreeMap::new(),
        files: files.into(),
    }
}

/// The same inputs, and a checkpoint from which to go on.
fn going_on(inputs: &Inputs, checkpoint: Artifact) -> Inputs {
    let mut by_name = BTreeMap::from([("checkpoint".to_owned(), vec![checkpoint])]);
    for name in ["objects", "trajectories", "candidates", "rollouts"] {
        by_name.insert(name.to_owned(), inputs.artifacts(name).to_vec());
    }
    Inputs::new(by_name, vec![SourceFile::named("hand", &config().hand)])
}

#[test]
fn a_training_that_goes_on_does_not_encode_motions_that_were_drawn() {
    let code = vec![0.25; config().network.latent_dim];
    let mut candidates = candidates(&[Vector3::z(), Vector3::z()]);
    candidates.candidates[1].latent.clone_from(&code);
    let rollouts = rollouts(&candidates, &[Verdict::Held, Verdict::Held]);
    let folder = tempfile::tempdir().unwrap();
    let alone = with_accepted(folder.path(), &candidates, &rollouts);
    let of_first = tempfile::tempdir().unwrap();
    let both = going_on(&alone, trained(of_first.path(), &config()));
    let is_encoded = |inputs: &Inputs, name: &str| {
        let out = tempfile::tempdir().unwrap();
        let cx = Context::detached(&"cgf".parse().unwrap(), 7, out.path());
        assert!(matches!(
            Train::make(&config(), inputs, &cx).unwrap(),
            Outcome::Made(_)
        ));
        let model = trained_in(out.path());
        let of_model = BTreeMap::from([("checkpoint".to_owned(), vec![model])]);
        let reported = tempfile::tempdir().unwrap();
        let cx = Context::detached(&"cgf".parse().unwrap(), 7, reported.path());
        let made = stage_train::report::LatentsReport::make(
            &config(),
            &Inputs::new(of_model, Vec::new()),
            &cx,
        );
        let Outcome::Made(made) = made.unwrap() else {
            panic!("nothing was made");
        };
        assert!(made.kl_nats.is_finite() && made.kl_nats > 0.0);
        let description = cgf::Description::read(&out.path().join(checkpoint::LAST.description));
        let description = description.unwrap();
        assert_eq!(
            description.objects,
            ["can", "tin"].map(str::to_owned).into()
        );
        let mut encoded = description.demonstrations.iter();
        encoded.any(|one| one.name == name)
    };
    assert!(!is_encoded(&both, "can-1"));
    assert!(is_encoded(&both, "can-0"));
    // Of another function the codes say nothing.
    assert!(is_encoded(&alone, "can-1"));
}

#[test]
fn what_was_learned_before_is_known_after_a_training_that_goes_on() {
    let candidates = candidates(&[Vector3::z()]);
    let rollouts = rollouts(&candidates, &[Verdict::Held]);
    let folder = tempfile::tempdir().unwrap();
    let alone = with_accepted(folder.path(), &candidates, &rollouts);
    let [of_first, of_second, of_third] = [(); 3].map(|()| tempfile::tempdir().unwrap());
    let make = |inputs: &Inputs, config: &TrainConfig, folder: &Path| {
        Train::make(
            config,
            inputs,
            &Context::detached(&"cgf".parse().unwrap(), 7, folder),
        )
    };
    // The first learns from both objects, the second from the can alone.
    let both = going_on(&alone, trained(of_first.path(), &config()));
    let of_can = |name: &&str| {
        let artifacts = both.artifacts(name).iter();
        let of_can = artifacts.filter(|one| !["c", "tin"].contains(&one.key.as_str()));
        ((*name).to_owned(), of_can.cloned().collect())
    };
    let names = [
        "checkpoint",
        "objects",
        "trajectories",
        "candidates",
        "rollouts",
    ];
    let of_can = Inputs::new(names.iter().map(of_can).collect(), both.files().to_vec());
    make(&of_can, &config(), of_second.path()).unwrap();
    let second = trained_in(of_second.path());
    let description = cgf::Description::read(&of_second.path().join(checkpoint::LAST.description));
    let names = ["can", "tin"].map(str::to_owned);
    assert_eq!(description.unwrap().objects, names.into());
    let mut unseen = config();
    unseen.unseen.unseen_objects = vec!["tin".to_owned()];
    let err = make(&going_on(&alone, second), &unseen, of_third.path()).unwrap_err();
    assert!(err.to_string().contains("object `tin`"), "{err}");
}

#[test]
fn a_training_does_not_go_on_from_a_function_that_knows_an_unseen_object() {
    let candidates = candidates(&[Vector3::z()]);
    let rollouts = rollouts(&candidates, &[Verdict::Held]);
    let folder = tempfile::tempdir().unwrap();
    let of_first = tempfile::tempdir().unwrap();
    let inputs = with_accepted(folder.path(), &candidates, &rollouts);
    let inputs = going_on(&inputs, trained(of_first.path(), &config()));
    let mut config = config();
    config.unseen.unseen_objects = vec!["tin".to_owned()];
    let out = tempfile::tempdir().unwrap();
    let cx = Context::detached(&"cgf".parse().unwrap(), 7, out.path());
    let err = Train::make(&config, &inputs, &cx).unwrap_err();
    assert!(err.to_string().contains("object `tin`"), "{err}");
    assert!(err.hint().unwrap().contains("unseen_objects"));
}
