//! Where a recipe's virtual point lights stand, and the strokes that try a response over them.

use crate::error::BakeError;
use crate::evaluate::cost;
use crate::evaluate::held_out::{grown_strokes, shifted_strokes};
use crate::recipe::model::{Clouds, Recipe};
use crate::response::cache::ResponseCache;
use crate::response::{LightSpacing, WantedLights, light_grid};
use glam::DVec3;
use squall_runtime::relight::PointLight;
use squall_runtime::stroke::Stroke;
use squall_runtime::transport::Cloud;
use std::ops::Range;

/// More virtual lights than this would take days: a typing error in the spacing, most likely.
const MAX_LIGHTS: f64 = 2e6;
/// Points along the longest side of the bounds of strokes grown at random, where the recipe states no spacing.
const POINTS: f64 = 24.0;
/// A recipe that states no spacing and no budget has this many intervals along the longest side.
const USUAL_INTERVALS: f64 = 12.0;

/// A recipe's cloud and strokes, for which virtual lights are placed.
pub struct Site<'a> {
    /// The whole recipe.
    pub recipe: &'a Recipe,
    /// What it says of the cloud.
    pub clouds: &'a Clouds,
    /// The cloud itself; of as many cells as the caller wants to work with: those that light is stored for.
    pub cloud: &'a Cloud,
    /// The same in the cells that are shown.
    pub shown: &'a Cloud,
    /// Smallest and largest corner of the box that virtual lights have to fill, m.
    pub bounds: [DVec3; 2],
    /// What the scene relights at once: [`cost::flashes`].
    pub flashes: Vec<Vec<PointLight>>,
    /// Where rows may have been solved before.
    pub cache: Option<&'a ResponseCache>,
    /// Height of the cloud's base, m.
    base: f64,
    /// The recipe's own strokes, grown.
    strokes: Vec<Vec<PointLight>>,
}

/// The cloud in the cells that its recipe stores light for, where those are blocks of the density's.
///
/// Errors: cells that are no equal blocks of the grid's.
pub fn in_light_cells(recipe: &Recipe, clouds: &Clouds, shown: &Cloud) -> Result<Option<Cloud>, BakeError> {
    let Some(cells) = clouds.light_cells else { return Ok(None) };
    let counts = shown.shape.to_array().map(|count| count as u32);
    let whole = |axis: usize| cells[axis] <= counts[axis] && counts[axis].is_multiple_of(cells[axis]);
    if !(0..3).all(whole) {
        let wanted = format!("along each axis a divisor of the grid's {counts:?} cells");
        let (file, field) = (recipe.file.clone(), "clouds.response.cells".into());
        return Err(BakeError::Input { file, field, wanted, found: format!("{cells:?}") });
    }
    if cells == counts {
        return Ok(None);
    }
    let blocks = [0, 1, 2].map(|axis: usize| counts[axis] / cells[axis]);
    Ok(Some(shown.coarsened(blocks)?))
}

impl<'a> Site<'a> {
    /// Grows the recipe's strokes. The box is the one that the recipe names, or the cloud's own down to the strokes' lowest point.
    pub fn new(recipe: &'a Recipe, clouds: &'a Clouds, cloud: &'a Cloud) -> Self {
        let strokes: Vec<Vec<PointLight>> =
            recipe.strokes.iter().map(|record| Stroke::grow(record).lights(0.0)).collect();
        let (mut low, mut high) = (cloud.origin_m, cloud.far_corner());
        for light in strokes.iter().flatten() {
            low = low.min(light.position);
            high = high.max(light.position);
        }
        let named = &clouds.lights;
        let bounds =
            [named.low_m.map_or(low, DVec3::from_array), named.high_m.map_or(high, DVec3::from_array)];
        let occupied = cloud.extinction.iter().position(|&e| e > 0.0);
        let base = occupied.map_or(cloud.origin_m.z, |at| {
            cloud.origin_m.z + cloud.shape.cell(at)[2] as f64 * cloud.cell_m[2]
        });
        Self {
            recipe,
            clouds,
            cloud,
            shown: cloud,
            bounds,
            flashes: cost::flashes(recipe),
            cache: None,
            base,
            strokes,
        }
    }

    /// The longest side of the bounds, m.
    pub fn side(&self) -> f64 {
        (self.bounds[1] - self.bounds[0]).max_element()
    }

    /// The recipe's own spacing, m: stated, or usual.
    pub fn usual_spacing_m(&self) -> f64 {
        match self.clouds.lights.spacing_m {
            0.0 => self.side() / USUAL_INTERVALS,
            stated => stated,
        }
    }

