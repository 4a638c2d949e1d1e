//! Certificates and keys of TLS: whether those of an access file can be used, and why a connection under it
//! cannot be made.
//!
//! zenoh says only that it cannot connect. So the same handshake is made once more, with the same certificates,
//! when it has failed.

use std::{
    fmt, fs, io,
    net::{SocketAddr, TcpStream},
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

use rustls::{
    AlertDescription, CertificateError, ClientConfig, ClientConnection, RootCertStore,
    client::{WebPkiServerVerifier, danger::ServerCertVerifier},
    crypto::{CryptoProvider, ring::default_provider},
    pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime, pem::PemObject},
    sign::CertifiedKey,
    version::TLS13,
};
use zenoh::Config;

/// Time for a connection and for each answer in the handshake.
const WAIT: Duration = Duration::from_secs(2);
/// Where it is said how certificates are made.
const SHOWN: &str = "`data/access/README.md` shows how";

/// The object identifier 2.5.4.3 in DER.
const COMMON_NAME: [u8; 5] = [0x06, 0x03, 0x55, 0x04, 0x03];

/// Why a certificate, a key or a handshake is no good, with advice.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TlsFault {
    problem: String,
    advice: String,
}

impl TlsFault {
    fn new(problem: impl Into<String>, advice: impl Into<String>) -> Self {
        Self {
            problem: problem.into(),
            advice: advice.into(),
        }
    }

    /// Returns the next action.
    pub fn advice(&self) -> &str {
        &self.advice
    }
}

impl fmt::Display for TlsFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.problem)
    }
}

impl std::error::Error for TlsFault {}

/// The files of one side, which listens or connects.
#[derive(Debug, Clone, Default)]
struct Side {
    certificate: Option<PathBuf>,
    key: Option<PathBuf>,
}

/// The part of an access file that is about TLS.
#[derive(Debug, Clone)]
pub(crate) struct Tls {
    authority: Option<PathBuf>,
    listener: Side,
    client: Side,
    /// Whether clients show a certificate, too.
    is_mutual: bool,
    /// Whether the host must be one that the certificate names.
    is_name_checked: bool,
}

impl Tls {
    /// Reads which files a configuration names; certificates within it are left to zenoh.
    pub(crate) fn of(config: &Config) -> Self {
        let value = |key: &str| {
            let value = config.get_json(&format!("transport/link/tls/{key}"));
            serde_json::from_str(&value.unwrap_or_default()).unwrap_or(serde_json::Value::Null)
        };
        let path = |key: &str| value(key).as_str().map(PathBuf::from);
        let side = |word: &str| Side {
            certificate: path(&format!("{word}_certificate")),
            key: path(&format!("{word}_private_key")),
        };
        Self {
            authority: path("root_ca_certificate"),
            listener: side("listen"),
            client: side("connect"),
            is_mutual: value("enable_mtls").as_bool() == Some(true),
            is_name_checked: value("verify_name_on_connect").as_bool() != Some(false),
        }
    }

    /// Checks every certificate and key that can be read, and that each key is that of its certificate.
    pub(crate) fn check(&self) -> Result<(), (PathBuf, TlsFault)> {
        if let Some(authority) = &self.authority {
            certificates(authority)?;
        }
        for side in [&self.listener, &self.client] {
            let chain = side.certificate.as_deref().map(certificates).transpose()?;
            let key = side.key.as_deref().map(private_key).transpose()?;
            if let (Some(chain), Some(key), Some(path)) = (chain, key, &side.key) {
                matched(chain, key, side).map_err(|fault| (path.clone(), fault))?;
            }
        }
        Ok(())
    }

    /// Returns why no client accepts the listener's certificate at this time, if that is so.
    pub(crate) fn stale_listener(&self) -> Option<(PathBuf, TlsFault)> {
        let path = self.listener.certificate.as_ref()?;
        let chain = certificates(path).ok()?;
        Some((path.clone(), stale(&chain)?))
    }

    /// Returns the certificate of who connects, if it has no common name: by that a router's rules know clients.
    pub(crate) fn nameless_client(&self) -> Option<(PathBuf, TlsFault)> {
        let path = self
            .client
            .certificate
            .as_ref()
            .filter(|_| self.is_mutual)?;
        let chain = certificates(path).ok()?;
        let mut own = RootCertStore::empty();
        own.add(chain.first()?.clone()).ok()?;
        let subject = own.roots.first()?.subject.as_ref();
        if subject
            .windows(COMMON_NAME.len())
            .any(|bytes| bytes == COMMON_NAME)
        {
            return None;
        }
        let fault = TlsFault::new(
            "has no common name, and a router's rules may know who connects by nothing else",
            format!("issue it with one, `-subj \"/CN=cell\"`; {SHOWN}"),
        );
        Some((path.clone(), fault))
    }

