//! Lights that stand in the picture themselves, lamps and channels, and the layer of streaks over them.
//!
//! Twins: `crate::renderer::channel`, `Town::draw_lamps`, `crate::rain::Workspace::draw`.

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::{Dispatch, Recorder};
use super::memory::Held;
use super::rain::{RainGroup, plain};
use super::shader::{SPOTS_DRAW, SPOTS_PLACE, STREAKS_OVER};
use super::targets::LIGHT;
use wgpu::BufferUsages as Use;

/// Strokes that there is room for at first.
const FEW_STROKES: usize = 16;
/// What has a brightness of its own.
pub const NO_STROKE: u32 = u32::MAX;
/// Spots that there is room for at first.
const FEW: usize = 1024;

plain! {
    /// `SpotSource` of spots.wgsl.
    SpotSource { position: [f32; 3], stroke: u32, light: [f32; 3], sigma: f32 }
}
plain! {
    /// `Spot` of spots.wgsl.
    Spot { pixel: [f32; 2], sigma: f32, reach: f32, light: [f32; 4] }
}
plain! {
    /// `SpotFrame` of spots.wgsl.
    SpotFrame { counts: [u32; 4] }
}

/// The passes.
pub struct SpotPasses {
    place: Kernel,
    draw: wgpu::RenderPipeline,
    over: wgpu::RenderPipeline,
    place_layout: wgpu::BindGroupLayout,
    draw_layout: wgpu::BindGroupLayout,
    layer_layout: wgpu::BindGroupLayout,
    uniform: Held<wgpu::Buffer>,
    sources: Held<wgpu::Buffer>,
    placed: Held<wgpu::Buffer>,
    /// Colour times brightness of every stroke.
    strokes: Held<wgpu::Buffer>,
    groups: Option<[wgpu::BindGroup; 2]>,
    /// How far what stands before spots is, and the medium's uniforms.
    metres: Option<wgpu::TextureView>,
    medium: wgpu::Buffer,
    relief: wgpu::TextureView,
    layer: Option<wgpu::BindGroup>,
    count: u32,
    room: usize,
}

impl SpotPasses {
    /// The pipelines; `medium` is the medium's uniform buffer, `relief` what is dry under covers.
    pub fn new(
        gpu: &Gpu,
        [frame, town]: [&wgpu::BindGroupLayout; 2],
        rain: &RainGroup,
        (medium, relief): (&wgpu::Buffer, &wgpu::TextureView),
    ) -> Self {
        let [uniform, read, exact] = [Slot::Uniform, Slot::Read, Slot::Exact];
        let place_layout = gpu.layout("spots", &[uniform, read, Slot::Write, uniform, exact, exact, read]);
        let draw_layout = gpu.layout("spots drawn", &[Slot::Read]);
        let layer_layout = gpu.layout("layer of streaks", &[Slot::Flat]);
        let module = gpu.module(&SPOTS_PLACE);
        let groups = [Some(frame), Some(town), Some(&rain.layout), Some(&place_layout)];
        let place = gpu.kernel(&module, "place_spots", &groups);
        let one = |src, dst| wgpu::BlendComponent {
            src_factor: src,
            dst_factor: dst,
            operation: wgpu::BlendOperation::Add,
        };
        use wgpu::BlendFactor::{One, OneMinusSrcAlpha};
        let draw = over_picture(
            gpu,
            (&gpu.module(&SPOTS_DRAW), ["spot_vertex", "spot_fragment"]),
            &gpu.pipeline_layout("spots", &[Some(frame), Some(&draw_layout)]),
            one(One, One),
        );
        let over = over_picture(
            gpu,
            (&gpu.module(&STREAKS_OVER), ["whole_picture", "lay_streaks"]),
            &gpu.pipeline_layout("streaks over", &[Some(frame), Some(&layer_layout), Some(&rain.layout)]),
            one(One, OneMinusSrcAlpha),
        );
        let uniform = gpu.uniform::<SpotFrame>("spots");
        let (sources, placed) = room(gpu, FEW);
        Self {
            place,
            draw,
            over,
            place_layout,
            draw_layout,
            layer_layout,
            uniform,
            sources,
            placed,
            strokes: gpu.storage("brightness of strokes", &[[0.0f32; 4]; FEW_STROKES]),
            groups: None,
            metres: None,
            medium: medium.clone(),
            relief: relief.clone(),
            layer: None,
            count: 0,
            room: FEW,
        }
    }

    /// The spots of the next frames.
    pub fn set_sources(&mut self, gpu: &Gpu, sources: &[SpotSource]) {
        if sources.len() > self.room {
            self.room = sources.len().next_power_of_two();
            (self.sources, self.placed) = room(gpu, self.room);
            self.bind(gpu);
        }
        self.count = sources.len() as u32;
        gpu.write(&self.sources, sources);
    }

