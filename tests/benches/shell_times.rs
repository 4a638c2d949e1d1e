//! Processor time of the programs that a shell has started.

/// The seconds of children in what a shell's `times` says: its second line, e.g. `0m1.200s 0m0.300s`.
pub(crate) fn children_s(said: &str) -> f64 {
    let times = said.lines().nth(1).unwrap().split_whitespace();
    times
        .map(|time| {
            let (minutes, seconds) = time.trim_end_matches('s').split_once('m').unwrap();
            60.0 * minutes.parse::<f64>().unwrap() + seconds.parse::<f64>().unwrap()
        })
        .sum()
}
