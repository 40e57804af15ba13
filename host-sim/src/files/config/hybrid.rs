//! The hybrid law's part of `controller.toml`.

use super::ranges::accepted;
use super::written::{line, number};
use super::{Check, ConfigError, parse};
use flexor::control::{FreeParameters, HybridParameters, MotionParameters};
use serde::Deserialize;
use serde::de::IgnoredAny;

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
    free: FreeFile,
    motion: Option<MotionFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FreeFile {
    #[serde(rename = "stiffness_Nm_rad")]
    stiffness: f64,
    #[serde(rename = "damping_Nms_rad")]
    damping: f64,
    #[serde(rename = "torque_loop_per_s")]
    torque_loop: f64,
    #[serde(rename = "section_frequency_rad_s")]
    section_frequency: f64,
    section_damping: f64,
    #[serde(rename = "section_angle_Nm_rad")]
    section_angle: [f64; 2],
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct MotionFile {
    settle_s: Option<f64>,
    approach_speed_m_s: Option<f64>,
    approach_limit_m: Option<f64>,
    contact_on_share: Option<f64>,
    contact_off_share: Option<f64>,
    force_ramp_per_s: Option<f64>,
    lost_s: Option<f64>,
    stop_s: Option<f64>,
    lift_speed_m_s: Option<f64>,
    lift_m: Option<f64>,
}

fn parse_free(check: &Check<'_>, read: &FreeFile) -> Result<FreeParameters, ConfigError> {
    let value = |key: &str, value| check.value(&format!("free.{key}"), value);
    Ok(FreeParameters {
        stiffness_nm_rad: value("stiffness_Nm_rad", read.stiffness)?,
        damping_nms_rad: value("damping_Nms_rad", read.damping)?,
        torque_loop_per_s: value("torque_loop_per_s", read.torque_loop)?,
        section_frequency_rad_s: value("section_frequency_rad_s", read.section_frequency)?,
        section_damping: value("section_damping", read.section_damping)?,
        section_angle_nm_rad: check.pair("free.section_angle_Nm_rad", read.section_angle)?,
    })
}

fn parse_motion(check: &Check<'_>, read: &MotionFile) -> Result<MotionParameters, ConfigError> {
    let or = |key: &str, value: Option<f64>, default: f64| {
        let value = check.optional(&format!("motion.{key}"), value)?;
        Ok::<f64, ConfigError>(value.unwrap_or(default))
    };
    let d = MotionParameters::DEFAULT;
    Ok(MotionParameters {
        settle_s: or("settle_s", read.settle_s, d.settle_s)?,
        approach_speed_m_s: or(
            "approach_speed_m_s",
            read.approach_speed_m_s,
            d.approach_speed_m_s,
        )?,
        approach_limit_m: or(
            "approach_limit_m",
            read.approach_limit_m,
            d.approach_limit_m,
        )?,
        contact_on_share: or(
            "contact_on_share",
            read.contact_on_share,
            d.contact_on_share,
        )?,
        contact_off_share: or(
            "contact_off_share",
            read.contact_off_share,
            d.contact_off_share,
        )?,
        force_ramp_per_s: or(
            "force_ramp_per_s",
            read.force_ramp_per_s,
            d.force_ramp_per_s,
        )?,
        lost_s: or("lost_s", read.lost_s, d.lost_s)?,
        stop_s: or("stop_s", read.stop_s, d.stop_s)?,
        lift_speed_m_s: or("lift_speed_m_s", read.lift_speed_m_s, d.lift_speed_m_s)?,
        lift_m: or("lift_m", read.lift_m, d.lift_m)?,
    })
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
        free: parse_free(&check, &read.free)?,
        motion: parse_motion(&check, &read.motion.unwrap_or_default())?,
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

/// What concerns the force.
fn force_lines(law: &HybridParameters) -> [Line; 7] {
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
    ]
}

/// Joint 2 in the air.
fn free_lines(free: &FreeParameters) -> [Line; 6] {
    let section = free.section_frequency_rad_s;
    [
        ("stiffness_Nm_rad", number(free.stiffness_nm_rad), "k2"),
        ("damping_Nms_rad", number(free.damping_nms_rad), "B2"),
        ("torque_loop_per_s", number(free.torque_loop_per_s), "K_T"),
        ("section_frequency_rad_s", number(section), "w"),
        ("section_damping", number(free.section_damping), "z"),
        ("section_angle_Nm_rad", pair(free.section_angle_nm_rad), "g"),
    ]
}

/// Contact made, kept, lost and left.
fn motion_lines(m: &MotionParameters) -> [Line; 10] {
    [
        (
            "settle_s",
            m.settle_s,
            "how long the first tick is held, pressing, before the table begins",
        ),
        (
            "approach_speed_m_s",
            m.approach_speed_m_s,
            "of the tip towards the surface",
        ),
        (
            "approach_limit_m",
            m.approach_limit_m,
            "way after which an approach is given up",
        ),
        (
            "contact_on_share",
            m.contact_on_share,
            "of the planned force: from there on there is contact",
        ),
        (
            "contact_off_share",
            m.contact_off_share,
            "below it there is none",
        ),
        (
            "force_ramp_per_s",
            m.force_ramp_per_s,
            "planned forces a second by which force is made and taken away",
        ),
        ("lost_s", m.lost_s, "time without contact that ends a run"),
        ("stop_s", m.stop_s, "time in which the path comes to a stop"),
        (
            "lift_speed_m_s",
            m.lift_speed_m_s,
            "of the tip off the surface",
        ),
        ("lift_m", m.lift_m, "way by which it is lifted"),
    ]
    .map(|(key, value, what)| (key, number(value), what))
}

fn add(text: &mut String, lines: &[Line]) {
    let lines = lines.iter();
    text.extend(lines.map(|(key, value, what)| line(&format!("{key} = {value}"), what)));
}

/// `law` as the text of a `controller.toml`; see [`super::controller_toml`].
pub(super) fn hybrid_toml(law: &HybridParameters, how: &[String]) -> String {
    let mut text =
        String::from("# Gains of the hybrid law; docs/control.md says what each does.\n");
    text.extend(how.iter().map(|line| format!("# {line}\n")));
    text.push('\n');
    add(&mut text, &joint_lines(law));
    add(&mut text, &force_lines(law));
    text.push_str("\n[free]   # joint 2 with the tip in the air\n");
    add(&mut text, &free_lines(&law.free));
    text.push_str("\n[motion]   # contact made, kept, lost and left\n");
    add(&mut text, &motion_lines(&law.motion));
    text
}
