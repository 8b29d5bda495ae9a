//! Window, constant and terms fitted together, and why more terms never fit worse.
//!
//! A search for the places of N terms is greedy: on its own it may end worse than a search for fewer, and a picture
//! that differs by less than anyone can see may lead it elsewhere. So a fit climbs a ladder. At every rung it
//! takes the best of its own search, from one start or several; of the best lower rung's pattern with further terms
//! grown on it; and of that pattern as it is. Each is measured on the rounded numbers that an asset stores.

use super::refine::{self, Free, Model, Samples};
use super::search::{self, Effort};
use super::window::{Extent, Shape};
use super::window_field::Fields;
use super::{BLACK, DARK, Grey, draw, quality, support};
use squall_formats::section::streak::{Body, CosinePattern, Method, Pattern, StreakPattern};

/// Most samples that a fit ends on, and that it searches on; larger regions are averaged down first.
const MAX_SAMPLES: usize = 1 << 15;
const SEARCH_SAMPLES: usize = 1 << 12;
/// Steps of the last refinement, and the relative gain below which it stops.
const FINAL_STEPS: usize = 60;
const FINE: f64 = 1e-5;
/// The same for fits that come close.
const CLOSE_STEPS: usize = 400;
const FINEST: f64 = 1e-9;
/// What a pattern grown from fewer terms must gain over the own search of more, dB: below this the two are as good.
const GROWN_WINS_DB: f64 = 1.0;
/// Softness of the window at further starts, as logarithms of factors: one start may end in a dead end that noise opens or shuts.
const OTHER_STARTS: [f64; 2] = [0.7, -0.7];
/// Numbers of terms, from 1, whose searches are short enough to start several times wherever they end.
const FEW: usize = 2;
/// What a pattern of fewer terms must gain over one of more that is rough, below [`CLOSE_DB`], to take its place, dB: nobody
/// sees the difference, and patterns of released assets stay as they are. Above, every gain counts.
const FEWER_WIN_DB: f64 = 0.3;
const CLOSE_DB: f64 = 40.0;
/// Numbers of terms that later ones are measured against: every one up to 12, then two for each doubling.
pub const RUNGS: [usize; 25] =
    [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768];

/// One rung: a fit, before and after it is rounded.
#[derive(Clone)]
struct Rung {
    model: Model,
    stored: CosinePattern,
    psnr_db: f64,
}

/// Fits of one picture with more and more terms.
pub struct Ladder<'a> {
    picture: &'a Grey,
    coarse: Samples,
    fine: Samples,
    shape: Shape,
    frequencies: bool,
    /// The best at the first of [`RUNGS`].
    climbed: Vec<Rung>,
}

impl<'a> Ladder<'a> {
    /// A ladder for `picture` under a window of `shape`; frequencies stay integers unless they are free.
    pub fn new(picture: &'a Grey, shape: Shape, frequencies: bool) -> Self {
        let [coarse, fine] = [SEARCH_SAMPLES, MAX_SAMPLES].map(|most| sample(picture, most));
        Self { picture, coarse, fine, shape, frequencies, climbed: Vec::new() }
    }

    /// The best pattern of at most `cosines` terms, rounded as an asset stores it.
    ///
    /// Its PSNR is never below that of a [`RUNGS`] number of fewer terms, by more than .3 dB where that is rough (below
    /// 40 dB), and does not depend on what was asked before.
    pub fn pattern(&mut self, cosines: usize) -> Pattern {
        for count in RUNGS.into_iter().filter(|&count| count <= cosines).skip(self.climbed.len()) {
            let rung = self.climb(count);
            self.climbed.push(rung);
        }
        match RUNGS.iter().position(|&count| count == cosines) {
            Some(rung) => Pattern::Cosines(self.climbed[rung].stored.clone()),
            None => Pattern::Cosines(self.climb(cosines).stored),
        }
    }

    /// PSNR of the window and the constant alone, dB; 0 before anything was fitted.
    pub fn first_db(&self) -> f64 {
        self.climbed.first().map_or(0.0, |rung| rung.psnr_db)
    }

    /// The best that `count` terms can be reached by, on top of the highest rung below.
    fn climb(&self, count: usize) -> Rung {
        let (model, error) = self.searched(count, 0.0);
        let mut best = self.finished(model);
        if (1..=FEW).contains(&count) || best.psnr_db >= CLOSE_DB {
            for stretch in OTHER_STARTS {
                let (model, other_error) = self.searched(count, stretch);
                // The last refinement costs more than the search, and does not make up for what is behind here.
                if other_error > error {
                    continue;
                }
                let other = self.finished(model);
                if other.psnr_db > best.psnr_db + GROWN_WINS_DB {
                    best = other;
                }
            }
        }
        let below =
            RUNGS.iter().zip(&self.climbed).filter(|(rung, _)| **rung < count).map(|(_, below)| below);
        let Some(below) = below.max_by(|a, b| a.psnr_db.total_cmp(&b.psnr_db)) else { return best };
        // Where the own search found something better than what was there, it did its work.
        if best.psnr_db < below.psnr_db {
            let mut grown = below.model.clone();
            let effort = Effort { rounds: 0, ..effort(count) };
            search::grow(&mut grown, &self.coarse, count, self.free(), effort);
            let grown = self.finished(grown);
            if grown.psnr_db > best.psnr_db + GROWN_WINS_DB {
                best = grown;
            }
        }
        let slack = if below.psnr_db < CLOSE_DB { FEWER_WIN_DB } else { 0.0 };
        if below.psnr_db > best.psnr_db + slack { below.clone() } else { best }
    }

