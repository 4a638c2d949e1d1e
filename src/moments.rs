//! Times of day as people and programs read them, in UTC: the same wherever a lake is looked at.

/// Nanoseconds in a second.
const SECOND_NS: u64 = 1_000_000_000;

const SECONDS_PER_DAY: u64 = 86_400;

/// A time to the minute, e.g. `2026-11-21 14:03`.
pub(crate) fn minute(since_1970_ns: u64) -> String {
    let (date, second) = split(since_1970_ns);
    format!("{date} {:02}:{:02}", second / 3600, second / 60 % 60)
}

/// A time to the second, e.g. `2026-11-21T14:03:09Z`.
pub(crate) fn second(since_1970_ns: u64) -> String {
    let (date, second) = split(since_1970_ns);
    let (hour, minute) = (second / 3600, second / 60 % 60);
    format!("{date}T{hour:02}:{minute:02}:{:02}Z", second % 60)
}

/// The date, and the second of the day.
fn split(since_1970_ns: u64) -> (String, u64) {
    let seconds = since_1970_ns / SECOND_NS;
    let (year, month, day) = date(seconds / SECONDS_PER_DAY);
    (
        format!("{year:04}-{month:02}-{day:02}"),
        seconds % SECONDS_PER_DAY,
    )
}

/// The year, month and day so many days after 1970-01-01, in years that begin with March, so that
/// the leap day is a year's last.
fn date(days: u64) -> (u64, u64, u64) {
    // Days from 0000-03-01 to 1970-01-01.
    let days = days + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let months_since_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * months_since_march + 2) / 5 + 1;
    let month = (months_since_march + 2) % 12 + 1;
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    (year, month, day)
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert_eq!(minute(1_795_269_789 * SECOND_NS), "2026-11-21 14:03");
    }
}
