//! Hands the page and its frames to browsers, over HTTP/1, all in one thread; a browser that is slow, gone or malicious costs a
//! connection and nothing else.
//!
//! Everything has a bound: connections, browsers that look, the head and body of a request, the time for them. A frame that a browser has
//! not taken when the next one is there is not kept for it. One that takes nothing at all is disconnected by the system after
//! [`STALLED_MS`]. Of connections that neither look nor order the oldest of the address that has the most goes where another one comes
//! ([`guests`]), so that an order is read at once however many are silent, and urgent orders need no turn. A browser with the token has
//! a turn of its own: those without it do not keep it from looking.

use std::convert::Infallible;
use std::net::TcpListener;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::Router;
use axum::body::{Body, Bytes, to_bytes};
use axum::extract::{Extension, Request, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, HeaderValue, REFERRER_POLICY,
    WWW_AUTHENTICATE, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, StatusCode};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use rustix::net::sockopt;
use serde_json::Value;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio_stream::StreamExt;
use tokio_stream::wrappers::WatchStream;

use super::pictures::{Pictures, locked};
use super::token::Token;
use super::{guard, orders};
use crate::guests::{self, Guest};

/// The most connections at a time that neither look nor order.
const GUESTS_MAX: usize = 64;
/// The most browsers that look at a time with the token, and as many without it.
const LOOKING_MAX: usize = 12;
/// The most orders under way at a time; urgent ones need no turn.
const ORDERS_MAX: usize = 4;
/// The most urgent orders whose answers are waited for at a time; more are given all the same.
const URGENT_MAX: usize = 64;
/// The most runs that are listed.
const RUNS_MAX: usize = 100;
/// The longest head of a request, and the most that is kept for a connection that is slow.
const HEAD_BYTES: usize = 16 << 10;
/// The longest order.
const ORDER_BYTES: usize = 4 << 10;
/// What the system keeps for a connection that is slow: a frame or a few.
const SEND_BYTES: usize = 32 << 10;
/// The longest time for the head of a request, and for its body.
const PATIENCE: Duration = Duration::from_secs(5);
/// A connection that takes nothing is closed by the system after so long.
const STALLED_MS: u32 = 10_000;
/// What the page may load: what comes from here.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
/// The page and what belongs to it: where it is, its kind and its text.
const FILES: [(&str, &str, &str); 9] = [
    ("/", HTML, include_str!("page/page.html")),
    ("/page.css", CSS, include_str!("page/page.css")),
    ("/page.js", SCRIPT, include_str!("page/page.js")),
    ("/pictures.js", SCRIPT, include_str!("page/pictures.js")),
    ("/orders.js", SCRIPT, include_str!("page/orders.js")),
    ("/runs.js", SCRIPT, include_str!("page/runs.js")),
    ("/signals.js", SCRIPT, include_str!("page/signals.js")),
    ("/stream.js", SCRIPT, include_str!("page/stream.js")),
    ("/icon.svg", "image/svg+xml", include_str!("page/icon.svg")),
];

/// What is served.
#[derive(Clone)]
pub struct Served {
    /// The newest frame.
    pub frames: watch::Receiver<Bytes>,
    /// What is too large for each frame.
    pub pictures: Arc<Mutex<Pictures>>,
    /// What orders need.
    pub token: Token,
    /// Looking needs no token.
    pub shown_to_all: bool,
    /// Name of the cell.
    pub cell: String,
}

#[derive(Clone)]
struct Desk {
    served: Served,
    with_token: Turns,
    without: Turns,
    ordering: Arc<Semaphore>,
    urgent: Arc<Semaphore>,
}

/// Turns of those who look.
#[derive(Clone)]
struct Turns {
    looking: Arc<Semaphore>,
    listing: Arc<Semaphore>,
}

impl Turns {
    fn new() -> Turns {
        Turns {
            looking: Arc::new(Semaphore::new(LOOKING_MAX)),
            listing: Arc::new(Semaphore::new(1)),
        }
    }
}

