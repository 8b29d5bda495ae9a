use super::*;
use glam::{DVec2, Vec3};
use squall_scene::heights::{Grid, bake_heights};
use squall_scene::{Read, Scene, World};

fn street() -> Scene {
    let none = |_: &str, _: u64| -> Result<Vec<u8>, squall_scene::SceneError> { unreachable!() };
    Scene::read(&synth_street(1), &mut { none }, &Read::default()).unwrap()
}

#[test]
fn a_street_is_small_reads_back_whole_and_is_the_same_again() {
    let bytes = synth_street(1);
    assert!(bytes.len() <= 1_000_000, "{} bytes", bytes.len());
    assert!(bytes == synth_street(1) && bytes != synth_street(2));
    let scene = street();
    assert_eq!(scene.report.left_out(), None);
    assert!(scene.report.triangles > 10_000 && scene.lamps.len() >= 5);
    for name in
        ["asphalt", "granite kerb", "neon pink", "awning green", "car paint", "signal red", "shop glass"]
    {
        assert!(scene.materials.iter().any(|material| material.name == name), "{name}");
    }
}

#[test]
fn its_road_has_a_crown_kerbs_and_hollows_that_fill() {
    let scene = street();
    let grid = Grid::over(DVec2::new(-24.0, -7.0), DVec2::new(24.0, 7.0), 0.1).unwrap();
    let heights = bake_heights(&scene, grid, &squall_scene::Quiet).unwrap();
    let mean = |y: f64| {
        let row =
            (0..400).map(|k| heights.middle[grid.cell(DVec2::new(-19.95 + 0.1 * f64::from(k), y)).unwrap()]);
        row.sum::<f32>() / 400.0
    };
    assert!(mean(0.05) > mean(3.75) + 0.05 && mean(4.55) > mean(3.95) + 0.05);
    let flooded = squall_scene::flow::bake_flooded(&heights, 0.3, &squall_scene::Quiet).unwrap();
    let wet = flooded.depth_m.iter().filter(|depth| **depth > 0.002).count() as f64 * 0.01;
    let deepest = flooded.depth_m.iter().copied().fold(0.0, f32::max);
    // Of 384 m² of road some stand under water, nowhere deeper than a shoe.
    assert!((8.0..160.0).contains(&wet) && (0.01..0.12).contains(&deepest), "{wet} m², {deepest} m");
}

#[test]
fn fronts_look_outwards() {
    // A ray from a place where one can stand meets the front of what it meets first.
    let world = World::new(street());
    let mut random = Random::new(5);
    let (mut backs, mut all) = (0, 0);
    for _ in 0..4000 {
        let place = DVec3::new(random.range(-20.0, 20.0), random.range(-3.0, 3.0), random.range(2.0, 6.0));
        let ray = squall_scene::Ray { origin: place.as_vec3(), direction: random.direction().as_vec3() };
        let Some(hit) = world.first(&ray, f32::INFINITY, true) else { continue };
        let scene = world.scene();
        if scene.materials[scene.material[hit.triangle as usize] as usize].two_sided {
            continue;
        }
        all += 1;
        backs += u32::from(world.normal(hit.triangle).dot(ray.direction) > 0.0);
    }
    assert!(all > 2000 && backs * 200 < all, "{backs} of {all}");
    assert!(world.scene().bounds()[1].z > 12.0 && world.scene().bounds()[0].cmpgt(Vec3::splat(-60.0)).all());
}
