use super::*;
use crate::assert_layout;
use crate::gpu::{square, test_gpu};

/// Speed and way of drops after one step in single precision, relative to the root mean square.
const STEP: f64 = 1e-5;
/// Of all wet cells, those whose drop was at a threshold: of running, or of the roulette.
const AT_A_THRESHOLD: f64 = 2e-3;
/// A film's last nanograms, of a mass that single precision has 24 bits of.
const FILM: f64 = 1e-5;

#[test]
fn structs_lie_as_the_shader_has_them() {
    assert_layout!(
        GLASS,
        Pane {
            cells,
            spacing,
            hold,
            pull,
            drag,
            edge_friction,
            wetting,
            wet_preference,
            speed_most,
            lightest,
            seed
        }
    );
    assert_layout!(
        GLASS,
        State { left, step, steps, salt, fastest, drained_low, drained_high, flows_low, flows_high }
    );
}

#[test]
fn the_shaders_water_is_the_processors() {
    assert!(GLASS.says(&format!("FLOW_MOST: u32 = {FLOW_MOST}u")));
    for (name, value) in flow::water() {
        assert!(GLASS.says(&format!("const {name}: f32 = {value};")), "{name} {value}");
    }
}

/// A pane in rain, wet and running.
fn wet(cells: [usize; 2], seconds: u32) -> Glass {
    let pull_m_per_s2 = [1.5, 9.0];
    let mut pane =
        Glass::new(GlassSettings { cells, pull_m_per_s2, seed: 3, ..GlassSettings::default() }).unwrap();
    let blocked: Vec<bool> = (0..cells[0] * cells[1]).map(|at| at % 97 == 0).collect();
    pane.set_obstacles(&blocked).unwrap();
    for _ in 0..20 * seconds {
        pane.rain(2.5e-3, 4000.0, 0.05).unwrap();
        pane.advance(0.05).unwrap();
    }
    pane
}

#[test]
fn each_step_on_the_card_is_the_processors() {
    let Some(gpu) = test_gpu() else { return };
    let mut pane = wet([96, 64], 2);
    for turn in 0..6 {
        let mut card = CardGlass::new(&gpu, pane.clone()).unwrap();
        let seconds = 0.999 * pane.step_beside(f64::from(pane.fastest));
        let report = pane.advance(seconds).unwrap();
        card.advance(seconds).unwrap();
        let on_card = card.read_report().unwrap();
        assert_eq!((report.steps, on_card.steps), (1, pane.steps));
        let (water, motion) = (card.read_water().unwrap(), card.read_motion().unwrap());
        let (mut off, mut all, mut others, mut wet) = (0.0, 0.0, 0, 0);
        for (at, (&found, [speed, crossed])) in water.iter().zip(motion).enumerate() {
            let wanted = pane.cells.mass[at];
            wet += u32::from(wanted > 0);
            if f64::from(found.abs_diff(wanted)) > 1.0 + FILM * f64::from(wanted) {
                others += 1;
                continue;
            }
            off += square(speed - pane.cells.speed[at]) + square(0.1 * (crossed - pane.cells.crossed[at]));
            all += square(pane.cells.speed[at]) + square(0.1 * pane.cells.crossed[at]);
        }
        let motion = (off / all).sqrt();
        println!(
            "step {turn}: motion {motion:.1e} relative L2, {others} of {wet} cells otherwise, {} flows",
            report.flows
        );
        assert!(wet > 1000 && report.flows > 0 && all > 0.0, "{wet} {report:?}");
        assert!(motion < STEP && f64::from(others) <= AT_A_THRESHOLD * f64::from(wet), "{motion} {others}");
        assert!(on_card.flows.abs_diff(report.flows) <= 1);
    }
}

