use super::*;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds,
    Layer, LayerAttributes, Text, Vec2, WritableImage,
};
use squall_runtime::glam::{DMat4, DVec3, dcamera::rh};
use std::path::PathBuf;

/// Depth and places in single precision, m.
const ROUND_OFF: f64 = 1e-4;
/// The same of half floats, relative.
const HALF: f64 = 2e-3;
const SIZE: [usize; 2] = [20, 12];

fn camera() -> Camera {
    Camera::look_at(DVec3::new(1.0, -5.0, 2.0), DVec3::new(0.0, 4.0, 0.5), Radians(1.0), [20, 12]).unwrap()
}

use squall_formats::units::Radians;

/// The ground z = 0 as `camera` sees it: planar depth, places; sky above the horizon.
fn ground(camera: &Camera) -> (Vec<f32>, Vec<DVec3>) {
    let pixel = |i: usize| {
        let ray = camera.ray((i % SIZE[0]) as f64 + 0.5, (i / SIZE[0]) as f64 + 0.5);
        let distance = -ray.origin.z / ray.direction.z;
        let place = ray.origin + ray.direction * distance;
        if distance > 0.0 {
            ((place - ray.origin).dot(camera.forward) as f32, place)
        } else {
            (f32::INFINITY, DVec3::ZERO)
        }
    };
    (0..SIZE[0] * SIZE[1]).map(pixel).unzip()
}

type Channels = Vec<(String, FlatSamples)>;

fn floats(name: &str, values: impl IntoIterator<Item = f32>) -> (String, FlatSamples) {
    (name.into(), FlatSamples::F32(values.into_iter().collect()))
}

fn three(names: [&str; 3], values: &[[f32; 3]]) -> Channels {
    (0..3).map(|band| floats(names[band], values.iter().map(|value| value[band]))).collect()
}

fn layer(name: Option<&str>, channels: Channels, size: [usize; 2]) -> Layer<AnyChannels<FlatSamples>> {
    let list = channels.into_iter().map(|(name, samples)| AnyChannel::new(name.as_str(), samples)).collect();
    let attributes =
        LayerAttributes { layer_name: name.map(|name| name.into()), ..LayerAttributes::default() };
    Layer::new((size[0], size[1]), attributes, Encoding::SMALL_LOSSLESS, AnyChannels::sort(list))
}

fn file(layers: Vec<Layer<AnyChannels<FlatSamples>>>) -> Input {
    let bounds = IntegerBounds::from_dimensions(Vec2(SIZE[0], SIZE[1]));
    let image = Image::from_layers(ImageAttributes::new(bounds), layers);
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut bytes).unwrap();
    Input { path: PathBuf::from("frame.exr"), bytes: bytes.into_inner() }
}

fn colour(prefix: &str) -> Channels {
    let names = ["R", "G", "B"].map(|letter| format!("{prefix}{letter}"));
    let pixels: Vec<[f32; 3]> = (0..SIZE[0] * SIZE[1]).map(|i| [i as f32, 1.0, 0.5]).collect();
    three([&names[0], &names[1], &names[2]], &pixels)
}

fn given() -> Reading {
    Reading { camera: Some(camera()), ..Reading::default() }
}

fn depths_agree(found: &[f32], tolerance: f64) {
    for (found, wanted) in found.iter().zip(ground(&camera()).0) {
        let agree = found == &wanted || (f64::from(*found) / f64::from(wanted) - 1.0).abs() < tolerance;
        assert!(agree, "{found} {wanted}");
    }
}

#[test]
fn blenders_layers_are_found_in_one_part_and_in_many() {
    let (depth, _) = ground(&camera());
    let stored: Vec<f32> = depth.iter().map(|&d| if d.is_finite() { d } else { 1e10 }).collect();
    let up = vec![[0.0, 0.0, 1.0]; depth.len()];
    let mut all = colour("ViewLayer.Combined.");
    all.push(floats("ViewLayer.Depth.V", stored.clone()));
    all.extend(three(["ViewLayer.Normal.X", "ViewLayer.Normal.Y", "ViewLayer.Normal.Z"], &up));
    all.extend(three(
        ["ViewLayer.DiffCol.R", "ViewLayer.DiffCol.G", "ViewLayer.DiffCol.B"],
        &vec![[0.25; 3]; depth.len()],
    ));
    let one = read_gbuffer(&file(vec![layer(None, all, SIZE)]), &given()).unwrap();
    assert_eq!(one.writer, Writer::Blender);
    depths_agree(&one.buffer.depth_m, ROUND_OFF);
    assert_eq!(one.buffer.albedo.as_ref().unwrap()[7], [0.25; 3]);
    assert_eq!(one.buffer.colour[7], [7.0, 1.0, 0.5]);
    let parts = vec![
        layer(Some("ViewLayer.Combined"), colour(""), SIZE),
        layer(Some("ViewLayer.Depth"), vec![floats("Z", stored)], SIZE),
        layer(Some("ViewLayer.Normal"), three(["X", "Y", "Z"], &up), SIZE),
    ];
    let many = read_gbuffer(&file(parts), &given()).unwrap();
    assert_eq!(many.buffer.depth_m, one.buffer.depth_m);
    assert_eq!(many.buffer.normal, one.buffer.normal);
    assert!(many.notes.iter().any(|note| note.starts_with("no albedo")));
    let named: Vec<_> = many.found.iter().map(|(role, name)| (role.name(), name.as_str())).collect();
    assert_eq!(
        named,
        [("colour", "ViewLayer.Combined"), ("depth", "ViewLayer.Depth"), ("normal", "ViewLayer.Normal")]
    );
}

