//! From linear light to a display: the lens's bloom, then the curve as a fragment pass onto whatever texture is shown.
//!
//! Twin: `crate::tone`.

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::Recorder;
use super::memory::{Held, Image};
use super::rain::plain;
use super::shader::{BLOOM, TONE};
use super::targets::LIGHT;
use crate::error::RuntimeError;
use crate::tone::Tone;

/// Most levels of bloom.
const LEVELS: usize = 12;
/// What is written: a signal, display light that the texture's format makes a signal of, or radiance.
const SIGNAL: u32 = 0;
const DISPLAY_LIGHT: u32 = 1;
const RADIANCE: u32 = 2;

plain! {
    /// `Bloom` of bloom.wgsl.
    BloomUniform { amount: [f32; 4], weights: [[f32; 4]; 3] }
}
plain! {
    /// `Tone` of tone.wgsl.
    ToneUniform { curve: [f32; 4], output: [u32; 4] }
}

/// What a picture is developed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Developed {
    /// A display's signal, sRGB.
    Signal,
    /// Linear radiance, W/(m² sr), without bloom and curve.
    Radiance,
}

/// The passes for pictures of one size.
pub struct TonePasses {
    halve: Kernel,
    double: Kernel,
    bloom_layouts: [wgpu::BindGroupLayout; 2],
    tone_layout: wgpu::BindGroupLayout,
    bloom: Held<wgpu::Buffer>,
    tone: Held<wgpu::Buffer>,
    bloom_group: wgpu::BindGroup,
    module: wgpu::ShaderModule,
    layout: wgpu::PipelineLayout,
    /// One a format, made when it is first drawn to.
    pipelines: Vec<(wgpu::TextureFormat, wgpu::RenderPipeline)>,
    chain: Option<Chain>,
    /// Levels that the next picture's bloom has.
    levels: usize,
}

/// A picture's levels, each half of the one before.
struct Chain {
    sizes: Vec<[u32; 2]>,
    down: Vec<wgpu::BindGroup>,
    up: Vec<Vec<wgpu::BindGroup>>,
    tone: wgpu::BindGroup,
    _held: (Vec<Image>, Vec<Image>, Vec<Held<wgpu::Buffer>>),
}

impl TonePasses {
    /// The pipelines.
    pub fn new(gpu: &Gpu, frame: &wgpu::BindGroupLayout) -> Self {
        let bloom_layouts = [
            gpu.layout("bloom", &[Slot::Uniform]),
            gpu.layout("level", &[Slot::Flat, Slot::Flat, Slot::Store(LIGHT), Slot::Uniform]),
        ];
        let tone_layout = gpu.layout("tone", &[Slot::Uniform, Slot::Flat, Slot::Flat]);
        let groups = [Some(&bloom_layouts[0]), Some(&bloom_layouts[1])];
        let module = gpu.module(&BLOOM);
        let [halve, double] = ["halve", "double"].map(|entry| gpu.kernel(&module, entry, &groups));
        let (bloom, tone) = (gpu.uniform::<BloomUniform>("bloom"), gpu.uniform::<ToneUniform>("tone"));
        let bloom_group = gpu.group("bloom", &bloom_layouts[0], &[bloom.as_entire_binding()]);
        let layout = gpu.pipeline_layout("tone", &[Some(frame), Some(&tone_layout)]);
        let module = gpu.module(&TONE);
        let (pipelines, chain) = (Vec::new(), None);
        Self {
            halve,
            double,
            bloom_layouts,
            tone_layout,
            bloom,
            tone,
            bloom_group,
            module,
            layout,
            pipelines,
            chain,
            levels: 0,
        }
    }

    /// Binds a picture of this size.
    pub fn set_picture(&mut self, gpu: &Gpu, picture: &wgpu::TextureView, size: [u32; 2]) {
        let mut sizes = Vec::new();
        let mut last = size;
        while sizes.len() < LEVELS && (last[0] > 1 || last[1] > 1) {
            last = last.map(|side| side.div_ceil(2));
            sizes.push(last);
        }
        if sizes.is_empty() {
            sizes.push([1, 1]);
        }
        let target = |label: &str| -> Vec<Image> {
            sizes.iter().map(|size| gpu.target(label, *size, LIGHT)).collect()
        };
        let (levels, spread) = (target("level"), target("spread"));
        use wgpu::BindingResource::TextureView;
        let number = |level: usize, coarsest: bool| {
            let buffer = gpu.uniform::<[u32; 4]>("number of a level");
            gpu.write(&buffer, &[[level as u32, u32::from(coarsest), 0, 0]]);
            buffer
        };
        let mut numbers = Vec::new();
        let mut group =
            |fine: &wgpu::TextureView, coarse: &wgpu::TextureView, made: &Image, (level, coarsest)| {
                let buffer = number(level, coarsest);
                let group = gpu.group(
                    "level",
                    &self.bloom_layouts[1],
                    &[
                        TextureView(fine),
                        TextureView(coarse),
                        TextureView(&made.view),
                        buffer.as_entire_binding(),
                    ],
                );
                numbers.push(buffer);
                group
            };
        let mut down = Vec::new();
        let mut up = Vec::new();
        for (level, made) in levels.iter().enumerate() {
            let fine = if level == 0 { picture } else { &levels[level - 1].view };
            down.push(group(fine, fine, made, (level, false)));
            // As the coarsest of all, and with a coarser one below it.
            let own = &levels[level].view;
            let mut both = vec![group(own, own, &spread[level], (level, true))];
            if let Some(coarser) = spread.get(level + 1) {
                both.push(group(own, &coarser.view, &spread[level], (level, false)));
            }
            up.push(both);
        }
        let tone = gpu.group(
            "tone",
            &self.tone_layout,
            &[self.tone.as_entire_binding(), TextureView(picture), TextureView(&spread[0].view)],
        );
        self.chain = Some(Chain { sizes, down, up, tone, _held: (levels, spread, numbers) });
    }

