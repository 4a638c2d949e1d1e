//! Makes the tables of READMEs again: each that has a marker comes from the query that the marker names.
//!
//! `cargo bench --bench tables` compares all of them with the READMEs and fails if one differs;
//! `-- --write` writes them there instead; the names of READMEs or of queries choose among them, e.g.
//! `-- --write stages/screen/README.md`. `PIPELINE_REAL_DATA` names the folder of measured data,
//! `PIPELINE_LAKE` a folder that is kept, so that a bench that was interrupted goes on.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]

#[path = "tables/query.rs"]
mod query;
#[path = "tables/readme.rs"]
mod readme;
#[path = "tables/studies.rs"]
mod studies;

use std::{
    collections::BTreeSet,
    env,
    error::Error,
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

use query::Query;
use readme::Readme;
use studies::Studies;

/// The dataset in the folder of measured data.
const DATASET: &str = "dexycb-right";
/// The argument that writes the READMEs.
const WRITE: &str = "--write";

fn main() -> Result<ExitCode, Box<dyn Error>> {
    // Cargo adds the first argument.
    let arguments: Vec<String> = env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let (flags, names): (Vec<_>, Vec<_>) = arguments.iter().partition(|word| *word == WRITE);
    let mut unknown: BTreeSet<&Path> = names.iter().map(Path::new).collect();
    let is_asked_for_all = unknown.is_empty();
    let temporary = tempfile::tempdir()?;
    let folder = env::var_os("PIPELINE_LAKE").map(PathBuf::from);
    let dataset = env::var_os("PIPELINE_REAL_DATA").map(|folder| Path::new(&folder).join(DATASET));
    let mut studies = Studies::open(
        folder.as_deref().unwrap_or(temporary.path()),
        dataset.filter(|folder| folder.is_dir()),
    )?;
    let (mut n_same, mut n_written, mut n_wrong) = (0, 0, 0);
    for mut readme in Readme::all()? {
        let is_chosen = unknown.remove(readme.name());
        for idx in 0..readme.tables().len() {
            let table = readme.tables().swap_remove(idx);
            let Some(path) = table.query else { continue };
            let name = path.strip_prefix(env!("CARGO_MANIFEST_DIR"))?;
            if !(unknown.remove(name) || is_chosen || is_asked_for_all) {
                continue;
            }
            println!("table  {}", name.display());
            match make(&mut studies, &path) {
                Ok(None) => println!("       skipped: `PIPELINE_REAL_DATA` has no `{DATASET}`"),
                Ok(Some(made)) => {
                    print(&readme.lines[table.lines.clone()], &made);
                    if readme.lines[table.lines.clone()] == made {
                        n_same += 1;
                    } else if flags.is_empty() {
                        n_wrong += 1;
                    } else {
                        readme.replace(table.lines, made)?;
                        n_written += 1;
                    }
                }
                // The others are made all the same.
                Err(reason) => {
                    println!("       not made: {reason}");
                    n_wrong += 1;
                }
            }
        }
    }
    if let Some(name) = unknown.first() {
        let name = name.display();
        return Err(format!("`{name}` is not a README with a table, and no query of one").into());
    }
    println!(
        "{n_same} tables are as READMEs show them, {n_written} were written, {n_wrong} are wrong"
    );
    Ok(ExitCode::from(u8::from(n_wrong > 0)))
}

/// Makes the table of a query; `None` if that takes a dataset that is not there.
fn make(studies: &mut Studies, path: &Path) -> Result<Option<Vec<String>>, String> {
    let query = Query::read(path)?;
    if studies.lack(&query) {
        return Ok(None);
    }
    let before = Instant::now();
    let table = query.table(&studies.answer(&query)?)?;
    println!("       made in {:.0} s", before.elapsed().as_secs_f64());
    Ok(Some(table))
}

/// Prints a table; lines that the README shows otherwise, or has not, begin with `-` and `+`.
fn print(shown: &[String], made: &[String]) {
    for line in shown.iter().filter(|line| !made.contains(line)) {
        println!("- {line}");
    }
    for line in made {
        let sign = if shown.contains(line) { ' ' } else { '+' };
        println!("{sign} {line}");
    }
}
