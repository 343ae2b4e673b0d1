//! Runs random bytes through every entry point, where libFuzzer does not run: `soak [CASES]
//! [ENTRY...]`.
//!
//! Prints the number of cases with each outcome, and the slowest case. A panic names its case,
//! which `soak --case NUMBER ENTRY` repeats; a case that takes longer than `HANG` ends the run.
//! Fails if either occurred.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::panic::{catch_unwind, set_hook};
use std::process::exit;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use trisquare_fuzz::{ENTRIES, Entry};

const DEFAULT_CASES: u64 = 1_000_000;
/// Maximum size of a case in bytes; a calibration reads some hundreds.
const MAX_BYTES: u64 = 1024;
/// Maximum time of a case, which usually takes about a millisecond.
const HANG: Duration = Duration::from_secs(10);
const PANIC: &str = "PANIC";
/// Maximum number of panics that are reported one by one.
const MAX_REPORTS: u64 = 20;

/// Number of the current case plus one, and its start, in milliseconds since the start of the run.
static CASE: AtomicU64 = AtomicU64::new(0);
static BEGUN: AtomicU64 = AtomicU64::new(0);
static PANICS: AtomicU64 = AtomicU64::new(0);

thread_local! {
    static NAME: Cell<&'static str> = const { Cell::new("") };
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [flag, number, name] = arguments.as_slice()
        && flag == "--case"
    {
        let case = number.parse().unwrap_or_else(|_| usage());
        println!("{name} {case}: {}", entry(name).1(&bytes_of(case)));
        return;
    }
    let (cases, names) = match arguments.split_first() {
        Some((first, rest)) => match first.parse() {
            Ok(cases) => (cases, rest),
            Err(_) => (DEFAULT_CASES, &arguments[..]),
        },
        None => (DEFAULT_CASES, &arguments[..]),
    };
    let chosen: Vec<_> = match names {
        [] => ENTRIES.to_vec(),
        _ => names.iter().map(|name| entry(name)).collect(),
    };
    let start = Instant::now();
    set_hook(Box::new(|panic| {
        if PANICS.fetch_add(1, Ordering::Relaxed) >= MAX_REPORTS {
            return;
        }
        let case = CASE.load(Ordering::Relaxed) - 1;
        eprintln!("{panic}\nrepeat with: soak --case {case} {}", NAME.get());
    }));
    thread::spawn(move || watch(start));
    let mut panics = 0;
    for (name, run) in chosen {
        NAME.set(name);
        panics += soak(name, run, cases, start);
    }
    exit(if panics > 0 { 1 } else { 0 });
}

fn usage() -> ! {
    let names: Vec<&str> = ENTRIES.iter().map(|(name, _)| *name).collect();
    eprintln!(
        "soak [CASES] [ENTRY...] | soak --case NUMBER ENTRY; {}",
        names.join(", ")
    );
    exit(2)
}

fn entry(name: &str) -> (&'static str, Entry) {
    let found = ENTRIES.iter().find(|(known, _)| *known == name);
    *found.unwrap_or_else(|| usage())
}

/// Runs the cases of an entry point and returns the number of panics.
fn soak(name: &str, run: Entry, cases: u64, start: Instant) -> u64 {
    let mut counts: BTreeMap<&str, u64> = BTreeMap::new();
    let (mut slowest, mut slowest_case) = (Duration::ZERO, 0);
    let begun = Instant::now();
    for case in 0..cases {
        let bytes = bytes_of(case);
        BEGUN.store(start.elapsed().as_millis() as u64, Ordering::Relaxed);
        CASE.store(case + 1, Ordering::Relaxed);
        let clock = Instant::now();
        let outcome = catch_unwind(|| run(&bytes)).unwrap_or(PANIC);
        *counts.entry(outcome).or_default() += 1;
        if clock.elapsed() > slowest {
            (slowest, slowest_case) = (clock.elapsed(), case);
        }
    }
    CASE.store(0, Ordering::Relaxed);
    let seconds = begun.elapsed().as_secs_f64();
    println!(
        "{name}: {cases} cases in {seconds:.0} s; slowest {:.1} ms (case {slowest_case})",
        1e3 * slowest.as_secs_f64()
    );
    for (outcome, count) in &counts {
        println!(
            "  {count:8} {:5.1} %  {outcome}",
            100.0 * *count as f64 / cases as f64
        );
    }
    counts.get(PANIC).copied().unwrap_or_default()
}

/// Returns the bytes of a case: SplitMix64 (G. Steele, D. Lea & C. Flood, OOPSLA 2014). Its initial
/// state is mixed as well; otherwise neighbouring cases would be shifted copies of each other.
fn bytes_of(case: u64) -> Vec<u8> {
    let mut state = mixed(case.wrapping_mul(GOLDEN));
    let mut next = || {
        state = state.wrapping_add(GOLDEN);
        mixed(state)
    };
    let words = 1 + next() % (MAX_BYTES / 8);
    (0..words).flat_map(|_| next().to_le_bytes()).collect()
}

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

fn mixed(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

fn watch(start: Instant) {
    loop {
        thread::sleep(Duration::from_secs(1));
        let case = CASE.load(Ordering::Relaxed);
        let begun = Duration::from_millis(BEGUN.load(Ordering::Relaxed));
        if case > 0 && start.elapsed().saturating_sub(begun) > HANG {
            eprintln!("case {} has not ended in {HANG:?}", case - 1);
            exit(1);
        }
    }
}
