//! The stage: one unit per shape, and one per object that is passed on.

use std::collections::BTreeSet;

use dataflow::{
    Artifact, BoxedDiagnostic, Context, Inputs, Line, OptionsUsed, Outcome, Output, Outputs, Scope,
    Stage, Sum, Unit,
};
use geometry::{OBJECT_SIDES_M, TriMesh, mean_distance};
use lake::{ReadArtifact, WriteArtifact};
use object_shapes::MeshedObject;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use schemas::{
    Table,
    demonstrations::Demonstration,
    objects::{APART_FROM, MESH, Object, Surface},
};

use crate::{
    ShapesConfig,
    bodies::{body, stretched},
};

/// Generates training objects.
pub struct Shapes;

dataflow::metrics! {
    /// Metrics of an object.
    pub struct ShapesMetrics {
        /// Number of generated shapes: 1 if it is one.
        generated: Sum,
        /// Number of its convex parts.
        convex_parts_n: Sum,
        /// Number of the orientations in which it can lie.
        rests_n: Sum,
    }
}

/// The label of a demonstration that names its object.
const OBJECT: &str = "object";
/// The least and the greatest density, in kilograms per cubic meter of the body: of a foam brick, and of a can of food.
const DENSITIES: [f64; 2] = [80.0, 900.0];
/// Least and greatest mass, in kilograms.
const MASSES_KG: [f64; 2] = [0.02, 1.2];
/// Draws of a shape before it is given up.
const DRAWS: usize = 8;

impl Stage for Shapes {
    type Config = ShapesConfig;

