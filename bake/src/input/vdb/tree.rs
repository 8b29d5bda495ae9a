//! Trees of 5, 4 and 3 levels: a root with tiles and nodes, nodes of 32³ and 16³ places, leaves of 8³ voxels.

use super::bytes::Bytes;
use super::codec::{Compression, is_on, values};
use super::{Read, Refusal};

/// What a tree's values are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Value {
    F32,
    F64,
    F16,
    /// float in the tree, half in arrays.
    SavedAsHalf,
    /// double in the tree, half in arrays.
    DoubleSavedAsHalf,
}

impl Value {
    pub fn named(type_name: &str) -> Option<Self> {
        Some(match type_name {
            "Tree_float_5_4_3" => Self::F32,
            "Tree_double_5_4_3" => Self::F64,
            "Tree_half_5_4_3" => Self::F16,
            "Tree_float_5_4_3_HalfFloat" => Self::SavedAsHalf,
            "Tree_double_5_4_3_HalfFloat" => Self::DoubleSavedAsHalf,
            _ => return None,
        })
    }

    /// Bytes of a value in an array.
    pub fn stored_bytes(self) -> usize {
        match self {
            Self::F16 | Self::SavedAsHalf | Self::DoubleSavedAsHalf => 2,
            Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// A value of an array.
    pub fn stored(self, bytes: &[u8]) -> f32 {
        match *bytes {
            [a, b] => half::f16::from_le_bytes([a, b]).to_f32(),
            [a, b, c, d] => f32::from_le_bytes([a, b, c, d]),
            [a, b, c, d, e, f, g, h] => f64::from_le_bytes([a, b, c, d, e, f, g, h]) as f32,
            _ => 0.0,
        }
    }

    /// A value that stands by itself: background, tile, inactive value.
    pub fn full(self, at: &mut Bytes<'_>) -> Read<f32> {
        let bytes = match self {
            Self::F16 => 2,
            Self::F32 | Self::SavedAsHalf => 4,
            Self::F64 | Self::DoubleSavedAsHalf => 8,
        };
        Ok(self.stored(at.take(bytes)?))
    }
}

/// Voxels along an edge: of a leaf, of a node of 16³ leaves, of a node of 32³ of those.
const LEAF: i32 = 8;
const MIDDLE: i32 = 128;
const UPPER: i32 = 4096;
/// Leaves and tiles of a tree. A box of 2²⁸ voxels that is one voxel thick has 2²² leaves of 8 × 8 × 1; along its edges a leaf more. (A line of more
/// voxels than 40 million has more, and is refused.)
const MOST_PARTS: usize = 5 << 20;

/// A box of voxels, both ends included.
#[derive(Clone, Copy)]
pub(super) struct BoxOf {
    pub low: [i64; 3],
    pub high: [i64; 3],
}

impl BoxOf {
    pub fn counts(&self) -> [u64; 3] {
        [0, 1, 2].map(|axis| (self.high[axis] - self.low[axis] + 1) as u64)
    }

    fn joined(all: Option<Self>, other: Self) -> Option<Self> {
        let Some(all) = all else { return Some(other) };
        Some(Self {
            low: [0, 1, 2].map(|axis| all.low[axis].min(other.low[axis])),
            high: [0, 1, 2].map(|axis| all.high[axis].max(other.high[axis])),
        })
    }

    /// What of a box lies in this one.
    fn within(&self, other: &Self) -> Option<Self> {
        let low = [0, 1, 2].map(|axis| self.low[axis].max(other.low[axis]));
        let high = [0, 1, 2].map(|axis| self.high[axis].min(other.high[axis]));
        (0..3).all(|axis| low[axis] <= high[axis]).then_some(Self { low, high })
    }

    /// A cube of voxels.
    fn cube(origin: [i64; 3], edge: i32) -> Self {
        Self { low: origin, high: origin.map(|at| at + i64::from(edge) - 1) }
    }
}

struct Leaf<'a> {
    origin: [i64; 3],
    active: &'a [u8],
}

struct Tile {
    space: BoxOf,
    value: f32,
    active: bool,
}

/// A tree without its leaves' values.
pub(super) struct Tree<'a> {
    pub background: f32,
    value: Value,
    compression: Compression,
    leaves: Vec<Leaf<'a>>,
    tiles: Vec<Tile>,
}

/// Places of a node or leaf: x slowest, z fastest.
fn place(origin: [i64; 3], log2: u32, edge: i32, at: usize) -> [i64; 3] {
    let mask = (1usize << log2) - 1;
    let steps = [at >> (2 * log2), at >> log2 & mask, at & mask];
    [0, 1, 2].map(|axis| origin[axis] + steps[axis] as i64 * i64::from(edge))
}

