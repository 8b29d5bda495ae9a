//! All maps of a scene.

use crate::Progress;
use crate::edges::Kept;
use crate::edges::drips::{DripSettings, bake_drips};
use crate::edges::fins::{FinSettings, bake_fins};
use crate::error::SceneError;
use crate::flow::bake_flooded;
use crate::heights::{Grid, bake_heights};
use crate::lightning::{LightningSettings, bake_lightning, nodes_over};
use crate::overhead::{OverheadSettings, bake_overhead};
use crate::world::World;
use glam::{DVec2, DVec3};
use squall_runtime::wet::maps::{GroundMap, WetMaps};

/// What is baked of a scene, and how finely.
#[derive(Clone, Debug, PartialEq)]
pub struct MapSettings {
    /// Rectangle of the ground that maps cover, low corner and high one, m; all of the scene where absent.
    pub region_m: Option<[DVec2; 2]>,
    /// Side of a cell of heights and water, m.
    pub cell_m: f64,
    /// Deepest standing water, m: what would be deeper has a drain.
    pub deepest_m: f64,
    /// Side of a cell of light from overhead, m; none is baked where absent.
    pub overhead_cell_m: Option<f64>,
    /// How light from overhead is worked out.
    pub overhead: OverheadSettings,
    /// Lightning's key directions and how its light is worked out; none is baked without directions.
    pub lightning: LightningSettings,
    /// Height above the region's lowest ground that lightning's volume reaches to, m, but never beyond the scene.
    pub lightning_top_m: f64,
    /// Which edges drip; none where absent.
    pub drips: Option<DripSettings>,
    /// Which edges are silhouettes; none where absent.
    pub fins: Option<FinSettings>,
}

impl Default for MapSettings {
    fn default() -> Self {
        let lightning =
            LightningSettings { directions: Vec::new(), cell_m: 2.0, paths: 3072, bounces: 3, seed: 1 };
        Self {
            region_m: None,
            cell_m: 0.1,
            deepest_m: 0.3,
            overhead_cell_m: Some(0.25),
            overhead: OverheadSettings::default(),
            lightning,
            lightning_top_m: 12.0,
            drips: Some(DripSettings::default()),
            fins: Some(FinSettings::default()),
        }
    }
}

/// Maps, and figures about them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BakedMaps {
    /// The maps.
    pub maps: WetMaps,
    /// Drains that were put where water would stand too deep.
    pub drains: usize,
    /// Standing water when all puddles are full, m³.
    pub water_m3: f64,
    /// Edges that drip beyond [`DripSettings::most`]: those that least drains over.
    pub drips_left_out: usize,
    /// Silhouettes beyond [`FinSettings::most`]: the shortest.
    pub fins_left_out: usize,
}

/// Depth of standing water in every cell of a grid, m, by an artist.
pub type Mask<'a> = dyn Fn(&Grid) -> Result<Vec<f32>, SceneError> + 'a;

impl MapSettings {
    /// The grids of heights and of light from overhead, and lightning's box: what [`bake_maps`] will fill.
    ///
    /// Errors: too many cells or nodes; a region without area.
    fn grids(&self, world: &World) -> Result<(Grid, Option<Grid>, [DVec3; 2]), SceneError> {
        let [low, high] = world.scene().bounds().map(|corner| corner.as_dvec3());
        let [from, to] = self.region_m.unwrap_or([low.truncate(), high.truncate()]);
        let ground = Grid::over(from, to, self.cell_m)?;
        let overhead = self.overhead_cell_m.map(|cell| Grid::over(from, to, cell)).transpose();
        let overhead = overhead.map_err(|error| match error {
            SceneError::Input { field, wanted, found } if field == "cell_m" => {
                SceneError::Input { field: "overhead.cell_m".into(), wanted, found }
            }
            other => other,
        })?;
        let top = high.z.min(low.z + self.lightning_top_m).max(low.z + 1e-3);
        let volume = [from.extend(low.z), to.extend(top)];
        if !self.lightning.directions.is_empty() {
            nodes_over(volume[0], volume[1], self.lightning.cell_m)?;
        }
        Ok((ground, overhead, volume))
    }
}

