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

/// What the page of runs shows.
pub(super) struct RunsContent<'a> {
    pub(super) title: &'a str,
    pub(super) cases: &'a [CaseRun<'a>],
    /// The case that it begins with.
    pub(super) shown: usize,
    pub(super) facts: &'a [(String, String)],
    pub(super) provenance: &'a [(String, String)],
}

/// What the page of a plan shows.
pub(super) struct PlanContent<'a> {
    pub(super) plan: &'a Plan,
    /// Whether it can be driven, in a sentence.
    pub(super) verdict: (bool, String),
    pub(super) warnings: &'a [String],
    pub(super) facts: &'a [(String, String)],
    pub(super) provenance: &'a [(String, String)],
}

/// What the page on accuracy shows.
pub(super) struct AccuracyContent<'a> {
    pub(super) accuracies: &'a [Accuracy],
    /// What is above its bound or limit, in words.
    pub(super) excess: &'a [String],
    /// What was asked for of the joints, N m.
    pub(super) limit_nm: Option<[f64; 2]>,
    pub(super) facts: &'a [(String, String)],
    pub(super) provenance: &'a [(String, String)],
}

/// What the page on gains shows.
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

/// The page's file in a folder.
const PAGE: &str = "report.html";

/// Where a page will be, as a sentence.
fn place(output: &Output) -> String {
    format!("The report is {}", output.folder().join(PAGE).display())
}

/// Writes figures and page of runs; says where they will be.
pub(super) fn runs(output: &Output, content: &RunsContent<'_>) -> Result<String, CliError> {
    let cases = content.cases.iter();
    let cases: Vec<report::Case> = cases
        .map(|&(case, plant, plan, run)| report::Case {
            case,
            plant,
            plan,
            run,
        })
        .collect();
    let folder = output.partial();
    report::write_figures(&folder, &cases)?;
    let page = report::RunsPage {
        title: content.title,
        cases: &cases,
        shown: content.shown,
        notes: content.facts,
        provenance: content.provenance,
    };
    report::write_html(&folder.join(PAGE), &page)?;
    Ok(place(output))
}

/// Writes figure and page of a plan; says where they will be.
pub(super) fn plan(output: &Output, content: &PlanContent<'_>) -> Result<String, CliError> {
    let (good, text) = content.verdict.clone();
    let page = report::PlanPage {
        title: "Flexor: plan",
        verdict: &report::Verdict { good, text },
        warnings: content.warnings,
        plan: content.plan,
        notes: content.facts,
        provenance: content.provenance,
    };
    report::write_plan(&output.partial(), &page)?;
    Ok(place(output))
}

/// Writes figures and page on the accuracy of number types; says where they will be.
pub(super) fn accuracy(output: &Output, content: &AccuracyContent<'_>) -> Result<String, CliError> {
    let asked = match content.limit_nm {
        Some(_) => "bounds and limits",
        None => "bounds",
    };
    let verdict = match content.excess {
        [] => report::Verdict {
            good: true,
            text: format!("f32 and fixed point keep to their {asked}, joint by joint."),
        },
        excess => report::Verdict {
            good: false,
            text: format!("Not within its {asked}: {}.", excess.join("; ")),
        },
    };
    let page = report::AccuracyPage {
        accuracies: content.accuracies,
        verdict: &verdict,
        limit_nm: content.limit_nm,
        notes: content.facts,
        provenance: content.provenance,
    };
    report::write_accuracy(&output.partial(), &page)?;
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
    let plants: Vec<&Summary> = std::iter::once(&report.nominal)
        .chain(&report.spread)
        .collect();
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
        provenance: content.provenance,
    };
    report::write_gains(&output.partial(), &page)?;
    Ok(place(output))
}

/// Writes figures and page of a campaign; says where they will be.
pub(super) fn campaign(
    output: &Output,
    (identity, records, findings): (&CampaignIdentity, &CampaignRecords, &Findings),
    provenance: &[(String, String)],
) -> Result<String, CliError> {
    let page = report::CampaignPage {
        identity,
        records,
        findings,
        notes: &[],
        provenance,
    };
    report::write_campaign(&output.partial(), &page)?;
    Ok(place(output))
}
