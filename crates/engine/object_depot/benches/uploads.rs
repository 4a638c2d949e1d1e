//! Uploads to an object store beside the bare client on the same server: 10,000 files of 1 kB, 64 at once
//! and as many as a lake sends, and one of 1 GiB; and the memory that they take.
//!
//! The server is that of the environment, the first argument its bucket and prefix. With `moto`'s, on a
//! machine with 4 GB to spare (it keeps everything in memory):
//!
//! ```sh
//! python -m moto.server -p 5555 & curl -X PUT http://127.0.0.1:5555/lab
//! export AWS_ENDPOINT_URL=http://127.0.0.1:5555 AWS_ALLOW_HTTP=true AWS_REGION=us-east-1
//! export AWS_ACCESS_KEY_ID=key AWS_SECRET_ACCESS_KEY=secret
//! cargo bench -p object_depot --bench uploads -- s3://lab/bench
//! ```

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

use std::{
    fs,
    io::{self, Read},
    sync::atomic::{AtomicUsize, Ordering},
    thread,
    time::Instant,
};

use depot::{Content, Depot, PutMode};
use futures_util::{StreamExt, stream};
use object_depot::ObjectDepot;
use object_store::{
    ObjectStore, ObjectStoreExt, PutPayload, WriteMultipart, aws::AmazonS3Builder, path::Path,
};
use tokio::runtime::Runtime;

/// Small files, their bytes, and how many are on their way at once.
const N_FILES: usize = 10_000;
const SMALL: usize = 1000;
const AT_ONCE: usize = 64;

/// Files that a lake sends at once.
const OF_A_LAKE: usize = 8;

/// Bytes of the large file, and of its parts by the bare client.
const LARGE: usize = 1 << 30;
const PART: usize = 8 << 20;

/// By what share equal uploads differ, with other programs beside.
const NOISE: f64 = 0.1;

/// Files in each turn: the clients take turns, for a server may slow down with what it holds.
const TURN: usize = 1000;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let Some(url) = arguments.find(|argument| argument.starts_with("s3://")) else {
        println!("name a bucket and prefix, e.g. `-- s3://lab/bench`");
        return;
    };
    let ours = ObjectDepot::from_url(&url).unwrap();
    let bare = Bare::new(&url);
    let mut seconds = [0.0; 3];
    for turn in 0..N_FILES / TURN {
        let names = |who: &str| (0..TURN).map(|n| format!("{who}/{turn}/{n}")).collect();
        seconds[0] += timed(|| bare.small(names("bare")));
        seconds[1] += timed(|| small(&ours, &names("ours"), AT_ONCE));
        seconds[2] += timed(|| small(&ours, &names("lake"), OF_A_LAKE));
    }
    let per_second = seconds.map(|seconds| N_FILES as f64 / seconds);
    println!(
        "files of 1 kB a second: bare client, 64 at once {:.0}",
        per_second[0]
    );
    println!(
        "  ours, 64 at once {:.0}: {:.2} of it",
        per_second[1],
        per_second[1] / per_second[0]
    );
    println!(
        "  as a lake sends {:.0}: {:.2} of it",
        per_second[2],
        per_second[2] / per_second[0]
    );

    // Before the bare client, which keeps more in memory.
    let large_s = timed(|| {
        let content = Content {
            size: LARGE as u64,
            reader: Box::new(io::repeat(7).take(LARGE as u64)),
        };
        ours.put("large/ours", content, PutMode::Always).unwrap();
    });
    let memory = memory_mb();
    let bare_large_s = timed(|| bare.large());
    println!(
        "1 GiB: bare client {bare_large_s:.1} s, ours {large_s:.1} s: {:.2} of its speed",
        bare_large_s / large_s
    );
    println!("memory {memory:.0} MB");
    let least = 0.8 * (1.0 - NOISE);
    if per_second[1] < least * per_second[0] || bare_large_s < least * large_s || memory > 200.0 {
        println!("limit: 0.8 of the bare client, 200 MB: MISSED by more than noise");
        std::process::exit(1);
    }
}

fn timed(work: impl FnOnce()) -> f64 {
    let started = Instant::now();
    work();
    started.elapsed().as_secs_f64()
}

/// Stores small files by threads.
fn small(depot: &ObjectDepot, names: &[String], at_once: usize) {
    let next = AtomicUsize::new(0);
    thread::scope(|scope| {
        for _ in 0..at_once {
            scope.spawn(|| {
                while let Some(name) = names.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let content = Content::of_bytes(vec![7; SMALL]);
                    depot.put(name, content, PutMode::Always).unwrap();
                }
            });
        }
    });
}

/// The client alone.
struct Bare {
    store: Box<dyn ObjectStore>,
    prefix: String,
    runtime: Runtime,
}

impl Bare {
    fn new(url: &str) -> Self {
        let rest = url.trim_start_matches("s3://");
        let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let store = AmazonS3Builder::from_env().with_bucket_name(bucket);
        Self {
            store: Box::new(store.build().unwrap()),
            prefix: prefix.to_owned(),
            runtime: Runtime::new().unwrap(),
        }
    }

    fn path(&self, name: &str) -> Path {
        Path::from(format!("{}/{name}", self.prefix))
    }

    fn small(&self, names: Vec<String>) {
        let puts = stream::iter(names).map(|name| async move {
            let bytes = PutPayload::from(vec![7; SMALL]);
            self.store.put(&self.path(&name), bytes).await.unwrap();
        });
        self.runtime
            .block_on(puts.buffer_unordered(AT_ONCE).collect::<Vec<()>>());
    }

    fn large(&self) {
        self.runtime.block_on(async {
            let upload = self.store.put_multipart(&self.path("large/bare")).await;
            let mut upload = WriteMultipart::new_with_chunk_size(upload.unwrap(), PART);
            for _ in 0..LARGE / PART {
                upload.wait_for_capacity(OF_A_LAKE).await.unwrap();
                upload.write(&vec![7; PART]);
            }
            upload.finish().await.unwrap();
        });
    }
}

/// The most memory that this process has had, in MB.
fn memory_mb() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().strip_suffix(" kB"));
    kib.unwrap().parse::<f64>().unwrap() * 1024.0 / 1e6
}
