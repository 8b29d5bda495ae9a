//! A renderer's buffers from one OpenEXR file: colour, depth or places, normals, albedo, roughness, emission, a mask of what gets wet.
//!
//! Layers are found by the names that renderers write ([`roles`]), or named; axes, unit and the space of normals follow the writer, or are given
//! ([`space`]); the camera is given, or is the file's own. What is missing is done without, and said.

mod lens;
mod planes;
pub mod roles;
pub mod space;
#[cfg(test)]
mod tests;

use super::Input;
use crate::error::BakeError;
use planes::{Contents, Plane};
use roles::{Found, Role, choose};
use space::Axes;
use squall_runtime::Camera;
use squall_runtime::glam::Vec3;
use squall_runtime::wet::frame::GBuffer;
use std::path::Path;

/// Who wrote a file, as far as it can be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Writer {
    /// Blender: z up, metres.
    Blender,
    /// Houdini's Karma or Mantra: y up, metres.
    Houdini,
    /// Unreal's Movie Render Queue: z up, left-handed, centimetres.
    Unreal,
    /// pbrt: y up, left-handed, metres.
    Pbrt,
    /// `squall render`: z up, metres, W/(m² sr).
    Squall,
    /// Somebody else: z up, metres.
    Other,
}

impl Writer {
    fn of(contents: &Contents<'_>) -> Self {
        let software =
            ["software", "Software"].iter().find_map(|name| contents.text(name)).unwrap_or_default();
        let software = software.to_ascii_lowercase();
        let has = |end: &str| contents.channels.iter().any(|channel| channel.name.ends_with(end));
        let attribute = |start: &str| contents.attributes().any(|name| name.starts_with(start));
        if attribute("unreal/") || contents.channels.iter().any(|c| c.layer.starts_with("FinalImage")) {
            Self::Unreal
        } else if software.contains("blender") || attribute("Blender") || has("Combined.R") {
            Self::Blender
        } else if ["houdini", "karma", "mantra", "husk"].iter().any(|name| software.contains(name)) {
            Self::Houdini
        } else if software == crate::picture::SOFTWARE {
            Self::Squall
        } else if software.contains("pbrt") || has("RelativeVariance.R") || has("dzdx") {
            Self::Pbrt
        } else {
            Self::Other
        }
    }

    /// Its world.
    pub fn axes(self) -> Axes {
        match self {
            Self::Blender | Self::Squall | Self::Other => Axes::SQUALL,
            Self::Houdini => Axes { y_up: true, ..Axes::SQUALL },
            Self::Unreal => Axes { left_handed: true, metres: 0.01, ..Axes::SQUALL },
            Self::Pbrt => Axes { y_up: true, left_handed: true, ..Axes::SQUALL },
        }
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Blender => "Blender",
            Self::Houdini => "Houdini",
            Self::Unreal => "Unreal",
            Self::Pbrt => "pbrt",
            Self::Squall => "squall",
            Self::Other => "unknown",
        }
    }
}

/// What somebody says of a file; what is left out, the file tells.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Layers by name; "none" leaves a buffer out.
    pub layers: Vec<(Role, String)>,
    /// Whether y is up.
    pub y_up: Option<bool>,
    /// Whether the world is left-handed.
    pub left_handed: Option<bool>,
    /// Metres of a unit, above 0.
    pub metres: Option<f64>,
    /// Whether normals are in the world; before the camera otherwise.
    pub world_normals: Option<bool>,
    /// Whether depth is measured along each pixel's ray.
    pub ray_depth: bool,
    /// The camera, in Squall's world.
    pub camera: Option<Camera>,
}

/// A file's buffers.
#[derive(Clone, Debug)]
pub struct TakenBuffer {
    /// The buffers.
    pub buffer: GBuffer,
    /// The camera that they were drawn with.
    pub camera: Camera,
    /// Where the camera is from.
    pub camera_from: &'static str,
    /// Who wrote the file.
    pub writer: Writer,
    /// Every buffer that was found, by its layer.
    pub found: Vec<(Role, String)>,
    /// What is worth knowing: what was assumed, mended, done without.
    pub notes: Vec<String>,
}

/// Depths of this many units and more are the sky: Blender writes 1e10, half floats end at 65504.
const SKY_UNITS: f32 = 1e9;
const LARGEST_HALF: f32 = 65_504.0;

