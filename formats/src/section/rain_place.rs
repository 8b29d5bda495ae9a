//! `RPLC` v1: where rain is: a map of it over the ground, and how far it is seen. Bytes: SPEC.md, "RPLC".

use crate::container::OutSection;
use crate::error::{Limits, ReadError};
use crate::meta::{self, check_version};
use crate::tag::Tag;
use serde::{Deserialize, Serialize};

/// Where rain is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RainPlaceSection {
    /// Distance from the eye beyond which rain is not looked through, m: \[weber\]'s sphere of the sky.
    pub farthest_m: Option<f64>,
    /// Rain over the ground.
    pub map: Option<RainMapRecord>,
}

/// Rain over the ground at time 0, cell by cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RainMapRecord {
    /// Lowest corner of the grid, x and y, m.
    pub origin_m: [f64; 2],
    /// Edge of a cell, m.
    pub cell_m: f64,
    /// Cells along x and y.
    pub size: [u32; 2],
    /// The heaviest rain, mm/h.
    pub heaviest_mm_per_h: f64,
    /// Rain falls from this height, m, and fades to nothing over the second number above it.
    pub top_m: Option<[f64; 2]>,
    /// Rates in steps of the heaviest over 65535, x fastest.
    pub steps: Vec<u16>,
}

/// Most cells along a side.
pub const MOST_SIDE: u32 = 4096;

impl RainMapRecord {
    /// Rates of all cells, mm/h, x fastest.
    pub fn rates(&self) -> Vec<f32> {
        let step = self.heaviest_mm_per_h / f64::from(u16::MAX);
        self.steps.iter().map(|&steps| (f64::from(steps) * step) as f32).collect()
    }

    /// The steps of rates, and the heaviest of them; rates that are no numbers count as 0.
    pub fn quantise(rates: &[f32]) -> (f64, Vec<u16>) {
        let heaviest = rates.iter().fold(0.0f32, |most, rate| most.max(*rate));
        let factor = if heaviest > 0.0 { f64::from(u16::MAX) / f64::from(heaviest) } else { 0.0 };
        // Casts saturate.
        let steps = rates.iter().map(|&rate| libm::round(f64::from(rate) * factor) as u16);
        (f64::from(heaviest), steps.collect())
    }

    fn check(&self) -> Result<(), (&'static str, &'static str, String)> {
        let within = |value: f64, low: f64, high: f64| value >= low && value <= high;
        let Self { origin_m, cell_m, size, heaviest_mm_per_h, top_m, steps } = self;
        if !origin_m.iter().all(|&at| within(at, -1e9, 1e9)) {
            return Err(("map.origin_m", "within -1e9 to 1e9 m", format!("{origin_m:?}")));
        }
        if !within(*cell_m, 1e-3, 1e7) {
            return Err(("map.cell_m", "0.001 to 1e7 m", cell_m.to_string()));
        }
        if size.iter().any(|side| !(1..=MOST_SIDE).contains(side)) {
            return Err(("map.size", "1 to 4096 cells a side", format!("{size:?}")));
        }
        if u64::from(size[0]) * u64::from(size[1]) != steps.len() as u64 {
            return Err(("map.steps", "one for each cell", steps.len().to_string()));
        }
        if !within(*heaviest_mm_per_h, 1e-6, 1000.0) {
            return Err(("map.heaviest_mm_per_h", "1e-6 to 1000 mm/h", heaviest_mm_per_h.to_string()));
        }
        if !steps.contains(&u16::MAX) {
            return Err(("map.steps", "65535 in a cell: the heaviest rain", "less in each".into()));
        }
        match top_m {
            Some([height, softness]) if !(within(*height, -1e6, 1e6) && within(*softness, 0.0, 1e6)) => {
                Err(("map.top_m", "a height within -1e6 to 1e6 m, softness 0 to 1e6 m", format!("{top_m:?}")))
            }
            _ => Ok(()),
        }
    }
}

impl RainPlaceSection {
    /// The section's tag.
    pub const TAG: Tag = Tag(*b"RPLC");
    /// Version that this build writes, and the newest that it reads.
    pub const VERSION: u16 = 1;

