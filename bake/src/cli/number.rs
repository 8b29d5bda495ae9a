//! Numbers of options, checked while they are parsed: a value that no run of a command could take is bad usage (exit code 2). What is
//! wrong only beside an asset or an input is that file's error (3).

/// A finite number.
pub fn finite(text: &str) -> Result<f64, String> {
    let found = text.trim().parse::<f64>().ok().filter(|value| value.is_finite());
    found.ok_or_else(|| "wanted a finite number".into())
}

/// A finite number above 0.
pub fn positive(text: &str) -> Result<f64, String> {
    finite(text).ok().filter(|value| *value > 0.0).ok_or_else(|| "wanted a number above 0".into())
}

/// A finite number from 0.
pub fn from_zero(text: &str) -> Result<f64, String> {
    finite(text).ok().filter(|value| *value >= 0.0).ok_or_else(|| "wanted a number of 0 or more".into())
}

/// A number from `low` to `high`, both among them; `unit` is said behind them.
pub fn from_to(
    low: f64,
    high: f64,
    unit: &'static str,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| {
        let found = finite(text).ok().filter(|value| (low..=high).contains(value));
        found.ok_or_else(|| format!("wanted {low} to {high}{}{unit}", if unit.is_empty() { "" } else { " " }))
    }
}

/// A number between `low` and `high`, neither among them.
pub fn between(
    low: f64,
    high: f64,
    unit: &'static str,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| {
        let found = finite(text).ok().filter(|value| *value > low && *value < high);
        found.ok_or_else(|| format!("wanted {unit} between {low} and {high}"))
    }
}

/// N finite numbers with commas between them.
pub fn list<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let found: Result<Vec<f64>, String> = text.split(',').map(finite).collect();
    let found = found.ok().and_then(|found| <[f64; N]>::try_from(found).ok());
    found.ok_or_else(|| format!("wanted {N} finite numbers with commas between them"))
}

/// [`list`], every number from `low` to `high`.
pub fn list_from_to<const N: usize>(
    low: f64,
    high: f64,
    unit: &'static str,
) -> impl Fn(&str) -> Result<[f64; N], String> + Clone + Send + Sync + 'static {
    move |text| {
        let found = list::<N>(text).ok().filter(|all| all.iter().all(|value| (low..=high).contains(value)));
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        found.ok_or_else(|| format!("wanted {N} numbers from {low} to {high}{unit} with commas between them"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_bound_takes_what_is_no_number() {
        for wrong in ["nan", "inf", "-inf", "", "x", "1,2"] {
            assert!(finite(wrong).is_err() && from_to(-1e9, 1e9, "m")(wrong).is_err(), "{wrong}");
        }
        assert_eq!(
            (from_to(0.0, 2.0, "m")("2"), between(0.0, 2.0, "degrees")("2").is_err()),
            (Ok(2.0), true)
        );
        assert_eq!(from_to(0.0, 2.0, "")("3"), Err("wanted 0 to 2".into()));
        assert_eq!(list::<3>("-3, 0,1e2"), Ok([-3.0, 0.0, 100.0]));
        assert!(list::<3>("1,2").is_err() && list::<2>("1,nan").is_err());
        for (unit, wanted) in [("m/s", "from -1 to 1 m/s with"), ("", "from -1 to 1 with")] {
            let words = list_from_to::<2>(-1.0, 1.0, unit)("0,2").unwrap_err();
            assert!(words.contains(wanted), "{words}");
        }
    }
}
