//! Speed of sampling motions at the released model's size, with and without their exact rates, beside PyTorch: as the
//! released code does it and as well as one can; and of the function of this repository.
//!
//! `PIPELINE_PYTHON` names a Python that has `torch`, `python3` where it is not set; without it PyTorch
//! is skipped. All run on one thread, in turns of a few hundred motions; times are CPU times.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

mod limits;
mod python;

use std::{
    collections::BTreeMap,
    env,
    hint::black_box,
    path::Path,
    process::{Command, ExitCode},
    sync::Arc,
};

use cgf::{
    Activation, Cgf, NetworkConfig, ObjectFeature, Random, RestingObject, TrainingConfig,
    TrainingMotion, TrainingSet,
};
use dataflow::Pipeline;
use limits::Limits;
use motion::{Motion, Step};
use nalgebra::{Isometry3, Point3, Vector3};
use python::Script;
use rayon::{ThreadPool, ThreadPoolBuilder};
use robot::RobotModel;
use serde_json::{Value, json};
use spatial::{Pose, RestingPose};
use stage_train::Train;

const MOTIONS: usize = 10_000;
const STEPS: usize = 40;
/// Motions of one turn.
const TURN: usize = 500;
/// The same where each takes as long as many of the others'.
const RELEASED_TURN: usize = 10;
const THREADS: &str = "RAYON_NUM_THREADS";

const MIN_BESIDE_RELEASED: f64 = 40.0;
const MIN_BESIDE_BATCHED: f64 = 1.5;
const MIN_BESIDE_FACTORED: f64 = 2.0;
const MAX_FOR_RATES: f64 = 3.0;
/// CPU time of a motion of the trained function, in milliseconds, on a core with AVX-512: 0.74 measured, and a third
/// more.
const MAX_TRAINED_MS: f64 = 1.0;
/// Relative difference of a ratio of two sums of turns from run to run, with other programs beside.
const NOISE: f64 = 0.1;

fn main() -> ExitCode {
    // candle looks for the number of threads in the surroundings alone.
    if env::var(THREADS).as_deref() != Ok("1") {
        let myself = env::current_exe().unwrap();
        let ran = Command::new(myself).env(THREADS, "1").status().unwrap();
        return if ran.success() {
            ExitCode::SUCCESS
        } else {
            ExitCode::FAILURE
        };
    }
    let pool = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let [relu, silu] = [Activation::Relu, Activation::Silu].map(Ours::new);
    let trained = Ours::trained();
    let mut torch = Torch::start(&relu);
    let mut lanes: Vec<Lane> = vec![
        Lane::new("ours, ReLU", |n| relu.values(&pool, n)),
        Lane::new("ours, ReLU, with rates", |n| relu.rates(&pool, n)),
        Lane::new("ours, SiLU", |n| silu.values(&pool, n)),
        Lane::new("ours, SiLU, with rates", |n| silu.rates(&pool, n)),
        Lane::new("the trained function", |n| trained.values(&pool, n)),
        Lane::new("the trained function, with rates", |n| {
            trained.rates(&pool, n)
        }),
    ];
    let mut ways = [
        "released",
        "batched",
        "batched by 25",
        "factored",
        "factored by 25",
    ]
    .map(|way| (way, 0.0, 0));
    for _ in 0..MOTIONS / TURN {
        for lane in &mut lanes {
            lane.seconds += (lane.run)(TURN);
            lane.motions += TURN;
        }
        if let Ok(torch) = &mut torch {
            for (way, seconds, motions) in &mut ways {
                let n = if *way == "released" {
                    RELEASED_TURN
                } else {
                    TURN
                };
                *seconds += torch.sample(way, n);
                *motions += n;
            }
        }
    }
    println!(
        "\n{:<36} {:>14} {:>12}",
        "motions of 40 steps, one thread", "us per motion", "per second"
    );
    let show = |name: &str, seconds: f64, motions: usize| -> f64 {
        let each = seconds / motions as f64;
        println!(
            "{name:<36} {:>14.1} {:>12.0}   of {motions}",
            1e6 * each,
            1.0 / each
        );
        each
    };
    let ours: Vec<f64> = lanes
        .iter()
        .map(|lane| show(lane.name, lane.seconds, lane.motions))
        .collect();
    let mut limits = Limits::with_noise(NOISE);
    match torch {
        Ok(torch) => {
            let theirs = ways.map(|(way, seconds, motions)| {
                show(
                    &format!("PyTorch {}, {way}", torch.version),
                    seconds,
                    motions,
                )
            });
            println!();
            let [released, batched, by_25, factored, factored_by_25] = theirs;
            let (batched, factored) = (batched.min(by_25), factored.min(factored_by_25));
            let batched = batched / ours[0];
            limits.keep("batched over ours", batched, MIN_BESIDE_BATCHED..);
            let released = released / ours[0];
            limits.keep("released way over ours", released, MIN_BESIDE_RELEASED..);
            let factored = factored / ours[0];
            let what = "batched with a factored first layer over ours";
            limits.keep(what, factored, MIN_BESIDE_FACTORED..);
        }
        Err(reason) => println!("PyTorch: skipped, {reason}"),
    }
    for (what, with, without) in [("ReLU", ours[1], ours[0]), ("SiLU", ours[3], ours[2])] {
        let what = format!("{what} with both derivatives over without");
        limits.keep(&what, with / without, ..=MAX_FOR_RATES);
    }
    limits.keep(
        "ms for a motion of the trained function",
        1e3 * ours[4],
        ..=MAX_TRAINED_MS,
    );
    limits.end()
}