#[test]
fn no_nanogram_is_lost_on_the_card_and_long_rain_runs_off_as_on_the_processor() {
    /// Some hundred runs to the lower edge, each of its own way.
    const RUNS: f64 = 0.02;
    let Some(gpu) = test_gpu() else { return };
    let mut pane = wet([96, 64], 0);
    let mut card = CardGlass::new(&gpu, pane.clone()).unwrap();
    for frame in 0..60 {
        assert_eq!(card.rain(2.5e-3, 4000.0, 0.05).unwrap(), pane.rain(2.5e-3, 4000.0, 0.05).unwrap());
        card.wet([frame, 0], 5e-3).unwrap();
        pane.wet([frame, 0], 5e-3).unwrap();
        card.advance(0.05).unwrap();
        pane.advance(0.05).unwrap();
        if frame % 20 == 19 {
            let water: u64 = card.read_water().unwrap().iter().map(|&mass| u64::from(mass)).sum();
            let report = card.read_report().unwrap();
            assert_eq!(water + report.drained_ng, card.received_ng());
            assert_eq!(card.received_ng(), pane.received_ng());
        }
    }
    let report = card.read_report().unwrap();
    let (found, wanted) = (report.drained_ng as f64, pane.drained_ng() as f64);
    let wet = card.read_water().unwrap().iter().filter(|&&mass| mass > 0).count() as f64;
    println!("{report:?}, processor {} steps, drained {wanted}, wet {wet} {}", pane.steps, pane.wet_cells());
    assert!(wanted > 0.0 && (found / wanted - 1.0).abs() < RUNS, "{found} {wanted}");
    assert!((wet / pane.wet_cells() as f64 - 1.0).abs() < RUNS);
    assert!((report.steps as f64 / pane.steps as f64 - 1.0).abs() < RUNS);
}

#[test]
fn what_the_processor_refuses_the_card_refuses_in_the_same_words_and_steps_hold_no_more() {
    let Some(gpu) = test_gpu() else { return };
    let mut pane = wet([32, 24], 1);
    let before = gpu.bytes_held();
    let mut card = CardGlass::new(&gpu, pane.clone()).unwrap();
    let held = gpu.bytes_held();
    let beyond = 1.001 * pane.longest_call_s();
    for seconds in [beyond, -1.0, f64::NAN] {
        let wanted = pane.advance(seconds).unwrap_err().to_string();
        assert_eq!(card.advance(seconds).unwrap_err().to_string(), wanted);
    }
    assert_eq!(
        card.wet([32, 0], 1e-3).unwrap_err().to_string(),
        pane.wet([32, 0], 1e-3).unwrap_err().to_string()
    );
    assert_eq!(
        card.wet([0, 0], 0.1).unwrap_err().to_string(),
        pane.wet([0, 0], 0.1).unwrap_err().to_string()
    );
    let heavy = |found: Result<u32, RuntimeError>| found.unwrap_err().to_string();
    assert_eq!(heavy(card.rain(1e-3, 1e12, 1.0)), heavy(pane.rain(1e-3, 1e12, 1.0)));
    card.set_measured(true);
    card.advance(0.02).unwrap();
    card.advance(0.0).unwrap();
    assert_eq!(gpu.bytes_held(), held);
    assert!(card.report().unwrap().passes.iter().all(|pass| pass.name == "pane"));
    drop(card);
    assert_eq!(gpu.bytes_held(), before);
}

#[test]
fn drops_by_the_ten_thousand_land_where_they_do_on_the_processor() {
    let Some(gpu) = test_gpu() else { return };
    let mut pane = wet([48, 40], 0);
    let mut card = CardGlass::new(&gpu, pane.clone()).unwrap();
    let count = pane.rain(1e-3, 2e7, 1.0).unwrap();
    assert!(count as usize > 2 * LANDINGS);
    assert_eq!(card.rain(1e-3, 2e7, 1.0).unwrap(), count);
    assert_eq!(card.read_water().unwrap(), pane.cells.mass);
    assert_eq!(card.read_report().unwrap().drained_ng, pane.drained_ng());
}
