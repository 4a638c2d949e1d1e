//! `pipeline doctor --robot`: what a URDF describes, what is unphysical in it, and a first proposal
//! of a hand's table.

use std::{
    collections::BTreeSet,
    fs::File,
    io::{self, Read},
    path::{Path, PathBuf},
};

use robot::{Bodies, Finding, MAX_URDF_BYTES, Part, RobotModel, Severity};
use stage_retarget::HandTable;

use crate::{
    outcome::{Outcome, Trouble},
    report,
};

/// Checks a robot's URDF.
pub(super) fn check(path: &Path) -> Result<Outcome, Trouble> {
    let shown = path.display();
    let bytes = read(path).map_err(|err| {
        Trouble::failed(
            anyhow::Error::from(err).context(format!("cannot read `{shown}`")),
            Some("give the path of a URDF, e.g. `data/robots/allegro_right.urdf`".to_owned()),
        )
    })?;
    let model = RobotModel::from_urdf_bytes(&bytes).map_err(|err| {
        let hint = err.hint();
        Trouble::failed(
            anyhow::Error::from(err).context(format!("`{shown}` cannot be used")),
            hint,
        )
    })?;
    let mut findings = model.examine();
    findings.extend(missing_meshes(&model, path));
    let table = HandTable::proposed(&model);
    if table.is_none() {
        findings.push(Finding {
            severity: Severity::Note,
            part: Part::Robot,
            problem: "has too few fingers and links to propose a hand's table from".to_owned(),
            advice: String::new(),
        });
    }
    let mut rows = summary(&model);
    rows.extend(findings_by_kind(&findings));
    // The table is for a file, what is said about the robot for a person.
    report::line(report::columns(&rows, &[]).trim_end());
    if let Some(table) = table {
        let head = "# A first proposal of a hand's table, from the tree alone: look it over, above all its \
                    side and scale.\n";
        report::data(format!("{head}{}", table.to_toml()).as_bytes());
    }
    let mut hints: Vec<&str> = Vec::new();
    for finding in &findings {
        let advice = finding.advice.as_str();
        if !advice.is_empty() && !hints.contains(&advice) {
            hints.push(advice);
            report::line(&format!("hint: {advice}"));
        }
    }
    let is_wrong = |finding: &&Finding| finding.severity == Severity::Wrong;
    match findings.iter().filter(is_wrong).count() {
        0 => Ok(Outcome::Done),
        n => {
            let places = if n == 1 { "place" } else { "places" };
            Err(Trouble::failed(
                anyhow::anyhow!("`{shown}` describes what cannot be, in {n} {places}"),
                None,
            ))
        }
    }
}

