//! Metrics of partitions, and their aggregation over the partitions of an output.

use std::{collections::BTreeMap, marker::PhantomData};

/// Metrics by name, as they are stored.
pub type MetricValues = BTreeMap<String, f64>;

/// A stored partition lacks a metric that its output declares.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("it has no metric `{0}`")]
pub struct MissingMetric(pub String);

/// The metrics of one partition, or of all partitions of an output together.
///
/// [`metrics!`](crate::metrics!) declares a struct of them.
pub trait Metrics: Sized + 'static {
    /// Adds every metric under its name.
    fn write(&self, values: &mut MetricValues);

    /// Reads what [`Metrics::write`] wrote.
    ///
    /// # Errors
    ///
    /// Fails if a required metric is missing.
    fn read(values: &MetricValues) -> Result<Self, MissingMetric>;

    /// Aggregates the metrics of partitions, in their order.
    fn aggregate(partitions: &[Self]) -> Self;

    /// Returns every metric by name.
    fn metric_values(&self) -> MetricValues {
        let mut values = MetricValues::new();
        self.write(&mut values);
        values
    }
}

/// An output without metrics.
impl Metrics for () {
    fn write(&self, _values: &mut MetricValues) {}

    fn read(_values: &MetricValues) -> Result<Self, MissingMetric> {
        Ok(())
    }

    fn aggregate(_partitions: &[Self]) -> Self {}
}

/// The type of a field of [`metrics!`](crate::metrics!), and its aggregation over partitions.
pub trait Aggregate {
    /// The field's type.
    type Value;

    /// Adds the field's metrics, which are named by the field.
    fn write(field: &str, value: &Self::Value, values: &mut MetricValues);

    /// Reads what [`Aggregate::write`] wrote.
    ///
    /// # Errors
    ///
    /// Fails if a required metric is missing.
    fn read(field: &str, values: &MetricValues) -> Result<Self::Value, MissingMetric>;

    /// Aggregates the values of partitions, in their order.
    fn aggregate<'a>(values: impl Iterator<Item = &'a Self::Value>) -> Self::Value
    where
        Self::Value: 'a;
}

/// One number per partition that aggregates into one number.
pub trait ScalarAggregate {
    /// Aggregates the numbers of partitions, in their order; 0 for none.
    fn of(numbers: impl Iterator<Item = f64>) -> f64;
}

/// Sum, for counts and other additive quantities.
#[derive(Debug, Clone, Copy)]
pub enum Sum {}

/// Mean over the partitions.
#[derive(Debug, Clone, Copy)]
pub enum Mean {}

/// Maximum.
#[derive(Debug, Clone, Copy)]
pub enum Max {}

impl ScalarAggregate for Sum {
    fn of(numbers: impl Iterator<Item = f64>) -> f64 {
        // Not `Iterator::sum`, which is -0 for no numbers.
        numbers.fold(0.0, |sum, number| sum + number)
    }
}

impl ScalarAggregate for Mean {
    fn of(numbers: impl Iterator<Item = f64>) -> f64 {
        let (sum, n) = numbers.fold((0.0, 0.0), |(sum, n), number| (sum + number, n + 1.0));
        sum / f64::max(n, 1.0)
    }
}

impl ScalarAggregate for Max {
    fn of(numbers: impl Iterator<Item = f64>) -> f64 {
        numbers.reduce(f64::max).unwrap_or(0.0)
    }
}

/// A required metric.
impl<F: ScalarAggregate> Aggregate for F {
    type Value = f64;

    fn write(field: &str, value: &f64, values: &mut MetricValues) {
        values.insert(field.to_owned(), *value);
    }

    fn read(field: &str, values: &MetricValues) -> Result<f64, MissingMetric> {
        let found = values.get(field).copied();
        found.ok_or_else(|| MissingMetric(field.to_owned()))
    }

    fn aggregate<'a>(values: impl Iterator<Item = &'a f64>) -> f64 {
        F::of(values.copied())
    }
}

/// An optional metric: aggregated over the partitions that have it, absent if none does.
impl<F: ScalarAggregate> Aggregate for Option<F> {
    type Value = Option<f64>;

    fn write(field: &str, value: &Option<f64>, values: &mut MetricValues) {
        values.extend(value.map(|value| (field.to_owned(), value)));
    }

    fn read(field: &str, values: &MetricValues) -> Result<Option<f64>, MissingMetric> {
        Ok(values.get(field).copied())
    }

    fn aggregate<'a>(values: impl Iterator<Item = &'a Option<f64>>) -> Option<f64> {
        let mut known = values.copied().flatten().peekable();
        known.peek().is_some().then_some(())?;
        Some(F::of(known))
    }
}

/// The metrics of another struct, under their own names.
pub struct With<M>(PhantomData<M>);

impl<M: Metrics + Clone> Aggregate for With<M> {
    type Value = M;

