//! The frame's uniforms: what [`crate::camera::Camera`] is to a shader.

use super::Gpu;
use super::binding::Slot;
use super::memory::{Held, Image};
use crate::camera::{Camera, Projection};
use crate::frame::Frame;
use crate::shade::sky::Sky;
use crate::shade::sky::card::SkyUniform;
use glam::DVec3;

/// `Frame` of common.wgsl.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct FrameUniform {
    pub eye: [f32; 3],
    pub projection: u32,
    pub way: [f32; 3],
    pub width: u32,
    pub way_dx: [f32; 3],
    pub height: u32,
    pub way_dy: [f32; 3],
    pub unit: f32,
    pub eye_dx: [f32; 3],
    pub pixels_per_metre: f32,
    pub eye_dy: [f32; 3],
    pub exposure: f32,
    pub right: [f32; 3],
    pub time: f32,
    pub up: [f32; 3],
    pub eye_height: f32,
    pub forward: [f32; 3],
    pub pad0: f32,
    pub position: [f32; 3],
    pub pad1: f32,
    pub half_extent: [f32; 2],
    pub shift: [f32; 2],
}

impl FrameUniform {
    /// Of a frame in the scene's coordinates, whose pictures store light in units of `unit`, W/(m² sr).
    pub fn new(frame: &Frame, unit: f32) -> Self {
        let mut uniform = Self::of_camera(&frame.camera, unit);
        (uniform.exposure, uniform.time) = (frame.exposure.0 as f32, frame.weather.time.0 as f32);
        uniform
    }

    /// Of a camera alone.
    pub fn of_camera(camera: &Camera, unit: f32) -> Self {
        let half = camera.half_extent();
        let dx = camera.right * (2.0 * half.x / f64::from(camera.width));
        let dy = camera.up * (-2.0 * half.y / f64::from(camera.height));
        let corner =
            camera.up * half.y - camera.right * half.x - dx * camera.shift_px.x - dy * camera.shift_px.y;
        let is_perspective = matches!(camera.projection, Projection::Perspective { .. });
        let (eye, way, [way_dx, way_dy], [eye_dx, eye_dy]) = if is_perspective {
            (camera.position, camera.forward + corner, [dx, dy], [DVec3::ZERO; 2])
        } else {
            (camera.position + corner, camera.forward, [DVec3::ZERO; 2], [dx, dy])
        };
        let three = |v: DVec3| v.as_vec3().to_array();
        Self {
            eye: three(eye),
            projection: u32::from(!is_perspective),
            way: three(way),
            width: camera.width,
            way_dx: three(way_dx),
            height: camera.height,
            way_dy: three(way_dy),
            unit,
            eye_dx: three(eye_dx),
            pixels_per_metre: camera.pixels_per_metre() as f32,
            eye_dy: three(eye_dy),
            exposure: 0.0,
            right: three(camera.right),
            time: 0.0,
            up: three(camera.up),
            eye_height: camera.position.z.clamp(0.0, 1e5) as f32,
            forward: three(camera.forward),
            pad0: 0.0,
            position: three(camera.position),
            pad1: 0.0,
            half_extent: half.as_vec2().to_array(),
            shift: camera.shift_px.as_vec2().to_array(),
        }
    }
}

/// Group 0: the frame's uniforms, the sky's, and the table of clear air.
pub struct FrameGroup {
    /// The frame's uniforms.
    pub buffer: Held<wgpu::Buffer>,
    sky: Held<wgpu::Buffer>,
    table: Image,
    /// The group's layout.
    pub layout: wgpu::BindGroupLayout,
    /// The group.
    pub group: wgpu::BindGroup,
}

impl FrameGroup {
    /// Makes the group, of a dark sky.
    pub fn new(gpu: &Gpu) -> Self {
        let buffer = gpu.uniform::<FrameUniform>("frame");
        let sky = gpu.uniform::<SkyUniform>("sky");
        let [columns, rows] = SkyUniform::TABLE;
        let kind = (wgpu::TextureDimension::D2, wgpu::TextureFormat::Rgba32Float);
        let table = gpu.texture("clear air", [columns, rows, 1], kind, wgpu::TextureUsages::empty());
        let layout = gpu.layout("frame", &[Slot::Uniform, Slot::Uniform, Slot::Exact]);
        let resources = [buffer.as_entire_binding(), sky.as_entire_binding(), table.binding()];
        let group = gpu.group("frame", &layout, &resources);
        Self { buffer, sky, table, layout, group }
    }

