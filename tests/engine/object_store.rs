//! A depot in an object store, on `moto`'s server. The Python that `PIPELINE_PYTHON` names has it
//! (`tests/engine/object_store/requirements.txt`); without it these tests skip, saying so.

use std::{
    collections::BTreeSet,
    env,
    io::{self, Read, Write},
    net::{TcpListener, TcpStream},
    process::{Child, Command, Output, Stdio},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use crate::engine::elsewhere::{ACTS, Cluster};
use crate::engine::place::{
    CHAIN, LONG, Place, Running, files_below, free_port, put, read, stderr, stdout,
};

/// Secret that no file and no line may contain.
const SECRET: &str = "a-secret-that-nobody-may-see";
const DEPOT: &str = "s3://lab/results/ours";

/// An S3 server with the bucket `lab`, in memory.
struct Server {
    process: Child,
    port: u16,
}

/// Failure of a request that would create a file, the first one for its key.
#[derive(Debug, Clone, Copy)]
enum Trouble {
    /// The file is stored, and the answer lost.
    LostAnswer,
    /// The file is stored, and the answer says that the server is busy.
    Unavailable,
    /// The file is not stored, and the answer says that another is being stored.
    Conflict,
    /// The condition is ignored, here of every request: the file is stored over any other.
    Replaced,
}

impl Server {
    /// Starts it; says why not, if it cannot be had here.
    fn start() -> Option<Self> {
        let Ok(python) = env::var("PIPELINE_PYTHON") else {
            measured_data::print_skipped("`PIPELINE_PYTHON` names no Python");
            return None;
        };
        let has = Command::new(&python)
            .args(["-c", "import moto.server"])
            .output();
        if !has.is_ok_and(|output| output.status.success()) {
            measured_data::print_skipped(&format!("`{python}` lacks `moto`"));
            return None;
        }
        let port = free_port();
        let process = Command::new(python)
            .args([
                "-m",
                "moto.server",
                "-H",
                "127.0.0.1",
                "-p",
                &port.to_string(),
            ])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let server = Self { process, port };
        let made = format!(
            "PUT /lab HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
        );
        let until = Instant::now() + LONG;
        while !answer(port, made.as_bytes()).is_ok_and(|bytes| bytes.starts_with(b"HTTP/1.1 200")) {
            assert!(Instant::now() < until, "the server does not come up");
            thread::park_timeout(Duration::from_millis(50));
        }
        Some(server)
    }

    /// Starts a proxy before it, in which each file's first create meets trouble; returns its port.
    fn troubled(&self, trouble: Trouble) -> u16 {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let to = self.port;
        let met: Arc<Mutex<BTreeSet<String>>> = Arc::default();
        thread::spawn(move || {
            for client in listener.incoming().map_while(Result::ok) {
                let met = Arc::clone(&met);
                thread::spawn(move || pass(client, to, trouble, &met));
            }
        });
        port
    }
}

/// Fault of an answer.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    /// None comes.
    Hangs,
    /// It is a refusal.
    Refused,
    /// The connection ends in the middle of the body.
    Cut,
    /// It says that the body is as short as it is.
    Short,
    /// The connection ends before it.
    Reset,
    /// It says that the server is busy.
    Busy,
}

const FAULTS: [Fault; 6] = [
    Fault::Hangs,
    Fault::Refused,
    Fault::Cut,
    Fault::Short,
    Fault::Reset,
    Fault::Busy,
];

