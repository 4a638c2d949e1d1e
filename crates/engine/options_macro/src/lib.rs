//! The attribute `options` of a struct of options; the crate `options` says what it does.
//!
//! What it deliberately leaves out: anything that reads documentation, which is no part of a crate's
//! code.

use proc_macro::TokenStream;
use proc_macro2::{Ident, TokenStream as Tokens, TokenTree};
use quote::{format_ident, quote};
use syn::{
    Data, DeriveInput, Error, Field, Fields, Result, Token, Type,
    parse::{Parse, ParseStream},
};

/// Declares a struct of options; the crate `options` has an example.
#[proc_macro_attribute]
pub fn options(arguments: TokenStream, item: TokenStream) -> TokenStream {
    let expanded = expanded(arguments.into(), item.into());
    expanded.unwrap_or_else(Error::into_compile_error).into()
}

fn expanded(arguments: Tokens, item: Tokens) -> Result<Tokens> {
    expand(syn::parse2(arguments)?, syn::parse2(item)?)
}

/// `name` or `name = VALUE`, between commas.
struct Settings(Vec<(Ident, Option<Tokens>)>);

impl Parse for Settings {
    fn parse(input: ParseStream<'_>) -> Result<Self> {
        let mut settings: Vec<(Ident, Option<Tokens>)> = Vec::new();
        while !input.is_empty() {
            let name: Ident = input.parse()?;
            if settings.iter().any(|(other, _)| *other == name) {
                return Err(Error::new(name.span(), format!("`{name}` is said twice")));
            }
            let has_value = input.parse::<Option<Token![=]>>()?.is_some();
            let mut value = Tokens::new();
            while has_value && !input.is_empty() && !input.peek(Token![,]) {
                value.extend([input.parse::<TokenTree>()?]);
            }
            settings.push((name, has_value.then_some(value)));
            input.parse::<Option<Token![,]>>()?;
        }
        Ok(Self(settings))
    }
}

/// The parts of a declaration, gathered over its fields.
#[derive(Default)]
struct Declared {
    /// Functions that return defaults, or describe ranges in the schema.
    functions: Vec<Tokens>,
    /// `field: default` of each field that has one.
    values: Vec<Tokens>,
    /// Checks of ranges and tables.
    checks: Vec<Tokens>,
}

fn expand(arguments: Settings, mut item: DeriveInput) -> Result<Tokens> {
    let mut also = Tokens::new();
    for (name, value) in arguments.0 {
        match (name.to_string().as_str(), value) {
            ("also", Some(function)) => also = quote!(#function(self, &mut faults);),
            _ => return Err(Error::new(name.span(), "expected `also = FUNCTION`")),
        }
    }
    let ident = item.ident.clone();
    let Data::Struct(data) = &mut item.data else {
        return Err(Error::new(ident.span(), "expected a struct"));
    };
    let Fields::Named(fields) = &mut data.fields else {
        return Err(Error::new(ident.span(), "expected fields with names"));
    };
    let mut declared = Declared::default();
    for field in &mut fields.named {
        declare(&ident, field, &mut declared)?;
    }
    let is_optional = declared.values.len() == fields.named.len();
    let Declared {
        functions,
        values,
        checks,
    } = declared;
    let default = is_optional.then(|| {
        quote! {
            #[automatically_derived]
            impl ::core::default::Default for #ident {
                fn default() -> Self {
                    Self { #(#values),* }
                }
            }
        }
    });
    Ok(quote! {
        #[derive(Debug, Clone, ::serde::Serialize, ::serde::Deserialize, ::schemars::JsonSchema)]
        #[serde(deny_unknown_fields)]
        #item

        impl #ident {
            #(#functions)*
        }

        #default

        #[automatically_derived]
        impl ::options::Options for #ident {
            fn faults(&self) -> ::std::vec::Vec<::options::OptionFault> {
                let mut faults = ::options::OptionFaults::default();
                #(#checks)*
                #also
                faults.found()
            }
        }
    })
}

