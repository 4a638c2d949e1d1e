//! `pipeline doctor --robot`: a URDF's summary, its unphysical values, and a first draft of the hand's file.

use std::{
    collections::BTreeSet,
    convert::Infallible,
    fs::File,
    io::{self, Read},
    path::Path,
};

use dataflow::{Diagnostic, missing};
use hand_files::HandFile;
use robot::{DynamicsModel, Finding, MAX_URDF_BYTES, Mesh, Part, RobotModel, Severity};
use robot_meshes::LoadError;

use crate::{
    label::Label,
    outcome::{CommandError, CommandOutcome},
    report::{self, LabeledRow},
};

/// Least width of the column of labels, in characters.
const LABEL_WIDTH: usize = 8;

/// Checks a robot's URDF.
pub(super) fn check(path: &Path) -> Result<CommandOutcome, CommandError> {
    let shown = path.display();
    let bytes = read(path).map_err(|err| {
        CommandError::failed(
            anyhow::Error::from(err).context(format!("cannot read `{shown}`")),
            Some(format!("give the path of a URDF; {}", missing(path))),
        )
    })?;
    let model = RobotModel::from_urdf_bytes(&bytes).map_err(|err| {
        let hint = err.hint();
        CommandError::failed(
            anyhow::Error::from(err).context(format!("`{shown}` cannot be used")),
            hint,
        )
    })?;
    let (model, mut findings) = with_mesh_shapes(model, path);
    findings.extend(model.examine());
    findings.extend(missing_drawings(&model, path));
    let file = HandFile::proposed(&model, path);
    if file.is_none() {
        findings.push(Finding {
            severity: Severity::Note,
            part: Part::Robot,
            problem: "has too few fingers and links to propose a hand's file from".to_owned(),
            advice: String::new(),
        });
    }
    let mut rows = summary(&model);
    rows.extend(findings_by_kind(&findings));
    // The hand's file goes to stdout, the summary to the user (stderr).
    report::print(&report::labeled_rows(&rows, LABEL_WIDTH));
    if let Some(file) = file {
        let head = "# A first proposal of a hand's file, from its URDF alone: review it, above all its side, scale and \
                    drive.\n# `urdf` is a path from the folder of this file.\n";
        report::data(format!("{head}{}", file.to_toml()).as_bytes())?;
    }
    let mut hints: Vec<&str> = Vec::new();
    for finding in &findings {
        let advice = finding.advice.as_str();
        if !advice.is_empty() && !hints.contains(&advice) {
            hints.push(advice);
            report::line(Label::Hint, advice);
        }
    }
    let count = |severity| {
        let such = findings
            .iter()
            .filter(|finding| finding.severity == severity);
        such.count()
    };
    let trouble = match (count(Severity::Missing), count(Severity::Wrong)) {
        (0, 0) => return Ok(CommandOutcome::Done),
        (0, n) => {
            let values = if n == 1 { "value" } else { "values" };
            format!("`{shown}`: {n} physically impossible {values}")
        }
        (n, _) => format!("`{shown}` cannot be used: {n} missing"),
    };
    Err(CommandError::failed(anyhow::anyhow!(trouble), None))
}

/// Reads at most the maximum size of a URDF, plus one byte to detect a larger file.
fn read(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let limit = u64::try_from(MAX_URDF_BYTES).unwrap_or(u64::MAX);
    File::open(path)?
        .take(limit.saturating_add(1))
        .read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn row(label: Label, subject: impl Into<String>, finding: impl Into<String>) -> LabeledRow {
    (label, vec![subject.into(), finding.into()])
}

/// Summary of the robot.
fn summary(model: &RobotModel) -> Vec<LabeledRow> {
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
            Label::Ok,
            "robot",
            format!("`{}`, root link `{root}`", model.name()),
        ),
        row(
            Label::Ok,
            "joints",
            format!("{} independent ones{followers}", model.dof()),
        ),
        row(
            Label::Ok,
            "links",
            format!(
                "{} in {} moving bodies, {:.3} kg together",
                model.links().len(),
                n_moving + 1,
                DynamicsModel::new(model).mass_kg()
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
            Label::Ok,
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

/// One row per kind of finding, with its parts, the worst first.
fn findings_by_kind(findings: &[Finding]) -> Vec<LabeledRow> {
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
    let label = |severity| match severity {
        Severity::Missing => Label::Missing,
        Severity::Wrong => Label::Wrong,
        Severity::Doubtful => Label::Doubtful,
        Severity::Note => Label::Note,
    };
    kinds
        .iter()
        .map(|(severity, problem, parts)| match parts.as_slice() {
            [part] => row(label(*severity), part.to_string(), *problem),
            parts => row(
                label(*severity),
                counted(parts),
                format!("each {problem}: {}", names(parts)),
            ),
        })
        .collect()
}

/// Counts the parts of one kind.
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

/// Reads the collision meshes; missing or unreadable ones are findings.
fn with_mesh_shapes(model: RobotModel, urdf: &Path) -> (RobotModel, Vec<Finding>) {
    let mut findings: Vec<Finding> = Vec::new();
    let read = model.with_mesh_shapes(|link, mesh| {
        let bodies = robot_meshes::convex_bodies(link, mesh, urdf);
        Ok::<_, Infallible>(bodies.unwrap_or_else(|err| {
            findings.push(missing_shape(link, mesh, err));
            Vec::new()
        }))
    });
    let Ok(model) = read;
    (model, findings)
}

fn missing_shape(link: &str, mesh: &Mesh, err: LoadError) -> Finding {
    let advice = err.hint().unwrap_or_default();
    let file = &mesh.file;
    let problem = match err {
        LoadError::Missing { .. } => format!("collides with the mesh `{file}`, which is not there"),
        err => format!(
            "collides with the mesh `{file}`, which cannot be used: {}",
            report::chain(&anyhow::Error::from(err))
        ),
    };
    Finding {
        severity: Severity::Missing,
        part: Part::Link(link.to_owned()),
        problem,
        advice,
    }
}

/// Finds missing visual meshes.
fn missing_drawings(model: &RobotModel, urdf: &Path) -> Option<Finding> {
    let meshes = model.links().iter().flat_map(|link| &link.meshes);
    let missing: BTreeSet<&str> = meshes
        .filter(|mesh| !mesh.is_collision && robot_meshes::find(&mesh.file, urdf).is_none())
        .map(|mesh| mesh.file.as_str())
        .collect();
    let first = missing.first()?;
    Some(Finding {
        severity: Severity::Note,
        part: Part::Robot,
        problem: match missing.len() {
            1 => format!("is drawn with a mesh that is not there: `{first}`"),
            n => format!("is drawn with {n} meshes that are not there, the first `{first}`"),
        },
        advice: "nothing but a viewer needs them: put them where the URDF says, relative to it or \
                 to a folder above it that has the package's name"
            .to_owned(),
    })
}
