//! Access rules: the shipped access files over real sockets, with certificates that live as long as a
//! test.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::mpsc::{self, RecvTimeoutError},
    thread,
    time::Duration,
};

use cell::{
    Access, CellClient, CellError, ControlReply, Keys, ModelMismatch, Patience, Router,
    ServiceConfig, SimulatedCell, SimulatedCellConfig, WatchEvent, Watcher,
};
use schemas::executions::Outcome;
use zenoh::{Session, Wait};

use crate::{
    credential_folder::CredentialFolder,
    lab::{GRIPPER, SOON, addressed, cube, execute, goal, report, robot, scene, terms},
};

/// Timeout of a client that is refused.
const REFUSED: Duration = Duration::from_secs(2);
/// Waits no longer than that.
const IMPATIENT: Patience = Patience {
    answer: REFUSED,
    result: REFUSED,
};
/// Folder of the shipped files.
const SHIPPED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../data/access");
/// The two ways of authentication.
const WAYS: [&str; 2] = ["certificates", "passwords"];

/// Certificates and access files of a test, and the clients and servers that use them.
struct People(CredentialFolder);

impl People {
    fn new() -> Self {
        Self(CredentialFolder::new(Path::new(SHIPPED)))
    }

    fn file(&self, way: &str, who: &str) -> PathBuf {
        self.0.file(way, who)
    }

    fn access(&self, way: &str, who: &str) -> Access {
        Access::read(&self.file(way, who)).unwrap()
    }

    fn router(&self, way: &str) -> Router {
        Router::start("tls/localhost:0", Some(&self.access(way, "router"))).unwrap()
    }

    /// Starts a cell that connects to a router.
    fn cell(&self, way: &str, router: &Router, service: ServiceConfig) -> SimulatedCell {
        let config = SimulatedCellConfig {
            name: "simulated".to_owned(),
            listen: String::new(),
            scene: scene(),
            arm: None,
            mismatch: ModelMismatch::default(),
            service: ServiceConfig {
                router: Some(router.endpoint().to_owned()),
                access: Some(self.file(way, "cell")),
                ..service
            },
        };
        let cell = SimulatedCell::start(config, GRIPPER).unwrap();
        cell.put_object("cube", cube());
        cell
    }

    fn client(&self, way: &str, who: &str, router: &Router) -> CellClient {
        let access = self.access(way, who);
        CellClient::connect_as(Some(&access), router.endpoint(), "simulated", SOON).unwrap()
    }

    /// Opens a session for actions of a dishonest client.
    fn session(&self, way: &str, who: &str, router: &Router) -> Session {
        let mut config = zenoh::Config::from_file(self.file(way, who)).unwrap();
        let endpoints = format!("[\"{}\"]", router.endpoint());
        for (key, value) in [
            ("mode", "\"client\""),
            ("connect/endpoints", endpoints.as_str()),
            ("scouting/multicast/enabled", "false"),
        ] {
            config.insert_json5(key, value).unwrap();
        }
        zenoh::open(config).wait().unwrap()
    }
}

#[test]
fn authenticated_dispatcher_has_its_goal_executed() {
    let credentials = People::new();
    for way in WAYS {
        let router = credentials.router(way);
        let cell = credentials.cell(way, &router, ServiceConfig::default());
        let client = credentials.client(way, "dispatcher", &router);
        assert!(client.capabilities(SOON).unwrap().simulated);
        let report = execute(&client, &goal(0.04));
        assert_eq!(report.outcome, Outcome::Succeeded, "{way}");
        assert_eq!(client.stop(SOON).unwrap(), ControlReply::Done);
        assert_eq!(client.resume(SOON).unwrap(), ControlReply::Done);
        assert_eq!(
            client.cancel("00", SOON).unwrap(),
            ControlReply::UnknownGoal
        );
        assert_eq!(cell.executed_count(), 1);
    }
}

#[test]
fn listening_cell_authenticates_its_peers() {
    let credentials = People::new();
    let config = SimulatedCellConfig {
        name: "simulated".to_owned(),
        listen: "tls/localhost:0".to_owned(),
        scene: scene(),
        arm: None,
        mismatch: ModelMismatch::default(),
        service: ServiceConfig {
            access: Some(credentials.file("certificates", "router")),
            ..ServiceConfig::default()
        },
    };
    let cell = SimulatedCell::start(config, GRIPPER).unwrap();
    cell.put_object("cube", cube());
    let connect = |who: &str| {
        let access = credentials.access("certificates", who);
        CellClient::connect_as(Some(&access), cell.endpoint(), "simulated", SOON).unwrap()
    };
    let there = terms(&connect("dispatcher"));
    let unheard = connect("viewer").execute(&goal(0.04), &there, &robot(), IMPATIENT, &());
    assert!(
        matches!(unheard, Err(CellError::NoAnswer { .. })),
        "{unheard:?}"
    );
    assert_eq!(cell.executed_count(), 0);
    let report = execute(&connect("dispatcher"), &goal(0.04));
    assert_eq!(report.outcome, Outcome::Succeeded);
}