/// Reads no more of a file than a URDF can have, and one byte by which a larger one is known.
fn read(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let limit = u64::try_from(MAX_URDF_BYTES).unwrap_or(u64::MAX);
    File::open(path)?
        .take(limit.saturating_add(1))
        .read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn row(word: &str, subject: impl Into<String>, finding: impl Into<String>) -> Vec<String> {
    vec![format!("{word:<8}"), subject.into(), finding.into()]
}

/// What the robot is.
fn summary(model: &RobotModel) -> Vec<Vec<String>> {
    let n_moving = model
        .links()
        .iter()
        .filter(|link| link.kind.is_some())
        .count();
    let n_followers = n_moving - model.dof();
    let followers = match n_followers {
        0 => String::new(),
        n => format!(", and {n} that follow them"),
    };
    let root = model.links().first().map_or("", |link| link.name.as_str());
    let mut rows = vec![
        row(
            "ok",
            "robot",
            format!("`{}`, root link `{root}`", model.name()),
        ),
        row(
            "ok",
            "joints",
            format!("{} independent ones{followers}", model.dof()),
        ),
        row(
            "ok",
            "links",
            format!(
                "{} in {} moving bodies, {:.3} kg together",
                model.links().len(),
                n_moving + 1,
                Bodies::new(model).mass_kg()
            ),
        ),
    ];
    for finger in model.fingers() {
        let joints: Vec<&str> = finger
            .joints
            .iter()
            .filter_map(|&joint| model.joints().get(joint))
            .map(|joint| joint.name.as_str())
            .collect();
        let tip = model.links().get(finger.tip_link);
        rows.push(row(
            "ok",
            if finger.is_thumb { "thumb" } else { "finger" },
            format!(
                "to `{}`, {:.0} mm: {}",
                tip.map_or("", |link| link.name.as_str()),
                finger.length_m * 1000.0,
                joints.join(", ")
            ),
        ));
    }
    rows
}

/// One row for each kind of finding, with the parts that it is about, the worst first.
fn findings_by_kind(findings: &[Finding]) -> Vec<Vec<String>> {
    let mut kinds: Vec<(Severity, &str, Vec<&Part>)> = Vec::new();
    for finding in findings {
        let known = kinds.iter_mut().find(|(severity, problem, parts)| {
            let is_alike = match (&finding.part, parts.first()) {
                (Part::Link(_), Some(Part::Link(_))) | (Part::Joint(_), Some(Part::Joint(_))) => {
                    true
                }
                (Part::Robot | Part::Link(_) | Part::Joint(_), _) => false,
            };
            *severity == finding.severity && *problem == finding.problem && is_alike
        });
        match known {
            Some((_, _, parts)) => parts.push(&finding.part),
            None => kinds.push((finding.severity, &finding.problem, vec![&finding.part])),
        }
    }
    kinds.sort_by_key(|(severity, ..)| *severity);
    let word = |severity| match severity {
        Severity::Wrong => "wrong",
        Severity::Doubtful => "doubtful",
        Severity::Note => "note",
    };
    kinds
        .iter()
        .map(|(severity, problem, parts)| match parts.as_slice() {
            [part] => row(word(*severity), part.to_string(), *problem),
            parts => row(
                word(*severity),
                counted(parts),
                format!("each {problem}: {}", names(parts)),
            ),
        })
        .collect()
}

/// How many parts of one kind there are.
fn counted(parts: &[&Part]) -> String {
    let what = match parts.first() {
        Some(Part::Link(_)) => "links",
        Some(Part::Joint(_)) => "joints",
        Some(Part::Robot) | None => "robots",
    };
    format!("{} {what}", parts.len())
}

/// The names of parts.
fn names(parts: &[&Part]) -> String {
    let name = |part: &&Part| match part {
        Part::Link(name) | Part::Joint(name) => format!("`{name}`"),
        Part::Robot => String::new(),
    };
    parts.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// Looks for the meshes that the robot names.
fn missing_meshes(model: &RobotModel, urdf: &Path) -> Option<Finding> {
    let mut missing: BTreeSet<&str> = BTreeSet::new();
    for mesh in model.links().iter().flat_map(|link| &link.meshes) {
        if !candidates(&mesh.file, urdf)
            .iter()
            .any(|path| path.exists())
        {
            missing.insert(&mesh.file);
        }
    }
    let first = missing.first()?;
    Some(Finding {
        severity: Severity::Note,
        part: Part::Robot,
        problem: match missing.len() {
            1 => format!("names a mesh that is not there: `{first}`"),
            n => format!("names {n} meshes that are not there, the first `{first}`"),
        },
        advice:
            "meshes are only for viewers, nothing here opens them: put them where the URDF says, \
                 relative to it or to a folder above it that has the package's name"
                .to_owned(),
    })
}

/// Where a mesh may be: a path beside the URDF, or in a package among the folders above it.
fn candidates(file: &str, urdf: &Path) -> Vec<PathBuf> {
    let folder = urdf.parent().unwrap_or(Path::new(""));
    if let Some(path) = file.strip_prefix("file://") {
        return vec![PathBuf::from(path)];
    }
    let Some(in_package) = file
        .strip_prefix("package://")
        .or_else(|| file.strip_prefix("model://"))
    else {
        return vec![folder.join(file)];
    };
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    let below = in_package.split_once('/').map(|(_, below)| below);
    absolute
        .ancestors()
        .flat_map(|above| {
            let with_name = above.join(in_package);
            let without = below.map(|below| above.join(below));
            std::iter::once(with_name).chain(without)
        })
        .collect()
}