    /// Makes the client's handshake, and returns why it fails; `None` if it does not, or if nothing answers.
    pub(crate) fn handshake_fault(&self, host: &str, address: SocketAddr) -> Option<TlsFault> {
        let config = match self.client_config() {
            Ok(config) => config,
            Err(fault) => return Some(fault),
        };
        let name = ServerName::try_from(host.trim_matches(['[', ']']).to_owned()).ok()?;
        let fault = match shake_hands(config, name, address)? {
            rustls::Error::InvalidCertificate(err) => self.of_their_certificate(host, err)?,
            rustls::Error::AlertReceived(alert) => self.of_our_certificate(alert),
            rustls::Error::InvalidMessage(_) => TlsFault::new(
                "what listens there does not speak TLS",
                "write `tcp/` where it listens without TLS on this machine, or give it an access file",
            ),
            other => TlsFault::new(
                format!("the handshake of TLS fails: {other}"),
                format!("compare the access files of both sides; {SHOWN}"),
            ),
        };
        Some(fault)
    }

    fn client_config(&self) -> Result<ClientConfig, TlsFault> {
        let mut roots = public_roots();
        if let Some(authority) = &self.authority {
            roots.add_parsable_certificates(certificates(authority).map_err(|(_, fault)| fault)?);
        }
        let config = ClientConfig::builder_with_provider(provider())
            .with_protocol_versions(&[&TLS13])
            .map_err(|err| unusable(&err))?
            .with_root_certificates(roots);
        if !self.is_mutual {
            return Ok(config.with_no_client_auth());
        }
        let (Some(certificate), Some(key)) = (&self.client.certificate, &self.client.key) else {
            return Err(TlsFault::new(
                "the access file wants certificates of both sides (`enable_mtls`) and names none to show",
                format!("name `connect_certificate` and `connect_private_key` in it; {SHOWN}"),
            ));
        };
        let chain = certificates(certificate).map_err(|(_, fault)| fault)?;
        let key = private_key(key).map_err(|(_, fault)| fault)?;
        let config = config.with_client_auth_cert(chain, key);
        config.map_err(|err| unusable(&err))
    }

    /// What is wrong with the certificate that the other side shows.
    fn of_their_certificate(&self, host: &str, err: CertificateError) -> Option<TlsFault> {
        if let Some(times) = out_of_date(&err) {
            return Some(TlsFault::new(
                format!("its certificate {times}"),
                format!("issue it a new one, and check the clocks of both machines; {SHOWN}"),
            ));
        }
        let problem = match err {
            CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. }
                if !self.is_name_checked =>
            {
                return None;
            }
            CertificateError::NotValidForNameContext { presented, .. } => {
                let names: Vec<&str> = presented
                    .iter()
                    .map(|name| name.split('"').nth(1).unwrap_or(name))
                    .collect();
                return Some(of_another_host(host, &names));
            }
            CertificateError::NotValidForName => return Some(of_another_host(host, &[])),
            CertificateError::UnknownIssuer | CertificateError::BadSignature => {
                let authority = self.authority.as_deref().map_or_else(
                    || "an authority that the access file names (`root_ca_certificate`)".to_owned(),
                    |path| format!("the authority in `{}`", path.display()),
                );
                format!("its certificate is not issued by {authority}")
            }
            CertificateError::InvalidPurpose | CertificateError::InvalidPurposeContext { .. } => {
                "its certificate is not one for servers".to_owned()
            }
            other => format!("its certificate cannot be accepted: {other}"),
        };
        let advice = "give both sides certificates of one authority, and name that authority in both access files";
        Some(TlsFault::new(problem, format!("{advice}; {SHOWN}")))
    }

    /// What the other side says of our certificate.
    fn of_our_certificate(&self, alert: AlertDescription) -> TlsFault {
        let shown = self.client.certificate.as_ref().filter(|_| self.is_mutual);
        let Some(path) = shown else {
            return TlsFault::new(
                "it wants a certificate of who connects, and the access file shows none",
                format!(
                    "set `enable_mtls`, `connect_certificate` and `connect_private_key` in it; {SHOWN}"
                ),
            );
        };
        let shown = path.display();
        let stale = certificates(path).ok().and_then(|chain| stale(&chain));
        let problem = match (stale, alert) {
            (Some(stale), _) => format!("it refuses the certificate `{shown}`, which {stale}"),
            (None, AlertDescription::UnknownCA | AlertDescription::DecryptError) => {
                format!(
                    "it refuses the certificate `{shown}`: it does not know the authority that issued it"
                )
            }
            (None, AlertDescription::CertificateExpired) => {
                format!(
                    "it refuses the certificate `{shown}`: by its clock the certificate is out of date"
                )
            }
            (None, alert) => format!("it refuses the certificate `{shown}`: {alert:?}"),
        };
        let advice = "issue one by the authority that the other side trusts, valid now";
        TlsFault::new(problem, format!("{advice}; {SHOWN}"))
    }
}

