//! The town's picture, pass by pass.
//!
//! 1. What every pixel's middle sees, and what that is made of: only when camera, quality or town change.
//! 2. Light at nodes: irradiance, what panes show, what water shows.
//! 3. Pixels that the nodes around them can stand for; the others go on a list.
//! 4. The pixels on the list, each on its own: edges of surfaces, shadows' edges, shores.

use super::TownGroup;
use super::light::{TownLights, TownSource, TownView};
use super::surface::TownSurfaces;
use crate::camera::Camera;
use crate::error::RuntimeError;
use crate::gpu::binding::{Kernel, Slot};
use crate::gpu::clock::Recorder;
use crate::gpu::frame::FrameGroup;
use crate::gpu::memory::{Held, Image};
use crate::gpu::rain::RainGroup;
use crate::gpu::shader::{TOWN_LOOK, TOWN_MADE, TOWN_NODES, TOWN_PIXELS, TOWN_REST};
use crate::gpu::targets::{LIGHT, METRES};
use crate::gpu::{Gpu, LARGEST_BINDING};
use crate::shade::town::Town;
use crate::shade::town::frame::Quality;

/// What pixels see: distance and thing.
const SEEN: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Uint;
/// What it is made of.
const MADE: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Uint;
/// The list's head: workgroups of the pass over it along each axis, pixels on it.
const HEAD: [u32; 4] = [0, 1, 1, 0];

/// Slots of what lights a town: view, lights, the two maps.
const LIT: [Slot; 4] = [Slot::Uniform, Slot::Read, Slot::Exact, Slot::Exact];
/// Pictures of nodes.
const NODES: [Slot; 3] = [Slot::Exact; 3];

/// The picture of one town.
pub struct TownPasses {
    kernels: [Kernel; 5],
    layouts: [wgpu::BindGroupLayout; 5],
    surfaces: TownSurfaces,
    view: Held<wgpu::Buffer>,
    sources: Held<wgpu::Buffer>,
    kept: Option<Kept>,
    seen_by: Option<(Camera, TownView)>,
    lit_by: Option<(TownView, Vec<TownSource>)>,
    /// Whether what pixels see is of another camera, quality or picture.
    is_stale: bool,
    /// Whether light is other than that of the picture.
    is_dark: bool,
}

/// What is as large as the picture.
struct Kept {
    size: [u32; 2],
    spacing: u32,
    seen: Image,
    made: Image,
    nodes: [Image; 3],
    rest: Held<wgpu::Buffer>,
    groups: Option<[wgpu::BindGroup; 5]>,
}

/// Pictures that the town is drawn from and into.
pub struct TownTargets<'a> {
    /// The map that mirrors look into, and that of all directions; light in units of the frame's.
    pub maps: [&'a wgpu::TextureView; 2],
    /// Light times cover, and cover.
    pub town: &'a wgpu::TextureView,
    /// Distance at every pixel's middle, m; 1e30 where it sees no town.
    pub metres: &'a wgpu::TextureView,
}

impl TownPasses {
    /// Prepares the passes of `town`, whose rays are `rays`.
    ///
    /// Errors: a town that doesn't fit WebGPU's default limits.
    pub fn new(
        gpu: &Gpu,
        frame: &FrameGroup,
        (town, rays): (&Town, &TownGroup),
        rain: &RainGroup,
    ) -> Result<Self, RuntimeError> {
        let surfaces = TownSurfaces::new(gpu, rays, town)?;
        let pair = [Slot::Whole, Slot::Whole];
        let layouts = [
            gpu.layout("town: look", &[Slot::Uniform, Slot::Store(SEEN), Slot::Store(METRES)]),
            gpu.layout("town: surfaces", &[Slot::Uniform, Slot::Whole, Slot::Store(MADE)]),
            gpu.layout("town: nodes", &[&LIT[..], &pair, &[Slot::Store(LIGHT); 3]].concat()),
            gpu.layout(
                "town: pixels",
                &[&[Slot::Uniform], &pair[..], &NODES, &[Slot::Store(LIGHT), Slot::Write]].concat(),
            ),
            gpu.layout("town: rest", &[&LIT[..], &pair, &NODES, &[Slot::Store(LIGHT), Slot::Read]].concat()),
        ];
        let shaders = [&TOWN_LOOK, &TOWN_MADE, &TOWN_NODES, &TOWN_PIXELS, &TOWN_REST];
        let entries = ["look_at_town", "make_surfaces", "light_nodes", "light_pixels", "light_rest"];
        let kernels = std::array::from_fn(|i| {
            let rain = [2, 4].contains(&i).then_some(&rain.layout);
            let groups = [Some(&frame.layout), Some(&surfaces.layout), rain, Some(&layouts[i])];
            gpu.kernel(&gpu.module(shaders[i]), entries[i], &groups)
        });
        Ok(Self {
            kernels,
            layouts,
            surfaces,
            view: gpu.uniform::<TownView>("view of the town"),
            sources: gpu.storage("lights on the town", &[TownSource::default()]),
            kept: None,
            seen_by: None,
            lit_by: None,
            is_stale: true,
            is_dark: true,
        })
    }

