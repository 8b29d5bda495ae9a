//! Light from overhead on upward surfaces: lamps and shining triangles, shadowed.

use crate::Progress;
use crate::error::SceneError;
use crate::heights::{Grid, Heights};
use crate::light::{Shining, from_lamp, irradiance_of_polygon, shining};
use crate::world::{Ray, World};
use glam::Vec3;
use rayon::prelude::*;
use squall_runtime::random::Random;

/// How finely light from overhead is worked out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OverheadSettings {
    /// Points of a shining triangle that are asked whether they are hidden.
    pub points: u32,
    /// Most shining triangles that a cell looks at: those that would give it most. The others count as unhidden as these are.
    pub triangles: usize,
    /// Seed.
    pub seed: u64,
}

impl Default for OverheadSettings {
    fn default() -> Self {
        Self { points: 4, triangles: 48, seed: 1 }
    }
}

/// Most looks of all cells at lamps and shining triangles, a ray for [`LOOKS_A_RAY`] of them: some ten hours of one core.
pub const MOST_LOOKS: f64 = (1u64 << 40) as f64;
/// How many triangles Lambert's formula is worked out for while a ray is followed, about.
pub const LOOKS_A_RAY: f64 = 16.0;

/// Looks of one cell.
fn looks(lit: usize, lamps: usize, settings: &OverheadSettings) -> f64 {
    let rays = lit.min(settings.triangles) as f64 * f64::from(settings.points) + lamps as f64;
    lit as f64 + LOOKS_A_RAY * rays
}

fn few_enough(looks: f64, grid: &Grid) -> Result<(), SceneError> {
    if looks <= MOST_LOOKS {
        return Ok(());
    }
    let least = (1e3 * grid.cell_m * (looks / MOST_LOOKS).sqrt()).ceil() / 1e3;
    let wanted = format!("at least {least:.3} m, or fewer points, lamps and shining triangles");
    Err(SceneError::input("overhead.cell_m", wanted, format!("{} m, {looks:.1e} looks at them", grid.cell_m)))
}

/// Irradiance of an upward surface on top of what stands in each cell of `grid`, red, green and blue, W/m²; 0 where there is nothing.
/// `heights` say how high that is.
///
/// Errors: more than [`MOST_LOOKS`]; an interruption.
pub fn bake_overhead(
    world: &World,
    grid: Grid,
    heights: &Heights,
    settings: &OverheadSettings,
    progress: &dyn Progress,
) -> Result<[Vec<f32>; 3], SceneError> {
    let lit = shining(world);
    few_enough(looks(lit.len(), world.scene().lamps.len(), settings) * grid.cells() as f64, &grid)?;
    let width = grid.size[0];
    let rows: Result<Vec<Vec<[f32; 3]>>, SceneError> = (0..grid.size[1])
        .into_par_iter()
        .map(|y| {
            let cell = |x: usize| {
                // A cell may look at millions of triangles.
                progress.check()?;
                let middle = grid.middle(x, y);
                let height = heights.grid.cell(middle).map_or(f32::NAN, |cell| heights.middle[cell]);
                if height.is_nan() {
                    return Ok([0.0; 3]);
                }
                let place = World::off(middle.as_vec2().extend(height), Vec3::Z);
                let mut random = Random::from_parts(&[settings.seed, (y * width + x) as u64]);
                Ok(irradiance(world, &lit, place, Vec3::Z, settings, &mut random))
            };
            let row: Result<Vec<_>, SceneError> = (0..width).map(cell).collect();
            progress.advance(1);
            row
        })
        .collect();
    let rows = rows?;
    Ok([0, 1, 2].map(|band| rows.iter().flatten().map(|light| light[band]).collect()))
}

