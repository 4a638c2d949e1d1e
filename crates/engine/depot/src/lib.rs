//! Files by key that several machines share: a depot.
//!
//! A [`Depot`] is a folder that machines mount ([`FolderDepot`]). It needs no
//! locks: a file appears whole or not at all, and of several that are put at one key at the same
//! time with [`PutMode::IfAbsent`] one wins.
//!
//! ```
//! use depot::{Content, Depot, FolderDepot, Put, PutMode};
//!
//! let folder = std::env::temp_dir().join("a_depot_of_an_example");
//! std::fs::create_dir_all(&folder)?;
//! let depot = FolderDepot::new(&folder);
//! depot.put("units/a", Content::of_bytes(b"bytes".to_vec()), PutMode::Always)?;
//! let again = depot.put("units/a", Content::of_bytes(b"other".to_vec()), PutMode::IfAbsent)?;
//! assert_eq!(again, Put::There);
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A [`Link`] makes requests to a depot that cannot hang, and that are made again while it is down, for as long as its
//! [`Patience`] says.
//!
//! What this crate deliberately does not know: artifacts, digests, records. `lake` decides what the
//! keys are and checks every byte that it fetches.

mod error;
mod folder;
mod interface;
mod link;
mod patience;

pub use error::DepotError;
pub use folder::{FolderDepot, WRITING};
pub use interface::{Content, Depot, Entry, Put, PutMode, Sink};
pub use link::{ContentSource, Link, OutageListener, Piece, PieceSink, Traffic};
pub use patience::{Outage, Patience};
