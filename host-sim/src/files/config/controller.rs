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

/// `law` as the text of a `controller.toml`, whose first comment has the lines `how`: how it
/// was found. [`parse_controller`] reads the same law from it, but for a force filter that
/// filters nothing, which is left out.
pub fn controller_toml(law: &LawParameters, how: &[String]) -> String {
    // Every number as a float, which TOML tells from an integer.
    let number = |x: f64| format!("{x:?}");
    // A key with its value, or commented out with an example; and what it is for.
    let line = |assignment: String, comment: &str| format!("{assignment:<41} # {comment}\n");
    let filter = |key: &str, hz: Option<f64>, example: f64, comment: &str| match hz {
        Some(hz) => line(format!("{key} = {}", number(hz)), comment),
        None => line(format!("# {key} = {}", number(example)), comment),
    };
    let filtered = law.force_derivative_s != 0.0 || law.force_proportional != 0.0;
    let projection = match law.force_projection {
        ForceProjection::JacobianTranspose => "jacobian-transpose",
        ForceProjection::AsPrinted => "as-printed",
    };
    let slope_rate = match law.slope_rate_feedback {
        SlopeRateFeedback::Deviation => "deviation",
        SlopeRateFeedback::AsPrinted => "as-printed",
    };
    let mut text = String::from(
        "# Gains of eq. 18-20, found by `flexor gains tune`; docs/gains.md says how.\n",
    );
    text.extend(how.iter().map(|line| format!("# {line}\n")));
    let gains = [
        (
            "K_DF_s",
            law.force_derivative_s,
            "on the force error's derivative",
        ),
        ("K_PF", law.force_proportional, "on the force error"),
        ("K_IF_per_s", law.force_integral_per_s, "on its integral"),
        (
            "K_w_Nms_rad",
            law.slope_rate_nms_rad,
            "on the root slope rate",
        ),
    ];
    text.push('\n');
    text.extend(gains.map(|(key, gain, what)| line(format!("{key} = {}", number(gain)), what)));
    text.push('\n');
    text += &filter(
        "force_filter_Hz",
        law.force_filter_hz.filter(|_| filtered),
        DERIVATIVE_FILTER_HZ,
        "corner of the filter on the force error; left out: none, or 100 with K_DF",
    );
    text += &filter(
        "slope_rate_filter_Hz",
        law.slope_rate_filter_hz,
        50.0,
        "corner of the filter on the slope rate; left out: none",
    );
    text.push('\n');
    text += &line(
        format!("force_projection = \"{projection}\""),
        "\"jacobian-transpose\" or \"as-printed\"",
    );
    text += &line(
        format!("slope_rate_feedback = \"{slope_rate}\""),
        "\"deviation\" from the plan, or \"as-printed\": all of it",
    );
    text += &line(
        format!("feedforward = {}", law.feedforward),
        "false: feedback only, as in the paper's figure 5",
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_written_controller_is_read_as_it_was() {
        let law = LawParameters {
            force_derivative_s: 1.2e-5,
            force_proportional: 0.25,
            force_integral_per_s: 4.0,
            slope_rate_nms_rad: 0.088,
            force_filter_hz: Some(120.0),
            slope_rate_filter_hz: None,
            force_projection: ForceProjection::AsPrinted,
            slope_rate_feedback: SlopeRateFeedback::AsPrinted,
            feedforward: false,
        };
        let text = controller_toml(&law, &["a word".into()]);
        assert_eq!(parse_controller("c", &text).unwrap(), law, "{text}");
        // A filter without a gain on what it filters is not written.
        let idle = LawParameters {
            force_derivative_s: 0.0,
            force_proportional: 0.0,
            slope_rate_filter_hz: Some(30.0),
            ..law
        };
        let text = controller_toml(&idle, &[]);
        let read = parse_controller("c", &text).unwrap();
        let expected = LawParameters {
            force_filter_hz: None,
            ..idle
        };
        assert_eq!(read, expected, "{text}");
    }
}
