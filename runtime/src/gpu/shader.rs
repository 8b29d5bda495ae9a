//! The shaders: WGSL put together from parts, so that one thing is written once.

/// A file's text without comments, indents, empty lines and spaces that part nothing, which a program would otherwise carry: a third of all shaders' bytes.
macro_rules! bare {
    ($file:expr) => {{
        const TEXT: &[u8] = include_str!($file).as_bytes();
        const LENGTH: usize = bare(TEXT, &mut []);
        const BARE: [u8; LENGTH] = {
            let mut bytes = [0; LENGTH];
            bare(TEXT, &mut bytes);
            bytes
        };
        match std::str::from_utf8(&BARE) {
            Ok(text) => text,
            Err(_) => panic!("a shader's code is text"),
        }
    }};
}

/// Bytes of `text` without what WGSL does not read, written to `out` as far as it goes. WGSL has no strings that a comment could begin in.
const fn bare(text: &[u8], out: &mut [u8]) -> usize {
    let (mut at, mut length, mut line, mut kept) = (0, 0, 0, 0);
    let mut before = b'\n';
    while at < text.len() {
        let byte = text[at];
        if byte == b'/' && at + 1 < text.len() && text[at + 1] == b'/' {
            while at < text.len() && text[at] != b'\n' {
                at += 1;
            }
            continue;
        }
        at += 1;
        if byte == b'\n' {
            // Spaces at the end, and the line if there was nothing else.
            length = kept;
            if length == line {
                continue;
            }
        } else if (byte == b' ' || byte == b'\t')
            && (length == line || at < text.len() && is_spare(before, text[at]))
        {
            continue;
        }
        before = byte;
        if length < out.len() {
            out[length] = byte;
        }
        length += 1;
        if byte == b'\n' {
            (line, kept) = (length, length);
        } else if byte != b' ' && byte != b'\t' {
            kept = length;
        }
    }
    length
}

/// Whether WGSL reads two bytes alike with a space between them and without: one of them is a token of its own, and they make no longer one together.
const fn is_spare(before: u8, next: u8) -> bool {
    match (before, next) {
        // A comment's ends, and what closes a list of types before an assignment.
        (b'*', b'/') | (b'/', b'*') | (b'>', b'=') => false,
        (b',' | b':' | b';' | b'(' | b'{' | b'[' | b'=' | b'+' | b'*', _) => true,
        (_, b'{' | b'}' | b')' | b']' | b'=' | b'+' | b'*') => true,
        _ => false,
    }
}

/// A shader: parts that it shares with others, then its own.
pub struct Shader {
    /// What its own file is called.
    pub name: &'static str,
    parts: &'static [&'static str],
}

impl Shader {
    /// The whole text.
    pub fn source(&self) -> String {
        self.parts.concat()
    }

    /// Whether it has this piece of a line, however that is spaced.
    #[cfg(test)]
    pub fn says(&self, code: &str) -> bool {
        let mut out = vec![0; code.len()];
        let length = bare(code.as_bytes(), &mut out);
        self.source().as_bytes().windows(length).any(|own| own == &out[..length])
    }
}

/// Rays, hashes, random numbers, noise, phase functions; the frame's uniforms in group 0.
const COMMON: &str = bare!("common.wgsl");

/// Where it rains, and what rain shows of the world: group 2.
const FIELD: &str = bare!("rain_field.wgsl");
const IN_SCATTERING: &str = bare!("in_scattering.wgsl");
const RAIN: &str = bare!("rain.wgsl");
/// The medium's optical depth.
const DEPTH: &str = bare!("medium_depth.wgsl");
/// Spots of light in the picture.
const SPOTS: &str = bare!("spots.wgsl");
/// A coarse picture at a finer one's pixels.
const DOUBLED: &str = bare!("doubled.wgsl");
/// Rays against the town: group 1.
const TOWN_RAYS: &str = bare!("town_rays.wgsl");
/// What lamps reach; covers of one's own, in group 2.
const LAMP_REACH: &str = bare!("lamp_reach.wgsl");
const COVERS: &str = bare!("covers.wgsl");
/// What it is made of; how it is looked at and lit; light between nodes.
const TOWN_SURFACE: &str = bare!("town_surface.wgsl");
const TOWN_VIEW: &str = bare!("town_view.wgsl");
const TOWN_LIGHT: &str = bare!("town_light.wgsl");
const TOWN_MIX: &str = bare!("town_mix.wgsl");
/// The cloud's grid, in group 1.
const CLOUD: &str = bare!("cloud.wgsl");

