//! Images of lights in panes of glass: where the eye sees a lamp, a channel or the sun in a wall's windows.
//!
//! A pane is a flat mirror. A light's image stands as far behind the wall as the light stands before it, as large and as bright as the
//! light itself at that distance but for Fresnel's share; it is seen where the way to it meets glass, and where nothing stands on
//! either part of that way. What is broad (sky, cloud, walls) is traced with the surface (`Town::pane`); lights without
//! breadth are narrower than the nodes of that, and are found here one by one.
//!
//! | symbol | quantity | unit |
//! |---|---|---|
//! | a, b | heights of eye and light over the wall's plane | m |
//! | t = a/(a + b) | share of the way from the eye to the image that lies before the wall | – |

use super::{Thing, Town};
use crate::camera::{Camera, Projection};
use crate::shade::water::{GLASS, fresnel_reflectance};
use glam::{DVec2, DVec3};

/// A wall with windows whose front the eye sees.
#[derive(Clone, Copy, Debug)]
pub struct PaneWall {
    block: usize,
    wall: u32,
    /// Middle of its face, m.
    middle: DVec3,
    normal: DVec3,
    /// Unit vector along it, level.
    side: DVec3,
    /// Half its length and half its height, m.
    half: DVec2,
}

/// A light's image in a pane.
#[derive(Clone, Copy, Debug)]
pub struct PaneImage {
    /// Where on the glass it is seen, m.
    pub at: DVec3,
    /// Where rays from there start, just off the glass, m.
    pub start: DVec3,
    /// Where it seems to stand, behind the wall, m.
    pub behind: DVec3,
    /// Share of the light that the glass sends on: Fresnel's, times what of the spot is glass.
    pub share: f32,
}

/// What a light at rest in the world is looked for with.
#[derive(Clone, Copy)]
pub struct PaneView<'a> {
    town: &'a Town,
    camera: &'a Camera,
}

impl PaneWall {
    fn height(&self, point: DVec3) -> f64 {
        (point - self.middle).dot(self.normal)
    }

    /// Where a point's image stands, m.
    pub fn behind(&self, point: DVec3) -> DVec3 {
        point - self.normal * (2.0 * self.height(point))
    }

    /// A direction after the glass.
    pub fn reflected(&self, direction: DVec3) -> DVec3 {
        direction - self.normal * (2.0 * direction.dot(self.normal))
    }

    /// Places on the wall, from its middle along it and up, m.
    fn on_wall(&self, point: DVec3) -> DVec2 {
        let off = point - self.middle;
        DVec2::new(off.dot(self.side), off.z)
    }

    /// The same eye on the other side of the wall: its rays are those that come back from the glass.
    pub fn mirrored_camera(&self, camera: &Camera) -> Camera {
        let [right, up, forward] = [camera.right, camera.up, camera.forward].map(|axis| self.reflected(axis));
        let position = self.behind(camera.position);
        Camera { position, right, up, forward, ..camera.clone() }
    }

    /// The direction in which the glass shows a distant light in direction `towards`, unit vectors; none where the wall turns its back on it.
    pub fn image_of_direction(&self, towards: DVec3) -> Option<DVec3> {
        (towards.dot(self.normal) > 0.0).then(|| self.reflected(towards))
    }

    /// Whether lights within `radius` of `centre` may be seen in this wall from `eye`.
    pub fn may_show(&self, eye: DVec3, centre: DVec3, radius: f64) -> bool {
        let (a, b) = (self.height(eye), self.height(centre));
        if b + radius <= 0.0 {
            return false;
        }
        if b - radius <= 0.0 {
            return true;
        }
        // Where the way from the mirrored eye to any point of the ball meets the plane: t moves by a r/((a + b)(a + b − r)) at most, the
        // point itself by r.
        let (start, way) = (self.on_wall(eye), self.on_wall(centre) - self.on_wall(eye));
        let nearest = a + b - radius;
        let slack = radius * a / nearest * (1.0 + way.length() / (a + b));
        let place = start + way * (a / (a + b));
        (place.abs() - self.half).max_element() <= slack
    }
}

impl<'a> PaneView<'a> {
    /// A town's panes as a camera sees them.
    pub fn new(town: &'a Town, camera: &'a Camera) -> Self {
        Self { town, camera }
    }

