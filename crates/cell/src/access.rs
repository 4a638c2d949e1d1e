//! Credentials, trusted peers and access rules: kept in a file, never on a command line.

use std::{
    fmt, fs, io,
    net::SocketAddr,
    path::{Path, PathBuf},
};

use serde_json::Value;
use zenoh::Config;

use crate::{
    CellError,
    error::Cause,
    tls::{Tls, TlsFault},
};

/// Settings that an access file may contain, as paths into zenoh's configuration; this program sets
/// all others.
const ALLOWED: [&[&str]; 4] = [
    &["transport", "link", "tls"],
    &["transport", "auth"],
    &["access_control"],
    &["low_pass_filter"],
];

/// Settings of an access file that name other files.
const FILES: [&str; 6] = [
    "transport/link/tls/root_ca_certificate",
    "transport/link/tls/listen_certificate",
    "transport/link/tls/listen_private_key",
    "transport/link/tls/connect_certificate",
    "transport/link/tls/connect_private_key",
    "transport/auth/usrpwd/dictionary_file",
];

/// The content of an access file: certificates, users, rules and limits.
///
/// The file is a part of a [zenoh
/// configuration](https://docs.rs/zenoh/latest/zenoh/struct.Config.html) in JSON5. It may hold
/// `transport.link.tls`, `transport.auth`, `access_control` and `low_pass_filter`, and nothing
/// else: endpoints and session behavior are set elsewhere. Paths in it are relative to the current
/// directory, as for `zenohd`.
#[derive(Clone)]
pub struct Access {
    path: PathBuf,
    config: Config,
    tls: Tls,
}

/// Why a file is not an access file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AccessFault {
    /// It cannot be read.
    #[error("{0}")]
    Read(io::Error),
    /// It is not a part of a zenoh configuration.
    #[error("{0}")]
    Configuration(Cause),
    /// zenoh cannot write what it read.
    #[error("zenoh cannot write its settings: {0}")]
    Unwritable(serde_json::Error),
    /// It has settings that are made elsewhere, by their paths.
    #[error("`{}` is not for an access file", .0.join("`, `"))]
    OtherSettings(Vec<String>),
    /// A setting cannot be read.
    #[error("`{key}` in it: {message}")]
    Setting {
        /// Path of the setting.
        key: &'static str,
        /// zenoh's message, or the parser's.
        message: String,
    },
    /// A file that it names cannot be opened.
    #[error("`{}` in it: {cause}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// Why not.
        cause: io::Error,
    },
    /// Whoever connects is neither asked for a certificate nor for a password.
    #[error(
        "it asks whoever connects for neither a certificate (`enable_mtls`) nor a password \
         (`dictionary_file`)"
    )]
    OpenToAll,
}

impl fmt::Debug for Access {
    /// Writes the file's name but no secrets.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Access").field(&self.path).finish()
    }
}

impl Access {
    /// Reads an access file.
    ///
    /// # Errors
    ///
    /// Fails if the file or one that it names cannot be read, is not part of a zenoh configuration,
    /// or contains other settings than the four above; if a certificate or key in a file that it names cannot be
    /// used, or a key is not that of its certificate.
    pub fn read(path: &Path) -> Result<Self, CellError> {
        let wrong = |fault: AccessFault| CellError::Access {
            path: path.to_owned(),
            fault,
        };
        let text = fs::read_to_string(path).map_err(|err| wrong(AccessFault::Read(err)))?;
        let config = Config::from_json5(&text)
            .map_err(|err| wrong(AccessFault::Configuration(err.into())))?;
        let value = |config: &Config| {
            let value = serde_json::to_value(config);
            value.map_err(|err| wrong(AccessFault::Unwritable(err)))
        };
        let others = differences(&value(&config)?, &value(&Config::default())?);
        if !others.is_empty() {
            return Err(wrong(AccessFault::OtherSettings(others)));
        }
        for key in FILES {
            let unknown = |message: String| wrong(AccessFault::Setting { key, message });
            let named = config
                .get_json(key)
                .map_err(|err| unknown(err.to_string()))?;
            let named = serde_json::from_str::<Option<PathBuf>>(&named);
            let Some(file) = named.map_err(|err| unknown(err.to_string()))? else {
                continue;
            };
            if let Err(cause) = fs::File::open(&file) {
                return Err(wrong(AccessFault::File { file, cause }));
            }
        }
        let tls = Tls::of(&config);
        tls.check()
            .map_err(|(file, fault)| CellError::Credentials {
                path: path.to_owned(),
                file,
                fault,
            })?;
        Ok(Self {
            path: path.to_owned(),
            config,
            tls,
        })
    }

