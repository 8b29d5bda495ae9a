//! Nodes: where meshes and lamps stand. Instances are placed one by one.

use super::File;
use super::images::Paint;
use super::primitives::{Shapes, place_mesh};
use crate::error::SceneError;
use crate::scene::{Lamp, LampKind, Scene};
use glam::{DMat4, DQuat, DVec3, Vec4};
use gltf::json::extensions::scene::khr_lights_punctual::{Light, Type};
use gltf::json::scene::Node;
use gltf::json::validation::Checked;

/// glTF's y up to our z up: a quarter turn about x.
const UPRIGHT: DMat4 = DMat4::from_cols_array(&[
    1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0,
]);

/// Farthest that a number of a transform may be from 0.
const FARTHEST: f64 = 1e7;

/// Places all meshes and lamps of the file's scene.
pub(super) fn place(file: &File<'_>, paints: &[Option<Paint>], scene: &mut Scene) -> Result<(), SceneError> {
    let nodes = &file.root.nodes;
    if nodes.len() as u64 > file.how.limits.nodes {
        let wanted = format!("at most {}", file.how.limits.nodes);
        return Err(SceneError::input("nodes", wanted, nodes.len()));
    }
    let mut shapes = Shapes::new(file, paints);
    let mut seen = vec![false; nodes.len()];
    let mut stack: Vec<(usize, DMat4)> = roots(file)?.into_iter().rev().map(|node| (node, UPRIGHT)).collect();
    while let Some((index, above)) = stack.pop() {
        let field = || format!("nodes[{index}]");
        let node = nodes.get(index).ok_or_else(|| SceneError::input(field(), "a node", "none"))?;
        if std::mem::replace(&mut seen[index], true) {
            return Err(SceneError::input(field(), "one parent", "two, or itself among its children"));
        }
        let place = above * transform(node, &field())?;
        if !place.to_cols_array().iter().all(|number| number.abs() <= FARTHEST) {
            return Err(SceneError::input(field(), "a place within 10⁷ m", format!("{place:?}")));
        }
        if let Some(mesh) = node.mesh {
            scene.report.skinned += u64::from(node.skin.is_some());
            for instance in instances(file, node, &field())? {
                place_mesh(&mut shapes, mesh.value(), &(place * instance), scene)?;
            }
        }
        if let Some(light) = node.extensions.as_ref().and_then(|more| more.khr_lights_punctual.as_ref()) {
            scene.lamps.push(lamp(file, light.light.value(), &place)?);
        }
        for child in node.children.iter().flatten().rev() {
            stack.push((child.value(), place));
        }
    }
    Ok(())
}

/// Nodes that the scene to be shown begins with; of a file without scenes, those that are nobody's children.
fn roots(file: &File<'_>) -> Result<Vec<usize>, SceneError> {
    let root = file.root;
    let scene = root.scene.map_or(0, |scene| scene.value());
    if let Some(scene) = root.scenes.get(scene) {
        return Ok(scene.nodes.iter().map(|node| node.value()).collect());
    }
    if root.scene.is_some() {
        return Err(SceneError::input("scene", "a scene that is there", scene));
    }
    let mut child = vec![false; root.nodes.len()];
    for node in root.nodes.iter().flat_map(|node| node.children.iter().flatten()) {
        if let Some(child) = child.get_mut(node.value()) {
            *child = true;
        }
    }
    Ok((0..root.nodes.len()).filter(|node| !child[*node]).collect())
}

fn transform(node: &Node, field: &str) -> Result<DMat4, SceneError> {
    let numbers = |values: &[f32]| values.iter().all(|value| value.is_finite());
    let refuse = || Err(SceneError::input(field, "a transform of finite numbers", "others"));
    if let Some(matrix) = node.matrix {
        if !numbers(&matrix) {
            return refuse();
        }
        return Ok(DMat4::from_cols_array(&matrix.map(f64::from)));
    }
    let place = node.translation.unwrap_or([0.0; 3]);
    let scale = node.scale.unwrap_or([1.0; 3]);
    let turn = node.rotation.unwrap_or_default().0;
    if !(numbers(&place) && numbers(&scale) && numbers(&turn)) {
        return refuse();
    }
    Ok(placed(place, turn, scale))
}

