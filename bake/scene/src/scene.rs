//! A scene as triangles in the world: metres, z up, watts.

use crate::error::SceneError;
use crate::gltf;
use glam::{DVec3, Vec3};

/// Upper bounds on what a file may ask for, checked before memory is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Triangles of all instances. A triangle takes some 250 bytes while maps are baked, 60 of them for good.
    pub triangles: u64,
    /// Elements of all accessors that are read, each decoded once however many primitives name it; of one, where it holds indices.
    pub elements: u64,
    /// Nodes and instances.
    pub nodes: u64,
    /// Bytes of all buffers and pictures beside the file.
    pub bytes: u64,
    /// Pixels of all textures, each picture decoded once however many materials name it.
    pub pixels: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { triangles: 1 << 24, elements: 1 << 27, nodes: 1 << 22, bytes: 4 << 30, pixels: 1 << 28 }
    }
}

/// How a scene is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Read {
    /// Lumens that a watt stands for: glTF's lamps are in candela and its emission in candela a square metre. 683 is the usual
    /// exchange rate (Blender's "standard"), 1 takes the file's numbers as watts.
    pub lumens_per_watt: f64,
    /// Keep vertex normals, for pictures.
    pub normals: bool,
    /// Keep the second set of texture coordinates, for light maps.
    pub second_uv: bool,
    /// Upper bounds.
    pub limits: Limits,
}

impl Default for Read {
    fn default() -> Self {
        Self { lumens_per_watt: 683.0, normals: false, second_uv: false, limits: Limits::default() }
    }
}

/// What a surface is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name in the file; empty where it has none.
    pub name: String,
    /// Base colour, the share of light that it reflects, 0 to 1.
    pub base: [f32; 3],
    /// Radiance that it emits, W/(m² sr).
    pub emission: [f32; 3],
    /// Perceptual roughness, 0 to 1.
    pub roughness: f32,
    /// Share of metal, 0 to 1.
    pub metal: f32,
    /// Whether both sides are drawn and shine.
    pub two_sided: bool,
    /// Light passes through it (glTF's blending), rain does not.
    pub clear: bool,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            base: [1.0; 3],
            emission: [0.0; 3],
            roughness: 1.0,
            metal: 0.0,
            two_sided: false,
            clear: false,
        }
    }
}

impl Material {
    /// Whether it emits light.
    pub fn shines(&self) -> bool {
        self.emission.iter().any(|band| *band > 0.0)
    }
}

/// How a lamp shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LampKind {
    /// Alike in all directions; `power` is W/sr.
    Point,
    /// In a cone; `power` is W/sr.
    Spot {
        /// Unit direction that the light travels in.
        direction: DVec3,
        /// Cosines of the angles from it at which light begins to fade, and is gone.
        cosines: [f64; 2],
    },
    /// From far away; `power` is W/m² across it.
    Distant {
        /// Unit direction towards the light.
        towards: DVec3,
    },
}

/// A lamp without extent.
#[derive(Clone, Debug, PartialEq)]
pub struct Lamp {
    /// Its name in the file.
    pub name: String,
    /// Where, m; nothing to a distant one.
    pub position_m: DVec3,
    /// Red, green and blue: [`LampKind`] says in which unit.
    pub power: [f64; 3],
    /// How it shines.
    pub kind: LampKind,
}

/// What was read, and what was not.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SceneReport {
    /// Triangles that have an area.
    pub triangles: u64,
    /// Triangles without one (or with a corner that is no number), which were left out.
    pub degenerate: u64,
    /// Meshes placed in the world, instances counted one by one.
    pub instances: u64,
    /// Points and lines, which rain does not meet.
    pub skipped_primitives: u64,
    /// Meshes with bones, which were taken in the pose that the file gives them.
    pub skinned: u64,
    /// Textures that could not be read and why; their materials have the factors alone.
    pub unread_textures: Vec<String>,
}

impl SceneReport {
    /// What was left out, in words; `None` where nothing was.
    pub fn left_out(&self) -> Option<String> {
        let mut words = Vec::new();
        if self.degenerate > 0 {
            words.push(format!("{} triangles without area left out", self.degenerate));
        }
        if self.skipped_primitives > 0 {
            words.push(format!("{} sets of points or lines left out", self.skipped_primitives));
        }
        if self.skinned > 0 {
            words.push(format!("{} meshes with bones taken in the pose of the file", self.skinned));
        }
        words.extend(self.unread_textures.iter().map(|why| format!("texture not read: {why}")));
        (!words.is_empty()).then(|| words.join("; "))
    }
}

/// A scene as triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// Corners, m, counter-clockwise from the front.
    pub triangles: Vec<[Vec3; 3]>,
    /// Material of each triangle.
    pub material: Vec<u32>,
    /// Mean of the base colour's texture over each triangle, as square roots over 255; empty where no material has a texture.
    pub paint: Vec<[u8; 3]>,
    /// Normals of the corners, where they were asked for; `[0; 3]` where the file has none.
    pub normals: Vec<[Vec3; 3]>,
    /// Second texture coordinates of the corners, where they were asked for; NaN where the file has none.
    pub second_uv: Vec<[[f32; 2]; 3]>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Lamps.
    pub lamps: Vec<Lamp>,
    /// What was read.
    pub report: SceneReport,
}

/// Files beside a scene: a name as the file has it (percent-decoded) and the most bytes that are taken, to the file's bytes.
pub type Beside<'a> = dyn FnMut(&str, u64) -> Result<Vec<u8>, SceneError> + 'a;

impl Scene {
    /// Reads glTF 2.0, .glb or .gltf, told apart by the first bytes. `beside` reads files that it names.
    ///
    /// Errors: bytes that are no glTF; a required extension that isn't read, by name; buffers, accessors or nodes that contradict each
    /// other; more than the limits allow; no triangle.
    pub fn read(bytes: &[u8], beside: &mut Beside<'_>, how: &Read) -> Result<Self, SceneError> {
        gltf::read(bytes, beside, how)
    }

    /// Smallest and largest corner, m.
    pub fn bounds(&self) -> [Vec3; 2] {
        self.triangles.iter().flatten().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], corner| {
            [low.min(*corner), high.max(*corner)]
        })
    }

    /// Base colour of a triangle, its texture's mean included.
    pub fn base(&self, triangle: usize) -> [f32; 3] {
        let mut base = self.materials[self.material[triangle] as usize].base;
        if let Some(paint) = self.paint.get(triangle) {
            for (band, paint) in base.iter_mut().zip(paint) {
                let root = f32::from(*paint) / 255.0;
                *band *= root * root;
            }
        }
        base
    }
}

#[cfg(test)]
mod tests;
