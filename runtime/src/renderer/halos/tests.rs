use super::*;
use crate::camera::Projection;
use crate::rain::{RainField, RainVolume};
use squall_formats::units::{MillimetresPerHour, Radians};

const SIZE: [u32; 2] = [70, 45];

fn camera() -> Camera {
    let projection = Projection::Perspective { vertical_fov: Radians(1.0) };
    Camera::new(DVec3::Z * 2.0, DVec3::X, DVec3::Z, projection, SIZE).unwrap()
}

fn lamps(places: &[[f32; 3]]) -> Vec<StreetLamp> {
    places.iter().map(|&position| StreetLamp { position, intensity: [300.0, 200.0, 90.0] }).collect()
}

/// A wall to the left and a ground that runs away from the camera, sky to the right.
fn metres(camera: &Camera) -> Vec<f32> {
    let pixel = |i: usize| {
        let (x, y) = (i % SIZE[0] as usize, i / SIZE[0] as usize);
        let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
        let ground = if ray.direction.z < 0.0 { (-2.0 / ray.direction.z) as f32 } else { f32::INFINITY };
        if x < 23 { ground.min(14.0) } else { ground }
    };
    (0..(SIZE[0] * SIZE[1]) as usize).map(pixel).collect()
}

#[test]
fn tiles_show_what_pixels_show() {
    /// Twice what tiles allow for: between middle and corners a halo bends once.
    const ALLOWED: f32 = 2.0 * FrameQuality::STILL.halos.tolerance;
    let camera = camera();
    let metres = metres(&camera);
    let medium = Medium::geometric(MillimetresPerHour(60.0));
    let (field, tables) = (RainField::from(RainVolume::default()), Spreading::of(None, medium.phase()));
    let mut halos = Halos::new(&tables, &medium, &field);
    halos.add_lamps(&lamps(&[[20.0, 3.0, 5.0], [60.0, -8.0, 6.0], [300.0, 40.0, 6.0]]), camera.position);
    let dark = vec![[1e-6f32; 3]; metres.len()];
    let mut picture = Picture { width: SIZE[0] as usize, height: SIZE[1] as usize, pixels: dark };
    halos.draw(&camera, &metres, &mut picture);
    for (i, (pixel, &metres)) in picture.pixels.iter().zip(&metres).enumerate() {
        let (x, y) = (i % SIZE[0] as usize, i / SIZE[0] as usize);
        let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
        let wanted = halos.radiance(&ray, f64::from(metres), [0.0; 3])[0];
        assert!((pixel[0] - 1e-6 - wanted).abs() <= ALLOWED * wanted, "{x} {y}: {} {wanted}", pixel[0]);
    }
}

#[test]
fn a_halo_is_what_is_scattered_once_and_more_often_cut_where_the_scene_ends() {
    let camera = camera();
    let medium = Medium::geometric(MillimetresPerHour(60.0));
    let (field, tables) = (RainField::from(RainVolume::default()), Spreading::of(None, medium.phase()));
    let mut halos = Halos::new(&tables, &medium, &field);
    let lamp = DVec3::new(400.0, 30.0, 6.0);
    halos.add_lamps(&lamps(&[lamp.as_vec3().to_array()]), camera.position);
    let ray = camera.ray(30.0, 20.0);
    let mut last = 0.0;
    for end in [3.0, 50.0, 380.0, 420.0, f64::INFINITY] {
        let beside = PointBeside::new(lamp, ray.origin, ray.direction, end, LAMP_RADIUS_M);
        let once = tables.once.of_point(medium.extinction().0, &beside)[0];
        let more = tables.more.of_point(medium.extinction().0, &beside)[0];
        let found = f64::from(halos.radiance(&ray, end, [0.0; 3])[0]);
        assert!((found / (300.0 * (once + more)) - 1.0).abs() < 1e-5, "{end}: {found} {once} {more}");
        assert!(more > 0.0 && found > last, "{end}");
        last = found;
    }
}

#[test]
fn rain_that_ends_before_a_lamp_or_begins_beyond_it_dims_its_halo() {
    let camera = camera();
    let medium = Medium::geometric(MillimetresPerHour(60.0));
    let tables = Spreading::of(None, medium.phase());
    let lamp = lamps(&[[100.0, 2.0, 4.0]]);
    let ray = camera.ray(35.0, 20.0);
    let halo = |radius: Option<f64>| {
        use crate::rain::Region;
        use squall_formats::units::Metres;
        let region =
            radius.map(|radius| Region { centre: [0.0; 2], radius: Metres(radius), softness: Metres(0.0) });
        let field = RainField::from(RainVolume { ceiling: None, region });
        let mut halos = Halos::new(&tables, &medium, &field);
        halos.add_lamps(&lamp, camera.position);
        halos.radiance(&ray, f64::INFINITY, [0.0; 3])[0]
    };
    let radii = [Some(10.0), Some(60.0), Some(150.0), Some(1e4), None];
    let found = radii.map(halo);
    assert!(found[0] > 0.0 && found.windows(2).all(|pair| pair[0] < pair[1] * 1.0001), "{found:?}");
    assert!(found[0] < 0.2 * found[4] && found[3] > 0.99 * found[4], "{found:?}");
}