/// Bakes all that is asked for. `mask` replaces the water where an artist says how deep it is: it is given the grid, and returns a depth
/// in m for each of its cells.
///
/// Errors: too many cells or nodes, or more work on them than is allowed; what `mask` refuses; an interruption.
pub fn bake_maps(
    world: &World,
    settings: &MapSettings,
    mask: Option<&Mask<'_>>,
    progress: &dyn Progress,
) -> Result<BakedMaps, SceneError> {
    let (grid, overhead_grid, volume) = settings.grids(world)?;
    progress.begin("scene: heights and water", 3);
    let heights = bake_heights(world.scene(), grid, progress)?;
    progress.advance(1);
    let flooded = bake_flooded(&heights, settings.deepest_m as f32, progress)?;
    progress.advance(1);
    let drips = settings.drips.map(|settings| bake_drips(world, &flooded, &settings, progress));
    let drips = drips.transpose()?.unwrap_or(Kept { edges: Vec::new(), left_out: 0 });
    let fins = settings.fins.map(|settings| bake_fins(world, &settings, progress));
    let fins = fins.transpose()?.unwrap_or(Kept { edges: Vec::new(), left_out: 0 });
    progress.advance(1);
    let water = match mask {
        Some(mask) => mask(&grid)?,
        None => flooded.depth_m,
    };
    let water_m3 = water.iter().map(|depth| f64::from(*depth)).sum::<f64>() * grid.cell_m * grid.cell_m;
    let map = |grid: &Grid, values: Vec<f32>| GroundMap {
        origin_m: grid.origin_m,
        cell_m: grid.cell_m,
        size: grid.size,
        values,
    };
    let mut overhead = None;
    if let Some(grid) = overhead_grid {
        progress.begin("scene: light from overhead", grid.size[1] as u64);
        let light = bake_overhead(world, grid, &heights, &settings.overhead, progress)?;
        overhead = Some(light.map(|band| map(&grid, band)));
    }
    let mut lightning = None;
    if !settings.lightning.directions.is_empty() {
        let size = nodes_over(volume[0], volume[1], settings.lightning.cell_m)?;
        progress.begin("scene: light of lightning", size.iter().product::<usize>() as u64);
        lightning = Some(bake_lightning(world, volume, &settings.lightning, progress)?);
    }
    let maps = WetMaps {
        height_m: Some(map(&grid, heights.highest)),
        water_m: Some(map(&grid, water)),
        overhead,
        drips: drips.edges,
        fins: fins.edges,
        lightning,
    };
    Ok(BakedMaps {
        maps,
        drains: flooded.drains.len(),
        water_m3,
        drips_left_out: drips.left_out,
        fins_left_out: fins.left_out,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quiet;
    use crate::scene::Scene;
    use crate::testing::{cuboid, quad};

    #[test]
    fn everything_that_is_asked_for_is_there_and_a_mask_is_the_water() {
        let mut scene = Scene::default();
        quad(&mut scene, [-5.0, -5.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], 0);
        cuboid(&mut scene, [-1.0, -1.0, 0.0], [1.0, 1.0, 2.0], 0);
        let world = World::new(scene);
        let mut settings = MapSettings::default();
        settings.lightning.directions = vec![DVec3::Z];
        settings.lightning.paths = 32;
        let mask = |grid: &Grid| Ok(vec![0.02; grid.cells()]);
        let baked = bake_maps(&world, &settings, Some(&mask), &Quiet).unwrap();
        let maps = &baked.maps;
        assert_eq!(maps.height_m.as_ref().unwrap().at(DVec2::splat(0.1)), Some(2.0));
        assert_eq!(maps.water_m.as_ref().unwrap().at(DVec2::splat(3.1)), Some(0.02));
        assert!((baked.water_m3 - 2.0).abs() < 1e-4 && maps.lightning.is_some() && maps.overhead.is_some());
        assert!(!maps.drips.is_empty() && !maps.fins.is_empty());
        let open = bake_maps(&world, &settings, None, &Quiet).unwrap();
        assert_eq!(open.water_m3, 0.0);
    }

    #[test]
    fn edges_that_a_map_does_not_hold_are_counted_and_too_many_cells_name_their_key() {
        let mut scene = Scene::default();
        quad(&mut scene, [-5.0, -5.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], 0);
        cuboid(&mut scene, [-1.0, -1.0, 0.0], [1.0, 1.0, 2.0], 0);
        let world = World::new(scene);
        let mut settings = MapSettings { overhead_cell_m: None, ..MapSettings::default() };
        settings.drips = Some(DripSettings { most: 1, ..DripSettings::default() });
        settings.fins = Some(FinSettings { most: 2, ..FinSettings::default() });
        let baked = bake_maps(&world, &settings, None, &Quiet).unwrap();
        assert_eq!((baked.maps.drips.len(), baked.drips_left_out), (1, 3));
        assert_eq!((baked.maps.fins.len(), baked.fins_left_out), (2, 10));
        settings.overhead_cell_m = Some(0.001);
        let error = bake_maps(&world, &settings, None, &Quiet).unwrap_err().to_string();
        assert!(error.starts_with("overhead.cell_m"), "{error}");
    }
}
