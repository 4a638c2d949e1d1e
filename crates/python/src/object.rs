//! Objects that a hand grasps.

use std::{
    fs,
    path::PathBuf,
    sync::{Arc, OnceLock},
};

use dataflow::{Digest, unit_seed};
use geometry::{DistanceField, TriMesh, mean_distance};
use nalgebra::Point3;
use object_shapes::MeshedObject;
use pyo3::{
    prelude::*,
    types::{PyAny, PyDict},
};
use schemas::Table as _;
use serde_json::json;
use spatial::{Pose, Table};
use stage_ingest::IngestConfig;
use stage_retarget::RetargetConfig;

use crate::{
    arrays::{self, Array, Rows, array, corners, vector, vectors},
    error::{failed, wrong},
    options,
    threads::in_threads,
};

/// Stage whose seeds [`Object::from_mesh`] takes.
const INGEST: &str = "ingest";
/// Largest height of the lowest point of an object that stands, above or below the table, in meters: errors of
/// perception are less.
const STANDING_M: f64 = 0.02;
/// Largest mass, in kilograms.
const MAX_MASS_KG: f64 = 1000.0;
/// Fewest points that span a body.
const MIN_POINTS: usize = 4;

/// An object that a hand grasps: its shape, mass and the ways in which it rests on a table.
///
/// Lengths are in meters in the object's own frame, that of its mesh.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Object {
    /// As a lake stores it.
    pub(crate) stored: schemas::objects::Object,
    /// Of its mesh and mass.
    pub(crate) digest: Digest,
    /// Distances from its surface, computed when they are first needed.
    field: OnceLock<Arc<DistanceField>>,
}

