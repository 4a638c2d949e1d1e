//! What a unit reads, declared as a type.

#[doc(hidden)]
pub use dataflow;
#[doc(hidden)]
pub use schemas;

/// Declares what each unit of an output reads, for outputs with a unit for every partition of one input.
///
/// The struct's fields are the inputs, loaded. The first, `each`, is the input of which every partition has a
/// unit, with a label that is named like the kind of item in it; the text after it completes `there are no
/// candidates …` where it has no partition. `own` is the partition of another input that has the unit's key:
/// without it the unit is skipped with the reason after `or`. `all` are all partitions of an input. Names in
/// brackets restrict the files that are read. A value that is not the input's table is made of an artifact of
/// the table after `=` by a function. Below `files` are values made of
/// what else the unit reads, such as its files outside the lake.
///
/// The struct is an output's [`Inputs`](dataflow::Output::Inputs). It has `INPUTS`, the names of its inputs,
/// and `units`, which lists the units of the partitions that an option names, of all if it names none.
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
    (@name $type:ty, $input:ty) => { <$input as $crate::inputs::schemas::Table>::NAME };
    (@type own $type:ty) => { $type };
    (@type all $type:ty) => { Vec<$type> };
    (@add own $unit:ident, $name:ident, $scope:ident) => { $unit.reading_own($name, $scope) };
    (@add all $unit:ident, $name:ident, $scope:ident) => {
        $unit.reading($name, $scope.partitions($name).iter().map(|one| &one.key))
    };
    (@read own $inputs:ident, $type:ty) => { $crate::ReadInputs::one::<$type>($inputs)? };
    (@read all $inputs:ident, $type:ty) => { $crate::ReadInputs::all::<$type>($inputs)? };
    (@read own $inputs:ident, $type:ty, $input:ty, $read:expr) => {{
        let read: fn(&$crate::inputs::dataflow::Artifact) -> Result<$type, $crate::LakeError> = $read;
        read($crate::ReadInputs::artifact($inputs, $crate::inputs!(@name $input))?)?
    }};
    (
        $(#[$about:meta])*
        $vis:vis struct $struct:ident {
            $(#[$key_about:meta])*
            each $key:ident: $keyed:ty $([$($key_file:expr),+])?, $to_do:literal;
            $(
                $(#[$field_about:meta])*
                $mode:ident $field:ident: $type:ty
                    $([$file:expr])? $(= $input:ty, $read:expr)? $(, or $reason:literal)?;
            )*
        }
        $(files {
            $($(#[$load_about:meta])* $loaded:ident: $loaded_type:ty = $load:expr;)*
        })?
    ) => {
        $(#[$about])*
        $vis struct $struct {
            $(#[$key_about])*
            $vis $key: $keyed,
            $($(#[$field_about])* $vis $field: $crate::inputs!(@type $mode $type),)*
            $($($(#[$load_about])* $vis $loaded: $loaded_type,)*)?
        }

        impl $struct {
            /// The names of the inputs.
            $vis const INPUTS: &'static [&'static str] = &[
                $crate::inputs!(@name $keyed),
                $($crate::inputs!(@name $type $(, $input)?),)*
            ];

            /// Lists a unit for each partition that an option names, for all if it names none.
            ///
            /// # Errors
            ///
            /// Fails if there is none, or the option names a partition that there is not.
            $vis fn units(
                scope: &$crate::inputs::dataflow::Scope,
                names: &[String],
            ) -> Result<
                Vec<$crate::inputs::dataflow::Unit>,
                $crate::inputs::dataflow::InputError,
            > {
                let each = $crate::inputs!(@name $keyed);
                let item = <$keyed as $crate::inputs::schemas::Table>::PARTITION;
                scope.some(each, $to_do)?;
                let unit = |partition: &$crate::inputs::dataflow::Partition| {
                    let unit = $crate::inputs::dataflow::Unit::new(&partition.key)
                        .with_label(item, &partition.key)
                        .reading(each, [&partition.key]);
                    $(let unit = unit.only_files(each, [$($key_file),+]);)?
                    $(
                        let name = $crate::inputs!(@name $type $(, $input)?);
                        let unit = $crate::inputs!(@add $mode unit, name, scope);
                        $(let unit = unit.only_files(name, [$file]);)?
                    )*
                    unit
                };
                Ok(scope.chosen(each, item, names)?.into_iter().map(unit).collect())
            }
        }

        impl $crate::inputs::dataflow::UnitInputs<'_> for $struct {
            fn read(
                inputs: &$crate::inputs::dataflow::Inputs,
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
                Ok(Ok(Self {
                    $key: $crate::ReadInputs::one::<$keyed>(inputs)?,
                    $($field: $crate::inputs!(@read $mode inputs, $type $(, $input, $read)?),)*
                    $($($loaded: ($load)(inputs)?,)*)?
                }))
            }
        }
    };
}
