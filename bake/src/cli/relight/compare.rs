//! `squall relight … --compare DIR`: pictures beside the truth's, and figures.

use crate::cli::folder::OutputFolder;
use plotters::style::colors::colormaps::ViridisRGB;
use serde_json::{Value, json};
use squall_bake::fields::grey_picture;
use squall_bake::output::write_atomically;
use squall_bake::picture::{encode_exr, encode_png8, encode_rgb8};
use squall_bake::relit::compare::{Comparison, Distance, Section};
use squall_runtime::tone::Tone;
use std::io::Write;

/// A difference is shown so many times as bright.
const DIFFERENCE_SHOWN: f32 = 10.0;
/// A section's colours reach down to this share of its brightest cell, by the logarithm.
const DARKEST: f64 = 1e-4;
/// A section's cells are drawn as large as makes each half about so many pixels wide.
const SECTION_PX: f64 = 480.0;
/// Most pixels of a cell's edge.
const CELL_PX: f64 = 64.0;
/// Black pixels between a section's halves.
const GAP_PX: usize = 8;

/// Names of the files; a section only where the asset knows fluence.
pub fn names(section: bool) -> Vec<&'static str> {
    let mut names = vec!["relit.exr", "relit.png", "truth.exr", "truth.png", "single.exr", "single.png"];
    names.extend(["difference.exr", "difference.png", "compare.json"]);
    names.extend(section.then_some("section.png"));
    names
}

/// Writes the comparison, PNGs developed by `tone`, and says what `compare.json` says.
pub fn write(folder: OutputFolder, comparison: &Comparison, tone: &Tone) -> anyhow::Result<Value> {
    let Comparison { width, relit, truth, single, section, report } = comparison;
    let difference: Vec<f32> = relit.iter().zip(truth).map(|(a, b)| (a - b).abs()).collect();
    let shown: Vec<f32> = difference.iter().map(|value| DIFFERENCE_SHOWN * value).collect();
    let grey = |values: &[f32]| grey_picture(*width, values);
    let pictures = [
        ("relit", grey(relit), grey(relit)),
        ("truth", grey(truth), grey(truth)),
        ("single", grey(single), grey(single)),
        ("difference", grey(&difference), grey(&shown)),
    ];
    let mut summary = serde_json::to_value(report)?;
    summary["exposure"] = json!(tone.exposure);
    summary["difference_shown"] = json!(DIFFERENCE_SHOWN);
    summary["section"] = section.as_ref().map_or(Value::Null, |section| {
        let [low, high] = range(section);
        json!({
            "across": (if section.across == 0 { "x" } else { "y" }), "at_m": section.at_m,
            "low_W_per_m2": low, "high_W_per_m2": high,
        })
    });
    let names = names(section.is_some());
    summary["files"] = json!(names);
    folder.write(|folder| {
        let put = |name: &str, bytes: &[u8]| write_atomically(&folder.join(name), |out| out.write_all(bytes));
        for (name, linear, shown) in &pictures {
            put(&format!("{name}.exr"), &encode_exr(linear)?)?;
            put(&format!("{name}.png"), &encode_png8(shown, tone)?)?;
        }
        if let Some(section) = section {
            let (size, bytes) = drawn(section);
            put("section.png", &encode_rgb8(size, &bytes)?)?;
        }
        put("compare.json", (serde_json::to_string_pretty(&summary)? + "\n").as_bytes())?;
        Ok(())
    })?;
    Ok(summary)
}

/// What a comparison says, in words.
pub fn words(comparison: &Comparison) -> String {
    let of = |what: &str, distance: &Distance| {
        format!(
            "{what} {:.2} % (without the brightest 1 %: {:.2} %), median {:.2} %, mean {:+.2} %",
            100.0 * distance.l2,
            100.0 * distance.l2_without_brightest,
            100.0 * distance.median,
            100.0 * distance.mean
        )
    };
    let report = &comparison.report;
    let mut lines = vec![
        of("whole picture: relative L2", &report.whole),
        of("light scattered more than once:", &report.scattered_again),
        of("single scattering alone:", &report.single),
    ];
    lines.extend(report.fluence.as_ref().map(|fluence| of("fluence per cell:", fluence)));
    lines.join("\n")
}

/// Fluence that the darkest and the brightest colour stand for, W/m²: one scale for both halves.
fn range(section: &Section) -> [f64; 2] {
    let all = section.relit.iter().chain(&section.truth);
    let high = f64::from(all.fold(0.0f32, |most, &value| most.max(value)));
    [high * DARKEST, high]
}

/// The asset's section on the left, the truth's on the right, in false colours by the logarithm: size and RGB bytes.
fn drawn(section: &Section) -> ([usize; 2], Vec<u8>) {
    let (columns, rows) = (section.width, section.relit.len() / section.width);
    let [along, up] = section.cell_m;
    let across_px = (SECTION_PX / columns as f64).round().clamp(1.0, CELL_PX);
    // A tower of cells is drawn lower than it is.
    let highest = (SECTION_PX / rows as f64).round().clamp(1.0, CELL_PX);
    let up_px = (across_px * up / along).round().clamp(1.0, highest);
    let [across_px, up_px] = [across_px, up_px].map(|px| px as usize);
    let half = columns * across_px;
    let size = [2 * half + GAP_PX, rows * up_px];
    let [_, high] = range(section);
    let mut bytes = vec![0u8; 3 * size[0] * size[1]];
    for (at, pixel) in bytes.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let [x, y] = [at % size[0], at / size[0]];
        let (values, x) = match x {
            _ if x < half => (&section.relit, x),
            _ if x >= half + GAP_PX => (&section.truth, x - half - GAP_PX),
            _ => continue,
        };
        let value = f64::from(values[y / up_px * columns + x / across_px]);
        let share = if value > high * DARKEST {
            libm::log10(value / high) / -libm::log10(DARKEST) + 1.0
        } else {
            0.0
        };
        let color = ViridisRGB::get_color_normalized(share, 0.0, 1.0);
        *pixel = [color.0, color.1, color.2];
    }
    (size, bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sections_brightest_cell_has_the_last_colour_and_a_dark_one_the_first() {
        let section = Section {
            across: 1,
            at_m: 0.0,
            width: 2,
            cell_m: [100.0, 50.0],
            relit: vec![1.0, 0.0],
            truth: vec![1e-2, 1e-9],
        };
        let ([width, height], bytes) = drawn(&section);
        assert_eq!([width, height], [4 * 64 + GAP_PX, 32]);
        let at = |x: usize| [bytes[3 * x], bytes[3 * x + 1], bytes[3 * x + 2]];
        let color = |share: f64| {
            let color = ViridisRGB::get_color_normalized(share, 0.0, 1.0);
            [color.0, color.1, color.2]
        };
        assert_eq!([at(0), at(64), at(128)], [color(1.0), color(0.0), [0; 3]]);
        let hundredth = libm::log10(f64::from(1e-2f32)) / 4.0 + 1.0;
        assert_eq!([at(136), at(200)], [color(hundredth), color(0.0)]);
    }
}
