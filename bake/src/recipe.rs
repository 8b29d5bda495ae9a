//! The recipe: what a scene has and how good it must be. Every key with unit, range and default: docs/recipe.md.
//!
//! A recipe is TOML. Unknown keys are errors that name the nearest known one, numbers are checked with file, line and
//! column, and nothing outside the sections that it has is baked.

mod clouds;
mod file;
mod place;
mod view;

use crate::budget::clouds::{CloudBudget, Given};
use crate::density::DensitySpec;
use crate::error::BakeError;
use crate::input::read_text;
use crate::input::scene::{Optics, scene_files};
use crate::response::ResponseSettings;
use crate::streak::FitSettings;
pub use clouds::parse_directions;
pub use place::RecipeError;
use squall_formats::section::bolt::StrokeRecord;
use squall_formats::section::response::DistantKind;
use squall_formats::section::view::ViewSection;
use std::path::{Path, PathBuf};

/// A recipe, read and checked.
#[derive(Clone, Debug)]
pub struct Recipe {
    /// The recipe's own file.
    pub file: PathBuf,
    /// Its text as it was read, hashed into the asset's provenance.
    pub text: String,
    /// A cloud lit by lightning.
    pub clouds: Option<Clouds>,
    /// Rain.
    pub rain: Option<Rain>,
    /// Strokes.
    pub strokes: Vec<StrokeRecord>,
    /// Town file, JSON.
    pub town: Option<PathBuf>,
    /// The picture that the recipe frames.
    pub view: Option<ViewSection>,
}

/// What the recipe says of the cloud.
#[derive(Clone, Debug)]
pub struct Clouds {
    /// SCENE.json with the grid.
    pub scene: PathBuf,
    /// Optics that override the scene's.
    pub optics: Optics,
    /// Where virtual lamps stand.
    pub lights: Lamps,
    /// Distant light to bake beside them.
    pub distant: Vec<DistantKind>,
    /// How to solve, and how to store.
    pub response: ResponseSettings,
    /// Strokes that judge the result, grown at random inside the lamps' reach.
    pub test_strokes: u32,
    /// How good is good enough.
    pub budget: CloudBudget,
    /// Which settings the recipe states itself.
    pub given: Given,
}

/// Where virtual lamps stand.
#[derive(Clone, Debug, PartialEq)]
pub struct Lamps {
    /// Smallest corner of the reach, m; the grid's own where absent.
    pub low_m: Option<[f64; 3]>,
    /// Largest corner of the reach, m; the grid's own where absent.
    pub high_m: Option<[f64; 3]>,
    /// Distance between lamps sideways and above the cloud's base, h_usr, m.
    pub spacing_m: f64,
    /// ε of \[dobashi\] eq. 4, 1/m².
    pub epsilon_per_m2: f64,
    /// Longest interval below the base, m.
    pub longest_m: f64,
    /// Bake only lamps that a stroke of the recipe can touch.
    pub prune: bool,
}

/// What the recipe says of rain.
#[derive(Clone, Debug)]
pub struct Rain {
    /// Pictures of streaks, in order.
    pub pictures: Vec<PathBuf>,
    /// Layer of the pictures, which are then all OpenEXR.
    pub layer: Option<String>,
    /// How to fit them.
    pub fit: FitSettings,
    /// PSNR that every pattern is to have, dB; method and number of cosines are then chosen picture by
    /// picture.
    pub psnr_db: Option<f64>,
    /// Whether the recipe names the method itself; where not, a PSNR chooses it too.
    pub method_given: bool,
    /// What the density table must cover, and how well.
    pub density: DensitySpec,
}

impl Recipe {
    /// The recipe's own file and every file that it names, those that its scene names among them.
    ///
    /// Errors: a scene that cannot be read.
    pub fn inputs(&self) -> Result<Vec<PathBuf>, BakeError> {
        let pictures = self.rain.iter().flat_map(|rain| &rain.pictures);
        let mut files: Vec<PathBuf> =
            std::iter::once(&self.file).chain(&self.town).chain(pictures).cloned().collect();
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
