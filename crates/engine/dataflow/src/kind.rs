//! Type-erased stage kinds, so that a pipeline can hold stages of every kind.

use std::{any::Any, cell::LazyCell, collections::BTreeMap, ops::Range, sync::Arc};

use options::OptionFault;
use serde::{Deserialize, de::IntoDeserializer};
use serde_json::Value;
use toml_edit::InlineTable;

use crate::{
    advice::{BoxedDiagnostic, Diagnostic},
    code::Code,
    context::{Context, Inputs},
    field_names::field_names,
    file_fault::FileFault,
    metrics::MissingMetric,
    name::NodeName,
    outcome::Outcome,
    output::OutputInfo,
    record::RecordOutcome,
    report::Report,
    scope::Scope,
    stage::{ErasedLine, Lines, OutputNames, OutputOf, Outputs, Stage, Wiring},
    summary::Summary,
    tables::{merge_values, set_value},
    unit::Unit,
};

/// One kind of stage, as named by `kind = "…"` in a pipeline file.
#[derive(Clone)]
pub struct Kind {
    /// The value of `kind`.
    pub name: &'static str,
    /// Description, in one sentence.
    pub about: &'static str,
    /// The artifacts it reads; of a stage of [`Wiring::Free`], its inputs as the file names them.
    pub inputs: Vec<String>,
    /// Further artifacts that it reads where they are wired.
    pub optional_inputs: &'static [&'static str],
    /// Whether the kind or the pipeline file declares the inputs.
    pub wiring: Wiring,
    /// Text at the end of its page of options.
    pub example: Option<&'static str>,
    /// The artifacts it makes, in the order in which they are made: results, then reports.
    pub outputs: Vec<OutputInfo>,
    configure: Arc<Configure>,
    schema: fn() -> Value,
    completion: Option<Completion>,
}

/// Options that a stage's table may leave out where a file that it names has them.
#[derive(Clone, Copy)]
struct Completion {
    options: &'static [&'static str],
    /// The option that names the file.
    file: &'static str,
    complete: OptionCompletion,
}

