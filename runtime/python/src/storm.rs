//! `squall.open`: pictures of a baked storm.

use crate::arrays::{light, picture};
use crate::{refused, wanted};
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use squall_runtime::formats::units::{MillimetresPerHour, Seconds};
use squall_runtime::frame::FlashCurve;
use squall_runtime::{Flash, Frame, StormRenderer};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// An open asset that draws pictures.
#[pyclass(module = "squall")]
pub struct Storm {
    renderer: StormRenderer,
}

/// Opens an asset that `squall bake` made.
#[pyfunction]
pub fn open(path: PathBuf) -> PyResult<Storm> {
    Ok(Storm { renderer: StormRenderer::open(path).map_err(refused)? })
}

#[pymethods]
impl Storm {
    /// Names of the asset's strokes.
    #[getter]
    fn strokes(&self) -> Vec<String> {
        self.renderer.strokes().iter().map(|record| record.name.clone()).collect()
    }

    /// Width and height of the asset's own view, px; None where it brings none.
    #[getter]
    fn size(&self) -> Option<(u32, u32)> {
        self.renderer.view().map(|view| (view.camera.size_px[0], view.camera.size_px[1]))
    }

    /// Draws the asset's own view: linear radiance, float32 of shape (height, width, 3). What is left out is as in the asset;
    /// `flashes` says how brightly each stroke flashes, by name.
    #[pyo3(signature = (*, rate = None, time = None, exposure_ms = None, flashes = None, size = None, samples = 2))]
    fn render<'py>(
        &mut self,
        py: Python<'py>,
        rate: Option<f64>,
        time: Option<f64>,
        exposure_ms: Option<f64>,
        flashes: Option<BTreeMap<String, f64>>,
        size: Option<[u32; 2]>,
        samples: u32,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let frame = self.renderer.frame().ok_or_else(|| wanted("asset", "one that brings a view", "none"))?;
        let mut frame: Frame = frame;
        if let Some(rate) = rate {
            frame = frame.rain(MillimetresPerHour(rate));
        }
        if let Some(time) = time {
            frame = frame.time(Seconds(time));
        }
        if let Some(milliseconds) = exposure_ms {
            frame = frame.exposure(Seconds(milliseconds * 1e-3));
        }
        if let Some(size) = size {
            frame.camera = frame.camera.resized(size).map_err(refused)?;
        }
        if let Some(flashes) = flashes {
            frame = frame.dark();
            for (stroke, brightness) in flashes {
                frame = frame.flash(Flash::named(stroke).brightness(brightness));
            }
        }
        if !(1..=8).contains(&samples) {
            return Err(wanted("samples", "1 to 8", samples));
        }
        frame.quality.town.samples = samples;
        let renderer = &mut self.renderer;
        py.detach(|| renderer.render(&frame).map(|_| ())).map_err(refused)?;
        let drawn = self.renderer.picture();
        light(py, drawn.pixels.clone(), [drawn.width, drawn.height])
    }

    /// Develops a picture for a display as the asset's author wants it: uint8 sRGB of the same shape.
    fn develop<'py>(&self, py: Python<'py>, radiance: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let (picture, _) = picture(radiance)?;
        let tone = self.renderer.tone();
        let pixels = py.detach(|| tone.to_srgb8(&picture));
        PyArray1::from_vec(py, pixels.into_flattened()).reshape([picture.height, picture.width, 3])
    }

    /// Mean brightness of a natural flash in each of several exposures: the first return stroke begins at time 0. Times in s.
    #[staticmethod]
    fn flash_curve(seed: u64, opens: Vec<f64>, exposure: f64) -> Vec<f64> {
        let curve = FlashCurve::natural(seed);
        opens.into_iter().map(|time| curve.mean(Seconds(time), Seconds(exposure))).collect()
    }
}
