use std::{collections::BTreeMap, sync::atomic::AtomicUsize, thread, time::SystemTime};

use super::*;

/// Fault of a request.
#[derive(Clone, Copy)]
enum Fault {
    Fails,
    Hangs,
    /// The answer begins, and fails before its end.
    Cut,
}

/// A depot in memory whose first requests meet a fault.
struct Faulty {
    fault: Fault,
    n_faults: usize,
    n_asked: AtomicUsize,
    files: Mutex<BTreeMap<String, Vec<u8>>>,
}

impl Faulty {
    fn new(fault: Fault, n_faults: usize) -> Arc<Self> {
        Arc::new(Self {
            fault,
            n_faults,
            n_asked: AtomicUsize::new(0),
            files: Mutex::default(),
        })
    }

    /// Whether the answer to this request is cut.
    fn ask(&self) -> Result<bool, DepotError> {
        if self.n_asked.fetch_add(1, Ordering::Relaxed) >= self.n_faults {
            return Ok(false);
        }
        match self.fault {
            Fault::Fails => Err(down()),
            Fault::Hangs => loop {
                thread::park();
            },
            Fault::Cut => Ok(true),
        }
    }
}

fn down() -> DepotError {
    DepotError::io("get", "key")(io::Error::other("down"))
}

impl Depot for Faulty {
    fn get(&self, key: &str, sink: &mut crate::Sink) -> Result<bool, DepotError> {
        let is_cut = self.ask()?;
        let Some(bytes) = self.files.lock().unwrap().get(key).cloned() else {
            return Ok(false);
        };
        let (first, rest) = bytes.split_at(bytes.len() / 2);
        sink(first).map_err(DepotError::io("get", key))?;
        if is_cut {
            return Err(down());
        }
        sink(rest).map_err(DepotError::io("get", key))?;
        Ok(true)
    }

    fn put(&self, key: &str, mut content: Content, _: PutMode) -> Result<Put, DepotError> {
        let mut bytes = Vec::new();
        let read = content.reader.read_to_end(&mut bytes);
        read.map_err(DepotError::io("put", key))?;
        if self.ask()? {
            return Err(down());
        }
        self.files.lock().unwrap().insert(key.to_owned(), bytes);
        Ok(Put::New)
    }

    fn head(&self, key: &str) -> Result<Option<Entry>, DepotError> {
        self.ask()?;
        Ok(Some(entry(key)))
    }

    fn list(&self, _: &str, each: &mut dyn FnMut(Entry)) -> Result<(), DepotError> {
        let is_cut = self.ask()?;
        each(entry("first"));
        if is_cut {
            return Err(down());
        }
        each(entry("second"));
        Ok(())
    }

    fn remove(&self, _: &str) -> Result<(), DepotError> {
        self.ask().map(drop)
    }
}

fn entry(key: &str) -> Entry {
    Entry {
        key: key.to_owned(),
        size: 5,
        modified: SystemTime::UNIX_EPOCH,
    }
}

fn patient(seconds: u64) -> Patience {
    Patience::For(Duration::from_secs(seconds))
}

#[test]
fn requests_are_made_again_until_the_depot_is_back_and_come_out_whole() {
    for fault in [Fault::Fails, Fault::Cut] {
        let link = Link::new(Faulty::new(fault, 2), patient(60));
        link.put_bytes("key", b"bytes", PutMode::Always).unwrap();
        for _ in 0..2 {
            let link = Link::new(Arc::clone(&link.depot), patient(60));
            assert_eq!(link.read("key").unwrap().unwrap(), b"bytes");
            assert_eq!(link.list("").unwrap().len(), 2);
            assert_eq!(link.offline(), None);
        }
        assert!(link.last_failure().is_some());
    }
    let link = Link::new(Faulty::new(Fault::Cut, 3), patient(60));
    assert_eq!(link.list("").unwrap().len(), 2, "each entry once");
    let hung = Link::new(Faulty::new(Fault::Hangs, 1), patient(60));
    assert!(hung.head("key").unwrap().is_some());
}

#[test]
fn an_outage_is_told_once_with_its_end() {
    let said = Arc::new(Mutex::new(Vec::new()));
    let listener: Arc<OutageListener> = {
        let said = Arc::clone(&said);
        Arc::new(move |outage: &Outage| said.lock().unwrap().push(outage.clone()))
    };
    let link =
        Link::new(Faulty::new(Fault::Fails, 6), patient(60)).with_outage_listener(Some(listener));
    assert!(link.head("key").unwrap().is_some());
    let said = said.lock().unwrap();
    let [begin, end] = said.as_slice() else {
        panic!("{said:?}");
    };
    assert!(begin.why.as_ref().unwrap().contains("down"), "{begin:?}");
    assert_eq!(end.why, None);
    assert!(begin.lasted < end.lasted);
}

#[test]
fn patience_ends_and_then_nothing_is_asked_any_more() {
    for (fault, why) in [(Fault::Fails, "down"), (Fault::Hangs, "did not answer")] {
        let link = Link::new(Faulty::new(fault, usize::MAX), patient(2));
        let began = Instant::now();
        let err = link.head("key").unwrap_err();
        assert!(began.elapsed() < Duration::from_secs(4), "{err}");
        assert!(err.chain().contains(why), "{}", err.chain());
        assert!(link.offline().unwrap().contains(why));
        let n_requests = link.traffic().n_requests;
        assert!(matches!(link.read("key"), Err(DepotError::Offline(_))));
        assert_eq!(link.traffic().n_requests, n_requests);
    }
}

#[test]
fn heartbeats_are_asked_once_and_casual_requests_rest_after_a_failure() {
    let link = Link::new(Faulty::new(Fault::Fails, 1), Patience::Once);
    assert!(link.head("key").is_err());
    assert!(link.head("key").is_ok());
    let link = Link::new(Faulty::new(Fault::Fails, 1), Patience::Casual);
    assert!(link.head("key").is_err());
    assert!(matches!(link.head("key"), Err(DepotError::Resting)));
    assert_eq!(link.traffic().n_requests, 1);
    thread::sleep(pause(1 + Patience::CASUAL_FROM));
    assert!(link.head("key").is_ok());
    assert!(link.head("key").is_ok());
}

#[test]
fn unreadable_content_and_refused_bytes_are_no_fault_of_the_depot() {
    struct Unreadable;
    impl Read for Unreadable {
        fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
            Err(io::Error::other("damaged"))
        }
    }
    let link = Link::new(Faulty::new(Fault::Fails, 0), patient(60));
    let open = || {
        Ok(Content {
            size: 5,
            reader: Box::new(Unreadable),
        })
    };
    let put = link.put("key", &open, PutMode::Always);
    assert!(put.unwrap_err().chain().contains("damaged"));
    link.put_bytes("key", b"bytes", PutMode::Always).unwrap();
    let mut refuse = |piece: Piece| match piece {
        Piece::Begin => Ok(()),
        Piece::Bytes(_) => Err(io::Error::other("too long")),
    };
    let got = link.get("key", &mut refuse);
    assert!(got.unwrap_err().chain().contains("too long"));
    assert_eq!(link.offline(), None);
    assert_eq!(link.read("key").unwrap().unwrap(), b"bytes");
}
