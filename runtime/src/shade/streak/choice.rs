//! Which pattern a drop shows: by how long its streak is against its width, by its size, by the line of sight and by what lights it.
//!
//! A set whose pictures say what they show ([`SceneNotes`]) is sorted once into bins of such conditions, each with the few patterns
//! that come nearest; a drop takes one of its bin by its own number, the same for its whole life while its conditions stay. A set that
//! says nothing is drawn by number alone.

#[cfg(feature = "gpu")]
mod flat;

use squall_formats::section::streak::{SceneNotes, StreakPattern};

/// How a drop is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditions {
    /// Length of the streak, the drop's width included, over that width.
    pub aspect: f64,
    /// Diameter, mm; 0 where it is not known.
    pub diameter_mm: f64,
    /// Elevation of the line of sight, degrees.
    pub view_elevation_deg: f64,
    /// Share of one light in all that lights the drop.
    pub light_share: f64,
    /// Angle between the line of sight and the way to that light, degrees: 0 is straight against it.
    pub light_angle_deg: f64,
}

/// Middles of the bins.
const ASPECTS_LOG2: [f64; 13] = [0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0];
const DIAMETERS_MM: [f64; 4] = [0.7, 1.1, 1.7, 2.7];
const ELEVATIONS_DEG: [f64; 5] = [-50.0, -20.0, 0.0, 30.0, 60.0];
const SHARES: [f64; 3] = [0.0, 0.4, 0.8];
const ANGLES_DEG: [f64; 4] = [15.0, 50.0, 100.0, 150.0];
const BINS: usize =
    ASPECTS_LOG2.len() * DIAMETERS_MM.len() * ELEVATIONS_DEG.len() * SHARES.len() * ANGLES_DEG.len();
/// Differences that count as much as each other: in the logarithm to base 2, degrees, shares.
const ASPECT_SCALE: f64 = 0.6;
const DIAMETER_SCALE: f64 = 1.0;
const ELEVATION_SCALE_DEG: f64 = 20.0;
const SHARE_SCALE: f64 = 0.3;
const ANGLE_SCALE_DEG: f64 = 35.0;
/// Patterns of a bin: at most this many, none worse than the best by more than the slack.
const MOST: usize = 8;
const SLACK: f64 = 1.0;

/// Patterns by conditions.
#[derive(Clone, Debug)]
pub struct Choice {
    /// Where each bin's patterns begin in `patterns`; one more than there are bins.
    starts: Vec<u32>,
    patterns: Vec<u16>,
}

/// What is known of a pattern.
struct Traits {
    aspect_log2: f64,
    diameter_log2: Option<f64>,
    scene: Option<(SceneNotes, f64)>,
}

impl Traits {
    fn of(streak: &StreakPattern) -> Self {
        let [width, length] = streak.size_px.map(f64::from);
        let aspect = length * streak.body.length() / (width * streak.body.width());
        let angle = |scene: SceneNotes| {
            let [view, light] = [scene.view_elevation_deg, scene.light_elevation_deg]
                .map(|degrees| libm::sincos(degrees.to_radians()));
            let cosine =
                view.1 * light.1 * libm::cos(scene.light_azimuth_deg.to_radians()) + view.0 * light.0;
            (scene, libm::acos(cosine.clamp(-1.0, 1.0)).to_degrees())
        };
        Self {
            aspect_log2: libm::log2(aspect),
            diameter_log2: streak.notes.map(|notes| libm::log2(notes.diameter_mm.max(1e-3))),
            scene: streak.scene.map(angle),
        }
    }

    /// How far a pattern is from what a bin's middle wants; what is not known is no distance.
    fn distance(&self, aspect_log2: f64, diameter_mm: f64, elevation: f64, [share, angle]: [f64; 2]) -> f64 {
        let square = |difference: f64, scale: f64| (difference / scale) * (difference / scale);
        let mut sum = square(aspect_log2 - self.aspect_log2, ASPECT_SCALE);
        if let Some(own) = self.diameter_log2 {
            sum += square(libm::log2(diameter_mm) - own, DIAMETER_SCALE);
        }
        if let Some((scene, own_angle)) = &self.scene {
            sum += square(elevation - scene.view_elevation_deg, ELEVATION_SCALE_DEG);
            sum += square(share - scene.light_share, SHARE_SCALE);
            sum += share.min(scene.light_share) * square(angle - own_angle, ANGLE_SCALE_DEG);
        }
        sum
    }
}

impl Choice {
    /// The choice among `patterns`; `None` where none of them says what it shows.
    pub fn new(patterns: &[&StreakPattern]) -> Option<Self> {
        if patterns.iter().all(|pattern| pattern.scene.is_none()) {
            return None;
        }
        let traits: Vec<Traits> = patterns.iter().map(|pattern| Traits::of(pattern)).collect();
        let mut choice = Self { starts: vec![0], patterns: Vec::new() };
        let mut ranked: Vec<(f64, u16)> = Vec::with_capacity(traits.len());
        for bin in 0..BINS {
            let mut rest = bin;
            let mut digit = |base: usize| {
                let digit = rest % base;
                rest /= base;
                digit
            };
            let angle = ANGLES_DEG[digit(ANGLES_DEG.len())];
            let share = SHARES[digit(SHARES.len())];
            let elevation = ELEVATIONS_DEG[digit(ELEVATIONS_DEG.len())];
            let diameter = DIAMETERS_MM[digit(DIAMETERS_MM.len())];
            let aspect = ASPECTS_LOG2[digit(ASPECTS_LOG2.len())];
            ranked.clear();
            let each = traits.iter().enumerate();
            ranked.extend(
                each.map(|(at, own)| (own.distance(aspect, diameter, elevation, [share, angle]), at as u16)),
            );
            ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let least = ranked.first().map_or(0.0, |(distance, _)| *distance);
            let near = ranked.iter().take(MOST).take_while(|(distance, _)| *distance <= least + SLACK);
            choice.patterns.extend(near.map(|(_, at)| *at));
            choice.starts.push(choice.patterns.len() as u32);
        }
        Some(choice)
    }

