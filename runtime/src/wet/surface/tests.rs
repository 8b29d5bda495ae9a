use super::*;
use crate::camera::Camera;
use crate::wet::frame::GBuffer;
use crate::wet::maps::WetMaps;
use crate::wet::material::{WATER_INDEX, diffuse_fresnel, wet_albedo};
use crate::wet::ripples::DropFlux;
use squall_formats::units::Degrees;

/// Single precision.
const ROUND_OFF: f32 = 1e-5;
const SIZE: [usize; 2] = [64, 48];

/// A street of grey asphalt before a bright wall, under a dim sky.
struct Street {
    buffer: GBuffer,
    camera: Camera,
    maps: WetMaps,
    light: WorldLight,
    flux: Vec<DropFlux>,
}

fn street(scale: f32) -> Street {
    let camera =
        Camera::look_at(DVec3::Z * 1.6, DVec3::new(0.0, 20.0, 1.0), Degrees(50.0), [64, 48]).unwrap();
    let mut buffer = GBuffer { size: SIZE, emission: Some(Vec::new()), ..GBuffer::default() };
    for i in 0..SIZE[0] * SIZE[1] {
        let ray = camera.ray((i % SIZE[0]) as f64 + 0.5, (i / SIZE[0]) as f64 + 0.5);
        let wall = 20.0 / ray.direction.y;
        let ground = if ray.direction.z < 0.0 { -1.6 / ray.direction.z } else { f64::INFINITY };
        let place = ray.origin + ray.direction * wall.min(ground);
        let high = place.z > 8.0;
        let on_wall = wall < ground;
        buffer.depth_m.push(if high {
            f32::INFINITY
        } else {
            (place - camera.position).dot(camera.forward) as f32
        });
        let normal = if on_wall { [0.0, -1.0, 0.0] } else { [0.0, 0.0, 1.0] };
        buffer.normal.push(if high { [0.0; 3] } else { normal });
        let colour = if high {
            0.3
        } else if on_wall {
            2.0
        } else {
            0.5
        };
        buffer.colour.push([colour * scale, colour * scale, 0.5 * colour * scale]);
        if let Some(emission) = &mut buffer.emission {
            emission.push([if on_wall && !high { 0.5 * scale } else { 0.0 }; 3]);
        }
    }
    let flux = vec![DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 400.0 }];
    let light = WorldLight::uniform([0.3 * scale; 3]);
    Street { buffer, camera, maps: WetMaps::default(), light, flux }
}

impl Street {
    fn frame(&self, rate: f64) -> WetFrame<'_> {
        WetFrame {
            buffer: &self.buffer,
            colour: &self.buffer.colour,
            camera: &self.camera,
            maps: &self.maps,
            light: &self.light,
            rate_mm_per_h: rate,
            flux: if rate > 0.0 { &self.flux } else { &[] },
            wind: DVec3::ZERO,
            time_s: 1.0,
            seed: 5,
            lightning: [0.0; 2],
        }
    }

    fn wet(&self, rate: f64, controls: &SurfaceControls) -> (Layer, SurfaceReport) {
        let mut layer = Layer::default();
        let report = Surface::new(5).unwrap().draw(&self.frame(rate), controls, &mut layer).unwrap();
        (layer, report)
    }
}

#[test]
fn a_dry_surface_keeps_its_bits() {
    let street = street(1.0);
    let (layer, report) = street.wet(0.0, &SurfaceControls::default());
    assert_eq!(report, SurfaceReport::default());
    let mut picture = street.buffer.colour.clone();
    layer.onto(&mut picture).unwrap();
    assert_eq!(picture, street.buffer.colour);
    let mut masked = street;
    masked.buffer.wettable = Some(vec![0.0; SIZE[0] * SIZE[1]]);
    let (layer, _) = masked.wet(25.0, &SurfaceControls::default());
    assert!(layer.alpha.iter().all(|alpha| *alpha == 0.0));
}

#[test]
fn light_is_linear_in_all_intensities_at_once() {
    let controls = SurfaceControls::default();
    let (one, of_one) = street(1.0).wet(25.0, &controls);
    let (three, of_three) = street(3.0).wet(25.0, &controls);
    assert_eq!(of_one, of_three);
    assert_eq!(one.alpha, three.alpha);
    for (a, b) in one.light.iter().flatten().zip(three.light.iter().flatten()) {
        assert!((3.0 * a - b).abs() <= 10.0 * ROUND_OFF * b.abs(), "{a} {b}");
    }
}

