//! The states of goals, searched: what the protocol promises holds in each, and every fault breaks it.

mod model;

use stateright::{Checker, HasDiscoveries, Model};

use self::model::{Action, Fault, ONCE, PERMITTED, Protocol, REFUSED, SUCCEEDED, UNKNOWN, walk};

fn protocol(motions: usize, attempts: usize, starts: u8) -> Protocol {
    Protocol {
        motions,
        attempts,
        starts,
        fault: None,
    }
}

#[test]
fn goals_keep_every_promise() {
    for protocol in [protocol(2, 1, 2), protocol(1, 2, 2)] {
        let checker = protocol.checker().threads(2).spawn_bfs().join();
        println!("{} states of {protocol:?}", checker.unique_state_count());
        checker.assert_properties();
    }
    // Without a crash of a cell no outcome is unknown.
    let checker = protocol(2, 2, 1).checker().threads(2).spawn_bfs().join();
    println!("{} states without crashes", checker.unique_state_count());
    for promise in [ONCE, PERMITTED, SUCCEEDED, REFUSED, UNKNOWN] {
        checker.assert_no_discovery(promise);
    }
}

#[test]
fn every_fault_breaks_a_promise() {
    for (fault, broken) in [
        (Fault::PermissionOfRun, PERMITTED),
        (Fault::LedgerOfOptions, ONCE),
        (Fault::AcceptedFreed, ONCE),
        (Fault::NoAddress, SUCCEEDED),
        (Fault::OtherJournal, ONCE),
        (Fault::RepeatFreed, REFUSED),
        (Fault::OpenInTurn, UNKNOWN),
        (Fault::UnknownIgnored, UNKNOWN),
        (Fault::KeyKept, ONCE),
    ] {
        let fault = Some(fault);
        let protocol = Protocol {
            fault,
            ..protocol(2, 1, 2)
        };
        let until = HasDiscoveries::AllOf([broken].into());
        let checker = protocol.checker().finish_when(until).spawn_bfs().join();
        let trace = checker.assert_any_discovery(broken).into_actions();
        println!("{fault:?}: {trace:?}");
    }
}

#[test]
fn walks_differ_by_seed_alone() {
    assert_eq!(walk(7, 40), walk(7, 40));
    let walks: Vec<Vec<Action>> = (0..20).map(|seed| walk(seed, 40)).collect();
    assert!(walks.iter().all(|walk| walk.len() == 40));
    let actions = [Action::Run, Action::LoseAnswer, Action::RaiseAttempt];
    for action in actions {
        assert!(walks.concat().contains(&action), "{action:?}");
    }
}
