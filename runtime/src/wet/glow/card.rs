//! Glow and mist on a graphics card, over textures of the application's: one submission a frame, nothing read back.
//!
//! Twin: [`super::Glow`]. Kernels' weights and mist's light at nodes are the processor's, worked out when camera, light or controls change.

use super::{DEPTHS, GlowControls, LEVELS, NODES_PX, ring_energies};
use crate::airlight::Airlight;
use crate::camera::Camera;
use crate::error::RuntimeError;
use crate::gpu::binding::{Kernel, Slot};
use crate::gpu::clock::{Clock, GpuReport};
use crate::gpu::memory::{Held, Image};
use crate::gpu::readback::Readback;
use crate::gpu::shader::GLOW;
use crate::gpu::{Gpu, LARGEST_BINDING};
use crate::medium::{Medium, Phase};
use crate::point_spread::PointSpread;
use crate::tone::bloom::halved;
use crate::wet::card::{self, CardFrame, LAYER};
use crate::wet::frame::Layer;
use crate::wet::reflect::view::View;
use crate::world::WorldLight;
use squall_formats::drops::Optics;
use squall_formats::units::MillimetresPerHour;
use uniforms::{GlowUniform, LevelUniform};

mod uniforms {
    use crate::gpu::rain::plain;

    plain! {
        /// `Glow` of spread.wgsl.
        GlowUniform {
            size: [u32; 2], half: [u32; 2], focal: [f32; 2], middle: [f32; 2], least: [f32; 3], extinction: f32, mist: f32, sky: f32,
            strength: f32, is_paper: u32, is_parallel: u32, across: u32, pad0: [u32; 2], weights: [[[f32; 4]; 9]; 6],
        }
    }
    plain! {
        /// `Level` of spread.wgsl.
        LevelUniform {
            size: [u32; 2], finer: [u32; 2], coarser: [u32; 2], begin: u32, finer_begin: u32, coarser_begin: u32, number: u32,
            is_coarsest: u32, stride: u32,
        }
    }
}

/// Kawase's passes at most.
const PASSES: usize = 16;
/// Bytes of a value: three colours and one more.
const VALUE_BYTES: u64 = 16;

/// Glow of frames on a graphics card; keeps its tables and its memory between them.
///
/// ```no_run
/// use squall_runtime::camera::Camera;
/// use squall_runtime::gpu::Gpu;
/// use squall_runtime::wet::card::CardFrame;
/// use squall_runtime::wet::glow::{GlowControls, card::CardGlow};
/// use squall_runtime::{wgpu, world::WorldLight};
///
/// # fn draw(device: wgpu::Device, queue: wgpu::Queue, picture: &wgpu::TextureView, depth_m: &wgpu::TextureView, camera: &Camera)
/// # -> Result<(), squall_runtime::RuntimeError> {
/// // The application's own device, and its own textures on it.
/// let gpu = Gpu::with_device(device, queue)?;
/// let mut glow = CardGlow::new(&gpu);
/// let light = WorldLight::default();
/// let frame = CardFrame { rate_mm_per_h: 25.0, ..CardFrame::new(camera, &light, [picture, depth_m]) };
/// // For a pass of one's own: out = layer.rgb + (1 − layer.a) × picture.
/// let layer: &wgpu::TextureView = glow.draw(&frame, &GlowControls::default())?;
/// # let _ = layer;
/// # Ok(())
/// # }
/// ```
pub struct CardGlow {
    gpu: Gpu,
    layouts: [wgpu::BindGroupLayout; 4],
    kernels: Kernels,
    uniform: Held<wgpu::Buffer>,
    tables: Option<(Airlight, PointSpread)>,
    /// Pixels a radian that the weights are of.
    weights: Option<(u64, [[[f32; 4]; LEVELS]; DEPTHS.len()])>,
    room: Option<Room>,
    clock: Clock,
    is_measured: bool,
    back: Readback,
}

struct Kernels {
    find: Kernel,
    halve: Kernel,
    gather: Kernel,
    blur: Kernel,
    lay: Kernel,
}

