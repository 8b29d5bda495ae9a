//! Street lamps side by side, so that registers ask eight of them at once which matter to a spot.

use crate::shade::water::widest_spread;
use glam::Vec3;
use squall_formats::section::town::StreetLamp;

/// Lamps asked together.
pub(super) const LANES: usize = 8;

/// Some numbers of lamps, one each.
pub(super) type Each = [f32; LANES];

/// Eight lamps; those that are missing in the last eight have no light.
struct Eight {
    place: [Each; 3],
    /// Sum of the intensity's colours, W/sr.
    light: Each,
}

/// All lamps of a town, in their order.
pub(in super::super) struct LampLanes(Vec<Eight>);

impl LampLanes {
    pub fn new(lamps: &[StreetLamp]) -> Self {
        let eight = |lamps: &[StreetLamp]| {
            let each = |of: &dyn Fn(&StreetLamp) -> f32| -> Each {
                std::array::from_fn(|lane| lamps.get(lane).map_or(0.0, of))
            };
            let place = std::array::from_fn(|axis| each(&|lamp| lamp.position[axis]));
            Eight { place, light: each(&|lamp| lamp.intensity.iter().sum()) }
        };
        Self(lamps.chunks(LANES).map(eight).collect())
    }

    /// Sum of the colours of each lamp's irradiance on a spot, without shadow, W/m².
    pub fn irradiances(&self, point: Vec3, normal: Vec3) -> impl Iterator<Item = Each> {
        self.0.iter().map(move |Eight { place: [x, y, z], light }| {
            std::array::from_fn(|lane| {
                let way = [x[lane] - point.x, y[lane] - point.y, z[lane] - point.z];
                let squared = (way[0] * way[0] + way[1] * way[1] + way[2] * way[2]).max(1e-6);
                let along = normal.x * way[0] + normal.y * way[1] + normal.z * way[2];
                light[lane] * along.max(0.0) / (squared * squared.sqrt())
            })
        })
    }

    /// Whether each lamp may have a highlight on rippled water of this slope at a spot: where this is not above 0, it has none.
    pub fn highlights(
        &self,
        point: Vec3,
        normal: Vec3,
        to_viewer: Vec3,
        slope: f32,
    ) -> impl Iterator<Item = Each> {
        let most = widest_spread(slope);
        self.0.iter().map(move |Eight { place: [x, y, z], .. }| {
            std::array::from_fn(|lane| {
                let way = [x[lane] - point.x, y[lane] - point.y, z[lane] - point.z];
                let squared = (way[0] * way[0] + way[1] * way[1] + way[2] * way[2]).max(1e-4);
                let near = 1.0 / squared.sqrt();
                let half =
                    [way[0] * near + to_viewer.x, way[1] * near + to_viewer.y, way[2] * near + to_viewer.z];
                let height = normal.x * half[0] + normal.y * half[1] + normal.z * half[2];
                let long = half[0] * half[0] + half[1] * half[1] + half[2] * half[2];
                // The facet's tilt, tan² = long/height² − 1, against the steepest that shows anything.
                (1.0 + most) * height * height - long
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::shade::town::light::{SceneLight, irradiance};
    use crate::shade::water::rippled_highlight;

    #[test]
    fn lamps_side_by_side_have_the_light_of_each_and_no_highlight_is_missed() {
        /// Sums of single precision in another order.
        const ROUND_OFF: f32 = 1e-5;
        let mut random = Random::new(6);
        let mut place = |wide: f64| [0; 3].map(|_| random.range(-wide, wide) as f32);
        let lamps: Vec<StreetLamp> = (0..21)
            .map(|_| StreetLamp { position: place(60.0), intensity: place(9.0).map(f32::abs) })
            .collect();
        let lanes = LampLanes::new(&lamps);
        let (mut shown, mut hidden) = (0, 0);
        for i in 0..400 {
            let (point, normal) = (Vec3::from_array(place(40.0)), Vec3::from_array(place(1.0)).normalize());
            let to_viewer = Vec3::from_array(place(1.0)).normalize();
            let slope = [0.0, 0.01, 0.1, 0.3][i % 4];
            let own: Vec<f32> = lanes.irradiances(point, normal).flatten().collect();
            let may: Vec<f32> = lanes.highlights(point, normal, to_viewer, slope).flatten().collect();
            assert!(own[21..].iter().all(|&light| light == 0.0));
            for (number, lamp) in lamps.iter().enumerate() {
                let position = Vec3::from_array(lamp.position);
                let light = SceneLight { position, intensity: lamp.intensity, visibility: 1.0 };
                let wanted: f32 = irradiance(&light, point, normal).iter().sum();
                assert!((own[number] - wanted).abs() <= ROUND_OFF * wanted, "{} {wanted}", own[number]);
                let way = (position - point).normalize();
                let is_lit = rippled_highlight(normal, way, to_viewer, slope) > 0.0;
                assert!(may[number] > 0.0 || !is_lit, "{i} {number}");
                shown += usize::from(may[number] > 0.0);
                hidden += usize::from(may[number] <= 0.0);
            }
        }
        assert!(hidden > shown && shown > 100, "{hidden} {shown}");
    }
}
