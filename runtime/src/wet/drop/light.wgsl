// Light on drops: the picture made small, the world beyond it, lamps overhead, lightning; and what balls of water show of it, by the normal, a tile of
// the picture each. Group 2. (wet/drop/light.rs, wet/drop/ball.rs)

struct DropLight {
    // The camera: to the right, up, forward.
    right: vec3f,
    is_perspective: u32,
    up: vec3f,
    // Bent once, as the paper prints it.
    is_paper: u32,
    forward: vec3f,
    // Irradiances of the two key directions' lightning now.
    flash_0: f32,
    sun_towards: vec3f,
    flash_1: f32,
    sun_irradiance: vec3f,
    lamp_height: f32,
    // Unit vectors; the fourth number is 0 where there is none, and light comes from everywhere.
    keys: array<vec4f, 2>,
    // Corner of the volume of lightning's light, from the eye, m, and its cells' side.
    volume_origin: vec3f,
    volume_cell: f32,
    volume_size: vec3u,
    // Blocks of the small picture in a row.
    columns: u32,
    // Pixels a unit of tangent, and the axis's pixel.
    scale: vec2f,
    centre: vec2f,
    size: vec2u,
    // Corner of the map of light from overhead, from the eye, m; no cells where there is none.
    overhead_origin: vec2f,
    overhead_size: vec2u,
    overhead_cell: f32,
    // Cells that the map is asked beside a place, uphill and downhill.
    uphill: f32,
}

const WATER_INDEX: f32 = 1.333;
const SMALL_BLOCK: u32 = 8u;
const TILES: vec2u = vec2u(16u, 12u);
const ENTRIES: u32 = 341u;
// Steps along the side of the world's map.
const WORLD_STEPS: u32 = 160u;
const DROP_ASYMMETRY: f32 = 0.77;
const MARGIN: f32 = 0.06;
const FARTHEST_LAMP: f32 = 2.5;

@group(2) @binding(0) var<uniform> water: DropLight;
@group(2) @binding(1) var<storage, read_write> small: array<vec4f>;
@group(2) @binding(2) var<storage, read_write> tables: array<vec4f>;
@group(2) @binding(3) var<storage, read> world: array<vec4f>;
@group(2) @binding(4) var<storage, read> overhead: array<vec4f>;
@group(2) @binding(5) var<storage, read> lightning: array<f32>;

// Share of light that water reflects. (wet/material.rs)
fn water_fresnel(cosine: f32) -> f32 {
    let c = clamp(cosine, 0.0, 1.0);
    let g = sqrt(WATER_INDEX * WATER_INDEX - 1.0 + c * c);
    let sides = (g - c) / (g + c);
    let ratio = (c * (g + c) - 1.0) / (c * (g - c) + 1.0);
    return 0.5 * sides * sides * (1.0 + ratio * ratio);
}

// Offset of what is seen at pixel coordinates at a depth. (Eye::at)
fn seen_at(pixel: vec2f, depth: f32) -> vec3f {
    let across = (pixel - water.centre) / water.scale;
    let side = water.right * across.x - water.up * across.y;
    if water.is_perspective == 1u {
        return (water.forward + side) * depth;
    }
    return water.forward * depth + side;
}

fn seen_towards(offset: vec3f) -> vec3f {
    return select(water.forward, normalize(offset), water.is_perspective == 1u);
}

// Axes across a view: to its right, and up.
fn axes_across(direction: vec3f) -> array<vec3f, 2> {
    let right = normalize(cross(direction, water.up));
    return array<vec3f, 2>(right, cross(right, direction));
}

// The world's light from a direction, between the nodes of its map.
fn world_at(direction: vec3f) -> vec3f {
    let place = clamp(octahedron_fold(direction) * 0.5 + 0.5, vec2f(0.0), vec2f(1.0)) * f32(WORLD_STEPS);
    let cell = min(vec2u(place), vec2u(WORLD_STEPS - 1u));
    let part = place - vec2f(cell);
    let at = cell.y * (WORLD_STEPS + 1u) + cell.x;
    let low = mix(world[at].xyz, world[at + 1u].xyz, part.x);
    let high = mix(world[at + WORLD_STEPS + 1u].xyz, world[at + WORLD_STEPS + 2u].xyz, part.x);
    return mix(low, high, part.y);
}

// The small picture between its blocks' middles.
fn small_at(pixel: vec2f) -> vec3f {
    let last = vec2u(water.columns, arrayLength(&small) / water.columns) - 1u;
    let place = clamp(pixel / f32(SMALL_BLOCK) - 0.5, vec2f(0.0), vec2f(last));
    let near = vec2u(place);
    let far = min(near + 1u, last);
    let part = place - vec2f(near);
    let rows = vec2u(near.y, far.y) * water.columns;
    let high = mix(small[rows.x + near.x].xyz, small[rows.x + far.x].xyz, part.x);
    let low = mix(small[rows.y + near.x].xyz, small[rows.y + far.x].xyz, part.x);
    return mix(high, low, part.y);
}

