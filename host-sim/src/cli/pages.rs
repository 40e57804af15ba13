//! The figures and pages that commands write beside their results.
//!
//! Without the feature `report`, `no_pages.rs` stands in for this module.

use super::{CliError, Output};
use crate::analysis::fixed_point::accuracy::Accuracy;
use crate::analysis::stability::map::GainId;
use crate::analysis::stability::path::{Report, Summary};
use crate::analysis::stability::{StabilityError, map, path};
use crate::campaign::findings::Findings;
use crate::campaign::identity::CampaignIdentity;
use crate::campaign::record::CampaignRecords;
use crate::planner::plan::Plan;
use crate::plant::PlantParameters;
use crate::plant::spread::PlantVariant;
use crate::report;
use crate::simulation::closed_loop::Run;
use flexor::control::PaperParameters;

/// A case's name, the plant's, the plan and the run.
pub(super) type CaseRun<'a> = (&'a str, &'a str, &'a Plan, &'a Run);

/// What the page on gains shows.
pub(super) struct GainsContent<'a> {
    pub(super) plan: &'a Plan,
    pub(super) plant: &'a PlantParameters,
    pub(super) law: &'a PaperParameters,
    pub(super) report: &'a Report,
    pub(super) map_of: [GainId; 2],
    pub(super) warnings: &'a [String],
    pub(super) facts: &'a [(String, String)],
}

/// The page's file in a folder.
const PAGE: &str = "report.html";

/// Where a page will be, as a sentence.
fn place(output: &Output) -> String {
    format!("The report is {}", output.folder().join(PAGE).display())
}

/// Writes figures and page of runs; says where they will be.
pub(super) fn runs(
    output: &Output,
    title: &str,
    cases: &[CaseRun<'_>],
    facts: &[(String, String)],
) -> Result<String, CliError> {
    let cases: Vec<report::Case> = cases
        .iter()
        .map(|&(case, plant, plan, run)| report::Case {
            case,
            plant,
            plan,
            run,
        })
        .collect();
    let folder = output.partial();
    report::write_figures(&folder, &cases)?;
    report::write_html(&folder.join(PAGE), title, &cases, facts)?;
    Ok(place(output))
}

/// Writes figures and page on the accuracy of number types; says where they will be.
pub(super) fn accuracy(
    output: &Output,
    accuracies: &[Accuracy],
    facts: &[(String, String)],
) -> Result<String, CliError> {
    let folder = output.partial();
    report::write_accuracy(&folder, &folder.join(PAGE), accuracies, facts)?;
    Ok(place(output))
}

/// Writes figures and page on gains; says where they will be.
pub(super) fn gains(output: &Output, content: &GainsContent<'_>) -> Result<String, CliError> {
    let GainsContent { plan, report, .. } = *content;
    let variant = PlantVariant::new(&plan.model.arm, plan.tick_rate_hz, content.plant, 0.0)
        .map_err(StabilityError::from)?;
    let start = plan.time(0);
    let frozen_points = path::frozen_points(plan, &variant, &[start])?;
    let map = map::map(plan, &variant, content.law, content.map_of)?;
    let mut spread: Vec<&Summary> = report.spread.iter().collect();
    spread.sort_by(|a, b| b.spectral_radius_max.total_cmp(&a.spectral_radius_max));
    let plants: Vec<&Summary> = std::iter::once(&report.nominal).chain(spread).collect();
    let page = report::GainsPage {
        title: "Flexor: gains",
        warnings: content.warnings,
        plants: &plants,
        gains: report::Gains {
            points: &report.points,
            frozen_points: &frozen_points,
            map: &map,
            times: [start, plan.time(plan.ticks)],
        },
        notes: content.facts,
    };
    report::write_gains(&output.partial(), &page)?;
    Ok(place(output))
}

/// Writes figures and page of a campaign; says where they will be.
pub(super) fn campaign(
    output: &Output,
    identity: &CampaignIdentity,
    records: &CampaignRecords,
    findings: &Findings,
) -> Result<String, CliError> {
    let page = report::CampaignPage {
        identity,
        records,
        findings,
        notes: &[],
    };
    report::write_campaign(&output.partial(), &page)?;
    Ok(place(output))
}