    /// Returns why clients refuse whoever listens with this file now, if its certificate is out of date.
    pub fn stale_listener(&self) -> Option<CellError> {
        let (file, fault) = self.tls.stale_listener()?;
        Some(CellError::Credentials {
            path: self.path.clone(),
            file,
            fault,
        })
    }

    /// Returns why a router may forbid everything to who connects with this file, if its certificate has no common
    /// name.
    pub fn nameless_client(&self) -> Option<CellError> {
        let (file, fault) = self.tls.nameless_client()?;
        Some(CellError::Credentials {
            path: self.path.clone(),
            file,
            fault,
        })
    }

    /// Returns why a connection under TLS is not made, if something answers.
    pub(crate) fn handshake_fault(&self, host: &str, address: SocketAddr) -> Option<TlsFault> {
        self.tls.handshake_fault(host, address)
    }

    /// Returns the file's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns zenoh's default configuration with the file's settings applied.
    pub(crate) fn config(&self) -> Config {
        self.config.clone()
    }

    /// Checks that connecting peers must authenticate.
    ///
    /// # Errors
    ///
    /// Fails if neither a certificate nor a password is required.
    pub(crate) fn check_listener(&self) -> Result<(), CellError> {
        let said = |key: &str| self.config.get_json(key).unwrap_or_default();
        let certificates = said("transport/link/tls/enable_mtls") == "true";
        let passwords = said("transport/auth/usrpwd/dictionary_file").starts_with('"');
        if certificates || passwords {
            return Ok(());
        }
        Err(CellError::Access {
            path: self.path.clone(),
            fault: AccessFault::OpenToAll,
        })
    }
}

/// Returns the paths at which a configuration differs from the default, except for those that an
/// access file may set.
fn differences(said: &Value, default: &Value) -> Vec<String> {
    let mut found = Vec::new();
    compare(said, default, &mut Vec::new(), &mut found);
    found
}

fn compare(said: &Value, default: &Value, at: &mut Vec<String>, found: &mut Vec<String>) {
    if said == default || ALLOWED.iter().any(|path| *path == at.as_slice()) {
        return;
    }
    let (Value::Object(said), Value::Object(default)) = (said, default) else {
        found.push(at.join("."));
        return;
    };
    for (key, value) in said {
        at.push(key.clone());
        compare(value, default.get(key).unwrap_or(&Value::Null), at, found);
        at.pop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Access, CellError> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("access.json5");
        fs::write(&file, text).unwrap();
        Access::read(&file)
    }

    #[test]
    fn access_file_holds_nothing_but_credentials() {
        let good = "{ transport: { link: { tls: { enable_mtls: true } } }, low_pass_filter: [] }";
        assert!(read(good).unwrap().check_listener().is_ok());
        for (text, part) in [
            ("{ mode: 'peer' }", "`mode`"),
            (
                "{ connect: { endpoints: ['tcp/10.0.0.1:7447'] } }",
                "`connect.endpoints`",
            ),
            (
                "{ scouting: { multicast: { enabled: true } } }",
                "`scouting.multicast.enabled`",
            ),
            (
                "{ transport: { link: { tx: { lease: 1 } } } }",
                "`transport.link.tx.lease`",
            ),
            ("{ acces_control: {} }", "acces_control"),
            ("{", "access.json5"),
            (
                "{ transport: { link: { tls: { connect_private_key: 'no/such.key' } } } }",
                "`no/such.key` in it: ",
            ),
        ] {
            let err = read(text).unwrap_err().to_string();
            assert!(err.contains(part), "{text}: {err}");
        }
        assert!(read("{}").unwrap().check_listener().is_err());
        assert!(Access::read(Path::new("/nowhere")).is_err());
    }

    #[test]
    fn a_password_is_not_shown() {
        let text = "{ transport: { auth: { usrpwd: { user: 'a', password: 'secret' } } } }";
        let shown = format!("{:?}", read(text).unwrap());
        assert!(
            shown.contains("access.json5") && !shown.contains("secret"),
            "{shown}"
        );
    }
}
