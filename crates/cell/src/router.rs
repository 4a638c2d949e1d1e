//! The zenoh router between cells and dispatchers.

use zenoh::{Session, Wait};

use crate::{Access, CellError, session};

/// A running router; it stops when dropped.
///
/// It forwards between connected cells and dispatchers and does nothing else. Any other zenoh
/// router does as well (`zenohd`).
pub struct Router {
    session: Session,
    endpoint: String,
}

impl Router {
    /// Starts a router that listens at `tcp/HOST:PORT` on the loopback interface, or at
    /// `tls/HOST:PORT` on any with an access file; port 0 takes any free one.
    ///
    /// # Errors
    ///
    /// Fails if it cannot listen on the endpoint, or if other machines would reach it without an
    /// access file.
    pub fn start(listen: &str, access: Option<&Access>) -> Result<Self, CellError> {
        let (session, endpoint) = session::listen(listen, access)?;
        Ok(Self { session, endpoint })
    }

    /// Returns the router's endpoint.
    pub fn endpoint(&self) -> &str {
        &self.endpoint
    }
}

impl Drop for Router {
    fn drop(&mut self) {
        let _closed = self.session.close().wait();
    }
}
