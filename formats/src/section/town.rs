//! `TOWN` v1: the ground and what stands on it. Bytes: SPEC.md, "TOWN".
//!
//! A town is boxes with a rule for their windows, street lamps, wet ground with straight roads, and hills on a
//! coarse height map. Positions in metres, z up, the flat ground at z = 0.

use crate::container::OutSection;
use crate::error::{Limits, ReadError};
use crate::meta::{self, check_version};
use crate::tag::Tag;
use serde::{Deserialize, Serialize};

/// The ground and what stands on it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TownSection {
    /// What lies underfoot.
    pub ground: Ground,
    /// Boxes: houses, towers, masts.
    pub blocks: Vec<Block>,
    /// Street lamps.
    pub lamps: Vec<StreetLamp>,
    /// Hills; elsewhere the ground is flat.
    pub hills: Option<HeightMap>,
}

/// Material of the ground.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ground {
    /// Share of light that dry open ground reflects, per colour, in [0, 1].
    pub albedo: [f32; 3],
    /// Share of the ground under a film of water, in [0, 1].
    pub wetness: f32,
    /// Share of the ground under standing water, in [0, 1]: puddles on roads, wide sheets on open ground.
    pub puddles: f32,
    /// Typical width of a puddle on a road, m; sheets on open ground are twenty times as wide.
    pub puddle_size: f32,
    /// Root mean square slope of standing water under rain, in [0, 1].
    pub ripple: f32,
    /// Seed of the puddles and the ground's texture.
    pub seed: u32,
    /// Straight stretches of road.
    pub roads: Vec<Road>,
}

/// A straight road.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Road {
    /// One end of the middle line, m.
    pub from: [f32; 2],
    /// The other end, m.
    pub to: [f32; 2],
    /// Half the width, m.
    pub half_width: f32,
    /// Share of light that the dry surface reflects, per colour, in [0, 1].
    pub albedo: [f32; 3],
}

/// An upright box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Block {
    /// Middle of the footprint, m.
    pub centre: [f32; 2],
    /// Half the footprint's sides along the box's own axes, m.
    pub half: [f32; 2],
    /// Height of the foot above z = 0, m.
    pub foot: f32,
    /// Height of the box itself, m.
    pub height: f32,
    /// Turn of the box's own x axis from the world's towards y, rad.
    pub yaw: f32,
    /// Share of light that the walls reflect, per colour, in [0, 1].
    pub albedo: [f32; 3],
    /// Windows in the four walls.
    pub windows: Option<Windows>,
}

/// A wall's windows: a grid of panes, some lit, which is told from the seed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Windows {
    /// Width and height of the wall that belongs to one window, m.
    pub pitch: [f32; 2],
    /// Share of the wall that is glass, in [0, 1].
    pub glass: f32,
    /// Share of windows that are lit, in [0, 1].
    pub lit: f32,
    /// Mean radiance of a lit window per colour, W/(m² sr).
    pub radiance: [f32; 3],
    /// Seed.
    pub seed: u32,
}

/// A street lamp: a point that shines alike in all directions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StreetLamp {
    /// Where, m.
    pub position: [f32; 3],
    /// Radiant intensity per colour, W/sr.
    pub intensity: [f32; 3],
}

/// Heights on a rectangular grid of nodes, bilinear between them; the ground outside is flat at 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeightMap {
    /// First node, m.
    pub origin: [f32; 2],
    /// Distance between nodes along x and y, m.
    pub cell: [f32; 2],
    /// Nodes along x and y, at least 2 each.
    pub counts: [u32; 2],
    /// Metres per step of [`HeightMap::heights`].
    pub step: f32,
    /// Height of each node above z = 0 in steps, x fastest.
    pub heights: Vec<u16>,
}

impl Default for Ground {
    fn default() -> Self {
        Self {
            albedo: [0.06, 0.065, 0.05],
            wetness: 0.8,
            puddles: 0.3,
            puddle_size: 4.0,
            ripple: 0.02,
            seed: 1,
            roads: Vec::new(),
        }
    }
}

/// Farthest that anything may stand from the origin, m.
const FARTHEST: f32 = 1e6;
/// Tallest that anything may be, m.
const TALLEST: f32 = 1e4;
/// Brightest radiance and intensity.
const BRIGHTEST: f32 = 1e12;

/// Counts bad values of one section with the section's name on them.
struct Check;

impl Check {
    fn one(
        field: &'static str,
        wanted: &'static str,
        value: f32,
        low: f32,
        high: f32,
    ) -> Result<(), ReadError> {
        // NaN lies in no range.
        if value >= low && value <= high {
            return Ok(());
        }
        Err(ReadError::Invalid {
            section: TownSection::TAG,
            offset: None,
            field,
            wanted,
            found: value.to_string(),
        })
    }

    fn share(field: &'static str, values: &[f32]) -> Result<(), ReadError> {
        values.iter().try_for_each(|&v| Self::one(field, "a share in [0, 1]", v, 0.0, 1.0))
    }

