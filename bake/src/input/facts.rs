//! Facts that a scene states in words: the order of its grid, its units, how cells are read between their centres.
//!
//! What the words say is obeyed, or refused; a sentence that says nothing known is refused too, because whoever
//! wrote it meant something.

/// Order in which a grid's file holds its cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// x + nx (y + ny z): this project's own.
    XFastest,
    /// z + nz (y + ny x): C order of an array indexed \[x\]\[y\]\[z\].
    ZFastest,
}

/// What a fact accepts, and what was said.
pub type Refusal = (&'static str, String);

/// Lower-case words of a sentence: runs of letters and digits.
fn words(text: &str) -> Vec<String> {
    let parts = text.split(|c: char| !c.is_alphanumeric() && c != 'µ');
    parts.filter(|part| !part.is_empty()).map(str::to_lowercase).collect()
}

/// The order that key `index` states.
///
/// Errors: y fastest, two orders at once, another number format than little-endian float32, words that name no order.
pub fn order(index: &str) -> Result<Order, Refusal> {
    let refused = |wanted| Err((wanted, format!("\"{index}\"")));
    let said = words(index);
    let has = |word: &str| said.iter().any(|known| known == word);
    let formats =
        ["float64", "f64", "double", "float16", "f16", "half", "int16", "uint16", "int8", "uint8", "big"];
    if formats.iter().any(|&word| has(word)) || said.join(" ").contains("big endian") {
        return refused("little-endian float32");
    }
    let tight: String = index.to_lowercase().chars().filter(|c| !c.is_whitespace() && *c != '*').collect();
    let fastest = |axis: &str| said.windows(2).any(|pair| pair[0] == axis && pair[1] == "fastest");
    let slowest = |axis: &str| said.windows(2).any(|pair| pair[0] == axis && pair[1] == "slowest");
    let x = fastest("x") || slowest("z") || tight.contains("x+nx(y+nyz)") || tight.contains("fortran");
    let z = fastest("z") || slowest("x") || tight.contains("z+nz(y+nyx)");
    match (x, z) {
        _ if fastest("y") || slowest("y") => refused("x fastest or z fastest, y between them"),
        (true, false) => Ok(Order::XFastest),
        (false, true) => Ok(Order::ZFastest),
        (true, true) => refused("one order"),
        (false, false) => refused("\"x + nx*(y + ny*z), x fastest\" or \"z + nz*(y + ny*x), z fastest\""),
    }
}

/// Words that name a unit of length, or of power, that the keys do not have.
const FOREIGN: [&str; 30] = [
    "km",
    "kilometre",
    "kilometres",
    "kilometer",
    "kilometers",
    "cm",
    "centimetre",
    "centimetres",
    "centimeter",
    "centimeters",
    "mm",
    "millimetre",
    "millimetres",
    "millimeter",
    "millimeters",
    "ft",
    "foot",
    "feet",
    "mile",
    "miles",
    "inch",
    "inches",
    "yard",
    "yards",
    "nm",
    "kw",
    "mw",
    "gw",
    "µm",
    "um",
];
const OWN: [&str; 6] = ["m", "metre", "metres", "meter", "meters", "si"];

/// Checks what key `units` states: metres and watts, as the keys' own names say.
///
/// Errors: another unit, or words that name none.
pub fn units(stated: &serde_json::Value) -> Result<(), Refusal> {
    let wanted = "metres and watts, as the keys' names say";
    let mut said = Vec::new();
    collect(stated, &mut said);
    let all: Vec<String> = said.iter().flat_map(|text| words(text)).collect();
    let foreign = all.iter().any(|word| FOREIGN.contains(&word.as_str()));
    if foreign || !all.iter().any(|word| OWN.contains(&word.as_str())) {
        return Err((wanted, stated.to_string()));
    }
    Ok(())
}

/// Every text inside a JSON value.
fn collect<'a>(value: &'a serde_json::Value, said: &mut Vec<&'a str>) {
    match value {
        serde_json::Value::String(text) => said.push(text),
        serde_json::Value::Array(list) => list.iter().for_each(|value| collect(value, said)),
        serde_json::Value::Object(map) => map.values().for_each(|value| collect(value, said)),
        _ => {}
    }
}

/// Checks what key `interpolation` states: every cell has one value, and there is none outside the grid.
///
/// Errors: linear or higher, or words that name none.
pub fn interpolation(stated: &str) -> Result<(), Refusal> {
    let said = words(stated);
    let has = |list: &[&str]| said.iter().any(|word| list.contains(&word.as_str()));
    let smooth = ["linear", "trilinear", "cubic", "tricubic", "quadratic", "spline"];
    let flat = ["nearest", "constant", "piecewise", "none", "cell", "cells", "box"];
    if has(&smooth) || !has(&flat) {
        return Err(("\"nearest\": every cell has one value", format!("\"{stated}\"")));
    }
    Ok(())
}

/// Relative difference that a stated largest extinction may have from the grid's own: it is written with few digits.
const ROUNDED: f64 = 0.01;

/// Checks what key `sigma_t_max_per_m` states against the grid's largest extinction with the scene's own kappa, 1/m.
///
/// Errors: they differ by more than a hundredth.
pub fn largest_extinction(stated: f64, found: f64) -> Result<(), Refusal> {
    if (stated - found).abs() <= ROUNDED * stated.abs().max(found.abs()) {
        return Ok(());
    }
    Err((
        "the grid's largest extinction with this kappa, 1/m",
        format!("{stated}, where the grid has {found:.6}"),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn orders_in_words_are_obeyed_or_refused() {
        for x in
            ["x + nx*(y + ny*z), x fastest, little-endian float32", "x fastest", "x+nx*(y+ny*z)", "z slowest"]
        {
            assert_eq!(order(x), Ok(Order::XFastest), "{x}");
        }
        for z in ["z + nz*(y + ny*x), z fastest", "z fastest", "Z Fastest; float32", "x slowest, z fastest"] {
            assert_eq!(order(z), Ok(Order::ZFastest), "{z}");
        }
        for none in [
            "y fastest",
            "x fastest, z fastest",
            "as usual",
            "",
            "x fastest, float64",
            "x fastest, big-endian",
        ] {
            assert!(order(none).is_err(), "{none}");
        }
    }

    #[test]
    fn units_other_than_the_keys_own_are_refused() {
        for good in [
            json!("metres; sigma_t in 1/m; intensity in W/sr; radiance in W/(m^2 sr); fluence rate in W/m^2"),
            json!("SI"),
            json!({"length": "m", "extinction": "1/m"}),
        ] {
            assert_eq!(units(&good), Ok(()), "{good}");
        }
        for bad in [
            json!("kilometres"),
            json!("1/km"),
            json!({"length": "km"}),
            json!("feet"),
            json!("kW/sr and m"),
            json!(""),
        ] {
            assert!(units(&bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn interpolation_and_the_largest_extinction_are_checked() {
        assert_eq!(interpolation("nearest (piecewise constant per cell), zero outside the grid"), Ok(()));
        assert!(interpolation("trilinear").is_err() && interpolation("as you like").is_err());
        assert_eq!(largest_extinction(0.02, 0.019_999_999_6), Ok(()));
        assert!(largest_extinction(0.03, 0.02).is_err() && largest_extinction(f64::NAN, 0.02).is_err());
    }
}
