//! `controller.toml`: which law, its gains, filters and options.

use super::hybrid::{hybrid_toml, parse_hybrid};
use super::written::{line, number};
use super::{Check, ConfigError, parse};
use flexor::control::{ForceProjection, LawParameters, PaperParameters, SlopeRateFeedback};
use serde::Deserialize;
use serde::de::IgnoredAny;

/// What is asked first; all other keys are the law's.
#[derive(Deserialize)]
struct Choice {
    #[serde(default)]
    law: LawName,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum LawName {
    #[default]
    Paper,
    Hybrid,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PaperFile {
    #[serde(rename = "law")]
    _law: Option<IgnoredAny>,
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
    let choice: Choice = parse(file, text)?;
    Ok(match choice.law {
        LawName::Paper => parse_paper(file, text)?.into(),
        LawName::Hybrid => parse_hybrid(file, text)?.into(),
    })
}

/// Reads a file that is of the paper's law.
fn parse_paper(file: &str, text: &str) -> Result<PaperParameters, ConfigError> {
    let read: PaperFile = parse(file, text)?;
    let check = Check { file };
    let force_derivative_s = check.value("K_DF_s", read.force_derivative)?;
    let force_filter_hz = check
        .optional("force_filter_Hz", read.force_filter)?
        .or((force_derivative_s != 0.0).then_some(DERIVATIVE_FILTER_HZ));
    Ok(PaperParameters {
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
    match law {
        LawParameters::Paper(paper) => paper_toml(paper, how),
        LawParameters::Hybrid(hybrid) => hybrid_toml(hybrid, how),
    }
}

/// The text for the paper's law.
fn paper_toml(law: &PaperParameters, how: &[String]) -> String {
    let filter = |key: &str, hz: Option<f64>, example: f64, comment: &str| match hz {
        Some(hz) => line(&format!("{key} = {}", number(hz)), comment),
        None => line(&format!("# {key} = {}", number(example)), comment),
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
    text += &format!(
        "\n{}",
        line("law = \"paper\"", "or \"hybrid\", which has other keys")
    );
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
    text.extend(gains.map(|(key, gain, what)| line(&format!("{key} = {}", number(gain)), what)));
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
        &format!("force_projection = \"{projection}\""),
        "\"jacobian-transpose\" or \"as-printed\"",
    );
    text += &line(
        &format!("slope_rate_feedback = \"{slope_rate}\""),
        "\"deviation\" from the plan, or \"as-printed\": all of it",
    );
    text += &line(
        &format!("feedforward = {}", law.feedforward),
        "false: feedback only, as in the paper's figure 5",
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use flexor::control::HybridParameters;

    #[test]
    fn a_written_controller_is_read_as_it_was() {
        let law = PaperParameters {
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
        let text = controller_toml(&law.into(), &["a word".into()]);
        assert_eq!(parse_controller("c", &text).unwrap(), law.into(), "{text}");
        // A filter without a gain on what it filters is not written.
        let idle = PaperParameters {
            force_derivative_s: 0.0,
            force_proportional: 0.0,
            slope_rate_filter_hz: Some(30.0),
            ..law
        };
        let text = controller_toml(&idle.into(), &[]);
        let read = parse_controller("c", &text).unwrap();
        let expected = PaperParameters {
            force_filter_hz: None,
            ..idle
        };
        assert_eq!(read, expected.into(), "{text}");
    }

    #[test]
    fn each_law_has_its_keys_and_no_others() {
        let error = |text: &str| {
            let error = parse_controller("c.toml", text).unwrap_err().to_string();
            assert!(!error.contains('\n'), "{error}");
            error
        };
        let hybrid = controller_toml(&HybridParameters::PAPER_ARM_HUB.into(), &[]);
        let read = parse_controller("c.toml", &hybrid).unwrap();
        assert_eq!(read, HybridParameters::PAPER_ARM_HUB.into(), "{hybrid}");
        assert!(error(&format!("{hybrid}K_PF = 1.0\n")).contains("unknown field `K_PF`"));
        let paper = controller_toml(&LawParameters::FEEDFORWARD, &[]);
        let key = "torque_loop_per_s";
        let words = error(&format!("{paper}{key} = 1.0\n"));
        assert!(words.contains(&format!("unknown field `{key}`")), "{words}");
        assert_eq!(
            error("law = \"best\""),
            "c.toml: line 1: law = \"best\"; accepted: \"paper\" or \"hybrid\""
        );
        for (from, to, words) in [
            (
                "section_damping = 0.567",
                "section_damping = 1.5",
                "section_damping = 1.5; accepted: a damping ratio from 0 to 1",
            ),
            (
                "rate_filter_Hz = [30.0, 4280.0]",
                "rate_filter_Hz = [30.0, 0.0]",
                "rate_filter_Hz[1] = 0; accepted: two frequencies in Hz above 0 up to 1e6",
            ),
            (
                "joint_stiffness_Nm_rad = [800.0, 2.21]",
                "joint_stiffness_Nm_rad = [0.0, 2.21]",
                "joint1_integral_Nm_rads = 2500; accepted: a gain in N m/(rad s), 0 where joint_stiffness_Nm_rad[0] is, from 0 to 1e11",
            ),
            (
                "force_integral_per_s = 10.2",
                "",
                "force_integral_per_s: missing field",
            ),
        ] {
            assert!(hybrid.contains(from), "{hybrid}");
            let error = error(&hybrid.replacen(from, to, 1));
            assert!(error.contains(words), "{error}");
        }
    }
}
