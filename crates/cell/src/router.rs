//! What cells and dispatchers meet at.

use zenoh::{Session, Wait};

use crate::{Access, CellError, session};

/// A running router; it stops when this is dropped.
///
/// Cells and dispatchers connect to it and it forwards between them; it takes part in nothing. Any
/// other zenoh router does as well (`zenohd`).
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
    /// Fails if the endpoint cannot be listened on, or other machines would reach it unasked.
    pub fn start(listen: &str, access: Option<&Access>) -> Result<Self, CellError> {
        let (session, endpoint) = session::listen(listen, access)?;
        Ok(Self { session, endpoint })
    }

    /// Returns where it is reached.
    pub fn endpoint(&self) -> &str {
        &self.endpoint
    }
}

impl Drop for Router {
    fn drop(&mut self) {
        let _closed = self.session.close().wait();
    }
}
