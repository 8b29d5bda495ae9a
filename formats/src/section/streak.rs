//! `STRK` v2: streak patterns. Bytes: SPEC.md, "STRK".
//!
//! A pattern is a drop's streak in its own picture: u across, v along the fall, both 0 to 1, (0, 0) the top
//! left corner. What a pattern's numbers mean stands here beside how they are stored, because the fit and
//! the runtime must agree on both: [`Pattern::value`] is the definition, everything else approximates it.
//!
//! Stored numbers are small integers with a step each. `write` rounds to the nearest step, so that what was read
//! (or [`StreakPattern::quantised`]) is written without loss; of two ways to store one pattern, a cosine and its
//! mirror image for instance, it takes the same one each time, so that what it wrote it writes again.

mod cosine;
mod kind;
mod packing;
mod separable;
mod window;

pub use cosine::{Cosine, CosinePattern, MAX_TERMS};
pub use separable::SeparablePattern;
pub use window::{EdgeWindow, PowerWindow, Window};

use crate::error::{Limits, ReadError};
use crate::meta::{self, check_version};
use crate::tag::Tag;
use kind::Kind;
use packing::{Cursor, TAG, invalid, nearest};
use serde::{Deserialize, Serialize};

/// Longest side of a source picture, pixels.
pub const MAX_SIDE: usize = 65_535;
/// Longest name, bytes.
pub const MAX_NAME: usize = 255;
/// PSNR of an exact fit: what infinity is stored as, dB.
pub const PSNR_CAP_DB: f64 = 99.99;

/// How a pattern was made: its stored code, and its name at the surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum Method {
    /// The strongest pairs of the discrete Fourier transform, a Gaussian window multiplied afterwards.
    Paper = 1,
    /// The strongest pairs of the discrete Fourier transform alone.
    Fourier = 2,
    /// Integer frequencies under a Gaussian window, by least squares.
    Windowed = 3,
    /// Free frequencies under a Gaussian window, fitted jointly.
    OffGrid = 4,
    /// Free frequencies under a super-Gaussian window, fitted jointly.
    Super = 5,
    /// Free frequencies between four soft edges that bend, fitted jointly.
    Edges = 6,
    /// Products of tables across and along.
    Separable = 7,
}

impl Method {
    /// All methods, in the order of their codes.
    pub const ALL: [Self; 7] = [
        Self::Paper,
        Self::Fourier,
        Self::Windowed,
        Self::OffGrid,
        Self::Super,
        Self::Edges,
        Self::Separable,
    ];

    /// The name used on the command line and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Fourier => "fourier",
            Self::Windowed => "windowed",
            Self::OffGrid => "off-grid",
            Self::Super => "super",
            Self::Edges => "edges",
            Self::Separable => "separable",
        }
    }

    /// The method of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|method| method.name() == name)
    }

    fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|&method| method as u8 == code)
    }
}

/// The part of the picture that the drop's path covers, as fractions: length and width of a drawn streak
/// are those of this box, and the black margin around it comes on top.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Left and right end, in [0, 1], ascending.
    pub u: [f64; 2],
    /// Top and bottom end, in [0, 1], ascending.
    pub v: [f64; 2],
}

impl Body {
    /// The whole picture.
    pub const WHOLE: Self = Self { u: [0.0, 1.0], v: [0.0, 1.0] };

    /// Share of the picture's width.
    pub fn width(&self) -> f64 {
        self.u[1] - self.u[0]
    }

    /// Share of the picture's length.
    pub fn length(&self) -> f64 {
        self.v[1] - self.v[0]
    }
}

/// What is known of the drop behind a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DropNotes {
    /// Equivalent diameter, mm, in steps of 1 µm up to 65.535.
    pub diameter_mm: f64,
    /// Exposure, ms, in steps of 1 µs up to 65.535.
    pub exposure_ms: f64,
}

/// What a drop was lit by and how it was looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneNotes {
    /// Elevation of the line of sight, degrees, −90 to 90 in steps of 1; above 0 looks up.
    pub view_elevation_deg: f64,
    /// Share of one light in the irradiance of all, 0 to 1 in steps of 1/255; 0 is an overcast sky alone.
    pub light_share: f64,
    /// Where that light stands, from straight behind the drop toward the right, degrees, −180 to 180 in steps of 1.
    pub light_azimuth_deg: f64,
    /// Its elevation, degrees, −90 to 90 in steps of 1.
    pub light_elevation_deg: f64,
}

