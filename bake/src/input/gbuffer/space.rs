//! Whose axes and units places and normals have.

use crate::error::BakeError;
use squall_runtime::Camera;
use squall_runtime::glam::{DMat4, DVec3, DVec4, Vec3};
use squall_runtime::wet::frame::GBuffer;

/// A renderer's world: which axis is up, which hand it has, what its unit is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes {
    /// Whether y is up; z otherwise.
    pub y_up: bool,
    /// Whether it is left-handed: Unreal's and pbrt's worlds.
    pub left_handed: bool,
    /// Metres of its unit, above 0.
    pub metres: f64,
}

impl Axes {
    /// Squall's own: z up, right-handed, metres.
    pub const SQUALL: Self = Self { y_up: false, left_handed: false, metres: 1.0 };

    /// A direction in Squall's world.
    pub fn direction(self, v: DVec3) -> DVec3 {
        match (self.y_up, self.left_handed) {
            (false, false) => v,
            (false, true) => DVec3::new(v.x, -v.y, v.z),
            (true, false) => DVec3::new(v.x, -v.z, v.y),
            (true, true) => DVec3::new(v.x, v.z, v.y),
        }
    }

    /// A place in Squall's world, m.
    pub fn place(self, v: DVec3) -> DVec3 {
        self.direction(v) * self.metres
    }

    /// From Squall's world to this one's.
    pub fn from_squall(self) -> DMat4 {
        let column = |axis: DVec3| (self.direction(axis) / self.metres).extend(0.0);
        // A turn's inverse is its transpose; a scale's is its inverse.
        DMat4::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z), DVec4::W).transpose()
    }
}

/// What normals are measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NormalSpace {
    /// The world.
    World,
    /// The camera: x right, y up, z towards the eye.
    Camera,
    /// The same with z ahead, as left-handed renderers have it.
    CameraAhead,
}

impl NormalSpace {
    const ALL: [Self; 3] = [Self::World, Self::Camera, Self::CameraAhead];

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::World => "in the world",
            Self::Camera => "before the camera, z towards the eye",
            Self::CameraAhead => "before the camera, z ahead",
        }
    }

    fn turned(self, n: [f32; 3], camera: &Camera, axes: Axes) -> Vec3 {
        let v = Vec3::from_array(n).as_dvec3();
        let turned = match self {
            Self::World => axes.direction(v),
            Self::Camera => camera.right * v.x + camera.up * v.y - camera.forward * v.z,
            Self::CameraAhead => camera.right * v.x + camera.up * v.y + camera.forward * v.z,
        };
        turned.as_vec3()
    }
}

/// Normals of what depth shows, by the nearer neighbour across and down; zero beside the sky and where both are far.
pub fn normals_of_depth(buffer: &GBuffer, camera: &Camera) -> Vec<[f32; 3]> {
    let [width, height] = buffer.size;
    let mut out = vec![[0.0; 3]; width * height];
    for y in 0..height {
        for x in 0..width {
            let Some(here) = buffer.place(camera, x, y) else { continue };
            let step = |dx: isize, dy: isize| {
                let at = |sign: isize| {
                    let (x, y) = (x.checked_add_signed(sign * dx)?, y.checked_add_signed(sign * dy)?);
                    let inside = x < width && y < height;
                    inside
                        .then(|| buffer.place(camera, x, y))
                        .flatten()
                        .map(|place| (place - here) * sign as f64)
                };
                match (at(1), at(-1)) {
                    (Some(a), Some(b)) => Some(if a.length_squared() < b.length_squared() { a } else { b }),
                    (a, b) => a.or(b),
                }
            };
            let (Some(across), Some(down)) = (step(1, 0), step(0, 1)) else { continue };
            let Some(normal) = down.cross(across).try_normalize() else { continue };
            let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5).direction;
            let facing = if normal.dot(ray) > 0.0 { -normal } else { normal };
            out[y * width + x] = facing.as_vec3().to_array();
        }
    }
    out
}

