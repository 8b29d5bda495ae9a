// Finds a frame's drops and draws their streaks: `rain::{search, streak, scatter}` and `shade::streak`.
//
// One thread a cell of a class's lattice. What a streak covers is Σ −ln(1 − α), and its light that times its radiance, so that
// streaks may be added up in any order: light between two streaks is as if both had the mean of theirs.

const CLASSES: u32 = 256u;
// Street lamps that light drops.
const NEAR_LAMPS: u32 = 128u;
const THIN_WIDTH_PX: f32 = 4.0;
const THIN_LENGTH_PX: f32 = 12.0;
const PERIODS_PER_PIXEL: f32 = 0.6;
const THIN_PICTURE_PX: f32 = 16.0;
const DOT_LENGTH_PX: f32 = 3.0;
const LONGEST_PX: f32 = 1e5;
const NARROWEST_BOX: f32 = 0.25;
const TOO_SHORT: f32 = 0.5;
// `rain::light::UNEVEN`.
const UNEVEN: f32 = 0.5;
const NEAREST_SHARE: f32 = 0.05;
const WIDTHS: u32 = 35u;
const LENGTHS: u32 = 25u;
const PHASES: f32 = 16.0;
const RADIUS_ALONG: f32 = 0.625;
const STRETCHED_PX: f32 = 2.0;
const LEVEL: f32 = 0.25;
// What −ln(1 − α) is multiplied by in half precision, and light beside it.
const COVER_UNIT: f32 = 2048.0;
const LIGHT_UNIT: f32 = 64.0;

const THIN: u32 = 1u;
const THIN_LEVEL: u32 = 2u;
const MIRRORED: u32 = 4u;
const PLAIN: u32 = 8u;

struct RainClass {
    // Hash of the seed and the class.
    key: vec2u,
    // Smallest diameter and width, mm.
    smallest: f32,
    width: f32,
    // Lowest cell of the box that is looked at.
    base_x: vec2u,
    base_y: vec2u,
    base_z: vec2u,
    crowd: f32,
    floor: f32,
    // The same relative to the camera's cell; the class's first thread.
    low: vec3i,
    first: u32,
    size: vec3u,
    edge: f32,
    // The camera's place in its cell, in cells.
    place: vec3f,
    near: f32,
    far: f32,
    // Planes n·p ≤ d of the frustum's piece, in cells.
    planes: array<vec4f, 6>,
}

struct NearLamp {
    // Its number in the town behind it.
    position: vec4f,
    intensity: vec4f,
}

struct RainFrame {
    // Exposure, s.
    exposure: vec4f,
    // Half the exposure's way of a drop with no fall speed in camera space; gain.
    still_way: vec4f,
    // World up in camera space; the slope Λ.
    world_up: vec4f,
    // Wind; how often a flash counts when drops pick patterns.
    wind: vec4f,
    // Focal length, half width, half height, px; pixels across over pixels down for the same angle.
    lens: vec4f,
    // From the picture's middle to the axis, px; half extents at unit depth.
    shift: vec4f,
    // Lengths times depth over focal length, least and most; length over width below which patterns are too short.
    lengths: vec4f,
    // Classes, capacity, patterns, near lamps.
    counts: vec4u,
    // Threads; whether rain is full wherever is looked, whether the town covers, whether patterns say what they show.
    flags: vec4u,
    classes: array<RainClass, CLASSES>,
    near_lamps: array<NearLamp, NEAR_LAMPS>,
}

struct PatternHead {
    // Ends of u and v of its body, and of where it has light.
    body: vec4f,
    range: vec4f,
    // First of the tables across, of those along, of the terms; terms.
    tables: vec4u,
    // Mean light, periods across of the finest visible wave, constant.
    light: vec4f,
    // 0: four soft edges, 1: profiles as a window, 2: profiles alone; first profile, pairs of profiles.
    kind: vec4u,
    // Coefficients of the sides, of the ends, and the softness of all four.
    sides: array<vec4f, 2>,
    ends: array<vec4f, 2>,
    softness: vec4f,
}

struct DrawnStreak {
    // Where the drop is when the shutter opens and closes, px.
    ends: vec4f,
    // Radiance; coverage of the whole streak, px².
    light: vec4f,
    id: vec2u,
    pattern: u32,
    // How it is drawn; in the upper half how far it shows its pattern, 65535 for all.
    kind: u32,
    // Thin: middle along and across lines, lean, weight. Else: the pattern's corner and its size, px.
    place: vec4f,
    // Thin: pixels along per line and per pixel, radius along, intervals per pixel. Else: direction along, weight.
    steps: vec4f,
    // Thin: classes of width, slant, length; the picture's length, px, as bits.
    tables: vec4u,
    // Thin: shares of the next width and slant. Inverse depth in the middle and its gain per pixel.
    shares: vec4f,
    // Pixels that it may touch: left, top, right, bottom.
    bounds: vec4f,
}

struct DrawArguments {
    vertices: u32,
    found: atomic<u32>,
    first_vertex: u32,
    first_instance: u32,
    // How many of them were inside the picture in the middle of the exposure.
    inside: atomic<u32>,
}

// Where a width's tables begin in a pattern's, and how many pixels there are on each side; where a length's begin, its intervals.
struct TableSizes {
    across: array<vec4u, WIDTHS>,
    along: array<vec4u, LENGTHS>,
}

@group(2) @binding(0) var<uniform> rain: RainFrame;
@group(2) @binding(6) var<uniform> sizes: TableSizes;
@group(2) @binding(7) var<storage, read> heads: array<PatternHead>;
