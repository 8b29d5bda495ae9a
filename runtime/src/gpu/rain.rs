//! Rain on the card: a frame's drops found, one thread a lattice cell, and their streaks drawn by one indirect draw.
//!
//! Twins: `crate::rain` and `crate::shade::streak`.

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::{Dispatch, Recorder, groups_of};
use super::memory::{Held, Image};
use super::shader::{RAIN_DRAW, RAIN_FIND};
use crate::error::RuntimeError;
use crate::rain::CoverMap;
use crate::shade::streak::upload::StreakTables;
use std::sync::Arc;
use wgpu::BufferUsages as Use;

/// Most classes of drops, and street lamps that light them.
pub const CLASSES: usize = 256;
pub const NEAR_LAMPS: usize = 128;
/// Most covers of the caller's own, and their cells beside each other in a texture.
pub const COVERS: usize = 16;
const CELLS_ACROSS: u32 = 2048;
/// Rows of a texture within WebGPU's default limits.
const MOST_ROWS: usize = 8192;
/// Most streaks that one frame draws.
const MOST_STREAKS: u32 = 1 << 19;
/// Streaks that there is always room for.
const FEWEST_STREAKS: u32 = 1 << 14;
/// What the layer adds up.
pub const LAYER: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

macro_rules! plain {
    ($(#[$doc:meta])* $name:ident { $($field:ident: $kind:ty),* $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        #[repr(C)]
        pub struct $name { $(pub $field: $kind),* }

        impl Default for $name {
            fn default() -> Self {
                bytemuck::Zeroable::zeroed()
            }
        }
    };
}
pub(crate) use plain;

plain! {
    /// `CoverHead` of rain_field.wgsl.
    CoverHead { origin: [f32; 3], inverse_cell: f32, size: [u32; 2], first: u32, highest: f32 }
}
plain! {
    /// `RainField` of rain_field.wgsl.
    FieldUniform {
        ceiling: [f32; 4],
        region: [f32; 4],
        map_place: [f32; 4],
        map_top: [f32; 4],
        has: [u32; 4],
        counts: [u32; 4],
        covers: [CoverHead; COVERS],
    }
}
plain! {
    /// `RainLight` of in_scattering.wgsl.
    RainLight {
        sun_towards: [f32; 4],
        sun: [f32; 4],
        flash_towards: [f32; 4],
        flash: [f32; 4],
        medium_flash_towards: [f32; 4],
        medium_flash: [f32; 4],
        phases: [[f32; 4]; 3],
        sun_lost: [f32; 4],
    }
}
plain! {
    /// `RainClass` of rain.wgsl.
    RainClass {
        key: [u32; 2],
        smallest: f32,
        width: f32,
        base_x: [u32; 2],
        base_y: [u32; 2],
        base_z: [u32; 2],
        crowd: f32,
        floor: f32,
        low: [i32; 3],
        first: u32,
        size: [u32; 3],
        edge: f32,
        place: [f32; 3],
        near: f32,
        far: f32,
        pad: [f32; 3],
        planes: [[f32; 4]; 6],
    }
}
plain! {
    /// `NearLamp` of rain.wgsl.
    NearLamp { position: [f32; 4], intensity: [f32; 4] }
}
plain! {
    /// `RainFrame` of rain.wgsl.
    RainFrame {
        exposure: [f32; 4],
        still_way: [f32; 4],
        world_up: [f32; 4],
        wind: [f32; 4],
        lens: [f32; 4],
        shift: [f32; 4],
        lengths: [f32; 4],
        counts: [u32; 4],
        flags: [u32; 4],
        classes: [RainClass; CLASSES],
        near_lamps: [NearLamp; NEAR_LAMPS],
    }
}
plain! {
    /// `PatternHead` of rain.wgsl.
    PatternHead {
        body: [f32; 4],
        range: [f32; 4],
        tables: [u32; 4],
        light: [f32; 4],
        kind: [u32; 4],
        sides: [[f32; 4]; 2],
        ends: [[f32; 4]; 2],
        softness: [f32; 4],
    }
}
plain! {
    /// `DrawnStreak` of rain.wgsl.
    DrawnStreak {
        ends: [f32; 4],
        light: [f32; 4],
        id: [u32; 2],
        pattern: u32,
        kind: u32,
        place: [f32; 4],
        steps: [f32; 4],
        tables: [u32; 4],
        shares: [f32; 4],
        bounds: [f32; 4],
    }
}
plain! {
    /// `TableSizes` of rain.wgsl.
    TableUniform { across: [[u32; 4]; 35], along: [[u32; 4]; 25] }
}
plain! {
    /// `DrawArguments` of rain.wgsl.
    DrawArguments { vertices: u32, found: u32, first_vertex: u32, first_instance: u32, inside: u32, pad: [u32; 3] }
}

/// Everything that any pass asks of the rain: group 2.
pub struct RainGroup {
    pub layout: wgpu::BindGroupLayout,
    pub group: wgpu::BindGroup,
    pub frame: Held<wgpu::Buffer>,
    pub field: Held<wgpu::Buffer>,
    pub light: Held<wgpu::Buffer>,
    /// What rain shows in every direction, one phase function under the other.
    pub shown: Image,
    pub phases: Image,
    heads: Held<wgpu::Buffer>,
    sizes: Held<wgpu::Buffer>,
    map: Image,
    /// The texels of the map that is on the card: where they are, and how many.
    map_at: (usize, usize),
    cells: Image,
    covers: Vec<Arc<CoverMap>>,
    told: wgpu::Buffer,
}

/// Phase functions that rain shows the world by: drops', medium's, undrawn rain's.
pub const PHASES: usize = 3;
/// Bins of a phase function's table.
const PHASE_BINS: u32 = 360;
/// Texels along a side of the map of directions.
pub const SHOWN_SIDE: u32 = 161;

/// Slots of group 2.
const SLOTS: [Slot; 10] = [
    Slot::Uniform,
    Slot::Uniform,
    Slot::Exact,
    Slot::Uniform,
    Slot::Exact,
    Slot::Exact,
    Slot::Uniform,
    Slot::Read,
    Slot::Uniform,
    Slot::Exact,
];

impl RainGroup {
    /// Of an asset's patterns, without weather yet; `told` is what the card finds around the eye, an
    /// [`super::around::Around`].
    pub fn new(gpu: &Gpu, tables: &StreakTables, told: &wgpu::Buffer) -> Self {
        let exact = wgpu::TextureFormat::Rgba32Float;
        let mut sizes = TableUniform::default();
        if let Some(own) = &tables.sizes {
            let four = |[first, count]: [u32; 2]| [first, count, 0, 0];
            sizes.across = own.across.map(four);
            sizes.along = own.along.map(four);
        }
        let mut group = Self {
            layout: gpu.layout("rain", &SLOTS),
            group: gpu.group("none", &gpu.layout("none", &[]), &[]),
            frame: gpu.uniform::<RainFrame>("rain's frame"),
            field: gpu.uniform::<FieldUniform>("where it rains"),
            light: gpu.uniform::<RainLight>("rain's light"),
            shown: gpu.target("shown by rain", [SHOWN_SIDE, SHOWN_SIDE * PHASES as u32], exact),
            phases: gpu.target("phases", [PHASE_BINS, PHASES as u32], exact),
            heads: gpu.storage("patterns", &tables.heads),
            sizes: gpu.uniform::<TableUniform>("sizes of tables"),
            map: gpu.target("map of rain", [2, 2], wgpu::TextureFormat::R32Float),
            map_at: (0, 0),
            cells: gpu.target("cells of covers", [1, 1], wgpu::TextureFormat::Rg32Float),
            covers: Vec::new(),
            told: told.clone(),
        };
        gpu.write(&group.sizes, &[sizes]);
        group.bind(gpu);
        group
    }

    fn bind(&mut self, gpu: &Gpu) {
        let view = |image: &'_ Image| image.view.clone();
        let (map, shown, phases) = (view(&self.map), view(&self.shown), view(&self.phases));
        self.group = gpu.group(
            "rain",
            &self.layout,
            &[
                self.frame.as_entire_binding(),
                self.field.as_entire_binding(),
                wgpu::BindingResource::TextureView(&map),
                self.light.as_entire_binding(),
                wgpu::BindingResource::TextureView(&shown),
                wgpu::BindingResource::TextureView(&phases),
                self.sizes.as_entire_binding(),
                self.heads.as_entire_binding(),
                self.told.as_entire_binding(),
                self.cells.binding(),
            ],
        );
    }

    /// Puts covers of the caller's own on the card, and their heads where the next frame's rain is.
    ///
    /// Errors: more covers, or more cells of them, than there is room for.
    pub fn set_covers(
        &mut self,
        gpu: &Gpu,
        covers: &[Arc<CoverMap>],
        field: &mut FieldUniform,
    ) -> Result<(), RuntimeError> {
        if covers.len() > COVERS {
            let wanted = format!("at most {COVERS} covers of one's own on a graphics card");
            return Err(RuntimeError::argument("rain covers", wanted, covers.len()));
        }
        let same = |(a, b): (&Arc<CoverMap>, &Arc<CoverMap>)| a.has_cells_of(b);
        if self.covers.len() != covers.len() || !self.covers.iter().zip(covers).all(same) {
            let mut cells: Vec<[f32; 2]> = covers.iter().flat_map(|cover| cover.cells()).collect();
            let rows = cells.len().div_ceil(CELLS_ACROSS as usize).max(1);
            if rows > MOST_ROWS {
                let wanted =
                    format!("at most {} cells on a graphics card", MOST_ROWS * CELLS_ACROSS as usize);
                return Err(RuntimeError::argument("rain covers", wanted, cells.len()));
            }
            cells.resize(rows * CELLS_ACROSS as usize, [1.0, 0.0]);
            let size = [CELLS_ACROSS, rows as u32];
            self.cells = gpu.target("cells of covers", size, wgpu::TextureFormat::Rg32Float);
            gpu.fill(&self.cells, &cells);
            self.covers = covers.to_vec();
            self.bind(gpu);
        }
        let mut first = 0;
        for (slot, cover) in field.covers.iter_mut().zip(covers) {
            *slot = cover.head(first);
            first += slot.size[0] * slot.size[1];
        }
        field.counts[0] = covers.len() as u32;
        Ok(())
    }

    /// Puts a map of rain on the card, unless it is there already.
    pub fn set_map(&mut self, gpu: &Gpu, map: Option<&crate::rain::RainMap>) {
        let Some(map) = map else { return };
        let (size, texels) = map.texels();
        let at = (texels.as_ptr() as usize, texels.len());
        if self.map_at == at {
            return;
        }
        if self.map.texture.width() != size[0] || self.map.texture.height() != size[1] {
            self.map = gpu.target("map of rain", size, wgpu::TextureFormat::R32Float);
            self.bind(gpu);
        }
        gpu.fill(&self.map, texels);
        self.map_at = at;
    }
}

/// Finding and drawing.
pub struct RainPasses {
    find: Kernel,
    draw: wgpu::RenderPipeline,
    find_layout: wgpu::BindGroupLayout,
    draw_layout: wgpu::BindGroupLayout,
    patterns: wgpu::BindGroup,
    choice: Held<wgpu::Buffer>,
    pub arguments: Held<wgpu::Buffer>,
    pub found: Held<wgpu::Buffer>,
    find_group: wgpu::BindGroup,
    draw_group: Option<wgpu::BindGroup>,
    /// Streaks that there is room for.
    pub capacity: u32,
    /// Numbers of the patterns that frames are told.
    pub patterns_count: u32,
    pub has_choice: bool,
    pub shortest_aspect: f32,
}

impl RainPasses {
    /// Pipelines and the patterns' tables.
    pub fn new(
        gpu: &Gpu,
        frame: &wgpu::BindGroupLayout,
        town: &wgpu::BindGroupLayout,
        rain: &RainGroup,
        tables: &StreakTables,
    ) -> Self {
        let find_layout = gpu.layout("rain found", &[Slot::Write, Slot::Write, Slot::Read]);
        let draw_layout = gpu.layout("rain drawn", &[Slot::Read, Slot::Exact]);
        let pattern_layout = gpu.layout("patterns", &[Slot::Read; 4]);
        let module = gpu.module(&RAIN_FIND);
        let find =
            gpu.kernel(&module, "find", &[Some(frame), Some(town), Some(&rain.layout), Some(&find_layout)]);
        let groups = [Some(frame), Some(&pattern_layout), Some(&rain.layout), Some(&draw_layout)];
        let draw = draw_pipeline(gpu, &gpu.pipeline_layout("draw rain", &groups));
        let held = [
            gpu.storage("tables of thin streaks", &tables.tables),
            gpu.storage("cosines", &tables.terms),
            gpu.storage("soft edges", &tables.edges),
            gpu.storage("profiles", &tables.profiles),
        ];
        let bindings = held.each_ref().map(|buffer| buffer.as_entire_binding());
        let patterns = gpu.group("patterns", &pattern_layout, &bindings);
        let choice = gpu.storage("choice of patterns", &tables.choice);
        let arguments = gpu.buffer(
            "rain's draw",
            size_of::<DrawArguments>() as u64,
            Use::STORAGE | Use::INDIRECT | Use::COPY_SRC,
        );
        let found = room(gpu, FEWEST_STREAKS);
        let find_group = found_group(gpu, &find_layout, [&found, &arguments, &choice]);
        Self {
            find,
            draw,
            find_layout,
            draw_layout,
            patterns,
            choice,
            arguments,
            found,
            find_group,
            draw_group: None,
            capacity: FEWEST_STREAKS,
            patterns_count: tables.heads.len() as u32,
            has_choice: !tables.choice.is_empty(),
            shortest_aspect: tables.shortest_aspect,
        }
    }

    /// Makes room for a frame's streaks, of which there may be `most`.
    pub fn reserve(&mut self, gpu: &Gpu, most: f64) {
        let wanted = (most.clamp(0.0, f64::from(MOST_STREAKS)) as u32).next_power_of_two();
        if wanted > self.capacity {
            self.capacity = wanted;
            self.found = room(gpu, wanted);
            self.find_group =
                found_group(gpu, &self.find_layout, [&self.found, &self.arguments, &self.choice]);
            self.draw_group = None;
        }
    }

    /// Binds what stands before drops: metres along each pixel's ray.
    pub fn set_scene(&mut self, gpu: &Gpu, distance: &wgpu::TextureView) {
        self.draw_group = Some(gpu.group(
            "rain drawn",
            &self.draw_layout,
            &[self.found.as_entire_binding(), wgpu::BindingResource::TextureView(distance)],
        ));
    }

    /// Whether room was made since [`RainPasses::set_scene`].
    pub fn wants_scene(&self) -> bool {
        self.draw_group.is_none()
    }

    /// Finds the drops of a frame with this many threads.
    pub fn find(&self, gpu: &Gpu, recorder: &mut Recorder<'_>, groups: [&wgpu::BindGroup; 3], threads: u32) {
        gpu.write(&self.arguments, &[DrawArguments { vertices: 6, ..DrawArguments::default() }]);
        let [frame, town, rain] = groups;
        let groups = [frame, town, rain, &self.find_group];
        let size = groups_of(threads, 64);
        recorder.compute("find drops", &[Dispatch { kernel: &self.find, groups: &groups, size }]);
    }

    /// Adds the streaks up into `layer`, which is cleared.
    pub fn draw(
        &self,
        recorder: &mut Recorder<'_>,
        [frame, rain]: [&wgpu::BindGroup; 2],
        layer: &wgpu::TextureView,
    ) {
        let Some(drawn) = &self.draw_group else { return };
        let target = wgpu::RenderPassColorAttachment {
            view: layer,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                store: wgpu::StoreOp::Store,
            },
        };
        recorder.draw("streaks", &[Some(target)], |pass| {
            pass.set_pipeline(&self.draw);
            for (number, group) in [frame, &self.patterns, rain, drawn].into_iter().enumerate() {
                pass.set_bind_group(number as u32, group, &[]);
            }
            pass.draw_indirect(&self.arguments, 0);
        });
    }
}

