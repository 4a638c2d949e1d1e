//! Requests to a depot that cannot hang, and that stop at the first failure.

use std::{
    io::{self, Read},
    sync::{
        Arc, OnceLock,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::Duration,
};

use crate::{
    DepotError,
    interface::{Content, Depot, Entry, Put, PutMode, Sink},
    watch::{Pass, watched},
};

/// Silence after which a depot counts as down: a run may lose 5 s to it in all.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(4);

/// Bytes per second that any depot takes: the last answer to a large file may come late.
const SLOWEST: u64 = 1_000_000;

/// A connection to a depot.
///
/// After a request has failed or was not answered, the depot is *offline* for this process: further
/// requests fail at once, so that their callers go on without the depot.
pub struct Link {
    depot: Arc<dyn Depot>,
    offline: OnceLock<String>,
    n_requests: AtomicU64,
    bytes_got: AtomicU64,
    bytes_put: AtomicU64,
}

/// Traffic of a link.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Number of requests.
    pub n_requests: u64,
    /// Bytes fetched.
    pub bytes_got: u64,
    /// Bytes sent.
    pub bytes_put: u64,
}

impl Link {
    /// Returns a link to a depot; nothing is asked of it yet.
    pub fn new(depot: Arc<dyn Depot>) -> Self {
        Self {
            depot,
            offline: OnceLock::new(),
            n_requests: AtomicU64::new(0),
            bytes_got: AtomicU64::new(0),
            bytes_put: AtomicU64::new(0),
        }
    }

    /// Returns why the depot is offline, if it is.
    pub fn offline(&self) -> Option<&str> {
        self.offline.get().map(String::as_str)
    }

    /// Takes the depot offline.
    pub fn give_up(&self, why: String) {
        self.offline.get_or_init(|| why);
    }

    /// Returns the traffic of the link so far.
    pub fn traffic(&self) -> Traffic {
        Traffic {
            n_requests: self.n_requests.load(Ordering::Relaxed),
            bytes_got: self.bytes_got.load(Ordering::Relaxed),
            bytes_put: self.bytes_put.load(Ordering::Relaxed),
        }
    }

    /// Passes the bytes of a file to `sink`; returns whether there is such a file.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline, with the error of `sink`, which takes no depot offline, or if
    /// the request fails.
    pub fn get(&self, key: &str, sink: &mut Sink) -> Result<bool, DepotError> {
        let asked = key.to_owned();
        let work = move |depot: &dyn Depot, pass: &mut Pass<Vec<u8>>| {
            depot.get(&asked, &mut |bytes| {
                let is_wanted = pass(bytes.to_vec());
                is_wanted.then_some(()).ok_or_else(not_wanted)
            })
        };
        let mut taken = Ok(());
        let got = self.ask("get", key, ANSWER_TIMEOUT, work, |bytes: Vec<u8>| {
            let n_bytes = bytes.len() as u64;
            self.bytes_got.fetch_add(n_bytes, Ordering::Relaxed);
            taken = sink(&bytes);
            taken.is_ok()
        });
        taken.map_err(DepotError::io("get", key))?;
        got
    }

    /// Returns a small file, if there is such a file.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline or the request fails.
    pub fn read(&self, key: &str) -> Result<Option<Vec<u8>>, DepotError> {
        let mut bytes = Vec::new();
        let is_there = self.get(key, &mut |piece| {
            bytes.extend_from_slice(piece);
            Ok(())
        })?;
        Ok(is_there.then_some(bytes))
    }

    /// Stores a file, whole or not at all.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline, the content cannot be read or the request fails.
    pub fn put(&self, key: &str, content: Content, mode: PutMode) -> Result<Put, DepotError> {
        let size = content.size;
        let asked = key.to_owned();
        let is_unreadable = Arc::new(AtomicBool::new(false));
        let content = Content {
            size,
            reader: Box::new(Watched {
                reader: content.reader,
                is_unreadable: Arc::clone(&is_unreadable),
            }),
        };
        let work = move |depot: &dyn Depot, pass: &mut Pass<()>| {
            let put = depot.put(&asked, content, mode);
            // A content that cannot be read is no fault of the depot.
            if is_unreadable.load(Ordering::Relaxed) {
                pass(());
            }
            put
        };
        let timeout = ANSWER_TIMEOUT + Duration::from_secs(size / SLOWEST);
        let put = self.ask("put", key, timeout, work, |()| false)?;
        self.bytes_put.fetch_add(size, Ordering::Relaxed);
        Ok(put)
    }

    /// Returns a file's size and time, if there is such a file.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline or the request fails.
    pub fn head(&self, key: &str) -> Result<Option<Entry>, DepotError> {
        let asked = key.to_owned();
        let work = move |depot: &dyn Depot, _: &mut Pass<()>| depot.head(&asked);
        self.ask("look for", key, ANSWER_TIMEOUT, work, |()| true)
    }

    /// Lists every file whose key begins with `prefix` and `/`, in any order.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline or the request fails.
    pub fn list(&self, prefix: &str) -> Result<Vec<Entry>, DepotError> {
        let asked = prefix.to_owned();
        let work = move |depot: &dyn Depot, pass: &mut Pass<Entry>| {
            depot.list(&asked, &mut |entry| {
                let _is_wanted = pass(entry);
            })
        };
        let mut entries = Vec::new();
        self.ask("list", prefix, ANSWER_TIMEOUT, work, |entry| {
            entries.push(entry);
            true
        })?;
        Ok(entries)
    }

