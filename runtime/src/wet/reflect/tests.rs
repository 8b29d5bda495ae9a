use super::*;
use crate::camera::Camera;
use crate::world::WorldLight;
use glam::DVec3;
use squall_formats::units::Degrees;

const SIZE: [usize; 2] = [160, 120];
/// Height of the eye, and distance of a wall across the view, m.
const EYE_M: f64 = 1.6;
const WALL_M: f64 = 20.0;

/// Ground z = 0 before an endless wall, from eye height, looking level.
struct Street {
    view: View,
    depth: Vec<f32>,
    inverse: Vec<f32>,
    places: Vec<DVec3>,
}

fn street() -> Street {
    let camera =
        Camera::look_at(DVec3::Z * EYE_M, DVec3::new(0.0, WALL_M, EYE_M), Degrees(50.0), [160, 120]).unwrap();
    let (mut depth, mut places) = (Vec::new(), Vec::new());
    for i in 0..SIZE[0] * SIZE[1] {
        let ray = camera.ray((i % SIZE[0]) as f64 + 0.5, (i / SIZE[0]) as f64 + 0.5);
        let wall = WALL_M / ray.direction.y;
        let ground = if ray.direction.z < 0.0 { -EYE_M / ray.direction.z } else { f64::INFINITY };
        let place = ray.origin + ray.direction * wall.min(ground);
        depth.push((place - camera.position).dot(camera.forward) as f32);
        places.push(place);
    }
    let mut inverse = Vec::new();
    march::inverse_of(&depth, &mut inverse);
    Street { view: View::new(&camera), depth, inverse, places }
}

impl Street {
    fn picture(&self, light: impl Fn(DVec3) -> f32) -> Pyramid {
        let mut pyramid = Pyramid::default();
        let pixels: Vec<[f32; 3]> = self.places.iter().map(|place| [light(*place); 3]).collect();
        pyramid.fill(SIZE, &pixels);
        pyramid
    }

