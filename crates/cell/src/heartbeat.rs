//! The dispatcher's heartbeat.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use zenoh::{
    Session, Wait,
    qos::{CongestionControl, Priority},
};

use serde::{Deserialize, Serialize};

use crate::{CellError, wire};

/// Heartbeat period: a cell with a timeout of a quarter of a second misses four before it stops.
const PERIOD: Duration = Duration::from_millis(50);

/// Content of a heartbeat.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct HeartbeatMessage {
    /// The dispatcher's name, as in its goals.
    pub(crate) dispatcher: String,
}

/// Sends heartbeats to a cell until dropped.
pub(crate) struct Heartbeat {
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Heartbeat {
    pub(crate) fn start(
        session: &Session,
        key: String,
        dispatcher: &str,
    ) -> Result<Self, CellError> {
        let beat = wire::line(&HeartbeatMessage {
            dispatcher: dispatcher.to_owned(),
        });
        let over = Arc::new(AtomicBool::new(false));
        let (session, until) = (session.clone(), Arc::clone(&over));
        let thread = thread::Builder::new()
            .name("heartbeat".to_owned())
            .spawn(move || {
                while !until.load(Ordering::Relaxed) {
                    // Drop a beat that would have to wait: the next one is as good.
                    let _sent = session
                        .put(key.as_str(), beat.as_slice())
                        .congestion_control(CongestionControl::Drop)
                        .priority(Priority::RealTime)
                        .express(true)
                        .wait();
                    thread::park_timeout(PERIOD);
                }
            })
            .map_err(CellError::Thread)?;
        Ok(Self {
            over,
            thread: Some(thread),
        })
    }
}

impl Drop for Heartbeat {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ended = thread.join();
        }
    }
}
