//! `BOLT` v1: the strokes of a storm, as the numbers that grow them. Bytes: SPEC.md, "BOLT".

use crate::container::OutSection;
use crate::error::{Limits, ReadError};
use crate::meta::{self, check_version};
use crate::tag::Tag;
use serde::{Deserialize, Serialize};

/// What a stroke is grown from. The same numbers grow the same stroke everywhere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StrokeRecord {
    /// Name, for the command line.
    pub name: String,
    /// Seed of all its random turns.
    pub seed: u64,
    /// Where the main channel starts, m.
    pub from_m: [f64; 3],
    /// Where it ends, m.
    pub to_m: [f64; 3],
    /// Length of a segment, m.
    pub segment_m: f64,
    /// Mean angle between a segment and the channel's heading, rad.
    pub turn_rad: f64,
    /// How far the channel as a whole strays from the straight line, as a share of its length.
    pub wander: f64,
    /// Chance that a branch leaves at the end of a segment, 0 to 1.
    pub branching: f64,
    /// Mean angle between a branch and its parent, rad.
    pub branch_rad: f64,
    /// Length of a branch, as a share of what is left of its parent.
    pub branch_length: f64,
    /// Highest branch order; 0 is the main channel alone.
    pub max_order: u8,
    /// Intensity per length of a branch, as a share of its parent's.
    pub branch_intensity: f64,
    /// Radiant intensity of the whole stroke, W/sr.
    pub intensity_w_per_sr: f64,
    /// Colour of its light: weights of the red, green and blue band, mean 1.
    pub color: [f32; 3],
}

/// The strokes of an asset.
#[derive(Clone, Debug, PartialEq)]
pub struct BoltSection {
    /// In the recipe's order.
    pub strokes: Vec<StrokeRecord>,
}

impl BoltSection {
    /// The section's tag.
    pub const TAG: Tag = Tag(*b"BOLT");
    /// Version that this build writes, and the newest that it reads.
    pub const VERSION: u16 = 1;

    /// Reads and checks every number.
    pub fn read(bytes: &[u8], version: u16, limits: &Limits) -> Result<Self, ReadError> {
        check_version(Self::TAG, version, Self::VERSION)?;
        let strokes: Vec<StrokeRecord> = meta::decode(Self::TAG, bytes, limits)?;
        if strokes.len() as u64 > limits.items {
            let (wanted, allowed) = (strokes.len() as u64, limits.items);
            return Err(ReadError::OverLimit { section: Self::TAG, field: "strokes", wanted, allowed });
        }
        for stroke in &strokes {
            stroke.check().map_err(|(field, wanted, found)| ReadError::Invalid {
                section: Self::TAG,
                offset: None,
                field,
                wanted,
                found,
            })?;
        }
        Ok(Self { strokes })
    }

    /// The section's bytes.
    pub fn write(&self) -> OutSection {
        OutSection::small(Self::TAG, Self::VERSION, false, meta::encode(&self.strokes))
    }
}

/// Most segments that a straight main channel may have.
pub const MAX_MAIN_SEGMENTS: f64 = 4096.0;

impl StrokeRecord {
    /// A channel as recipes grow it unless told otherwise; name, seed, ends and intensity are the caller's.
    pub fn usual() -> Self {
        Self {
            name: String::new(),
            seed: 1,
            from_m: [0.0; 3],
            to_m: [0.0; 3],
            segment_m: 0.0,
            turn_rad: 16f64.to_radians(),
            wander: 0.15,
            branching: 0.1,
            branch_rad: 35f64.to_radians(),
            branch_length: 0.5,
            max_order: 3,
            branch_intensity: 0.35,
            intensity_w_per_sr: 0.0,
            color: [0.85, 0.95, 1.2],
        }
    }

    /// Field, accepted range and value of the first number out of range.
    pub fn check(&self) -> Result<(), (&'static str, &'static str, String)> {
        let finite = self.from_m.iter().chain(&self.to_m).all(|v| v.is_finite());
        if !finite {
            return Err(("from_m, to_m", "finite metres", format!("{:?}, {:?}", self.from_m, self.to_m)));
        }
        let length = self.length();
        let within = |field, wanted, value: f64, low: f64, high: f64| {
            if value >= low && value <= high { Ok(()) } else { Err((field, wanted, value.to_string())) }
        };
        within("from_m to to_m", "1 m to 1000 km apart", length, 1.0, 1e6)?;
        let shortest = length / MAX_MAIN_SEGMENTS;
        within("segment_m", "1/4096 of the stroke to the whole of it", self.segment_m, shortest, length)?;
        within("turn_rad", "0 to 1.2", self.turn_rad, 0.0, 1.2)?;
        within("wander", "0 to 1", self.wander, 0.0, 1.0)?;
        within("branching", "0 to 1", self.branching, 0.0, 1.0)?;
        within("branch_rad", "0 to 1.6", self.branch_rad, 0.0, 1.6)?;
        within("branch_length", "0 to 1", self.branch_length, 0.0, 1.0)?;
        within("max_order", "0 to 8", f64::from(self.max_order), 0.0, 8.0)?;
        within("branch_intensity", "0 to 1", self.branch_intensity, 0.0, 1.0)?;
        within("intensity_w_per_sr", "0 to 1e18", self.intensity_w_per_sr, 0.0, 1e18)?;
        let bands = self.color.iter().all(|&band| (0.0..=100.0).contains(&band));
        if !bands {
            return Err(("color", "three weights, 0 to 100", format!("{:?}", self.color)));
        }
        Ok(())
    }

    /// Straight distance from start to end, m.
    pub fn length(&self) -> f64 {
        let square = |axis: usize| {
            let step = self.to_m[axis] - self.from_m[axis];
            step * step
        };
        libm::sqrt(square(0) + square(1) + square(2))
    }
}
