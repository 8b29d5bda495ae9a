//! Half precision, as textures hold it: for tests that fill and read them.

/// The bits of the half nearest to `value`; infinite beyond 65 504.
pub fn bits_of(value: f32) -> u16 {
    let sign = ((value.to_bits() >> 16) & 0x8000) as u16;
    let size = value.abs();
    if size.is_nan() {
        return 0x7E00;
    }
    if size >= 65_520.0 {
        return sign | 0x7C00;
    }
    if size < 6.103_515_6e-5 {
        return sign | libm::rintf(size * 16_777_216.0) as u16;
    }
    let (power, rest) = (libm::ilogbf(size), size);
    let whole = libm::rintf(libm::scalbnf(rest, 10 - power)) as u32;
    sign | (((power + 14) as u32 * 1024) + whole) as u16
}

/// The number that the bits stand for.
pub fn value_of(bits: u16) -> f32 {
    let (sign, power, rest) = (bits >> 15, i32::from(bits >> 10 & 31), f32::from(bits & 1023));
    let size = match power {
        0 => libm::scalbnf(rest, -24),
        31 if rest > 0.0 => f32::NAN,
        31 => f32::INFINITY,
        _ => libm::scalbnf(1024.0 + rest, power - 25),
    };
    if sign == 1 { -size } else { size }
}

#[test]
fn every_half_comes_back_as_it_was() {
    for bits in (0..=u16::MAX).filter(|bits| bits & 0x7C00 != 0x7C00) {
        assert_eq!(bits_of(value_of(bits)), bits, "{bits:x}");
    }
    assert_eq!((bits_of(1.0), bits_of(65_519.0), bits_of(1e9)), (0x3C00, 0x7BFF, 0x7C00));
}