    fn place(field: &'static str, values: &[f32]) -> Result<(), ReadError> {
        values.iter().try_for_each(|&v| Self::one(field, "metres within ±1000 km", v, -FARTHEST, FARTHEST))
    }

    fn size(field: &'static str, values: &[f32]) -> Result<(), ReadError> {
        values.iter().try_for_each(|&v| Self::one(field, "metres in [0.001, 1e6]", v, 1e-3, FARTHEST))
    }

    fn height(field: &'static str, value: f32) -> Result<(), ReadError> {
        Self::one(field, "metres in [0, 10000]", value, 0.0, TALLEST)
    }

    fn light(field: &'static str, values: &[f32]) -> Result<(), ReadError> {
        values.iter().try_for_each(|&v| Self::one(field, "a number in [0, 1e12]", v, 0.0, BRIGHTEST))
    }
}

impl TownSection {
    /// This section's tag.
    pub const TAG: Tag = Tag(*b"TOWN");
    /// Newest version of this section's layout.
    pub const VERSION: u16 = 1;

    /// Reads and checks a section's bytes.
    ///
    /// Errors: a newer version, more than `limits.items` blocks, lamps, roads or `limits.cells` nodes, bytes
    /// that are no record of this version, a value outside its range.
    pub fn read(bytes: &[u8], version: u16, limits: &Limits) -> Result<Self, ReadError> {
        check_version(Self::TAG, version, Self::VERSION)?;
        let town: Self = meta::decode(Self::TAG, bytes, limits)?;
        town.validate(limits)?;
        Ok(town)
    }

    /// The section's bytes, ready for the container.
    pub fn write(&self) -> OutSection {
        OutSection::small(Self::TAG, Self::VERSION, false, meta::encode(self))
    }

    /// Checks every value against its range; what [`TownSection::read`] does after decoding.
    pub fn validate(&self, limits: &Limits) -> Result<(), ReadError> {
        let counts = [
            ("blocks", self.blocks.len(), limits.items),
            ("lamps", self.lamps.len(), limits.items),
            ("roads", self.ground.roads.len(), limits.items),
            ("height map nodes", self.hills.as_ref().map_or(0, |hills| hills.heights.len()), limits.cells),
        ];
        for (field, count, allowed) in counts {
            if count as u64 > allowed {
                let wanted = count as u64;
                return Err(ReadError::OverLimit { section: Self::TAG, field, wanted, allowed });
            }
        }
        self.ground.validate()?;
        self.blocks.iter().try_for_each(Block::validate)?;
        for lamp in &self.lamps {
            Check::place("lamp position", &lamp.position)?;
            Check::light("lamp intensity", &lamp.intensity)?;
        }
        self.hills.as_ref().map_or(Ok(()), HeightMap::validate)
    }
}

impl Ground {
    fn validate(&self) -> Result<(), ReadError> {
        Check::share("ground albedo", &self.albedo)?;
        Check::share("ground wetness, puddles and ripple", &[self.wetness, self.puddles, self.ripple])?;
        Check::size("puddle size", &[self.puddle_size])?;
        for road in &self.roads {
            Check::place("road ends", &[road.from[0], road.from[1], road.to[0], road.to[1]])?;
            Check::size("road half width", &[road.half_width])?;
            Check::share("road albedo", &road.albedo)?;
        }
        Ok(())
    }
}

impl Block {
    fn validate(&self) -> Result<(), ReadError> {
        Check::place("block centre", &self.centre)?;
        Check::size("block half sides", &self.half)?;
        Check::height("block foot", self.foot)?;
        Check::height("block height", self.height)?;
        Check::one("block yaw", "radians in [-7, 7]", self.yaw, -7.0, 7.0)?;
        Check::share("block albedo", &self.albedo)?;
        let Some(windows) = &self.windows else { return Ok(()) };
        // A pane below a tenth of a metre would let a hostile file ask for endless windows.
        for pitch in windows.pitch {
            Check::one("window pitch", "metres in [0.1, 100]", pitch, 0.1, 100.0)?;
        }
        Check::share("window glass and lit share", &[windows.glass, windows.lit])?;
        Check::light("window radiance", &windows.radiance)
    }
}