/// Light on drops over a frame of the caller's, in group 2.
const DROP_LIGHT: &str = bare!("../wet/drop/light.wgsl");

/// The sky, in group 0.
const SKY: &str = bare!("sky.wgsl");
/// The march, with the cloud's volumes in groups 1 and 2.
const VOLUME: &str = bare!("volume.wgsl");

macro_rules! shaders {
    ($($(#[$doc:meta])* $constant:ident = $name:literal $(in $folder:literal)? [$($part:expr),*];)*) => {
        $($(#[$doc])* pub(crate) const $constant: Shader =
            Shader { name: $name, parts: &[$($part,)* bare!(concat!($($folder,)? $name, ".wgsl"))] };)*

        /// Every shader.
        pub(crate) const ALL: &[&Shader] = &[$(&$constant),*];
    };
}

shaders! {
    /// Nothing but the common part, run by its own tests.
    PROBE = "probe" [COMMON];
    /// Drops of a frame.
    RAIN_FIND = "rain_find" [COMMON, FIELD, COVERS, TOWN_RAYS, LAMP_REACH, IN_SCATTERING, RAIN];
    /// Their streaks.
    RAIN_DRAW = "rain_draw" [COMMON, IN_SCATTERING, RAIN];
    /// What rain shows of the world in every direction.
    SHOWN = "shown" [COMMON];
    /// The medium and halos in it.
    MEDIUM = "medium" [COMMON, FIELD, IN_SCATTERING, DEPTH, LAMP_REACH];
    /// What is dry under covers.
    RELIEF = "relief" [COMMON, FIELD, COVERS, TOWN_RAYS];
    /// Lamps and channels: where they are and what of them arrives.
    SPOTS_PLACE = "spots_place" [COMMON, FIELD, TOWN_RAYS, DEPTH, SPOTS];
    /// They themselves.
    SPOTS_DRAW = "spots_draw" [COMMON, SPOTS];
    /// The layer of streaks over the picture.
    STREAKS_OVER = "streaks_over" [COMMON, IN_SCATTERING];
    /// What a lens spreads.
    BLOOM = "bloom" [DOUBLED];
    /// A scene of the caller's.
    /// The display's picture.
    TONE = "tone" [COMMON, DOUBLED];
    /// What every pixel's middle sees of the town.
    TOWN_LOOK = "town_look" [COMMON, TOWN_RAYS, TOWN_SURFACE, TOWN_VIEW];
    /// What it is made of.
    TOWN_MADE = "town_made" [COMMON, TOWN_RAYS, TOWN_SURFACE, TOWN_VIEW];
    /// Light at nodes.
    TOWN_NODES = "town_nodes"
        [COMMON, FIELD, IN_SCATTERING, TOWN_RAYS, LAMP_REACH, TOWN_SURFACE, TOWN_VIEW, TOWN_LIGHT];
    /// Pixels between them.
    TOWN_PIXELS = "town_pixels" [COMMON, TOWN_RAYS, TOWN_SURFACE, TOWN_VIEW, TOWN_MIX];
    /// All other pixels.
    TOWN_REST = "town_rest"
        [COMMON, FIELD, IN_SCATTERING, TOWN_RAYS, LAMP_REACH, TOWN_SURFACE, TOWN_VIEW, TOWN_LIGHT, TOWN_MIX];
    /// Sums of rows.
    ROWS = "rows" [];
    /// Sums of rows back to light per cell.
    HAAR = "haar" [CLOUD];
    /// Direct light of strokes.
    DIRECT = "direct" [CLOUD];
    /// Light per cell into volumes.
    PACK = "pack" [CLOUD];
    /// The picture's sky, and the cloud over it.
    MARCH = "march" [COMMON, SKY, CLOUD, VOLUME];
    /// Maps of what is around the eye.
    LOOK = "look" [COMMON, SKY, CLOUD, VOLUME];
    /// What those maps come to.
    AROUND = "around" [COMMON];
    /// The town before the sky.
    COMPOSE = "compose" [COMMON, SKY];
    /// A step of water's lattice.
    RIPPLES = "wet/ripples/step" in "../" [];
    /// What drops show, by their normal.
    DROP_TABLES = "wet/drop/tables" in "../" [COMMON, DROP_LIGHT];
    /// Layers of rain over a picture.
    LAYERS = "wet/layers/sheet" in "../" [COMMON, DROP_LIGHT];
    /// Drops on a pane.
    GLASS = "wet/glass/flow" in "../" [COMMON];
    /// Glow around lights, and mist.
    GLOW = "wet/glow/spread" in "../" [];
}

#[cfg(test)]
mod counts;

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use wgpu::naga;

    /// A struct's fields with their offsets, and its size, as a shader lays them out.
    pub struct Layout {
        pub fields: Vec<(String, u32)>,
        pub size: u32,
    }

    /// How `shader` lays the struct `name` out.
    pub fn layout_of(shader: &Shader, name: &str) -> Layout {
        let module = naga::front::wgsl::parse_str(&shader.source()).expect("a shader that parses");
        let found = module.types.iter().find(|(_, kind)| kind.name.as_deref() == Some(name));
        let (_, kind) = found.unwrap_or_else(|| panic!("{} has no struct {name}", shader.name));
        let naga::TypeInner::Struct { members, span } = &kind.inner else { panic!("{name} is no struct") };
        let fields = members.iter().map(|m| (m.name.clone().unwrap_or_default(), m.offset)).collect();
        Layout { fields, size: *span }
    }

    /// Compares a `repr(C)` struct with a shader's of the same name: offsets of all fields that `listed` names in order, padding
    /// (fields of Rust whose names begin with `pad`) left out, and the size.
    #[macro_export]
    #[doc(hidden)]
    macro_rules! assert_layout {
        ($shader:expr, $kind:ident { $($field:ident),* $(,)? }) => {
            let found = $crate::gpu::shader::tests::layout_of(&$shader, stringify!($kind));
            let wanted = [$((stringify!($field).to_owned(), std::mem::offset_of!($kind, $field) as u32)),*];
            assert_eq!(found.fields, wanted, "{}", stringify!($kind));
            assert_eq!(found.size as usize, size_of::<$kind>(), "size of {}", stringify!($kind));
        };
    }

    #[test]
    fn every_shader_is_valid_with_no_optional_feature() {
        for shader in ALL {
            let source = shader.source();
            let module = naga::front::wgsl::parse_str(&source)
                .unwrap_or_else(|error| panic!("{}: {}", shader.name, error.emit_to_string(&source)));
            let mut validator = naga::valid::Validator::new(
                naga::valid::ValidationFlags::all(),
                naga::valid::Capabilities::empty(),
            );
            if let Err(error) = validator.validate(&module) {
                panic!("{}: {}", shader.name, error.emit_to_string(&source));
            }
        }
    }

    #[test]
    fn no_stage_sees_more_than_eight_storage_buffers() {
        for shader in ALL {
            let module = naga::front::wgsl::parse_str(&shader.source()).unwrap();
            let mut validator = naga::valid::Validator::new(
                naga::valid::ValidationFlags::all(),
                naga::valid::Capabilities::empty(),
            );
            let info = validator.validate(&module).unwrap();
            for (number, entry) in module.entry_points.iter().enumerate() {
                let used = info.get_entry_point(number);
                let storage = module.global_variables.iter().filter(|(handle, variable)| {
                    matches!(variable.space, naga::AddressSpace::Storage { .. }) && !used[*handle].is_empty()
                });
                assert!(storage.count() <= 8, "{}: {}", shader.name, entry.name);
            }
        }
    }

    #[test]
    fn a_bare_text_has_the_same_code_line_by_line() {
        let text =
            b"// A note.\n\nfn f() -> f32 { // one\n    let x: vec2<f32> = 1.0 / *p * *q - -r;  \n\t// two\n    return x; }\n";
        let mut out = [0; 120];
        let length = super::bare(text, &mut out);
        assert_eq!(&out[..length], b"fn f() -> f32{\nlet x:vec2<f32> =1.0 / *p**q - -r;\nreturn x;}\n");
        assert_eq!(super::bare(text, &mut []), length);
    }
}
