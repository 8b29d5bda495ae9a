use super::*;
use crate::assert_layout;
use crate::gpu::{square, test_gpu};
use crate::wet::ripples::{Edges, STEPS_MAX};

/// The same sums in single precision, which a card may contract and order otherwise: of the root mean square, over a few hundred steps.
const ROUND_OFF: f64 = 5e-6;

#[test]
fn structs_lie_as_the_shader_has_them() {
    assert_layout!(RIPPLES, RippleStep { cells, edges, scheme, keep, square, ratio, per_spacing, first });
    assert_layout!(RIPPLES, Mark { middle, radius, height, rim, mend, both });
}

fn relative(found: &[f32], wanted: &[f32]) -> f64 {
    assert_eq!(found.len(), wanted.len());
    let off: f64 = found.iter().zip(wanted).map(|(found, wanted)| square(found - wanted)).sum();
    let all: f64 = wanted.iter().map(|wanted| square(*wanted)).sum();
    assert!(all > 0.0, "water that moves");
    (off / all).sqrt()
}

/// Heights and slopes against the processor's, relative.
fn differences(card: &mut CardRipples, water: &mut Ripples) -> [f64; 2] {
    let [width, height] = water.settings.cells;
    let heights: Vec<f32> = (0..width * height).map(|k| water.height(k % width, k / width)).collect();
    let mut slopes = vec![[0.0; 2]; width * height];
    water.slopes(&mut slopes);
    let found = card.read_slopes().unwrap();
    let heights = relative(&card.read_heights().unwrap(), &heights);
    [heights, relative(found.as_flattened(), slopes.as_flattened())]
}

fn assert_alike(what: &str, card: &mut CardRipples, water: &mut Ripples) {
    let [heights, slopes] = differences(card, water);
    println!("{what}: heights {heights:.1e}, slopes {slopes:.1e} relative L2");
    assert!(heights < ROUND_OFF && slopes < ROUND_OFF, "{what}: {heights} {slopes}");
}

fn settings(cells: [usize; 2], scheme: Scheme, edges: Edges) -> RippleSettings {
    RippleSettings { cells, scheme, edges, ..RippleSettings::default() }
}

const RAIN: [DropFlux; 2] = [
    DropFlux { diameter_m: 1e-3, speed_m_per_s: 4.0, impacts_per_m2_s: 3000.0 },
    DropFlux { diameter_m: 4e-3, speed_m_per_s: 8.8, impacts_per_m2_s: 300.0 },
];

#[test]
fn rain_on_the_card_is_rain_on_the_processor_at_any_size_with_any_edges() {
    let Some(gpu) = test_gpu() else { return };
    for (cells, scheme, edges) in [
        ([256, 256], Scheme::Nine, Edges::Repeat),
        ([67, 45], Scheme::Nine, Edges::Reflect),
        ([45, 131], Scheme::Five, Edges::Repeat),
        ([64, 8], Scheme::Five, Edges::Reflect),
    ] {
        let mut water = Ripples::new(settings(cells, scheme, edges)).unwrap();
        let mut card = CardRipples::new(&gpu, &water).unwrap();
        // Frames of several lengths: the surface of a step ago is told anew.
        for seconds in [0.1, 0.033, 0.05, 1e-5, 0.2] {
            let wanted = water.advance(seconds, &RAIN, 9).unwrap();
            assert_eq!(card.advance(seconds, &RAIN, 9).unwrap(), wanted);
        }
        assert_eq!(card.time_s().to_bits(), water.time_s().to_bits());
        assert_alike(&format!("{cells:?} {scheme:?} {edges:?}"), &mut card, &mut water);
    }
}

#[test]
fn more_steps_and_drops_than_a_submission_holds_are_as_many_submissions() {
    let Some(gpu) = test_gpu() else { return };
    let mut water = Ripples::new(settings([96, 64], Scheme::Nine, Edges::Repeat)).unwrap();
    let mut card = CardRipples::new(&gpu, &water).unwrap();
    let rain = RAIN.map(|drop| DropFlux { impacts_per_m2_s: 40.0 * drop.impacts_per_m2_s, ..drop });
    let report = water.advance(4.0, &rain, 1).unwrap();
    assert!(report.steps > 2 * STEPS as u32 && report.impacts > 10 * MARKS as u32, "{report:?}");
    assert_eq!(card.advance(4.0, &rain, 1).unwrap(), report);
    assert_alike("storm", &mut card, &mut water);
}

