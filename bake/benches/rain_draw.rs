//! `cargo bench -p squall-bake --bench rain_draw [-- PICTURE… --each --baselines]`: what drawing a frame's streaks costs, beside how far the
//! frame is off; with `--each` how far each picture's own pattern is off it, with `--baselines` what \[weber\]'s Algorithm 1 as printed and a particle system take for one such frame.
//!
//! Milliseconds are one thread's own, at 1920 × 1080, T 20 ms, streaks of 30 to 200 px; the error is that of a smaller frame of the
//! same streaks against the pictures themselves with 256 samples a pixel. Nothing is asserted: machines differ, and tests judge errors.

use squall_bake::chart::picture_kernel::PictureSet;
use squall_bake::chart::rain_frame::{PER_SAMPLE, View};
use squall_bake::density::DensitySpec;
use squall_bake::input::picture::{Grey, read_grey};
use squall_bake::plan::density::bake_density;
use squall_bake::streak::{FitSettings, Method, Source, fit_all};
use squall_formats::section::streak::StreakSection;
use squall_runtime::rain::{Kernel, SmoothWindow};
use squall_runtime::shade::streak::StreakSet;
use std::path::PathBuf;

fn main() {
    let mut files: Vec<PathBuf> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).map(PathBuf::from).collect();
    if files.is_empty() {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../data/storm/streaks");
        files = (0..12).map(|i| folder.join(format!("drop{i:02}.png"))).collect();
    }
    let pictures: Vec<Grey> = files.iter().map(|file| read_grey(file).unwrap()).collect();
    let sources: Vec<Source> =
        files.iter().zip(&pictures).map(|(file, picture)| Source { file, picture, notes: None }).collect();
    let set = |method: Method| {
        let patterns = fit_all(&sources, FitSettings { method, cosines: 6 }).unwrap();
        StreakSet::new(&StreakSection { patterns })
    };
    let section = bake_density(&DensitySpec::default()).unwrap();
    if std::env::args().any(|argument| argument == "--baselines") {
        let patterns = fit_all(&sources, FitSettings { method: Method::Paper, cosines: 6 }).unwrap();
        let view =
            View { section: &section, rate: 75.0, fov: 120.0, size: [1920, 1080], lengths_px: [30.0, 200.0] };
        let own = view.time(&set(Method::Edges), 9).unwrap();
        let [grid, system] = view.baselines(&patterns, &pictures).unwrap();
        let ours = own.find_ms + own.draw_ms;
        println!("R 75, fov 120: found and drawn {ours:.1} ms");
        println!("Algorithm 1 as printed, one frame: {:.0} ms, {:.0} ×", grid.median, grid.median / ours);
        println!("particle system: {:.1} ms, {:.1} ×", system.median, system.median / ours);
        return;
    }
    if std::env::args().any(|argument| argument == "--each") {
        // How far each picture's own pattern is off it, on a frame of R 75, fov 120.
        let view =
            View { section: &section, rate: 75.0, fov: 120.0, size: [480, 270], lengths_px: [30.0, 200.0] };
        for (source, picture) in sources.iter().zip(&pictures) {
            let truth =
                view.supersampled(&PictureSet::new(std::slice::from_ref(picture), PER_SAMPLE)).unwrap();
            let error = |method: Method| {
                let fitted =
                    fit_all(std::slice::from_ref(source), FitSettings { method, cosines: 6 }).unwrap();
                100.0 * view.measure(&StreakSet::new(&StreakSection { patterns: fitted }), &truth).unwrap().0
            };
            let [edges, separable, paper] = [Method::Edges, Method::Separable, Method::Paper].map(error);
            println!(
                "{}: 6 cosines {edges:.2} %, separable {separable:.2} %, paper {paper:.2} %",
                source.file.display()
            );
        }
        return;
    }
    let (cosines, separable) = (set(Method::Edges), set(Method::Separable));
    let reference = PictureSet::new(&pictures, PER_SAMPLE);
    println!("  R  fov  kernel            streaks  covered Mpx  find ms  draw ms  error %  MB held");
    for (rate, fov) in [
        (0.1, 120.0),
        (2.0, 120.0),
        (25.0, 120.0),
        (75.0, 120.0),
        (75.0, 60.0),
        (200.0, 140.0),
        (200.0, 20.0),
    ] {
        let large = View { section: &section, rate, fov, size: [1920, 1080], lengths_px: [30.0, 200.0] };
        let small = View { size: [480, 270], ..large };
        let truth = small.supersampled(&reference).unwrap();
        let line = |name: &str, kernel: &dyn Fn() -> (squall_bake::chart::rain_frame::Drawn, f64)| {
            let (drawn, error) = kernel();
            println!(
                "{rate:>5} {fov:>3}  {name:<16} {:>8} {:>12.2} {:>8.2} {:>8.2} {:>8.2} {:>8.1}",
                drawn.streaks,
                drawn.covered as f64 * 1e-6,
                drawn.find_ms,
                drawn.draw_ms,
                100.0 * error,
                drawn.bytes as f64 / f64::from(1 << 20)
            );
        };
        fn of<K: Kernel>(
            large: &View,
            small: &View,
            truth: &[f32],
            kernel: &K,
        ) -> (squall_bake::chart::rain_frame::Drawn, f64) {
            (large.time(kernel, 9).unwrap(), small.measure(kernel, truth).unwrap().0)
        }
        line("cosines", &|| of(&large, &small, &truth, &cosines));
        line("separable", &|| of(&large, &small, &truth, &separable));
        line("smooth window", &|| of(&large, &small, &truth, &SmoothWindow));
    }
}
