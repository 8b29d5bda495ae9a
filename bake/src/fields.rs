//! What a light makes of a cloud, as files: per-cell fields and pictures in the layout that `squall solve` and `squall relight`
//! share. Raw little-endian f32, x fastest; pictures row 0 = top, and once more as OpenEXR.

use crate::cloud::{Truth, image::solve_image};
use crate::error::BakeError;
use crate::output::write_atomically;
use crate::picture::write_exr;
use crate::progress::Progress;
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::picture::Picture;
use std::io::Write;
use std::path::Path;

/// A quantity per cell or pixel, with its standard error where the method has one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Values.
    pub mean: Vec<f32>,
    /// One standard error each; none for a method without chance.
    pub error: Option<Vec<f32>>,
}

impl From<Vec<f32>> for Estimate {
    fn from(mean: Vec<f32>) -> Self {
        Self { mean, error: None }
    }
}

/// Fields and pictures of one light, or of several together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fields {
    /// Scattered fluence rate per cell, W/m².
    pub phi_scattered: Estimate,
    /// Never scattered fluence rate per cell, W/m².
    pub phi_direct: Estimate,
    /// J per cell towards each orthographic camera, by its name, W/(m² sr), of all orders: [`squall_formats::basis`].
    pub towards: Vec<(String, Estimate)>,
    /// 1 in cells whose light is known, 0 in others; absent where all are. [`Fields::write`]: `seen.f32`.
    pub seen: Option<Estimate>,
    /// Scattered light's radiance per pixel of each camera, by its name and width, W/(m² sr).
    pub images: Vec<(String, usize, Estimate)>,
}

/// The cameras whose rays all go one way: those that J per cell is written for.
pub fn orthographic(cameras: &[(String, Camera)]) -> impl Iterator<Item = &(String, Camera)> {
    cameras.iter().filter(|(_, camera)| matches!(camera.projection, Projection::Orthographic { .. }))
}

impl Fields {
    /// Collects a solved cloud's fields and renders its pictures. `truth` was solved towards the orthographic ones of
    /// `cameras`, in their order.
    ///
    /// Errors: an interruption.
    pub fn of_truth(
        truth: &Truth,
        cameras: &[(String, Camera)],
        progress: &dyn Progress,
    ) -> Result<Self, BakeError> {
        let towards = orthographic(cameras).enumerate();
        let towards = towards
            .map(|(i, (name, camera))| (name.clone(), truth.towards(i, -camera.forward).into()))
            .collect();
        let mut images = Vec::with_capacity(cameras.len());
        for (name, camera) in cameras {
            progress.begin(&format!("image {name}"), u64::from(camera.height));
            let image = solve_image(truth, camera, progress)?;
            images.push((name.clone(), camera.width as usize, image.into()));
        }
        Ok(Self {
            phi_scattered: truth.phi_scattered().into(),
            phi_direct: truth.phi_direct().into(),
            towards,
            seen: None,
            images,
        })
    }

    /// Names of the files that [`Fields::write`] makes.
    pub fn file_names(&self) -> Vec<String> {
        let mut names = Vec::new();
        let mut add = |name: String, estimate: &Estimate| {
            names.push(format!("{name}.f32"));
            names.extend(estimate.error.as_ref().map(|_| format!("{name}_se.f32")));
        };
        add("phi_sc".into(), &self.phi_scattered);
        add("phi_dir".into(), &self.phi_direct);
        self.seen.iter().for_each(|seen| add("seen".into(), seen));
        self.towards.iter().for_each(|(camera, j)| add(format!("jcam_{camera}"), j));
        self.images.iter().for_each(|(camera, _, image)| add(format!("image_{camera}"), image));
        names.extend(self.images.iter().map(|(camera, ..)| format!("image_{camera}.exr")));
        names
    }

    /// Writes everything into `folder`, which exists: `phi_sc.f32`, `phi_dir.f32`, `seen.f32` where not all are, `jcam_<camera>.f32`,
    /// `image_<camera>.f32`
    /// and `.exr`, and `<name>_se.f32` beside each `.f32` that has errors. Returns the files' names. Each file appears whole
    /// or not at all.
    ///
    /// Errors: what writing meets.
    pub fn write(&self, folder: &Path) -> Result<Vec<String>, BakeError> {
        let mut names = Vec::new();
        let mut write = |name: String, estimate: &Estimate| -> Result<(), BakeError> {
            let errors = estimate.error.as_ref().map(|error| (format!("{name}_se.f32"), error));
            for (name, values) in std::iter::once((format!("{name}.f32"), &estimate.mean)).chain(errors) {
                let bytes: &[u8] = bytemuck::cast_slice(values);
                write_atomically(&folder.join(&name), |out| out.write_all(bytes))?;
                names.push(name);
            }
            Ok(())
        };
        write("phi_sc".into(), &self.phi_scattered)?;
        write("phi_dir".into(), &self.phi_direct)?;
        if let Some(seen) = &self.seen {
            write("seen".into(), seen)?;
        }
        for (camera, j) in &self.towards {
            write(format!("jcam_{camera}"), j)?;
        }
        for (camera, _, image) in &self.images {
            write(format!("image_{camera}"), image)?;
        }
        for (camera, width, image) in &self.images {
            let name = format!("image_{camera}.exr");
            write_exr(&folder.join(&name), &grey_picture(*width, &image.mean))?;
            names.push(name);
        }
        Ok(names)
    }
}

/// A picture of white light from one value a pixel.
pub fn grey_picture(width: usize, values: &[f32]) -> Picture {
    let pixels: Vec<[f32; 3]> = values.iter().map(|&value| [value; 3]).collect();
    Picture { width, height: values.len() / width, pixels }
}
