// Where each spot is and what of it arrives; after `spots.wgsl`.

@group(3) @binding(0) var<uniform> spots: SpotFrame;
@group(3) @binding(1) var<storage, read> sources: array<SpotSource>;
@group(3) @binding(2) var<storage, read_write> placed: array<Spot>;
@group(3) @binding(3) var<uniform> medium: MediumFrame;
@group(3) @binding(4) var scene_distance: texture_2d<f32>;
@group(3) @binding(5) var dry_relief: texture_2d<f32>;
// Colour times brightness of every stroke.
@group(3) @binding(6) var<storage, read> stroke_light: array<vec4f>;

@compute @workgroup_size(64)
fn place_spots(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= spots.counts.x {
        return;
    }
    let source = sources[id.x];
    placed[id.x].light = vec4f(0.0);
    let at = project(source.position);
    if at.z <= 0.0 {
        return;
    }
    let off = source.position - frame.position;
    let metres = length(off);
    var left = 1.0;
    if spots.counts.y != 0u && metres > 0.0 {
        let way = off / metres;
        let ray_secant = 1.0 / max(dot(way, frame.forward), 1e-6);
        left = exp(-min(optical_depth(frame.position, way, metres / ray_secant, ray_secant), 200.0));
    }
    let is_lamp = source.stroke == NO_STROKE;
    if !is_lamp && left < FAINT {
        return;
    }
    if spots.counts.z != 0u && town_is_blocked(frame.position, source.position) {
        return;
    }
    if spots.counts.w != 0u {
        let pixel = vec2i(floor(at.xy));
        if all(pixel >= vec2i(0)) && all(pixel < vec2i(i32(frame.width), i32(frame.height))) {
            let before = textureLoad(scene_distance, pixel, 0).x;
            if before > 0.0 && before < metres {
                return;
            }
        }
    }
    var light = source.light * left;
    if !is_lamp {
        light *= stroke_light[source.stroke].xyz;
    }
    placed[id.x].pixel = at.xy;
    placed[id.x].sigma = source.sigma;
    placed[id.x].reach = select(CHANNEL_REACH, ceil(3.0 * source.sigma), is_lamp);
    placed[id.x].light = vec4f(light, select(0.0, 1.0, is_lamp));
}
