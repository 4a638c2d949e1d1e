//! Certificates that live as long as a test, and the shipped access files that name them.

use std::{
    fs,
    path::{Path, PathBuf},
};

use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair,
    KeyUsagePurpose,
};
use tempfile::TempDir;

/// What a shipped file says instead of a password.
const PLACEHOLDER: &str = "a password of its own";

/// A folder of certificates and access files.
pub(crate) struct Papers {
    folder: TempDir,
    /// Where the shipped files are.
    shipped: PathBuf,
}

impl Papers {
    /// Makes an authority and what it says of a router, a cell, a dispatcher and a viewer.
    pub(crate) fn new(shipped: &Path) -> Self {
        let folder = TempDir::new().unwrap();
        let mut authority = CertificateParams::default();
        authority.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        authority.key_usages = vec![KeyUsagePurpose::KeyCertSign];
        let key = KeyPair::generate().unwrap();
        let certificate = authority.self_signed(&key).unwrap();
        let write = |name: String, text: &str| fs::write(folder.path().join(name), text).unwrap();
        write("ca.pem".to_owned(), &certificate.pem());
        let issuer = Issuer::new(authority, key);
        let mut passwords = String::new();
        for name in ["router", "cell", "dispatcher", "viewer"] {
            let mut person = CertificateParams::new(vec!["localhost".to_owned()]).unwrap();
            person.distinguished_name.push(DnType::CommonName, name);
            person.extended_key_usages = vec![if name == "router" {
                ExtendedKeyUsagePurpose::ServerAuth
            } else {
                ExtendedKeyUsagePurpose::ClientAuth
            }];
            let key = KeyPair::generate().unwrap();
            let certificate = person.signed_by(&key, &issuer).unwrap();
            write(format!("{name}.pem"), &certificate.pem());
            write(format!("{name}.key"), &key.serialize_pem());
            passwords.push_str(&format!("{name}:secret of {name}\n"));
        }
        write("passwords.txt".to_owned(), &passwords);
        Self {
            folder,
            shipped: shipped.to_owned(),
        }
    }

    /// Returns a copy of a shipped file that names what is in this folder.
    pub(crate) fn file(&self, way: &str, who: &str) -> PathBuf {
        let shipped = self.shipped.join(way).join(format!("{who}.json5"));
        let text = fs::read_to_string(shipped).unwrap();
        let here = format!("\"{}/", self.folder.path().display());
        let text = text.replace("\"certificates/", &here);
        let text = text.replace(PLACEHOLDER, &format!("secret of {who}"));
        let file = self.folder.path().join(format!("{way}-{who}.json5"));
        fs::write(&file, text).unwrap();
        file
    }
}
