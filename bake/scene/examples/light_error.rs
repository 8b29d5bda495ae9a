//! How far lightning's baked light is from what 64 times as many paths give.
//!
//! `cargo run --release -p squall-scene --example light_error -- SCENE.glb [PATHS] [CELL_M]`

use glam::DVec3;
use squall_scene::lightning::{LightningSettings, bake_lightning, relative_l2};
use squall_scene::{Quiet, Read, Scene, SceneError, World};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut words = std::env::args().skip(1);
    let file = words.next().ok_or("wanted a scene: SCENE.glb [PATHS] [CELL_M]")?;
    let paths = words.next().map_or(Ok(512), |word| word.parse())?;
    let cell_m = words.next().map_or(Ok(8.0), |word| word.parse())?;
    let mut alone = |name: &str, _: u64| Err(SceneError::input(name, "nothing beside the scene", "a file"));
    let world = World::new(Scene::read(&std::fs::read(file)?, &mut alone, &Read::default())?);
    let [low, high] = world.scene().bounds().map(|corner| corner.as_dvec3());
    let volume = [low, high.with_z(high.z.min(low.z + 12.0))];
    let directions = vec![DVec3::new(0.628, 0.439, 0.643), DVec3::new(-0.470, -0.171, 0.866)];
    let usual = LightningSettings { directions, cell_m, paths, bounces: 3, seed: 1 };
    let found = bake_lightning(&world, volume, &usual, &Quiet)?;
    let many = LightningSettings { paths: 64 * paths, seed: 2, ..usual };
    let truth = bake_lightning(&world, volume, &many, &Quiet)?;
    let nodes: usize = found.size.iter().product();
    println!(
        "{nodes} nodes, {paths} paths each: L2 {:.4} of {} paths",
        relative_l2(&found, &truth),
        64 * paths
    );
    Ok(())
}
