//! The hand and the options of screening, as `pipelines/cgf.toml` has them.

use robot::RobotModel;
use simulation::{Protocol, SceneConfig};
use toml_edit::DocumentMut;

/// The bundled hand.
pub(crate) fn hand() -> RobotModel {
    RobotModel::from_urdf(include_str!("../../../data/robots/allegro_right.urdf")).unwrap()
}

/// The scene and the protocol.
pub(crate) fn options() -> (SceneConfig, Protocol) {
    let file: DocumentMut = include_str!("../../../pipelines/cgf.toml").parse().unwrap();
    let screen = &file["stages"]["screen"];
    let [scene, protocol] = ["scene", "protocol"]
        .map(|key| DocumentMut::from(screen[key].clone().into_table().unwrap()));
    (
        toml_edit::de::from_document(scene).unwrap(),
        toml_edit::de::from_document(protocol).unwrap(),
    )
}
