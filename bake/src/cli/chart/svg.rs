//! One chart as an SVG: a panel for every truth and pair of measures, one below the other.
//!
//! Light and dark are left to style sheets: what is drawn in `INK` and its paper follows the reader's scheme.

use plotters::coord::combinators::BindKeyPoints;
use plotters::coord::ranged1d::{AsRangedCoord, Ranged, ValueFormatter};
use plotters::coord::{Shift, cartesian::Cartesian2d};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use squall_bake::chart::{Row, rises};
use std::fmt::Write;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

const WIDTH: u32 = 900;
const PANEL: u32 = 430;
const HEAD: u32 = 46;
const MARGIN: u32 = 14;
/// Above a plot, for what its errors are measured against.
const CAPTION: u32 = 34;
/// Right of the plot, for the names of the series.
const LEGEND: u32 = 250;
/// Longest name in a legend, characters; the pointer and the table have all of it.
const MOST_NAME: usize = 34;
/// A panel with more of the papers' points than this leaves their names to the pointer.
const MOST_LABELS: usize = 4;
const INK: RGBColor = RGBColor(32, 32, 36);
const GRID: RGBColor = RGBColor(205, 205, 210);
/// Okabe and Ito's colours, told apart by those who confuse red and green; then darker ones for long lists.
const COLORS: [RGBColor; 14] = [
    RGBColor(0, 114, 178),
    RGBColor(230, 159, 0),
    RGBColor(0, 158, 115),
    RGBColor(213, 94, 0),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(150, 140, 0),
    RGBColor(120, 94, 240),
    RGBColor(136, 34, 85),
    RGBColor(68, 119, 102),
    RGBColor(170, 68, 0),
    RGBColor(90, 90, 160),
    RGBColor(160, 60, 120),
    RGBColor(120, 120, 120),
];

/// Style that makes a drawing follow the reader's scheme; the page has its own.
const STYLE: &str = "<style>@media (prefers-color-scheme: dark){svg{background:#16181d}\
text{fill:#e6e6ea}[stroke=\"#202024\"]{stroke:#e6e6ea}[fill=\"#202024\"]{fill:#e6e6ea}\
[stroke=\"#CDCDD2\"]{stroke:#3a3d45}}</style>";

/// Rows of one panel.
struct Panel<'a> {
    truth: &'a str,
    error: &'a str,
    cost: &'a str,
    rows: Vec<&'a Row>,
}

/// Draws a chart's rows, in the first `most` of its panels.
pub fn draw(id: &str, question: &str, rows: &[&Row], most: usize) -> anyhow::Result<String> {
    let mut panels = panels(rows);
    panels.truncate(most);
    let height = HEAD + PANEL * panels.len() as u32;
    let (mut text, mut marks) = (String::new(), String::new());
    {
        let root = SVGBackend::with_string(&mut text, (WIDTH, height)).into_drawing_area();
        let failed = |error: DrawingAreaErrorKind<_>| anyhow::anyhow!("{id}: {error:?}");
        let (head, body) = root.split_vertically(HEAD);
        let title = ("sans-serif", 22).into_font().color(&INK);
        head.draw(&Text::new(question.to_owned(), (MARGIN as i32, 14), title)).map_err(failed)?;
        for (panel, area) in panels.iter().zip(body.split_evenly((panels.len().max(1), 1))) {
            draw_panel(panel, &area, &mut marks).map_err(|error| anyhow::anyhow!("{id}: {error}"))?;
        }
        root.present().map_err(failed)?;
    }
    let end = text.rfind("</svg>").unwrap_or(text.len());
    let start = text.find('>').map_or(0, |at| at + 1);
    // A picture that scales: plotters writes its size in pixels and a view box.
    Ok(format!("{}{STYLE}{}{marks}{}", &text[..start], &text[start..end], &text[end..]))
}