impl HeightMap {
    fn validate(&self) -> Result<(), ReadError> {
        Check::place("height map origin", &self.origin)?;
        Check::size("height map cell", &self.cell)?;
        let invalid = |field, wanted, found| {
            Err(ReadError::Invalid { section: TownSection::TAG, offset: None, field, wanted, found })
        };
        let [nx, ny] = self.counts;
        if nx < 2 || ny < 2 {
            return invalid("height map counts", "at least 2 × 2 nodes", format!("{nx} × {ny}"));
        }
        if u64::from(nx) * u64::from(ny) != self.heights.len() as u64 {
            let found = format!("{nx} × {ny} and {} heights", self.heights.len());
            return invalid("height map counts", "as many nodes as heights", found);
        }
        Check::one("height map step", "metres in [0, 0.15]", self.step, 0.0, 0.15)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample() -> TownSection {
        let windows = Windows { pitch: [3.0, 3.5], glass: 0.4, lit: 0.3, radiance: [0.3, 0.2, 0.1], seed: 9 };
        let block = Block {
            centre: [10.0, 900.0],
            half: [12.0, 15.0],
            foot: 0.0,
            height: 80.0,
            yaw: 0.3,
            albedo: [0.3; 3],
            windows: Some(windows),
        };
        let mast = Block { windows: None, half: [0.5; 2], foot: 80.0, height: 20.0, ..block.clone() };
        let road =
            Road { from: [0.0, -100.0], to: [0.0, 800.0], half_width: 5.0, albedo: [0.05, 0.05, 0.055] };
        TownSection {
            ground: Ground { roads: vec![road], ..Ground::default() },
            blocks: vec![block, mast],
            lamps: vec![StreetLamp { position: [5.0, 30.0, 8.0], intensity: [20.0, 14.0, 6.0] }],
            hills: Some(HeightMap {
                origin: [-1e4, 5e3],
                cell: [500.0, 400.0],
                counts: [3, 2],
                step: 0.05,
                heights: vec![0, 900, 0, 10, 65_535, 0],
            }),
        }
    }

    fn read(bytes: &[u8]) -> Result<TownSection, ReadError> {
        TownSection::read(bytes, TownSection::VERSION, &Limits::default())
    }

    #[test]
    fn a_town_reads_back_as_it_was_written() {
        let section = sample().write();
        assert!(!section.required);
        assert_eq!(read(&section.to_bytes()).unwrap(), sample());
        assert!(TownSection::read(&section.to_bytes(), 2, &Limits::default()).is_err());
    }

    #[test]
    fn the_bytes_lie_where_the_specification_says() {
        let bytes = sample().write().to_bytes();
        let float = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let count = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
        // Ground: 3 + 4 floats, a seed, one road of 32 bytes.
        assert_eq!((float(12), float(24), count(32)), (0.8, 0.02, 1));
        assert_eq!((float(44), float(56)), (-100.0, 5.0));
        // Blocks: 73 bytes with windows, 41 without.
        assert_eq!((count(72), float(84), float(100)), (2, 900.0, 80.0));
        assert_eq!((bytes[120], float(121), bytes[153 + 40]), (1, 3.0, 0));
        // One lamp of 24 bytes, the option's byte, the hills.
        assert_eq!((count(194), float(214), bytes[226], float(227)), (1, 20.0, 1, -1e4));
        assert_eq!((float(251), count(255), bytes.len()), (0.05, 6, 275));
    }

    #[test]
    fn a_town_cut_at_any_byte_is_refused() {
        let bytes = sample().write().to_bytes();
        for cut in 0..bytes.len() {
            assert!(read(&bytes[..cut]).is_err(), "cut at {cut}");
        }
    }

    #[test]
    fn every_number_out_of_range_is_refused_by_name() {
        type Spoil = fn(&mut TownSection);
        let spoils: [(&str, Spoil); 12] = [
            ("block centre", |t| t.blocks[0].centre[1] = f32::NAN),
            ("block half", |t| t.blocks[1].half[0] = 0.0),
            ("block height", |t| t.blocks[0].height = -1.0),
            ("block yaw", |t| t.blocks[0].yaw = f32::INFINITY),
            ("window pitch", |t| t.blocks[0].windows.as_mut().unwrap().pitch[0] = 1e-9),
            ("lit", |t| t.blocks[0].windows.as_mut().unwrap().lit = 1.5),
            ("lamp intensity", |t| t.lamps[0].intensity[2] = f32::INFINITY),
            ("ripple", |t| t.ground.ripple = 2.0),
            ("road half width", |t| t.ground.roads[0].half_width = -5.0),
            ("height map counts", |t| t.hills.as_mut().unwrap().counts = [u32::MAX, u32::MAX]),
            ("height map counts", |t| t.hills.as_mut().unwrap().counts = [6, 1]),
            ("height map step", |t| t.hills.as_mut().unwrap().step = f32::NAN),
        ];
        for (name, spoil) in spoils {
            let mut town = sample();
            spoil(&mut town);
            let error = read(&town.write().to_bytes()).unwrap_err().to_string();
            assert!(error.contains(name), "{name}: {error}");
        }
        let limits = Limits { items: 1, ..Limits::default() };
        let crowded = TownSection::read(&sample().write().to_bytes(), 1, &limits).unwrap_err();
        assert!(matches!(crowded, ReadError::OverLimit { field: "blocks", .. }));
    }

    proptest! {
        #[test]
        fn damaged_bytes_never_panic_and_never_pass_unchecked(at in 0usize..400, value: u8) {
            let mut bytes = sample().write().to_bytes();
            let at = at % bytes.len();
            bytes[at] = value;
            if let Ok(town) = read(&bytes) {
                prop_assert!(town.validate(&Limits::default()).is_ok());
            }
        }
    }
}
