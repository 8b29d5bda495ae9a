//! `CLRT` v2: what a cloud does with the light of virtual sources. Bytes: SPEC.md, "CLRT".
//!
//! A row belongs to one virtual source and holds, per channel of direction, the Haar coefficients of the cloud's
//! answer to a source of unit strength. Rows are contiguous and found through an index, so that a reader touches only
//! the sources that a stroke needs.

mod stream;

pub use stream::{CHANNEL_BYTES, Channel, ESCAPE, StreamWriter, accumulate, channels, check_stream};

use crate::container::{OutSection, checksum};
use crate::error::{Limits, ReadError};
use crate::grid::GridShape;
use crate::meta;
use crate::section::{Tag, check_version, join_head, split_head};
use crate::sphere;
use crate::view_region::{MAX_VIEW_DEGREE, ViewRegion, view_functions};
use serde::{Deserialize, Serialize};

/// Which virtual sources the rows belong to. More kinds may follow in later versions of the section.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum SourceBasis {
    /// Point lamps of 1 W/sr at the nodes of a rectilinear grid; a light between nodes is split trilinearly
    /// (\[dobashi\] eq. 6), so that no intensity is lost.
    LightGrid {
        /// Node coordinates along x, rising, m.
        x_m: Vec<f64>,
        /// Node coordinates along y, rising, m.
        y_m: Vec<f64>,
        /// Node coordinates along z, rising, m.
        z_m: Vec<f64>,
        /// Row of each node, x fastest; `u32::MAX` where none was baked.
        rows: Vec<u32>,
    },
}

/// Light from far away that fills the space around the cloud.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum DistantKind {
    /// Radiance 1 W/(m² sr) from every direction above the horizon.
    UpperSky,
    /// Radiance 1 W/(m² sr) from every direction below the horizon.
    LowerSky,
    /// A beam of irradiance 1 W/m² across it, a low sun for instance.
    Beam {
        /// Unit direction of travel.
        direction: [f64; 3],
    },
}

/// A row that belongs to distant light; it holds all of that light, direct light included.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DistantSource {
    /// Which light.
    pub kind: DistantKind,
    /// Its row.
    pub row: u32,
}

/// No row for this node.
pub const NO_ROW: u32 = u32::MAX;

/// What the channels of a row mean: a basis of J, the light scattered per unit of scattering coefficient and
/// steradian, ∫ p(ω·ω') L(ω') dω'.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DirectionalBasis {
    /// J in the 26 directions of [`sphere::directions_26`], read between by [`sphere::interpolate_26`].
    Directions26,
    /// J's coefficients on the real orthonormal harmonics of degree 0 to `degree`, in [`sphere::harmonics`]' order.
    Harmonics {
        /// Highest degree, 0 to 3.
        degree: u8,
    },
    /// J towards the eyes of [`ResponseHead::view_region`] alone: its coefficients on the polynomials of [`crate::view_region::ViewRegionFrame`].
    ViewRegion {
        /// Highest degree, 0 to 2.
        degree: u8,
    },
}

impl DirectionalBasis {
    /// Number of channels.
    pub fn count(self) -> usize {
        match self {
            Self::Directions26 => 26,
            Self::Harmonics { degree } => sphere::harmonic_count(usize::from(degree)),
            Self::ViewRegion { degree } => view_functions(degree),
        }
    }
}

/// Which light the rows hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DirectTerm {
    /// All of it, light scattered once from the source included, as in \[dobashi\].
    InRows,
    /// What was scattered beyond the delta-scaled medium's unscattered light; the runtime works out the rest from the
    /// stroke itself.
    AtRunTime,
}

/// How coefficients are stored. More kinds may follow in later versions of the section.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Codec {
    /// \[dobashi\] §6: every coefficient above the threshold as index u32 and value f32.
    Paper,
    /// Gap and dead-zone quantised value, a byte each; rare large ones escape to f32.
    Bytes,
}

/// How a cell's mean flux is carried to its faces (runtime: `transport::sweep`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SweepScheme {
    /// Second order in thin cells, never negative in thick ones.
    Weighted,
    /// Second order everywhere; oscillates in thick cells.
    Diamond,
    /// First order, never negative.
    Step,
}

/// The discretisation that the rows were solved with, for run-time sweeps that match it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SolverRecord {
    /// Solve cells per stored cell along x, y, z.
    pub refine: [u32; 3],
    /// Polar nodes per hemisphere and azimuths of a double-Gauss set, or `[0, n]` for Lebedev's set of n.
    pub directions: [u8; 2],
    /// Scheme of the sweeps.
    pub scheme: SweepScheme,
    /// Extinction after delta scaling over extinction before, 1 − ωf, in (0, 1]: light that the transport counted as
    /// unscattered is not in the rows, so whoever works out direct light must count it there.
    pub extinction_scale: f64,
    /// Residual asked of every solve.
    pub tolerance: f64,
    /// Largest residual that was left.
    pub worst_residual: f64,
    /// Most sweeps that a batch took.
    pub most_sweeps: u32,
}

