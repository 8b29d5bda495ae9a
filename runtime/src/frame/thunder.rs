//! Thunder as data: when a listener hears a stroke, and from how far.

use crate::stroke::Stroke;
use glam::DVec3;
use squall_formats::units::{Metres, MetresPerSecond, Seconds};

/// Speed of sound in air of 20 °C; it changes by .6 m/s a degree.
pub const SPEED_OF_SOUND: MetresPerSecond = MetresPerSecond(343.0);

/// What a listener hears of a stroke.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thunder {
    /// To the nearest piece of the channel: the clap.
    pub nearest: Metres,
    /// To the farthest: the rumble ends.
    pub farthest: Metres,
    /// From light to the first sound.
    pub delay: Seconds,
    /// From the first sound to the last, echoes left out.
    pub duration: Seconds,
}

impl Thunder {
    /// The thunder of a stroke for a listener, in still air of one temperature. `None` for a stroke without segments.
    ///
    /// ```
    /// use squall_runtime::{Stroke, frame::Thunder, glam::DVec3};
    /// let stroke = Stroke::from_points(&[DVec3::new(0.0, 3430.0, 0.0)], 1e6, [1.0; 3])?;
    /// assert!((Thunder::of(&stroke, DVec3::ZERO).unwrap().delay.0 - 10.0).abs() < 1e-9);
    /// # Ok::<(), squall_runtime::RuntimeError>(())
    /// ```
    pub fn of(stroke: &Stroke, listener: DVec3) -> Option<Self> {
        let mut reach: Option<[f64; 2]> = None;
        for segment in &stroke.segments {
            let way = segment.to - segment.from;
            let along = match way.length_squared() {
                0.0 => 0.0,
                squared => ((listener - segment.from).dot(way) / squared).clamp(0.0, 1.0),
            };
            let near = listener.distance(segment.from + way * along);
            let far = listener.distance(segment.from).max(listener.distance(segment.to));
            let [nearest, farthest] = reach.unwrap_or([near, far]);
            reach = Some([nearest.min(near), farthest.max(far)]);
        }
        let [nearest, farthest] = reach?;
        Some(Self {
            nearest: Metres(nearest),
            farthest: Metres(farthest),
            delay: Seconds(nearest / SPEED_OF_SOUND.0),
            duration: Seconds((farthest - nearest) / SPEED_OF_SOUND.0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thunder_comes_from_the_nearest_piece_and_rumbles_to_the_farthest() {
        let stroke =
            Stroke::from_points(&[DVec3::new(300.0, 0.0, 0.0), DVec3::new(300.0, 0.0, 400.0)], 1e6, [1.0; 3]);
        let stroke = stroke.unwrap();
        let thunder = Thunder::of(&stroke, DVec3::new(0.0, 0.0, 0.0)).unwrap();
        assert!((thunder.nearest.0 - 300.0).abs() < 1e-9);
        assert!((thunder.farthest.0 - 500.0).abs() < 1e-9);
        assert!((thunder.delay.0 - 300.0 / 343.0).abs() < 1e-12);
        assert!((thunder.duration.0 - 200.0 / 343.0).abs() < 1e-12);
        // Beside the middle of a channel the nearest place is no end of it.
        let beside = Thunder::of(&stroke, DVec3::new(0.0, 0.0, 200.0)).unwrap();
        assert!((beside.nearest.0 - 300.0).abs() < 1e-9);
    }
}
