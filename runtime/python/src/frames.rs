//! `squall.Rain`: rain over frames.

use crate::arrays::{Depth, array_of, light, picture, shares};
use crate::{refused, wanted};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use squall_runtime::camera::{Intrinsics, Projection};
use squall_runtime::depth::{DepthBuffer, DepthHoles, DepthKind};
use squall_runtime::formats::units::{Degrees, Metres, MillimetresPerHour, Seconds};
use squall_runtime::frame_rain::{FrameRain, FrameRainSettings, TakenFrame};
use squall_runtime::glam::{DMat3, DVec3};
use squall_runtime::world::WorldLight;
use squall_runtime::{Asset, Camera};
use std::path::PathBuf;

/// The light of a world, as drops hand it on: taken from one frame and given to the others of its sequence.
#[pyclass(frozen, module = "squall")]
pub struct Light {
    world: WorldLight,
}

#[pymethods]
impl Light {
    /// Spherical harmonics of the radiance of the whole sphere, float32 of shape (9 or 169, 3).
    fn coefficients<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let all = self.world.coefficients();
        let count = all.len();
        PyArray1::from_vec(py, all.into_flattened()).reshape([count, 3])
    }

    /// A light from `coefficients()`.
    #[staticmethod]
    fn from_coefficients(coefficients: Vec<[f32; 3]>) -> PyResult<Self> {
        let world = WorldLight::from_coefficients(&coefficients, None).map_err(refused)?;
        Ok(Self { world })
    }

    /// The same radiance from everywhere, in the frames' own linear unit.
    #[staticmethod]
    fn uniform(radiance: [f32; 3]) -> Self {
        Self { world: WorldLight::uniform(radiance) }
    }
}

/// A frame in rain, with its labels.
#[pyclass(frozen, module = "squall")]
pub struct Rained {
    /// The rainy frame, of the kind that came.
    #[pyo3(get)]
    image: Py<PyAny>,
    /// Coverage of the streaks, float32 of shape (height, width), 0 to 1.
    #[pyo3(get)]
    mask: Py<PyArray2<f32>>,
    /// Transmittance of the rain between camera and scene, the same.
    #[pyo3(get)]
    transmittance: Py<PyArray2<f32>>,
    /// Light that the rain scatters in, float32 of shape (height, width, 3).
    #[pyo3(get)]
    in_scattered: Py<PyArray3<f32>>,
    /// Arrays by name, an entry a streak: id, diameter_mm, distance_m, depth_m, ends_px, width_px, alpha, visible.
    #[pyo3(get)]
    streaks: Py<PyDict>,
    /// The light that the rain was in: give it to the other frames of a sequence.
    #[pyo3(get)]
    light: Py<Light>,
    /// Pixels without a depth.
    #[pyo3(get)]
    holes: usize,
}

/// Puts rain over frames; keeps tables, patterns and memory from one to the next.
#[pyclass(module = "squall")]
pub struct Rain {
    rain: FrameRain,
}

/// Everything that tells one call from another.
struct Call {
    settings: FrameRainSettings,
    camera: Camera,
    velocity: DVec3,
    time: f64,
    kind: DepthKind,
    holes: DepthHoles,
}

#[pymethods]
impl Rain {
    /// The rain of an asset, or a small built-in one.
    #[new]
    #[pyo3(signature = (asset = None))]
    fn new(asset: Option<PathBuf>) -> PyResult<Self> {
        let rain = match asset {
            Some(path) => FrameRain::new(&Asset::open(path).map_err(refused)?),
            None => FrameRain::built_in(),
        };
        Ok(Self { rain: rain.map_err(refused)? })
    }

