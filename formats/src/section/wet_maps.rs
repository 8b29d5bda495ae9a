//! `WETM` v1: what is baked of a scene's meshes for rain where it lands. Bytes: SPEC.md, "WETM".

mod code;

use crate::container::OutSection;
use crate::error::{Limits, ReadError};
use crate::meta::{self, check_version};
use crate::tag::Tag;
pub use code::{decode, encode};
use serde::{Deserialize, Serialize};

/// Maps of a scene; all of them may be absent.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WetMapsSection {
    /// Height of the highest point in each cell, m.
    pub height: Option<GroundRecord>,
    /// Depth of standing water when puddles are full, m.
    pub water: Option<GroundRecord>,
    /// Irradiance of an upward surface from overhead, red, green and blue, W/m²: three maps of one grid, or none.
    pub overhead: Vec<GroundRecord>,
    /// Where water drips from.
    pub drips: DripRecords,
    /// Silhouettes.
    pub fins: FinRecords,
    /// Light of lightning after it was reflected.
    pub lightning: Option<LightningRecord>,
}

/// Values over the ground, cell by cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroundRecord {
    /// Lowest corner of the grid, x and y, m.
    pub origin_m: [f64; 2],
    /// Edge of a cell, m.
    pub cell_m: f64,
    /// Cells along x and y.
    pub size: [u32; 2],
    /// Value of the first step.
    pub low: f32,
    /// What a step adds, or the square of a number of steps.
    pub step: f32,
    /// Whether steps count by their squares, so that small values keep their digits.
    pub squared: bool,
    /// Steps of all cells, x fastest, as [`encode`] writes them: 0 is nothing there, k is the value of k − 1 steps.
    pub code: Vec<u8>,
}

/// A box in which places are held in steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BoxRecord {
    /// Lowest corner, m.
    pub low_m: [f32; 3],
    /// What a step adds along each axis, m.
    pub step_m: [f32; 3],
}

/// Edges that drip.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DripRecords {
    /// The box that they lie in.
    pub within: BoxRecord,
    /// Ends of each in steps, one end after the other.
    pub ends: Vec<[u16; 6]>,
    /// Area that drains over each, m².
    pub drains_m2: Vec<f32>,
}

/// Silhouettes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FinRecords {
    /// The box that they lie in.
    pub within: BoxRecord,
    /// Ends of each in steps, one end after the other.
    pub ends: Vec<[u16; 6]>,
    /// Unit normals of the two faces of each, times 127.
    pub normals: Vec<[i8; 6]>,
}

/// A volume of harmonics for each key direction of lightning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightningRecord {
    /// The first node, m.
    pub origin_m: [f64; 3],
    /// Distance between nodes, m.
    pub cell_m: f64,
    /// Nodes along x, y and z.
    pub size: [u32; 3],
    /// Unit vectors towards the light.
    pub directions: Vec<[f32; 3]>,
    /// Value of 32767 steps, of each key direction and harmonic.
    pub peaks: Vec<[f32; 9]>,
    /// Steps of each key direction, of each node (x first), of each harmonic.
    pub steps: Vec<[i16; 9]>,
}

/// Most cells along a side of a map, nodes along a side of a volume, and key directions.
pub const MOST_CELLS: u32 = 4096;
/// See [`MOST_CELLS`].
pub const MOST_NODES: u32 = 512;
/// See [`MOST_CELLS`].
pub const MOST_DIRECTIONS: usize = 16;
/// Largest step of a map: one less than its largest code.
pub const MOST_STEPS: u16 = u16::MAX - 1;
/// Farthest that anything may be from the origin, m.
const FARTHEST_M: f64 = 1e7;

/// What is wrong: field, wanted, found.
type Wrong = (&'static str, &'static str, String);

fn within(value: f64, low: f64, high: f64) -> bool {
    // No number lies in no range.
    value >= low && value <= high
}

/// Whether three steps are a unit vector times 127: rounding of three parts changes its length by less than 1.
fn is_unit(normal: &[i8]) -> bool {
    let squared: i32 = normal.iter().map(|part| i32::from(*part) * i32::from(*part)).sum();
    (125 * 125..=129 * 129).contains(&squared)
}

/// How values that lie between two steps are rounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rounding {
    /// To the nearer one.
    Nearest,
    /// Upwards.
    Up,
}

