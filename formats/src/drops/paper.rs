//! The forms that the rain paper prints, where they differ from what the parent module uses. \[weber\]
//!
//! They are the baseline that charts compare with; each says what is wrong with it.

use super::number_density;
use crate::units::{MetresPerSecond, Millimetres, MillimetresPerHour, PerKilometre};

/// Millimetres in an inch: Bentley measured in fractions of one.
const INCH: f64 = 25.4;

/// Names of Bentley's classes, \[weber\] Table A.3.
pub const CLASS_NAMES: [&str; 5] = ["very small", "small", "medium", "large", "very large"];

/// Bentley's class edges, 1/50 … 1/3 inch, with the gaps between them. \[bentley-1904\]
/// The paper prints them rounded; its Table A.3 was computed from these.
pub const CLASSES: [[Millimetres; 2]; 5] = [
    [Millimetres(INCH / 50.0), Millimetres(INCH / 30.0)],
    [Millimetres(INCH / 30.0), Millimetres(INCH / 18.0)],
    [Millimetres(INCH / 16.0), Millimetres(INCH / 8.0)],
    [Millimetres(INCH / 7.0), Millimetres(INCH / 5.0)],
    [Millimetres(INCH / 5.0), Millimetres(INCH / 3.0)],
];

/// The same edges as \[weber\] Table A.5 prints them.
pub const CLASSES_AS_PRINTED: [[Millimetres; 2]; 5] = [
    [Millimetres(0.51), Millimetres(0.85)],
    [Millimetres(0.85), Millimetres(1.41)],
    [Millimetres(1.59), Millimetres(3.18)],
    [Millimetres(3.63), Millimetres(5.08)],
    [Millimetres(5.08), Millimetres(8.47)],
];

/// Drops per m³ of a class by one left rectangle, N(from) (to − from); \[weber\] Table A.3.
/// Over-counts wherever the distribution falls within the class: 46 printed for medium drops in light
/// rain, 8.1 exact.
pub fn drops_per_volume(from: Millimetres, to: Millimetres, rate: MillimetresPerHour) -> f64 {
    number_density(from, rate) * (to.0 - from.0)
}

/// v = 200 √(D/2000), \[weber\] eq. 4. Against measured speeds +53 % at 0.5 mm, +11 % at 1 mm, +17 % at 5.8 mm.
pub fn fall_speed(diameter: Millimetres) -> MetresPerSecond {
    MetresPerSecond(200.0 * (diameter.0.max(0.0) / 2000.0).sqrt())
}

/// β = 0.312 R^0.67, \[weber\] eq. 9; per KILOMETRE, which the paper says only in a table's caption.
/// A fit of its own, not the integral of the paper's drop sizes: 12 % under it at 2 mm/h, 2 % over at 75.
pub fn extinction(rate: MillimetresPerHour) -> PerKilometre {
    PerKilometre(if rate.0 > 0.0 { 0.312 * libm::pow(rate.0, 0.67) } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// \[weber\] Table A.3, drops per m³ for the rates of Table A.2.
    const TABLE_A3: [(f64, [f64; 5]); 4] = [
        (2.0, [448.0, 225.0, 46.0, 0.0, 0.0]),
        (5.0, [613.0, 380.0, 122.0, 0.0, 0.0]),
        (25.0, [939.0, 772.0, 463.0, 6.0, 1.0]),
        (75.0, [1168.0, 1111.0, 917.0, 29.0, 6.0]),
    ];

    #[test]
    fn all_twenty_entries_of_table_a3_are_left_rectangles_over_inch_fractions() {
        for (rate, row) in TABLE_A3 {
            let found = CLASSES.map(|[a, b]| drops_per_volume(a, b, MillimetresPerHour(rate)).round());
            assert_eq!(found, row, "R = {rate}");
        }
    }

    #[test]
    fn the_printed_edges_do_not_give_the_printed_table() {
        let [a, b] = CLASSES_AS_PRINTED[0];
        assert_ne!(drops_per_volume(a, b, MillimetresPerHour(2.0)).round(), TABLE_A3[0].1[0]);
        for (inch, printed) in CLASSES.iter().flatten().zip(CLASSES_AS_PRINTED.iter().flatten()) {
            // Two printed decimals; 3.175 is printed 3.18.
            assert!((inch.0 - printed.0).abs() < 0.0051, "{inch:?} {printed:?}");
        }
    }

    #[test]
    fn the_exact_medium_class_of_light_rain_has_eight_drops_where_46_are_printed() {
        let [a, b] = CLASSES[2];
        let exact = super::super::drops_per_volume(a, b, MillimetresPerHour(2.0));
        assert!((exact - 8.1).abs() < 0.05);
    }

    #[test]
    fn the_printed_fall_speed_errs_as_documented() {
        for (diameter, measured, percent) in [(0.5, 2.06, 53.0), (1.0, 4.03, 11.0), (5.8, 9.17, 17.0)] {
            let error: f64 = 100.0 * (fall_speed(Millimetres(diameter)).0 / measured - 1.0);
            // Rounded to whole percents; 53.5 rounds either way.
            assert!((error - percent).abs() < 0.6, "{diameter} mm: {error} %");
        }
    }

    #[test]
    fn the_printed_extinction_is_table_a4_and_not_the_integral_of_the_sizes() {
        for (rate, printed, integral) in
            [(2.0, 0.496, 0.564), (5.0, 0.917, 1.005), (25.0, 2.70, 2.77), (75.0, 5.63, 5.54)]
        {
            let rate = MillimetresPerHour(rate);
            // Two printed decimals.
            assert!((extinction(rate).0 - printed).abs() < 5e-3);
            assert!((super::super::extinction(rate, 2.0).0 - integral).abs() < 5e-3);
        }
    }
}