    /// Rains on a frame; the arrays that come in are not changed. See `squall.rain`.
    #[pyo3(signature = (
        rgb, depth, *, rate, intrinsics = None, vertical_fov = None, exposure_ms = 20.0, time = 0.0, seed = 1,
        wind = [0.0; 3], pose = None, velocity = [0.0; 3], light = None, gain = 1.0, depth_kind = "planar",
        depth_scale = None, baseline = None, holes = "fill", sky_distance = 1000.0, streak_px = None
    ))]
    #[allow(clippy::too_many_arguments)]
    fn rain<'py>(
        &mut self,
        py: Python<'py>,
        rgb: &Bound<'py, PyAny>,
        depth: &Bound<'py, PyAny>,
        rate: f64,
        intrinsics: Option<[f64; 4]>,
        vertical_fov: Option<f64>,
        exposure_ms: f64,
        time: f64,
        seed: u64,
        wind: [f64; 3],
        pose: Option<[[f64; 4]; 4]>,
        velocity: [f64; 3],
        light: Option<Py<Light>>,
        gain: f64,
        depth_kind: &str,
        depth_scale: Option<f64>,
        baseline: Option<f64>,
        holes: &str,
        sky_distance: f64,
        streak_px: Option<[f64; 2]>,
    ) -> PyResult<Rained> {
        let (mut picture, samples) = picture(rgb)?;
        let size = [picture.width, picture.height];
        let camera = camera(size.map(|side| side as u32), intrinsics, vertical_fov, pose)?;
        let kind = match depth_kind {
            "planar" | "disparity" => DepthKind::Planar,
            "ray" => DepthKind::Range,
            other => return Err(wanted("depth_kind", "'planar', 'ray' or 'disparity'", format!("'{other}'"))),
        };
        if let Some(baseline) = baseline
            && !(baseline > 0.0 && baseline.is_finite())
        {
            return Err(wanted("baseline", "metres above 0", baseline.to_string()));
        }
        let disparity = match (depth_kind, baseline) {
            ("disparity", None) => return Err(wanted("baseline", "metres, which a disparity needs", "None")),
            ("disparity", Some(baseline)) => {
                let focal = camera.intrinsics().map_or(0.0, |lens| lens.fx);
                Some(baseline * focal)
            }
            _ => None,
        };
        let depth = Depth::of(depth, size, depth_scale, disparity)?;
        let holes = match holes {
            "fill" => DepthHoles::FillFromNeighbours,
            "leave" => DepthHoles::LeaveAlone,
            "sky" => DepthHoles::At(Metres(f64::INFINITY)),
            other => return Err(wanted("holes", "'fill', 'leave' or 'sky'", format!("'{other}'"))),
        };
        let settings = FrameRainSettings {
            rate: MillimetresPerHour(rate),
            exposure: Seconds(exposure_ms * 1e-3),
            wind: DVec3::from_array(wind),
            seed,
            gain,
            lengths_px: streak_px,
            extent: Metres(sky_distance),
        };
        let velocity = DVec3::from_array(velocity);
        let call = Call { settings, camera, velocity, time, kind, holes };
        let given = match light {
            Some(light) => light,
            None => Py::new(py, Light { world: WorldLight::estimate(&picture, &call.camera) })?,
        };
        let world = &given.get().world;
        let metres = depth.metres()?;
        let buffer = DepthBuffer::new(metres, size[0], size[1], call.kind).map_err(refused)?.with_holes(call.holes);
        let frame = TakenFrame {
            camera: &call.camera,
            velocity: call.velocity,
            time: Seconds(call.time),
            depth: Some(buffer),
            light: world,
        };
        let rain = &mut self.rain;
        let report = py.detach(|| rain.rain_on(&call.settings, &frame, &mut picture)).map_err(refused)?;
        let streaks = streaks(py, rain, &frame)?;
        Ok(Rained {
            image: array_of(py, picture, samples)?.unbind(),
            mask: shares(py, rain.mask().to_vec(), size)?.unbind(),
            transmittance: shares(py, rain.transmittance().to_vec(), size)?.unbind(),
            in_scattered: self::light(py, rain.in_scattered().to_vec(), size)?.unbind(),
            streaks: streaks.unbind(),
            light: given.clone_ref(py),
            holes: report.holes,
        })
    }
}

/// The camera of a frame. `pose` takes points of a camera whose x is right, y down and z ahead to a world whose z is up.
fn camera(
    size: [u32; 2],
    intrinsics: Option<[f64; 4]>,
    vertical_fov: Option<f64>,
    pose: Option<[[f64; 4]; 4]>,
) -> PyResult<Camera> {
    let (position, forward, up) = match pose {
        None => (DVec3::Z * 1.6, DVec3::Y, DVec3::Z),
        Some(rows) => {
            let column = |at: usize| DVec3::new(rows[0][at], rows[1][at], rows[2][at]);
            let turn = DMat3::from_cols(column(0), column(1), column(2));
            let off = (turn.transpose() * turn - DMat3::IDENTITY).to_cols_array();
            if !(off.iter().all(|value| value.abs() < 1e-2) && turn.determinant() > 0.0) {
                return Err(wanted("pose", "a 4 × 4 matrix whose first columns are a rotation", "another"));
            }
            (column(3), column(2), -column(1))
        }
    };
    let camera = match (intrinsics, vertical_fov) {
        (Some([fx, fy, cx, cy]), None) => {
            // Calibrations count from the middle of the top left pixel, the runtime from its corner.
            let lens = Intrinsics { fx, fy, cx: cx + 0.5, cy: cy + 0.5 };
            Camera::pinhole(position, forward, up, lens, size)
        }
        (None, Some(degrees)) => {
            let projection = Projection::Perspective { vertical_fov: Degrees(degrees).into() };
            Camera::new(position, forward, up, projection, size)
        }
        _ => return Err(wanted("intrinsics", "either intrinsics or vertical_fov", "both or neither")),
    };
    camera.map_err(refused)
}

fn streaks<'py>(py: Python<'py>, rain: &FrameRain, frame: &TakenFrame<'_>) -> PyResult<Bound<'py, PyDict>> {
    let labels: Vec<_> = rain.labels(frame).collect();
    let out = PyDict::new(py);
    let column = |of: fn(&squall_runtime::frame_rain::StreakLabel) -> f64| {
        PyArray1::from_vec(py, labels.iter().map(of).collect::<Vec<f64>>())
    };
    out.set_item("id", PyArray1::from_vec(py, labels.iter().map(|label| label.id).collect::<Vec<u64>>()))?;
    out.set_item("diameter_mm", column(|label| label.diameter_mm))?;
    out.set_item("distance_m", column(|label| label.distance_m))?;
    out.set_item("depth_m", column(|label| label.depth_m))?;
    let ends: Vec<f64> = labels.iter().flat_map(|label| label.ends_px).flatten().collect();
    out.set_item("ends_px", PyArray1::from_vec(py, ends).reshape([labels.len(), 2, 2])?)?;
    out.set_item("width_px", column(|label| label.width_px))?;
    out.set_item("alpha", column(|label| label.alpha))?;
    out.set_item("visible", column(|label| label.visible))?;
    Ok(out)
}
