//! A page as one HTML file: text and tables here, figures as empty frames that `assets/page.js` fills from
//! the data at the end of the file.
//!
//! Text is escaped wherever it enters, the data cannot close its own script element, and a content policy
//! forbids the page to load anything.

use super::decimate::extreme_indices;
use super::encode::Columns;
use super::page::{HeatMap, Notes, Page, PageBlock, Plot, Section, Table, Tone, Waterfall, Width};
use serde_json::{Value, json};
use std::fmt::Write as _;

const TEMPLATE: &str = include_str!("assets/page.html");
const STYLE: &str = include_str!("assets/page.css");
const SCRIPT: &str = include_str!("assets/page.js");

/// Longer series are thinned to about this many points.
const LONGEST_SERIES: usize = 12_000;

impl Page {
    /// The page as one file that opens offline.
    pub fn to_html(&self) -> String {
        self.to_html_in(&str::to_owned)
    }

    /// The same with every text that a person reads as `say` gives it: in other units than V and um.
    pub fn to_html_in(&self, say: &dyn Fn(&str) -> String) -> String {
        let mut body = String::new();
        let mut contents = String::new();
        let mut figures = Vec::new();
        let mut columns = Columns::default();
        for (number, section) in self.sections.iter().enumerate() {
            let heading = escape(&section.heading);
            let _ = write!(contents, "<a href=\"#section-{number}\">{heading}</a>");
            write_section(&mut body, number, section, &mut figures, &mut columns);
        }
        let data = json!({
            "selectors": self.selectors,
            "figures": figures.into_iter().map(|figure| texts_in(figure, say)).collect::<Vec<_>>(),
            "columns": columns.into_json(),
        });
        // Inside a script element only "</" and "<!--" could end or change it; as JSON escapes they cannot.
        let data = data.to_string().replace('<', "\\u003c");
        let mut facts = String::new();
        for (name, value) in &self.facts {
            let _ = write!(
                facts,
                "<div><dt>{}</dt><dd>{}</dd></div>",
                escape(name),
                escape(value)
            );
        }
        let mut footer = String::new();
        for line in &self.footer {
            let _ = write!(footer, "<p>{}</p>", escape(line));
        }
        fill(
            TEMPLATE,
            &[
                ("title", &escape(&self.title)),
                ("style", STYLE),
                ("tone", tone_class(self.tone)),
                ("lead", &say(&escape(&self.lead_sentence))),
                ("facts", &say(&facts)),
                ("contents", &contents),
                ("body", &say(&body)),
                ("footer", &say(&footer)),
                ("data", &data),
                ("script", SCRIPT),
            ],
        )
    }
}

/// A figure with its texts as `say` gives them.
fn texts_in(figure: Value, say: &dyn Fn(&str) -> String) -> Value {
    match figure {
        Value::String(text) => Value::String(say(&text)),
        Value::Array(values) => Value::Array(
            values
                .into_iter()
                .map(|value| texts_in(value, say))
                .collect(),
        ),
        Value::Object(fields) => Value::Object(
            fields
                .into_iter()
                .map(|(key, value)| (key, texts_in(value, say)))
                .collect(),
        ),
        other => other,
    }
}

/// Replaces `{{name}}` in one pass, so that what is filled in is never searched again.
fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut out =
        String::with_capacity(template.len() + values.iter().map(|v| v.1.len()).sum::<usize>());
    let mut rest = template;
    while let Some((before, after)) = rest.split_once("{{") {
        out.push_str(before);
        let Some((name, after)) = after.split_once("}}") else {
            rest = after;
            break;
        };
        if let Some((_, value)) = values.iter().find(|(known, _)| *known == name) {
            out.push_str(value);
        }
        rest = after;
    }
    out.push_str(rest);
    out
}

pub(crate) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            _ => out.push(c),
        }
    }
    out
}

fn tone_class(tone: Tone) -> &'static str {
    match tone {
        Tone::Neutral => "neutral",
        Tone::Good => "good",
        Tone::Attention => "attention",
    }
}