/// The light of a streak over its picture; brightest source pixel 1.
#[derive(Clone, Debug, PartialEq)]
pub enum Pattern {
    /// A constant and cosines under a window.
    Cosines(CosinePattern),
    /// Products of two tables.
    Separable(SeparablePattern),
}

impl Pattern {
    /// Light at (u, v): the definition of a stored pattern. Small negative values occur where cosines
    /// overshoot. Zero outside the picture, except that [`EdgeWindow`] fades by itself and is not cut.
    pub fn value(&self, u: f64, v: f64) -> f64 {
        match self {
            Self::Cosines(pattern) => pattern.value(u, v),
            Self::Separable(pattern) => pattern.value(u, v),
        }
    }

    fn kind(&self) -> Kind {
        match self {
            Self::Separable(_) => Kind::Separable,
            Self::Cosines(pattern) => match pattern.window {
                Window::Flat => Kind::FlatCosines,
                Window::Power(window) if window.exponent == [2.0; 2] => Kind::GaussianCosines,
                Window::Power(_) => Kind::PowerCosines,
                Window::Edges(_) => Kind::EdgeCosines,
            },
        }
    }

    /// Number of oscillating terms, or of products of tables.
    pub fn terms(&self) -> usize {
        match self {
            Self::Cosines(pattern) => pattern.terms.len(),
            Self::Separable(pattern) => pattern.rank(),
        }
    }
}

/// One streak of the section.
#[derive(Clone, Debug, PartialEq)]
pub struct StreakPattern {
    /// What the picture was called; at most [`MAX_NAME`] bytes, no control characters.
    pub name: String,
    /// How it was fitted.
    pub method: Method,
    /// Source picture, pixels across and along.
    pub size_px: [u16; 2],
    /// Where in the picture the streak is.
    pub body: Body,
    /// Light of the whole pattern over the area of the body: a drawn streak's sum over pixels is its length ×
    /// its width × this. 0 to 4 in steps of 1/16384.
    pub mean: f64,
    /// Peak signal-to-noise ratio of these very numbers against the picture, dB, in steps of 0.01.
    pub psnr_db: f64,
    /// Structural similarity likewise, −1 to 1.
    pub ssim: f64,
    /// The drop, where it is known.
    pub notes: Option<DropNotes>,
    /// Its light and the line of sight, where they are known.
    pub scene: Option<SceneNotes>,
    /// The light.
    pub pattern: Pattern,
}

impl StreakPattern {
    /// The pattern as it comes back from a file.
    pub fn quantised(&self) -> Self {
        let section = StreakSection { patterns: vec![self.clone()] };
        let read = StreakSection::read(&section.write(), section.version(), &Limits::default());
        // What `write` saturates into range, `read` accepts.
        read.ok().and_then(|mut section| section.patterns.pop()).unwrap_or_else(|| self.clone())
    }

    /// Bytes by which the section grows for this pattern, name and notes included.
    pub fn stored_bytes(&self) -> usize {
        let with = StreakSection { patterns: vec![self.clone()] }.write().len();
        with - StreakSection::default().write().len()
    }
}

/// Section `STRK`: the streak patterns that rain is drawn with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StreakSection {
    /// The patterns; a drop picks one by its number.
    pub patterns: Vec<StreakPattern>,
}

/// What every pattern has, as it is stored; its name and its numbers follow in the pool.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Record {
    /// Kind in the high four bits, method in the low four.
    kind_and_method: u8,
    terms: u16,
    size_px: [u16; 2],
    /// Left, top, right, bottom in steps of 1/255.
    body: [u8; 4],
    mean: u16,
    psnr_centidecibel: u16,
    ssim: i16,
    name_bytes: u8,
    /// Diameter in µm and exposure in µs.
    notes: Option<[u16; 2]>,
}

/// A record of version 2: one of version 1, then elevation of the view, share, azimuth and elevation of the light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct SceneRecord {
    record: Record,
    scene: Option<(i8, u8, i16, i8)>,
}