// Radiance from a direction: the picture's where it shows that direction, the world's outside.
fn surroundings(direction: vec3f) -> vec3f {
    let along = dot(direction, water.forward);
    if water.is_perspective == 0u || along < 1e-3 {
        return world_at(direction);
    }
    let far = vec2f(dot(direction, water.right), -dot(direction, water.up)) / along * water.scale + water.centre;
    let share = far / vec2f(water.size);
    let edge = min(min(share.x, 1.0 - share.x), min(share.y, 1.0 - share.y));
    if edge <= 0.0 {
        return world_at(direction);
    }
    let seen = small_at(far);
    if edge < MARGIN {
        return mix(world_at(direction), seen, edge / MARGIN);
    }
    return seen;
}

// One level of one tile's table.
fn table_level(tile: u32, spread: vec2f, level: u32) -> vec3f {
    let begin = tile * ENTRIES;
    if level >= 4u {
        return tables[begin + ENTRIES - 1u].xyz;
    }
    let side = 16u >> level;
    let place = clamp((spread * 0.5 + 0.5) * f32(side) - 0.5, vec2f(0.0), vec2f(f32(side - 1u)));
    let cell = min(vec2u(place), vec2u(side - 2u));
    let part = place - vec2f(cell);
    // Levels of 256, 64, 16, 4 and 1.
    let corner = begin + (256u - side * side) / 3u * 4u + cell.y * side + cell.x;
    let low = mix(tables[corner].xyz, tables[corner + 1u].xyz, part.x);
    let high = mix(tables[corner + side].xyz, tables[corner + side + 1u].xyz, part.x);
    return mix(low, high, part.y);
}

// What balls of water at a pixel show where their normal leans by `spread`, blurred by `level`; between four tiles and two levels.
fn shown(pixel: vec2f, spread: vec2f, level: f32) -> vec3f {
    let place = clamp(pixel / vec2f(water.size) * vec2f(TILES) - 0.5, vec2f(0.0), vec2f(TILES - 1u));
    let tile = min(vec2u(place), TILES - 2u);
    let part = place - vec2f(tile);
    let held = clamp(level, 0.0, 4.0);
    let fine = u32(held);
    let share = held - f32(fine);
    var sum = vec3f(0.0);
    for (var k = 0u; k < 4u; k++) {
        let step = vec2u(k & 1u, k >> 1u);
        let weights = select(1.0 - part, part, step == vec2u(1u));
        let number = (tile.y + step.y) * TILES.x + tile.x + step.x;
        var light = table_level(number, spread, fine);
        if share > 0.02 {
            light = mix(light, table_level(number, spread, fine + 1u), share);
        }
        sum += weights.x * weights.y * light;
    }
    return sum;
}

// Light from overhead at a place from the eye, and 0 where there is none.
fn overhead_at(place: vec2f) -> vec3f {
    let cells = (place - water.overhead_origin) / water.overhead_cell;
    if any(cells < vec2f(0.0)) || any(cells >= vec2f(water.overhead_size)) {
        return vec3f(0.0);
    }
    let last = water.overhead_size - 1u;
    let at = clamp(cells - 0.5, vec2f(0.0), vec2f(last));
    let first = min(vec2u(at), max(last, vec2u(1u)) - 1u);
    let second = min(first + 1u, last);
    let part = at - vec2f(first);
    let rows = vec2u(first.y, second.y) * water.overhead_size.x;
    let low = mix(overhead[rows.x + first.x].xyz, overhead[rows.x + second.x].xyz, part.x);
    let high = mix(overhead[rows.y + first.x].xyz, overhead[rows.y + second.x].xyz, part.x);
    let value = mix(low, high, part.y);
    return select(vec3f(0.0), value, value > vec3f(0.0));
}

// Tangent of the angle between the vertical and the lamp.
fn lamp_lean(loss: f32, beyond: f32) -> f32 {
    let share = loss * water.lamp_height / 1.5;
    if share > 1.0 {
        return 1.0 / (share * share * share);
    }
    let near = share / (1.0 + sqrt(1.0 - share * share));
    let told = clamp((share - 0.03) / 0.07, 0.0, 1.0);
    let far = near + told * (min(1.0 / max(near, 1e-3), FARTHEST_LAMP) - near);
    return 0.5 * ((1.0 - beyond) * near + (1.0 + beyond) * far);
}

struct Lamp {
    towards: vec3f,
    // Across its way.
    irradiance: vec3f,
}

