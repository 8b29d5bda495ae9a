//! What light of lamps costs that rain scatters: `cargo bench -p squall-runtime --bench point_spread`.
//!
//! On one thread: the tables of a phase function, then one lamp on one ray, scattered once (airlight) and more often (point spread), cut by the
//! scene's depth. Nothing is asserted: machines differ, and tests judge errors.

use squall_runtime::airlight::{Airlight, PointBeside};
use squall_runtime::medium::{Phase, PhaseTable};
use squall_runtime::point_spread::PointSpread;
use squall_runtime::random::Random;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

const RAYS: usize = 200_000;

fn milliseconds(run: impl FnOnce()) -> f64 {
    let start = Instant::now();
    run();
    start.elapsed().as_secs_f64() * 1e3
}

fn main() {
    println!(
        "{:<8} {:>8} {:>12} {:>12} {:>10} {:>10}",
        "phase", "1/km", "airlight ms", "spread ms", "once ns", "more ns"
    );
    for (name, phase) in
        [("g .77", Phase::HenyeyGreenstein(0.77)), ("drops", Phase::Table(Arc::new(PhaseTable::drops())))]
    {
        let (mut airlight, mut spread) = (None, None);
        let once = milliseconds(|| airlight = Some(Airlight::new(&phase)));
        let more = milliseconds(|| spread = Some(PointSpread::new(&phase)));
        let (Some(airlight), Some(spread)) = (airlight, spread) else { return };
        for extinction in [1e-3, 1e-2] {
            let mut random = Random::new(3);
            let mut place = |low: f64, high: f64| random.range(low, high);
            let lamps: Vec<PointBeside> = (0..RAYS)
                .map(|_| PointBeside {
                    h: place(0.2, 60.0),
                    foot: place(-20.0, 150.0),
                    end: place(5.0, 400.0),
                })
                .collect();
            let each = |light: &dyn Fn(&PointBeside) -> [f64; 3]| {
                let whole = milliseconds(|| {
                    lamps.iter().for_each(|lamp| {
                        black_box(light(lamp));
                    });
                });
                whole * 1e6 / RAYS as f64
            };
            let [first, rest] = [
                each(&|lamp| airlight.of_point(extinction, lamp)),
                each(&|lamp| spread.of_point(extinction, lamp)),
            ];
            println!(
                "{name:<8} {:>8.1} {once:>12.1} {more:>12.1} {first:>10.0} {rest:>10.0}",
                extinction * 1e3
            );
        }
    }
}
