use super::*;
use crate::camera::Camera;
use crate::wet::frame::GBuffer;
use crate::wet::maps::WetMaps;
use crate::wet::surface::lightning::LightningControls;
use crate::world::WorldLight;
use squall_formats::units::Degrees;

const SIZE: [usize; 2] = [48, 32];

struct Scene {
    buffer: GBuffer,
    camera: Camera,
    flux: Vec<DropFlux>,
    light: WorldLight,
    maps: WetMaps,
}

/// Level ground and a bright lamp in the sky above it.
fn scene(rate: f64) -> Scene {
    let camera =
        Camera::look_at(DVec3::Z * 1.6, DVec3::new(0.0, 10.0, 1.0), Degrees(50.0), [48, 32]).unwrap();
    let mut buffer = GBuffer { size: SIZE, ..GBuffer::default() };
    for i in 0..SIZE[0] * SIZE[1] {
        let ray = camera.ray((i % SIZE[0]) as f64 + 0.5, (i / SIZE[0]) as f64 + 0.5);
        let far = -1.6 / ray.direction.z;
        let on_ground = far > 0.0 && far < 200.0;
        let depth = if on_ground { (far * ray.direction.dot(camera.forward)) as f32 } else { f32::INFINITY };
        buffer.depth_m.push(depth);
        buffer.normal.push(if on_ground { [0.0, 0.0, 1.0] } else { [0.0; 3] });
        buffer.colour.push(if on_ground { [0.2; 3] } else { [0.1, 0.1, 0.15] });
    }
    buffer.colour[4 * SIZE[0] + 24] = [50.0, 40.0, 20.0];
    let light = WorldLight::uniform([0.1; 3]);
    Scene { buffer, camera, flux: flux_of(MillimetresPerHour(rate)), light, maps: WetMaps::default() }
}

impl Scene {
    fn frame(&self, rate: f64) -> WetFrame<'_> {
        WetFrame {
            buffer: &self.buffer,
            colour: &self.buffer.colour,
            camera: &self.camera,
            maps: &self.maps,
            light: &self.light,
            rate_mm_per_h: rate,
            flux: &self.flux,
            wind: DVec3::ZERO,
            time_s: 2.0,
            seed: 3,
            lightning: [0.5, 0.0],
        }
    }
}

#[test]
fn the_drops_flux_carries_what_the_pages_say() {
    for (rate, wanted) in [(2.0, 2.37), (25.0, 28.2), (75.0, 80.2)] {
        let volume = |flux: &DropFlux| {
            let d = flux.diameter_m;
            std::f64::consts::PI / 6.0 * d * d * d * flux.impacts_per_m2_s
        };
        let carried = flux_of(MillimetresPerHour(rate)).iter().map(volume).sum::<f64>() * 3600.0 * 1e3;
        // Ten sizes for all, those below .4 mm left out.
        assert!((carried / wanted - 1.0).abs() < 0.06, "{rate}: {carried}");
    }
    assert!(flux_of(MillimetresPerHour(0.0)).is_empty());
}

#[test]
fn layers_over_the_frame_are_the_picture_and_effects_go_alone() {
    let scene = scene(25.0);
    let mut renderer = WetRenderer::built_in().unwrap();
    let all = WetSettings::default();
    let report = renderer.draw(&scene.frame(25.0), &all).unwrap();
    let on: Vec<Effect> = Effect::ALL.into_iter().filter(|effect| all.is_on(*effect)).collect();
    assert_eq!(report.effects.iter().map(|effect| effect.effect).collect::<Vec<_>>(), on);
    let whole = renderer.picture().to_vec();
    let mut stacked = scene.buffer.colour.clone();
    for (_, layer) in renderer.layers() {
        layer.onto(&mut stacked).unwrap();
    }
    assert_eq!(stacked, whole);
    assert!(whole.iter().flatten().all(|value| value.is_finite() && *value >= 0.0));
    for effect in Effect::ALL {
        let mut one = all.clone();
        one.only(&[effect]);
        let report = renderer.draw(&scene.frame(25.0), &one).unwrap();
        assert_eq!(report.effects.len(), 1, "{report:?}");
        // Nothing drips where no edge was baked, nothing flickers without neon, and a small frame may have no drop before it.
        let may_be_none = matches!(
            effect,
            Effect::Drips | Effect::Drops | Effect::Flicker | Effect::Halos | Effect::Splatters
        );
        assert!(report.effects[0].pixels > 0 || may_be_none, "{report:?}");
    }
    renderer.draw(&scene.frame(25.0), &all).unwrap();
    assert_eq!(renderer.picture(), whole);
}

#[test]
fn no_rain_and_no_flash_leave_every_bit() {
    let scene = scene(0.0);
    let mut renderer = WetRenderer::built_in().unwrap();
    let dry = WetFrame { lightning: [0.0; 2], ..scene.frame(0.0) };
    let report = renderer.draw(&dry, &WetSettings::default()).unwrap();
    assert!(report.effects.iter().all(|effect| effect.pixels == 0));
    assert_eq!(renderer.picture(), scene.buffer.colour);
}

