//! Claims of units that move a robot: of machines that share a depot, one makes each, once and for all.

use std::fs;

use dataflow::{Digest, UnitName};
use depot::DepotError;

use super::{Shared, keys};
use crate::{
    LakeError,
    atomic::{io_error, write_atomic},
    clock::host,
};

impl Shared {
    /// Claims a unit for this lake; a claim that this lake made before holds.
    pub(crate) fn claim(&self, fingerprint: &Digest, unit: &UnitName) -> Result<(), LakeError> {
        let unknown = |source: DepotError| LakeError::Unclaimed {
            unit: unit.to_string(),
            source: Box::new(source),
        };
        self.check_creates().map_err(unknown)?;
        let host = host();
        let claim = format!("{host}\n{}\n", self.identity()?);
        let key = keys::claim(fingerprint);
        let claimed = self.remote.create(&key, claim.as_bytes());
        let Some(other) = claimed.map_err(unknown)? else {
            return Ok(());
        };
        let other = String::from_utf8_lossy(&other);
        Err(LakeError::Claimed {
            unit: unit.to_string(),
            host: other.lines().next().unwrap_or_default().to_owned(),
            key,
        })
    }

    /// What tells this lake from all others, on this machine too.
    fn identity(&self) -> Result<String, LakeError> {
        let path = self.folder.join("identity");
        if !path.exists() {
            let random = "/proc/sys/kernel/random/uuid";
            let random = fs::read(random).map_err(io_error("read", random.as_ref()))?;
            write_atomic(&path, &random)?;
        }
        let identity = fs::read_to_string(&path).map_err(io_error("read", &path))?;
        Ok(identity.trim().to_owned())
    }
}
