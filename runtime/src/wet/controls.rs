//! Controls of effects: one declaration gives the typed struct, its usual values, and the rows that tools print and check.

/// One control, as tools list it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Plain name, as in `[view.wet.EFFECT]`.
    pub name: &'static str,
    /// The paper's name; empty where the paper has none.
    pub paper: &'static str,
    /// Smallest and largest value.
    pub range: [f32; 2],
    /// SI unit; empty for pure numbers.
    pub unit: &'static str,
    /// Value where nothing is said.
    pub usual: f32,
    /// What it does.
    pub says: &'static str,
}

/// Declares the controls of an effect. Each line: documentation, name, usual value, range, unit, the paper's name.
///
/// ```ignore
/// controls! {
///     /// How splashes look.
///     pub struct SplashControls {
///         /// Factor on a splash's size.
///         size: 1.0, 0.1..=10.0, "", "";
///     }
/// }
/// ```
#[allow(unused_macros, reason = "effects declare theirs with it")]
macro_rules! controls {
    ($(#[doc = $about:literal])+ pub struct $name:ident {
        $($(#[doc = $says:literal])+ $field:ident: $usual:expr, $low:literal..=$high:literal, $unit:literal, $paper:literal;)+
    }) => {
        $(#[doc = $about])+
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name { $($(#[doc = $says])+ pub $field: f32,)+ }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $usual,)+ }
            }
        }

        impl $name {
            /// The controls as tools list them.
            pub const PARAMETERS: &'static [$crate::wet::controls::Parameter] = &[$($crate::wet::controls::Parameter {
                name: stringify!($field), paper: $paper, range: [$low, $high], unit: $unit, usual: $usual,
                says: concat!($($says),+).trim_ascii(),
            },)+];

            /// Value of the control of that name.
            pub fn get(&self, name: &str) -> Option<f32> {
                match name { $(stringify!($field) => Some(self.$field),)+ _ => None }
            }

            /// Checks that every control is in its range, as drawing does: fields can be set past [`Self::set`].
            ///
            /// Errors: the first control that is out of its range, or not a number.
            pub fn check(&self) -> Result<(), $crate::error::RuntimeError> {
                let mut whole = *self;
                Self::PARAMETERS.iter().try_for_each(|known| whole.set(known.name, self.get(known.name).unwrap_or(f32::NAN)))
            }

            /// Sets the control of that name.
            ///
            /// Errors: no control of that name; a value out of its range.
            pub fn set(&mut self, name: &str, value: f32) -> Result<(), $crate::error::RuntimeError> {
                let known = Self::PARAMETERS.iter().find(|parameter| parameter.name == name);
                let Some(known) = known else {
                    let names: Vec<_> = Self::PARAMETERS.iter().map(|parameter| parameter.name).collect();
                    return Err($crate::error::RuntimeError::argument("control", names.join(", "), name));
                };
                if !(known.range[0]..=known.range[1]).contains(&value) {
                    let wanted = format!("{} to {} {}", known.range[0], known.range[1], known.unit);
                    return Err($crate::error::RuntimeError::argument(known.name, wanted.trim_end().to_owned(), value));
                }
                match name { $(stringify!($field) => self.$field = value,)+ _ => {} }
                Ok(())
            }
        }
    };
}
#[allow(unused_imports, reason = "effects declare theirs with it")]
pub(crate) use controls;

#[cfg(test)]
mod tests {
    controls! {
        /// Two controls.
        pub struct Two {
            /// The first.
            first: 1.0, 0.0..=2.0, "m", "a";
            /// The second.
            second: -1.0, -2.0..=0.0, "", "";
        }
    }

    #[test]
    fn controls_are_found_by_name_and_held_to_their_ranges() {
        let mut two = Two::default();
        assert_eq!((two.get("first"), two.get("third")), (Some(1.0), None));
        two.set("second", -2.0).unwrap();
        assert_eq!(two.second, -2.0);
        for (name, value) in [("first", 2.5), ("first", f32::NAN), ("third", 1.0)] {
            assert!(two.set(name, value).is_err());
        }
        assert!(two.check().is_ok());
        assert!(
            Two { first: 2.5, ..two }.check().is_err() && Two { second: f32::NAN, ..two }.check().is_err()
        );
        assert_eq!((Two::PARAMETERS[0].says, Two::PARAMETERS[0].unit), ("The first.", "m"));
    }
}