/// Replaces `#[option(…)]` of a field by the attributes that it stands for, and adds what it declares.
fn declare(owner: &Ident, field: &mut Field, declared: &mut Declared) -> Result<()> {
    let Some(place) = field
        .attrs
        .iter()
        .position(|it| it.path().is_ident("option"))
    else {
        return Ok(());
    };
    let settings: Settings = field.attrs.remove(place).parse_args()?;
    let (ident, ty) = (&field.ident, &field.ty);
    let key = ident.as_ref().map(Ident::to_string).unwrap_or_default();
    let (mut range, mut why) = (None, None);
    for (name, value) in settings.0 {
        match (name.to_string().as_str(), value) {
            ("path", None) => field
                .attrs
                .push(syn::parse_quote!(#[serde(skip_serializing)])),
            ("default", None) => {
                field.attrs.push(syn::parse_quote!(#[serde(default)]));
                declared
                    .values
                    .push(quote!(#ident: ::core::default::Default::default()));
            }
            ("default", Some(value)) => {
                let function = format_ident!("default_{key}");
                let path = format!("{owner}::{function}");
                field
                    .attrs
                    .push(syn::parse_quote!(#[serde(default = #path)]));
                declared.values.push(quote!(#ident: Self::#function()));
                declared
                    .functions
                    .push(quote!(fn #function() -> #ty { #value }));
            }
            ("flatten", None) => {
                field.attrs.push(syn::parse_quote!(#[serde(flatten)]));
                let check = quote!(faults.extend(::options::Options::faults(value)););
                declared.checks.push(checked(field, &check));
            }
            ("table", None) => {
                let check = quote!(faults.of_table(#key, ::options::Options::faults(value)););
                declared.checks.push(checked(field, &check));
            }
            ("range", Some(value)) => range = Some((name, value)),
            ("why", Some(value)) => why = Some(value),
            _ => {
                let known = "expected `default`, `default = VALUE`, `flatten`, `path`, `range = RANGE`, \
                             `table` or `why = REASON`";
                return Err(Error::new(name.span(), known));
            }
        }
    }
    match (range, why) {
        (None, None) => Ok(()),
        (Some((_, range)), Some(why)) => {
            let check = quote!(faults.within(#key, *value, #range, #why););
            declared.checks.push(checked(field, &check));
            // A path, for a closure is refused where schemars is built without the full grammar of expressions.
            let function = format_ident!("describe_{key}");
            declared.functions.push(quote! {
                fn #function(schema: &mut ::schemars::Schema) {
                    ::options::describe(schema, &(#range), #why);
                }
            });
            field
                .attrs
                .push(syn::parse_quote!(#[schemars(transform = Self::#function)]));
            Ok(())
        }
        (Some((name, _)), None) => Err(Error::new(name.span(), "a range has a reason: `why = …`")),
        (None, Some(why)) => Err(Error::new_spanned(why, "the reason for which `range`?")),
    }
}

/// A check of a field's `value`; of an `Option`, where it is set.
fn checked(field: &Field, check: &Tokens) -> Tokens {
    let ident = &field.ident;
    let is_option = match &field.ty {
        Type::Path(path) => path
            .path
            .segments
            .last()
            .is_some_and(|last| last.ident == "Option"),
        _ => false,
    };
    if is_option {
        quote!(if let Some(value) = &self.#ident { #check })
    } else {
        quote!({ let value = &self.#ident; #check })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(arguments: &str, item: &str) -> String {
        let [arguments, item] = [arguments, item].map(|text| text.parse().unwrap());
        expanded(arguments, item).unwrap_err().to_string()
    }

    #[test]
    fn a_declaration_that_says_nothing_or_half_is_refused_with_the_reason() {
        let known = "expected `default`, `default = VALUE`, `flatten`, `path`, `range = RANGE`, `table` or `why = REASON`";
        for (option, expected) in [
            ("defualt = 4", known),
            ("default = 4, unit = \"m\"", known),
            ("path = \"hand.urdf\"", known),
            ("table = true", known),
            ("range, why = \"a reason\"", known),
            ("range = 0..=3, why", known),
            ("range = 0..=3", "a range has a reason: `why = …`"),
            (
                "default = 2, why = \"a reason\"",
                "the reason for which `range`?",
            ),
            (
                "range = 0..=3, range = 1..=3, why = \"a reason\"",
                "`range` is said twice",
            ),
            ("= 4", "expected identifier"),
            ("\"default\"", "expected identifier"),
        ] {
            let item = format!("struct Config {{ #[option({option})] steps: usize }}");
            assert_eq!(fault("", &item), expected, "{option}");
        }
    }

    #[test]
    fn an_option_is_declared_in_parentheses() {
        for option in ["#[option]", "#[option = 4]"] {
            let found = fault("", &format!("struct Config {{ {option} steps: usize }}"));
            assert!(found.contains("parentheses: #[option(...)]"), "{found}");
        }
    }

    #[test]
    fn only_a_struct_with_named_fields_has_options_and_only_also_is_said_of_it() {
        for (arguments, item, expected) in [
            ("", "enum Config { Steps }", "expected a struct"),
            ("", "struct Config(usize);", "expected fields with names"),
            ("", "struct Config;", "expected fields with names"),
            ("also", "struct Config {}", "expected `also = FUNCTION`"),
            (
                "check = Self::faults",
                "struct Config {}",
                "expected `also = FUNCTION`",
            ),
        ] {
            assert_eq!(fault(arguments, item), expected, "{item}");
        }
    }

    #[test]
    fn a_struct_has_a_default_where_every_option_has_one() {
        for (second, has_default) in [
            ("#[option(default)]", true),
            ("#[option(path)]", false),
            ("", false),
        ] {
            let item = format!(
                "struct Config {{ #[option(default = 4, range = 1..=9, why = \"a reason\")] steps: usize, \
                 {second} hand: String }}"
            );
            let found = expanded(Tokens::new(), item.parse().unwrap())
                .unwrap()
                .to_string();
            assert_eq!(
                found.contains("default :: Default for Config"),
                has_default,
                "{second}"
            );
            assert!(
                found.contains("fn default_steps () -> usize { 4 }"),
                "{found}"
            );
            // No trace of the attribute is left for the compiler to refuse.
            assert!(!found.contains("option ("), "{found}");
        }
    }
}
