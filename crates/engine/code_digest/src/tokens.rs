//! The tokens of a source file that decide what it computes.

use proc_macro2::{Delimiter, Spacing, TokenStream, TokenTree};

/// One token that counts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Token {
    /// An identifier or keyword.
    Word(String),
    /// A literal as it is written.
    Literal(String),
    /// A sign, and whether the next sign follows at once: `>>` is not `> >`.
    Sign(char, bool),
    /// An opening or closing bracket.
    Bracket(char),
}

/// What counts of a file.
#[derive(Debug, Default)]
pub(crate) struct CodeTokens {
    pub(crate) tokens: Vec<Token>,
    /// The modules that it declares for tests.
    pub(crate) test_modules: Vec<String>,
}

/// Returns what counts of a file: neither comments, documentation and white space, nor tests, nor the
/// commas that rustfmt adds where it breaks a list. A file without valid tokens counts by each character.
pub(crate) fn counted(text: &str) -> CodeTokens {
    let mut counted = CodeTokens::default();
    match text.parse::<TokenStream>() {
        Ok(stream) => counted.add(stream, Within::Code),
        Err(_) => counted.tokens = characters(text),
    }
    counted
}

/// Returns the words of a text and each character between them.
fn characters(text: &str) -> Vec<Token> {
    let in_word = |c: char| c.is_alphanumeric() || c == '_';
    let pieces = text.split_inclusive(|c| !in_word(c));
    let tokens = pieces.flat_map(|piece| {
        let word = piece.trim_end_matches(|c| !in_word(c));
        let between = piece[word.len()..].chars().map(|c| Token::Sign(c, false));
        let word = Some(word).filter(|word| !word.is_empty());
        word.map(|word| Token::Word(word.to_owned()))
            .into_iter()
            .chain(between)
    });
    tokens.collect()
}

/// What surrounds tokens.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Within {
    /// Code in which a last comma has a meaning, such as a tuple's.
    Code,
    /// Code in which a last comma has none.
    List,
    /// An attribute or a macro's arguments or rules, which may do anything with a token.
    Macro,
}

impl CodeTokens {
    fn add(&mut self, stream: TokenStream, within: Within) {
        let trees: Vec<TokenTree> = stream.into_iter().collect();
        let mut at = 0;
        while let Some(tree) = trees.get(at) {
            let (before, rest) = trees.split_at(at);
            at += 1;
            if let Some(n) = documentation(rest) {
                at += n - 1;
                continue;
            }
            if within != Within::Macro {
                if is_test_file(rest) {
                    return;
                }
                if let Some((n, declared)) = test_item(rest) {
                    self.test_modules.extend(declared);
                    at += n - 1;
                    continue;
                }
                let next = rest.get(1);
                let last = next.is_none() && within == Within::List;
                if is_sign(Some(tree), ',') && (last || is_sign(next, '>')) {
                    continue;
                }
            }
            match tree {
                TokenTree::Ident(word) => self.tokens.push(Token::Word(word.to_string())),
                TokenTree::Literal(literal) => {
                    self.tokens.push(Token::Literal(literal.to_string()));
                }
                TokenTree::Punct(sign) => {
                    let next = rest.get(1).filter(|next| !is_sign(Some(next), ','));
                    let joint = sign.spacing() == Spacing::Joint
                        && matches!(next, Some(TokenTree::Punct(_)));
                    self.tokens.push(Token::Sign(sign.as_char(), joint));
                }
                TokenTree::Group(group) => {
                    let [open, close] = brackets(group.delimiter());
                    self.tokens.push(Token::Bracket(open));
                    let inside = inside(group, before, within);
                    self.add(group.stream(), inside);
                    self.tokens.push(Token::Bracket(close));
                }
            }
        }
    }
}

fn brackets(delimiter: Delimiter) -> [char; 2] {
    match delimiter {
        Delimiter::Parenthesis => ['(', ')'],
        Delimiter::Bracket => ['[', ']'],
        Delimiter::Brace | Delimiter::None => ['{', '}'],
    }
}

fn is_word(tree: &TokenTree, word: &str) -> bool {
    matches!(tree, TokenTree::Ident(name) if name == word)
}

fn is_sign(tree: Option<&TokenTree>, sign: char) -> bool {
    matches!(tree, Some(TokenTree::Punct(punct)) if punct.as_char() == sign)
}

