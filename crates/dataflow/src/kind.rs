//! Type-erased stage kinds, so that a pipeline can hold stages of every kind.

use std::{any::Any, marker::PhantomData, ops::Range};

use serde::{Deserialize, de::IntoDeserializer};
use serde_json::Value;
use toml_edit::InlineTable;

use crate::{
    advice::Advised,
    context::{Context, Inputs},
    metrics::MissingFigure,
    option_faults::OptionFault,
    outcome::Outcome,
    output::OutputInfo,
    record::RecordOutcome,
    report::{Generator, Recorded, Report, Unreported},
    scope::Scope,
    stage::{OutputOf, Stage},
    summary::{Summarize, SummaryLine},
    unit::Unit,
};

/// One kind of stage, as named by `kind = "…"` in a pipeline file.
#[derive(Clone, Copy)]
pub struct Kind {
    /// The value of `kind`.
    pub name: &'static str,
    /// What it does, in one sentence.
    pub about: &'static str,
    /// The artifacts it reads.
    pub inputs: &'static [&'static str],
    outputs: fn() -> Vec<OutputInfo>,
    configure: fn(InlineTable) -> Result<Box<dyn Configured>, ConfigFault>,
    schema: fn() -> Value,
}

/// One option of a kind, for people.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct OptionInfo {
    /// Dotted key in the stage's table.
    pub key: String,
    /// Its type, e.g. `number`.
    pub value: String,
    /// What it means, with its unit.
    pub about: String,
    /// Its default, if it may be left out.
    pub default: Option<String>,
    /// Whether the file must set it.
    pub required: bool,
}

/// A stage with its configuration.
pub(crate) trait Configured: Send + Sync {
    /// The typed configuration.
    fn options(&self) -> &dyn Any;
    /// The configuration without the paths of files that its units read.
    fn config(&self) -> Value;
    fn check(&self) -> Vec<OptionFault>;
    fn prepare(&self) -> Result<(), Advised>;
    // Of the output at this position in `Kind::outputs`:
    fn units(&self, output_idx: usize, scope: &Scope) -> Result<Vec<Unit>, Advised>;
    fn make(&self, output_idx: usize, inputs: &Inputs, cx: &Context) -> Result<Outcome, Advised>;
    fn tell(
        &self,
        output_idx: usize,
        outcomes: &[&RecordOutcome],
    ) -> Result<SummaryLine, MissingFigure>;
}

/// A fault in a stage's table.
pub(crate) struct ConfigFault {
    pub(crate) message: String,
    pub(crate) span: Option<Range<usize>>,
}

/// A configured stage with the outputs of it and of its report, and its generator.
struct ConfiguredStage<R: Report, G> {
    options: Config<R>,
    /// The options as fingerprints hold them: serialized once, where that can fail.
    config: Value,
    outputs: Vec<Listed<R::Stage>>,
    generator: PhantomData<fn() -> G>,
}

/// An output of a kind.
struct Listed<S: Stage> {
    info: OutputInfo,
    output: &'static dyn OutputOf<S>,
    summarize_fn: Summarize,
}

/// Lists the outputs of a stage, then those of its report, each with its line.
fn outputs<R: Report>() -> Vec<Listed<R::Stage>> {
    let results = R::Stage::OUTPUTS
        .iter()
        .map(|output| (output, R::Stage::CODE));
    let reports = R::OUTPUTS.iter().map(|output| (output, R::CODE));
    let listed = results.chain(reports).map(|(output, code)| {
        let info = output.info(code);
        let lines = R::LINES.iter().filter(|line| line.output() == output.id());
        let mut tellings = lines.map(|line| line.summarize_fn()).chain(output.line());
        let (Some(summarize_fn), None) = (tellings.next(), tellings.next()) else {
            unreachable!("the output `{}` has no line, or two", info.artifact);
        };
        Listed {
            info,
            output: *output,
            summarize_fn,
        }
    });
    listed.collect()
}