#[test]
fn unreals_centimetres_left_hand_and_camera_are_read_from_its_own_attributes() {
    // A camera that looks along Unreal's +y, which is Squall's −y, turned down.
    let pitch = -0.2f64;
    let eye = DVec3::new(1.0, 5.0, 2.0);
    let forward = DVec3::new(0.0, -libm::cos(pitch), libm::sin(pitch));
    let fov = squall_runtime::camera::vertical_from_horizontal(Radians(1.2), 20.0 / 12.0);
    let wanted = Camera::look_at(eye, eye + forward, fov, [20, 12]).unwrap();
    let (depth, _) = ground(&wanted);
    let half = |d: f32| half::f16::from_f32(if d.is_finite() { 100.0 * d } else { 65_504.0 });
    let mut all = colour("");
    all.push((
        "FinalImageMovieRenderQueue_WorldDepth.R".into(),
        FlatSamples::F16(depth.iter().map(|&d| half(d)).collect()),
    ));
    let mut part = layer(None, all, SIZE);
    let texts = [
        ("unreal/camera/curPos/x", 100.0),
        ("unreal/camera/curPos/y", -500.0),
        ("unreal/camera/curPos/z", 200.0),
        ("unreal/camera/curRot/pitch", pitch.to_degrees()),
        ("unreal/camera/curRot/yaw", 90.0),
        ("unreal/camera/curRot/roll", 0.0),
        ("unreal/camera/FinalImage/fov", 1.2f64.to_degrees()),
    ];
    for (name, value) in texts {
        let value = AttributeValue::Text(Text::from(value.to_string().as_str()));
        part.attributes.other.insert(Text::from(name), value);
    }
    let taken = read_gbuffer(&file(vec![part]), &Reading::default()).unwrap();
    assert_eq!((taken.writer, taken.camera_from), (Writer::Unreal, "unreal/camera"));
    assert!((taken.camera.position - eye).length() < ROUND_OFF, "{}", taken.camera.position);
    assert!((taken.camera.forward - forward).length() < ROUND_OFF && taken.camera.right.x < -0.999);
    for (found, wanted) in taken.buffer.depth_m.iter().zip(&depth) {
        assert!(found == wanted || f64::from(found / wanted - 1.0).abs() < HALF, "{found} {wanted}");
    }
}

#[test]
fn pbrts_places_before_the_camera_give_depth_and_its_normals_are_turned() {
    let camera = camera();
    let (depth, places) = ground(&camera);
    let before =
        |v: DVec3| [v.dot(camera.right) as f32, v.dot(camera.up) as f32, v.dot(camera.forward) as f32];
    let stored: Vec<[f32; 3]> = places
        .iter()
        .zip(&depth)
        .map(|(place, depth)| if depth.is_finite() { before(*place - camera.position) } else { [0.0; 3] })
        .collect();
    let mut all = colour("");
    all.extend(three(["P.X", "P.Y", "P.Z"], &stored));
    all.extend(three(["Ns.X", "Ns.Y", "Ns.Z"], &vec![before(DVec3::Z); depth.len()]));
    all.push(floats("dzdx", vec![0.0; depth.len()]));
    let taken = read_gbuffer(&file(vec![layer(None, all, SIZE)]), &given()).unwrap();
    assert_eq!(taken.writer, Writer::Pbrt);
    depths_agree(&taken.buffer.depth_m, ROUND_OFF);
    let ground = taken.buffer.depth_m.iter().position(|depth| depth.is_finite()).unwrap();
    assert!((f64::from(taken.buffer.normal[ground][2]) - 1.0).abs() < ROUND_OFF);
    assert!(taken.notes.iter().any(|note| note.contains("z ahead")), "{:?}", taken.notes);
}

#[test]
fn a_files_own_matrix_gives_the_camera_back_whichever_way_it_is_written() {
    let camera = Camera { shift_px: squall_runtime::glam::DVec2::new(1.5, -0.75), ..camera() };
    let lens = rh::proj::directx::perspective_infinite_reverse(1.0, 20.0 / 12.0, 0.1);
    let whole = camera.projection_matrix(0.1) * camera.view_matrix();
    let unit = DMat4::from_translation(DVec3::splat(0.5)) * DMat4::from_scale(DVec3::splat(0.5));
    let tilted = Axes { y_up: true, ..Axes::SQUALL };
    for (matrix, axes) in [
        (whole, Axes::SQUALL),
        (whole.transpose(), Axes::SQUALL),
        ((unit * whole).transpose(), Axes::SQUALL),
        (whole * tilted.from_squall().inverse(), tilted),
    ] {
        let (depth, _) = ground(&camera);
        let mut all = colour("");
        all.push(floats("Z", depth));
        let mut part = layer(None, all, SIZE);
        part.attributes.world_to_normalized_device = Some(matrix.to_cols_array().map(|v| v as f32));
        let reading = Reading { y_up: Some(axes.y_up), ..Reading::default() };
        let found = read_gbuffer(&file(vec![part]), &reading).unwrap().camera;
        assert!((found.position - camera.position).length() < 1e-3, "{}", found.position);
        let place = DVec3::new(0.4, 6.0, 1.0);
        let off = found.project(place).unwrap().pixel - camera.project(place).unwrap().pixel;
        assert!(off.length() < 1e-3, "{off}");
    }
    let _ = lens;
}

