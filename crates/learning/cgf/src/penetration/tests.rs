use std::sync::LazyLock;

use candle_core::Var;
use geometry::TriMesh;
use nalgebra::Isometry3;

use super::*;
use crate::random::Random;

/// A palm without a shape, a sphere on a hinge, and another on a slide.
const HAND: &str = r#"<robot name="h"><link name="palm"/>
  <link name="a"><collision><origin xyz="0 0 0.03"/><geometry><sphere radius="0.012"/></geometry></collision></link>
  <link name="b"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
  <joint name="ja" type="revolute"><parent link="palm"/><child link="a"/><axis xyz="0 1 0"/>
    <origin xyz="0.01 0 0.02" rpy="0.1 0.2 0.3"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="jb" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
    <origin xyz="0 0 0.01"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"#;

fn body() -> Body {
    Body::new(Arc::new(RobotModel::from_urdf(HAND).unwrap())).unwrap()
}

/// A cube of 10 cm about its origin, 4 cm above the table, turned and off the origin of what is seen.
fn surroundings() -> PenetrationScene {
    static FIELD: LazyLock<Arc<DistanceField>> = LazyLock::new(|| {
        let high = Point3::new(0.05, 0.05, 0.05);
        let mesh = TriMesh::cuboid(-high, high);
        Arc::new(DistanceField::new(&mesh, 0.0025, 0.05).unwrap().unwrap())
    });
    let seen = Isometry3::new(Vector3::new(0.01, 0.02, 0.0), Vector3::new(0.0, 0.0, 0.4));
    PenetrationScene {
        field: FIELD.clone(),
        object_from_network: Pose::new(Isometry3::translation(0.0, 0.0, -0.09) * seen),
        table_from_network: Pose::new(seen),
    }
}

fn row(position: [f32; 3], q: [f32; 2]) -> Vec<f32> {
    let turn = [1.0, 0.1, 0.0, 0.0, 0.9, 0.2];
    [&position[..], &turn, &q].concat()
}

fn penetration(rows: &[Vec<f32>], around: &[PenetrationScene]) -> Vec<f32> {
    let rows = Tensor::new(rows.to_vec(), &Device::Cpu).unwrap();
    let depths = body().penetration(&rows, around).unwrap();
    depths.flatten_all().unwrap().to_vec1().unwrap()
}

#[test]
fn squared_depths_are_a_mean_over_the_links() {
    // Straight above the cube, both spheres' centers on the vertical.
    let upright = |z: f32| [&[0.0, 0.0, z][..], &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]].concat();
    let straight = HAND.replace("rpy=\"0.1 0.2 0.3\"", "rpy=\"0 0 0\"");
    let body = Body::new(Arc::new(RobotModel::from_urdf(&straight).unwrap())).unwrap();
    let check = |z: f32, depths_m: [f32; 2]| {
        let rows = Tensor::new(vec![[upright(z), vec![0.0; 2]].concat()], &Device::Cpu).unwrap();
        let found = body.penetration(&rows, &[surroundings()]).unwrap();
        let found = found.flatten_all().unwrap().to_vec1::<f32>().unwrap()[0];
        let expected = depths_m.iter().map(|d| d * d).sum::<f32>() / 3.0;
        assert!((found - expected).abs() < 2e-7, "{found} {expected}");
    };
    // The cube's top is at 14 cm; the spheres' centers are 5 and 3 cm above the palm.
    check(0.2, [0.0, 0.0]);
    check(0.12, [0.0, 0.01]);
    check(0.1, [0.002, 0.03]);
    // The table is at 0; the cube begins 4 cm above it.
    check(-0.04, [0.002, 0.03]);
}

#[test]
fn gradients_equal_central_differences() {
    let mut random = Random::new(3, 0);
    let mut number = |center: f64, by: f64| narrow(center + by * random.normal());
    let mut checked = 0;
    for _ in 0..80 {
        let position = [number(0.03, 0.03), number(0.0, 0.03), number(0.08, 0.05)];
        let at = row(position, [number(0.0, 0.5), number(0.0, 0.02)]);
        let tensor = Tensor::new(vec![at.clone()], &Device::Cpu).unwrap();
        let var = Var::from_tensor(&tensor).unwrap();
        let value = body().penetration(&var, &[surroundings()]).unwrap();
        if value.to_vec2::<f32>().unwrap()[0][0] == 0.0 {
            continue;
        }
        let gradients = value.sum_all().unwrap().backward().unwrap();
        let found = gradients.get(&var).unwrap().to_vec2::<f32>().unwrap();
        let largest = found[0].iter().fold(0.0_f32, |m, x| m.max(x.abs()));
        let h = 1e-4;
        let off = (0..at.len()).filter(|&k| {
            let mut moved = [at.clone(), at.clone()];
            moved[0][k] += h;
            moved[1][k] -= h;
            let values = penetration(&moved, &[surroundings()]);
            let expected = (values[0] - values[1]) / (2.0 * h);
            (expected - found[0][k]).abs() > 0.02 * largest
        });
        // At an edge of the distances' grid, a number may be between two slopes.
        assert!(off.count() <= 1, "{at:?}: {found:?}");
        checked += 1;
    }
    assert!(checked > 20, "{checked}");
}

#[test]
fn every_motion_is_measured_in_its_own_surroundings() {
    let deep = row([0.03, 0.0, 0.06], [0.0, 0.0]);
    let mut away = surroundings();
    away.object_from_network = Pose::new(Isometry3::translation(0.0, 0.0, -9.0));
    let rows = vec![deep; 4];
    let values = penetration(&rows, &[surroundings(), away]);
    assert!(values[0] > 0.0 && values[0] == values[1], "{values:?}");
    assert!(values[2] == 0.0 && values[3] == 0.0, "{values:?}");
}

#[test]
fn penetration_depth_is_rotation_invariant() {
    let turn = UnitQuaternion::from_euler_angles(0.3, -0.2, 1.1);
    let before = row([0.03, 0.0, 0.06], [0.2, 0.01]);
    let mut after = before.clone();
    for from in [0, 3, 6] {
        let vector = Vector3::from_fn(|k, _| f64::from(before[from + k]));
        for (x, turned) in after[from..from + 3].iter_mut().zip(&(turn * vector)) {
            *x = narrow(*turned);
        }
    }
    let expected = penetration(&[before], &[surroundings()])[0];
    let found = penetration(&[after], &[surroundings().turned(&turn)])[0];
    assert!(
        expected > 1e-5 && (found - expected).abs() < 1e-8,
        "{found} {expected}"
    );
}
