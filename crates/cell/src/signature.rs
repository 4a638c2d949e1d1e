//! Signatures: a cell signs its answers with the key of its goal journal, a dispatcher its goals.
//!
//! Any party allowed to query a cell may also answer in its place, and sees all queries. So a
//! secret in the query would prove nothing; a signature does (Ed25519: Josefsson and Liusvaara, RFC
//! 8032, 2017). That of an answer covers the key queried, the query's parameters with a nonce, the
//! bytes that were asked, and the answer: an old answer, and one to other bytes, are no answers.

use std::{
    fmt,
    fs::{self, File},
    io::{self, Write},
    path::Path,
    str::FromStr,
    time::Instant,
};

use ring::{
    rand::{SecureRandom, SystemRandom},
    signature::{ED25519, ED25519_PUBLIC_KEY_LEN, Ed25519KeyPair, KeyPair, UnparsedPublicKey},
};
use serde::{Deserialize, Serialize};
use zenoh::{handlers::FifoChannelHandler, query::Reply};

use crate::{text::plain_line, wire};

/// Replies to a query.
type Replies = FifoChannelHandler<Reply>;

/// Bytes of a key's seed.
const SEED: usize = 32;
/// Bytes of a nonce.
const NONCE: usize = 16;
/// Purposes of signatures, so that none is valid for another.
const OF_ANSWER: &str = "cgf cell answer";
const OF_GOAL: &str = "cgf cell goal";
/// File of a folder that holds the private key.
const FILE: &str = "key";
/// Characters shown of an untrusted answer.
const SHOWN: usize = 60;

/// A key pair: that of a cell's journal, or that of a dispatcher.
pub struct SigningKey {
    pair: Ed25519KeyPair,
    /// The public key in hexadecimal digits: the name of the journal or dispatcher.
    name: String,
}

/// A dispatcher's public key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PublicKey(String);

impl PublicKey {
    /// Returns it in hexadecimal digits.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl FromStr for PublicKey {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match from_hex(text) {
            Some(bytes) if bytes.len() == ED25519_PUBLIC_KEY_LEN => Ok(Self(text.to_owned())),
            Some(_) | None => Err(format!(
                "`{}` is not a public key: expected {} hexadecimal digits in lower case",
                plain_line(text),
                2 * ED25519_PUBLIC_KEY_LEN
            )),
        }
    }
}

/// First line of an answer; the body follows.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Signed {
    journal: String,
    /// BLAKE3 of the query's payload.
    asked: String,
    signature: String,
}

/// A query, sent once.
#[derive(Debug, Clone)]
pub(crate) struct Question {
    key: String,
    /// As in the selector, with a nonce.
    parameters: String,
    /// BLAKE3 of the payload.
    asked: String,
}

/// A cell's signed acceptance of a goal, with what it needs to be verified.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Acceptance {
    question: Vec<u8>,
    answer: Vec<u8>,
}

/// First line of a kept acceptance.
#[derive(Serialize)]
struct Asked<'a> {
    key: &'a str,
    parameters: &'a str,
}

/// An answer of any party.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Answer {
    /// Signed for this query by the holder of a journal's key.
    Signed {
        /// The journal.
        journal: String,
        /// The line with the signature.
        line: Vec<u8>,
        /// The answer's body.
        body: Vec<u8>,
    },
    /// Signed by the holder of a journal's key for other bytes than were sent.
    OfOtherBytes {
        /// The journal.
        journal: String,
    },
    /// Without a valid signature.
    Unsigned(Vec<u8>),
    /// Too long to be read, with its length in bytes.
    Long(usize),
}

impl fmt::Debug for SigningKey {
    /// Writes the public part only.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("SigningKey").field(&self.name).finish()
    }
}

impl SigningKey {
    /// Generates a new key.
    ///
    /// # Errors
    ///
    /// Fails if the system's random number generator does.
    pub fn fresh() -> io::Result<Self> {
        let mut seed = [0; SEED];
        random(&mut seed)?;
        Self::new(&seed)
    }

