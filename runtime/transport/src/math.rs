//! Elementary functions for inner loops: inlined, the same bits on every machine, faster than a general library.

/// e^{−x} for x ≥ 0, relative error below 3·10⁻⁷; 0 beyond x = 87.
#[inline(always)]
pub fn exp_neg(x: f32) -> f32 {
    // 2^(−x log₂ e) = 2^n · 2^f with n the nearest integer and |f| ≤ ½.
    let y = x.min(87.0) * -std::f32::consts::LOG2_E;
    // Adding and taking away 1.5·2²³ rounds to the nearest integer.
    const ROUND: f32 = 12_582_912.0;
    let n = (y + ROUND) - ROUND;
    // The product above rounds at the size of y; the fraction is taken from x again, in two parts of ln 2.
    let r = -x.min(87.0) - n * 0.693_359_4 + n * 2.121_944_4e-4;
    let p = 1.0
        + r * (1.0
            + r * (0.5 + r * (0.166_666_55 + r * (0.041_665_795 + r * (0.008_333_452 + r * 0.001_398_2)))));
    if x > 87.0 { 0.0 } else { p * f32::from_bits((((n as i32) + 127) as u32) << 23) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_is_within_its_stated_error_and_never_negative() {
        for i in 0..200_000 {
            let x = i as f32 * 4.5e-4;
            let exact = libm::exp(-f64::from(x));
            let found = f64::from(exp_neg(x));
            if x <= 87.0 {
                assert!((found / exact - 1.0).abs() < 3e-7, "x = {x}: {found} against {exact}");
            }
        }
        assert_eq!(exp_neg(0.0), 1.0);
        assert_eq!(exp_neg(88.0), 0.0);
        assert_eq!(exp_neg(f32::INFINITY), 0.0);
    }
}
