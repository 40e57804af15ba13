//! What stands in for `pages.rs` where the feature `report` is off: no figures, no pages.

use super::{CliError, Output};
use crate::analysis::fixed_point::accuracy::Accuracy;
use crate::analysis::stability::map::GainId;
use crate::analysis::stability::path::Report;
use crate::campaign::findings::Findings;
use crate::campaign::identity::CampaignIdentity;
use crate::campaign::record::CampaignRecords;
use crate::planner::plan::Plan;
use crate::plant::PlantParameters;
use crate::simulation::closed_loop::Run;
use flexor::control::PaperParameters;

/// A case's name, the plant's, the plan and the run.
pub(super) type CaseRun<'a> = (&'a str, &'a str, &'a Plan, &'a Run);

/// What the page of runs would show.
#[allow(dead_code)]
pub(super) struct RunsContent<'a> {
    pub(super) title: &'a str,
    pub(super) cases: &'a [CaseRun<'a>],
    /// The case that it begins with.
    pub(super) shown: usize,
    pub(super) facts: &'a [(String, String)],
    pub(super) provenance: &'a [(String, String)],
}

/// What the page of a plan would show.
#[allow(dead_code)]
pub(super) struct PlanContent<'a> {
    pub(super) plan: &'a Plan,
    /// Whether it can be driven, in a sentence.
    pub(super) verdict: (bool, String),
    pub(super) warnings: &'a [String],
    pub(super) facts: &'a [(String, String)],
    pub(super) provenance: &'a [(String, String)],
}

/// What the page on accuracy would show.
#[allow(dead_code)]
pub(super) struct AccuracyContent<'a> {
    pub(super) accuracies: &'a [Accuracy],
    /// What is above its bound or limit, in words.
    pub(super) excess: &'a [String],
    /// What was asked for of the joints, N m.
    pub(super) limit_nm: Option<[f64; 2]>,
    pub(super) facts: &'a [(String, String)],
    pub(super) provenance: &'a [(String, String)],
}

/// What a page on gains would show.
#[allow(dead_code)]
pub(super) struct GainsContent<'a> {
    pub(super) plan: &'a Plan,
    pub(super) plant: &'a PlantParameters,
    pub(super) law: &'a PaperParameters,
    pub(super) report: &'a Report,
    pub(super) map_of: [GainId; 2],
    pub(super) warnings: &'a [String],
    pub(super) facts: &'a [(String, String)],
    pub(super) provenance: &'a [(String, String)],
}

/// Where results are, as a sentence.
fn place(output: &Output) -> Result<String, CliError> {
    Ok(format!("The results are in {}", output.folder().display()))
}

/// Says where the results are.
pub(super) fn runs(output: &Output, _content: &RunsContent<'_>) -> Result<String, CliError> {
    place(output)
}

/// Says where the results are.
pub(super) fn plan(output: &Output, _content: &PlanContent<'_>) -> Result<String, CliError> {
    place(output)
}

/// Says where the results are.
pub(super) fn accuracy(
    output: &Output,
    _content: &AccuracyContent<'_>,
) -> Result<String, CliError> {
    place(output)
}

/// Says where the results are.
pub(super) fn gains(output: &Output, _content: &GainsContent<'_>) -> Result<String, CliError> {
    place(output)
}

/// Says where the results are.
pub(super) fn campaign(
    output: &Output,
    _campaign: (&CampaignIdentity, &CampaignRecords, &Findings),
    _provenance: &[(String, String)],
) -> Result<String, CliError> {
    place(output)
}
