use dataflow::Diagnostic;
use nalgebra::{Point3, Vector3};
use robot::{Link, Shape};
use tempfile::TempDir;

use super::*;

/// A cuboid of 20, 40 and 60 mm whose lowest corner is the origin.
fn cuboid() -> TriMesh {
    TriMesh::cuboid(Point3::origin(), Point3::new(0.02, 0.04, 0.06))
}

/// Two cuboids a long way from each other, in one mesh.
fn two_cuboids() -> TriMesh {
    let mut mesh = cuboid();
    let n = u32::try_from(mesh.vertices_m.len()).unwrap();
    let other = cuboid();
    let away = Vector3::new(0.2, 0.0, 0.0);
    mesh.vertices_m
        .extend(other.vertices_m.iter().map(|vertex| vertex + away));
    mesh.triangles.extend(
        other
            .triangles
            .iter()
            .map(|triangle| triangle.map(|idx| idx + n)),
    );
    mesh
}

fn stl_text(mesh: &TriMesh) -> Vec<u8> {
    let mut text = "solid\n".to_owned();
    for &triangle in &mesh.triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        for corner in mesh.corners(triangle) {
            text += &format!("vertex {} {} {}\n", corner.x, corner.y, corner.z);
        }
        text += "endloop\nendfacet\n";
    }
    text.into_bytes()
}

#[expect(clippy::cast_possible_truncation, reason = "as the format has it")]
fn stl_binary(mesh: &TriMesh) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend(u32::try_from(mesh.triangles.len()).unwrap().to_le_bytes());
    for &triangle in &mesh.triangles {
        bytes.extend([0; 12]);
        for corner in mesh.corners(triangle) {
            bytes.extend(corner.iter().flat_map(|x| (*x as f32).to_le_bytes()));
        }
        bytes.extend([0; 2]);
    }
    bytes
}

/// A folder with a robot of one link, which collides with a mesh.
struct OneLink {
    folder: TempDir,
}

impl OneLink {
    #[expect(
        clippy::disallowed_methods,
        reason = "a test's file may well be half a file"
    )]
    fn new(file: &str, bytes: &[u8]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(file), bytes).unwrap();
        Self { folder }
    }

    fn read(&self, origin: &str, mesh: &str) -> Result<Link, LoadError> {
        let xml = format!(
            "<robot name='r'><link name='a'><collision>{origin}<geometry><mesh {mesh}/></geometry>\
             </collision></link></robot>"
        );
        let model = RobotModel::from_urdf(&xml).unwrap();
        let urdf = self.folder.path().join("robot.urdf");
        let model = with_mesh_shapes(model, &urdf)?;
        assert!(model.without_mesh_shape().is_none());
        Ok(model.links()[0].clone())
    }
}

/// The least and the greatest coordinates of a link's shapes, in its frame.
fn bounds(link: &Link) -> [Vector3<f64>; 2] {
    let corners = || {
        link.collisions.iter().flat_map(|collision| {
            let Shape::Convex(body) = &collision.shape else {
                panic!("{collision:?}");
            };
            let corners = body.corners_m().iter();
            corners.map(|corner| (collision.link_from_shape * *corner).coords)
        })
    };
    [
        corners().reduce(|a, b| a.inf(&b)).unwrap(),
        corners().reduce(|a, b| a.sup(&b)).unwrap(),
    ]
}

fn check(link: &Link, low: [f64; 3], high: [f64; 3]) {
    for (found, expected) in bounds(link).iter().zip([low, high]) {
        let off = (found - Vector3::from(expected)).norm();
        assert!(off < 1e-6, "{found} for {expected:?}");
    }
}

