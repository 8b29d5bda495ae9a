//! Light read and worked out from SPEC.md's words alone, beside the runtime's: container, `CLDG`, `CLRT`, the inverse Haar
//! transform, weights, harmonics and direct light. Nothing here calls the project's readers.

use crate::root;
use glam::DVec3;
use squall_runtime::Asset;
use squall_runtime::relight::{PointLight, RelightBuffers, RelightOptions, Relighter};
use squall_runtime::single_scatter::{DirectRays, DirectSettings, add_direct};
use std::f64::consts::PI;

/// Bytes and how far they have been read.
struct Bytes<'a>(&'a [u8], usize);

impl Bytes<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let part = self.0[self.1..self.1 + N].try_into().unwrap();
        self.1 += N;
        part
    }
    fn u8(&mut self) -> u8 {
        self.take::<1>()[0]
    }
    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }
    fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.take())
    }
    fn f32(&mut self) -> f32 {
        f32::from_le_bytes(self.take())
    }
    fn f64(&mut self) -> f64 {
        f64::from_le_bytes(self.take())
    }
    fn list(&mut self) -> Vec<f64> {
        (0..self.u64()).map(|_| self.f64()).collect()
    }
}

/// §1: the bytes of a section and its version.
fn section<'a>(file: &'a [u8], tag: &[u8; 4]) -> (&'a [u8], u16) {
    let count = Bytes(file, 12).u32() as usize;
    let line = (0..count).map(|i| 64 + 48 * i).find(|&at| &file[at..at + 4] == tag).unwrap();
    let (offset, length) = (Bytes(file, line + 8).u64() as usize, Bytes(file, line + 16).u64() as usize);
    (&file[offset..offset + length], u16::from_le_bytes([file[line + 4], file[line + 5]]))
}

/// §3: where the arrays behind the metadata begin.
fn behind_metadata(section: &[u8]) -> usize {
    (8 + Bytes(section, 0).u64() as usize).next_multiple_of(64)
}

struct Grid {
    counts: [usize; 3],
    cell: [f64; 3],
    origin: [f64; 3],
    g: f64,
    extinction: Vec<f64>,
}

impl Grid {
    fn read(file: &[u8]) -> Self {
        let (part, version) = section(file, b"CLDG");
        let mut at = Bytes(part, 8);
        let counts = [0; 3].map(|_| at.u32() as usize);
        let cell = [0; 3].map(|_| at.f64());
        let origin = [0; 3].map(|_| at.f64());
        let (_albedo, g, periodic) = (at.f64(), at.f64(), at.u8());
        assert_eq!(periodic, 0);
        let cells: usize = counts.iter().product();
        let mut bulk = Bytes(part, behind_metadata(part));
        let extinction = match version {
            1 => (0..cells).map(|_| f64::from(bulk.f32())).collect(),
            // A bit a cell, and a number for each that is set.
            2 => {
                let filled = at.u32() as usize;
                let bits = &part[behind_metadata(part)..][..cells.div_ceil(32) * 4];
                assert_eq!(filled, bits.iter().map(|byte| byte.count_ones() as usize).sum::<usize>());
                let mut values = Bytes(part, behind_metadata(part) + bits.len());
                let value = |cell: usize| match bits[cell / 8] >> (cell % 8) & 1 {
                    1 => f64::from(values.f32()),
                    _ => 0.0,
                };
                (0..cells).map(value).collect()
            }
            version => panic!("CLDG of version {version}"),
        };
        Self { counts, cell, origin, g, extinction }
    }

    fn low(&self, index: usize) -> [f64; 3] {
        let [nx, ny, _] = self.counts;
        let cell = [index % nx, index / nx % ny, index / nx / ny];
        [0, 1, 2].map(|k| self.origin[k] + self.cell[k] * cell[k] as f64)
    }

    /// Optical depth between two points: the sorted crossings of all planes between cells, and what lies between them.
    fn depth(&self, from: [f64; 3], to: [f64; 3]) -> f64 {
        let mut crossings = vec![0.0, 1.0];
        for k in 0..3 {
            for plane in 0..=self.counts[k] {
                let t = (self.origin[k] + self.cell[k] * plane as f64 - from[k]) / (to[k] - from[k]);
                if t > 0.0 && t < 1.0 {
                    crossings.push(t);
                }
            }
        }
        crossings.sort_by(f64::total_cmp);
        let length: f64 = (0..3).map(|k| (to[k] - from[k]) * (to[k] - from[k])).sum::<f64>().sqrt();
        let mut depth = 0.0;
        for pair in crossings.windows(2) {
            let middle = 0.5 * (pair[0] + pair[1]);
            let at = [0, 1, 2]
                .map(|k| ((from[k] + middle * (to[k] - from[k]) - self.origin[k]) / self.cell[k]).floor());
            if (0..3).all(|k| at[k] >= 0.0 && at[k] < self.counts[k] as f64) {
                let [x, y, z] = at.map(|v| v as usize);
                let index = x + self.counts[0] * (y + self.counts[1] * z);
                depth += self.extinction[index] * length * (pair[1] - pair[0]);
            }
        }
        depth
    }
}

