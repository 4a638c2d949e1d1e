//! Connections under TLS that are not made, and certificates and keys that cannot be used: each is said with what is
//! wrong, on both sides.

use std::{
    fs,
    net::TcpListener,
    path::{Path, PathBuf},
    thread,
    time::Duration,
};

use cell::{Access, CellClient, CellError, Router};

use crate::credential_folder::CredentialFolder;

/// Timeout of a client that is refused.
const REFUSED: Duration = Duration::from_millis(600);
/// A year in the far future.
const AGES_HENCE: i32 = 4000;

fn credentials() -> CredentialFolder {
    CredentialFolder::new(Path::new(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../data/access"
    )))
}

/// The path of a file beside the access files.
fn beside(credentials: &CredentialFolder, name: &str) -> PathBuf {
    credentials
        .file("certificates", "cell")
        .with_file_name(name)
}

fn access(credentials: &CredentialFolder, who: &str) -> Access {
    Access::read(&credentials.file("certificates", who)).unwrap()
}

/// The error of a dispatcher with these credentials at an endpoint.
fn refused(credentials: &CredentialFolder, endpoint: &str) -> CellError {
    let access = access(credentials, "dispatcher");
    let connected = CellClient::connect_as(Some(&access), endpoint, "simulated", REFUSED);
    connected.map(drop).unwrap_err()
}

#[track_caller]
fn says(err: &CellError, parts: &[&str]) {
    let said = format!("{err}; {}", err.hint().unwrap_or_default());
    for part in parts {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
}

#[test]
fn a_refused_certificate_of_the_router_is_named_with_its_fault() {
    let hosts: [(&[&str], _, &[&str]); 4] = [
        (
            &["localhost"],
            1975..2020,
            &["its certificate expired ", " days ago", "clocks"],
        ),
        (
            &["localhost"],
            3000..AGES_HENCE,
            &["its certificate is not valid yet: it begins in ", " days"],
        ),
        (
            &["other.lab"],
            1975..AGES_HENCE,
            &[
                "its certificate is for `other.lab`, not for `localhost`",
                "subjectAltName",
            ],
        ),
        (&[], 1975..AGES_HENCE, &["its certificate names no host"]),
    ];
    for (hosts, years, parts) in hosts {
        let credentials = credentials();
        credentials.certify_for("router", hosts, years);
        let router =
            Router::start("tls/localhost:0", Some(&access(&credentials, "router"))).unwrap();
        says(&refused(&credentials, router.endpoint()), parts);
    }
    let (here, there) = (credentials(), credentials());
    let router = Router::start("tls/localhost:0", Some(&access(&there, "router"))).unwrap();
    let parts = [
        "its certificate is not issued by the authority in `",
        "ca.pem`",
    ];
    says(&refused(&here, router.endpoint()), &parts);
}

#[test]
fn a_refused_certificate_of_a_client_is_named_with_its_fault() {
    let credentials = credentials();
    let router = Router::start("tls/localhost:0", Some(&access(&credentials, "router"))).unwrap();
    credentials.certify_for("dispatcher", &["localhost"], 1975..2020);
    let parts = [
        "it refuses the certificate `",
        "dispatcher.pem`, which expired ",
    ];
    says(&refused(&credentials, router.endpoint()), &parts);
    credentials.certify_for("dispatcher", &["localhost"], 3000..AGES_HENCE);
    says(
        &refused(&credentials, router.endpoint()),
        &["dispatcher.pem`, which is not valid yet"],
    );
    // One of another authority.
    let others = self::credentials();
    for ending in ["pem", "key"] {
        let name = format!("dispatcher.{ending}");
        fs::copy(beside(&others, &name), beside(&credentials, &name)).unwrap();
    }
    let parts = ["it does not know the authority that issued it"];
    says(&refused(&credentials, router.endpoint()), &parts);
    // None at all.
    let file = credentials.file("passwords", "dispatcher");
    let none = Access::read(&file).unwrap();
    let err = CellClient::connect_as(Some(&none), router.endpoint(), "simulated", REFUSED);
    let parts = [
        "it wants a certificate of who connects",
        "connect_certificate",
    ];
    says(&err.map(drop).unwrap_err(), &parts);
}

#[test]
fn a_wrong_password_and_silence_are_no_faults_of_tls() {
    let credentials = credentials();
    let router = credentials.file("passwords", "router");
    let router = Router::start("tls/localhost:0", Some(&Access::read(&router).unwrap())).unwrap();
    let file = credentials.file("passwords", "dispatcher");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, text.replace("secret of dispatcher", "a guess")).unwrap();
    let guess = Access::read(&file).unwrap();
    let err = CellClient::connect_as(Some(&guess), router.endpoint(), "simulated", REFUSED);
    let err = err.map(drop).unwrap_err();
    assert!(matches!(err, CellError::Connect { .. }), "{err}");
    let endpoint = router.endpoint().to_owned();
    drop(router);
    let err = refused(&credentials, &endpoint);
    assert!(matches!(err, CellError::Connect { .. }), "{err}");
}