fn of_another_host(host: &str, names: &[&str]) -> TlsFault {
    match names.first() {
        Some(name) => TlsFault::new(
            format!(
                "its certificate is for `{}`, not for `{host}`",
                names.join("`, `")
            ),
            format!(
                "write the host as the certificate names it, `tls/{name}:PORT`, or issue one for `{host}` \
                 (`subjectAltName`)"
            ),
        ),
        None => TlsFault::new(
            format!("its certificate names no host, and `{host}` is asked for"),
            format!("issue one with `subjectAltName=DNS:{host}`; {SHOWN}"),
        ),
    }
}

fn unusable(err: &rustls::Error) -> TlsFault {
    TlsFault::new(
        format!("the certificates of the access file cannot be used: {err}"),
        format!("issue them anew; {SHOWN}"),
    )
}

fn provider() -> Arc<CryptoProvider> {
    Arc::new(default_provider())
}

/// The authorities that zenoh trusts beside that of the access file.
fn public_roots() -> RootCertStore {
    RootCertStore {
        roots: webpki_roots::TLS_SERVER_ROOTS.to_vec(),
    }
}

/// Connects and makes the handshake; `None` if it succeeds or there is no answer.
fn shake_hands(
    config: ClientConfig,
    name: ServerName<'static>,
    address: SocketAddr,
) -> Option<rustls::Error> {
    let mut tcp = TcpStream::connect_timeout(&address, WAIT).ok()?;
    tcp.set_read_timeout(Some(WAIT)).ok()?;
    tcp.set_write_timeout(Some(WAIT)).ok()?;
    let mut tls = match ClientConnection::new(Arc::new(config), name) {
        Ok(tls) => tls,
        Err(err) => return Some(err),
    };
    let of_tls = |err: &io::Error| err.get_ref()?.downcast_ref::<rustls::Error>().cloned();
    while tls.is_handshaking() {
        if let Err(err) = tls.complete_io(&mut tcp) {
            return of_tls(&err);
        }
    }
    // The other side judges a client's certificate after the client's part is over.
    match tls.complete_io(&mut tcp) {
        Ok(_) => None,
        Err(err) => of_tls(&err),
    }
}

/// Returns why a certificate is out of date now.
fn stale(chain: &[CertificateDer<'static>]) -> Option<TlsFault> {
    let (own, above) = chain.split_first()?;
    let roots = Arc::new(public_roots());
    let verifier = WebPkiServerVerifier::builder_with_provider(roots, provider());
    let verifier = verifier.build().ok()?;
    // Its dates are checked before who issued it, so that any authorities do.
    let name = ServerName::try_from("localhost").ok()?;
    match verifier.verify_server_cert(own, above, &name, &[], UnixTime::now()) {
        Err(rustls::Error::InvalidCertificate(err)) => {
            let advice = format!("issue a new one, and check this machine's clock; {SHOWN}");
            Some(TlsFault::new(out_of_date(&err)?, advice))
        }
        _ => None,
    }
}

/// Says when a certificate expired, or begins to be valid.
fn out_of_date(err: &CertificateError) -> Option<String> {
    let seconds = |from: UnixTime, to: UnixTime| to.as_secs().saturating_sub(from.as_secs());
    match *err {
        CertificateError::ExpiredContext { time, not_after } => {
            Some(format!("expired {} ago", span(seconds(not_after, time))))
        }
        CertificateError::Expired => Some("has expired".to_owned()),
        CertificateError::NotValidYetContext { time, not_before } => Some(format!(
            "is not valid yet: it begins in {}",
            span(seconds(time, not_before))
        )),
        CertificateError::NotValidYet => Some("is not valid yet".to_owned()),
        _ => None,
    }
}

/// A time in words, in its largest unit.
fn span(seconds: u64) -> String {
    let units = [(86_400, "day"), (3600, "hour"), (60, "minute")];
    let fits = units.into_iter().find(|(unit, _)| seconds >= *unit);
    let (n, unit) = fits.map_or((seconds, "second"), |(of, unit)| (seconds / of, unit));
    format!("{n} {unit}{}", if n == 1 { "" } else { "s" })
}

type FileFault = (PathBuf, TlsFault);

/// Reads the certificates of a file, at least one.
fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, FileFault> {
    let bytes = read(path)?;
    let read: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&bytes).collect();
    match read {
        Ok(chain) if !chain.is_empty() => Ok(chain),
        Ok(_) => Err((path.to_owned(), no_such_text(&bytes, path, "certificate"))),
        Err(_) => Err((path.to_owned(), damaged(&bytes, "certificate"))),
    }
}

