//! Who may ask for what.
//!
//! Any page of the web can have a browser send requests to 127.0.0.1. What is asked for must therefore be asked for by a name that is
//! this PC's (a foreign name that was made to point here is refused), an order must come from this very page, and it must carry
//! the token, which no other page can know.

use std::net::IpAddr;

use axum::http::header::{AUTHORIZATION, CONTENT_TYPE, HOST, ORIGIN};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, StatusCode};
use subtle::ConstantTimeEq;

use super::token::Token;

/// Why something is refused, in words that say what is right.
pub type Refusal = (StatusCode, String);

fn text(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    headers.get(name)?.to_str().ok()
}

/// The request names this PC: by an address, as `localhost`, or by its own name.
pub fn host(headers: &HeaderMap) -> Result<(), Refusal> {
    let given = text(headers, HOST).unwrap_or_default();
    let authority = given.parse::<Authority>().ok();
    let name = authority.as_ref().map_or("", Authority::host);
    let system = rustix::system::uname();
    let own = system.nodename().to_str().unwrap_or_default();
    if is_this_pc(name, own) {
        return Ok(());
    }
    Err((
        StatusCode::FORBIDDEN,
        format!(
            "{given:?} is no name of this PC: ask for its address, localhost or {own:?}, as in http://127.0.0.1:8640/\n"
        ),
    ))
}

fn is_this_pc(name: &str, own: &str) -> bool {
    let address = name.trim_start_matches('[').trim_end_matches(']');
    let is_own = |name: &str| !own.is_empty() && name.eq_ignore_ascii_case(own);
    address.parse::<IpAddr>().is_ok()
        || name.eq_ignore_ascii_case("localhost")
        || is_own(name)
        || name.strip_suffix(".local").is_some_and(is_own)
}

/// The request comes from a page of this server, or from no page at all.
pub fn origin(headers: &HeaderMap) -> Result<(), Refusal> {
    let host = text(headers, HOST).unwrap_or_default();
    let Some(origin) = headers.get(ORIGIN) else {
        return Ok(());
    };
    if origin.to_str().is_ok_and(|o| o == format!("http://{host}")) {
        return Ok(());
    }
    Err((
        StatusCode::FORBIDDEN,
        format!("a page of {origin:?} may give no orders here: only that of http://{host}/ may\n"),
    ))
}

/// The request says that its body is JSON, which no form of another page can.
pub fn kind(headers: &HeaderMap) -> Result<(), Refusal> {
    let kind = text(headers, CONTENT_TYPE).unwrap_or_default();
    let kind = kind.split(';').next().unwrap_or_default().trim();
    if kind.eq_ignore_ascii_case("application/json") {
        return Ok(());
    }
    Err((
        StatusCode::UNSUPPORTED_MEDIA_TYPE,
        "an order is JSON: send it as Content-Type: application/json\n".into(),
    ))
}

/// The request carries the token.
pub fn token(headers: &HeaderMap, token: &Token) -> Result<(), Refusal> {
    let given = text(headers, AUTHORIZATION).and_then(|value| {
        let (scheme, token) = value.split_once(' ')?;
        scheme.eq_ignore_ascii_case("bearer").then(|| token.trim())
    });
    let Some(given) = given else {
        return Err((
            StatusCode::UNAUTHORIZED,
            "this needs the token of the page, which stands where the page was started: send it as Authorization: Bearer TOKEN, or \
             open the page with #token=TOKEN behind its address\n"
                .into(),
        ));
    };
    if bool::from(given.as_bytes().ct_eq(token.text().as_bytes())) {
        return Ok(());
    }
    Err((
        StatusCode::FORBIDDEN,
        "that is not the token of this page: it stands where the page was started, or in the file that --token names\n".into(),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_addresses_and_names_of_this_pc_are_asked_for() {
        for name in [
            "127.0.0.1",
            "[::1]",
            "localhost",
            "LocalHost",
            "192.168.1.4",
            "mill",
            "mill.local",
        ] {
            assert!(is_this_pc(name, "mill"), "{name}");
        }
        for name in [
            "",
            "evil.example",
            "mill.evil.example",
            "127.0.0.1.evil.example",
            ".local",
        ] {
            assert!(!is_this_pc(name, "mill"), "{name}");
        }
        assert!(!is_this_pc("", "") && !is_this_pc(".local", ""));
    }
}