/// What of `CLRT` the test needs.
struct Response {
    axes: [Vec<f64>; 3],
    node_rows: Vec<u32>,
    scale: f64,
    /// By row, then coefficient: Haar coefficients of every cell.
    rows: Vec<Vec<Vec<f64>>>,
}

impl Response {
    /// Version 1, harmonics of degree 1, direct light left to the reader, codec bytes: what the golden asset has.
    fn read(file: &[u8], cells: usize) -> Self {
        let (part, version) = section(file, b"CLRT");
        let mut at = Bytes(part, 8);
        let shape: usize = (0..3).map(|_| at.u32() as usize).product();
        assert_eq!((version, shape, at.u32()), (1, cells, 0));
        let axes = [0; 3].map(|_| at.list());
        let node_rows: Vec<u32> = (0..at.u64()).map(|_| at.u32()).collect();
        let distant = at.u64();
        for _ in 0..distant {
            if at.u32() == 2 {
                at.take::<24>();
            }
            at.u32();
        }
        assert_eq!((at.u32(), at.u8(), at.u32(), at.u32()), (1, 1, 1, 1));
        at.take::<14>();
        at.u32();
        let scale = at.f64();
        let (k, c) = (node_rows.iter().filter(|&&row| row != u32::MAX).count() + distant as usize, 4);
        let tables = behind_metadata(part);
        let rows_at = (tables + 16 * k + 8 * k * c).next_multiple_of(64);
        let rows = (0..k).map(|row| {
            let offset = Bytes(part, tables + 16 * row).u64() as usize;
            row_coefficients(part, rows_at + offset, c, cells)
        });
        let rows = rows.collect();
        Self { axes, node_rows, scale, rows }
    }

    /// "Weights": rows and what a light of 1 W/sr gives each.
    fn weights(&self, point: [f64; 3]) -> Vec<(usize, f64)> {
        let mut parts = vec![(0, 1.0, 1)];
        for k in 0..3 {
            let axis = &self.axes[k];
            let high = axis.iter().position(|&node| node > point[k]).unwrap();
            let share = (point[k] - axis[high - 1]) / (axis[high] - axis[high - 1]);
            let split = |&(node, weight, stride): &(usize, f64, usize)| {
                [
                    (node + (high - 1) * stride, weight * (1.0 - share), stride * axis.len()),
                    (node + high * stride, weight * share, stride * axis.len()),
                ]
            };
            parts = parts.iter().flat_map(split).collect();
        }
        parts.into_iter().map(|(node, weight, _)| (self.node_rows[node] as usize, weight)).collect()
    }
}

/// "Row", codec bytes.
fn row_coefficients(part: &[u8], at: usize, c: usize, cells: usize) -> Vec<Vec<f64>> {
    let mut head = Bytes(part, at);
    let mut stream = Bytes(part, at + 12 * c);
    let read = (0..c).map(|_| {
        let mut values = vec![0.0; cells];
        values[0] = f64::from(head.f32());
        let (step, length) = (f64::from(head.f32()), head.u32() as usize);
        let (end, mut index) = (stream.1 + length, 0);
        while stream.1 < end {
            index += usize::from(stream.u8()) + 1;
            let value = stream.u8() as i8;
            values[index] = if value == -128 { f64::from(stream.f32()) } else { f64::from(value) * step };
        }
        values
    });
    read.collect()
}

/// "Transform", backward.
fn untransformed(mut values: Vec<f64>, counts: [usize; 3]) -> Vec<f64> {
    let levels = counts.map(|n| {
        let mut sizes = vec![n];
        while *sizes.last().unwrap() > 1 {
            sizes.push(sizes.last().unwrap().div_ceil(2));
        }
        sizes
    });
    let deepest = levels.iter().map(Vec::len).max().unwrap() - 1;
    let size = |axis: usize, level: usize| levels[axis].get(level).copied().unwrap_or(1);
    let strides = [1, counts[0], counts[0] * counts[1]];
    for level in (0..deepest).rev() {
        for axis in [2, 1, 0] {
            let n = size(axis, level);
            if n == 1 {
                continue;
            }
            let others = [(axis + 1) % 3, (axis + 2) % 3];
            for i in 0..size(others[0], level) {
                for j in 0..size(others[1], level) {
                    let base = i * strides[others[0]] + j * strides[others[1]];
                    unpair(&mut values, base, strides[axis], n, (1 << level, counts[axis]));
                }
            }
        }
    }
    values
}

