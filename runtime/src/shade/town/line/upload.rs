//! Lines of light as a graphics card reads them.

use super::{ANGLE_STEPS, Images, LineLight, MOST_STEPS, REACH, STEP};
use crate::gpu::town::light::TownSource;

impl Images {
    /// Steps of a highlight: as a share of its width, per radian of the line, at most; widths at which it ends.
    pub(crate) const STEPS: [f32; 4] = [STEP, ANGLE_STEPS, MOST_STEPS, REACH];

    /// Balls, then the lines in them.
    pub(crate) fn sources(&self) -> impl Iterator<Item = TownSource> {
        let balls = self.balls.iter().map(|ball| TownSource {
            start: ball.centre.to_array(),
            share: ball.radius,
            ..TownSource::default()
        });
        let line = |light: &LineLight| TownSource {
            start: light.from.to_array(),
            share: light.visibility,
            end: light.to.to_array(),
            intensity: light.intensity,
            ..TownSource::default()
        };
        balls.chain(self.lines.iter().map(line))
    }
}