// Where light from lamps overhead comes from; dark where none does.
fn lamp_at(place: vec3f) -> Lamp {
    let dark = Lamp(vec3f(0.0, 0.0, 1.0), vec3f(0.0));
    if water.overhead_size.x == 0u {
        return dark;
    }
    let here = overhead_at(place.xy);
    if here.x + here.y + here.z <= 0.0 {
        return dark;
    }
    // The brightest band alone tells where the lamp is.
    var band = vec3f(1.0, 0.0, 0.0);
    var most = here.x;
    if here.y > most {
        band = vec3f(0.0, 1.0, 0.0);
        most = here.y;
    }
    if here.z > most {
        band = vec3f(0.0, 0.0, 1.0);
        most = here.z;
    }
    let cell = water.overhead_cell;
    let x = dot(overhead_at(place.xy + vec2f(cell, 0.0)) - overhead_at(place.xy - vec2f(cell, 0.0)), band);
    let y = dot(overhead_at(place.xy + vec2f(0.0, cell)) - overhead_at(place.xy - vec2f(0.0, cell)), band);
    let slopes = vec2f(x, y) / (2.0 * cell * most);
    let steep = length(slopes);
    let uphill = select(vec2f(0.0), slopes / max(steep, 1e-30), steep > 0.0);
    let step = uphill * (water.uphill * cell);
    let beside = vec2f(dot(overhead_at(place.xy + step), band), dot(overhead_at(place.xy - step), band));
    let nearer = (beside.x - most) / (beside.x + most);
    let farther = (most - beside.y) / (most + beside.y);
    let beyond = 4.0 * (nearer - farther) / max(abs(nearer) + abs(farther), 1e-6);
    let lean = uphill * lamp_lean(steep, clamp(beyond, -1.0, 1.0));
    let towards = normalize(vec3f(lean, 1.0));
    return Lamp(towards, here / towards.z);
}

// What the scene sends on of a key direction's lightning: the even harmonic, between the eight nodes around a place.
fn sent_on(key: u32, place: vec3f) -> f32 {
    let size = water.volume_size;
    let last = size - 1u;
    let at = clamp((place - water.volume_origin) / water.volume_cell, vec3f(0.0), vec3f(last));
    let first = min(vec3u(at), max(last, vec3u(1u)) - 1u);
    let part = at - vec3f(first);
    let begin = key * size.x * size.y * size.z;
    var sum = 0.0;
    for (var corner = 0u; corner < 8u; corner++) {
        let step = vec3u(corner & 1u, (corner >> 1u) & 1u, corner >> 2u);
        let weights = select(1.0 - part, part, step == vec3u(1u));
        let node = min(first + step, last);
        let index = begin + (node.z * size.y + node.y) * size.x + node.x;
        if index < arrayLength(&lightning) {
            sum += weights.x * weights.y * weights.z * lightning[index];
        }
    }
    return max(sum * 0.28209479, 0.0);
}

fn flash_at(key: u32, place: vec3f, direction: vec3f) -> f32 {
    let towards = water.keys[key];
    if towards.w == 0.0 {
        return 1.0 / (4.0 * PI);
    }
    return henyey_greenstein(DROP_ASYMMETRY, dot(direction, towards.xyz)) + sent_on(key, place);
}

struct Beams {
    light: vec3f,
    // Where most of it comes from, in the picture.
    from_: vec2f,
}

// Radiance that water's discs have of beams, at an offset from the eye.
fn beams_at(place: vec3f, direction: vec3f) -> Beams {
    var sum = water.sun_irradiance * henyey_greenstein(DROP_ASYMMETRY, dot(direction, water.sun_towards));
    var from_ = water.sun_towards;
    let lamp = lamp_at(place);
    let light = lamp.irradiance * henyey_greenstein(DROP_ASYMMETRY, dot(direction, lamp.towards));
    if light.x + light.y + light.z > sum.x + sum.y + sum.z {
        from_ = lamp.towards;
    }
    sum += light;
    if water.flash_0 > 0.0 {
        sum += water.flash_0 * flash_at(0u, place, direction);
    }
    if water.flash_1 > 0.0 {
        sum += water.flash_1 * flash_at(1u, place, direction);
    }
    let axes = axes_across(direction);
    let side = select(1.0, -0.7, dot(from_, direction) < 0.0);
    return Beams(sum, vec2f(dot(from_, axes[0]), dot(from_, axes[1])) * side);
}

// How a beam's light lies over a ball's disc.
fn glint(spread: vec2f, from_: vec2f) -> f32 {
    let off = spread + 0.75 * from_;
    let away = dot(off, off) / 0.08;
    return 0.4 + 0.6 / (0.08 * (1.0 + away) * (1.0 + away));
}
