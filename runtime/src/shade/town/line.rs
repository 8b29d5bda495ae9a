//! Lights without breadth, and their images in rippled water, integrated along their length.
//!
//! A facet's slope that shows a point of the line to the eye changes evenly along a short line, and the highlight falls with it as
//! a normal curve does. Sums at steps well below the curve's width are as good as its integral, so a line takes as many steps as
//! its image is long in widths, and no gap opens between them.

#[cfg(feature = "gpu")]
mod upload;

use crate::shade::water::{LANES, SMOOTHEST, rippled_highlights};
use glam::Vec3;

/// A piece of a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineLight {
    /// One end, m.
    pub from: Vec3,
    /// The other, m.
    pub to: Vec3,
    /// Radiant intensity of the whole per colour, W/sr.
    pub intensity: [f32; 3],
    /// Share of it that arrives through cloud, in [0, 1].
    pub visibility: f32,
}

/// Lines that are asked together whether any of them can have an image.
const TOGETHER: usize = 8;

/// Lines whose images stand in water, neighbours close to each other; most water asks a few balls around them and no line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Images {
    lines: Vec<LineLight>,
    balls: Vec<Ball>,
}

/// A ball around some places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ball {
    centre: Vec3,
    radius: f32,
}

impl From<Vec<LineLight>> for Images {
    /// Lines that together send less than a faint share (`FAINT`) of the light, those that stand deep in cloud, are left out.
    fn from(mut lines: Vec<LineLight>) -> Self {
        let light = |line: &LineLight| line.visibility * line.intensity.iter().sum::<f32>();
        let mut sorted: Vec<f32> = lines.iter().map(light).collect();
        sorted.sort_by(f32::total_cmp);
        let most = FAINT * sorted.iter().sum::<f32>();
        let mut sum = 0.0;
        let brightest_left_out = sorted.iter().copied().take_while(|own| {
            sum += own;
            sum <= most
        });
        let least = brightest_left_out.fold(0.0, f32::max);
        lines.retain(|line| light(line) > least);
        let balls = lines.chunks(TOGETHER).map(Ball::around).collect();
        Self { lines, balls }
    }
}

impl std::ops::Deref for Images {
    type Target = [LineLight];

    fn deref(&self) -> &[LineLight] {
        &self.lines
    }
}

impl Images {
    /// No lines.
    pub const NONE: &'static Self = &Self { lines: Vec::new(), balls: Vec::new() };

    /// Middles of the balls around the lines: places that stand for those of all lines in them.
    pub fn centres(&self) -> impl Iterator<Item = Vec3> {
        self.balls.iter().map(|ball| ball.centre)
    }

    /// Calls `shown` for each ball whose lines may have an image in water, with its middle and those lines that have one there, each
    /// with its [`LineLight::highlight`].
    pub(super) fn each_shown<'a>(
        &'a self,
        place: &Place,
        mut shown: impl FnMut(Vec3, &[(&'a LineLight, f32)]),
    ) {
        let mut lit: [(&LineLight, f32); TOGETHER] = [(&NO_LINE, 0.0); TOGETHER];
        for (lines, ball) in self.lines.chunks(TOGETHER).zip(&self.balls) {
            if ball.has_no_image(place) {
                continue;
            }
            let mut count = 0;
            // Where one line ends the next begins.
            let mut last = (Vec3::NAN, None);
            for line in lines {
                let from = if line.from == last.0 { last.1 } else { place.slope_of(line.from) };
                last = (line.to, place.slope_of(line.to));
                let bright = line.highlight_between([from, last.1], place);
                if bright > 0.0 {
                    lit[count] = (line, bright);
                    count += 1;
                }
            }
            if count > 0 {
                shown(ball.centre, &lit[..count]);
            }
        }
    }
}

const NO_LINE: LineLight =
    LineLight { from: Vec3::ZERO, to: Vec3::ZERO, intensity: [0.0; 3], visibility: 0.0 };

/// A place of water that is looked at.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// The place, m.
    pub point: Vec3,
    /// Unit normal of the still water.
    pub normal: Vec3,
    /// Unit direction to the eye.
    pub to_viewer: Vec3,
    /// Root mean square slope along one axis.
    pub slope: f32,
}

impl Place {
    /// The facet's slope across the surface that shows a light at `position` to the eye; none below the surface.
    fn slope_of(&self, position: Vec3) -> Option<Vec3> {
        let way = position - self.point;
        if self.normal.dot(way) <= 0.0 {
            return None;
        }
        let half = way.normalize() + self.to_viewer;
        Some(half / self.normal.dot(half) - self.normal)
    }
}

impl Ball {
    fn around(lines: &[LineLight]) -> Self {
        Self::of(&lines.iter().flat_map(|line| [line.from, line.to]).collect::<Vec<_>>())
    }

