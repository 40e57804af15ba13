//! The hybrid law's part of `controller.toml`.

use super::ranges::accepted;
use super::written::{line, number};
use super::{Check, ConfigError, parse};
use flexor::control::HybridParameters;
use serde::Deserialize;
use serde::de::IgnoredAny;

/// Time to settle where a file leaves it out, s: the slowest pole is at -3 1/s, and what is left
/// of the start's error after this is in the noise.
const SETTLE_S: f64 = 2.0;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct HybridFile {
    #[serde(rename = "law")]
    _law: Option<IgnoredAny>,
    #[serde(rename = "joint_stiffness_Nm_rad")]
    joint_stiffness: [f64; 2],
    #[serde(rename = "joint_damping_Nms_rad")]
    joint_damping: [f64; 2],
    #[serde(rename = "rate_filter_Hz")]
    rate_filter: [f64; 2],
    #[serde(rename = "joint1_integral_Nm_rads")]
    joint1_integral: f64,
    #[serde(rename = "joint1_integral_limit_Nm")]
    joint1_integral_limit: f64,
    #[serde(rename = "force_integral_per_s")]
    force_integral: f64,
    #[serde(rename = "torque_loop_per_s")]
    torque_loop: f64,
    #[serde(rename = "torque_correction_limit_Nm")]
    torque_correction_limit: f64,
    #[serde(rename = "section_frequency_rad_s")]
    section_frequency: f64,
    section_damping: f64,
    #[serde(rename = "section_angle_Nm_rad")]
    section_angle: [f64; 2],
    section_force: [f64; 2],
    settle_s: Option<f64>,
}

/// Reads a file that is of the hybrid law.
///
/// # Errors
/// [`ConfigError`].
pub(super) fn parse_hybrid(file: &str, text: &str) -> Result<HybridParameters, ConfigError> {
    let read: HybridFile = parse(file, text)?;
    let check = Check { file };
    let key = "joint1_integral_Nm_rads";
    let joint1_integral = check.value(key, read.joint1_integral)?;
    let joint_stiffness_nm_rad = check.pair("joint_stiffness_Nm_rad", read.joint_stiffness)?;
    // The integral is kept as an angle that the stiffness answers.
    if joint1_integral > 0.0 && joint_stiffness_nm_rad[0] == 0.0 {
        return Err(ConfigError::OutOfRange {
            file: file.into(),
            field: key.into(),
            value: joint1_integral,
            accepted: accepted(key).unwrap_or_default(),
        });
    }
    Ok(HybridParameters {
        joint_stiffness_nm_rad,
        joint_damping_nms_rad: check.pair("joint_damping_Nms_rad", read.joint_damping)?,
        rate_filter_hz: check.pair("rate_filter_Hz", read.rate_filter)?,
        joint1_integral_nm_rads: joint1_integral,
        joint1_integral_limit_nm: check
            .value("joint1_integral_limit_Nm", read.joint1_integral_limit)?,
        force_integral_per_s: check.value("force_integral_per_s", read.force_integral)?,
        torque_loop_per_s: check.value("torque_loop_per_s", read.torque_loop)?,
        torque_correction_limit_nm: check
            .value("torque_correction_limit_Nm", read.torque_correction_limit)?,
        section_frequency_rad_s: check.value("section_frequency_rad_s", read.section_frequency)?,
        section_damping: check.value("section_damping", read.section_damping)?,
        section_angle_nm_rad: check.pair("section_angle_Nm_rad", read.section_angle)?,
        section_force: check.pair("section_force", read.section_force)?,
        settle_s: check
            .optional("settle_s", read.settle_s)?
            .unwrap_or(SETTLE_S),
    })
}

/// A key, its value, and what it is.
type Line = (&'static str, String, &'static str);

fn pair([first, second]: [f64; 2]) -> String {
    format!("[{}, {}]", number(first), number(second))
}

/// The law, and what concerns the joints.
fn joint_lines(law: &HybridParameters) -> [Line; 6] {
    [
        (
            "law",
            "\"hybrid\"".into(),
            "or \"paper\", which has other keys",
        ),
        (
            "joint_stiffness_Nm_rad",
            pair(law.joint_stiffness_nm_rad),
            "K1, k2: about the planned motor angles",
        ),
        (
            "joint_damping_Nms_rad",
            pair(law.joint_damping_nms_rad),
            "B1, B2: against the planned rates",
        ),
        (
            "rate_filter_Hz",
            pair(law.rate_filter_hz),
            "corners of the filters on the rates",
        ),
        (
            "joint1_integral_Nm_rads",
            number(law.joint1_integral_nm_rads),
            "Ki1: what K1 and the plan leave over",
        ),
        (
            "joint1_integral_limit_Nm",
            number(law.joint1_integral_limit_nm),
            "largest torque of it",
        ),
    ]
}

/// What concerns the force, and the start.
fn force_lines(law: &HybridParameters) -> [Line; 8] {
    [
        (
            "force_integral_per_s",
            number(law.force_integral_per_s),
            "K_IF: on the force error's integral, in N",
        ),
        (
            "torque_loop_per_s",
            number(law.torque_loop_per_s),
            "K_T: how fast the root moment follows; 0: no gauge",
        ),
        (
            "torque_correction_limit_Nm",
            number(law.torque_correction_limit_nm),
            "largest torque of that loop",
        ),
        (
            "section_frequency_rad_s",
            number(law.section_frequency_rad_s),
            "w: of the second-order section",
        ),
        (
            "section_damping",
            number(law.section_damping),
            "z: its damping ratio",
        ),
        (
            "section_angle_Nm_rad",
            pair(law.section_angle_nm_rad),
            "g: what joint 2's error feeds to it",
        ),
        (
            "section_force",
            pair(law.section_force),
            "h: what the force error's moment feeds to it",
        ),
        (
            "settle_s",
            number(law.settle_s),
            "how long the first tick is held before the table begins",
        ),
    ]
}

/// `law` as the text of a `controller.toml`; see [`super::controller_toml`].
pub(super) fn hybrid_toml(law: &HybridParameters, how: &[String]) -> String {
    let mut text =
        String::from("# Gains of the hybrid law; docs/control.md says what each does.\n");
    text.extend(how.iter().map(|line| format!("# {line}\n")));
    text.push('\n');
    let lines = joint_lines(law).into_iter().chain(force_lines(law));
    text.extend(lines.map(|(key, value, what)| line(&format!("{key} = {value}"), what)));
    text
}
