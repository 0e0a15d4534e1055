//! Answers scrapes: GET and HEAD of `/metrics` over HTTP/1, many connections in one thread, each closed after its answer.
//!
//! Everything has a bound: the connections, the head of a request, the time of a connection. A client that sends nothing, or takes
//! nothing, is disconnected after [`PATIENCE`] and keeps no other waiting.

use std::convert::Infallible;
use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;

use hyper::body::Incoming;
use hyper::header::{ACCEPT, ALLOW, CONTENT_TYPE, HeaderValue};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::TokioIo;

use super::exposition::{self, Dialect};
use super::served::Served;
use crate::guests;

/// The most connections at a time; the oldest goes where another one comes.
const CONNECTIONS_MAX: usize = 16;
/// The longest head of a request.
const HEAD_BYTES: usize = 8 << 10;
/// The longest time for a request and its answer; a test waits for it.
const PATIENCE: Duration = Duration::from_secs(if cfg!(test) { 1 } else { 4 });

/// Answers at `listener` in a thread of its own, as long as the process lives.
///
/// # Errors
/// The thread cannot be started.
pub fn start(listener: TcpListener, served: Served) -> std::io::Result<()> {
    serve(listener, move |request| respond(request, &served))
}

fn serve(
    listener: TcpListener,
    respond: impl Fn(&Request<Incoming>) -> Response<String> + Send + Sync + 'static,
) -> std::io::Result<()> {
    let respond = Arc::new(respond);
    guests::serve(listener, "qd-metrics", CONNECTIONS_MAX, move |stream, _| {
        let respond = Arc::clone(&respond);
        async move {
            let service = service_fn(async |request| Ok::<_, Infallible>(respond(&request)));
            let connection = http1::Builder::new()
                .keep_alive(false)
                .max_buf_size(HEAD_BYTES)
                .title_case_headers(true)
                .serve_connection(TokioIo::new(stream), service);
            // Whether a client leaves early is its own affair.
            let _ = tokio::time::timeout(PATIENCE, connection).await;
        }
    })
}

fn respond(request: &Request<Incoming>, served: &Served) -> Response<String> {
    if request.method() != Method::GET && request.method() != Method::HEAD {
        let mut response = plain(
            StatusCode::METHOD_NOT_ALLOWED,
            "metrics are read with GET\n",
        );
        let allowed = HeaderValue::from_static("GET, HEAD");
        response.headers_mut().insert(ALLOW, allowed);
        return response;
    }
    if request.uri().path() != "/metrics" {
        return plain(StatusCode::NOT_FOUND, "metrics are at /metrics\n");
    }
    let mut accepted = request.headers().get_all(ACCEPT).iter();
    let dialect = if accepted.any(|value| {
        let value = value.to_str().unwrap_or_default();
        value.contains("application/openmetrics-text")
    }) {
        Dialect::OpenMetrics
    } else {
        Dialect::PrometheusText
    };
    match exposition::text(served, dialect) {
        Ok(text) => response(StatusCode::OK, dialect.content_type(), text),
        Err(_) => plain(StatusCode::INTERNAL_SERVER_ERROR, ""),
    }
}

fn plain(status: StatusCode, words: &str) -> Response<String> {
    response(status, "text/plain; charset=utf-8", words.into())
}

