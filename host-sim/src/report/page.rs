//! Pages made of templates: each extends `base.html`, which has what all have in common: one style,
//! one script, and uPlot for the charts. A page needs nothing but itself.

use super::figures::Figure;
use super::motion::Motion;
use super::series::Panel;
use super::{ReportError, write_file};
use minijinja::{Environment, Value, context};
use serde::Serialize;
use std::path::Path;

/// The templates. Their names' ending makes all text escaped.
const TEMPLATES: [(&str, &str); 7] = [
    ("base.html", include_str!("base.html")),
    ("explore.html", include_str!("explore.html")),
    ("report.html", include_str!("report.html")),
    ("plan.html", include_str!("plan.html")),
    ("gains.html", include_str!("gains.html")),
    ("accuracy.html", include_str!("accuracy.html")),
    ("campaign.html", include_str!("campaign.html")),
];

/// What all pages look like, light and dark.
const STYLE: &str = include_str!("style.css");

/// What all pages do.
const SCRIPT: &str = include_str!("page.js");

/// The charts, as they are published (`uplot/README.md`), and what their licence asks for.
const UPLOT: [&str; 3] = [
    include_str!("uplot/uPlot.iife.min.js"),
    include_str!("uplot/uPlot.min.css"),
    include_str!("uplot/LICENSE"),
];

/// What came out, in a sentence, and whether it is good.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Verdict {
    /// Whether it is what was wanted.
    pub good: bool,
    /// The sentence.
    pub text: String,
}

/// What a page can be looked into: charts that share a time, and an arm that moves with it.
#[derive(Serialize)]
pub(super) struct Explored {
    /// Names of case and plant.
    pub(super) name: String,
    /// The arm, where there is one.
    pub(super) motion: Option<Motion>,
    /// The charts.
    pub(super) panels: Vec<Panel>,
}

/// The page of a template of that name. `explored` are the cases that it can be looked into, with
/// the one that it begins with.
pub(super) fn render(
    name: &str,
    values: Value,
    explored: Option<(&[Explored], usize)>,
) -> Result<String, minijinja::Error> {
    let mut environment = Environment::new();
    for (name, template) in TEMPLATES {
        environment.add_template(name, template)?;
    }
    environment.add_global("style", Value::from_safe_string(STYLE.into()));
    let Some((cases, shown)) = explored else {
        return environment.get_template(name)?.render(values);
    };
    let [charts, charts_style, licence] = UPLOT;
    let globals = [
        ("script", SCRIPT.to_string()),
        ("charts", charts.trim_end().to_string()),
        ("charts_style", charts_style.to_string()),
        ("charts_licence", licence.trim_end().to_string()),
        ("data", script_json(&Data { shown, cases })?),
    ];
    for (name, text) in globals {
        environment.add_global(name, Value::from_safe_string(text));
    }
    let moves = cases.iter().any(|case| case.motion.is_some());
    let names: Vec<String> = cases.iter().map(|case| case.name.clone()).collect();
    environment.add_global("moves", moves);
    environment.add_global("explored", names);
    environment.get_template(name)?.render(values)
}

/// What the script gets.
#[derive(Serialize)]
struct Data<'a> {
    shown: usize,
    cases: &'a [Explored],
}

/// Writes the page of a template of that name to `path`; see [`render`].
pub(super) fn write(
    path: &Path,
    name: &str,
    values: Value,
    explored: Option<(&[Explored], usize)>,
) -> Result<(), ReportError> {
    let page = render(name, values, explored).map_err(|error| ReportError::Page {
        path: path.to_path_buf(),
        reason: error.to_string(),
    })?;
    write_file(path, &page)
}

/// JSON that can stand in a script element: nothing in it can close the element or open
/// a comment.
fn script_json<T: Serialize>(value: &T) -> Result<String, minijinja::Error> {
    let json = serde_json::to_string(value).map_err(|error| {
        minijinja::Error::new(minijinja::ErrorKind::BadSerialization, error.to_string())
    })?;
    let mut safe = String::with_capacity(json.len());
    for c in json.chars() {
        match c {
            '<' | '>' | '&' | '\u{2028}' | '\u{2029}' => {
                safe.push_str(&format!("\\u{:04x}", c as u32));
            }
            c => safe.push(c),
        }
    }
    Ok(safe)
}

/// Writes figures as SVG files into a folder.
pub(super) fn write_svgs(folder: &Path, figures: &[Figure]) -> Result<(), ReportError> {
    figures.iter().try_for_each(|figure| {
        write_file(&folder.join(format!("{}.svg", figure.name)), &figure.svg)
    })
}

/// Figures as the templates take them.
pub(super) fn embedded(figures: Vec<Figure>) -> Vec<Value> {
    figures
        .into_iter()
        .map(|figure| {
            // In HTML the elements need no name space, and so the page no address.
            let svg = figure
                .svg
                .replacen(r#" xmlns="http://www.w3.org/2000/svg""#, "", 1);
            context! {
                name => figure.name,
                caption => figure.caption,
                svg => Value::from_safe_string(svg),
            }
        })
        .collect()
}
