//! Times in UTC for people and programs, so that a lake looks the same everywhere.

use jiff::Timestamp;

/// A time to the minute, e.g. `2026-11-21 14:03`.
pub(crate) fn minute(since_1970_ns: u64) -> String {
    written(since_1970_ns, "%Y-%m-%d %H:%M")
}

/// A time to the second, e.g. `2026-11-21T14:03:09Z`.
pub(crate) fn second(since_1970_ns: u64) -> String {
    written(since_1970_ns, "%Y-%m-%dT%H:%M:%SZ")
}

fn written(since_1970_ns: u64, format: &str) -> String {
    match Timestamp::from_nanosecond(since_1970_ns.into()) {
        Ok(time) => time.strftime(format).to_string(),
        // The largest 64-bit time is in 2554.
        Err(err) => unreachable!("every such number is a time before 9999: {err}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nanoseconds in a second.
    const SECOND_NS: u64 = 1_000_000_000;

    #[test]
    fn days_around_leap_days_and_new_years_are_right() {
        for (seconds, text) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_399, "2000-02-28T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (951_868_800, "2000-03-01T00:00:00Z"),
            (1_795_269_789, "2026-11-21T14:03:09Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
            (4_107_542_399, "2100-02-28T23:59:59Z"),
            (1_735_689_599, "2024-12-31T23:59:59Z"),
        ] {
            assert_eq!(second(seconds * SECOND_NS), text);
        }
        assert_eq!(second(u64::MAX), "2554-07-21T23:34:33Z");
        assert_eq!(minute(1_795_269_789 * SECOND_NS), "2026-11-21 14:03");
    }
}
