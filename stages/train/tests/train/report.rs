//! Reports on a training.

use std::{collections::BTreeMap, fs, path::Path};

use cgf::Description;
use dataflow::{
    Artifact, BoxedDiagnostic, Context, Inputs, Outcome, Output, Partition, Report, Scope, Summary,
};
use folds::UnseenObjects;
use schemas::{
    Table, checkpoint,
    latents::Latents,
    reconstruction::Reconstruction,
    training::{Split, Training},
};
use stage_train::report::{LatentsReport, ReconstructionReport, TrainReport, TrainingReport};
use stage_train::{Train, TrainConfig, TrainError};
use tempfile::TempDir;

use crate::{config, inputs, scope};

/// Two objects, one of them unseen; nothing is held out.
fn unseen() -> TrainConfig {
    TrainConfig {
        unseen: UnseenObjects {
            unseen_objects: Vec::new(),
            unseen_fold: Some("2/2".parse().unwrap()),
        },
        ..config()
    }
}

/// A trained checkpoint, and what its reports read.
struct Trained {
    config: TrainConfig,
    /// Keeps the files that `inputs` names.
    _folders: [TempDir; 2],
    inputs: Inputs,
    description: Description,
}

impl Trained {
    fn new(config: TrainConfig) -> Self {
        let folders = [TempDir::new().unwrap(), TempDir::new().unwrap()];
        let read = inputs(folders[0].path());
        let out = folders[1].path();
        let cx = Context::detached(&"cgf".parse().unwrap(), 7, out);
        Train::make(&config, &read, &cx).unwrap();
        let names = [checkpoint::LAST.weights, checkpoint::LAST.description];
        let model = Artifact {
            key: "cgf".parse().unwrap(),
            labels: BTreeMap::new(),
            files: names.map(|name| (name.to_owned(), out.join(name))).into(),
        };
        let all = ["objects", "trajectories"]
            .map(|input| (input.to_owned(), read.artifacts(input).to_vec()))
            .into_iter()
            .chain([("checkpoint".to_owned(), vec![model])]);
        Self {
            config,
            inputs: Inputs::new(all.collect(), read.files().to_vec()),
            description: Description::read(&out.join(checkpoint::LAST.description)).unwrap(),
            _folders: folders,
        }
    }

    fn report<O: Output<Stage = Train>>(
        &self,
        seed: u64,
        folder: &Path,
    ) -> Result<O::Metrics, BoxedDiagnostic> {
        let cx = Context::detached(&"cgf".parse().unwrap(), seed, folder);
        match O::read_and_make(&self.config, &self.inputs, &cx)? {
            Outcome::Made(made) => Ok(made),
            Outcome::Labeled(..) | Outcome::Provisional(_) => panic!("not made"),
            Outcome::Skipped { reason } | Outcome::Filtered { reason } => panic!("{reason}"),
        }
    }

    /// Makes a report; returns its table, its charts and its metrics.
    fn table_of<O, T>(&self) -> (T, Vec<String>, O::Metrics)
    where
        O: Output<Stage = Train>,
        T: Table,
    {
        let folder = TempDir::new().unwrap();
        let made = self.report::<O>(7, folder.path()).unwrap();
        let table = folder.path().join(lake::table::FILE);
        let artifact = Artifact {
            key: "cgf".parse().unwrap(),
            labels: BTreeMap::new(),
            files: BTreeMap::from([(lake::table::FILE.to_owned(), table)]),
        };
        let charts = files(folder.path()).into_keys();
        let charts = charts.filter(|name| name.contains(".svg"));
        (
            lake::table::read(&artifact).unwrap(),
            charts.collect(),
            made,
        )
    }
}

fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = fs::read_dir(folder).unwrap().map(|file| {
        let path = file.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        (name, fs::read(&path).unwrap())
    });
    files.collect()
}

fn said<O: Output>(made: O::Metrics) -> String {
    O::LINE.unwrap()(&Summary::made(&[made]))
}

