use super::*;
use crate::picture::write_grey_exr;
use std::path::PathBuf;

/// Single precision.
const ROUND_OFF: f32 = 1e-6;
/// Metres of a scene, and nothing at one pixel.
const SCENE: [f64; 6] = [2.0, 4.0, 0.0, 8.0, 16.0, 40.0];

fn npy(descr: &str, data: Vec<u8>) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (2, 3)}}");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

fn png16(values: &[u16]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, 3, 2);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_be_bytes()).collect();
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&bytes).unwrap();
    writer.finish().unwrap();
    out
}

fn input(name: &str, bytes: Vec<u8>) -> Input {
    Input { path: PathBuf::from(name), bytes }
}

fn reading(form: DepthForm, scale: Option<f64>) -> DepthReading {
    DepthReading { form, scale, baseline_focal: 0.5 * 400.0 }
}

#[test]
fn every_form_of_depth_gives_the_same_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("z.exr");
    write_grey_exr(&path, 3, 2, &SCENE.map(|metres| metres as f32)).unwrap();
    let exr = input("z.exr", std::fs::read(path).unwrap());
    let f4 = npy("<f4", SCENE.iter().flat_map(|&v| (v as f32).to_le_bytes()).collect());
    let millimetres = npy("<f8", SCENE.iter().flat_map(|v| (v * 1000.0).to_le_bytes()).collect());
    let u2 = npy("<u2", SCENE.iter().flat_map(|&v| ((v * 100.0) as u16).to_le_bytes()).collect());
    let at = |scale: f64| png16(&SCENE.map(|metres| (metres * scale) as u16));
    let disparity = |scale: f64| SCENE.map(|metres| if metres > 0.0 { 200.0 / metres * scale } else { 0.0 });
    let png_disparity = png16(&disparity(256.0).map(|value| value as u16));
    let npy_disparity = npy("<f4", disparity(1.0).iter().flat_map(|&v| (v as f32).to_le_bytes()).collect());
    let planar = DepthForm::Planar;
    for (input, reading) in [
        (exr, reading(planar, None)),
        (input("f4.npy", f4), reading(planar, None)),
        (input("mm.npy", millimetres), reading(planar, Some(0.001))),
        (input("u2.npy", u2), reading(planar, Some(100.0))),
        (input("kitti.png", at(256.0)), reading(planar, Some(256.0))),
        (input("tum.png", at(1000.0)), reading(planar, Some(1000.0))),
        (input("disparity.png", png_disparity), reading(DepthForm::Disparity, Some(256.0))),
        (input("disparity.npy", npy_disparity), reading(DepthForm::Disparity, None)),
    ] {
        let found = depth_of(&input, &reading).unwrap();
        assert_eq!((found.width, found.height, found.kind), (3, 2, DepthKind::Planar));
        for (found, wanted) in found.metres.iter().zip(SCENE) {
            assert!(
                (found - wanted as f32).abs() <= ROUND_OFF * found,
                "{}: {found} {wanted}",
                input.path.display()
            );
        }
    }
    let ray = npy("<f4", SCENE.iter().flat_map(|&v| (v as f32).to_le_bytes()).collect());
    assert_eq!(
        depth_of(&input("r.npy", ray), &reading(DepthForm::Ray, None)).unwrap().kind,
        DepthKind::Range
    );
}

#[test]
fn sky_is_far_and_what_is_nothing_is_a_hole() {
    let values = [f32::INFINITY, f32::NAN, -1.0, 0.0, 3.0, f32::NEG_INFINITY];
    let bytes = npy("<f4", values.iter().flat_map(|v| v.to_le_bytes()).collect());
    let found = depth_of(&input("a.npy", bytes), &reading(DepthForm::Planar, None)).unwrap();
    assert_eq!(found.metres, [f32::INFINITY, 0.0, 0.0, 0.0, 3.0, 0.0]);
}

#[test]
fn what_is_no_depth_is_refused_with_what_would_be() {
    let refused = |name: &str, bytes: Vec<u8>, scale: Option<f64>, words: &str| {
        let error =
            depth_of(&input(name, bytes), &reading(DepthForm::Planar, scale)).unwrap_err().to_string();
        assert!(error.starts_with(name) && error.contains(words), "{error}");
    };
    refused("a.png", png16(&[1; 6]), None, "--depth-scale");
    refused("a.npy", npy("<u2", vec![1; 12]), None, "--depth-scale");
    refused("a.png", png16(&[1; 6]), Some(0.0), "above 0");
    refused("a.png", png16(&[1; 6]), Some(f64::NAN), "above 0");
    refused("a.png", png16(&[0; 6]), Some(256.0), "holes alone");
    refused("a.jpg", b"\xff\xd8\xff\xe0".to_vec(), None, "a JPEG picture");
    let mut eight = Vec::new();
    let mut encoder = png::Encoder::new(&mut eight, 3, 2);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&[9; 6]).unwrap();
    writer.finish().unwrap();
    refused("a.png", eight, Some(256.0), "8 bits, Grayscale");
    let whole = png16(&[700; 6]);
    for length in 8..whole.len() - 12 {
        let cut = input("a.png", whole[..length].to_vec());
        assert!(depth_of(&cut, &reading(DepthForm::Planar, Some(256.0))).is_err(), "{length}");
    }
}

#[test]
fn the_depth_among_an_exrs_channels_is_found_by_its_name() {
    let chosen = |names: &[&str]| {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        depth_channel(&names)
    };
    assert_eq!(chosen(&["B", "G", "R", "Z"]).as_deref(), Some("Z"));
    assert_eq!(chosen(&["ViewLayer.Combined.R", "ViewLayer.Depth.Z"]).as_deref(), Some("ViewLayer.Depth.Z"));
    assert_eq!(chosen(&["R", "depth.Z", "normal.X", "normal.Z"]).as_deref(), Some("depth.Z"));
    assert_eq!(chosen(&["Depth.V", "Image.R"]).as_deref(), Some("Depth.V"));
    assert_eq!(chosen(&["Y"]).as_deref(), Some("Y"));
    assert_eq!(chosen(&["distance"]).as_deref(), Some("distance"));
    assert_eq!(chosen(&["R", "G", "B"]), None);
    assert_eq!(chosen(&["a.Z", "b.Z"]), None);
}
