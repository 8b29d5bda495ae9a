//! The inverse transform on the card, point by point: only cells that somebody can see, and only towards the viewer.

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::{Pass, groups_of};
use super::memory::Held;
use super::rows::{RowSum, Rows};
use super::shader::HAAR;
use crate::clouds::Viewer;
use crate::relight::Relighter;
use glam::DVec3;
use squall_formats::basis::DirectionalBasis;

/// Levels an axis of the transform may have: grids of up to 65 536 cells along it.
const LEVELS: usize = 16;

/// `Haar` of haar.wgsl.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct HaarUniform {
    pub depth: u32,
    pub basis: u32,
    pub stride: u32,
    pub cells: u32,
    pub middle: [f32; 3],
    pub pad0: f32,
    pub beyond: [f32; 3],
    pub pad1: f32,
    pub half: [f32; 3],
    pub pad2: f32,
    pub axes: [[f32; 4]; 3],
    pub turns: [[f32; 4]; 3 * LEVELS],
}

/// The transform of one asset.
pub struct HaarPass {
    kernel: Kernel,
    light_layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
    uniform: HaarUniform,
    buffer: Held<wgpu::Buffer>,
    _places: Held<wgpu::Buffer>,
    _seen: Held<wgpu::Buffer>,
    cells: usize,
}

/// Light per cell of the rows' grid: what one sum of rows becomes.
pub struct RowLight {
    /// J of the seen cells, W/(m² sr), x fastest; 0 elsewhere.
    pub light: Held<wgpu::Buffer>,
    group: wgpu::BindGroup,
}

impl HaarPass {
    /// Prepares the transform; `cloud` is the cloud's uniform buffer.
    pub fn new(gpu: &Gpu, relighter: &Relighter, rows: &Rows, cloud: &wgpu::Buffer) -> Self {
        let head = &relighter.response().head;
        let known = relighter.known_light_cells();
        let seen: Vec<u32> = (0..known.len() as u32).filter(|&cell| known[cell as usize]).collect();
        let mut uniform = HaarUniform {
            basis: match head.basis {
                DirectionalBasis::ViewRegion { .. } => 0,
                DirectionalBasis::Harmonics { .. } => 1,
                DirectionalBasis::Directions26 => 2,
            },
            stride: (rows.stride / 4) as u32,
            cells: seen.len() as u32,
            ..bytemuck::Zeroable::zeroed()
        };
        for axis in 0..3 {
            for (level, (_, turn)) in relighter.haar().rotations(axis).enumerate().take(LEVELS) {
                uniform.turns[axis * LEVELS + level] = turn;
                uniform.depth = uniform.depth.max(level as u32 + 1);
            }
        }
        if let Some(frame) = relighter.view_region_frame() {
            let [middle, half] = frame.middle_and_half().map(DVec3::from_array);
            uniform.middle = (middle - relighter.cloud().origin_m).as_vec3().to_array();
            uniform.half = half.as_vec3().to_array();
            uniform.axes = frame.axes().map(|axis| DVec3::from_array(axis).as_vec3().extend(0.0).to_array());
        }
        let layout = gpu.layout("transform", &[Slot::Uniform, Slot::Uniform, Slot::Read, Slot::Read]);
        let light_layout = gpu.layout("light of rows", &[Slot::Read, Slot::Write]);
        let buffer = gpu.uniform::<HaarUniform>("transform");
        let places = gpu.storage("used places", &rows.places);
        let cells = gpu.storage("seen cells", &seen);
        let group = gpu.group(
            "transform",
            &layout,
            &[cloud, &buffer, &places, &cells].map(|buffer| buffer.as_entire_binding()),
        );
        let module = gpu.module(&HAAR);
        let kernel = gpu.kernel(&module, "light_of_cells", &[None, Some(&layout), Some(&light_layout)]);
        Self {
            kernel,
            light_layout,
            group,
            uniform,
            buffer,
            _places: places,
            _seen: cells,
            cells: known.len(),
        }
    }

    /// Room for the light of one sum.
    pub fn light(&self, gpu: &Gpu, sum: &RowSum) -> RowLight {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let light = gpu.buffer("light of rows", 4 * self.cells as u64, usage);
        let resources = [&sum.coefficients, &light].map(|buffer| buffer.as_entire_binding());
        let group = gpu.group("light of rows", &self.light_layout, &resources);
        RowLight { light, group }
    }

    /// Tells the next submission who looks, in the asset's coordinates.
    pub fn look(&mut self, gpu: &Gpu, relighter: &Relighter, viewer: Viewer) {
        let mut uniform = self.uniform;
        if let (Viewer::At(place), Some(frame)) = (viewer, relighter.view_region_frame()) {
            let [middle, _] = frame.middle_and_half().map(DVec3::from_array);
            uniform.beyond = (place - middle).as_vec3().to_array();
        }
        gpu.write(&self.buffer, &[uniform]);
    }