#[test]
fn what_listens_without_tls_is_told_apart() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let endpoint = format!("tls/{}", listener.local_addr().unwrap());
    thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let _sent =
                std::io::Write::write_all(&mut &stream, b"HTTP/1.1 400 Bad Request\r\n\r\n");
        }
    });
    says(&refused(&credentials(), &endpoint), &["does not speak TLS"]);
}

#[test]
fn keys_and_certificates_that_cannot_be_used_are_found_when_the_file_is_read() {
    let pem = |label: &str| format!("-----BEGIN {label}-----\nMA==\n-----END {label}-----\n");
    let cut = |credentials: &CredentialFolder, name: &str| {
        let text = fs::read_to_string(beside(credentials, name)).unwrap();
        text[..text.len() / 2].to_owned()
    };
    let other = credentials();
    let key = |name: &str| fs::read_to_string(beside(&other, name)).unwrap();
    let credentials = credentials();
    let der = [0x30, 0x82, 0x01, 0xff, 0xfe];
    let cases: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("cell.key", key("cell.key").into(), &["is not the key of the certificate in `", "cell.pem`"]),
        (
            "cell.key",
            pem("ENCRYPTED PRIVATE KEY").into(),
            &["is encrypted", "`openssl pkey -in ", "cell.key -out"],
        ),
        (
            "cell.key",
            "-----BEGIN RSA PRIVATE KEY-----\nProc-Type: 4,ENCRYPTED\n\nMA==\n-----END RSA PRIVATE KEY-----\n".into(),
            &["is encrypted"],
        ),
        ("cell.key", key("cell.pem").into(), &["holds a certificate, and a private key is expected"]),
        ("cell.pem", key("cell.key").into(), &["holds a private key, and a certificate is expected"]),
        ("cell.key", der.into(), &["holds no private key in PEM form", "openssl pkey -inform der"]),
        ("cell.pem", der.into(), &["holds no certificate in PEM form", "openssl x509 -inform der"]),
        ("ca.pem", b"a lab\n".into(), &["ca.pem`", "holds no certificate in PEM form"]),
        ("ca.pem", Vec::new(), &["ca.pem`", "is empty"]),
        ("cell.pem", cut(&credentials, "cell.pem").into(), &["is cut off"]),
        ("cell.key", cut(&credentials, "cell.key").into(), &["is cut off"]),
        ("cell.key", pem("PRIVATE KEY").into(), &["cannot be used"]),
        ("cell.pem", pem("CERTIFICATE").into(), &["cannot be used with the certificate in"]),
    ];
    for (name, bytes, parts) in cases {
        let before = fs::read(beside(&credentials, name)).unwrap();
        fs::write(beside(&credentials, name), bytes).unwrap();
        let file: PathBuf = credentials.file("certificates", "cell");
        let err = Access::read(&file).unwrap_err();
        assert!(matches!(err, CellError::Credentials { .. }), "{err}");
        says(&err, parts);
        says(&err, &["certificates-cell.json5"]);
        fs::write(beside(&credentials, name), before).unwrap();
        assert!(Access::read(&file).is_ok(), "{name}");
    }
}

#[test]
fn a_listener_with_a_stale_certificate_is_told() {
    let credentials = credentials();
    assert!(access(&credentials, "router").stale_listener().is_none());
    credentials.certify_for("router", &["localhost"], 1975..2020);
    let stale = access(&credentials, "router").stale_listener().unwrap();
    says(&stale, &["router.pem`", " expired "]);
}

#[test]
fn a_client_whose_certificate_has_no_name_is_told() {
    let credentials = credentials();
    assert!(access(&credentials, "cell").nameless_client().is_none());
    credentials.certify_for("", &["localhost"], 1975..AGES_HENCE);
    for ending in ["pem", "key"] {
        let from = beside(&credentials, &format!(".{ending}"));
        fs::copy(from, beside(&credentials, &format!("cell.{ending}"))).unwrap();
    }
    let nameless = access(&credentials, "cell").nameless_client().unwrap();
    says(&nameless, &["cell.pem`", "has no common name", "-subj"]);
}