fn panels<'a>(rows: &[&'a Row]) -> Vec<Panel<'a>> {
    let mut panels: Vec<Panel<'a>> = Vec::new();
    for &row in rows {
        let known = panels.iter_mut().find(|panel| {
            panel.truth == row.truth && panel.error == row.error_metric && panel.cost == row.cost_metric
        });
        match known {
            Some(panel) => panel.rows.push(row),
            None => panels.push(Panel {
                truth: &row.truth,
                error: &row.error_metric,
                cost: &row.cost_metric,
                rows: vec![row],
            }),
        }
    }
    panels
}

/// Ends of an axis, a little beyond its values.
fn ends(values: impl Iterator<Item = f64>, logarithmic: bool) -> (f64, f64) {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for value in values.filter(|value| value.is_finite() && (!logarithmic || *value > 0.0)) {
        low = low.min(value);
        high = high.max(value);
    }
    if low > high {
        return if logarithmic { (0.1, 10.0) } else { (0.0, 1.0) };
    }
    if logarithmic {
        let room = libm::pow(high / low, 0.06).max(1.15);
        (low / room, high * room)
    } else {
        let room = (0.07 * (high - low)).max(0.02 * high.abs()).max(1e-9);
        (low - room, high + room)
    }
}

fn draw_panel(panel: &Panel<'_>, area: &Area<'_>, marks: &mut String) -> anyhow::Result<()> {
    // Counts that begin at nothing are drawn on an even scale.
    let costs_rise = panel.rows.iter().all(|row| row.cost_p10 > 0.0);
    let errors_rise = !rises(panel.error);
    let (x0, x1) = ends(panel.rows.iter().flat_map(|row| [row.cost_p10, row.cost_p90]), costs_rise);
    let (y0, y1) = ends(panel.rows.iter().map(|row| row.error), errors_rise);
    // What has no error at all stands on a logarithmic panel's floor.
    let floor = if errors_rise { y0 } else { f64::NEG_INFINITY };
    let rising = |low: f64, high: f64| (low..high).log_scale().with_key_points(ticks(low, high));
    match (costs_rise, errors_rise) {
        (true, true) => plot(panel, area, rising(x0, x1), rising(y0, y1), floor, marks),
        (true, false) => plot(panel, area, rising(x0, x1), y0..y1, floor, marks),
        (false, true) => plot(panel, area, x0..x1, rising(y0, y1), floor, marks),
        (false, false) => plot(panel, area, x0..x1, y0..y1, floor, marks),
    }
}

/// Round numbers on a logarithmic axis: powers of ten, and 2 and 5 times those where there are few.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let decades = libm::log10(high / low);
    let steps: &[f64] = match decades {
        d if d > 3.0 => &[1.0],
        d if d > 1.3 => &[1.0, 2.0, 5.0],
        _ => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0],
    };
    let first = libm::floor(libm::log10(low)) as i32;
    let last = libm::ceil(libm::log10(high)) as i32;
    let power = |exponent: i32| libm::pow(10.0, f64::from(exponent));
    let all = (first..=last).flat_map(|exponent| steps.iter().map(move |step| step * power(exponent)));
    all.filter(|tick| (low..=high).contains(tick)).collect()
}