impl<'a> Tree<'a> {
    /// Reads the shape of a tree: all but its leaves' values.
    pub fn read(at: &mut Bytes<'a>, value: Value, compression: Compression) -> Read<Self> {
        let buffers = at.i32()?;
        if buffers != 1 {
            return Err(Refusal::new("buffers", "1 a tree", buffers));
        }
        let background = value.full(at)?;
        let [tiles, children] = [at.u32()?, at.u32()?];
        let mut tree = Self { background, value, compression, leaves: Vec::new(), tiles: Vec::new() };
        for _ in 0..tiles {
            let origin = at.place()?.map(i64::from);
            let (value, active) = (value.full(at)?, at.u8()? != 0);
            tree.add_tile(BoxOf::cube(origin, UPPER), value, active)?;
        }
        for _ in 0..children {
            let origin = at.place()?.map(i64::from);
            tree.node(at, origin, &[(5, MIDDLE), (4, LEAF)])?;
        }
        Ok(tree)
    }

    fn add_tile(&mut self, space: BoxOf, value: f32, active: bool) -> Read<()> {
        if active || value != self.background {
            self.tiles.push(Tile { space, value, active });
            self.check_parts()?;
        }
        Ok(())
    }

    fn check_parts(&self) -> Read<()> {
        let parts = self.leaves.len() + self.tiles.len();
        if parts > MOST_PARTS {
            return Err(Refusal::new("tree", format!("at most {MOST_PARTS} leaves and tiles"), "more"));
        }
        Ok(())
    }

    /// A node, and what hangs below it: `levels` are the places along an edge (log2) and the edge of a place, outermost first.
    fn node(&mut self, at: &mut Bytes<'a>, origin: [i64; 3], levels: &[(u32, i32)]) -> Read<()> {
        let [(log2, edge), below @ ..] = levels else {
            self.leaves.push(Leaf { origin, active: at.take(64)? });
            return self.check_parts();
        };
        let count = 1usize << (3 * log2);
        let (children, active) = (at.take(count / 8)?, at.take(count / 8)?);
        let tiles = values(at, self.value, self.compression, active, self.background)?;
        for (i, &value) in tiles.iter().enumerate().filter(|&(i, _)| !is_on(children, i)) {
            self.add_tile(BoxOf::cube(place(origin, *log2, *edge, i), *edge), value, is_on(active, i))?;
        }
        for i in (0..count).filter(|&i| is_on(children, i)) {
            self.node(at, place(origin, *log2, *edge, i), below)?;
        }
        Ok(())
    }

    /// The box around all active voxels.
    pub fn active_box(&self) -> Option<BoxOf> {
        let mut all = None;
        for tile in self.tiles.iter().filter(|tile| tile.active) {
            all = BoxOf::joined(all, tile.space);
        }
        for leaf in &self.leaves {
            for i in (0..512).filter(|&i| is_on(leaf.active, i)) {
                all = BoxOf::joined(all, BoxOf::cube(place(leaf.origin, 3, 1, i), 1));
            }
        }
        all
    }

    /// Writes tiles and leaves into the box's voxels, x fastest; `at` stands where the leaves' values do.
    pub fn fill(&self, at: &mut Bytes<'_>, space: &BoxOf, voxels: &mut [f32]) -> Read<()> {
        let [nx, ny, _] = space.counts().map(|count| count as usize);
        let index = |[x, y, z]: [i64; 3]| {
            let [x, y, z] = [x - space.low[0], y - space.low[1], z - space.low[2]].map(|at| at as usize);
            x + nx * (y + ny * z)
        };
        // Tiles and leaves lie apart from one another: a file whose own overlap would cost without end.
        let mut left = voxels.len();
        let mut spend = |voxels: usize| match left.checked_sub(voxels) {
            Some(rest) => {
                left = rest;
                Ok(())
            }
            None => Err(Refusal::new("tree", "tiles and leaves beside one another", "some that overlap")),
        };
        for tile in &self.tiles {
            let Some(part) = space.within(&tile.space) else { continue };
            spend(part.counts().iter().product::<u64>() as usize)?;
            for z in part.low[2]..=part.high[2] {
                for y in part.low[1]..=part.high[1] {
                    let start = index([part.low[0], y, z]);
                    voxels[start..start + part.counts()[0] as usize].fill(tile.value);
                }
            }
        }
        for leaf in &self.leaves {
            // The mask stands before the values once more.
            let active = at.take(64)?;
            let values = values(at, self.value, self.compression, active, self.background)?;
            let Some(part) = space.within(&BoxOf::cube(leaf.origin, LEAF)) else { continue };
            spend(part.counts().iter().product::<u64>() as usize)?;
            for (i, &value) in values.iter().enumerate() {
                let voxel = place(leaf.origin, 3, 1, i);
                if space.within(&BoxOf::cube(voxel, 1)).is_some() {
                    voxels[index(voxel)] = value;
                }
            }
        }
        Ok(())
    }
}
