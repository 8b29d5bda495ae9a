// What a town is made of: `shade::town::{facade, ground}`. Group 1 beside the rays' own lists.

// A box's walls, in the tree's order.
struct TownWall {
    albedo: vec3f,
    glass: f32,
    // Of a lit window.
    radiance: vec3f,
    seed: u32,
    // Distance of windows, m, 0 where there are none; share of them that is lit.
    pitch: vec2f,
    lit: f32,
    pad: f32,
    // Windows along walls 0 and 2, along walls 1 and 3, storeys; height, m.
    counts: vec4f,
}

// A road: start and unit direction; albedo and half its width; its length. A lamp: place; intensity.
struct TownPart {
    a: vec4f,
    b: vec4f,
    c: vec4f,
}

struct TownGround {
    albedo: vec3f,
    wetness: f32,
    // Noise above which a road, and open land, is under water; width of puddles, m; slope of still water.
    shores: vec2f,
    puddle_size: f32,
    ripple: f32,
    seed: u32,
    // The first of the parts; the rest are lamps.
    roads: u32,
    lamps: u32,
}

struct Surface {
    albedo: vec3f,
    glass: f32,
    emission: vec3f,
    wet: f32,
    slope: f32,
}

// A place where a ray ends, and what is there: GROUND, HILL, a box's number, NOTHING.
struct Spot {
    point: vec3f,
    distance: f32,
    normal: vec3f,
    thing: u32,
    // 0 to 3; 4 on the roof, 5 on the underside.
    wall: u32,
    on_wall: vec2f,
}

const FILM_SLOPE: f32 = 0.11;
const UNDERSIDE: u32 = 5u;
const SHORE: f32 = 0.05;
const LAND_SHARE: f32 = 0.9;
const LAND_WIDTH: f32 = 20.0;
const PAINTED: f32 = 0.075;
const DASH: f32 = 4.0;
// A pixel that covers more windows than this along one axis sees their mean.
const MOST_WINDOWS: f32 = 6.0;

@group(1) @binding(5) var<uniform> ground: TownGround;
@group(1) @binding(6) var<storage, read> town_walls: array<TownWall>;
@group(1) @binding(7) var<storage, read> town_parts: array<TownPart>;

fn spot_of(hit: TownHit, origin: vec3f, way: vec3f) -> Spot {
    let wall = select(hit.wall, UNDERSIDE, hit.wall == NO_WALL && hit.normal.z < 0.0);
    return Spot(origin + way * hit.distance, hit.distance, hit.normal, hit.thing, wall, hit.on_wall);
}

fn is_box(thing: u32) -> bool { return thing < HILL; }

// ---- Walls (shade/town/facade.rs)

fn sixteen(bits: u32) -> f32 { return f32(bits & 0xFFFFu) * (1.0 / 65536.0); }

// Light of one window, as a factor on the mean radiance of a lit one.
fn window_light(own_wall: TownWall, wall: u32, column: i32, storey: i32) -> vec3f {
    let seed = vec2u(0u, (own_wall.seed << 2u) ^ wall);
    let row = bitcast<u32>(storey);
    let across = bitcast<u32>(column);
    let floor_bits = mix64(seed ^ vec2u(row, 0xF1000000u));
    let turned = vec2u(seed.y >> 15u, seed.y << 17u);
    let own = mix64(turned ^ vec2u(across << 20u, across >> 12u) ^ vec2u(row, 0u));
    let d = sixteen(floor_bits.x);
    var crowd = 2.6;
    if d < 0.4 { crowd = 0.35; } else if d < 0.9 { crowd = 1.2; }
    if sixteen(own.x) >= own_wall.lit * crowd { return vec3f(0.0); }
    let bright = 0.35 + 1.3 * sixteen(own.x >> 16u);
    let cold = sixteen(own.y) * sixteen(own.y);
    return vec3f(1.06 - 0.3 * cold, 0.98 + 0.05 * cold, 0.8 + 0.95 * cold) * bright;
}

fn pane_overlap(low: f32, high: f32, i: i32, pane: f32) -> f32 {
    let middle = f32(i) + 0.5;
    return max(min(high, middle + 0.5 * pane) - max(low, middle - 0.5 * pane), 0.0);
}

