//! URDFs, and all that is made of one that can be read.
#![no_main]

use libfuzzer_sys::fuzz_target;
use robot::{DynamicsModel, JointMotion, RobotModel, FreeRootState};
use spatial::{Palm, Pose};

fuzz_target!(|bytes: &[u8]| {
    let model = match RobotModel::from_urdf_bytes(bytes) {
        Ok(model) => model,
        Err(err) => {
            let _said = (err.to_string(), err.hint());
            return;
        }
    };
    for joint in model.joints() {
        assert!(joint.lower <= joint.upper && !joint.lower.is_nan());
    }
    let q = model.mid_range();
    let poses = model.forward_kinematics::<Palm>(&q).expect("one position per joint");
    assert_eq!(poses.len(), model.links().len());
    for (idx, link) in model.links().iter().enumerate() {
        assert!(link.parent.is_none_or(|parent| parent < idx));
        let origin = poses[idx].translation.vector.into();
        let jacobian = model.geometric_jacobian(&poses, idx, &origin);
        assert_eq!(jacobian.ncols(), model.dof());
    }
    for finger in model.fingers() {
        assert!(!finger.links.is_empty() && finger.tip_link < model.links().len());
    }
    let _found = (model.examine(), model.hand_layout());
    let bodies = DynamicsModel::new(&model);
    let motion = JointMotion {
        q: &q,
        velocity: &q,
        acceleration: &q,
    };
    let root = FreeRootState::still(poses[0].reinterpret());
    let down = [0.0, 0.0, -9.81].into();
    let efforts = bodies.inverse_dynamics(&root, &motion, &down);
    assert_eq!(efforts.expect("one number per joint").joints.len(), model.dof());
    let mass = bodies.mass_matrix(&q).expect("one position per joint");
    assert_eq!(mass.nrows(), model.dof());
});
