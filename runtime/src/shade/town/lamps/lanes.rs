//! Street lamps side by side, so that registers ask eight of them at once which matter to a spot, and neighbours together, so that most
//! are never asked.

mod groups;

use crate::shade::water::widest_spread;
use glam::Vec3;
use groups::{Group, along_a_curve};
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
    /// The lamps' numbers in the town's order.
    numbers: [u32; LANES],
}

/// All lamps of a town, neighbours together.
pub(in super::super) struct LampLanes {
    eights: Vec<Eight>,
    groups: Vec<Group>,
}

/// Number of a lamp that is missing.
const NO_LAMP: u32 = u32::MAX;
/// Groups that together add less than this share of a spot's light are not asked: a tenth of what one lamp has to add.
const LEAST_OF_GROUPS: f32 = 0.1 * super::LEAST;

impl LampLanes {
    pub fn new(lamps: &[StreetLamp]) -> Self {
        let order = along_a_curve(lamps);
        let eight = |numbers: &[u32]| {
            let lamp = |lane: usize| numbers.get(lane).map(|&number| &lamps[number as usize]);
            let each = |of: &dyn Fn(&StreetLamp) -> f32| -> Each {
                std::array::from_fn(|lane| lamp(lane).map_or(0.0, of))
            };
            Eight {
                place: std::array::from_fn(|axis| each(&|lamp| lamp.position[axis])),
                light: each(&|lamp| lamp.intensity.iter().sum()),
                numbers: std::array::from_fn(|lane| numbers.get(lane).copied().unwrap_or(NO_LAMP)),
            }
        };
        let eights: Vec<Eight> = order.chunks(LANES).map(eight).collect();
        Self { eights, groups: Group::of(&order, lamps) }
    }

    fn members(&self, group: &Group) -> &[Eight] {
        &self.eights[group.eights.clone()]
    }

    /// Calls `visit` with numbers and sum of the colours of the irradiance, W/m², of those lamps whose own, without shadow, is above `least`
    /// of what a spot has: `so_far`, the sum of its colours from other lights, and that of all lamps that matter.
    pub fn each_above(
        &self,
        (point, normal): (Vec3, Vec3),
        (least, so_far): (f32, f32),
        mut visit: impl FnMut(usize, f32),
    ) {
        let own =
            |group: &Group| self.members(group).iter().map(|eight| (eight, eight.irradiance(point, normal)));
        let total = |group: &Group| own(group).map(|(_, own)| own.iter().sum::<f32>()).sum::<f32>();
        // The group that may be brightest tells what the others have to be measured against.
        let most = |group: &&Group| group.most_at(point);
        let Some(first) = self.groups.iter().max_by(|a, b| most(a).total_cmp(&most(b))) else { return };
        let faint = LEAST_OF_GROUPS * (so_far + total(first)) / self.groups.len() as f32;
        let asked = || self.groups.iter().filter(move |group| group.most_at(point) >= faint);
        let least = least * (so_far + asked().map(total).sum::<f32>());
        for (eight, own) in asked().flat_map(own) {
            for (number, own) in eight.numbers.into_iter().zip(own) {
                if own > least && number != NO_LAMP {
                    visit(number as usize, own);
                }
            }
        }
    }

    /// Calls `visit` with the number of each lamp that may have a highlight on rippled water of this slope at a spot; all others have
    /// none.
    pub fn each_in_water(
        &self,
        (point, normal): (Vec3, Vec3),
        to_viewer: Vec3,
        slope: f32,
        mut visit: impl FnMut(usize),
    ) {
        let place = super::super::line::Place { point, normal, to_viewer, slope };
        let most = widest_spread(slope);
        for group in self.groups.iter().filter(|group| group.may_shine(&place)) {
            for eight in self.members(group) {
                let may = eight.highlight(point, normal, to_viewer, most);
                for (number, may) in eight.numbers.into_iter().zip(may) {
                    if may > 0.0 && number != NO_LAMP {
                        visit(number as usize);
                    }
                }
            }
        }
    }
}

impl Eight {
    /// Sum of the colours of each lamp's irradiance on a spot, without shadow, W/m².
    fn irradiance(&self, point: Vec3, normal: Vec3) -> Each {
        let Self { place: [x, y, z], light, .. } = self;
        std::array::from_fn(|lane| {
            let way = [x[lane] - point.x, y[lane] - point.y, z[lane] - point.z];
            let squared = (way[0] * way[0] + way[1] * way[1] + way[2] * way[2]).max(1e-6);
            let along = normal.x * way[0] + normal.y * way[1] + normal.z * way[2];
            light[lane] * along.max(0.0) / (squared * squared.sqrt())
        })
    }

    /// Whether each lamp may have a highlight at a spot whose facets show anything up to a tilt of tan² `most`: where this is not above
    /// 0, it has none.
    fn highlight(&self, point: Vec3, normal: Vec3, to_viewer: Vec3, most: f32) -> Each {
        let [x, y, z] = &self.place;
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
    }
}

#[cfg(test)]
mod tests;
