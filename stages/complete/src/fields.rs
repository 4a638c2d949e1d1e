//! Distances from an estimated object.

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, OptionsUsed, Outcome, Output, Scope, Sum, Unit,
};
use geometry::TriMesh;
use lake::{ReadArtifact, ReadInputs, WriteArtifact};
use retargeting::survey;
use schemas::{
    Table,
    distance_fields::{self, FieldInfo},
    objects::{MESH, Object},
};

use crate::{Complete, CompleteConfig};

/// The artifact `distance_fields`.
pub struct DistanceFields;

dataflow::metrics! {
    /// Metrics of an object's distances.
    pub struct FieldMetrics {
        /// Number of the vertices of its convex hull.
        hull_vertices_n: Sum,
    }
}

impl Output for DistanceFields {
    type Stage = Complete;
    type Metrics = FieldMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = FieldInfo::NAME;
    const SCHEMA: &'static str = FieldInfo::VERSION;
    const PARTITION: &'static str = FieldInfo::PARTITION;
    const LINE: Option<Line<FieldMetrics>> =
        Some(|summary| format!("{} objects → distances from their surfaces", summary.n_made));
    const OPTIONS: OptionsUsed = OptionsUsed::Only(&["field_spacing_m"]);

    fn units(_config: &CompleteConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let unit = |object: &dataflow::Partition| {
            Unit::new(&object.key)
                .with_label("object", &object.key)
                .reading(Object::NAME, [&object.key])
                .only_files(Object::NAME, [MESH])
        };
        Ok(scope.partitions(Object::NAME).iter().map(unit).collect())
    }

    fn make(
        config: &CompleteConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<FieldMetrics>, BoxedDiagnostic> {
        let object = inputs.artifact(Object::NAME)?;
        let mesh = TriMesh::from_obj(&object.text(MESH)?);
        let surveyed = match mesh.and_then(|mesh| survey(&mesh, config.field_spacing_m)) {
            Ok(Some(surveyed)) => surveyed,
            Ok(None) => return Ok(Outcome::skipped("its estimated shape has no surface")),
            Err(err) => return Ok(Outcome::skipped(format!("its estimated shape: {err}"))),
        };
        let hull = surveyed.hull_in_object.iter();
        let info = FieldInfo {
            spacing_m: config.field_spacing_m,
            margin_m: surveyed.margin_m,
            center_of_mass_m: surveyed.center_of_mass_in_object.into(),
            hull_m: hull.map(|&vertex| vertex.into()).collect(),
        };
        cx.write(&info)?;
        cx.write_file(distance_fields::FIELD, &surveyed.field.to_bytes())?;
        Ok(Outcome::Made(FieldMetrics {
            hull_vertices_n: info.hull_m.len() as f64,
        }))
    }
}
