//! Options that put another sky over a picture.

use squall_formats::section::view::ViewSky;

/// The sun and what hides it.
#[derive(clap::Args)]
pub struct SkyArgs {
    /// Where the sun stands: azimuth from +x towards +y and elevation, degrees.
    #[arg(long, value_name = "AZ,EL", allow_hyphen_values = true, value_parser = sun)]
    sun: Option<[f64; 2]>,
    /// Share of the sky under grey cloud, 0 to 1.
    #[arg(long, value_name = "SHARE", value_parser = share)]
    overcast: Option<f64>,
}

impl SkyArgs {
    /// Puts what was given over `sky`.
    pub fn apply(&self, sky: &mut ViewSky) {
        if let Some([azimuth, elevation]) = self.sun {
            sky.sun_azimuth_rad = azimuth.to_radians();
            sky.sun_elevation_rad = elevation.to_radians();
        }
        if let Some(overcast) = self.overcast {
            sky.overcast = overcast;
        }
    }
}

fn sun(text: &str) -> Result<[f64; 2], String> {
    let wanted = "wanted AZIMUTH,ELEVATION in degrees, the elevation from -17 to 90, such as 105,20";
    let (azimuth, elevation) = text.split_once(',').ok_or(wanted)?;
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| wanted.to_owned());
    let (azimuth, elevation) = (number(azimuth)?, number(elevation)?);
    if azimuth.abs() <= 5729.5 && (-17.0..=90.0).contains(&elevation) {
        return Ok([azimuth, elevation]);
    }
    Err(wanted.into())
}

fn share(text: &str) -> Result<f64, String> {
    let wanted = "wanted a number from 0 to 1";
    let value: f64 = text.parse().map_err(|_| wanted.to_owned())?;
    if (0.0..=1.0).contains(&value) { Ok(value) } else { Err(wanted.into()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn suns_are_two_numbers_of_a_sky() {
        assert_eq!(sun("105, -3.2"), Ok([105.0, -3.2]));
        assert_eq!(sun("-90,90"), Ok([-90.0, 90.0]));
        for wrong in ["105", "a,b", "0,-18", "0,91", "nan,0", "1,2,3"] {
            assert!(sun(wrong).is_err(), "{wrong}");
        }
        assert!(share("1.1").is_err() && share("nan").is_err() && share("0.4") == Ok(0.4));
    }
}
