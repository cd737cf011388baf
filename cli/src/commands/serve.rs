//! `bond serve`: a scene with open ports meets a real outside.

use crate::input::{self, Set, Which};
use crate::serve::link::Link;
use crate::serve::log::{self, Log};
use crate::serve::peer::{self, Peer};
use crate::serve::report::{self as told, Met, Outcome};
use crate::serve::{
    DeviceMeeting, End, Meeting, Pipe, Shared, Udp, Until, WaveMeeting, Who, clock, serve as serve_until,
};
use crate::stop::Stop;
use crate::{output, report};
use bond::Steps;
use bond::exchange::{Exchange, WaveExchange};
use bond::internal::{CompiledInternals, ExchangeInternals, StepsInternals};
use bond_compiler::discretise::Method;
use bond_compiler::model::Settings;
use bond_runtime::scene::Scene;
use clap::builder::PossibleValuesParser;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

/// The help text below the options, for a command with this name.
pub fn help(called: &str) -> String {
    format!(
        "Examples:\n  {called} --udp 127.0.0.1:7000 --duration 60s --report json\n  {called} --udp 127.0.0.1:7000 --priority 80 --core 1 \
--lock-memory --ledger wall.csv\n  {called} --udp 0.0.0.0:7000 --key-file wall.key\n  {called} --stdio --lockstep < moves.csv\n  {called} --shm wall\n\nPorts that carry waves, \
`port hand {{ impedance = 20 N*s/m }}`, meet those of another program; one of the two is told where the other is:\n  bond serve slave.bond --udp 127.0.0.1:7002\n  \
bond serve master.bond --udp 127.0.0.1:7001 --peer 127.0.0.1:7002\n\nThe rate is that of the sampled region behind the open \
ports. The clock starts with the first measurement.\n\nAn address that other machines can reach asks for --key-file or --peer. `openssl rand -hex 32 > wall.key` makes \
a key.\nA device that says nothing for a second has left; then another may join.\n\nLines: each line out has the value held at each port, then the energy in J that may be drawn; each line \
in has how far\neach port moved under it. docs/reference/serve.md describes the packets, and what keeps a device passive over a lossy line;\n\
models/embed/device.py is a device in Python.\n\nServing ends after --duration, whether or not a device came, at the end of standard input, or with Ctrl-C, and then reports."
    )
}

/// Connect a scene's open ports to real devices, or to another program, in real time
#[derive(clap::Args)]
#[command(after_help = help("bond serve wall.bond") + "\nBuilt into one file: bond build wall.bond -o wall, then ./wall serve ...")]
pub struct Args {
    /// A model
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The stepper, for every region that can take it
    #[arg(long, value_name = "METHOD", value_parser = PossibleValuesParser::new(Method::ALL.map(Method::name)))]
    method: Option<String>,
    #[command(flatten)]
    set: Set,
    #[command(flatten)]
    which: Which,
    #[command(flatten)]
    how: How,
}

/// All that serving a compiled scene takes.
#[derive(clap::Args)]
pub struct How {
    #[command(flatten)]
    line: Line,
    /// Use packets instead of lines on standard input and output
    #[arg(long)]
    binary: bool,
    /// No clock: each interval waits for its measurement, or its waves
    #[arg(long)]
    lockstep: bool,
    /// The address of the device or the other program, with or without a port: only it may speak. Default: any
    #[arg(long, value_name = "ADDRESS")]
    peer: Option<Peer>,
    /// A file with a key that the device has too: only packets that are sealed with it count. It holds 32 bytes, or 64
    /// hexadecimal digits
    #[arg(long, value_name = "FILE")]
    key_file: Option<PathBuf>,
    /// How long to serve, from the start on, whether or not a device comes; with --lockstep, in the scene's time.
    /// Default: without end
    #[arg(long, value_name = "T", value_parser = input::span, allow_negative_numbers = true)]
    duration: Option<f64>,
    /// Intervals for which an effort is held without a newer one, on either side; then 0 is held. Of waves, how many
    /// may wait for their interval; then two are joined
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1_000_000), allow_negative_numbers = true)]
    hold: u32,
    /// Real-time priority (SCHED_FIFO), 1 to 99
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u8).range(1..=99), allow_negative_numbers = true)]
    priority: Option<u8>,
    /// The core to run on, from 0
    #[arg(long, value_name = "K", value_parser = |text: &str| input::count(text, 0..=u64::MAX), allow_negative_numbers = true)]
    core: Option<u64>,
    /// Keep memory from being swapped out
    #[arg(long)]
    lock_memory: bool,
    /// Format of the report, which goes to standard error if standard output has the efforts
    #[arg(long, value_enum, default_value_t = Format::Text)]
    report: Format,
    /// Write the ledger, one row per interval, to a file (`.csv` or `.parquet`)
    #[arg(long, value_name = "FILE.csv")]
    ledger: Option<PathBuf>,
}