#[test]
fn the_papers_fog_stands_in_the_mediums_place_and_streaks_stay() {
    let scene = scene(75.0);
    let mut renderer = WetRenderer::built_in().unwrap();
    let mut settings = WetSettings::default();
    settings.only(&[Effect::Rain]);
    renderer.draw(&scene.frame(75.0), &settings).unwrap();
    let ours = renderer.layers()[0].1.clone();
    settings.rain.paper_fog = 1.0;
    (settings.rain.paper_start, settings.rain.paper_end) = (1.0, 20.0);
    renderer.draw(&scene.frame(75.0), &settings).unwrap();
    let theirs = &renderer.layers()[0].1;
    // Ground behind the fog's end is gone; ours never is.
    let far =
        (0..ours.alpha.len()).find(|&at| scene.buffer.depth_m[at] > 20.0 && scene.buffer.depth_m[at] < 100.0);
    let far = far.unwrap();
    assert!(theirs.alpha[far] > 0.999 && ours.alpha[far] < 0.9, "{} {}", theirs.alpha[far], ours.alpha[far]);
}

#[test]
fn settings_are_found_by_name_and_held_to_their_ranges() {
    let mut settings = WetSettings::default();
    settings.set(Effect::Surface, "puddles", 0.5).unwrap();
    assert_eq!(settings.get(Effect::Surface, "puddles"), Some(0.5));
    assert!(settings.set(Effect::Surface, "puddles", 1.5).is_err());
    // What is said is said, though it is the usual value.
    settings.set(Effect::Lightning, "flash", LightningControls::default().flash).unwrap();
    assert!(settings.is_said(Effect::Lightning, "flash") && settings.is_said(Effect::Surface, "puddles"));
    assert!(
        !settings.is_said(Effect::Splashes, "flash")
            && !WetSettings::default().is_said(Effect::Surface, "puddles")
    );
    assert!(settings.set(Effect::Glow, "puddles", 0.5).is_err());
    settings.glow.mist = f32::NAN;
    assert!(settings.check().is_err());
    for effect in Effect::ALL {
        assert_eq!(Effect::from_name(effect.name()), Some(effect));
        for parameter in effect.parameters() {
            assert!(!parameter.says.is_empty() && parameter.says.ends_with(['.', ')']), "{parameter:?}");
            assert!((parameter.range[0]..=parameter.range[1]).contains(&parameter.usual), "{parameter:?}");
        }
    }
}

#[test]
fn a_views_effects_are_the_settings_and_unknown_names_are_refused() {
    use squall_formats::section::view::ViewEffect;
    let said = |effect: &str, name: &str, value: f64| {
        let controls = vec![(name.to_owned(), value)];
        WetSettings::of_view(&[ViewEffect { effect: effect.into(), on: false, controls }])
    };
    let settings = said("glow", "mist", 3.0).unwrap();
    assert!(!settings.is_on(Effect::Glow) && settings.is_on(Effect::Surface));
    assert_eq!(settings.glow.mist, 3.0);
    assert_eq!(WetSettings::of_view(&[]).unwrap(), WetSettings::default());
    for (effect, name, value) in [("snow", "mist", 1.0), ("glow", "snow", 1.0), ("glow", "mist", -1.0)] {
        assert!(said(effect, name, value).is_err());
    }
}

#[test]
fn lightnings_brightness_has_one_name_and_one_usual_value_in_every_effect() {
    let mut found = 0;
    for effect in Effect::ALL {
        for parameter in effect.parameters().iter().filter(|parameter| parameter.name == "flash") {
            let lightning = LightningControls::default().flash;
            assert_eq!((parameter.usual, parameter.unit), (lightning, "W/m2"), "{}", effect.name());
            assert_eq!(parameter.range, [0.0, 1e6]);
            found += 1;
        }
        let named = effect.parameters().iter().any(|parameter| parameter.name == "strength");
        assert!(!named || effect == Effect::Glow, "{}", effect.name());
    }
    assert!(found >= 6, "{found}");
}

#[test]
fn a_frames_light_stands_for_the_buffers_own_and_must_have_its_size() {
    let scene = scene(25.0);
    let mut renderer = WetRenderer::built_in().unwrap();
    let bright: Vec<[f32; 3]> =
        scene.buffer.colour.iter().map(|light| light.map(|band| 2.0 * band)).collect();
    let settings = WetSettings::default();
    renderer.draw(&WetFrame { colour: &bright, ..scene.frame(25.0) }, &settings).unwrap();
    let seen = renderer.picture().to_vec();
    let buffer = GBuffer { colour: bright.clone(), ..scene.buffer.clone() };
    renderer.draw(&WetFrame { buffer: &buffer, colour: &bright, ..scene.frame(25.0) }, &settings).unwrap();
    assert_eq!(renderer.picture(), seen);
    assert!(renderer.draw(&WetFrame { colour: &bright[1..], ..scene.frame(25.0) }, &settings).is_err());
}