    /// The ball around all of these.
    pub fn of(places: &[Vec3]) -> Self {
        let ends = || places.iter().copied();
        let (low, high) = ends()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), end| (low.min(end), high.max(end)));
        let centre = 0.5 * (low + high);
        let radius = ends().map(|end| end.distance(centre)).fold(0.0, f32::max);
        // Outwards by more than round-off.
        Self { centre, radius: radius * 1.0001 + 1e-3 }
    }

    /// Whether [`LineLight::highlight`] is 0 for every line in the ball.
    ///
    /// Unit vectors to its places differ from the one w to its centre by e at most, so a facet's slope T/N of half = w + v is no
    /// shorter along T than (|T| − e)/(N + e), and no two of them are farther apart than 2e/(N − e) + 2e(|T| + e)/(N − e)².
    pub fn has_no_image(&self, &Place { point, normal, to_viewer, slope }: &Place) -> bool {
        let way = self.centre - point;
        let distance = way.length();
        if distance <= 1.5 * self.radius {
            return false;
        }
        // The chord of an angle whose sine is radius/distance is below √2 times that sine.
        let e = std::f32::consts::SQRT_2 * self.radius / distance;
        let half = way / distance + to_viewer;
        let up = normal.dot(half);
        let across = (half - normal * up).length();
        let least = up - e;
        if least <= 1e-3 {
            return false;
        }
        let apart = 2.0 * e / least * (1.0 + (across + e) / least);
        // A hundredth more than the lines' own test asks for.
        (across - e) / (up + e) > 1.01 * (REACH * slope.max(SMOOTHEST) + 0.25 * apart)
    }
}

/// Share of a channel's light whose image is not missed.
const FAINT: f32 = 1e-3;
/// Steps as a share of the highlight's standard deviation.
const STEP: f32 = 0.4;
/// Steps per radian that the line covers.
const ANGLE_STEPS: f32 = 16.0;
/// Most steps of one line.
const MOST_STEPS: f32 = 64.0;
/// Standard deviations at which a highlight ends.
const REACH: f32 = 7.1;

impl LineLight {
    /// Its middle, m.
    pub fn middle(&self) -> Vec3 {
        0.5 * (self.from + self.to)
    }

    /// Radiance towards the eye per unit of the line's intensity from rippled water at `point`, 1/m²: the mean of
    /// [`rippled_highlight`](crate::shade::water::rippled_highlight) over squared distance along it.
    pub fn highlight(&self, place: &Place) -> f32 {
        self.highlight_between([self.from, self.to].map(|end| place.slope_of(end)), place)
    }

