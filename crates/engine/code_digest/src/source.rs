//! What a source file names: crates, modules, included files.

use std::collections::BTreeSet;

use blake3::Hasher;

use crate::tokens::{CodeTokens, Token, counted};

/// A file of a crate, by its tokens.
#[derive(Debug)]
pub(crate) struct Source {
    /// Its path below the crate's folder.
    pub(crate) path: String,
    counted: CodeTokens,
}

impl Source {
    pub(crate) fn new(path: String, text: &str) -> Self {
        let counted = counted(text);
        Self { path, counted }
    }

    fn tokens(&self) -> &[Token] {
        &self.counted.tokens
    }

    /// Adds its tokens to a digest, apart from each other and from those of other files.
    pub(crate) fn digest(&self, hasher: &mut Hasher) {
        add(hasher, 'f', &self.path);
        for token in self.tokens() {
            match token {
                Token::Word(word) => add(hasher, 'w', word),
                Token::Literal(literal) => add(hasher, 'l', literal),
                Token::Sign(sign, joint) => {
                    let kind = if *joint { 'j' } else { 's' };
                    add(hasher, kind, sign.encode_utf8(&mut [0; 4]));
                }
                Token::Bracket(bracket) => add(hasher, 'b', bracket.encode_utf8(&mut [0; 4])),
            }
        }
    }

    /// Its words, without the mark of raw ones.
    pub(crate) fn words(&self) -> impl Iterator<Item = &str> {
        self.tokens().iter().filter_map(word)
    }

    /// The files of the modules that it declares only for tests, and the folders of theirs, but for those
    /// that it declares within another module.
    pub(crate) fn of_tests(&self) -> impl Iterator<Item = [String; 2]> {
        let (folder, name) = self.path.rsplit_once('/').unwrap_or_default();
        let folder = match name {
            "lib.rs" | "main.rs" | "mod.rs" => folder,
            _ => self.path.trim_end_matches(".rs"),
        };
        let declared = self.counted.test_modules.iter();
        let only = declared.filter(|name| !self.declares(name));
        only.map(move |name| [format!("{folder}/{name}.rs"), format!("{folder}/{name}/")])
    }

    /// Whether it declares this module other than for tests.
    fn declares(&self, name: &str) -> bool {
        self.tokens().windows(3).any(|tokens| match tokens {
            [keyword, module, Token::Sign(';', _)] => {
                word(keyword) == Some("mod") && word(module) == Some(name)
            }
            _ => false,
        })
    }

    /// Whether a file of its modules may have a name of its own: `#[path = "…"] mod`.
    pub(crate) fn has_named_modules(&self) -> bool {
        let mut windows = self.tokens().windows(3);
        windows.any(|tokens| match tokens {
            [Token::Bracket('['), path, Token::Sign('=', _)] => word(path) == Some("path"),
            [_, attribute, Token::Bracket('(')] => word(attribute) == Some("cfg_attr"),
            _ => false,
        })
    }

    /// The files whose content it includes, relative to its own folder; none for one that is not named by
    /// a plain literal.
    pub(crate) fn includes(&self) -> impl Iterator<Item = Option<&str>> {
        let windows = self.tokens().windows(5);
        windows.filter_map(|tokens| match tokens {
            [name, Token::Sign('!', _), Token::Bracket(_), file, close] => {
                let include = ["include", "include_str", "include_bytes"];
                let file = match (file, close) {
                    (Token::Literal(literal), Token::Bracket(_)) => unquoted(literal),
                    _ => None,
                };
                include.contains(&word(name)?).then_some(file)
            }
            _ => None,
        })
    }

    /// Whether it has a path through or to this module: `report::…`, `…::report` or `…::{…, report}`.
    pub(crate) fn uses(&self, module: &str) -> bool {
        // The brackets that are open, and whether each is a list of paths.
        let mut open = Vec::new();
        let tokens = self.tokens();
        for (at, token) in tokens.iter().enumerate() {
            let follows = is_path(&tokens[..at]) || open.last() == Some(&true);
            match token {
                Token::Bracket('(' | '[' | '{') => open.push(follows),
                Token::Bracket(_) => drop(open.pop()),
                _ if word(token) != Some(module) => {}
                _ if follows || is_path(&tokens[..tokens.len().min(at + 3)]) => return true,
                _ => {}
            }
        }
        false
    }

    /// The names of the types and traits that it defines.
    pub(crate) fn defined(&self) -> impl Iterator<Item = &str> {
        self.tokens().windows(2).filter_map(|tokens| {
            let kinds = ["enum", "struct", "trait", "union"];
            kinds
                .contains(&word(&tokens[0])?)
                .then(|| word(&tokens[1]))?
        })
    }

    /// The words of each `impl`, up to its body.
    pub(crate) fn implementations(&self) -> impl Iterator<Item = BTreeSet<&str>> {
        let tokens = self.tokens();
        let is_start = |at: usize| {
            let follows_item = match at.checked_sub(1).map(|before| &tokens[before]) {
                None | Some(Token::Bracket('{' | '}' | ']') | Token::Sign(';', _)) => true,
                Some(before) => word(before) == Some("unsafe"),
            };
            follows_item && word(&tokens[at]) == Some("impl")
        };
        let starts = (0..tokens.len()).filter(move |at| is_start(*at));
        starts.map(move |at| {
            let header = tokens[at..].iter();
            let header = header.take_while(|token| **token != Token::Bracket('{'));
            header.filter_map(word).collect()
        })
    }
}

/// Adds a text to a digest.
pub(crate) fn add(hasher: &mut Hasher, kind: char, text: &str) {
    hasher.update(kind.encode_utf8(&mut [0; 4]).as_bytes());
    hasher.update(&(text.len() as u64).to_le_bytes());
    hasher.update(text.as_bytes());
}

fn word(token: &Token) -> Option<&str> {
    match token {
        Token::Word(word) => Some(word.strip_prefix("r#").unwrap_or(word)),
        _ => None,
    }
}

/// Whether tokens end with `::`.
fn is_path(tokens: &[Token]) -> bool {
    matches!(tokens, [.., Token::Sign(':', true), Token::Sign(':', _)])
}

/// The text of a string literal that is neither raw nor has escapes.
fn unquoted(literal: &str) -> Option<&str> {
    let text = literal.strip_prefix('"')?.strip_suffix('"')?;
    (!text.contains('\\')).then_some(text)
}
