//! What a town keeps dry: a drop is followed back along its own fall, exactly, with no map between.

use super::Town;
use crate::rain::Shelter;
use glam::DVec3;

impl Shelter for Town {
    /// Nothing falls inside blocks, hills or the ground.
    fn reaches(&self, point: DVec3, velocity: DVec3) -> bool {
        let place = point.as_vec3();
        let ground = self.hills.as_ref().map_or(0.0, |hills| hills.height(place.truncate()));
        if place.z < ground {
            return false;
        }
        let back = if velocity.z < 0.0 { -velocity.as_vec3().normalize() } else { glam::Vec3::Z };
        !self.boxes.is_covered(place, back)
            && self.hills.as_ref().is_none_or(|hills| hills.meet(place, back, f32::MAX).is_none())
    }

    /// Of blocks and masts; what hills keep dry in a slanting rain counts as rained on.
    fn lid(&self, place: DVec3, velocity: DVec3, _: [f64; 2]) -> f64 {
        let Some(top) = self.boxes.top() else { return f64::NEG_INFINITY };
        // Falls from above everything.
        let start = place + velocity * ((f64::from(top) + 1.0 - place.z) / velocity.z);
        let way = velocity.normalize().as_vec3();
        let met = self.boxes.meet(start.as_vec3(), way, f32::MAX);
        met.map_or(f64::NEG_INFINITY, |hit| start.z + f64::from(hit.distance * way.z))
    }
}

#[cfg(test)]
mod tests {
    use crate::rain::Shelter;
    use crate::shade::town::tests::small_town;
    use glam::DVec3;

    #[test]
    fn rain_falls_beside_a_tower_and_not_in_it_nor_in_its_lee() {
        let town = small_town();
        let down = DVec3::new(0.0, 0.0, -6.0);
        // The tower stands over x −10…10, y 100…120, 60 m high.
        assert!(!town.reaches(DVec3::new(0.0, 110.0, 30.0), down));
        assert!(town.reaches(DVec3::new(8.0, 105.0, 60.1), down));
        assert!(town.reaches(DVec3::new(0.0, 90.0, 1.0), down));
        // Wind from the north carries drops in under 45° beyond the tower: its lee reaches 60 m south.
        let slanted = DVec3::new(0.0, -6.0, -6.0);
        assert!(!town.reaches(DVec3::new(0.0, 90.0, 1.0), slanted));
        assert!(!town.reaches(DVec3::new(0.0, 42.0, 1.0), slanted));
        assert!(town.reaches(DVec3::new(0.0, 39.0, 1.0), slanted));
        // A fast drop is steeper than a slow one in the same wind.
        let fast = DVec3::new(0.0, -6.0, -60.0);
        assert!(town.reaches(DVec3::new(0.0, 90.0, 1.0), fast));
        assert!(!town.reaches(DVec3::new(0.0, 0.0, -1.0), down));
    }
}
