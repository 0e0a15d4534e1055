//! Answers scrapes: HTTP/1.1, GET and HEAD of `/metrics`, one connection after the other, each closed after its answer.
//!
//! Everything has a bound: the head of a request, the time that one connection may take, the length of an answer. Who sends
//! nothing, or takes nothing, is let go after [`PATIENCE`], and keeps nobody waiting but the next scrape.

use std::fmt::Write as _;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

use super::exposition::{self, Dialect};
use super::served::Served;

/// The longest head of a request.
const HEAD_BYTES: usize = 8 << 10;
/// The longest time for a request, and for its answer.
const PATIENCE: Duration = Duration::from_secs(2);
/// So long a client that has its answer may take to go.
const FAREWELL: Duration = Duration::from_millis(200);
/// Wait after an accept that failed, as when no descriptor is left.
const PAUSE: Duration = Duration::from_millis(100);
const STACK_BYTES: usize = 256 << 10;

/// Answers at `listener` in a thread of its own, as long as the process lives.
///
/// # Errors
/// The thread cannot be started.
pub fn start(listener: TcpListener, served: Served) -> std::io::Result<()> {
    // The launcher's end is the same open socket: it must block for this thread to sleep.
    listener.set_nonblocking(false)?;
    let thread = std::thread::Builder::new()
        .name("qd-metrics".into())
        .stack_size(STACK_BYTES);
    thread.spawn(move || {
        loop {
            match listener.accept() {
                // A client that leaves in the middle is its own affair.
                Ok((stream, _)) => drop(answer(stream, &served)),
                Err(_) => std::thread::sleep(PAUSE),
            }
        }
    })?;
    Ok(())
}

fn answer(mut stream: TcpStream, served: &Served) -> std::io::Result<()> {
    let until = Instant::now() + PATIENCE;
    let head = read_head(&mut stream, until)?;
    let response = respond(head.as_deref(), served);
    let until = Instant::now() + PATIENCE;
    write_until(&mut stream, response.as_bytes(), until)?;
    stream.shutdown(std::net::Shutdown::Write)?;
    // What the client still sends is taken away, else the kernel would reset the connection before the answer is read.
    let until = until.min(Instant::now() + FAREWELL);
    let mut rest = [0; 1024];
    for _ in 0..HEAD_BYTES / rest.len() {
        stream.set_read_timeout(Some(left(until)?))?;
        if stream.read(&mut rest)? == 0 {
            break;
        }
    }
    Ok(())
}

fn left(until: Instant) -> std::io::Result<Duration> {
    let left = until.saturating_duration_since(Instant::now());
    if left.is_zero() {
        return Err(std::io::ErrorKind::TimedOut.into());
    }
    Ok(left)
}

