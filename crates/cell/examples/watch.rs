//! Prints what happens at a robot cell: `cargo run --release -p cell --example watch -- [ENDPOINT] [CELL]`.

#![expect(clippy::print_stdout, reason = "an example for a terminal")]

use std::{env, error::Error, time::Duration};

use cell::{Keys, SealedGoal, StateHeader, subscribe};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = env::args().skip(1);
    let endpoint = arguments
        .next()
        .unwrap_or_else(|| "tcp/127.0.0.1:7447".to_owned());
    let keys = Keys::new(arguments.next().as_deref().unwrap_or("simulated"))?;
    let (_session, subscriber) = subscribe(&endpoint, &keys.all(), Duration::from_mins(10))?;
    while let Ok(sample) = subscriber.recv() {
        let bytes = sample.payload().to_bytes();
        let line = bytes
            .split(|&byte| byte == b'\n')
            .next()
            .unwrap_or_default();
        let key = sample.key_expr().as_str();
        if key == keys.motion() {
            match SealedGoal::open(&bytes) {
                Ok((sealed, goal)) => println!(
                    "motion   {} {} with {} steps",
                    sealed.goal_id,
                    goal.candidate_id,
                    goal.hand.points.len()
                ),
                Err(rejection) => println!("motion   unreadable: {}", rejection.reason),
            }
        } else if key == keys.state() {
            let header: StateHeader = serde_json::from_slice(line)?;
            // One line a second is enough for the eye.
            if header.seq.is_multiple_of(100) {
                println!("state    {} sample {}", header.goal_id, header.seq);
            }
        } else {
            println!("outcome  {}", String::from_utf8_lossy(line));
        }
    }
    Ok(())
}
