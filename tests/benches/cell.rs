//! Latency of a simulated cell after a goal, and jitter of its hand commands at 333 Hz, against the same loop with no
//! zenoh in it.
//!
//! `cargo bench --bench cell` sends the same motion of the bundled hand as a new goal, again and again, to a cell in
//! real time with a subscriber, and then has it carried out by the same physics at the same times in this process
//! alone. Lateness is that of each step of the loop behind its time.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]
#![expect(clippy::panic, reason = "a bench may break off")]
#![expect(clippy::cast_precision_loss, reason = "counts are small")]
#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a share of a count"
)]

#[path = "screening/can.rs"]
mod can;
#[path = "screening/options.rs"]
mod options;

use std::{
    sync::mpsc,
    time::{Duration, Instant},
};

use cell::{
    CellClient, Goal, GoalResult, Grasp, JointPoint, JointRates, JointTrack, Keys, ModelMismatch,
    Pacer, PalmPoint, PalmTrajectory, Patience, ServiceConfig, SimulatedCell, SimulatedCellConfig,
    Terms, Tick, execute_offline, robot_digest, subscribe,
};
use nalgebra::Isometry3;
use robot::RobotModel;
use simulation::{ObjectShape, SceneConfig};
use spatial::{Pose, Twist};

/// Goals of each kind.
const GOALS: u32 = 20;
/// The rate of the hand's controllers, in 1/s.
const RATE_HZ: f64 = 333.0;
const SOON: Duration = Duration::from_secs(20);
const URDF: &str = include_str!("../../data/robots/allegro_right.urdf");

fn main() {
    let object = can::can();
    println!(
        "{GOALS} goals of {:.1} s at {RATE_HZ} Hz, the bundled hand beside a can",
        length_s(&goal(0))
    );
    let with = over_zenoh(&object);
    let without = alone(&object);
    row("goal sent to first command", &with.sent_ms, "ms");
    row("goal arrived to first command", &with.arrived_ms, "ms");
    row("lateness of a step, over zenoh", &with.late_us, "us");
    row("lateness of a step, no zenoh", &without, "us");
    let late = |late: &[f64]| quantile(late, 0.99);
    println!(
        "99 % quantile with and without zenoh: {:.2} times",
        late(&with.late_us) / late(&without)
    );
}

struct Measured {
    sent_ms: Vec<f64>,
    arrived_ms: Vec<f64>,
    late_us: Vec<f64>,
}

/// Sends goals to a cell with a subscriber.
fn over_zenoh(object: &ObjectShape) -> Measured {
    let cell = SimulatedCell::start(config(), URDF).unwrap();
    cell.put_object("can", object.clone());
    let (ticks, seen) = mpsc::channel::<(Instant, Tick)>();
    cell.on_tick(Box::new(move |tick| {
        let _gone = ticks.send((Instant::now(), tick));
    }));
    let keys = Keys::new(cell.name()).unwrap();
    let (_session, _watching) = subscribe(cell.endpoint(), &keys.all(), SOON).unwrap();
    let client = CellClient::connect(cell.endpoint(), cell.name(), SOON).unwrap();
    let mut measured = Measured {
        sent_ms: Vec::new(),
        arrived_ms: Vec::new(),
        late_us: Vec::new(),
    };
    let robot = RobotModel::from_urdf(URDF).unwrap();
    let terms = Terms::new(client.capabilities(SOON).unwrap(), false);
    let patience = Patience {
        answer: SOON,
        result: SOON,
    };
    for attempt in 0..GOALS {
        let sent = Instant::now();
        let done = client
            .execute(&goal(attempt), &terms, robot.joints(), patience, &())
            .unwrap();
        let GoalResult::Report(report) = done else {
            panic!("{done:?}");
        };
        assert!(report.rejection.is_none(), "{}", report.message);
        for (idx, (at, tick)) in seen.try_iter().enumerate() {
            if idx == 0 {
                measured
                    .sent_ms
                    .push(1e3 * at.duration_since(sent).as_secs_f64());
                measured.arrived_ms.push(1e3 * tick.since_goal_s);
            }
            measured.late_us.push(1e6 * tick.late_s);
        }
    }
    measured
}

