//! The engine, as questions use it: one thread, a fixed order of rows, and the functions that are known to mean
//! what they mean elsewhere.

use std::{collections::BTreeSet, sync::Arc};

use datafusion::{
    arrow::compute::concat_batches,
    common::{Result, TableReference},
    datasource::TableProvider,
    execution::{SessionStateBuilder, SessionStateDefaults, session_state::SessionState},
    logical_expr::{AggregateUDF, ScalarUDF},
    optimizer::{Analyzer, Optimizer},
    physical_optimizer::optimizer::PhysicalOptimizer,
    physical_plan::collect,
    prelude::{SessionConfig, SessionContext},
    sql::{parser::Statement, sqlparser::ast},
};

use super::{
    answer::Answer, lists::Simplify, meaning::Meaning, quantile::Quantile, texts::Texts,
    truths::OfTruths,
};

/// Functions of single values.
const SCALARS: [&str; 85] = [
    "abs",
    "acos",
    "acosh",
    "array_distinct",
    "array_element",
    "array_has",
    "array_length",
    "array_max",
    "array_min",
    "array_sum",
    "array_to_string",
    "ascii",
    "asin",
    "asinh",
    "atan",
    "atan2",
    "atanh",
    "btrim",
    "cardinality",
    "cbrt",
    "ceil",
    "character_length",
    "chr",
    "coalesce",
    "concat",
    "concat_ws",
    "contains",
    "cos",
    "cosh",
    "cot",
    "current_date",
    "date_part",
    "date_trunc",
    "degrees",
    "ends_with",
    "exp",
    "factorial",
    "floor",
    "gcd",
    "get_field",
    "greatest",
    "isnan",
    "lcm",
    "least",
    "left",
    "levenshtein",
    "ln",
    "log",
    "log10",
    "log2",
    "lower",
    "lpad",
    "ltrim",
    "make_array",
    "make_date",
    "now",
    "nullif",
    "nvl",
    "pi",
    "power",
    "radians",
    "regexp_like",
    "regexp_replace",
    "repeat",
    "replace",
    "reverse",
    "right",
    "round",
    "rpad",
    "rtrim",
    "signum",
    "sin",
    "sinh",
    "split_part",
    "sqrt",
    "starts_with",
    "strpos",
    "substr",
    "tan",
    "tanh",
    "to_char",
    "to_timestamp",
    "translate",
    "trunc",
    "upper",
];

/// Functions of single values that have other names elsewhere.
const OTHER_NAMES: [(&str, &str); 4] = [
    ("array_length", "len"),
    ("regexp_like", "regexp_matches"),
    ("signum", "sign"),
    ("to_char", "strftime"),
];

/// Functions of many rows that have other names elsewhere.
const OTHER_AGGREGATES: [(&str, &str); 9] = [
    ("array_agg", "list"),
    ("first_value", "first"),
    ("last_value", "last"),
    ("stddev", "stdev"),
    ("string_agg", "group_concat"),
    ("string_agg", "listagg"),
    ("var", "variance"),
    ("covar_samp", "covar"),
    ("any_value", "arbitrary"),
];

/// Functions of many rows.
const AGGREGATES: [&str; 26] = [
    "any_value",
    "array_agg",
    "avg",
    "bool_and",
    "bool_or",
    "corr",
    "count",
    "covar_pop",
    "covar_samp",
    "first_value",
    "grouping",
    "last_value",
    "max",
    "median",
    "min",
    "nth_value",
    "regr_count",
    "regr_intercept",
    "regr_r2",
    "regr_slope",
    "stddev",
    "stddev_pop",
    "string_agg",
    "sum",
    "var",
    "var_pop",
];

/// Answers questions.
pub(super) struct Engine {
    context: SessionContext,
}

