//! Certificates for tests, made by the `openssl` program as docs/howto/remote.md says.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

/// An authority that signs certificates.
pub struct Authority {
    folder: TempDir,
}

/// What a certificate is to be like.
#[derive(Clone, Copy)]
pub struct Wish<'a> {
    /// Its common name.
    pub name: &'a str,
    /// Whether it is a server's.
    pub server: bool,
    /// How long it is valid; a negative number has expired.
    pub days: i32,
}

/// An operator's certificate, valid today.
pub fn operator(name: &str) -> Wish<'_> {
    Wish {
        name,
        server: false,
        days: 2,
    }
}

/// The certificate of this PC.
pub fn server() -> Wish<'static> {
    Wish {
        name: "controller",
        server: true,
        days: 2,
    }
}

const KEY: [&str; 5] = [
    "-newkey",
    "ec",
    "-pkeyopt",
    "ec_paramgen_curve:prime256v1",
    "-nodes",
];

fn openssl(folder: &Path, words: &[&str]) {
    let done = Command::new("openssl")
        .args(words)
        .current_dir(folder)
        .output();
    let done = done.expect("openssl");
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "openssl {words:?}: {said}");
}

/// Whether certificates can be made here; says so if not.
pub fn can_be_made() -> bool {
    let found = Command::new("openssl").arg("version").output().is_ok();
    if !found {
        eprintln!("\n*** SKIPPED: orders over TLS: no openssl here ***\n");
    }
    found
}

impl Authority {
    pub fn new(name: &str) -> Authority {
        let folder = tempfile::tempdir().expect("a folder");
        let subject = format!("/CN={name}");
        let words = ["req", "-x509", "-days", "3", "-subj", &subject];
        let files = ["-keyout", "ca-key.pem", "-out", "ca.pem"];
        openssl(folder.path(), &[&words[..], &KEY, &files].concat());
        Authority { folder }
    }

    /// A folder with such a certificate, signed by this authority, and the certificate of the one that is trusted. It stays as long as
    /// the authority.
    pub fn identity(&self, wish: Wish, trusted: &Authority) -> PathBuf {
        let made = tempfile::Builder::new().tempdir_in(self.folder.path());
        let folder = made.expect("a folder").keep();
        let extensions = match wish.server {
            true => "subjectAltName=DNS:localhost,IP:127.0.0.1\nextendedKeyUsage=serverAuth\n",
            false => "extendedKeyUsage=clientAuth\n",
        };
        let extensions = format!("{extensions}basicConstraints=CA:FALSE\n");
        fs::write(folder.join("cert.ext"), extensions).expect("a file");
        let subject = format!("/CN={}", wish.name);
        let words = ["req", "-subj", &subject];
        let files = ["-keyout", "key.pem", "-out", "cert.csr"];
        openssl(&folder, &[&words[..], &KEY, &files].concat());
        let ca = |file: &str| self.folder.path().join(file).to_string_lossy().into_owned();
        let (authority, key, days) = (ca("ca.pem"), ca("ca-key.pem"), wish.days.to_string());
        let words = ["x509", "-req", "-in", "cert.csr", "-CA", &authority];
        let more = ["-CAkey", &key, "-CAcreateserial", "-days", &days];
        let files = ["-extfile", "cert.ext", "-out", "cert.pem"];
        openssl(&folder, &[&words[..], &more, &files].concat());
        let ca = trusted.folder.path().join("ca.pem");
        fs::copy(ca, folder.join("ca.pem")).expect("a file");
        let mode = fs::Permissions::from_mode(0o600);
        fs::set_permissions(folder.join("key.pem"), mode).expect("its mode");
        folder
    }
}
