//! The effects and their controls, as `--list` prints them and `--set` takes them.

use crate::cli::json;
use crate::cli::table::{self, Column, layout};
use serde_json::{Value, json};
use squall_bake::provenance::tool;
use squall_runtime::wet::controls::Parameter;
use squall_runtime::wet::draw::{Effect, WetSettings};

/// A control of an effect, set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Whose.
    pub effect: Effect,
    /// Its name.
    pub control: &'static str,
    /// Its value.
    pub value: f32,
}

/// Reads EFFECT.CONTROL=X. Errors: no such control, a value out of its range.
pub fn setting(text: &str) -> Result<Setting, String> {
    let wanted = || "wanted EFFECT.CONTROL=X; squall wet --list has them all".to_owned();
    let (name, value) = text.split_once('=').ok_or_else(wanted)?;
    let (effect, control) = name.trim().split_once('.').ok_or_else(wanted)?;
    let effect = Effect::from_name(effect).ok_or_else(|| {
        let known = Effect::ALL.map(Effect::name).join(", ");
        format!("no effect `{effect}`: wanted one of {known}")
    })?;
    let names = || effect.parameters().iter().map(|parameter| parameter.name).collect::<Vec<_>>().join(", ");
    let parameter = effect.parameters().iter().find(|parameter| parameter.name == control);
    let parameter = parameter.ok_or_else(|| format!("no control `{control}`: wanted one of {}", names()))?;
    let [low, high] = parameter.range;
    let range = || format!("wanted {low} to {high} {}", parameter.unit).trim_end().to_owned();
    let value: f32 = value.trim().parse().map_err(|_| range())?;
    WetSettings::default().set(effect, parameter.name, value).map_err(|_| range())?;
    Ok(Setting { effect, control: parameter.name, value })
}

/// Prints every effect, as words or as JSON. Errors: standard output cannot be written to.
pub fn print(as_json: bool) -> anyhow::Result<()> {
    if as_json {
        let effects: Vec<Value> = Effect::ALL.into_iter().map(effect_value).collect();
        return json::answer(&json!({ "command": "wet", "tool": tool(), "effects": effects }));
    }
    for effect in Effect::ALL {
        let off = if is_on(effect) { "" } else { " (off; --with turns it on)" };
        say!("{}{off}: {} [paper: {}]", effect.name(), effect.says(), effect.section());
        let columns = [
            Column::left("  control"),
            Column::left("unit"),
            Column::right("usual"),
            Column::left("range"),
            Column::left("paper"),
            Column::left("what it does"),
        ];
        let row = |parameter: &Parameter| {
            let [low, high] = parameter.range;
            vec![
                format!("  {}", parameter.name),
                dash(parameter.unit),
                parameter.usual.to_string(),
                format!("{low} to {high}"),
                dash(parameter.paper),
                parameter.says.to_owned(),
            ]
        };
        let rows: Vec<Vec<String>> = effect.parameters().iter().map(row).collect();
        table::print(&layout(&columns, &rows))?;
        say!("");
    }
    Ok(())
}

/// Whether it is drawn where nobody says a word.
fn is_on(effect: Effect) -> bool {
    !WetSettings::OFF.contains(&effect)
}

fn dash(text: &str) -> String {
    if text.is_empty() { "–".to_owned() } else { text.to_owned() }
}

fn effect_value(effect: Effect) -> Value {
    let controls: Vec<Value> = effect
        .parameters()
        .iter()
        .map(|parameter| {
            json!({
                "name": parameter.name,
                "paper": parameter.paper,
                "unit": parameter.unit,
                "range": parameter.range,
                "usual": parameter.usual,
                "says": parameter.says,
            })
        })
        .collect();
    json!({
        "effect": effect.name(),
        "on": is_on(effect),
        "says": effect.says(),
        "section": effect.section(),
        "controls": controls,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_is_an_effect_a_control_and_a_value_in_its_range() {
        let found = setting("surface.puddles=0.5").unwrap();
        assert_eq!((found.effect, found.control, found.value), (Effect::Surface, "puddles", 0.5));
        for wrong in [
            "surface.puddles",
            "snow.x=1",
            "surface.snow=1",
            "surface.puddles=2",
            "surface.puddles=nan",
            "puddles=1",
        ] {
            assert!(setting(wrong).is_err(), "{wrong}");
        }
    }
}
