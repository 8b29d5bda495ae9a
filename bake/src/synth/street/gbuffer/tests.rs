use super::*;
use crate::progress::Quiet;
use squall_formats::units::Radians;
use squall_runtime::camera::Projection;
use squall_scene::{Material, Read, Scene};

#[test]
fn buffers_of_a_shining_ceiling_over_a_floor_have_its_form_factor() {
    // A floor of albedo ½ below a square that shines.
    let mut writer = squall_scene::write::GlbWriter::new(683.0);
    let floor = writer.material(&Material { base: [0.5; 3], ..Material::default() });
    let lamp =
        writer.material(&Material { emission: [1.0, 2.0, 3.0], base: [0.0; 3], ..Material::default() });
    let square = |half: f32, z: f32, up: bool, material: u32| squall_scene::write::Part {
        places: vec![[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]],
        corners: if up { vec![[0, 1, 2], [0, 2, 3]] } else { vec![[0, 2, 1], [0, 3, 2]] },
        material,
        ..Default::default()
    };
    let mesh = writer.mesh("room", &[square(5.0, 0.0, true, floor), square(1.0, 2.0, false, lamp)]);
    writer.place("room", mesh, DVec3::ZERO, 0.0);
    let none = |_: &str, _: u64| -> Result<Vec<u8>, squall_scene::SceneError> { unreachable!() };
    let how = Read { normals: true, ..Read::default() };
    let world = World::new(Scene::read(&writer.finish("test"), &mut { none }, &how).unwrap());
    let camera = Camera::new(
        DVec3::new(0.0, 0.0, 1.5),
        DVec3::NEG_Z,
        DVec3::Y,
        Projection::Perspective { vertical_fov: Radians(0.2) },
        [9, 9],
    );
    let settings = GBufferSettings { samples: 64, sky: [0.0; 3], ..GBufferSettings::default() };
    let buffer = render_gbuffer(&world, &camera.unwrap(), settings, &Quiet).unwrap();
    let slant = libm::sqrtf(5.0);
    let factor = 4.0 * (1.0 / slant) * libm::atanf(1.0 / slant);
    let pixel = 4 * 9 + 4;
    for (found, radiance) in buffer.colour[pixel].iter().zip([1.0, 2.0, 3.0]) {
        let wanted = 0.5 / PI * factor * radiance;
        assert!((found / wanted - 1.0).abs() < 0.05, "{found} {wanted}");
    }
    assert!((buffer.depth_m[pixel] - 1.5).abs() < 1e-4 && buffer.normal[pixel][2] > 0.999);
    assert_eq!(buffer.albedo.unwrap()[pixel], [0.5; 3]);
}