/// One way to sample: its times, and the number of motions.
struct Lane<'a> {
    name: &'static str,
    run: Box<dyn Fn(usize) -> f64 + 'a>,
    seconds: f64,
    motions: usize,
}

impl<'a> Lane<'a> {
    fn new(name: &'static str, run: impl Fn(usize) -> f64 + 'a) -> Self {
        Self {
            name,
            run: Box::new(run),
            seconds: 0.0,
            motions: 0,
        }
    }
}

/// A function and an object.
struct Ours {
    cgf: Cgf,
    scene: RestingObject,
    times: Vec<f64>,
    noise: Vec<Vec<f64>>,
}

impl Ours {
    /// The function of this repository.
    fn trained() -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/checkpoints/allegro_right");
        let file = |name| folder.join(name);
        let cgf = Cgf::load(&file("last.safetensors"), &file("last.json")).unwrap();
        Self::of(cgf, scene())
    }

    /// A network of the released model's size that was hardly trained.
    fn new(activation: Activation) -> Self {
        let hand =
            RobotModel::from_urdf(include_str!("../../data/robots/allegro_right.urdf")).unwrap();
        let (mut network, mut training) = options();
        network.points = 2000;
        network.point_widths = vec![64, 128, 1024];
        network.latent_dim = 256;
        network.decoder_widths = vec![256, 512, 256];
        network.activation = activation;
        training.epochs = 1;
        training.penetration_weight = 0.0;
        let scene = scene();
        let track = |name: &str, x: f64| TrainingMotion {
            name: name.to_owned(),
            scene: 0,
            split: schemas::training::Split::Training,
            code: None,
            motion: Motion::new(
                &hand.joint_names(),
                (0..20)
                    .map(|k| Step {
                        time_s: f64::from(k),
                        frame_from_palm: Pose::new(Isometry3::translation(
                            x,
                            0.02 * f64::from(k),
                            0.1,
                        )),
                        q_rad: vec![0.01 * f64::from(k); hand.dof()],
                        rates: (),
                    })
                    .collect(),
            )
            .unwrap(),
        };
        let set = TrainingSet {
            scenes: vec![scene.clone()],
            tracks: vec![track("a", 0.1), track("b", -0.1)],
            distances: BTreeMap::new(),
        };
        let cgf = cgf::train(&set, &Arc::new(hand), &network, &training, 7, |_| {})
            .unwrap()
            .last;
        Self::of(cgf, scene)
    }

    fn of(cgf: Cgf, scene: RestingObject) -> Self {
        let mut random = Random::new(2, 0);
        let width = cgf.description().network.latent_dim;
        let mut noise = |_| (0..width).map(|_| random.normal()).collect();
        Self {
            times: Cgf::times(STEPS),
            noise: (0..TURN).map(&mut noise).collect(),
            cgf,
            scene,
        }
    }

    fn values(&self, pool: &ThreadPool, n: usize) -> f64 {
        self.timed(pool, |feature| {
            let latents = self.latents(feature, n);
            black_box(self.cgf.decode(feature, &latents, &self.times).unwrap());
        })
    }

    fn rates(&self, pool: &ThreadPool, n: usize) -> f64 {
        self.timed(pool, |feature| {
            let latents = self.latents(feature, n);
            black_box(
                self.cgf
                    .decode_with_rates(feature, &latents, &self.times)
                    .unwrap(),
            );
        })
    }

    fn latents(&self, feature: &ObjectFeature, n: usize) -> Vec<Vec<f64>> {
        let noise = self.noise.get(..n).unwrap().to_vec();
        self.cgf.prior_codes(feature, noise).unwrap()
    }

    /// Returns the CPU seconds of the object's feature and of the work with it.
    fn timed(&self, pool: &ThreadPool, work: impl Fn(&ObjectFeature) + Sync) -> f64 {
        pool.install(|| {
            let before = cpu_time::thread_s();
            work(&self.cgf.feature(&self.scene).unwrap());
            cpu_time::thread_s() - before
        })
    }
}