const BODY_STEPS: f64 = 255.0;
const MEAN_STEPS: f64 = 16_384.0;
const PSNR_STEPS: f64 = 100.0;
const SSIM_STEPS: f64 = 32_767.0;
const NOTE_STEPS: f64 = 1000.0;
const SHARE_STEPS: f64 = 255.0;

impl StreakSection {
    /// The section's tag.
    pub const TAG: Tag = TAG;
    /// Newest version that this build writes and reads.
    pub const VERSION: u16 = 2;

    /// Version of [`StreakSection::write`]'s bytes: 1 where no pattern says what it was lit by, 2 otherwise.
    pub fn version(&self) -> u16 {
        if self.patterns.iter().any(|pattern| pattern.scene.is_some()) { 2 } else { 1 }
    }

    /// Reads a section.
    ///
    /// Errors: bytes missing or left over, more patterns or terms, of one or in sum, than `limits` and [`MAX_TERMS`] allow, a
    /// method that this build does not know, any number outside its range.
    pub fn read(bytes: &[u8], version: u16, limits: &Limits) -> Result<Self, ReadError> {
        check_version(Self::TAG, version, Self::VERSION)?;
        let (records, pool): (Vec<SceneRecord>, Vec<u8>) = match version {
            1 => {
                let (records, pool): (Vec<Record>, Vec<u8>) = meta::decode(Self::TAG, bytes, limits)?;
                (records.into_iter().map(|record| SceneRecord { record, scene: None }).collect(), pool)
            }
            _ => meta::decode(Self::TAG, bytes, limits)?,
        };
        if records.len() as u64 > limits.patterns {
            return Err(ReadError::OverLimit {
                section: Self::TAG,
                field: "patterns",
                wanted: records.len() as u64,
                allowed: limits.patterns,
            });
        }
        let terms: u64 = records.iter().map(|record| u64::from(record.record.terms)).sum();
        if terms > limits.pattern_terms {
            return Err(ReadError::OverLimit {
                section: Self::TAG,
                field: "cosines and products of all patterns",
                wanted: terms,
                allowed: limits.pattern_terms,
            });
        }
        let mut pool = Cursor::new(&pool);
        let patterns =
            records.iter().map(|record| read_pattern(record, &mut pool)).collect::<Result<_, _>>()?;
        pool.finish()?;
        Ok(Self { patterns })
    }

    /// The section's bytes. Numbers are rounded to their steps and saturate at the ends of their ranges.
    pub fn write(&self) -> Vec<u8> {
        let mut pool = Vec::new();
        let records: Vec<SceneRecord> =
            self.patterns.iter().map(|pattern| write_pattern(pattern, &mut pool)).collect();
        if self.version() == 1 {
            let records: Vec<Record> = records.into_iter().map(|record| record.record).collect();
            return meta::encode(&(records, pool));
        }
        meta::encode(&(records, pool))
    }
}

fn read_scene((view, share, azimuth, elevation): (i8, u8, i16, i8)) -> Result<SceneNotes, ReadError> {
    let [view_elevation_deg, light_elevation_deg] = [view, elevation].map(f64::from);
    let light_azimuth_deg = f64::from(azimuth);
    for (field, degrees, most) in [
        ("elevation of the view", view_elevation_deg, 90.0),
        ("azimuth of the light", light_azimuth_deg, 180.0),
        ("elevation of the light", light_elevation_deg, 90.0),
    ] {
        if degrees.abs() > most {
            return Err(invalid(field, "within ±90°, an azimuth within ±180°", degrees));
        }
    }
    let light_share = f64::from(share) / SHARE_STEPS;
    Ok(SceneNotes { view_elevation_deg, light_share, light_azimuth_deg, light_elevation_deg })
}

fn write_scene(scene: &SceneNotes) -> (i8, u8, i16, i8) {
    let degrees = |value: f64, most: i64| nearest(value, -most, most) as i16;
    (
        degrees(scene.view_elevation_deg, 90) as i8,
        nearest(scene.light_share * SHARE_STEPS, 0, 255) as u8,
        degrees(scene.light_azimuth_deg, 180),
        degrees(scene.light_elevation_deg, 90) as i8,
    )
}

