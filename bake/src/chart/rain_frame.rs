//! Chart `rain-frame`: how far the streaks of a frame are off the same drops drawn from the pictures themselves with
//! many samples a pixel, against time a frame.

use super::clock::seconds;
use super::picture_kernel::PictureSet;
use super::rain_baselines::{ParticleSystem, Rainfall, ScreenGrid};
use super::{Cost, Point, Sweep};
use crate::error::BakeError;
use crate::evaluate::relative_l2;
use crate::input::picture::{Grey, read_grey};
use crate::plan::density::bake_density;
use crate::progress::Progress;
use crate::streak::{FitSettings, Method, Source, fit_all};
use glam::DVec3;
use squall_formats::section::density::DensitySection;
use squall_formats::section::streak::{StreakPattern, StreakSection};
use squall_formats::units::{Degrees, MillimetresPerHour, Seconds};
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::picture::Picture;
use squall_runtime::rain::{Clip, Kernel, Rain, Scene, Shot, SmoothWindow, Surroundings, Weather, Workspace};
use squall_runtime::shade::streak::StreakSet;
use std::path::PathBuf;

const RMSE: &str = "streaks' light, relative RMSE";
const TIME: &str = "a frame, CPU ms";

/// What is read against what.
pub const PAIRS: &[(&str, &str)] = &[(RMSE, TIME)];

/// The reference's pixels along each side of a frame's.
pub const SAMPLES: u32 = 4;
/// Samples of a picture along each side of one of the reference's pixels.
pub const PER_SAMPLE: u32 = 4;
pub(super) const EXPOSURE: Seconds = Seconds(0.02);
const REPEATS: usize = 3;
/// Rates and fields of view that are swept, of the table's: its ends, and a usual heavy rain. The reference of one case is as much work as hundreds of frames.
const SWEPT: ([f64; 3], [f64; 2]) = ([2.0, 25.0, 75.0], [60.0, 120.0]);
/// Streaks' lengths, px.
const LENGTHS_PX: [f64; 2] = [10.0, 200.0];
/// What drops cover. With more, the widest of them hide a pixel wholly in some of its samples; what a frame with
/// one sample a pixel is then off, 2 % at 8, no pattern can help.
const GAIN: f64 = 1.0;
/// \[weber\] table 1, GeForce GTX 980, 20 ms: frames a second at 2, 5, 25 and 75 mm/h, by horizontal field of view.
pub(super) const TABLE_1: [(f64, [f64; 4]); 4] = [
    (120.0, [60.0, 48.0, 37.0, 30.0]),
    (100.0, [55.0, 45.0, 35.0, 27.0]),
    (80.0, [50.0, 42.0, 31.0, 24.0]),
    (60.0, [45.0, 39.0, 28.0, 22.0]),
];
pub(super) const RATES: [f64; 4] = [2.0, 5.0, 25.0, 75.0];

