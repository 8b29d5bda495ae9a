//! Scenes as .glb files.

use crate::scene::{Lamp, LampKind, Material};
use glam::{DQuat, DVec3};
use serde_json::{Value, json};

/// Triangles of one material on their way into a mesh: metres, z up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Part {
    /// Places of the vertices, m.
    pub places: Vec<[f32; 3]>,
    /// Unit normals of the vertices; flat triangles where there are none.
    pub normals: Vec<[f32; 3]>,
    /// Corners of the triangles, counter-clockwise from the front.
    pub corners: Vec<[u32; 3]>,
    /// Number of the material, as [`GlbWriter::material`] gave it.
    pub material: u32,
}

/// Puts a scene into a .glb: materials, meshes, nodes and lamps in the order in which they are added.
pub struct GlbWriter {
    lumens_per_watt: f64,
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    materials: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
    lamps: Vec<Value>,
}

/// glTF's axes: y up.
fn turned([x, y, z]: [f32; 3]) -> [f32; 3] {
    [x, z, -y]
}

/// A number without the noise of its last digits.
fn short(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

impl GlbWriter {
    /// An empty scene. Lamps and emission are written in lumens, of which `lumens_per_watt` are a watt (usually 683).
    pub fn new(lumens_per_watt: f64) -> Self {
        Self {
            lumens_per_watt,
            bytes: Vec::new(),
            views: Vec::new(),
            accessors: Vec::new(),
            materials: Vec::new(),
            meshes: Vec::new(),
            nodes: Vec::new(),
            lamps: Vec::new(),
        }
    }

    /// Adds a material and gives its number.
    pub fn material(&mut self, material: &Material) -> u32 {
        let [red, green, blue] = material.base.map(|band| short(f64::from(band)));
        let alpha = if material.clear { 0.3 } else { 1.0 };
        let mut value = json!({
            "name": material.name,
            "pbrMetallicRoughness": {
                "baseColorFactor": [red, green, blue, alpha],
                "metallicFactor": short(f64::from(material.metal)),
                "roughnessFactor": short(f64::from(material.roughness)),
            },
        });
        if material.two_sided {
            value["doubleSided"] = json!(true);
        }
        if material.clear {
            value["alphaMode"] = json!("BLEND");
        }
        let brightest = material.emission.iter().copied().fold(0.0, f32::max);
        if brightest > 0.0 {
            // Factors end at 1; what is brighter is the strength.
            value["emissiveFactor"] = json!(material.emission.map(|band| short(f64::from(band / brightest))));
            let strength = short(f64::from(brightest) * self.lumens_per_watt);
            value["extensions"] =
                json!({ "KHR_materials_emissive_strength": { "emissiveStrength": strength } });
        }
        self.materials.push(value);
        self.materials.len() as u32 - 1
    }

    /// Adds a mesh and gives its number. Parts without triangles are left out.
    pub fn mesh(&mut self, name: &str, parts: &[Part]) -> usize {
        let mut primitives = Vec::new();
        for part in parts.iter().filter(|part| !part.corners.is_empty()) {
            let mut attributes = json!({ "POSITION": self.vectors(&part.places, true) });
            if !part.normals.is_empty() {
                attributes["NORMAL"] = self.vectors(&part.normals, false).into();
            }
            let indices = self.indices(&part.corners, part.places.len());
            primitives
                .push(json!({ "attributes": attributes, "indices": indices, "material": part.material }));
        }
        self.meshes.push(json!({ "name": name, "primitives": primitives }));
        self.meshes.len() - 1
    }

    /// Places a mesh, turned about the vertical.
    pub fn place(&mut self, name: &str, mesh: usize, at: DVec3, yaw: f64) {
        let mut node = json!({ "name": name, "mesh": mesh });
        Self::moved(&mut node, at, DQuat::from_xyzw(0.0, libm::sin(0.5 * yaw), 0.0, libm::cos(0.5 * yaw)));
        self.nodes.push(node);
    }

    /// Adds a lamp (KHR_lights_punctual).
    pub fn lamp(&mut self, lamp: &Lamp) {
        let brightest = lamp.power.iter().copied().fold(0.0, f64::max);
        let colour = lamp.power.map(|band| if brightest > 0.0 { short(band / brightest) } else { 1.0 });
        let intensity = short(brightest * self.lumens_per_watt);
        let mut light = json!({ "name": lamp.name, "color": colour, "intensity": intensity });
        let mut direction = DVec3::NEG_Z;
        light["type"] = json!(match lamp.kind {
            LampKind::Point => "point",
            LampKind::Spot { .. } => "spot",
            LampKind::Distant { .. } => "directional",
        });
        match lamp.kind {
            LampKind::Point => {}
            LampKind::Spot { direction: along, cosines } => {
                direction = along;
                let [inner, outer] = cosines.map(|cosine| short(libm::acos(cosine)));
                light["spot"] = json!({ "innerConeAngle": inner, "outerConeAngle": outer });
            }
            LampKind::Distant { towards } => direction = -towards,
        }
        self.lamps.push(light);
        let index = self.lamps.len() - 1;
        let mut node = json!({
            "name": lamp.name,
            "extensions": { "KHR_lights_punctual": { "light": index } },
        });
        // Lamps look along their −z.
        let along = DVec3::new(direction.x, direction.z, -direction.y);
        Self::moved(&mut node, lamp.position_m, DQuat::from_rotation_arc(DVec3::NEG_Z, along.normalize()));
        self.nodes.push(node);
    }

    fn moved(node: &mut Value, at: DVec3, turn: DQuat) {
        let at = [at.x, at.z, -at.y].map(short);
        if at != [0.0; 3] {
            node["translation"] = json!(at);
        }
        if turn.w.abs() < 1.0 - 1e-12 {
            node["rotation"] = json!(turn.to_array().map(|part| (part * 1e9).round() / 1e9));
        }
    }

    fn view(&mut self, bytes: &[u8], target: u32) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let offset = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        self.views.push(json!({
            "buffer": 0, "byteOffset": offset, "byteLength": bytes.len(), "target": target,
        }));
        self.views.len() - 1
    }

    fn vectors(&mut self, vectors: &[[f32; 3]], bounds: bool) -> usize {
        let turned: Vec<[f32; 3]> = vectors.iter().map(|vector| turned(*vector)).collect();
        let bytes: Vec<u8> = turned.iter().flatten().flat_map(|number| number.to_le_bytes()).collect();
        let view = self.view(&bytes, 34_962);
        let mut accessor =
            json!({ "bufferView": view, "componentType": 5126, "count": vectors.len(), "type": "VEC3" });
        if bounds {
            for (name, pick) in [("min", f32::min as fn(f32, f32) -> f32), ("max", f32::max)] {
                let corner: [f32; 3] = std::array::from_fn(|axis| {
                    turned.iter().map(|vector| vector[axis]).reduce(pick).unwrap_or_default()
                });
                accessor[name] = json!(corner);
            }
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn indices(&mut self, corners: &[[u32; 3]], vertices: usize) -> usize {
        // 65535 itself would restart a strip.
        let (kind, bytes): (u32, Vec<u8>) = if vertices < 65_536 {
            (5123, corners.iter().flatten().flat_map(|index| (*index as u16).to_le_bytes()).collect())
        } else {
            (5125, corners.iter().flatten().flat_map(|index| index.to_le_bytes()).collect())
        };
        let view = self.view(&bytes, 34_963);
        let count = 3 * corners.len();
        self.accessors
            .push(json!({ "bufferView": view, "componentType": kind, "count": count, "type": "SCALAR" }));
        self.accessors.len() - 1
    }

    /// The file. `generator` is what made it.
    pub fn finish(mut self, generator: &str) -> Vec<u8> {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let nodes: Vec<usize> = (0..self.nodes.len()).collect();
        let mut root = json!({
            "asset": { "version": "2.0", "generator": generator },
            "scene": 0,
            "scenes": [{ "nodes": nodes }],
            "nodes": self.nodes,
        });
        let lists = [
            ("meshes", self.meshes),
            ("materials", self.materials),
            ("accessors", self.accessors),
            ("bufferViews", self.views),
        ];
        // Empty lists are no glTF.
        for (name, list) in lists.into_iter().filter(|(_, list)| !list.is_empty()) {
            root[name] = list.into();
        }
        if !self.bytes.is_empty() {
            root["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        }
        let mut used = vec!["KHR_materials_emissive_strength"];
        if !self.lamps.is_empty() {
            used.push("KHR_lights_punctual");
            root["extensions"] = json!({ "KHR_lights_punctual": { "lights": self.lamps } });
        }
        root["extensionsUsed"] = json!(used);
        let mut text = root.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let length = 12 + 8 + text.len() + 8 + self.bytes.len();
        let mut file = b"glTF\x02\0\0\0".to_vec();
        file.extend_from_slice(&(length as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &self.bytes)] {
            file.extend_from_slice(&(chunk.len() as u32).to_le_bytes());
            file.extend_from_slice(kind);
            file.extend_from_slice(chunk);
        }
        file
    }
}