/// The head of a request, up to its empty line; none if it is longer than [`HEAD_BYTES`].
fn read_head(stream: &mut TcpStream, until: Instant) -> std::io::Result<Option<String>> {
    let mut head = Vec::with_capacity(1024);
    let mut buffer = [0; 1024];
    while !head.windows(4).any(|end| end == b"\r\n\r\n") {
        if head.len() > HEAD_BYTES {
            return Ok(None);
        }
        stream.set_read_timeout(Some(left(until)?))?;
        let read = stream.read(&mut buffer)?;
        if read == 0 {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        head.extend_from_slice(buffer.get(..read).unwrap_or_default());
    }
    Ok(Some(String::from_utf8_lossy(&head).into_owned()))
}

fn write_until(stream: &mut TcpStream, mut bytes: &[u8], until: Instant) -> std::io::Result<()> {
    while !bytes.is_empty() {
        stream.set_write_timeout(Some(left(until)?))?;
        let written = stream.write(bytes)?;
        if written == 0 {
            return Err(std::io::ErrorKind::WriteZero.into());
        }
        bytes = bytes.get(written..).unwrap_or_default();
    }
    Ok(())
}

fn respond(head: Option<&str>, served: &Served) -> String {
    let plain = "text/plain; charset=utf-8";
    let Some(head) = head else {
        return response("431 Request Header Fields Too Large", plain, "", "", false);
    };
    let mut lines = head.lines();
    let mut request = lines.next().unwrap_or_default().split(' ');
    let (method, target) = (
        request.next().unwrap_or_default(),
        request.next().unwrap_or_default(),
    );
    if !request.next().is_some_and(|v| v.starts_with("HTTP/1.")) {
        return response("400 Bad Request", plain, "", "not HTTP/1.1\n", false);
    }
    let without_body = method == "HEAD";
    if method != "GET" && !without_body {
        let words = "metrics are read with GET\n";
        return response(
            "405 Method Not Allowed",
            plain,
            "Allow: GET, HEAD\r\n",
            words,
            false,
        );
    }
    let path = target.split('?').next().unwrap_or_default();
    if path != "/metrics" {
        let words = "metrics are at /metrics\n";
        return response("404 Not Found", plain, "", words, without_body);
    }
    let accept = lines.filter_map(|line| line.split_once(':'));
    let dialect = accept
        .filter(|(name, _)| name.eq_ignore_ascii_case("accept"))
        .any(|(_, value)| value.contains("application/openmetrics-text"));
    let dialect = if dialect {
        Dialect::OpenMetrics
    } else {
        Dialect::PrometheusText
    };
    match exposition::text(served, dialect) {
        Ok(text) => response("200 OK", dialect.content_type(), "", &text, without_body),
        Err(_) => response("500 Internal Server Error", plain, "", "", without_body),
    }
}

fn response(status: &str, kind: &str, more: &str, body: &str, without_body: bool) -> String {
    let length = body.len();
    let mut text = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\n{more}Connection: close\r\n\r\n"
    );
    if !without_body {
        let _ = text.write_str(body);
    }
    text
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use bus::cell::CellPaths;

    use super::*;
    use crate::metrics::numbers::Numbers;

    fn served() -> Served {
        let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let machine = machine::Machine::load(&root.join("machines/xy")).expect("a machine");
        Served {
            place: CellPaths::new("metrics-of-no-cell").expect("a name"),
            numbers: Arc::new(Numbers::new(&machine, bus::member::Pace::Lockstep)),
            log: root,
            program: None,
        }
    }

    fn status(head: &str) -> String {
        let response = respond(Some(head), &served());
        response.lines().next().unwrap_or_default().into()
    }

    #[test]
    fn metrics_are_read_with_get_at_their_path_and_nothing_else_is_there() {
        assert_eq!(status("GET /metrics HTTP/1.1\r\n\r\n"), "HTTP/1.1 200 OK");
        assert_eq!(
            status("GET /metrics?a=1 HTTP/1.0\r\n\r\n"),
            "HTTP/1.1 200 OK"
        );
        assert_eq!(status("GET / HTTP/1.1\r\n\r\n"), "HTTP/1.1 404 Not Found");
        assert_eq!(
            status("POST /metrics HTTP/1.1\r\n\r\n"),
            "HTTP/1.1 405 Method Not Allowed"
        );
        assert_eq!(status("GET /metrics"), "HTTP/1.1 400 Bad Request");
        assert_eq!(status("\u{0}\r\n\r\n"), "HTTP/1.1 400 Bad Request");
        assert!(respond(None, &served()).starts_with("HTTP/1.1 431 "));
        let head = respond(Some("HEAD /metrics HTTP/1.1\r\n\r\n"), &served());
        assert!(head.ends_with("\r\n\r\n"), "{head}");
    }

    #[test]
    fn who_sends_nothing_or_no_end_is_let_go_and_the_next_scrape_is_answered() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a socket");
        let address = listener.local_addr().expect("its address");
        start(listener, served()).expect("a server");
        let mut silent = TcpStream::connect(address).expect("a connection");
        let mut endless = TcpStream::connect(address).expect("a connection");
        // Queued behind the silent one; the server may close it in the middle.
        let _ = endless.write_all(&[b'x'; HEAD_BYTES + 2048]);
        let mut scrape = TcpStream::connect(address).expect("a connection");
        scrape
            .write_all(b"GET /metrics HTTP/1.1\r\nAccept: application/openmetrics-text\r\n\r\n")
            .expect("a request");
        let mut text = String::new();
        scrape.read_to_string(&mut text).expect("an answer");
        assert!(text.starts_with("HTTP/1.1 200 OK"), "{text}");
        assert!(text.ends_with("# EOF\n"), "{text}");
        let mut nothing = Vec::new();
        let _ = silent.read_to_end(&mut nothing);
        assert!(nothing.is_empty());
    }

    #[test]
    fn who_takes_nothing_is_let_go_too() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a socket");
        let client = TcpStream::connect(listener.local_addr().expect("its address"));
        let _client = client.expect("a connection");
        let (mut stream, _) = listener.accept().expect("the other end");
        let until = Instant::now() + Duration::from_millis(200);
        // More than any socket takes by itself.
        let error = write_until(&mut stream, &vec![0; 64 << 20], until).expect_err("no end");
        let kinds = [std::io::ErrorKind::TimedOut, std::io::ErrorKind::WouldBlock];
        assert!(kinds.contains(&error.kind()), "{error}");
    }
}
