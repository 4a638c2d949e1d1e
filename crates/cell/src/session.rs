//! zenoh sessions that connect only to their configured peers.

use std::{
    io::ErrorKind,
    net::{IpAddr, SocketAddr, TcpListener, ToSocketAddrs},
    path::Path,
    time::Duration,
};

use zenoh::{
    Config, Session, Wait, handlers::FifoChannelHandler, pubsub::Subscriber, sample::Sample,
};

use crate::{Access, CellError, client::MAX_REPORT_BYTES};

/// Lease of a silent peer, in milliseconds: shorter than zenoh's 10 s, so that a dead cell is
/// noticed; long enough for a machine under full CPU load.
const LEASE_MS: u32 = 4000;

/// Reconnection backoff: initial and maximum pause in milliseconds, and growth factor.
const RETRY: &str = "{ period_init_ms: 100, period_max_ms: 1000, period_increase_factor: 2 }";

/// Number of attempts to find a free port: another program may take it before it is used.
const PORT_TRIES: u32 = 5;

/// Longest message reassembled from fragments, in bytes: the longest report plus zenoh's overhead.
/// Longer ones are dropped.
const MAX_MESSAGE_BYTES: usize = MAX_REPORT_BYTES + 64 * 1024;

/// Samples buffered for a slow subscriber.
const BACKLOG: usize = 4096;

/// Protection of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Protection {
    /// Unprotected: for one machine.
    Tcp,
    /// By TLS.
    Tls,
}

impl Protection {
    const ALL: [(&'static str, Self); 2] = [("tcp/", Self::Tcp), ("tls/", Self::Tls)];
}

/// An endpoint to listen on or connect to.
struct Endpoint<'a> {
    protection: Protection,
    host: &'a str,
    /// The host's resolved address.
    address: SocketAddr,
}

impl<'a> Endpoint<'a> {
    /// Parses `tcp/HOST:PORT` or `tls/HOST:PORT` and checks that an endpoint reachable by other
    /// machines is protected.
    fn parse(endpoint: &'a str) -> Result<Self, CellError> {
        let wrong = || CellError::Endpoint {
            endpoint: endpoint.to_owned(),
        };
        let (protection, place) = Protection::ALL
            .iter()
            .find_map(|(prefix, kind)| Some((*kind, endpoint.strip_prefix(prefix)?)))
            .ok_or_else(wrong)?;
        // zenoh's endpoint options are not part of a port.
        let (host, port) = place.rsplit_once(':').ok_or_else(wrong)?;
        let port = port.parse::<u16>();
        if host.is_empty() || port.is_err() {
            return Err(wrong());
        }
        let addresses: Vec<SocketAddr> = place
            .to_socket_addrs()
            .map_err(|source| CellError::Host {
                endpoint: endpoint.to_owned(),
                source,
            })?
            .collect();
        let here = |address: &SocketAddr| address.ip().to_canonical().is_loopback();
        if protection == Protection::Tcp && !addresses.iter().all(here) {
            return Err(CellError::NotLoopback {
                endpoint: endpoint.to_owned(),
            });
        }
        let address = *addresses.first().ok_or_else(wrong)?;
        Ok(Self {
            protection,
            host,
            address,
        })
    }

    /// Returns the endpoint in zenoh's syntax: without TLS with the checked address, since the name
    /// may resolve differently a moment later; with TLS with the name in the certificate.
    fn at(&self, port: u16) -> String {
        match self.protection {
            Protection::Tcp => format!("tcp/{}", SocketAddr::new(self.ip(), port)),
            Protection::Tls => format!("tls/{}:{port}", self.host),
        }
    }

    /// Checks that an access file is given where one is required.
    fn check_access<T: ?Sized>(&self, endpoint: &str, access: Option<&T>) -> Result<(), CellError> {
        if self.protection == Protection::Tls && access.is_none() {
            return Err(CellError::NoAccess {
                endpoint: endpoint.to_owned(),
            });
        }
        Ok(())
    }