/// What a picture of one size takes.
struct Room {
    size: [u32; 2],
    levels: Vec<[usize; 2]>,
    nodes: Held<wgpu::Buffer>,
    /// Whose light the nodes hold.
    seen: Option<(Camera, WorldLight)>,
    bound: Option<([wgpu::TextureView; 2], wgpu::BindGroup)>,
    /// Lights and sums, and the two in each other's place.
    lights: [wgpu::BindGroup; 2],
    /// Levels, then Kawase's passes.
    numbers: Vec<wgpu::BindGroup>,
    layer: Image,
    layer_group: wgpu::BindGroup,
    _held: ([Held<wgpu::Buffer>; 3], Vec<Held<wgpu::Buffer>>),
}

impl CardGlow {
    /// The pipelines; memory comes with the first frame.
    pub fn new(gpu: &Gpu) -> Self {
        let layouts = [
            gpu.layout("glow", &[Slot::Uniform, Slot::Exact, Slot::Exact, Slot::Read]),
            gpu.layout("lights that glow", &[Slot::Write; 3]),
            gpu.layout("level of glow", &[Slot::Uniform]),
            gpu.layout("layer of glow", &[Slot::Store(LAYER)]),
        ];
        let module = gpu.module(&GLOW);
        let groups = layouts.each_ref().map(Some);
        let kernel = |entry| gpu.kernel(&module, entry, &groups);
        let kernels = Kernels {
            find: kernel("find_glow"),
            halve: kernel("halve_glow"),
            gather: kernel("gather_glow"),
            blur: kernel("blur_glow"),
            lay: kernel("lay_glow"),
        };
        let uniform = gpu.uniform::<GlowUniform>("glow");
        let (clock, back) = (Clock::new(gpu), Readback::new(gpu));
        let (tables, weights, room) = (None, None, None);
        let gpu = gpu.clone();
        Self { gpu, layouts, kernels, uniform, tables, weights, room, clock, is_measured: false, back }
    }

    /// Draws the glow of the picture's lights, and mist before it: a texture of the camera's size, rgba32float, light and in the fourth number the share
    /// of what is below that the layer hides. Textures that stay the same cost no new bind groups, another size costs new memory.
    ///
    /// # Errors
    ///
    /// Controls out of their ranges, textures of another size than the camera's, pictures whose levels a card's buffer does not hold: of some 16 million
    /// pixels, fewer where a picture is very narrow.
    pub fn draw(
        &mut self,
        frame: &CardFrame<'_>,
        controls: &GlowControls,
    ) -> Result<&wgpu::TextureView, RuntimeError> {
        controls.check()?;
        frame.check()?;
        let size = frame.size();
        check_size(size)?;
        let mut room = match self.room.take() {
            Some(room) if room.size == size => room,
            _ => Room::new(&self.gpu, &self.layouts, size),
        };
        let uniform = self.uniform_of(frame, controls, &room);
        if uniform.mist > 0.0 {
            room.see(&self.gpu, frame);
        }
        room.bind(&self.gpu, (&self.layouts[0], &self.uniform), [frame.picture, frame.depth_m]);
        self.gpu.write(&self.uniform, &[uniform]);
        self.record(&room, &uniform, controls.paper_passes as usize);
        Ok(&self.room.insert(room).layer.view)
    }

    fn uniform_of(&mut self, frame: &CardFrame<'_>, controls: &GlowControls, room: &Room) -> GlowUniform {
        let view = View::new(frame.camera);
        let mut uniform = GlowUniform {
            size: room.size,
            half: room.levels[0].map(|side| side as u32),
            focal: view.focal().to_array(),
            middle: view.middle().to_array(),
            is_parallel: u32::from(view.is_parallel()),
            across: nodes_along(room.size[0]),
            ..GlowUniform::default()
        };
        // No rain, no glow: as the processor has it.
        if frame.rate_mm_per_h.partial_cmp(&0.0).is_none_or(|order| order.is_le()) {
            return uniform;
        }
        let rain = Medium::geometric(MillimetresPerHour(frame.rate_mm_per_h)).extinction().0;
        uniform.extinction = (rain + f64::from(controls.mist) * 1e-3) as f32;
        uniform.least = frame.light.mean_radiance().map(|value| value * controls.threshold);
        uniform.sky = controls.sky;
        if controls.paper > 0.5 {
            (uniform.is_paper, uniform.strength) = (1, controls.paper_amount);
            return uniform;
        }
        (uniform.mist, uniform.strength) = (controls.mist * 1e-3, controls.strength);
        uniform.weights = self.weights(frame.camera.pixels_per_metre());
        uniform
    }

