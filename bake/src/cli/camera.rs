//! Where a picture is seen from: CAMERA.json or the `[view]` of a recipe, for whichever command draws one.

use squall_bake::BakeError;
use squall_bake::input::scene::read_camera;
use squall_bake::recipe::read_view;
use squall_formats::section::bolt::BoltSection;
use squall_runtime::frame::camera_of;
use squall_runtime::{Asset, Camera, RuntimeError};
use std::path::{Path, PathBuf};

/// `--camera` and `--view`, one of the two.
#[derive(clap::Args)]
#[group(required = true, multiple = false)]
pub struct CameraArgs {
    /// The camera (CAMERA.json): one camera object of a scene.
    #[arg(long, value_name = "CAMERA")]
    camera: Option<PathBuf>,
    /// The camera of a view: a TOML file with the table `view`, such as a recipe.
    #[arg(long)]
    view: Option<PathBuf>,
}

impl CameraArgs {
    /// The files that it stands in.
    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.camera.iter().chain(&self.view)
    }

    /// The camera and its name, "view" where it is a view's; `asset` has the strokes that a view may name.
    ///
    /// Errors: a file that cannot be read as what it is to be, numbers out of range.
    pub fn read(&self, asset: &Asset) -> Result<(String, Camera), BakeError> {
        match (&self.camera, &self.view) {
            (_, Some(view)) => {
                let view = read_view(view, &stroke_names(asset)?)?;
                Ok(("view".into(), camera_of(&view.camera)?))
            }
            (Some(camera), None) => read_camera(camera),
            (None, None) => Err(BakeError::input(Path::new("--camera"), "camera", "a file", "none")),
        }
    }
}

fn stroke_names(asset: &Asset) -> Result<Vec<String>, RuntimeError> {
    if asset.directory().find(BoltSection::TAG).is_none() {
        return Ok(Vec::new());
    }
    let section = asset.section(BoltSection::TAG, "the strokes", BoltSection::read)?;
    Ok(section.strokes.into_iter().map(|record| record.name).collect())
}