impl GroundRecord {
    /// The record of values over a grid in at most `steps` steps; values that are no numbers are nothing there.
    pub fn quantise(
        (origin_m, cell_m, size): ([f64; 2], f64, [u32; 2]),
        values: &[f32],
        steps: u16,
        squared: bool,
        rounding: Rounding,
    ) -> Self {
        let numbers = || values.iter().copied().filter(|value| value.is_finite());
        let low = if squared { 0.0 } else { numbers().reduce(f32::min).unwrap_or(0.0) };
        let high = numbers().reduce(f32::max).unwrap_or(0.0);
        let steps = f64::from(steps.min(MOST_STEPS));
        // A step that holds the highest value after its own rounding.
        let exact = (f64::from(high) - f64::from(low)).max(0.0) / if squared { steps * steps } else { steps };
        let step = if exact as f32 as f64 >= exact { exact as f32 } else { (exact as f32).next_up() };
        let code = |value: &f32| {
            if !value.is_finite() {
                return 0;
            }
            let above = (f64::from(*value) - f64::from(low)).max(0.0);
            let at = if step > 0.0 { above / f64::from(step) } else { 0.0 };
            let at = if squared { at.sqrt() } else { at };
            let at = match rounding {
                Rounding::Nearest => libm::round(at),
                Rounding::Up => libm::ceil(at - 1e-6),
            };
            at.min(steps) as u16 + 1
        };
        let codes: Vec<u16> = values.iter().map(code).collect();
        Self { origin_m, cell_m, size, low, step, squared, code: encode(&codes, size[0] as usize) }
    }

    /// Values of all cells, x fastest; NaN where there is nothing.
    ///
    /// Errors: a code that [`WetMapsSection::read`] refuses, as words.
    pub fn values(&self) -> Result<Vec<f32>, &'static str> {
        let codes = decode(&self.code, self.size.map(|side| side as usize))?;
        let value = |code: u16| match code {
            0 => f32::NAN,
            code => {
                let at = f32::from(code - 1);
                self.low + self.step * if self.squared { at * at } else { at }
            }
        };
        Ok(codes.into_iter().map(value).collect())
    }

    fn check(&self) -> Result<(), Wrong> {
        if !self.origin_m.iter().all(|at| within(*at, -FARTHEST_M, FARTHEST_M)) {
            return Err(("map.origin_m", "within ±1e7 m", format!("{:?}", self.origin_m)));
        }
        if !within(self.cell_m, 1e-3, FARTHEST_M) {
            return Err(("map.cell_m", "0.001 to 1e7 m", self.cell_m.to_string()));
        }
        if self.size.iter().any(|side| !(1..=MOST_CELLS).contains(side)) {
            return Err(("map.size", "1 to 4096 cells a side", format!("{:?}", self.size)));
        }
        if !(within(self.low.into(), -1e7, 1e7) && within(self.step.into(), 0.0, 1e9)) {
            let found = format!("{}, {}", self.low, self.step);
            return Err(("map.low and map.step", "within ±1e7, and 0 to 1e9", found));
        }
        // A cell takes a byte at least, so that no more of them are asked for than there are bytes.
        let cells = self.size.map(|side| side as usize);
        decode(&self.code, cells).map(drop).map_err(|wanted| ("map.code", wanted, "others".into()))
    }
}

impl BoxRecord {
    /// The smallest box around places.
    pub fn around(places: impl Iterator<Item = [f64; 3]>) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for place in places {
            for axis in 0..3 {
                low[axis] = low[axis].min(place[axis]);
                high[axis] = high[axis].max(place[axis]);
            }
        }
        if low[0] > high[0] {
            return Self::default();
        }
        let low_m = low.map(|low| low as f32);
        let step = |axis: usize| ((high[axis] - f64::from(low_m[axis])) / 65_535.0).max(0.0) as f32;
        Self { low_m, step_m: [step(0), step(1), step(2)] }
    }

    /// A place in steps.
    pub fn steps(&self, place: [f64; 3]) -> [u16; 3] {
        [0, 1, 2].map(|axis| {
            let step = f64::from(self.step_m[axis]);
            let above = place[axis] - f64::from(self.low_m[axis]);
            // Casts saturate.
            if step > 0.0 { libm::round(above / step) as u16 } else { 0 }
        })
    }

    /// The place of steps.
    pub fn place(&self, steps: [u16; 3]) -> [f64; 3] {
        [0, 1, 2]
            .map(|axis| f64::from(self.low_m[axis]) + f64::from(self.step_m[axis]) * f64::from(steps[axis]))
    }

    fn check(&self) -> Result<(), Wrong> {
        let good = self.low_m.iter().all(|low| within((*low).into(), -FARTHEST_M, FARTHEST_M))
            && self.step_m.iter().all(|step| within((*step).into(), 0.0, 1e3));
        let found = || format!("{:?}, {:?}", self.low_m, self.step_m);
        good.then_some(()).ok_or_else(|| ("box", "a corner within ±1e7 m, steps of 0 to 1000 m", found()))
    }
}

impl LightningRecord {
    /// Peaks and steps of harmonics: every harmonic of every key direction over its own largest.
    pub fn quantise(harmonics: &[[f32; 9]], directions: usize) -> (Vec<[f32; 9]>, Vec<[i16; 9]>) {
        let nodes = harmonics.len() / directions.max(1);
        let mut peaks = vec![[0.0f32; 9]; directions];
        let mut steps = Vec::with_capacity(harmonics.len());
        for (peaks, nodes) in peaks.iter_mut().zip(harmonics.chunks_exact(nodes.max(1))) {
            for node in nodes {
                for (peak, value) in peaks.iter_mut().zip(node) {
                    *peak = peak.max(value.abs());
                }
            }
            let step = |value: f32, peak: f32| match peak > 0.0 {
                true => libm::round(f64::from(value) / f64::from(peak) * 32_767.0) as i16,
                false => 0,
            };
            steps.extend(nodes.iter().map(|node| std::array::from_fn(|at| step(node[at], peaks[at]))));
        }
        (peaks, steps)
    }

