//! Building and reading the columns of an artifact's record batch.

use std::{collections::HashMap, sync::Arc};

use arrow_array::{
    Array, ArrayRef, BooleanArray, FixedSizeListArray, Float64Array, Int64Array, ListArray,
    RecordBatch, StringArray,
    cast::AsArray,
    types::{Float64Type, Int64Type},
};
use arrow_buffer::OffsetBuffer;
use arrow_schema::{ArrowError, DataType, Field, FieldRef, Schema};
use nalgebra::{Unit, Vector3};
use spatial::{NotAPose, Pose, Rest};

/// Key of the schema's name and version in the file's metadata.
const SCHEMA_KEY: &str = "schema";

/// Key of the joints' names, separated by commas, in the file's metadata.
const JOINTS_KEY: &str = "joints";

/// Why a table is not what its schema says.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SchemaError {
    /// The table was written by another version.
    #[error("table has schema `{found}`, expected `{expected}`")]
    Version {
        /// The version of this program.
        expected: String,
        /// The version in the file.
        found: String,
    },
    /// A column is missing or has another type.
    #[error("column `{column}` is missing or not of type {expected}")]
    Column {
        /// The column's name.
        column: String,
        /// The type promised.
        expected: &'static str,
    },
    /// A number is NaN or infinite.
    #[error("column `{column}` holds a number that is not finite in row {row}")]
    NotFinite {
        /// The column's name.
        column: String,
        /// The row.
        row: usize,
    },
    /// There are too few or too many rows.
    #[error("table has {found} rows, expected {expected}")]
    Rows {
        /// What was expected.
        expected: &'static str,
        /// Rows found.
        found: usize,
    },
    /// A value breaks the artifact's own rules.
    #[error("column `{column}`: {message}")]
    Invalid {
        /// The column's name.
        column: String,
        /// What is wrong with it.
        message: String,
    },
    /// A value that should be a pose is none.
    #[error("column `{column}` does not hold a pose")]
    Pose {
        /// The column's name.
        column: String,
        /// Why.
        source: NotAPose,
    },
    /// The columns do not make a batch.
    #[error("columns do not fit together")]
    Arrow(#[from] ArrowError),
}

/// Columns in the making, each with its unit and description.
pub(crate) struct Columns {
    metadata: HashMap<String, String>,
    fields: Vec<FieldRef>,
    arrays: Vec<ArrayRef>,
    not_finite: Option<SchemaError>,
}

impl Columns {
    /// Starts the columns of a schema, e.g. `rollouts/1`.
    pub(crate) fn new(version: &str) -> Self {
        Self {
            metadata: HashMap::from([(SCHEMA_KEY.to_owned(), version.to_owned())]),
            fields: Vec::new(),
            arrays: Vec::new(),
            not_finite: None,
        }
    }

    /// Notes the joints' names.
    pub(crate) fn with_joints(mut self, joints: &[String]) -> Self {
        self.metadata
            .insert(JOINTS_KEY.to_owned(), joints.join(","));
        self
    }

    /// Notes a list of names that the rows' lists follow.
    pub(crate) fn with_names(mut self, key: &str, names: &[String]) -> Self {
        self.metadata.insert(key.to_owned(), names.join(","));
        self
    }

    pub(crate) fn utf8(&mut self, name: &str, about: &str, values: impl Iterator<Item = String>) {
        let array = StringArray::from_iter_values(values);
        self.push(name, None, about, Arc::new(array));
    }

    pub(crate) fn bool(&mut self, name: &str, about: &str, values: impl Iterator<Item = bool>) {
        let array: BooleanArray = values.map(Some).collect();
        self.push(name, None, about, Arc::new(array));
    }

    pub(crate) fn i64(&mut self, name: &str, about: &str, values: impl Iterator<Item = i64>) {
        let array = Int64Array::from_iter_values(values);
        self.push(name, Some("1"), about, Arc::new(array));
    }

    pub(crate) fn f64(
        &mut self,
        name: &str,
        unit: &str,
        about: &str,
        values: impl Iterator<Item = f64>,
    ) {
        let values: Vec<f64> = values.collect();
        self.check(
            name,
            values.iter().enumerate().map(|(row, &value)| (row, value)),
        );
        self.push(
            name,
            Some(unit),
            about,
            Arc::new(Float64Array::from(values)),
        );
    }

