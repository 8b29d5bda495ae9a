// The cloud's grid, and who looks at it; binding 0 of group 1 wherever the cloud is. (gpu/cloud.rs)

struct Cloud {
    // Its corner in the scene, m.
    origin: vec3f,
    albedo: f32,
    cell: vec3f,
    g: f32,
    counts: vec3u,
    // 1 where the grid repeats along x and y.
    periodic: u32,
    // The grid that rows hold light for: blocks of cells.
    light_counts: vec3u,
    extinction_unit: f32,
    blocks: vec3f,
    extinction_scale: f32,
    // From the grid's corner, m; or the direction towards somebody far away.
    viewer: vec3f,
    viewer_is_far: u32,
    // Longest step where edges are cut, m, before distance makes it longer; shortest edge of a cell, m.
    fine: f32,
    shortest: f32,
    // Billows: amplitude, height from which fibres take over, scale of the table.
    amplitude: f32,
    fibres_from: f32,
    voxels_per_metre: f32,
    pad0: f32,
    pad1: f32,
    pad2: f32,
}

@group(1) @binding(0) var<uniform> cloud: Cloud;

fn cell_at(index: u32, counts: vec3u) -> vec3u {
    let row = index / counts.x;
    return vec3u(index % counts.x, row % counts.y, row / counts.y);
}

fn index_of_cell(cell: vec3u, counts: vec3u) -> u32 {
    return cell.x + counts.x * (cell.y + counts.y * cell.z);
}

// Unit direction from a place, measured from the grid's corner, to the viewer. (Viewer::direction_from)
fn towards_viewer(place: vec3f) -> vec3f {
    if cloud.viewer_is_far == 1u { return cloud.viewer; }
    let way = cloud.viewer - place;
    let size = length(way);
    if size == 0.0 { return vec3f(0.0, 0.0, -1.0); }
    return way / size;
}

// Henyey and Greenstein's phase function of the cloud's droplets, 1/sr, in the form that keeps its digits at the peak.
fn phase(g: f32, cosine: f32) -> f32 {
    let narrow = 1.0 - abs(g);
    let side = select(1.0, -1.0, g < 0.0);
    let base = narrow * narrow + 2.0 * abs(g) * max(1.0 - side * cosine, 0.0);
    return (1.0 - g * g) / (12.566370614 * max(base * sqrt(base), 1e-37));
}