    /// The light grid at a spacing, m; pruned to the recipe's strokes where the recipe says so.
    ///
    /// Errors: more virtual lights than days allow.
    pub fn place_lights(&self, spacing_m: f64) -> Result<WantedLights, BakeError> {
        let [low, high] = self.bounds;
        let nodes = ((high - low) / spacing_m).ceil() + DVec3::ONE;
        if nodes.x * nodes.y * nodes.z > MAX_LIGHTS {
            let wanted = format!("at most {MAX_LIGHTS} virtual lights");
            let found = format!("about {} × {} × {}", nodes.x, nodes.y, nodes.z);
            let (file, field) = (self.recipe.file.clone(), "clouds.lightning.spacing_m".into());
            return Err(BakeError::Input { file, field, wanted, found });
        }
        let stated = &self.clouds.lights;
        let spacing =
            LightSpacing { base_m: spacing_m, epsilon: stated.epsilon_per_m2, longest_m: stated.longest_m };
        let mut grid = light_grid(low, high, self.base, spacing);
        if stated.prune || stated.in_cloud {
            grid.wanted = vec![false; grid.len()];
            if stated.in_cloud {
                self.want_in_cloud(&mut grid);
            }
            for light in self.strokes.iter().flatten() {
                for node in grid.around(light.position).into_iter().flatten() {
                    grid.wanted[node] = true;
                }
            }
        }
        Ok(grid)
    }

    /// Wants the nodes that a light anywhere in cloud is split over.
    fn want_in_cloud(&self, lights: &mut WantedLights) {
        let cloud = self.cloud;
        let cells = (0..cloud.shape.len()).filter(|&cell| cloud.extinction[cell] > 0.0);
        let half = 0.5 * DVec3::from_array(cloud.cell_m);
        for cell in cells {
            let middle = cloud.centre(cloud.shape.cell(cell));
            // Intervals that a cell spans: those of its corners, and all between.
            let [low, high] = [middle - half, middle + half];
            let axes = lights.grid.axes();
            let spans = [0, 1, 2].map(|axis: usize| {
                let nodes = axes[axis];
                let first = nodes.partition_point(|&node| node <= low[axis]).saturating_sub(1);
                let last = nodes.partition_point(|&node| node < high[axis]).min(nodes.len() - 1);
                first..=last
            });
            let [nx, ny] = [axes[0].len(), axes[1].len()];
            let [xs, ys, zs] = spans;
            for k in zs {
                for j in ys.clone() {
                    for i in xs.clone() {
                        lights.wanted[i + nx * (j + ny * k)] = true;
                    }
                }
            }
        }
    }

    /// Strokes of the given numbers that try a response over `lights`, or score it: the recipe's own, moved, where lights were
    /// pruned to those; else grown at random in the bounds. A number always gives the same stroke, if it gives one.
    pub fn strokes(
        &self,
        lights: &WantedLights,
        spacing_m: f64,
        numbers: Range<usize>,
    ) -> Vec<Vec<PointLight>> {
        let mut bounds = lights.grid.bounds().map(DVec3::from_array);
        if self.clouds.lights.in_cloud {
            bounds = [self.cloud.origin_m.max(bounds[0]), self.cloud.far_corner().min(bounds[1])];
            bounds[0].z = bounds[0].z.max(self.base);
        }
        let usable = |point: DVec3| lights.reaches(point);
        if self.clouds.lights.prune {
            return shifted_strokes(&self.strokes, usable, 0.5 * spacing_m, numbers);
        }
        // Their points lie no closer where virtual lights do: strokes are the same for every spacing.
        let spacing_m = if self.clouds.given.spacing {
            0.5 * spacing_m / f64::from(1u32 << self.clouds.lights.levels)
        } else {
            (bounds[1] - bounds[0]).max_element() / POINTS
        };
        grown_strokes(self.cloud, bounds, usable, spacing_m, numbers)
    }

    /// Strokes that candidates at a spacing are tried on.
    ///
    /// Errors: there is none.
    pub(super) fn tried_strokes(
        &self,
        lights: &WantedLights,
        spacing_m: f64,
    ) -> Result<Vec<Vec<PointLight>>, BakeError> {
        let found = self.strokes(lights, spacing_m, 0..TRIED_STROKES[1]);
        if found.is_empty() {
            return Err(BakeError::NotReached {
                what: "clouds.budget".into(),
                wanted: "a stroke to try settings on".into(),
                reached: "none that the virtual lights cover".into(),
                hint: "strokes in the recipe, or larger bounds without prune, would give some".into(),
            });
        }
        Ok(found)
    }

    /// The light grid at a spacing, m, and the held-out strokes that score a response over it: behind those that candidates are tried
    /// on, and others in every iteration, counted from 0.
    ///
    /// Errors: as [`Site::place_lights`].
    pub fn held_out(
        &self,
        spacing_m: f64,
        iteration: usize,
    ) -> Result<(WantedLights, Vec<Vec<PointLight>>), BakeError> {
        let lights = self.place_lights(spacing_m)?;
        let count = self.clouds.held_out_strokes as usize;
        let chosen = self.clouds.budget.needs_held_out();
        let first = if chosen { TRIED_STROKES[1] + iteration * count } else { 0 };
        let strokes = self.strokes(&lights, spacing_m, first..first + count);
        Ok((lights, strokes))
    }
}

/// Strokes that candidates are tried on: as many as memory has room for, between these.
pub const TRIED_STROKES: [usize; 2] = [4, 32];
