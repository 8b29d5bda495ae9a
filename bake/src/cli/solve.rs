//! `squall solve SCENE.json --lamp NAME -o DIR`
use squall_bake::input::scene::{Optics, read_scene};
use std::path::PathBuf;

/// The slow truth: fields and pictures of one light in a scene, without an asset.
#[derive(clap::Args)]
pub struct Args {
    /// The scene (SCENE.json).
    scene: PathBuf,
    /// Name of one of the scene's lights.
    #[arg(long)]
    lamp: String,
    /// Folder for the results; made if missing.
    #[arg(short, long)]
    out: PathBuf,
    /// Parts that every cell is cut into along each axis.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=64))]
    refine: u32,
    /// Direction set: 14, 26, 50 or POLARxAZIMUTHS.
    #[arg(long, default_value = "50")]
    directions: String,
    #[arg(long, default_value_t = 2)]
    samples: u32,
    #[arg(long)]
    high_degree: bool,
    #[arg(long, default_value_t = 1e-4)]
    tolerance: f64,
    #[arg(long)]
    no_delta: bool,
}

pub fn run(args: Args) -> anyhow::Result<()> {
    use squall_bake::cloud::*;
    use squall_runtime::transport::quadrature::Quadrature;
    let scene = read_scene(&args.scene, Optics::default())?;
    let mut settings = TruthSettings {
        refine: args.refine,
        samples: args.samples,
        high_degree: args.high_degree,
        ..Default::default()
    };
    settings.solve.tolerance = args.tolerance;
    settings.solve.delta = !args.no_delta;
    settings.solve.quadrature = match args.directions.as_str() {
        "14" => Quadrature::Lebedev14,
        "26" => Quadrature::Lebedev26,
        "50" => Quadrature::Lebedev50,
        o => {
            let (a, b) = o.split_once('x').unwrap();
            Quadrature::DoubleGauss { polar: a.parse()?, azimuths: b.parse()? }
        }
    };
    let light = scene.lights.iter().find(|l| l.0 == args.lamp).unwrap().1;
    let dirs: Vec<_> = scene.cameras.iter().map(|c| -c.1.forward).collect();
    let t = std::time::Instant::now();
    let truth = solve_light(&scene.cloud, light, &dirs, &settings)?;
    eprintln!("{:?} {:?}", t.elapsed(), truth.report);
    std::fs::create_dir_all(&args.out)?;
    let w = |n: &str, v: &[f32]| std::fs::write(args.out.join(n), bytemuck::cast_slice(v));
    w("phi_sc.f32", &truth.phi_scattered())?;
    w("phi_dir.f32", &truth.phi_direct())?;
    for (i, (n, c)) in scene.cameras.iter().enumerate() {
        w(&format!("jcam_{n}.f32"), &truth.towards(i, -c.forward))?;
        let t = std::time::Instant::now();
        w(&format!("image_{n}.f32"), &image::solve_image(&truth, c))?;
        eprintln!("image {n} {:?}", t.elapsed());
    }
    Ok(())
}
