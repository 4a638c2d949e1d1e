//! What a run does while its depot is down, and what it says of it.

use std::{
    sync::Arc,
    time::{Duration, SystemTime},
};

use clap::ValueEnum;
use lake::{DepotOutage, DepotOutageListener, OutagePolicy, Sharing};

use crate::{label::Label, progress::Quiet, report, timestamps};

/// Minutes for which a run waits for a depot that is down: a night, so that a disk that is full at three in the
/// morning ends no run before somebody comes at nine.
pub(crate) const PATIENCE_MIN: f64 = 480.0;

/// Time for which requests are made again where a run is not to wait.
const SHORT: Duration = Duration::from_secs(30);

/// What a run does when its depot stays down.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum DepotDown {
    /// Wait until it is back
    Wait,
    /// Fail after half a minute
    Fail,
    /// Go on without it after 5 s, and make everything here
    Alone,
}

/// Returns how a run uses its depot.
pub(crate) fn run_sharing(when_down: DepotDown, patience_min: f64, quiet: Quiet) -> Sharing {
    let patience = minutes(patience_min);
    let (patience, outage_policy) = match when_down {
        DepotDown::Wait => (patience, OutagePolicy::Fail),
        DepotDown::Fail => (patience.min(SHORT), OutagePolicy::Fail),
        DepotDown::Alone => {
            let alone = Sharing::default();
            (alone.patience, alone.outage_policy)
        }
    };
    Sharing {
        patience,
        outage_policy,
        on_outage: Some(listener(quiet, outage_policy)),
    }
}

/// Returns how a command uses a depot without which it makes no sense.
pub(crate) fn required_sharing(quiet: Quiet) -> Sharing {
    Sharing {
        patience: SHORT,
        outage_policy: OutagePolicy::Fail,
        on_outage: Some(listener(quiet, OutagePolicy::Fail)),
    }
}

/// Returns how a worker uses its depot: until the time of its job ends.
pub(crate) fn worker_sharing(patience: Duration) -> Sharing {
    Sharing {
        patience,
        outage_policy: OutagePolicy::Fail,
        on_outage: Some(listener(Quiet::No, OutagePolicy::Fail)),
    }
}

/// A number of minutes that a person gave.
pub(crate) fn minutes(number: f64) -> Duration {
    Duration::try_from_secs_f64(number * 60.0).unwrap_or(Duration::MAX / 2)
}

fn listener(quiet: Quiet, outage_policy: OutagePolicy) -> Arc<DepotOutageListener> {
    Arc::new(move |outage| {
        if quiet == Quiet::No {
            let (label, text, hint) = described(outage, outage_policy);
            report::line_with_hint(label, text, hint.as_deref());
        }
    })
}

/// Describes an outage, or its end, and what to do.
fn described(outage: &DepotOutage, outage_policy: OutagePolicy) -> (Label, String, Option<String>) {
    let requests = &outage.outage;
    let Some(why) = &requests.why else {
        let lasted = report::duration(requests.lasted.as_secs_f64());
        let text = format!("the depot is back after {lasted}");
        return (Label::Note, text, None);
    };
    let since = clock(outage.since);
    if outage.is_of_sending {
        let text = format!("results are not sent to the depot since {since}: {why}");
        let hint = "they are kept in the lake, and sent when it is back";
        return (Label::Wait, text, Some(hint.to_owned()));
    }
    let left = report::duration(requests.left.as_secs_f64());
    let at_stake = outage.at_stake.as_ref();
    let at_stake =
        at_stake.filter(|(_, n_units)| *n_units > 0 && outage_policy == OutagePolicy::Fail);
    let hint = at_stake.map(|(node, n_units)| {
        format!(
            "without it {n_units} units of `{node}` would be made again, and what follows from them: \
             `--depot-down alone` does that"
        )
    });
    let text = format!("the depot does not answer since {since}, waiting for up to {left}: {why}");
    (Label::Wait, text, hint)
}

/// A time of the day to the second.
fn clock(time: SystemTime) -> String {
    let since_1970 = time.duration_since(SystemTime::UNIX_EPOCH);
    let since_1970_ns = since_1970.map_or(0, |it| it.as_nanos());
    let second = timestamps::second(u64::try_from(since_1970_ns).unwrap_or(u64::MAX));
    second.replace('T', " ")
}

#[cfg(test)]
mod tests {
    use depot::Outage;

    use super::*;

    #[test]
    fn an_outage_says_since_when_for_what_and_how_much_would_be_made_again() {
        let requests = Outage {
            lasted: Duration::from_secs(6),
            why: Some("cannot list `units` in the depot: down".to_owned()),
            left: Duration::from_hours(8),
        };
        let mut outage = DepotOutage {
            since: SystemTime::UNIX_EPOCH,
            outage: requests,
            is_of_sending: false,
            at_stake: Some((dataflow::NodeName::parse("split.parts").unwrap(), 101)),
        };
        let (label, said, hint) = described(&outage, OutagePolicy::Fail);
        assert_eq!(label, Label::Wait);
        for part in [
            "since 1970-01-01 00:00:00Z",
            "for up to 8 h 00 min: cannot list `units`",
        ] {
            assert!(said.contains(part), "{said}");
        }
        let hint = hint.unwrap();
        assert!(
            hint.contains("101 units of `split.parts` would be made again"),
            "{hint}"
        );
        assert!(described(&outage, OutagePolicy::Alone).2.is_none());
        outage.outage.why = None;
        assert_eq!(
            described(&outage, OutagePolicy::Fail),
            (
                Label::Note,
                "the depot is back after 6.0 s".to_owned(),
                None
            )
        );
    }
}