/// Returns what the tokens of a group are within, by what stands before it.
fn inside(group: &proc_macro2::Group, before: &[TokenTree], outside: Within) -> Within {
    let is_macro = match before {
        [.., TokenTree::Ident(_), sign] if is_sign(Some(sign), '!') => true,
        [.., rules, _, TokenTree::Ident(_)] if is_word(rules, "macro_rules") => true,
        [.., sign] if is_sign(Some(sign), '#') => true,
        [.., hash, sign] => is_sign(Some(hash), '#') && is_sign(Some(sign), '!'),
        _ => false,
    };
    if is_macro || outside == Within::Macro {
        return Within::Macro;
    }
    if group.delimiter() != Delimiter::Parenthesis {
        return Within::List;
    }
    // `f(a,)` is `f(a)`, and `(a, b,)` is `(a, b)`, but `(a,)` is not `(a)`.
    let is_call = match before {
        [.., quote, TokenTree::Ident(_)] if is_sign(Some(quote), '\'') => false,
        [.., TokenTree::Ident(name)] => !BEFORE_TUPLES.contains(&name.to_string().as_str()),
        _ => false,
    };
    let has = |sign| move |tree: &TokenTree| is_sign(Some(tree), sign);
    let commas = group.stream().into_iter().filter(has(','));
    let is_long = commas.count() > 1 && !group.stream().into_iter().any(|tree| has('<')(&tree));
    if is_call || is_long {
        Within::List
    } else {
        Within::Code
    }
}

/// Words after which parentheses are not those of a call or a signature.
const BEFORE_TUPLES: [&str; 30] = [
    "as", "async", "await", "become", "box", "break", "const", "do", "dyn", "else", "extern",
    "for", "gen", "if", "impl", "in", "let", "loop", "match", "move", "mut", "raw", "ref",
    "return", "static", "try", "unsafe", "where", "while", "yield",
];

/// Returns the number of tokens of the attribute at the beginning, and its content.
fn attribute(trees: &[TokenTree]) -> Option<(usize, Vec<TokenTree>)> {
    let [hash, rest @ ..] = trees else {
        return None;
    };
    let inner = usize::from(is_sign(rest.first(), '!'));
    match rest.get(inner) {
        Some(TokenTree::Group(group))
            if is_sign(Some(hash), '#') && group.delimiter() == Delimiter::Bracket =>
        {
            Some((inner + 2, group.stream().into_iter().collect()))
        }
        _ => None,
    }
}

/// Returns the number of tokens of the comment for readers at the beginning.
fn documentation(trees: &[TokenTree]) -> Option<usize> {
    let (n, content) = attribute(trees)?;
    is_word(content.first()?, "doc").then_some(n)
}

/// Whether an attribute leaves its item to tests: `test`, `cfg(test)` or `cfg(all(test, …))`.
fn is_for_tests(content: &[TokenTree]) -> bool {
    match content {
        [test] => is_word(test, "test"),
        [cfg, TokenTree::Group(group)] if is_word(cfg, "cfg") || is_word(cfg, "all") => {
            let all: Vec<TokenTree> = group.stream().into_iter().collect();
            let mut conditions = all.split(|tree| is_sign(Some(tree), ','));
            let whole = is_word(cfg, "all") || conditions.clone().count() == 1;
            whole && conditions.any(is_for_tests)
        }
        _ => false,
    }
}

/// Whether the rest of a module is for tests alone: `#![cfg(test)]`.
fn is_test_file(trees: &[TokenTree]) -> bool {
    let is_inner = is_sign(trees.get(1), '!');
    is_inner && attribute(trees).is_some_and(|(_, content)| is_for_tests(&content))
}

