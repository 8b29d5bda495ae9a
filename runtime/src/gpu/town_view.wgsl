// How a town is looked at, and what each pixel's middle sees, as it is kept: `shade::town::frame`. Group 3 begins with this.

struct TownView {
    // Samples along a pixel's side; facets of the roughest water; pixels between nodes; lights with shadows.
    counts: vec4u,
    // Lines whose image stands in water.
    lines: vec4u,
    // Their steps: as a share of a highlight's width, per radian, at most; widths at which a highlight ends.
    steps: vec4f,
    // How much light may differ between nodes; angle of a pixel, rad, 0 where rays are parallel; width of a pixel there, m;
    // extinction of rain, 1/m.
    measures: vec4f,
    // Harmonics of the sky.
    ambient: array<vec4f, 9>,
    // Unit vector towards the sun, and its angular radius; its irradiance.
    sun_towards: vec4f,
    sun: vec4f,
    // Heading, half the width, bottom and top of the map that mirrors look into, rad; the same of the map of all directions.
    mirror: vec4f,
    around: vec4f,
}

@group(3) @binding(0) var<uniform> view: TownView;

const KIND_SHIFT: u32 = 28u;
const WALL_SHIFT: u32 = 24u;
const NUMBER: u32 = 0xFFFFFFu;
const SEES_GROUND: u32 = 1u;
const SEES_HILL: u32 = 2u;
const SEES_BOX: u32 = 3u;

// Bits of a surface's last number.
const WITHIN: u32 = 0x80000000u;
const ALL_SKY: u32 = 0x40000000u;

// Distance as bits, and what it is; 0 for nothing.
fn packed_spot(spot: Spot) -> vec2u {
    var kind = SEES_BOX;
    var number = spot.thing;
    if spot.thing == NOTHING { return vec2u(bitcast<u32>(FARTHEST), 0u); }
    if spot.thing == GROUND { kind = SEES_GROUND; number = 0u; }
    if spot.thing == HILL { kind = SEES_HILL; number = 0u; }
    return vec2u(bitcast<u32>(spot.distance), (kind << KIND_SHIFT) | (spot.wall << WALL_SHIFT) | number);
}

fn hill_normal(spot: vec2f) -> vec3f {
    let at = (spot - town.hills.xy) / town.hills.zw;
    let low = clamp(vec2i(floor(at)), vec2i(0), vec2i(town.counts.xy) - 1);
    let h = hill_corners(low.x, low.y);
    let place = at - vec2f(low);
    let twist = h.x - h.y - h.z + h.w;
    let gradient = (vec2f(h.y - h.x, h.z - h.x) + twist * place.yx) / town.hills.zw;
    return normalize(vec3f(-gradient, 1.0));
}

fn wall_normal(solid: TownBox, wall: u32) -> vec3f {
    let across = vec2f(-solid.axis.y, solid.axis.x);
    switch wall {
        case 0u: { return vec3f(solid.axis, 0.0); }
        case 1u: { return vec3f(across, 0.0); }
        case 2u: { return vec3f(-solid.axis, 0.0); }
        case 3u: { return vec3f(-across, 0.0); }
        case 4u: { return vec3f(0.0, 0.0, 1.0); }
        default: { return vec3f(0.0, 0.0, -1.0); }
    }
}

// Along a wall from its right edge and above its foot, m.
fn place_on_wall(solid: TownBox, wall: u32, point: vec3f) -> vec2f {
    let own = box_own(solid, point.xy - solid.centre);
    let height = point.z - solid.foot;
    switch wall {
        case 0u: { return vec2f(own.y + solid.half.y, height); }
        case 1u: { return vec2f(solid.half.x - own.x, height); }
        case 2u: { return vec2f(solid.half.y - own.y, height); }
        case 3u: { return vec2f(own.x + solid.half.x, height); }
        default: { return vec2f(0.0); }
    }
}

// The way back; NOTHING where nothing was seen.
fn unpacked_spot(bits: vec2u, ray: Ray) -> Spot {
    let distance = bitcast<f32>(bits.x);
    let point = ray.origin + ray.way * distance;
    let kind = bits.y >> KIND_SHIFT;
    if kind == 0u { return Spot(point, distance, vec3f(0.0), NOTHING, NO_WALL, vec2f(0.0)); }
    if kind == SEES_GROUND { return Spot(point, distance, vec3f(0.0, 0.0, 1.0), GROUND, NO_WALL, vec2f(0.0)); }
    if kind == SEES_HILL { return Spot(point, distance, hill_normal(point.xy), HILL, NO_WALL, vec2f(0.0)); }
    let number = bits.y & NUMBER;
    let wall = (bits.y >> WALL_SHIFT) & 7u;
    let solid = town_boxes[number];
    return Spot(point, distance, wall_normal(solid, wall), number, wall, place_on_wall(solid, wall, point));
}

// Whether two places are on one surface of the town, flat or nearly so. (frame/node.rs, same_surface)
fn same_surface(a: Spot, b: Spot) -> bool {
    if a.thing != b.thing { return false; }
    if a.thing == HILL {
        return dot(a.normal, b.normal) > 0.97
            && abs(dot(b.point - a.point, a.normal)) <= 0.02 * (1.0 + max(a.distance, b.distance));
    }
    return a.wall == b.wall;
}

// Width of a pixel where a ray ended, m. (frame/strip.rs, Task::footprint)
fn footprint_of(way: vec3f, spot: Spot) -> f32 {
    let width = select(view.measures.z, view.measures.y * spot.distance, view.measures.y > 0.0);
    return width / sqrt(max(-dot(way, spot.normal), 0.01));
}

// Emission has an exponent in common, and sixteen bits a colour.
fn packed_surface(made: Surface, is_wet: bool, flags: u32) -> vec4u {
    let glass_or_wet = select(made.glass, made.wet, is_wet);
    var last = vec2u(bitcast<u32>(made.slope), flags);
    if !is_wet {
        let most = max(max(made.emission.x, made.emission.y), max(made.emission.z, 1e-30));
        let power = i32(ceil(log2(most) + 1e-3));
        let parts = made.emission * ldexp(1.0, -power);
        last = vec2u(pack2x16unorm(parts.xy), pack2x16unorm(vec2f(parts.z, 0.0)) | (u32(power + 128) << 16u) | flags);
    }
    return vec4u(pack2x16unorm(made.albedo.xy), pack2x16unorm(vec2f(made.albedo.z, glass_or_wet)), last);
}

fn unpacked_surface(bits: vec4u, is_wet: bool) -> Surface {
    let rest = unpack2x16unorm(bits.y);
    let albedo = vec3f(unpack2x16unorm(bits.x), rest.x);
    if is_wet { return Surface(albedo, 0.0, vec3f(0.0), rest.y, bitcast<f32>(bits.z)); }
    let power = i32((bits.w >> 16u) & 0xFFu) - 128;
    let emission = vec3f(unpack2x16unorm(bits.z), unpack2x16unorm(bits.w & 0xFFFFu).x) * ldexp(1.0, power);
    return Surface(albedo, rest.y, emission, 0.0, 1.0);
}

const WATER: f32 = 1.333;
const GLASS: f32 = 1.52;

// (shade/water.rs)
fn fresnel_reflectance(cosine: f32, index: f32) -> f32 {
    let c = clamp(cosine, 0.0, 1.0);
    let inside = sqrt(max(1.0 - (1.0 - c * c) / (index * index), 0.0));
    let across = (c - index * inside) / max(c + index * inside, 1e-12);
    let along = (index * c - inside) / max(index * c + inside, 1e-12);
    return 0.5 * (across * across + along * along);
}