#[test]
fn unauthenticated_peer_is_refused() {
    let credentials = People::new();
    let others = People::new();
    for way in WAYS {
        let router = credentials.router(way);
        let refused = |access: Option<Access>| {
            let err =
                CellClient::connect_as(access.as_ref(), router.endpoint(), "simulated", REFUSED);
            err.map(drop).unwrap_err()
        };
        let err = refused(None);
        assert!(matches!(err, CellError::NoAccess { .. }), "{way}: {err}");
        let err = refused(Some(others.access(way, "dispatcher")));
        assert!(matches!(err, CellError::Tls { .. }), "{way}: {err}");
        let said = err.to_string();
        assert!(said.contains("its certificate is not issued by"), "{said}");
    }
    // An expired certificate.
    let once = People::new();
    let router = once.router("certificates");
    once.0.certify("dispatcher", 2020);
    let access = once.access("certificates", "dispatcher");
    let refused = CellClient::connect_as(Some(&access), router.endpoint(), "simulated", REFUSED);
    assert!(refused.is_err());
    // Clients that know the authority but have no certificate, or a wrong name or password.
    let router = credentials.router("certificates");
    let access = credentials.access("passwords", "dispatcher");
    let refused = CellClient::connect_as(Some(&access), router.endpoint(), "simulated", REFUSED);
    assert!(refused.is_err());
    let router = credentials.router("passwords");
    for (from, to) in [
        ("secret of dispatcher", "a guess"),
        ("user: \"dispatcher\"", "user: \"somebody\""),
    ] {
        let file = credentials.file("passwords", "dispatcher");
        let text = fs::read_to_string(&file).unwrap();
        assert!(text.contains(from));
        fs::write(&file, text.replace(from, to)).unwrap();
        let access = Access::read(&file).unwrap();
        let refused =
            CellClient::connect_as(Some(&access), router.endpoint(), "simulated", REFUSED);
        assert!(refused.is_err(), "{to}");
    }
}

#[test]
fn watcher_sees_everything_and_moves_nothing() {
    let credentials = People::new();
    for way in WAYS {
        let router = credentials.router(way);
        let cell = credentials.cell(way, &router, ServiceConfig::default());
        let viewer = credentials.client(way, "viewer", &router);
        let dispatcher = credentials.client(way, "dispatcher", &router);
        let access = credentials.access(way, "viewer");
        let mut watcher =
            Watcher::start(Some(&access), router.endpoint(), "simulated", SOON).unwrap();

        let err = viewer.capabilities(REFUSED).unwrap_err();
        assert!(matches!(err, CellError::NoAnswer { .. }), "{err}");
        let hint = err.hint().unwrap();
        assert!(
            hint.contains("access rules") && hint.contains("viewer.json5"),
            "{hint}"
        );
        let there = terms(&dispatcher);
        let unheard = viewer.execute(&goal(0.04), &there, &robot(), IMPATIENT, &());
        assert!(
            matches!(unheard, Err(CellError::NoAnswer { .. })),
            "{unheard:?}"
        );
        assert_eq!(viewer.stop(REFUSED).unwrap(), ControlReply::NoAnswer);
        assert_eq!(cell.executed_count(), 0);
        // The viewer's stop has stopped nothing, and its resume takes no stop back.
        let report = execute(&dispatcher, &goal(0.04));
        assert_eq!(report.outcome, Outcome::Succeeded, "{way}");
        assert_eq!(
            viewer.cancel(&report.goal_id, REFUSED).unwrap(),
            ControlReply::NoAnswer
        );
        assert_eq!(dispatcher.stop(SOON).unwrap(), ControlReply::Done);
        assert_eq!(viewer.resume(REFUSED).unwrap(), ControlReply::NoAnswer);
        let mut other = goal(0.04);
        other.attempt = 2;
        let there = terms(&dispatcher);
        let refused = dispatcher.execute(&other, &there, &robot(), IMPATIENT, &());
        assert!(
            matches!(refused, Err(CellError::Stopped { .. })),
            "{refused:?}"
        );

        // Nor does it pass for a cell.
        let liar = credentials.session(way, "viewer", &router);
        let keys = Keys::new("simulated").unwrap();
        let _queryable = liar
            .declare_queryable(keys.all())
            .callback(|query| query.reply(query.key_expr(), "{}\n").wait().unwrap())
            .wait()
            .unwrap();
        assert!(dispatcher.capabilities(SOON).is_ok(), "one cell answers");

        // Publications of a viewer in the cell's name reach nobody.
        for key in [keys.state(), keys.outcome("00"), keys.motion()] {
            liar.put(key, "{}\n").wait().unwrap();
        }
        let (mut states, mut motions, mut outcomes) = (0, 0, Vec::new());
        while let Some(seen) = watcher.next(Duration::from_millis(500)) {
            match seen {
                WatchEvent::State(_) => states += 1,
                WatchEvent::Motion(..) => motions += 1,
                WatchEvent::Outcome(outcome) => outcomes.push(outcome.goal_id),
                _ => {}
            }
        }
        let counts = watcher.counts();
        assert_eq!(
            (states, motions),
            (report.samples.len(), 1),
            "{way}: {counts:?}"
        );
        assert_eq!(outcomes, [report.goal_id]);
        assert_eq!(watcher.counts().unreadable_n, 0);
    }
}

