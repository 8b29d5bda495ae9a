//! From a stored pattern to what drawing needs.

use super::column;
use super::profile::Profile;
use super::thin::Thin;
use squall_formats::section::streak::{Body, CosinePattern, EdgeWindow, Pattern, StreakPattern, Window};
use std::f64::consts::TAU;

/// Amplitude below which a wave does not decide how a pattern is drawn.
const VISIBLE: f32 = 0.02;

/// A pattern ready to be drawn.
#[derive(Clone, Debug)]
pub struct Prepared {
    pub body: Body,
    /// Periods across of its finest visible wave.
    pub finest: f64,
    /// Where the pattern has light or its drop covers anything: ends of u and of v.
    pub range: [[f64; 2]; 2],
    /// How it is drawn where its width is resolved.
    pub light: PatternLight,
    /// How it is drawn where it is not.
    pub thin: Thin,
}

/// The two kinds of pattern.
#[derive(Clone, Debug)]
pub enum PatternLight {
    /// Cosines under a window.
    Cosines(Cosines),
    /// Products of profiles, across and along.
    Products(Vec<[Profile; 2]>),
}

/// Cosines under a window.
#[derive(Clone, Debug)]
pub struct Cosines {
    pub frame: PatternFrame,
    pub constant: f32,
    pub terms: Vec<Term>,
}

/// How the window is read.
#[derive(Clone, Debug)]
pub enum PatternFrame {
    /// Four soft edges.
    Edges(EdgeWindow),
    /// A profile across times a profile along.
    Profiles([Profile; 2]),
}

/// One cosine.
#[derive(Clone, Copy, Debug)]
pub struct Term {
    /// Periods over the picture, across and along.
    pub frequency: [f64; 2],
    pub amplitude: f32,
    /// Phase at the picture's corner, in turns.
    pub turns: f64,
}

impl Prepared {
    /// Tabulates what the thin form needs; a few thousand evaluations of the pattern.
    pub fn new(streak: &StreakPattern) -> Self {
        let light = match &streak.pattern {
            Pattern::Cosines(pattern) => PatternLight::Cosines(Cosines::new(pattern)),
            Pattern::Separable(pattern) => {
                let profiles = |k: usize| {
                    let across = Profile::new(|u| pattern.across_at(k, u));
                    [across, Profile::new(|v| pattern.along_at(k, v))]
                };
                PatternLight::Products((0..pattern.rank()).map(profiles).collect())
            }
        };
        let body = streak.body;
        let integral = streak.mean * body.width() * body.length();
        let finest = match &light {
            PatternLight::Cosines(cosines) => {
                let visible = cosines.terms.iter().filter(|term| term.amplitude > VISIBLE);
                visible.map(|term| term.frequency[0].abs()).fold(0.0, f64::max)
            }
            PatternLight::Products(_) => 0.0,
        };
        let (light_range, covered) = (range(&light), [body.u, body.v]);
        // The drop's disc may reach beyond its light.
        let range = [0, 1].map(|axis| {
            let ([a, b], [c, d]) = (light_range[axis], covered[axis]);
            [a.min(c), b.max(d)]
        });
        Self {
            body,
            finest,
            range,
            light,
            thin: Thin::new(&streak.pattern, (integral, body.width()), column::profiles(streak)),
        }
    }

    /// The cosines, of a pattern that is made of them.
    pub fn cosines(&self) -> Option<&Cosines> {
        match &self.light {
            PatternLight::Cosines(cosines) => Some(cosines),
            PatternLight::Products(_) => None,
        }
    }
}

/// Where the pattern has light: ends of u and of v.
fn range(light: &PatternLight) -> [[f64; 2]; 2] {
    /// Softnesses beyond which an edge has faded to 10⁻⁴ of the light, and its sum to 10⁻⁵.
    const FADED: f64 = 2.6;
    let PatternLight::Cosines(Cosines { frame: PatternFrame::Edges(window), .. }) = light else {
        return [[0.0, 1.0]; 2];
    };
    let bend = |bends: &[f64]| bends.iter().map(|bend| bend.abs()).sum::<f64>();
    let [left, right] = [0, 1].map(|i| bend(&window.sides[i][1..]) + FADED * window.softness[i]);
    let [top, bottom] = [0, 1].map(|i| bend(&window.ends[i][1..]) + FADED * window.softness[2 + i]);
    [
        [window.sides[0][0] - left, window.sides[1][0] + right],
        [window.ends[0][0] - top, window.ends[1][0] + bottom],
    ]
}

impl Cosines {
    fn new(pattern: &CosinePattern) -> Self {
        let frame = match &pattern.window {
            Window::Edges(window) => PatternFrame::Edges(*window),
            Window::Flat => PatternFrame::Profiles([Profile::new(|_| 1.0), Profile::new(|_| 1.0)]),
            Window::Power(window) => {
                let window = *window;
                PatternFrame::Profiles([0, 1].map(|axis| Profile::new(move |x| window.profile(axis, x))))
            }
        };
        let terms = pattern.terms.iter().map(|term| Term {
            frequency: [term.across, term.along],
            amplitude: term.amplitude as f32,
            turns: term.phase / TAU,
        });
        Self { frame, constant: pattern.constant as f32, terms: terms.collect() }
    }
}