/// Serves at `listener` in a thread of its own, as long as the process lives.
///
/// # Errors
/// The thread cannot be started.
pub fn start(listener: TcpListener, served: Served) -> std::io::Result<()> {
    let router = router(served);
    guests::serve(listener, "qd-web", GUESTS_MAX, move |stream, guest| {
        // Without them it is served all the same, only less tightly.
        let _ = sockopt::set_socket_send_buffer_size(&stream, SEND_BYTES);
        let _ = sockopt::set_tcp_user_timeout(&stream, STALLED_MS);
        let _ = stream.set_nodelay(true);
        let router = TowerToHyperService::new(router.clone());
        async move {
            let service = service_fn(move |mut request: hyper::Request<Incoming>| {
                request.extensions_mut().insert(guest.clone());
                router.call(request)
            });
            // Whether a browser leaves early is its own affair.
            let _ = http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(PATIENCE)
                .keep_alive(false)
                .max_buf_size(HEAD_BYTES)
                .serve_connection(TokioIo::new(stream), service)
                .await;
        }
    })
}

fn router(served: Served) -> Router {
    let desk = Desk {
        served,
        with_token: Turns::new(),
        without: Turns::new(),
        ordering: Arc::new(Semaphore::new(ORDERS_MAX)),
        urgent: Arc::new(Semaphore::new(URGENT_MAX)),
    };
    let shown = Router::new()
        .route("/frames", get(frames))
        .route("/machine", get(machine))
        .route("/path", get(path))
        .route("/trail", get(trail))
        .route("/runs", get(runs))
        .route_layer(middleware::from_fn_with_state(desk.clone(), who_looks));
    let mut files = Router::new();
    for (place, kind, text) in FILES {
        let file = move || async move { ([(CONTENT_TYPE, kind)], text) };
        files = files.route(place, get(file));
    }
    files
        .route("/order", post(order))
        .merge(shown)
        .fallback(|| async { (StatusCode::NOT_FOUND, "the page is at /\n") })
        .layer(middleware::from_fn(every_answer))
        .with_state(desk)
}

/// Of every request: whom it asks; of every answer: what a browser may do with it.
async fn every_answer(request: Request, next: Next) -> Response {
    let mut response = match guard::host(request.headers()) {
        Ok(()) => next.run(request).await,
        Err(refusal) => refusal.into_response(),
    };
    let headers = response.headers_mut();
    let mut set = |name: HeaderName, value: &'static str| {
        headers.insert(name, HeaderValue::from_static(value));
    };
    set(CACHE_CONTROL, "no-store");
    set(CONTENT_SECURITY_POLICY, POLICY);
    set(X_CONTENT_TYPE_OPTIONS, "nosniff");
    set(REFERRER_POLICY, "no-referrer");
    set(
        HeaderName::from_static("cross-origin-resource-policy"),
        "same-origin",
    );
    response
}

fn refused((status, words): guard::Refusal) -> Response {
    let mut response = (status, words).into_response();
    if status == StatusCode::UNAUTHORIZED {
        let scheme = HeaderValue::from_static("Bearer");
        response.headers_mut().insert(WWW_AUTHENTICATE, scheme);
    }
    response
}

/// Whose turns are whose; where the page is not for all, looking needs the token too.
async fn who_looks(State(desk): State<Desk>, mut request: Request, next: Next) -> Response {
    let turns = match guard::token(request.headers(), &desk.served.token) {
        Ok(()) => desk.with_token,
        Err(_) if desk.served.shown_to_all => desk.without,
        Err(refusal) => return refused(refusal),
    };
    request.extensions_mut().insert(turns);
    next.run(request).await
}