    /// One array of `N` numbers per row.
    pub(crate) fn f64_array<const N: usize>(
        &mut self,
        name: &str,
        unit: &str,
        about: &str,
        rows: impl Iterator<Item = [f64; N]>,
    ) {
        let rows: Vec<[f64; N]> = rows.collect();
        self.check(
            name,
            rows.iter()
                .enumerate()
                .flat_map(|(row, values)| values.iter().map(move |&value| (row, value))),
        );
        let array = fixed_size_list(&rows);
        self.push(name, Some(unit), about, Arc::new(array));
    }

    /// How the object of each row lay, in two columns.
    pub(crate) fn rest(&mut self, rests: impl Iterator<Item = Rest> + Clone) {
        let ups = rests.clone().map(|rest| rest.up_in_object.into_inner());
        self.f64_array(
            "rest_up",
            "1",
            "unit vector against gravity, object frame",
            ups.map(<[f64; 3]>::from),
        );
        self.f64(
            "rest_height_m",
            "m",
            "height of the object's origin above the table",
            rests.map(|rest| rest.height_m),
        );
    }

    /// One list of numbers per row.
    pub(crate) fn f64_list(
        &mut self,
        name: &str,
        unit: &str,
        about: &str,
        rows: impl Iterator<Item = Vec<f64>>,
    ) {
        let rows: Vec<Vec<f64>> = rows.collect();
        self.check(
            name,
            rows.iter()
                .enumerate()
                .flat_map(|(row, values)| values.iter().map(move |&value| (row, value))),
        );
        let values = Float64Array::from(rows.concat());
        let array = list(rows.iter().map(Vec::len), Arc::new(values));
        self.push(name, Some(unit), about, Arc::new(array));
    }

    /// One list of arrays of `N` numbers per row.
    pub(crate) fn f64_arrays<const N: usize>(
        &mut self,
        name: &str,
        unit: &str,
        about: &str,
        rows: impl Iterator<Item = Vec<[f64; N]>>,
    ) {
        let rows: Vec<Vec<[f64; N]>> = rows.collect();
        self.check(
            name,
            rows.iter().enumerate().flat_map(|(row, arrays)| {
                arrays.as_flattened().iter().map(move |&value| (row, value))
            }),
        );
        let values = fixed_size_list(&rows.concat());
        let array = list(rows.iter().map(Vec::len), Arc::new(values));
        self.push(name, Some(unit), about, Arc::new(array));
    }

    /// One list of whole numbers per row.
    pub(crate) fn i64_list(
        &mut self,
        name: &str,
        about: &str,
        rows: impl Iterator<Item = Vec<i64>>,
    ) {
        let rows: Vec<Vec<i64>> = rows.collect();
        let values = Int64Array::from(rows.concat());
        let array = list(rows.iter().map(Vec::len), Arc::new(values));
        self.push(name, Some("1"), about, Arc::new(array));
    }

    fn check(&mut self, name: &str, mut numbers: impl Iterator<Item = (usize, f64)>) {
        if self.not_finite.is_none() {
            self.not_finite = numbers
                .find(|(_, number)| !number.is_finite())
                .map(|(row, _)| SchemaError::NotFinite {
                    column: name.to_owned(),
                    row,
                });
        }
    }

    fn push(&mut self, name: &str, unit: Option<&str>, about: &str, array: ArrayRef) {
        let mut metadata = HashMap::from([("description".to_owned(), about.to_owned())]);
        if let Some(unit) = unit {
            metadata.insert("unit".to_owned(), unit.to_owned());
        }
        let field = Field::new(name, array.data_type().clone(), false).with_metadata(metadata);
        self.fields.push(Arc::new(field));
        self.arrays.push(array);
    }

    pub(crate) fn schema(&self) -> Schema {
        Schema::new_with_metadata(self.fields.clone(), self.metadata.clone())
    }

    pub(crate) fn into_batch(self) -> Result<RecordBatch, SchemaError> {
        let schema = Arc::new(self.schema());
        match self.not_finite {
            Some(err) => Err(err),
            None => Ok(RecordBatch::try_new(schema, self.arrays)?),
        }
    }
}

/// A count as it is stored; no count in memory is larger than the largest `i64`.
pub(crate) fn count(n: usize) -> i64 {
    i64::try_from(n).unwrap_or(i64::MAX)
}

fn item(data_type: DataType) -> FieldRef {
    Arc::new(Field::new("item", data_type, false))
}

