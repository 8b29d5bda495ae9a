//! Near drops at short exposures: what is drawn is the drop's own optics in the light that it is in, not a bar.

use squall_bake::streak::{FitSettings, Method, Source, fit};
use squall_bake::synth::streak::SynthStreak;
use squall_bake::synth::streak::scene::Scene;
use squall_bake::synth::streak::scene_streak;
use squall_formats::section::streak::{DropNotes, SceneNotes, StreakPattern, StreakSection};
use squall_runtime::rain::{Clip, Footprint, Kernel, SmoothWindow};
use squall_runtime::shade::streak::StreakSet;
use std::path::Path;

/// Seed of the sample's sets, and of each the picture of a drop that falls two diameters, in half a millisecond.
const SEED: u64 = 3;
const SHORT: usize = 1;
const LIGHTS: [Scene; 4] = [Scene::Overcast, Scene::Backlit, Scene::Lamp, Scene::Up];

fn pattern_of(streak: &SynthStreak) -> StreakPattern {
    let source = Source { file: Path::new("short.png"), picture: &streak.picture, notes: None };
    let mut pattern = fit(&source, FitSettings { method: Method::Edges, cosines: 6 }).unwrap();
    let exposure_ms = 1e3 * streak.drop.exposure();
    pattern.notes = Some(DropNotes { diameter_mm: streak.drop.diameter_mm(), exposure_ms });
    pattern.scene = streak.notes;
    pattern
}

/// Angle between the line of sight and the way to the light, degrees.
fn angle(scene: &SceneNotes) -> f64 {
    let [view, light] = [scene.view_elevation_deg, scene.light_elevation_deg]
        .map(|degrees| libm::sincos(degrees.to_radians()));
    let cosine = view.1 * light.1 * libm::cos(scene.light_azimuth_deg.to_radians()) + view.0 * light.0;
    libm::acos(cosine.clamp(-1.0, 1.0)).to_degrees()
}

/// The drop of a pattern's picture, seen as the picture shows it, pixel for pixel, in the light and on the line of sight of `scene`.
fn footprint(pattern: &StreakPattern, scene: &SceneNotes) -> Footprint {
    let [across, along] = pattern.size_px.map(f64::from);
    let (u, v) = (pattern.body.u, pattern.body.v);
    let width = across * pattern.body.width();
    Footprint {
        centre: [0.5 * (u[0] + u[1]) * across, 0.5 * (v[0] + v[1]) * along],
        axis: [0.0, 1.0],
        length: along * pattern.body.length() - width,
        width,
        diameter_mm: pattern.notes.map_or(0.0, |notes| notes.diameter_mm),
        elevation_deg: scene.view_elevation_deg,
        light: [scene.light_share, angle(scene)],
        ..Footprint::default()
    }
}

fn draw<K: Kernel>(kernel: &K, footprint: &Footprint, [width, height]: [usize; 2]) -> Vec<f64> {
    let mut picture = vec![0.0; width * height];
    let (_, placed) = kernel.place(footprint).unwrap();
    let clip = Clip { left: 0, top: 0, right: width as i32, bottom: height as i32 };
    kernel.draw(&placed, clip, &mut K::Scratch::default(), &mut |span| {
        for (x, share) in span.shares[..span.count].iter().enumerate() {
            picture[span.y as usize * width + span.x as usize + x] = f64::from(*share);
        }
    });
    picture
}

/// Correlation of two pictures.
fn alike(a: &[f64], b: &[f64]) -> f64 {
    let count = a.len() as f64;
    let means = [a, b].map(|values| values.iter().sum::<f64>() / count);
    let moment = |a: &[f64], b: &[f64], [ma, mb]: [f64; 2]| {
        a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>()
    };
    let both = moment(a, b, means);
    both / (moment(a, a, [means[0]; 2]) * moment(b, b, [means[1]; 2])).sqrt()
}

#[test]
fn a_near_drop_in_half_a_millisecond_shows_its_optics_in_its_own_light() {
    /// Six cosines under a window leave some of a caustic out.
    const ALIKE: f64 = 0.93;
    let streaks = LIGHTS.map(|scene| scene_streak(scene, SEED, SHORT));
    let patterns: Vec<StreakPattern> = streaks.iter().map(pattern_of).collect();
    let set = StreakSet::new(&StreakSection { patterns: patterns.clone() });
    for (i, (streak, pattern)) in streaks.iter().zip(&patterns).enumerate() {
        let drop = &streak.drop;
        assert!(drop.exposure() < 1e-3 && drop.diameter_mm() > 1.0);
        let seen = footprint(pattern, &streak.notes.unwrap());
        let size = [streak.picture.width, streak.picture.height];
        let picture =
            |streak: &SynthStreak| streak.picture.pixels.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
        let (shown, bar) = (draw(&set, &seen, size), draw(&SmoothWindow, &seen, size));
        // All four show the same drop on the same path, in one light each.
        let likeness: Vec<f64> = streaks.iter().map(|other| alike(&shown, &picture(other))).collect();
        let plain = alike(&bar, &picture(streak));
        println!("{}: like {likeness:.3?}, a bar {plain:.3}", LIGHTS[i].name());
        assert!(likeness[i] > ALIKE, "{}: {likeness:?}", LIGHTS[i].name());
        assert!(likeness[i] > plain + 0.02, "{}: a bar is as like as {plain}", LIGHTS[i].name());
        for (j, other) in likeness.iter().enumerate() {
            assert!(
                j == i || *other < likeness[i],
                "{} shows {}: {likeness:?}",
                LIGHTS[i].name(),
                LIGHTS[j].name()
            );
        }
    }
}