    fn with<T>(&self, picture: &Pyramid, world: &InScattering, task: impl FnOnce(&Mirror<'_>) -> T) -> T {
        let march =
            March { view: &self.view, inverse_depth: &self.inverse, reach_m: 500.0, thickness_m: 1.0 };
        task(&Mirror { view: &self.view, picture, march, world })
    }

    /// Place before the camera, normal and direction to the eye of a ground pixel.
    fn ground(&self, x: usize, y: usize) -> (Vec3, Vec3, Vec3) {
        let place = self.view.place(x, y, self.depth[y * SIZE[0] + x]);
        (place, self.view.from_world(Vec3::Z), self.view.to_eye(place))
    }
}

fn world(radiance: f32) -> InScattering {
    WorldLight::uniform([radiance; 3]).in_scattering(&Phase::HenyeyGreenstein(1.0))
}

use crate::medium::Phase;

#[test]
fn a_flat_wet_plane_is_a_mirror() {
    /// A pixel of the wall is 16 cm wide, and its light is looked up between four.
    const PIXEL: f32 = 0.03;
    let street = street();
    let light = |place: DVec3| (2.0 + libm::sin(0.5 * place.z) + 0.5 * libm::cos(0.3 * place.x)) as f32;
    let picture = street.picture(light);
    let table = FresnelTable::water();
    street.with(&picture, &world(0.0), |mirror| {
        let mut seen = 0;
        for (x, y) in (70..118).flat_map(|y| (10..150).map(move |x| (x, y))) {
            let place = street.places[y * SIZE[0] + x];
            if place.z > 1e-6 {
                continue;
            }
            // The wall where the mirrored ray meets it.
            let way = place - DVec3::Z * EYE_M;
            let further = (WALL_M - place.y) / way.y;
            let met = place + DVec3::new(way.x, way.y, -way.z) * further;
            if !(0.4..7.0).contains(&met.z) || met.x.abs() > 9.0 {
                continue;
            }
            let found = mirror.fan(street.ground(x, y), 0.0, &table);
            let cosine = EYE_M / way.length();
            let wanted = light(met) * fresnel(cosine, WATER_INDEX) as f32;
            assert!(
                (found.light[0] / wanted - 1.0).abs() < PIXEL,
                "{x} {y} {met}: {} {wanted}",
                found.light[0]
            );
            seen += 1;
        }
        assert!(seen > 1000, "{seen}");
    });
}

#[test]
fn a_mirror_at_normal_incidence_reflects_its_f0_of_what_stands_there() {
    let street = street();
    let picture = street.picture(|_| 0.0);
    let straight = (WATER_INDEX - 1.0) / (WATER_INDEX + 1.0);
    street.with(&picture, &world(3.0), |mirror| {
        // A wall that faces the eye mirrors what is behind it: the world.
        let place = Vec3::new(0.0, 0.0, 20.0);
        let found = mirror.fan((place, Vec3::NEG_Z, Vec3::NEG_Z), 0.0, &FresnelTable::water());
        assert!((f64::from(found.light[1]) - 3.0 * straight * straight).abs() < 1e-5, "{found:?}");
    });
}

#[test]
fn a_rough_film_under_an_even_world_mirrors_its_mean_reflection() {
    let street = street();
    let picture = street.picture(|_| 2.0);
    street.with(&picture, &world(2.0), |mirror| {
        for (y, slope) in [(75, 0.05), (90, 0.11), (110, 0.2)] {
            let found = mirror.fan(street.ground(80, y), slope, &FresnelTable::water());
            assert!((found.light[0] - 2.0 * found.fresnel).abs() < 1e-3 * found.light[0], "{found:?}");
        }
    });
}

/// What facets of every slope mirror, one by one: the integral that the fan's bins stand for.
fn every_facet(mirror: &Mirror<'_>, (place, normal, to_eye): (Vec3, Vec3, Vec3), slope: f32) -> f32 {
    let along = (to_eye - normal * normal.dot(to_eye)).normalize();
    let aside = normal.cross(along);
    let table = FresnelTable::water();
    let (mut sum, mut weight) = (0.0, 0.0);
    let steps = 400;
    for step in 0..steps {
        let deviation = 8.0 * (step as f32 + 0.5) / steps as f32 - 4.0;
        for lean in [-1.1, -0.3, 0.3, 1.1] {
            let facet = (normal + along * (deviation * slope) + aside * (lean * slope)).normalize();
            let cosine = facet.dot(to_eye);
            if cosine <= 0.0 {
                continue;
            }
            let mut ray = facet * (2.0 * cosine) - to_eye;
            ray -= normal * (2.0 * ray.dot(normal)).min(0.0);
            let share = libm::expf(-0.5 * deviation * deviation) * cosine / facet.dot(normal);
            let light = match mirror.march.end(place, ray) {
                End::Seen(at) => mirror.picture.at(at, 0.0).x * mirror.march.share(at),
                _ => 0.0,
            };
            sum += share * table.at(cosine) * light;
            weight += share;
        }
    }
    sum / weight
}

#[test]
fn a_lamps_streak_keeps_its_energy_and_stretches_more_the_flatter_it_is_looked_at() {
    /// Four bins for a normal distribution, squares for what facets that lean aside blur.
    const BINS: f32 = 0.12;
    let street = street();
    let lamp = DVec3::new(0.0, WALL_M, 3.0);
    let picture = street.picture(|place| if place.distance(lamp) < 0.3 { 100.0 } else { 0.0 });
    let table = FresnelTable::water();
    street.with(&picture, &world(0.0), |mirror| {
        let (mut fan, mut truth, mut mirrored) = (0.0, 0.0, 0.0);
        let (mut rows, mut sharp) = (0, 0);
        for y in 66..SIZE[1] {
            let (mut row, mut smooth) = (0.0, 0.0);
            for x in (56..104).step_by(2) {
                if street.places[y * SIZE[0] + x].z > 1e-6 {
                    continue;
                }
                row += mirror.fan(street.ground(x, y), 0.11, &table).light[0];
                truth += every_facet(mirror, street.ground(x, y), 0.11);
                smooth += mirror.fan(street.ground(x, y), 0.0, &table).light[0];
            }
            fan += row;
            mirrored += smooth;
            rows += usize::from(row > 0.05);
            sharp += usize::from(smooth > 0.05);
        }
        println!("streak {fan}, every facet {truth}, mirror {mirrored}; rows {rows}, {sharp}");
        assert!((fan / truth - 1.0).abs() < BINS, "{fan} {truth}");
        assert!(rows > 3 * sharp && sharp > 0, "{rows} {sharp}");
    });
}

#[test]
fn a_table_of_facets_tells_what_leaning_films_mirror_around_it() {
    /// Bins as wide as the film's deviation; those that end beyond the picture, where the world's light begins, are shared otherwise; and the places lie some
    /// pixels apart.
    const BINS: f32 = 0.2;
    let street = street();
    let picture = street.picture(|place| (3.0 + 0.1 * place.x - 0.2 * place.z) as f32);
    let water = FresnelTable::water();
    street.with(&picture, &world(2.0), |mirror| {
        for y in [92, 104] {
            let (place, normal, to_eye) = street.ground(80, y);
            let table = mirror.facets((place, normal, to_eye), &water);
            for lean in [Vec3::ZERO, Vec3::new(0.12, 0.0, 0.05), Vec3::new(-0.2, 0.0, -0.04)] {
                let (place, _, to_eye) = street.ground(84, y + 3);
                let normal = (normal + lean).normalize();
                let told = table.shown((normal, to_eye), 0.11, &water).unwrap();
                let looked = mirror.fan((place, normal, to_eye), 0.11, &water);
                let ratio = told.light[0] / looked.light[0];
                assert!((ratio - 1.0).abs() < BINS, "{y} {lean}: {ratio}");
                assert!((told.fresnel / looked.fresnel - 1.0).abs() < BINS, "{y} {lean}");
            }
        }
        let (place, normal, to_eye) = street.ground(80, 100);
        let table = mirror.facets((place, normal, to_eye), &water);
        let steep = (normal + Vec3::X).normalize();
        assert_eq!(
            (table.shown((steep, to_eye), 0.11, &water), table.shown((normal, to_eye), 0.01, &water)),
            (None, None)
        );
    });
}

#[test]
fn the_table_of_reflection_is_fresnels() {
    let table = FresnelTable::water();
    for i in 0..=1000 {
        let cosine = f64::from(i) / 1000.0;
        let wanted = fresnel(cosine, WATER_INDEX);
        assert!((f64::from(table.at(cosine as f32)) - wanted).abs() < 1e-3, "{cosine}");
    }
}