// Radiance of lit windows, and the share that is glass.
fn wall_sample(own_wall: TownWall, wall: u32, at: vec2f, wide: f32, footprint: f32) -> vec4f {
    let pitch = own_wall.pitch;
    let counts = vec2f(select(own_wall.counts.y, own_wall.counts.x, (wall & 1u) == 0u), own_wall.counts.z);
    let margin = (vec2f(wide, own_wall.counts.w) - counts * pitch) * 0.5;
    let place = (at - margin) / pitch;
    let half = vec2f(0.5 * max(footprint, 1e-3)) / pitch;
    let low = max(place - half, vec2f(0.0));
    let high = min(place + half, counts);
    if low.x >= high.x || low.y >= high.y { return vec4f(0.0); }
    let area = 4.0 * half.x * half.y;
    let size = high - low;
    if max(size.x, size.y) > MOST_WINDOWS {
        let covered = size.x * size.y / area;
        let lit = own_wall.lit * covered * own_wall.glass;
        return vec4f(lit * own_wall.radiance * vec3f(0.96, 0.997, 1.117), covered * own_wall.glass);
    }
    let pane = sqrt(own_wall.glass);
    var seen = vec4f(0.0);
    for (var storey = i32(floor(low.y)); storey < i32(ceil(high.y)); storey++) {
        let tall = pane_overlap(low.y, high.y, storey, pane);
        for (var column = i32(floor(low.x)); column < i32(ceil(high.x)); column++) {
            let share = tall * pane_overlap(low.x, high.x, column, pane) / area;
            if share > 0.0 {
                seen += share * vec4f(window_light(own_wall, wall, column, storey) * own_wall.radiance, 1.0);
            }
        }
    }
    return seen;
}

// ---- The ground (shade/town/ground.rs)

fn ground_level(spot: vec2f, land: bool) -> f32 {
    if land { return fractal_noise(vec3f(spot / (LAND_WIDTH * ground.puddle_size), 3.5), 6u, 0.5, ground.seed); }
    return fractal_noise(vec3f(spot / ground.puddle_size, 0.5), 4u, 0.5, ground.seed);
}

fn soil(spot: vec2f, footprint: f32) -> Surface {
    var road = ground.roads;
    var along = 0.0;
    var across = 0.0;
    for (var i = 0u; i < ground.roads; i++) {
        let part = town_parts[i];
        let place = spot - part.a.xy;
        along = dot(place, part.a.zw);
        across = place.x * part.a.w - place.y * part.a.z;
        if abs(across) <= part.b.w && along >= 0.0 && along <= part.c.x {
            road = i;
            break;
        }
    }
    let land = road == ground.roads;
    let shore = select(ground.shores.x, ground.shores.y, land);
    let width = SHORE + 0.5 * footprint / (ground.puddle_size * select(1.0, LAND_WIDTH, land));
    var puddle = 0.0;
    if shore < 1e6 { puddle = smoothstep(shore - 0.5 * width, shore + 0.5 * width, ground_level(spot, land)); }
    var albedo = ground.albedo;
    var film = 0.12;
    if !land {
        albedo = town_parts[road].b.xyz;
        film = 0.85;
        let paint = clamp((PAINTED + 0.5 * footprint - abs(across)) / max(footprint, 1e-3), 0.0, 1.0)
            * min(2.0 * PAINTED / max(footprint, 2.0 * PAINTED), 1.0);
        let dashed = select(select(0.0, 1.0, (i32(along / DASH) & 1) == 0), 0.5, footprint > DASH);
        albedo += (0.55 - albedo) * paint * dashed;
    }
    let patches = gradient_noise(vec3f(spot / 21.0, 7.5), ground.seed);
    var grain = 0.0;
    if footprint < 1.0 { grain = gradient_noise(vec3f(spot / 0.6, 7.5), ground.seed); }
    let texture = 1.0 + 0.3 * patches + 0.25 * grain;
    let dark = 1.0 - 0.45 * max(ground.wetness, puddle);
    film *= ground.wetness;
    let wet = film + (1.0 - film) * puddle;
    let slope = ground.ripple + (FILM_SLOPE - ground.ripple) * (1.0 - puddle);
    return Surface(clamp(albedo * texture * dark, vec3f(0.0), vec3f(1.0)), 0.0, vec3f(0.0), wet, slope);
}

// What a spot is made of, averaged over `footprint` m. (shade/town.rs, Town::surface)
fn surface_of(spot: Spot, footprint: f32) -> Surface {
    if !is_box(spot.thing) {
        var found = soil(spot.point.xy, footprint);
        if spot.thing == HILL {
            found.wet = 0.0;
            found.slope = 1.0;
        }
        return found;
    }
    let own_wall = town_walls[spot.thing];
    var seen = vec4f(0.0);
    if own_wall.pitch.x > 0.0 && spot.wall < NO_WALL {
        let half = town_boxes[spot.thing].half;
        let wide = 2.0 * select(half.x, half.y, (spot.wall & 1u) == 0u);
        seen = wall_sample(own_wall, spot.wall, spot.on_wall, wide, footprint);
    }
    return Surface(own_wall.albedo * (1.0 - 0.9 * seen.w), seen.w, seen.xyz, 0.0, 1.0);
}

fn has_panes(spot: Spot) -> bool {
    return is_box(spot.thing) && spot.wall < NO_WALL && town_walls[min(spot.thing, arrayLength(&town_walls) - 1u)].pitch.x > 0.0;
}
