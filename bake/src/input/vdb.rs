//! OpenVDB files (.vdb): sparse trees of voxels, read into a dense box. Read by ourselves: the Rust readers that exist give wrong
//! numbers for half precision with masks, without an error.
//!
//! What is read: file versions 222 to 224 (OpenVDB 2 and later), trees of 5, 4 and 3 levels of float, double or half values (also
//! float saved as half), tiles, active masks, zip, Blosc with LZ4 or zlib, any axis-aligned transform, instances. Refused with what
//! is there: level sets, vectors and other values, point data, rotated or frustum transforms.
//!
//! | file | holds |
//! |---|---|
//! | `bytes.rs` | reads numbers within bounds |
//! | `header.rs` | what grids a file has and where each lies |
//! | `codec.rs` | zip, Blosc, and arrays whose inactive values are left out |
//! | `tree.rs` | nodes, leaves and tiles |
//! | `transform.rs` | from voxels to metres |
//!
//! Source: openvdb/io/{Archive,Compression,GridDescriptor}.cc and openvdb/tree/{RootNode,InternalNode,LeafNode}.h; Blosc 1's chunk format.

mod bytes;
mod codec;
mod header;
mod transform;
mod tree;

#[cfg(test)]
mod tests;

use super::Input;
use super::volume::{MAX_CELLS, Volume};
use crate::error::BakeError;
use bytes::Bytes;
use glam::DVec3;
use header::{GridHeader, Grids};
use squall_formats::GridShape;
use tree::{BoxOf, Tree};

/// What was wanted and what was found, with the field.
pub(super) struct Refusal {
    field: String,
    wanted: String,
    found: String,
}

impl Refusal {
    fn new(field: &str, wanted: impl ToString, found: impl ToString) -> Self {
        Self { field: format!("vdb {field}"), wanted: wanted.to_string(), found: found.to_string() }
    }
}

type Read<T> = Result<T, Refusal>;

/// Which way is up in a file's own axes. Squall's is z.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Up {
    /// As here, and in Blender.
    #[default]
    Z,
    /// As in Houdini, Maya and Unity: (x, y, z) becomes (x, −z, y).
    Y,
}

/// Whether the file begins as OpenVDB's do.
pub fn is_vdb(input: &Input) -> bool {
    input.bytes.starts_with(&header::MAGIC)
}

/// Reads the grid called `name`, or the only float grid (else the one called "density") where no name is given: the box around its
/// active voxels, inactive ones within it included, as `copyToArray` of OpenVDB gives them. One unit of the file is
/// `metres_per_unit` m.
///
/// Errors: what the module's head lists, no such grid, no active voxel, a box of more than 2²⁸ voxels, bytes that are cut or
/// contradict themselves; the values are checked by the caller.
pub fn read_vdb(
    input: &Input,
    name: Option<&str>,
    up: Up,
    metres_per_unit: f64,
) -> Result<Volume, BakeError> {
    let refuse =
        |refusal: Refusal| BakeError::input(&input.path, refusal.field, refusal.wanted, refusal.found);
    read(&input.bytes, name, up, metres_per_unit).map_err(refuse)
}

fn read(bytes: &[u8], name: Option<&str>, up: Up, metres_per_unit: f64) -> Read<Volume> {
    let grids = Grids::read(bytes)?;
    let chosen = grids.choose(name)?;
    let grid = GridHeader::read(bytes, chosen)?;
    grid.refuse_level_sets(&chosen.shown_name())?;
    let to_world = grid.transform.to_world(up, metres_per_unit)?;
    // An instance has its own place, and another grid's voxels.
    let (holder, head) = match grids.parent_of(chosen)? {
        None => (chosen, grid),
        Some(parent) => (parent, GridHeader::read(bytes, parent)?),
    };
    let mut at = Bytes::new(bytes, head.tree_at)?;
    let tree = Tree::read(&mut at, holder.value, head.compression)?;
    let Some(space) = tree.active_box() else {
        return Err(Refusal::new("grid", "active voxels", format!("none in {}", chosen.shown_name())));
    };
    let [nx, ny, nz] = space.counts();
    let count = nx.checked_mul(ny).and_then(|area| area.checked_mul(nz));
    let Some(count) = count.filter(|&count| count <= MAX_CELLS as u64) else {
        return Err(Refusal::new(
            "grid",
            "at most 2^28 voxels around the active ones",
            format!("{nx} × {ny} × {nz}"),
        ));
    };
    let mut voxels = vec![tree.background; count as usize];
    let mut leaves = Bytes::new(bytes, head.leaves_at)?;
    tree.fill(&mut leaves, &space, &mut voxels)?;
    Ok(turned(&voxels, &space, &to_world))
}

/// The box with the world's axes, x fastest.
fn turned(voxels: &[f32], space: &BoxOf, to_world: &transform::ToWorld) -> Volume {
    let counts = space.counts().map(|count| count as usize);
    let mut shape = [0usize; 3];
    let mut cell_m = [0.0; 3];
    let mut origin = [0.0; 3];
    for axis in 0..3 {
        let from = to_world.axes[axis];
        let scale = to_world.scale[axis];
        shape[axis] = counts[from];
        cell_m[axis] = scale.abs();
        // Voxels' middles stand at whole numbers.
        let ends = [space.low[from] as f64 - 0.5, space.high[from] as f64 + 0.5];
        let ends = ends.map(|end| to_world.offset[axis] + scale * end);
        origin[axis] = ends[0].min(ends[1]);
    }
    let strides = [1, counts[0], counts[0] * counts[1]];
    let place = |axis: usize, at: usize| {
        let at = if to_world.scale[axis] < 0.0 { shape[axis] - 1 - at } else { at };
        at * strides[to_world.axes[axis]]
    };
    let mut values = Vec::with_capacity(voxels.len());
    for z in 0..shape[2] {
        for y in 0..shape[1] {
            let row = place(2, z) + place(1, y);
            values.extend((0..shape[0]).map(|x| voxels[row + place(0, x)]));
        }
    }
    let [nx, ny, nz] = shape.map(|count| count as u32);
    Volume { shape: GridShape::new(nx, ny, nz), cell_m, origin_m: DVec3::from_array(origin), values }
}