/// The chart's points.
///
/// Errors: a picture that is missing or damaged, an interruption.
pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let Some(rain) = &task.recipe.rain else { return Ok(Vec::new()) };
    if rain.pictures.is_empty() {
        return Ok(Vec::new());
    }
    let most = if task.quick { 1 } else { 4 };
    let step = (rain.pictures.len() / most).max(1);
    let files: Vec<PathBuf> = rain.pictures.iter().step_by(step).take(most).cloned().collect();
    let pictures = files.iter().map(|file| read_grey(file)).collect::<Result<Vec<_>, _>>()?;
    let fit = |method: Method, cosines: usize| -> Result<Vec<StreakPattern>, BakeError> {
        let sources = files.iter().zip(&pictures);
        let sources: Vec<Source> =
            sources.map(|(file, picture)| Source { file, picture, notes: None }).collect();
        fit_all(&sources, FitSettings { method, cosines })
    };
    let counts = cosine_counts(rain, task.quick);
    let section = bake_density(&rain.density)?;
    let own = &rain.density.ranges;
    let rates: &[f64] = if task.quick { &[25.0] } else { &SWEPT.0 };
    let rates = rates.iter().copied().filter(|&rate| (own.rate[0].0..=own.rate[1].0).contains(&rate));
    let fovs: &[f64] = if task.quick { &[60.0] } else { &SWEPT.1 };
    let cases: Vec<(f64, f64)> = rates.flat_map(|rate| fovs.iter().map(move |&fov| (rate, fov))).collect();
    progress.begin("chart rain-frame", (cases.len() * (counts.len() + 7)) as u64);
    let reference = PictureSet::new(&pictures, PER_SAMPLE);
    let mut patterns: Vec<(String, bool, bool, Vec<StreakPattern>)> = Vec::new();
    for &cosines in &counts {
        let chosen = rain.psnr_db.is_none() && rain.fit == FitSettings { method: Method::Edges, cosines };
        let name = format!("edges, {cosines} cosines");
        patterns.push((name, chosen, false, fit(Method::Edges, cosines)?));
    }
    patterns.push(("separable, 2 products".into(), false, false, fit(Method::Separable, 0)?));
    patterns.push(("paper, 6 cosines".into(), false, true, fit(Method::Paper, 6)?));
    let mut points = Vec::new();
    for (rate, fov) in cases {
        let size = if task.quick { [320, 180] } else { [960, 540] };
        let view = View { section: &section, rate, fov, size, lengths_px: LENGTHS_PX };
        let truth = view.supersampled(&reference)?;
        let samples = SAMPLES * PER_SAMPLE;
        let words = format!(
            "R {rate} mm/h, fov {fov}°: the pictures themselves, {samples} × {samples} samples a pixel"
        );
        let mut add = |series: &str, setting: String, chosen: bool, baseline: bool, measured: (f64, Cost)| {
            progress.advance(1);
            points.push(Point {
                series: series.into(),
                setting,
                truth: words.clone(),
                errors: vec![(RMSE, measured.0)],
                costs: vec![(TIME, measured.1)],
                bytes: None,
                chosen,
                baseline,
            });
        };
        progress.check()?;
        add("no pattern", "a smooth window".into(), false, false, view.measure(&SmoothWindow, &truth)?);
        for (name, chosen, baseline, patterns) in &patterns {
            let set = StreakSet::new(&StreakSection { patterns: patterns.clone() });
            let series = match (baseline, name.split(',').next()) {
                (true, _) => "paper's cosines",
                (false, Some("separable")) => "separable",
                _ => "edges",
            };
            add(series, name.clone(), *chosen, *baseline, view.measure(&set, &truth)?);
        }
        // Neither has drops that stand in the world: they have a cost and no error.
        let paper = patterns.last().map_or(&[][..], |(.., patterns)| patterns.as_slice());
        let [grid, system] = view.baselines(paper, &pictures)?;
        let words = "Algorithm 1 as printed: a grid on the screen, 6 cosines".to_owned();
        add("Algorithm 1", words, false, true, (f64::NAN, grid));
        add("particle system", "particles, textures".into(), false, true, (f64::NAN, system));
        // The paper gives no error; the point has a cost alone. Its horizontal fov stands beside our vertical one.
        if let Some(fps) = frames_per_second(rate, fov) {
            let setting = format!("paper's table 1: {fps} fps on a GTX 980, whole frame, horizontal fov");
            add("paper's table 1", setting, false, true, (f64::NAN, Cost::exact(1e3 / fps)));
        }
    }
    Ok(points)
}

/// Numbers of cosines that are swept, the recipe's own among them.
fn cosine_counts(rain: &crate::recipe::model::Rain, quick: bool) -> Vec<usize> {
    let mut counts = if quick { vec![6] } else { vec![0, 3, 6, 12, 24] };
    if rain.psnr_db.is_none() && rain.fit.method == Method::Edges {
        counts.push(rain.fit.cosines);
        counts.sort_unstable();
        counts.dedup();
    }
    counts
}

/// What \[weber\]'s table 1 has for a rate, mm/h, and a field of view, degrees.
fn frames_per_second(rate: f64, fov: f64) -> Option<f64> {
    let (_, fps) = TABLE_1.iter().find(|(table_fov, _)| *table_fov == fov)?;
    RATES.iter().position(|&r| r == rate).map(|place| fps[place])
}

