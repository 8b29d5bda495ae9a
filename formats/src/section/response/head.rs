//! A response's metadata: which sources its rows belong to, what their coefficients mean, how they were solved for.

use super::entropy::EntropyRecord;
use super::finer::FinerLevel;
use super::sun::SunDirections;
use crate::basis::DirectionalBasis;
use crate::error::{Limits, ReadError};
use crate::grid::GridShape;
use crate::light_grid::LightGrid;
use crate::meta;
use crate::tag::Tag;
use crate::view_region::{MAX_VIEW_DEGREE, ViewRegion};
use serde::{Deserialize, Serialize};

/// The section's tag.
pub(super) const TAG: Tag = Tag(*b"CLRT");

/// Which virtual sources the rows belong to. More kinds may follow in later versions of the section; what only some of them
/// have is asked for, as [`SourceBasis::light_grid`] is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum SourceBasis {
    /// Point lights of 1 W/sr at the nodes of a rectilinear grid; a light between nodes is split trilinearly
    /// (\[dobashi\] eq. 6), so that no intensity is lost.
    LightGrid {
        /// Where the nodes stand.
        grid: LightGrid,
        /// Row of each node, x fastest; [`NO_ROW`] where none was baked.
        rows: Vec<u32>,
    },
}

impl SourceBasis {
    /// The light grid and each node's row, where the sources are one.
    pub fn light_grid(&self) -> Option<(&LightGrid, &[u32])> {
        match self {
            Self::LightGrid { grid, rows } => Some((grid, rows)),
        }
    }

    /// Row of node `node`; `None` for one that was not baked or is not there.
    pub fn row_of(&self, node: usize) -> Option<u32> {
        let (_, rows) = self.light_grid()?;
        rows.get(node).copied().filter(|&row| row != NO_ROW)
    }
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
    /// The same for the sun, its direct light left to the reader: the row holds what the cloud scatters beyond that. New in
    /// version 3.
    Sun {
        /// Unit direction of travel.
        direction: [f64; 3],
    },
}

/// A row that belongs to distant light; it holds all of that light, direct light included, but of [`DistantKind::Sun`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DistantSource {
    /// Which light.
    pub kind: DistantKind,
    /// Its row.
    pub row: u32,
}

/// No row for this node.
pub const NO_ROW: u32 = u32::MAX;

/// Which light the rows hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DirectTerm {
    /// All of it, light scattered once from the source included, as in \[dobashi\].
    InRows,
    /// What was scattered beyond the delta-scaled medium's unscattered light; the runtime works out the rest from the
    /// stroke itself.
    AtRunTime,
}

/// How coefficients are stored. Another kind takes another version of the section, and readers of this one refuse it by name:
/// whoever matches on this decides for every kind there is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Codec {
    /// \[dobashi\] §6: every coefficient above the threshold as index u32 and value f32.
    Paper,
    /// Gap and dead-zone quantised value, a byte each; rare large ones escape to f32.
    Bytes,
    /// The same in as many bits as each is rare, over the places that rows use: [`super::EntropyRecord`]. New in version 4.
    Entropy,
}

/// What a row's cells hold of light that was solved for in smaller cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stored {
    /// Its mean over each.
    #[default]
    Means,
    /// What, read between the middles of the stored cells, comes closest to the solved ones, weighted by how much of each is seen. It may be
    /// below zero; over a cell the mean of the reading is the light's. New in version 5.
    Fit,
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
    /// Cells that the rows describe: those of section `CLDG`.
    pub shape: GridShape,
    /// Which sources.
    pub sources: SourceBasis,
    /// Rows of distant light.
    pub distant: Vec<DistantSource>,
    /// What the coefficients of a row mean.
    pub basis: DirectionalBasis,
    /// Whether direct light is inside.
    pub direct: DirectTerm,
    /// How coefficients lie.
    pub codec: Codec,
    /// How they were solved for.
    pub solver: SolverRecord,
    /// Where viewpoints may stand; anywhere where absent. From elsewhere the rows' light means nothing. New in version 2.
    pub view_region: Option<ViewRegion>,
    /// Which cells' light means something, a bit each, lowest first; all where absent. New in version 2: in a section of version 1
    /// it may be only the cells with extinction and those that touch one.
    pub seen: Option<Vec<u8>>,
    /// Where the sun may stand whose beams are among the distant lights. New in version 3.
    pub sun: Option<SunDirections>,
    /// Virtual lights between those of the light grid, coarse to fine; their rows stand behind all others. New in version 4.
    pub finer: Vec<FinerLevel>,
    /// How rows of codec `Entropy` are coded; [`super::write()`] makes it. New in version 4.
    pub entropy: Option<EntropyRecord>,
    /// What cells hold. New in version 5.
    pub stored: Stored,
}

