//! `MuJoCo` in a process of its own, and the descriptions of scene and scripts that it gets.

use geometry::SurfaceDistance;
use nalgebra::{Isometry3, Matrix3, Point3};
use robot::{JointKind, Link, RobotModel, Shape};
use serde_json::{Value, json};
use simulation::{ObjectMass, ObjectShape, Phase, Setpoint, SettledScene, Support, Verdict};
use spatial::{Object, Pose, Table};
use stage_screen::ScreenConfig;

use crate::python::{self, Script};

/// Time constant in seconds and damping ratio of contacts as soft as those here; by default 0.02 and 1.
pub(crate) const SOLREF: [f64; 2] = [0.01, 1.0];

/// A running `MuJoCo`.
pub(crate) struct Mujoco {
    script: Script,
    /// Its version.
    pub(crate) version: String,
    /// Of the object in the scene, where its parts only stand for it.
    surface: Option<SurfaceDistance>,
    /// Deepest that the hand may be in what it holds, in meters.
    max_depth_m: f64,
}

/// Outcome of a script in `MuJoCo`.
pub(crate) struct Rolled {
    /// CPU seconds of its physics steps until the motion fails or ends.
    pub(crate) cpu_s: f64,
    /// As in column `reason` of the rollouts.
    pub(crate) verdict: String,
}

impl Mujoco {
    /// Starts it on one thread; an error says what is missing.
    pub(crate) fn start() -> Result<Self, String> {
        let mut script = Script::start(&python::name(), "screening/mujoco_rollouts.py", &[], 1)?;
        let said: Value = serde_json::from_str(&script.ask("start")?).unwrap();
        Ok(Self {
            script,
            version: said["mujoco"].as_str().unwrap().to_owned(),
            surface: None,
            max_depth_m: 0.0,
        })
    }

    /// Builds a scene; all scripts after it are carried out there.
    pub(crate) fn build(
        &mut self,
        screen: &ScreenConfig,
        model: &RobotModel,
        object: &ObjectShape,
        engine: Engine,
    ) {
        self.surface = object.surface.as_ref().map(SurfaceDistance::new);
        self.max_depth_m = screen.max_penetration_m;
        self.ask(&json!({ "scene": scene(screen, model, object, engine) }));
    }

    /// Carries out scripts, one after the other.
    pub(crate) fn roll(&mut self, rollouts: &[Value]) -> Vec<Rolled> {
        let answer = self.ask(&json!({ "rollouts": rollouts }));
        let seconds = answer["cpu_s"].as_array().unwrap();
        let verdicts = answer["verdicts"].as_array().unwrap();
        let deep = answer["deep"].as_array().unwrap();
        let rolled = seconds.iter().zip(verdicts).zip(deep);
        let rolled = rolled.map(|((cpu_s, verdict), deep)| Rolled {
            cpu_s: cpu_s.as_f64().unwrap(),
            verdict: match verdict.as_str().unwrap() {
                held if held == Verdict::Held.as_str() && self.is_too_deep(deep) => {
                    Verdict::TooDeep.as_str().to_owned()
                }
                verdict => verdict.to_owned(),
            },
        });
        rolled.collect()
    }

    /// Whether one of these contacts of the hand, with parts of the object, is too deep below its surface.
    fn is_too_deep(&self, contacts: &Value) -> bool {
        contacts.as_array().unwrap().iter().any(|contact| {
            let [x, y, z, depth_m] = [0, 1, 2, 3].map(|at: usize| contact[at].as_f64().unwrap());
            let protrusion_m = self.surface.as_ref().map_or(0.0, |surface| {
                let on_part = Point3::new(x, y, z);
                surface.signed_distance(&on_part).distance_m.max(0.0)
            });
            depth_m - protrusion_m > self.max_depth_m
        })
    }

    fn ask(&mut self, what: &Value) -> Value {
        let answer = self.script.ask_again(&what.to_string());
        serde_json::from_str(&answer).unwrap()
    }
}

/// Contact options of `MuJoCo`.
#[derive(Clone, Copy)]
pub(crate) struct Engine {
    /// `pyramidal`, its default, or `elliptic`.
    pub(crate) cone: &'static str,
    /// Stiffness of friction relative to that of the normal; 1 by default.
    pub(crate) impratio: f64,
    /// Time constant in seconds and damping ratio of contacts.
    pub(crate) solref: [f64; 2],
    /// Iterations that take away what its regularized friction lets contacts creep; 0 by default.
    pub(crate) noslip: u32,
    /// Physics steps there in one here.
    pub(crate) steps: u32,
}

