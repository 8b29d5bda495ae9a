//! Quantities with their unit in the type, for public borders; inner loops use plain floats.
//!
//! SI throughout. The two lengths that rain papers mix, metres and kilometres, are kept apart here:
//! an extinction printed per kilometre cannot meet a path in metres without a conversion.

use serde::{Deserialize, Serialize};

macro_rules! quantity {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(pub f64);

        impl $name {
            /// The bare number, in the unit that the type's name says.
            pub const fn get(self) -> f64 {
                self.0
            }
        }
    };
}

quantity! {
    /// A length or distance, m.
    Metres
}
quantity! {
    /// A drop diameter, mm.
    Millimetres
}
quantity! {
    /// Extinction, scattering or absorption coefficient, 1/m.
    PerMetre
}
quantity! {
    /// Extinction as rain papers print it, 1/km.
    PerKilometre
}
quantity! {
    /// A time span, s.
    Seconds
}
quantity! {
    /// A speed, m/s.
    MetresPerSecond
}
quantity! {
    /// Rainfall intensity, mm/h.
    MillimetresPerHour
}
quantity! {
    /// An angle, rad.
    Radians
}
quantity! {
    /// An angle as people type it, degrees.
    Degrees
}
quantity! {
    /// Radiant intensity of a point source, W/sr.
    WattsPerSteradian
}

impl From<PerKilometre> for PerMetre {
    fn from(value: PerKilometre) -> Self {
        Self(value.0 / 1000.0)
    }
}

impl From<PerMetre> for PerKilometre {
    fn from(value: PerMetre) -> Self {
        Self(value.0 * 1000.0)
    }
}

impl From<Degrees> for Radians {
    fn from(value: Degrees) -> Self {
        Self(value.0.to_radians())
    }
}

impl From<Radians> for Degrees {
    fn from(value: Radians) -> Self {
        Self(value.0.to_degrees())
    }
}

impl From<Millimetres> for Metres {
    fn from(value: Millimetres) -> Self {
        Self(value.0 / 1000.0)
    }
}

impl std::ops::Mul<Metres> for PerMetre {
    /// Optical depth of a homogeneous path; dimensionless.
    type Output = f64;

    fn mul(self, path: Metres) -> f64 {
        self.0 * path.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn optical_depth_of_a_kilometre_is_the_printed_coefficient() {
        let printed = PerKilometre(2.70);
        let depth = PerMetre::from(printed) * Metres(1000.0);
        assert_eq!(depth, 2.70);
        assert_eq!(PerKilometre::from(PerMetre::from(printed)), printed);
    }
}
