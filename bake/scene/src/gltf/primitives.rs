//! Meshes: triangles of any primitive, placed in the world.

use super::File;
use super::images::Paint;
use crate::error::SceneError;
use crate::scene::Scene;
use glam::{DMat3, DMat4, DVec3, Vec3};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use std::collections::BTreeMap;
use std::rc::Rc;

/// Meshes as they were read; an instance reads none again.
pub(super) struct Shapes<'a> {
    file: &'a File<'a>,
    paints: &'a [Option<Paint>],
    known: BTreeMap<usize, Rc<Vec<Shape>>>,
    /// Accessors that were decoded: primitives share them.
    pairs: BTreeMap<usize, Numbers<2>>,
    triples: BTreeMap<usize, Numbers<3>>,
    /// Triangles of all shapes, each counted once.
    triangles: u64,
}

/// Elements of an accessor.
type Numbers<const N: usize> = Rc<Vec<[f32; N]>>;

/// The accessor of that index, decoded unless it was before.
fn decoded<const N: usize>(
    file: &File<'_>,
    known: &mut BTreeMap<usize, Numbers<N>>,
    index: usize,
    what: &str,
) -> Result<Numbers<N>, SceneError> {
    if let Some(known) = known.get(&index) {
        return Ok(known.clone());
    }
    let numbers = Rc::new(file.numbers::<N>(index, what)?);
    known.insert(index, numbers.clone());
    Ok(numbers)
}

/// Refuses more triangles than are allowed.
fn few_enough(triangles: u64, file: &File<'_>) -> Result<(), SceneError> {
    let most = file.how.limits.triangles;
    if triangles > most {
        let wanted = format!("at most {most} triangles, instances counted one by one");
        return Err(SceneError::input("meshes", wanted, "more"));
    }
    Ok(())
}

/// One primitive's triangles.
struct Shape {
    places: Numbers<3>,
    normals: Option<Numbers<3>>,
    second_uv: Option<Numbers<2>>,
    corners: Vec<[u32; 3]>,
    material: u32,
    /// Means of the texture, where its material has one.
    paint: Option<Vec<[u8; 3]>>,
}

/// Smallest area of a triangle, m², and its smallest height over its longest side: below, it has neither inside nor normal in single precision.
const LEAST_AREA: f64 = 1e-10;
const LEAST_HEIGHT: f64 = 1e-6;

impl<'a> Shapes<'a> {
    pub(super) fn new(file: &'a File<'a>, paints: &'a [Option<Paint>]) -> Self {
        Self {
            file,
            paints,
            known: BTreeMap::new(),
            pairs: BTreeMap::new(),
            triples: BTreeMap::new(),
            triangles: 0,
        }
    }

    fn mesh(&mut self, index: usize, scene: &mut Scene) -> Result<Rc<Vec<Shape>>, SceneError> {
        if let Some(known) = self.known.get(&index) {
            return Ok(known.clone());
        }
        let mesh = self.file.root.meshes.get(index);
        let mesh = mesh
            .ok_or_else(|| SceneError::input(format!("meshes[{index}]"), "a mesh that is there", "none"))?;
        let mut shapes = Vec::new();
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            let field = format!("meshes[{index}].primitives[{number}]");
            match self.shape(primitive, &field)? {
                Some(shape) => shapes.push(shape),
                None => scene.report.skipped_primitives += 1,
            }
        }
        let shapes = Rc::new(shapes);
        self.known.insert(index, shapes.clone());
        Ok(shapes)
    }

    fn shape(&mut self, primitive: &Primitive, field: &str) -> Result<Option<Shape>, SceneError> {
        let Checked::Valid(mode) = primitive.mode else {
            return Err(SceneError::input(format!("{field}.mode"), "a kind of primitive, 0 to 6", "another"));
        };
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            return Ok(None);
        }
        let attribute = |semantic: Semantic| primitive.attributes.get(&Checked::Valid(semantic));
        let places = attribute(Semantic::Positions)
            .ok_or_else(|| SceneError::input(format!("{field}.attributes"), "POSITION", "none"))?;
        let places = decoded(self.file, &mut self.triples, places.value(), &format!("{field}.POSITION"))?;
        let order = match primitive.indices {
            Some(indices) => self.file.indices(indices.value(), places.len(), &format!("{field}.indices"))?,
            None => (0..places.len() as u32).collect(),
        };
        let corners = corners(mode, &order);
        self.triangles += corners.len() as u64;
        few_enough(self.triangles, self.file)?;
        let material = match primitive.material {
            Some(material) if material.value() + 1 < self.paints.len() => material.value(),
            Some(material) => {
                let wanted = format!("below {}", self.paints.len() - 1);
                return Err(SceneError::input(format!("{field}.material"), wanted, material.value()));
            }
            None => self.paints.len() - 1,
        };
        let per_vertex = |count: usize, name: &str| {
            if count == places.len() {
                return Ok(());
            }
            let wanted = format!("as many as there are places, {}", places.len());
            Err(SceneError::input(format!("{field}.{name}"), wanted, count))
        };
        let mut pairs = |set: u32| {
            let Some(accessor) = attribute(Semantic::TexCoords(set)) else { return Ok(None) };
            let name = format!("TEXCOORD_{set}");
            let values = decoded(self.file, &mut self.pairs, accessor.value(), &format!("{field}.{name}"))?;
            per_vertex(values.len(), &name)?;
            Ok::<_, SceneError>(Some(values))
        };
        let mut paint = None;
        if let Some(texture) = &self.paints[material]
            && let Some(uv) = pairs(texture.set)?
        {
            let means = corners.iter().map(|corners| texture.mean(corners.map(|at| uv[at as usize])));
            paint = Some(means.collect());
        }
        let second_uv = if self.file.how.second_uv { pairs(1)? } else { None };
        let mut normals = None;
        if let (true, Some(accessor)) = (self.file.how.normals, attribute(Semantic::Normals)) {
            let values = decoded(self.file, &mut self.triples, accessor.value(), &format!("{field}.NORMAL"))?;
            per_vertex(values.len(), "NORMAL")?;
            normals = Some(values);
        }
        Ok(Some(Shape { places, normals, second_uv, corners, material: material as u32, paint }))
    }
}

