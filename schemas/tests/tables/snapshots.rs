//! The columns of every version: `schemas/snapshots/NAME-VERSION.snap`.

use std::{
    collections::BTreeSet,
    fmt::{Debug, Write},
};

use arrow_schema::{DataType, Schema};
use schemas::Table;

use crate::filled::{self, EachTable};

/// Instruction shown when the columns differ from those of the version.
const HINT: &str = "columns differ from those of this version: raise the VERSION of the table, then keep \
                    the snapshot of the new one with `INSTA_UPDATE=unseen cargo test -p schemas`";

#[test]
fn a_changed_column_is_a_new_version() {
    struct Compared;
    impl EachTable for Compared {
        fn table<T: Table + PartialEq + Debug>(&self, _key: &str, table: &T) {
            let (name, version) = T::VERSION.split_once('/').unwrap();
            assert_eq!(name, T::NAME);
            let mut settings = insta::Settings::new();
            settings.set_snapshot_path("../../snapshots");
            settings.set_prepend_module_to_snapshot(false);
            settings.set_omit_expression(true);
            settings.set_description(HINT);
            let columns = columns(&table.to_batch().unwrap().schema());
            settings.bind(|| insta::assert_snapshot!(format!("{name}-{version}"), columns));
        }
    }
    filled::each(&Compared);
}

/// Returns the columns as a Markdown table, after the keys of the file's metadata.
fn columns(schema: &Schema) -> String {
    let notes: BTreeSet<&str> = schema.metadata().keys().map(String::as_str).collect();
    let notes = notes.into_iter().collect::<Vec<_>>().join(", ");
    let mut text = format!("{}\n\nmetadata: {notes}\n\n", schema.metadata()["schema"]);
    text += "| column | type | unit | meaning |\n| --- | --- | --- | --- |\n";
    for field in schema.fields() {
        let note = |key: &str| field.metadata().get(key).map_or("", String::as_str);
        let (name, mut data_type) = (field.name(), type_name(field.data_type()));
        if field.is_nullable() {
            data_type += " or null";
        }
        let (unit, meaning) = (note("unit"), note("description"));
        writeln!(text, "| `{name}` | {data_type} | {unit} | {meaning} |").unwrap();
    }
    text
}

fn type_name(data_type: &DataType) -> String {
    match data_type {
        DataType::Utf8 => "utf8".to_owned(),
        DataType::Boolean => "bool".to_owned(),
        DataType::Int64 => "i64".to_owned(),
        DataType::Float64 => "f64".to_owned(),
        DataType::FixedSizeList(item, size) => format!("{} × {size}", type_name(item.data_type())),
        DataType::List(item) => format!("list of {}", type_name(item.data_type())),
        other => other.to_string(),
    }
}
