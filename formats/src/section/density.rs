//! `DENS`: how many streaks a camera sees, for any rainfall and any camera. Bytes: SPEC.md, "DENS".
//!
//! The count of one class of drops is a camera's shell factor times ∫ N(D,R) L(D,T)³ dD, and L³ is a cubic
//! in the exposure T. So four moments of the class answer for every field of view, resolution, aspect,
//! range of lengths and exposure EXACTLY; only the rate R needs an axis. A moment falls like e^{−Λa}, a the
//! class's smallest diameter; with that factor divided out, what is left is nearly a power of R, so its
//! logarithm against ln R is nearly straight and four neighbouring nodes interpolate it.
//!
//! | symbol | meaning                                                            | unit     |
//! | n      | ∫ N dD over the class                                              | 1/m³     |
//! | A      | ∫ N D² dD                                                          | mm²/m³   |
//! | M_j    | ∫ N d^{3−j} v^j dD, d the diameter in metres, j = 0…3              | m³⁻ʲ (m/s)ʲ/m³ |

use crate::drops::{self, View};
use crate::error::{Limits, ReadError};
use crate::tag::Tag;
use crate::units::{Degrees, Metres, MetresPerSecond, Millimetres, MillimetresPerHour, Seconds};
use crate::{container::OutSection, meta};
use serde::{Deserialize, Serialize};

/// Moments stored per node and class: n, A, M_0 … M_3.
pub const MOMENTS: usize = 6;
/// Nodes that one interpolation reads, and so the fewest that a table may have.
pub const STENCIL: usize = 4;

const MAX_NODES: usize = 4096;
const MAX_CLASSES: usize = 256;
/// e^±690 is still a normal double.
const MAX_LOG: f64 = 690.0;
/// Cell edges from 6 cm to 16 m: below, enumeration crawls; above, a frustum holds a fraction of a cell.
const EDGE_LOG2: std::ops::RangeInclusive<i32> = -4..=4;
/// Expected drops in a lattice cell at the largest rate; bounds the work that one cell can ask for.
pub const MAX_DROPS_PER_CELL: f64 = 512.0;

/// How drops are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Mode {
    /// Contiguous classes, exact integrals over each, measured fall speeds.
    Default,
    /// Bentley's classes with their gaps, exact drop numbers, each class at its left edge, the paper's speed.
    PaperExact,
    /// As printed: Bentley's classes, a left rectangle for the drop number, left edge, the paper's speed.
    Paper,
}

impl Mode {
    /// All modes, in the order of the section's tables.
    pub const ALL: [Self; 3] = [Self::Default, Self::PaperExact, Self::Paper];

    /// The mode's name on the command line and in recipes.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Default => "default",
            Self::PaperExact => "paper-exact",
            Self::Paper => "paper",
        }
    }

    /// The mode called `name`.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.name() == name)
    }
}

/// The ranges, ends included, in which the bake vouches for [`DensitySection::measured_error`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ranges {
    /// Rainfall intensity.
    pub rate: [MillimetresPerHour; 2],
    /// Vertical field of view.
    pub vertical_fov: [Degrees; 2],
    /// Exposure.
    pub exposure: [Seconds; 2],
    /// Projected streak length, px.
    pub length_px: [f64; 2],
}

/// One class of drops. Everything here is fixed when the asset is baked, so that no change of rate, exposure
/// or field of view moves a drop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Class {
    /// Smallest and largest diameter.
    pub diameter: [Millimetres; 2],
    /// The diameter that stands for the class.
    pub representative: Millimetres,
    /// Speed of the class's co-moving frame: that of its representative drop.
    pub fall_speed: MetresPerSecond,
    /// Binary logarithm of the edge of the class's lattice cells in metres.
    pub edge_log2: i32,
}

impl Class {
    /// Edge of the class's lattice cells; a power of two, so that dividing by it is exact.
    pub fn edge(&self) -> Metres {
        Metres(libm::scalbn(1.0, self.edge_log2))
    }

