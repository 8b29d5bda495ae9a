//! What is dry around an eye: heights below which covers keep rain off, along spokes, found when eye, fall or covers change.
//!
//! Twin: `crate::rain::under`, the relief of `CoveredRain`.

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::{Dispatch, Recorder};
use super::memory::{Held, Image};
use super::rain::{RainGroup, plain};
use super::shader::RELIEF;
use crate::rain::relief_of;
use crate::rain::{CoverMap, Covers};
use glam::DVec3;
use std::sync::Arc;

/// Nodes along a spoke, and most spokes.
const NODES: u32 = 208;
const SPOKES: u32 = 4096;
/// Heights, and slopes that pass over them.
const HEIGHTS: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Float;

plain! {
    /// `ReliefFrame` of relief.wgsl.
    ReliefFrame { fall: [f32; 4], spokes: [f32; 4] }
}

/// What a relief was made for.
#[derive(PartialEq)]
struct MadeFor {
    frame: ReliefFrame,
    eye: DVec3,
    covers: Vec<Arc<CoverMap>>,
}

/// The pass.
pub struct ReliefPass {
    kernel: Kernel,
    uniform: Held<wgpu::Buffer>,
    /// By node along x and by spoke along y.
    pub heights: Image,
    group: wgpu::BindGroup,
    made_for: Option<MadeFor>,
    is_stale: bool,
}

impl ReliefPass {
    /// The pipeline.
    pub fn new(gpu: &Gpu, [frame, town]: [&wgpu::BindGroupLayout; 2], rain: &RainGroup) -> Self {
        let layout = gpu.layout("relief", &[Slot::Uniform, Slot::Store(HEIGHTS)]);
        let groups = [Some(frame), Some(town), Some(&rain.layout), Some(&layout)];
        let kernel = gpu.kernel(&gpu.module(&RELIEF), "make_relief", &groups);
        let uniform = gpu.uniform::<ReliefFrame>("relief");
        let heights = gpu.target("relief", [NODES, SPOKES], HEIGHTS);
        let group = gpu.group("relief", &layout, &[uniform.as_entire_binding(), heights.binding()]);
        Self { kernel, uniform, heights, group, made_for: None, is_stale: false }
    }

    /// What covers the next frame's rain, whose drops fall with the mean velocity `fall`, m/s, before `camera`; answers the medium's part
    /// of it: how the fall leans, and how many spokes there are, none where nothing covers.
    pub fn set(
        &mut self,
        gpu: &Gpu,
        covers: Covers<'_>,
        fall: DVec3,
        camera: &crate::camera::Camera,
    ) -> [f32; 4] {
        let own = covers.maps.to_vec();
        let (has_town, Some(relief)) = (covers.first.is_some(), relief_of(covers, fall, camera)) else {
            self.made_for = None;
            return [0.0; 4];
        };
        let [x, y, z] = relief.fall;
        let [low, high] = relief.slopes;
        let frame = ReliefFrame {
            fall: [x, y, z, f32::from(u8::from(has_town))],
            spokes: [relief.spokes as f32, low, high, 0.0],
        };
        let now = Some(MadeFor { frame, eye: camera.position, covers: own });
        if self.made_for != now {
            gpu.write(&self.uniform, &[frame]);
            (self.made_for, self.is_stale) = (now, true);
        }
        [relief.lean[0], relief.lean[1], relief.spokes as f32, 0.0]
    }

    /// Puts it on record, where it is not that of this frame yet.
    pub fn record(&mut self, recorder: &mut Recorder<'_>, [frame, town, rain]: [&wgpu::BindGroup; 3]) {
        let Some(made_for) = self.made_for.as_ref().filter(|_| self.is_stale) else { return };
        let groups = [frame, town, rain, &self.group];
        let size = [made_for.frame.spokes[0] as u32, 1, 1];
        recorder.compute("dry under covers", &[Dispatch { kernel: &self.kernel, groups: &groups, size }]);
        self.is_stale = false;
    }
}
