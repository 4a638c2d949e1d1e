//! Certificates that live as long as a test, and the shipped access files that name them.

use std::{
    fs,
    ops::Range,
    path::{Path, PathBuf},
};

use rcgen::{
    BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa,
    Issuer, KeyPair, KeyUsagePurpose, date_time_ymd,
};
use tempfile::TempDir;

/// Placeholder for a password in a shipped file.
const PLACEHOLDER: &str = "a password of its own";

/// A year in the far future.
const AGES_HENCE: i32 = 4000;

/// A folder of certificates and access files.
pub(crate) struct CredentialFolder {
    folder: TempDir,
    /// Folder of the shipped files.
    shipped: PathBuf,
    authority: Issuer<'static, KeyPair>,
}

impl CredentialFolder {
    /// Makes an authority, and certificates and passwords of router, cell, dispatcher and viewer.
    pub(crate) fn new(shipped: &Path) -> Self {
        let folder = TempDir::new().unwrap();
        let mut authority = CertificateParams::default();
        authority.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        authority.key_usages = vec![KeyUsagePurpose::KeyCertSign];
        let key = KeyPair::generate().unwrap();
        let certificate = authority.self_signed(&key).unwrap();
        fs::write(folder.path().join("ca.pem"), certificate.pem()).unwrap();
        let credentials = Self {
            folder,
            shipped: shipped.to_owned(),
            authority: Issuer::new(authority, key),
        };
        let mut passwords = String::new();
        for name in ["router", "cell", "dispatcher", "viewer"] {
            credentials.certify(name, AGES_HENCE);
            passwords.push_str(&format!("{name}:secret of {name}\n"));
        }
        fs::write(credentials.folder.path().join("passwords.txt"), passwords).unwrap();
        credentials
    }

    /// Issues a certificate that is valid until the end of a year.
    pub(crate) fn certify(&self, name: &str, year: i32) {
        self.certify_for(name, &["localhost"], 1975..year);
    }

    /// Issues a certificate for these hosts that is valid from one year to the end of another.
    pub(crate) fn certify_for(&self, name: &str, hosts: &[&str], years: Range<i32>) {
        let hosts: Vec<String> = hosts.iter().map(|&host| host.to_owned()).collect();
        let mut person = CertificateParams::new(hosts).unwrap();
        person.distinguished_name = DistinguishedName::new();
        if !name.is_empty() {
            person.distinguished_name.push(DnType::CommonName, name);
        }
        person.not_before = date_time_ymd(years.start, 1, 1);
        person.not_after = date_time_ymd(years.end, 12, 31);
        person.extended_key_usages = vec![if name == "router" {
            ExtendedKeyUsagePurpose::ServerAuth
        } else {
            ExtendedKeyUsagePurpose::ClientAuth
        }];
        let key = KeyPair::generate().unwrap();
        let certificate = person.signed_by(&key, &self.authority).unwrap();
        let write = |ending: &str, text: String| {
            let file = self.folder.path().join(format!("{name}.{ending}"));
            fs::write(file, text).unwrap();
        };
        write("pem", certificate.pem());
        write("key", key.serialize_pem());
    }

    /// Returns a copy of a shipped file that names this folder's certificates and passwords.
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