/// Stored normals as unit vectors of Squall's world; `given` says what they are measured in, where somebody does. Returns them and the space that was
/// taken: that which agrees best with what depth shows. Values that all lie in 0 to 1 are colours of normals, (n + 1)/2.
pub fn normals(
    stored: &[[f32; 3]],
    (given, axes): (Option<bool>, Axes),
    (camera, shown): (&Camera, &[[f32; 3]]),
) -> (Vec<[f32; 3]>, NormalSpace, bool) {
    let finite = || stored.iter().filter(|n| n.iter().all(|v| v.is_finite()) && **n != [0.0; 3]);
    let is_coloured = finite().count() > 0
        && finite().flatten().all(|&v| (0.0..=1.0).contains(&v))
        && finite().filter(|n| (Vec3::from_array(**n).length() - 1.0).abs() > 0.05).count() * 2
            > finite().count();
    let decoded = |n: [f32; 3]| if is_coloured { n.map(|v| 2.0 * v - 1.0) } else { n };
    let candidates = NormalSpace::ALL.into_iter().filter(|space| match given {
        None => true,
        Some(true) => *space == NormalSpace::World,
        Some(false) => *space != NormalSpace::World,
    });
    let agreement = |space: NormalSpace| -> f64 {
        let pairs = stored.iter().zip(shown).filter(|(_, shown)| **shown != [0.0; 3]);
        let dot = pairs.filter_map(|(n, shown)| {
            let turned = space.turned(decoded(*n), camera, axes).try_normalize()?;
            Some(f64::from(turned.dot(Vec3::from_array(*shown))))
        });
        dot.sum()
    };
    let mut best = (NormalSpace::World, f64::NEG_INFINITY);
    for space in candidates {
        let score = agreement(space);
        // The world's is taken where nothing tells them apart.
        if score > best.1 + 1e-9 {
            best = (space, score);
        }
    }
    let turned = |n: &[f32; 3]| {
        best.0.turned(decoded(*n), camera, axes).try_normalize().unwrap_or(Vec3::ZERO).to_array()
    };
    (stored.iter().map(turned).collect(), best.0, is_coloured)
}

/// Planar depth of stored places, in the world or before the camera, whichever projects onto the pixels that hold them; and in words which it was.
///
/// Errors: neither does.
pub fn depth_of_places(
    stored: &[[f32; 3]],
    (camera, axes): (&Camera, Axes),
    path: &std::path::Path,
) -> Result<(Vec<f32>, &'static str), BakeError> {
    /// Pixels that a place may project beside its own: places are means over a pixel at edges, half floats are coarse.
    const NEAR_PX: f64 = 2.0;
    let view = |v: DVec3, ahead: f64| {
        camera.position
            + (camera.right * v.x + camera.up * v.y + camera.forward * (ahead * v.z)) * axes.metres
    };
    let spaces: [(&'static str, &dyn Fn(DVec3) -> DVec3); 3] = [
        ("in the world", &|v| axes.place(v)),
        ("before the camera, z towards the eye", &|v| view(v, -1.0)),
        ("before the camera, z ahead", &|v| view(v, 1.0)),
    ];
    let width = camera.width as usize;
    let real = |p: &[f32; 3]| p.iter().all(|v| v.is_finite()) && *p != [0.0; 3];
    let mut best = (0usize, 0usize);
    let step = (stored.len() / 4096).max(1);
    let tried = stored.iter().step_by(step).filter(|p| real(p)).count();
    for (number, (_, place)) in spaces.iter().enumerate() {
        let fits = (0..stored.len()).step_by(step).filter(|&i| real(&stored[i])).filter(|&i| {
            let here = DVec3::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5, 0.0).truncate();
            let seen = camera.project(place(Vec3::from_array(stored[i]).as_dvec3()));
            seen.is_some_and(|seen| seen.depth > 0.0 && seen.pixel.distance(here) < NEAR_PX)
        });
        let count = fits.count();
        if count > best.1 {
            best = (number, count);
        }
    }
    if 2 * best.1 < tried {
        let wanted =
            "places that the camera sees in their own pixels (another --up, --hand, --unit-m or --camera?)";
        let found = format!("{} of {tried} looked at", best.1);
        return Err(BakeError::input(path, "position", wanted, found));
    }
    let (words, place) = spaces[best.0];
    let depth = |p: &[f32; 3]| {
        if !real(p) {
            return f32::INFINITY;
        }
        let place = place(Vec3::from_array(*p).as_dvec3());
        ((place - camera.position).dot(camera.forward)) as f32
    };
    Ok((stored.iter().map(depth).collect(), words))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_worlds_up_is_up_and_its_hands_are_turned_right() {
        for (y_up, left_handed) in [(false, false), (false, true), (true, false), (true, true)] {
            let axes = Axes { y_up, left_handed, metres: 0.01 };
            let up = if y_up { DVec3::Y } else { DVec3::Z };
            assert_eq!(axes.direction(up), DVec3::Z);
            let hand = axes.direction(DVec3::X).cross(axes.direction(DVec3::Y)).dot(axes.direction(DVec3::Z));
            assert_eq!(hand, if left_handed { -1.0 } else { 1.0 });
            let place = DVec3::new(3.0, -4.0, 5.0);
            let back = axes.from_squall().transform_point3(axes.place(place));
            assert!((back - place).length() < 1e-12, "{axes:?} {back}");
        }
    }
}
