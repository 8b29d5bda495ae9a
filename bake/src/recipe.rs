//! The recipe: what a scene has and how good it must be. Every key with unit, range and default: docs/recipe.md.
//!
//! A recipe is TOML. Unknown keys are errors that name the nearest known one, numbers are checked with file, line and
//! column, and nothing outside the sections that it has is baked.

mod clouds;
mod file;
pub mod model;
mod number;
mod place;
mod rain;
mod rain_map;
mod scene;
mod sun;
mod view;

use crate::error::BakeError;
pub use crate::error::RecipeError;
use crate::input::read_text;
use crate::input::scene::scene_files;
pub use clouds::parse_directions;
use model::RainMapSource;
pub use model::{Clouds, Rain, Recipe, VirtualLights};
pub(crate) use rain_map::ends_in;
use squall_formats::section::view::ViewSection;
use std::path::{Path, PathBuf};
pub use sun::sun_at;

impl Recipe {
    /// The recipe's own file and every file that it names, those that its scene names among them.
    ///
    /// Errors: a scene that cannot be read.
    pub fn inputs(&self) -> Result<Vec<PathBuf>, BakeError> {
        let pictures = self.rain.iter().flat_map(|rain| &rain.pictures);
        let mut files: Vec<PathBuf> =
            std::iter::once(&self.file).chain(&self.town).chain(pictures).cloned().collect();
        if let Some(RainMapSource::File { path, .. }) =
            self.rain.as_ref().and_then(|rain| rain.map.as_ref()).map(|map| &map.source)
        {
            files.push(path.clone());
        }
        #[cfg(feature = "meshes")]
        if let Some(scene) = &self.scene {
            files.extend(crate::input::meshes::mesh_files(&scene.file)?);
            files.extend(scene.puddles.iter().map(|mask| mask.file.clone()));
        }
        if let Some(clouds) = &self.clouds {
            files.extend(scene_files(&clouds.scene)?);
        }
        Ok(files)
    }

    /// Reads and checks a recipe.
    pub fn read(path: &Path) -> Result<Self, BakeError> {
        let text = read_text(path, "a recipe (TOML)")?;
        file::read(path, text)
    }
}

/// Reads a picture from a file of its own: `[view]` and the tables under it, as in a recipe. `strokes` are the names of the
/// asset's strokes.
///
/// Errors: as for a recipe.
pub fn read_view(path: &Path, strokes: &[String]) -> Result<ViewSection, BakeError> {
    file::read_view(path, &read_text(path, "a view (TOML)")?, strokes)
}