#[test]
fn wet_asphalt_is_darker_near_by_and_mirrors_the_wall_far_off() {
    let street = street(1.0);
    let (layer, report) = street.wet(25.0, &SurfaceControls::default());
    let mut picture = street.buffer.colour.clone();
    layer.onto(&mut picture).unwrap();
    let ground = |y: usize| y * SIZE[0] + 30;
    let rows = |near: f32, far: f32| {
        (0..SIZE[1])
            .filter(|&y| street.buffer.normal[ground(y)][2] > 0.5)
            .filter(|&y| (near..far).contains(&street.buffer.depth_m[ground(y)]))
            .collect::<Vec<_>>()
    };
    let ratio = |y: usize| picture[ground(y)][0] / street.buffer.colour[ground(y)][0];
    assert!(rows(0.0, 4.0).into_iter().all(|y| ratio(y) < 1.0));
    let far = rows(10.0, 14.0).into_iter().map(ratio).fold(f32::INFINITY, f32::min);
    assert!(far > 1.2, "{far}");
    assert!(report.wet > 1000 && report.puddles > 100 && report.puddles < report.wet, "{report:?}");
    assert!(picture.iter().flatten().all(|value| value.is_finite() && *value >= 0.0));
}

#[test]
fn stones_that_lean_do_not_drain_the_puddle_above_them() {
    /// Of a few hundred pixels some lie at shores.
    const SHORES: f32 = 0.3;
    let mut street = street(1.0);
    let even = street.wet(25.0, &SurfaceControls::default()).1.puddles as f32;
    for (k, normal) in street.buffer.normal.iter_mut().enumerate().filter(|(_, normal)| normal[2] > 0.5) {
        // Up to nine degrees, each its own way.
        let lean = |odd: bool| if odd { 0.11 } else { -0.11 };
        *normal = Vec3::new(lean(k % 3 == 0), lean(k % 5 < 2), 1.0).normalize().into();
    }
    let bumpy = street.wet(25.0, &SurfaceControls::default()).1.puddles as f32;
    assert!((bumpy / even - 1.0).abs() < SHORES && even > 100.0, "{even} {bumpy}");
}

#[test]
fn films_that_nodes_tell_are_those_that_are_looked_at() {
    /// What a tenth of a difference between nodes leaves of it between them.
    const BETWEEN: f32 = 0.02;
    let street = street(1.0);
    let look = |tolerance: f32| {
        street.wet(25.0, &SurfaceControls { tolerance, puddles: 0.0, ..SurfaceControls::default() })
    };
    let ((told, few), (looked, all)) = (look(0.1), look(0.0));
    assert!(few.rays * 3 < all.rays * 2, "{few:?} {all:?}");
    let (mut off, mut sum) = (0.0, 0.0);
    for (a, b) in told.light.iter().flatten().zip(looked.light.iter().flatten()) {
        off += (a - b) * (a - b);
        sum += b * b;
    }
    assert!(off < BETWEEN * BETWEEN * sum, "{}", (off / sum).sqrt());
}

#[test]
fn dry_looks_have_no_film_and_send_no_rays() {
    let mut street = street(1.0);
    let usual = SurfaceControls { puddles: 0.0, tolerance: 0.0, ..SurfaceControls::default() };
    let whole = street.wet(25.0, &usual).1.rays;
    let half = SIZE[0] / 2;
    street.buffer.wettable = Some((0..SIZE[0] * SIZE[1]).map(|at| f32::from(at % SIZE[0] >= half)).collect());
    for controls in [usual, SurfaceControls { paper_streaks: 1.0, ..usual }] {
        let mut surface = Surface::new(5).unwrap();
        let mut layer = Layer::default();
        surface.draw(&street.frame(25.0), &controls, &mut layer).unwrap();
        for (at, film) in surface.films.iter().enumerate().filter(|(at, _)| at % half < half / 2) {
            assert!(!film.shown && film.light == [0.0; 3] && film.fresnel == 0.0, "{at}");
        }
        assert!(surface.films.iter().any(|film| film.shown && film.light[0] > 0.0));
        let mut dry = (0..SIZE[0] * SIZE[1]).filter(|at| at % SIZE[0] < half);
        assert!(dry.all(|at| layer.alpha[at] == 0.0 && layer.light[at] == [0.0; 3]));
    }
    let rays = street.wet(25.0, &usual).1.rays;
    assert!(rays > 0 && rays * 10 < whole * 6, "{rays} {whole}");
}