#[test]
fn every_kind_of_file_has_its_shape_where_the_urdf_puts_it() {
    let cuboid = cuboid();
    for (file, bytes) in [
        ("m.obj", cuboid.to_obj().into_bytes()),
        ("m.stl", stl_text(&cuboid)),
        ("m.STL", stl_binary(&cuboid)),
    ] {
        let files = OneLink::new(file, &bytes);
        let named = format!("filename='{file}'");
        check(
            &files.read("", &named).unwrap(),
            [0.0; 3],
            [0.02, 0.04, 0.06],
        );
        // In millimeters.
        let scaled = format!("{named} scale='0.001 0.001 0.001'");
        check(
            &files.read("", &scaled).unwrap(),
            [0.0; 3],
            [2e-5, 4e-5, 6e-5],
        );
        // Mirrored, as left hands are made of right ones.
        let mirrored = format!("{named} scale='1 -1 1'");
        check(
            &files.read("", &mirrored).unwrap(),
            [0.0, -0.04, 0.0],
            [0.02, 0.0, 0.06],
        );
        // A quarter turn about z.
        let origin = "<origin xyz='0.1 0 0' rpy='0 0 1.5707963267948966'/>";
        check(
            &files.read(origin, &named).unwrap(),
            [0.06, 0.0, 0.0],
            [0.1, 0.02, 0.06],
        );
    }
}

#[test]
fn a_mesh_that_is_not_convex_becomes_several_bodies() {
    let files = OneLink::new("m.obj", two_cuboids().to_obj().as_bytes());
    let link = files.read("", "filename='m.obj'").unwrap();
    assert!((2..=MAX_PARTS).contains(&link.collisions.len()));
    // Nothing is between them.
    for collision in &link.collisions {
        let x = collision.link_from_shape.translation.x;
        let reach = collision.shape.extent_m(&Vector3::x());
        assert!(x + reach < 0.03 || x - reach > 0.19, "{collision:?}");
    }
}

#[test]
fn unavailable_device_is_an_error_with_a_hint() {
    let cuboid = cuboid();
    let flat = cuboid.scaled(&Vector3::new(1.0, 1.0, 0.0));
    let cut = &stl_binary(&cuboid)[..300];
    for (file, bytes, named, says, hint) in [
        (
            "m.obj",
            &b""[..],
            "none.obj",
            "collides with the mesh `none.obj`, which is not there",
            "put it where",
        ),
        (
            "m.obj",
            b"",
            "",
            "collides with the mesh ``, which is not there",
            "put it where",
        ),
        (
            "m.dae",
            b"<COLLADA/>",
            "m.dae",
            "which is neither STL nor OBJ nor PLY",
            "convert it",
        ),
        (
            "m",
            b"",
            "m",
            "which is neither STL nor OBJ nor PLY",
            "convert it",
        ),
        (
            "m.stl",
            cut,
            "m.stl",
            "has 300 bytes, expected 684",
            "copy it",
        ),
        (
            "m.obj",
            b"v 0 0 0\n",
            "m.obj",
            "the mesh has no triangles",
            "with its faces",
        ),
        (
            "m.obj",
            flat.to_obj().as_bytes(),
            "m.obj",
            "no convex hull with a volume",
            "",
        ),
    ] {
        let files = OneLink::new(file, bytes);
        let err = files.read("", &format!("filename='{named}'")).unwrap_err();
        let cause = std::error::Error::source(&err).map(ToString::to_string);
        let said = format!("{err}: {}", cause.unwrap_or_default());
        assert!(said.contains("link `a`") && said.contains(says), "{said}");
        let hinted = err.hint().unwrap_or_default();
        assert!(hinted.contains(hint), "{hinted}");
    }
}

#[test]
fn a_mesh_that_changes_has_another_shape() {
    let mut files = OneLink::new("m.obj", cuboid().to_obj().as_bytes());
    let named = "filename='m.obj'";
    check(
        &files.read("", named).unwrap(),
        [0.0; 3],
        [0.02, 0.04, 0.06],
    );
    let larger = cuboid().scaled(&Vector3::repeat(2.0));
    files = OneLink::new("m.obj", larger.to_obj().as_bytes());
    check(
        &files.read("", named).unwrap(),
        [0.0; 3],
        [0.04, 0.08, 0.12],
    );
}
