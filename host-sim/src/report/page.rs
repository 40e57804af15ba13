//! Pages made of templates: each extends `base.html`, which has what all have in common.

use super::figures::Figure;
use super::{ReportError, write_file};
use minijinja::{Environment, Value, context};
use std::path::Path;

/// The templates. Their names' ending makes all text escaped.
const TEMPLATES: [(&str, &str); 5] = [
    ("base.html", include_str!("base.html")),
    ("report.html", include_str!("report.html")),
    ("gains.html", include_str!("gains.html")),
    ("accuracy.html", include_str!("accuracy.html")),
    ("campaign.html", include_str!("campaign.html")),
];

/// What all pages look like, light and dark.
const STYLE: &str = include_str!("style.css");

/// The page of a template of that name.
pub(super) fn render(name: &str, values: &Value) -> Result<String, minijinja::Error> {
    let mut environment = Environment::new();
    for (name, template) in TEMPLATES {
        environment.add_template(name, template)?;
    }
    environment.add_global("style", Value::from_safe_string(STYLE.into()));
    environment.get_template(name)?.render(values)
}

/// Writes the page of a template of that name to `path`.
pub(super) fn write(path: &Path, name: &str, values: &Value) -> Result<(), ReportError> {
    let page = render(name, values).map_err(|error| ReportError::Page {
        path: path.to_path_buf(),
        reason: error.to_string(),
    })?;
    write_file(path, &page)
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
