//! Times in UTC for people and programs, so that a lake looks the same everywhere.

use std::time::{Duration, UNIX_EPOCH};

/// A time to the minute, e.g. `2026-11-21 14:03`.
pub(crate) fn minute(since_1970_ns: u64) -> String {
    let mut minute = second(since_1970_ns).replace('T', " ");
    minute.truncate("2026-11-21 14:03".len());
    minute
}

/// A time to the second, e.g. `2026-11-21T14:03:09Z`.
pub(crate) fn second(since_1970_ns: u64) -> String {
    // The largest 64-bit time is in 2554, and it can write those before 9999.
    let time = UNIX_EPOCH + Duration::from_nanos(since_1970_ns);
    humantime::format_rfc3339_seconds(time).to_string()
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
