//! Stage kinds without their types, so that a pipeline can hold stages of every kind.

use std::{any::Any, ops::Range};

use serde::{Deserialize, de::IntoDeserializer};
use serde_json::Value;

use crate::{
    code::Code,
    context::{Context, Inputs},
    option_faults::OptionFault,
    stage::{Advised, Input, Labels, Outcome, Output, Scope, Stage},
    unit::{Summary, Unit},
};

/// One kind of stage: what `kind = "…"` in a pipeline file can name.
#[derive(Clone, Copy)]
pub struct Kind {
    /// The value of `kind`.
    pub name: &'static str,
    /// What it does, in one sentence.
    pub about: &'static str,
    /// The artifacts it reads.
    pub inputs: &'static [Input],
    /// The artifacts it makes.
    pub outputs: &'static [Output],
    pub(crate) code: Code,
    configure: fn(toml_edit::InlineTable) -> Result<Box<dyn Configured>, ConfigFault>,
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
    /// The configuration as the stage has it.
    fn options(&self) -> &dyn Any;
    /// The configuration without the paths of files that its units read.
    fn config(&self) -> Value;
    /// The configuration as it counts for the fingerprints of an output's units.
    fn config_of(&self, output: &str) -> Value;
    fn check(&self) -> Vec<OptionFault>;
    fn prepare(&self) -> Result<(), Advised>;
    fn units(&self, output: &str, scope: &Scope) -> Result<Vec<Unit>, Advised>;
    fn foretell(&self, output: &str, unit: &Unit, scope: &Scope) -> Option<Labels>;
    fn run(&self, inputs: &Inputs, cx: &Context) -> Result<Outcome, Advised>;
    fn describe(&self, output: &str, summary: &Summary) -> String;
}

/// What is wrong with a stage's table.
pub(crate) struct ConfigFault {
    pub(crate) message: String,
    pub(crate) span: Option<Range<usize>>,
}

struct WithConfig<S: Stage>(S::Config);

impl<S: Stage> Configured for WithConfig<S> {
    fn options(&self) -> &dyn Any {
        &self.0
    }

    fn config(&self) -> Value {
        serde_json::to_value(&self.0).unwrap_or(Value::Null)
    }

    fn config_of(&self, output: &str) -> Value {
        let mut config = self.config();
        if let Value::Object(options) = &mut config {
            options.retain(|option, _| S::decides(option, output));
        }
        config
    }

    fn check(&self) -> Vec<OptionFault> {
        S::check(&self.0)
    }

    fn prepare(&self) -> Result<(), Advised> {
        S::prepare(&self.0).map_err(Advised::from)
    }

    fn units(&self, output: &str, scope: &Scope) -> Result<Vec<Unit>, Advised> {
        S::units(&self.0, output, scope).map_err(Advised::from)
    }

    fn foretell(&self, output: &str, unit: &Unit, scope: &Scope) -> Option<Labels> {
        S::foretell(&self.0, output, unit, scope)
    }

    fn run(&self, inputs: &Inputs, cx: &Context) -> Result<Outcome, Advised> {
        S::run(&self.0, inputs, cx).map_err(Advised::from)
    }

    fn describe(&self, output: &str, summary: &Summary) -> String {
        S::describe(output, summary)
    }
}

impl Kind {
    /// Returns the kind that a stage type implements.
    pub fn of<S: Stage>() -> Self {
        Self {
            name: S::KIND,
            about: S::ABOUT,
            inputs: S::INPUTS,
            outputs: S::OUTPUTS,
            code: S::CODE,
            configure: |table| {
                let deserializer = toml_edit::Value::InlineTable(table).into_deserializer();
                S::Config::deserialize(deserializer)
                    .map(|config| Box::new(WithConfig::<S>(config)) as Box<dyn Configured>)
                    .map_err(|err| ConfigFault {
                        message: err.message().to_owned(),
                        span: err.span(),
                    })
            },
            schema: || schemars::schema_for!(S::Config).to_value(),
        }
    }

    pub(crate) fn configure(
        &self,
        table: toml_edit::InlineTable,
    ) -> Result<Box<dyn Configured>, ConfigFault> {
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
            // A table's is that of the options in it.
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
