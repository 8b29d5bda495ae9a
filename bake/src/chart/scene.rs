//! The recipe's cloud as charts sweep it: the same optics on fewer cells, so that a sweep of a hundred settings ends.

use crate::error::BakeError;
use crate::evaluate::held_out::extinction_at;
use crate::input::scene::read_scene;
use crate::plan::budget::Margins;
use crate::plan::lights::Site;
use crate::plan::plan;
use crate::progress::Quiet;
use crate::recipe::model::{Clouds, Recipe, ResponseSettings};
use squall_formats::GridShape;
use squall_runtime::relight::PointLight;
use squall_runtime::stroke::Stroke;
use squall_runtime::transport::Cloud;

/// A cloud to sweep.
pub struct ChartScene<'a> {
    recipe: &'a Recipe,
    clouds: &'a Clouds,
    /// The cloud, on at most as many cells as asked for.
    pub cloud: Cloud,
    /// How it came about, in words.
    pub words: String,
    /// The recipe's own distance between virtual lights on this cloud, m: stated, usual or chosen by its budget.
    pub spacing_m: f64,
    /// The recipe's own way to solve and store, likewise.
    pub settings: ResponseSettings,
}

/// The recipe's cloud on at most `most` cells: blocks of cells become one of their mean extinction. `None` without clouds.
///
/// Errors: an input that is missing or damaged.
pub fn chart_scene(recipe: &Recipe, most: usize) -> Result<Option<ChartScene<'_>>, BakeError> {
    let Some(clouds) = &recipe.clouds else { return Ok(None) };
    let scene = read_scene(&clouds.scene, clouds.optics)?;
    let mut factor = [1usize; 3];
    let size = |factor: [usize; 3]| -> [usize; 3] {
        std::array::from_fn(|axis| scene.cloud.shape.to_array()[axis].div_ceil(factor[axis]))
    };
    while size(factor).iter().product::<usize>() > most {
        // The finest axis first: cells stay as cubic as they are.
        let edge = |axis: usize| scene.cloud.cell_m[axis] * factor[axis] as f64;
        let splits = (0..3).filter(|&axis| size(factor)[axis] > 1);
        let Some(axis) = splits.min_by(|&a, &b| edge(a).total_cmp(&edge(b))) else { break };
        factor[axis] *= 2;
    }
    let cloud = coarsened(&scene.cloud, factor)?;
    let [nx, ny, nz] = cloud.shape.to_array();
    let words = if factor == [1; 3] {
        format!("the recipe's cloud, {nx} × {ny} × {nz} cells")
    } else {
        format!("the recipe's cloud on {nx} × {ny} × {nz} cells")
    };
    let planned = plan(&Site::new(recipe, clouds, &cloud), Margins::default(), &Quiet)?;
    let spacing_m = planned.spacing_m;
    // Charts vary one light grid.
    let settings = ResponseSettings { finer: 0, ..planned.settings };
    Ok(Some(ChartScene { recipe, clouds, cloud, words, spacing_m, settings }))
}

/// Blocks of cells as one cell of their mean extinction; what a block has beyond the grid is empty, as everything outside is.
fn coarsened(cloud: &Cloud, factor: [usize; 3]) -> Result<Cloud, BakeError> {
    let fine = cloud.shape.to_array();
    let coarse: [usize; 3] = std::array::from_fn(|axis| fine[axis].div_ceil(factor[axis]));
    let shape = GridShape::new(coarse[0] as u32, coarse[1] as u32, coarse[2] as u32);
    let mut sums = vec![0.0f64; shape.len()];
    for (index, &extinction) in cloud.extinction.iter().enumerate() {
        let cell = cloud.shape.cell(index);
        let [x, y, z]: [usize; 3] = std::array::from_fn(|axis| cell[axis] / factor[axis]);
        sums[shape.index(x, y, z)] += f64::from(extinction);
    }
    let block = factor.iter().product::<usize>() as f64;
    let cell_m = std::array::from_fn(|axis| cloud.cell_m[axis] * factor[axis] as f64);
    let extinction = sums.into_iter().map(|sum| (sum / block) as f32).collect();
    Ok(Cloud { shape, cell_m, extinction, ..cloud.clone() }.checked()?)
}

impl ChartScene<'_> {
    /// Where virtual lights stand over this cloud.
    pub fn site(&self) -> Site<'_> {
        Site::new(self.recipe, self.clouds, &self.cloud)
    }

    /// A point light inside the cloud: the point of the recipe's strokes with the densest cell, or the densest cell's own middle.
    pub fn light(&self) -> PointLight {
        let cloud = &self.cloud;
        let points = self.recipe.strokes.iter().flat_map(|record| Stroke::grow(record).lights(0.0));
        let deepest =
            points.map(|p| (extinction_at(cloud, p.position), p.position)).max_by(|a, b| a.0.total_cmp(&b.0));
        let position = match deepest {
            Some((extinction, position)) if extinction > 0.0 => position,
            _ => {
                let cells = cloud.extinction.iter().enumerate();
                let densest = cells.max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(index, _)| index);
                cloud.centre(cloud.shape.cell(densest))
            }
        };
        PointLight { position, intensity: 1.0 }
    }
}
