//! The page on gains: verdict and plants first, the ones with the least to spare on top; then margins
//! along the path, poles and map.

use super::figures::gains::{self, Gains};
use super::page::{Explored, Verdict};
use super::series::Panel;
use super::{ReportError, page};
use crate::analysis::stability::path::{
    DELAY_MARGIN_MAX_TICKS, GAIN_MARGIN_MAX_DB, PathPoint, Summary,
};
use minijinja::{Value, context};
use std::path::Path;

/// What the page on gains shows.
#[derive(Clone, Copy, Debug)]
pub struct GainsPage<'a> {
    /// The page's title.
    pub title: &'a str,
    /// What to warn of.
    pub warnings: &'a [String],
    /// The plants examined, that in the middle first.
    pub plants: &'a [&'a Summary],
    /// The figures' data.
    pub gains: Gains<'a>,
    /// Names and facts.
    pub notes: &'a [(String, String)],
    /// What it was made from: names and facts.
    pub provenance: &'a [(String, String)],
}

/// Writes the page on gains to `dir`/report.html and its figures beside it as SVG files:
/// `gains_loci.svg`, `gains_map.svg`, `gains_margins.svg`. All text is escaped, and the
/// page needs nothing but itself.
///
/// # Errors
/// [`ReportError`].
pub fn write_gains(dir: &Path, content: &GainsPage<'_>) -> Result<(), ReportError> {
    let mut figures = gains::figures(&content.gains)?;
    page::write_svgs(dir, &figures)?;
    // Those that the charts show as well.
    let stills = figures.split_off(2);
    let values = context! {
        title => content.title,
        verdict => verdict(content.plants),
        warnings => content.warnings,
        rows => rows(content.plants),
        figures => page::embedded(figures),
        stills => page::embedded(stills),
        notes => content.notes,
        provenance => content.provenance,
    };
    let explored = [explored(&content.gains)];
    page::write(
        &dir.join("report.html"),
        "gains.html",
        values,
        Some((&explored, 0)),
    )
}

/// How near to instability a plant is: with either margin as a share of what is wanted of it.
fn tightness(plant: &Summary) -> f64 {
    match plant.stable {
        true => (plant.gain_margin_db / 6.0).min(plant.delay_margin_ticks),
        false => f64::NEG_INFINITY,
    }
}

/// The plants, those with the least to spare first; of unstable ones the fastest growing.
fn sorted<'a>(plants: &[&'a Summary]) -> Vec<&'a Summary> {
    let mut sorted = plants.to_vec();
    sorted.sort_by(|a, b| {
        let margin = tightness(a).total_cmp(&tightness(b));
        margin.then(b.spectral_radius_max.total_cmp(&a.spectral_radius_max))
    });
    sorted
}

fn rows(plants: &[&Summary]) -> Vec<Value> {
    let row = |(place, plant): (usize, &Summary)| {
        context! {
            name => plant.name,
            binds => place == 0 && plants.len() > 1,
            stable => plant.stable,
            radius => format!("{:.6}", plant.spectral_radius_max),
            worst_t => format!("{:.3}", plant.worst_t_s),
            mode => plant.worst_mode,
            damping => format!("{:.3}", plant.contact_damping_min),
            gain => format!("{:.1}", plant.gain_margin_db),
            delay => format!("{:.2}", plant.delay_margin_ticks),
        }
    };
    sorted(plants).into_iter().enumerate().map(row).collect()
}

fn verdict(plants: &[&Summary]) -> Verdict {
    let unstable = plants.iter().filter(|plant| !plant.stable).count();
    let sorted = sorted(plants);
    let Some(tightest) = sorted.first() else {
        return Verdict {
            good: false,
            text: "No plant was examined.".into(),
        };
    };
    let least = |f: &dyn Fn(&Summary) -> f64| {
        plants
            .iter()
            .map(|plant| f(plant))
            .fold(f64::INFINITY, f64::min)
    };
    let text = match (unstable, plants.len()) {
        (0, 1) => format!(
            "Stable along the path, with {:.1} dB and {:.2} ticks to spare.",
            tightest.gain_margin_db, tightest.delay_margin_ticks
        ),
        (0, all) => format!(
            "Stable along the path on all {all} plants, with at least {:.1} dB and {:.2} ticks to spare; {} binds.",
            least(&|p| p.gain_margin_db),
            least(&|p| p.delay_margin_ticks),
            tightest.name
        ),
        (_, all) => format!(
            "Unstable on {unstable} of {all} plants; {} grows fastest.",
            tightest.name
        ),
    };
    Verdict {
        good: unstable == 0,
        text,
    }
}

/// Margins and damping along the path.
fn explored(gains: &Gains<'_>) -> Explored {
    // The points lie at whole ticks, and as many as there are need no finer steps than these.
    let step = 1e-5;
    let curve = |panel: Panel, label: &str, style, value: &dyn Fn(&PathPoint) -> f64| {
        let points = gains.points.iter().map(|point| [point.t, value(point)]);
        panel.with(label, style, step, points)
    };
    let level = |panel: Panel, label: &str, at: f64| {
        panel.with(label, "planned", step, gains.times.map(|t| [t, at]))
    };
    let panel = Panel::new(
        "gain margin",
        "dB",
        1.0,
        [-GAIN_MARGIN_MAX_DB, GAIN_MARGIN_MAX_DB],
    );
    let gain = curve(level(panel, "wanted", 6.0), "margin", "0", &|p| {
        p.gain_margin_db
    });
    let panel = Panel::new("delay margin", "ticks", 0.2, [0.0, DELAY_MARGIN_MAX_TICKS]);
    let delay = curve(level(panel, "wanted", 1.0), "margin", "0", &|p| {
        p.delay_margin_ticks
    });
    let panel = Panel::new("damping ratio", "", 0.02, [-1.0, 1.0]);
    let damping = curve(
        level(panel, "edge of stability", 0.0),
        "contact mode",
        "0",
        &|p| p.verdict.contact_damping,
    );
    let panel = Panel::new("real part", "1/s", 0.5, [-200.0, 200.0]);
    let panel = level(panel, "edge of stability", 0.0);
    let panel = curve(panel, "slowest pole but the tangential", "0", &|p| {
        p.verdict.worst.re
    });
    let real = curve(panel, "tangential mode", "1", &|p| {
        p.verdict.tangential[0].re.max(p.verdict.tangential[1].re)
    });
    Explored {
        name: "planned arm".into(),
        motion: None,
        panels: vec![gain, delay, damping, real],
    }
}