    /// Walls with windows that turn their face to the eye.
    pub fn walls(&self) -> Vec<PaneWall> {
        let mut walls = Vec::new();
        for (block, box_) in self.town.blocks.iter().enumerate().filter(|(_, block)| block.windows.is_some())
        {
            let (sin, cos) = libm::sincos(f64::from(box_.yaw));
            let axis = DVec3::new(cos, sin, 0.0);
            let axes = [axis, DVec3::new(-sin, cos, 0.0), -axis, DVec3::new(sin, -cos, 0.0)];
            let [x, y] = box_.half.map(f64::from);
            let foot = DVec2::from_array(box_.centre.map(f64::from)).extend(f64::from(box_.foot));
            let half_height = 0.5 * f64::from(box_.height);
            for (wall, normal) in axes.into_iter().enumerate() {
                let [deep, long] = if wall % 2 == 0 { [x, y] } else { [y, x] };
                let wall = PaneWall {
                    block,
                    wall: wall as u32,
                    middle: foot + normal * deep + DVec3::Z * half_height,
                    normal,
                    side: DVec3::new(-normal.y, normal.x, 0.0),
                    half: DVec2::new(long, half_height),
                };
                let faces = match self.camera.projection {
                    Projection::Perspective { .. } => wall.height(self.camera.position) > 0.0,
                    Projection::Orthographic { .. } => self.camera.forward.dot(normal) < 0.0,
                };
                if faces {
                    walls.push(wall);
                }
            }
        }
        walls
    }

    /// The eye that looks at a point.
    fn eye_of(&self, point: DVec3) -> DVec3 {
        let Camera { position, forward, .. } = *self.camera;
        match self.camera.projection {
            Projection::Perspective { .. } => position,
            Projection::Orthographic { .. } => point - forward * (point - position).dot(forward),
        }
    }

    /// The image of a light of some `radius`, m, in a wall's panes; none where there is no glass, or anything on the way.
    pub fn image(&self, wall: &PaneWall, light: DVec3, radius: f64) -> Option<PaneImage> {
        let b = wall.height(light);
        if b <= 0.0 {
            return None;
        }
        let behind = wall.behind(light);
        let eye = self.eye_of(behind);
        let a = wall.height(eye);
        let before = a / (a + b);
        let at = eye + (behind - eye) * before;
        if a <= 0.0 || (wall.on_wall(at).abs() - wall.half).max_element() > 0.0 {
            return None;
        }
        let image = self.seen(wall, eye, (behind - eye).normalize(), 2.0 * radius * before)?;
        let is_open = !self.town.is_blocked(image.start.as_vec3(), light.as_vec3());
        is_open.then_some(PaneImage { behind, ..image })
    }

    /// What the pane sends on that a ray of the eye meets in unit `direction`, over a pixel or `width` m if that is more; whether the light is
    /// open to it is not asked. `behind` is the glass itself.
    pub fn seen(&self, wall: &PaneWall, eye: DVec3, direction: DVec3, width: f64) -> Option<PaneImage> {
        let hit = self.town.trace(eye.as_vec3(), direction.as_vec3(), f32::MAX)?;
        let Thing::Block(block, Some(number), _) = hit.thing else { return None };
        if (block, number) != (wall.block, wall.wall) {
            return None;
        }
        let per_metre = self.camera.pixels_per_metre();
        let pixel = match self.camera.projection {
            Projection::Perspective { .. } => f64::from(hit.distance) / per_metre,
            Projection::Orthographic { .. } => 1.0 / per_metre,
        };
        let cosine = -direction.dot(wall.normal);
        let footprint = pixel.max(width) / cosine.max(0.01).sqrt();
        let glass = self.town.surface(&hit, footprint as f32).glass;
        let share = glass * fresnel_reflectance(cosine as f32, GLASS);
        let at = hit.point.as_dvec3();
        (share > 0.0).then(|| PaneImage { at, start: Town::lifted(&hit).as_dvec3(), behind: at, share })
    }