/// Units as they are read: the micro sign and superscripts do not stand in program text.
fn unit_text(unit: &str) -> String {
    match unit.strip_prefix("um") {
        Some(rest) => format!("\u{b5}m{rest}"),
        None => unit.to_owned(),
    }
}

fn write_section(
    body: &mut String,
    number: usize,
    section: &Section,
    figures: &mut Vec<Value>,
    columns: &mut Columns,
) {
    let _ = write!(
        body,
        "<section id=\"section-{number}\"><h2>{}</h2>",
        escape(&section.heading)
    );
    for paragraph in section.text.split("\n\n").filter(|p| !p.trim().is_empty()) {
        let _ = write!(body, "<p class=\"text\">{}</p>", escape(paragraph));
    }
    body.push_str("<div class=\"blocks\">");
    for block in &section.blocks {
        match block {
            PageBlock::Table(table) => write_table(body, table),
            PageBlock::Notes(notes) => write_notes(body, notes),
            PageBlock::Plot(plot) => {
                let width = match plot.width {
                    Width::Full => "full",
                    Width::Half => "half",
                    Width::Third => "third",
                };
                write_frame(
                    body,
                    figures.len(),
                    "plot",
                    width,
                    &plot.title,
                    &plot.caption,
                );
                figures.push(plot_json(plot, columns));
            }
            PageBlock::Waterfall(waterfall) => {
                write_frame(
                    body,
                    figures.len(),
                    "waterfall",
                    "full",
                    &waterfall.title,
                    &waterfall.caption,
                );
                figures.push(waterfall_json(waterfall));
            }
            PageBlock::HeatMap(map) => {
                write_frame(
                    body,
                    figures.len(),
                    "heatmap",
                    "full",
                    &map.title,
                    &map.caption,
                );
                figures.push(heat_map_json(map));
            }
        }
    }
    body.push_str("</div></section>\n");
}

fn write_frame(
    body: &mut String,
    number: usize,
    kind: &str,
    width: &str,
    title: &str,
    caption: &str,
) {
    let _ = write!(
        body,
        "<figure class=\"{kind} {width}\" data-figure=\"{number}\"><h3>{}</h3><div class=\"drawing\"></div>",
        escape(title)
    );
    if !caption.is_empty() {
        let _ = write!(body, "<figcaption>{}</figcaption>", escape(caption));
    }
    body.push_str("</figure>");
}

fn looks_like_a_number(cell: &str) -> bool {
    cell.chars()
        .next()
        .is_some_and(|c| c.is_ascii_digit() || matches!(c, '-' | '+' | '.' | '<' | '\u{2212}'))
        && cell.chars().any(|c| c.is_ascii_digit())
}

fn write_table(body: &mut String, table: &Table) {
    body.push_str("<div class=\"table full\">");
    if !table.title.is_empty() {
        let _ = write!(body, "<h3>{}</h3>", escape(&table.title));
    }
    body.push_str("<div class=\"scroll\"><table><thead><tr>");
    for column in &table.columns {
        let _ = write!(body, "<th scope=\"col\">{}</th>", escape(column));
    }
    body.push_str("</tr></thead><tbody>");
    for (number, row) in table.rows.iter().enumerate() {
        let highlighted = table.highlighted_rows.contains(&number);
        body.push_str(if highlighted {
            "<tr class=\"highlighted\">"
        } else {
            "<tr>"
        });
        for index in 0..table.columns.len().max(row.len()) {
            let cell = row.get(index).map_or("", String::as_str);
            let class = if looks_like_a_number(cell) {
                " class=\"number\""
            } else {
                ""
            };
            let _ = write!(body, "<td{class}>{}</td>", escape(cell));
        }
        body.push_str("</tr>");
    }
    body.push_str("</tbody></table></div>");
    if !table.caption.is_empty() {
        let _ = write!(body, "<p class=\"caption\">{}</p>", escape(&table.caption));
    }
    body.push_str("</div>");
}