    /// Expected drops in one cell, were all of the class as frequent as its smallest: what a cell is
    /// searched for before each drop is judged by its own diameter.
    pub fn candidates_per_cell(&self, rate: MillimetresPerHour) -> f64 {
        let edge = self.edge().0;
        let width = self.diameter[1].0 - self.diameter[0].0;
        drops::number_density(self.diameter[0], rate) * width * edge * edge * edge
    }
}

/// The table of one mode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// How this table counts.
    pub mode: Mode,
    /// Its classes, by ascending diameter.
    pub classes: Vec<Class>,
    /// ln M + Λa of every moment M: node by node, within it class by class, within it n, A, M_0 … M_3.
    pub log_moments: Vec<f64>,
}

/// `DENS` v1: density tables. Bytes: SPEC.md, "DENS".
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DensitySection {
    /// Where the bake vouches for the error below.
    pub ranges: Ranges,
    /// Largest relative error of a class's count that was asked for.
    pub asked_error: f64,
    /// Largest relative error of a class's count that was measured between the nodes, against quadrature.
    pub measured_error: f64,
    /// Nodes of the rate axis, ascending; the first and last are the range's ends.
    pub rates: Vec<MillimetresPerHour>,
    /// One table per mode, in the order of [`Mode::ALL`].
    pub tables: Vec<Table>,
}

/// Where a rate falls on the axis: the first of [`STENCIL`] nodes and their weights, and Λ of the rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisPlace {
    first: usize,
    weights: [f64; STENCIL],
    slope: f64,
}

/// Moments of one class at one rate; see the module's table for the units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// n: drops per m³.
    pub number: f64,
    /// A: ∫ N D² dD, mm²/m³.
    pub area: f64,
    /// M_0 … M_3.
    pub length: [f64; 4],
}

impl Moments {
    /// ∫ N L³ dD for exposure T: M_0 + 3 M_1 T + 3 M_2 T² + M_3 T³, dimensionless (m³ per m³).
    pub fn cubed_length(&self, exposure: Seconds) -> f64 {
        let [m0, m1, m2, m3] = self.length;
        let t = exposure.0;
        m0 + t * (3.0 * m1 + t * (3.0 * m2 + t * m3))
    }

    /// ∫ N D² L dD for exposure T, mm² m per m³: what a shell as deep as the streak is long holds of area.
    pub fn area_times_length(&self, exposure: Seconds) -> f64 {
        // D² d = 1e6 d³, and D² v = 1e6 d² v.
        1e6 * (self.length[0] + self.length[1] * exposure.0)
    }

    /// The one length whose cube is the class's mean: (∫ N L³ / n)^⅓; 0 where rain is so thin that n is.
    pub fn representative_length(&self, exposure: Seconds) -> Metres {
        let mean = if self.number > 0.0 { self.cubed_length(exposure) / self.number } else { 0.0 };
        Metres(libm::cbrt(mean))
    }

    /// Streaks of this class in a camera's picture.
    pub fn count(&self, view: &View) -> f64 {
        view.shell_factor() * self.cubed_length(view.exposure)
    }
}

impl DensitySection {
    /// The section's tag.
    pub const TAG: Tag = Tag(*b"DENS");
    /// Newest version that this build reads and writes.
    pub const VERSION: u16 = 1;

    /// The table of `mode`.
    pub fn table(&self, mode: Mode) -> &Table {
        // `read` and the bake keep one table per mode, in this order.
        &self.tables[mode as usize]
    }