/// A cloud of points on a table.
fn scene() -> RestingObject {
    let mut random = Random::new(1, 0);
    let mut point = |_| Point3::from(Vector3::from_fn(|_, _| 0.05 * random.normal()));
    RestingObject {
        object: "cloud".to_owned(),
        rest: RestingPose {
            up_in_object: Vector3::z_axis(),
            height_m: 0.1,
        },
        points_in_object: (0..2000).map(&mut point).collect(),
    }
}

/// The options of `pipelines/cgf.toml`.
fn options() -> (NetworkConfig, TrainingConfig) {
    let text = include_str!("../../pipelines/cgf.toml");
    let read = Pipeline::parse("cgf.toml".as_ref(), text, &pipeline::kinds(), None, &[]).unwrap();
    let train = read.find("train").unwrap().options::<Train>().unwrap();
    (train.network.clone(), train.training.clone())
}

/// PyTorch in a process of its own.
struct Torch {
    script: Script,
    version: String,
}

impl Torch {
    fn start(ours: &Ours) -> Result<Self, String> {
        let mut script = Script::start(&python::name(), "sampling/torch_ways.py", &[], 1)?;
        let description = ours.cgf.description();
        let sizes = json!({
            "steps": STEPS,
            "latent": description.network.latent_dim,
            "points": description.network.points,
            "point_widths": description.network.point_widths,
            "widths": description.network.decoder_widths,
            "outputs": 9 + description.joints.len(),
        });
        let said: Value = serde_json::from_str(&script.ask(&sizes.to_string())?).unwrap();
        Ok(Self {
            script,
            version: said["torch"].as_str().unwrap().to_owned(),
        })
    }

    /// Samples so many motions, and returns the CPU seconds that it took.
    fn sample(&mut self, way: &str, motions: usize) -> f64 {
        let request = json!({ "way": way, "motions": motions });
        let said = self.script.ask_again(&request.to_string());
        let said: Value = serde_json::from_str(&said).unwrap();
        said["seconds"].as_f64().unwrap()
    }
}
