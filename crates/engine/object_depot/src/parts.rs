//! Large files, sent in parts.

use std::io::{self, Read};

use object_store::{ObjectStore, ObjectStoreExt, WriteMultipart, path::Path};

use crate::store::{Boxed, boxed};

/// Bytes of a part.
pub(crate) const SIZE: usize = 8 << 20;

/// Parts sent at once.
const AT_ONCE: usize = 4;

/// Stores a file in parts; nothing is visible before the last, and nothing is left of a file that
/// cannot be read.
pub(crate) async fn put(
    store: &dyn ObjectStore,
    path: &Path,
    reader: &mut (dyn Read + Send),
) -> Result<(), Boxed> {
    let upload = store.put_multipart(path).await.map_err(boxed)?;
    let mut upload = WriteMultipart::new_with_chunk_size(upload, SIZE);
    match write(&mut upload, reader).await {
        Ok(()) => upload.finish().await.map(drop).map_err(boxed),
        Err(err) => {
            // Parts that could not be aborted expire by the rule of the bucket.
            let _aborted = upload.abort().await;
            Err(err)
        }
    }
}

async fn write(upload: &mut WriteMultipart, reader: &mut (dyn Read + Send)) -> Result<(), Boxed> {
    let mut piece = vec![0; SIZE / 8];
    loop {
        let n_read = match reader.read(&mut piece) {
            Err(err) if err.kind() == io::ErrorKind::Interrupted => continue,
            read => read.map_err(boxed)?,
        };
        match piece.get(..n_read) {
            Some(bytes) if n_read > 0 => {
                upload.wait_for_capacity(AT_ONCE).await.map_err(boxed)?;
                upload.write(bytes);
            }
            // What is sent here is aborted where it fails, unlike the last part.
            _ => return upload.wait_for_capacity(0).await.map_err(boxed),
        }
    }
}