/// Everything about a response but its coefficients.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResponseHead {
    /// Cells that the rows describe; the grid of section `CLDG` or one that divides it.
    pub shape: GridShape,
    /// Which sources.
    pub sources: SourceBasis,
    /// Rows of distant light.
    pub distant: Vec<DistantSource>,
    /// Which directions.
    pub channels: DirectionalBasis,
    /// Whether direct light is inside.
    pub direct: DirectTerm,
    /// How coefficients lie.
    pub codec: Codec,
    /// How they were solved for.
    pub solver: SolverRecord,
    /// Where eyes may stand; anywhere where absent. From elsewhere the rows' light means nothing. New in version 2.
    pub view_region: Option<ViewRegion>,
    /// Which cells' light means something, a bit each, lowest first; all where absent. New in version 2: in a section of version 1
    /// it may be only the cells with extinction and those that touch one.
    pub seen: Option<Vec<u8>>,
}

impl ResponseHead {
    /// Whether the rows' light in cell `cell` means something.
    pub fn sees(&self, cell: usize) -> bool {
        self.seen
            .as_ref()
            .is_none_or(|seen| seen.get(cell / 8).is_some_and(|byte| byte >> (cell % 8) & 1 == 1))
    }
}

/// A bit a cell, lowest first, for [`ResponseHead::seen`].
pub fn pack_seen(seen: &[bool]) -> Vec<u8> {
    let byte =
        |cells: &[bool]| cells.iter().enumerate().fold(0, |byte, (bit, &seen)| byte | u8::from(seen) << bit);
    seen.chunks(8).map(byte).collect()
}

/// [`ResponseHead`] as version 1 has it.
#[derive(Deserialize)]
struct HeadV1 {
    shape: GridShape,
    sources: SourceBasis,
    distant: Vec<DistantSource>,
    channels: DirectionalBasis,
    direct: DirectTerm,
    codec: Codec,
    solver: SolverRecord,
}

impl HeadV1 {
    fn newest(self) -> Result<ResponseHead, ReadError> {
        let Self { shape, sources, distant, channels, direct, codec, solver } = self;
        if let DirectionalBasis::ViewRegion { .. } = channels {
            return Err(invalid("channels", "those of version 1", format!("{channels:?}")));
        }
        Ok(ResponseHead {
            shape,
            sources,
            distant,
            channels,
            direct,
            codec,
            solver,
            view_region: None,
            seen: None,
        })
    }
}

/// Where a row lies, and how far it may be off.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct RowEntry {
    /// Start, from the first row's.
    pub offset: u64,
    /// Length, bytes.
    pub length: u32,
    /// CRC-32 of the row.
    pub checksum: u32,
}

/// How far the stored channel of a source of unit strength is from what was solved, as an L2 norm over cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct ChannelBound {
    /// γ of \[dobashi\] §6: root of the sum of squares of the coefficients left out.
    pub discarded: f32,
    /// Root of the sum of squares of what quantising changed in those that were kept.
    pub quantised: f32,
}

impl ChannelBound {
    /// γ + q.
    pub fn total(self) -> f32 {
        self.discarded + self.quantised
    }
}

/// A cloud response: a view into the asset's bytes.
#[derive(Clone, Debug)]
pub struct ResponseSection<'a> {
    /// Version that it was written in.
    pub version: u16,
    /// What the rows mean.
    pub head: ResponseHead,
    /// One entry a row.
    pub index: &'a [RowEntry],
    /// One bound a row and channel, channels innermost.
    pub bounds: &'a [ChannelBound],
    /// All rows.
    pub rows: &'a [u8],
}

impl<'a> ResponseSection<'a> {
    /// The section's tag.
    pub const TAG: Tag = Tag(*b"CLRT");
    /// Version that this build writes, and the newest that it reads.
    pub const VERSION: u16 = 2;