fn fixed_size_list<const N: usize>(rows: &[[f64; N]]) -> FixedSizeListArray {
    let size = i32::try_from(N).unwrap_or(i32::MAX);
    let values = Float64Array::from(rows.as_flattened().to_vec());
    FixedSizeListArray::new(item(DataType::Float64), size, Arc::new(values), None)
}

fn list(lengths: impl IntoIterator<Item = usize>, values: ArrayRef) -> ListArray {
    let field = item(values.data_type().clone());
    ListArray::new(field, OffsetBuffer::from_lengths(lengths), values, None)
}

/// Reads the columns of one version of a schema by name.
pub(crate) struct Reader<'a> {
    batch: &'a RecordBatch,
}

impl<'a> Reader<'a> {
    /// Refuses a batch of another schema or version.
    pub(crate) fn new(batch: &'a RecordBatch, version: &str) -> Result<Self, SchemaError> {
        let schema = batch.schema_ref();
        let found = schema.metadata().get(SCHEMA_KEY).map_or("", String::as_str);
        if found == version {
            Ok(Self { batch })
        } else {
            Err(SchemaError::Version {
                expected: version.to_owned(),
                found: found.to_owned(),
            })
        }
    }

    pub(crate) fn rows(&self) -> usize {
        self.batch.num_rows()
    }

    pub(crate) fn expect_rows(&self, expected: usize) -> Result<(), SchemaError> {
        if self.rows() == expected {
            Ok(())
        } else {
            Err(SchemaError::Rows {
                expected: "one",
                found: self.rows(),
            })
        }
    }

    pub(crate) fn expect_some_rows(&self) -> Result<(), SchemaError> {
        if self.rows() > 0 {
            Ok(())
        } else {
            Err(SchemaError::Rows {
                expected: "at least one",
                found: 0,
            })
        }
    }

