//! Only an option's value counts, not whether it is set in the pipeline file or is the default.

use dataflow::{
    BoxedDiagnostic, Cause, Code, Context, Inputs, Kind, Line, Outcome, Output, Outputs, Pipeline,
    RunOptions, Scope, Stage, Unit, UnitState, plan, run,
};
use lake::Lake;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::engine::place::Place;

/// The code, which does not change.
const CODE: Code = Code { parts: "number=1" };

/// A stage in the version in which its option has this default.
struct Number<const DEFAULT: u8>;

#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct NumberConfig<const DEFAULT: u8> {
    /// The number to write.
    #[serde(default = "default::<DEFAULT>")]
    number: u8,
}

impl<const DEFAULT: u8> dataflow::Options for NumberConfig<DEFAULT> {}

fn default<const DEFAULT: u8>() -> u8 {
    DEFAULT
}

impl<const DEFAULT: u8> Stage for Number<DEFAULT> {
    type Config = NumberConfig<DEFAULT>;

    const KIND: &'static str = "number";
    const ABOUT: &'static str = "Writes a number";
    const INPUTS: &'static [&'static str] = &[];
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl<const DEFAULT: u8> Output for Number<DEFAULT> {
    type Stage = Self;
    type Metrics = ();
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = "numbers";
    const SCHEMA: &'static str = "numbers/1";
    const PARTITION: &'static str = "number";
    const LINE: Option<Line<()>> = Some(|summary| format!("{} numbers", summary.n_made));

    fn units(
        _config: &NumberConfig<DEFAULT>,
        _scope: &Scope,
    ) -> Result<Vec<Unit>, BoxedDiagnostic> {
        Ok(vec![Unit::new("all")])
    }

    fn make(
        config: &NumberConfig<DEFAULT>,
        _inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<()>, BoxedDiagnostic> {
        let path = cx.folder().join("number.txt");
        lake::write_atomic(&path, config.number.to_string().as_bytes())?;
        Ok(Outcome::Made(()))
    }
}

/// Says whether the number would be written again, and why.
fn planned(place: &Place, kind: &Kind, table: &str) -> UnitState {
    let lake = Lake::open(&place.lake());
    let plan = plan(&read(place, kind, table), &lake, &RunOptions::default()).unwrap();
    let units = plan.nodes.into_iter().next().unwrap().units.unwrap();
    units.into_iter().next().unwrap().state
}

fn read(place: &Place, kind: &Kind, table: &str) -> Pipeline {
    let text = format!("seed = 7\n[stages.number]\nkind = \"number\"\n{table}");
    Pipeline::parse(
        &place.pipeline(),
        &text,
        std::slice::from_ref(kind),
        None,
        &[],
    )
    .unwrap()
}

#[test]
fn a_default_that_changes_in_the_code_is_a_changed_value() {
    let place = Place::new("");
    let [three, four] = [&Kind::of::<Number<3>>(CODE), &Kind::of::<Number<4>>(CODE)];
    let options = RunOptions::default();
    let lake = Lake::open(&place.lake());
    run(&read(&place, three, ""), &lake, &options, None, &|_| {}).unwrap();
    assert_eq!(planned(&place, three, ""), UnitState::Cached);
    assert_eq!(planned(&place, three, "number = 3"), UnitState::Cached);
    assert_eq!(planned(&place, four, "number = 3"), UnitState::Cached);
    let changed = UnitState::Run {
        causes: vec![Cause::Config {
            key: "number".to_owned(),
            old: 3.into(),
            new: 4.into(),
        }],
        upstream: Vec::new(),
    };
    assert_eq!(planned(&place, four, ""), changed);
    assert_eq!(planned(&place, three, "number = 4"), changed);
}
