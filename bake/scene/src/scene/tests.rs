use super::*;
use crate::write::{GlbWriter, Part};
use proptest::prelude::*;
use serde_json::{Value, json};

/// Single precision, a few operations.
const ROUND_OFF: f32 = 1e-5;

/// Two triangles, one of which stands upright, a lamp, two materials.
fn sample() -> Vec<u8> {
    let mut writer = GlbWriter::new(683.0);
    let grey =
        writer.material(&Material { name: "grey".into(), base: [0.5, 0.25, 0.125], ..Material::default() });
    let neon =
        Material { name: "neon".into(), emission: [0.5, 2.0, 1.0], two_sided: true, ..Material::default() };
    let neon = writer.material(&neon);
    let parts = [
        Part {
            places: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]],
            normals: vec![[0.0, 0.0, 1.0]; 3],
            corners: vec![[0, 1, 2]],
            material: grey,
        },
        Part {
            places: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 4.0]],
            corners: vec![[0, 1, 2]],
            material: neon,
            ..Part::default()
        },
    ];
    let mesh = writer.mesh("two", &parts);
    writer.place("here", mesh, DVec3::new(10.0, 20.0, 30.0), 0.0);
    writer.place("turned", mesh, DVec3::ZERO, std::f64::consts::FRAC_PI_2);
    writer.lamp(&Lamp {
        name: "lamp".into(),
        position_m: DVec3::new(1.0, 2.0, 3.0),
        power: [10.0, 5.0, 1.0],
        kind: LampKind::Spot { direction: DVec3::new(0.6, 0.0, -0.8), cosines: [0.9, 0.5] },
    });
    writer.finish("test")
}

fn none(name: &str, _: u64) -> Result<Vec<u8>, SceneError> {
    Err(SceneError::input(name, "a file", "none"))
}

fn read(bytes: &[u8]) -> Result<Scene, SceneError> {
    let how = Read { normals: true, second_uv: true, ..Read::default() };
    Scene::read(bytes, &mut none, &how)
}

/// The sample's JSON, changed, with its binary chunk as base64.
fn changed(change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let glb = sample();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let mut root: Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    let digits = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::from("data:application/octet-stream;base64,");
    for group in glb[28 + length..].chunks(3) {
        let word = group.iter().enumerate().fold(0u32, |w, (k, b)| w | u32::from(*b) << (16 - 8 * k));
        for place in 0..=group.len() {
            text.push(digits[(word >> (18 - 6 * place) & 63) as usize] as char);
        }
    }
    root["buffers"][0]["uri"] = text.into();
    change(&mut root);
    root.to_string().into_bytes()
}

fn refused(bytes: &[u8], words: &str) {
    let error = read(bytes).expect_err(words).to_string();
    assert!(error.contains(words), "{words}: {error}");
}

#[test]
fn what_was_written_stands_where_it_stood_z_up_and_in_watts() {
    for bytes in [sample(), changed(|_| ())] {
        let scene = read(&bytes).unwrap();
        assert_eq!((scene.report.triangles, scene.report.instances, scene.report.left_out()), (4, 2, None));
        let close = |a: Vec3, b: [f32; 3]| a.distance(Vec3::from_array(b)) < ROUND_OFF;
        assert!(close(scene.triangles[0][2], [10.0, 23.0, 30.0]), "{:?}", scene.triangles[0]);
        assert!(close(scene.triangles[1][2], [10.0, 20.0, 34.0]));
        // A quarter turn to the left takes x to y.
        assert!(close(scene.triangles[2][1], [0.0, 2.0, 0.0]), "{:?}", scene.triangles[2]);
        assert!(close(scene.normals[0][1], [0.0, 0.0, 1.0]) && scene.normals[1][0] == Vec3::ZERO);
        assert_eq!(scene.base(0), [0.5, 0.25, 0.125]);
        let neon = &scene.materials[scene.material[1] as usize];
        for (found, wanted) in neon.emission.iter().zip([0.5, 2.0, 1.0]) {
            assert!((found - wanted).abs() < 1e-4 * wanted, "{found} for {wanted}");
        }
        let lamp = &scene.lamps[0];
        assert!(
            (lamp.power[1] - 5.0).abs() < 1e-4 && lamp.position_m.distance(DVec3::new(1.0, 2.0, 3.0)) < 1e-6
        );
        let LampKind::Spot { direction, cosines } = lamp.kind else { panic!("{:?}", lamp.kind) };
        assert!(direction.distance(DVec3::new(0.6, 0.0, -0.8)) < 1e-6 && (cosines[1] - 0.5).abs() < 1e-5);
    }
}