    /// How the next picture is developed, for a texture of this format.
    ///
    /// Errors: a format that no picture is shown in.
    pub fn set(
        &mut self,
        gpu: &Gpu,
        tone: &Tone,
        (developed, format): (Developed, wgpu::TextureFormat),
    ) -> Result<(), RuntimeError> {
        let bloom = &tone.bloom;
        let amount = bloom.amount.clamp(0.0, 1.0);
        let known = self.chain.as_ref().map_or(0, |chain| chain.sizes.len());
        self.levels = known.min(bloom.levels as usize);
        if amount == 0.0 || developed == Developed::Radiance {
            self.levels = 0;
        }
        let mut uniform = BloomUniform::default();
        let mut weights = vec![1.0f32; self.levels];
        (1..self.levels).for_each(|level| weights[level] = weights[level - 1] * bloom.reach.clamp(0.0, 2.0));
        let total: f32 = weights.iter().sum();
        let slots = uniform.weights.as_flattened_mut();
        slots.iter_mut().zip(&weights).for_each(|(slot, weight)| *slot = weight * amount / total);
        uniform.amount = [amount, self.levels as f32, 0.0, 0.0];
        gpu.write(&self.bloom, &[uniform]);
        let spread = if self.levels > 0 { amount } else { 0.0 };
        let output = match developed {
            Developed::Radiance => RADIANCE,
            Developed::Signal if format.is_srgb() => DISPLAY_LIGHT,
            Developed::Signal => SIGNAL,
        };
        let curve = [tone.exposure, tone.contrast, tone.shoulder, spread];
        let output = [output, u32::from(tone.dither), 0, 0];
        gpu.write(&self.tone, &[ToneUniform { curve, output }]);
        if self.pipelines.iter().all(|(known, _)| *known != format) {
            self.pipelines.push((format, pipeline(gpu, &self.module, &self.layout, format)?));
        }
        Ok(())
    }

    /// Spreads light, then develops the picture onto `target`, whose format [`TonePasses::set`] was told.
    pub fn record(
        &self,
        recorder: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        (target, format): (&wgpu::TextureView, wgpu::TextureFormat),
    ) {
        let Some(chain) = &self.chain else { return };
        let groups_of = |level: usize| chain.sizes[level].map(|side| side.div_ceil(8));
        if self.levels > 0 {
            recorder.pass("bloom", |pass| {
                for level in 0..self.levels {
                    let [x, y] = groups_of(level);
                    pass.run(&self.halve, &[Some(&self.bloom_group), Some(&chain.down[level])], [x, y, 1]);
                }
                for level in (0..self.levels).rev() {
                    let [x, y] = groups_of(level);
                    let which = usize::from(level + 1 < self.levels);
                    let groups = [Some(&self.bloom_group), Some(&chain.up[level][which])];
                    pass.run(&self.double, &groups, [x, y, 1]);
                }
            });
        }
        let Some((_, pipeline)) = self.pipelines.iter().find(|(known, _)| *known == format) else { return };
        let attachment = wgpu::RenderPassColorAttachment {
            view: target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                store: wgpu::StoreOp::Store,
            },
        };
        recorder.draw("tone", &[Some(attachment)], |pass| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, frame, &[]);
            pass.set_bind_group(1, &chain.tone, &[]);
            pass.draw(0..3, 0..1);
        });
    }
}

/// Formats that a picture can be developed to.
const FORMATS: [wgpu::TextureFormat; 6] = {
    use wgpu::TextureFormat as F;
    [F::Rgba8Unorm, F::Rgba8UnormSrgb, F::Bgra8Unorm, F::Bgra8UnormSrgb, F::Rgba16Float, F::Rgba32Float]
};

fn pipeline(
    gpu: &Gpu,
    module: &wgpu::ShaderModule,
    layout: &wgpu::PipelineLayout,
    format: wgpu::TextureFormat,
) -> Result<wgpu::RenderPipeline, RuntimeError> {
    if !FORMATS.contains(&format) {
        let wanted = "rgba8, bgra8 (either in sRGB), rgba16float or rgba32float";
        return Err(RuntimeError::argument("target texture", wanted, format!("{format:?}")));
    }
    let targets = [Some(format.into())];
    let descriptor = wgpu::RenderPipelineDescriptor {
        label: Some("tone"),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("whole_picture"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some("develop"),
            compilation_options: Default::default(),
            targets: &targets,
        }),
        multiview_mask: None,
        cache: None,
    };
    Ok(gpu.render_pipeline(format!("tone {format:?}"), |device| device.create_render_pipeline(&descriptor)))
}

#[cfg(test)]
mod tests;