    /// Tells the passes of the next submission what to draw.
    pub fn set(&self, gpu: &Gpu, uniform: &FrameUniform) {
        gpu.write(&self.buffer, &[*uniform]);
    }

    /// Tells them under what sky. The table of clear air stays as it is unless a sky is given.
    pub fn set_sky(&self, gpu: &Gpu, uniform: &SkyUniform, table: Option<&Sky>) {
        gpu.write(&self.sky, &[*uniform]);
        if let Some(sky) = table {
            gpu.fill(&self.table, &sky.table());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assert_layout;
    use crate::gpu::clock::{Clock, Dispatch};
    use crate::gpu::readback::Readback;
    use crate::gpu::shader::PROBE;
    use crate::gpu::test_gpu;
    use crate::noise::Lattice;
    use crate::phase::henyey_greenstein;
    use crate::random::{Random, hash};
    use glam::{DVec2, Vec3};
    use squall_formats::units::Radians;

    #[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
    #[repr(C)]
    struct Probe {
        place: [f32; 3],
        seed: u32,
        state: [u32; 2],
        part: [u32; 2],
    }

    #[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
    #[repr(C)]
    struct Answer {
        hash: [u32; 2],
        gradient: f32,
        fractal: f32,
        folded: [f32; 2],
        unit: f32,
        phase: f32,
        unfolded: [f32; 3],
        secant: f32,
        way: [f32; 3],
        pad: f32,
        projected: [f32; 3],
        pad1: f32,
    }

    #[test]
    fn the_frames_uniforms_lie_as_the_shader_has_them() {
        use FrameUniform as Frame;
        assert_layout!(
            PROBE,
            Frame {
                eye,
                projection,
                way,
                width,
                way_dx,
                height,
                way_dy,
                unit,
                eye_dx,
                pixels_per_metre,
                eye_dy,
                exposure,
                right,
                time,
                up,
                eye_height,
                forward,
                pad0,
                position,
                pad1,
                half_extent,
                shift,
            }
        );
        assert_layout!(PROBE, Probe { place, seed, state, part });
        assert_layout!(
            PROBE,
            Answer {
                hash,
                gradient,
                fractal,
                folded,
                unit,
                phase,
                unfolded,
                secant,
                way,
                pad,
                projected,
                pad1
            }
        );
    }

    #[test]
    fn uniforms_of_sky_and_surroundings_lie_as_the_shaders_have_them() {
        use crate::gpu::around::{Around, Window};
        use crate::gpu::light::Tints;
        use crate::gpu::shader::{AROUND, LOOK, MARCH};
        use crate::shade::sky::card::SkyUniform as Sky;
        assert_layout!(
            MARCH,
            Sky {
                sun,
                overcast,
                grey,
                high_cloud,
                ground,
                seed,
                mean,
                level,
                upper,
                cosine_low,
                lower,
                cosine_scale,
                air_cloud,
                disc_low,
                air_town,
                disc_scale,
                air_high,
                has_disc,
                irradiance,
                half_angle,
                sun_pixel,
                pad,
                high,
                disc,
                harmonics,
            }
        );
        assert_layout!(MARCH, Tints { strokes, quiet, pad0, pad1, pad2 });
        assert_layout!(LOOK, Window { heading, half_width, bottom, top, columns, rows, pad0, pad1 });
        assert_eq!(
            crate::gpu::shader::tests::layout_of(&LOOK, "Windows").size as usize,
            2 * size_of::<Window>()
        );
        assert_layout!(AROUND, Around { mean, sun_open, glow_centre, glow_radius, glow_radiance, deviation });
    }

    fn cameras() -> [Camera; 2] {
        let camera = |projection| {
            let mut camera = Camera::new(
                DVec3::new(10.0, -20.0, 3.0),
                DVec3::new(1.0, 2.0, 0.2),
                DVec3::Z,
                projection,
                [640, 480],
            )
            .unwrap();
            (camera.shift_px, camera.pixel_aspect) = (DVec2::new(12.0, -31.0), 1.25);
            camera
        };
        [
            camera(Projection::Perspective { vertical_fov: Radians(1.0) }),
            camera(Projection::Orthographic { half_width: 40.0, half_height: 30.0 }),
        ]
    }

    #[test]
    fn the_common_part_gives_the_processors_hashes_noise_directions_and_rays() {
        /// Round-off of some tens of single-precision operations; noise multiplies places by up to 8.
        const ROUND_OFF: f64 = 2e-4;
        let Some(gpu) = test_gpu() else { return };
        let mut random = Random::new(3);
        let questions: Vec<Probe> = (0..500u64)
            .map(|i| Probe {
                place: [0; 3].map(|_| random.range(-400.0, 400.0) as f32),
                seed: i as u32 * 77,
                state: [i as u32, 0x8000_0001],
                part: [!0, (i as u32 * 0x1234_5677) >> 1],
            })
            .collect();
        let asked = gpu.storage("questions", &questions);
        let bytes = (questions.len() * size_of::<Answer>()) as u64;
        let told = gpu.buffer("answers", bytes, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
        let frame = FrameGroup::new(&gpu);
        let layout = gpu.layout("probe", &[Slot::Read, Slot::Write]);
        let group = gpu.group("probe", &layout, &[asked.as_entire_binding(), told.as_entire_binding()]);
        let module = gpu.module(&PROBE);
        let kernel = gpu.kernel(&module, "probe", &[Some(&frame.layout), Some(&layout)]);
        let (mut clock, mut back) = (Clock::new(&gpu), Readback::new(&gpu));
        for camera in cameras() {
            frame.set(&gpu, &FrameUniform::of_camera(&camera, 1.0));
            let mut recorder = clock.record(true);
            let groups = [&frame.group, &group];
            recorder.compute("probe", &[Dispatch { kernel: &kernel, groups: &groups, size: [8, 1, 1] }]);
            back.copy_buffer(&mut recorder.encoder, &told);
            recorder.submit();
            let answers: Vec<Answer> = back.values().unwrap();
            let times = clock.read().unwrap();
            assert!(!gpu.has_clock() || times.len() == 1 && times[0].name == "probe", "{times:?}");
            for (asked, found) in questions.iter().zip(&answers) {
                let whole = |[low, high]: [u32; 2]| u64::from(high) << 32 | u64::from(low);
                let wanted = hash(&[whole(asked.state), whole(asked.part)]);
                assert_eq!(whole(found.hash), wanted);
                let unit = Random::from_parts(&[whole(asked.state), whole(asked.part)]).unit();
                let place = Vec3::from_array(asked.place);
                let lattice = Lattice::new(asked.seed);
                let folded = crate::octahedron::fold(place);
                let pixel = [place.x.abs(), place.y.abs()].map(f64::from);
                let ray = camera.ray(pixel[0], pixel[1]);
                let seen = camera.project(ray.origin + ray.direction * 100.0).unwrap();
                let pairs = [
                    (found.unit, unit),
                    (found.gradient, f64::from(lattice.gradient(place))),
                    (found.fractal, f64::from(lattice.fractal(place, 4, 0.55))),
                    (found.folded[0], f64::from(folded[0])),
                    (found.folded[1], f64::from(folded[1])),
                    (found.phase, henyey_greenstein(0.85, f64::from(place.normalize().x))),
                    (found.secant, camera.secants().at(pixel[0], pixel[1])),
                    (found.way[0], ray.direction.x),
                    (found.way[2], ray.direction.z),
                    (found.unfolded[1], f64::from(place.normalize().y)),
                    (found.projected[0] * 1e-2, seen.pixel.x * 1e-2),
                    (found.projected[2] * 1e-2, seen.depth * 1e-2),
                ];
                for (i, (found, wanted)) in pairs.into_iter().enumerate() {
                    let off = (f64::from(found) - wanted).abs() / wanted.abs().max(1.0);
                    assert!(off < ROUND_OFF, "{i}: {found} for {wanted} at {place}");
                }
            }
        }
    }
}
