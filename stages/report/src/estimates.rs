//! Objects whose shape was estimated, read from the artifacts of a run.

use std::collections::BTreeMap;

use dataflow::{Artifact, BoxedDiagnostic, Inputs};
use lake::table;
use schemas::{Table, completions::CompletedObject, objects::Object, views::Views};

use crate::{
    Facts,
    pictures::{Pictures, SEEN_M},
};

/// Most objects with pictures: each has about 9 kB.
pub(crate) const PICTURED: usize = 40;

/// An object whose shape was estimated.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimatedObject {
    /// Number of its views.
    pub views_n: i64,
    /// Whether a symmetry completed it.
    pub symmetric: bool,
    /// Share of the completed hull that was carved out of it.
    pub free_share: f64,
    /// Number of points that its views show.
    pub seen_n: usize,
    /// Share of its surface that is farther than 5 mm from all of them.
    pub unseen_share: f64,
    /// Its pictures, if its views are wired.
    pub pictures: Option<Pictures>,
}

/// Reads the objects whose shape was estimated, by name.
pub(crate) fn estimated(
    inputs: &Inputs,
    facts: &Facts,
) -> Result<BTreeMap<String, EstimatedObject>, BoxedDiagnostic> {
    // A completion is in the frame of the object that was made with it.
    let is_estimated = facts.stage_of(Object::NAME) == facts.stage_of(CompletedObject::NAME);
    let mut estimated = BTreeMap::new();
    for (idx, artifact) in inputs.artifacts(CompletedObject::NAME).iter().enumerate() {
        let completion: CompletedObject = table::read(artifact)?;
        let own = |input: &str| {
            let mut artifacts = inputs.artifacts(input).iter();
            artifacts.find(|one| one.key == artifact.key)
        };
        let object = own(Object::NAME).filter(|_| is_estimated);
        let pictures = match own(Views::NAME).filter(|_| idx < PICTURED) {
            Some(views) => pictures(&completion, views, object)?,
            None => None,
        };
        let unseen = completion.unseen_m.iter();
        let unseen_n = unseen.filter(|&&distance_m| distance_m > SEEN_M).count();
        let object = EstimatedObject {
            views_n: completion.views_n,
            symmetric: completion.symmetric,
            free_share: completion.free_share,
            seen_n: completion.seen_m.len(),
            unseen_share: unseen_n as f64 / completion.unseen_m.len().max(1) as f64,
            pictures,
        };
        estimated.insert(artifact.key.to_string(), object);
    }
    Ok(estimated)
}

/// Draws an object as its first view shows it.
fn pictures(
    completion: &CompletedObject,
    views: &Artifact,
    object: Option<&Artifact>,
) -> Result<Option<Pictures>, BoxedDiagnostic> {
    let views: Views = table::read(views)?;
    let Some(view) = views.first() else {
        return Ok(None);
    };
    let object: Option<Object> = object.map(table::read).transpose()?;
    Ok(Pictures::draw(view, completion, object.as_ref())?)
}
