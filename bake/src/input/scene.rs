//! SCENE.json, LAMPS.json and CAMERA.json: a grid with its optics, lights and cameras.

use crate::error::BakeError;
use crate::input::{read_grid, read_json};
pub use crate::recipe::model::Optics;
use glam::DVec3;
use serde::Deserialize;
use squall_formats::GridShape;
use squall_formats::units::Radians;
use squall_runtime::camera::{Camera, Projection, vertical_from_horizontal};
use squall_runtime::relight::PointLight;
use squall_runtime::transport::direct::Light;
use squall_runtime::transport::{Boundary, Cloud};
use std::path::{Path, PathBuf};

/// A scene as read: the cloud, and lights and cameras by name.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The file it came from.
    pub file: PathBuf,
    /// The grid that the scene names, and every other file that belongs to it.
    pub inputs: Vec<PathBuf>,
    /// Extinction grid and optics.
    pub cloud: Cloud,
    /// Lights, in the file's order.
    pub lights: Vec<(String, Light)>,
    /// Cameras, in the file's order.
    pub cameras: Vec<(String, Camera)>,
}

impl Scene {
    /// The light called `name`. Errors: there is none; the message names those that there are.
    pub fn light(&self, name: &str) -> Result<Light, BakeError> {
        let found = self.lights.iter().find(|(known, _)| known == name);
        found.map(|(_, light)| *light).ok_or_else(|| {
            let names: Vec<_> = self.lights.iter().map(|(name, _)| format!("\"{name}\"")).collect();
            let wanted = match names.as_slice() {
                [] => "a scene with lights".to_owned(),
                [one] => one.clone(),
                [most @ .., last] => format!("{} or {last}", most.join(", ")),
            };
            BakeError::input(&self.file, "lamp", wanted, format!("\"{name}\""))
        })
    }
}