    fn write(_field: &str, value: &M, values: &mut MetricValues) {
        value.write(values);
    }

    fn read(_field: &str, values: &MetricValues) -> Result<M, MissingMetric> {
        M::read(values)
    }

    fn aggregate<'a>(values: impl Iterator<Item = &'a M>) -> M {
        M::aggregate(&values.cloned().collect::<Vec<M>>())
    }
}

/// Declares the metrics of an output: each field with its aggregation over partitions, an [`Aggregate`]
/// such as [`Sum`], [`Mean`], [`Max`], `Option` of one for a metric that some partitions lack, or
/// [`With`].
///
/// A metric computed from others, such as a rate from two counts, is `derived`: it is stored beside
/// them, and recomputed from their aggregates.
///
/// # Examples
///
/// ```
/// use dataflow::{Max, Mean, Metrics, Sum};
///
/// dataflow::metrics! {
///     /// Metrics of the motions of an object.
///     pub struct Motions {
///         /// Number of motions.
///         motions_n: Sum,
///         /// Number of those that hold.
///         held_n: Sum,
///         /// Duration of the longest, in seconds.
///         duration_s: Max,
///         /// Where it was measured, how far the object slipped, in meters.
///         slip_m: Option<Mean>,
///     }
///     derived {
///         rate: |all| all.held_n / all.motions_n.max(1.0),
///     }
/// }
///
/// let motions = |motions_n, held_n| Motions { motions_n, held_n, duration_s: 2.0, slip_m: None };
/// let all = Motions::aggregate(&[motions(1.0, 1.0), motions(3.0, 0.0)]);
/// assert_eq!(all.metric_values()["rate"], 0.25);
/// assert_eq!(Motions::read(&all.metric_values()), Ok(all));
/// ```
#[macro_export]
macro_rules! metrics {
    (
        $(#[$about:meta])*
        $vis:vis struct $name:ident {
            $($(#[$field_about:meta])* $field:ident: $aggregate:ty,)*
        }
        $(derived {
            $($derived:ident: $value:expr,)*
        })?
    ) => {
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq)]
        $vis struct $name {
            $($(#[$field_about])* pub $field: <$aggregate as $crate::Aggregate>::Value,)*
        }

        impl $crate::Metrics for $name {
            fn write(&self, values: &mut $crate::MetricValues) {
                $(<$aggregate as $crate::Aggregate>::write(
                    stringify!($field),
                    &self.$field,
                    values,
                );)*
                $($(
                    let derived: fn(&Self) -> f64 = $value;
                    values.insert(stringify!($derived).to_owned(), derived(self));
                )*)?
            }

            fn read(values: &$crate::MetricValues) -> Result<Self, $crate::MissingMetric> {
                Ok(Self {
                    $($field: <$aggregate as $crate::Aggregate>::read(
                        stringify!($field),
                        values,
                    )?,)*
                })
            }

            fn aggregate(partitions: &[Self]) -> Self {
                Self {
                    $($field: <$aggregate as $crate::Aggregate>::aggregate(
                        partitions.iter().map(|partition| &partition.$field),
                    ),)*
                }
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    crate::metrics! {
        /// One metric of each kind.
        struct Fixture {
            n: Sum,
            error_m: Mean,
            depth_m: Max,
            slip_m: Option<Mean>,
        }
        derived {
            share: |it| it.error_m / it.n.max(1.0),
        }
    }

    fn fixture(n: f64, error_m: f64, depth_m: f64, slip_m: Option<f64>) -> Fixture {
        Fixture {
            n,
            error_m,
            depth_m,
            slip_m,
        }
    }

    #[test]
    fn each_metric_aggregates_as_declared() {
        let all = [
            fixture(1.0, 0.25, 0.3, None),
            fixture(3.0, 0.5, 0.1, Some(0.5)),
            fixture(0.0, 0.75, 0.2, Some(1.5)),
        ];
        let aggregated = Fixture::aggregate(&all);
        assert_eq!(aggregated, fixture(4.0, 0.5, 0.3, Some(1.0)));
        assert_eq!(aggregated.metric_values()["share"], 0.125);
        assert_eq!(Fixture::aggregate(&all[..1]).slip_m, None);
        let none = Fixture::aggregate(&[]);
        assert_eq!(none, fixture(0.0, 0.0, 0.0, None));
        assert!(none.n.is_sign_positive());
    }

    #[test]
    fn a_promised_figure_that_is_missing_is_named() {
        let written = fixture(1.0, 0.25, 0.3, None).metric_values();
        assert_eq!(
            written.keys().collect::<Vec<_>>(),
            ["depth_m", "error_m", "n", "share"]
        );
        assert!(Fixture::read(&written).is_ok());
        let mut lacking = written;
        lacking.remove("error_m");
        let err = Fixture::read(&lacking).unwrap_err();
        assert_eq!(err.to_string(), "it has no metric `error_m`");
    }
}
