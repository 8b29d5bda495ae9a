//! Powers of positive numbers in single precision, without branches, for pixel after pixel.

/// Coefficients of 2^f for f in [−½, ½]: ln 2 to the k-th over k!.
const EXP2: [f32; 7] =
    [1.0, std::f32::consts::LN_2, 0.240_226_5, 0.055_504_11, 0.009_618_129, 0.001_333_355_8, 0.000_154_035_3];

/// `value` raised to `exponent`, within 2·10⁻⁶ of it for every 20 powers of two between the result and 1; a normal number above 0, and
/// results within what single precision holds. Beyond, they end at 2^±126.
#[inline(always)]
pub(super) fn power(value: f32, exponent: f32) -> f32 {
    // value = 2^k · m with m in [√½, √2): log₂ m = 2/ln 2 · artanh((m − 1)/(m + 1)).
    let bits = value.to_bits();
    let shifted = bits.wrapping_sub(0x3f35_04f3) as i32;
    let k = shifted >> 23;
    let m = f32::from_bits(bits.wrapping_sub((k << 23) as u32));
    let t = (m - 1.0) / (m + 1.0);
    let s = t * t;
    let artanh = t * (1.0 + s * (1.0 / 3.0 + s * (0.2 + s * (1.0 / 7.0 + s * (1.0 / 9.0)))));
    let log = k as f32 + 2.0 * std::f32::consts::LOG2_E * artanh;
    let raised = (log * exponent).clamp(-126.0, 126.0);
    let whole = (raised + 126.5) as i32 - 126;
    let f = raised - whole as f32;
    let [a, b, c, d, e, g, h] = EXP2;
    let part = a + f * (b + f * (c + f * (d + f * (e + f * (g + f * h)))));
    part * f32::from_bits(((whole + 127) << 23) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_those_of_libm() {
        /// What is promised for every 20 powers of two.
        const ROUND_OFF: f32 = 2e-6;
        for exponent in [1.0 / 2.4, 0.3, 1.0, 1.3, 4.0] {
            for i in -3000..3000 {
                let value = libm::exp2f(i as f32 * 0.01);
                let wanted = libm::powf(value, exponent);
                let twenties = 1.0 + (libm::log2f(wanted) / 20.0).abs();
                let off = (power(value, exponent) / wanted - 1.0).abs();
                assert!(off < ROUND_OFF * twenties, "{value}^{exponent}: {off}");
            }
        }
        assert!(power(1e38, 4.0).is_finite() && power(1e-38, 4.0) > 0.0);
    }
}