/// One browser that looks: its frames, until it leaves.
async fn frames(
    State(desk): State<Desk>,
    Extension(turns): Extension<Turns>,
    Extension(guest): Extension<Guest>,
) -> Response {
    let Ok(seat) = turns.looking.try_acquire_owned() else {
        let words = format!(
            "{LOOKING_MAX} browsers look at this page already: close one, or look with the token, for which as many have room\n"
        );
        return (StatusCode::SERVICE_UNAVAILABLE, words).into_response();
    };
    guest.stays();
    let frames = WatchStream::from_changes(desk.served.frames);
    let frames = frames.map(move |frame| -> Result<Bytes, Infallible> {
        let _as_long_as_it_looks: &OwnedSemaphorePermit = &seat;
        Ok(frame)
    });
    let kind = [(CONTENT_TYPE, "text/event-stream")];
    (kind, Body::from_stream(frames)).into_response()
}

fn json(text: Bytes) -> impl IntoResponse {
    ([(CONTENT_TYPE, "application/json")], text)
}

async fn machine(State(desk): State<Desk>) -> impl IntoResponse {
    json(locked(&desk.served.pictures).machine())
}

async fn path(State(desk): State<Desk>) -> impl IntoResponse {
    json(locked(&desk.served.pictures).path())
}

async fn trail(State(desk): State<Desk>) -> impl IntoResponse {
    json(locked(&desk.served.pictures).trail())
}

/// The runs of the cell, read from the disk one browser at a time.
async fn runs(State(desk): State<Desk>, Extension(turns): Extension<Turns>) -> Response {
    let turn = turns.listing.acquire_owned().await;
    let cell = desk.served.cell.clone();
    let read = move || (report::runs::newest(&cell, RUNS_MAX), turn);
    match tokio::task::spawn_blocking(read).await {
        Ok((runs, _)) => json(Value::from(runs).to_string().into()).into_response(),
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

/// One order: 200 with what came of it, 409 with the reason where the cell refuses it.
async fn order(
    State(desk): State<Desk>,
    Extension(guest): Extension<Guest>,
    headers: HeaderMap,
    body: Body,
) -> Response {
    let may = guard::origin(&headers)
        .and_then(|()| guard::token(&headers, &desk.served.token))
        .and_then(|()| guard::kind(&headers));
    if let Err(refusal) = may {
        return refused(refusal);
    }
    let body = match tokio::time::timeout(PATIENCE, to_bytes(body, ORDER_BYTES)).await {
        Ok(Ok(body)) => body,
        Ok(Err(_)) => {
            let words = format!("an order has at most {ORDER_BYTES} bytes\n");
            return (StatusCode::PAYLOAD_TOO_LARGE, words).into_response();
        }
        Err(_) => {
            let words = "the order did not come to its end in time\n";
            return (StatusCode::REQUEST_TIMEOUT, words).into_response();
        }
    };
    let order = match orders::parse(&body) {
        Ok(order) => order,
        Err(words) => return (StatusCode::BAD_REQUEST, words).into_response(),
    };
    let cell = desk.served.cell.clone();
    // What is given stays given where the browser leaves, and its turn is taken as long as it is under way.
    let given = match order.urgent() {
        Some(order) => {
            let outcome = orders::give_urgently(order, &cell);
            let Ok(turn) = desk.urgent.try_acquire_owned() else {
                let words = "given; the orders before have no answer yet\n";
                return (StatusCode::ACCEPTED, words).into_response();
            };
            guest.stays();
            tokio::spawn(async move { (outcome.await, turn) }).await
        }
        None => {
            let Ok(turn) = desk.ordering.try_acquire_owned() else {
                let words = "the orders before have no answer yet: not given\n";
                return (StatusCode::SERVICE_UNAVAILABLE, words).into_response();
            };
            guest.stays();
            tokio::task::spawn_blocking(move || (order.give(&cell), turn)).await
        }
    };
    match given.map(|(outcome, _)| outcome) {
        Ok(Ok(words)) => (StatusCode::OK, words).into_response(),
        Ok(Err(words)) => (StatusCode::CONFLICT, words).into_response(),
        Err(_) => {
            let words = "what came of the order is not known\n";
            (StatusCode::INTERNAL_SERVER_ERROR, words).into_response()
        }
    }
}