    /// Reads head, index and bounds, and views the rows; those are bulk, each with a checksum of its own.
    pub fn read(bytes: &'a [u8], version: u16, limits: &Limits) -> Result<Self, ReadError> {
        check_version(Self::TAG, version, Self::VERSION)?;
        let (head, rest) = split_head(Self::TAG, bytes)?;
        let head: ResponseHead = match version {
            1 => meta::decode::<HeadV1>(Self::TAG, head, limits)?.newest()?,
            _ => meta::decode(Self::TAG, head, limits)?,
        };
        let cells = head.shape.checked_len().filter(|&cells| cells as u64 <= limits.cells);
        if cells.is_none() {
            return Err(invalid("shape", "1 cell to the limit", format!("{:?}", head.shape)));
        }
        if let DirectionalBasis::Harmonics { degree: 4.. } = head.channels {
            return Err(invalid("channels", "degree 0 to 3", format!("{:?}", head.channels)));
        }
        check_view_region(&head)?;
        if head.solver.refine.iter().any(|&factor| factor == 0 || factor > 64) {
            return Err(invalid("refine", "1 to 64", format!("{:?}", head.solver.refine)));
        }
        let scale = head.solver.extinction_scale;
        if !(scale > 0.0 && scale <= 1.0) {
            return Err(invalid("extinction scale", "above 0, at most 1", scale.to_string()));
        }
        let SourceBasis::LightGrid { x_m, y_m, z_m, rows: node_rows } = &head.sources;
        for axis in [x_m, y_m, z_m] {
            let rising = axis.windows(2).all(|pair| pair[0] < pair[1]);
            if axis.is_empty() || !rising || !axis.iter().all(|v| v.is_finite()) {
                return Err(invalid(
                    "lamp grid axis",
                    "rising finite metres",
                    format!("{} nodes", axis.len()),
                ));
            }
        }
        let nodes = (x_m.len() as u64).saturating_mul(y_m.len() as u64).saturating_mul(z_m.len() as u64);
        if nodes != node_rows.len() as u64 || nodes > limits.sources {
            return Err(invalid("lamp grid rows", "one a node", format!("{} for {nodes}", node_rows.len())));
        }
        let listed = || {
            let lights = node_rows.iter().copied().filter(|&row| row != NO_ROW);
            lights.chain(head.distant.iter().map(|source| source.row))
        };
        let count = listed().count();
        let mut seen = vec![false; count];
        for row in listed() {
            match seen.get_mut(row as usize) {
                Some(slot) if !*slot => *slot = true,
                _ => return Err(invalid("rows of sources", "each row once", row.to_string())),
            }
        }
        for source in &head.distant {
            if let DistantKind::Beam { direction } = source.kind {
                let length: f64 = direction.iter().map(|v| v * v).sum();
                if !(1.0 - 1e-6..1.0 + 1e-6).contains(&length) {
                    return Err(invalid("beam direction", "a unit vector", format!("{direction:?}")));
                }
            }
        }
        let channels = head.channels.count();
        // In 64 bits: on a 32-bit machine a hostile count could wrap around.
        let index_bytes = count as u64 * size_of::<RowEntry>() as u64;
        let bounds_bytes = (count * channels) as u64 * size_of::<ChannelBound>() as u64;
        let rows_start = (index_bytes + bounds_bytes).next_multiple_of(64);
        if (rest.len() as u64) < rows_start {
            let missing = rows_start - rest.len() as u64;
            return Err(ReadError::Truncated { section: Self::TAG, offset: bytes.len() as u64, missing });
        }
        let [index_bytes, bounds_bytes, rows_start] =
            [index_bytes, bounds_bytes, rows_start].map(|length| length as usize);
        let cast = |error: bytemuck::PodCastError| invalid("index", "an aligned array", error.to_string());
        let index: &[RowEntry] = bytemuck::try_cast_slice(&rest[..index_bytes]).map_err(cast)?;
        let bounds: &[ChannelBound] =
            bytemuck::try_cast_slice(&rest[index_bytes..index_bytes + bounds_bytes]).map_err(cast)?;
        if rest[index_bytes + bounds_bytes..rows_start].iter().any(|&b| b != 0) {
            return Err(invalid("padding before the rows", "zero", "something else".into()));
        }
        let rows = &rest[rows_start..];
        let mut end = 0u64;
        for entry in index {
            if entry.offset != end {
                return Err(invalid("row offset", "the end of the row before", entry.offset.to_string()));
            }
            end = end.saturating_add(u64::from(entry.length));
        }
        if end != rows.len() as u64 {
            return Err(invalid("rows", "as long as the index says", format!("{} for {end}", rows.len())));
        }
        if !bounds.iter().all(|b| b.total().is_finite() && b.discarded >= 0.0 && b.quantised >= 0.0) {
            return Err(invalid("error bounds", "finite and not negative", "something else".into()));
        }
        Ok(Self { version, head, index, bounds, rows })
    }

    /// Number of virtual sources.
    pub fn row_count(&self) -> usize {
        self.index.len()
    }

    /// Length of section bytes that are checked on opening: everything before the rows.
    pub fn head_length(&self, section_length: u64) -> u64 {
        section_length - self.rows.len() as u64
    }

