//! Whether a place can be reached over TLS with these certificates, and if not, why: zenoh says no more than that it cannot.

use std::io::ErrorKind;
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustls::crypto::ring;
use rustls::pki_types::ServerName;
use rustls::version::TLS13;
use rustls::{ClientConfig, ClientConnection, RootCertStore};

use super::{Identity, OrdersError, TlsPlace};

/// So long each step may last.
const STEP_LIMIT: Duration = Duration::from_secs(1);
/// A server that does not want a certificate says so within this time; one that takes it says nothing.
const REFUSAL_LIMIT: Duration = Duration::from_millis(300);

/// Shakes hands as zenoh will, and goes.
///
/// # Errors
/// Nobody is there, one side does not believe the other's certificate, or the key is none for the certificate.
pub(super) fn reach(place: &TlsPlace, identity: &Identity) -> Result<(), OrdersError> {
    let unreachable = |why: String| OrdersError::NotReached {
        place: place.to_string(),
        why,
    };
    let mut connection = client(place, identity).map_err(unreachable)?;
    let mut stream = connected(place).map_err(unreachable)?;
    let begun = Instant::now();
    while connection.is_handshaking() {
        if begun.elapsed() > STEP_LIMIT {
            return Err(unreachable("it does not speak TLS".into()));
        }
        let shaken = connection.complete_io(&mut stream);
        shaken.map_err(|error| unreachable(words(&error)))?;
    }
    while connection.wants_write() {
        let sent = connection.write_tls(&mut stream);
        sent.map_err(|error| unreachable(words(&error)))?;
    }
    // With TLS 1.3 the client is done before the server has judged its certificate. What the server sends then is an alert, or
    // tickets for the next session.
    let _ = stream.set_read_timeout(Some(REFUSAL_LIMIT));
    match connection.complete_io(&mut stream) {
        Ok((0, _)) => return Err(unreachable("it hangs up".into())),
        Err(error) if !waited(&error) => return Err(unreachable(words(&error))),
        _ => {}
    }
    connection.send_close_notify();
    let _ = connection.write_tls(&mut stream);
    Ok(())
}

fn waited(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
}

/// What an error of TLS means to whoever put the certificates there.
fn words(error: &std::io::Error) -> String {
    if waited(error) {
        return "it does not answer".into();
    }
    let inner = error
        .get_ref()
        .and_then(|e| e.downcast_ref::<rustls::Error>());
    match inner {
        Some(rustls::Error::InvalidCertificate(why)) => {
            format!("its certificate is not believed here (ca.pem): {why:?}")
        }
        Some(rustls::Error::AlertReceived(alert)) => {
            format!("it does not believe this certificate (cert.pem): {alert:?}")
        }
        Some(other) => other.to_string(),
        None => format!("it hangs up: {error}"),
    }
}

fn client(place: &TlsPlace, identity: &Identity) -> Result<ClientConnection, String> {
    let mut roots = RootCertStore::empty();
    for authority in identity.authorities() {
        roots
            .add(authority)
            .map_err(|error| format!("ca.pem: {error}"))?;
    }
    let key = identity
        .private_key()
        .ok_or("key.pem holds no private key")?;
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_protocol_versions(&[&TLS13])
        .map_err(|error| error.to_string())?
        .with_root_certificates(roots)
        .with_client_auth_cert(identity.chain(), key)
        .map_err(|error| format!("cert.pem and key.pem: {error}"))?;
    let (host, _) = place.host_and_port();
    let name =
        ServerName::try_from(host.to_string()).map_err(|error| format!("{host}: {error}"))?;
    ClientConnection::new(Arc::new(config), name).map_err(|error| error.to_string())
}

fn connected(place: &TlsPlace) -> Result<TcpStream, String> {
    let (host, port) = place.host_and_port();
    let addresses = (host, port)
        .to_socket_addrs()
        .map_err(|error| error.to_string())?;
    let mut why = "the name has no address".to_string();
    // zenoh takes the first.
    for address in addresses.take(1) {
        match TcpStream::connect_timeout(&address, STEP_LIMIT) {
            Ok(stream) => {
                let limit = Some(STEP_LIMIT);
                let set = stream
                    .set_read_timeout(limit)
                    .and(stream.set_write_timeout(limit));
                return set.map(|()| stream).map_err(|error| error.to_string());
            }
            Err(error) => why = error.to_string(),
        }
    }
    Err(why)
}