/// Carries the same goals out in this process alone.
fn alone(object: &ObjectShape) -> Vec<f64> {
    let mut late_us = Vec::new();
    for attempt in 0..GOALS {
        let mut pacer = Pacer::default();
        let report = execute_offline(&config(), URDF, object, &goal(attempt), &mut |sample| {
            late_us.push(1e6 * pacer.wait(sample.time_s));
            None
        });
        assert!(report.unwrap().rejection.is_none());
    }
    late_us
}

fn config() -> SimulatedCellConfig {
    let scene = options::screen(false, Some("table_lift")).scene;
    SimulatedCellConfig {
        name: "bench".to_owned(),
        listen: "tcp/127.0.0.1:0".to_owned(),
        scene: SceneConfig {
            time_step_s: 1.0 / RATE_HZ,
            steps_per_control: 1,
            ..scene
        },
        arm: None,
        mismatch: ModelMismatch::default(),
        service: ServiceConfig {
            real_time: true,
            ..ServiceConfig::default()
        },
    }
}

/// The palm stands above a can and the fingers beckon, for two seconds; then they close on nothing.
fn goal(attempt: u32) -> Goal {
    let protocol = options::screen(false, Some("table_lift")).protocol;
    let hand = options::hand();
    let reach_s = 2.0;
    let palm = |time_s: f64| PalmPoint {
        time_s,
        table_from_palm: Pose::new(Isometry3::translation(0.0, 0.0, 0.5)),
        velocity: Twist::zero(),
        acceleration: Twist::zero(),
    };
    let ticks = (reach_s * RATE_HZ) as u32;
    let point = |tick: u32| {
        let time_s = f64::from(tick) / RATE_HZ;
        let (sin, cos) = (std::f64::consts::TAU * time_s).sin_cos();
        let swing = 0.1;
        let speed = std::f64::consts::TAU * swing;
        let dof = hand.dof();
        JointPoint {
            time_s,
            q_rad: hand
                .mid_range()
                .iter()
                .map(|q| q + swing * (1.0 - cos))
                .collect(),
            rates: JointRates {
                velocity: vec![speed * sin; dof],
                acceleration: vec![std::f64::consts::TAU * speed * cos; dof],
            },
        }
    };
    Goal {
        candidate_id: "bench".to_owned(),
        object: "can".to_owned(),
        robot: robot_digest(URDF),
        attempt,
        resumed: 0,
        table_from_object: can::upright().table_from_object(),
        start_tolerance_rad: 0.1,
        grasp: Grasp {
            reach_s,
            ..Grasp::try_from(&protocol).unwrap()
        },
        carrier: PalmTrajectory::Palm(vec![palm(0.0), palm(reach_s)]),
        hand: JointTrack {
            joints: hand.joint_names(),
            points: (0..=ticks).map(point).collect(),
        },
    }
}

fn length_s(goal: &Goal) -> f64 {
    let grasp = &goal.grasp;
    grasp.reach_s + grasp.squeeze_s + grasp.pause_s + grasp.lift_s
}

fn quantile(numbers: &[f64], share: f64) -> f64 {
    let mut sorted = numbers.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = ((sorted.len() - 1) as f64 * share).round() as usize;
    sorted[at]
}

fn row(what: &str, numbers: &[f64], unit: &str) {
    let [half, most, nearly_all, all] = [0.5, 0.99, 0.999, 1.0].map(|q| quantile(numbers, q));
    println!(
        "{what:<32} median {half:8.1} {unit}, 99 % {most:8.1}, 99.9 % {nearly_all:8.1}, most {all:8.1} (of {})",
        numbers.len()
    );
}