/// Irradiance of a surface by lamps and shining triangles, W/m². `place` is a little off it.
pub fn irradiance(
    world: &World,
    lit: &[Shining],
    place: Vec3,
    normal: Vec3,
    settings: &OverheadSettings,
    random: &mut Random,
) -> [f32; 3] {
    let mut sum = [0.0f32; 3];
    for lamp in &world.scene().lamps {
        let Some((towards, far, power)) = from_lamp(lamp, place.as_dvec3()) else { continue };
        let cosine = towards.dot(normal);
        // Short of the lamp itself, whose glass may stand around it.
        let ray = Ray { origin: place, direction: towards };
        if cosine > 0.0 && !world.blocked(&ray, far - LAMP_RADIUS_M) {
            for band in 0..3 {
                sum[band] += cosine * power[band];
            }
        }
    }
    let mut given: Vec<(f32, &Shining)> = lit
        .iter()
        .map(|one| {
            let share = irradiance_of_polygon(place, normal, &one.corners, one.normal, one.two_sided);
            (share * crate::light::mean(one.radiance), one)
        })
        .filter(|(given, _)| *given > 0.0)
        .collect();
    given.sort_by(|a, b| b.0.total_cmp(&a.0));
    let whole: f32 = given.iter().map(|(given, _)| given).sum();
    let (mut looked_at, mut seen) = (0.0, 0.0);
    for (at, (given, one)) in given.iter().enumerate() {
        // What is left is less than anybody sees, or too much to look at.
        let rest = at >= settings.triangles || *given < 1e-4 * whole;
        let share = match rest {
            true => seen / f32::max(looked_at, 1e-30),
            false => visible(world, one, place, settings.points, random),
        };
        if !rest {
            (looked_at, seen) = (looked_at + given, seen + given * share);
        }
        let factor = share * given / crate::light::mean(one.radiance);
        for band in 0..3 {
            sum[band] += factor * one.radiance[band];
        }
    }
    sum
}

/// A lamp without extent stands in something, m.
pub const LAMP_RADIUS_M: f32 = 0.3;