fn response(status: StatusCode, kind: &'static str, body: String) -> Response<String> {
    let mut response = Response::new(body);
    *response.status_mut() = status;
    let kind = HeaderValue::from_static(kind);
    response.headers_mut().insert(CONTENT_TYPE, kind);
    response
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::{SocketAddr, TcpStream};

    use bus::cell::CellPaths;

    use super::*;
    use crate::metrics::numbers::Numbers;

    fn served() -> Served {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let machine = machine::Machine::load(&root.join("machines/xy")).expect("a machine");
        Served {
            place: CellPaths::new("metrics-of-no-cell").expect("a name"),
            numbers: Arc::new(Numbers::new(&machine, bus::member::Pace::Lockstep)),
            recorder: Arc::default(),
        }
    }

    /// A server and where it is.
    fn started() -> SocketAddr {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a socket");
        let address = listener.local_addr().expect("its address");
        start(listener, served()).expect("a server");
        address
    }

    /// What a request is answered.
    fn answer(address: SocketAddr, request: &str) -> String {
        let mut stream = TcpStream::connect(address).expect("a connection");
        stream.write_all(request.as_bytes()).expect("a request");
        let mut text = String::new();
        stream.read_to_string(&mut text).expect("an answer");
        text
    }

    #[test]
    fn metrics_are_read_with_get_at_their_path_and_nothing_else_is_there() {
        let address = started();
        let status = |head: &str| {
            let answer = answer(address, head);
            let line = answer.lines().next().unwrap_or_default();
            line.split_once(' ').unwrap_or_default().1.to_string()
        };
        assert_eq!(status("GET /metrics HTTP/1.1\r\n\r\n"), "200 OK");
        assert_eq!(status("GET /metrics?a=1 HTTP/1.0\r\n\r\n"), "200 OK");
        assert_eq!(status("GET / HTTP/1.1\r\n\r\n"), "404 Not Found");
        let not_allowed = answer(address, "POST /metrics HTTP/1.1\r\n\r\n");
        assert!(
            not_allowed.starts_with("HTTP/1.1 405 Method Not Allowed\r\n"),
            "{not_allowed}"
        );
        assert!(not_allowed.contains("\r\nAllow: GET, HEAD\r\n"));
        assert_eq!(status("GET /metrics\r\n\r\n"), "400 Bad Request");
        assert_eq!(status("\u{0}\r\n\r\n"), "400 Bad Request");
        assert_eq!(
            status(&"x".repeat(HEAD_BYTES)),
            "431 Request Header Fields Too Large"
        );
        let head = answer(address, "HEAD /metrics HTTP/1.1\r\n\r\n");
        assert!(head.starts_with("HTTP/1.1 200 OK\r\n"), "{head}");
        assert!(head.ends_with("\r\n\r\n"), "{head}");
    }

    #[test]
    fn idle_connections_keep_no_scrape_waiting_and_are_closed() {
        let address = started();
        let connect = || TcpStream::connect(address).expect("a connection");
        let mut silent = connect();
        let mut half = connect();
        half.write_all(b"GET /met").expect("half a request");
        let text = answer(
            address,
            "GET /metrics HTTP/1.1\r\nAccept: application/openmetrics-text\r\n\r\n",
        );
        silent.set_nonblocking(true).expect("a socket");
        let still_open = silent.read(&mut [0]).expect_err("nothing is sent");
        assert_eq!(still_open.kind(), std::io::ErrorKind::WouldBlock);
        silent.set_nonblocking(false).expect("a socket");
        assert!(text.starts_with("HTTP/1.1 200 OK"), "{text}");
        assert!(text.ends_with("# EOF\n"), "{text}");
        // As many as there may be and more: the oldest go, and the scrape is answered while others are silent still.
        let idle: Vec<TcpStream> = (0..CONNECTIONS_MAX + 4).map(|_| connect()).collect();
        let text = answer(address, "GET /metrics HTTP/1.1\r\n\r\n");
        assert!(text.starts_with("HTTP/1.1 200 OK"), "{text}");
        drop(idle);
        for stream in [&mut silent, &mut half] {
            let mut nothing = Vec::new();
            let _ = stream.read_to_end(&mut nothing);
            assert!(nothing.is_empty());
        }
    }

    #[test]
    fn a_client_that_takes_nothing_is_disconnected() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a socket");
        let address = listener.local_addr().expect("its address");
        // More than any socket takes by itself.
        serve(listener, |_| Response::new("x".repeat(64 << 20))).expect("a server");
        let mut client = TcpStream::connect(address).expect("a connection");
        client
            .write_all(b"GET / HTTP/1.1\r\n\r\n")
            .expect("a request");
        std::thread::sleep(PATIENCE + PATIENCE / 4);
        let mut taken = Vec::new();
        let _ = client.read_to_end(&mut taken);
        assert!(taken.len() < 64 << 20, "{} bytes", taken.len());
    }
}