    /// Removes a file, if there is one.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline or the request fails.
    pub fn remove(&self, key: &str) -> Result<(), DepotError> {
        let asked = key.to_owned();
        let work = move |depot: &dyn Depot, _: &mut Pass<()>| depot.remove(&asked);
        self.ask("remove", key, ANSWER_TIMEOUT, work, |()| true)
    }

    /// Makes a request, if the depot is not offline, and takes it offline if that fails.
    fn ask<T: Send + 'static, R: Send + 'static>(
        &self,
        action: &'static str,
        key: &str,
        timeout: Duration,
        work: impl FnOnce(&dyn Depot, &mut Pass<T>) -> Result<R, DepotError> + Send + 'static,
        mut each: impl FnMut(T) -> bool,
    ) -> Result<R, DepotError> {
        if let Some(why) = self.offline() {
            let why = why.to_owned();
            return Err(DepotError::Offline { why });
        }
        self.n_requests.fetch_add(1, Ordering::Relaxed);
        let depot = Arc::clone(&self.depot);
        let mut is_refused = false;
        let answer = watched(
            timeout,
            move |pass| work(&*depot, pass),
            |part| {
                is_refused = is_refused || !each(part);
                !is_refused
            },
        );
        let answer = answer.unwrap_or_else(|| {
            Err(DepotError::Silent {
                action,
                key: key.to_owned(),
                waited: timeout,
            })
        });
        if let Err(err) = &answer
            && !is_refused
        {
            self.give_up(err.chain());
        }
        answer
    }
}

/// A content that notes whether it could be read.
struct Watched {
    reader: Box<dyn Read + Send>,
    is_unreadable: Arc<AtomicBool>,
}

impl Read for Watched {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.reader.read(into);
        self.is_unreadable
            .fetch_or(read.is_err(), Ordering::Relaxed);
        read
    }
}

fn not_wanted() -> io::Error {
    io::Error::other("nobody takes the bytes any more")
}

#[cfg(test)]
mod tests {
    use std::time::SystemTime;

    use super::*;

    /// A depot whose every request fails, is refused or is never answered.
    enum Broken {
        Fails,
        Hangs,
    }

    impl Broken {
        fn ask<T>(&self) -> Result<T, DepotError> {
            match self {
                Self::Fails => Err(DepotError::io("get", "key")(io::Error::other("down"))),
                Self::Hangs => loop {
                    std::thread::park();
                },
            }
        }
    }

    impl Depot for Broken {
        fn get(&self, _: &str, _: &mut Sink) -> Result<bool, DepotError> {
            self.ask()
        }

        fn put(&self, _: &str, _: Content, _: PutMode) -> Result<Put, DepotError> {
            self.ask()
        }

        fn head(&self, _: &str) -> Result<Option<Entry>, DepotError> {
            self.ask()
        }

        fn list(&self, _: &str, _: &mut dyn FnMut(Entry)) -> Result<(), DepotError> {
            self.ask()
        }

        fn remove(&self, _: &str) -> Result<(), DepotError> {
            self.ask()
        }
    }

    /// A depot that takes and gives anything.
    struct Willing;

    impl Depot for Willing {
        fn get(&self, _: &str, sink: &mut Sink) -> Result<bool, DepotError> {
            sink(b"bytes").map_err(DepotError::io("get", "key"))?;
            Ok(true)
        }

        fn put(&self, _: &str, mut content: Content, _: PutMode) -> Result<Put, DepotError> {
            let read = content.reader.read_to_end(&mut Vec::new());
            read.map_err(DepotError::io("put", "key"))?;
            Ok(Put::New)
        }

        fn head(&self, key: &str) -> Result<Option<Entry>, DepotError> {
            Ok(Some(Entry {
                key: key.to_owned(),
                size: 5,
                modified: SystemTime::UNIX_EPOCH,
            }))
        }

        fn list(&self, _: &str, _: &mut dyn FnMut(Entry)) -> Result<(), DepotError> {
            Ok(())
        }

        fn remove(&self, _: &str) -> Result<(), DepotError> {
            Ok(())
        }
    }

    #[test]
    fn a_depot_that_fails_or_hangs_is_asked_once() {
        for (broken, why) in [(Broken::Fails, "down"), (Broken::Hangs, "did not answer")] {
            let link = Link::new(Arc::new(broken));
            assert!(link.head("key").is_err());
            assert!(
                link.offline().unwrap().contains(why),
                "{:?}",
                link.offline()
            );
            assert!(matches!(link.read("key"), Err(DepotError::Offline { .. })));
            assert_eq!(link.traffic().n_requests, 1);
        }
    }

    #[test]
    fn unreadable_content_and_refused_bytes_are_no_fault_of_the_depot() {
        struct Unreadable;
        impl Read for Unreadable {
            fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
                Err(io::Error::other("damaged"))
            }
        }
        let link = Link::new(Arc::new(Willing));
        let content = Content {
            size: 5,
            reader: Box::new(Unreadable),
        };
        let put = link.put("key", content, PutMode::Always);
        assert!(put.unwrap_err().chain().contains("damaged"));
        let mut refuse = |_: &[u8]| Err(io::Error::other("too long"));
        let got = link.get("key", &mut refuse);
        assert!(got.unwrap_err().chain().contains("too long"));
        assert_eq!(link.offline(), None);
        assert_eq!(link.read("key").unwrap().unwrap(), b"bytes");
        assert_eq!(link.traffic().bytes_got, 10);
    }
}