/// Reads a file's buffers.
///
/// Errors: no EXR, damaged, deep, subsampled or larger than a picture may be; a named layer that is not there; no colour; neither depth nor places; nothing
/// but sky; layers of unequal windows; no camera; colours, albedo, roughness or emission of a surface that are no finite numbers.
pub fn read_gbuffer(input: &Input, reading: &Reading) -> Result<TakenBuffer, BakeError> {
    let contents = Contents::of(input)?;
    let path = input.path.as_path();
    let writer = Writer::of(&contents);
    let usual = writer.axes();
    let axes = Axes {
        y_up: reading.y_up.unwrap_or(usual.y_up),
        left_handed: reading.left_handed.unwrap_or(usual.left_handed),
        metres: reading.metres.unwrap_or(usual.metres),
    };
    let (found, mut notes) = choose(&contents, &reading.layers)?;
    let (camera, camera_from) = camera_for(&contents, reading, axes)?;
    let has = |role: Role| found.iter().any(|found| found.role == role);
    if !has(Role::Depth) && !has(Role::Position) {
        let listed = contents.channels.iter().map(|channel| channel.name.as_str()).collect::<Vec<_>>();
        let wanted = "a layer of depth or of places (--layer depth=NAME)";
        return Err(BakeError::input(path, "depth", wanted, listed.join(", ")));
    }
    // Depth says all that places would.
    let used: Vec<&Found<'_>> =
        found.iter().filter(|found| !(found.role == Role::Position && has(Role::Depth))).collect();
    let channels: Vec<_> = used.iter().flat_map(|found| found.channels.iter().copied()).collect();
    let mut planes = contents.read(&channels)?.into_iter();
    let mut buffers = Buffers::default();
    for found in &used {
        let own: Vec<Plane> = planes.by_ref().take(found.channels.len()).collect();
        buffers.take(found.role, own);
    }
    let size = contents.size;
    let mut buffer = GBuffer { size, colour: buffers.colour.unwrap_or_default(), ..GBuffer::default() };
    buffer.depth_m = match (&buffers.depth, &buffers.position) {
        (Some(depth), _) => planar(depth, (axes.metres, reading.ray_depth), &camera),
        (None, Some(places)) => {
            let (depth, words) = space::depth_of_places(places, (&camera, axes), path)?;
            notes.push(format!("depth from places {words}"));
            depth
        }
        (None, None) => Vec::new(),
    };
    if !buffer.depth_m.iter().any(|depth| *depth > 0.0 && depth.is_finite()) {
        return Err(BakeError::input(path, "depth", "some pixel with a depth", "sky and holes alone"));
    }
    let shown = space::normals_of_depth(&buffer, &camera);
    match &buffers.normal {
        None => notes.push("no normals: taken from depth".into()),
        Some(stored) => {
            let given = (reading.world_normals, axes);
            let (normals, space, is_coloured) = space::normals(stored, given, (&camera, &shown));
            let coded = if is_coloured { ", as colours (n + 1)/2" } else { "" };
            notes.push(format!("normals {}{coded}", space.words()));
            buffer.normal = normals;
        }
    }
    mend_normals(&mut buffer, shown, &mut notes);
    (buffer.albedo, buffer.emission) = (buffers.albedo, buffers.emission);
    (buffer.roughness, buffer.wettable) = (buffers.roughness, buffers.wettable);
    check_numbers(&mut buffer, path, &mut notes)?;
    for (role, how) in [
        (Role::Albedo, "a usual one is taken (controls of the surface)"),
        (Role::Roughness, "a usual one is taken (controls of the surface)"),
        (Role::Emission, "light that surfaces send of their own is darkened with the rest"),
    ] {
        if !has(role) {
            notes.push(format!("no {}: {how}", role.name()));
        }
    }
    buffer.check(&camera)?;
    let found = used.iter().map(|found| (found.role, found.name.clone())).collect();
    Ok(TakenBuffer { buffer, camera, camera_from, writer, found, notes })
}

/// The camera that was given, at the picture's size, or the file's own; and where it is from. Errors: one of another shape; none.
fn camera_for(
    contents: &Contents<'_>,
    reading: &Reading,
    axes: Axes,
) -> Result<(Camera, &'static str), BakeError> {
    let size = contents.size.map(|count| count as u32);
    if let Some(camera) = &reading.camera {
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        let own = f64::from(camera.width) / f64::from(camera.height);
        if (aspect / own - 1.0).abs() > 0.01 {
            let wanted = format!("a camera as wide as the picture, {} × {}", size[0], size[1]);
            let found = format!("{} × {}", camera.width, camera.height);
            return Err(BakeError::input(contents.path(), "--camera", wanted, found));
        }
        return Ok((camera.clone().resized(size)?, "--camera"));
    }
    lens::camera_of(contents, axes).ok_or_else(|| {
        let wanted =
            "a camera: --camera CAMERA.json, or the file's own attributes worldToNDC or unreal/camera";
        BakeError::input(contents.path(), "camera", wanted, "neither")
    })
}

/// Buffers on their way.
#[derive(Default)]
struct Buffers {
    colour: Option<Vec<[f32; 3]>>,
    depth: Option<Plane>,
    position: Option<Vec<[f32; 3]>>,
    normal: Option<Vec<[f32; 3]>>,
    albedo: Option<Vec<[f32; 3]>>,
    emission: Option<Vec<[f32; 3]>>,
    roughness: Option<Plane>,
    wettable: Option<Plane>,
}