    /// Brightness of every stroke in the next frame; whether it rains, whether a town and whether a scene of the caller's may stand
    /// before spots.
    pub fn set_frame(&mut self, gpu: &Gpu, strokes: &[[f32; 3]], [rains, has_town, has_scene]: [bool; 3]) {
        let counts = [self.count, u32::from(rains), u32::from(has_town), u32::from(has_scene)];
        gpu.write(&self.uniform, &[SpotFrame { counts }]);
        let mut bright: Vec<[f32; 4]> = strokes.iter().map(|[r, g, b]| [*r, *g, *b, 0.0]).collect();
        if size_of_val(&bright[..]) as u64 > self.strokes.size() {
            bright.resize(bright.len().next_power_of_two(), [0.0; 4]);
            self.strokes = gpu.storage("brightness of strokes", &bright);
            self.bind(gpu);
        } else {
            gpu.write(&self.strokes, &bright);
        }
    }

    /// Binds the layer of streaks, and the metres to what stands before spots.
    pub fn set_layer(&mut self, gpu: &Gpu, layer: &wgpu::TextureView, metres: &wgpu::TextureView) {
        self.metres = Some(metres.clone());
        self.bind(gpu);
        let layer = wgpu::BindingResource::TextureView(layer);
        self.layer = Some(gpu.group("layer of streaks", &self.layer_layout, &[layer]));
    }

    fn bind(&mut self, gpu: &Gpu) {
        let Some(metres) = &self.metres else { return };
        let [uniform, sources, placed, medium] =
            [&*self.uniform, &*self.sources, &*self.placed, &self.medium]
                .map(wgpu::Buffer::as_entire_binding);
        let [metres, relief] = [metres, &self.relief].map(wgpu::BindingResource::TextureView);
        let strokes = self.strokes.as_entire_binding();
        let all = [uniform, sources, placed.clone(), medium, metres, relief, strokes];
        self.groups = Some([
            gpu.group("spots", &self.place_layout, &all),
            gpu.group("spots drawn", &self.draw_layout, &[placed]),
        ]);
    }

    /// Places the spots.
    pub fn place(&self, recorder: &mut Recorder<'_>, [frame, town, rain]: [&wgpu::BindGroup; 3]) {
        if let Some([own, _]) = self.groups.as_ref().filter(|_| self.count > 0) {
            let groups = [frame, town, rain, own];
            let size = [self.count.div_ceil(64), 1, 1];
            recorder.compute("place lights", &[Dispatch { kernel: &self.place, groups: &groups, size }]);
        }
    }

    /// Draws spots over `picture`, and streaks over those where `rains`.
    pub fn draw(
        &self,
        recorder: &mut Recorder<'_>,
        [frame, rain]: [&wgpu::BindGroup; 2],
        picture: &wgpu::TextureView,
        rains: bool,
    ) {
        let layer = self.layer.as_ref().filter(|_| rains);
        if self.count == 0 && layer.is_none() {
            return;
        }
        let target = wgpu::RenderPassColorAttachment {
            view: picture,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
        };
        recorder.draw("lights and streaks", &[Some(target)], |pass| {
            pass.set_bind_group(0, frame, &[]);
            if let Some([_, own]) = self.groups.as_ref().filter(|_| self.count > 0) {
                pass.set_pipeline(&self.draw);
                pass.set_bind_group(1, own, &[]);
                pass.draw(0..6, 0..self.count);
            }
            if let Some(layer) = layer {
                pass.set_pipeline(&self.over);
                pass.set_bind_group(1, layer, &[]);
                pass.set_bind_group(2, rain, &[]);
                pass.draw(0..3, 0..1);
            }
        });
    }
}

fn room(gpu: &Gpu, spots: usize) -> (Held<wgpu::Buffer>, Held<wgpu::Buffer>) {
    let bytes = |one: usize| (spots * one) as u64;
    let sources = gpu.buffer("sources of spots", bytes(size_of::<SpotSource>()), Use::STORAGE);
    (sources, gpu.buffer("spots", bytes(size_of::<Spot>()), Use::STORAGE | Use::COPY_SRC))
}

/// A pipeline that blends over a picture.
fn over_picture(
    gpu: &Gpu,
    (module, [vertex, fragment]): (&wgpu::ShaderModule, [&str; 2]),
    layout: &wgpu::PipelineLayout,
    blend: wgpu::BlendComponent,
) -> wgpu::RenderPipeline {
    let target = wgpu::ColorTargetState {
        format: LIGHT,
        blend: Some(wgpu::BlendState { color: blend, alpha: blend }),
        write_mask: wgpu::ColorWrites::COLOR,
    };
    let targets = [Some(target)];
    let descriptor = wgpu::RenderPipelineDescriptor {
        label: Some(fragment),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(vertex),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(fragment),
            compilation_options: Default::default(),
            targets: &targets,
        }),
        multiview_mask: None,
        cache: None,
    };
    gpu.render_pipeline(fragment.into(), |device| device.create_render_pipeline(&descriptor))
}