impl ResponseHead {
    /// The oldest version that can say this, which is the one that is written.
    pub(super) fn version(&self, cloud_blocks: bool) -> u16 {
        match (self.codec, self.sun.is_some() || cloud_blocks) {
            _ if self.stored == Stored::Fit => 5,
            _ if !self.finer.is_empty() => 4,
            (Codec::Entropy, _) => 4,
            (_, true) => 3,
            (_, false) => 2,
        }
    }

    /// The metadata record of a section of `version`.
    pub(super) fn encode(&self, version: u16) -> Vec<u8> {
        if version >= 5 {
            return meta::encode(self);
        }
        let Self { shape, sources, distant, basis, direct, codec, solver, view_region, seen, sun, .. } = self;
        let old = (shape, sources, distant, basis, direct, codec, solver, view_region, seen);
        if version == 4 {
            return meta::encode(&(old, sun, &self.finer, &self.entropy));
        }
        if version == 3 { meta::encode(&(old, sun)) } else { meta::encode(&old) }
    }

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

/// [`ResponseHead`] as version 4 has it.
#[derive(Deserialize)]
struct HeadV4 {
    before: HeadV3,
    finer: Vec<FinerLevel>,
    entropy: Option<EntropyRecord>,
}

impl From<HeadV4> for ResponseHead {
    fn from(head: HeadV4) -> Self {
        Self { finer: head.finer, entropy: head.entropy, ..head.before.into() }
    }
}

/// [`ResponseHead`] as version 3 has it.
#[derive(Deserialize)]
struct HeadV3 {
    before: HeadV2,
    sun: Option<SunDirections>,
}

impl From<HeadV3> for ResponseHead {
    fn from(head: HeadV3) -> Self {
        Self { sun: head.sun, ..head.before.into() }
    }
}

/// [`ResponseHead`] as version 2 has it.
#[derive(Deserialize)]
struct HeadV2 {
    shape: GridShape,
    sources: SourceBasis,
    distant: Vec<DistantSource>,
    basis: DirectionalBasis,
    direct: DirectTerm,
    codec: Codec,
    solver: SolverRecord,
    view_region: Option<ViewRegion>,
    seen: Option<Vec<u8>>,
}

impl From<HeadV2> for ResponseHead {
    fn from(head: HeadV2) -> Self {
        let HeadV2 { shape, sources, distant, basis, direct, codec, solver, view_region, seen } = head;
        let (sun, finer, entropy, stored) = (None, Vec::new(), None, Stored::Means);
        Self {
            shape,
            sources,
            distant,
            basis,
            direct,
            codec,
            solver,
            view_region,
            seen,
            sun,
            finer,
            entropy,
            stored,
        }
    }
}

/// [`ResponseHead`] as version 1 has it.
#[derive(Deserialize)]
struct HeadV1 {
    shape: GridShape,
    sources: SourceBasis,
    distant: Vec<DistantSource>,
    basis: DirectionalBasis,
    direct: DirectTerm,
    codec: Codec,
    solver: SolverRecord,
}

impl HeadV1 {
    fn newest(self) -> Result<ResponseHead, ReadError> {
        let Self { shape, sources, distant, basis, direct, codec, solver } = self;
        if let DirectionalBasis::ViewRegion { .. } = basis {
            return Err(invalid(None, "basis", "one of version 1", basis.name()));
        }
        Ok(ResponseHead {
            shape,
            sources,
            distant,
            basis,
            direct,
            codec,
            solver,
            view_region: None,
            seen: None,
            sun: None,
            finer: Vec::new(),
            entropy: None,
            stored: Stored::Means,
        })
    }
}

/// Largest coordinate of a viewpoint, m: its square is far within double precision.
const FARTHEST_VIEWPOINT: f64 = 1e9;

impl ResponseHead {
    /// Reads the metadata record of a section of `version` and checks every number of it. Returns the number of rows too.
    pub(super) fn read(record: &[u8], version: u16, limits: &Limits) -> Result<(Self, usize), ReadError> {
        let head: Self = match version {
            1 => meta::decode::<HeadV1>(TAG, record, limits)?.newest()?,
            2 => meta::decode::<HeadV2>(TAG, record, limits)?.into(),
            3 => meta::decode::<HeadV3>(TAG, record, limits)?.into(),
            4 => meta::decode::<HeadV4>(TAG, record, limits)?.into(),
            _ => meta::decode(TAG, record, limits)?,
        };
        let cells = head.shape.checked_len().filter(|&cells| cells as u64 <= limits.cells);
        if cells.is_none() {
            return Err(invalid(None, "shape", "1 cell to the limit", format!("{:?}", head.shape)));
        }
        if let DirectionalBasis::Harmonics { degree: degree @ 4.. } = head.basis {
            return Err(invalid(None, "basis", "harmonics of degree 0 to 3", degree.to_string()));
        }
        if head.codec == Codec::Entropy && version < 4 {
            return Err(invalid(None, "codec", "one of the section's version", "entropy".into()));
        }
        head.check_view_region()?;
        head.check_seen()?;
        head.solver.check()?;
        let rows = head.check_sources(limits)?;
        let finer = head.check_finer(limits, rows)?;
        head.check_sun()?;
        Ok((head, rows + finer))
    }