    fn ip(&self) -> IpAddr {
        self.address.ip()
    }

    /// Whether another program listens there.
    fn is_taken(&self) -> bool {
        let bound = TcpListener::bind(self.address);
        bound.is_err_and(|err| err.kind() == ErrorKind::AddrInUse)
    }

    /// Returns the port to listen on: the requested one, or a free one.
    fn free_port(&self) -> Result<u16, CellError> {
        if self.address.port() != 0 {
            return Ok(self.address.port());
        }
        TcpListener::bind(self.address)
            .and_then(|listener| listener.local_addr())
            .map(|address| address.port())
            .map_err(|err| CellError::Listen {
                endpoint: self.at(0),
                source: zenoh::Error::from(err).into(),
            })
    }
}

/// Checks an endpoint before any connection; whether the host is reachable is not tested.
///
/// # Errors
///
/// Fails if it is not an endpoint, if other machines could read its traffic, or if no access file
/// is given where one is required; the file is not read.
pub fn check_endpoint(endpoint: &str, access: Option<&Path>) -> Result<(), CellError> {
    match Endpoint::parse(endpoint) {
        Ok(found) => found.check_access(endpoint, access),
        Err(CellError::Host { .. }) if endpoint.starts_with("tls/") && access.is_none() => {
            Err(CellError::NoAccess {
                endpoint: endpoint.to_owned(),
            })
        }
        Err(CellError::Host { .. }) => Ok(()),
        Err(err) => Err(err),
    }
}

/// Opens a client session, which reconnects by itself.
pub(crate) fn connect(
    endpoint: &str,
    access: Option<&Access>,
    timeout: Duration,
) -> Result<Session, CellError> {
    let to = Endpoint::parse(endpoint)?;
    to.check_access(endpoint, access)?;
    let config = config(
        access,
        &[
            ("mode", "\"client\"".to_owned()),
            ("listen/endpoints", "[]".to_owned()),
            ("connect/endpoints", list(&to.at(to.address.port()))),
            ("connect/timeout_ms", timeout.as_millis().to_string()),
            ("connect/exit_on_failure", "true".to_owned()),
            ("connect/retry", RETRY.to_owned()),
        ],
    )?;
    zenoh::open(config).wait().map_err(|source| {
        let secured = access.filter(|_| to.protection == Protection::Tls);
        let endpoint = endpoint.to_owned();
        match secured.and_then(|access| access.handshake_fault(to.host, to.address)) {
            Some(fault) => CellError::Tls { endpoint, fault },
            None => CellError::Connect {
                endpoint,
                access: access.map(|access| access.path().to_owned()),
                waited: timeout,
                source: source.into(),
            },
        }
    })
}

/// Opens a session that accepts clients and forwards between them; returns it with the endpoint,
/// which differs from `listen` if that requests any free port.
pub(crate) fn listen(
    listen: &str,
    access: Option<&Access>,
) -> Result<(Session, String), CellError> {
    let at = Endpoint::parse(listen)?;
    at.check_access(listen, access)?;
    if let Some(access) = access.filter(|_| at.protection == Protection::Tls) {
        access.check_listener()?;
    }
    let mut tries = if at.address.port() == 0 {
        PORT_TRIES
    } else {
        1
    };
    loop {
        let endpoint = at.at(at.free_port()?);
        let config = config(
            access,
            &[
                // Only a router forwards publications between clients.
                ("mode", "\"router\"".to_owned()),
                ("listen/endpoints", list(&endpoint)),
                ("listen/timeout_ms", "0".to_owned()),
                ("listen/exit_on_failure", "true".to_owned()),
                ("connect/endpoints", "[]".to_owned()),
            ],
        )?;
        tries -= 1;
        match zenoh::open(config).wait() {
            Ok(session) => return Ok((session, endpoint)),
            Err(_) if tries > 0 => {}
            Err(_) if at.is_taken() => return Err(CellError::PortTaken { endpoint }),
            Err(source) => {
                return Err(CellError::Listen {
                    endpoint,
                    source: source.into(),
                });
            }
        }
    }
}

/// Returns the id of the router that a client's session is connected to.
pub(crate) fn router(session: &Session) -> Option<String> {
    let mut routers = session.info().routers_zid().wait();
    routers.next().map(|zid| zid.to_string())
}

/// Subscribes to a cell's key, for watching.
///
/// # Errors
///
/// Fails if nothing listens at `endpoint` within `timeout`.
pub fn subscribe(
    endpoint: &str,
    key: &str,
    timeout: Duration,
) -> Result<(Session, Subscriber<FifoChannelHandler<Sample>>), CellError> {
    let session = connect(endpoint, None, timeout)?;
    let subscriber = listen_to(&session, key)?;
    Ok((session, subscriber))
}

/// Subscribes to a key in a session, with a buffer for unfetched samples.
pub(crate) fn listen_to(
    session: &Session,
    key: &str,
) -> Result<Subscriber<FifoChannelHandler<Sample>>, CellError> {
    session
        .declare_subscriber(key)
        .with(zenoh::handlers::FifoChannel::new(BACKLOG))
        .wait()
        .map_err(|source| CellError::Zenoh {
            action: "subscribe",
            source: source.into(),
        })
}

fn config(access: Option<&Access>, settings: &[(&str, String)]) -> Result<Config, CellError> {
    let quiet = [
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
        // There is no scouting, so there is nothing to wait for.
        ("scouting/delay", "0".to_owned()),
        ("transport/shared_memory/enabled", "false".to_owned()),
        ("transport/link/tx/lease", LEASE_MS.to_string()),
        (
            "transport/link/rx/max_message_size",
            MAX_MESSAGE_BYTES.to_string(),
        ),
        // No clock time in messages.
        ("timestamping/enabled", "false".to_owned()),
    ];
    let mut config = access.map(Access::config).unwrap_or_default();
    for (key, value) in quiet.iter().chain(settings) {
        config
            .insert_json5(key, value)
            .map_err(|source| CellError::Zenoh {
                action: "configure a session",
                source: source.into(),
            })?;
    }
    Ok(config)
}

fn list(endpoint: &str) -> String {
    serde_json::json!([endpoint]).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unprotected_cell_listens_on_loopback_only() {
        for here in ["tcp/127.0.0.1:7447", "tcp/[::1]:7447", "tcp/localhost:7447"] {
            assert!(Endpoint::parse(here).is_ok(), "{here}");
        }
        for elsewhere in ["tcp/0.0.0.0:7447", "tcp/10.0.0.7:7447", "tcp/[::]:0"] {
            assert!(
                matches!(
                    Endpoint::parse(elsewhere),
                    Err(CellError::NotLoopback { .. })
                ),
                "{elsewhere}"
            );
            let protected = elsewhere.replace("tcp/", "tls/");
            assert!(Endpoint::parse(&protected).is_ok(), "{protected}");
        }
        for wrong in [
            "127.0.0.1:7447",
            "tcp/nowhere",
            "udp/127.0.0.1:7447",
            "tcp/127.0.0.1:7447#iface=eth0",
            "tls/127.0.0.1:7447?rel=0",
            "tcp/:7447",
            "",
        ] {
            assert!(
                matches!(Endpoint::parse(wrong), Err(CellError::Endpoint { .. })),
                "{wrong}"
            );
        }
    }

    #[test]
    fn cell_on_a_network_needs_an_access_file() {
        let refused = listen("tls/0.0.0.0:0", None).map(drop).unwrap_err();
        assert!(matches!(refused, CellError::NoAccess { .. }), "{refused}");
    }

    #[test]
    fn an_endpoint_keeps_its_host_name_only_under_tls() {
        let at = |endpoint: &str| Endpoint::parse(endpoint).map(|found| found.at(1)).unwrap();
        assert!(["tcp/127.0.0.1:1", "tcp/[::1]:1"].contains(&at("tcp/localhost:0").as_str()));
        assert_eq!(at("tls/localhost:0"), "tls/localhost:1");
    }
}