impl<R: Report, G> ConfiguredStage<R, G> {
    /// Parses the options of a stage's table.
    fn read(table: InlineTable) -> Result<Self, ConfigFault> {
        // Every such number is `null` in JSON, so that recipes with different ones would be equal.
        if let Some(fault) = not_finite(&table) {
            return Err(fault);
        }
        let deserializer = toml_edit::Value::InlineTable(table).into_deserializer();
        let options = Config::<R>::deserialize(deserializer).map_err(|err| ConfigFault {
            message: err.message().to_owned(),
            span: err.span(),
        })?;
        let config = serde_json::to_value(&options).map_err(|err| ConfigFault {
            message: format!("its options cannot be written as JSON: {err}"),
            span: None,
        })?;
        Ok(Self {
            options,
            config,
            outputs: outputs::<R>(),
            generator: PhantomData,
        })
    }
}

/// Finds the first number of a table that is NaN or infinite.
fn not_finite(table: &InlineTable) -> Option<ConfigFault> {
    fn within(key: &str, value: &toml_edit::Value) -> Option<ConfigFault> {
        match value {
            toml_edit::Value::Float(number) if !number.value().is_finite() => Some(ConfigFault {
                message: format!("`{key}` is {}, expected a finite number", number.value()),
                span: value.span(),
            }),
            toml_edit::Value::Array(values) => values.iter().find_map(|value| within(key, value)),
            toml_edit::Value::InlineTable(table) => {
                let mut values = table.iter();
                values.find_map(|(below, value)| within(&format!("{key}.{below}"), value))
            }
            _ => None,
        }
    }
    table.iter().find_map(|(key, value)| within(key, value))
}

type Config<R> = <<R as Report>::Stage as Stage>::Config;

impl<R, G> Configured for ConfiguredStage<R, G>
where
    R: Report,
    G: Generator<Stage = R::Stage>,
{
    fn options(&self) -> &dyn Any {
        &self.options
    }

    fn config(&self) -> Value {
        self.config.clone()
    }

    fn check(&self) -> Vec<OptionFault> {
        R::Stage::check(&self.options)
    }

    fn prepare(&self) -> Result<(), Advised> {
        G::generate(&self.options)?;
        Ok(R::Stage::prepare(&self.options)?)
    }

    fn units(&self, output_idx: usize, scope: &Scope) -> Result<Vec<Unit>, Advised> {
        self.outputs[output_idx].output.units(&self.options, scope)
    }

    fn make(&self, output_idx: usize, inputs: &Inputs, cx: &Context) -> Result<Outcome, Advised> {
        let output = self.outputs[output_idx].output;
        output.make(&self.options, inputs, cx)
    }

    fn tell(
        &self,
        output_idx: usize,
        outcomes: &[&RecordOutcome],
    ) -> Result<SummaryLine, MissingFigure> {
        (self.outputs[output_idx].summarize_fn)(outcomes)
    }
}

impl Kind {
    /// Returns the kind of a stage without a report.
    pub fn of<S: Stage>() -> Self {
        Self::generated::<Unreported<S>, Recorded<S>>()
    }

    /// Returns the kind of a stage with its report.
    pub fn reported<R: Report>() -> Self {
        Self::generated::<R, Recorded<R::Stage>>()
    }

    /// Returns the kind of a stage with its report and the generator of its dataset.
    ///
    /// # Panics
    ///
    /// Panics if an output of the stage or its report has no line or two, or
    /// [`Output::OPTIONS`](crate::Output::OPTIONS) names an unknown option.
    pub fn generated<R: Report, G: Generator<Stage = R::Stage>>() -> Self {
        let kind = Self {
            name: R::Stage::KIND,
            about: R::Stage::ABOUT,
            inputs: R::Stage::INPUTS,
            outputs: || outputs::<R>().iter().map(|listed| listed.info).collect(),
            configure: |table| {
                let configured = ConfiguredStage::<R, G>::read(table)?;
                Ok(Box::new(configured) as Box<dyn Configured>)
            },
            schema: || schemars::schema_for!(Config<R>).to_value(),
        };
        kind.check_declared();
        kind
    }