/// Returns, by their dotted keys, the values of these options in the file that a stage's table names; it may change
/// the table.
pub type OptionCompletion = fn(
    &mut InlineTable,
    &[&'static str],
) -> Result<Vec<(&'static str, toml_edit::Value)>, OptionFault>;

/// Parses a stage's table.
type Configure = dyn Fn(InlineTable) -> Result<Box<dyn StageWithConfig>, ConfigFault> + Send + Sync;

/// One option of a kind, for people.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct OptionInfo {
    /// Dotted key in the stage's table.
    pub key: String,
    /// Its type, e.g. `number`.
    pub value: String,
    /// Meaning, with its unit.
    pub about: String,
    /// Its default, if it may be left out.
    pub default: Option<String>,
    /// Its range with the reason, if it has one.
    pub range: Option<String>,
    /// Whether the file must set it.
    pub required: bool,
}

/// A stage with its configuration.
pub(crate) trait StageWithConfig: Send + Sync {
    /// The typed configuration.
    fn options(&self) -> &dyn Any;
    /// The configuration without the paths of files that its units read.
    fn config(&self) -> Value;
    fn check(&self) -> Vec<OptionFault>;
    fn check_wired(&self, inputs: &BTreeMap<String, NodeName>) -> Vec<OptionFault>;
    /// The options whose files [`Self::check_files`] checks.
    fn files(&self) -> &'static [&'static str];
    fn check_files(&self) -> Vec<FileFault>;
    /// The outputs, whose names may follow from the options.
    fn outputs(&self) -> Vec<OutputInfo>;
    fn prepare(&self) -> Result<(), BoxedDiagnostic>;
    // Of the output at this position in [`Kind::outputs`]:
    fn units(&self, output_idx: usize, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic>;
    fn make(
        &self,
        output_idx: usize,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome, BoxedDiagnostic>;
    fn summarize(
        &self,
        output_idx: usize,
        outcomes: &[&RecordOutcome],
    ) -> Result<(Summary, String), MissingMetric>;
}

/// A fault in a stage's table.
pub(crate) struct ConfigFault {
    pub(crate) message: String,
    pub(crate) span: Option<Range<usize>>,
}

/// A stage with its configuration and its type.
struct ConfiguredStage<S: Stage> {
    options: S::Config,
    /// The options as fingerprints hold them: serialized once, where that can fail.
    config: Value,
    parts: Arc<Parts<S>>,
}

/// Parts that all stages of a kind share.
struct Parts<S: Stage> {
    outputs: Vec<KindOutput<S>>,
    generate: Option<Generate<S>>,
}

/// An output of a kind.
struct KindOutput<S: Stage> {
    info: OutputInfo,
    output: &'static dyn OutputOf<S>,
    line: ErasedLine,
}

/// Makes the dataset that the options name.
type Generate<S> = Box<dyn Fn(&<S as Stage>::Config) -> Result<(), BoxedDiagnostic> + Send + Sync>;

impl<S: Stage> ConfiguredStage<S> {
    /// Parses the options of a stage's table.
    fn read(table: InlineTable, parts: Arc<Parts<S>>) -> Result<Self, ConfigFault> {
        // Every such number is `null` in JSON, so that recipes with different ones would be equal.
        if let Some(fault) = not_finite(&table) {
            return Err(fault);
        }
        let deserializer = toml_edit::Value::InlineTable(table).into_deserializer();
        let options = S::Config::deserialize(deserializer).map_err(|err| ConfigFault {
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
            parts,
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

impl<S: Stage> StageWithConfig for ConfiguredStage<S> {
    fn options(&self) -> &dyn Any {
        &self.options
    }

    fn config(&self) -> Value {
        self.config.clone()
    }

    fn check(&self) -> Vec<OptionFault> {
        S::check(&self.options)
    }

    fn check_wired(&self, inputs: &BTreeMap<String, NodeName>) -> Vec<OptionFault> {
        S::check_wired(&self.options, inputs)
    }

    fn files(&self) -> &'static [&'static str] {
        S::FILES
    }

    fn check_files(&self) -> Vec<FileFault> {
        S::check_files(&self.options)
    }

    fn outputs(&self) -> Vec<OutputInfo> {
        let outputs = self.parts.outputs.iter();
        let named = outputs.map(|listed| {
            let OutputNames {
                artifact,
                schema,
                partition,
            } = listed.output.names(&self.options);
            OutputInfo {
                artifact,
                schema,
                partition,
                execution: listed.output.execution(&self.options),
                ..listed.info
            }
        });
        named.collect()
    }

    fn prepare(&self) -> Result<(), BoxedDiagnostic> {
        if let Some(generate) = &self.parts.generate {
            generate(&self.options)?;
        }
        S::prepare(&self.options)
    }

    fn units(&self, output_idx: usize, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let output = self.parts.outputs[output_idx].output;
        output.units(&self.options, scope)
    }

    fn make(
        &self,
        output_idx: usize,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome, BoxedDiagnostic> {
        let output = self.parts.outputs[output_idx].output;
        output.make(&self.options, inputs, cx)
    }

    fn summarize(
        &self,
        output_idx: usize,
        outcomes: &[&RecordOutcome],
    ) -> Result<(Summary, String), MissingMetric> {
        (self.parts.outputs[output_idx].line)(outcomes)
    }
}

impl Kind {
    /// Returns the kind of a stage with this [`code!`](macro@crate::code) and without a report: its outputs
    /// have their own lines.
    ///
    /// # Panics
    ///
    /// Panics if an output of the stage or its report has no line or two, or
    /// [`Output::OPTIONS`](crate::Output::OPTIONS) names an unknown option.
    pub fn of<S: Stage>(code: Code) -> Self {
        Self::new::<S>([code; 2], &[], Lines::new(), None)
    }

    /// Returns the kind of a stage with its report, by the code of each.
    ///
    /// # Panics
    ///
    /// Panics as [`Kind::of`] does.
    pub fn reported<R: Report>(codes: [Code; 2]) -> Self {
        Self::with_report::<R>(codes, None)
    }

    /// Returns the kind of a stage with its report, of which datasets may be generated: `generate`
    /// makes the one that the options name, before [`Stage::prepare`].
    ///
    /// Its code is not part of any fingerprint: files outside the lake are fingerprinted by their
    /// bytes.
    ///
    /// # Panics
    ///
    /// Panics as [`Kind::of`] does.
    pub fn generated<R: Report, E: Diagnostic>(
        codes: [Code; 2],
        generate: fn(&<R::Stage as Stage>::Config) -> Result<(), E>,
    ) -> Self {
        let generate: Generate<R::Stage> = Box::new(move |options| Ok(generate(options)?));
        Self::with_report::<R>(codes, Some(generate))
    }

    fn with_report<R: Report>(codes: [Code; 2], generate: Option<Generate<R::Stage>>) -> Self {
        let mut lines = Lines::new();
        R::lines(&mut lines);
        Self::new(codes, R::OUTPUTS, lines, generate)
    }

    /// Lists the outputs of a stage, then those of its report, each with its line.
    fn new<S: Stage>(
        [code, report_code]: [Code; 2],
        reports: Outputs<S>,
        mut lines: Lines<S>,
        generate: Option<Generate<S>>,
    ) -> Self {
        let results = S::OUTPUTS.iter().map(|output| (output, code));
        let reports = reports.iter().map(|output| (output, report_code));
        let listed = results.chain(reports).map(|(output, code)| {
            output.add_line(&mut lines);
            let info = output.info(code);
            let Some(line) = lines.take(*output) else {
                unreachable!("the output `{}` has no line", info.artifact);
            };
            KindOutput {
                info,
                output: *output,
                line,
            }
        });
        let parts = Arc::new(Parts {
            outputs: listed.collect(),
            generate,
        });
        let kind = Self {
            name: S::KIND,
            about: S::ABOUT,
            inputs: S::INPUTS.iter().map(|&input| input.to_owned()).collect(),
            optional_inputs: S::OPTIONAL_INPUTS,
            wiring: S::WIRING,
            example: S::EXAMPLE,
            outputs: parts.outputs.iter().map(|listed| listed.info).collect(),
            configure: Arc::new(move |table| {
                let configured = ConfiguredStage::<S>::read(table, Arc::clone(&parts))?;
                Ok(Box::new(configured) as Box<dyn StageWithConfig>)
            }),
            schema: || schemars::schema_for!(S::Config).to_value(),
            completion: None,
        };
        kind.check_declared(field_names::<S::Config>());
        kind
    }

    /// Checks that outputs name existing options: these fields, or those of the schema.
    fn check_declared(&self, fields: Option<&[&str]>) {
        let schema = LazyCell::new(|| self.schema());
        let exists = |option: &str| match fields {
            Some(fields) => fields.contains(&option),
            None => schema["properties"].get(option).is_some(),
        };
        for output in &self.outputs {
            for option in output.options.named() {
                assert!(
                    exists(option),
                    "`{}` is said to depend on `{option}`, which is not an option of `{}`",
                    output.artifact,
                    self.name
                );
            }
        }
    }

    /// Returns every artifact that it reads, those of [`Kind::optional_inputs`] last.
    pub fn all_inputs(&self) -> Vec<&str> {
        let inputs = self.inputs.iter().map(String::as_str);
        inputs.chain(self.optional_inputs.iter().copied()).collect()
    }

    /// Returns the kind, of whose options some may be left out where `complete` finds them in the file that the
    /// option `file` names.
    #[must_use]
    pub fn completed(
        mut self,
        options: &'static [&'static str],
        file: &'static str,
        complete: OptionCompletion,
    ) -> Self {
        self.completion = Some(Completion {
            options,
            file,
            complete,
        });
        self
    }

    /// Returns the option that names the file of an option, of one below it or of the table around it.
    pub(crate) fn file_of(&self, option: &str) -> Option<&'static str> {
        let completion = self.completion.as_ref()?;
        let is_in = |whole: &str, part: &str| {
            let rest = part.strip_prefix(whole);
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
        };
        let mut options = completion.options.iter();
        let found = options.any(|of| is_in(of, option) || is_in(option, of));
        found.then_some(completion.file)
    }

    /// Adds the options that files have and the stage's table leaves out.
    pub(crate) fn complete(&self, table: &mut InlineTable) -> Result<(), OptionFault> {
        let Some(completion) = &self.completion else {
            return Ok(());
        };
        let mut values = InlineTable::new();
        for (key, value) in (completion.complete)(table, completion.options)? {
            let words: Vec<String> = key.split('.').map(str::to_owned).collect();
            set_value(&mut values, &words, &value);
        }
        merge_values(&mut values, table);
        *table = values;
        Ok(())
    }

    pub(crate) fn configure(
        &self,
        table: InlineTable,
    ) -> Result<Box<dyn StageWithConfig>, ConfigFault> {
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
        for option in &mut options {
            let file = self.file_of(&option.key);
            if let Some(file) = file.filter(|_| option.default.is_none() && option.required) {
                option.required = false;
                option.default = Some(format!("from the {file}'s file"));
            }
        }
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
            range: range_of(property),
            required: required.contains(&name.as_str()),
        });
        collect_options(root, target, &key, options);
    }
}

/// The range that [`options::describe`] added to a schema: `from 1 to 100: …`.
fn range_of(schema: &Value) -> Option<String> {
    let why = schema.get("why")?.as_str()?;
    Some(format!("{}: {why}", options::range_in(schema)?))
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
    use crate::{code::Code, output::OptionsUsed, stage::Output, summary::Line};

    /// A stage with an option that cannot always be serialized.
    enum Fixture {}

    #[derive(Debug, Deserialize, serde::Serialize, schemars::JsonSchema)]
    struct Config {
        #[serde(default, serialize_with = "positive")]
        weights: Vec<f64>,
    }

    impl options::Options for Config {}

    fn positive<T: serde::Serializer>(weights: &[f64], serializer: T) -> Result<T::Ok, T::Error> {
        if weights.iter().any(|weight| *weight < 0.0) {
            return Err(serde::ser::Error::custom("a weight is negative"));
        }
        serializer.collect_seq(weights)
    }

    const CODE: Code = Code { parts: "" };

    #[derive(Debug, thiserror::Error)]
    #[error("it makes nothing")]
    struct Nothing;

    impl crate::Diagnostic for Nothing {
        fn hint(&self) -> Option<String> {
            None
        }
    }

    impl Stage for Fixture {
        type Config = Config;

        const KIND: &'static str = "fixture";
        const ABOUT: &'static str = "Makes nothing";
        const INPUTS: &'static [&'static str] = &[];
        const OUTPUTS: Outputs<Self> = &[];
    }

    /// A stage with one output: valid, with an unknown option, or without a line.
    struct Declared<const FAULT: u8>;

    impl<const FAULT: u8> Stage for Declared<FAULT> {
        type Config = Config;

        const KIND: &'static str = "declared";
        const ABOUT: &'static str = "Makes nothing";
        const INPUTS: &'static [&'static str] = &[];
        const OUTPUTS: Outputs<Self> = &[&Self];
    }

    impl<const FAULT: u8> Output for Declared<FAULT> {
        type Stage = Self;
        type Metrics = ();
        type Inputs<'a> = &'a Inputs;

        const ARTIFACT: &'static str = "nothing";
        const SCHEMA: &'static str = "nothing/1";
        const PARTITION: &'static str = "none";
        const OPTIONS: OptionsUsed = OptionsUsed::Except(if FAULT == 1 {
            &["wieghts"]
        } else {
            &["weights"]
        });
        const LINE: Option<Line<()>> = if FAULT == 2 {
            None
        } else {
            Some(|_| String::new())
        };

        fn units(_: &Config, _: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
            Err(Nothing.into())
        }

        fn make(_: &Config, _: &Inputs, _: &Context) -> Result<Outcome<()>, BoxedDiagnostic> {
            Err(Nothing.into())
        }
    }

    #[test]
    fn an_output_names_options_that_there_are_and_has_a_line() {
        let is_sound = |kind: fn() -> Kind| std::panic::catch_unwind(kind).is_ok();
        assert!(is_sound(|| Kind::of::<Declared<0>>(CODE)));
        assert!(!is_sound(|| Kind::of::<Declared<1>>(CODE)));
        assert!(!is_sound(|| Kind::of::<Declared<2>>(CODE)));
    }

    #[test]
    fn options_that_serialize_as_null_are_refused() {
        let read = |table: &str| {
            let table = table.parse::<toml_edit::Value>().unwrap();
            let table = table.as_inline_table().unwrap().clone();
            let configured = Kind::of::<Fixture>(CODE).configure(table);
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