#[test]
fn losses_of_every_epoch_are_shown() {
    let trained = Trained::new(unseen());
    let (rows, charts, made) = trained.table_of::<TrainingReport, Training>();
    let splits: Vec<(i64, Split)> = rows.iter().map(|row| (row.epoch, row.split)).collect();
    let of_epoch = |epoch| [(epoch, Split::Training), (epoch, Split::Unseen)];
    assert_eq!(splits, [1, 2, 3].map(of_epoch).concat());
    let curve = &trained.description.training_curve;
    assert_eq!(rows[5].total, f64::from(curve[2].unseen.unwrap().total));
    assert_eq!(rows[4].kl_nats, f64::from(curve[2].training.kl));
    assert_eq!(rows[4].learning_rate, curve[2].learning_rate);
    assert_eq!(made.loss[Split::Unseen], Some(rows[5].total));
    let expected = ["kl", "learning_rate", "loss", "terms", "terms_unseen"];
    assert_eq!(charts, expected.map(|name| format!("{name}.svg")));
    let line = said::<TrainingReport>(made);
    assert!(line.starts_with("3 epochs, loss "), "{line}");
    assert!(
        line.contains("unseen objects") && !line.contains("held out"),
        "{line}"
    );
}

#[test]
fn every_motion_is_compared_with_its_execution() {
    let trained = Trained::new(unseen());
    let (made_of, charts, made) = trained.table_of::<ReconstructionReport, Reconstruction>();
    let Reconstruction { joints, rows } = made_of;
    assert_eq!(joints, trained.description.joints);
    assert_eq!(rows.len(), 3);
    for (row, demonstration) in rows.iter().zip(&trained.description.demonstrations) {
        assert_eq!(row.sequence, demonstration.name);
        assert_eq!(row.object, demonstration.object);
        assert_eq!(row.split, demonstration.split);
        // The training has measured the grasps itself.
        let known = &demonstration.grasp_error;
        assert!((row.palm_error_grasp_m - known.position_m).abs() < 1e-9);
        assert!((row.palm_rotation_grasp_rad - known.rotation_rad).abs() < 1e-7);
        assert!(row.joint_error_grasp_rad <= known.joints_rad + 1e-9);
        let mean = row.joint_errors_rad.iter().sum::<f64>() / joints.len() as f64;
        assert!((row.joint_error_mean_rad - mean).abs() < 1e-12);
        // No tip is farther off than palm and joints can carry it: this hand is no longer than 0.3 m.
        let reach_m = 0.3 * (known.rotation_rad + 4.0 * known.joints_rad * 4.0);
        assert!(row.tip_error_grasp_m <= known.position_m + reach_m);
        assert!(row.tip_error_grasp_m > 0.0 && row.tip_error_mean_m > 0.0);
    }
    let unseen = made.tip_error_mean_m[Split::Unseen].unwrap();
    assert!((unseen - rows[2].tip_error_mean_m).abs() < 1e-12);
    let expected = ["joints", "objects", "objects_grasp", "time"];
    assert_eq!(charts, expected.map(|name| format!("{name}.svg")));
    let line = said::<ReconstructionReport>(made);
    assert!(
        line.starts_with("tip error ") && line.contains(" mm (grasp ") && line.contains("unseen "),
        "{line}"
    );
}

#[test]
fn use_of_the_latent_code_is_that_of_the_motions_learned_from() {
    let trained = Trained::new(unseen());
    let (rows, charts, made) = trained.table_of::<LatentsReport, Latents>();
    assert_eq!(rows.len(), trained.description.network.latent_dim);
    let learned = &trained.description.demonstrations[..2];
    for (dimension, row) in rows.iter().enumerate() {
        let code = |k: usize| {
            let motion = &learned[k];
            (
                motion.latent_mean[dimension],
                motion.latent_deviation[dimension],
            )
        };
        let ((a, s), (b, t)) = (code(0), code(1));
        assert!((row.mean_deviation - (a - b).abs() / 2.0).abs() < 1e-12);
        assert!((row.deviation_mean - f64::midpoint(s, t)).abs() < 1e-12);
        let kl = |m: f64, s: f64| 0.5 * (m * m + s * s - 1.0 - (s * s).ln());
        assert!((row.kl_nats - f64::midpoint(kl(a, s), kl(b, t))).abs() < 1e-9);
        assert_eq!(row.active, row.mean_deviation > 0.1);
    }
    let total: f64 = rows.iter().map(|row| row.kl_nats).sum();
    assert!((made.kl_nats - total).abs() < 1e-12);
    assert_eq!(charts, ["kl.svg", "means.svg", "spread.svg"]);
    let n_active = rows.iter().filter(|row| row.active).count();
    let line = said::<LatentsReport>(made);
    assert!(
        line.starts_with(&format!("{n_active} of 3 active latent dimensions")),
        "{line}"
    );
}