    /// Refuses what no rain is: the field, what is wanted, what was found.
    pub fn check(&self) -> Result<(), (&'static str, &'static str, String)> {
        match self.farthest_m {
            Some(farthest) if !(farthest > 0.0 && farthest <= 1e7) => {
                return Err(("farthest_m", "above 0, to 1e7 m", farthest.to_string()));
            }
            _ => {}
        }
        self.map.as_ref().map_or(Ok(()), RainMapRecord::check)
    }

    /// Reads a record.
    ///
    /// Errors: another version, bytes that are no record of this one, numbers out of range, more cells than `limits.cells`.
    pub fn read(bytes: &[u8], version: u16, limits: &Limits) -> Result<Self, ReadError> {
        check_version(Self::TAG, version, Self::VERSION)?;
        let section: Self = meta::decode(Self::TAG, bytes, limits)?;
        section.check().map_err(|(field, wanted, found)| ReadError::Invalid {
            section: Self::TAG,
            offset: None,
            field,
            wanted,
            found,
        })?;
        let cells = section.map.as_ref().map_or(0, |map| map.steps.len() as u64);
        if cells > limits.cells {
            let (wanted, allowed) = (cells, limits.cells);
            return Err(ReadError::OverLimit { section: Self::TAG, field: "map.steps", wanted, allowed });
        }
        Ok(section)
    }

    /// The section's bytes.
    pub fn write(&self) -> OutSection {
        OutSection::small(Self::TAG, Self::VERSION, false, meta::encode(self))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place() -> RainPlaceSection {
        let (heaviest_mm_per_h, steps) = RainMapRecord::quantise(&[0.0, 12.5, 50.0, f32::NAN, 3.0, 1.0]);
        let map = RainMapRecord {
            origin_m: [-500.0, 20.0],
            cell_m: 250.0,
            size: [3, 2],
            heaviest_mm_per_h,
            top_m: Some([900.0, 100.0]),
            steps,
        };
        RainPlaceSection { farthest_m: Some(3e4), map: Some(map) }
    }

    #[test]
    fn a_map_reads_back_within_half_a_step() {
        let bytes = meta::encode(&place());
        let read = RainPlaceSection::read(&bytes, 1, &Limits::default()).unwrap();
        assert_eq!(read, place());
        let rates = read.map.unwrap().rates();
        for (rate, wanted) in rates.iter().zip([0.0, 12.5, 50.0, 0.0, 3.0, 1.0]) {
            assert!((rate - wanted).abs() <= 50.0 / 65535.0 * 0.51, "{rate} for {wanted}");
        }
        assert!(RainPlaceSection::read(&bytes, 2, &Limits::default()).is_err());
        assert!(
            (0..bytes.len()).all(|cut| RainPlaceSection::read(&bytes[..cut], 1, &Limits::default()).is_err())
        );
    }

    #[test]
    fn numbers_out_of_range_are_refused_by_name() {
        let refused = |change: &dyn Fn(&mut RainPlaceSection), words: &str| {
            let mut section = place();
            change(&mut section);
            let error = RainPlaceSection::read(&meta::encode(&section), 1, &Limits::default()).unwrap_err();
            assert!(error.to_string().contains(words), "{error}");
        };
        let map =
            |change: fn(&mut RainMapRecord)| move |s: &mut RainPlaceSection| change(s.map.as_mut().unwrap());
        refused(&|s| s.farthest_m = Some(0.0), "farthest_m");
        refused(&|s| s.farthest_m = Some(f64::NAN), "farthest_m");
        refused(&map(|m| m.origin_m[1] = f64::INFINITY), "map.origin_m");
        refused(&map(|m| m.cell_m = -1.0), "map.cell_m");
        refused(&map(|m| m.size = [0, 6]), "map.size");
        refused(&map(|m| m.size = [3, 3]), "map.steps");
        refused(&map(|m| m.heaviest_mm_per_h = f64::NAN), "map.heaviest_mm_per_h");
        refused(&map(|m| m.steps[2] = 9), "map.steps");
        refused(&map(|m| m.top_m = Some([0.0, -1.0])), "map.top_m");
    }
}
