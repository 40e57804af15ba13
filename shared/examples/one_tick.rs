//! One control tick, from a table in memory to the torques: what the firmware does 5,000 times
//! a second.
//!
//! ```text
//! cargo run -p flexor --example one_tick
//! ```

use flexor::control::{Command, Controller, LimitParameters, PaperParameters};
use flexor::model::ArmParameters;
use flexor::signals::{Measurement, Reference};
use flexor::table::{Header, Piece, Table, TableError, TableWriter, image_bytes, scaling_for};

/// What the table says at every tick: made up, the tip pressing down with 2 N.
const PLANNED: Reference<f64> = Reference {
    torque: [3.0, 0.5],
    force: 2.0,
    angle: [0.9, -0.7],
    root_slope: 0.17,
    root_slope_rate: 0.0,
    normal_angle: core::f64::consts::FRAC_PI_2,
};

/// A table of 100 ticks at 1 kHz. `flexor plan` writes such images, with a motion in them.
fn table_image(arm: &ArmParameters) -> Result<Vec<u8>, TableError> {
    // The columns are cubic splines: one segment has four knots, equal ones are a constant.
    let pieces = [Piece {
        ticks: 100,
        segments: 1,
    }];
    let header = Header {
        arm_fingerprint: arm.fingerprint(),
        // Of what was planned: the planner's business.
        task_fingerprint: 0,
        tick_rate_hz: 1000,
        ticks: 100,
        first_tick: 0,
        scaling: PLANNED.columns().map(|value| scaling_for(value.abs())),
    };
    let mut image = vec![0; image_bytes(&pieces)];
    let mut writer = TableWriter::new(&mut image, &header, &pieces)?;
    for _ in 0..pieces[0].rows() {
        writer.row(&PLANNED)?;
    }
    writer.finish()?;
    Ok(image)
}

/// The first tick's command where `force_n` is measured at the tip, N, and everything else is
/// as planned.
fn one_tick(force_n: f32) -> Result<Command<f32>, TableError> {
    let arm = ArmParameters::PAPER;
    let image = table_image(&arm)?;
    let table = Table::open(&image)?;
    let law = PaperParameters {
        force_proportional: 0.5,
        ..PaperParameters::FEEDFORWARD
    };
    let limits = LimitParameters {
        torque_nm: [20.0, 2.0],
        torque_rate_nm_s: [1e4, 1e3],
    };
    let mut controller = Controller::<f32>::new(&table, &arm, &law.into(), &limits)?;
    let measured = Measurement {
        angle: PLANNED.angle.map(|angle| angle as f32),
        root_slope: PLANNED.root_slope as f32,
        force: force_n,
        ..Measurement::default()
    };
    Ok(controller.tick(&measured))
}

fn main() -> Result<(), TableError> {
    println!("planned:         {:?} N m", PLANNED.torque);
    for force_n in [2.0, 1.5] {
        let command = one_tick(force_n)?;
        println!("{force_n} N measured:  {:?} N m", command.torque);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_little_force_is_answered_by_the_jacobians_transpose() {
        let planned = one_tick(2.0).unwrap().torque.map(f64::from);
        let pressing = one_tick(1.5).unwrap().torque.map(f64::from);
        // u = K_PF * 0.5 N, along the normal: straight down.
        let u = 0.5 * 0.5;
        let [first, second] = PLANNED.angle.map(libm::cos);
        let expected = [u * (0.5 * first + 0.55 * second), u * 0.55 * second];
        for joint in 0..2 {
            assert!((planned[joint] - PLANNED.torque[joint]).abs() < 1e-6);
            assert!((pressing[joint] - planned[joint] - expected[joint]).abs() < 1e-5);
        }
    }
}