/// The line to the outside.
#[derive(clap::Args)]
#[group(required = true, multiple = false)]
struct Line {
    /// Standard input and output
    #[arg(long)]
    stdio: bool,
    /// UDP, listening at this address; port 0 takes a free one
    #[arg(long, value_name = "ADDR:PORT", value_parser = address)]
    udp: Option<SocketAddr>,
    /// Shared memory: a file of this name, created in /dev/shm
    #[arg(long, value_name = "NAME")]
    shm: Option<String>,
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Format {
    Text,
    Json,
}

/// An address.
fn address(text: &str) -> Result<SocketAddr, String> {
    let wanted = "write an IP address and a port, such as 127.0.0.1:7000 or [::1]:7000; names are not looked up";
    text.parse().map_err(|_| wanted.to_string())
}

/// Serves a model.
///
/// # Errors
/// A command line or a model that is wrong, numerics that fail.
pub fn serve(args: &Args) -> Result<(), Stop> {
    if args.file == Path::new("-") && args.how.line.stdio {
        return Err(Stop::Usage("both the model and the measurements would be read from standard input".into()));
    }
    if let Some(path) = &args.how.ledger {
        output::not_over(path, &[(&args.file, "the model")])?;
    }
    let mut options = input::options(&args.which, &args.set)?;
    if let Some(method) = &args.method {
        options = options.method(method);
    }
    let compiled = input::compile(&args.file, &options)?;
    output::not_over_used(args.how.ledger.as_deref(), compiled.used())?;
    meet(compiled.scene(), &compiled.stages().model.settings, &args.how)
}

/// Refuses options that do not go together.
fn fit(scene: &Scene, args: &How) -> Result<(), Stop> {
    let carries_waves = !scene.waves.is_empty();
    let udp = args.line.udp.is_some();
    if let Some(port) = scene.waves.first().filter(|_| !udp) {
        return Err(Stop::Usage(format!("`{}` carries waves, which go over --udp only", port.name)));
    }
    for (asked, option, line, there) in [
        (args.binary, "--binary", "--stdio", args.line.stdio),
        (args.lockstep && !carries_waves, "--lockstep", "--stdio", args.line.stdio),
        (args.peer.is_some(), "--peer", "--udp", udp),
        (args.key_file.is_some(), "--key-file", "--udp", udp),
    ] {
        if asked && !there {
            return Err(Stop::Usage(format!("{option} is for {line} only")));
        }
    }
    if args.line.stdio && args.ledger.as_deref() == Some(Path::new("-")) {
        return Err(Stop::Usage("standard output has the efforts; give --ledger a file".into()));
    }
    if let Some(address) = args.line.udp {
        peer::is_told_from_strangers(address, args.peer.is_some() || args.key_file.is_some())?;
    }
    if let (Some(ledger), Some(file)) = (&args.ledger, &args.key_file) {
        output::not_over(ledger, &[(file, "the key")])?;
    }
    Ok(())
}

/// Serves a scene whose model says `settings`.
///
/// # Errors
/// A scene without open ports that can be served, a line that cannot be opened, numerics that fail.
pub fn meet(scene: &Scene, settings: &Settings, args: &How) -> Result<(), Stop> {
    fit(scene, args)?;
    let key = args.key_file.as_deref().map(peer::key).transpose()?;
    let options = Steps::new().resolve(settings, settings.stop.unwrap_or(1.0), settings.every)?;
    // Later sessions have higher numbers.
    let session = SystemTime::now().duration_since(UNIX_EPOCH).map_or(1, |t| t.as_nanos() as u64).max(1);
    let unfit = |e| match e {
        bond::exchange::Unfit::Start(e) => e.into(),
        other => Stop::Model(other.to_string()),
    };
    let asked = Arc::new(AtomicBool::new(false));
    let flag = asked.clone();
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed))
        .map_err(|e| Stop::Usage(format!("cannot watch for Ctrl-C: {e}")))?;
    let who = Who { peer: args.peer, key };
    let until = Until { duration: args.duration, asked: &asked, lockstep: args.lockstep };
    match args.line.udp.filter(|_| !scene.waves.is_empty()) {
        Some(address) => {
            let own = WaveExchange::on(scene, &options, session, args.hold).map_err(unfit)?;
            let mut own = if args.lockstep { own.in_lockstep() } else { own };
            let run = Run::new(scene, args, &until)?;
            let mut with = WaveMeeting::new(&mut own, address, who, args.lockstep)?;
            let (line, ended) = run.exchange(&mut with, |with| (with.name(), with.refused()))?;
            run.report(Met::Waves(&own), line, ended)
        }
        None => {
            let mut own = Exchange::on(scene, &options, session, args.hold).map_err(unfit)?;
            let run = Run::new(scene, args, &until)?;
            let ports = scene.open.len();
            let mut link = match &args.line {
                Line { udp: Some(address), .. } => Link::Udp(Udp::new(*address, who, &own, args.priority)?),
                Line { shm: Some(name), .. } => Link::Shared(Shared::new(name, ports)?),
                Line { .. } => Link::Pipe(Box::new(Pipe::new(args.binary, ports, session))),
            };
            let mut with = DeviceMeeting::new(&mut own, &mut link);
            let (line, ended) = run.exchange(&mut with, |with| (with.name(), with.refused()))?;
            run.report(Met::Device(&own), line, ended)
        }
    }
}