fn read_pattern(
    SceneRecord { record, scene }: &SceneRecord,
    pool: &mut Cursor,
) -> Result<StreakPattern, ReadError> {
    let (kind, method) = (record.kind_and_method >> 4, record.kind_and_method & 15);
    let kind =
        Kind::from_code(kind).ok_or_else(|| invalid("pattern kind", "0 (flat) to 4 (separable)", kind))?;
    let method = Method::from_code(method)
        .ok_or_else(|| invalid("method", "a code from 1 (paper) to 7 (separable)", method))?;
    let terms = usize::from(record.terms);
    if terms > MAX_TERMS {
        return Err(ReadError::OverLimit {
            section: StreakSection::TAG,
            field: "terms of a pattern",
            wanted: terms as u64,
            allowed: MAX_TERMS as u64,
        });
    }
    if record.size_px.contains(&0) {
        return Err(invalid("picture size", "at least 1 × 1 pixels", format!("{:?}", record.size_px)));
    }
    let [left, top, right, bottom] = record.body.map(|step| f64::from(step) / BODY_STEPS);
    if !(left < right && top < bottom) {
        return Err(invalid("body", "left < right and top < bottom", format!("{:?}", record.body)));
    }
    let psnr_db = f64::from(record.psnr_centidecibel) / PSNR_STEPS;
    if psnr_db > PSNR_CAP_DB {
        return Err(invalid("PSNR", "at most 99.99 dB", psnr_db));
    }
    let name = std::str::from_utf8(pool.take(usize::from(record.name_bytes))?)
        .ok()
        .filter(|name| !name.chars().any(char::is_control))
        .ok_or_else(|| invalid("name", "UTF-8 without control characters", "other bytes"))?
        .to_owned();
    let pattern = match kind {
        Kind::Separable => Pattern::Separable(SeparablePattern::read(terms, pool)?),
        _ => Pattern::Cosines(CosinePattern::read(kind, terms, pool)?),
    };
    Ok(StreakPattern {
        name,
        method,
        size_px: record.size_px,
        body: Body { u: [left, right], v: [top, bottom] },
        mean: f64::from(record.mean) / MEAN_STEPS,
        psnr_db,
        ssim: (f64::from(record.ssim) / SSIM_STEPS).max(-1.0),
        notes: record.notes.map(|[diameter, exposure]| DropNotes {
            diameter_mm: f64::from(diameter) / NOTE_STEPS,
            exposure_ms: f64::from(exposure) / NOTE_STEPS,
        }),
        scene: scene.map(read_scene).transpose()?,
        pattern,
    })
}

fn write_pattern(streak: &StreakPattern, pool: &mut Vec<u8>) -> SceneRecord {
    let mut name = streak.name.replace(char::is_control, "_");
    while name.len() > MAX_NAME {
        name.pop();
    }
    pool.extend_from_slice(name.as_bytes());
    match &streak.pattern {
        Pattern::Cosines(pattern) => pattern.write(pool),
        Pattern::Separable(pattern) => pattern.write(pool),
    }
    let body_step = |fraction: f64| nearest(fraction * BODY_STEPS, 0, 255) as u8;
    // A body narrower than a step still has one.
    let span = |ends: [f64; 2]| {
        let low = body_step(ends[0]).min(254);
        (low, body_step(ends[1]).max(low + 1))
    };
    let ((left, right), (top, bottom)) = (span(streak.body.u), span(streak.body.v));
    let note = |value: f64| nearest(value * NOTE_STEPS, 0, 65_535) as u16;
    let record = Record {
        kind_and_method: (streak.pattern.kind() as u8) << 4 | streak.method as u8,
        terms: streak.pattern.terms().min(MAX_TERMS) as u16,
        size_px: streak.size_px.map(|side| side.max(1)),
        body: [left, top, right, bottom],
        mean: nearest(streak.mean * MEAN_STEPS, 0, 65_535) as u16,
        psnr_centidecibel: nearest(streak.psnr_db.min(PSNR_CAP_DB) * PSNR_STEPS, 0, 9999) as u16,
        ssim: nearest(streak.ssim * SSIM_STEPS, -32_767, 32_767) as i16,
        name_bytes: name.len() as u8,
        notes: streak.notes.map(|notes| [note(notes.diameter_mm), note(notes.exposure_ms)]),
    };
    SceneRecord { record, scene: streak.scene.as_ref().map(write_scene) }
}

#[cfg(test)]
mod tests;
