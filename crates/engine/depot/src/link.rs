//! Requests to a depot that cannot hang, and are repeated while it is down: a file system or a store that machines
//! share has bad minutes, which are no end.

use std::{
    io::{self, Read},
    sync::{
        Arc, Mutex, MutexGuard,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use clock::{Condvar, Pass, watched};

use crate::{
    DepotError,
    interface::{Content, Depot, Entry, Put, PutMode},
    patience::{ANSWER_TIMEOUT, Outage, Patience, SAID_AFTER, pause, timeout},
};

/// Bytes per second that any depot takes: the last answer to a large file may come late.
const SLOWEST: u64 = 1_000_000;

/// A connection to a depot.
///
/// A request that fails or is not answered is made again, with growing pauses, as [`Patience`] says. Where that ends,
/// the depot is *offline* for this link: further requests fail at once.
pub struct Link {
    depot: Arc<dyn Depot>,
    patience: Patience,
    on_outage: Option<Arc<OutageListener>>,
    state: Mutex<State>,
    /// Wakes requests that pause.
    hurried: Condvar,
    n_requests: AtomicU64,
    bytes_got: AtomicU64,
    bytes_put: AtomicU64,
}

/// Receives outages when they have lasted for a while, and their ends.
pub type OutageListener = dyn Fn(&Outage) + Send + Sync;

/// State of a link.
struct State {
    offline: Option<Arc<DepotError>>,
    /// Times of the last success and the last failure, and of the first failure since the last success.
    succeeded: Option<Instant>,
    last_failure: Option<Instant>,
    down: Option<Instant>,
    /// Why requests have failed since the last success.
    failing: Option<String>,
    /// Failures without a success between them, and the time before which nothing is asked, of a casual link.
    n_failed: u32,
    asked_from: Option<Instant>,
    /// Requests whose outage was told.
    n_told: usize,
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

impl std::ops::Add for Traffic {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            n_requests: self.n_requests + other.n_requests,
            bytes_got: self.bytes_got + other.bytes_got,
            bytes_put: self.bytes_put + other.bytes_put,
        }
    }
}

/// Piece of a file that is fetched.
pub enum Piece<'a> {
    /// The file begins, again where a request is repeated: what came before counts no more.
    Begin,
    /// Its next bytes.
    Bytes(&'a [u8]),
}

/// Receives the pieces of a file.
pub type PieceSink<'a> = dyn FnMut(Piece) -> io::Result<()> + 'a;

/// Opens the content of a file to store, for each try anew.
pub type ContentSource<'a> = dyn Fn() -> io::Result<Content> + 'a;

/// One try of a request, with the time that its answer may take beyond that of a small one.
type Try<T, R> = (Duration, Work<T, R>);
type Work<T, R> = Box<dyn FnOnce(&dyn Depot, &mut Pass<T>) -> Result<R, DepotError> + Send>;

/// Part of an answer.
enum Part<T> {
    Begin,
    Next(T),
}

impl Link {
    /// Returns a link to a depot; nothing is asked of it yet.
    pub fn new(depot: Arc<dyn Depot>, patience: Patience) -> Self {
        Self {
            depot,
            patience,
            on_outage: None,
            state: Mutex::new(State {
                offline: None,
                succeeded: None,
                last_failure: None,
                down: None,
                failing: None,
                n_failed: 0,
                asked_from: None,
                n_told: 0,
            }),
            hurried: Condvar::default(),
            n_requests: AtomicU64::new(0),
            bytes_got: AtomicU64::new(0),
            bytes_put: AtomicU64::new(0),
        }
    }

    /// Reports outages to a listener.
    #[must_use]
    pub fn with_outage_listener(mut self, on_outage: Option<Arc<OutageListener>>) -> Self {
        self.on_outage = on_outage;
        self
    }

    /// Returns why the depot is offline, if it is.
    pub fn offline(&self) -> Option<String> {
        self.state().offline.as_ref().map(|err| err.chain())
    }

    /// Takes the depot offline.
    pub fn give_up(&self, why: DepotError) -> DepotError {
        let mut state = self.state();
        let offline = state.offline.get_or_insert_with(|| Arc::new(why));
        DepotError::Offline(Arc::clone(offline))
    }

    /// Returns when a request failed last, if one did.
    pub fn last_failure(&self) -> Option<Instant> {
        self.state().last_failure
    }

    /// Returns when a request succeeded last, if one did.
    pub fn succeeded(&self) -> Option<Instant> {
        self.state().succeeded
    }

    /// Returns for how long requests have failed without a success.
    pub fn down_for(&self) -> Option<Duration> {
        self.state().down.map(clock::since)
    }

    /// Returns why requests have failed since the last success, if they have, or why the depot is offline.
    pub fn failing(&self) -> Option<String> {
        self.offline().or_else(|| self.state().failing.clone())
    }

    /// Returns the traffic of the link so far.
    pub fn traffic(&self) -> Traffic {
        Traffic {
            n_requests: self.n_requests.load(Ordering::Relaxed),
            bytes_got: self.bytes_got.load(Ordering::Relaxed),
            bytes_put: self.bytes_put.load(Ordering::Relaxed),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        clock::lock(&self.state)
    }

    /// Passes the bytes of a file to `sink`; returns whether there is such a file.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline, with the error of `sink`, which takes no depot offline, or if
    /// the request fails.
    pub fn get(&self, key: &str, sink: &mut PieceSink) -> Result<bool, DepotError> {
        let work = || {
            let asked = key.to_owned();
            let work: Work<Vec<u8>, bool> = Box::new(move |depot, pass| {
                depot.get(&asked, &mut |bytes| {
                    let is_wanted = pass(bytes.to_vec());
                    is_wanted.then_some(()).ok_or_else(not_wanted)
                })
            });
            Ok((Duration::ZERO, work))
        };
        let mut taken = Ok(());
        let got = self.ask("get", key, work, |part| {
            taken = match part {
                Part::Begin => sink(Piece::Begin),
                Part::Next(bytes) => {
                    let n_bytes = bytes.len() as u64;
                    self.bytes_got.fetch_add(n_bytes, Ordering::Relaxed);
                    sink(Piece::Bytes(&bytes))
                }
            };
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
            match piece {
                Piece::Begin => bytes.clear(),
                Piece::Bytes(piece) => bytes.extend_from_slice(piece),
            }
            Ok(())
        })?;
        Ok(is_there.then_some(bytes))
    }

    /// Stores a file, whole or not at all.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline, the content cannot be opened or read, or the request fails.
    pub fn put(&self, key: &str, open: &ContentSource, mode: PutMode) -> Result<Put, DepotError> {
        let mut size = 0;
        let work = || {
            let content = open().map_err(DepotError::io("put", key))?;
            let asked = key.to_owned();
            let is_unreadable = Arc::new(AtomicBool::new(false));
            let content = Content {
                size: content.size,
                reader: Box::new(Watched {
                    reader: content.reader,
                    is_unreadable: Arc::clone(&is_unreadable),
                }),
            };
            size = content.size;
            let work: Work<(), Put> = Box::new(move |depot, pass| {
                let put = depot.put(&asked, content, mode);
                // A content that cannot be read is no fault of the depot.
                if is_unreadable.load(Ordering::Relaxed) {
                    pass(());
                }
                put
            });
            Ok((Duration::from_secs(size / SLOWEST), work))
        };
        let put = self.ask("put", key, work, |part| matches!(part, Part::Begin))?;
        self.bytes_put.fetch_add(size, Ordering::Relaxed);
        Ok(put)
    }

    /// Stores a small file.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline or the request fails.
    pub fn put_bytes(&self, key: &str, bytes: &[u8], mode: PutMode) -> Result<Put, DepotError> {
        self.put(key, &|| Ok(Content::of_bytes(bytes.to_vec())), mode)
    }

    /// Returns a file's size and time, if there is such a file.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline or the request fails.
    pub fn head(&self, key: &str) -> Result<Option<Entry>, DepotError> {
        self.ask_simply("look for", key, |depot, key| depot.head(key))
    }

    /// Lists every file whose key begins with `prefix` and `/`, in any order.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline or the request fails.
    pub fn list(&self, prefix: &str) -> Result<Vec<Entry>, DepotError> {
        let work = || {
            let asked = prefix.to_owned();
            let work: Work<Entry, ()> = Box::new(move |depot, pass| {
                depot.list(&asked, &mut |entry| {
                    let _is_wanted = pass(entry);
                })
            });
            Ok((Duration::ZERO, work))
        };
        let mut entries = Vec::new();
        self.ask("list", prefix, work, |part| {
            match part {
                Part::Begin => entries.clear(),
                Part::Next(entry) => entries.push(entry),
            }
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
        self.ask_simply("remove", key, |depot, key| depot.remove(key))
    }

    /// Makes a request whose answer has no parts.
    fn ask_simply<R: Send + 'static>(
        &self,
        action: &'static str,
        key: &str,
        ask: fn(&dyn Depot, &str) -> Result<R, DepotError>,
    ) -> Result<R, DepotError> {
        let work = || {
            let asked = key.to_owned();
            let work: Work<(), R> = Box::new(move |depot, _| ask(depot, &asked));
            Ok((Duration::ZERO, work))
        };
        self.ask(action, key, work, |_| true)
    }

    /// Makes a request, and again while it fails and this link is patient. `work` gives each try; `each` takes the
    /// parts of the answer, and says whether it wants more.
    fn ask<T: Send + 'static, R: Send + 'static>(
        &self,
        action: &'static str,
        key: &str,
        mut work: impl FnMut() -> Result<Try<T, R>, DepotError>,
        mut each: impl FnMut(Part<T>) -> bool,
    ) -> Result<R, DepotError> {
        self.check()?;
        let began = clock::now();
        let mut is_told = false;
        let mut n_failed = 0;
        loop {
            self.n_requests.fetch_add(1, Ordering::Relaxed);
            let (longer, work) = work()?;
            let patience = self.patience.left(began);
            let waited = longer + patience.map_or(ANSWER_TIMEOUT, |left| timeout(n_failed, left));
            let depot = Arc::clone(&self.depot);
            let mut is_refused = !each(Part::Begin);
            let answer = watched(
                waited,
                move |pass| work(&*depot, pass),
                |part| {
                    is_refused = is_refused || !each(Part::Next(part));
                    !is_refused
                },
            );
            let silent = || DepotError::Silent {
                action,
                key: key.to_owned(),
                waited,
            };
            let err = match answer.unwrap_or_else(|| Err(silent())) {
                Err(err) if is_refused => return Err(err),
                Err(err) => err,
                Ok(answer) => {
                    self.success(is_told, began);
                    return Ok(answer);
                }
            };
            n_failed += 1;
            self.failure(&err);
            let left = self.patience.left(began).filter(|_| !err.is_lasting());
            let Some(left) = left.filter(|left| !left.is_zero()) else {
                return Err(self.end(err, is_told, clock::since(began)));
            };
            if clock::since(began) >= SAID_AFTER && !is_told {
                is_told = true;
                self.tell(&err, clock::since(began), left);
            }
            self.pause(pause(n_failed).min(left));
            self.check()?;
        }
    }

    /// Makes requests that pause between two tries again at once.
    pub fn retry_now(&self) {
        self.hurried.notify_all();
    }

    fn pause(&self, time: Duration) {
        let waited = self.hurried.wait_timeout(self.state(), &self.state, time);
        drop(waited);
    }

    /// Fails if nothing is asked now.
    fn check(&self) -> Result<(), DepotError> {
        let state = self.state();
        if let Some(err) = &state.offline {
            return Err(DepotError::Offline(Arc::clone(err)));
        }
        match state.asked_from {
            Some(from) if clock::now() < from => Err(DepotError::Resting),
            _ => Ok(()),
        }
    }

    fn success(&self, is_told: bool, began: Instant) {
        let mut state = self.state();
        (state.n_failed, state.asked_from) = (0, None);
        (state.down, state.failing) = (None, None);
        state.succeeded = Some(clock::now());
        if is_told {
            state.n_told -= 1;
            if state.n_told == 0 {
                drop(state);
                self.say(&Outage {
                    lasted: clock::since(began),
                    why: None,
                    left: Duration::ZERO,
                });
            }
        }
    }

    fn failure(&self, err: &DepotError) {
        let mut state = self.state();
        let now = clock::now();
        state.last_failure = Some(now);
        state.down.get_or_insert(now);
        state.failing = Some(err.chain());
        state.n_failed = state.n_failed.saturating_add(1);
        if matches!(self.patience, Patience::Casual) {
            state.asked_from = Some(now + pause(state.n_failed + Patience::CASUAL_FROM));
        }
    }

    /// The error of a request that is not made again.
    fn end(&self, err: DepotError, is_told: bool, lasted: Duration) -> DepotError {
        if is_told {
            self.state().n_told -= 1;
        }
        if !matches!(self.patience, Patience::For(_)) {
            return err;
        }
        let err = if err.is_lasting() || lasted < SAID_AFTER {
            err
        } else {
            DepotError::Down {
                lasted,
                source: Box::new(err),
            }
        };
        self.give_up(err)
    }

    fn tell(&self, err: &DepotError, lasted: Duration, left: Duration) {
        let mut state = self.state();
        state.n_told += 1;
        if state.n_told == 1 {
            drop(state);
            self.say(&Outage {
                lasted,
                why: Some(err.chain()),
                left,
            });
        }
    }

    fn say(&self, outage: &Outage) {
        if let Some(on_outage) = &self.on_outage {
            on_outage(outage);
        }
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
mod tests;
