//! The command `virtual-board`: a board before a simulated arm, for other processes to talk to.

use super::bench::{Bench, ProofArgs, ScenarioArgs};
use super::signals::stop_flag;
use super::{CliError, Common, print};
use crate::files::config;
use crate::simulation::bench::{BenchArm, FaultName, TimedFault, VirtualSetting};
use crate::target::{Listen, serve};
use clap::Args;
use serde_json::json;
use std::net::SocketAddr;
use std::path::PathBuf;

/// The arm before a virtual board, and what goes wrong with it.
#[derive(Args, Clone)]
pub(super) struct VirtualArmArgs {
    #[command(flatten)]
    pub(super) scenario: ScenarioArgs,
    /// Gains; without it those that `run` takes
    #[arg(long, value_name = "FILE")]
    pub(super) controller: Option<PathBuf>,
    #[command(flatten)]
    pub(super) proof: ProofArgs,
    /// A fault of docs/bench.md, so many seconds after enabling, in every run; with a value where it
    /// has one, and an end where it is to pass, as force_noise=30@1.5..2; may be given several times
    #[arg(long, value_name = "NAME[=VALUE]@S[..S]", value_parser = fault)]
    pub(super) fault: Vec<TimedFault>,
}

#[derive(Args)]
pub(super) struct VirtualBoardArgs {
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    arm: VirtualArmArgs,
    /// Listen on this address, say 127.0.0.1:7070, instead of a pseudo-terminal; port 0 is any that is
    /// free
    #[arg(long, value_name = "ADDRESS")]
    listen: Option<SocketAddr>,
    /// Times that it is faster than a real board: a number from 0.01 to 100, or max, as fast as it can
    #[arg(long, value_name = "N", default_value = "1", value_parser = speed)]
    speed: f64,
}

/// The fastest that a virtual board goes.
const SPEED_MAX: f64 = 100.0;

/// A speed of the command line.
fn speed(text: &str) -> Result<f64, String> {
    match (text, text.parse::<f64>()) {
        ("max", _) => Ok(SPEED_MAX),
        (_, Ok(speed)) if (0.01..=SPEED_MAX).contains(&speed) => Ok(speed),
        _ => Err("accepted: a number from 0.01 to 100, or max".into()),
    }
}

/// A fault of the command line.
fn fault(text: &str) -> Result<TimedFault, String> {
    let (what, when) = text
        .split_once('@')
        .ok_or("accepted: NAME@S, a fault's name and the time of it after enabling in s")?;
    let (name, value) = match what.split_once('=') {
        Some((name, value)) => (name, Some(value)),
        None => (what, None),
    };
    let entry = FaultName::find(name).ok_or_else(|| {
        let names: Vec<_> = FaultName::all().map(|entry| entry.name).collect();
        format!("no fault is called {name}; accepted: {}", names.join(", "))
    })?;
    let value = match (entry.unit, value) {
        (None, None) => 0.0,
        (Some(unit), Some(value)) => value
            .parse()
            .ok()
            .filter(|value: &f64| value.is_finite())
            .ok_or_else(|| format!("{name}={value}; accepted: a number in {unit}"))?,
        (Some(unit), None) => {
            return Err(format!("{name} wants a value: {name}=X@S, X in {unit}"));
        }
        (None, Some(_)) => return Err(format!("{name} has no value: {name}@S")),
    };
    let time = |text: &str| {
        let time = text.parse().ok().filter(|time| (0.0..=1e4).contains(time));
        time.ok_or_else(|| format!("{text}; accepted: a time after enabling in s, from 0 to 10000"))
    };
    let (from_s, to_s) = match when.split_once("..") {
        Some((from, to)) => (time(from)?, time(to)?),
        None => (time(when)?, f64::INFINITY),
    };
    Ok(TimedFault {
        kind: entry.kind(value),
        from_s,
        to_s,
    })
}

impl VirtualArmArgs {
    /// Plans, and makes the arm; gains that are not proved for it are refused.
    pub(super) fn prepare(&self, common: &Common) -> Result<(Bench, BenchArm), CliError> {
        let gains = self.controller.as_deref();
        let bench = self
            .scenario
            .prepare(common, gains, config::DEFAULT_CONTROLLER)?;
        let setup = bench.config.scenario.middle();
        let arm = setup.on_bench(&bench.planned.plan, 1)?;
        self.proof.check(&bench)?;
        Ok((bench, arm))
    }
}

pub(super) fn virtual_board(args: &VirtualBoardArgs) -> Result<(), CliError> {
    let (bench, arm) = args.arm.prepare(&args.common)?;
    bench.say_note();
    let setting = VirtualSetting::new(bench.task(), &arm, args.arm.fault.clone(), args.speed);
    let stop = stop_flag()?;
    let listen = args.listen.map_or(Listen::Terminal, Listen::Tcp);
    let mut printed = Ok(());
    serve(&setting, (listen, args.speed), stop, |port| {
        printed = if args.common.json {
            print(json!({ "port": port }))
        } else {
            print(format_args!("{port}"))
        };
    })?;
    printed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::bench::FaultKind;

    #[test]
    fn faults_have_a_name_a_time_and_perhaps_a_value() {
        let given = fault("drive2_runaway=3.5@0.5..2").unwrap();
        assert_eq!(given.kind, FaultKind::DriveRunaway(1, 3.5));
        assert_eq!((given.from_s, given.to_s), (0.5, 2.0));
        let given = fault("emergency_stop@1").unwrap();
        assert_eq!(given.kind, FaultKind::EmergencyStop);
        assert_eq!((given.from_s, given.to_s), (1.0, f64::INFINITY));
        for bad in [
            "emergency_stop",
            "emergency_stop=1@1",
            "force_noise@1",
            "force_noise=loud@1",
            "fire@1",
            "retract@-1",
            "retract@soon",
        ] {
            assert!(fault(bad).is_err(), "{bad}");
        }
        assert!(fault("fire@1").unwrap_err().contains("strain_rail"));
    }

    #[test]
    fn a_speed_is_a_number_or_max() {
        assert_eq!((speed("2.5"), speed("max")), (Ok(2.5), Ok(SPEED_MAX)));
        for bad in ["0", "-1", "101", "nan", "fast"] {
            assert!(speed(bad).is_err(), "{bad}");
        }
    }
}
