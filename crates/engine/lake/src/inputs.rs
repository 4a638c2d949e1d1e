//! What a unit reads, declared as a type.

#[doc(hidden)]
pub use dataflow;
use dataflow::{Artifact, InputError, Inputs, PartitionKey, Scope, Unit};
#[doc(hidden)]
pub use schemas;
use schemas::Table;

use crate::{LakeError, ReadInputs};

/// Declares what each unit of an output reads.
///
/// The struct's fields are the inputs, loaded. The first says which units there are:
///
/// | first field | units |
/// | --- | --- |
/// | `each candidates: Candidates` | one for every partition of the input, with a label named like the kind of item in it |
/// | `group trajectories: Trajectory, by "object"` | one for every value of the partitions' label, which reads all partitions with it |
/// | `with given: GraspInputs` | those of other declared inputs, which are read, too |
///
/// The text after it completes `there are no candidates …` where the input has no partition; without the text there
/// are no units then. Each further field says which partitions of another input a unit reads:
///
/// | further field | partitions | value |
/// | --- | --- | --- |
/// | `own object: Object, or "object missing"` | the one with the unit's key; without it the unit is skipped with the reason after `or` | `Object` |
/// | `the networks: …` | the only one | its value |
/// | `all trajectories: Trajectory` | all | `Vec<Trajectory>` |
/// | `labeled trajectories: Trajectory, by "object"` | those whose label is the unit's key | `Vec<Trajectory>` |
/// | `maybe field: …` | those that the stage adds to the unit, at most one | `Option` of its value |
/// | `added trajectories: Trajectory` | those that the stage adds to the unit | `Vec<Trajectory>` |
/// | `others objects: Object` | those that the stage adds to the unit, except the one with the unit's key | `Vec<Object>` |
///
/// Names in brackets restrict the files that are read. A value that is not the input's table is made of an artifact
/// of the table after `=`, or of the name in parentheses after it, by a function. Below `files` are values made of
/// what else the unit reads, such as its files outside the lake.
///
/// The struct is an output's [`Inputs`](dataflow::Output::Inputs). It has `INPUTS`, the names of its inputs,
/// and `units`, which lists the units that an option names, all if it names none.
///
/// ```
/// use lake::ReadArtifact;
/// use schemas::{candidates::Candidates, objects::{self, Object}};
///
/// lake::inputs! {
///     /// What a unit reads: an object's motions, and its mesh.
///     struct MotionInputs {
///         /// The motions.
///         each candidates: Candidates [lake::table::FILE], "to look at";
///         /// The object's mesh.
///         own mesh: String = Object, |object| object.text(objects::MESH), or "object missing";
///     }
/// }
///
/// assert_eq!(MotionInputs::INPUTS, ["candidates", "objects"]);
/// let nothing = MotionInputs::units(&dataflow::Scope::default(), &[]).unwrap_err();
/// assert_eq!(nothing.to_string(), "there are no candidates to look at");
/// ```
#[macro_export]
macro_rules! inputs {
    (@name $type:ty) => { <$type as $crate::inputs::schemas::Table>::NAME };
    (@name $type:ty, ($name:expr)) => { $name };
    (@name $type:ty, $input:ty) => { <$input as $crate::inputs::schemas::Table>::NAME };
    (@read $type:ty) => { $crate::table::read };
    (@read $type:ty, $input:tt, $read:expr) => { $read };
    // The first field.
    (@names each $type:ty) => { &[$crate::inputs!(@name $type)] };
    (@names group $type:ty) => { &[$crate::inputs!(@name $type)] };
    (@names with $type:ty) => { <$type>::INPUTS };
    (@key each $type:ty) => { $type };
    (@key group $type:ty) => { Vec<$type> };
    (@key with $type:ty) => { $type };
    (@units each $type:ty, $scope:ident, $names:ident, $to_do:expr) => {
        $crate::inputs::each::<$type>($scope, $names, $to_do)?
    };
    (@units group $type:ty, $scope:ident, $names:ident, $to_do:expr, $by:literal) => {
        $crate::inputs::grouped::<$type>($scope, $by, $names, $to_do)?
    };
    (@units with $type:ty, $scope:ident, $names:ident, $to_do:expr) => {
        <$type>::units($scope, $names)?
    };
    (@load each $type:ty, $inputs:ident, $key:ident) => {
        $crate::table::read::<$type>($crate::inputs::own($inputs, $crate::inputs!(@name $type), $key)?)?
    };
    (@load group $type:ty, $inputs:ident, $key:ident) => {
        $crate::ReadInputs::all::<$type>($inputs)?
    };
    (@load with $type:ty, $inputs:ident, $key:ident) => {
        match <$type as $crate::inputs::dataflow::UnitInputs>::read($inputs, $key)? {
            Ok(inputs) => inputs,
            Err(reason) => return Ok(Err(reason)),
        }
    };
    // The further fields.
    (@type own $type:ty) => { $type };
    (@type the $type:ty) => { $type };
    (@type maybe $type:ty) => { Option<$type> };
    (@type $many:ident $type:ty) => { Vec<$type> };
    (@add own $unit:ident, $name:ident, $scope:ident) => { $unit.reading_own($name, $scope) };
    (@add labeled $unit:ident, $name:ident, $scope:ident, $by:literal) => {
        $crate::inputs::labeled($unit, $name, $scope, $by)
    };
    (@add the $unit:ident, $name:ident, $scope:ident) => {
        $unit.reading($name, $scope.partitions($name).iter().map(|one| &one.key))
    };
    (@add all $unit:ident, $name:ident, $scope:ident) => {
        $unit.reading($name, $scope.partitions($name).iter().map(|one| &one.key))
    };
    (@add $added:ident $unit:ident, $name:ident, $scope:ident) => { $unit };
    (@value own $inputs:ident, $key:ident, $name:expr, $read:expr) => {
        $crate::inputs::one($inputs, $name, $read)?
    };
    (@value the $inputs:ident, $key:ident, $name:expr, $read:expr) => {
        $crate::inputs::one($inputs, $name, $read)?
    };
    (@value maybe $inputs:ident, $key:ident, $name:expr, $read:expr) => {
        $crate::inputs::optional($inputs, $name, $read)?
    };
    (@value others $inputs:ident, $key:ident, $name:expr, $read:expr) => {
        $crate::inputs::others($inputs, $name, $key, $read)?
    };
    (@value $many:ident $inputs:ident, $key:ident, $name:expr, $read:expr) => {
        $crate::inputs::all($inputs, $name, $read)?
    };
    (@to_do $to_do:literal) => { Some($to_do) };
    (@to_do) => { None };
    (
        $(#[$about:meta])*
        $vis:vis struct $struct:ident {
            $(#[$key_about:meta])*
            $kind:ident $key:ident: $keyed:ty $([$($key_file:expr),+])? $(, by $key_by:literal)? $(, $to_do:literal)?;
            $(
                $(#[$field_about:meta])*
                $mode:ident $field:ident: $type:ty
                    $([$file:expr])? $(= $input:tt, $read:expr)? $(, by $by:literal)? $(, or $reason:literal)?;
            )*
        }
        $(files {
            $($(#[$load_about:meta])* $loaded:ident: $loaded_type:ty = $load:expr;)*
        })?
    ) => {
        $(#[$about])*
        $vis struct $struct {
            $(#[$key_about])*
            $vis $key: $crate::inputs!(@key $kind $keyed),
            $($(#[$field_about])* $vis $field: $crate::inputs!(@type $mode $type),)*
            $($($(#[$load_about])* $vis $loaded: $loaded_type,)*)?
        }

        impl $struct {
            /// The names of the inputs.
            $vis const INPUTS: &'static [&'static str] = &$crate::inputs::joined::<{
                const FIRST: &[&str] = $crate::inputs!(@names $kind $keyed);
                const FURTHER: &[&str] = &[$($crate::inputs!(@name $type $(, $input)?)),*];
                FIRST.len() + FURTHER.len()
            }>(
                $crate::inputs!(@names $kind $keyed),
                &[$($crate::inputs!(@name $type $(, $input)?)),*],
            );

            /// Lists the units that an option names, all if it names none.
            ///
            /// # Errors
            ///
            /// Fails if there is none, or the option names one that there is not.
            $vis fn units(
                scope: &$crate::inputs::dataflow::Scope,
                names: &[String],
            ) -> Result<
                Vec<$crate::inputs::dataflow::Unit>,
                $crate::inputs::dataflow::InputError,
            > {
                let units = $crate::inputs!(
                    @units $kind $keyed, scope, names, $crate::inputs!(@to_do $($to_do)?)
                    $(, $key_by)?
                );
                let unit = |unit: $crate::inputs::dataflow::Unit| {
                    $(let unit = unit.only_files($crate::inputs!(@name $keyed), [$($key_file),+]);)?
                    $(
                        let name = $crate::inputs!(@name $type $(, $input)?);
                        let unit = $crate::inputs!(@add $mode unit, name, scope $(, $by)?);
                        $(let unit = unit.only_files(name, [$file]);)?
                        let _ = name;
                    )*
                    unit
                };
                Ok(units.into_iter().map(unit).collect())
            }
        }

        impl $crate::inputs::dataflow::UnitInputs<'_> for $struct {
            fn read(
                inputs: &$crate::inputs::dataflow::Inputs,
                key: &$crate::inputs::dataflow::PartitionKey,
            ) -> Result<Result<Self, String>, $crate::inputs::dataflow::BoxedDiagnostic> {
                $(
                    let name = $crate::inputs!(@name $type $(, $input)?);
                    $(
                        if inputs.artifacts(name).is_empty() {
                            return Ok(Err($reason.to_owned()));
                        }
                    )?
                    let _ = name;
                )*
                let _ = key;
                Ok(Ok(Self {
                    $key: $crate::inputs!(@load $kind $keyed, inputs, key),
                    $($field: $crate::inputs!(
                        @value $mode inputs, key, $crate::inputs!(@name $type $(, $input)?),
                        $crate::inputs!(@read $type $(, $input, $read)?)
                    ),)*
                    $($($loaded: ($load)(inputs)?,)*)?
                }))
            }
        }
    };
}

/// Makes a value of an artifact.
type Read<T> = fn(&Artifact) -> Result<T, LakeError>;

/// Lists a unit for each partition that an option names.
#[doc(hidden)]
pub fn each<T: Table>(
    scope: &Scope,
    names: &[String],
    to_do: Option<&'static str>,
) -> Result<Vec<Unit>, InputError> {
    if let Some(to_do) = to_do {
        scope.non_empty(T::NAME, to_do)?;
    }
    let chosen = scope.chosen(T::NAME, T::PARTITION, names)?.into_iter();
    let unit = |partition: &dataflow::Partition| {
        Unit::new(&partition.key)
            .with_label(T::PARTITION, &partition.key)
            .reading(T::NAME, [&partition.key])
    };
    Ok(chosen.map(unit).collect())
}

/// Lists a unit for each value of a label that an option names.
#[doc(hidden)]
pub fn grouped<T: Table>(
    scope: &Scope,
    label: &'static str,
    names: &[String],
    to_do: Option<&'static str>,
) -> Result<Vec<Unit>, InputError> {
    if let Some(to_do) = to_do {
        scope.non_empty(T::NAME, to_do)?;
    }
    let groups = scope.chosen_by_label(T::NAME, label, names)?.into_iter();
    let unit = |(value, keys): (&str, Vec<&PartitionKey>)| {
        let unit = Unit::new(value).with_label(label, value);
        unit.reading(T::NAME, keys)
    };
    Ok(groups.map(unit).collect())
}

/// Adds the partitions of an input whose label is the unit's key.
#[doc(hidden)]
#[must_use]
pub fn labeled(unit: Unit, input: &str, scope: &Scope, label: &str) -> Unit {
    let key = unit.partition.clone();
    let all = scope.partitions(input).iter();
    let own = all.filter(|one| one.label(label) == Some(key.as_str()));
    unit.reading(input, own.map(|one| &one.key))
}

/// Returns the artifact with the unit's key.
#[doc(hidden)]
pub fn own<'a>(
    inputs: &'a Inputs,
    input: &'static str,
    key: &PartitionKey,
) -> Result<&'a Artifact, LakeError> {
    let mut all = inputs.artifacts(input).iter();
    let own = all.find(|one| one.key == *key);
    own.ok_or(LakeError::MissingInput { what: input })
}

/// Reads the only artifact.
#[doc(hidden)]
pub fn one<T>(inputs: &Inputs, input: &'static str, read: Read<T>) -> Result<T, LakeError> {
    read(inputs.artifact(input)?)
}

/// Reads the only artifact, if there is one.
#[doc(hidden)]
pub fn optional<T>(
    inputs: &Inputs,
    input: &'static str,
    read: Read<T>,
) -> Result<Option<T>, LakeError> {
    if inputs.artifacts(input).is_empty() {
        return Ok(None);
    }
    one(inputs, input, read).map(Some)
}

/// Reads all artifacts.
#[doc(hidden)]
pub fn all<T>(inputs: &Inputs, input: &'static str, read: Read<T>) -> Result<Vec<T>, LakeError> {
    inputs.artifacts(input).iter().map(read).collect()
}

/// Reads all artifacts but that with the unit's key.
#[doc(hidden)]
pub fn others<T>(
    inputs: &Inputs,
    input: &'static str,
    key: &PartitionKey,
    read: Read<T>,
) -> Result<Vec<T>, LakeError> {
    let all = inputs.artifacts(input).iter();
    let others = all.filter(|one| one.key != *key);
    others.map(read).collect()
}

/// Joins the names of the first field and of the further ones.
#[doc(hidden)]
pub const fn joined<const N: usize>(
    first: &[&'static str],
    further: &[&'static str],
) -> [&'static str; N] {
    let mut all = [""; N];
    let mut idx = 0;
    while idx < N {
        all[idx] = if idx < first.len() {
            first[idx]
        } else {
            further[idx - first.len()]
        };
        idx += 1;
    }
    all
}