/// Reads the private key of a file.
fn private_key(path: &Path) -> Result<PrivateKeyDer<'static>, FileFault> {
    let bytes = read(path)?;
    if is_encrypted(&bytes) {
        let fault = TlsFault::new(
            "is encrypted, and nobody is there to type its passphrase",
            format!(
                "`openssl pkey -in {} -out plain.key` writes it without; keep that readable by you alone",
                path.display()
            ),
        );
        return Err((path.to_owned(), fault));
    }
    PrivateKeyDer::from_pem_slice(&bytes).map_err(|err| {
        let fault = match err {
            rustls::pki_types::pem::Error::NoItemsFound => {
                no_such_text(&bytes, path, "private key")
            }
            _ => damaged(&bytes, "private key"),
        };
        (path.to_owned(), fault)
    })
}

fn read(path: &Path) -> Result<Vec<u8>, FileFault> {
    fs::read(path).map_err(|err| {
        let advice = "check its name and its permissions";
        (
            path.to_owned(),
            TlsFault::new(format!("cannot be read: {err}"), advice),
        )
    })
}

/// Checks that a key can be used, and is that of the first certificate.
fn matched(
    chain: Vec<CertificateDer<'static>>,
    key: PrivateKeyDer<'static>,
    side: &Side,
) -> Result<(), TlsFault> {
    let certificate = side.certificate.as_deref().unwrap_or(Path::new(""));
    match CertifiedKey::from_der(chain, key, &default_provider()) {
        Ok(_) => Ok(()),
        Err(rustls::Error::InconsistentKeys(_)) => Err(TlsFault::new(
            format!(
                "is not the key of the certificate in `{}`",
                certificate.display()
            ),
            format!("name the two that were made together; {SHOWN}"),
        )),
        Err(rustls::Error::InvalidCertificate(err)) => Err(TlsFault::new(
            format!(
                "cannot be used with the certificate in `{}`: {err}",
                certificate.display()
            ),
            format!("issue it anew; {SHOWN}"),
        )),
        Err(err) => Err(TlsFault::new(
            format!("cannot be used: {err}"),
            format!(
                "use a key of ECDSA (P-256 or P-384), Ed25519 or RSA (2048 bits or more); {SHOWN}"
            ),
        )),
    }
}

fn is_encrypted(bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    text.contains("-----BEGIN ENCRYPTED PRIVATE KEY-----")
        || text.contains("Proc-Type: 4,ENCRYPTED")
}

fn damaged(bytes: &[u8], expected: &str) -> TlsFault {
    let problem = if String::from_utf8_lossy(bytes).contains("-----END ") {
        format!("is damaged: its {expected} is no base64 between `BEGIN` and `END`")
    } else {
        format!("is cut off: its {expected} has no line `-----END …-----`")
    };
    TlsFault::new(problem, "copy it again, whole")
}

/// Why a file without what is expected of it has none.
fn no_such_text(bytes: &[u8], path: &Path, expected: &str) -> TlsFault {
    let text = String::from_utf8_lossy(bytes);
    let label = text
        .split_once("-----BEGIN ")
        .and_then(|(_, rest)| rest.split_once("-----"));
    let shown = path.display();
    if let Some((label, _)) = label {
        let label = label.to_lowercase();
        let problem = format!("holds a {label}, and a {expected} is expected");
        return TlsFault::new(
            problem,
            "the names of two files may be exchanged in the access file",
        );
    }
    // A sequence of ASN.1.
    if bytes.first() == Some(&0x30) && text.contains('\u{fffd}') {
        let command = if expected == "certificate" {
            "x509"
        } else {
            "pkey"
        };
        return TlsFault::new(
            format!("holds no {expected} in PEM form; it looks like DER"),
            format!(
                "`openssl {command} -inform der -in {shown} -out {shown}.pem` writes it as PEM"
            ),
        );
    }
    TlsFault::new(
        if bytes.is_empty() {
            "is empty".to_owned()
        } else {
            format!("holds no {expected} in PEM form")
        },
        format!("it has lines `-----BEGIN …-----` and `-----END …-----`; {SHOWN} it is made"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_is_told_in_its_largest_unit() {
        for (seconds, text) in [
            (0, "0 seconds"),
            (60, "1 minute"),
            (7200, "2 hours"),
            (86_399, "23 hours"),
            (86_400, "1 day"),
            (864_000, "10 days"),
        ] {
            assert_eq!(span(seconds), text);
        }
    }
}
