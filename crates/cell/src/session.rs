//! zenoh sessions that talk to whom they are told to and to nobody else.

use std::{
    net::{SocketAddr, TcpListener, ToSocketAddrs},
    time::Duration,
};

use zenoh::{
    Config, Session, Wait, handlers::FifoChannelHandler, pubsub::Subscriber, sample::Sample,
};

use crate::CellError;

/// How long a silent peer counts as connected, in milliseconds: shorter than zenoh's 10 s, so that
/// a dead cell is noticed; long enough for a machine whose cores are all busy.
const LEASE_MS: u32 = 4000;

/// Prefix of the only kind of endpoint there is.
const TCP: &str = "tcp/";

/// How often a free port is tried: between finding and using one, another program may take it.
const PORT_TRIES: u32 = 5;

/// Samples that wait for a slow subscriber.
const BACKLOG: usize = 4096;

/// Opens a session of a client.
pub(crate) fn connect(endpoint: &str, timeout: Duration) -> Result<Session, CellError> {
    if !endpoint.starts_with(TCP) {
        return Err(CellError::Endpoint {
            endpoint: endpoint.to_owned(),
        });
    }
    let config = config(&[
        ("mode", "\"client\"".to_owned()),
        ("connect/endpoints", list(endpoint)),
        ("connect/timeout_ms", timeout.as_millis().to_string()),
        ("connect/exit_on_failure", "true".to_owned()),
    ])?;
    zenoh::open(config)
        .wait()
        .map_err(|source| CellError::Connect {
            endpoint: endpoint.to_owned(),
            waited: timeout,
            source: source.into(),
        })
}

/// Opens a session that clients connect to and that forwards between them; returns it with the
/// endpoint listened on, which differs from `listen` if that asks for any free port.
pub(crate) fn listen(listen: &str) -> Result<(Session, String), CellError> {
    let address = loopback(listen)?;
    let mut tries = if address.port() == 0 { PORT_TRIES } else { 1 };
    loop {
        let endpoint = format!("{TCP}{}", free_port(address)?);
        let config = config(&[
            // Only a router forwards what one client publishes to the others.
            ("mode", "\"router\"".to_owned()),
            ("listen/endpoints", list(&endpoint)),
            ("listen/timeout_ms", "0".to_owned()),
            ("listen/exit_on_failure", "true".to_owned()),
            ("connect/endpoints", "[]".to_owned()),
        ])?;
        tries -= 1;
        match zenoh::open(config).wait() {
            Ok(session) => return Ok((session, endpoint)),
            Err(_) if tries > 0 => {}
            Err(source) => {
                return Err(CellError::Listen {
                    endpoint,
                    source: source.into(),
                });
            }
        }
    }
}

/// Subscribes to a key of a cell, as somebody who watches.
///
/// # Errors
///
/// Fails if nothing listens at `endpoint` within `timeout`.
pub fn subscribe(
    endpoint: &str,
    key: &str,
    timeout: Duration,
) -> Result<(Session, Subscriber<FifoChannelHandler<Sample>>), CellError> {
    let session = connect(endpoint, timeout)?;
    let subscriber = session
        .declare_subscriber(key)
        .with(zenoh::handlers::FifoChannel::new(BACKLOG))
        .wait()
        .map_err(|source| CellError::Zenoh {
            action: "subscribe",
            source: source.into(),
        })?;
    Ok((session, subscriber))
}

fn config(settings: &[(&str, String)]) -> Result<Config, CellError> {
    let quiet = [
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
        // Nobody is scouted for, so there is nothing to wait for.
        ("scouting/delay", "0".to_owned()),
        ("transport/shared_memory/enabled", "false".to_owned()),
        ("transport/link/tx/lease", LEASE_MS.to_string()),
        // No clock time in messages.
        ("timestamping/enabled", "false".to_owned()),
    ];
    let mut config = Config::default();
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

/// Reads `tcp/HOST:PORT` and makes sure that no other machine reaches it.
fn loopback(endpoint: &str) -> Result<SocketAddr, CellError> {
    let wrong = || CellError::Endpoint {
        endpoint: endpoint.to_owned(),
    };
    let address = endpoint
        .strip_prefix(TCP)
        .and_then(|address| address.to_socket_addrs().ok())
        .and_then(|mut addresses| addresses.next())
        .ok_or_else(wrong)?;
    if address.ip().is_loopback() {
        Ok(address)
    } else {
        Err(CellError::NotLoopback {
            endpoint: endpoint.to_owned(),
        })
    }
}

/// Returns the address with a free port if it asks for any.
fn free_port(address: SocketAddr) -> Result<SocketAddr, CellError> {
    if address.port() != 0 {
        return Ok(address);
    }
    TcpListener::bind(address)
        .and_then(|listener| listener.local_addr())
        .map_err(|err| CellError::Listen {
            endpoint: format!("{TCP}{address}"),
            source: zenoh::Error::from(err).into(),
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_listens_on_this_machine_only() {
        assert!(loopback("tcp/127.0.0.1:7447").is_ok());
        assert!(matches!(
            loopback("tcp/0.0.0.0:7447"),
            Err(CellError::NotLoopback { .. })
        ));
        for wrong in ["127.0.0.1:7447", "tcp/nowhere", "udp/127.0.0.1:7447", ""] {
            assert!(
                matches!(loopback(wrong), Err(CellError::Endpoint { .. })),
                "{wrong}"
            );
        }
    }
}