/// One line of `n` entries: means and differences back to neighbours. `whole` is how many cells an entry stands for.
fn unpair(values: &mut [f64], base: usize, stride: usize, n: usize, (whole, count): (usize, usize)) {
    let stands_for = |entry: usize| (count - entry * whole).min(whole) as f64;
    let means = n.div_ceil(2);
    let line: Vec<f64> = (0..n).map(|i| values[base + i * stride]).collect();
    for i in 0..means {
        if 2 * i + 1 == n {
            values[base + 2 * i * stride] = line[i];
            continue;
        }
        let (u, v) = (stands_for(2 * i), stands_for(2 * i + 1));
        let (c, s) = ((u / (u + v)).sqrt(), (v / (u + v)).sqrt());
        let (mean, difference) = (line[i], line[means + i]);
        values[base + 2 * i * stride] = c * mean - s * difference;
        values[base + (2 * i + 1) * stride] = s * mean + c * difference;
    }
}

fn phase(a: f64, cos: f64) -> f64 {
    let base = 1.0 + a * a - 2.0 * a * cos;
    (1.0 - a * a) / (4.0 * PI * base * base.sqrt())
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// "Direct light": the cell's mean, by midpoints of so many parts along each axis; and the same with one phase function for
/// all that the scaled medium counts as unscattered.
fn direct(grid: &Grid, scale: f64, light: [f64; 3], cell: usize, towards: [f64; 3]) -> [f64; 2] {
    const PARTS: usize = 12;
    let (low, g) = (grid.low(cell), grid.g);
    let mut sums = [0.0; 2];
    for part in 0..PARTS * PARTS * PARTS {
        let index = [part % PARTS, part / PARTS % PARTS, part / PARTS / PARTS];
        let at = [0, 1, 2].map(|k| low[k] + grid.cell[k] * (index[k] as f64 + 0.5) / PARTS as f64);
        let offset = [0, 1, 2].map(|k| at[k] - light[k]);
        let square = dot(offset, offset);
        let cos = dot(offset, towards) / square.sqrt();
        let depth = grid.depth(light, at);
        let (open, scaled) = (libm::exp(-depth), libm::exp(-scale * depth));
        sums[0] += (phase(g, cos) * open + phase(g * g, cos) * (scaled - open)) / square;
        sums[1] += phase(g, cos) * scaled / square;
    }
    sums.map(|sum| sum / (PARTS * PARTS * PARTS) as f64)
}

const VIEWPOINT: [f64; 3] = [600.0, -900.0, 80.0];
const LIGHTS: [([f64; 3], f64); 3] =
    [([-61.0, 22.0, 651.0], 7.0), ([103.0, -48.0, 667.0], 3.0), ([12.0, 71.0, 480.0], 11.0)];
/// Midpoints beside a light leave some per cent in its neighbours' cells, and few of the runtime's rays get to the darkest: a
/// single cell may differ by this share of its J and of a hundredth of the brightest.
const CELL: f64 = 0.05;
/// And all of them together, as a root of the sum of squares.
const TOGETHER: f64 = 0.02;
/// Rows alone hold nothing but single precision.
const ROWS: f64 = 1e-5;

fn unit_to_viewpoint(grid: &Grid, cell: usize) -> [f64; 3] {
    let low = grid.low(cell);
    let offset = [0, 1, 2].map(|k| VIEWPOINT[k] - (low[k] + 0.5 * grid.cell[k]));
    offset.map(|v| v / dot(offset, offset).sqrt())
}

#[test]
fn light_worked_out_from_the_specifications_words_is_the_runtimes() {
    let path = root().join("data/golden/v1/golden.squall");
    let file = std::fs::read(&path).unwrap();
    let grid = Grid::read(&file);
    let cells = grid.extinction.len();
    let response = Response::read(&file, cells);

    let asset = Asset::open(&path).unwrap();
    let relighter = Relighter::new(&asset).unwrap();
    let lights = LIGHTS.map(|(at, intensity)| PointLight { position: DVec3::from_array(at), intensity });
    let mut buffers = RelightBuffers::default();
    let relit = relighter.relight(&lights, RelightOptions::default(), &mut buffers).unwrap();
    let to_viewer: Vec<[f32; 3]> =
        (0..cells).map(|cell| unit_to_viewpoint(&grid, cell).map(|v| v as f32)).collect();
    let mut rays = vec![0.0; cells];
    let settings = DirectSettings { rays: DirectRays::PerPoint(400_000), seed: 3 };
    add_direct(relighter.cloud(), relighter.extinction_scale(), &lights, &to_viewer, settings, &mut rays);

    // Rows: Haar coefficients summed with their weights, then each plane transformed back.
    let planes: Vec<Vec<f64>> = (0..4)
        .map(|coefficient| {
            let mut sum = vec![0.0; cells];
            for (at, intensity) in LIGHTS {
                for (row, weight) in response.weights(at) {
                    for (sum, value) in sum.iter_mut().zip(&response.rows[row][coefficient]) {
                        *sum += intensity * weight * value;
                    }
                }
            }
            untransformed(sum, grid.counts)
        })
        .collect();

    let mut pairs = Vec::new();
    let (mut compared, mut off, mut whole, mut off_with_one_phase) = (0, 0.0, 0.0, 0.0);
    let mut factors = Vec::new();
    for cell in (0..cells).filter(|&cell| grid.extinction[cell] > 0.0) {
        let towards = unit_to_viewpoint(&grid, cell);
        let [x, y, z] = towards;
        let harmonics = [(1.0 / (4.0 * PI)).sqrt(), (3.0 / (4.0 * PI)).sqrt()];
        let basis = [harmonics[0], harmonics[1] * y, harmonics[1] * z, harmonics[1] * x];
        let rows: f64 = (0..4).map(|i| basis[i] * planes[i][cell]).sum();
        let centre = DVec3::from_array([0, 1, 2].map(|k| grid.low(cell)[k] + 0.5 * grid.cell[k]));
        relit.factors(centre, DVec3::from_array(towards), &mut factors);
        let found = f64::from(relit.value(cell, &factors));
        let largest = planes[0].iter().fold(0.0f64, |largest, v| largest.max(v.abs()));
        assert!((rows - found).abs() < ROWS * largest, "cell {cell}: {rows} from words, {found}");

        // A light inside the cell is no matter of midpoints.
        let low = grid.low(cell);
        let holds = |at: [f64; 3]| (0..3).all(|k| (0.0..=grid.cell[k]).contains(&(at[k] - low[k])));
        if LIGHTS.iter().any(|&(at, _)| holds(at)) {
            continue;
        }
        let direct = LIGHTS.iter().fold([0.0; 2], |sum, &(at, intensity)| {
            let part = direct(&grid, response.scale, at, cell, towards);
            [sum[0] + intensity * part[0], sum[1] + intensity * part[1]]
        });
        let (wanted, found) = (rows + direct[0], found + f64::from(rays[cell]));
        pairs.push((cell, wanted, found));
        compared += 1;
        whole += wanted * wanted;
        off += (found - wanted) * (found - wanted);
        off_with_one_phase += (found - rows - direct[1]) * (found - rows - direct[1]);
    }
    assert!(compared >= 25, "{compared} cells");
    let brightest = pairs.iter().fold(0.0f64, |brightest, pair| brightest.max(pair.1));
    for (cell, wanted, found) in pairs {
        let allowed = CELL * (wanted + 0.01 * brightest);
        assert!((found - wanted).abs() < allowed, "cell {cell}: J {wanted} from words, {found}");
    }
    let (off, one_phase) = ((off / whole).sqrt(), (off_with_one_phase / whole).sqrt());
    assert!(off < TOGETHER, "{off} over {compared} cells");
    // The test can tell: with the cloud's phase function for all of it, J is another.
    assert!(one_phase > 10.0 * TOGETHER, "{one_phase}");
    println!("{compared} cells: {off:.2e} off; with one phase function {one_phase:.2}");
}

#[test]
fn a_grid_read_by_the_specifications_words_is_the_runtimes_in_both_versions() {
    for (name, wanted) in [("v1/golden", 1), ("v5/fit", 2)] {
        let path = root().join(format!("data/golden/{name}.squall"));
        let file = std::fs::read(&path).unwrap();
        assert_eq!(section(&file, b"CLDG").1, wanted, "{name}");
        let cloud = Relighter::new(&Asset::open(&path).unwrap()).unwrap().cloud().clone();
        let runtime: Vec<f64> = cloud.extinction.iter().map(|&value| f64::from(value)).collect();
        assert_eq!(Grid::read(&file).extinction, runtime, "{name}");
    }
}
