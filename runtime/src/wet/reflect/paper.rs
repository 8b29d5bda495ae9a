//! The paper's streaks, \[toyshop\] §6.3, as a baseline: a mirror image in a buffer of half the size, smeared upwards and downwards the more the farther away
//! what it shows is. The paper gives no amount; the number of pixels a metre is a control. It stretches by distance alone, so that a lamp's streak
//! does not know at what angle the street is looked at, nor how rough it is.

/// Smears each column of a buffer: a pixel becomes the mean of those that are wet within its own reach, `reach_px` above and below.
/// Weights of a pixel sum to 1; a column whose reach is the same keeps its light but for what its ends cut off.
pub fn smear(
    size: [usize; 2],
    (light, wet, reach_px): (&[[f32; 3]], &[bool], &[f32]),
    out: &mut Vec<[f32; 3]>,
) {
    let [width, height] = size;
    out.clear();
    out.resize(width * height, [0.0; 3]);
    // Running sums down a column make every mean two look-ups.
    let mut sums = vec![[0.0f64; 4]; height + 1];
    for x in 0..width {
        for y in 0..height {
            let at = y * width + x;
            let mut sum = sums[y];
            if wet[at] {
                for band in 0..3 {
                    sum[band] += f64::from(light[at][band]);
                }
                sum[3] += 1.0;
            }
            sums[y + 1] = sum;
        }
        for y in 0..height {
            let at = y * width + x;
            if !wet[at] {
                continue;
            }
            let reach = reach_px[at].max(0.0) as usize;
            let (low, high) = (y.saturating_sub(reach), (y + reach + 1).min(height));
            let count = sums[high][3] - sums[low][3];
            for band in 0..3 {
                out[at][band] = ((sums[high][band] - sums[low][band]) / count) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smear_keeps_its_light_and_grows_with_its_reach() {
        let (size, lit) = ([3, 41], 20 * 3 + 1);
        let mut light = vec![[0.0; 3]; 3 * 41];
        light[lit] = [2.0, 1.0, 0.5];
        let mut out = Vec::new();
        for reach in [0.0f32, 4.0, 9.0] {
            smear(size, (&light, &[true; 123], &[reach; 123]), &mut out);
            let sum: f32 = out.iter().map(|pixel| pixel[0]).sum();
            assert!((sum - 2.0).abs() < 1e-5, "{sum}");
            let lit = out.iter().filter(|pixel| pixel[0] > 0.0).count();
            assert_eq!(lit, 2 * reach as usize + 1);
        }
    }
}
