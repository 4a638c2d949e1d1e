//! Enums that are stored as words.

/// Declares an enum and the word that a column stores for each variant.
macro_rules! words {
    (
        $(#[$meta:meta])*
        $vis:vis enum $name:ident: $what:literal {
            $($(#[$note:meta])* $variant:ident = $word:literal,)*
        }
    ) => {
        $(#[$meta])*
        $vis enum $name {
            $($(#[$note])* $variant,)*
        }

        impl $name {
            /// All of them, in the order of their declaration.
            pub const ALL: [Self; [$($word),*].len()] = [$(Self::$variant),*];

            #[doc = concat!("Returns the word of this ", $what, ".")]
            pub fn as_str(self) -> &'static str {
                match self {
                    $(Self::$variant => $word,)*
                }
            }

            #[doc = concat!("Returns the ", $what, " of this word.")]
            pub fn parse(word: &str) -> Option<Self> {
                match word {
                    $($word => Some(Self::$variant),)*
                    _ => None,
                }
            }
        }

        impl crate::columns::Cell for $name {
            const TYPE: &'static str = "utf8";

            fn array(cells: &[&Self]) -> arrow_array::ArrayRef {
                let words = cells.iter().map(|cell| cell.as_str());
                std::sync::Arc::new(arrow_array::StringArray::from_iter_values(words))
            }

            fn read(
                column: &crate::columns::Column<'_>,
                row: usize,
            ) -> Result<Self, crate::SchemaError> {
                let word = <String as crate::columns::Cell>::read(column, row)?;
                let no_word = || column.invalid(format!(concat!("`{}` is not a valid ", $what), word));
                Self::parse(&word).ok_or_else(no_word)
            }
        }

        /// None is the empty word.
        impl crate::columns::Cell for Option<$name> {
            const TYPE: &'static str = <$name as crate::columns::Cell>::TYPE;

            fn array(cells: &[&Self]) -> arrow_array::ArrayRef {
                let words = cells.iter().map(|cell| cell.map_or("", $name::as_str));
                std::sync::Arc::new(arrow_array::StringArray::from_iter_values(words))
            }

            fn read(
                column: &crate::columns::Column<'_>,
                row: usize,
            ) -> Result<Self, crate::SchemaError> {
                let word = <String as crate::columns::Cell>::read(column, row)?;
                if word.is_empty() {
                    return Ok(None);
                }
                <$name as crate::columns::Cell>::read(column, row).map(Some)
            }
        }
    };
}
pub(crate) use words;
