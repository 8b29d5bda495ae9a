//! What a town keeps dry: a drop is followed back along its own fall, exactly, with no map between.

use super::Town;
use super::hills::Hills;
use crate::rain::Shelter;
use glam::{DVec3, Vec3};

impl Shelter for Town {
    /// Nothing falls inside blocks, hills or the ground.
    fn reaches(&self, point: DVec3, velocity: DVec3) -> bool {
        let place = point.as_vec3();
        let ground = self.hills.as_ref().map_or(0.0, |hills| hills.height(place.truncate()));
        if place.z < ground {
            return false;
        }
        let back = if velocity.z < 0.0 { -velocity.as_vec3().normalize() } else { Vec3::Z };
        !self.boxes.is_covered(place, back)
            && self.hills.as_ref().is_none_or(|hills| hills.meet(place, back, f32::MAX).is_none())
    }

    fn top(&self) -> f64 {
        let hills = self.hills.as_ref().map(Hills::top);
        self.boxes.top().into_iter().chain(hills).map(f64::from).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The highest of blocks, masts and hills on the way; a hill where there is air below it: under one that rain falls onto more steeply than
    /// its slopes no ray goes.
    fn lid(&self, place: DVec3, velocity: DVec3, _: [f64; 2]) -> f64 {
        /// Heights that air is looked for at.
        const HEIGHTS: u32 = 12;
        let top = self.top();
        if top == f64::NEG_INFINITY {
            return top;
        }
        // Falls from above everything.
        let start = place + velocity * ((top + 1.0 - place.z) / velocity.z);
        let way = velocity.normalize().as_vec3();
        let block = self.boxes.meet(start.as_vec3(), way, f32::MAX).map(|hit| hit.distance);
        let limit = block.unwrap_or(f32::MAX);
        let hill = self.hills.as_ref().and_then(|hills| hills.meet(start.as_vec3(), way, limit));
        let Some(metres) = hill.map(|(metres, _)| metres).or(block) else { return f64::NEG_INFINITY };
        let lid = start.z + f64::from(metres * way.z);
        if hill.is_none() {
            return lid;
        }
        let is_air = |i: u32| {
            let z = lid * (f64::from(i) + 0.5) / f64::from(HEIGHTS);
            !self.is_solid((place + velocity * ((z - place.z) / velocity.z)).as_vec3())
        };
        if (0..HEIGHTS).any(is_air) { lid } else { f64::NEG_INFINITY }
    }
}

impl Town {
    /// Whether a point lies within blocks, hills or the ground.
    fn is_solid(&self, point: Vec3) -> bool {
        let ground = self.hills.as_ref().map_or(0.0, |hills| hills.height(point.truncate()));
        point.z < ground || self.boxes.holds(point)
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

    #[test]
    fn a_hill_keeps_off_what_it_has_a_lee_for_and_nothing_of_steeper_rain() {
        let town = small_town();
        // The ridge runs along y = 2100, 50 m high, 100 m to both sides.
        let over = |y: f64, fall: DVec3| town.lid(DVec3::new(500.0, y, 0.0), fall, [-100.0, 500.0]);
        for y in [2030.0, 2100.0, 2170.0] {
            assert_eq!(over(y, DVec3::new(0.0, 0.0, -6.0)), f64::NEG_INFINITY, "{y}");
        }
        // Rain flatter than the slope of a half: what would come down at y = 1950 meets (y − 1950)/4 = (2200 − y)/2.
        let flat = DVec3::new(0.0, -24.0, -6.0);
        let lid = over(1950.0, flat);
        assert!((lid - 125.0 / 3.0).abs() < 0.01, "{lid}");
        assert_eq!(over(1850.0, flat), f64::NEG_INFINITY);
        // Drops and medium agree on both sides of it.
        let at = |z: f64| DVec3::new(500.0, 1950.0, 0.0) + flat * (z / flat.z);
        assert!(!town.reaches(at(lid - 1.0), flat) && !town.reaches(at(5.0), flat));
        assert!(town.reaches(at(lid + 1.0), flat));
        // A tower's lid is its roof, or that of its mast, and it has a lee in wind.
        let tower = |fall: DVec3| town.lid(DVec3::new(0.0, 110.0, 0.0), fall, [-100.0, 500.0]);
        assert_eq!(tower(DVec3::new(0.0, 0.0, -6.0)), 70.0);
        assert!(town.lid(DVec3::new(0.0, 95.0, 0.0), DVec3::new(0.0, -6.0, -6.0), [-100.0, 500.0]) > 0.0);
    }
}