fn placed(place: [f32; 3], turn: [f32; 4], scale: [f32; 3]) -> DMat4 {
    let turn = DQuat::from_array(turn.map(f64::from));
    let turn = if turn.length_squared() > 1e-12 { turn.normalize() } else { DQuat::IDENTITY };
    let vector = |values: [f32; 3]| DVec3::from_array(values.map(f64::from));
    DMat4::from_scale_rotation_translation(vector(scale), turn, vector(place))
}

/// Transforms of a node's instances (EXT_mesh_gpu_instancing): one, the identity, where it has none.
fn instances(file: &File<'_>, node: &Node, field: &str) -> Result<Vec<DMat4>, SceneError> {
    let more = node.extensions.as_ref().and_then(|more| more.others.get("EXT_mesh_gpu_instancing"));
    let Some(attributes) = more.and_then(|more| more.get("attributes")) else {
        return Ok(vec![DMat4::IDENTITY]);
    };
    let accessor = |name: &str| attributes.get(name).and_then(|index| index.as_u64());
    let what = format!("{field}: EXT_mesh_gpu_instancing");
    let places = accessor("TRANSLATION").map(|index| file.numbers::<3>(index as usize, &what)).transpose()?;
    let turns = accessor("ROTATION").map(|index| file.numbers::<4>(index as usize, &what)).transpose()?;
    let scales = accessor("SCALE").map(|index| file.numbers::<3>(index as usize, &what)).transpose()?;
    let counts = [places.as_ref().map(Vec::len), turns.as_ref().map(Vec::len), scales.as_ref().map(Vec::len)];
    let mut given = counts.iter().flatten();
    let Some(&count) = given.next() else { return Ok(vec![DMat4::IDENTITY]) };
    if given.any(|other| *other != count) || count as u64 > file.how.limits.nodes {
        let wanted = format!("as many of each, at most {}", file.how.limits.nodes);
        return Err(SceneError::input(what, wanted, format!("{counts:?}")));
    }
    Ok((0..count)
        .map(|at| {
            let place = places.as_ref().map_or([0.0; 3], |all| all[at]);
            let turn = turns.as_ref().map_or(Vec4::W.to_array(), |all| all[at]);
            placed(place, turn, scales.as_ref().map_or([1.0; 3], |all| all[at]))
        })
        .collect())
}

fn lamp(file: &File<'_>, index: usize, place: &DMat4) -> Result<Lamp, SceneError> {
    let all = file.root.extensions.as_ref().and_then(|more| more.khr_lights_punctual.as_ref());
    let field = format!("KHR_lights_punctual.lights[{index}]");
    let light: &Light = all
        .and_then(|all| all.lights.get(index))
        .ok_or_else(|| SceneError::input(field.clone(), "a light that is there", "none"))?;
    let power =
        light.color.map(|band| f64::from(band) * f64::from(light.intensity) / file.how.lumens_per_watt);
    if power.iter().any(|band| !(*band >= 0.0 && *band <= 1e12)) {
        let found = format!("{:?} × {}", light.color, light.intensity);
        return Err(SceneError::input(field, "an intensity of 0 or more", found));
    }
    // Lamps look along their own −z.
    let direction = place.transform_vector3(DVec3::NEG_Z).normalize_or(DVec3::NEG_Z);
    let kind = match (light.type_, &light.spot) {
        (Checked::Valid(Type::Directional), _) => LampKind::Distant { towards: -direction },
        (Checked::Valid(Type::Spot), Some(spot)) => {
            let angles = [f64::from(spot.inner_cone_angle), f64::from(spot.outer_cone_angle)];
            if !(0.0 <= angles[0] && angles[0] <= angles[1] && angles[1] <= std::f64::consts::FRAC_PI_2) {
                let wanted = "cone angles that rise, 0 to 90°";
                return Err(SceneError::input(field, wanted, format!("{angles:?} rad")));
            }
            LampKind::Spot { direction, cosines: angles.map(libm::cos) }
        }
        (Checked::Valid(Type::Point), _) => LampKind::Point,
        _ => return Err(SceneError::input(field, "a point, spot or directional light", "another")),
    };
    let name = light.name.clone().unwrap_or_default();
    Ok(Lamp { name, position_m: place.transform_point3(DVec3::ZERO), power, kind })
}
