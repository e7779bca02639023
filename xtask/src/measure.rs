//! Seconds, processor seconds and peak memory of stages, and processes to measure them in.
//!
//! Peak memory is the high-water mark of the resident set (`VmHWM`), which the kernel resets when
//! a 5 is written to `/proc/self/clear_refs`. So a stage's peak holds what it was given and what it
//! took, but not what stages before it needed for a while. Linux only; elsewhere it is NaN.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::XtaskError;

/// What a stage took.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Stage {
    pub(crate) name: String,
    /// By the clock.
    pub(crate) seconds: f64,
    /// On all processors together.
    #[serde(deserialize_with = "nan_if_null")]
    pub(crate) cpu_seconds: f64,
    #[serde(deserialize_with = "nan_if_null")]
    pub(crate) peak_mib: f64,
}

/// Collects the stages of one process.
#[derive(Debug, Default)]
pub(crate) struct Recorder {
    pub(crate) stages: Vec<Stage>,
}

impl Recorder {
    /// Runs a stage and writes down what it took; what it returns is not yet dropped then.
    pub(crate) fn run<T>(&mut self, name: &str, work: impl FnOnce() -> T) -> T {
        reset_peak();
        let cpu = cpu_seconds();
        let clock = Instant::now();
        let result = work();
        self.stages.push(Stage {
            name: name.to_owned(),
            seconds: clock.elapsed().as_secs_f64(),
            cpu_seconds: cpu_seconds() - cpu,
            peak_mib: status_mib("VmHWM"),
        });
        result
    }
}

/// Resident memory at this moment, MiB.
pub(crate) fn resident_mib() -> f64 {
    status_mib("VmRSS")
}

fn reset_peak() {
    // Where this is not allowed the peak is that of the whole process so far.
    let _unsupported = std::fs::write("/proc/self/clear_refs", "5");
}

fn status_mib(key: &str) -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kib = text.lines().find_map(|line| {
        let value = line.strip_prefix(key)?.strip_prefix(':')?;
        value.trim().strip_suffix("kB")?.trim().parse::<f64>().ok()
    });
    kib.map_or(f64::NAN, |kib| kib / 1024.0)
}

/// Time on a processor of all threads that are alive, in seconds.
fn cpu_seconds() -> f64 {
    let nanoseconds = || -> Option<f64> {
        let mut sum = 0.0;
        for task in std::fs::read_dir("/proc/self/task").ok()? {
            let text = std::fs::read_to_string(task.ok()?.path().join("schedstat")).ok()?;
            sum += text.split_whitespace().next()?.parse::<f64>().ok()?;
        }
        Some(sum)
    };
    nanoseconds().map_or(f64::NAN, |ns| ns * 1e-9)
}

/// Runs a process with so many threads for whatever it uses, and waits for it.
pub(crate) fn run_child(command: &mut Command, n_threads: usize) -> Result<(), XtaskError> {
    for variable in [
        "RAYON_NUM_THREADS",
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
    ] {
        command.env(variable, n_threads.to_string());
    }
    let line = || format!("{command:?}");
    let (line, output) = (line(), command.output());
    let output = output.map_err(|source| XtaskError::Command {
        command: line.clone(),
        source,
    })?;
    if output.status.success() {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let last: Vec<&str> = said.lines().rev().take(5).collect();
    Err(XtaskError::Child {
        command: line,
        status: output.status,
        message: last.into_iter().rev().collect::<Vec<_>>().join("; "),
    })
}

/// Reads a JSON file that a measured process or its parent wrote.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, XtaskError> {
    let text = std::fs::read_to_string(path).map_err(|source| XtaskError::File {
        path: path.to_owned(),
        source,
    })?;
    serde_json::from_str(&text).map_err(|error| XtaskError::Measurement {
        path: path.to_owned(),
        message: error.to_string(),
    })
}

/// The middle value, the mean of the two middle ones of an even number; NaN of nothing.
pub(crate) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => sorted[n / 2],
        n => 0.5 * (sorted[n / 2 - 1] + sorted[n / 2]),
    }
}

/// JSON has no NaN; what could not be measured is null there.
fn nan_if_null<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians() {
        assert!(median(&[]).is_nan(), "nothing");
        assert!((median(&[3.0, 1.0, 2.0]) - 2.0).abs() < 1e-15, "odd");
        assert!((median(&[4.0, 1.0, 2.0, 3.0]) - 2.5).abs() < 1e-15, "even");
    }

    #[test]
    fn a_stage_is_written_down_with_its_memory() {
        let mut recorder = Recorder::default();
        let length = recorder.run("fill", || std::hint::black_box(vec![1_u8; 64 << 20]).len());
        assert_eq!(length, 64 << 20, "the result is handed on");
        let stage = &recorder.stages[0];
        assert!(stage.seconds > 0.0, "time");
        if cfg!(target_os = "linux") {
            assert!(stage.peak_mib > 64.0, "{} MiB", stage.peak_mib);
        }
    }
}