#[pymethods]
impl Object {
    /// Makes an object of a mesh: `path` is an OBJ, STL or PLY in meters, `mass` in kilograms.
    ///
    /// It is what the stage `ingest` of this name makes of the mesh with the pipeline's `seed`, to the bit; `options` are
    /// those of that stage, of which `points_n`, `max_convex_parts_n` and `part_tolerance_m` count. `name` is the file's
    /// if it is None.
    #[staticmethod]
    #[pyo3(signature = (path, mass, *, name=None, seed=7, options=None))]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "Python's paths become owned ones"
    )]
    fn from_mesh(
        py: Python<'_>,
        path: PathBuf,
        mass: f64,
        name: Option<String>,
        seed: u64,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let unusable = |problem: String| {
            wrong(
                format!("the mesh `{}` cannot be used: {problem}", path.display()),
                "pass a closed mesh in meters: OBJ, STL or PLY",
            )
        };
        let bytes = fs::read(&path).map_err(|err| unusable(err.to_string()))?;
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        let (mesh, _) = object_shapes::mesh(&file, &bytes).map_err(unusable)?;
        let stem = || path.file_stem().unwrap_or_default().to_string_lossy();
        let name = name.unwrap_or_else(|| stem().into_owned());
        Self::of(py, &mesh, &name, mass, (seed, options))
    }

    /// Makes an object of points on its surface, `(n, 3)` in meters in any frame: the convex hull of all of them, with
    /// `mass` in kilograms.
    ///
    /// `seed` and `options` are those of `from_mesh`.
    #[staticmethod]
    #[pyo3(signature = (points, mass, *, name="object", seed=7, options=None))]
    fn from_points(
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        mass: f64,
        name: &str,
        seed: u64,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let rows = Rows::read("points", points, &[3])?;
        let unusable = |problem: String| {
            wrong(
                format!("`points` span no body: {problem}"),
                "pass points in meters on all sides of the object",
            )
        };
        if rows.len() < MIN_POINTS {
            return Err(unusable(format!("there are {} of them", rows.len())));
        }
        let points = (0..rows.len()).map(|idx| Point3::from_slice(rows.row(idx)));
        let cloud = TriMesh {
            vertices_m: points.collect(),
            triangles: Vec::new(),
        };
        let hull = cloud
            .convex_hull()
            .and_then(|hull| {
                hull.check_size(&geometry::OBJECT_SIDES_M)?;
                Ok(hull)
            })
            .map_err(|err| unusable(err.to_string()))?;
        Self::of(py, &hull, name, mass, (seed, options))
    }

    /// The name.
    #[getter]
    fn name(&self) -> &str {
        &self.stored.name
    }

    /// Mass in kilograms.
    #[getter]
    fn mass(&self) -> f64 {
        self.stored.mass_kg
    }

    /// Center of mass `(3,)`.
    #[getter]
    fn center_of_mass<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        vector(py, &self.stored.center_of_mass_m)
    }

    /// Inertia about the center of mass along the object's axes `(3, 3)`, in kilogram square meters.
    #[getter]
    fn inertia<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let [xx, yy, zz, xy, xz, yz] = self.stored.inertia_kg_m2;
        array(py, &[xx, xy, xz, xy, yy, yz, xz, yz, zz], None, &[3, 3])
    }

    /// Vertices of the mesh `(n, 3)`.
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        vectors(py, &self.stored.vertices_m)
    }

    /// Vertices of each triangle of the mesh `(n, 3)`, counterclockwise seen from outside; whole numbers.
    #[getter]
    fn triangles<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        corners(py, &self.stored.triangles)
    }

    /// Points on the surface `(n, 3)`.
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        vectors(py, &self.stored.points_m)
    }

    /// Outward unit normal at each point `(n, 3)`.
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        vectors(py, &self.stored.normals)
    }

    /// Poses of the object as it rests on the table `(n, 4, 4)`: the table's top is at z = 0, and z is up. Those of
    /// demonstrations come first, the most frequent first, then the most probable.
    #[getter]
    fn resting_poses<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let rests = self.stored.rests.iter();
        arrays::poses(py, rests.map(|known| known.rest.table_from_object()))
    }

    /// Share of random drops that end in each resting pose `(n,)`.
    #[getter]
    fn resting_probabilities<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let rests = self.stored.rests.iter();
        vector(py, &rests.map(|rest| rest.probability).collect::<Vec<_>>())
    }

    /// Signed distances of points `(n, 3)` from the surface `(n,)`, negative inside. Near the surface they are off by a
    /// tenth of a millimeter, in the middle of the object by about one.
    fn distance<'py>(&self, py: Python<'py>, points: &Bound<'_, PyAny>) -> PyResult<Array<'py>> {
        let rows = Rows::read("points", points, &[3])?;
        let field = self.field(py)?;
        let distance = |idx| field.distance(&Point3::from_slice(rows.row(idx))).0;
        let distances: Vec<f64> = (0..rows.len()).map(distance).collect();
        array(
            py,
            &distances,
            rows.is_batch.then_some(distances.len()),
            &[],
        )
    }

    /// Mean distance between the surfaces of two objects in meters, after this one is scaled to the size of `other` and
    /// aligned with it: 0 for equal shapes of any size, infinite for a mesh without area.
    ///
    /// `seed` is that of the 192 points sampled on each surface.
    #[pyo3(signature = (other, *, seed=7))]
    fn mean_distance(&self, py: Python<'_>, other: &Self, seed: u64) -> f64 {
        let meshes = [self, other].map(Self::mesh);
        py.detach(|| mean_distance(&meshes[0], &meshes[1], seed))
    }

    fn __repr__(&self) -> String {
        format!(
            "<pipeline.Object {:?}, {:.3} kg, {} triangles>",
            self.stored.name,
            self.stored.mass_kg,
            self.stored.triangles.len()
        )
    }
}

impl From<schemas::objects::Object> for Object {
    fn from(object: schemas::objects::Object) -> Self {
        let numbers = object.vertices_m.iter().flatten().chain([&object.mass_kg]);
        let bytes: Vec<u8> = numbers.flat_map(|number| number.to_le_bytes()).collect();
        Self {
            digest: Digest::of_bytes(&bytes),
            stored: object,
            field: OnceLock::new(),
        }
    }
}

