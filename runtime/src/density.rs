//! How many streaks a camera sees: the density table, read. \[weber\] §3.1, corrected.

use crate::error::RuntimeError;
use crate::load::Asset;
use squall_formats::drops::View;
use squall_formats::section::density::{DensitySection, Mode, Ranges};
use squall_formats::units::{MillimetresPerHour, Radians};

/// Reads an asset's density tables. No other section is looked at.
pub fn read_density(asset: &Asset) -> Result<DensitySection, RuntimeError> {
    asset.section(DensitySection::TAG, "rain density tables", DensitySection::read)
}

/// Expected number of streaks per class of `mode` in the whole picture of `view`, into `counts`, and their
/// sum. `counts` needs the length of the mode's class list.
///
/// Counts are means of Poisson numbers and so fractions. Error: within the section's `measured_error`, for
/// each class. Errors: an impossible view, or a rate, fov, exposure or length outside the ranges that the
/// asset vouches for; the message names the range.
pub fn lookup_counts_into(
    section: &DensitySection,
    mode: Mode,
    view: &View,
    rate: MillimetresPerHour,
    counts: &mut [f64],
) -> Result<f64, RuntimeError> {
    check_ranges(&section.ranges, view, rate)?;
    let table = section.table(mode);
    if counts.len() != table.classes.len() {
        return Err(RuntimeError::argument(
            "counts",
            format!("{} places", table.classes.len()),
            counts.len(),
        ));
    }
    let place = section.place(rate).ok_or_else(|| {
        RuntimeError::argument("rate", "a rate on the table's axis", format!("{} mm/h", rate.0))
    })?;
    let factor = view.shell_factor();
    let mut total = 0.0;
    for (class, count) in counts.iter_mut().enumerate() {
        *count = factor * table.cubed_length(&place, class, view.exposure);
        total += *count;
    }
    Ok(total)
}

/// [`lookup_counts_into`] into a fresh list.
pub fn lookup_counts(
    section: &DensitySection,
    mode: Mode,
    view: &View,
    rate: MillimetresPerHour,
) -> Result<Vec<f64>, RuntimeError> {
    let mut counts = vec![0.0; section.table(mode).classes.len()];
    lookup_counts_into(section, mode, view, rate, &mut counts)?;
    Ok(counts)
}

/// A view's own errors in the runtime's words.
pub fn check_view(view: &View) -> Result<(), RuntimeError> {
    view.check().map_err(|error| RuntimeError::argument(error.field, error.wanted, error.found))
}

fn check_ranges(ranges: &Ranges, view: &View, rate: MillimetresPerHour) -> Result<(), RuntimeError> {
    check_view(view)?;
    if !(rate.0 > 0.0 && rate.0.is_finite()) {
        return Err(RuntimeError::argument("rate", "a positive rainfall in mm/h", rate.0));
    }
    let outside = |value: f64, [low, high]: [f64; 2]| !(low..=high).contains(&value);
    let refuse = |field, [low, high]: [f64; 2], unit, found: f64| {
        let wanted = format!("{low} to {high} {unit}, the range of this asset's density table");
        Err(RuntimeError::argument(field, wanted, format!("{} {unit}", tidy(found))))
    };
    let rates = ranges.rate.map(|rate| rate.0);
    if outside(rate.0, rates) {
        return refuse("rate", rates, "mm/h", rate.0);
    }
    let fov = ranges.vertical_fov;
    if outside(view.vertical_fov.0, fov.map(|degrees| Radians::from(degrees).0)) {
        return refuse("fov", fov.map(|degrees| degrees.0), "degrees", view.vertical_fov.0.to_degrees());
    }
    let exposure = ranges.exposure.map(|time| time.0);
    if outside(view.exposure.0, exposure) {
        return refuse("exposure-ms", exposure.map(|time| tidy(time * 1e3)), "ms", view.exposure.0 * 1e3);
    }
    for (field, length) in [("min-px", view.min_px), ("max-px", view.max_px)] {
        if outside(length, ranges.length_px) {
            return refuse(field, ranges.length_px, "px", length);
        }
    }
    Ok(())
}

/// Twelve digits: hides what a conversion to degrees or milliseconds did to the last bits.
fn tidy(value: f64) -> f64 {
    format!("{value:.11e}").parse().unwrap_or(value)
}