/// Describes the scene of a template.
fn scene(screen: &ScreenConfig, model: &RobotModel, object: &ObjectShape, engine: Engine) -> Value {
    let scene = &screen.scene;
    // Options that the peer's scene does not have.
    assert!(scene.object_mass() == ObjectMass::Measured && scene.table_friction.is_none());
    assert!(scene.support == Support::Table);
    let links: Vec<Value> = model.links().iter().map(|l| link(model, l)).collect();
    let parts = object.parts_m.iter();
    let parts: Vec<Vec<[f64; 3]>> = parts
        .map(|part| part.iter().map(|p| p.coords.into()).collect())
        .collect();
    json!({
        "time_step_s": scene.time_step_s / f64::from(engine.steps),
        "steps_per_control": scene.steps_per_control * engine.steps,
        "friction": scene.friction,
        "drive": scene.drive,
        "fingers_touch": scene.fingers_touch,
        "fingers_touch_palm": scene.fingers_touch_palm,
        "palm_compliance": scene.palm_compliance,
        "protocol": screen.protocol,
        "noted_depth_m": screen.max_penetration_m,
        "links": links,
        "object": {
            "parts": parts,
            "mass": object.mass_kg * scene.mass_scale,
            "center_of_mass": object.center_of_mass_m.coords.as_slice(),
            "inertia": six(&(object.inertia_kg_m2 * scene.mass_scale)),
        },
        "engine": {
            "cone": engine.cone,
            "impratio": engine.impratio,
            "multiccd": "enable",
            "solref": engine.solref,
            "noslip_iterations": engine.noslip,
        },
    })
}

/// Describes a rollout of a template, from the object's settled pose.
pub(crate) fn rollout(template: &SettledScene, setpoints: &[Setpoint]) -> Value {
    let setpoints: Vec<Value> = setpoints
        .iter()
        .map(|setpoint| {
            json!({
                "phase": match setpoint.phase {
                    Phase::Reach => "reach",
                    Phase::Close => "close",
                    Phase::Squeeze => "squeeze",
                    Phase::Lift => "lift",
                    Phase::Hold => "hold",
                    Phase::Pull => "pull",
                },
                "palm": seven(&setpoint.table_from_palm),
                "q": setpoint.q,
            })
        })
        .collect();
    json!({
        "table_from_object": template.table_from_object().to_array(),
        "setpoints": setpoints,
    })
}

fn link(model: &RobotModel, link: &Link) -> Value {
    let joint = link.joint.map(|number| {
        let joint = &model.joints()[number];
        assert_eq!((link.multiplier, link.offset), (1.0, 0.0), "no mimics");
        json!({
            "number": number,
            "name": joint.name,
            "kind": match joint.kind {
                JointKind::Revolute => "revolute",
                JointKind::Continuous => "continuous",
                JointKind::Prismatic => "prismatic",
            },
            "axis": link.axis.as_slice(),
            "lower": joint.lower,
            "upper": joint.upper,
        })
    });
    let shapes: Vec<Value> = link
        .collisions
        .iter()
        .map(|collision| {
            let (kind, size) = match &collision.shape {
                Shape::Box { half_extents_m } => ("box", half_extents_m.as_slice().to_vec()),
                Shape::Sphere { radius_m } => ("sphere", vec![*radius_m]),
                Shape::Cylinder {
                    radius_m,
                    half_length_m,
                } => ("cylinder", vec![*radius_m, *half_length_m]),
                Shape::Capsule {
                    radius_m,
                    half_length_m,
                } => ("capsule", vec![*radius_m, *half_length_m]),
                Shape::Convex(body) => {
                    let corners = body.corners_m().iter().flat_map(|corner| corner.iter());
                    ("mesh", corners.copied().collect())
                }
            };
            json!({
                "type": kind,
                "size": size,
                "link_from_shape": seven(&collision.link_from_shape),
            })
        })
        .collect();
    let inertial = link.inertial.as_ref();
    json!({
        "name": link.name,
        "parent": link.parent,
        "parent_from_joint": seven(&link.parent_from_joint),
        "joint": joint,
        "mass": inertial.map_or(0.0, |inertial| inertial.mass_kg),
        "center_of_mass": inertial.map(|i| i.center_of_mass_m.coords.as_slice().to_vec()),
        "inertia": inertial.map(|inertial| six(&inertial.inertia_kg_m2)),
        "shapes": shapes,
    })
}

/// A pose as seven numbers, the quaternion's w last.
fn seven(isometry: &Isometry3<f64>) -> [f64; 7] {
    Pose::<Table, Object>::new(*isometry).to_array()
}

/// A symmetric matrix as xx, yy, zz, xy, xz, yz.
fn six(m: &Matrix3<f64>) -> [f64; 6] {
    [
        m[(0, 0)],
        m[(1, 1)],
        m[(2, 2)],
        m[(0, 1)],
        m[(0, 2)],
        m[(1, 2)],
    ]
}
