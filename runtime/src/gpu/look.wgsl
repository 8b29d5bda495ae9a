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

// All directions, and where mirrors look.
struct Windows {
    around: Window,
    mirror: Window,
}

@group(3) @binding(0) var<uniform> windows: Windows;
@group(3) @binding(1) var around_map: texture_storage_2d<rgba16float, write>;
@group(3) @binding(2) var mirror_map: texture_storage_2d<rgba16float, write>;
// Radiance and distance of each ray of the glow; the last is the sun's, and its first number the share that comes through.
@group(3) @binding(3) var<storage, read_write> rays: array<vec4f>;

const GLOW_COLUMNS: u32 = 96u;
const GLOW_ROWS: u32 = 32u;

fn looked_at(window: Window, at: vec2u) -> vec4f {
    let elevation = window.bottom + (window.top - window.bottom) * f32(at.y) / f32(window.rows - 1u);
    let across = 2.0 * f32(at.x) / f32(window.columns - 1u) - 1.0;
    let azimuth = window.heading + across * window.half_width;
    let level = cos(elevation);
    let way = vec3f(level * cos(azimuth), level * sin(azimuth), sin(elevation));
    let view = march(Ray(frame.position, way), false);
    return vec4f(stored(covered(sky_radiance(way), view)), view.transmittance);
}

fn tiles(window: Window) -> vec2u { return (vec2u(window.columns, window.rows) + 7u) / 8u; }

fn follow_glow(number: u32) {
    let count = GLOW_COLUMNS * GLOW_ROWS;
    if number > count { return; }
    var way = sky.sun;
    if number < count {
        let rise = (f32(number / GLOW_COLUMNS) + 0.5) / f32(GLOW_ROWS);
        let level = sqrt(1.0 - rise * rise);
        let azimuth = TAU * (f32(number % GLOW_COLUMNS) + 0.5) / f32(GLOW_COLUMNS);
        way = vec3f(level * cos(azimuth), level * sin(azimuth), rise);
    }
    let view = march(Ray(frame.position, way), true);
    rays[number] = select(vec4f(view.radiance, view.distance), vec4f(view.transmittance), number == count);
}

// A workgroup is a tile of a map, or rays of the glow: all in one dispatch, so that none waits for another's longest ray. The
// mirrors' tiles come last; where nothing mirrors there are fewer workgroups.
@compute @workgroup_size(64)
fn look_around(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) local: u32) {
    let inner = vec2u(local % 8u, local / 8u);
    var number = group.x;
    let glow = (GLOW_COLUMNS * GLOW_ROWS) / 64u + 1u;
    if number < glow {
        follow_glow(number * 64u + local);
        return;
    }
    number -= glow;
    let around = tiles(windows.around);
    if number < around.x * around.y {
        let at = 8u * vec2u(number % around.x, number / around.x) + inner;
        if at.x < windows.around.columns && at.y < windows.around.rows {
            textureStore(around_map, at, looked_at(windows.around, at));
        }
        return;
    }
    number -= around.x * around.y;
    let mirror = tiles(windows.mirror);
    let at = 8u * vec2u(number % mirror.x, number / mirror.x) + inner;
    if at.x < windows.mirror.columns && at.y < windows.mirror.rows {
        textureStore(mirror_map, at, looked_at(windows.mirror, at));
    }
}
