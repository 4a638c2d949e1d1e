//! Signed answers: the cell signs with the key of its goal journal.
//!
//! Any party allowed to query a cell may also answer in its place, and sees all queries. So a
//! secret in the query would prove nothing; a signature does (Ed25519: Josefsson and Liusvaara, RFC
//! 8032, 2017). It covers the key queried, a nonce of the query, and the answer, so that old
//! answers cannot be replayed.

use std::{
    fmt,
    fs::{self, File},
    io::{self, Write},
    path::Path,
    time::Instant,
};

use ring::{
    rand::{SecureRandom, SystemRandom},
    signature::{ED25519, Ed25519KeyPair, KeyPair, UnparsedPublicKey},
};
use serde::{Deserialize, Serialize};
use zenoh::{handlers::FifoChannelHandler, query::Reply};

use crate::wire;

/// Replies to a query.
type Replies = FifoChannelHandler<Reply>;

/// Bytes of a key's seed.
const SEED: usize = 32;
/// Bytes of a nonce.
const NONCE: usize = 16;
/// Purpose of a signature, so that none is valid in another protocol.
const PURPOSE: &str = "cgf cell answer";
/// Query parameter that holds the nonce.
const PARAMETER: &str = "nonce";
/// File of a journal that holds its private key.
const FILE: &str = "key";
/// Characters shown of an untrusted answer.
const SHOWN: usize = 60;

/// The key of a cell's journal.
pub(crate) struct JournalKey {
    pair: Ed25519KeyPair,
    /// The public key in hexadecimal digits: the journal's name.
    name: String,
}

/// First line of an answer; the body follows.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Signed {
    journal: String,
    signature: String,
}

/// A query, sent once.
#[derive(Debug, Clone)]
pub(crate) struct Question {
    key: String,
    nonce: String,
}

/// An answer of any party.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Answer {
    /// Signed for this query by the holder of a journal's key.
    Signed {
        /// The journal.
        journal: String,
        /// The answer's body.
        body: Vec<u8>,
    },
    /// Without a valid signature.
    Unsigned(Vec<u8>),
    /// Too long to be read, with its length in bytes.
    Long(usize),
}

impl fmt::Debug for JournalKey {
    /// Writes the public part only.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("JournalKey").field(&self.name).finish()
    }
}

impl JournalKey {
    /// Generates a new key.
    pub(crate) fn fresh() -> io::Result<Self> {
        let mut seed = [0; SEED];
        random(&mut seed)?;
        Self::new(&seed)
    }

    /// Reads the key of the journal in a folder; generates one if there is none.
    pub(crate) fn open(folder: &Path) -> io::Result<Self> {
        let path = folder.join(FILE);
        match fs::read_to_string(&path) {
            Ok(text) => {
                let seed = from_hex(text.trim());
                let damaged = || io::Error::other(format!("`{}` is damaged", path.display()));
                Self::new(&seed.ok_or_else(damaged)?)
            }
            Err(err) if err.kind() == io::ErrorKind::NotFound => {
                let mut seed = [0; SEED];
                random(&mut seed)?;
                write_secret(&path, &to_hex(&seed))?;
                Self::new(&seed)
            }
            Err(err) => Err(err),
        }
    }

    fn new(seed: &[u8]) -> io::Result<Self> {
        let pair = Ed25519KeyPair::from_seed_unchecked(seed);
        let pair = pair.map_err(|err| io::Error::other(format!("no key: {err}")))?;
        Ok(Self {
            name: to_hex(pair.public_key().as_ref()),
            pair,
        })
    }

    /// Returns the journal's name: the public key.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Signs and serializes an answer.
    pub(crate) fn sign(&self, question: &Question, body: &[u8]) -> Vec<u8> {
        let signature = self.pair.sign(question.signed(body).as_bytes());
        let mut bytes = wire::line(&Signed {
            journal: self.name.clone(),
            signature: to_hex(signature.as_ref()),
        });
        bytes.extend_from_slice(body);
        bytes
    }
}