fn write_notes(body: &mut String, notes: &Notes) {
    let _ = write!(
        body,
        "<div class=\"notes full {}\">",
        tone_class(notes.tone)
    );
    if !notes.title.is_empty() {
        let _ = write!(body, "<h3>{}</h3>", escape(&notes.title));
    }
    body.push_str("<ul>");
    for item in &notes.items {
        let _ = write!(body, "<li>{}</li>", escape(item));
    }
    body.push_str("</ul></div>");
}

fn plot_json(plot: &Plot, columns: &mut Columns) -> Value {
    let axis = |axis: &super::page::Axis| json!({ "label": axis.label, "unit": unit_text(&axis.unit), "log": axis.log });
    let series: Vec<Value> = plot
        .series
        .iter()
        .map(|series| {
            let length = series.x.len().min(series.y.len());
            let (x, y) = (&series.x[..length], &series.y[..length]);
            let (x, y) = if length > LONGEST_SERIES {
                let kept = extreme_indices(&[x, y], LONGEST_SERIES);
                let pick = |values: &[f64]| kept.iter().map(|&i| values[i]).collect::<Vec<f64>>();
                (columns.intern(&pick(x)), columns.intern(&pick(y)))
            } else {
                (columns.intern(x), columns.intern(y))
            };
            json!({
                "label": series.label, "x": x, "y": y,
                "style": series.style, "role": series.role, "when": series.when,
            })
        })
        .collect();
    json!({
        "kind": "plot", "title": plot.title, "x": axis(&plot.x), "y": axis(&plot.y), "series": series,
        "levels": plot.levels, "bands": plot.bands, "link": plot.link, "height": plot.height_px, "equal": plot.equal, "percentiles": plot.percentiles,
    })
}

fn waterfall_json(waterfall: &Waterfall) -> Value {
    json!({
        "kind": "waterfall", "title": waterfall.title, "steps": waterfall.steps,
        "labels": waterfall.value_labels, "floor": waterfall.floor,
        "unit": unit_text(&waterfall.unit), "selector": waterfall.selector,
    })
}

fn heat_map_json(map: &HeatMap) -> Value {
    json!({
        "kind": "heatmap", "title": map.title, "rows": map.rows, "groups": map.column_groups,
        "layers": map.layers, "neutral": map.neutral, "unit": unit_text(&map.unit),
        "selector": map.selector,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::page::{CurveRole, Series};

    #[test]
    fn hostile_names_stay_text() {
        let name = "</script><script>alert(1)</script>{{data}}";
        let page = Page {
            title: name.into(),
            lead_sentence: name.into(),
            sections: vec![Section {
                heading: name.into(),
                text: name.into(),
                blocks: vec![
                    PageBlock::Plot(Plot::new(name).with(Series::line(
                        name,
                        CurveRole::Model,
                        vec![0.0, 1.0],
                        vec![f64::NAN, 2.0],
                    ))),
                    PageBlock::Table(Table {
                        columns: vec![name.into()],
                        rows: vec![vec![name.into(), "1.5".into()]],
                        ..Table::default()
                    }),
                ],
            }],
            ..Page::default()
        };
        let html = page.to_html();
        assert!(!html.contains("<script>alert"));
        assert_eq!(
            html.matches("</script>").count(),
            TEMPLATE.matches("</script>").count()
        );
        assert!(html.contains("<td class=\"number\">1.5</td>"));
    }

    #[test]
    fn the_page_refers_to_nothing_outside_itself() {
        let html = Page::default().to_html();
        assert!(html.contains("default-src 'none'"));
        for outside in ["src=\"", "@import", "fetch(", "XMLHttpRequest", "import("] {
            assert!(!html.contains(outside), "{outside}");
        }
        // Inside the page a clip path is named by its fragment.
        assert_eq!(html.matches("url(").count(), html.matches("url(#").count());
        let addresses: Vec<_> = html
            .match_indices("http")
            .map(|(i, _)| &html[i..i + 26])
            .collect();
        assert!(addresses.iter().all(|a| a.starts_with("http-equiv") || a.starts_with("http://www.w3.org/2000/svg")), "{addresses:?}");
    }
}