    /// Puts one sum's way back on record.
    pub fn run(&self, pass: &mut Pass<'_>, light: &RowLight) {
        if self.uniform.cells > 0 {
            let size = groups_of(self.uniform.cells, 64);
            pass.run(&self.kernel, &[None, Some(&self.group), Some(&light.group)], size);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::cloud::CloudUniform;
    use super::*;
    use crate::assert_layout;
    use crate::clouds::Clouds;
    use crate::gpu::clock::Clock;
    use crate::gpu::readback::Readback;
    use crate::gpu::test_gpu;
    use crate::load::Asset;
    use crate::random::Random;
    use crate::relight::SourceWeight;

    #[test]
    fn the_transforms_uniforms_lie_as_the_shader_has_them() {
        use {CloudUniform as Cloud, HaarUniform as Haar};
        assert_layout!(
            HAAR,
            Haar { depth, basis, stride, cells, middle, pad0, beyond, pad1, half, pad2, axes, turns }
        );
        let found = crate::gpu::shader::tests::layout_of(&HAAR, "Cloud");
        let wanted = [
            ("origin", std::mem::offset_of!(Cloud, origin)),
            ("albedo", std::mem::offset_of!(Cloud, albedo)),
            ("cell", std::mem::offset_of!(Cloud, cell)),
            ("g", std::mem::offset_of!(Cloud, g)),
            ("counts", std::mem::offset_of!(Cloud, counts)),
            ("periodic", std::mem::offset_of!(Cloud, periodic)),
            ("light_counts", std::mem::offset_of!(Cloud, light_counts)),
            ("extinction_unit", std::mem::offset_of!(Cloud, extinction_unit)),
            ("blocks", std::mem::offset_of!(Cloud, blocks)),
            ("extinction_scale", std::mem::offset_of!(Cloud, extinction_scale)),
            ("viewer", std::mem::offset_of!(Cloud, viewer)),
            ("viewer_is_far", std::mem::offset_of!(Cloud, viewer_is_far)),
            ("fine", std::mem::offset_of!(Cloud, fine)),
            ("shortest", std::mem::offset_of!(Cloud, shortest)),
            ("amplitude", std::mem::offset_of!(Cloud, amplitude)),
            ("fibres_from", std::mem::offset_of!(Cloud, fibres_from)),
            ("voxels_per_metre", std::mem::offset_of!(Cloud, voxels_per_metre)),
        ];
        assert_eq!(found.fields[..wanted.len()], wanted.map(|(name, at)| (name.to_owned(), at as u32)));
        assert_eq!(found.size as usize, size_of::<Cloud>());
    }

    /// Golden assets: harmonics with the cloud's own cells, light towards a view region, light on blocks of cells.
    const ASSETS: [&str; 3] = ["v1/golden.squall", "v2/eyes.squall", "v3/sun.squall"];

    #[test]
    fn rows_summed_and_transformed_back_on_the_card_are_the_processors() {
        /// Single-precision sums in another order, as a share of the light's root mean square.
        const ROUND_OFF: f64 = 1e-5;
        let Some(gpu) = test_gpu() else { return };
        for name in ASSETS {
            let path = format!("{}/../data/golden/{name}", env!("CARGO_MANIFEST_DIR"));
            let clouds = Clouds::new(&Asset::open(path).unwrap()).unwrap();
            let relighter = clouds.relighter();
            let cloud = gpu.uniform::<CloudUniform>("cloud");
            let rows = Rows::new(&gpu, relighter).unwrap();
            let mut haar = HaarPass::new(&gpu, relighter, &rows, &cloud);
            let sum = rows.sum(&gpu);
            let light = haar.light(&gpu, &sum);
            let (mut clock, mut back) = (Clock::new(&gpu), Readback::new(&gpu));
            let mut random = Random::new(8);
            for _ in 0..3 {
                let sources: Vec<SourceWeight> = (0..relighter.response().row_count() as u32)
                    .filter(|row| row % 3 != 1)
                    .map(|row| SourceWeight { row, intensity: random.range(-1.0, 3.0) as f32 })
                    .collect();
                let at = match relighter.view_region() {
                    Some(region) => DVec3::from_array(region.point([0; 3].map(|_| random.range(-1.0, 1.0)))),
                    None => DVec3::new(random.range(-900.0, 900.0), -400.0, random.range(0.0, 900.0)),
                };
                let viewer = Viewer::At(at);
                let grid = relighter.cloud();
                gpu.write(&cloud, &[CloudUniform::new(relighter, DVec3::ZERO).seen_by(grid, viewer)]);
                rows.weigh(&gpu, &sum, &sources);
                haar.look(&gpu, relighter, viewer);
                let mut recorder = clock.record(true);
                recorder.pass("rows", |pass| {
                    rows.run(pass, &sum);
                    haar.run(pass, &light);
                });
                back.copy_buffer(&mut recorder.encoder, &light.light);
                recorder.submit();
                let found: Vec<f32> = back.values().unwrap();
                let wanted = relighter.towards_for_tests(&sources, viewer);
                let known = relighter.known_light_cells();
                let (mut off, mut all) = (0.0, 0.0);
                for cell in (0..found.len()).filter(|&cell| known[cell]) {
                    off += crate::gpu::square(found[cell] - wanted[cell]);
                    all += crate::gpu::square(wanted[cell]);
                }
                assert!(all > 0.0 && (off / all).sqrt() < ROUND_OFF, "{name}: {}", (off / all).sqrt());
            }
        }
    }
}
