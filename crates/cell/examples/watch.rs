//! Prints the events of a robot cell:
//! `cargo run --release -p cell --example watch -- [--seconds N] [--access FILE] [ENDPOINT] [CELL]`.

#![expect(clippy::print_stdout, reason = "an example for a terminal")]

use std::{
    env,
    error::Error,
    path::Path,
    time::{Duration, Instant},
};

use cell::{Access, WatchEvent, Watcher};

/// Timeout for a cell or its router to appear.
const WAIT: Duration = Duration::from_mins(10);
/// Longest wait for an event before the end time is checked.
const LOOK: Duration = Duration::from_millis(200);

fn main() -> Result<(), Box<dyn Error>> {
    let (mut places, mut seconds, mut access) = (Vec::new(), f64::INFINITY, None);
    let mut arguments = env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--seconds" => seconds = arguments.next().unwrap_or_default().parse()?,
            "--access" => {
                let file = arguments.next().unwrap_or_default();
                access = Some(Access::read(Path::new(&file))?);
            }
            _ => places.push(argument),
        }
    }
    let endpoint = places.first().map_or("tcp/127.0.0.1:7447", String::as_str);
    let cell = places.get(1).map_or("simulated", String::as_str);
    let mut watcher = Watcher::start(access.as_ref(), endpoint, cell, WAIT)?;
    let started = Instant::now();
    while started.elapsed().as_secs_f64() < seconds {
        match watcher.next(LOOK) {
            Some(WatchEvent::Alive) => println!("alive"),
            Some(WatchEvent::Gone) => println!("gone"),
            Some(WatchEvent::Motion(goal_id, goal)) => println!(
                "motion   {goal_id} {} with {} steps",
                goal.candidate_id,
                goal.hand.points.len()
            ),
            Some(WatchEvent::Outcome(over)) => println!(
                "outcome  {} {}: {} ({})",
                over.result_n,
                over.goal_id,
                over.outcome.as_str(),
                over.message
            ),
            // One line a second is enough for the eye.
            Some(WatchEvent::State(state)) if state.seq.is_multiple_of(100) => println!(
                "state    {} at {:.2} s of goal `{}`",
                state.seq, state.sample.time_s, state.goal_id
            ),
            Some(_) | None => {}
        }
    }
    let counts = watcher.counts();
    println!(
        "watched {:.0} s: {} states, of which {} were requested, {} lost; {} outcomes, of which {} were \
         requested; {} restarts of the cell, {} unreadable",
        started.elapsed().as_secs_f64(),
        counts.states_n,
        counts.recovered_n,
        counts.gaps_n,
        counts.outcomes_n,
        counts.recovered_outcomes_n,
        counts.restarts_n,
        counts.unreadable_n
    );
    Ok(())
}