impl Question {
    /// Makes a query of a key, with a new nonce.
    pub(crate) fn new(key: &str) -> io::Result<Self> {
        let mut nonce = [0; NONCE];
        random(&mut nonce)?;
        Ok(Self {
            key: key.to_owned(),
            nonce: to_hex(&nonce),
        })
    }

    /// Parses a received query.
    pub(crate) fn of(query: &zenoh::query::Query) -> Self {
        let nonce = query.parameters().get(PARAMETER).unwrap_or_default();
        Self {
            key: query.key_expr().as_str().to_owned(),
            nonce: nonce.to_owned(),
        }
    }

    /// Returns the query's selector, with a first number if there is one.
    pub(crate) fn selector(&self, from: Option<u64>) -> String {
        let Self { key, nonce } = self;
        match from {
            Some(from) => format!("{key}?from={from};{PARAMETER}={nonce}"),
            None => format!("{key}?{PARAMETER}={nonce}"),
        }
    }

    /// Parses an answer to this query and checks its signature.
    pub(crate) fn read(&self, bytes: &[u8]) -> Answer {
        let found = wire::split_line::<Signed>("signature", bytes).ok();
        let signed = found.and_then(|(signed, body)| {
            let (key, signature) = (from_hex(&signed.journal)?, from_hex(&signed.signature)?);
            let key = UnparsedPublicKey::new(&ED25519, key);
            let verified = key.verify(self.signed(body).as_bytes(), &signature);
            verified.ok()?;
            Some(Answer::Signed {
                journal: signed.journal,
                body: body.to_owned(),
            })
        });
        signed.unwrap_or_else(|| Answer::Unsigned(bytes.to_owned()))
    }

    /// Collects distinct answers until a deadline, none longer than `most` bytes.
    pub(crate) fn collect(&self, replies: &Replies, most: usize, deadline: Instant) -> Vec<Answer> {
        let mut answers = Vec::new();
        while let Ok(Some(reply)) = replies.recv_deadline(deadline) {
            // An error reply is a timeout reported by a router.
            let Ok(sample) = reply.into_result() else {
                continue;
            };
            let payload = sample.payload();
            let answer = if payload.len() > most {
                Answer::Long(payload.len())
            } else {
                self.read(&payload.to_bytes())
            };
            // Equal answers count once.
            if !answers.contains(&answer) {
                answers.push(answer);
            }
        }
        answers
    }

    /// Returns the text that an answer's signature covers.
    fn signed(&self, body: &[u8]) -> String {
        let Self { key, nonce } = self;
        let digest = blake3::hash(body).to_hex();
        format!("{PURPOSE}\n{key}\n{nonce}\n{digest}")
    }
}

impl Answer {
    /// Returns who answered, as text for people.
    pub(crate) fn who(&self) -> String {
        match self {
            Self::Signed { journal, .. } => format!("the cell with journal {}", short(journal)),
            Self::Unsigned(bytes) => {
                format!(
                    "somebody without a valid signature, who says `{}`",
                    shown(bytes)
                )
            }
            Self::Long(bytes) => format!("somebody with {bytes} bytes, which were not read"),
        }
    }
}

/// Returns the start of a journal's name, by which people tell journals apart.
pub(crate) fn short(journal: &str) -> &str {
    journal.get(..16).unwrap_or(journal)
}

/// Returns a random, unguessable name.
pub(crate) fn random_name() -> io::Result<String> {
    let mut name = [0; NONCE];
    random(&mut name)?;
    Ok(to_hex(&name))
}

fn random(bytes: &mut [u8]) -> io::Result<()> {
    let filled = SystemRandom::new().fill(bytes);
    filled.map_err(|err| io::Error::other(format!("the system gives no random numbers: {err}")))
}