/// Corners of the triangles of a list, a strip or a fan; strips keep their side by turning every other triangle.
fn corners(mode: Mode, order: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => (order.windows(3).enumerate())
            .map(|(at, w)| if at % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] })
            .collect(),
        Mode::TriangleFan if order.len() > 2 => {
            order[1..].windows(2).map(|pair| [pair[0], pair[1], order[0]]).collect()
        }
        Mode::Triangles => order.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
        _ => Vec::new(),
    }
}

/// Puts a mesh into the scene by a transform.
pub(super) fn place_mesh(
    shapes: &mut Shapes<'_>,
    index: usize,
    place: &DMat4,
    scene: &mut Scene,
) -> Result<(), SceneError> {
    let mesh = shapes.mesh(index, scene)?;
    let how = shapes.file.how;
    scene.report.instances += 1;
    if scene.report.instances > how.limits.nodes {
        let wanted = format!("at most {} instances", how.limits.nodes);
        return Err(SceneError::input("meshes", wanted, "more"));
    }
    let painted = shapes.paints.iter().any(Option::is_some);
    // A mirrored mesh turns its triangles round.
    let mirrored = place.determinant() < 0.0;
    let about = DMat3::from_mat4(*place);
    let about = if about.determinant().abs() > 1e-30 { about.inverse().transpose() } else { DMat3::IDENTITY };
    for shape in mesh.iter() {
        let more = scene.triangles.len() as u64 + scene.report.degenerate + shape.corners.len() as u64;
        few_enough(more, shapes.file)?;
        for (at, corners) in shape.corners.iter().enumerate() {
            let mut corners = *corners;
            if mirrored {
                corners.swap(1, 2);
            }
            let triangle = corners.map(|vertex| {
                place.transform_point3(DVec3::from_array(shape.places[vertex as usize].map(f64::from)))
            });
            if !has_area(&triangle) {
                scene.report.degenerate += 1;
                continue;
            }
            scene.triangles.push(triangle.map(|corner| corner.as_vec3()));
            scene.material.push(shape.material);
            if painted {
                scene.paint.push(shape.paint.as_ref().map_or([255; 3], |paint| paint[at]));
            }
            if how.normals {
                let normal = |vertex: u32| {
                    let Some(normals) = &shape.normals else { return Vec3::ZERO };
                    let normal = DVec3::from_array(normals[vertex as usize].map(f64::from));
                    (about * normal).as_vec3().normalize_or_zero()
                };
                scene.normals.push(corners.map(normal));
            }
            if how.second_uv {
                let uv =
                    |vertex: u32| shape.second_uv.as_ref().map_or([f32::NAN; 2], |uv| uv[vertex as usize]);
                scene.second_uv.push(corners.map(uv));
            }
        }
    }
    Ok(())
}

/// Whether a triangle has an inside; no number beyond 10⁷ m has.
fn has_area(triangle: &[DVec3; 3]) -> bool {
    let [a, b, c] = *triangle;
    let twice = (b - a).cross(c - a).length();
    let longest = (b - a).length_squared().max((c - a).length_squared()).max((c - b).length_squared());
    let near = triangle.iter().all(|corner| corner.abs().max_element() <= 1e7);
    near && twice > 2.0 * LEAST_AREA && twice > LEAST_HEIGHT * longest
}
