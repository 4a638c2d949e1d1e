//! A robot cell on ROS 2: an arm and a hand whose `joint_trajectory_controller`s are reached through
//! `rmw_zenoh`. `README.md` beside this file leads from a robot that is up to its first motion.

mod config;
mod controllers;
mod emulated;
mod executing;
mod machine;
mod measurements;
mod path;

use std::{
    io::Write,
    path::Path,
    process::ExitCode,
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use cell::{CellServer, PlannedFault, Report, ServerConfig, ServiceConfig};

use robot::Joint;

use crate::{
    config::Config,
    emulated::{Behavior, Emulated},
    machine::Ros2Machine,
};

const USAGE: &str = "\
Usage: ros2_cell check CONFIG
       ros2_cell serve CONFIG [--fault FAULT]...
       ros2_cell emulate CONFIG [ARM HAND]

check     says whether the robot is ready for goals; nothing moves
serve     waits until the robot is ready, then serves a cell until Ctrl-C; a motion under way brakes
          then, and its outcome is unknown
emulate   stands in for the ROS 2 controllers; ARM and HAND are each sound, late, jerky, refusing,
          dying or runaway [default: sound]";

/// Timeout of `check` for a robot that is not ready.
const CHECK: Duration = Duration::from_secs(3);
/// Poll period of `check`.
const LOOK: Duration = Duration::from_millis(100);
/// Poll period for a robot that is not ready to be served.
const WAIT: Duration = Duration::from_millis(500);
/// Number of latest updates of the emulated controllers in which the joints must rest to count as still.
const STEPS: usize = 50;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let done = match words.as_slice() {
        ["check", config] => check(Path::new(config)),
        ["serve", config, faults @ ..] => serve(Path::new(config), faults),
        ["emulate", config] => emulate(Path::new(config), ["sound"; 2]),
        ["emulate", config, arm, hand] => emulate(Path::new(config), [arm, hand]),
        _ => Err(USAGE.to_owned()),
    };
    match done {
        Ok(code) => code,
        Err(message) => {
            say(&message);
            ExitCode::FAILURE
        }
    }
}

fn check(path: &Path) -> Result<ExitCode, String> {
    let machine = Ros2Machine::new(Config::read(path)?)?;
    let until = Instant::now() + CHECK;
    while !machine.is_ready() && Instant::now() < until {
        thread::sleep(LOOK);
    }
    let found = machine.readiness();
    for (what, found) in &found {
        match found {
            Ok(()) => say(&format!("ok     {what}")),
            Err(why) => say(&format!("wrong  {what}: {why}")),
        }
    }
    for line in machine.positions() {
        say(&line);
    }
    let is_ready = found.iter().all(|(_, found)| found.is_ok());
    Ok(ExitCode::from(u8::from(!is_ready)))
}

fn serve(path: &Path, faults: &[&str]) -> Result<ExitCode, String> {
    let config = Config::read(path)?;
    let planned = faults.chunks(2).map(|pair| match pair {
        ["--fault", fault] => fault.parse(),
        _ => Err(USAGE.to_owned()),
    });
    let service = ServiceConfig {
        journal: Some(config.journal.clone()),
        real_time: true,
        router: Some(config.router.clone()),
        faults: planned.collect::<Result<Vec<PlannedFault>, String>>()?,
        ..ServiceConfig::default()
    };
    let server = ServerConfig {
        name: config.cell.clone(),
        listen: String::new(),
        service,
    };
    let machine = Arc::new(Ros2Machine::new(config)?);
    while !machine.is_ready() {
        for (what, found) in machine.readiness() {
            let _told = found.map_err(|why| say(&format!("wait   {what}: {why}")));
        }
        thread::sleep(WAIT);
    }
    let cell = CellServer::start(server, machine).map_err(|err| {
        let hint = err.hint().map(|hint| format!("\nhint: {hint}"));
        cell::with_causes(&err) + &hint.unwrap_or_default()
    })?;
    cell.on_outcome(Box::new(|over: &Report| {
        let outcome = over.outcome.as_str();
        say(&format!(
            "goal   {} {outcome}: {}",
            over.goal_id, over.message
        ));
    }));
    ready(cell.endpoint());
    loop {
        thread::park();
    }
}

fn emulate(path: &Path, behaviors: [&str; 2]) -> Result<ExitCode, String> {
    let config = Config::read(path)?;
    let robot = config.load()?;
    let [arm, hand] = behaviors.map(str::parse::<Behavior>);
    let start = [robot.arm_joints(), robot.hand_joints()]
        .map(|joints| joints.iter().map(Joint::nearest_zero).collect());
    let emulated = Emulated::start(&config, &robot, [arm?, hand?], start)?;
    emulated.put_object(0.05);
    ready(&config.router);
    let (mut told_n, mut was_moving) = (0, false);
    loop {
        thread::sleep(LOOK);
        let log = emulated.log();
        for why in log.refused.iter().skip(told_n) {
            say(&format!("refused: {why}"));
        }
        told_n = log.refused.len();
        let mut recent = log.steps.iter().rev().take(STEPS);
        let is_moving = recent.any(|(_, change)| *change > 0.0);
        if is_moving != was_moving {
            let motion = log.motions_n;
            say(&format!(
                "joints {}, message stream {motion}",
                if is_moving { "move" } else { "stand" }
            ));
        }
        was_moving = is_moving;
    }
}

/// Tells the program that waits for this one.
fn ready(endpoint: &str) {
    let mut out = std::io::stdout();
    let _told = writeln!(out, "{endpoint}").and_then(|()| out.flush());
}

fn say(line: &str) {
    let _told = writeln!(std::io::stderr(), "{line}");
}