impl Engine {
    pub(super) fn new() -> Self {
        let mut config = SessionConfig::new()
            .with_target_partitions(1)
            .with_information_schema(false);
        let parser = &mut config.options_mut().sql_parser;
        parser.enable_ident_normalization = false;
        parser.map_string_types_to_utf8view = false;
        "nulls_last".clone_into(&mut parser.default_null_ordering);
        let mut rules = Analyzer::new().rules;
        rules.insert(0, Arc::new(Meaning));
        rules.push(Arc::new(Texts));
        let mut reductions = Optimizer::new().rules;
        for rule in &mut reductions {
            if rule.name() == "simplify_expressions" {
                *rule = Arc::new(Simplify::default());
            }
        }
        // This one takes conditions below joins by the names of columns, which both sides may have.
        let mut steps = PhysicalOptimizer::new().rules;
        steps.retain(|rule| !rule.name().starts_with("FilterPushdown"));
        let state = SessionStateBuilder::new()
            .with_config(config)
            .with_expr_planners(SessionStateDefaults::default_expr_planners())
            .with_scalar_functions(scalars())
            .with_aggregate_functions(aggregates())
            .with_window_functions(SessionStateDefaults::default_window_functions())
            .with_analyzer_rules(rules)
            .with_optimizer_rules(reductions)
            .with_physical_optimizer_rules(steps)
            .build();
        Self {
            context: SessionContext::new_with_state(state),
        }
    }

    /// Adds a table.
    pub(super) fn add(&self, name: &str, table: Arc<dyn TableProvider>) -> Result<()> {
        let reference = TableReference::bare(name);
        self.context.register_table(reference, table).map(drop)
    }

    /// Answers a statement.
    pub(super) fn answer(&self, statement: ast::Statement) -> Result<Answer> {
        answer(&self.context.state(), statement)
    }
}

fn answer(state: &SessionState, statement: ast::Statement) -> Result<Answer> {
    let runtime = tokio::runtime::Builder::new_current_thread().build()?;
    runtime.block_on(async {
        let plan = state
            .statement_to_plan(Statement::Statement(Box::new(statement)))
            .await?;
        let names = plan.schema().iter().map(|(table, field)| {
            let table = table.map(|table| table.table().to_owned());
            (field.name().clone(), table)
        });
        let names = names.collect();
        let steps = state.create_physical_plan(&plan).await?;
        let schema = steps.schema();
        let rows = collect(steps, state.task_ctx()).await?;
        Ok(Answer {
            names,
            rows: concat_batches(&schema, &rows)?,
        })
    })
}

/// Whether a function is one of many rows.
pub(super) fn is_aggregate(name: &str) -> bool {
    aggregates().iter().any(|function| {
        function.name() == name || function.aliases().iter().any(|alias| alias == name)
    })
}

/// Names of all functions.
pub(super) fn functions() -> Vec<String> {
    let scalars = scalars()
        .into_iter()
        .map(|function| function.name().to_owned());
    let aggregates = aggregates()
        .into_iter()
        .map(|function| function.name().to_owned());
    let windows = SessionStateDefaults::default_window_functions().into_iter();
    let windows = windows.map(|function| function.name().to_owned());
    let names: BTreeSet<String> = scalars.chain(aggregates).chain(windows).collect();
    names.into_iter().collect()
}

fn scalars() -> Vec<Arc<ScalarUDF>> {
    let known = SessionStateDefaults::default_scalar_functions().into_iter();
    let known = known.filter(|function| SCALARS.contains(&function.name()));
    let named = known.map(|function| {
        let others = others(function.name(), &OTHER_NAMES);
        if others.is_empty() {
            return function;
        }
        Arc::new(Arc::unwrap_or_clone(function).with_aliases(others))
    });
    named.collect()
}

/// The other names of a function.
fn others(function: &str, known: &[(&'static str, &'static str)]) -> Vec<&'static str> {
    let others = known.iter().filter(|(name, _)| *name == function);
    others.map(|(_, other)| *other).collect()
}

fn aggregates() -> Vec<Arc<AggregateUDF>> {
    let known = SessionStateDefaults::default_aggregate_functions().into_iter();
    let known = known.filter(|function| AGGREGATES.contains(&function.name()));
    let named = known.map(|function| {
        if ["sum", "avg"].contains(&function.name()) {
            let function = OfTruths::new(Arc::unwrap_or_clone(function));
            return Arc::new(AggregateUDF::new_from_impl(function));
        }
        let others = others(function.name(), &OTHER_AGGREGATES);
        if others.is_empty() {
            return function;
        }
        Arc::new(Arc::unwrap_or_clone(function).with_aliases(others))
    });
    let quantile = AggregateUDF::new_from_impl(Quantile::new());
    named.chain([Arc::new(quantile)]).collect()
}
