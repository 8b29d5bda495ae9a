// The sum of rows, gathered coefficient by coefficient: each is a list of (row, value), cut into pieces of at most 16, so that
// no thread waits for a long one. (relight.rs, sum_rows)

// Row, and the bits of the row's value.
@group(1) @binding(0) var<storage, read> entries: array<vec2u>;
// Where a piece begins among the entries, and where its sum goes; it ends where the next begins.
@group(1) @binding(1) var<storage, read> pieces: array<vec2u>;
// First part of a list of several pieces, how many there are, where their sum goes.
@group(1) @binding(2) var<storage, read> merges: array<vec4u>;

// How bright each row's source is, W/sr.
@group(2) @binding(0) var<storage, read> weights: array<f32>;
@group(2) @binding(1) var<storage, read_write> coefficients: array<f32>;
@group(2) @binding(2) var<storage, read_write> parts: array<f32>;

const IS_PART: u32 = 0x80000000u;

fn index_of(id: vec3u) -> u32 { return id.x + id.y * (65535u * 64u); }

@compute @workgroup_size(64)
fn sum_rows(@builtin(global_invocation_id) id: vec3u) {
    let at = index_of(id);
    if at + 1u >= arrayLength(&pieces) { return; }
    let piece = pieces[at];
    let end = pieces[at + 1u].x;
    var sum = 0.0;
    for (var i = piece.x; i < end; i++) {
        let entry = entries[i];
        sum += weights[entry.x] * bitcast<f32>(entry.y);
    }
    if (piece.y & IS_PART) != 0u {
        parts[piece.y & ~IS_PART] = sum;
    } else {
        coefficients[piece.y] = sum;
    }
}

@compute @workgroup_size(64)
fn merge_parts(@builtin(global_invocation_id) id: vec3u) {
    let at = index_of(id);
    if at >= arrayLength(&merges) { return; }
    let merge = merges[at];
    var sum = 0.0;
    for (var i = 0u; i < merge.y; i++) { sum += parts[merge.x + i]; }
    coefficients[merge.z] = sum;
}
