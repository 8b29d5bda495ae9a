//! OpenVDB files (.vdb) of a grid: file version 224, zip, leaves without light or density left out. Read back by OpenVDB itself in
//! tests (input/vdb.rs has the format's source).

use flate2::Compression;
use flate2::write::ZlibEncoder;
use glam::DVec3;
use squall_formats::GridShape;
use std::collections::BTreeMap;
use std::io::{self, Write};

/// Voxels along the edges of a leaf, of a node of 16³ leaves and of a node of 32³ of those.
const EDGES: [usize; 3] = [8, 128, 4096];
/// Places along an edge of the two kinds of nodes, log2: inner first.
const LOG2: [usize; 2] = [4, 5];

/// A grid of `C` numbers per cell that is to be written: 1 as floats, 3 as vectors.
pub struct VdbGrid<'a, const C: usize> {
    /// Its name.
    pub name: &'a str,
    /// Cells along x, y, z.
    pub shape: GridShape,
    /// Edges of a cell, m.
    pub cell_m: [f64; 3],
    /// The low corner, m.
    pub origin_m: DVec3,
    /// Values, x fastest.
    pub values: &'a [[f32; C]],
}

/// A leaf's voxels that hold something, by the leaf's place among the grid's leaves.
type Leaves<const C: usize> = BTreeMap<[usize; 3], Vec<[f32; C]>>;

/// Writes one grid. Voxels are active where they are not zero.
///
/// Errors: the writer's.
pub fn write_vdb<const C: usize>(grid: &VdbGrid<'_, C>, out: &mut dyn Write) -> io::Result<()> {
    let mut file = Vec::new();
    file.extend(b"\x20BDV\0\0\0\0");
    words(&mut file, &[224, 10, 0]);
    file.push(1);
    // The file's identifier, of its content, so that the same grid gives the same bytes.
    let hash = blake3::hash(bytemuck::cast_slice(grid.values.as_flattened())).to_hex();
    let part = |from: usize, to: usize| &hash.as_str()[from..to];
    let id = format!("{}-{}-{}-{}-{}", part(0, 8), part(8, 12), part(12, 16), part(16, 20), part(20, 32));
    file.extend(id.as_bytes());
    words(&mut file, &[0, 1]);
    text(&mut file, grid.name);
    text(&mut file, if C == 1 { "Tree_float_5_4_3" } else { "Tree_vec3s_5_4_3" });
    text(&mut file, "");
    let places_at = file.len();
    file.extend([0; 24]);

    let grid_at = file.len();
    words(&mut file, &[1]);
    head(&mut file, grid);
    let leaves = leaves_of(grid);
    topology::<C>(&mut file, &leaves)?;
    let leaves_at = file.len();
    for_leaves(&leaves, &mut |voxels| {
        file.extend(mask(voxels));
        array(&mut file, voxels)
    })?;
    for (i, place) in [grid_at, leaves_at, file.len()].into_iter().enumerate() {
        file[places_at + 8 * i..][..8].copy_from_slice(&(place as u64).to_le_bytes());
    }
    out.write_all(&file)
}

fn words(file: &mut Vec<u8>, list: &[u32]) {
    list.iter().for_each(|word| file.extend(word.to_le_bytes()));
}

fn text(file: &mut Vec<u8>, text: &str) {
    words(file, &[text.len() as u32]);
    file.extend(text.as_bytes());
}

/// What the grid is, and where its voxels stand: middles at whole numbers.
fn head<const C: usize>(file: &mut Vec<u8>, grid: &VdbGrid<'_, C>) {
    words(file, &[3]);
    for (name, value) in [("class", "fog volume"), ("name", grid.name), ("creator", "squall")] {
        text(file, name);
        text(file, "string");
        text(file, value);
    }
    text(file, "ScaleTranslateMap");
    let scale = DVec3::from_array(grid.cell_m);
    let inverse = scale.recip();
    for vector in [grid.origin_m + 0.5 * scale, scale, scale, inverse, inverse * inverse, 0.5 * inverse] {
        vector.to_array().iter().for_each(|value| file.extend(value.to_le_bytes()));
    }
}

