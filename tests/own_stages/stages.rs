//! Small kinds of stages: one that reads files outside the lake, one that maps partition by partition,
//! one that gathers every partition, one that gathers by a label, one that goes on where it was
//! interrupted, one that must not be done twice (`act`), one as a lab would write it (`logged`), and programs; `map.sh`
//! is `map` as a program.
//!
//! A kind is a type that implements [`dataflow::Stage`], and lists its outputs, types that implement
//! [`dataflow::Output`]; where there is one, it is the same type. Most need two functions: `units` lists
//! what there is to make and what each unit reads, `make` makes one unit. Everything else (what is up to
//! date, threads, damaged files, publishing) is the engine's.

mod act;
mod bytes;
mod gather;
mod group;
mod hooks;
mod logged;
mod map;
mod split;
mod steps;

use std::{
    io,
    path::{Path, PathBuf},
};

use dataflow::{Code, Diagnostic, Kind};
use lake::LakeError;
use stage_program::{Artifacts, KnownArtifact, Program};

use self::{
    act::Act, gather::Gather, group::Group, logged::Logged, map::Map, split::Split, steps::Steps,
};

/// Why one of these stages cannot go on.
#[derive(Debug, thiserror::Error)]
pub(crate) enum OwnError {
    /// A file or folder cannot be read or written.
    #[error("cannot use `{}`", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Why not.
        source: io::Error,
    },
    /// The lake cannot keep or give a table.
    #[error(transparent)]
    Lake(#[from] LakeError),
    /// A table's columns do not fit together.
    #[error("cannot lay out the table")]
    Table(#[from] arrow_schema::ArrowError),
    /// A test asks for it.
    #[error("fails at `{0}`, as asked for")]
    Asked(String),
}

impl OwnError {
    /// Returns a function that says which file or folder an error is about.
    pub(crate) fn at(path: &Path) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |source| Self::Io { path, source }
    }
}

impl Diagnostic for OwnError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::Lake(err) => err.hint(),
            Self::Io { .. } | Self::Table(_) | Self::Asked(_) => None,
        }
    }
}

/// The code part of a kind's fingerprint. A program writes `dataflow::code!` instead, which its build
/// script fills with digests of the sources; here a test chooses among two versions.
const fn code(version: u8) -> Code {
    Code {
        parts: if version == 1 {
            "own_stages=1"
        } else {
            "own_stages=2"
        },
    }
}

/// The artifacts that programs can make here, beside tables of their own.
pub(crate) enum Own {}

impl Artifacts for Own {
    const KNOWN: &'static [KnownArtifact] = &[KnownArtifact::of_files(
        "parts",
        "parts/1",
        "part",
        &[bytes::DATA],
    )];
}

/// Returns the kinds, each in the version that `version` says: 1 or 2.
pub(crate) fn kinds_with(version: impl Fn(&str) -> u8) -> Vec<Kind> {
    let versions = [
        [Kind::of::<Split<1>>(code(1)), Kind::of::<Split<2>>(code(2))],
        [Kind::of::<Map<1>>(code(1)), Kind::of::<Map<2>>(code(2))],
        [
            Kind::of::<Gather<1>>(code(1)),
            Kind::of::<Gather<2>>(code(2)),
        ],
        [Kind::of::<Group<1>>(code(1)), Kind::of::<Group<2>>(code(2))],
        [Kind::of::<Steps<1>>(code(1)), Kind::of::<Steps<2>>(code(2))],
    ];
    let choose = |[first, second]: [Kind; 2]| match version(first.name) {
        1 => first,
        _ => second,
    };
    let mut kinds = Vec::from(versions.map(choose));
    kinds.push(Kind::of::<Act>(code(1)));
    kinds.push(Kind::of::<Logged>(code(1)));
    kinds.push(Kind::of::<Program<Own>>(dataflow::code!("stage-program")));
    kinds
}
