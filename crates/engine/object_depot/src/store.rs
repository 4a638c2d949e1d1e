//! The depot on `object_store`'s client.

use std::{
    io::Read,
    sync::Arc,
    time::{Duration, Instant},
};

use depot::{Content, Depot, DepotError, Entry, Put, PutMode, Sink};
use futures_util::StreamExt;
use object_store::{
    ClientOptions, Error, ObjectMeta, ObjectStore, ObjectStoreExt, PutOptions, PutPayload,
    RetryConfig, aws::AmazonS3Builder, path::Path, prefix::PrefixStore,
};
use tokio::runtime::{Builder, Runtime};

use crate::{causes::Cause, parts, settings};

/// Retries of a request, and the time for all of them: whoever asks goes on with longer pauses (`depot::Link`).
const RETRIES: usize = 2;
const RETRIED_WITHIN: Duration = Duration::from_secs(3);

/// Time to connect.
const CONNECT: Duration = Duration::from_secs(3);

/// Threads that wait for the network.
const THREADS: usize = 2;

/// Why a URL does not name a depot.
#[derive(Debug, thiserror::Error)]
#[error("cannot use the object store")]
pub struct InvalidUrl(#[from] Boxed);

/// A depot in an object store.
pub struct ObjectDepot {
    store: Arc<dyn ObjectStore>,
    runtime: Runtime,
    bucket: String,
    url: String,
}

impl ObjectDepot {
    /// Returns the depot at a URL, `s3://BUCKET/PREFIX`; nothing is asked of it yet.
    ///
    /// # Errors
    ///
    /// Fails if the URL or the environment does not name a bucket and how to reach it.
    pub fn from_url(url: &str) -> Result<Self, InvalidUrl> {
        let rest = url.strip_prefix("s3://").filter(|rest| !rest.is_empty());
        let rest = rest.ok_or_else(|| Boxed::from("it is not of the form `s3://BUCKET/PREFIX`"))?;
        let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        check_names()?;
        check_endpoints(|name| std::env::var(name).ok())?;
        // A large file may take long: whoever asks gives up on silence (`depot::Link`).
        let client = ClientOptions::new()
            .with_connect_timeout(CONNECT)
            .with_timeout_disabled();
        let s3 = AmazonS3Builder::from_env()
            .with_bucket_name(bucket)
            .with_client_options(with_http(client))
            .with_retry(RetryConfig {
                max_retries: RETRIES,
                retry_timeout: RETRIED_WITHIN,
                ..RetryConfig::default()
            })
            .build()
            .map_err(boxed)?;
        let runtime = Builder::new_multi_thread()
            .worker_threads(THREADS)
            .enable_all()
            .build()
            .map_err(boxed)?;
        Ok(Self {
            store: Arc::new(PrefixStore::new(s3, prefix.trim_matches('/'))),
            runtime,
            bucket: bucket.to_owned(),
            url: url.to_owned(),
        })
    }

    fn failed(&self, action: &'static str, key: &str, err: &Boxed) -> DepotError {
        // What the reader or the sink of a request failed with is no answer of the store.
        let cause = Cause::of(err, &self.bucket, &self.url);
        DepotError::Store {
            action,
            key: key.to_owned(),
            hint: cause.hint.clone(),
            is_lasting: cause.is_lasting,
            source: Box::new(cause),
        }
    }
}

/// Refuses misspelt settings: the client would do without them, and ask another store or as somebody else.
fn check_names() -> Result<(), Boxed> {
    let names: Vec<String> = std::env::vars_os()
        .filter_map(|(name, _)| name.into_string().ok())
        .collect();
    let misspelt = settings::misspelt(names.iter().map(String::as_str));
    let said: Vec<String> = misspelt
        .iter()
        .map(|(name, meant)| format!("`{name}` in the environment is not read, `{meant}` is meant"))
        .collect();
    if said.is_empty() {
        return Ok(());
    }
    Err(said.join("; ").into())
}

/// Variables that name the endpoint of a store that is not Amazon's.
const ENDPOINTS: [&str; 3] = ["AWS_ENDPOINT_URL", "AWS_ENDPOINT", "AWS_ENDPOINT_URL_S3"];

/// Refuses an endpoint that is no URL, or whose lack of encryption is not allowed by name: the client would only say
/// that it cannot build a request.
fn check_endpoints(variable: impl Fn(&str) -> Option<String>) -> Result<(), Boxed> {
    for name in ENDPOINTS {
        let Some(endpoint) = variable(name).filter(|endpoint| !endpoint.is_empty()) else {
            continue;
        };
        let scheme = endpoint.split_once("://").map(|(scheme, _)| scheme);
        let allowed = variable("AWS_ALLOW_HTTP");
        let problem = match scheme {
            Some("https") => continue,
            Some("http") if allowed.as_deref() == Some("true") => continue,
            Some("http") => format!(
                "`{name}` is `{endpoint}`, without encryption: allow that with `AWS_ALLOW_HTTP=true`, or write `https://…`"
            ),
            _ => format!(
                "`{name}` is `{endpoint}`: write it with `https://` or `http://`, e.g. `https://{}`",
                endpoint.rsplit("//").next().unwrap_or_default()
            ),
        };
        return Err(problem.into());
    }
    Ok(())
}

/// An endpoint without encryption, which the environment must allow by name.
fn with_http(client: ClientOptions) -> ClientOptions {
    let allowed = std::env::var("AWS_ALLOW_HTTP").is_ok_and(|allowed| allowed == "true");
    client.with_allow_http(allowed)
}

impl Depot for ObjectDepot {
    fn get(&self, key: &str, sink: &mut Sink) -> Result<bool, DepotError> {
        let got = async {
            let Some(found) = if_there(self.store.get(&Path::from(key)).await)? else {
                return Ok(false);
            };
            let mut pieces = found.into_stream();
            while let Some(piece) = pieces.next().await {
                let piece = piece.map_err(boxed)?;
                sink(&piece).map_err(boxed)?;
            }
            Ok(true)
        };
        self.runtime
            .block_on(got)
            .map_err(|err| self.failed("get", key, &err))
    }

    fn put(&self, key: &str, mut content: Content, mode: PutMode) -> Result<Put, DepotError> {
        let path = Path::from(key);
        let put = async {
            if content.size > parts::SIZE as u64 && mode == PutMode::Always {
                parts::put(&*self.store, &path, &mut content.reader).await?;
                return Ok(Put::New);
            }
            let mut bytes = Vec::new();
            content.reader.read_to_end(&mut bytes).map_err(boxed)?;
            let (mode, mut tries) = match mode {
                // The client does not repeat a create whose answer was lost, since it cannot say whose file is
                // there then; whoever creates a file here reads back what is there.
                PutMode::IfAbsent => (object_store::PutMode::Create, RETRIES),
                PutMode::Always => (object_store::PutMode::Overwrite, 0),
            };
            let bytes = PutPayload::from(bytes);
            let since = Instant::now();
            loop {
                let options = PutOptions::from(mode.clone());
                match self.store.put_opts(&path, bytes.clone(), options).await {
                    Ok(_) => return Ok(Put::New),
                    Err(Error::AlreadyExists { .. } | Error::Precondition { .. }) => {
                        return Ok(Put::There);
                    }
                    Err(Error::Generic { .. }) if tries > 0 && since.elapsed() < RETRIED_WITHIN => {
                        tries -= 1;
                    }
                    Err(err) => return Err(boxed(err)),
                }
            }
        };
        self.runtime
            .block_on(put)
            .map_err(|err| self.failed("put", key, &err))
    }

    fn head(&self, key: &str) -> Result<Option<Entry>, DepotError> {
        let found = self.runtime.block_on(self.store.head(&Path::from(key)));
        let found = if_there(found).map_err(|err| self.failed("look for", key, &err))?;
        Ok(found.as_ref().map(entry))
    }

    fn list(&self, prefix: &str, each: &mut dyn FnMut(Entry)) -> Result<(), DepotError> {
        let path = Path::from(prefix);
        let listed = async {
            let mut found = self.store.list(Some(&path));
            while let Some(meta) = found.next().await {
                each(entry(&meta.map_err(boxed)?));
            }
            Ok(())
        };
        self.runtime
            .block_on(listed)
            .map_err(|err| self.failed("list", prefix, &err))
    }

    fn remove(&self, key: &str) -> Result<(), DepotError> {
        let removed = self.runtime.block_on(self.store.delete(&Path::from(key)));
        if_there(removed).map_err(|err| self.failed("remove", key, &err))?;
        Ok(())
    }
}

fn entry(meta: &ObjectMeta) -> Entry {
    Entry {
        key: meta.location.to_string(),
        size: meta.size,
        modified: meta.last_modified.into(),
    }
}

/// An error whose type does not matter.
pub(crate) type Boxed = Box<dyn std::error::Error + Send + Sync>;

pub(crate) fn boxed(err: impl std::error::Error + Send + Sync + 'static) -> Boxed {
    Box::new(err)
}

fn if_there<T>(found: object_store::Result<T>) -> Result<Option<T>, Boxed> {
    match found {
        Err(Error::NotFound { source, .. }) if is_bucket_missing(&*source) => Err(source),
        Err(Error::NotFound { .. }) => Ok(None),
        found => found.map(Some).map_err(boxed),
    }
}

/// Whether it is the bucket that was not found: then every file would seem to be absent.
fn is_bucket_missing(err: &(dyn std::error::Error + 'static)) -> bool {
    let mut cause = Some(err);
    while let Some(err) = cause {
        if err.to_string().contains("NoSuchBucket") {
            return true;
        }
        cause = err.source();
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_endpoint_is_a_url_and_says_whether_it_encrypts() {
        let said = |name: &str, endpoint: &str, allowed: &str| {
            let found = check_endpoints(|asked| match asked {
                "AWS_ALLOW_HTTP" => Some(allowed.to_owned()),
                asked => (asked == name).then(|| endpoint.to_owned()),
            });
            found.err().map(|err| err.to_string())
        };
        for name in ENDPOINTS {
            assert_eq!(said(name, "https://minio.lab:9000", ""), None);
            assert_eq!(said(name, "http://minio.lab:9000", "true"), None);
            assert_eq!(said(name, "", ""), None);
            for wrong in ["minio.lab:9000", "//minio.lab", "htps://minio.lab", "minio"] {
                let said = said(name, wrong, "true").unwrap();
                assert!(said.contains(name) && said.contains(wrong), "{said}");
                assert!(said.contains("`https://minio"), "{said}");
            }
            let plain = said(name, "http://minio.lab:9000", "yes").unwrap();
            assert!(
                plain.contains(name) && plain.contains("AWS_ALLOW_HTTP=true"),
                "{plain}"
            );
        }
    }
}
