//! What is baked of a scene's meshes: maps for rain where it lands.

use super::stage::{Clock, StageOutput};
use crate::error::BakeError;
use crate::input::Fingerprint;
use crate::input::meshes::{read_meshes, refused};
use crate::input::picture::{grey_of, picture_file};
use crate::progress::Progress;
use crate::provenance::input_record;
use crate::recipe::model::{PuddleMask, Recipe, SceneSpec};
use crate::response::cache::ResponseCache;
use glam::DVec2;
use squall_formats::Limits;
use squall_formats::container::OutSection;
use squall_formats::section::wet_maps::WetMapsSection;
use squall_scene::edges::{drips::DripSettings, fins::FinSettings};
use squall_scene::heights::Grid;
use squall_scene::lightning::LightningSettings;
use squall_scene::overhead::OverheadSettings;
use squall_scene::{MapSettings, Read, SceneError, World, bake_maps, section_of};
use std::path::Path;

/// The maps' section, if the recipe names a scene. A cache gives the section of a bake that had the same scene and settings.
///
/// Errors: a scene that is missing, damaged or out of range; more cells than a map may have; an interruption.
pub(super) fn scene(
    recipe: &Recipe,
    cache: Option<&ResponseCache>,
    progress: &dyn Progress,
) -> Result<StageOutput, BakeError> {
    let Some(spec) = &recipe.scene else { return Ok(StageOutput::default()) };
    let clock = Clock::start();
    let how = Read { lumens_per_watt: spec.lumens_per_watt, ..Read::default() };
    let meshes = read_meshes(&spec.file, &how)?;
    let mut files = meshes.inputs;
    let mask = spec.puddles.as_ref().map(Depths::read).transpose()?;
    files.extend(mask.as_ref().map(|mask| mask.input.clone()));
    let inputs = files.iter().map(|input| input_record(recipe, input)).collect();
    let key =
        cache.map(|cache| cache.piece_key("WETM", &depends(spec, &files).each_ref().map(Vec::as_slice)));
    let report = meshes.scene.report.clone();
    let kept = cache.zip(key.as_ref()).and_then(|(cache, key)| cache.piece(key));
    let (record, left_out) = match kept.and_then(|bytes| unpacked(&bytes)) {
        Some(kept) => kept,
        None => {
            let world = World::new(meshes.scene);
            let depths = |grid: &Grid| mask.as_ref().map_or_else(|| Ok(Vec::new()), |mask| mask.over(grid));
            let mask = mask.is_some().then_some(&depths as &squall_scene::Mask<'_>);
            let baked = bake_maps(&world, &settings(spec), mask, &Told(progress))
                .map_err(|error| within_recipe(recipe, &spec.file, error))?;
            let left_out = [baked.drips_left_out, baked.fins_left_out].map(|count| count as u64);
            (section_of(&baked.maps), left_out)
        }
    };
    let made = words(&record, report.triangles, left_out, report.left_out());
    let section = checked(recipe, record)?;
    if let (Some(cache), Some(key)) = (cache, key) {
        cache.keep_piece(&key, &packed(left_out, &section.to_bytes()));
    }
    let error = "heights within 1/65534, light within 1/4095 of its root".into();
    let report = clock.report("scene", made, section.length(), error);
    Ok(StageOutput { sections: vec![section], inputs, reports: vec![report], ..StageOutput::default() })
}

/// What a cache keeps: how many edges that drip and silhouettes the maps leave out, then the section.
fn packed(left_out: [u64; 2], section: &[u8]) -> Vec<u8> {
    let mut bytes = left_out.map(u64::to_le_bytes).as_flattened().to_vec();
    bytes.extend_from_slice(section);
    bytes
}

fn unpacked(bytes: &[u8]) -> Option<(WetMapsSection, [u64; 2])> {
    let (counts, section) = bytes.split_first_chunk::<16>()?;
    let (drips, fins) = counts.split_first_chunk::<8>()?;
    let left_out = [u64::from_le_bytes(*drips), u64::from_le_bytes(fins.try_into().ok()?)];
    let record = WetMapsSection::read(section, WetMapsSection::VERSION, &Limits::default()).ok()?;
    Some((record, left_out))
}

/// What a reader would refuse is refused here, where the recipe is known.
fn checked(recipe: &Recipe, record: WetMapsSection) -> Result<OutSection, BakeError> {
    record.check().map_err(|(field, wanted, found)| {
        BakeError::input(&recipe.file, format!("scene: {field}"), wanted, found)
    })?;
    let section = record.write();
    let most = Limits::default().head_bytes;
    if section.length() > most {
        let wanted = format!("maps of at most {most} bytes: larger cells, or a smaller region_m");
        return Err(BakeError::input(&recipe.file, "scene", wanted, section.length()));
    }
    Ok(section)
}

/// An error about a key of the recipe names the recipe, one about the scene the scene.
fn within_recipe(recipe: &Recipe, scene: &Path, error: SceneError) -> BakeError {
    match error {
        SceneError::Input { field, wanted, found }
            if ["region_m", "cell_m", "overhead.cell_m", "lightning.cell_m", "lightning.paths"]
                .contains(&field.as_str()) =>
        {
            BakeError::input(&recipe.file, format!("scene.{field}"), wanted, found)
        }
        other => refused(scene)(other),
    }
}

/// What the maps are made from: settings, and what files hold.
fn depends(spec: &SceneSpec, files: &[Fingerprint]) -> [Vec<u8>; 2] {
    // Where files lie changes nothing.
    let mut spec = spec.clone();
    spec.file = Default::default();
    if let Some(mask) = &mut spec.puddles {
        mask.file = Default::default();
    }
    [format!("{spec:?}").into_bytes(), files.iter().flat_map(|file| file.hash).collect()]
}

fn settings(spec: &SceneSpec) -> MapSettings {
    let overhead = OverheadSettings {
        points: spec.overhead_points,
        seed: spec.overhead_seed,
        ..OverheadSettings::default()
    };
    MapSettings {
        region_m: spec.region_m.map(|corners| corners.map(DVec2::from_array)),
        cell_m: spec.cell_m,
        deepest_m: spec.deepest_m,
        overhead_cell_m: spec.overhead_cell_m,
        overhead,
        lightning: LightningSettings {
            directions: spec.directions.clone(),
            cell_m: spec.lightning_cell_m,
            paths: spec.paths,
            bounces: spec.bounces,
            seed: spec.lightning_seed,
        },
        lightning_top_m: spec.lightning_top_m,
        drips: spec.drips.then(DripSettings::default),
        fins: spec.fins.then(FinSettings::default),
    }
}

fn words(
    record: &WetMapsSection,
    triangles: u64,
    edges_left_out: [u64; 2],
    left_out: Option<String>,
) -> String {
    let mut parts = vec![format!("{triangles} triangles")];
    if let Some(height) = &record.height {
        parts.push(format!("{} × {} cells", height.size[0], height.size[1]));
    }
    if let Some(Ok(depths)) = record.water.as_ref().map(|water| water.values()) {
        let wet = depths.iter().filter(|depth| **depth > 0.0).count();
        parts.push(format!("{wet} under water"));
    }
    let edges = [(record.drips.ends.len(), "edges drip"), (record.fins.ends.len(), "silhouettes")];
    parts.extend(edges.iter().zip(edges_left_out).map(|((count, what), more)| match more {
        0 => format!("{count} {what}"),
        more => format!("{count} {what} ({more} lesser ones left out)"),
    }));
    if let Some(lightning) = &record.lightning {
        let [nx, ny, nz] = lightning.size;
        parts
            .push(format!("lightning from {} sides at {nx} × {ny} × {nz} nodes", lightning.directions.len()));
    }
    parts.extend(left_out);
    parts.join(", ")
}

/// An artist's depths of water.
struct Depths {
    width: usize,
    height: usize,
    /// Grey values, row 0 on top.
    values: Vec<f32>,
    white_m: f64,
    input: Fingerprint,
}

impl Depths {
    fn read(mask: &PuddleMask) -> Result<Self, BakeError> {
        let input = picture_file(&mask.file)?;
        let picture = grey_of(&input, None)?.picture;
        if let Some(at) = picture.pixels.iter().position(|grey| !(*grey >= 0.0 && *grey <= 1e6)) {
            let field = format!("pixel {} × {}", at % picture.width, at / picture.width);
            return Err(BakeError::input(&mask.file, field, "a grey of 0 or more", picture.pixels[at]));
        }
        Ok(Self {
            width: picture.width,
            height: picture.height,
            values: picture.pixels,
            white_m: mask.white_m,
            input: input.fingerprint(),
        })
    }

    /// Depths over a map: the picture spans it, its top row where y is greatest; bilinear between pixels' middles.
    fn over(&self, grid: &Grid) -> Result<Vec<f32>, SceneError> {
        let [columns, rows] = grid.size;
        let axis = |cell: usize, cells: usize, pixels: usize| {
            let at =
                ((cell as f64 + 0.5) / cells as f64 * pixels as f64 - 0.5).clamp(0.0, (pixels - 1) as f64);
            let first = (at as usize).min(pixels.saturating_sub(2));
            (first, (first + 1).min(pixels - 1), at - first as f64)
        };
        let value = |x: usize, y: usize| f64::from(self.values[y * self.width + x]);
        let depth = |cell: usize| {
            let (x0, x1, u) = axis(cell % columns, columns, self.width);
            let (y0, y1, v) = axis(rows - 1 - cell / columns, rows, self.height);
            let low = value(x0, y0) + u * (value(x1, y0) - value(x0, y0));
            let high = value(x0, y1) + u * (value(x1, y1) - value(x0, y1));
            ((low + v * (high - low)) * self.white_m) as f32
        };
        Ok((0..grid.cells()).map(depth).collect())
    }
}

/// A bake's progress, as a scene's maps tell it.
struct Told<'a>(&'a dyn Progress);

impl squall_scene::Progress for Told<'_> {
    fn begin(&self, part: &str, total: u64) {
        self.0.begin(part, total);
    }
    fn advance(&self, steps: u64) {
        self.0.advance(steps);
    }
    fn interrupted(&self) -> bool {
        self.0.interrupted()
    }
}

#[cfg(test)]
mod tests;