fn plot<X, Y>(
    panel: &Panel<'_>,
    area: &Area<'_>,
    x: X,
    y: Y,
    floor: f64,
    marks: &mut String,
) -> anyhow::Result<()>
where
    X: AsRangedCoord<Value = f64>,
    X::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
    Y: AsRangedCoord<Value = f64>,
    Y::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let failed = |error| anyhow::anyhow!("{error:?}");
    let caption = ("sans-serif", 14).into_font().color(&INK);
    let words = format!("against {}", panel.truth);
    area.draw(&Text::new(words, (MARGIN as i32, 8), caption)).map_err(failed)?;
    let mut chart = ChartBuilder::on(area)
        .margin(MARGIN)
        .margin_top(CAPTION)
        .margin_right(LEGEND)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d(x, y)
        .map_err(failed)?;
    let label = ("sans-serif", 13).into_font().color(&INK);
    chart
        .configure_mesh()
        .x_desc(panel.cost)
        .y_desc(panel.error)
        .axis_style(INK)
        .bold_line_style(GRID)
        .light_line_style(TRANSPARENT)
        .label_style(label.clone())
        .axis_desc_style(label)
        .x_labels(8)
        .y_labels(8)
        .x_label_formatter(&|value| tick(*value))
        .y_label_formatter(&|value| tick(*value))
        .draw()
        .map_err(failed)?;
    let whole = chart.plotting_area();
    draw_front(panel, floor, whole)?;
    let mut names: Vec<&str> = Vec::new();
    for row in &panel.rows {
        if !names.contains(&row.series.as_str()) {
            names.push(&row.series);
        }
    }
    let few = panel.rows.iter().filter(|row| row.baseline && row.error.is_finite()).count() <= MOST_LABELS;
    for (index, name) in names.iter().enumerate() {
        let color = COLORS[index % COLORS.len()];
        let mut mine: Vec<&Row> = panel.rows.iter().filter(|row| row.series == *name).copied().collect();
        mine.sort_by(|a, b| a.cost_median.total_cmp(&b.cost_median));
        let dots: Vec<&Row> = mine.iter().filter(|row| row.error.is_finite()).copied().collect();
        let line = dots.iter().map(|row| (row.cost_median, row.error.max(floor)));
        whole.draw(&PathElement::new(line.collect::<Vec<_>>(), color.stroke_width(2))).map_err(failed)?;
        for row in &mine {
            draw_point(row, color, floor, whole, marks)?;
            if row.baseline && few && row.error.is_finite() {
                name_point(&row.setting, (row.cost_median, row.error.max(floor)), whole)?;
            }
        }
        // The legend stands in the margin, in pixels of the panel.
        let right = whole.get_x_axis_pixel_range().end;
        let (left, top) = (right + 14 - area.get_base_pixel().0, 34 + 19 * index as i32);
        area.draw(&Rectangle::new([(left, top), (left + 12, top + 12)], color.filled())).map_err(failed)?;
        let text = ("sans-serif", 13).into_font().color(&INK);
        let mut shown: String = name.chars().take(MOST_NAME).collect();
        if name.chars().count() > MOST_NAME {
            shown.push('…');
        }
        area.draw(&Text::new(shown, (left + 18, top + 1), text)).map_err(failed)?;
    }
    Ok(())
}

type Plot<'a, X, Y> = DrawingArea<SVGBackend<'a>, Cartesian2d<X, Y>>;

/// The Pareto front, broad and pale behind everything: what is reached at a cost stays reached beyond it.
fn draw_front<X, Y>(panel: &Panel<'_>, floor: f64, area: &Plot<'_, X, Y>) -> anyhow::Result<()>
where
    X: Ranged<ValueType = f64>,
    Y: Ranged<ValueType = f64>,
{
    let mut front: Vec<(f64, f64)> = panel
        .rows
        .iter()
        .filter(|row| row.pareto)
        .map(|row| (row.cost_median, row.error.max(floor)))
        .collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut steps: Vec<(f64, f64)> = Vec::new();
    for point in front {
        if let Some(&(_, before)) = steps.last() {
            steps.push((point.0, before));
        }
        steps.push(point);
    }
    let style = RGBColor(140, 140, 150).mix(0.45).stroke_width(7);
    area.draw(&PathElement::new(steps, style)).map_err(|error| anyhow::anyhow!("{error:?}"))
}