#[test]
fn normals_come_from_depth_where_there_are_none_and_where_they_are_zero_or_no_number() {
    let (depth, _) = ground(&camera());
    let mut all = colour("");
    all.push(floats("Z", depth.clone()));
    let without = read_gbuffer(&file(vec![layer(None, all.clone(), SIZE)]), &given()).unwrap();
    let lit = |i: usize| without.buffer.depth_m[i].is_finite();
    assert!((0..depth.len()).filter(|i| lit(*i)).all(|i| without.buffer.normal[i][2] > 0.999));
    let mut normals = vec![[0.0, 0.0, 1.0]; depth.len()];
    let low = depth.len() - 3;
    (normals[low], normals[low - 1]) = ([0.0; 3], [f32::NAN; 3]);
    all.extend(three(["N.x", "N.y", "N.z"], &normals));
    let mended = read_gbuffer(&file(vec![layer(None, all, SIZE)]), &given()).unwrap();
    assert!(mended.buffer.normal[low][2] > 0.999 && mended.buffer.normal[low - 1][2] > 0.999);
    assert!(
        mended.notes.iter().any(|note| note.starts_with("2 pixels without a normal")),
        "{:?}",
        mended.notes
    );
}

#[test]
fn what_cannot_be_done_without_is_refused_by_name() {
    let (depth, _) = ground(&camera());
    let refused = |layers: Vec<Layer<AnyChannels<FlatSamples>>>, reading: &Reading, wanted: &str| {
        let words = read_gbuffer(&file(layers), reading).unwrap_err().to_string();
        assert!(words.contains(wanted), "{words}");
    };
    let with = |more: Channels| {
        let mut all = colour("");
        all.extend(more);
        vec![layer(None, all, SIZE)]
    };
    refused(with(vec![]), &given(), "depth: wanted a layer of depth or of places");
    refused(vec![layer(None, vec![floats("Z", depth.clone())], SIZE)], &given(), "colour: wanted");
    refused(with(vec![floats("Z", depth.clone())]), &Reading::default(), "camera: wanted a camera");
    refused(with(vec![floats("Z", vec![f32::NAN; depth.len()])]), &given(), "sky and holes alone");
    let named = Reading { layers: vec![(Role::Albedo, "wood".into())], ..given() };
    refused(
        with(vec![floats("Z", depth.clone())]),
        &named,
        "--layer albedo: wanted a layer with three channels",
    );
    let small = vec![
        layer(Some("rgba"), colour(""), SIZE),
        layer(Some("depth"), vec![floats("Z", vec![1.0; 60])], [10, 6]),
    ];
    refused(small, &given(), "the window of rgba.R, 20 × 12");
    let mut broken = colour("");
    broken[1] = floats("G", vec![f32::NAN; depth.len()]);
    broken.push(floats("Z", depth.clone()));
    refused(vec![layer(None, broken, SIZE)], &given(), "colour, pixel (0, 0): wanted finite samples");
    let whole = file(with(vec![floats("Z", depth)]));
    for cut in [10, 200, whole.bytes.len() / 2, whole.bytes.len() - 1] {
        let part = Input { bytes: whole.bytes[..cut].to_vec(), ..whole.clone() };
        assert!(read_gbuffer(&part, &given()).is_err(), "{cut}");
    }
}

#[test]
fn a_window_smaller_than_the_picture_leaves_the_rest_to_the_sky() {
    let (depth, _) = ground(&camera());
    let crop = |values: &[f32]| -> Vec<f32> {
        (0..6).flat_map(|y| (0..10).map(move |x| (x, y))).map(|(x, y)| values[(y + 5) * 20 + x + 4]).collect()
    };
    let mut all: Channels = ["R", "G", "B"].iter().map(|name| floats(name, vec![0.5; 60])).collect();
    all.push(floats("Z", crop(&depth)));
    let mut part = layer(None, all, [10, 6]);
    part.attributes.layer_position = Vec2(4, 5);
    let taken = read_gbuffer(&file(vec![part]), &given()).unwrap();
    assert_eq!(taken.buffer.size, SIZE);
    assert_eq!(taken.buffer.depth_m[7 * 20 + 6], depth[7 * 20 + 6]);
    assert!(taken.buffer.depth_m[0].is_nan() && taken.buffer.colour[0] == [0.0; 3]);
    assert_eq!(taken.buffer.colour[7 * 20 + 6], [0.5; 3]);
}
