//! The hand and the options of screening, as `pipelines/cgf.toml` has them.

use dataflow::Pipeline;
use robot::RobotModel;
use simulation::{Protocol, SceneConfig};
use stage_screen::Screen;

/// The bundled hand.
pub(crate) fn hand() -> RobotModel {
    RobotModel::from_urdf(include_str!("../../../data/robots/allegro_right.urdf")).unwrap()
}

/// The scene and the protocol.
pub(crate) fn options() -> (SceneConfig, Protocol) {
    let text = include_str!("../../../pipelines/cgf.toml");
    let read = Pipeline::parse("cgf.toml".as_ref(), text, &pipeline::kinds(), None, &[]).unwrap();
    let screen = read.find("screen").unwrap().options::<Screen>().unwrap();
    (screen.scene.clone(), screen.protocol.clone())
}
