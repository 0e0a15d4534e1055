//! What the commands that show a cell take.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;
use report::scope::span::Span;

use crate::metrics::place as metrics;
use crate::web::place as web;

/// Which running cell to look at.
#[derive(Debug, Clone, Args)]
pub struct CellOptions {
    /// Name of the cell [default: the only one that runs]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// See a cell of another machine, on which `quadrant remote serve` runs; read only (docs/howto/remote.md)
    #[arg(long, value_name = "tcp/HOST:PORT")]
    pub remote: Option<String>,
}

/// What the commands that start a cell show of it meanwhile.
#[derive(Debug, Clone, Args)]
pub struct ShowOptions {
    /// Show `quadrant monitor` in this terminal meanwhile; closing it (q) ends nothing
    #[arg(long)]
    pub view: bool,
    /// Serve metrics for Prometheus (OpenMetrics, docs/howto/metrics.md) at this address or port [without one: 127.0.0.1:7823]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = metrics::DEFAULT_ADDRESS, value_parser = metrics::parse_address)]
    pub metrics: Option<SocketAddr>,
    /// Show the cell as a page in the browser (docs/howto/web.md) at this address or port [without one: 127.0.0.1:8640]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, require_equals = true, default_missing_value = web::DEFAULT_ADDRESS, value_parser = web::parse_address)]
    pub web: Option<SocketAddr>,
    /// With --web: file with the token that orders from the page need; made if it is not there [default: a new token, printed]
    #[arg(long, value_name = "FILE", requires = "web")]
    pub token: Option<PathBuf>,
    /// With --web: looking at the page needs the token too, as on a PC that others use
    #[arg(long, requires = "web")]
    pub token_to_look: bool,
}

/// What `quadrant metrics` takes.
#[derive(Debug, Clone, Args)]
pub struct MetricsOptions {
    /// Name of the cell
    #[arg(long)]
    pub cell: String,
}

/// What `quadrant remote serve` takes.
#[cfg(feature = "remote")]
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Nobody is asked for a password: who reaches the place sees the machine. It listens on this PC alone; from\nelsewhere, go through ssh:\n  ssh -L 7447:127.0.0.1:7447 controller\n  quadrant monitor --remote tcp/127.0.0.1:7447"
)]
pub struct ServeOptions {
    /// Name of the cell [default: the only one that runs]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// Where to listen [default: tcp/127.0.0.1:7447, unless --connect is given]
    #[arg(long, value_name = "tcp/HOST:PORT")]
    pub listen: Vec<String>,
    /// A zenoh router to connect to
    #[arg(long, value_name = "tcp/HOST:PORT")]
    pub connect: Vec<String>,
    /// Take orders at this place, over TLS, from the operators that are named; without it nobody can give any
    #[arg(long, value_name = "tls/HOST:PORT", requires_all = ["tls", "operator"])]
    pub orders: Option<String>,
    /// Folder with the certificates for it: ca.pem, cert.pem, key.pem
    #[arg(long, value_name = "FOLDER", requires = "orders")]
    pub tls: Option<PathBuf>,
    /// Common name of a certificate whose owner may give orders; once for each
    #[arg(long, value_name = "NAME", requires = "orders")]
    pub operator: Vec<String>,
    /// Snapshots per second
    #[arg(long, value_name = "HZ", default_value_t = 20, value_parser = clap::value_parser!(u64).range(2..=100))]
    pub rate: u64,
}

/// What `quadrant remote order` takes.
#[cfg(feature = "remote")]
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Orders: hold, resume, stop, enable, disable, override. The controller PC takes them where `quadrant remote serve`\nwas started with --orders, --tls and --operator.\n\n  quadrant remote order hold --to tls/controller:7448 --tls ~/certificates --cell mill\n\nExit status: 1 if the machine refuses, or nobody answers; 3 if the server is not reached."
)]
pub struct OrderOptions {
    /// What to order
    pub order: String,
    /// Of an override, in percent
    #[arg(value_name = "PERCENT")]
    pub percent: Option<f64>,
    /// Where the server takes orders
    #[arg(long, value_name = "tls/HOST:PORT")]
    pub to: String,
    /// Folder with one's own certificates: ca.pem, cert.pem, key.pem
    #[arg(long, value_name = "FOLDER")]
    pub tls: PathBuf,
    /// Name of the cell
    #[arg(long, value_name = "NAME")]
    pub cell: String,
}

/// What `quadrant status` takes.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Exit status 1: no cell runs, or its master says nothing.")]
pub struct StatusOptions {
    /// Which cell.
    #[command(flatten)]
    pub to: CellOptions,
    /// Print JSON; units are in the names
    #[arg(long)]
    pub json: bool,
}

