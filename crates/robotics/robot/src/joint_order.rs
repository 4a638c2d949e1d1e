//! Joint vectors of one order in another.

use std::collections::BTreeSet;

use crate::WrongDof;

/// Permutation of joint vectors from one order into another, found by the joints' names and checked
/// once.
///
/// ```
/// use robot::JointOrder;
///
/// let order = JointOrder::new(&["thumb", "index"], &["index", "thumb"])?;
/// assert_eq!(order.apply(&[0.1, 0.2])?, [0.2, 0.1]);
/// assert!(JointOrder::new(&["thumb"], &["index", "thumb"]).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JointOrder {
    /// Index in the old order of each number of the new one.
    columns: Vec<usize>,
}

/// Difference between two lists that are not orders of the same joints.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum JointMismatch {
    /// A joint of the vectors is none of those wanted.
    #[error("joint `{joint}` is not one of the joints expected")]
    Unknown {
        /// Its name.
        joint: String,
    },
    /// A joint that is wanted is not in the vectors.
    #[error("joint `{joint}` is missing")]
    Missing {
        /// Its name.
        joint: String,
    },
    /// A joint is in a list more than once.
    #[error("joint `{joint}` is named twice")]
    Duplicate {
        /// Its name.
        joint: String,
    },
}

impl JointMismatch {
    /// Returns the name of the joint.
    pub fn joint(&self) -> &str {
        match self {
            Self::Unknown { joint } | Self::Missing { joint } | Self::Duplicate { joint } => joint,
        }
    }
}

impl JointOrder {
    /// Takes the names of the joints in the order of the vectors, and in the order wanted.
    ///
    /// # Errors
    ///
    /// Fails unless both lists name the same joints, each once; with the first that is unknown, else
    /// the first that is named twice, else the first that is missing.
    pub fn new(from: &[impl AsRef<str>], to: &[impl AsRef<str>]) -> Result<Self, JointMismatch> {
        let from: Vec<&str> = from.iter().map(AsRef::as_ref).collect();
        let to: Vec<&str> = to.iter().map(AsRef::as_ref).collect();
        let owned = |joint: &&str| (*joint).to_owned();
        if let Some(joint) = from.iter().find(|joint| !to.contains(joint)) {
            return Err(JointMismatch::Unknown {
                joint: owned(joint),
            });
        }
        if let Some(joint) = duplicate(&from).or_else(|| duplicate(&to)) {
            return Err(JointMismatch::Duplicate {
                joint: owned(&joint),
            });
        }
        let column = |joint: &&str| {
            let found = from.iter().position(|name| name == joint);
            found.ok_or_else(|| JointMismatch::Missing {
                joint: owned(joint),
            })
        };
        Ok(Self {
            columns: to.iter().map(column).collect::<Result<_, _>>()?,
        })
    }

    /// Returns a vector's numbers in the new order: positions, velocities or accelerations.
    ///
    /// # Errors
    ///
    /// Fails if the vector does not hold exactly one number per joint.
    pub fn apply(&self, numbers: &[f64]) -> Result<Vec<f64>, WrongDof> {
        if numbers.len() != self.columns.len() {
            return Err(WrongDof {
                expected: self.columns.len(),
                found: numbers.len(),
            });
        }
        Ok(self.columns.iter().map(|&column| numbers[column]).collect())
    }
}

fn duplicate<'a>(names: &[&'a str]) -> Option<&'a str> {
    let mut seen = BTreeSet::new();
    names.iter().copied().find(|name| !seen.insert(*name))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn lists_of_different_joints_are_refused() {
        let check = |from: &[&str], to: &[&str], expected: &str| {
            let found = JointOrder::new(from, to).map_err(|err| err.to_string());
            assert!(found.unwrap_err().starts_with(expected), "{from:?} {to:?}");
        };
        check(&["a", "c"], &["a", "b"], "joint `c` is not one of");
        check(&["a"], &["a", "b"], "joint `b` is missing");
        check(&["a", "b", "a"], &["a", "b"], "joint `a` is named twice");
        check(&["a", "b"], &["b", "a", "b"], "joint `b` is named twice");
        check(&["a"], &[], "joint `a` is not one of");
        let none: [&str; 0] = [];
        assert!(JointOrder::new(&none, &none).is_ok());
    }

    #[test]
    fn vectors_of_another_length_are_refused() {
        let order = JointOrder::new(&["a", "b"], &["b", "a"]).unwrap();
        for numbers in [&[][..], &[1.0], &[1.0, 2.0, 3.0]] {
            let err = order.apply(numbers).unwrap_err();
            assert_eq!((err.expected, err.found), (2, numbers.len()));
        }
    }

    proptest! {
        #[test]
        fn every_number_keeps_its_joint(
            to in Just((0..6).collect::<Vec<u8>>()).prop_shuffle(),
            from in Just((0..6).collect::<Vec<u8>>()).prop_shuffle(),
        ) {
            let names = |order: &[u8]| order.iter().map(|n| format!("j{n}")).collect::<Vec<_>>();
            let numbers = |order: &[u8]| order.iter().map(|&n| f64::from(n)).collect::<Vec<_>>();
            let order = JointOrder::new(&names(&from), &names(&to)).unwrap();
            prop_assert_eq!(order.apply(&numbers(&from)).unwrap(), numbers(&to));
        }
    }
}