#[derive(Deserialize)]
struct SceneFile {
    dims_xyz: Option<[u32; 3]>,
    cell_m: Option<CellSize>,
    origin_m: Option<[f64; 3]>,
    density_file: Option<PathBuf>,
    extinction_file: Option<PathBuf>,
    kappa_per_m: Option<f64>,
    albedo: Option<f64>,
    g: Option<f64>,
    boundary: Option<String>,
    #[serde(default)]
    lights: Vec<LightFile>,
    #[serde(default)]
    cameras: Vec<CameraFile>,
    analytic_shape: Option<serde_json::Value>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum CellSize {
    Cube(f64),
    Box([f64; 3]),
}

#[derive(Deserialize)]
struct LightFile {
    name: Option<String>,
    #[serde(rename = "type")]
    kind: Option<String>,
    position_m: Option<[f64; 3]>,
    #[serde(rename = "intensity_W_per_sr")]
    intensity: Option<f64>,
    direction: Option<[f64; 3]>,
    #[serde(rename = "irradiance_W_per_m2")]
    irradiance: Option<f64>,
}

#[derive(Deserialize)]
struct CameraFile {
    name: Option<String>,
    #[serde(rename = "type")]
    kind: Option<String>,
    origin_m: Option<[f64; 3]>,
    target_m: Option<[f64; 3]>,
    direction: Option<[f64; 3]>,
    up: Option<[f64; 3]>,
    horizontal_fov_deg: Option<f64>,
    vertical_fov_deg: Option<f64>,
    half_width_m: Option<f64>,
    half_height_m: Option<f64>,
    width: u32,
    height: u32,
}

/// Reads a scene and the grid that it names.
///
/// `optics` override what the file says. Errors: anything missing, of another type or outside its range, and a scene
/// that has shapes in place of a grid.
pub fn read_scene(path: &Path, optics: Optics) -> Result<Scene, BakeError> {
    let file: SceneFile = read_json(path, "a scene (SCENE.json)")?;
    let bad = |field: &str, wanted: &str, found: &dyn std::fmt::Display| {
        BakeError::input(path, field, wanted, found)
    };
    let grid_file = match (&file.density_file, &file.extinction_file) {
        (Some(grid), None) | (None, Some(grid)) => grid,
        (Some(_), Some(_)) => return Err(bad("density_file and extinction_file", "one of the two", &"both")),
        (None, None) => {
            let found =
                if file.analytic_shape.is_some() { "an analytic shape and no grid" } else { "neither" };
            return Err(bad("density_file", "a grid: density_file or extinction_file", &found));
        }
    };
    let [nx, ny, nz] = file.dims_xyz.ok_or_else(|| bad("dims_xyz", "three counts", &"nothing"))?;
    let shape = GridShape::new(nx, ny, nz);
    let Some(count) = shape.checked_len().filter(|&cells| cells <= MAX_CELLS) else {
        return Err(bad("dims_xyz", "1 to 2^28 cells", &format!("{nx} × {ny} × {nz}")));
    };
    let cell_m = match file.cell_m {
        Some(CellSize::Cube(edge)) => [edge; 3],
        Some(CellSize::Box(edges)) => edges,
        None => return Err(bad("cell_m", "an edge in metres, or three", &"nothing")),
    };
    let origin =
        file.origin_m.ok_or_else(|| bad("origin_m", "the grid's corner, three metres", &"nothing"))?;
    let kappa = if file.extinction_file.is_some() {
        1.0
    } else {
        optics
            .kappa_per_m
            .or(file.kappa_per_m)
            .ok_or_else(|| bad("kappa_per_m", "extinction of density 1, 1/m", &"nothing"))?
    };
    if !(0.0..=MOST_KAPPA).contains(&kappa) {
        return Err(bad("kappa_per_m", "0 to 100, 1/m", &kappa));
    }
    let boundary = match file.boundary.as_deref() {
        None | Some("open") => Boundary::Open,
        Some("periodic_xy") => Boundary::PeriodicXy,
        Some(other) => return Err(bad("boundary", "\"open\" or \"periodic_xy\"", &format!("\"{other}\""))),
    };
    let albedo = optics.albedo.or(file.albedo).ok_or_else(|| bad("albedo", "0 to 1", &"nothing"))?;
    let g = optics.g.or(file.g).ok_or_else(|| bad("g", "between -1 and 1", &"nothing"))?;
    let grid_path = beside(path, grid_file);
    let extinction: Vec<f32> =
        read_grid(&grid_path, count)?.into_iter().map(|rho| (f64::from(rho) * kappa) as f32).collect();
    let longest = cell_m.iter().fold(0.0f64, |most, &edge| most.max(edge));
    let densest = extinction.iter().fold(0.0f32, |most, &value| most.max(value));
    if f64::from(densest) * longest > MOST_DEPTH {
        let found = format!("{:.3e}", f64::from(densest) * longest);
        return Err(bad("extinction", "cells of optical depth up to 10000", &found));
    }
    let cloud = Cloud { shape, cell_m, origin_m: DVec3::from_array(origin), extinction, albedo, g, boundary };
    let cloud = cloud.checked().map_err(|error| named(path, error))?;
    let mut lights = Vec::new();
    for (i, light) in file.lights.iter().enumerate() {
        let name = light.name.clone().unwrap_or_else(|| format!("light{i}"));
        lights.push((name, light.read(path, &format!("lights[{i}]"))?));
    }
    let mut cameras = Vec::new();
    for (i, camera) in file.cameras.iter().enumerate() {
        let name = camera.name.clone().unwrap_or_else(|| format!("camera{i}"));
        cameras.push((name, camera.read(path, &format!("cameras[{i}]"))?));
    }
    check_names(path, "lights", lights.iter().map(|(name, _)| name))?;
    check_names(path, "cameras", cameras.iter().map(|(name, _)| name))?;
    Ok(Scene { file: path.to_owned(), inputs: vec![grid_path], cloud, lights, cameras })
}

/// Names tell lights and cameras apart, on the command line and in the names of files.
fn check_names<'a>(
    path: &Path,
    list: &str,
    names: impl Iterator<Item = &'a String>,
) -> Result<(), BakeError> {
    let mut seen = std::collections::HashSet::new();
    for (i, name) in names.enumerate() {
        let bad = |wanted: &str| {
            Err(BakeError::input(path, format!("{list}[{i}].name"), wanted, format!("{name:?}")))
        };
        if name.is_empty() || name.len() > 100 || name.chars().any(|c| c.is_control() || "/\\".contains(c)) {
            return bad("1 to 100 characters that can be part of a file's name");
        }
        if !seen.insert(name) {
            return bad("a name of its own");
        }
    }
    Ok(())
}

/// Extinction of density 1 beyond which a unit was mistaken, 1/m.
const MOST_KAPPA: f64 = 100.0;
/// Optical depth of one cell beyond which nothing inside it can be told apart, and solving takes for ever.
const MOST_DEPTH: f64 = 1e4;

/// More cells than this are refused before memory is taken.
const MAX_CELLS: usize = 1 << 28;

/// Reads LAMPS.json: a list of point sources. Keys other than position and intensity are for people.
pub fn read_lights(path: &Path) -> Result<Vec<PointLight>, BakeError> {
    let list: Vec<LightFile> = read_json(path, "a list of lamps (LAMPS.json)")?;
    let point = |(i, light): (usize, &LightFile)| {
        let (position, intensity) = light.read_point(path, &format!("[{i}]"))?;
        Ok(PointLight { position, intensity })
    };
    list.iter().enumerate().map(point).collect()
}

/// Reads CAMERA.json: one camera object of a scene. Its name is "camera" where the file gives none.
pub fn read_camera(path: &Path) -> Result<(String, Camera), BakeError> {
    let camera: CameraFile = read_json(path, "one camera (CAMERA.json)")?;
    let name = camera.name.clone().unwrap_or_else(|| "camera".into());
    check_names(path, "camera", std::iter::once(&name))?;
    Ok((name, camera.read(path, "camera")?))
}

/// A file named inside another, relative to that one's folder.
pub fn beside(file: &Path, named: &Path) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).join(named)
}