    /// Whether nothing of the town stands before the sky in unit direction `towards`.
    pub fn sees_sky(&self, start: DVec3, towards: DVec3) -> bool {
        self.town.sees(start.as_vec3(), towards.as_vec3())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::shade::town::tests::small_town;
    use squall_formats::units::Radians;

    fn camera(at: DVec3, towards: DVec3) -> Camera {
        let projection = Projection::Perspective { vertical_fov: Radians(0.9) };
        Camera::new(at, towards, DVec3::Z, projection, [320, 240]).unwrap()
    }

    /// The tower's south wall stands at y = 100, 10 m to both sides and 60 m high.
    fn south(view: &PaneView) -> PaneWall {
        view.walls().into_iter().find(|wall| wall.normal.y < -0.9).unwrap()
    }

    #[test]
    fn a_light_before_a_wall_is_seen_in_the_glass_that_its_mirrored_way_meets() {
        /// Single-precision rays over a hundred metres.
        const ROUND_OFF: f64 = 1e-3;
        let town = small_town();
        let camera = camera(DVec3::new(-30.0, 20.0, 5.0), DVec3::Y);
        let view = PaneView::new(&town, &camera);
        let wall = south(&view);
        let mut random = Random::new(5);
        let (mut seen, mut dark) = (0, 0);
        for _ in 0..600 {
            let light =
                DVec3::new(random.range(-30.0, 60.0), random.range(0.0, 99.0), random.range(0.5, 90.0));
            let Some(image) = view.image(&wall, light, 0.01) else {
                dark += 1;
                continue;
            };
            seen += 1;
            assert!(wall.may_show(camera.position, light, 0.5));
            assert!((image.at.y - 100.0).abs() < ROUND_OFF);
            assert!((image.behind - DVec3::new(light.x, 200.0 - light.y, light.z)).length() < ROUND_OFF);
            // Angles in and out are one, and the two ways are the image's distance.
            let [to_eye, to_light] = [camera.position, light].map(|end| (end - image.at).normalize());
            assert!((to_eye.y - to_light.y).abs() < ROUND_OFF && (to_eye.x + to_light.x).abs() < 1.0);
            let ways = camera.position.distance(image.at) + image.at.distance(light);
            assert!((ways - camera.position.distance(image.behind)).abs() < ROUND_OFF);
            let fresnel = f64::from(fresnel_reflectance(-to_light.dot(-wall.normal) as f32, GLASS));
            assert!(f64::from(image.share) <= fresnel * 1.001 && image.share > 0.0);
        }
        // Half of the wall is glass.
        assert!(seen > 30 && dark > 30, "{seen} {dark}");
    }

    #[test]
    fn what_stands_on_either_part_of_the_way_hides_an_image() {
        let town = small_town();
        let shown = |eye: DVec3, light: DVec3| {
            let camera = camera(eye, DVec3::Y);
            let view = PaneView::new(&town, &camera);
            // Some of the light's neighbours are seen in glass, wherever the frames are.
            let walls = view.walls();
            let near = |i: u32| light + DVec3::new(f64::from(i % 9) * 0.4, 0.0, f64::from(i / 9) * 0.4);
            (0..81).any(|i| walls.iter().any(|wall| view.image(wall, near(i), 0.01).is_some()))
        };
        let eye = DVec3::new(0.0, 20.0, 5.0);
        assert!(shown(eye, DVec3::new(2.0, 60.0, 10.0)));
        // Behind the tower, and behind the ground.
        assert!(!shown(eye, DVec3::new(2.0, 160.0, 10.0)));
        assert!(!shown(eye, DVec3::new(2.0, 60.0, -50.0)));
        // A second tower before the eye, and before the light.
        let second = squall_formats::section::town::Block {
            centre: [0.0, 40.0],
            half: [30.0, 1.0],
            ..town.blocks[0].clone()
        };
        let walled = small_town().with(Vec::new(), &[second]);
        let camera = camera(eye, DVec3::Y);
        let view = PaneView::new(&walled, &camera);
        let far = view.walls().into_iter().find(|wall| wall.block == 0 && wall.normal.y < -0.9).unwrap();
        let near = |i: u32| DVec3::new(2.0 + f64::from(i % 9) * 0.4, 70.0, 10.0 + f64::from(i / 9) * 0.4);
        assert!((0..81).all(|i| view.image(&far, near(i), 0.01).is_none()));
    }

    #[test]
    fn a_ball_that_a_wall_may_not_show_holds_no_light_that_it_shows() {
        let town = small_town();
        let camera = camera(DVec3::new(-30.0, 20.0, 5.0), DVec3::Y);
        let view = PaneView::new(&town, &camera);
        let mut random = Random::new(9);
        let (mut left_out, mut shown) = (0, 0);
        for _ in 0..3000 {
            let radius = random.range(0.1, 40.0);
            let centre = DVec3::new(
                random.range(-200.0, 300.0),
                random.range(-300.0, 150.0),
                random.range(0.0, 300.0),
            );
            let light = centre + random.direction() * random.range(0.0, radius);
            for wall in view.walls() {
                let may = wall.may_show(camera.position, centre, radius);
                let is_shown = view.image(&wall, light, 0.1).is_some();
                assert!(may || !is_shown, "{centre} {radius} {light}");
                left_out += u32::from(!may);
                shown += u32::from(is_shown);
            }
        }
        assert!(left_out > 1000 && shown > 10, "{left_out} {shown}");
    }
}
