//! `squall export ASSET --density|--light STROKE|--fluence STROKE -o FILE`

use super::common::Common;
use super::folder::check_apart;
use super::json;
use serde_json::json;
use squall_bake::BakeError;
use squall_bake::output::ktx2::{Texel, ktx2};
use squall_bake::output::npy::write_npy;
use squall_bake::output::vdb::{VdbGrid, write_vdb};
use squall_bake::output::{Output, Place};
use squall_bake::provenance::tool;
use squall_runtime::transport::Cloud;
use squall_runtime::{Asset, Clouds, Flash, StormRenderer, glam::DVec3};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Writes what an asset holds per cell into a volume that other programs read.
///
/// OpenVDB has leaves without anything left out; NumPy's arrays have axes x, y, z (and band); KTX 2 is a 3-D texture.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
#[command(group(clap::ArgGroup::new("quantity").required(true)))]
pub struct Args {
    /// The asset.
    asset: PathBuf,
    /// Extinction, 1/m: grid "density".
    #[arg(long, group = "quantity")]
    density: bool,
    /// In-scattered radiance of a stroke towards the viewer, direct light included, W/(m² sr) in three bands: grid "light". More than
    /// one stroke, parted by commas, flash together.
    #[arg(long, value_name = "STROKE", value_delimiter = ',', group = "quantity")]
    light: Vec<String>,
    /// Fluence rate of a stroke, W/m² in three bands: grid "fluence". An asset baked for a view region holds none.
    #[arg(long, value_name = "STROKE", value_delimiter = ',', group = "quantity")]
    fluence: Vec<String>,
    /// Where light is looked at from, m; the camera of the asset's own view if left out.
    #[arg(long, value_name = "X,Y,Z", value_parser = place, allow_hyphen_values = true, requires = "light", conflicts_with_all = ["density", "fluence"])]
    viewer: Option<DVec3>,
    /// The file to write: .vdb, .npy or .ktx2.
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
    /// Form of the file where its name does not tell, as on standard output.
    #[arg(long, value_enum)]
    format: Option<Form>,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: Common,
}

impl Args {
    /// Whether the answer is to be JSON.
    pub fn json(&self) -> bool {
        self.json
    }
}

fn place(text: &str) -> Result<DVec3, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|part| part.trim().parse().ok()).collect();
    match numbers.as_slice() {
        &[x, y, z] if text.split(',').count() == 3 && [x, y, z].iter().all(|v| v.is_finite()) => {
            Ok(DVec3::new(x, y, z))
        }
        _ => Err("three numbers in metres, such as 0,-400,2".into()),
    }
}

#[derive(Clone, Copy, PartialEq, clap::ValueEnum)]
enum Form {
    /// OpenVDB.
    Vdb,
    /// NumPy's array.
    Npy,
    /// KTX 2, a 3-D texture.
    Ktx2,
}

impl Form {
    /// The form of the name's end, or what was given for standard output, devices and pipes, which have no such names.
    ///
    /// Errors: a name that tells none, or another one.
    fn of(path: &Path, given: Option<Self>) -> Result<Self, BakeError> {
        let named = match path.extension().and_then(|end| end.to_str()) {
            Some("vdb") => Some(Self::Vdb),
            Some("npy") => Some(Self::Npy),
            Some("ktx2") => Some(Self::Ktx2),
            _ => None,
        };
        let bad = |wanted: &str| BakeError::input(path, "file", wanted, path.display());
        match (named, given) {
            (Some(named), Some(given)) if named != given => Err(bad("a name that ends as --format says")),
            (Some(form), _) => Ok(form),
            (None, Some(form)) if !matches!(Place::of(path)?, Place::File(_)) => Ok(form),
            (None, None) if !matches!(Place::of(path)?, Place::File(_)) => {
                Err(bad("--format vdb, npy or ktx2 beside an output without a name"))
            }
            (None, _) => Err(bad("a name that ends in .vdb, .npy or .ktx2")),
        }
    }
}

/// A quantity per cell.
enum Cells {
    /// One number, of this name and unit.
    One(&'static str, &'static str, Vec<f32>),
    /// Red, green and blue.
    Three(&'static str, &'static str, Vec<[f32; 3]>),
}