    /// Harmonics of each key direction, of each node.
    pub fn harmonics(&self) -> Vec<[f32; 9]> {
        let nodes = self.steps.len() / self.directions.len().max(1);
        let of = |(at, steps): (usize, &[i16; 9])| {
            let peaks = self.peaks.get(at / nodes.max(1)).copied().unwrap_or_default();
            std::array::from_fn(|k| f32::from(steps[k]) * (peaks[k] / 32_767.0))
        };
        self.steps.iter().enumerate().map(of).collect()
    }

    fn check(&self) -> Result<(), Wrong> {
        if !(self.origin_m.iter().all(|at| within(*at, -FARTHEST_M, FARTHEST_M))
            && within(self.cell_m, 1e-3, FARTHEST_M))
        {
            let found = format!("{:?}, {}", self.origin_m, self.cell_m);
            return Err(("lightning.origin_m and cell_m", "within ±1e7 m, and 0.001 to 1e7 m", found));
        }
        if self.size.iter().any(|side| !(1..=MOST_NODES).contains(side)) {
            return Err(("lightning.size", "1 to 512 nodes a side", format!("{:?}", self.size)));
        }
        let unit = |d: &[f32; 3]| within((d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).into(), 0.998, 1.002);
        let count = self.directions.len();
        if !(1..=MOST_DIRECTIONS).contains(&count) || !self.directions.iter().all(unit) {
            return Err(("lightning.directions", "1 to 16 unit vectors", format!("{:?}", self.directions)));
        }
        let peaks = self.peaks.as_flattened().iter().all(|peak| within((*peak).into(), 0.0, 1e9));
        if self.peaks.len() != count || !peaks {
            return Err(("lightning.peaks", "one set a direction, 0 to 1e9", self.peaks.len().to_string()));
        }
        let nodes: u64 = self.size.iter().map(|side| u64::from(*side)).product();
        if nodes * count as u64 != self.steps.len() as u64 {
            return Err(("lightning.steps", "one set a direction and node", self.steps.len().to_string()));
        }
        Ok(())
    }
}

impl WetMapsSection {
    /// The section's tag.
    pub const TAG: Tag = Tag(*b"WETM");
    /// Version that this build writes, and the newest that it reads.
    pub const VERSION: u16 = 1;

    /// Refuses what no maps are: the field, what is wanted, what was found.
    pub fn check(&self) -> Result<(), (&'static str, &'static str, String)> {
        for map in self.height.iter().chain(&self.water).chain(&self.overhead) {
            map.check()?;
        }
        let grid = |map: &GroundRecord| (map.origin_m, map.cell_m, map.size);
        let same = self.overhead.iter().all(|map| grid(map) == grid(&self.overhead[0]));
        if !matches!(self.overhead.len(), 0 | 3) || !same {
            return Err(("overhead", "three maps of one grid, or none", self.overhead.len().to_string()));
        }
        let (drips, fins) = (&self.drips, &self.fins);
        drips.within.check()?;
        fins.within.check()?;
        if drips.ends.len() != drips.drains_m2.len()
            || !drips.drains_m2.iter().all(|area| within((*area).into(), 0.0, 1e12))
        {
            return Err(("drips.drains_m2", "one a drip, 0 to 1e12 m²", drips.drains_m2.len().to_string()));
        }
        if fins.ends.len() != fins.normals.len() {
            return Err(("fins.normals", "two a fin", fins.normals.len().to_string()));
        }
        if let Some(normals) = fins.normals.iter().find(|normals| !normals.chunks_exact(3).all(is_unit)) {
            return Err(("fins.normals", "unit vectors times 127", format!("{normals:?}")));
        }
        self.lightning.as_ref().map_or(Ok(()), LightningRecord::check)
    }

    /// Reads a record.
    ///
    /// Errors: another version, bytes that are no record of this one, numbers out of range, more edges than `limits.items`.
    pub fn read(bytes: &[u8], version: u16, limits: &Limits) -> Result<Self, ReadError> {
        check_version(Self::TAG, version, Self::VERSION)?;
        let section: Self = meta::decode(Self::TAG, bytes, limits)?;
        let edges = [("drips", section.drips.ends.len()), ("fins", section.fins.ends.len())];
        for (field, wanted) in edges.map(|(field, count)| (field, count as u64)) {
            if wanted > limits.items {
                return Err(ReadError::OverLimit {
                    section: Self::TAG,
                    field,
                    wanted,
                    allowed: limits.items,
                });
            }
        }
        section.check().map_err(|(field, wanted, found)| ReadError::Invalid {
            section: Self::TAG,
            offset: None,
            field,
            wanted,
            found,
        })?;
        Ok(section)
    }

    /// The section's bytes.
    pub fn write(&self) -> OutSection {
        OutSection::small(Self::TAG, Self::VERSION, false, meta::encode(self))
    }
}

#[cfg(test)]
mod tests;