/// What `quadrant monitor` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Keys: h hold, r resume, s stop (asks first), b block by block, + - override, f rapids, j jog, : a block, ! emergency stop, ? help, q quit; the machine goes on.\nWhere standard output is no terminal: a line of JSON every 100 ms until the run ends. NO_COLOR is obeyed."
)]
pub struct MonitorOptions {
    /// Which cell.
    #[command(flatten)]
    pub to: CellOptions,
    /// Watch for a moment, print one screen (or one line with --json), and leave
    #[arg(long)]
    pub once: bool,
    /// Lines of JSON, one every 100 ms; what is new since the line before: reversals, events
    #[arg(long)]
    pub json: bool,
}

/// What `quadrant web` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Two addresses are printed: one to look, one with a token, with which orders can be given too.\nClosing the browser or this command ends nothing: the machine goes on.\n  quadrant web\n  quadrant web 9000 --cell mill --token ~/.quadrant-token\n\nExit status: 1 if no cell runs; 2 if the token's file is not usable; 3 if the address is taken."
)]
pub struct WebOptions {
    /// Address or port to serve the page at; 0 takes a free port
    #[arg(value_name = "ADDR", default_value = web::DEFAULT_ADDRESS, value_parser = web::parse_address)]
    pub address: SocketAddr,
    /// Name of the cell [default: the only one that runs]
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// File with the token that orders need; made if it is not there [default: a new token, printed]
    #[arg(long, value_name = "FILE")]
    pub token: Option<PathBuf>,
    /// Looking needs the token too, as on a PC that others use
    #[arg(long)]
    pub token_to_look: bool,
    /// Serve at the listening socket that standard input is
    #[arg(long, hide = true)]
    pub inherited: bool,
}

/// What `quadrant scope` takes.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Triggers, each in quotes:\n  now                            as soon as the time before it has been seen (default)\n  reversal X | reversal X +      the command of X reverses (to the positive direction)\n  X.following_error > 5um        the condition comes to hold, or holds already; also <\n  X.velocity rising 0            the signal goes through the value upwards; also falling\n  abs X.torque > 3Nm             the same of the magnitude\n  block 12                       line 12 of the program comes under way\n  scan 2210                      this scan\n  trip                           the machine trips\n  mode | mode stopped            the mode changes, or becomes this one\n  order                          mode, feed hold or override change\n  death | death servo-X          a process dies, or this one\n\nWhat does the next reversal of X look like?\n  quadrant scope --signal X.following_error --signal X.torque --trigger \"reversal X\"\nThe same reversal of a run that is over, as a picture and a table:\n  quadrant scope --log runs/a --signal X.following_error,X.wind_up --trigger \"scan 2210\" --svg x.svg --csv x.csv\nWhat led to the trip? (The black box of it was saved without being asked.)\n  quadrant scope --log runs/a/black-box-4000-trip.mcap --signal X.torque,mode --trigger trip --before 1s\nEvery reversal of Y for a minute:\n  quadrant scope --signal Y.following_error --trigger \"reversal Y\" --every --timeout 60s --csv y.csv\n\nExit status: 1 if no cell runs, or the trigger does not come before the timeout, the end of the cell or of the\nlog (it says what was seen instead); 2 for a signal, trigger or length of time that does not exist."
)]
pub struct ScopeOptions {
    /// What to show, once for each or with commas between: X.following_error, X.torque, contour_error; --list shows all
    #[arg(long, value_name = "NAME")]
    pub signal: Vec<String>,
    /// What starts the capture, see below
    #[arg(long, value_name = "WHAT", default_value = "now")]
    pub trigger: String,
    /// Time before the trigger: 50ms, 0.2s, "200 scans"
    #[arg(long, value_name = "TIME", default_value = "50ms")]
    pub before: Span,
    /// Time from the trigger on
    #[arg(long, value_name = "TIME", default_value = "200ms")]
    pub after: Span,
    /// Write a table, one row per scan, units in the names; - is standard output [default: a chart in the terminal]
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Draw a picture; those of further captures are FILE-2.svg and so on
    #[arg(long, value_name = "FILE")]
    pub svg: Option<PathBuf>,
    /// So many captures, which do not overlap
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub count: u64,
    /// One capture after the other, until the end, the timeout or Ctrl-C
    #[arg(long, conflicts_with = "count")]
    pub every: bool,
    /// Give up after so long without a trigger [default: wait until the cell ends]
    #[arg(long, value_name = "TIME", conflicts_with = "log")]
    pub timeout: Option<Span>,
    /// Triggers in earlier scans do not count
    #[arg(long, value_name = "SCAN")]
    pub from: Option<u64>,
    /// Name of the cell [default: the only one that runs]
    #[arg(long, value_name = "NAME", conflicts_with = "log")]
    pub cell: Option<String>,
    /// A run directory, or an MCAP file of one, in place of a running cell
    #[arg(long, value_name = "RUN")]
    pub log: Option<PathBuf>,
    /// Show the signals of the machine with their units, and leave
    #[arg(long)]
    pub list: bool,
}
