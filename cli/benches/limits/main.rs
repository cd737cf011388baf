//! How close compiled scenes come to C written by hand for the very same work.
//!
//! `cargo bench -p bond --features criterion --bench limits` times each figure by criterion; with `-- --page` it
//! measures all of them in turns and writes the tables of `docs/inside/performance.md` anew (with `--large` also the
//! ladder of 1e5 cells).

mod clock;
mod figure;
mod program;
mod scene;
mod sheet;
mod tables;
mod ways;

use criterion::{Criterion, Throughput};
use std::time::Duration;
use ways::Ways;

/// All figures under criterion, but those whose preparation takes long.
fn figures(c: &mut Criterion) -> Result<(), String> {
    let folder = program::Folder::new()?;
    for figure in figure::all().into_iter().filter(|f| !f.is_large()) {
        let compiled = scene::compile(&figure)?;
        let mut ways = Ways::new(&folder, &figure, &compiled, &|_| ());
        for why in &ways.missing {
            eprintln!("{}: {why}", figure.title);
        }
        let mut group = c.benchmark_group(figure.title);
        group.throughput(Throughput::Elements(figure.per as u64)).sample_size(20);
        group.warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
        for way in &mut ways.list {
            let name = way.what.name();
            group.bench_function(name, |b| {
                b.iter_custom(|n| match way.time(n, 1) {
                    Ok(ns) => Duration::from_nanos(ns.max(1.0) as u64),
                    Err(e) => panic!("{name}: {e}"),
                });
            });
        }
        group.finish();
    }
    Ok(())
}

fn main() {
    let has = |option: &str| std::env::args().any(|a| a == option);
    let done = if has("--page") {
        sheet::write(has("--large"))
    } else {
        let mut criterion = Criterion::default().configure_from_args();
        let done = figures(&mut criterion);
        criterion.final_summary();
        done
    };
    if let Err(e) = done {
        eprintln!("{e}");
        std::process::exit(1);
    }
}