    /// Returns the error for a value that breaks the artifact's own rules.
    #[expect(
        clippy::unused_self,
        reason = "reads as part of the reader at its callers"
    )]
    pub(crate) fn invalid(&self, column: &str, message: String) -> SchemaError {
        SchemaError::Invalid {
            column: column.to_owned(),
            message,
        }
    }

    pub(crate) fn joints(&self) -> Result<Vec<String>, SchemaError> {
        let joints = self
            .batch
            .schema_ref()
            .metadata()
            .get(JOINTS_KEY)
            .map(|names| names.split(',').map(str::to_owned).collect::<Vec<_>>())
            .unwrap_or_default();
        if joints.iter().any(String::is_empty) || joints.is_empty() {
            return Err(self.invalid(JOINTS_KEY, "the metadata names no joints".to_owned()));
        }
        Ok(joints)
    }

    /// Returns a list of names from the metadata; none if they are not noted.
    pub(crate) fn names(&self, key: &str) -> Vec<String> {
        let names = self.batch.schema_ref().metadata().get(key);
        names
            .map(|names| {
                names
                    .split(',')
                    .filter(|name| !name.is_empty())
                    .map(str::to_owned)
            })
            .into_iter()
            .flatten()
            .collect()
    }

    pub(crate) fn utf8(&self, name: &str, row: usize) -> Result<&'a str, SchemaError> {
        let array = self.column(name, "utf8")?.as_string_opt::<i32>();
        Ok(self.present(array, name, "utf8")?.value(row))
    }

    pub(crate) fn bool(&self, name: &str, row: usize) -> Result<bool, SchemaError> {
        let array = self.column(name, "bool")?.as_boolean_opt();
        Ok(self.present(array, name, "bool")?.value(row))
    }

    pub(crate) fn i64(&self, name: &str, row: usize) -> Result<i64, SchemaError> {
        let array = self.column(name, "i64")?.as_primitive_opt::<Int64Type>();
        Ok(self.present(array, name, "i64")?.value(row))
    }

    pub(crate) fn u32(&self, name: &str, row: usize) -> Result<u32, SchemaError> {
        u32::try_from(self.i64(name, row)?).map_err(|err| self.invalid(name, err.to_string()))
    }

    pub(crate) fn f64(&self, name: &str, row: usize) -> Result<f64, SchemaError> {
        let array = self.column(name, "f64")?.as_primitive_opt::<Float64Type>();
        Ok(self.present(array, name, "f64")?.value(row))
    }

    pub(crate) fn f64_array<const N: usize>(
        &self,
        name: &str,
        row: usize,
    ) -> Result<[f64; N], SchemaError> {
        let array = self
            .column(name, "a fixed list of f64")?
            .as_fixed_size_list_opt();
        let values = self.present(array, name, "a fixed list of f64")?.value(row);
        let values = values.as_primitive_opt::<Float64Type>();
        let values = self.present(values, name, "a fixed list of f64")?.values();
        <[f64; N]>::try_from(&values[..]).map_err(|err| {
            self.invalid(
                name,
                format!("{} numbers, expected {N}: {err}", values.len()),
            )
        })
    }

    pub(crate) fn f64_list(&self, name: &str, row: usize) -> Result<Vec<f64>, SchemaError> {
        let values = self.list(name, row)?;
        let values = values.as_primitive_opt::<Float64Type>();
        Ok(self
            .present(values, name, "a list of f64")?
            .values()
            .to_vec())
    }

    pub(crate) fn i64_list(&self, name: &str, row: usize) -> Result<Vec<i64>, SchemaError> {
        let values = self.list(name, row)?;
        let values = values.as_primitive_opt::<Int64Type>();
        Ok(self
            .present(values, name, "a list of i64")?
            .values()
            .to_vec())
    }

    pub(crate) fn f64_arrays<const N: usize>(
        &self,
        name: &str,
        row: usize,
    ) -> Result<Vec<[f64; N]>, SchemaError> {
        let expected = "a list of fixed lists of f64";
        let rows = self.list(name, row)?;
        let rows = self.present(rows.as_fixed_size_list_opt(), name, expected)?;
        if usize::try_from(rows.value_length()) != Ok(N) {
            return Err(self.invalid(
                name,
                format!("lists of {} numbers, expected {N}", rows.value_length()),
            ));
        }
        // A slice of a fixed list keeps its values' offset, so each row is read on its own.
        (0..rows.len())
            .map(|row| {
                let values = rows.value(row);
                let values =
                    self.present(values.as_primitive_opt::<Float64Type>(), name, expected)?;
                <[f64; N]>::try_from(&values.values()[..])
                    .map_err(|err| self.invalid(name, err.to_string()))
            })
            .collect()
    }

    /// Reads `expected` joint positions.
    pub(crate) fn joint_positions(
        &self,
        name: &str,
        row: usize,
        expected: usize,
    ) -> Result<Vec<f64>, SchemaError> {
        let positions = self.f64_list(name, row)?;
        if positions.len() == expected {
            Ok(positions)
        } else {
            Err(self.invalid(
                name,
                format!("{} joint positions, expected {expected}", positions.len()),
            ))
        }
    }

    /// Reads what [`Columns::rest`] wrote.
    pub(crate) fn rest(&self, row: usize) -> Result<Rest, SchemaError> {
        let up: [f64; 3] = self.f64_array("rest_up", row)?;
        Ok(Rest {
            up_in_object: Unit::new_normalize(Vector3::from(up)),
            height_m: self.f64("rest_height_m", row)?,
        })
    }

    /// Reads seven numbers as a pose.
    #[expect(
        clippy::unused_self,
        reason = "reads as part of the reader at its callers"
    )]
    pub(crate) fn pose<To, From>(
        &self,
        name: &str,
        numbers: [f64; 7],
    ) -> Result<Pose<To, From>, SchemaError> {
        Pose::from_array(numbers).map_err(|source| SchemaError::Pose {
            column: name.to_owned(),
            source,
        })
    }

    fn list(&self, name: &str, row: usize) -> Result<ArrayRef, SchemaError> {
        let array = self.column(name, "a list")?.as_list_opt::<i32>();
        Ok(self.present(array, name, "a list")?.value(row))
    }

    fn column(&self, name: &str, expected: &'static str) -> Result<&'a ArrayRef, SchemaError> {
        self.batch
            .column_by_name(name)
            .ok_or_else(|| SchemaError::Column {
                column: name.to_owned(),
                expected,
            })
    }

    #[expect(
        clippy::unused_self,
        reason = "reads as part of the reader at its callers"
    )]
    fn present<T>(
        &self,
        array: Option<T>,
        name: &str,
        expected: &'static str,
    ) -> Result<T, SchemaError> {
        array.ok_or_else(|| SchemaError::Column {
            column: name.to_owned(),
            expected,
        })
    }
}
