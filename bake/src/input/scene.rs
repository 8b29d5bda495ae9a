//! SCENE.json, LAMPS.json and CAMERA.json: a grid with its optics, lights and cameras.

use crate::error::BakeError;
use crate::input::facts::{self, Order};
use crate::input::json::{parse_json, read_text_input};
use crate::input::vdb::Up;
use crate::input::volume::{Kind, MAX_CELLS, Volume, kind_of_grid, read_npy_file, read_vdb_file};
use crate::input::{Fingerprint, read_grid_file, read_json};
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
    /// Every file that was read for it, as it was when it was read: the scene's own, then the grid that it names.
    pub inputs: Vec<Fingerprint>,
    /// What was done to the grid that the file holds, in words; "as given" where nothing was.
    pub grid_made: String,
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

/// Keys of SCENE.json. Those from `note` on describe: they change nothing, but facts among them are checked.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
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
    grid: Option<String>,
    up: Option<UpName>,
    metres_per_unit: Option<f64>,
    resample_to: Option<[u32; 3]>,
    #[serde(default)]
    lights: Vec<LightFile>,
    #[serde(default)]
    cameras: Vec<CameraFile>,
    analytic_shape: Option<serde_json::Value>,
    #[serde(rename = "name")]
    _name: Option<String>,
    #[serde(rename = "note")]
    _note: Option<serde_json::Value>,
    units: Option<serde_json::Value>,
    index: Option<String>,
    interpolation: Option<String>,
    sigma_t_max_per_m: Option<f64>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum UpName {
    Y,
    Z,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum CellSize {
    Cube(f64),
    Box([f64; 3]),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
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
    #[serde(rename = "note")]
    _note: Option<serde_json::Value>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
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
    #[serde(rename = "note")]
    _note: Option<serde_json::Value>,
}

const SCENE: &str = "a scene (SCENE.json)";

/// The files that a scene stands in: its own, then the grid that it names. The grid is not read.
///
/// Errors: a scene that cannot be read, or names no grid.
pub fn scene_files(path: &Path) -> Result<[PathBuf; 2], BakeError> {
    let file: SceneFile = read_json(path, SCENE)?;
    Ok([path.to_owned(), beside(path, file.grid_file(path)?)])
}

/// Reads a scene and the grid that it names.
///
/// `optics` override what the file says. Errors: anything missing, unknown, of another type or outside its range, a fact in words
/// that is not so, and a scene that has shapes in place of a grid.
pub fn read_scene(path: &Path, optics: Optics) -> Result<Scene, BakeError> {
    let input = read_text_input(path)?;
    let file: SceneFile = parse_json(&input, SCENE)?;
    let (cloud, grid, grid_made) = file.cloud(path, optics)?;
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
    Ok(Scene {
        file: path.to_owned(),
        inputs: vec![input.fingerprint(), grid],
        grid_made,
        cloud,
        lights,
        cameras,
    })
}

impl SceneFile {
    /// The grid's file, as it is named.
    fn grid_file(&self, path: &Path) -> Result<&Path, BakeError> {
        match (&self.density_file, &self.extinction_file) {
            (Some(grid), None) | (None, Some(grid)) => Ok(grid),
            (Some(_), Some(_)) => {
                Err(BakeError::input(path, "density_file and extinction_file", "one of the two", "both"))
            }
            (None, None) => {
                let shape = self.analytic_shape.is_some();
                let found = if shape { "an analytic shape and no grid" } else { "neither" };
                Err(BakeError::input(path, "density_file", "a grid: density_file or extinction_file", found))
            }
        }
    }

    /// Refuses what the file says of itself in words where that is not so; the grid's order otherwise.
    fn facts(&self, path: &Path) -> Result<Order, BakeError> {
        let bad = |field: &str, (wanted, found): facts::Refusal| BakeError::input(path, field, wanted, found);
        if let Some(units) = &self.units {
            facts::units(units).map_err(|refusal| bad("units", refusal))?;
        }
        if let Some(stated) = &self.interpolation {
            facts::interpolation(stated).map_err(|refusal| bad("interpolation", refusal))?;
        }
        let order = self.index.as_deref().map_or(Ok(Order::XFastest), facts::order);
        order.map_err(|refusal| bad("index", refusal))
    }

    /// The cloud, which file its grid came from, and what was done to that.
    fn cloud(&self, path: &Path, optics: Optics) -> Result<(Cloud, Fingerprint, String), BakeError> {
        let bad = |field: &str, wanted: &str, found: &dyn std::fmt::Display| {
            BakeError::input(path, field, wanted, found)
        };
        let order = self.facts(path)?;
        let boundary = match self.boundary.as_deref() {
            None | Some("open") => Boundary::Open,
            Some("periodic_xy") => Boundary::PeriodicXy,
            Some(other) => {
                return Err(bad("boundary", "\"open\" or \"periodic_xy\"", &format!("\"{other}\"")));
            }
        };
        let albedo = optics.albedo.or(self.albedo).ok_or_else(|| bad("albedo", "0 to 1", &"nothing"))?;
        let g = optics.g.or(self.g).ok_or_else(|| bad("g", "between -1 and 1", &"nothing"))?;
        let kappa = self.kappa(path, optics)?;
        let (volume, input) = self.volume(path, order)?;
        let (volume, made) = self.brought_to_cells(path, volume, &input.path)?;
        let Volume { shape, cell_m, origin_m, values } = volume;
        let extinction = self.extinction(path, &values, kappa, cell_m)?;
        if let (Some(stated), None) = (self.sigma_t_max_per_m, optics.kappa_per_m) {
            let densest = extinction.iter().fold(0.0f32, |most, &value| most.max(value));
            facts::largest_extinction(stated, f64::from(densest))
                .map_err(|(wanted, found)| bad("sigma_t_max_per_m", wanted, &found))?;
        }
        let cloud = Cloud { shape, cell_m, origin_m, extinction, albedo, g, boundary };
        Ok((cloud.checked().map_err(|error| named(path, error))?, input, made))
    }

    /// The grid as its file holds it, where the scene or the file says that it lies.
    fn volume(&self, path: &Path, order: Order) -> Result<(Volume, Fingerprint), BakeError> {
        let bad = |field: &str, wanted: &str, found: &dyn std::fmt::Display| {
            BakeError::input(path, field, wanted, found)
        };
        let file = beside(path, self.grid_file(path)?);
        let kind = kind_of_grid(&file)?;
        if kind == Kind::Vdb {
            return self.vdb(path, &file);
        }
        let only_vdb = [
            ("grid", self.grid.is_some()),
            ("up", self.up.is_some()),
            ("metres_per_unit", self.metres_per_unit.is_some()),
        ];
        if let Some((key, _)) = only_vdb.iter().find(|(_, stated)| *stated) {
            return Err(bad(key, "nothing: only an OpenVDB file has it open", &"a value"));
        }
        let cell_m = match self.cell_m {
            Some(CellSize::Cube(edge)) => [edge; 3],
            Some(CellSize::Box(edges)) => edges,
            None => return Err(bad("cell_m", "an edge in metres, or three", &"nothing")),
        };
        let origin =
            self.origin_m.ok_or_else(|| bad("origin_m", "the grid's corner, three metres", &"nothing"))?;
        let origin_m = DVec3::from_array(origin);
        if kind == Kind::Npy {
            if self.index.is_some() {
                return Err(bad("index", "nothing: the array says it itself", &"words"));
            }
            let (shape, values, input) = read_npy_file(&file)?;
            if let Some(stated) = self.dims_xyz.filter(|&[nx, ny, nz]| GridShape::new(nx, ny, nz) != shape) {
                let [nx, ny, nz] = shape.to_array();
                return Err(bad(
                    "dims_xyz",
                    &format!("{nx} × {ny} × {nz}, as the array has"),
                    &shown(stated),
                ));
            }
            return Ok((Volume { shape, cell_m, origin_m, values }, input));
        }
        let dims = self.dims_xyz.ok_or_else(|| bad("dims_xyz", "three counts", &"nothing"))?;
        let shape = checked_shape(path, "dims_xyz", dims)?;
        let grid = read_grid_file(&file, shape.len())?;
        let values = match order {
            Order::XFastest => grid.values,
            Order::ZFastest => x_fastest(&grid.values, dims.map(|n| n as usize)),
        };
        Ok((Volume { shape, cell_m, origin_m, values }, grid.input))
    }

    /// An OpenVDB grid: the file says its cells and where it lies, unless the scene moves it.
    fn vdb(&self, path: &Path, file: &Path) -> Result<(Volume, Fingerprint), BakeError> {
        let of_file = [
            ("dims_xyz", self.dims_xyz.is_some()),
            ("cell_m", self.cell_m.is_some()),
            ("index", self.index.is_some()),
        ];
        if let Some((key, _)) = of_file.iter().find(|(_, stated)| *stated) {
            let wanted =
                "nothing: the OpenVDB file says it (metres_per_unit scales it, resample_to cuts it anew)";
            return Err(BakeError::input(path, *key, wanted, "a value"));
        }
        let unit = self.metres_per_unit.unwrap_or(1.0);
        if !(unit > 0.0 && unit.is_finite()) {
            return Err(BakeError::input(path, "metres_per_unit", "above 0, m", unit));
        }
        let up = match self.up {
            None | Some(UpName::Z) => Up::Z,
            Some(UpName::Y) => Up::Y,
        };
        let (mut volume, input) = read_vdb_file(file, self.grid.as_deref(), up, unit)?;
        if let Some(origin) = self.origin_m {
            volume.origin_m = DVec3::from_array(origin);
        }
        Ok((volume, input))
    }

    /// The grid in the cells that `resample_to` asks for, and what was done, in words.
    fn brought_to_cells(
        &self,
        path: &Path,
        given: Volume,
        file: &Path,
    ) -> Result<(Volume, String), BakeError> {
        let Some(counts) = self.resample_to else { return Ok((given, "as given".into())) };
        let shape = checked_shape(path, "resample_to", counts)?;
        if shape == given.shape {
            return Ok((given, "as given".into()));
        }
        let new = given.resampled(shape);
        let change = if given.mass() > 0.0 { new.mass() / given.mass() - 1.0 } else { 0.0 };
        let [nx, ny, nz] = given.shape.to_array();
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let edges = |cell: [f64; 3]| cell.map(|edge| format!("{edge:.4}")).join(" × ");
        let made = format!(
            "means of {name}'s {nx} × {ny} × {nz} cells of {} m, now {} m; mass changed by {change:.1e}",
            edges(given.cell_m),
            edges(new.cell_m),
        );
        Ok((new, made))
    }

    /// Extinction of density 1, 1/m.
    fn kappa(&self, path: &Path, optics: Optics) -> Result<f64, BakeError> {
        if self.extinction_file.is_some() {
            return Ok(1.0);
        }
        let wanted = "extinction of density 1, 0 or more, 1/m";
        match optics.kappa_per_m.or(self.kappa_per_m) {
            Some(kappa) if kappa >= 0.0 && kappa.is_finite() => Ok(kappa),
            Some(kappa) => Err(BakeError::input(path, "kappa_per_m", wanted, kappa)),
            None => Err(BakeError::input(path, "kappa_per_m", wanted, "nothing")),
        }
    }

    /// Extinction of every cell, 1/m, in the file's order. What is bounded is what matters: the extinction, and a cell's optical
    /// depth; density and kappa may have any units that cancel.
    fn extinction(
        &self,
        path: &Path,
        values: &[f32],
        kappa: f64,
        cell_m: [f64; 3],
    ) -> Result<Vec<f32>, BakeError> {
        let densest = values.iter().fold(0.0f32, |most, &rho| most.max(rho));
        let extinction = f64::from(densest) * kappa;
        let longest = cell_m.iter().fold(0.0f64, |most, &edge| most.max(edge));
        let from = match self.extinction_file {
            Some(_) => String::new(),
            None => format!(" (density {densest} × kappa_per_m {kappa})"),
        };
        if extinction > MOST_EXTINCTION {
            let wanted = format!("at most {MOST_EXTINCTION}, 1/m");
            return Err(BakeError::input(path, "extinction", wanted, format!("{extinction:.3e}{from}")));
        }
        if extinction * longest > MOST_DEPTH {
            let wanted = format!("cells of optical depth up to {MOST_DEPTH}");
            let found =
                format!("{:.3e}, of {extinction:.3e} 1/m{from} over {longest} m", extinction * longest);
            return Err(BakeError::input(path, "extinction", wanted, found));
        }
        Ok(values.iter().map(|&rho| (f64::from(rho) * kappa) as f32).collect())
    }
}

/// Counts of cells that are not too many. Errors: 0 along an axis, more than 2²⁸ in all.
fn checked_shape(path: &Path, field: &str, counts: [u32; 3]) -> Result<GridShape, BakeError> {
    let [nx, ny, nz] = counts;
    let shape = GridShape::new(nx, ny, nz);
    match shape.checked_len().filter(|&cells| cells <= MAX_CELLS) {
        Some(_) => Ok(shape),
        None => Err(BakeError::input(path, field, "1 to 2^28 cells", shown(counts))),
    }
}

fn shown([nx, ny, nz]: [u32; 3]) -> String {
    format!("{nx} × {ny} × {nz}")
}

/// A grid whose file has z fastest, with x fastest.
fn x_fastest(values: &[f32], [nx, ny, nz]: [usize; 3]) -> Vec<f32> {
    let mut out = Vec::with_capacity(values.len());
    for z in 0..nz {
        for y in 0..ny {
            out.extend((0..nx).map(|x| values[(x * ny + y) * nz + z]));
        }
    }
    out
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

/// Extinction beyond which a unit was mistaken, 1/m: milk has some 10³, the densest fog .1.
const MOST_EXTINCTION: f64 = 1e5;
/// Optical depth of one cell beyond which nothing inside it can be told apart, and solving takes for ever.
const MOST_DEPTH: f64 = 1e4;

/// Reads LAMPS.json: a list of point lights. Keys `name` and `note` are for people.
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
fn named(path: &Path, error: impl Into<squall_runtime::RuntimeError>) -> BakeError {
    match error.into() {
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