    /// Where `rate` falls on the axis. Between nodes ln M + Λa is the cubic in ln R through the four nearest;
    /// below the first node the straight line through the first two, so that M falls like e^{−Λa} to 0 with R.
    /// `None` for R ≤ 0, above the last node, and for NaN, and on an axis of fewer than four nodes, which no file has.
    pub fn place(&self, rate: MillimetresPerHour) -> Option<AxisPlace> {
        let last = *self.rates.last()?;
        if !(rate.0 > 0.0 && rate <= last) {
            return None;
        }
        let x = libm::log(rate.0);
        let upper = self.rates.partition_point(|&node| node < rate);
        let stencil = if upper == 0 && rate < self.rates[0] { 2 } else { STENCIL };
        let first = upper.saturating_sub(STENCIL / 2).min(self.rates.len().checked_sub(STENCIL)?);
        let mut nodes = [0.0; STENCIL];
        for (node, &rate) in nodes.iter_mut().zip(&self.rates[first..]) {
            *node = libm::log(rate.0);
        }
        let mut weights = [0.0; STENCIL];
        for i in 0..stencil {
            weights[i] = 1.0;
            for j in (0..stencil).filter(|&j| j != i) {
                weights[i] *= (x - nodes[j]) / (nodes[i] - nodes[j]);
            }
        }
        Some(AxisPlace { first, weights, slope: drops::slope(rate) })
    }

    /// Upper bound of the rates that this section can answer for.
    pub fn largest_rate(&self) -> MillimetresPerHour {
        self.ranges.rate[1]
    }

    /// Reads the section; every number is checked, so that a table that reads can be used blindly.
    pub fn read(bytes: &[u8], version: u16, limits: &Limits) -> Result<Self, ReadError> {
        meta::check_version(Self::TAG, version, Self::VERSION)?;
        let section: Self = meta::decode(Self::TAG, bytes, limits)?;
        section.check()?;
        Ok(section)
    }

    /// The section's bytes.
    pub fn write(&self) -> Vec<u8> {
        meta::encode(self)
    }

    /// The section on its way into an asset: small, so all of it is checked on open; optional, since a
    /// storm can be lit without its rain.
    pub fn to_section(&self) -> OutSection {
        OutSection::small(Self::TAG, Self::VERSION, false, self.write())
    }

    fn check(&self) -> Result<(), ReadError> {
        let Ranges { rate, vertical_fov, exposure, length_px } = self.ranges;
        let range = |low: f64, high: f64| low > 0.0 && low <= high && high.is_finite();
        for (field, wanted, [low, high]) in [
            ("rate range", "0 < low ≤ high, finite", rate.map(|r| r.0)),
            ("fov range", "0 < low ≤ high < 180 degrees", vertical_fov.map(|v| v.0)),
            ("exposure range", "0 < low ≤ high, finite", exposure.map(|t| t.0)),
            ("length range", "0 < low ≤ high, finite", length_px),
        ] {
            if !range(low, high) || (field == "fov range" && high >= 180.0) {
                return invalid(field, wanted, format!("{low} to {high}"));
            }
        }
        for (field, value) in [("asked error", self.asked_error), ("measured error", self.measured_error)] {
            if !(value >= 0.0 && value.is_finite()) {
                return invalid(field, "a finite number from 0", value);
            }
        }
        self.check_axis()?;
        if !self.tables.iter().map(|table| table.mode).eq(Mode::ALL) {
            let found: Vec<_> = self.tables.iter().take(8).map(|table| table.mode.name()).collect();
            return invalid("tables", "default, paper-exact and paper, in this order", found.join(", "));
        }
        self.tables.iter().try_for_each(|table| self.check_table(table))
    }

    fn check_axis(&self) -> Result<(), ReadError> {
        if !(STENCIL..=MAX_NODES).contains(&self.rates.len()) {
            return invalid("rate nodes", "4 to 4096 nodes", self.rates.len());
        }
        let [low, high] = self.ranges.rate;
        if self.rates[0] != low || self.rates[self.rates.len() - 1] != high {
            let found = format!("{} to {}", self.rates[0].0, self.rates[self.rates.len() - 1].0);
            return invalid("rate nodes", "the ends of the rate range", found);
        }
        for pair in self.rates.windows(2) {
            // Well apart: the weights divide by the difference of their logarithms.
            if !(1.0 + 1e-6..f64::INFINITY).contains(&(pair[1].0 / pair[0].0)) {
                return invalid("rate nodes", "ascending rates", format!("{} then {}", pair[0].0, pair[1].0));
            }
        }
        Ok(())
    }