#[test]
fn a_tower_before_a_lamp_darkens_the_rain_behind_it_and_none_before_it() {
    /// Texels of a lamp's map are 3° wide, and the shadow's edge is sought by halves.
    const EDGE: f64 = 0.05;
    let town = crate::shade::town::tests::small_town();
    let medium = Medium::geometric(MillimetresPerHour(60.0));
    let (field, tables) = (RainField::from(RainVolume::default()), Spreading::of(None, medium.phase()));
    let lamp = DVec3::from_array(town.lamps()[0].position.map(f64::from));
    let radiance = |walls: bool, eye: DVec3, towards: DVec3, end: f64| {
        let mut halos = Halos::new(&tables, &medium, &field).with_walls(walls.then_some(&town));
        halos.add_lamps(town.lamps(), eye);
        f64::from(halos.radiance(&Ray { origin: eye, direction: towards }, end, [0.0; 3])[0])
    };
    // The tower stands over x from −10 to 10 and y from 100 to 120; the lamp at y = 30. Along x before it nothing changes.
    let before = DVec3::new(-60.0, 60.0, 5.0);
    let whole = radiance(false, before, DVec3::X, 120.0);
    assert!(whole > 0.0 && (radiance(true, before, DVec3::X, 120.0) / whole - 1.0).abs() < 1e-6);
    // Behind it a ray within the shadow has nothing.
    let behind = DVec3::new(-8.0, 160.0, 5.0);
    assert!(radiance(true, behind, DVec3::X, 16.0) == 0.0 && radiance(false, behind, DVec3::X, 16.0) > 0.0);
    // A long ray loses what lies between the shadow's edges: lines from the lamp past the tower's front corners.
    let start = DVec3::new(-100.0, 160.0, 5.0);
    let edge = |x: f64, y: f64| lamp.x + (x - lamp.x) * (160.0 - lamp.y) / (y - lamp.y) - start.x;
    let [left, right] = [edge(-10.0, 100.0), edge(10.0, 120.0).max(edge(10.0, 100.0))];
    let once = |end: f64| {
        let beside = PointBeside::new(lamp, start, DVec3::X, end, LAMP_RADIUS_M);
        tables.once.of_point(medium.extinction().0, &beside)[0]
    };
    let open = (once(left) + once(200.0) - once(right)) / once(200.0);
    let found = radiance(true, start, DVec3::X, 200.0) / radiance(false, start, DVec3::X, 200.0);
    assert!((found - open).abs() < EDGE, "{found} {open}");
}

#[test]
fn rain_under_a_roof_shows_no_halo_and_half_a_roof_leaves_the_rays_part_beyond_it() {
    use crate::rain::{CoveredRain, Covers, Shelter};
    /// An edge is found within a three-hundredth of the angle at the lamp.
    const EDGE: f64 = 0.05;
    let camera = camera();
    let medium = Medium::geometric(MillimetresPerHour(60.0));
    let tables = Spreading::of(None, medium.phase());
    let field = RainField::from(RainVolume::default());
    let lamp = DVec3::new(60.0, 4.0, 5.0);
    let ray = camera.ray(35.0, 22.0);
    let halo = |roof: &dyn Shelter| {
        let covers = Covers { first: Some(roof), maps: &[] };
        let covered = CoveredRain::new(field, covers, DVec3::new(0.0, 0.0, -6.0), &camera);
        let mut halos = Halos::new(&tables, &medium, &field).under(&covered);
        halos.add_lamps(&lamps(&[lamp.as_vec3().to_array()]), camera.position);
        f64::from(halos.radiance(&ray, 200.0, [0.0; 3])[0])
    };
    let open = halo(&|_: DVec3, _: DVec3| true);
    assert!(open > 0.0 && halo(&|point: DVec3, _: DVec3| point.z > 500.0) == 0.0);
    // Dry up to 40 m from the eye, below 30 m: the lamp is dimmed by the 20 m beyond.
    let found = halo(&|point: DVec3, _: DVec3| point.x > 40.0 || point.z > 30.0);
    let extinction = medium.extinction().0;
    let of = |extinction: f64, end: f64| {
        let beside = PointBeside::new(lamp, ray.origin, ray.direction, end, LAMP_RADIUS_M);
        tables.once.of_point(extinction, &beside)[0]
    };
    let distance = lamp.distance(ray.origin);
    let thinned = extinction * (distance - 40.0) / distance;
    let edge = 40.0 / ray.direction.x;
    let wanted = 300.0 * (of(thinned, 200.0) - of(thinned, edge));
    // Light that is scattered more often adds some per cent.
    assert!(found > wanted && found < wanted * 1.1 + EDGE * wanted, "{found} {wanted} {open}");
}
