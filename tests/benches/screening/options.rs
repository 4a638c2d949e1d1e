//! The hand and the options of screening, as pipeline files have them.

use std::fs;

use dataflow::Pipeline;
use robot::RobotModel;
use stage_screen::{Screen, ScreenConfig};

/// The stage whose candidates squeeze by themselves.
const REFINED: &str = "refine";

/// The bundled hand.
pub(crate) fn hand() -> RobotModel {
    RobotModel::from_urdf(include_str!("../../../data/robots/allegro_right.urdf")).unwrap()
}

/// Scene, protocol and limits of motions that do not squeeze by themselves, as `pipelines/replay.toml` has them.
pub(crate) fn screen() -> ScreenConfig {
    of_file("pipelines/replay.toml")
}

/// Scene, protocol and limits of the candidates of a stage: for refined ones those of `pipelines/cgf.toml`.
#[allow(
    dead_code,
    reason = "only benches that read a lake have candidates of stages"
)]
pub(crate) fn screen_of(stage: &str) -> ScreenConfig {
    if stage == REFINED {
        of_file("pipelines/cgf.toml")
    } else {
        screen()
    }
}

fn of_file(path: &str) -> ScreenConfig {
    let root = env!("CARGO_MANIFEST_DIR");
    let path = format!("{root}/{path}");
    let text = fs::read_to_string(&path).unwrap();
    let read = Pipeline::parse(path.as_ref(), &text, &pipeline::kinds(), None, &[]).unwrap();
    let screen = read.find("screen").unwrap();
    screen.options::<Screen>().unwrap().resolved()
}