/// Works the quantity out, then writes it.
pub fn run(args: Args) -> anyhow::Result<()> {
    json::check_stdout(args.json, &[&args.out]);
    let names = if args.light.is_empty() { &args.fluence } else { &args.light };
    if let Some((_, name)) = names.iter().enumerate().find(|(at, name)| names[..*at].contains(name)) {
        json::usage(&format!("{name}: wanted every stroke once, found twice"));
    }
    let form = Form::of(&args.out, args.format)?;
    let bars = args.common.start()?;
    let output = Output::prepare(&args.out)?;
    check_apart(&[&args.out], [&args.asset].into_iter())?;
    let asset = super::asset::open(&args.asset)?;
    let mut clouds = Clouds::new(&asset)?;
    let cells = quantity(&args, &asset, &mut clouds)?;
    let cloud = clouds.cloud();
    // What is written is made first: a file cannot fail half way for a reason of ours.
    let bytes = encoded(form, cloud, &cells)?;
    output.write(|out| out.write_all(&bytes))?;
    let (name, unit, bands) = match &cells {
        Cells::One(name, unit, _) => (*name, *unit, 1),
        Cells::Three(name, unit, _) => (*name, *unit, 3),
    };
    let [nx, ny, nz] = cloud.shape.to_array();
    if args.json {
        return json::answer(&json!({
            "command": "export", "tool": tool(), "file": args.out.to_string_lossy(), "grid": name, "unit": unit,
            "dims_xyz": [nx, ny, nz], "bands": bands, "cell_m": cloud.cell_m, "origin_m": cloud.origin_m.to_array(),
            "bytes": bytes.len(),
        }));
    }
    let text =
        format!("{}: grid {name}, {unit}, {nx} × {ny} × {nz} cells, {} bytes", output.name(), bytes.len());
    bars.say(&text);
    Ok(())
}

fn quantity(args: &Args, asset: &Asset, clouds: &mut Clouds) -> anyhow::Result<Cells> {
    if args.density {
        return Ok(Cells::One("density", "1/m", clouds.cloud().extinction.clone()));
    }
    let flashes = |names: &[String]| names.iter().map(Flash::named).collect::<Vec<_>>();
    let count = clouds.cloud().shape.len();
    if !args.fluence.is_empty() {
        let mut cells = vec![[0.0; 3]; count];
        clouds.fluence(&flashes(&args.fluence), &mut cells)?;
        return Ok(Cells::Three("fluence", "W/m²", cells));
    }
    let viewer = match args.viewer {
        Some(viewer) => viewer,
        None => own_viewer(&args.asset, asset)?,
    };
    let mut cells = vec![[0.0; 4]; count];
    clouds.radiance(&flashes(&args.light), viewer, &mut cells)?;
    let light = cells.into_iter().map(|[red, green, blue, _]| [red, green, blue]).collect();
    Ok(Cells::Three("light", "W/(m² sr)", light))
}

/// The camera of the asset's own view.
fn own_viewer(path: &Path, asset: &Asset) -> anyhow::Result<DVec3> {
    let frame = StormRenderer::new(asset)?.frame().map(|frame| frame.camera.position);
    frame.ok_or_else(|| BakeError::input(path, "view", "a view, or --viewer X,Y,Z", "none").into())
}

fn encoded(form: Form, cloud: &Cloud, cells: &Cells) -> io::Result<Vec<u8>> {
    let [nx, ny, nz] = cloud.shape.to_array();
    let size = [nx, ny, nz].map(|count| count as u32);
    let mut bytes = Vec::new();
    match (form, cells) {
        (Form::Vdb, Cells::One(name, _, values)) => {
            vdb::<1>(cloud, name, bytemuck::cast_slice(values), &mut bytes)?
        }
        (Form::Vdb, Cells::Three(name, _, values)) => vdb::<3>(cloud, name, values, &mut bytes)?,
        (Form::Npy, Cells::One(_, _, values)) => {
            write_npy(&[nx, ny, nz], values.iter().copied(), &mut bytes)?
        }
        (Form::Npy, Cells::Three(_, _, values)) => {
            let bands = (0..3).flat_map(|band| values.iter().map(move |value| value[band]));
            write_npy(&[nx, ny, nz, 3], bands, &mut bytes)?;
        }
        (Form::Ktx2, Cells::One(_, _, values)) => {
            bytes = ktx2(Texel::R32, size, bytemuck::cast_slice(values));
        }
        (Form::Ktx2, Cells::Three(_, _, values)) => {
            // The extinction stands behind the light: what a march needs is one texel.
            let texels: Vec<half::f16> = values
                .iter()
                .zip(&cloud.extinction)
                .flat_map(|(light, &extinction)| {
                    let [red, green, blue] =
                        light.map(|value| half::f16::from_f32(value.min(half::f16::MAX.to_f32())));
                    // Both are cut to what 16 bits hold, 65 504: an infinite extinction would be no medium at all.
                    [red, green, blue, half::f16::from_f32(extinction.min(half::f16::MAX.to_f32()))]
                })
                .collect();
            let halves: Vec<u8> = texels.iter().flat_map(|half| half.to_le_bytes()).collect();
            bytes = ktx2(Texel::Rgba16, size, &halves);
        }
    }
    Ok(bytes)
}

fn vdb<const C: usize>(
    cloud: &Cloud,
    name: &str,
    values: &[[f32; C]],
    bytes: &mut Vec<u8>,
) -> io::Result<()> {
    let grid = VdbGrid { name, shape: cloud.shape, cell_m: cloud.cell_m, origin_m: cloud.origin_m, values };
    write_vdb(&grid, bytes)
}