    fn check_table(&self, table: &Table) -> Result<(), ReadError> {
        if !(1..=MAX_CLASSES).contains(&table.classes.len()) {
            return invalid("classes", "1 to 256 classes", table.classes.len());
        }
        let mut end = 0.0;
        for class in &table.classes {
            let [from, to] = class.diameter.map(|d| d.0);
            if !(from >= end && from > 0.0 && to > from && to.is_finite()) {
                return invalid(
                    "class diameters",
                    "ascending, without overlap",
                    format!("{from} to {to} mm"),
                );
            }
            end = to;
            if !(class.representative.0 >= from && class.representative.0 <= to) {
                return invalid("representative diameter", "one inside the class", class.representative.0);
            }
            // Ten times the speed of sound in drops: past any fit, and it keeps offsets of a lifetime exact.
            if !(class.fall_speed.0 > 0.0 && class.fall_speed.0 <= 1e3) {
                return invalid("fall speed", "a speed in (0, 1000] m/s", class.fall_speed.0);
            }
            if !EDGE_LOG2.contains(&class.edge_log2) {
                return invalid("lattice edge", "2^-4 to 2^4 metres", class.edge_log2);
            }
            let crowd = class.candidates_per_cell(self.largest_rate());
            if !(0.0..=MAX_DROPS_PER_CELL).contains(&crowd) {
                return invalid("lattice edge", "at most 512 drops in a cell", crowd);
            }
        }
        let wanted = self.rates.len() * table.classes.len() * MOMENTS;
        if table.log_moments.len() != wanted {
            let found = format!("{} in place of {wanted}", table.log_moments.len());
            return invalid("moments", "nodes × classes × 6 numbers", found);
        }
        match table.log_moments.iter().find(|value| !(-MAX_LOG..=MAX_LOG).contains(*value)) {
            Some(value) => invalid("moments", "logarithms within ±690", value),
            None => Ok(()),
        }
    }
}

impl Table {
    /// Moments of class `class` at a place of the rate axis.
    pub fn moments(&self, place: &AxisPlace, class: usize) -> Moments {
        let mut values = [0.0; MOMENTS];
        for (i, value) in values.iter_mut().enumerate() {
            *value = libm::exp(self.log_moment(place, class, i));
        }
        let [number, area, m0, m1, m2, m3] = values;
        Moments { number, area, length: [m0, m1, m2, m3] }
    }

    /// ∫ N L³ dD of class `class`: [`Moments::cubed_length`] at the cost of the four moments that it needs.
    pub fn cubed_length(&self, place: &AxisPlace, class: usize, exposure: Seconds) -> f64 {
        let moment = |j: usize| libm::exp(self.log_moment(place, class, MOMENTS - 4 + j));
        let length = [moment(0), moment(1), moment(2), moment(3)];
        Moments { number: 1.0, area: 0.0, length }.cubed_length(exposure)
    }

    fn log_moment(&self, place: &AxisPlace, class: usize, moment: usize) -> f64 {
        let node_stride = self.classes.len() * MOMENTS;
        let start = place.first * node_stride + class * MOMENTS + moment;
        let rest: f64 =
            (0..STENCIL).map(|i| place.weights[i] * self.log_moments[start + i * node_stride]).sum();
        rest - place.slope * self.classes[class].diameter[0].0
    }
}

fn invalid<T>(field: &'static str, wanted: &'static str, found: impl ToString) -> Result<T, ReadError> {
    let section = DensitySection::TAG;
    Err(ReadError::Invalid { section, offset: None, field, wanted, found: found.to_string() })
}

#[cfg(test)]
#[path = "density_tests.rs"]
mod tests;