    /// Checks that outputs name existing options.
    fn check_declared(&self) {
        let outputs = self.outputs();
        if outputs
            .iter()
            .all(|output| output.options.named().is_empty())
        {
            return;
        }
        let schema = self.schema();
        let known = schema.get("properties").and_then(Value::as_object);
        for output in outputs {
            for option in output.options.named() {
                assert!(
                    known.is_some_and(|known| known.contains_key(*option)),
                    "`{}` is said to depend on `{option}`, which is no option of `{}`",
                    output.artifact,
                    self.name
                );
            }
        }
    }

    /// Returns the artifacts it makes, in the order in which they are made: results, then reports.
    pub fn outputs(&self) -> Vec<OutputInfo> {
        (self.outputs)()
    }

    pub(crate) fn configure(&self, table: InlineTable) -> Result<Box<dyn Configured>, ConfigFault> {
        (self.configure)(table)
    }

    /// Returns the JSON schema of the stage's table.
    pub(crate) fn schema(&self) -> Value {
        (self.schema)()
    }

    /// Lists the options of the stage's table, in the order of the configuration struct's schema.
    pub fn options(&self) -> Vec<OptionInfo> {
        let root = self.schema();
        let mut options = Vec::new();
        collect_options(&root, &root, "", &mut options);
        options
    }
}

/// Walks a JSON schema's properties, following references into the schema's own definitions.
fn collect_options(root: &Value, schema: &Value, prefix: &str, options: &mut Vec<OptionInfo>) {
    let Some(properties) = schema.get("properties").and_then(Value::as_object) else {
        return;
    };
    let required: Vec<&str> = schema
        .get("required")
        .and_then(Value::as_array)
        .into_iter()
        .flatten()
        .filter_map(Value::as_str)
        .collect();
    for (name, property) in properties {
        let key = if prefix.is_empty() {
            name.clone()
        } else {
            format!("{prefix}.{name}")
        };
        let target = resolve(root, property);
        let about = [property, target]
            .into_iter()
            .find_map(|schema| schema.get("description")?.as_str())
            .unwrap_or_default();
        options.push(OptionInfo {
            key: key.clone(),
            value: type_name(target),
            about: about.split_whitespace().collect::<Vec<_>>().join(" "),
            // A table has the defaults of its options.
            default: property
                .get("default")
                .filter(|_| target.get("properties").is_none())
                .map(ToString::to_string),
            required: required.contains(&name.as_str()),
        });
        collect_options(root, target, &key, options);
    }
}

pub(crate) fn resolve<'a>(root: &'a Value, schema: &'a Value) -> &'a Value {
    let reference = schema.get("$ref").and_then(Value::as_str);
    reference
        .and_then(|path| root.pointer(path.strip_prefix('#')?))
        .unwrap_or(schema)
}