fn room(gpu: &Gpu, streaks: u32) -> Held<wgpu::Buffer> {
    let bytes = u64::from(streaks) * size_of::<DrawnStreak>() as u64;
    gpu.buffer("streaks", bytes, Use::STORAGE | Use::COPY_SRC)
}

fn found_group(gpu: &Gpu, layout: &wgpu::BindGroupLayout, buffers: [&wgpu::Buffer; 3]) -> wgpu::BindGroup {
    gpu.group("rain found", layout, &buffers.map(wgpu::Buffer::as_entire_binding))
}

fn draw_pipeline(gpu: &Gpu, layout: &wgpu::PipelineLayout) -> wgpu::RenderPipeline {
    let module = gpu.module(&RAIN_DRAW);
    let add = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    let target = wgpu::ColorTargetState {
        format: LAYER,
        blend: Some(wgpu::BlendState { color: add, alpha: add }),
        write_mask: wgpu::ColorWrites::ALL,
    };
    let targets = [Some(target)];
    let descriptor = wgpu::RenderPipelineDescriptor {
        label: Some("streaks"),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("streak_vertex"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("streak_fragment"),
            compilation_options: Default::default(),
            targets: &targets,
        }),
        multiview_mask: None,
        cache: None,
    };
    gpu.render_pipeline("streaks".into(), |device| device.create_render_pipeline(&descriptor))
}

#[cfg(test)]
mod tests;