impl Buffers {
    fn take(&mut self, role: Role, mut planes: Vec<Plane>) {
        let three = |planes: &[Plane]| {
            let count = planes.first().map_or(0, Vec::len);
            Some((0..count).map(|i| std::array::from_fn(|band| planes[band][i])).collect())
        };
        match role {
            Role::Colour => self.colour = three(&planes),
            Role::Position => self.position = three(&planes),
            Role::Normal => self.normal = three(&planes),
            Role::Albedo => self.albedo = three(&planes),
            Role::Emission => self.emission = three(&planes),
            Role::Depth => self.depth = planes.pop(),
            Role::Roughness => self.roughness = planes.pop(),
            Role::Wettable => self.wettable = planes.pop(),
        }
    }
}

/// Stored depths as planar metres: 0, infinity and what no unit reaches is the sky, NaN a hole; those below 0, as cameras that look along −z have them,
/// count by their size.
fn planar(depth: &[f32], (metres, along_ray): (f64, bool), camera: &Camera) -> Vec<f32> {
    let (width, secants) = (camera.width as usize, camera.secants());
    let one = |(i, &depth): (usize, &f32)| {
        let size = depth.abs();
        if depth.is_nan() {
            return f32::NAN;
        }
        if size == 0.0 || size >= SKY_UNITS || size == LARGEST_HALF {
            return f32::INFINITY;
        }
        let secant =
            if along_ray { secants.at((i % width) as f64 + 0.5, (i / width) as f64 + 0.5) } else { 1.0 };
        (f64::from(size) * metres / secant) as f32
    };
    depth.iter().enumerate().map(one).collect()
}

/// Gives surfaces without a normal that of the depth, takes those of the sky away.
fn mend_normals(buffer: &mut GBuffer, shown: Vec<[f32; 3]>, notes: &mut Vec<String>) {
    if buffer.normal.is_empty() {
        buffer.normal = shown;
        return;
    }
    let mut mended = 0usize;
    for ((normal, shown), depth) in buffer.normal.iter_mut().zip(&shown).zip(&buffer.depth_m) {
        if !(*depth > 0.0 && depth.is_finite()) {
            *normal = [0.0; 3];
        } else if *normal == [0.0; 3] {
            *normal = *shown;
            mended += 1;
        }
    }
    if mended > 0 {
        notes.push(format!("{mended} pixels without a normal: taken from depth"));
    }
}

/// Refuses colours that are no numbers, and surfaces' properties that are none; brings shares into 0 to 1. In the sky, and outside a data window,
/// what is no number is nothing.
fn check_numbers(buffer: &mut GBuffer, path: &Path, notes: &mut Vec<String>) -> Result<(), BakeError> {
    let width = buffer.size[0];
    let holes = buffer.depth_m.iter().filter(|depth| depth.is_nan()).count();
    if holes > 0 {
        notes.push(format!("{holes} pixels without a depth: left as they are"));
    }
    let is_surface = |i: usize| buffer.depth_m[i].is_finite();
    let place = |i: usize| format!("pixel ({}, {})", i % width, i / width);
    let mut threes: Vec<(&'static str, &mut Vec<[f32; 3]>, bool)> =
        vec![("colour", &mut buffer.colour, false)];
    threes.extend(buffer.albedo.as_mut().map(|values| ("albedo", values, true)));
    threes.extend(buffer.emission.as_mut().map(|values| ("emission", values, false)));
    let mut ones: Vec<(&'static str, &mut Vec<f32>)> = Vec::new();
    ones.extend(buffer.roughness.as_mut().map(|values| ("roughness", values)));
    ones.extend(buffer.wettable.as_mut().map(|values| ("wettable", values)));
    for (name, values, is_share) in threes {
        let mut cut = 0usize;
        for (i, value) in values.iter_mut().enumerate() {
            if !Vec3::from_array(*value).is_finite() {
                // A NaN of all three is what lies outside the data window.
                let outside = value.iter().all(|v| v.is_nan()) && !is_surface(i);
                if !outside && (name == "colour" || is_surface(i)) {
                    let field = format!("{name}, {}", place(i));
                    return Err(BakeError::input(path, field, "finite samples", format!("{value:?}")));
                }
                *value = [0.0; 3];
            }
            if is_share && value.iter().any(|v| !(0.0..=1.0).contains(v)) {
                *value = value.map(|v| v.clamp(0.0, 1.0));
                cut += 1;
            }
        }
        if cut > 0 {
            notes.push(format!("{cut} pixels of {name} outside 0 to 1: cut"));
        }
    }
    for (name, values) in ones {
        let mut cut = 0usize;
        for (i, value) in values.iter_mut().enumerate() {
            if !value.is_finite() {
                if is_surface(i) {
                    let field = format!("{name}, {}", place(i));
                    return Err(BakeError::input(path, field, "finite samples", *value));
                }
                *value = 0.0;
            }
            if !(0.0..=1.0).contains(value) {
                *value = value.clamp(0.0, 1.0);
                cut += 1;
            }
        }
        if cut > 0 {
            notes.push(format!("{cut} pixels of {name} outside 0 to 1: cut"));
        }
    }
    Ok(())
}
