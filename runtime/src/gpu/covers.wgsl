// Covers of the caller's own, roofs over a grid: `rain::cover::CoverMap`. After rain_field.wgsl, whose uniform holds their heads.

// Underside and top of each cell of all maps, one after the other; a top below its underside is a hole.
@group(2) @binding(9) var cover_cells: texture_2d<f32>;

const CELLS_ACROSS: u32 = 2048u;
// A place this near to a border, in cells, lies on it.
const AT_BORDER: f32 = 1e-5;

fn cover_cell(which: u32, at: vec2i) -> vec2f {
    let index = field.covers[which].first + u32(at.x) + field.covers[which].size.x * u32(at.y);
    return textureLoad(cover_cells, vec2u(index % CELLS_ACROSS, index / CELLS_ACROSS), 0).xy;
}

// Whether a way back from `start` (cells across) at `height` by `way` cells for a metre up meets nothing. (CoverMap::is_open)
fn cover_is_open(which: u32, start: vec2f, height: f32, way: vec2f) -> bool {
    let size = vec2f(field.covers[which].size);
    let last = field.covers[which].highest - height;
    if last < 0.0 {
        return true;
    }
    var climbed = 0.0;
    for (var axis = 0; axis < 2; axis++) {
        let at = start[axis];
        if at < 0.0 || at >= size[axis] {
            if way[axis] == 0.0 {
                return true;
            }
            let to_border = select((size[axis] - at) / way[axis], -at / way[axis], at < 0.0);
            if to_border < 0.0 {
                return true;
            }
            climbed = max(climbed, to_border);
        }
    }
    let most = i32(size.x + size.y) + 4;
    for (var step = 0; step < most; step++) {
        if climbed > last {
            break;
        }
        let here = start + way * climbed;
        var index = vec2f(0.0);
        for (var axis = 0; axis < 2; axis++) {
            let nearest = round(here[axis]);
            let is_border = abs(here[axis] - nearest) < AT_BORDER * (1.0 + abs(nearest)) && way[axis] != 0.0;
            index[axis] = select(floor(here[axis]), nearest - select(1.0, 0.0, way[axis] > 0.0), is_border);
        }
        if any(index < vec2f(0.0)) || any(index >= size) {
            return true;
        }
        var leave = ENDLESS;
        for (var axis = 0; axis < 2; axis++) {
            if way[axis] != 0.0 {
                let border = index[axis] + select(0.0, 1.0, way[axis] > 0.0);
                leave = min(leave, (border - start[axis]) / way[axis]);
            }
        }
        let cell = cover_cell(which, vec2i(index));
        if cell.x <= cell.y && height + climbed < cell.y && height + leave > cell.x {
            return false;
        }
        climbed = max(leave, climbed + AT_BORDER);
    }
    return true;
}

fn cover_lets_fall(which: u32, p: vec3f, velocity: vec3f) -> bool {
    let inverse = field.covers[which].inverse_cell;
    let off = p - field.covers[which].origin;
    var way = vec2f(0.0);
    if velocity.z < 0.0 {
        way = velocity.xy / velocity.z;
    }
    return cover_is_open(which, off.xy * inverse, off.z, way * inverse);
}

fn covers_let_fall(p: vec3f, velocity: vec3f) -> bool {
    for (var i = 0u; i < field.counts.x; i++) {
        if !cover_lets_fall(i, p, velocity) {
            return false;
        }
    }
    return true;
}