    /// The pattern of a drop with uniform bits `number`.
    pub fn pick(&self, conditions: &Conditions, number: u32) -> u32 {
        let nearest = |middles: &[f64], value: f64| {
            // Middles ascend: the first border that the value does not pass.
            middles.windows(2).take_while(|pair| value > 0.5 * (pair[0] + pair[1])).count()
        };
        let diameter = if conditions.diameter_mm > 0.0 { conditions.diameter_mm } else { DIAMETERS_MM[1] };
        let aspect = libm::log2f(conditions.aspect.max(1.0) as f32);
        let mut bin = nearest(&ASPECTS_LOG2, f64::from(aspect));
        for (middles, value) in [
            (&DIAMETERS_MM[..], diameter),
            (&ELEVATIONS_DEG[..], conditions.view_elevation_deg),
            (&SHARES[..], conditions.light_share),
            (&ANGLES_DEG[..], conditions.light_angle_deg),
        ] {
            bin = bin * middles.len() + nearest(middles, value);
        }
        let patterns = &self.patterns[self.starts[bin] as usize..self.starts[bin + 1] as usize];
        // The upper bits decide: the lower ones pick among patterns of sets without notes.
        let at = (u64::from(number) * patterns.len() as u64) >> 32;
        patterns.get(at as usize).map_or(0, |pattern| u32::from(*pattern))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shade::streak::tests::every_kind;
    use squall_formats::section::streak::DropNotes;

    /// A pattern of an aspect, lit and seen in some way.
    fn pattern(aspect: f64, diameter_mm: f64, scene: [f64; 4]) -> StreakPattern {
        let mut pattern = every_kind().patterns[0].clone();
        pattern.body = squall_formats::section::streak::Body::WHOLE;
        pattern.size_px = [16, (16.0 * aspect) as u16];
        pattern.notes = Some(DropNotes { diameter_mm, exposure_ms: 10.0 });
        let [view_elevation_deg, light_share, light_azimuth_deg, light_elevation_deg] = scene;
        pattern.scene =
            Some(SceneNotes { view_elevation_deg, light_share, light_azimuth_deg, light_elevation_deg });
        pattern
    }

    #[test]
    fn each_drop_takes_a_pattern_of_its_length_its_light_and_its_line_of_sight() {
        let patterns = [
            pattern(20.0, 1.5, [0.0, 0.0, 0.0, 0.0]),
            pattern(3.0, 1.5, [0.0, 0.0, 0.0, 0.0]),
            pattern(20.0, 1.5, [0.0, 0.8, 5.0, 10.0]),
            pattern(20.0, 1.5, [0.0, 0.8, 150.0, 20.0]),
            pattern(20.0, 1.5, [60.0, 0.0, 0.0, 0.0]),
        ];
        let all: Vec<&StreakPattern> = patterns.iter().collect();
        let choice = Choice::new(&all).unwrap();
        let conditions = |aspect, view_elevation_deg, light_share, light_angle_deg| Conditions {
            aspect,
            diameter_mm: 1.5,
            view_elevation_deg,
            light_share,
            light_angle_deg,
        };
        for number in (0..32).map(|shift| 0x9E37_79B9u32.rotate_left(shift)) {
            assert_eq!(choice.pick(&conditions(22.0, 3.0, 0.05, 90.0), number), 0);
            assert_eq!(choice.pick(&conditions(3.3, 3.0, 0.05, 90.0), number), 1);
            assert_eq!(choice.pick(&conditions(22.0, 3.0, 0.9, 12.0), number), 2);
            assert_eq!(choice.pick(&conditions(22.0, 3.0, 0.9, 160.0), number), 3);
            assert_eq!(choice.pick(&conditions(22.0, 65.0, 0.05, 90.0), number), 4);
        }
    }

    #[test]
    fn patterns_that_are_alike_are_all_taken_and_sets_that_say_nothing_are_drawn_by_number() {
        let alike: Vec<StreakPattern> = (0..4).map(|_| pattern(16.0, 1.7, [0.0, 0.0, 0.0, 0.0])).collect();
        let all: Vec<&StreakPattern> = alike.iter().collect();
        let choice = Choice::new(&all).unwrap();
        let seen = Conditions {
            aspect: 16.0,
            diameter_mm: 0.0,
            view_elevation_deg: 0.0,
            light_share: 0.0,
            light_angle_deg: 90.0,
        };
        let mut taken = [0; 4];
        for number in 0..4096u32 {
            taken[choice.pick(&seen, number << 20) as usize] += 1;
        }
        assert_eq!(taken, [1024; 4]);
        let silent = every_kind();
        assert!(Choice::new(&silent.patterns.iter().collect::<Vec<_>>()).is_none());
    }
}
