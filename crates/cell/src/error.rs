//! Errors of reaching or starting a cell.

use std::{error::Error, fmt, path::PathBuf, time::Duration};

use crate::{
    access::AccessFault,
    capabilities::{CapabilityChange, PalmLimitFault},
    tls::TlsFault,
    wire::WireError,
};

/// zenoh's error message, without its source location.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Cause(String);

impl From<zenoh::Error> for Cause {
    fn from(err: zenoh::Error) -> Self {
        let text = err.to_string();
        let message = text.split(" at /").next().unwrap_or_default();
        Self(message.trim_end_matches(['!', '.']).to_owned())
    }
}

/// What had been sent of a goal before a query failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transmission {
    /// Nothing: the robot has not moved for it.
    None,
    /// A message, which the cell may have accepted.
    Earlier,
}

impl fmt::Display for Transmission {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("; nothing was sent to the robot"),
            Self::Earlier => Ok(()),
        }
    }
}

/// Why a record of what is sent could not be written.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct RecordError(Box<dyn Error + Send + Sync>);

impl RecordError {
    /// Takes the recorder's own error.
    pub fn new(source: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self(source.into())
    }
}

/// Returns an error and its causes on one line.
pub fn with_causes(err: &dyn Error) -> String {
    let mut text = err.to_string();
    let mut cause = err.source();
    while let Some(next) = cause {
        text = format!("{text}: {next}");
        cause = next.source();
    }
    text
}

