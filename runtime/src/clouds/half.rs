//! Half precision.

/// The bits of IEEE binary16 nearest to `value`, ties to even; what is larger than its largest number, 65504, becomes that.
#[must_use]
pub fn f16_bits(value: f32) -> u16 {
    const LARGEST: f32 = 65504.0;
    if value.is_nan() {
        return 0x7E00;
    }
    let bits = value.clamp(-LARGEST, LARGEST).to_bits();
    let (sign, size) = ((bits >> 16 & 0x8000) as u16, bits & 0x7FFF_FFFF);
    // Below 2^-14 numbers are multiples of 2^-24: adding ½ leaves those as the lowest bits of a sum, rounded.
    if size < 0x3880_0000 {
        let sum = f32::from_bits(size) + 0.5;
        return sign | (sum.to_bits() - 0.5f32.to_bits()) as u16;
    }
    // Rounds the 13 bits that go, ties to even, and moves the exponent's bias from 127 to 15.
    let odd = size >> 13 & 1;
    sign | ((size + 0x0FFF + odd - (112 << 23)) >> 13) as u16
}

/// The number that bits of IEEE binary16 are.
#[cfg(feature = "gpu")]
pub(crate) fn f16_value(bits: u16) -> f32 {
    let size = u32::from(bits & 0x7FFF);
    // Numbers below 2^-14 lie as if their exponent were that of single precision's; one product moves it.
    let value = f32::from_bits(size << 13) * f32::from_bits((254 - 15) << 23);
    let value = if size >= 0x7C00 { f32::from_bits(size << 13 | 0x7F80_0000) } else { value };
    if bits >> 15 == 1 { -value } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value_of(bits: u16) -> f32 {
        let (exponent, fraction) = (i32::from(bits >> 10 & 31), f32::from(bits & 1023));
        let size = match exponent {
            0 => libm::ldexpf(fraction, -24),
            _ => libm::ldexpf(1.0 + fraction / 1024.0, exponent - 15),
        };
        if bits >> 15 == 1 { -size } else { size }
    }

    #[test]
    fn every_half_comes_back_and_numbers_between_go_to_the_nearest() {
        for bits in (0..0x7C00u16).chain(0x8000..0xFC00) {
            assert_eq!(f16_bits(value_of(bits)), bits, "{bits:04x}");
        }
        for bits in 0..0x7BFFu16 {
            let (low, high) = (value_of(bits), value_of(bits + 1));
            let middle = 0.5 * (low + high);
            assert_eq!(f16_bits(middle), bits + (bits & 1), "{bits:04x}");
            assert_eq!(f16_bits(middle + 0.1 * (high - middle)), bits + 1);
            assert_eq!(f16_bits(middle - 0.1 * (high - middle)), bits);
        }
        assert_eq!([f32::INFINITY, 1e9].map(f16_bits), [0x7BFF; 2]);
        assert_eq!(f16_bits(f32::NAN), 0x7E00);
    }
}