/// Returns the number of tokens of the item for tests at the beginning, and the name of the module that
/// it declares. An item of another form than these counts.
fn test_item(trees: &[TokenTree]) -> Option<(usize, Option<String>)> {
    let (mut n, mut is_test, mut is_elsewhere) = (0, false, false);
    while let Some((length, content)) = attribute(&trees[n..]) {
        n += length;
        is_test |= is_for_tests(&content);
        is_elsewhere |= is_word(content.first()?, "path");
    }
    if !is_test {
        return None;
    }
    if is_word(trees.get(n)?, "pub") {
        n += 1;
        n += usize::from(matches!(trees.get(n), Some(TokenTree::Group(_))));
    }
    let TokenTree::Ident(kind) = trees.get(n)? else {
        return None;
    };
    let is_function = |tree: &TokenTree| {
        ["fn", "async", "unsafe", "extern"]
            .iter()
            .any(|word| is_word(tree, word))
    };
    let has_body = match kind.to_string().as_str() {
        "use" | "static" | "type" | "let" => false,
        "const" => is_function(trees.get(n + 1)?),
        "mod" | "fn" | "async" | "unsafe" | "extern" | "impl" | "trait" | "enum" | "struct"
        | "union" | "macro_rules" => true,
        _ => return None,
    };
    let is_end = |tree: &TokenTree| match tree {
        TokenTree::Group(group) => has_body && group.delimiter() == Delimiter::Brace,
        other => is_sign(Some(other), ';'),
    };
    let end = n + trees[n..].iter().position(is_end)?;
    let declared = match &trees[n..=end] {
        [_, TokenTree::Ident(name), end] if is_sign(Some(end), ';') => {
            Some(name.to_string()).filter(|_| kind == "mod" && !is_elsewhere)
        }
        _ => None,
    };
    Some((end + 1, declared))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether two files are the same code.
    fn is_same(one: &str, other: &str) -> bool {
        counted(one).tokens == counted(other).tokens
    }

    #[test]
    fn comments_documentation_and_tests_do_not_count() {
        let code = "fn f(x: f64) -> f64 { 2.0 * x }";
        for more in [
            "// A comment.",
            "/* A /* nested */ comment. */",
            "//! A file.",
            "/// A function.",
            "/** A function. */",
            "#[doc = \"A function.\"]",
            "#[doc(hidden)]",
            "#[cfg(test)] mod tests { use super::*; #[test] fn it() { f(1.0); } }",
            "#[cfg(test)] mod fixture;",
            "#[cfg(test)] use std::{fmt, io};",
            "#[cfg(test)] pub(crate) const C: [f64; 2] = { [1.0, 2.0] };",
            "#[inline] #[cfg(all(test, unix))] pub(super) fn g() -> bool { true }",
            "#[test] fn it() { assert!(f(1.0) > 1.0); }",
            "#[cfg(test)] impl X { fn g(&self) {} }",
        ] {
            assert!(is_same(&format!("{more}\n{code}"), code), "{more}");
        }
        assert!(is_same("#![cfg(test)] fn f() {}", ""));
        assert!(is_same(
            "fn f() { /* why */ g() }",
            "fn f() {\n    // why\n    g()\n}\n"
        ));
        assert!(is_same("m! { /// A row.\n a: f64 }", "m! { a: f64 }"));
    }

    #[test]
    fn every_other_token_counts() {
        let code =
            "#[cfg(feature = \"a\")] fn f<'a>(x: &'a str) -> u8 { g::<Vec<u8>>(x, b'c', 10) + 1 }";
        for (old, new) in [
            ("+", "-"),
            ("10", "11"),
            ("10", "1_0"),
            ("10", "10.0"),
            ("b'c'", "b'd'"),
            ("b'c'", "'c'"),
            ("\"a\"", "\"b\""),
            ("feature", "target_os"),
            ("'a", "'b"),
            ("u8 {", "u16 {"),
            ("#[cfg(feature = \"a\")]", "#[cfg(not(test))]"),
            ("#[cfg(feature = \"a\")]", ""),
        ] {
            let edited = code.replace(old, new);
            assert!(edited != code && !is_same(code, &edited), "{edited}");
        }
        for (one, other) in [
            ("a b", "ab"),
            ("x >> 1", "x > > 1"),
            ("f(\"a  b\")", "f(\"a b\")"),
            ("f(r\"a // b\")", "f(r\"a\")"),
            ("f(\"/// a\")", "f(\"\")"),
            ("#[cfg(any(test, unix))] fn f() {}", ""),
            ("#[cfg(not(test))] fn f() {}", ""),
            ("#[cfg_attr(test, a)] fn f() {}", "fn f() {}"),
            (
                "let s = S { #[cfg(test)] a: 1, b: 2 };",
                "let s = S { b: 2 };",
            ),
        ] {
            assert!(!is_same(one, other), "{one}, {other}");
        }
    }

    #[test]
    fn a_comma_counts_where_it_has_a_meaning() {
        for (one, other) in [
            ("f(a, b)", "f(\n    a,\n    b,\n)"),
            ("f(a)", "f(\n    a,\n)"),
            ("fn f(a: A) {}", "fn f(a: A,) {}"),
            ("[a, b]", "[\n    a,\n    b,\n]"),
            ("S { a: 1 }", "S { a: 1, }"),
            ("use a::{b, c};", "use a::{\n    b,\n    c,\n};"),
            ("f::<A, B>()", "f::<\n    A,\n    B,\n>()"),
            ("(a, b)", "(a, b,)"),
        ] {
            assert!(is_same(one, other), "{one}, {other}");
        }
        for (one, other) in [
            ("(a)", "(a,)"),
            ("return (a)", "return (a,)"),
            ("&'a (A)", "&'a (A,)"),
            ("(f::<A, B>())", "(f::<A, B>(),)"),
            ("m!(a)", "m!(a,)"),
        ] {
            assert!(!is_same(one, other), "{one}, {other}");
        }
    }

    #[test]
    fn a_file_without_valid_tokens_counts_by_its_characters() {
        let broken = "fn f() { \"no end }";
        assert!(!is_same(broken, &broken.replace("fn f", "fn  f")));
        assert!(!is_same(broken, &format!("{broken} // more")));
        assert!(is_same(broken, broken));
    }

    #[test]
    fn modules_for_tests_are_named() {
        let text = "mod c; #[cfg(test)] pub(crate) mod d; mod e; \
                    #[cfg(test)] #[path = \"x.rs\"] mod e; #[cfg(test)] mod f {}";
        assert_eq!(counted(text).test_modules, ["d"]);
    }
}
