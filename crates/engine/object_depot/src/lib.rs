//! A depot in an object store: `s3://BUCKET/PREFIX`, on AWS or a server that speaks its protocol.
//!
//! Credentials, region and endpoint come from the environment as AWS's own tools name them
//! (`AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_REGION`, `AWS_ENDPOINT_URL`, …), or from the
//! machine's role; they are neither stored nor shown.
//!
//! A file is created if absent by a conditional request (`If-None-Match: *`). A store that ignores
//! the condition keeps the last of several that come at once; their bytes are checked wherever they
//! are used, so that it is only less economical.

mod causes;
mod parts;
mod settings;
mod store;

pub use store::{InvalidUrl, ObjectDepot};