#[test]
fn instances_sparse_places_strips_and_small_integers_are_read() {
    let bytes = changed(|root| {
        // The mesh's first triangle, three times along x: instances take their places from the triangle's own.
        root["nodes"][0]["extensions"] =
            json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": 0 } } });
        root["meshes"][0]["primitives"][1]["mode"] = 5.into();
        root["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    });
    let scene = read(&bytes).unwrap();
    assert_eq!((scene.report.triangles, scene.report.instances), (8, 4));
    let far = scene.triangles.iter().flatten().map(|corner| corner.y).fold(0.0, f32::max);
    assert!((far - 26.0).abs() < ROUND_OFF, "{far}");

    let sparse = changed(|root| {
        let count = root["accessors"][0]["count"].clone();
        let indices = root["accessors"][2].clone();
        root["accessors"][0] = json!({
            "componentType": 5126, "count": count, "type": "VEC3", "min": [0, 0, 0], "max": [0, 0, 0],
            "sparse": {
                "count": 3,
                "indices": { "bufferView": indices["bufferView"], "componentType": 5123 },
                "values": { "bufferView": root["accessors"][0]["bufferView"] },
            },
        });
    });
    assert_eq!(read(&sparse).unwrap().triangles, read(&sample()).unwrap().triangles);
}

#[test]
fn triangles_without_area_are_counted_and_a_scene_of_them_is_refused() {
    let squashed = |axis: usize| {
        changed(move |root| {
            for node in [0, 1] {
                root["nodes"][node]["scale"] = json!([1.0, 1.0, 1.0]);
                root["nodes"][node]["scale"][axis] = 0.0.into();
            }
        })
    };
    // glTF's z is our y: the triangle that lies loses its area, the one that stands keeps it.
    let scene = read(&squashed(2)).unwrap();
    assert_eq!((scene.report.triangles, scene.report.degenerate), (2, 2));
    assert!(scene.report.left_out().unwrap().contains("2 triangles without area"));
    refused(&squashed(0), "at least one triangle, found none with an area (4 without)");
    refused(&changed(|root| root["scenes"][0]["nodes"] = json!([2])), "at least one triangle, found none");
}

#[test]
fn contradictions_and_demands_without_measure_are_refused_by_place() {
    type Spoil = fn(&mut Value);
    let spoils: [(&str, Spoil); 18] = [
        ("asset.version", |r| r["asset"]["version"] = "1.0".into()),
        ("KHR_draco_mesh_compression", |r| r["extensionsRequired"] = json!(["KHR_draco_mesh_compression"])),
        ("buffers[0]", |r| r["buffers"][0]["byteLength"] = 1_000_000.into()),
        ("buffers[0].uri", |r| r["buffers"][0]["uri"] = "data:,x".into()),
        ("a file beside the scene", |r| r["buffers"][0]["uri"] = "http://example.org/x.bin".into()),
        ("x y.bin", |r| r["buffers"][0]["uri"] = "x%20y.bin".into()),
        ("bufferViews[0]", |r| r["bufferViews"][0]["byteOffset"] = u64::MAX.into()),
        ("bufferViews[0]", |r| r["bufferViews"][0]["buffer"] = 7.into()),
        ("accessors[0]", |r| r["accessors"][0]["count"] = u64::MAX.into()),
        ("accessors[0]", |r| r["accessors"][0]["count"] = 1_000.into()),
        ("accessors[0]", |r| r["accessors"][0]["type"] = "VEC2".into()),
        ("accessors[0]", |r| r["accessors"][0]["byteOffset"] = (u64::MAX - 3).into()),
        ("meshes[9]", |r| r["nodes"][0]["mesh"] = 9.into()),
        (".material", |r| r["meshes"][0]["primitives"][0]["material"] = 2.into()),
        ("nodes[0]: wanted one parent", |r| r["nodes"][0]["children"] = json!([1, 0])),
        ("nodes[77]", |r| r["nodes"][0]["children"] = json!([77])),
        ("nodes[0]", |r| r["nodes"][0]["translation"] = json!([1e30, 0.0, 0.0])),
        ("lights[0]", |r| {
            r["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] = json!(-1.0);
        }),
    ];
    for (words, spoil) in spoils {
        refused(&changed(spoil), words);
    }
    refused(&changed(|r| r["accessors"][2]["componentType"] = 5126.into()), "accessors[2]");
    refused(b"{}", "glTF JSON");
    refused(b"\x89PNG\r\n\x1a\n", "a file that starts with");
    refused(&sample()[..40], "glb");
    let few = Limits { triangles: 3, ..Limits::default() };
    let error = Scene::read(&sample(), &mut none, &Read { limits: few, ..Read::default() }).unwrap_err();
    assert!(error.to_string().contains("at most 3 triangles"), "{error}");
}

#[test]
fn textures_wrap_beyond_their_edges_and_give_triangles_their_mean() {
    // Two texels, black and white; a triangle that lies in the white one twice around the texture.
    let mut picture = Vec::new();
    let mut encoder = png::Encoder::new(&mut picture, 2, 1);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().unwrap().write_image_data(&[0, 255]).unwrap();
    let bytes = changed(|root| {
        root["images"] = json!([{ "uri": "checks.png" }]);
        root["textures"] = json!([{ "source": 0 }]);
        root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
        // Coordinates from the places: x, up to 2 and across both texels.
        let places = root["accessors"][0].clone();
        let mut uv = places.clone();
        uv["type"] = "VEC2".into();
        let offset = root["bufferViews"][0]["byteOffset"].clone();
        root["bufferViews"].as_array_mut().unwrap().push(json!({
            "buffer": 0, "byteOffset": offset, "byteLength": 36, "byteStride": 12,
        }));
        uv["bufferView"] = (root["bufferViews"].as_array().unwrap().len() - 1).into();
        root["accessors"].as_array_mut().unwrap().push(uv);
        let last = root["accessors"].as_array().unwrap().len() - 1;
        root["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = last.into();
    });
    let mut beside = |name: &str, _: u64| {
        assert_eq!(name, "checks.png");
        Ok(picture.clone())
    };
    let scene = Scene::read(&bytes, &mut beside, &Read::default()).unwrap();
    // Of a triangle that covers the texture twice over, 6 of 16 parts lie in white texels and 10 in black ones.
    let share = f32::from(scene.paint[0][0]) / 255.0;
    assert!((share * share - 6.0 / 16.0).abs() < 0.01, "{share}");
    assert_eq!(scene.paint[1], [255; 3]);
    let mut other = |_: &str, _: u64| Ok(b"GIF89a".to_vec());
    let report = Scene::read(&bytes, &mut other, &Read::default()).unwrap().report;
    assert!(report.left_out().unwrap().contains("neither PNG nor JPEG"));
}

/// A picture of 4 × 1 texels: white, black, black, black.
fn one_in_four() -> Vec<u8> {
    let mut picture = Vec::new();
    let mut encoder = png::Encoder::new(&mut picture, 4, 1);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().unwrap().write_image_data(&[255, 0, 0, 0]).unwrap();
    picture
}

#[test]
fn a_picture_of_many_materials_is_read_once_and_counts_once() {
    let bytes = changed(|root| {
        root["images"] = json!([{ "uri": "a.png" }, { "uri": "b.png" }]);
        root["textures"] = json!([{ "source": 0 }, { "source": 1 }]);
        let mut material = root["materials"][0].clone();
        material["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
        root["materials"] = vec![material; 200].into();
        root["materials"][199]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 1 });
    });
    let picture = one_in_four();
    let mut names = Vec::new();
    let mut read = |pixels: u64, bytes_allowed: u64| {
        names.clear();
        let mut beside = |name: &str, _: u64| {
            names.push(name.to_owned());
            Ok(picture.clone())
        };
        let limits = Limits { pixels, bytes: bytes_allowed, ..Limits::default() };
        let scene = Scene::read(&bytes, &mut beside, &Read { limits, ..Read::default() });
        (scene.map(|scene| scene.report.unread_textures), names.clone())
    };
    assert_eq!(read(8, 1 << 20), (Ok(Vec::new()), vec!["a.png".to_owned(), "b.png".to_owned()]));
    let unread = read(7, 1 << 20).0.unwrap();
    assert_eq!(unread, ["images[1]: 4 × 1 pixels, where all textures may have 3 more"]);
    let unread = read(3, 1 << 20).0.unwrap();
    assert_eq!(unread.len(), 2, "{unread:?}");
    // What the buffers and one picture take leaves too little for the other.
    let buffers =
        serde_json::from_slice::<Value>(&bytes).unwrap()["buffers"][0]["byteLength"].as_u64().unwrap();
    let error = read(8, buffers + 3 + picture.len() as u64).0.unwrap_err().to_string();
    assert!(error.contains("bytes in all buffers and pictures"), "{error}");
}

#[test]
fn emission_behind_a_texture_is_the_mean_of_all_its_texels_however_it_is_looked_up() {
    let picture = one_in_four();
    let transform = json!({ "KHR_texture_transform": { "scale": [0.1, 0.1], "offset": [0.7, 0.0] } });
    for (mode, extensions) in [(10_497, json!({})), (33_071, json!({})), (33_648, transform)] {
        let bytes = changed(|root| {
            root["images"] = json!([{ "uri": "a.png" }]);
            root["samplers"] = json!([{ "wrapS": mode, "wrapT": mode }]);
            root["textures"] = json!([{ "source": 0, "sampler": 0 }]);
            root["materials"][1]["emissiveTexture"] = json!({ "index": 0, "extensions": extensions });
        });
        let scene = Scene::read(&bytes, &mut |_, _| Ok(picture.clone()), &Read::default()).unwrap();
        let plain = read(&sample()).unwrap();
        for (found, whole) in scene.materials[1].emission.iter().zip(plain.materials[1].emission) {
            assert!((found - 0.25 * whole).abs() <= ROUND_OFF * whole, "{mode}: {found} of {whole}");
        }
    }
}

/// A file whose one mesh has so many primitives, all on one sparse accessor of zeros.
fn alike(primitives: usize, places: usize) -> Vec<u8> {
    changed(|root| {
        let (count, indices) = (root["accessors"][0]["count"].clone(), root["accessors"][2].clone());
        let view = root["accessors"][0]["bufferView"].clone();
        root["accessors"][0] = json!({
            "componentType": 5126, "count": places, "type": "VEC3",
            "sparse": {
                "count": count,
                "indices": { "bufferView": indices["bufferView"], "componentType": 5123 },
                "values": { "bufferView": view },
            },
        });
        let mut primitive = root["meshes"][0]["primitives"][0].clone();
        primitive["attributes"].as_object_mut().unwrap().remove("NORMAL");
        root["meshes"][0]["primitives"] = vec![primitive; primitives].into();
    })
}

#[test]
fn an_accessor_that_many_primitives_name_is_decoded_once_and_counts_once() {
    // A thousand primitives on 2²⁰ places each would be a hundred times the default limit.
    let many = read(&alike(1000, 1 << 20)).unwrap();
    assert_eq!((many.report.triangles, many.report.instances), (2000, 2));
    let how = |limits| Read { limits, ..Read::default() };
    let exact = Limits { elements: 1003, ..Limits::default() };
    assert!(Scene::read(&alike(9, 1000), &mut none, &how(exact)).is_ok());
    let less = Limits { elements: 1002, ..Limits::default() };
    let error = Scene::read(&alike(9, 1000), &mut none, &how(less)).unwrap_err().to_string();
    assert!(error.contains("at most 1002 elements of all accessors that are read, found 1003"), "{error}");
    // Two meshes' worth of places, and the sum is what counts.
    let both = Limits { elements: 5, ..Limits::default() };
    let error = Scene::read(&sample(), &mut none, &how(both)).unwrap_err().to_string();
    assert!(error.contains("found 6"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn damaged_files_never_panic(cut in 0usize..4000, flips in prop::collection::vec((0usize..4000, any::<u8>()), 1..6), text: bool) {
        let mut bytes = if text { changed(|_| ()) } else { sample() };
        for (at, value) in flips {
            let at = at % bytes.len();
            bytes[at] = value;
        }
        if cut < bytes.len() {
            bytes.truncate(bytes.len() - cut % 64);
        }
        if let Ok(scene) = read(&bytes) {
            prop_assert!(scene.triangles.iter().flatten().all(|corner| corner.is_finite()));
            prop_assert_eq!(scene.triangles.len(), scene.material.len());
        }
    }
}
