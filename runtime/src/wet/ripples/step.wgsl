// A step of water's lattice, marks that are added to it, and its slopes. (wet/ripples/step.rs, wet/slopes.rs)

struct RippleStep {
    // Cells along x and y; x is fastest in memory.
    cells: vec2u,
    // REPEAT or walls.
    edges: u32,
    // NINE points or five.
    scheme: u32,
    // 1 − γ.
    keep: f32,
    // C²; a sixth of it with nine points.
    square: f32,
    // This step's length over the one's before.
    ratio: f32,
    // 1/m.
    per_spacing: f32,
    // The first tile with marks.
    first: u32,
}

struct Mark {
    // In cells.
    middle: vec2f,
    radius: f32,
    // m.
    height: f32,
    rim: f32,
    // What of the weight (1 − s)² is taken off.
    mend: f32,
    // 1: the surface of a step ago is marked too.
    both: f32,
}

const REPEAT: u32 = 0u;
const NINE: u32 = 0u;

// Heights now, and a step ago, m.
@group(0) @binding(0) var<storage, read_write> now: array<f32>;
@group(0) @binding(1) var<storage, read_write> before: array<f32>;

@group(1) @binding(0) var<uniform> own: RippleStep;
@group(1) @binding(1) var<storage, read> marks: array<Mark>;
// A mark's number, and how many cells the lattice's repeat that it meets is away: two numbers of 16 bits.
@group(1) @binding(2) var<storage, read> entries: array<vec2u>;
// Place of a tile of 8 × 8 cells, in tiles, and where its entries begin and end.
@group(1) @binding(3) var<storage, read> tiles: array<vec4u>;

@group(2) @binding(0) var slopes: texture_storage_2d<rg32float, write>;

// The cell that one beside the lattice stands for.
fn fold(cell: i32, cells: i32) -> i32 {
    let repeated = select(select(cell, cell - cells, cell >= cells), cell + cells, cell < 0);
    return select(clamp(cell, 0, cells - 1), repeated, own.edges == REPEAT);
}

// Columns of a cell and of those beside it.
fn columns(x: u32) -> vec3i {
    let size = i32(own.cells.x);
    return vec3i(fold(i32(x) - 1, size), i32(x), fold(i32(x) + 1, size));
}

// Where the rows of a cell and of those beside it begin.
fn rows(y: u32) -> vec3i {
    let size = i32(own.cells.y);
    return vec3i(fold(i32(y) - 1, size), i32(y), fold(i32(y) + 1, size)) * i32(own.cells.x);
}

// z⁺ in place of z⁻.
@compute @workgroup_size(8, 8)
fn step_ripples(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= own.cells) {
        return;
    }
    let x = columns(id.x);
    let y = rows(id.y);
    let at = y.y + x.y;
    let here = now[at];
    let sides = (now[y.y + x.x] + now[y.y + x.z]) + (now[y.x + x.y] + now[y.z + x.y]);
    var laplacian = sides - 4.0 * here;
    if own.scheme == NINE {
        let corners = (now[y.x + x.x] + now[y.x + x.z]) + (now[y.z + x.x] + now[y.z + x.z]);
        laplacian = 4.0 * sides + corners - 20.0 * here;
    }
    var old = before[at];
    if own.ratio != 1.0 {
        // A step of another length had the surface nearer or farther.
        old = here - (here - old) * own.ratio;
    }
    before[at] = here + own.keep * (here - old) + own.square * laplacian;
}

// Marks of drops and bodies, tile by tile: a cell is one thread's, which adds them in their order.
@compute @workgroup_size(8, 8)
fn mark_ripples(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_id) local: vec3u) {
    let tile = tiles[own.first + group.x];
    let cell = tile.xy * 8u + local.xy;
    if any(cell >= own.cells) {
        return;
    }
    let at = cell.y * own.cells.x + cell.x;
    var here = now[at];
    var old = before[at];
    for (var k = tile.z; k < tile.w; k++) {
        let entry = entries[k];
        let mark = marks[entry.x];
        let packed = bitcast<i32>(entry.y);
        let shift = vec2i(extractBits(packed, 0u, 16u), extractBits(packed, 16u, 16u));
        let away = vec2f(vec2i(cell) + shift) - mark.middle;
        let s = dot(away, away) / (mark.radius * mark.radius);
        if s < 1.0 {
            let weight = (1.0 - s) * (1.0 - s);
            let value = mark.height * (weight * (1.0 - mark.rim * s) - mark.mend * weight);
            here += value;
            old += mark.both * value;
        }
    }
    now[at] = here;
    before[at] = old;
}

// Sobel's filter: 1 2 1 across, a central difference along.
@compute @workgroup_size(8, 8)
fn slope_ripples(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= own.cells) {
        return;
    }
    let x = columns(id.x);
    let y = rows(id.y);
    let up = vec3f(now[y.x + x.x], now[y.x + x.y], now[y.x + x.z]);
    let middle = vec2f(now[y.y + x.x], now[y.y + x.z]);
    let down = vec3f(now[y.z + x.x], now[y.z + x.y], now[y.z + x.z]);
    let along = (up.z - up.x) + 2.0 * (middle.y - middle.x) + (down.z - down.x);
    let across = (down.x - up.x) + 2.0 * (down.y - up.y) + (down.z - up.z);
    textureStore(slopes, id.xy, vec4f(vec2f(along, across) * (0.125 * own.per_spacing), 0.0, 0.0));
}