    /// The same with the slopes that show its ends.
    fn highlight_between(&self, ends: [Option<Vec3>; 2], place: &Place) -> f32 {
        let &Place { point, normal, to_viewer, slope } = place;
        let steps = match ends {
            [Some(a), Some(b)] => {
                let way = b - a;
                let nearest = a + way * (-a.dot(way) / way.length_squared().max(1e-30)).clamp(0.0, 1.0);
                // A bent path of slopes strays from its chord by less than a quarter of the chord.
                if nearest.length() > REACH * slope + 0.25 * way.length() {
                    return 0.0;
                }
                // Fresnel's share and the masking change with the line's own angle.
                let angle = self.from.distance(self.to) / self.middle().distance(point);
                (way.length() / (STEP * slope) + ANGLE_STEPS * angle).ceil().clamp(1.0, MOST_STEPS)
            }
            [None, None] => return 0.0,
            _ => MOST_STEPS,
        };
        // Some steps side by side, as registers hold them.
        let mut sum = 0.0;
        for first in (0..steps as usize).step_by(LANES) {
            let share: [f32; LANES] = std::array::from_fn(|lane| ((first + lane) as f32 + 0.5) / steps);
            let way = self.to - self.from;
            let start = self.from - point;
            let ways: [[f32; LANES]; 3] =
                std::array::from_fn(|axis| share.map(|share| start[axis] + way[axis] * share));
            let own = rippled_highlights(normal, ways, to_viewer, slope);
            let count = (steps as usize - first).min(LANES);
            sum += own[..count].iter().sum::<f32>();
        }
        sum / steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::shade::water::rippled_highlight;

    const BOLT: LineLight = LineLight {
        from: Vec3::new(300.0, 2_000.0, 900.0),
        to: Vec3::new(340.0, 2_050.0, 20.0),
        intensity: [1.0; 3],
        visibility: 1.0,
    };

    fn at(to_viewer: Vec3, slope: f32) -> Place {
        Place { point: Vec3::ZERO, normal: Vec3::Z, to_viewer, slope }
    }

    fn viewer(down: f32, side: f32) -> Vec3 {
        -Vec3::new(0.16 + side, 1.0, -down).normalize()
    }

    #[test]
    fn the_image_of_a_line_is_that_of_ten_thousand_points_on_it() {
        /// Steps of two fifths of a normal curve's width; its ends fall between steps.
        const STEPS: f32 = 0.03;
        for slope in [0.004, 0.02, 0.1] {
            let mut brightest = 0.0f32;
            let mut worst = 0.0f32;
            for i in 0..40 {
                for side in [0.0, 0.01, -0.03] {
                    let eye = viewer(0.01 + 0.012 * i as f32, side);
                    let found = BOLT.highlight(&at(eye, slope));
                    let wanted = (0..10_000)
                        .map(|k| {
                            let way = BOLT.from.lerp(BOLT.to, (k as f32 + 0.5) / 10_000.0);
                            let squared = way.length_squared();
                            f64::from(rippled_highlight(Vec3::Z, way / squared.sqrt(), eye, slope) / squared)
                        })
                        .sum::<f64>() as f32
                        / 10_000.0;
                    brightest = brightest.max(wanted);
                    worst = worst.max((found - wanted).abs());
                }
            }
            println!("slope {slope}: {worst:.2e} of {brightest:.2e}");
            assert!(brightest > 0.0 && worst < STEPS * brightest, "{slope}: {worst} of {brightest}");
        }
    }

    #[test]
    fn a_line_in_two_pieces_has_the_energy_of_the_whole() {
        const STEPS: f32 = 0.03;
        let middle = BOLT.middle();
        let halves = [LineLight { to: middle, ..BOLT }, LineLight { from: middle, ..BOLT }];
        let (mut whole, mut parts) = (0.0, 0.0);
        for i in 0..200 {
            let eye = viewer(0.002 + 0.0025 * i as f32, 0.0);
            let at = |line: &LineLight| line.highlight(&self::at(eye, 0.01));
            whole += at(&BOLT);
            parts += 0.5 * (at(&halves[0]) + at(&halves[1]));
        }
        assert!(whole > 0.0 && (parts / whole - 1.0).abs() < STEPS, "{parts} {whole}");
    }

    #[test]
    fn lines_that_are_left_out_together_have_no_image() {
        let mut random = Random::new(3);
        let place =
            |random: &mut Random, wide: f64| random.direction().as_vec3() * random.range(0.0, wide) as f32;
        let (mut asked, mut left_out) = (0, 0);
        for _ in 0..4000 {
            let wide = random.range(1.0, 150.0);
            let middle = Vec3::new(0.0, random.range(50.0, 3000.0) as f32, random.range(0.0, 900.0) as f32);
            let ends: Vec<Vec3> = (0..9).map(|_| middle + place(&mut random, wide)).collect();
            let line = |pair: &[Vec3]| LineLight { from: pair[0], to: pair[1], ..BOLT };
            let images = Images::from(ends.windows(2).map(line).collect::<Vec<_>>());
            let eye = viewer(random.range(0.001, 0.6) as f32, random.range(-0.4, 0.2) as f32);
            let slope = [0.0, 0.004, 0.02, 0.1][random.range(0.0, 3.99) as usize];
            let place = at(eye, slope);
            let mut shown = 0;
            images.each_shown(&place, |_, lines| {
                shown += lines.len();
                assert!(lines.iter().all(|(line, bright)| *bright == line.highlight(&place)));
            });
            let lit = images.iter().filter(|line| line.highlight(&place) > 0.0).count();
            assert_eq!(shown, lit);
            asked += images.balls.len();
            left_out += images.balls.iter().filter(|ball| ball.has_no_image(&place)).count();
        }
        assert!(left_out > asked / 10 && left_out < asked, "{left_out} of {asked}");
    }

    #[test]
    fn a_line_below_the_water_or_aside_has_no_image() {
        let sunk = LineLight { from: Vec3::new(0.0, 10.0, -5.0), to: Vec3::new(0.0, 10.0, -1.0), ..BOLT };
        assert_eq!(sunk.highlight(&at(viewer(0.2, 0.0), 0.05)), 0.0);
        assert_eq!(BOLT.highlight(&at(viewer(0.2, 0.9), 0.02)), 0.0);
    }
}