#[test]
fn a_surfaces_own_light_is_not_darkened() {
    let material = Material { albedo: [0.2; 3], roughness: 0.8, porosity: 1.0 };
    let pixel = SurfacePixel {
        colour: [5.0, 4.0, 3.0],
        emission: [5.0, 4.0, 3.0],
        material,
        wetness: Wetness { share: 1.0 },
        film: 1.0,
        cosine: 1.0,
    };
    let wet = wet_surface(&pixel, &SurfaceLight { mirrored: [0.0; 3], fresnel: 0.02 });
    assert_eq!(wet.light(&pixel), pixel.colour);
    let diffuse = SurfacePixel { emission: [0.0; 3], ..pixel };
    let light =
        wet_surface(&diffuse, &SurfaceLight { mirrored: [0.0; 3], fresnel: MEAN_REFLECTION }).light(&diffuse);
    let wanted = wet_albedo(0.2) as f32 / 0.2;
    for band in 0..3 {
        assert!((light[band] / diffuse.colour[band] - wanted).abs() < ROUND_OFF);
    }
    let mean = diffuse_fresnel(WATER_INDEX) as f32;
    assert!((mean - MEAN_REFLECTION).abs() < 2e-4, "{mean}");
}

#[test]
fn wetness_grows_with_the_rain_and_puddles_with_it() {
    let street = street(1.0);
    let count = |rate: f64, soaked: f32| {
        street.wet(rate, &SurfaceControls { soaked, ..SurfaceControls::default() }).1.puddles
    };
    let (early, late) = (count(25.0, 300.0), count(25.0, 3600.0));
    assert!(early < late, "{early} {late}");
    assert!(count(2.0, 1800.0) < count(75.0, 1800.0));
    let mean = |soaked: f32| {
        let (layer, _) =
            street.wet(5.0, &SurfaceControls { soaked, puddles: 0.0, ..SurfaceControls::default() });
        layer.alpha.iter().sum::<f32>()
    };
    assert!(mean(0.0) < mean(60.0) && mean(60.0) < mean(600.0));
}

#[test]
fn the_papers_forms_are_other_pictures_and_edges_lose_their_mirror() {
    let street = street(1.0);
    let usual = SurfaceControls::default();
    let (ours, _) = street.wet(25.0, &usual);
    for controls in [
        SurfaceControls { paper_streaks: 1.0, ..usual },
        SurfaceControls { paper_fresnel: 1.0, ..usual },
        SurfaceControls { edge_exponent: 3.0, ..usual },
    ] {
        let (theirs, _) = street.wet(25.0, &controls);
        assert_ne!(ours.light, theirs.light);
        assert!(theirs.light.iter().flatten().all(|value| value.is_finite() && *value >= 0.0));
    }
    let far = |layer: &Layer| {
        let at = (0..SIZE[0] * SIZE[1])
            .filter(|&at| street.buffer.depth_m[at] > 15.0 && street.buffer.normal[at][2] > 0.5);
        at.map(|at| layer.light[at][0]).sum::<f32>()
    };
    let (edged, _) = street.wet(25.0, &SurfaceControls { edge_exponent: 3.0, ..usual });
    assert!(far(&edged) < 0.6 * far(&ours), "{} {}", far(&edged), far(&ours));
}

#[test]
fn the_same_time_gives_the_same_picture_and_bad_numbers_are_refused() {
    let street = street(1.0);
    let controls = SurfaceControls::default();
    let mut surface = Surface::new(5).unwrap();
    let mut layer = Layer::default();
    for time_s in [0.2, 3.0, 1.0] {
        surface.draw(&WetFrame { time_s, ..street.frame(25.0) }, &controls, &mut layer).unwrap();
    }
    assert_eq!(layer, street.wet(25.0, &controls).0);
    let wrong = WetFrame { time_s: f64::NAN, ..street.frame(25.0) };
    assert!(surface.draw(&wrong, &controls, &mut layer).is_err());
    let mut holes = street;
    (holes.buffer.depth_m[2000], holes.buffer.normal[2001]) = (f32::NAN, [f32::NAN; 3]);
    let (layer, _) = holes.wet(25.0, &controls);
    assert_eq!((layer.alpha[2000], layer.alpha[2001]), (0.0, 0.0));
    assert!(layer.light.iter().flatten().all(|value| value.is_finite()));
}