    /// Tells the next frames who looks and what shines; `frame` is the camera that the frame's uniforms are of.
    ///
    /// Errors: a picture of more pixels than a list holds within WebGPU's default limits.
    pub fn set(
        &mut self,
        gpu: &Gpu,
        frame: &Camera,
        quality: Quality,
        lights: &TownLights<'_>,
    ) -> Result<(), RuntimeError> {
        let (pixels, most) = (u64::from(frame.width) * u64::from(frame.height), LARGEST_BINDING / 4 - 4);
        if pixels > most {
            let wanted = format!("a picture of at most {most} pixels");
            return Err(RuntimeError::Device { wanted, found: pixels.to_string() });
        }
        let bare = TownView::of_camera(frame, quality);
        let same = |(camera, view): &(Camera, TownView)| camera == frame && *view == bare;
        if !self.seen_by.as_ref().is_some_and(same) {
            self.seen_by = Some((frame.clone(), bare));
            self.is_stale = true;
        }
        self.reserve(gpu, [frame.width, frame.height], bare.counts[2]);
        let lit = (bare.lit_by(lights), lights.sources());
        if self.lit_by.as_ref() != Some(&lit) {
            gpu.write(&self.view, &[lit.0]);
            self.send(gpu, &lit.1);
            self.lit_by = Some(lit);
            self.is_dark = true;
        }
        Ok(())
    }

    /// Sends the lights of the next frames.
    fn send(&mut self, gpu: &Gpu, sources: &[TownSource]) {
        let bytes = size_of_val(sources) as u64;
        if self.sources.size() < bytes {
            // Larger by half, so that a flash with more branches seldom makes it grow again.
            self.sources = gpu.buffer("lights on the town", bytes * 3 / 2, wgpu::BufferUsages::STORAGE);
            if let Some(kept) = &mut self.kept {
                kept.groups = None;
            }
        }
        if !sources.is_empty() {
            gpu.write(&self.sources, sources);
        }
    }

    /// Makes what is as large as the picture, where that changed.
    fn reserve(&mut self, gpu: &Gpu, size: [u32; 2], spacing: u32) {
        if self.kept.as_ref().is_some_and(|kept| kept.size == size && kept.spacing == spacing) {
            return;
        }
        self.kept = None;
        self.is_stale = true;
        let across = size.map(|count| count.div_ceil(spacing));
        let bytes = 4 * (u64::from(size[0]) * u64::from(size[1]) + HEAD.len() as u64);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_SRC;
        self.kept = Some(Kept {
            size,
            spacing,
            seen: gpu.target("town: what pixels see", size, SEEN),
            made: gpu.target("town: what that is made of", size, MADE),
            nodes: ["irradiance", "panes", "water"].map(|label| gpu.target(label, across, LIGHT)),
            rest: gpu.buffer("town: pixels on their own", bytes, usage),
            groups: None,
        });
    }

    /// Says which pictures to draw from and into; asked for again after [`TownPasses::wants_targets`].
    pub fn set_targets(&mut self, gpu: &Gpu, targets: &TownTargets<'_>) {
        let Some(kept) = &mut self.kept else { return };
        let picture = wgpu::BindingResource::TextureView;
        let (view, sources) = (self.view.as_entire_binding(), self.sources.as_entire_binding());
        let (seen, made, town) = (picture(&kept.seen.view), picture(&kept.made.view), picture(targets.town));
        let rest = kept.rest.as_entire_binding();
        let nodes = kept.nodes.each_ref().map(|node| picture(&node.view));
        let [mirror, around] = targets.maps.map(picture);
        let lit = [view.clone(), sources, mirror, around];
        let pair = [seen.clone(), made.clone()];
        let lists = [
            vec![view.clone(), seen.clone(), picture(targets.metres)],
            vec![view.clone(), seen, made],
            [&lit[..], &pair, &nodes].concat(),
            [&[view][..], &pair, &nodes, &[town.clone(), rest.clone()]].concat(),
            [&lit[..], &pair, &nodes, &[town, rest]].concat(),
        ];
        let label = ["town: look", "town: surfaces", "town: nodes", "town: pixels", "town: rest"];
        kept.groups = Some(std::array::from_fn(|i| gpu.group(label[i], &self.layouts[i], &lists[i])));
        // Distances are drawn into a picture of the caller's.
        self.is_stale = true;
    }

    /// Whether pictures were made anew since [`TownPasses::set_targets`].
    pub fn wants_targets(&self) -> bool {
        self.kept.as_ref().is_some_and(|kept| kept.groups.is_none())
    }

    /// Draws the town, unless it is as it was drawn last: camera and lights are those of then, and neither maps nor rain nor what is
    /// around the eye are `changed`.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        [frame, rain]: [&wgpu::BindGroup; 2],
        changed: bool,
    ) {
        let Some(kept) = &self.kept else { return };
        if !(changed || self.is_stale || self.is_dark) {
            return;
        }
        let Some(groups) = &kept.groups else { return };
        gpu.write(&kept.rest, &HEAD);
        let tiles = |size: [u32; 2]| [size[0].div_ceil(8), size[1].div_ceil(8), 1];
        let (whole, nodes) = (tiles(kept.size), tiles(kept.size.map(|count| count.div_ceil(kept.spacing))));
        let group_of = |i: usize| {
            let rain = [2, 4].contains(&i).then_some(rain);
            [Some(frame), Some(&self.surfaces.group), rain, Some(&groups[i])]
        };
        if self.is_stale {
            recorder.pass("town: look", |pass| {
                pass.run(&self.kernels[0], &group_of(0), whole);
                pass.run(&self.kernels[1], &group_of(1), whole);
            });
        }
        recorder.pass("town: nodes", |pass| pass.run(&self.kernels[2], &group_of(2), nodes));
        recorder.pass("town: pixels", |pass| pass.run(&self.kernels[3], &group_of(3), whole));
        recorder.pass("town: rest", |pass| pass.run_indirect(&self.kernels[4], &group_of(4), &kept.rest));
        (self.is_stale, self.is_dark) = (false, false);
    }

    /// The list of pixels that no node stood for in the last frame: four numbers, the last of them its length, then pixels.
    #[cfg(test)]
    pub(super) fn rest(&self) -> Option<&wgpu::Buffer> {
        self.kept.as_ref().map(|kept| &*kept.rest)
    }
}
