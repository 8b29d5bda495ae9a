//! Which of a file's layers is which buffer, by the names that renderers give them.
//!
//! | writer | colour | depth | normal | position | albedo | roughness | emission |
//! |---|---|---|---|---|---|---|---|
//! | Blender | Combined | Depth (channel Z or V) | Normal | Position | DiffCol, Diffuse Color | an AOV called Roughness | Emit, Emission |
//! | Houdini Karma, Mantra | C, RGBA without a name | Pz, hitPz, depth | N, hitN | P, hitP | albedo, basecolor | roughness | emission, directemission |
//! | Unreal's Movie Render Queue | FinalImage, RGBA without a name | FinalImageMovieRenderQueue_WorldDepth, …WorldDepth | …WorldNormal | – | …BaseColor | …Roughness | …Emissive |
//! | pbrt | RGB without a name | – | Ns, N | P | Albedo | – | – |
//!
//! Names are compared without case, dots before the last part, blanks and signs.

use super::planes::{Channel, Contents};
use crate::error::BakeError;

/// A buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Role {
    /// Light towards the camera.
    Colour,
    /// Depth.
    Depth,
    /// Places, in the world or before the camera.
    Position,
    /// Normals.
    Normal,
    /// Diffuse albedo.
    Albedo,
    /// Perceptual roughness.
    Roughness,
    /// Light that surfaces send of their own.
    Emission,
    /// How much of the rain stays.
    Wettable,
}

impl Role {
    /// Every buffer.
    pub const ALL: [Self; 8] = [
        Self::Colour,
        Self::Depth,
        Self::Position,
        Self::Normal,
        Self::Albedo,
        Self::Roughness,
        Self::Emission,
        Self::Wettable,
    ];

    /// Its name on a command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Colour => "colour",
            Self::Depth => "depth",
            Self::Position => "position",
            Self::Normal => "normal",
            Self::Albedo => "albedo",
            Self::Roughness => "roughness",
            Self::Emission => "emission",
            Self::Wettable => "wettable",
        }
    }

    /// The buffer of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        let name = if name == "color" { "colour" } else { name };
        Self::ALL.into_iter().find(|role| role.name() == name)
    }

    /// Names of its layer, bare; the first are the surest.
    fn names(self) -> &'static [&'static str] {
        match self {
            Self::Colour => &["", "combined", "beauty", "c", "rgba", "image", "rgb", "color", "colour"],
            Self::Depth => &["depth", "worlddepth", "scenedepth", "z", "", "pz", "hitpz", "dpz"],
            Self::Position => &["position", "p", "hitp", "worldposition", "pworld"],
            Self::Normal => {
                &["normal", "ns", "n", "hitn", "worldnormal", "normals", "shadingnormal", "denoisingnormal"]
            }
            Self::Albedo => {
                &["albedo", "diffcol", "diffusecolor", "basecolor", "diffusealbedo", "denoisingalbedo"]
            }
            Self::Roughness => &["roughness", "specularroughness"],
            Self::Emission => {
                &["emission", "emit", "emissive", "emissivecolor", "combinedemission", "directemission"]
            }
            Self::Wettable => &["wettable", "wetness", "wetmask", "wet"],
        }
    }

    /// Whether it has three channels.
    fn is_triple(self) -> bool {
        !matches!(self, Self::Depth | Self::Roughness | Self::Wettable)
    }
}

/// A buffer's channels, one or three.
#[derive(Clone, Debug)]
pub struct Found<'a> {
    /// Which buffer.
    pub role: Role,
    /// Its layer, or its one channel where the layer has no name.
    pub name: String,
    /// The channels.
    pub channels: Vec<&'a Channel>,
}

/// Sets of three channels, and names of lone ones.
const TRIPLES: [[&str; 3]; 4] = [["r", "g", "b"], ["x", "y", "z"], ["red", "green", "blue"], ["0", "1", "2"]];
const SINGLES: [&str; 8] = ["z", "v", "y", "x", "r", "a", "red", "depth"];

/// A name's last part without case, blanks, signs, and what Unreal puts before its materials' names.
fn bare(layer: &str) -> String {
    let last = layer.rsplit('.').next().unwrap_or(layer);
    let mut name: String =
        last.chars().filter(char::is_ascii_alphanumeric).map(|letter| letter.to_ascii_lowercase()).collect();
    for prefix in ["finalimage", "movierenderqueue", "pw"] {
        if let Some(rest) = name.strip_prefix(prefix) {
            name = rest.to_owned();
        }
    }
    name
}

/// The layers of a file, each once, in the file's order.
pub fn layers(contents: &Contents<'_>) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for channel in &contents.channels {
        if !all.contains(&channel.layer) {
            all.push(channel.layer.clone());
        }
    }
    all
}

/// The channels of a layer that make a buffer.
fn channels_of<'a>(contents: &'a Contents<'_>, layer: &str, role: Role) -> Option<Vec<&'a Channel>> {
    let own: Vec<&Channel> = contents.channels.iter().filter(|channel| channel.layer == layer).collect();
    let letter = |wanted: &str| own.iter().copied().find(|c| c.letter.eq_ignore_ascii_case(wanted));
    let triple =
        || TRIPLES.iter().find_map(|letters| letters.iter().map(|l| letter(l)).collect::<Option<Vec<_>>>());
    if role.is_triple() {
        // Grey albedo, emission and colour are three times the same.
        let grey =
            || letter("y").filter(|_| role != Role::Position && role != Role::Normal).map(|y| vec![y; 3]);
        return triple().or_else(grey);
    }
    if role == Role::Depth && layer.is_empty() {
        return letter("z").map(|z| vec![z]);
    }
    let single = SINGLES.iter().find_map(|name| letter(name));
    single.or_else(|| own.first().copied().filter(|_| own.len() == 1)).map(|channel| vec![channel])
}

