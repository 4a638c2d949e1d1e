use motion::Motion;
use robot::RobotModel;
use simulation::{
    ObjectShape, PalmComplianceConfig, PalmDriveConfig, SceneConfig, SettledScene, SimulationError,
    TraceMode,
};

use crate::scene::{can, hand, protocol, q, scene, settled, side_grasp, upright, urdf};

fn refuse(object: &ObjectShape) -> SimulationError {
    SettledScene::new(&scene(), &hand(), object, &upright())
        .err()
        .unwrap()
}

#[test]
fn an_object_without_mass_is_refused() {
    let mut object = can();
    object.mass_kg = 0.0;
    let error = refuse(&object);
    assert_eq!(error, SimulationError::Massless { mass_kg: 0.0 });
    assert!(error.hint().is_some());
    object.mass_kg = f64::NAN;
    assert!(matches!(refuse(&object), SimulationError::Massless { .. }));
}

#[test]
fn an_inside_out_object_is_refused() {
    let mut object = can();
    // What the volume integrals of a mesh wound inward give.
    object.inertia_kg_m2 = -object.inertia_kg_m2;
    assert!(matches!(
        refuse(&object),
        SimulationError::ObjectInertia { .. }
    ));
}

#[test]
fn parts_without_volume_are_refused() {
    let mut object = can();
    object.parts_m[0].truncate(3);
    assert!(matches!(
        refuse(&object),
        SimulationError::FlatPart { part: 0, points: 3 }
    ));
    object.parts_m.clear();
    assert_eq!(refuse(&object), SimulationError::NoParts);
}

#[test]
fn a_hand_without_inertia_is_refused_by_the_link_that_lacks_it() {
    let xml = urdf();
    let link = xml.find(r#"<link name="link_2.0">"#).unwrap();
    let start = link + xml[link..].find("<inertial>").unwrap();
    let end = start + xml[start..].find("</inertial>").unwrap() + "</inertial>".len();
    let without = [&xml[..start], &xml[end..]].concat();
    let hand = RobotModel::from_urdf(&without).unwrap();
    let error = SettledScene::new(&scene(), &hand, &can(), &upright())
        .err()
        .unwrap();
    assert_eq!(
        error,
        SimulationError::NoInertia {
            links: vec!["link_2.0".to_owned()]
        }
    );
}

#[test]
fn a_protocol_that_names_an_unknown_joint_is_refused() {
    let mut protocol = protocol();
    protocol.flexion_joints.push("joint_16.0".to_owned());
    let motion = side_grasp([-0.015, -0.055, 0.02], &q([0.5; 3], [1.3, 0.5, 0.5, 0.5]));
    let error = settled(&scene())
        .rollout(&motion, &protocol, TraceMode::Nothing)
        .unwrap_err();
    assert!(matches!(error, SimulationError::UnknownJoint { name, .. } if name == "joint_16.0"));
}

#[test]
fn a_motion_that_does_not_fit_the_hand_is_refused() {
    let settled = settled(&scene());
    let good = side_grasp([-0.015, -0.055, 0.02], &q([0.5; 3], [1.3, 0.5, 0.5, 0.5]));
    let mut other: Vec<String> = hand().joint_names();
    other.swap(0, 1);
    let swapped = good.reordered(&other).unwrap();
    other[0] = "wrist".to_owned();
    let renamed = Motion::new(&other, good.steps().to_vec()).unwrap();
    for motion in [swapped, renamed] {
        let result = settled.rollout(&motion, &protocol(), TraceMode::Nothing);
        assert!(matches!(result, Err(SimulationError::Motion(_))));
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    // Contacts cannot be resolved in steps of a second.
    for time_step_s in [0.0, 1.0] {
        let mut scene = scene();
        scene.time_step_s = time_step_s;
        let error = SettledScene::new(&scene, &hand(), &can(), &upright()).err();
        assert!(
            matches!(error, Some(SimulationError::Setting(fault)) if fault.key == "time_step_s")
        );
    }
    let both = SceneConfig {
        palm_drive: Some(PalmDriveConfig::default()),
        palm_compliance: Some(PalmComplianceConfig::default()),
        ..scene()
    };
    let error = SettledScene::new(&both, &hand(), &can(), &upright()).err();
    assert!(matches!(error, Some(SimulationError::Setting(fault)) if fault.key == "palm_drive"));
}
