//! Slopes of a height field by Sobel's filter.

/// Slopes (∂z/∂x, ∂z/∂y) along the middle one of three rows, each with one value of margin on its left and right: Sobel's weights 1 2 1 across,
/// a central difference along. Exact for planes, error O(spacing²) else.
pub fn sobel_row(rows: [&[f32]; 3], per_spacing: f32, out: &mut [[f32; 2]]) {
    let width = out.len();
    let scale = 0.125 * per_spacing;
    let [left, here, right] = [0, 1, 2].map(|k| rows.map(|row| &row[k..k + width]));
    for x in 0..width {
        let along =
            (right[0][x] - left[0][x]) + 2.0 * (right[1][x] - left[1][x]) + (right[2][x] - left[2][x]);
        let across =
            (left[2][x] - left[0][x]) + 2.0 * (here[2][x] - here[0][x]) + (right[2][x] - right[0][x]);
        out[x] = [along * scale, across * scale];
    }
}

/// The same of one value, between two.
pub fn sobel(rows: [&[f32]; 3], x: usize, per_spacing: f32) -> [f32; 2] {
    let mut out = [[0.0; 2]];
    sobel_row(rows.map(|row| &row[x..x + 3]), per_spacing, &mut out);
    out[0]
}