#[test]
fn marks_wider_than_the_lattice_and_bodies_at_walls_are_the_processors() {
    let Some(gpu) = test_gpu() else { return };
    for (cells, edges) in [
        ([3, 3], Edges::Repeat),
        ([9, 20], Edges::Repeat),
        ([300, 200], Edges::Repeat),
        ([64, 40], Edges::Reflect),
    ] {
        let mut water = Ripples::new(settings(cells, Scheme::Nine, edges)).unwrap();
        let mut card = CardRipples::new(&gpu, &water).unwrap();
        let wide = Impact { at_m: [-0.31, 7.03], radius_m: 3.0, depth_m: 1e-3 };
        let narrow = Impact { at_m: [0.012, 0.02], radius_m: 1e-3, depth_m: 1e-3 };
        let nowhere = Impact { at_m: [f32::NAN, 0.0], radius_m: 0.01, depth_m: 1e-3 };
        for impact in [wide, narrow, nowhere, Impact { at_m: [1e30, 0.0], ..narrow }] {
            water.strike(&impact);
            card.strike(&impact);
        }
        let (from, to) = ([-0.049, 0.2], [0.1, 0.21]);
        water.push(from, to, 0.05, 0.01);
        card.push(from, to, 0.05, 0.01);
        assert_alike(&format!("marks on {cells:?} {edges:?}"), &mut card, &mut water);
        water.advance(0.2, &[], 0).unwrap();
        card.advance(0.2, &[], 0).unwrap();
        assert_alike(&format!("{cells:?} {edges:?} later"), &mut card, &mut water);
    }
}

#[test]
fn water_in_motion_comes_to_the_card_as_it_is_and_moves_on() {
    let Some(gpu) = test_gpu() else { return };
    let mut water = Ripples::new(settings([40, 50], Scheme::Nine, Edges::Repeat)).unwrap().starting_at(5.0);
    water.advance(0.3, &RAIN, 2).unwrap();
    let mut card = CardRipples::new(&gpu, &water).unwrap();
    let heights = card.read_heights().unwrap();
    assert!((0..2000).all(|k| heights[k].to_bits() == water.height(k % 40, k / 40).to_bits()));
    assert_eq!(card.advance(0.3, &RAIN, 2).unwrap(), water.advance(0.3, &RAIN, 2).unwrap());
    assert_alike("from motion", &mut card, &mut water);
}

#[test]
fn what_the_processor_refuses_the_card_refuses_in_the_same_words_and_nothing_has_moved() {
    let Some(gpu) = test_gpu() else { return };
    let mut water = Ripples::new(settings([16, 16], Scheme::Nine, Edges::Repeat)).unwrap();
    water.strike(&Impact { at_m: [0.05, 0.05], radius_m: 0.02, depth_m: 1e-3 });
    let mut card = CardRipples::new(&gpu, &water).unwrap();
    assert_eq!(card.longest_step_s(), water.longest_step_s());
    let before = card.read_heights().unwrap();
    let beyond = 1.001 * water.longest_step_s() * f64::from(STEPS_MAX);
    let heavy = [DropFlux { impacts_per_m2_s: 1e12, ..RAIN[0] }];
    let calls: [(f64, &[DropFlux]); 5] =
        [(beyond, &[]), (-1.0, &[]), (f64::NAN, &[]), (f64::INFINITY, &[]), (0.1, &heavy)];
    for (seconds, rain) in calls {
        let wanted = water.advance(seconds, rain, 0).unwrap_err().to_string();
        assert_eq!(card.advance(seconds, rain, 0).unwrap_err().to_string(), wanted);
    }
    assert_eq!(card.read_heights().unwrap(), before);
    let paper = Ripples::new(settings([16, 16], Scheme::Paper, Edges::Repeat)).unwrap();
    let refusal = CardRipples::new(&gpu, &paper).err().unwrap().to_string();
    assert!(refusal.starts_with("scheme: wanted Nine or Five"), "{refusal}");
    let vast = Ripples::new(settings([8192, 4097], Scheme::Nine, Edges::Repeat)).unwrap();
    assert!(CardRipples::new(&gpu, &vast).err().unwrap().to_string().starts_with("cells: wanted 33554432"));
}

#[test]
fn steps_hold_no_more_of_the_card_and_a_lattice_takes_as_much_as_is_written() {
    /// Two fields and slopes of 4 + 4 + 8 bytes a cell, lists of .47 MB.
    const BYTES: u64 = 16 * 256 * 256 + 16_384 + 65_536 + 262_144 + 131_072;
    let Some(gpu) = test_gpu() else { return };
    let water = Ripples::new(RippleSettings::default()).unwrap();
    let before = gpu.bytes_held();
    let mut card = CardRipples::new(&gpu, &water).unwrap();
    let clock = if gpu.has_clock() { 2048 } else { 0 };
    assert_eq!(gpu.bytes_held() - before, BYTES + clock);
    card.set_measured(true);
    for _ in 0..3 {
        card.advance(0.1, &RAIN, 3).unwrap();
        let report = card.report().unwrap();
        let names: Vec<_> = report.passes.iter().map(|pass| pass.name).collect();
        assert!(names == ["ripples", "slopes of ripples"] || !gpu.has_clock(), "{names:?}");
    }
    assert_eq!(gpu.bytes_held() - before, BYTES + clock);
    drop(card);
    assert_eq!(gpu.bytes_held(), before);
}