    /// The bytes of row `row` with their checksum verified.
    pub fn row(&self, row: usize) -> Result<&'a [u8], ReadError> {
        checked_row(self.index, self.rows, row)
    }

    /// The bytes of row `row`, for a reader that has verified it before.
    pub fn row_unchecked(&self, row: usize) -> Result<&'a [u8], ReadError> {
        row_bytes(self.index, self.rows, row)
    }

    /// Bounds of row `row`, one a channel.
    pub fn bounds_of(&self, row: usize) -> &'a [ChannelBound] {
        let channels = self.head.channels.count();
        self.bounds.get(row * channels..(row + 1) * channels).unwrap_or_default()
    }
}

/// The bytes of row `row` among all `rows`, unchecked. Errors: no such row.
pub fn row_bytes<'a>(index: &[RowEntry], rows: &'a [u8], row: usize) -> Result<&'a [u8], ReadError> {
    let entry = index.get(row).ok_or_else(|| invalid("row", "below the row count", row.to_string()))?;
    let start = entry.offset as usize;
    rows.get(start..start + entry.length as usize).ok_or(ReadError::Truncated {
        section: ResponseSection::TAG,
        offset: entry.offset,
        missing: u64::from(entry.length),
    })
}

/// The same with the row's checksum verified. Errors: no such row, or a damaged one.
pub fn checked_row<'a>(index: &[RowEntry], rows: &'a [u8], row: usize) -> Result<&'a [u8], ReadError> {
    let bytes = row_bytes(index, rows, row)?;
    let (wanted, found) = (index[row].checksum, checksum(bytes));
    if wanted != found {
        let part = format!("row {row}");
        return Err(ReadError::Checksum { section: ResponseSection::TAG, part, wanted, found });
    }
    Ok(bytes)
}

/// Eyes and seen cells, and channels that need them.
fn check_view_region(head: &ResponseHead) -> Result<(), ReadError> {
    if let DirectionalBasis::ViewRegion { degree } = head.channels {
        if degree > MAX_VIEW_DEGREE {
            return Err(invalid("channels", "degree 0 to 2 towards eyes", degree.to_string()));
        }
        if head.view_region.is_none() || head.direct == DirectTerm::InRows {
            let found = format!("eyes {:?}, direct light {:?}", head.view_region, head.direct);
            return Err(invalid("channels", "eyes, and direct light left to the reader", found));
        }
    }
    if let Some(view_region) = &head.view_region {
        let within = |axis: usize| {
            let (low, high) = (view_region.low_m[axis], view_region.high_m[axis]);
            low <= high && low.abs() <= FARTHEST_VIEWPOINT && high.abs() <= FARTHEST_VIEWPOINT
        };
        if !(0..3).all(within) {
            return Err(invalid("eyes", "a box within 1e9 m", format!("{view_region:?}")));
        }
    }
    let Some(seen) = &head.seen else { return Ok(()) };
    let cells = head.shape.len();
    let spare = seen.last().is_some_and(|last| !cells.is_multiple_of(8) && last >> (cells % 8) != 0);
    if seen.len() != cells.div_ceil(8) || spare {
        return Err(invalid("seen cells", "a bit a cell", format!("{} bytes for {cells}", seen.len())));
    }
    Ok(())
}

/// Largest coordinate of an eye, m: its square is far within double precision.
const FARTHEST_VIEWPOINT: f64 = 1e9;

fn invalid(field: &'static str, wanted: &'static str, found: String) -> ReadError {
    ReadError::Invalid { section: ResponseSection::TAG, offset: 8, field, wanted, found }
}

/// Rows gathered for writing.
#[derive(Clone, Debug, Default)]
pub struct ResponseRows {
    /// One a source, in row order.
    pub rows: Vec<Vec<u8>>,
    /// One a row and channel.
    pub bounds: Vec<ChannelBound>,
}

/// The section's bytes. `rows` are moved into it unchanged.
pub fn write(head: &ResponseHead, rows: ResponseRows) -> OutSection {
    let mut front = join_head(&meta::encode(head));
    let start = front.len();
    let mut offset = 0u64;
    for row in &rows.rows {
        let entry = RowEntry { offset, length: row.len() as u32, checksum: checksum(row) };
        front.extend_from_slice(bytemuck::bytes_of(&entry));
        offset += row.len() as u64;
    }
    front.extend_from_slice(bytemuck::cast_slice(&rows.bounds));
    front.resize(start + (front.len() - start).next_multiple_of(64), 0);
    let head_length = front.len() as u64;
    let mut parts = vec![front];
    parts.extend(rows.rows);
    OutSection {
        tag: ResponseSection::TAG,
        version: ResponseSection::VERSION,
        required: true,
        head_length,
        parts,
    }
}
