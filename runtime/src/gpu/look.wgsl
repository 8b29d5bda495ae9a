// The world from the eye, in directions instead of pixels: what mirrors look into, what lights rain and drops, and what the lit
// cloud sheds on the town. (shade/environment.rs, renderer/world.rs, renderer/light.rs)

struct Window {
    heading: f32,
    half_width: f32,
    bottom: f32,
    top: f32,
    columns: u32,
    rows: u32,
    pad0: u32,
    pad1: u32,
}

@group(3) @binding(0) var<uniform> window: Window;
@group(3) @binding(1) var map: texture_storage_2d<rgba16float, write>;
// Radiance and distance of each ray of the glow; the last is the sun's, and its first number the share that comes through.
@group(3) @binding(2) var<storage, read_write> rays: array<vec4f>;

const GLOW_COLUMNS: u32 = 96u;
const GLOW_ROWS: u32 = 32u;

@compute @workgroup_size(8, 8)
fn look_around(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= window.columns || id.y >= window.rows { return; }
    let elevation = window.bottom + (window.top - window.bottom) * f32(id.y) / f32(window.rows - 1u);
    let across = 2.0 * f32(id.x) / f32(window.columns - 1u) - 1.0;
    let azimuth = window.heading + across * window.half_width;
    let level = cos(elevation);
    let way = vec3f(level * cos(azimuth), level * sin(azimuth), sin(elevation));
    let view = march(Ray(frame.position, way), false);
    textureStore(map, id.xy, vec4f(stored(covered(sky_radiance(way), view)), view.transmittance));
}

@compute @workgroup_size(64)
fn follow_glow(@builtin(global_invocation_id) id: vec3u) {
    let count = GLOW_COLUMNS * GLOW_ROWS;
    if id.x > count { return; }
    if id.x == count {
        let view = march(Ray(frame.position, sky.sun), true);
        rays[count] = vec4f(view.transmittance, 0.0, 0.0, 0.0);
        return;
    }
    let rise = (f32(id.x / GLOW_COLUMNS) + 0.5) / f32(GLOW_ROWS);
    let level = sqrt(1.0 - rise * rise);
    let azimuth = TAU * (f32(id.x % GLOW_COLUMNS) + 0.5) / f32(GLOW_COLUMNS);
    let view = march(Ray(frame.position, vec3f(level * cos(azimuth), level * sin(azimuth), rise)), true);
    rays[id.x] = vec4f(view.radiance, view.distance);
}
