//! Certificates of one side, as they are on disk.

use std::fmt;
use std::fs::OpenOptions;
use std::io::Read;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;

use base64::prelude::{BASE64_STANDARD, Engine};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use zenoh::Config;

use super::OrdersError;
use crate::link::{LinkError, failed};

/// No file of these is larger.
const FILE_BYTES_MAX: u64 = 64 << 10;

/// The certificate of the authority, one's own certificate and its key.
#[derive(Clone)]
pub struct Identity {
    authority: String,
    certificate: String,
    key: String,
}

// A key is not for logs.
impl fmt::Debug for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Identity").finish_non_exhaustive()
    }
}

impl Identity {
    /// `ca.pem`, `cert.pem` and `key.pem` of a folder. They are read here, once: what was judged is what is used.
    ///
    /// # Errors
    /// One is not there or holds something else, or others than its owner may read the key.
    pub fn of(folder: &Path) -> Result<Identity, OrdersError> {
        let identity = Identity {
            authority: text(&folder.join("ca.pem"), false)?,
            certificate: text(&folder.join("cert.pem"), false)?,
            key: text(&folder.join("key.pem"), true)?,
        };
        let wrong = |file: &str, what: &str| OrdersError::File {
            path: folder.join(file),
            what: what.into(),
        };
        if identity.authorities().is_empty() {
            return Err(wrong("ca.pem", "holds no certificate (PEM)"));
        }
        if identity.chain().is_empty() {
            return Err(wrong("cert.pem", "holds no certificate (PEM)"));
        }
        if identity.private_key().is_none() {
            return Err(wrong("key.pem", "holds no private key (PEM)"));
        }
        Ok(identity)
    }

    pub(super) fn authorities(&self) -> Vec<CertificateDer<'static>> {
        certificates(&self.authority)
    }

    pub(super) fn chain(&self) -> Vec<CertificateDer<'static>> {
        certificates(&self.certificate)
    }

    pub(super) fn private_key(&self) -> Option<PrivateKeyDer<'static>> {
        PrivateKeyDer::from_pem_slice(self.key.as_bytes()).ok()
    }

    /// TLS alone, certificates of both sides, of this authority alone, and the name that was connected to.
    pub(super) fn put_into(&self, config: &mut Config) -> Result<(), LinkError> {
        let base64 = |text: &str| format!("\"{}\"", BASE64_STANDARD.encode(text));
        let (certificate, key) = (base64(&self.certificate), base64(&self.key));
        for (name, value) in [
            ("link/protocols", r#"["tls"]"#.into()),
            (
                "link/tls/root_ca_certificate_base64",
                base64(&self.authority),
            ),
            ("link/tls/listen_certificate_base64", certificate.clone()),
            ("link/tls/listen_private_key_base64", key.clone()),
            ("link/tls/connect_certificate_base64", certificate),
            ("link/tls/connect_private_key_base64", key),
            ("link/tls/enable_mtls", "true".into()),
            ("link/tls/verify_name_on_connect", "true".into()),
            ("link/tls/close_link_on_expiration", "true".into()),
        ] {
            config
                .insert_json5(&format!("transport/{name}"), &value)
                .map_err(failed(&format!("zenoh's setting transport/{name}")))?;
        }
        Ok(())
    }
}

fn certificates(text: &str) -> Vec<CertificateDer<'static>> {
    let each = CertificateDer::pem_slice_iter(text.as_bytes());
    each.collect::<Result<_, _>>().unwrap_or_default()
}

/// What a file holds; of a secret one, only if nobody but its owner can read it.
fn text(path: &Path, secret: bool) -> Result<String, OrdersError> {
    let wrong = |what: String| OrdersError::File {
        path: path.into(),
        what,
    };
    // A FIFO is not waited for.
    let flags = rustix::fs::OFlags::NONBLOCK.bits().cast_signed();
    let opened = OpenOptions::new().read(true).custom_flags(flags).open(path);
    let file = opened.map_err(|error| wrong(error.to_string()))?;
    let found = file.metadata().map_err(|error| wrong(error.to_string()))?;
    if !found.is_file() || found.len() > FILE_BYTES_MAX {
        return Err(wrong("is no file, or a large one".into()));
    }
    if secret && found.mode() & 0o077 != 0 {
        return Err(wrong("others may read it: chmod 600".into()));
    }
    let user = rustix::process::geteuid().as_raw();
    if secret && ![0, user].contains(&found.uid()) {
        return Err(wrong("belongs to another user".into()));
    }
    let mut text = String::new();
    let read = file.take(FILE_BYTES_MAX).read_to_string(&mut text);
    read.map_err(|error| wrong(error.to_string()))?;
    Ok(text)
}
