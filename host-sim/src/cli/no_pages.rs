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
}

/// Where results are, as a sentence.
fn place(output: &Output) -> Result<String, CliError> {
    Ok(format!("The results are in {}", output.folder().display()))
}

/// Says where the results are.
pub(super) fn runs(
    output: &Output,
    _title: &str,
    _cases: &[CaseRun<'_>],
    _facts: &[(String, String)],
) -> Result<String, CliError> {
    place(output)
}

/// Says where the results are.
pub(super) fn accuracy(
    output: &Output,
    _accuracies: &[Accuracy],
    _facts: &[(String, String)],
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
    _identity: &CampaignIdentity,
    _records: &CampaignRecords,
    _findings: &Findings,
) -> Result<String, CliError> {
    place(output)
}