#[test]
fn reports_are_the_same_bytes_whatever_the_seed() {
    let trained = Trained::new(TrainConfig {
        held_out_share: 0.34,
        ..config()
    });
    let splits = &trained.description.demonstrations;
    assert!(splits.iter().any(|motion| motion.split == Split::HeldOut));
    for output in TrainReport::OUTPUTS {
        let made = [7, 8, 9].map(|seed| {
            let folder = TempDir::new().unwrap();
            let cx = Context::detached(&"cgf".parse().unwrap(), seed, folder.path());
            let made = output.make(&trained.config, &trained.inputs, &cx).unwrap();
            assert!(matches!(made, Outcome::Made(_)), "{made:?}");
            files(folder.path())
        });
        assert!(made[0].len() > 2, "{:?}", made[0].keys());
        assert!(made.iter().all(|files| *files == made[0]));
    }
}

#[test]
fn a_training_that_goes_on_holds_out_what_was_held_out_before() {
    // The tin's motion is new to what goes on.
    let mut trained = Trained::new(TrainConfig {
        objects: vec!["can".to_owned()],
        held_out_share: 0.5,
        ..config()
    });
    trained.config.objects.clear();
    let splits = |description: &Description| -> BTreeMap<String, Split> {
        let motions = description.demonstrations.iter();
        motions.map(|one| (one.name.clone(), one.split)).collect()
    };
    let mut expected = splits(&trained.description);
    assert!(expected.values().any(|split| *split == Split::HeldOut));
    expected.insert("c".to_owned(), Split::Training);
    for seed in 8..14 {
        let folder = TempDir::new().unwrap();
        let cx = Context::detached(&"cgf".parse().unwrap(), seed, folder.path());
        Train::make(&trained.config, &trained.inputs, &cx).unwrap();
        let description = folder.path().join(checkpoint::LAST.description);
        assert_eq!(splits(&Description::read(&description).unwrap()), expected);
    }
}

#[test]
fn reports_read_only_the_files_they_need() {
    let config = config();
    assert_eq!(TrainingReport::units(&config, &scope()).unwrap(), []);
    let model = vec![Partition::new("cgf".parse().unwrap(), BTreeMap::new())];
    let trajectories = scope().partitions("trajectories").to_vec();
    let objects = scope().partitions("objects").to_vec();
    let scope = Scope::new(BTreeMap::from([
        ("checkpoint".to_owned(), model),
        ("trajectories".to_owned(), trajectories),
        ("objects".to_owned(), objects),
    ]));
    for (units, parts, n_motions) in [
        (
            TrainingReport::units(&config, &scope),
            &["last.json"][..],
            0,
        ),
        (LatentsReport::units(&config, &scope), &["last.json"], 0),
        (
            ReconstructionReport::units(&config, &scope),
            &["last.json", "last.safetensors"],
            3,
        ),
    ] {
        let [unit] = &units.unwrap()[..] else {
            panic!("not one unit that reads {parts:?}");
        };
        assert_eq!(unit.partition, "cgf");
        assert_eq!(unit.parts["checkpoint"], parts);
        let motions = unit.reads.get("trajectories").map_or(0, Vec::len);
        assert_eq!(motions, n_motions, "{parts:?}");
    }
}

#[test]
fn a_cut_off_checkpoint_is_a_clear_error() {
    let trained = Trained::new(config());
    let model = &trained.inputs.artifacts("checkpoint")[0];
    let path = model.file(checkpoint::LAST.weights).unwrap();
    let whole = fs::read(path).unwrap();
    fs::File::options()
        .write(true)
        .open(path)
        .unwrap()
        .set_len(whole.len() as u64 / 2)
        .unwrap();
    let folder = TempDir::new().unwrap();
    let err = trained
        .report::<ReconstructionReport>(7, folder.path())
        .unwrap_err();
    assert!(
        matches!(err.downcast_ref(), Some(TrainError::Cgf(_))),
        "{err:?}"
    );
}