/// Reason why a cell could not be reached or started; the outcome of a goal is a [`crate::Report`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CellError {
    /// A cell's name cannot be part of a key.
    #[error("`{name}` is not a name for a cell")]
    Name {
        /// The name.
        name: String,
    },
    /// An endpoint is not of the form `tcp/HOST:PORT` or `tls/HOST:PORT`.
    #[error("`{endpoint}` is not an endpoint of the form `tcp/HOST:PORT` or `tls/HOST:PORT`")]
    Endpoint {
        /// The endpoint.
        endpoint: String,
    },
    /// An endpoint's host cannot be resolved.
    #[error("cannot find the host of `{endpoint}`")]
    Host {
        /// The endpoint.
        endpoint: String,
        /// The cause.
        source: std::io::Error,
    },
    /// An endpoint that other machines can reach is not protected.
    #[error(
        "`{endpoint}` is not on the loopback interface and not protected: whoever is on that network could \
         move the robot"
    )]
    NotLoopback {
        /// The endpoint.
        endpoint: String,
    },
    /// An endpoint open to other machines lacks an access file with trusted peers.
    #[error("`{endpoint}` needs an access file that names its trusted peers")]
    NoAccess {
        /// The endpoint.
        endpoint: String,
    },
    /// An access file cannot be used.
    #[error("cannot use the access file `{}`: {fault}", path.display())]
    Access {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        fault: AccessFault,
    },
    /// A certificate or key that an access file names cannot be used.
    #[error("`{}`, which the access file `{}` names, {fault}", file.display(), path.display())]
    Credentials {
        /// The access file.
        path: PathBuf,
        /// The certificate or key.
        file: PathBuf,
        /// What is wrong with it.
        fault: TlsFault,
    },
    /// Something answers at the endpoint, and no connection under TLS is made.
    #[error("no connection to `{endpoint}`: {fault}")]
    Tls {
        /// The endpoint.
        endpoint: String,
        /// Why.
        fault: TlsFault,
    },
    /// Nothing answers at the endpoint.
    #[error(
        "nothing answers at `{endpoint}`: no connection to the robot cell within {waited:.1?}; nothing was \
         sent to the robot"
    )]
    Connect {
        /// The endpoint of the cell.
        endpoint: String,
        /// The client's access file.
        access: Option<PathBuf>,
        /// The timeout.
        waited: Duration,
        /// zenoh's message.
        source: Cause,
    },
    /// No router answers at the endpoint.
    #[error("nothing answers at `{endpoint}`: no connection to the router within {waited:.1?}")]
    Router {
        /// The endpoint of the router.
        endpoint: String,
        /// The cell's access file.
        access: Option<PathBuf>,
        /// The timeout.
        waited: Duration,
        /// zenoh's message.
        source: Cause,
    },
    /// The endpoint is reachable, but no cell of this name answers.
    #[error(
        "the robot cell did not answer within {waited:.1?}{transmission}: key `{key}`, session `{endpoint}`"
    )]
    NoAnswer {
        /// The key queried.
        key: String,
        /// The session's endpoint.
        endpoint: String,
        /// The client's access file.
        access: Option<PathBuf>,
        /// The timeout.
        waited: Duration,
        /// What had been sent of a goal before.
        transmission: Transmission,
    },
    /// Several cells have the same name: each would execute the goal.
    #[error(
        "{count} robot cells answer to one name{transmission}: key `{key}`, session `{endpoint}`: {who}"
    )]
    SeveralCells {
        /// The key queried.
        key: String,
        /// The session's endpoint.
        endpoint: String,
        /// Number of cells that answered.
        count: usize,
        /// The responders, as text for people: each one's journal, or its message if unsigned.
        who: String,
        /// What had been sent of a goal before.
        transmission: Transmission,
    },
    /// The answer is not signed by a cell.
    #[error(
        "an answer in the robot cell's name has no verified signature{transmission}: key `{key}`, session \
         `{endpoint}`: {who}"
    )]
    Unsigned {
        /// The key queried.
        key: String,
        /// The session's endpoint.
        endpoint: String,
        /// The responders, as text for people: each one's journal, or its message if unsigned.
        who: String,
        /// What had been sent of a goal before.
        transmission: Transmission,
    },
    /// One cell gives different answers to one query.
    #[error(
        "the robot cell contradicts itself: {count} different answers to one query{transmission}: key \
         `{key}`, session `{endpoint}`, journal {journal}"
    )]
    DifferentAnswers {
        /// The key queried.
        key: String,
        /// The session's endpoint.
        endpoint: String,
        /// Number of answers.
        count: usize,
        /// Start of the name of the journal that signs them all.
        journal: String,
        /// What had been sent of a goal before.
        transmission: Transmission,
    },
    /// The cell moves something real, and no person has allowed it.
    #[error("cell `{cell}` moves something real now, and `execute` does not allow it")]
    NotPermitted {
        /// The cell's name.
        cell: String,
    },
    /// The cell is not what it was when it was asked first.
    #[error("cell `{cell}` changed since it was asked first: {change}")]
    Changed {
        /// The cell's name.
        cell: String,
        /// The first difference.
        change: CapabilityChange,
    },
    /// The cell was stopped.
    #[error("cell `{cell}` is stopped and has not been resumed")]
    Stopped {
        /// The cell's name.
        cell: String,
    },
    /// The cell's capabilities contradict themselves.
    #[error("cell `{cell}` contradicts itself{transmission}: {fault}")]
    Contradiction {
        /// The cell's name.
        cell: String,
        /// The contradiction.
        fault: PalmLimitFault,
        /// What had been sent of a goal before.
        transmission: Transmission,
    },
    /// What is sent cannot be recorded.
    #[error("cannot record what is sent to the cell")]
    Record(#[from] RecordError),
    /// A party other than the cell answered a query to it.
    #[error(
        "a party other than the robot cell answers; the robot may be moving: key `{key}`, session `{endpoint}`: {who}"
    )]
    Strangers {
        /// The key queried.
        key: String,
        /// The session's endpoint.
        endpoint: String,
        /// The responders, as text for people: each one's journal, or its message if unsigned.
        who: String,
    },
    /// A different cell answers than before.
    #[error(
        "the robot cell is not the one that answered before: session `{endpoint}`, journal {found}, expected {expected}"
    )]
    OtherCell {
        /// The session's endpoint.
        endpoint: String,
        /// Journal of the cell that answered before.
        expected: String,
        /// Journal of the one that answers now.
        found: String,
    },
    /// A cell's own name differs from that in its keys.
    #[error(
        "the robot cell under the name `{expected}` calls itself `{found}`: session `{endpoint}`"
    )]
    OtherName {
        /// The session's endpoint.
        endpoint: String,
        /// The name in its keys.
        expected: String,
        /// The cell's own name.
        found: String,
    },
    /// The clocks of the two machines do not agree.
    #[error(
        "the robot cell's clock is {} s {}{transmission}",
        ahead_s.abs(),
        if *ahead_s > 0.0 { "ahead" } else { "behind" }
    )]
    Clock {
        /// Least lead of the cell's clock, in seconds; negative if it lags.
        ahead_s: f64,
        /// What had been sent of a goal before.
        transmission: Transmission,
    },
    /// Another cell has this name already.
    #[error("another robot cell has the name `{name}`: session `{endpoint}`: {who}")]
    NameTaken {
        /// The name.
        name: String,
        /// The session's endpoint.
        endpoint: String,
        /// The responders, as text for people: each one's journal, or its message if unsigned.
        who: String,
    },
    /// The system's random number generator failed.
    #[error("cannot generate random bytes")]
    Random(#[source] std::io::Error),
    /// The cell uses another version of the protocol.
    #[error(
        "the robot cell speaks version {found} of the protocol, expected {expected}{transmission}: session \
         `{endpoint}`"
    )]
    Protocol {
        /// The session's endpoint.
        endpoint: String,
        /// Version of this program.
        expected: u32,
        /// Version of the cell.
        found: u64,
        /// What had been sent of a goal before.
        transmission: Transmission,
    },
    /// An answer cannot be read.
    #[error("the robot cell's answer cannot be read: key `{key}`")]
    Answer {
        /// The key queried.
        key: String,
        /// The cause.
        source: WireError,
    },
    /// Another program listens at the endpoint.
    #[error("another program listens on `{endpoint}` already")]
    PortTaken {
        /// The endpoint.
        endpoint: String,
    },
    /// Listening on the endpoint failed.
    #[error("cannot listen on `{endpoint}`")]
    Listen {
        /// The endpoint.
        endpoint: String,
        /// zenoh's message.
        source: Cause,
    },
    /// zenoh refuses a session, a key or a message.
    #[error("cannot {action}")]
    Zenoh {
        /// The action that failed.
        action: &'static str,
        /// zenoh's message.
        source: Cause,
    },
    /// The cell cannot use its journal.
    #[error("cannot use the cell's journal in `{}`", path.display())]
    Journal {
        /// The folder.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// The journal is that of a robot of another kind.
    #[error(
        "the journal in `{}` is that of a {} cell, and this one is {}",
        path.display(),
        if *simulated { "simulated" } else { "real" },
        if *simulated { "real" } else { "simulated" }
    )]
    JournalKind {
        /// The folder.
        path: PathBuf,
        /// Whether the journal is that of a simulated cell.
        simulated: bool,
    },
    /// The robot's URDF cannot be used.
    #[error("the cell cannot use the robot's description")]
    Robot(#[from] robot::RobotError),
    /// The hand cannot be simulated.
    #[error("the simulated cell cannot simulate the hand")]
    Simulation(#[from] simulation::SimulationError),
    /// The cell's thread could not be started.
    #[error("cannot start the cell's thread")]
    Thread(#[source] std::io::Error),
}

/// Returns the advice for an unreachable cell.
fn unreached() -> &'static str {
    "start the cell and check its name and endpoint, or use the simulated one with \
     `--set dispatch.cell=simulated`"
}

impl CellError {
    /// Returns the failure of a connection as that of a connection to a router.
    pub(crate) fn of_a_router(self) -> Self {
        match self {
            Self::Connect {
                endpoint,
                access,
                waited,
                source,
            } => Self::Router {
                endpoint,
                access,
                waited,
                source,
            },
            other => other,
        }
    }

    /// Returns the error as that of a query after a goal was sent.
    pub(crate) fn after_transmission(mut self) -> Self {
        if let Self::NoAnswer { transmission, .. }
        | Self::SeveralCells { transmission, .. }
        | Self::Unsigned { transmission, .. }
        | Self::DifferentAnswers { transmission, .. }
        | Self::Contradiction { transmission, .. }
        | Self::Clock { transmission, .. }
        | Self::Protocol { transmission, .. } = &mut self
        {
            *transmission = Transmission::Earlier;
        }
        self
    }

    /// Returns the next action, where one is known.
    #[expect(clippy::too_many_lines, reason = "a list: every error and its advice")]
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Name { .. } => {
                Some("use lower-case letters, digits, `-` and `_`, e.g. `simulated`".to_owned())
            }
            Self::Endpoint { .. } => Some(
                "write e.g. `tcp/127.0.0.1:7447`, or `tls/robot.lab:7447` for another machine"
                    .to_owned(),
            ),
            Self::Host { .. } => Some("check the name, or write the address".to_owned()),
            Self::NotLoopback { .. } => Some(
                "write `tls/HOST:PORT` and name an access file, as `data/access/README.md` shows, or \
                 stay on this machine with `tcp/127.0.0.1:7447`"
                    .to_owned(),
            ),
            Self::NoAccess { .. } => Some(
                "name one with `--access FILE`, or for a dispatcher with `--set dispatch.access=FILE`; \
                 `data/access/README.md` shows how to make it"
                    .to_owned(),
            ),
            Self::Access { .. } => Some(
                "`data/access` holds files that can be copied, and says what goes into them"
                    .to_owned(),
            ),
            Self::Credentials { fault, .. } | Self::Tls { fault, .. } => {
                Some(fault.advice().to_owned())
            }
            Self::Connect { access: None, .. } => Some(unreached().to_owned()),
            Self::Connect {
                access: Some(path), ..
            } => Some(format!(
                "{}; a router that does not trust the certificate, user or password in `{}` takes no \
                 connection either",
                unreached(),
                path.display()
            )),
            Self::Router {
                endpoint,
                access: None,
                ..
            } => Some(format!(
                "start it with `pipeline router --listen {endpoint}`, or have the cell listen itself with `--listen`"
            )),
            Self::Router {
                endpoint,
                access: Some(path),
                ..
            } => Some(format!(
                "start it with `pipeline router --listen {endpoint} --access FILE`; it may also be there and not \
                 trust the certificate, user or password in `{}`",
                path.display()
            )),
            Self::NoAnswer { access, .. } => Some(format!(
                "{}; a router silently drops queries that its access rules forbid to {}",
                unreached(),
                access
                    .as_deref()
                    .map_or("a client without an access file".to_owned(), |path| format!(
                        "a client with `{}`",
                        path.display()
                    ))
            )),
            Self::SeveralCells { .. } => {
                Some("stop all but one of them, or give them different names".to_owned())
            }
            Self::Unsigned { .. } => Some(
                "find out what it is and stop it; a cell signs what it answers, as `crates/cell/README.md` says"
                    .to_owned(),
            ),
            Self::Strangers { .. } => Some(
                "look at the robot; then find out who else answers to its keys, and stop it".to_owned(),
            ),
            Self::OtherCell { .. } => Some(
                "look at the robot; when it is clear which cell drives it, run the command again".to_owned(),
            ),
            Self::OtherName { .. } => {
                Some("give the cell the name under which it serves".to_owned())
            }
            Self::Clock { .. } => {
                Some("set both clocks by the same time server (NTP)".to_owned())
            }
            Self::NameTaken { .. } => Some(
                "stop the other one, or give this one another name with `--set dispatch.cell_name=NAME`"
                    .to_owned(),
            ),
            Self::PortTaken { endpoint } => Some(format!(
                "end it, or take any free port with `--listen {}:0`",
                endpoint.rsplit_once(':').map_or("", |(place, _)| place)
            )),
            Self::Listen { endpoint, .. } if endpoint.starts_with("tls/") => {
                Some("the certificate in the access file may be no good".to_owned())
            }
            Self::Listen { .. } => Some(
                "the program may not be allowed to use that port; take any free one, e.g. \
                 `tcp/127.0.0.1:0`"
                    .to_owned(),
            ),
            Self::Protocol {
                expected, found, ..
            } => Some(format!(
                "update {}: both sides must speak one version, `crates/cell/README.md` is version {expected}",
                if *found < u64::from(*expected) {
                    "the cell"
                } else {
                    "this program"
                }
            )),
            Self::Answer { .. } => {
                Some("run the same version of the program on both sides".to_owned())
            }
            Self::DifferentAnswers { .. } => Some(
                "look at the cell's program: it may run twice with one journal".to_owned(),
            ),
            Self::NotPermitted { .. } => Some(
                "look at the robot; `--execute` lets a cell that is not simulated move".to_owned(),
            ),
            Self::Changed { .. } => Some(
                "find out why, and look at the robot; the same command takes the cell as it is now"
                    .to_owned(),
            ),
            Self::Stopped { .. } => Some("resume the cell, then run the same command".to_owned()),
            Self::Contradiction { .. } => Some("correct the cell's own limits".to_owned()),
            Self::Journal { .. } => Some(
                "give the cell a folder of its own that can be written to; another cell may be using this one"
                    .to_owned(),
            ),
            Self::JournalKind { .. } => Some(
                "give the cell a journal of its own: what a simulation did is nothing that a robot did".to_owned(),
            ),
            Self::Simulation(err) => err.hint(),
            Self::Zenoh { .. }
            | Self::Robot(_)
            | Self::Thread(_)
            | Self::Random(_)
            | Self::Record(_) => None,
        }
    }
}