/// Share of a triangle that is seen from a place, by points spread over it.
fn visible(world: &World, one: &Shining, place: Vec3, points: u32, random: &mut Random) -> f32 {
    let [a, b, c] = one.corners;
    let turn = [random.unit() as f32, random.unit() as f32];
    let mut seen = 0;
    for point in 0..points {
        // Additive recurrence of the plane's golden ratio: spread evenly for any number.
        let at = (point as f32 + 0.5) / points as f32;
        let mut u = (at + turn[0]).fract();
        let mut v = (0.754_877_7 * point as f32 + turn[1]).fract();
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let way = a + u * (b - a) + v * (c - a) - place;
        let far = way.length();
        let ray = Ray { origin: place, direction: way / far };
        seen += u32::from(!world.blocked(&ray, far * 0.999 - 1e-3));
    }
    seen as f32 / points as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quiet;
    use crate::heights::bake_heights;
    use crate::scene::{Lamp, LampKind, Material, Scene};
    use crate::testing::{StopsAfter, cuboid, quad};
    use glam::{DVec2, DVec3};

    fn lit(scene: Scene) -> (Grid, [Vec<f32>; 3]) {
        let world = World::new(scene);
        let grid = Grid::over(DVec2::splat(-4.0), DVec2::splat(4.0), 0.5).unwrap();
        let heights = bake_heights(world.scene(), grid, &Quiet).unwrap();
        let light = bake_overhead(&world, grid, &heights, &OverheadSettings::default(), &Quiet).unwrap();
        (grid, light)
    }

    fn ground() -> Scene {
        let mut scene = Scene::default();
        let glow = Material { emission: [1.0, 2.0, 4.0], ..Material::default() };
        scene.materials = vec![Material::default(), glow];
        quad(&mut scene, [-4.0, -4.0, 0.0], [8.0, 0.0, 0.0], [0.0, 8.0, 0.0], 0);
        scene
    }

    #[test]
    fn a_lamp_lights_the_ground_by_its_cosine_and_not_behind_a_wall() {
        let mut scene = ground();
        cuboid(&mut scene, [1.2, -4.0, 0.0], [1.4, 4.0, 3.0], 0);
        let position_m = DVec3::new(0.0, 0.0, 3.0);
        scene.lamps =
            vec![Lamp { name: String::new(), position_m, power: [90.0, 9.0, 0.0], kind: LampKind::Point }];
        let (grid, light) = lit(scene);
        for (cell, found) in light[0].iter().enumerate() {
            let at = grid.middle(cell % 16, cell / 16);
            if (1.0..1.5).contains(&at.x) {
                continue;
            }
            let squared = at.length_squared() + 9.0;
            let wanted = if at.x > 1.0 { 0.0 } else { 90.0 * 3.0 / (squared * squared.sqrt()) };
            assert!((f64::from(*found) - wanted).abs() <= 2e-3 * wanted, "{at}: {found} {wanted}");
            assert!((10.0 * light[1][cell] - found).abs() <= 1e-4 * found && light[2][cell] == 0.0);
        }
    }

    #[test]
    fn a_shining_ceiling_gives_its_form_factor_and_half_of_it_behind_half_a_screen() {
        let mut scene = ground();
        // Faces down; half of it is hidden from the middle by a sheet below.
        quad(&mut scene, [-2.0, -2.0, 2.0], [0.0, 4.0, 0.0], [4.0, 0.0, 0.0], 1);
        let (grid, open) = {
            // The ceiling is the uppermost surface: light on the ground below it is asked for there.
            let world = World::new(scene.clone());
            let lit = shining(&world);
            let mut random = Random::new(1);
            let place = Vec3::new(0.0, 0.0, 1e-3);
            let many = OverheadSettings { points: 64, ..OverheadSettings::default() };
            let light = irradiance(&world, &lit, place, Vec3::Z, &many, &mut random);
            (place, light)
        };
        let slant = libm::sqrtf(8.0);
        let wanted = 4.0 * (2.0 / slant) * libm::atanf(2.0 / slant);
        for (found, radiance) in open.iter().zip([1.0, 2.0, 4.0]) {
            assert!((found / (wanted * radiance) - 1.0).abs() < 2e-3, "{found} {wanted}");
        }
        quad(&mut scene, [-2.0, -2.0, 1.9], [2.0, 0.0, 0.0], [0.0, 4.0, 0.0], 0);
        let world = World::new(scene);
        let many = OverheadSettings { points: 4096, ..OverheadSettings::default() };
        let half = irradiance(&world, &shining(&world), grid, Vec3::Z, &many, &mut Random::new(2));
        // The sheet is a little nearer than the ceiling, and hides a little less of it than half.
        assert!((half[0] / open[0] - 0.5).abs() < 0.03, "{half:?} {open:?}");
    }

    #[test]
    fn more_looks_than_hours_allow_are_refused_and_a_row_stops_when_it_is_told_to() {
        // 4096 points of 48 triangles for each of 2²⁴ cells would take weeks.
        let many = OverheadSettings { points: 4096, ..OverheadSettings::default() };
        assert_eq!(looks(100, 2, &many), 100.0 + 16.0 * (48.0 * 4096.0 + 2.0));
        let grid = Grid::over(DVec2::ZERO, DVec2::splat(4096.0), 1.0).unwrap();
        let error = few_enough(looks(100, 2, &many) * grid.cells() as f64, &grid).unwrap_err().to_string();
        assert!(error.contains("overhead.cell_m: wanted at least 6.929 m"), "{error}");
        assert!(few_enough(looks(100, 2, &OverheadSettings::default()) * grid.cells() as f64, &grid).is_ok());
        let world = World::new(ground());
        let grid = Grid::over(DVec2::splat(-4.0), DVec2::splat(4.0), 8.0 / 64.0).unwrap();
        let heights = bake_heights(world.scene(), grid, &Quiet).unwrap();
        // More looks than there are rows.
        let stops = StopsAfter::new(100);
        let stopped = bake_overhead(&world, grid, &heights, &OverheadSettings::default(), &stops);
        assert_eq!(stopped.unwrap_err(), SceneError::Interrupted);
    }
}
