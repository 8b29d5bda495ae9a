use super::*;
use crate::random::Random;
use crate::shade::town::light::{SceneLight, irradiance};
use crate::shade::water::rippled_highlight;

/// Lamps in a square so wide, m.
fn lamps(random: &mut Random, count: usize, wide: f64) -> Vec<StreetLamp> {
    let mut place = |wide: f64| [0; 3].map(|_| random.range(-wide, wide) as f32);
    let mut lamp = || {
        let [x, y, _] = place(wide);
        let [_, _, z] = place(60.0);
        StreetLamp { position: [x, y, z], intensity: place(9.0).map(f32::abs) }
    };
    (0..count).map(|_| lamp()).collect()
}

#[test]
fn lamps_side_by_side_have_the_light_of_each_and_no_highlight_is_missed() {
    /// Sums of single precision in another order.
    const ROUND_OFF: f32 = 1e-5;
    let mut random = Random::new(6);
    for (count, wide) in [(21, 60.0), (150, 60.0), (150, 900.0)] {
        let lamps = lamps(&mut random, count, wide);
        let lanes = LampLanes::new(&lamps);
        let mut place = |wide: f64| Vec3::from_array([0; 3].map(|_| random.range(-wide, wide) as f32));
        let (mut shown, mut hidden) = (0, 0);
        for i in 0..400 {
            let (point, normal) = (place(40.0), place(1.0).normalize());
            let to_viewer = place(1.0).normalize();
            let slope = [0.0, 0.01, 0.1, 0.3][i % 4];
            let light_of = |lamp: &StreetLamp| {
                let position = Vec3::from_array(lamp.position);
                let light = SceneLight { position, intensity: lamp.intensity, visibility: 1.0 };
                irradiance(&light, point, normal).iter().sum::<f32>()
            };
            let all: Vec<f32> = lamps.iter().map(light_of).collect();
            let total: f32 = all.iter().sum();
            let mut found = vec![None; lamps.len()];
            lanes.each_above((point, normal), (1e-4, 0.0), |number, own| found[number] = Some(own));
            for (number, (found, wanted)) in found.iter().zip(&all).enumerate() {
                match found {
                    Some(own) => assert!((own - wanted).abs() <= ROUND_OFF * wanted, "{own} {wanted}"),
                    None => assert!(*wanted <= 1.001e-4 * total, "{i} {number}: {wanted} of {total}"),
                }
            }
            let mut may = vec![false; lamps.len()];
            lanes.each_in_water((point, normal), to_viewer, slope, |number| may[number] = true);
            for (number, lamp) in lamps.iter().enumerate() {
                let way = (Vec3::from_array(lamp.position) - point).normalize();
                let is_lit = rippled_highlight(normal, way, to_viewer, slope) > 0.0;
                assert!(may[number] || !is_lit, "{i} {number}");
                shown += usize::from(may[number]);
                hidden += usize::from(!may[number]);
            }
        }
        assert!(hidden > shown && shown > 100, "{hidden} {shown}");
    }
}

#[test]
fn a_town_five_times_as_large_asks_no_more_lamps_about_a_spot() {
    /// Of the lamps that a spot asks in the smaller town: groups are cut elsewhere.
    const MORE: f64 = 1.3;
    let mut random = Random::new(9);
    let asked = |random: &mut Random, count: usize| {
        // As many to a square kilometre in both.
        let lamps = lamps(random, count, 600.0 * (count as f64 / 200.0).sqrt());
        let lanes = LampLanes::new(&lamps);
        let spots = 200;
        let mut groups = 0;
        for _ in 0..spots {
            let point =
                Vec3::new(random.range(-300.0, 300.0) as f32, random.range(-300.0, 300.0) as f32, 0.0);
            // Dusk: lamps stand beside the light of a sky.
            let so_far = 0.3;
            let first = lanes.groups.iter().map(|group| group.most_at(point)).fold(0.0, f32::max);
            let faint = LEAST_OF_GROUPS * (so_far + first) / lanes.groups.len() as f32;
            groups += lanes.groups.iter().filter(|group| group.most_at(point) >= faint).count();
        }
        groups as f64 / f64::from(spots)
    };
    let [small, large] = [200, 1000].map(|count| asked(&mut random, count));
    println!("{small:.2} groups of 7, {large:.2} of 32");
    assert!(large < MORE * small, "{small} {large}");
}