    /// Energies of every class's rings.
    fn weights(&mut self, focal: f64) -> [[[f32; 4]; LEVELS]; DEPTHS.len()] {
        if let Some((_, weights)) = self.weights.filter(|(known, _)| *known == focal.to_bits()) {
            return weights;
        }
        let (once, more) = self.tables.get_or_insert_with(|| {
            let phase = Phase::HenyeyGreenstein(Optics::GEOMETRIC.asymmetry);
            (Airlight::new(&phase), PointSpread::new(&phase))
        });
        let weights = DEPTHS
            .map(|depth| ring_energies(depth, 0.5 * focal, (once, more)).map(|[r, g, b]| [r, g, b, 0.0]));
        self.weights = Some((focal.to_bits(), weights));
        weights
    }

    fn record(&mut self, room: &Room, uniform: &GlowUniform, passes: usize) {
        let Some((_, bound)) = &room.bound else { return };
        let kernels = &self.kernels;
        let groups = |turned: usize, number: usize| {
            [bound, &room.lights[turned], &room.numbers[number], &room.layer_group].map(Some)
        };
        let over = |[width, height]: [usize; 2], deep: usize| {
            [width.div_ceil(8) as u32, height.div_ceil(8) as u32, deep as u32]
        };
        let mut recorder = self.clock.record(self.is_measured);
        let mut turned = 0;
        if uniform.strength > 0.0 {
            recorder.pass("glow", |pass| {
                pass.run(&kernels.find, &groups(0, 0), over(room.levels[0], 1));
                if uniform.is_paper == 1 {
                    for number in 0..passes.min(PASSES) {
                        turned = number % 2;
                        pass.run(&kernels.blur, &groups(turned, LEVELS + number), over(room.levels[0], 1));
                    }
                    return;
                }
                for (number, level) in room.levels.iter().enumerate().skip(1) {
                    pass.run(&kernels.halve, &groups(0, number), over(*level, DEPTHS.len()));
                }
                for (number, level) in room.levels.iter().enumerate().rev() {
                    pass.run(&kernels.gather, &groups(0, number), over(*level, 1));
                }
            });
        }
        let whole = over(room.size.map(|side| side as usize), 1);
        recorder.pass("layer of glow", |pass| pass.run(&kernels.lay, &groups(turned, 0), whole));
        recorder.submit();
    }

    /// The layer last drawn, waited for; an empty one where none was.
    ///
    /// # Errors
    ///
    /// The device is lost.
    pub fn read(&mut self) -> Result<Layer, RuntimeError> {
        let Some(room) = &self.room else { return Ok(Layer::default()) };
        card::read_layer(&self.gpu, &mut self.back, &room.layer)
    }

    /// Has every frame's passes timed, where the device has a clock.
    pub const fn set_measured(&mut self, is_measured: bool) {
        self.is_measured = is_measured;
    }

    /// What the last frame took, waited for.
    ///
    /// # Errors
    ///
    /// The device is lost.
    pub fn report(&mut self) -> Result<GpuReport, RuntimeError> {
        card::report(&self.gpu, &mut self.clock)
    }
}

/// Nodes of mist's light along so many pixels.
const fn nodes_along(pixels: u32) -> u32 {
    pixels.div_ceil(NODES_PX as u32) + 1
}

/// Sides of a picture's levels, each half of the one before, the first half of the picture's.
fn levels_of(size: [u32; 2]) -> Vec<[usize; 2]> {
    let mut levels = vec![size.map(|side| halved(side as usize))];
    while let Some(&last) = levels.last().filter(|last| last.iter().any(|side| *side > 1)) {
        if levels.len() == LEVELS {
            break;
        }
        levels.push(last.map(halved));
    }
    levels
}

/// Refuses a picture whose lights or whose parts, one a class of depth, are more than a binding holds.
fn check_size(size: [u32; 2]) -> Result<(), RuntimeError> {
    let count = |levels: &[[usize; 2]]| levels.iter().map(|[x, y]| (x * y) as u64).sum::<u64>();
    let levels = levels_of(size);
    let bytes = VALUE_BYTES * count(&levels).max(DEPTHS.len() as u64 * count(&levels[1..]));
    if bytes > LARGEST_BINDING {
        let wanted = format!("levels of at most {LARGEST_BINDING} bytes");
        return Err(RuntimeError::argument(
            "picture",
            wanted,
            format!("{bytes}: {} × {} pixels", size[0], size[1]),
        ));
    }
    Ok(())
}