fn type_name(schema: &Value) -> String {
    if let Some(words) = schema.get("enum").and_then(Value::as_array) {
        let words: Vec<String> = words.iter().map(ToString::to_string).collect();
        return words.join(" or ");
    }
    if let Some(variants) = schema.get("oneOf").and_then(Value::as_array) {
        let words: Vec<String> = variants
            .iter()
            .map(|variant| {
                variant
                    .get("const")
                    .map_or_else(|| type_name(variant), ToString::to_string)
            })
            .collect();
        return words.join(" or ");
    }
    match schema.get("type") {
        Some(Value::String(name)) => name.clone(),
        Some(Value::Array(names)) => {
            let names: Vec<&str> = names.iter().filter_map(Value::as_str).collect();
            names.join(" or ")
        }
        _ => "value".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        code::Code,
        output::Options,
        stage::{Output, Outputs, OwnLine},
    };

    /// A stage with an option that cannot always be serialized.
    enum Fixture {}

    #[derive(Debug, Deserialize, serde::Serialize, schemars::JsonSchema)]
    struct Config {
        #[serde(default, serialize_with = "positive")]
        weights: Vec<f64>,
    }

    fn positive<T: serde::Serializer>(weights: &[f64], serializer: T) -> Result<T::Ok, T::Error> {
        if weights.iter().any(|weight| *weight < 0.0) {
            return Err(serde::ser::Error::custom("a weight is negative"));
        }
        serializer.collect_seq(weights)
    }

    #[derive(Debug, thiserror::Error)]
    #[error("it makes nothing")]
    struct Nothing;

    impl crate::Advise for Nothing {
        fn hint(&self) -> Option<String> {
            None
        }
    }

    impl Stage for Fixture {
        type Config = Config;
        type Error = Nothing;

        const KIND: &'static str = "fixture";
        const ABOUT: &'static str = "Makes nothing";
        const CODE: Code = Code { parts: "" };
        const INPUTS: &'static [&'static str] = &[];
        const OUTPUTS: Outputs<Self> = &[];
    }

    /// A stage with one output: valid, with an unknown option, or without a line.
    struct Declared<const FAULT: u8>;

    impl<const FAULT: u8> Stage for Declared<FAULT> {
        type Config = Config;
        type Error = Nothing;

        const KIND: &'static str = "declared";
        const ABOUT: &'static str = "Makes nothing";
        const CODE: Code = Code { parts: "" };
        const INPUTS: &'static [&'static str] = &[];
        const OUTPUTS: Outputs<Self> = &[&Self];
    }

    impl<const FAULT: u8> Output for Declared<FAULT> {
        type Stage = Self;
        type Metrics = ();
        type Error = Nothing;

        const ARTIFACT: &'static str = "nothing";
        const SCHEMA: &'static str = "nothing/1";
        const PARTITION: &'static str = "none";
        const OPTIONS: Options = Options::Except(if FAULT == 1 {
            &["wieghts"]
        } else {
            &["weights"]
        });
        const LINE: OwnLine<()> = if FAULT == 2 {
            None
        } else {
            Some(|_| String::new())
        };

        fn units(_: &Config, _: &Scope) -> Result<Vec<Unit>, Nothing> {
            Err(Nothing)
        }

        fn make(_: &Config, _: &Inputs, _: &Context) -> Result<Outcome<()>, Nothing> {
            Err(Nothing)
        }
    }

    #[test]
    fn an_output_names_options_that_there_are_and_has_a_line() {
        let is_sound = |kind: fn() -> Kind| std::panic::catch_unwind(kind).is_ok();
        assert!(is_sound(Kind::of::<Declared<0>>));
        assert!(!is_sound(Kind::of::<Declared<1>>));
        assert!(!is_sound(Kind::of::<Declared<2>>));
    }

    #[test]
    fn options_that_would_count_as_null_are_refused() {
        let read = |table: &str| {
            let table = table.parse::<toml_edit::Value>().unwrap();
            let table = table.as_inline_table().unwrap().clone();
            let configured = Kind::of::<Fixture>().configure(table);
            configured.map(|it| it.config()).map_err(|err| err.message)
        };
        assert_eq!(
            read("{ weights = [0.5] }").unwrap(),
            serde_json::json!({"weights": [0.5]})
        );
        for (weight, expected) in [
            ("nan", "`weights` is NaN, expected a finite number"),
            ("-inf", "`weights` is -inf, expected a finite number"),
            (
                "-1.0",
                "its options cannot be written as JSON: a weight is negative",
            ),
        ] {
            let found = read(&format!("{{ weights = [1.0, {weight}] }}"));
            assert_eq!(found.unwrap_err(), expected);
        }
    }
}