/// What was asked of an exchange, and what the system granted.
struct Run<'a> {
    scene: &'a Scene,
    args: &'a How,
    until: &'a Until<'a>,
    without: Vec<String>,
}

/// How an exchange ended: that, and the rows of the ledger that were lost.
type Ended = (End, u64);

impl<'a> Run<'a> {
    /// Asks the system for what is wanted. Threads that are started from here on take part in what is granted.
    fn new(scene: &'a Scene, args: &'a How, until: &'a Until<'a>) -> Result<Self, Stop> {
        let mut run = Self { scene, args, until, without: Vec::new() };
        let wishes =
            clock::Wishes { priority: args.priority, core: args.core.map(|k| k as usize), lock: args.lock_memory };
        run.without = clock::ask(wishes, &|line| run.say(line));
        Ok(run)
    }

    /// Whether the report goes to standard error.
    fn is_aside(&self) -> bool {
        self.args.line.stdio || self.args.ledger.as_deref() == Some(Path::new("-"))
    }

    /// Whether that is all there: whoever reads it finds all that would be said.
    fn is_alone(&self) -> bool {
        self.is_aside() && self.args.report == Format::Json
    }

    fn say(&self, line: &str) {
        if !self.is_alone() {
            report::say(line);
        }
    }

    /// Exchanges until the end. `about` tells the line, and how many packets it refused.
    fn exchange<M: Meeting>(
        &self,
        with: &mut M,
        about: impl Fn(&M) -> (String, u64),
    ) -> Result<((String, u64), Ended), Stop> {
        let (names, ports): (_, Vec<&str>) = match self.scene.waves.is_empty() {
            true => (&log::OF_DEVICE, self.scene.open.iter().map(|o| o.name.as_str()).collect()),
            false => (&log::OF_WAVES, self.scene.waves.iter().map(|w| w.name.as_str()).collect()),
        };
        let mut log = self.args.ledger.as_deref().map(|path| Log::new(path, names, &ports)).transpose()?;
        let line = about(with).0;
        self.say(&format!("`{}` at {} intervals a second, {line}", self.scene.name, 1.0 / with.period()));
        let end = serve_until(with, log.as_mut(), self.until);
        let lost = log.map(Log::end).transpose()?.unwrap_or(0);
        if lost > 0 {
            self.say(&format!("warning: {lost} rows of the ledger were lost, because the disk is too slow"));
        }
        Ok((about(with), (end, lost)))
    }

    /// Tells how it came out.
    fn report(&self, met: Met<'_, '_>, (line, refused): (String, u64), (end, lost): Ended) -> Result<(), Stop> {
        let (scene, paced) = (self.scene, !self.args.lockstep);
        let outcome = Outcome { scene, met, end: &end, line: &line, refused, paced, without: &self.without, lost };
        let text = match self.args.report {
            Format::Text => told::text(&outcome),
            Format::Json => told::json(&outcome),
        };
        if self.is_aside() {
            report::say(text.trim_end());
        } else {
            output::offer(&text)?;
        }
        let ended = match (end.broken, end.failure) {
            (Some(why), _) => Err(why),
            (None, None) => Ok(()),
            (None, Some(e)) => Err(e.into()),
        };
        ended.map_err(|stop| if self.is_alone() { stop.told() } else { stop })
    }
}
