use super::*;
use crate::progress::Quiet;
use squall_runtime::airlight::{Airlight, PointBeside};
use squall_runtime::medium::{Phase, PhaseTable};
use squall_runtime::point_spread::{PointSpread, axes};
use std::sync::Arc;

const FEW: SpreadSettings = SpreadSettings { photons: 100_000, seed: 5 };
/// Bins that are compared together.
const GROUP: usize = 12;

fn drops() -> Phase {
    Phase::Table(Arc::new(PhaseTable::drops()))
}

fn light_of(phase: &Phase, settings: &SpreadSettings) -> Light {
    solve_light(&SpreadPhase::new(phase, 1).unwrap(), settings, 0, &Quiet).unwrap()
}

/// Compares groups of bins of scattered light with what `wanted` says at an optical depth and a sine of half the angle, in standard
/// errors and `share` of it: mean square and worst.
fn off(light: &Light, more: bool, share: f64, wanted: &dyn Fn(f64, f64) -> f64) -> (f64, f64) {
    let (mut squares, mut worst, mut count) = (0.0, 0.0f64, 0);
    for shell in 0..axes::RADII {
        let depth = axes::radius(shell);
        for group in 0..BINS / GROUP {
            let (mut found, mut error, mut expected) = (0.0, 0.0, 0.0);
            for bin in group * GROUP..(group + 1) * GROUP {
                let (own, half) = (light.radiance(more, shell, bin), Light::half_sine(bin));
                // Solid angle of a bin, but for a factor: bins are even in ln(1 + 100 q).
                let solid_angle = half * (half + 0.01);
                found += own.mean * solid_angle;
                error += (own.standard_error * solid_angle) * (own.standard_error * solid_angle);
                expected += wanted(depth, half) * solid_angle;
            }
            if depth < 8.0 && error.sqrt() < 0.1 * found {
                let off = (found - expected) / libm::hypot(error.sqrt(), share * expected);
                squares += off * off;
                worst = worst.max(off.abs());
                count += 1;
            }
        }
    }
    assert!(count > 100, "{count} groups are known well enough");
    (squares / f64::from(count), worst)
}

#[test]
fn light_scattered_once_is_the_airlights_table() {
    /// The table's own error.
    const TABLE: f64 = 0.01;
    for phase in [Phase::HenyeyGreenstein(0.3), Phase::HenyeyGreenstein(0.77), drops()] {
        let airlight = Airlight::new(&phase);
        let (mean, worst) = off(&light_of(&phase, &FEW), false, TABLE, &|depth, half| {
            let cos = 1.0 - 2.0 * half * half;
            let h = depth * 2.0 * half * (1.0 - half * half).sqrt();
            airlight.of_point(1.0, &PointBeside { h, foot: depth * cos, end: f64::INFINITY })[1]
        });
        println!("mean square {mean:.2}, worst {worst:.1} standard errors");
        assert!(mean < 1.5 && worst < 5.0, "{mean} {worst}");
    }
}

#[test]
fn light_scattered_more_than_once_is_what_the_shipped_table_shows_along_rays() {
    /// Of the shipped table: its own photons, nodes and interpolation.
    const TABLE: f64 = 0.03;
    // The last asymmetry stands between nodes.
    for phase in [Phase::HenyeyGreenstein(0.77), drops(), Phase::HenyeyGreenstein(0.7)] {
        let spread = PointSpread::new(&phase);
        let seen = |depth: f64, half: f64| spread.lookup_seen(depth, half)[1];
        let (mean, worst) = off(&light_of(&phase, &FEW), true, TABLE, &seen);
        println!("mean square {mean:.2}, worst {worst:.1} standard errors");
        assert!(mean < 1.5 && worst < 5.0, "{mean} {worst}");
    }
}

#[test]
fn threads_change_no_byte_and_the_code_is_that_which_made_the_shipped_table() {
    let made = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let settings = SpreadSettings { photons: 3_200, seed: 2 };
        pool.install(|| bake_point_spread(&settings, &Quiet).unwrap())
    };
    let one = made(1);
    assert_eq!(one.len(), 4 * axes::VALUES);
    assert!(one == made(3));
    assert_eq!(blake3::hash(&one).to_hex().as_str(), OF_FEW, "the code makes other photons: see OF_FEW");
    assert_eq!(blake3::hash(&std::fs::read(SHIPPED).unwrap()).to_hex().as_str(), OF_SHIPPED);
}

/// The shipped table.
const SHIPPED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../runtime/src/point_spread/scattered.f32");
/// Hashes of a table of a few photons and of the shipped one, when both were made by the same code: whoever changes the photons makes
/// the table again (docs/point-spread.md), runs the ignored test below and writes both anew.
const OF_FEW: &str = "a279181a1fdee52958b5ab856a196cf0bf0602d50a5f9707fc77c49e133da133";
const OF_SHIPPED: &str = "031e92f94eca316faba5e3caa6fcd55431fa01a695074f6c890ab706f068df49";

#[test]
fn what_cannot_be_followed_is_refused() {
    let refused = |photons: u64| {
        let phase = SpreadPhase::new(&Phase::HenyeyGreenstein(0.5), 0).unwrap();
        solve_light(&phase, &SpreadSettings { photons, seed: 1 }, 0, &Quiet).unwrap_err().to_string()
    };
    assert!(refused(0).contains("photons") && refused(u64::MAX).contains("photons"));
    assert!(SpreadPhase::new(&Phase::Paper(0.9), 0).is_err());
}

#[test]
#[ignore = "two minutes of processor time; hashes of a few photons stand in for it"]
fn the_shipped_table_is_what_its_command_makes() {
    let made = bake_point_spread(&SpreadSettings::default(), &Quiet).unwrap();
    assert!(std::fs::read(SHIPPED).unwrap() == made);
}