    const KIND: &'static str = "shapes";
    const ABOUT: &'static str = "Generates training objects beside those of the recordings";
    const INPUTS: &'static [&'static str] = &[Object::NAME, Demonstration::NAME];
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl Output for Shapes {
    type Stage = Self;
    type Metrics = ShapesMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = Object::NAME;
    const SCHEMA: &'static str = Object::VERSION;
    const PARTITION: &'static str = Object::PARTITION;
    const LINE: Option<Line<ShapesMetrics>> = Some(|summary| {
        let generated = summary.metrics.generated;
        let passed_on = summary.n_made as f64 - generated;
        format!("{passed_on} objects → {generated} shapes beside them")
    });
    /// These choose units, or what they read.
    const OPTIONS: OptionsUsed = OptionsUsed::Except(&["count", "unseen_objects", "unseen_fold"]);

    fn units(config: &ShapesConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let objects = scope.partitions(Object::NAME);
        let demonstrations = scope.partitions(Demonstration::NAME).iter();
        let demonstrated: BTreeSet<&str> =
            demonstrations.filter_map(|one| one.label(OBJECT)).collect();
        scope.chosen(
            Object::NAME,
            Object::PARTITION,
            &config.unseen.unseen_objects,
        )?;
        let unseen = config.unseen.of(&demonstrated);
        let names: Vec<&str> = unseen.iter().copied().collect();
        let apart_from = names.join(",");
        let passed_on = objects.iter().map(|object| {
            let unit = Unit::new(&object.key).with_labels_of(object);
            unit.reading(Object::NAME, [&object.key])
        });
        // An object that nobody demonstrated is unseen to every function.
        let keys: Vec<&str> = objects
            .iter()
            .map(|object| object.key.as_str())
            .filter(|key| demonstrated.contains(key))
            .collect();
        let generated = (0..config.count).map(|number| {
            Unit::new(format!("shape_{number:05}"))
                .with_label(OBJECT, format!("shape_{number:05}"))
                .with_label(APART_FROM, &apart_from)
                .with_fact(APART_FROM, &apart_from)
                .reading(Object::NAME, keys.iter().copied())
                .only_files(Object::NAME, [MESH])
        });
        Ok(passed_on.chain(generated).collect())
    }

    fn make(
        config: &ShapesConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<ShapesMetrics>, BoxedDiagnostic> {
        let given = inputs.artifacts(Object::NAME);
        let Some(apart_from) = inputs.fact(APART_FROM) else {
            let object: Object = lake::table::read(&given[0])?;
            return write(cx, &object, 0.0);
        };
        let unseen: BTreeSet<&str> = apart_from.split(',').collect();
        let (unseen, seen): (Vec<&Artifact>, Vec<&Artifact>) = given
            .iter()
            .partition(|one| unseen.contains(one.key.as_str()));
        let mut random = ChaCha8Rng::seed_from_u64(cx.seed());
        let others = unseen
            .into_iter()
            .map(mesh)
            .collect::<Result<Vec<_>, _>>()?;
        for _ in 0..DRAWS {
            let drawn = drawn(config, &seen, &mut random)?;
            let is_apart =
                |other: &TriMesh| mean_distance(&drawn, other, cx.seed()) >= config.apart_m;
            if drawn.check_size(&OBJECT_SIDES_M).is_err() || !others.iter().all(is_apart) {
                continue;
            }
            let density = DENSITIES.map(f64::ln);
            let density = random.random_range(density[0]..=density[1]).exp();
            let mass_kg = density * drawn.volume_m3();
            let meshed = MeshedObject {
                name: cx.partition().as_str(),
                mass_kg: mass_kg.clamp(MASSES_KG[0], MASSES_KG[1]),
                mesh: &drawn,
                options: &config.shape,
                seed: cx.seed(),
            };
            match meshed.unseen() {
                Ok(object) if !object.rests.is_empty() => return write(cx, &object, 1.0),
                _ => {}
            }
        }
        Ok(Outcome::filtered(
            "every draw is similar to an unseen object, or rests nowhere",
        ))
    }
}

/// Draws a body: a seen object, scaled and stretched, or one of a family.
fn drawn(
    config: &ShapesConfig,
    seen: &[&Artifact],
    random: &mut ChaCha8Rng,
) -> Result<TriMesh, BoxedDiagnostic> {
    if seen.is_empty() || random.random_range(0.0..1.0) >= config.stretched_share {
        return Ok(body(random));
    }
    let parent = seen[random.random_range(0..seen.len())];
    Ok(stretched(&mesh(parent)?, random))
}

/// Reads the mesh of an object.
fn mesh(object: &Artifact) -> Result<TriMesh, BoxedDiagnostic> {
    let read = |bytes: &[u8]| Some(object_shapes::mesh(MESH, bytes).ok()?.0);
    Ok(object.parsed(MESH, read)?)
}

/// Writes an object's table, its surface and its mesh.
fn write(
    cx: &Context,
    object: &Object,
    generated: f64,
) -> Result<Outcome<ShapesMetrics>, BoxedDiagnostic> {
    let mesh = object_shapes::mesh_of(object);
    cx.write(object)?;
    cx.write(&Surface::from(object))?;
    cx.write_file(MESH, mesh.to_obj().as_bytes())?;
    Ok(Outcome::Made(ShapesMetrics {
        generated,
        convex_parts_n: object.parts_m.len() as f64,
        rests_n: object.rests.len() as f64,
    }))
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeMap, path::Path};

    use dataflow::Partition;
    use folds::UnseenObjects;
    use geometry::solid::{loft, rounded_rectangle};
    use object_shapes::ShapeOptions;

    use super::*;

    fn config(unseen: &[&str]) -> ShapesConfig {
        ShapesConfig {
            count: 3,
            stretched_share: 0.5,
            apart_m: 0.005,
            unseen: UnseenObjects {
                unseen_objects: unseen.iter().map(|&name| name.to_owned()).collect(),
                unseen_fold: None,
            },
            shape: ShapeOptions {
                points_n: 64,
                max_convex_parts_n: 4,
                part_tolerance_m: 0.0,
            },
        }
    }

    fn scope() -> Scope {
        let partition = |key: &str, object: &str| {
            let labels = BTreeMap::from([(OBJECT.to_owned(), object.to_owned())]);
            Partition::new(key.parse().unwrap(), labels)
        };
        Scope::new(BTreeMap::from([
            (
                Object::NAME.to_owned(),
                ["added", "box", "can"]
                    .map(|name| partition(name, name))
                    .to_vec(),
            ),
            (
                Demonstration::NAME.to_owned(),
                vec![partition("a", "box"), partition("b", "can")],
            ),
        ]))
    }

    /// A box with these half sides, in meters.
    fn carton(a: f64, b: f64, c: f64) -> TriMesh {
        let section = |z: f64| rounded_rectangle(a, b, 0.003, z);
        loft(&[section(-c), section(c)])
    }

    fn artifact(folder: &Path, name: &str, body: &TriMesh) -> Artifact {
        let folder = folder.join(name);
        std::fs::create_dir(&folder).unwrap();
        let meshed = MeshedObject {
            name,
            mass_kg: 0.2,
            mesh: body,
            options: &config(&[]).shape,
            seed: 1,
        };
        lake::table::write(&folder, &meshed.unseen().unwrap()).unwrap();
        std::fs::write(folder.join(MESH), body.to_obj()).unwrap();
        let files = [lake::table::FILE, MESH].map(|file| (file.to_owned(), folder.join(file)));
        Artifact {
            key: name.parse().unwrap(),
            labels: BTreeMap::new(),
            files: files.into(),
        }
    }

    fn made(config: &ShapesConfig, inputs: &Inputs, name: &str, seed: u64) -> Option<Object> {
        let out = tempfile::tempdir().unwrap();
        let cx = Context::detached(&name.parse().unwrap(), seed, out.path());
        match Shapes::make(config, inputs, &cx).unwrap() {
            Outcome::Made(_) => {}
            _ => return None,
        }
        let files = [(
            lake::table::FILE.to_owned(),
            out.path().join(lake::table::FILE),
        )];
        let object = Artifact {
            key: name.parse().unwrap(),
            labels: BTreeMap::new(),
            files: files.into(),
        };
        Some(lake::table::read(&object).unwrap())
    }

    #[test]
    fn objects_are_passed_on_and_shapes_say_what_they_were_kept_apart_from() {
        let units = Shapes::units(&config(&["can"]), &scope()).unwrap();
        let names: Vec<&str> = units.iter().map(|unit| unit.partition.as_str()).collect();
        let generated = ["shape_00000", "shape_00001", "shape_00002"];
        assert_eq!(names, [&["added", "box", "can"][..], &generated].concat());
        assert_eq!(units[1].reads[Object::NAME], ["box"]);
        assert_eq!(units[1].labels.as_ref().unwrap()[OBJECT], "box");
        assert!(!units[1].labels.as_ref().unwrap().contains_key(APART_FROM));
        // Nothing is made of an object without demonstrations.
        assert_eq!(units[3].reads[Object::NAME], ["box", "can"]);
        assert_eq!(units[3].labels.as_ref().unwrap()[APART_FROM], "can");
        let err = Shapes::units(&config(&["cup"]), &scope()).unwrap_err();
        assert!(err.to_string().contains("cup"), "{err}");
    }

    #[test]
    fn an_object_is_passed_on_unchanged() {
        let folder = tempfile::tempdir().unwrap();
        let given = artifact(folder.path(), "box", &carton(0.02, 0.03, 0.08));
        let object: Object = lake::table::read(&given).unwrap();
        let inputs = BTreeMap::from([(Object::NAME.to_owned(), vec![given])]);
        let inputs = Inputs::new(inputs, Vec::new());
        assert_eq!(made(&config(&[]), &inputs, "box", 5), Some(object));
    }

    #[test]
    fn no_shape_is_like_an_unseen_object() {
        let folder = tempfile::tempdir().unwrap();
        let seen = carton(0.02, 0.03, 0.08);
        let given = vec![
            artifact(folder.path(), "box", &seen),
            artifact(folder.path(), "brick", &carton(0.022, 0.032, 0.08)),
        ];
        let inputs = BTreeMap::from([(Object::NAME.to_owned(), given)]);
        let with = |apart_from: &str| {
            let facts = BTreeMap::from([(APART_FROM.to_owned(), apart_from.to_owned())]);
            Inputs::new(inputs.clone(), Vec::new()).with_facts(facts)
        };
        // All of them are boxes: some are like the brick, unless it is unseen.
        let stretched = ShapesConfig {
            stretched_share: 1.0,
            ..config(&[])
        };
        let distance_m = |object: &Object| {
            let mesh = object_shapes::mesh_of(object);
            mean_distance(&mesh, &carton(0.022, 0.032, 0.08), 99)
        };
        let name = |number: u64| format!("shape_{number:05}");
        let all = |inputs: &Inputs| -> Vec<Object> {
            (0..8)
                .filter_map(|n| made(&stretched, inputs, &name(n), n))
                .collect()
        };
        let free = all(&with(""));
        assert_eq!(free.len(), 8);
        assert!(free.iter().any(|object| distance_m(object) < 0.004));
        let apart = all(&with("brick"));
        assert!(!apart.is_empty());
        // Other points of the surfaces: half a millimeter for chance.
        assert!(apart.iter().all(|object| distance_m(object) > 0.0045));
        // Equal seeds give equal shapes.
        assert_eq!(free, all(&with("")));
        assert_ne!(free[0].vertices_m, free[1].vertices_m);
    }
}