#[test]
fn no_wet_surface_throws_back_more_than_falls_on_it_whatever_its_pores() {
    // A white furnace: light 1 comes from everywhere, and a white surface sends 1.
    for porosity in [0.0f32, 0.3, 1.0] {
        for (share, film) in [(0.0, 0.0), (0.4, 0.3), (1.0, 0.85), (1.0, 1.0)] {
            for fresnel in [0.02f32, MEAN_REFLECTION, 0.4, 1.0] {
                let pixel = SurfacePixel {
                    colour: [1.0; 3],
                    emission: [0.0; 3],
                    material: Material { albedo: [1.0; 3], roughness: 0.5, porosity },
                    wetness: Wetness { share },
                    film,
                    cosine: 1.0,
                };
                let light = SurfaceLight { mirrored: [fresnel; 3], fresnel };
                let seen = wet_surface(&pixel, &light).light(&pixel)[1];
                // Outside of the film, wet pores keep what their own water has reflected.
                let lost = (1.0 - film) * porosity * share * MEAN_REFLECTION;
                assert!(
                    (seen - (1.0 - lost)).abs() < ROUND_OFF,
                    "{porosity} {share} {film} {fresnel}: {seen}"
                );
                let black =
                    SurfacePixel { material: Material { albedo: [0.0; 3], ..pixel.material }, ..pixel };
                assert!(wet_surface(&black, &light).light(&black)[1] < 1.0 + ROUND_OFF);
            }
        }
    }
}

/// A height map of cells of 1 m about the street: level ground, and the wall, 8 m high, from y = 20 on.
fn walled() -> crate::wet::maps::GroundMap {
    let mut map = crate::wet::maps::GroundMap {
        origin_m: glam::DVec2::new(-30.0, -9.6),
        cell_m: 1.0,
        size: [60, 40],
        values: vec![0.0; 2400],
    };
    // The wall's own cells begin before it: their highest point is its top.
    map.values.iter_mut().enumerate().filter(|(at, _)| at / 60 >= 29).for_each(|(_, height)| *height = 8.0);
    map
}

#[test]
fn a_wall_in_the_height_map_gets_wet_and_what_is_under_an_awning_does_not() {
    let mut street = street(1.0);
    street.maps.height_m = Some(walled());
    let wall: Vec<usize> = (0..SIZE[0] * SIZE[1])
        .filter(|&at| street.buffer.normal[at][1] < -0.5 && street.buffer.depth_m[at].is_finite())
        .collect();
    let wet = |street: &Street, wind: DVec3| {
        let frame = WetFrame { wind, ..street.frame(25.0) };
        let mut surface = Surface::new(5).unwrap();
        let controls = SurfaceControls { soaked: 20.0, ..SurfaceControls::default() };
        surface.draw(&frame, &controls, &mut Layer::default()).unwrap();
        wall.iter().map(|&at| surface.states[at].wetness).sum::<f32>() / wall.len() as f32
    };
    let (calm, blown) = (wet(&street, DVec3::ZERO), wet(&street, DVec3::new(0.0, 6.5, 0.0)));
    // Driven at 45° it gets as much as level ground, in calm air what runs down, and no less where the wind comes from behind.
    assert!(calm > 0.0 && blown > 2.0 * calm, "{calm} {blown}");
    assert_eq!(wet(&street, DVec3::new(0.0, -6.5, 0.0)), calm);
    // Without a map the same.
    let bare = Street { maps: WetMaps::default(), ..street };
    assert_eq!((wet(&bare, DVec3::ZERO), wet(&bare, DVec3::new(0.0, 6.5, 0.0))), (calm, blown));
    // An awning 9 m up and 6 m deep, over all of the wall.
    let mut map = walled();
    map.values.iter_mut().enumerate().filter(|(at, _)| at / 60 >= 23).for_each(|(_, height)| *height = 9.0);
    let roofed = Street { maps: WetMaps { height_m: Some(map), ..WetMaps::default() }, ..bare };
    assert_eq!(wet(&roofed, DVec3::ZERO), 0.0);
}
