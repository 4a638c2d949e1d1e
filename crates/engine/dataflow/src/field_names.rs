//! The names of a struct's fields, as serde reads them.
//!
//! A JSON schema has them too, but to make those of all kinds would slow down the start of every command.

use serde::{
    Deserializer,
    de::{DeserializeOwned, Error as _, Visitor, value::Error},
    forward_to_deserialize_any,
};

/// Returns the names of the fields that a struct is read from; `None` of a type that serde does not read as a struct,
/// such as one with a flattened field.
pub(crate) fn field_names<T: DeserializeOwned>() -> Option<&'static [&'static str]> {
    let mut names = None;
    // There are no values, so that reading fails once the names are known.
    let _no_values = T::deserialize(FieldNames(&mut names));
    names
}

/// Input without values that takes the names for which it is asked.
struct FieldNames<'a>(&'a mut Option<&'static [&'static str]>);

impl<'de> Deserializer<'de> for FieldNames<'_> {
    type Error = Error;

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        *self.0 = Some(fields);
        self.deserialize_any(visitor)
    }

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Error> {
        Err(Error::custom("there are no values"))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Deserialize)]
    #[expect(dead_code, reason = "only its names are read")]
    struct Fields {
        first: u8,
        #[serde(default, rename = "other")]
        second: Option<String>,
    }

    #[derive(Deserialize)]
    #[expect(dead_code, reason = "only its names are read")]
    struct Flat {
        #[serde(flatten)]
        fields: Fields,
    }

    #[test]
    fn names_are_those_that_a_file_has() {
        assert_eq!(field_names::<Fields>(), Some(["first", "other"].as_slice()));
        assert_eq!(field_names::<Flat>(), None);
        assert_eq!(field_names::<f64>(), None);
    }
}