impl Server {
    /// Starts a proxy before it, in which the first `n_faults` requests that are `chosen` by their first line meet a
    /// fault; returns its port.
    fn faulty(
        &self,
        fault: Fault,
        n_faults: usize,
        chosen: impl Fn(&str) -> bool + Send + Sync + 'static,
    ) -> u16 {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let to = self.port;
        let (n_met, chosen) = (Arc::new(AtomicUsize::new(0)), Arc::new(chosen));
        thread::spawn(move || {
            for mut client in listener.incoming().map_while(Result::ok) {
                let (n_met, chosen) = (Arc::clone(&n_met), Arc::clone(&chosen));
                thread::spawn(move || {
                    let Ok((head, body)) = request(&mut client) else {
                        return;
                    };
                    let line = head.lines().next().unwrap_or_default();
                    let is_met = chosen(line) && n_met.fetch_add(1, Ordering::Relaxed) < n_faults;
                    let head = head.trim_end().to_owned() + "\r\nConnection: close\r\n\r\n";
                    let answered =
                        || answer(to, &[head.as_bytes(), &body].concat()).unwrap_or_default();
                    let answered = match fault {
                        _ if !is_met => answered(),
                        Fault::Hangs => {
                            thread::sleep(LONG);
                            Vec::new()
                        }
                        Fault::Reset => Vec::new(),
                        Fault::Refused => refusal("403 Forbidden"),
                        Fault::Busy => refusal("503 Slow Down"),
                        Fault::Cut | Fault::Short => half(&answered(), fault),
                    };
                    let _sent = client.write_all(&answered);
                });
            }
        });
        port
    }
}

fn refusal(status: &str) -> Vec<u8> {
    let body = "<?xml version=\"1.0\"?><Error><Code>AccessDenied</Code><Message>Access Denied</Message></Error>";
    let length = body.len();
    format!("HTTP/1.1 {status}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{body}")
        .into_bytes()
}

/// The first half of an answer's body.
fn half(answered: &[u8], fault: Fault) -> Vec<u8> {
    let end = answered.windows(4).position(|bytes| bytes == b"\r\n\r\n");
    let (head, body) = answered.split_at(end.map_or(answered.len(), |at| at + 4));
    let body = &body[..body.len() / 2];
    let head = String::from_utf8_lossy(head);
    let lines = head.split("\r\n").map(|line| {
        let is_length = line.to_lowercase().starts_with("content-length:");
        if is_length && fault == Fault::Short {
            format!("Content-Length: {}", body.len())
        } else {
            line.to_owned()
        }
    });
    let head = lines.collect::<Vec<_>>().join("\r\n");
    [head.as_bytes(), body].concat()
}

impl Drop for Server {
    fn drop(&mut self) {
        let _killed = self.process.kill();
        let _ended = self.process.wait();
    }
}

/// Sends a request, the last of its connection, and returns the answer.
fn answer(port: u16, request: &[u8]) -> io::Result<Vec<u8>> {
    let mut stream = TcpStream::connect(("127.0.0.1", port))?;
    stream.write_all(request)?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer)?;
    Ok(answer)
}

/// Reads a request: its head, as text, and its body.
fn request(client: &mut TcpStream) -> io::Result<(String, Vec<u8>)> {
    let mut bytes = Vec::new();
    let mut byte = [0];
    while !bytes.ends_with(b"\r\n\r\n") {
        client.read_exact(&mut byte)?;
        bytes.push(byte[0]);
    }
    let head = String::from_utf8(bytes).map_err(io::Error::other)?;
    let length = head.lines().find_map(|line| {
        let (name, value) = line.split_once(": ")?;
        name.eq_ignore_ascii_case("content-length")
            .then(|| value.parse().ok())?
    });
    let mut body = vec![0; length.unwrap_or(0)];
    client.read_exact(&mut body)?;
    Ok((head, body))
}

