//! The hand and the options of screening, as pipeline files have them.

use std::fs;

use dataflow::Pipeline;
use robot::RobotModel;
use stage_screen::{Screen, ScreenConfig};

/// The bundled hand.
pub(crate) fn hand() -> RobotModel {
    RobotModel::from_urdf(include_str!("../../../data/robots/allegro_right.urdf")).unwrap()
}

/// Scene, protocol and limits: of refined motions, which squeeze by themselves, those of `pipelines/cgf.toml`, of
/// others those of `pipelines/replay.toml`; with a profile, or none.
pub(crate) fn screen(refined: bool, profile: Option<&str>) -> ScreenConfig {
    let path = if refined {
        "pipelines/cgf.toml"
    } else {
        "pipelines/replay.toml"
    };
    let root = env!("CARGO_MANIFEST_DIR");
    let path = format!("{root}/{path}");
    let text = fs::read_to_string(&path).unwrap();
    let read = Pipeline::parse(path.as_ref(), &text, &pipeline::kinds(), profile, &[]).unwrap();
    let screen = read.find("screen").unwrap();
    screen.options::<Screen>().unwrap().resolved()
}
