//! The page that shows all charts: one file, no network, light and dark, a table for those who do not see charts.

use super::svg::figure;
use squall_bake::chart::Row;
use std::fmt::Write;

/// A chart on the page.
pub struct Figure<'a> {
    /// Chart id.
    pub id: &'static str,
    /// The question that it answers.
    pub question: &'static str,
    /// Its SVG.
    pub picture: String,
    /// Its rows.
    pub rows: Vec<&'a Row>,
}

const HEAD: &str = include_str!("page.html");

/// The whole page. `how` says what was swept.
pub fn page(how: &str, figures: &[Figure<'_>]) -> String {
    let mut links = String::new();
    let mut body = String::new();
    for chart in figures {
        let _ = write!(links, "<a href=\"#{0}\">{0}</a> ", chart.id);
        let _ = writeln!(
            body,
            "<section id=\"{}\"><h2 class=\"unseen\">{}</h2><figure>{}</figure>{}</section>",
            chart.id,
            escaped(chart.question),
            chart.picture,
            table(&chart.rows)
        );
    }
    HEAD.replace("{{how}}", &escaped(how)).replace("{{links}}", &links).replace("{{body}}", &body)
}

fn table(rows: &[&Row]) -> String {
    let mut text =
        format!("<details><summary>The same as a table: {} rows</summary><div><table>", rows.len());
    text.push_str("<thead><tr><th>series</th><th>setting</th><th>against</th><th>error</th><th></th><th>cost</th><th></th>");
    text.push_str("<th>10th to 90th percentile</th><th>marks</th></tr></thead><tbody>");
    for row in rows {
        let marks: Vec<&str> = [(row.pareto, "front"), (row.chosen, "chosen"), (row.baseline, "paper")]
            .into_iter()
            .filter_map(|(is, word)| is.then_some(word))
            .collect();
        let _ = write!(
            text,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td class=\"n\">{}</td><td>{}</td><td class=\"n\">{}</td><td>{} to {}</td><td>{}</td></tr>",
            escaped(&row.series),
            escaped(&row.setting),
            escaped(&row.truth),
            escaped(&row.error_metric),
            figure(row.error),
            escaped(&row.cost_metric),
            figure(row.cost_median),
            figure(row.cost_p10),
            figure(row.cost_p90),
            marks.join(", ")
        );
    }
    text.push_str("</tbody></table></div></details>");
    text
}

/// Text that means itself in HTML.
pub fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
    }
    out
}