#[test]
fn heartbeat_of_a_watcher_keeps_no_motion_alive() {
    let credentials = People::new();
    let way = "certificates";
    let router = credentials.router(way);
    let service = ServiceConfig {
        real_time: true,
        ..ServiceConfig::default()
    };
    let _cell = credentials.cell(way, &router, service);
    let keys = Keys::new("simulated").unwrap();
    // A dispatcher that falls silent right after its goal, while another sends heartbeats.
    let ended = |beats: &Session, attempt: u32| {
        let dispatcher = credentials.session(way, "dispatcher", &router);
        let mut goal = goal(0.04);
        goal.attempt = attempt;
        let client = credentials.client(way, "dispatcher", &router);
        let sealed = addressed(&client, &goal, "me");
        let ask = |key: String, payload: &[u8]| {
            let replies = dispatcher.get(key).payload(payload).timeout(SOON);
            let reply = replies.wait().unwrap().recv().unwrap();
            reply
                .into_result()
                .unwrap()
                .payload()
                .to_bytes()
                .into_owned()
        };
        let (over, beating) = mpsc::channel::<()>();
        let beat_key = keys.heartbeat();
        thread::scope(|scope| {
            // Moved into this closure, so that a failure in it ends the heartbeats, too.
            let over = over;
            scope.spawn(move || {
                let pause = Duration::from_millis(50);
                while beating.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                    let beat = "{\"dispatcher\":\"me\"}\n";
                    beats.put(&beat_key, beat).wait().unwrap();
                }
            });
            ask(keys.goal(), &sealed.bytes);
            let report = report(&ask(keys.result(&sealed.encoded.goal_id), &[]), &goal);
            drop(over);
            report
        })
    };
    let report = ended(&credentials.session(way, "viewer", &router), 1);
    assert_eq!(report.outcome, Outcome::Aborted, "{}", report.message);
    assert!(
        report.message.contains("no heartbeat"),
        "{}",
        report.message
    );
    let report = ended(&credentials.session(way, "dispatcher", &router), 2);
    assert_eq!(report.outcome, Outcome::Succeeded, "{}", report.message);
}

#[test]
fn a_message_that_is_too_long_does_not_reach_the_cell() {
    let credentials = People::new();
    for way in WAYS {
        let router = credentials.router(way);
        let _cell = credentials.cell(way, &router, ServiceConfig::default());
        let dispatcher = credentials.session(way, "dispatcher", &router);
        let keys = Keys::new("simulated").unwrap();
        let answered = |key: String, bytes: usize, wait: Duration| {
            let get = dispatcher.get(key).payload(vec![b' '; bytes]);
            let replies = get.timeout(wait).wait().unwrap();
            replies
                .recv()
                .is_ok_and(|reply| reply.into_result().is_ok())
        };
        assert!(
            answered(keys.goal(), 8 << 20, SOON),
            "{way}: the cell refuses it"
        );
        assert!(!answered(keys.goal(), (8 << 20) + 1, REFUSED), "{way}");
        assert!(answered(keys.resume(), 1024, SOON), "{way}");
        assert!(!answered(keys.stop(), 1025, REFUSED), "{way}");
        let client = credentials.client(way, "dispatcher", &router);
        assert_eq!(execute(&client, &goal(0.04)).outcome, Outcome::Succeeded);
    }
}

#[test]
fn both_access_files_grant_the_same_rights() {
    let rules = |way: &str| {
        let file = Path::new(SHIPPED).join(way).join("router.json5");
        let config = zenoh::Config::from_file(file).unwrap();
        let said = |key| config.get_json(key).unwrap();
        [
            "access_control/rules",
            "access_control/policies",
            "low_pass_filter",
        ]
        .map(said)
    };
    assert_eq!(rules("certificates"), rules("passwords"));
}
