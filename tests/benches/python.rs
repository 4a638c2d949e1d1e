//! Other programs' figures, from scripts in Python that answer line by line.

use std::{
    collections::VecDeque,
    env,
    io::{self, BufRead, BufReader, Write},
    path::{Path, PathBuf},
    process::{self, Child, ChildStdin, ChildStdout, Command, Stdio},
    thread::{self, JoinHandle},
};

/// Requirements of the scripts, with the versions that were measured.
const REQUIREMENTS: &str = "tests/benches/requirements.txt";
/// Number of lines kept of a script's stderr.
const KEPT: usize = 20;

/// Returns the Python that runs scripts.
pub(crate) fn name() -> PathBuf {
    env::var_os("PIPELINE_PYTHON").map_or_else(|| "python3".into(), PathBuf::from)
}

/// A running script: each line of input is answered with one.
pub(crate) struct Script {
    name: String,
    program: PathBuf,
    process: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
    /// Takes the last lines of its stderr.
    said: Option<JoinHandle<VecDeque<String>>>,
}

impl Script {
    /// Starts a script below `tests/benches` on a number of threads in a Python, [`name`] by default.
    ///
    /// # Errors
    ///
    /// Says that there is no such Python, and what to do.
    pub(crate) fn start(
        python: &Path,
        script: &str,
        arguments: &[&str],
        threads: usize,
    ) -> Result<Self, String> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/benches")
            .join(script);
        let mut command = Command::new(python);
        command
            .arg(path)
            .args(arguments)
            .env("OMP_NUM_THREADS", threads.to_string())
            .env("OPENBLAS_NUM_THREADS", threads.to_string());
        Self::of(command, python, script).map_err(|err| {
            format!(
                "cannot start the Python `{}`: {err}; name one with `PIPELINE_PYTHON`",
                python.display()
            )
        })
    }

    /// Starts a program that answers as a script does.
    pub(crate) fn of(mut command: Command, program: &Path, script: &str) -> io::Result<Self> {
        let mut process = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        let (output, errors) = (process.stdout.take(), process.stderr.take());
        let missing = || io::Error::other("it has no output");
        let errors = BufReader::new(errors.ok_or_else(missing)?);
        Ok(Self {
            name: script.to_owned(),
            program: program.to_owned(),
            input: process.stdin.take(),
            output: BufReader::new(output.ok_or_else(missing)?),
            said: Some(thread::spawn(move || last_lines(errors))),
            process,
        })
    }

    /// Sends the script a line and returns its answer.
    ///
    /// # Errors
    ///
    /// Says why there is no answer, where, and what to do.
    pub(crate) fn ask(&mut self, line: &str) -> Result<String, String> {
        if let Some(input) = &mut self.input {
            // The answer shows whether it was sent.
            let _it_may_have_ended = writeln!(input, "{line}").and_then(|()| input.flush());
        }
        let mut answer = String::new();
        match self.output.read_line(&mut answer) {
            Ok(n) if n > 0 => Ok(answer.trim_end().to_owned()),
            Ok(_) | Err(_) => Err(self.end()),
        }
    }

    /// Asks a script that has answered before; if it does no longer, says why and ends the bench.
    #[expect(clippy::print_stdout, reason = "a bench prints what it measured")]
    pub(crate) fn ask_again(&mut self, line: &str) -> String {
        self.ask(line).unwrap_or_else(|reason| {
            println!("error: {reason}");
            process::exit(1)
        })
    }

    /// Waits for the end of a script that gave no answer, and says why.
    fn end(&mut self) -> String {
        self.input = None;
        let status = self.process.wait();
        let said = self.said.take().and_then(|said| said.join().ok());
        let said = said.unwrap_or_default();
        let last = said.back().map_or("", String::as_str);
        let (script, python) = (&self.name, self.program.display());
        if let Some((_, module)) = last.split_once("No module named ") {
            let module = module.trim_matches(['\'', '"']);
            return format!(
                "the Python `{python}` has no module `{module}`, which `tests/benches/{script}` \
                 needs: `{python} -m pip install -r {REQUIREMENTS}`"
            );
        }
        let ended = status.map_or_else(|err| err.to_string(), |status| status.to_string());
        let why = if last.is_empty() {
            "and said nothing".to_owned()
        } else {
            format!("and said `{last}`")
        };
        format!(
            "`tests/benches/{script}` ended without an answer ({ended}) {why}: try it with \
             `{python} tests/benches/{script}`, and `{python} -m pip install -r {REQUIREMENTS}`"
        )
    }
}

impl Drop for Script {
    fn drop(&mut self) {
        self.input = None;
        let _it_may_have_ended = self.process.kill();
        let _nobody_asks = self.process.wait();
    }
}

/// Reads to the end and keeps the last lines that are not empty.
fn last_lines(lines: impl BufRead) -> VecDeque<String> {
    let mut kept = VecDeque::new();
    for line in lines.lines().map_while(Result::ok) {
        if !line.trim().is_empty() {
            kept.push_back(line.trim_end().to_owned());
        }
        if kept.len() > KEPT {
            kept.pop_front();
        }
    }
    kept
}