/// Channels without a layer whose whole name says what they are: Pz, roughness; Px, Py, Pz and Nx, Ny, Nz of older writers.
fn lone<'a>(contents: &'a Contents<'_>, role: Role) -> Option<Found<'a>> {
    let own = || contents.channels.iter().filter(|channel| channel.layer.is_empty());
    let named = |name: &str| own().find(|channel| channel.letter.eq_ignore_ascii_case(name));
    if role.is_triple() {
        let stems: &[&str] = match role {
            Role::Position => &["P"],
            Role::Normal => &["Ns", "N"],
            _ => return None,
        };
        return stems.iter().find_map(|stem| {
            let channels = ["x", "y", "z"].iter().map(|axis| named(&format!("{stem}{axis}")));
            let channels = channels.collect::<Option<Vec<_>>>()?;
            Some(Found { role, name: format!("{stem}x, {stem}y, {stem}z"), channels })
        });
    }
    let is_position = named("Px").is_some() && named("Py").is_some();
    own()
        .filter(|channel| !(role == Role::Depth && is_position && channel.letter.eq_ignore_ascii_case("pz")))
        .find(|channel| {
            let name = bare(&channel.letter);
            !name.is_empty() && role.names().contains(&name.as_str()) && name != "z"
        })
        .map(|channel| Found { role, name: channel.name.clone(), channels: vec![channel] })
}

/// Finds a buffer by its names; the layer of the same view as `beside` before others.
fn find<'a>(contents: &'a Contents<'_>, role: Role, beside: Option<&str>) -> Vec<Found<'a>> {
    let view = |layer: &str| layer.rsplit_once('.').map_or("", |(view, _)| view).to_owned();
    let mut found: Vec<(usize, bool, Found<'_>)> = Vec::new();
    for layer in layers(contents) {
        let Some(rank) = role.names().iter().position(|name| *name == bare(&layer)) else { continue };
        if let Some(channels) = channels_of(contents, &layer, role) {
            let name = if layer.is_empty() { channels[0].name.clone() } else { layer.clone() };
            let other = beside.is_some_and(|beside| view(beside) != view(&layer));
            found.push((rank, other, Found { role, name, channels }));
        }
    }
    found.sort_by_key(|(rank, other, _)| (*other, *rank));
    let mut found: Vec<Found<'_>> = found.into_iter().map(|(_, _, found)| found).collect();
    found.extend(lone(contents, role));
    found
}

/// A layer that somebody named.
fn asked<'a>(contents: &'a Contents<'_>, role: Role, name: &str) -> Result<Found<'a>, BakeError> {
    let whole = channels_of(contents, name, role);
    let channel = || {
        let one = contents.channels.iter().find(|channel| channel.name == name).filter(|_| !role.is_triple());
        one.map(|channel| vec![channel])
    };
    let channels = channel().or(whole).ok_or_else(|| {
        let count = if role.is_triple() { "three channels" } else { "one channel" };
        let known = layers(contents);
        let shown = |layer: &String| if layer.is_empty() { "(no name)".into() } else { layer.clone() };
        let listed = known.iter().map(shown).collect::<Vec<_>>().join(", ");
        let field = format!("--layer {}", role.name());
        BakeError::input(
            contents.path(),
            field,
            format!("a layer with {count}: {listed}"),
            format!("\"{name}\""),
        )
    })?;
    Ok(Found { role, name: name.to_owned(), channels })
}

/// Every buffer that the file has, and what is worth knowing of the choice. `named` are layers that somebody named; the name `none` leaves a buffer out.
///
/// Errors: a named layer that is not there, or has not the channels; no colour.
pub fn choose<'a>(
    contents: &'a Contents<'_>,
    named: &[(Role, String)],
) -> Result<(Vec<Found<'a>>, Vec<String>), BakeError> {
    let (mut all, mut notes): (Vec<Found<'_>>, Vec<String>) = (Vec::new(), Vec::new());
    for role in Role::ALL {
        if let Some((_, name)) = named.iter().find(|(known, _)| *known == role) {
            if name != "none" {
                all.push(asked(contents, role, name)?);
            }
            continue;
        }
        let beside = all.iter().find(|found| found.role == Role::Colour).map(|found| found.name.clone());
        let mut found = find(contents, role, beside.as_deref().filter(|_| role != Role::Colour));
        if found.is_empty() {
            continue;
        }
        let first = found.remove(0);
        if !found.is_empty() {
            let others = found.iter().map(|other| other.name.as_str()).collect::<Vec<_>>().join(", ");
            notes.push(format!("{} is {}; {others} would fit too", role.name(), first.name));
        }
        all.push(first);
    }
    if !all.iter().any(|found| found.role == Role::Colour) {
        let listed =
            contents.channels.iter().map(|channel| channel.name.as_str()).collect::<Vec<_>>().join(", ");
        let wanted = "a layer of colour with R, G and B (--layer colour=NAME)";
        return Err(BakeError::input(contents.path(), "colour", wanted, listed));
    }
    Ok((all, notes))
}

#[cfg(test)]
mod tests {
    use super::bare;

    #[test]
    fn names_are_bare_of_views_signs_and_what_unreal_puts_before_them() {
        assert_eq!(bare("ViewLayer.DiffCol"), "diffcol");
        assert_eq!(bare("FinalImageMovieRenderQueue_WorldDepth"), "worlddepth");
        assert_eq!(bare("FinalImagePWWorldNormal"), "worldnormal");
        assert_eq!(bare("View Layer.Diffuse Color"), "diffusecolor");
        assert_eq!(bare("FinalImage"), "");
    }
}