    /// Reads the key of a folder, in which only its owner may read it; generates one if there is none.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be read or written, or is damaged.
    pub fn open(folder: &Path) -> io::Result<Self> {
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
                fs::create_dir_all(folder)?;
                write_secret(&path, &to_hex(&seed))?;
                Self::new(&seed)
            }
            Err(err) => Err(err),
        }
    }

    /// Removes the key of a folder, if there is one.
    pub(crate) fn discard(folder: &Path) -> io::Result<()> {
        match fs::remove_file(folder.join(FILE)) {
            Err(err) if err.kind() != io::ErrorKind::NotFound => Err(err),
            Ok(()) | Err(_) => Ok(()),
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

    /// Returns the public key, in hexadecimal digits.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Signs and serializes an answer.
    pub(crate) fn answer(&self, question: &Question, body: &[u8]) -> Vec<u8> {
        let mut bytes = wire::line(&Signed {
            journal: self.name.clone(),
            asked: question.asked.clone(),
            signature: self.sign(&question.signed(&question.asked, body)),
        });
        bytes.extend_from_slice(body);
        bytes
    }

    /// Signs a goal's digest.
    pub(crate) fn sign_goal(&self, digest: &str) -> String {
        self.sign(&of_goal(digest))
    }

    fn sign(&self, text: &str) -> String {
        to_hex(self.pair.sign(text.as_bytes()).as_ref())
    }
}

/// Whether `signature` is that of a dispatcher's `key` for a goal's digest.
pub(crate) fn verifies_goal(key: &str, digest: &str, signature: &str) -> bool {
    verifies(key, &of_goal(digest), signature)
}

fn of_goal(digest: &str) -> String {
    format!("{OF_GOAL}\n{digest}")
}

fn verifies(key: &str, text: &str, signature: &str) -> bool {
    let (Some(key), Some(signature)) = (from_hex(key), from_hex(signature)) else {
        return false;
    };
    let key = UnparsedPublicKey::new(&ED25519, key);
    key.verify(text.as_bytes(), &signature).is_ok()
}

impl Question {
    /// Makes a query of a key with a payload, and with a new nonce after these parameters, e.g. `from=7`.
    pub(crate) fn new(key: &str, parameters: &str, payload: &[u8]) -> io::Result<Self> {
        let nonce = random_name()?;
        let separator = if parameters.is_empty() { "" } else { ";" };
        Ok(Self {
            key: key.to_owned(),
            parameters: format!("{parameters}{separator}nonce={nonce}"),
            asked: digest(payload),
        })
    }

    /// Parses a received query.
    pub(crate) fn of(query: &zenoh::query::Query) -> Self {
        let payload = query.payload().map(|payload| payload.to_bytes());
        Self {
            key: query.key_expr().as_str().to_owned(),
            parameters: query.parameters().as_str().to_owned(),
            asked: digest(&payload.unwrap_or_default()),
        }
    }

    /// Returns the query's selector.
    pub(crate) fn selector(&self) -> String {
        format!("{}?{}", self.key, self.parameters)
    }

    /// Parses an answer to this query and checks its signature.
    pub(crate) fn read(&self, bytes: &[u8]) -> Answer {
        let found = wire::split_line::<Signed>("signature", bytes).ok();
        let found = found.filter(|(signed, body)| {
            let text = self.signed(&signed.asked, body);
            verifies(&signed.journal, &text, &signed.signature)
        });
        match found {
            None => Answer::Unsigned(bytes.to_owned()),
            Some((Signed { journal, asked, .. }, _)) if asked != self.asked => {
                Answer::OfOtherBytes { journal }
            }
            Some((Signed { journal, .. }, body)) => Answer::Signed {
                journal,
                line: bytes.strip_suffix(body).unwrap_or(bytes).to_owned(),
                body: body.to_owned(),
            },
        }
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
    fn signed(&self, asked: &str, body: &[u8]) -> String {
        let Self {
            key, parameters, ..
        } = self;
        format!(
            "{OF_ANSWER}\n{key}\n{parameters}\n{asked}\n{}",
            digest(body)
        )
    }
}

fn digest(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

impl Acceptance {
    /// Takes the answer to a query.
    pub(crate) fn new(question: &Question, answer: Vec<u8>) -> Self {
        let Question {
            key, parameters, ..
        } = question;
        Self {
            question: wire::line(&Asked { key, parameters }),
            answer,
        }
    }

    /// Returns it as it is kept: a line with the key and the parameters of the query, then the answer as it
    /// came.
    pub fn to_bytes(&self) -> Vec<u8> {
        [self.question.as_slice(), &self.answer].concat()
    }
}

impl Answer {
    /// Returns a signed answer as it came.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        match self {
            Self::Signed { line, body, .. } => [line.as_slice(), body].concat(),
            Self::OfOtherBytes { .. } | Self::Unsigned(_) | Self::Long(_) => Vec::new(),
        }
    }

    /// Returns who answered, as text for people.
    pub(crate) fn who(&self) -> String {
        match self {
            Self::Signed { journal, .. } => format!("the cell with journal {}", short(journal)),
            Self::OfOtherBytes { journal } => format!(
                "the cell with journal {}, to other bytes than were sent, which were altered on the way",
                short(journal)
            ),
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
        .map(|c| c.to_digit(16).filter(|_| !c.is_ascii_uppercase()))
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
    let text: String = String::from_utf8_lossy(front).chars().take(SHOWN).collect();
    plain_line(&text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn question(key: &str, payload: &[u8]) -> Question {
        Question::new(key, "", payload).unwrap()
    }

    #[test]
    fn signature_binds_cell_query_and_content() {
        let (key, other) = (SigningKey::fresh().unwrap(), SigningKey::fresh().unwrap());
        let asked = question("cgf/cell/a/stop", b"");
        let bytes = key.answer(&asked, b"done\n");
        let answer = asked.read(&bytes);
        assert!(matches!(
            &answer,
            Answer::Signed { journal, body, .. } if *journal == key.name() && body == b"done\n"
        ));
        assert_eq!(answer.to_bytes(), bytes);
        let is_signed = |question: &Question, bytes: &[u8]| {
            matches!(question.read(bytes), Answer::Signed { .. })
        };
        // Asked again, elsewhere, or with other parameters, it is not an answer.
        assert!(!is_signed(&question("cgf/cell/a/stop", b""), &bytes));
        let elsewhere = Question {
            key: "cgf/cell/b/stop".to_owned(),
            ..asked.clone()
        };
        assert!(!is_signed(&elsewhere, &bytes));
        let from_seven = Question {
            parameters: format!("from=7;{}", asked.parameters),
            ..asked.clone()
        };
        assert!(!is_signed(&from_seven, &bytes));
        // In another's name it is none either.
        let renamed = String::from_utf8(bytes.clone()).unwrap();
        let renamed = renamed.replace(key.name(), other.name());
        assert!(!is_signed(&asked, renamed.as_bytes()));
        for at in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 1;
            assert!(!is_signed(&asked, &changed), "byte {at} changed");
            assert!(!is_signed(&asked, &bytes[..at]), "cut at {at}");
        }
    }

    #[test]
    fn genuine_answer_to_altered_bytes_is_named_and_does_not_count() {
        let key = SigningKey::fresh().unwrap();
        let sent = question("cgf/cell/a/goal", b"goal");
        let arrived = Question {
            asked: digest(b"nonsense"),
            ..sent.clone()
        };
        let answer = sent.read(&key.answer(&arrived, b"rejected\n"));
        let expected = Answer::OfOtherBytes {
            journal: key.name().to_owned(),
        };
        assert_eq!(answer, expected);
        assert!(answer.who().contains("altered on the way"));
    }

    #[test]
    fn a_goal_is_signed_by_one_dispatcher() {
        let (key, other) = (SigningKey::fresh().unwrap(), SigningKey::fresh().unwrap());
        let signature = key.sign_goal("00ff");
        assert!(verifies_goal(key.name(), "00ff", &signature));
        assert!(!verifies_goal(key.name(), "00fe", &signature));
        assert!(!verifies_goal(other.name(), "00ff", &signature));
        assert!(!verifies_goal("", "00ff", ""));
    }

    #[test]
    fn a_public_key_has_64_digits_in_lower_case() {
        let key = SigningKey::fresh().unwrap();
        assert_eq!(
            key.name().parse::<PublicKey>().unwrap().as_str(),
            key.name()
        );
        let upper = "A".repeat(64);
        for wrong in ["", "00ff", &upper, &"g".repeat(64)] {
            assert!(wrong.parse::<PublicKey>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_key_is_private() {
        let folder = tempfile::tempdir().unwrap();
        let key = SigningKey::open(folder.path()).unwrap();
        let again = SigningKey::open(folder.path()).unwrap();
        assert_eq!(key.name(), again.name());
        assert_ne!(key.name(), SigningKey::fresh().unwrap().name());
        let file = folder.path().join(FILE);
        let secret = fs::read_to_string(&file).unwrap();
        assert!(!format!("{key:?}").contains(secret.trim()));
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o77, 0);
        }
        fs::write(&file, "no key").unwrap();
        let err = SigningKey::open(folder.path()).unwrap_err().to_string();
        assert!(err.contains("is damaged"), "{err}");
    }

    #[test]
    fn an_answer_that_is_not_signed_is_shown_in_one_short_line() {
        let question = question("k", b"");
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