impl Room {
    fn new(gpu: &Gpu, layouts: &[wgpu::BindGroupLayout; 4], size: [u32; 2]) -> Self {
        let levels = levels_of(size);
        let count = |level: &[usize; 2]| level[0] * level[1];
        let (all, first) = (levels.iter().map(count).sum::<usize>(), count(&levels[0]));
        let values = |label: &str, count: usize| {
            gpu.buffer(label, VALUE_BYTES * count as u64, wgpu::BufferUsages::STORAGE)
        };
        let held = [
            values("lights that glow", first),
            values("levels of glow", all),
            values("parts of glow", DEPTHS.len() * (all - first)),
        ];
        let lights = [[0, 1, 2], [1, 0, 2]].map(|order| {
            gpu.group("lights that glow", &layouts[1], &order.map(|k| held[k].as_entire_binding()))
        });
        let uniforms: Vec<Held<wgpu::Buffer>> = numbers(&levels)
            .map(|number| {
                let buffer = gpu.uniform::<LevelUniform>("level of glow");
                gpu.write(&buffer, &[number]);
                buffer
            })
            .collect();
        let group = |buffer: &Held<wgpu::Buffer>| {
            gpu.group("level of glow", &layouts[2], &[buffer.as_entire_binding()])
        };
        let numbers = uniforms.iter().map(group).collect();
        let nodes = values("light of mist", size.map(|side| nodes_along(side) as usize).iter().product());
        let layer = gpu.target("layer of glow", size, LAYER);
        let layer_group = gpu.group("layer of glow", &layouts[3], &[layer.binding()]);
        let (seen, bound) = (None, None);
        Self {
            size,
            levels,
            nodes,
            seen,
            bound,
            lights,
            numbers,
            layer,
            layer_group,
            _held: (held, uniforms),
        }
    }

    /// Brings the world's light to the nodes, where it isn't this camera's yet.
    fn see(&mut self, gpu: &Gpu, frame: &CardFrame<'_>) {
        let known =
            self.seen.as_ref().is_some_and(|(camera, light)| camera == frame.camera && light == frame.light);
        if known {
            return;
        }
        let phase = Phase::HenyeyGreenstein(Optics::GEOMETRIC.asymmetry);
        let world = frame.light.in_scattering(&phase);
        let counts = self.size.map(|side| nodes_along(side) as usize);
        let nodes = super::nodes_of_mist(&View::new(frame.camera), &world, counts);
        let values: Vec<[f32; 4]> = nodes.iter().map(|light| light.extend(0.0).to_array()).collect();
        gpu.write(&self.nodes, &values);
        self.seen = Some((frame.camera.clone(), frame.light.clone()));
    }

    fn bind(
        &mut self,
        gpu: &Gpu,
        (layout, uniform): (&wgpu::BindGroupLayout, &wgpu::Buffer),
        views: [&wgpu::TextureView; 2],
    ) {
        if self.bound.as_ref().is_some_and(|(known, _)| known.each_ref() == views) {
            return;
        }
        let [picture, depth] = views.map(wgpu::BindingResource::TextureView);
        let resources = [uniform.as_entire_binding(), picture, depth, self.nodes.as_entire_binding()];
        self.bound = Some((views.map(Clone::clone), gpu.group("glow", layout, &resources)));
    }
}

/// What passes are told of every level, and of Kawase's passes.
fn numbers(levels: &[[usize; 2]]) -> impl Iterator<Item = LevelUniform> {
    let begin =
        |number: usize| levels[..number].iter().map(|level| (level[0] * level[1]) as u32).sum::<u32>();
    let size = |number: usize| levels[number].map(|side| side as u32);
    let stride = begin(levels.len()) - begin(1);
    let level = move |number: usize| {
        let at = number.min(levels.len() - 1);
        let (finer, coarser) = (at.saturating_sub(1), (at + 1).min(levels.len() - 1));
        LevelUniform {
            size: size(at),
            finer: size(finer),
            coarser: size(coarser),
            begin: begin(at),
            finer_begin: begin(finer),
            coarser_begin: begin(coarser),
            number: at as u32,
            is_coarsest: u32::from(at + 1 == levels.len()),
            stride,
        }
    };
    let passes = (0..PASSES as u32).map(|number| LevelUniform { number, ..LevelUniform::default() });
    (0..LEVELS).map(level).chain(passes)
}

#[cfg(test)]
mod tests;