    /// A search from nothing, under a window that starts with its softness stretched by e^`stretch`, and its summed squared error.
    fn searched(&self, count: usize, stretch: f64) -> (Model, f64) {
        let mut window = self.shape.start(&self.fine.extent);
        self.shape.soften(&mut window, stretch);
        let mut model = Model { shape: self.shape, window, constant: 0.5, waves: Vec::new() };
        let error = search::grow(&mut model, &self.coarse, count, self.free(), effort(count));
        (model, error)
    }

    fn free(&self) -> Free {
        Free { frequencies: self.frequencies, ..Free::ALL }
    }

    /// The last refinement on all samples, then rounding. A fit that comes close is refined further: what is left of its
    /// error then depends on where the refinement stopped, and faint noise decides that.
    fn finished(&self, mut model: Model) -> Rung {
        refine::refine(&mut model, &self.fine, self.free(), FINAL_STEPS, FINE);
        let first = self.rounded(model);
        if first.psnr_db < CLOSE_DB {
            return first;
        }
        let mut model = first.model.clone();
        refine::refine(&mut model, &self.fine, self.free(), CLOSE_STEPS, FINEST);
        let second = self.rounded(model);
        if second.psnr_db > first.psnr_db { second } else { first }
    }

    fn rounded(&self, model: Model) -> Rung {
        let stored = round_in_stages(model.clone(), &self.fine);
        let drawn = draw(&Pattern::Cosines(stored.clone()), self.picture.width, self.picture.height);
        Rung { model, stored, psnr_db: quality::psnr_db(self.picture, &drawn) }
    }
}

fn effort(cosines: usize) -> Effort {
    match cosines {
        0..=6 => Effort { peaks: 3, steps: 8, rounds: 2 },
        7..=12 => Effort { peaks: 3, steps: 8, rounds: 1 },
        _ => Effort { peaks: 1, steps: 6, rounds: 0 },
    }
}

/// The part of the picture that a fit must see, averaged down if it is large. Beyond a border that no light touches there is none, and a fit sees that too: what it put there
/// would be drawn, and would take its share of the drop's light.
fn sample(picture: &Grey, most: usize) -> Samples {
    let sides = [picture.width, picture.height];
    let ends = support(picture, BLACK);
    // A margin of background keeps the window from leaking past the light.
    let bounds = [0, 1].map(|axis| {
        let (side, margin) = (sides[axis] as i64, (2 + sides[axis] / 16) as i64);
        let [low, high] = ends[axis].map(|end| (end * side as f64).round() as i64);
        let low = if low > 0 { low - margin } else { 0 };
        let high = if high < side { high + margin } else { side };
        (low, high)
    });
    let mut cells = bounds.map(|(low, high)| (high - low) as usize);
    while cells[0] * cells[1] > most {
        let longer = usize::from(cells[1] > cells[0]);
        cells[longer] = cells[longer].div_ceil(2);
    }
    let edges = [0, 1].map(|axis| {
        let (low, high) = bounds[axis];
        (0..=cells[axis]).map(|i| low + i as i64 * (high - low) / cells[axis] as i64).collect::<Vec<i64>>()
    });
    let axes = [0, 1].map(|axis| {
        let middle = |pair: &[i64]| 0.5 * (pair[0] + pair[1]) as f64 / sides[axis] as f64;
        edges[axis].windows(2).map(middle).collect::<Vec<f64>>()
    });
    // Of the pixels from one edge to the next, those that the picture has.
    let within = |axis: usize, pair: &[i64]| {
        let [from, to] = [pair[0], pair[1]].map(|edge| edge.clamp(0, sides[axis] as i64) as usize);
        from..to
    };
    let mut light = Vec::with_capacity(cells[0] * cells[1]);
    for rows in edges[1].windows(2) {
        for columns in edges[0].windows(2) {
            let mut sum = 0.0;
            for y in within(1, rows) {
                let row = &picture.pixels[y * picture.width..][..picture.width];
                sum += row[within(0, columns)].iter().map(|&light| f64::from(light)).sum::<f64>();
            }
            light.push(sum / ((rows[1] - rows[0]) * (columns[1] - columns[0])) as f64);
        }
    }
    let extent = Extent { ends: support(picture, DARK), size: sides.map(|side| side as f64) };
    Samples { axes, light, extent, fields: Fields::default() }
}

/// Rounds in stages: what is rounded first is made up for by what is still free.
fn round_in_stages(mut model: Model, samples: &Samples) -> CosinePattern {
    let rounded = |model: &Model| {
        let streak = StreakPattern {
            name: String::new(),
            method: Method::Edges,
            size_px: [1, 1],
            body: Body::WHOLE,
            mean: 0.0,
            psnr_db: 0.0,
            ssim: 0.0,
            notes: None,
            scene: None,
            pattern: Pattern::Cosines(model.pattern()),
        };
        match streak.quantised().pattern {
            Pattern::Cosines(pattern) => pattern,
            Pattern::Separable(_) => model.pattern(),
        }
    };
    const POLISH: usize = 4;
    for stage in
        [Free { window: false, ..Free::ALL }, Free { window: false, frequencies: false, first_term: 0 }]
    {
        let stored = rounded(&model);
        if let Some(stored) = Model::from_pattern(&stored) {
            model.window = stored.window;
            if !stage.frequencies {
                model.waves = stored.waves;
            }
        }
        refine::refine(&mut model, samples, stage, POLISH, 1e-6);
    }
    rounded(&model)
}
