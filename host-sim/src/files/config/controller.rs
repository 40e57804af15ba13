//! `controller.toml`: gains, filters and options of the law.

use super::{Check, ConfigError, parse};
use flexor::control::{ForceProjection, LawParameters, SlopeRateFeedback};
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ControllerFile {
    #[serde(rename = "K_DF_s", alias = "K_DF")]
    force_derivative: f64,
    #[serde(rename = "K_PF")]
    force_proportional: f64,
    #[serde(rename = "K_IF_per_s", alias = "K_IF")]
    force_integral: f64,
    #[serde(rename = "K_w_Nms_rad", alias = "K_w")]
    slope_rate: f64,
    #[serde(rename = "force_filter_Hz")]
    force_filter: Option<f64>,
    #[serde(rename = "slope_rate_filter_Hz")]
    slope_rate_filter: Option<f64>,
    #[serde(default)]
    force_projection: ForceProjectionFile,
    #[serde(default)]
    slope_rate_feedback: SlopeRateFeedbackFile,
    #[serde(default = "default_true")]
    feedforward: bool,
}

fn default_true() -> bool {
    true
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum ForceProjectionFile {
    #[default]
    JacobianTranspose,
    AsPrinted,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum SlopeRateFeedbackFile {
    #[default]
    Deviation,
    AsPrinted,
}

/// Corner of the force filter, Hz, where K_DF wants one and the file gives none: an
/// unfiltered derivative is noise. Well above the contact mode (Table 1's arm: 5.5 Hz).
pub const DERIVATIVE_FILTER_HZ: f64 = 100.0;

/// Reads the text of a `controller.toml`; `file` is its name for messages.
///
/// # Errors
/// [`ConfigError`].
pub fn parse_controller(file: &str, text: &str) -> Result<LawParameters, ConfigError> {
    let read: ControllerFile = parse(file, text)?;
    let check = Check { file };
    let force_derivative_s = check.value("K_DF_s", read.force_derivative)?;
    let force_filter_hz = check
        .optional("force_filter_Hz", read.force_filter)?
        .or((force_derivative_s != 0.0).then_some(DERIVATIVE_FILTER_HZ));
    Ok(LawParameters {
        force_derivative_s,
        force_proportional: check.value("K_PF", read.force_proportional)?,
        force_integral_per_s: check.value("K_IF_per_s", read.force_integral)?,
        slope_rate_nms_rad: check.value("K_w_Nms_rad", read.slope_rate)?,
        force_filter_hz,
        slope_rate_filter_hz: check.optional("slope_rate_filter_Hz", read.slope_rate_filter)?,
        force_projection: match read.force_projection {
            ForceProjectionFile::JacobianTranspose => ForceProjection::JacobianTranspose,
            ForceProjectionFile::AsPrinted => ForceProjection::AsPrinted,
        },
        slope_rate_feedback: match read.slope_rate_feedback {
            SlopeRateFeedbackFile::Deviation => SlopeRateFeedback::Deviation,
            SlopeRateFeedbackFile::AsPrinted => SlopeRateFeedback::AsPrinted,
        },
        feedforward: read.feedforward,
    })
}
