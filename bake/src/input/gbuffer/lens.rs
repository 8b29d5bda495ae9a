//! The camera that a file's own attributes tell of.
//!
//! OpenEXR's standard has `worldToCamera` and `worldToNDC`, which Houdini, RenderMan and pbrt write, and `squall render`; Unreal's Movie Render
//! Queue writes place, turns and field of view as texts. Points are row vectors in the standard; pbrt writes columns. Which it is, the matrix
//! says itself: the camera's axes are perpendicular in one reading alone.

use super::planes::Contents;
use super::space::Axes;
use squall_formats::units::Radians;
use squall_runtime::Camera;
use squall_runtime::camera::{Projection, vertical_from_horizontal};
use squall_runtime::glam::{DMat3, DMat4, DVec2, DVec3, DVec4};

/// How far the axes of a matrix in single precision may be from perpendicular.
const SKEW: f64 = 2e-3;

/// The camera and where it is from.
pub fn camera_of(contents: &Contents<'_>, axes: Axes) -> Option<(Camera, &'static str)> {
    let [to_camera, to_screen] = contents.matrices();
    if let Some(camera) = to_screen.and_then(|matrix| from_screen(&matrix, axes, contents.size)) {
        return Some((camera, "worldToNDC"));
    }
    let width = contents.screen_width();
    if let Some((matrix, width)) = to_camera.zip(width)
        && let Some(camera) = from_axes(&matrix, (axes, f64::from(width)), contents)
    {
        return Some((camera, "worldToCamera and screenWindowWidth"));
    }
    unreal(contents, axes).map(|camera| (camera, "unreal/camera"))
}

/// Both readings of a matrix: rows of the file as rows, and as columns; from Squall's world.
fn readings(matrix: &[f32; 16], axes: Axes) -> [DMat4; 2] {
    let stored = DMat4::from_cols_array(&matrix.map(f64::from));
    // `from_cols_array` takes the file's rows for columns: points as row vectors.
    [stored * axes.from_squall(), stored.transpose() * axes.from_squall()]
}

fn from_screen(matrix: &[f32; 16], axes: Axes, size: [usize; 2]) -> Option<Camera> {
    readings(matrix, axes).into_iter().find_map(|matrix| of_projection(matrix, size))
}

/// The camera of a matrix from the world to normalised coordinates, −1 to 1 or 0 to 1 across the picture, y up or down.
fn of_projection(matrix: DMat4, [width, height]: [usize; 2]) -> Option<Camera> {
    let rows = matrix.transpose();
    let (x, y, w) = (rows.x_axis, rows.y_axis, rows.w_axis);
    let scale = w.truncate().length();
    if !(scale > 1e-12 && scale.is_finite()) {
        return None;
    }
    let [x, y, w]: [DVec4; 3] = [x / scale, y / scale, w / scale];
    let forward = w.truncate();
    let system = DMat3::from_cols(x.truncate(), y.truncate(), w.truncate()).transpose();
    let position = system.inverse() * -DVec3::new(x.w, y.w, w.w);
    let mut middle = DVec2::new(x.truncate().dot(forward), y.truncate().dot(forward));
    let (across, down) = (x.truncate() - forward * middle.x, y.truncate() - forward * middle.y);
    let (mut sx, mut sy) = (across.length(), down.length());
    let is_square = across.dot(down).abs() < SKEW * sx * sy;
    if !(position.is_finite() && sx > 1e-9 && sy > 1e-9 && is_square) {
        return None;
    }
    // Coordinates from 0 to 1 have their middle near ½.
    if (middle - 0.5).abs().max_element() < 0.25 {
        (sx, sy, middle) = (2.0 * sx, 2.0 * sy, 2.0 * middle - 1.0);
    }
    let right = across.normalize();
    let up = right.cross(forward).normalize();
    let upward = down.dot(up).signum();
    let half = DVec2::new(width as f64, height as f64) * 0.5;
    let camera = Camera {
        position,
        right: forward.cross(up).normalize(),
        up,
        forward: forward.normalize(),
        projection: Projection::Perspective { vertical_fov: Radians(2.0 * libm::atan(1.0 / sy)) },
        shift_px: DVec2::new(middle.x * half.x, -upward * middle.y * half.y),
        pixel_aspect: sx * half.x / (sy * half.y),
        width: width as u32,
        height: height as u32,
    };
    camera.check().ok().map(|()| camera)
}

/// The camera of a matrix from the world to axes before the camera, whose screen is `width` wide at distance 1.
fn from_axes(matrix: &[f32; 16], (axes, width): (Axes, f64), contents: &Contents<'_>) -> Option<Camera> {
    let size = contents.size.map(|count| count as u32);
    let affine = |matrix: &DMat4| (matrix.transpose().w_axis - DVec4::W).abs().max_element() < 1e-6;
    let matrix = readings(matrix, axes).into_iter().find(affine)?;
    let turn = DMat3::from_mat4(matrix).transpose();
    let position = DMat3::from_mat4(matrix).inverse() * -matrix.w_axis.truncate();
    // Before right-handed cameras z points back, before left-handed ones ahead.
    let ahead = if DMat3::from_mat4(matrix).determinant() > 0.0 { -1.0 } else { 1.0 };
    let aspect = f64::from(size[0]) * f64::from(contents.pixel_aspect()) / f64::from(size[1]);
    let fov = vertical_from_horizontal(Radians(2.0 * libm::atan(0.5 * width)), aspect);
    let projection = Projection::Perspective { vertical_fov: fov };
    Camera::new(position, turn.z_axis * ahead, turn.y_axis, projection, size).ok()
}

/// The camera of Unreal's Movie Render Queue: centimetres, degrees, x ahead, y right, z up, left-handed.
fn unreal(contents: &Contents<'_>, axes: Axes) -> Option<Camera> {
    let fields = ["unreal/camera", "unreal/layerData/rgba"];
    let number = |name: &str| {
        let text = fields.iter().find_map(|field| contents.text(&format!("{field}/{name}")))?;
        text.trim().parse::<f64>().ok().filter(|value| value.is_finite())
    };
    let place = DVec3::new(number("curPos/x")?, number("curPos/y")?, number("curPos/z")?);
    let [pitch, yaw, roll] = ["pitch", "yaw", "roll"].map(|name| number(&format!("curRot/{name}")));
    let (pitch, yaw, roll) = (pitch?.to_radians(), yaw?.to_radians(), roll.unwrap_or(0.0).to_radians());
    let lens = contents.attributes().find(|name| name.starts_with("unreal/") && name.ends_with("/fov"));
    let fov = lens.and_then(|name| contents.text(&name)?.trim().parse::<f64>().ok())?;
    let ((sin_p, cos_p), (sin_y, cos_y)) = (libm::sincos(pitch), libm::sincos(yaw));
    let forward = axes.direction(DVec3::new(cos_p * cos_y, cos_p * sin_y, sin_p));
    let size = contents.size.map(|count| count as u32);
    let aspect = f64::from(size[0]) / f64::from(size[1]);
    let vertical_fov = vertical_from_horizontal(Radians(fov.to_radians()), aspect);
    let projection = Projection::Perspective { vertical_fov };
    let up = axes.direction(DVec3::new(-sin_p * cos_y, -sin_p * sin_y, cos_p));
    let camera = Camera::new(axes.place(place), forward, up, projection, size).ok()?;
    // Unreal's roll turns the camera clockwise as it looks.
    Some(camera.rolled(Radians(-roll)))
}
