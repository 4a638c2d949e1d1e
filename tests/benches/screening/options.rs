//! The hand and the options of screening, as `pipelines/cgf.toml` has them.

use dataflow::Pipeline;
use robot::RobotModel;
use stage_screen::{Screen, ScreenConfig};

/// The bundled hand.
pub(crate) fn hand() -> RobotModel {
    RobotModel::from_urdf(include_str!("../../../data/robots/allegro_right.urdf")).unwrap()
}

/// Scene, protocol and limits.
pub(crate) fn screen() -> ScreenConfig {
    let text = include_str!("../../../pipelines/cgf.toml");
    let read = Pipeline::parse("cgf.toml".as_ref(), text, &pipeline::kinds(), None, &[]).unwrap();
    let screen = read.find("screen").unwrap();
    screen.options::<Screen>().unwrap().resolved()
}