    /// A view region, and a basis that needs one.
    fn check_view_region(&self) -> Result<(), ReadError> {
        if let DirectionalBasis::ViewRegion { degree } = self.basis {
            if degree > MAX_VIEW_DEGREE {
                let wanted = "degree 0 to 2 towards a view region";
                return Err(invalid(None, "basis", wanted, degree.to_string()));
            }
            if self.view_region.is_none() || self.direct == DirectTerm::InRows {
                let wanted = "a view region, and direct light left to the reader";
                let found = format!("view region {:?}, direct light {:?}", self.view_region, self.direct);
                return Err(invalid(None, "basis", wanted, found));
            }
        }
        let Some(region) = &self.view_region else { return Ok(()) };
        let within = |axis: usize| {
            let (low, high) = (region.low_m[axis], region.high_m[axis]);
            low <= high && low.abs() <= FARTHEST_VIEWPOINT && high.abs() <= FARTHEST_VIEWPOINT
        };
        if (0..3).all(within) {
            return Ok(());
        }
        Err(invalid(None, "view region", "a box within 1e9 m", format!("{region:?}")))
    }

    /// The sun's beams, and the record that says what they cover.
    fn check_sun(&self) -> Result<(), ReadError> {
        let suns = self.suns();
        match &self.sun {
            Some(sun) => sun.check(&suns),
            None if suns.is_empty() => Ok(()),
            None => {
                Err(invalid(None, "distant light", "no beam of the sun without its record", "one".into()))
            }
        }
    }

    fn check_seen(&self) -> Result<(), ReadError> {
        let Some(seen) = &self.seen else { return Ok(()) };
        let cells = self.shape.len();
        let spare = seen.last().is_some_and(|last| !cells.is_multiple_of(8) && last >> (cells % 8) != 0);
        if seen.len() == cells.div_ceil(8) && !spare {
            return Ok(());
        }
        Err(invalid(None, "seen cells", "a bit a cell", format!("{} bytes for {cells}", seen.len())))
    }

    /// Light grid and distant light; the number of rows that they name, each once.
    fn check_sources(&self, limits: &Limits) -> Result<usize, ReadError> {
        let SourceBasis::LightGrid { grid, rows: node_rows } = &self.sources;
        let nodes = check_axes(grid)?;
        if nodes != node_rows.len() as u64 {
            let found = format!("{} for {nodes}", node_rows.len());
            return Err(invalid(None, "light grid rows", "one a node", found));
        }
        let wanted = nodes.saturating_add(self.distant.len() as u64);
        if wanted > limits.sources {
            let allowed = limits.sources;
            return Err(ReadError::OverLimit { section: TAG, field: "virtual sources", wanted, allowed });
        }
        let listed = || {
            let lights = node_rows.iter().copied().filter(|&row| row != NO_ROW);
            lights.chain(self.distant.iter().map(|source| source.row))
        };
        let count = listed().count();
        let mut named = vec![false; count];
        for row in listed() {
            match named.get_mut(row as usize) {
                Some(slot) if !*slot => *slot = true,
                _ => return Err(invalid(None, "rows of sources", "each row once", row.to_string())),
            }
        }
        for source in &self.distant {
            if let DistantKind::Beam { direction } | DistantKind::Sun { direction } = source.kind {
                let length: f64 = direction.iter().map(|v| v * v).sum();
                if !(1.0 - 1e-6..1.0 + 1e-6).contains(&length) {
                    return Err(invalid(None, "beam direction", "a unit vector", format!("{direction:?}")));
                }
            }
        }
        Ok(count)
    }
}

/// Axes of a light grid; the number of its nodes.
pub(super) fn check_axes(grid: &LightGrid) -> Result<u64, ReadError> {
    for axis in grid.axes() {
        let rising = axis.windows(2).all(|pair| pair[0] < pair[1]);
        if axis.is_empty() || !rising || !axis.iter().all(|v| v.is_finite()) {
            let found = format!("{} nodes", axis.len());
            return Err(invalid(None, "light grid axis", "rising finite metres", found));
        }
    }
    Ok(grid.axes().iter().fold(1u64, |nodes, axis| nodes.saturating_mul(axis.len() as u64)))
}

impl SolverRecord {
    fn check(&self) -> Result<(), ReadError> {
        if self.refine.iter().any(|&factor| factor == 0 || factor > 64) {
            return Err(invalid(None, "refine", "1 to 64", format!("{:?}", self.refine)));
        }
        let scale = self.extinction_scale;
        if scale > 0.0 && scale <= 1.0 {
            return Ok(());
        }
        Err(invalid(None, "extinction scale", "above 0, at most 1", scale.to_string()))
    }
}

pub(super) fn invalid(
    offset: Option<u64>,
    field: &'static str,
    wanted: &'static str,
    found: String,
) -> ReadError {
    ReadError::Invalid { section: TAG, offset, field, wanted, found }
}
