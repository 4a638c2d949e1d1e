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
    let expanded = syn::parse(arguments).and_then(|given| expand(given, syn::parse(item)?));
    expanded.unwrap_or_else(Error::into_compile_error).into()
}

/// `name` or `name = VALUE`, between commas.
struct Settings(Vec<(Ident, Option<Tokens>)>);

impl Parse for Settings {
    fn parse(input: ParseStream<'_>) -> Result<Self> {
        let mut settings = Vec::new();
        while !input.is_empty() {
            let name: Ident = input.parse()?;
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
    /// Functions that return defaults.
    defaults: Vec<Tokens>,
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
        defaults,
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
            #(#defaults)*
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
                    .defaults
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
            let describe = quote!(|schema: &mut ::schemars::Schema| {
                ::options::describe(schema, &(#range), #why);
            });
            field
                .attrs
                .push(syn::parse_quote!(#[schemars(transform = #describe)]));
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