impl Object {
    /// Makes an object of its mesh, as the stage `ingest` does.
    fn of(
        py: Python<'_>,
        mesh: &TriMesh,
        name: &str,
        mass_kg: f64,
        (seed, options): (u64, Option<&Bound<'_, PyDict>>),
    ) -> PyResult<Self> {
        if !(0.0..=MAX_MASS_KG).contains(&mass_kg) || mass_kg == 0.0 {
            return Err(wrong(
                format!("`mass` is {mass_kg}"),
                "pass a mass in kilograms that a hand lifts, above 0 and at most 1000",
            ));
        }
        // Of the stage's options only those of the shape count here.
        let others = [("root", json!(".")), ("hand", json!("right"))];
        let config: IngestConfig = options::read(INGEST, options, None, &others)?;
        let seed = seed_of(seed, INGEST, name)?;
        let made = in_threads(py, |_| {
            MeshedObject {
                name,
                mass_kg,
                mesh,
                options: &config.shape,
                seed,
            }
            .unseen()
        })?;
        let object = made.map_err(|err| failed(&err, err.hint()))?;
        // As its readers find it in a lake.
        let stored = object.to_batch();
        let stored = stored.and_then(|batch| schemas::objects::Object::from_batch(name, &batch));
        stored.map(Self::from).map_err(|err| failed(&err, None))
    }

    /// Reads its pose on the table, an argument `table_from_object`; the first of its resting poses without one.
    pub(crate) fn placed(
        &self,
        given: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Pose<Table, spatial::Object>> {
        let name = "table_from_object";
        if let Some(given) = given {
            return self.standing(name, &Rows::one(name, given, &[4, 4])?);
        }
        let rest = self.stored.rests.first().ok_or_else(|| {
            wrong(
                format!("`{}` has no resting pose", self.stored.name),
                "pass `table_from_object`",
            )
        })?;
        Ok(rest.rest.table_from_object())
    }

    /// Reads a pose on the table, of an argument called `name`: the object stands on it.
    pub(crate) fn standing(
        &self,
        name: &str,
        matrix: &[f64],
    ) -> PyResult<Pose<Table, spatial::Object>> {
        let pose: Pose<Table, spatial::Object> = arrays::pose(name, matrix)?;
        let points = self.stored.vertices_m.iter().map(|&at| Point3::from(at));
        let lowest_m = points
            .map(|at| (*pose * at).z)
            .fold(f64::INFINITY, f64::min);
        if lowest_m.abs() > STANDING_M {
            return Err(wrong(
                format!("in `{name}` the object's lowest point is {lowest_m:.3} m above the table"),
                "pass a pose in which it stands on z = 0; `object.resting_poses` has some",
            ));
        }
        Ok(pose)
    }

    /// Returns its mesh.
    pub(crate) fn mesh(&self) -> TriMesh {
        object_shapes::mesh_of(&self.stored)
    }

    /// Returns the distances from its surface, those of the stage `retarget`.
    pub(crate) fn field(&self, py: Python<'_>) -> PyResult<&Arc<DistanceField>> {
        if let Some(field) = self.field.get() {
            return Ok(field);
        }
        let unused = [("hand", json!("")), ("hand_table", json!(""))];
        let config: RetargetConfig = options::read("retarget", None, None, &unused)?;
        let mesh = self.mesh();
        let surveyed = in_threads(py, |_| retargeting::survey(&mesh, config.field_spacing_m))?;
        let surveyed = surveyed.map_err(|err| failed(&err, err.hint()))?;
        let surveyed = surveyed.ok_or_else(|| {
            wrong(
                format!("the mesh of `{}` has no surface", self.stored.name),
                "pass a mesh with triangles",
            )
        })?;
        Ok(self.field.get_or_init(|| Arc::new(surveyed.field)))
    }
}

/// Returns the seed of what a stage of this name makes of an object, of the pipeline's seed.
///
/// # Errors
///
/// Fails with an exception if the object has a name that no partition may have.
pub(crate) fn seed_of(seed: u64, stage: &str, object: &str) -> PyResult<u64> {
    let unusable = |err: &dyn std::error::Error| {
        let hint = "names have letters, digits, `_`, `-` and `.`";
        failed(err, Some(hint.to_owned()))
    };
    let stage = stage.parse().map_err(|err| unusable(&err))?;
    let partition = object.parse().map_err(|err| unusable(&err))?;
    Ok(unit_seed(seed, &stage, &partition))
}