fn draw_point<X, Y>(
    row: &Row,
    color: RGBColor,
    floor: f64,
    area: &Plot<'_, X, Y>,
    marks: &mut String,
) -> anyhow::Result<()>
where
    X: Ranged<ValueType = f64>,
    Y: Ranged<ValueType = f64>,
{
    let failed = |error| anyhow::anyhow!("{error:?}");
    let (range_x, range_y) = (area.get_x_axis_pixel_range(), area.get_y_axis_pixel_range());
    if !row.error.is_finite() {
        // A cost without an error: a line across the panel.
        let low = area.map_coordinate(&(row.cost_median, f64::MIN_POSITIVE)).0;
        let x = low.clamp(range_x.start, range_x.end);
        let _ = write!(
            marks,
            "<line x1=\"{x}\" y1=\"{}\" x2=\"{x}\" y2=\"{}\" stroke=\"{}\" stroke-dasharray=\"6 5\" stroke-width=\"2\"/>",
            range_y.start,
            range_y.end,
            hex(color)
        );
        mark(marks, row, (x, (range_y.start + range_y.end) / 2));
        return Ok(());
    }
    let at = (row.cost_median, row.error.max(floor));
    let spread = vec![(row.cost_p10, at.1), (row.cost_p90, at.1)];
    area.draw(&PathElement::new(spread, color.mix(0.6).stroke_width(1))).map_err(failed)?;
    let style = if row.baseline { color.stroke_width(2) } else { color.filled() };
    area.draw(&Circle::new(at, 4, style)).map_err(failed)?;
    if row.chosen {
        area.draw(&Circle::new(at, 9, INK.stroke_width(2))).map_err(failed)?;
        name_point("chosen", at, area)?;
    }
    mark(marks, row, area.map_coordinate(&at));
    Ok(())
}

/// Width of a letter of a point's name, px, about.
const NAME_PX: f64 = 6.2;

fn name_point<X, Y>(text: &str, at: (f64, f64), area: &Plot<'_, X, Y>) -> anyhow::Result<()>
where
    X: Ranged<ValueType = f64>,
    Y: Ranged<ValueType = f64>,
{
    let style = ("sans-serif", 12).into_font().color(&INK);
    let width = (NAME_PX * text.chars().count() as f64) as i32;
    // Where it would run out of the panel to the right it stands to the left.
    let right = area.map_coordinate(&at).0 + 10 + width > area.get_x_axis_pixel_range().end;
    let (offset, side) = if right { (-10, HPos::Right) } else { (10, HPos::Left) };
    let style = style.pos(Pos::new(side, VPos::Top));
    let element = EmptyElement::at(at) + Text::new(text.to_owned(), (offset, -14), style);
    area.draw(&element).map_err(|error| anyhow::anyhow!("{error:?}"))
}

/// What a pointer finds at a point.
fn mark(marks: &mut String, row: &Row, (x, y): (i32, i32)) {
    let mut words = format!("{}\n{}\n{}: {}", row.series, row.setting, row.error_metric, figure(row.error));
    let _ = write!(words, "\n{}: {}", row.cost_metric, figure(row.cost_median));
    if row.cost_p10 != row.cost_p90 {
        let _ = write!(words, " ({} to {})", figure(row.cost_p10), figure(row.cost_p90));
    }
    if let Some(bytes) = row.bytes {
        let _ = write!(words, "\n{bytes} bytes");
    }
    for (is, word) in [
        (row.pareto, "on the Pareto front"),
        (row.chosen, "the recipe's own setting"),
        (row.baseline, "a paper's"),
    ] {
        if is {
            let _ = write!(words, "\n{word}");
        }
    }
    let _ = write!(
        marks,
        "<circle class=\"point\" cx=\"{x}\" cy=\"{y}\" r=\"8\" fill=\"#000\" fill-opacity=\"0\" tabindex=\"0\"><title>{}</title></circle>",
        super::page::escaped(&words)
    );
}

fn hex(color: RGBColor) -> String {
    format!("#{:02X}{:02X}{:02X}", color.0, color.1, color.2)
}

/// A figure in few digits.
pub fn figure(value: f64) -> String {
    let size = value.abs();
    match size {
        _ if !value.is_finite() => "none".into(),
        0.0 => "0".into(),
        _ if size >= 1e6 => format!("{:.3} M", value / 1e6),
        _ if size >= 1e3 => format!("{value:.0}"),
        _ if size >= 1.0 => trimmed(format!("{value:.3}")),
        _ if size >= 1e-4 => trimmed(format!("{value:.5}")),
        _ => format!("{value:.2e}"),
    }
}

fn trimmed(text: String) -> String {
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn tick(value: f64) -> String {
    figure(value)
}