/// Puts a file's name in front of a refused argument that came from it.
fn named(path: &Path, error: squall_runtime::RuntimeError) -> BakeError {
    match error {
        squall_runtime::RuntimeError::Argument { field, wanted, found } => {
            BakeError::input(path, field, wanted, found)
        }
        other => BakeError::Asset(other),
    }
}

impl LightFile {
    fn read(&self, path: &Path, place: &str) -> Result<Light, BakeError> {
        match self.kind.as_deref() {
            None | Some("point") => {
                let (position, intensity) = self.read_point(path, place)?;
                Ok(Light::Point { position, intensity })
            }
            Some("beam") => {
                let direction = vector(path, place, "direction", self.direction)?.try_normalize();
                let zero = || {
                    BakeError::input(path, format!("{place}.direction"), "a vector that is not zero", "zero")
                };
                Ok(Light::Beam {
                    direction: direction.ok_or_else(zero)?,
                    irradiance: power(path, place, "irradiance_W_per_m2", self.irradiance)?,
                })
            }
            Some(other) => {
                let wanted = "\"point\" or \"beam\"";
                Err(BakeError::input(path, format!("{place}.type"), wanted, format!("\"{other}\"")))
            }
        }
    }

    fn read_point(&self, path: &Path, place: &str) -> Result<(DVec3, f64), BakeError> {
        Ok((
            vector(path, place, "position_m", self.position_m)?,
            power(path, place, "intensity_W_per_sr", self.intensity)?,
        ))
    }
}

fn vector(path: &Path, place: &str, field: &str, value: Option<[f64; 3]>) -> Result<DVec3, BakeError> {
    let missing = || BakeError::input(path, format!("{place}.{field}"), "three numbers", "nothing");
    value.map(DVec3::from_array).ok_or_else(missing)
}

/// JSON has no infinities, and its reader refuses numbers that round to one.
fn power(path: &Path, place: &str, field: &str, value: Option<f64>) -> Result<f64, BakeError> {
    let bad = |wanted: &str, found: String| BakeError::input(path, format!("{place}.{field}"), wanted, found);
    match value {
        Some(value) if value >= 0.0 => Ok(value),
        Some(value) => Err(bad("not negative", value.to_string())),
        None => Err(bad("a number", "nothing".into())),
    }
}

impl CameraFile {
    fn read(&self, path: &Path, place: &str) -> Result<Camera, BakeError> {
        let bad = |field: &str, wanted: &str, found: String| {
            BakeError::input(path, format!("{place}.{field}"), wanted, found)
        };
        let aspect = f64::from(self.width) / f64::from(self.height.max(1));
        let vector = |value: [f64; 3]| DVec3::from_array(value);
        let up = self.up.map_or(DVec3::Z, vector);
        let size = [self.width, self.height];
        let (position, direction, projection) = match self.kind.as_deref() {
            None | Some("perspective") => {
                let origin = self.origin_m.map(vector);
                let origin = origin.ok_or_else(|| bad("origin_m", "the eye point", "nothing".into()))?;
                let direction = match (self.target_m, self.direction) {
                    (Some(target), _) => vector(target) - origin,
                    (None, Some(direction)) => vector(direction),
                    (None, None) => return Err(bad("target_m", "a target or a direction", "neither".into())),
                };
                let vertical = match (self.vertical_fov_deg, self.horizontal_fov_deg) {
                    (Some(degrees), None) => Radians(degrees.to_radians()),
                    (None, Some(degrees)) if degrees > 0.0 && degrees < 180.0 => {
                        vertical_from_horizontal(Radians(degrees.to_radians()), aspect)
                    }
                    (None, Some(degrees)) => {
                        return Err(bad("horizontal_fov_deg", "between 0 and 180", degrees.to_string()));
                    }
                    (Some(_), Some(_)) => {
                        return Err(bad("vertical_fov_deg", "one field of view", "two".into()));
                    }
                    (None, None) => {
                        let wanted = "vertical_fov_deg or horizontal_fov_deg";
                        return Err(bad("vertical_fov_deg", wanted, "neither".into()));
                    }
                };
                (origin, direction, Projection::Perspective { vertical_fov: vertical })
            }
            Some("orthographic") => {
                let target = self.target_m.or(self.origin_m).map(vector);
                let target = target.ok_or_else(|| bad("target_m", "the plane's centre", "nothing".into()))?;
                let direction = self.direction.map(vector);
                let direction =
                    direction.ok_or_else(|| bad("direction", "the viewing direction", "nothing".into()))?;
                let (Some(half_width), Some(half_height)) = (self.half_width_m, self.half_height_m) else {
                    return Err(bad("half_width_m", "half_width_m and half_height_m", "not both".into()));
                };
                (target, direction, Projection::Orthographic { half_width, half_height })
            }
            Some(other) => {
                return Err(bad("type", "\"perspective\" or \"orthographic\"", format!("\"{other}\"")));
            }
        };
        Camera::new(position, direction, up, projection, size).map_err(|error| match error {
            squall_runtime::RuntimeError::Argument { field, wanted, found } => {
                BakeError::input(path, format!("{place}: {field}"), wanted, found)
            }
            other => BakeError::Asset(other),
        })
    }
}