/// Passes one request on, unless it meets trouble.
fn pass(mut client: TcpStream, to: u16, trouble: Trouble, met: &Mutex<BTreeSet<String>>) {
    let Ok((head, body)) = request(&mut client) else {
        return;
    };
    let target = head.lines().next().unwrap_or_default().to_owned();
    let creates = head.to_lowercase().contains("\r\nif-none-match:");
    let is_met = creates
        && met
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .insert(target);
    let refusal = |status: &str| {
        format!("HTTP/1.1 {status}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
    };
    if let (true, Trouble::Conflict) = (is_met, trouble) {
        let _sent = client.write_all(refusal("409 Conflict").as_bytes());
        return;
    }
    let kept = |line: &&str| {
        let is_condition = line.to_lowercase().starts_with("if-none-match:");
        !(is_condition && matches!(trouble, Trouble::Replaced))
    };
    let lines: Vec<&str> = head.trim_end().split("\r\n").filter(kept).collect();
    let head = lines.join("\r\n") + "\r\nConnection: close\r\n\r\n";
    let Ok(answered) = answer(to, &[head.as_bytes(), &body].concat()) else {
        return;
    };
    let _sent = match (is_met, trouble) {
        (true, Trouble::LostAnswer) => Ok(()),
        (true, Trouble::Unavailable) => {
            client.write_all(refusal("503 Service Unavailable").as_bytes())
        }
        _ => client.write_all(&answered),
    };
}

/// The variables by which a command uses the depot at a port.
fn variables(url: &str, port: u16) -> [(&'static str, String); 6] {
    [
        ("PIPELINE_DEPOT", url.to_owned()),
        ("AWS_ACCESS_KEY_ID", "a-key".to_owned()),
        ("AWS_SECRET_ACCESS_KEY", SECRET.to_owned()),
        ("AWS_REGION", "us-east-1".to_owned()),
        ("AWS_ENDPOINT_URL", format!("http://127.0.0.1:{port}")),
        ("AWS_ALLOW_HTTP", "true".to_owned()),
    ]
}

/// Lets a command use the depot at a port.
fn share(command: &mut Command, url: &str, port: u16) -> Output {
    command.envs(variables(url, port)).output().unwrap()
}

fn well(output: &Output) -> String {
    let said = stdout(output) + &stderr(output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(!said.contains(SECRET));
    said
}

fn warnings(said: &str) -> usize {
    said.lines()
        .filter(|line| line.starts_with("warn "))
        .count()
}

fn machine(inputs_n: usize) -> Place {
    Place::with_inputs(CHAIN, inputs_n)
}

#[test]
fn machines_share_results_in_an_object_store_and_no_secret_is_kept() {
    let Some(server) = Server::start() else {
        return;
    };
    let (first, second) = (machine(8), machine(8));
    // More than one part.
    for machine in [&first, &second] {
        machine.input("large", &vec![7; 20 << 20]);
    }
    let on = |machine: &Place, command: &str| {
        let said = well(&share(
            &mut machine.command(command, &[]),
            DEPOT,
            server.port,
        ));
        assert_eq!(warnings(&said), 0, "{said}");
    };
    let ask = |machine: &Place, command: &str, arguments: &[&str]| {
        let mut command = machine.bare(&machine.lake(), command);
        well(&share(command.args(arguments), DEPOT, server.port));
    };
    on(&first, "run");
    first.take_log();
    ask(&second, "query", &["--depot", "select * from parts"]);
    on(&second, "run");
    assert_eq!(second.take_log(), []);
    ask(&second, "pull", &[]);
    assert_eq!(second.published(), first.published());
    ask(&second, "verify", &["--depot"]);
    ask(&second, "gc", &["--depot"]);
    ask(&second, "verify", &["--depot"]);
    for path in files_below(&first.lake()) {
        let bytes = read(&path);
        let holds = bytes
            .windows(SECRET.len())
            .any(|bytes| bytes == SECRET.as_bytes());
        assert!(!holds, "`{}`", path.display());
    }
}

#[test]
fn answers_that_are_lost_late_or_of_another_are_no_errors() {
    let Some(server) = Server::start() else {
        return;
    };
    for trouble in [Trouble::LostAnswer, Trouble::Unavailable, Trouble::Conflict] {
        let url = format!("{DEPOT}/{trouble:?}");
        let port = server.troubled(trouble);
        let first = machine(4);
        let said = well(&share(&mut first.command("run", &[]), &url, port));
        assert_eq!(warnings(&said), 0, "{trouble:?}: {said}");
        let mut verify = first.bare(&first.lake(), "verify");
        well(&share(verify.arg("--depot"), &url, server.port));
        let second = machine(4);
        well(&share(&mut second.command("run", &[]), &url, server.port));
        assert_eq!(second.take_log(), [], "{trouble:?}");
    }
}

#[test]
fn in_a_store_that_replaces_files_results_are_shared_and_nothing_is_claimed() {
    let Some(server) = Server::start() else {
        return;
    };
    let port = server.troubled(Trouble::Replaced);
    let [first, second] = [(); 2].map(|()| machine(4));
    for place in [&first, &second] {
        well(&share(&mut place.command("run", &[]), DEPOT, port));
    }
    assert_eq!(second.take_log(), []);
    let place = Place::with_inputs(ACTS, 2);
    let refused = share(&mut place.command("run", &[]), DEPOT, port);
    let said = stderr(&refused);
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains("it replaces files that are there"), "{said}");
    assert!(place.take_log().iter().all(|made| made.kind != "act"));
}

#[test]
fn an_object_store_that_refuses_is_down_or_lacks_the_bucket_costs_one_warning() {
    let Some(mut server) = Server::start() else {
        return;
    };
    let refusing = TcpListener::bind("127.0.0.1:0").unwrap();
    let refuses = refusing.local_addr().unwrap().port();
    thread::spawn(move || {
        for mut client in refusing.incoming().map_while(Result::ok) {
            let _asked = request(&mut client);
            let said = "HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";
            let _sent = client.write_all(said.as_bytes());
        }
    });
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let stays_silent = silent.local_addr().unwrap().port();
    let machine = machine(4);
    let mut added = 2;
    let mut costs_one_warning = |url: &str, port: u16, what: &str| {
        let value = format!("first.add={added}");
        added += 1;
        let started = Instant::now();
        let mut command = machine.command("run", &["--set", &value, "--depot-down", "alone"]);
        let said = well(&share(&mut command, url, port));
        assert_eq!(warnings(&said), 1, "{what}: {said}");
        // It is asked once, and not until some timeout for each of its files.
        assert!(
            started.elapsed() < Duration::from_secs(30),
            "{what}: {:?}",
            started.elapsed()
        );
    };
    costs_one_warning("s3://nothing/here", server.port, "no bucket");
    costs_one_warning(DEPOT, refuses, "refused");
    costs_one_warning(DEPOT, stays_silent, "silent");
    server.process.kill().unwrap();
    server.process.wait().unwrap();
    costs_one_warning(DEPOT, server.port, "down");
}

/// Fills a depot; returns the machine that did.
fn filled(server: &Server, url: &str, n_inputs: usize) -> Place {
    let first = machine(n_inputs);
    well(&share(&mut first.command("run", &[]), url, server.port));
    first
}

#[test]
fn one_answer_that_is_cut_short_refused_or_hung_makes_nothing_again() {
    let Some(server) = Server::start() else {
        return;
    };
    let first = filled(&server, DEPOT, 12);
    let makes_nothing = |fault: Fault, what: &'static str, n_faults: usize| {
        let port = server.faulty(fault, n_faults, move |line| line.contains(what));
        let second = machine(12);
        let said = well(&share(&mut second.command("run", &[]), DEPOT, port));
        let context = format!("{fault:?} {what}: {said}");
        assert_eq!(second.take_log(), [], "{context}");
        assert_eq!(warnings(&said), 0, "{context}");
        let mut pull = second.bare(&second.lake(), "pull");
        well(&share(&mut pull, DEPOT, server.port));
        assert_eq!(second.published(), first.published(), "{context}");
    };
    for fault in FAULTS {
        makes_nothing(fault, "list-type=2", 1);
        makes_nothing(fault, "/units/", 1);
    }
    // Several in a row, and one of each kind of file.
    for (fault, what) in [
        (Fault::Refused, "list-type=2"),
        (Fault::Cut, "/blobs/"),
        (Fault::Short, "/runs/"),
        (Fault::Refused, "/format"),
    ] {
        makes_nothing(fault, what, 3);
    }
}

#[test]
fn a_fault_of_the_depot_ends_no_run_by_jobs_and_loses_no_result() {
    let Some(server) = Server::start() else {
        return;
    };
    for (fault, what) in [
        (Fault::Hangs, "GET messages/ends"),
        (Fault::Refused, "GET messages/ends"),
        (Fault::Cut, "GET messages/ends"),
        // The first tells that the worker is there; the second is a heartbeat.
        (Fault::Hangs, "PUT messages/here"),
        (Fault::Refused, "PUT units"),
        (Fault::Hangs, "PUT blobs"),
    ] {
        let cluster = Cluster::new();
        let table = format!(
            "[slurm]\nheartbeat_timeout_s = 5\nlogs = \"{}\"\n",
            cluster.path("logs").display()
        );
        put(&cluster.path("executors.toml"), table.as_bytes());
        let (method, key) = what.split_once(' ').unwrap();
        let is_heartbeat = key == "messages/here";
        let n_seen = AtomicUsize::new(0);
        let chosen = move |line: &str| {
            let line = line.replace("%2F", "/");
            let is_meant = line.starts_with(method) && line.contains(key);
            is_meant && (!is_heartbeat || n_seen.fetch_add(1, Ordering::Relaxed) > 0)
        };
        let port = server.faulty(fault, 1, chosen);
        let place = machine(1);
        let url = format!("{DEPOT}/{fault:?}/{method}/{key}");
        let mut run = cluster.with(place.held(&["--on", "slurm", "--until", "split"]));
        run.envs(variables(&url, port));
        let mut run = Running::start(run);
        run.wait_for(&place, "p000");
        thread::sleep(Duration::from_secs(3));
        place.let_go("p000");
        let (code, said) = run.finish();
        assert_eq!(code, Some(0), "{fault:?} {what}: {said}");
        assert_eq!(place.take_log().len(), 1, "{fault:?} {what}: {said}");
        assert_eq!(cluster.calls("submit").len(), 1, "{fault:?} {what}: {said}");
        assert_eq!(cluster.calls("cancel").len(), 0, "{fault:?} {what}: {said}");
    }
}

#[test]
fn an_error_of_the_store_names_its_cause_once_and_what_to_do() {
    let Some(server) = Server::start() else {
        return;
    };
    let place = machine(2);
    place.run_well(&[]);
    let refused = server.faulty(Fault::Refused, usize::MAX, |_| true);
    let push = |url: &str, port: u16, change: &dyn Fn(&mut Command)| {
        let mut push = place.bare(&place.lake(), "push");
        push.envs(variables(url, port));
        change(&mut push);
        let output = push.output().unwrap();
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(
            !said.contains("<?xml") && !said.contains("<Code>"),
            "{said}"
        );
        assert!(!said.contains("169.254"), "{said}");
        let error = said.lines().find(|line| line.starts_with("error: "));
        let error = error.unwrap_or_else(|| panic!("{said}")).to_owned();
        (error, said)
    };
    let nothing = |_: &mut Command| {};
    let no_credentials = |push: &mut Command| {
        push.env_remove("AWS_ACCESS_KEY_ID")
            .env_remove("AWS_SECRET_ACCESS_KEY")
            .env("AWS_EC2_METADATA_DISABLED", "true");
    };
    let (error, said) = push("s3://nothing/here", server.port, &nothing);
    assert_eq!(error.matches("bucket").count(), 1, "{error}");
    assert!(error.contains("no bucket `nothing`"), "{error}");
    assert!(
        said.contains("hint: ") && said.contains("s3://nothing/here"),
        "{said}"
    );
    let (error, said) = push(DEPOT, refused, &nothing);
    assert_eq!(error.matches("Access Denied").count(), 1, "{error}");
    assert!(
        said.contains("hint: ") && said.contains("list, read, write and delete"),
        "{said}"
    );
    let (error, said) = push(DEPOT, server.port, &no_credentials);
    assert!(error.contains("no credentials"), "{error}");
    assert!(said.contains("AWS_ACCESS_KEY_ID"), "{said}");
}

#[test]
fn urls_that_name_no_bucket_are_refused() {
    let machine = machine(2);
    let output = share(&mut machine.command("run", &[]), "s3://", 1);
    let said = stderr(&output);
    assert_ne!(output.status.code(), Some(0));
    assert!(said.contains("s3://BUCKET/PREFIX"), "{said}");
}