/// A moment of rain.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// The drops.
    pub section: &'a DensitySection,
    /// mm/h.
    pub rate: f64,
    /// Vertical, degrees.
    pub fov: f64,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Shortest and longest streak, px.
    pub lengths_px: [f64; 2],
}

/// What a frame took.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    /// Streaks found.
    pub streaks: usize,
    /// Pixels that they touch, one by one, summed over the streaks.
    pub covered: usize,
    /// Finding them, ms of this thread.
    pub find_ms: f64,
    /// Drawing them over a picture that is there.
    pub draw_ms: f64,
    /// Memory that both keep.
    pub bytes: usize,
}

impl View<'_> {
    fn camera(&self, samples: u32) -> Result<Camera, BakeError> {
        let projection = Projection::Perspective { vertical_fov: Degrees(self.fov).into() };
        let size = self.size.map(|side| side * samples);
        Ok(Camera::new(DVec3::new(3.0, 5.0, 1.7), DVec3::new(1.0, 0.4, 0.1), DVec3::Z, projection, size)?)
    }

    /// Draws into a black `picture`, in `workspace`.
    fn draw<K: Kernel>(
        &self,
        samples: u32,
        kernel: &K,
        workspace: &mut Workspace,
        picture: &mut Picture,
    ) -> Result<(), BakeError> {
        self.find(samples, workspace)?;
        picture.pixels.fill([0.0; 3]);
        self.lay(samples, kernel, workspace, picture)
    }

    fn find(&self, samples: u32, workspace: &mut Workspace) -> Result<(), BakeError> {
        let camera = self.camera(samples)?;
        let shot = self.shot(samples, &camera);
        let weather =
            Weather::steady(MillimetresPerHour(self.rate), DVec3::new(2.0, -1.0, 0.0), Seconds(10.0));
        Rain::new(self.section, 7).find(&shot, &weather, None, workspace)?;
        Ok(())
    }

    fn shot<'c>(&self, samples: u32, camera: &'c Camera) -> Shot<'c> {
        let [shortest, longest] = self.lengths_px.map(|length| length * f64::from(samples));
        Shot { min_px: shortest, max_px: longest, ..Shot::new(camera, EXPOSURE) }
    }

    fn lay<K: Kernel>(
        &self,
        samples: u32,
        kernel: &K,
        workspace: &mut Workspace,
        picture: &mut Picture,
    ) -> Result<(), BakeError> {
        let camera = self.camera(samples)?;
        let shot = self.shot(samples, &camera);
        let light = Surroundings { above: [1.0; 3], below: [0.1; 3], ..Default::default() };
        workspace.draw(&shot, &Scene { depth: None, kernel, light: &light, gain: GAIN }, picture)?;
        Ok(())
    }

    /// What the frame takes \[weber\]'s Algorithm 1 with `patterns` and a particle system with `textures`, ms.
    ///
    /// Errors: a frame of no size.
    pub fn baselines(&self, patterns: &[StreakPattern], textures: &[Grey]) -> Result<[Cost; 2], BakeError> {
        let Self { rate, fov, size, lengths_px, .. } = *self;
        let rain = Rainfall { rate, fov, size, lengths_px, exposure: EXPOSURE };
        let mut picture = Picture::new(size[0] as usize, size[1] as usize)?;
        let grid = ScreenGrid::new(&rain, patterns);
        // A frame of it takes seconds: once is enough.
        let (_, screen) = seconds(1, || {
            picture.pixels.fill([0.0; 3]);
            grid.draw(10.0, &mut picture)
        });
        let mut system = ParticleSystem::new(rain);
        let (_, particles) = seconds(REPEATS, || {
            picture.pixels.fill([0.0; 3]);
            system.update(1.0 / 60.0);
            system.draw(textures, &mut picture)
        });
        Ok([screen.times(1e3), particles.times(1e3)])
    }

    /// What finding and drawing the frame's streaks takes; the median of `repeats`, after a first frame that allocates.
    ///
    /// Errors: a frame of no size, rain beyond the section's.
    pub fn time<K: Kernel + Sync>(&self, kernel: &K, repeats: usize) -> Result<Drawn, BakeError> {
        let mut picture = Picture::new(self.size[0] as usize, self.size[1] as usize)?;
        let mut workspace = Workspace::new();
        self.draw(1, kernel, &mut workspace, &mut picture)?;
        let (done, find) = seconds(repeats, || self.find(1, &mut workspace));
        done?;
        let (done, draw) = seconds(repeats, || self.lay(1, kernel, &mut workspace, &mut picture));
        done?;
        let whole = Clip { left: 0, top: 0, right: self.size[0] as i32, bottom: self.size[1] as i32 };
        let (mut covered, mut scratch) = (0, K::Scratch::default());
        for streak in workspace.streaks() {
            if let Some((_, placed)) = kernel.place(&streak.footprint()) {
                kernel.draw(&placed, whole, &mut scratch, &mut |span| covered += span.count);
            }
        }
        Ok(Drawn {
            streaks: workspace.streaks().len(),
            covered,
            find_ms: 1e3 * find.median,
            draw_ms: 1e3 * draw.median,
            bytes: workspace.bytes(),
        })
    }

    /// The frame with many samples a pixel.
    ///
    /// Errors: as [`View::time`].
    pub fn supersampled<K: Kernel>(&self, kernel: &K) -> Result<Vec<f32>, BakeError> {
        let [width, height] = self.size.map(|side| side as usize);
        let samples = SAMPLES as usize;
        let mut picture = Picture::new(width * samples, height * samples)?;
        self.draw(SAMPLES, kernel, &mut Workspace::new(), &mut picture)?;
        let mut sums = vec![0.0f32; width * height];
        for (index, pixel) in picture.pixels.iter().enumerate() {
            let (x, y) = (index % (width * samples) / samples, index / (width * samples) / samples);
            sums[y * width + x] += pixel[1];
        }
        let share = 1.0 / (samples * samples) as f32;
        Ok(sums.into_iter().map(|sum| sum * share).collect())
    }

    /// Relative error against `truth`, and what finding and drawing take together, ms.
    ///
    /// Errors: as [`View::time`].
    pub fn measure<K: Kernel + Sync>(&self, kernel: &K, truth: &[f32]) -> Result<(f64, Cost), BakeError> {
        let [width, height] = self.size.map(|side| side as usize);
        let mut picture = Picture::new(width, height)?;
        let mut workspace = Workspace::new();
        // The first frame allocates.
        self.draw(1, kernel, &mut workspace, &mut picture)?;
        let (done, cost) = seconds(REPEATS, || self.draw(1, kernel, &mut workspace, &mut picture));
        done?;
        let green: Vec<f32> = picture.pixels.iter().map(|pixel| pixel[1]).collect();
        Ok((relative_l2(&green, truth), cost.times(1e3)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::density::DensitySpec;
    use std::path::Path;

    #[test]
    fn more_cosines_are_nearer_to_the_pictures_and_nothing_else_keeps_a_frame_from_them() {
        /// Where streaks overlap or hide a pixel, one sample of it is not many.
        const ONE_SAMPLE: f64 = 0.01;
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/storm/streaks/drop10.png");
        let pictures = [read_grey(&file).unwrap()];
        let section = bake_density(&DensitySpec::default()).unwrap();
        let view =
            View { section: &section, rate: 25.0, fov: 60.0, size: [240, 135], lengths_px: LENGTHS_PX };
        let truth = view.supersampled(&PictureSet::new(&pictures, PER_SAMPLE)).unwrap();
        let error_of = |cosines: usize| {
            let source = Source { file: &file, picture: &pictures[0], notes: None };
            let fitted = fit_all(&[source], FitSettings { method: Method::Edges, cosines }).unwrap();
            let set = StreakSet::new(&StreakSection { patterns: fitted });
            view.measure(&set, &truth).unwrap().0
        };
        let once = PictureSet::new(&pictures, SAMPLES * PER_SAMPLE);
        let (three, many, own) = (error_of(3), error_of(24), view.measure(&once, &truth).unwrap().0);
        println!("3 cosines {three:.4}, 24 {many:.4}, the picture itself {own:.4}");
        assert!(own < ONE_SAMPLE && own < many && many < three, "{own} {many} {three}");
    }
}