/// Writes a file that only its owner may read, whole or not at all.
fn write_secret(path: &Path, text: &str) -> io::Result<()> {
    let beside = path.with_extension("new");
    let mut options = File::options();
    options.write(true).create(true).truncate(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let mut file = options.open(&beside)?;
    file.write_all(format!("{text}\n").as_bytes())?;
    file.sync_all()?;
    fs::rename(beside, path)
}

fn to_hex(bytes: &[u8]) -> String {
    let digits = bytes.iter().flat_map(|byte| [byte >> 4, byte & 15]);
    digits
        .filter_map(|digit| char::from_digit(u32::from(digit), 16))
        .collect()
}

fn from_hex(text: &str) -> Option<Vec<u8>> {
    let digits: Vec<u32> = text
        .chars()
        .map(|c| c.to_digit(16))
        .collect::<Option<_>>()?;
    let (pairs, rest) = digits.as_chunks::<2>();
    if !rest.is_empty() {
        return None;
    }
    let byte = |[high, low]: &[u32; 2]| u8::try_from(high * 16 + low).ok();
    pairs.iter().map(byte).collect()
}

/// Returns the start of bytes that may not be text.
fn shown(bytes: &[u8]) -> String {
    let front = bytes.get(..bytes.len().min(4 * SHOWN)).unwrap_or_default();
    let text = String::from_utf8_lossy(front);
    let plain = text.chars().take(SHOWN);
    plain
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signature_binds_cell_query_and_content() {
        let (key, other) = (JournalKey::fresh().unwrap(), JournalKey::fresh().unwrap());
        let question = Question::new("cgf/cell/a/stop").unwrap();
        let bytes = key.sign(&question, b"done\n");
        let expected = Answer::Signed {
            journal: key.name().to_owned(),
            body: b"done\n".to_vec(),
        };
        assert_eq!(question.read(&bytes), expected);
        let is_signed = |question: &Question, bytes: &[u8]| {
            matches!(question.read(bytes), Answer::Signed { .. })
        };
        // Asked again, or elsewhere, it is not an answer.
        assert!(!is_signed(
            &Question::new("cgf/cell/a/stop").unwrap(),
            &bytes
        ));
        let elsewhere = Question {
            key: "cgf/cell/b/stop".to_owned(),
            ..question.clone()
        };
        assert!(!is_signed(&elsewhere, &bytes));
        // In another's name it is none either.
        let renamed = String::from_utf8(bytes.clone()).unwrap();
        let renamed = renamed.replace(key.name(), other.name());
        assert!(!is_signed(&question, renamed.as_bytes()));
        for at in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 1;
            assert!(!is_signed(&question, &changed), "byte {at} changed");
            assert!(!is_signed(&question, &bytes[..at]), "cut at {at}");
        }
    }

    #[test]
    fn journal_key_is_private() {
        let folder = tempfile::tempdir().unwrap();
        let key = JournalKey::open(folder.path()).unwrap();
        let again = JournalKey::open(folder.path()).unwrap();
        assert_eq!(key.name(), again.name());
        assert_ne!(key.name(), JournalKey::fresh().unwrap().name());
        let file = folder.path().join(FILE);
        let secret = fs::read_to_string(&file).unwrap();
        assert!(!format!("{key:?}").contains(secret.trim()));
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o77, 0);
        }
        fs::write(&file, "no key").unwrap();
        let err = JournalKey::open(folder.path()).unwrap_err().to_string();
        assert!(err.contains("is damaged"), "{err}");
    }

    #[test]
    fn an_answer_that_is_not_signed_is_shown_in_one_short_line() {
        let question = Question::new("k").unwrap();
        for bytes in [&b"{}\nrows"[..], &[0xff; 1000], b""] {
            let who = question.read(bytes).who();
            assert!(who.contains("without a valid signature"), "{who}");
            assert!(
                who.chars().count() < 2 * SHOWN && !who.contains('\n'),
                "{who}"
            );
        }
    }
}