fn leaves_of<const C: usize>(grid: &VdbGrid<'_, C>) -> Leaves<C> {
    let [nx, ny, nz] = grid.shape.to_array();
    let mut leaves = Leaves::new();
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let value = grid.values[x + nx * (y + ny * z)];
                if value.iter().all(|&part| part == 0.0) {
                    continue;
                }
                let edge = EDGES[0];
                let leaf =
                    leaves.entry([x / edge, y / edge, z / edge]).or_insert_with(|| vec![[0.0; C]; 512]);
                leaf[(x % edge * edge + y % edge) * edge + z % edge] = value;
            }
        }
    }
    leaves
}

/// The place of something within the node that holds it: x slowest.
fn place_in(at: [usize; 3], edge: usize, node: usize, log2: usize) -> usize {
    let [x, y, z] = at.map(|at| at % node / edge);
    (x << (2 * log2)) | (y << log2) | z
}

/// Nodes as the file has them: each inner node's leaves in order, by outer node, then by inner node.
fn nodes<const C: usize>(
    leaves: &Leaves<C>,
) -> BTreeMap<[usize; 3], BTreeMap<usize, BTreeMap<usize, [usize; 3]>>> {
    let mut all: BTreeMap<_, BTreeMap<usize, BTreeMap<usize, [usize; 3]>>> = BTreeMap::new();
    for &leaf in leaves.keys() {
        let at = leaf.map(|place| place * EDGES[0]);
        let outer = at.map(|at| at / EDGES[2] * EDGES[2]);
        let inner = place_in(at, EDGES[1], EDGES[2], LOG2[1]);
        let place = place_in(at, EDGES[0], EDGES[1], LOG2[0]);
        all.entry(outer).or_default().entry(inner).or_default().insert(place, leaf);
    }
    all
}

fn topology<const C: usize>(file: &mut Vec<u8>, leaves: &Leaves<C>) -> io::Result<()> {
    let nodes = nodes(leaves);
    words(file, &[1]);
    file.extend([0; 4].repeat(C));
    words(file, &[0, nodes.len() as u32]);
    for (origin, inner) in &nodes {
        words(file, &origin.map(|at| at as u32));
        node::<C>(file, LOG2[1], inner.keys())?;
        for places in inner.values() {
            node::<C>(file, LOG2[0], places.keys())?;
            places.values().for_each(|leaf| file.extend(mask(&leaves[leaf])));
        }
    }
    Ok(())
}

/// A node without tiles: which places have something below them, no active tile, no tile's value.
fn node<'a, const C: usize>(
    file: &mut Vec<u8>,
    log2: usize,
    children: impl Iterator<Item = &'a usize>,
) -> io::Result<()> {
    let count = 1 << (3 * log2);
    let mut mask = vec![0u8; count / 8];
    children.for_each(|&at| mask[at / 8] |= 1 << (at % 8));
    file.extend(mask);
    file.extend(vec![0; count / 8]);
    array(file, &vec![[0.0; C]; count])
}

fn mask<const C: usize>(voxels: &[[f32; C]]) -> Vec<u8> {
    let mut mask = vec![0u8; voxels.len() / 8];
    for (at, _) in voxels.iter().enumerate().filter(|(_, value)| value.iter().any(|&part| part != 0.0)) {
        mask[at / 8] |= 1 << (at % 8);
    }
    mask
}

fn for_leaves<const C: usize>(
    leaves: &Leaves<C>,
    each: &mut dyn FnMut(&[[f32; C]]) -> io::Result<()>,
) -> io::Result<()> {
    for inner in nodes(leaves).values() {
        for places in inner.values() {
            places.values().try_for_each(|leaf| each(&leaves[leaf]))?;
        }
    }
    Ok(())
}

/// All values of a node: zipped where that is shorter.
fn array<const C: usize>(file: &mut Vec<u8>, values: &[[f32; C]]) -> io::Result<()> {
    const ALL_VALUES: u8 = 6;
    file.push(ALL_VALUES);
    let plain: Vec<u8> = values.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
    packed.write_all(&plain)?;
    let packed = packed.finish()?;
    if packed.len() < plain.len() {
        file.extend((packed.len() as i64).to_le_bytes());
        file.extend(packed);
    } else {
        file.extend((-(plain.len() as i64)).to_le_bytes());
        file.extend(plain);
    }
    Ok(())
}
