//! The cloud's density as the card marches it: half precision, filtered; the distance field; the billows' table.

use super::Gpu;
use super::binding::Slot;
use super::cloud::{CloudUniform, counts};
use super::light::{CloudLights, Tints};
use super::memory::{Held, Image};
use super::targets::LIGHT;
use crate::clouds::f16_bits;
use crate::shade::cloud::CloudShape;
use crate::shade::detail::Detail;
use crate::transport::Cloud;
use wgpu::{TextureDimension, TextureFormat, TextureUsages};

/// Groups 1 and 2 of passes that march: the cloud, and its light.
pub struct Volumes {
    billows: Option<Image>,
    ranks: Image,
    density: Image,
    distances: Image,
    samplers: [wgpu::Sampler; 2],
    tints: Held<wgpu::Buffer>,
    /// Layouts of groups 1 and 2.
    pub layouts: [wgpu::BindGroupLayout; 2],
    /// The groups.
    pub groups: [wgpu::BindGroup; 2],
    nothing: Image,
}

/// Ranks of the billows' noise.
const RANKS: u32 = 513;

impl Volumes {
    /// Brings the density of `cloud` to the card, in units of `unit` 1/m; `lights` is its light.
    pub fn new(gpu: &Gpu, (cloud, shape, unit): (&Cloud, &CloudShape, f32), lights: &CloudLights) -> Self {
        let pairs = cloud.extinction.iter().zip(shape.ceilings());
        let texels: Vec<[u16; 2]> =
            pairs.map(|(&own, &most)| [f16_bits(own / unit), f16_bits(most / unit)]).collect();
        let (size, uniform) = (counts(cloud.shape), &lights.uniform);
        let volumes = [&lights.quiet_volume, &lights.stroke_volume];
        Self::of(gpu, size, (&texels, shape.distances()), uniform, volumes)
    }

    /// No cloud: a grid of one empty cell, with its uniforms and its lack of light.
    pub fn none(gpu: &Gpu) -> (Self, Held<wgpu::Buffer>) {
        let uniform = gpu.uniform::<CloudUniform>("no cloud");
        let empty = CloudUniform {
            // A grid that no ray meets: it ends where it begins.
            counts: [1; 3],
            light_counts: [1; 3],
            cell: [0.0; 3],
            extinction_unit: 1.0,
            ..CloudUniform::default()
        };
        gpu.write(&uniform, &[empty]);
        let kind = (TextureDimension::D3, LIGHT);
        let dark = gpu.texture("no light", [1; 3], kind, TextureUsages::empty());
        (Self::of(gpu, [1; 3], (&[[0; 2]], &[u8::MAX]), &uniform, [&dark, &dark]), uniform)
    }

    fn of(
        gpu: &Gpu,
        size: [u32; 3],
        (texels, steps): (&[[u16; 2]], &[u8]),
        cloud: &wgpu::Buffer,
        light: [&Image; 2],
    ) -> Self {
        let volume = |label: &str, size: [u32; 3], format| {
            gpu.texture(label, size, (TextureDimension::D3, format), TextureUsages::empty())
        };
        let density = volume("density", size, TextureFormat::Rg16Float);
        gpu.fill(&density, texels);
        let distances = volume("distances", size, TextureFormat::R8Uint);
        gpu.fill(&distances, steps);
        let nothing = volume("no billows", [1; 3], TextureFormat::R8Unorm);
        let kind = (TextureDimension::D2, TextureFormat::R32Float);
        let ranks = gpu.texture("ranks", [RANKS, 1, 1], kind, TextureUsages::empty());
        let sampler = |mode| {
            gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                address_mode_u: mode,
                address_mode_v: mode,
                address_mode_w: mode,
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            })
        };
        let samplers = [wgpu::AddressMode::ClampToEdge, wgpu::AddressMode::Repeat].map(sampler);
        let tints = gpu.uniform::<Tints>("tints");
        let layouts = [
            gpu.layout(
                "cloud",
                &[
                    Slot::Uniform,
                    Slot::Volume,
                    Slot::WholeVolume,
                    Slot::Volume,
                    Slot::Exact,
                    Slot::Sampler,
                    Slot::Sampler,
                ],
            ),
            gpu.layout("light of the cloud", &[Slot::Uniform, Slot::Volume, Slot::Volume]),
        ];
        let group = Self::group(gpu, &layouts[0], cloud, [&density, &distances, &nothing, &ranks], &samplers);
        let of_light = [tints.as_entire_binding(), light[0].binding(), light[1].binding()];
        let lit = gpu.group("light of the cloud", &layouts[1], &of_light);
        Self {
            billows: None,
            ranks,
            density,
            distances,
            samplers,
            tints,
            layouts,
            groups: [group, lit],
            nothing,
        }
    }

    fn group(
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        cloud: &wgpu::Buffer,
        [density, distances, billows, ranks]: [&Image; 4],
        samplers: &[wgpu::Sampler; 2],
    ) -> wgpu::BindGroup {
        let [clamped, repeated] = samplers.each_ref().map(wgpu::BindingResource::Sampler);
        let resources = [
            cloud.as_entire_binding(),
            density.binding(),
            distances.binding(),
            billows.binding(),
            ranks.binding(),
            clamped,
            repeated,
        ];
        gpu.group("cloud", layout, &resources)
    }

    /// Brings the pattern of `detail` to the card; `cloud` is the grid's uniform buffer.
    pub fn set_detail(&mut self, gpu: &Gpu, cloud: &wgpu::Buffer, detail: &Detail) {
        let (side, table, _) = detail.table();
        if detail.ranks().len() == RANKS as usize {
            let billows = self.billows.get_or_insert_with(|| {
                let kind = (TextureDimension::D3, TextureFormat::R8Unorm);
                gpu.texture("billows", [side; 3], kind, TextureUsages::empty())
            });
            gpu.fill(billows, table);
            gpu.fill(&self.ranks, detail.ranks());
        }
        let billows = self.billows.as_ref().unwrap_or(&self.nothing);
        let images = [&self.density, &self.distances, billows, &self.ranks];
        self.groups[0] = Self::group(gpu, &self.layouts[0], cloud, images, &self.samplers);
    }

    /// Tells the next submission what the channels of light count.
    pub fn tint(&self, gpu: &Gpu, tints: &Tints) {
        gpu.write(&self.tints, &[*tints]);
    }
}
