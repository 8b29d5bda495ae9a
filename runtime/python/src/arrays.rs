//! Pictures and depths from numpy arrays, and back.

use crate::{refused, wanted};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use squall_runtime::picture::Picture;
use squall_runtime::tone::{linear_from_srgb, srgb_from_linear};

/// What the samples of a picture are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Samples {
    /// uint8 or uint16 of an sRGB signal, by their largest value.
    Srgb(u16),
    /// float32 light.
    Linear,
}

/// A picture of shape (height, width, 3): uint8 and uint16 are sRGB, float32 is linear light.
pub fn picture(array: &Bound<'_, PyAny>) -> PyResult<(Picture, Samples)> {
    if let Ok(array) = array.extract::<PyReadonlyArray3<'_, f32>>() {
        let mut picture = blank(array.shape())?;
        // A frame in C order is copied in one go.
        match array.as_slice() {
            Ok(samples) if array.is_c_contiguous() => picture.pixels.as_flattened_mut().copy_from_slice(samples),
            _ => fill(&mut picture, array.as_array().iter().copied()),
        }
        return Ok((picture, Samples::Linear));
    }
    let table = |top: u16| -> Vec<f32> {
        (0..=top).map(|step| linear_from_srgb(f32::from(step) / f32::from(top))).collect()
    };
    if let Ok(array) = array.extract::<PyReadonlyArray3<'_, u8>>() {
        let (mut picture, light) = (blank(array.shape())?, table(255));
        fill(&mut picture, array.as_array().iter().map(|&sample| light[usize::from(sample)]));
        return Ok((picture, Samples::Srgb(255)));
    }
    if let Ok(array) = array.extract::<PyReadonlyArray3<'_, u16>>() {
        let (mut picture, light) = (blank(array.shape())?, table(65_535));
        fill(&mut picture, array.as_array().iter().map(|&sample| light[usize::from(sample)]));
        return Ok((picture, Samples::Srgb(65_535)));
    }
    let kind = array.get_type().name()?;
    Err(wanted("rgb", "an array of shape (height, width, 3) of uint8, uint16 (sRGB) or float32 (linear)", kind))
}

fn blank(shape: &[usize]) -> PyResult<Picture> {
    match *shape {
        [height, width, 3] => Picture::new(width, height).map_err(refused),
        _ => Err(wanted("rgb", "shape (height, width, 3)", format!("{shape:?}"))),
    }
}

fn fill(picture: &mut Picture, samples: impl Iterator<Item = f32>) {
    picture.pixels.as_flattened_mut().iter_mut().zip(samples).for_each(|(out, sample)| *out = sample);
}

/// A picture as an array of the kind that came: float32 without a copy.
pub fn array_of<'py>(py: Python<'py>, picture: Picture, samples: Samples) -> PyResult<Bound<'py, PyAny>> {
    let shape = [picture.height, picture.width, 3];
    let values = picture.pixels.into_flattened();
    let signal = |light: &f32, top: f32| srgb_from_linear(*light) * top + 0.5;
    match samples {
        Samples::Linear => Ok(PyArray1::from_vec(py, values).reshape(shape)?.into_any()),
        Samples::Srgb(255) => {
            let values = values.iter().map(|light| signal(light, 255.0) as u8).collect();
            Ok(PyArray1::from_vec(py, values).reshape(shape)?.into_any())
        }
        Samples::Srgb(top) => {
            let values = values.iter().map(|light| signal(light, f32::from(top)) as u16).collect();
            Ok(PyArray1::from_vec(py, values).reshape(shape)?.into_any())
        }
    }
}

/// Light of a picture as float32 of shape (height, width, 3), without a copy.
pub fn light<'py>(py: Python<'py>, pixels: Vec<[f32; 3]>, size: [usize; 2]) -> PyResult<Bound<'py, PyArray3<f32>>> {
    PyArray1::from_vec(py, pixels.into_flattened()).reshape([size[1], size[0], 3])
}

/// Shares as float32 of shape (height, width), without a copy.
pub fn shares<'py>(py: Python<'py>, values: Vec<f32>, size: [usize; 2]) -> PyResult<Bound<'py, PyArray2<f32>>> {
    PyArray1::from_vec(py, values).reshape([size[1], size[0]])
}

/// A depth: read where it lies, or converted.
pub enum Depth<'py> {
    /// float32 in C order.
    Here(PyReadonlyArray2<'py, f32>),
    /// Anything else.
    Copied(Vec<f32>),
}

impl<'py> Depth<'py> {
    /// A depth of shape (height, width): float32 or float64 in metres (or pixels of disparity) times `scale`, uint16 by `scale`.
    pub fn of(array: &Bound<'py, PyAny>, size: [usize; 2], scale: Option<f64>, disparity: Option<f64>) -> PyResult<Self> {
        let check = |shape: &[usize]| match *shape == [size[1], size[0]] {
            true => Ok(()),
            false => Err(wanted("depth", &format!("shape ({}, {}), the picture's", size[1], size[0]), format!("{shape:?}"))),
        };
        if let Some(scale) = scale
            && !(scale > 0.0 && scale.is_finite())
        {
            return Err(wanted("depth_scale", "a number above 0", scale));
        }
        let metres = |value: f64| match disparity {
            Some(baseline_focal) if value > 0.0 => (baseline_focal / value) as f32,
            Some(_) => 0.0,
            None => value as f32,
        };
        if let Ok(array) = array.extract::<PyReadonlyArray2<'py, f32>>() {
            check(array.shape())?;
            if scale.is_none() && disparity.is_none() && array.is_c_contiguous() {
                return Ok(Self::Here(array));
            }
            let factor = scale.unwrap_or(1.0);
            return Ok(Self::Copied(array.as_array().iter().map(|&value| metres(f64::from(value) * factor)).collect()));
        }
        if let Ok(array) = array.extract::<PyReadonlyArray2<'py, f64>>() {
            check(array.shape())?;
            let factor = scale.unwrap_or(1.0);
            return Ok(Self::Copied(array.as_array().iter().map(|&value| metres(value * factor)).collect()));
        }
        if let Ok(array) = array.extract::<PyReadonlyArray2<'py, u16>>() {
            check(array.shape())?;
            let scale = scale.ok_or_else(|| {
                wanted("depth_scale", "how many steps of a uint16 depth are one metre (KITTI 256, TUM 5000)", "None")
            })?;
            return Ok(Self::Copied(array.as_array().iter().map(|&value| metres(f64::from(value) / scale)).collect()));
        }
        let kind = array.get_type().name()?;
        Err(wanted("depth", "an array of shape (height, width) of float32, float64 or uint16", kind))
    }

    /// The numbers.
    pub fn metres(&self) -> PyResult<&[f32]> {
        match self {
            Self::Here(array) => Ok(array.as_slice()?),
            Self::Copied(values) => Ok(values),
        }
    }
}
