//! Clouds at the edges of their range, baked, relit and looked at.

use glam::{DVec3, Vec4};
use squall_bake::asset::grid_section;
use squall_bake::progress::Quiet;
use squall_bake::response::{Job, ResponseSettings, Sources, WantedLights, bake_response};
use squall_formats::GridShape;
use squall_formats::container::write;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::response::{self, Codec, DirectTerm, DirectionalBasis, Stored};
use squall_formats::units::Radians;
use squall_runtime::Asset;
use squall_runtime::camera::{Projection, Ray};
use squall_runtime::relight::{PointLight, RelightBuffers, RelightOptions, Relighter};
use squall_runtime::shade::cloud::direct::ExactDirect;
use squall_runtime::shade::cloud::{
    Cells, CloudMarch, CloudPicture, CloudShape, MarchQuality, RayWidth, WideRay,
};
use squall_runtime::shade::detail::{Detail, DetailParameters};
use squall_runtime::shade::water::rippled_highlight;
use squall_runtime::transport::direct::Light;
use squall_runtime::transport::lanes::SimdLevel;
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::SolveSettings;
use squall_runtime::transport::{Boundary, Cloud};

fn uniform(shape: [u32; 3], cell_m: [f64; 3], extinction: f32) -> Cloud {
    let shape = GridShape::new(shape[0], shape[1], shape[2]);
    let origin_m = DVec3::new(-50.0, -50.0, 500.0);
    Cloud {
        shape,
        cell_m,
        origin_m,
        extinction: vec![extinction; shape.len()],
        albedo: 0.9,
        g: 0.85,
        boundary: Boundary::Open,
    }
}

#[test]
fn vacuum_a_single_cell_and_very_deep_cells_are_baked_and_relit() {
    for (shape, extinction) in
        [([1, 1, 1], 0.0), ([4, 3, 2], 0.0), ([1, 1, 1], 0.05), ([4, 3, 2], 1e-4), ([4, 3, 2], 10.0)]
    {
        let cloud = uniform(shape, [100.0, 100.0, 100.0], extinction);
        let high = cloud.far_corner();
        let grid = LightGrid { x_m: vec![-50.0, high.x], y_m: vec![-50.0, high.y], z_m: vec![450.0, high.z] };
        let lights = WantedLights { grid, wanted: Vec::new() };
        let settings = ResponseSettings {
            seen_only: false,
            finer: 0,
            spacing_m: 0.0,
            view_region: None,
            basis: DirectionalBasis::Harmonics { degree: 1 },
            direct: DirectTerm::AtRunTime,
            codec: Codec::Bytes,
            relative_error: 0.02,
            refine: 1,
            stored: Stored::Means,
            error_for: Default::default(),
            samples: 2,
            solve: SolveSettings {
                quadrature: Quadrature::Lebedev26,
                level: SimdLevel::Best,
                ..SolveSettings::default()
            },
        };
        let stroke = vec![PointLight { position: 0.5 * (cloud.origin_m + high), intensity: 1e6 }];
        let sources = Sources { lights, distant: Vec::new(), sun: None };
        let held_out = std::slice::from_ref(&stroke);
        let job = Job {
            cloud: &cloud,
            sources: &sources,
            settings: &settings,
            held_out,
            known: None,
            shown: None,
            cache: None,
        };
        let mut baked = bake_response(&job, &Quiet).unwrap();
        let sections = [grid_section(&cloud), response::write(&baked.head, std::mem::take(&mut baked.rows))];
        let mut bytes = Vec::new();
        write(&mut bytes, &sections).unwrap();
        let asset = Asset::from_bytes(&bytes).unwrap();
        let relighter = Relighter::new(&asset).unwrap();
        let mut buffers = RelightBuffers::default();
        let relit = relighter.relight(&stroke, RelightOptions::default(), &mut buffers).unwrap();
        let norm = |values: &[f32]| values.iter().map(|&v| f64::from(v) * f64::from(v)).sum::<f64>().sqrt();
        let wanted = &baked.held_out[0].uncompressed;
        let error: Vec<f32> = relit.planes.iter().zip(wanted).map(|(a, b)| a - b).collect();
        println!("{shape:?} {extinction}: light {:.3e}, off {:.1e}", norm(wanted), norm(&error));
        assert!(relit.planes.iter().all(|v| v.is_finite()));
        // A row's own budget; the sum of eight rows keeps it, as light of all has the same sign.
        assert!(norm(&error) <= 0.02 * norm(wanted), "{shape:?} {extinction}");
        assert!((norm(wanted) == 0.0) == (extinction == 0.0), "{shape:?} {extinction}");
        for (intensity, fine) in [(1e25, true), (1e39, false), (f64::NAN, false)] {
            let light = [PointLight { intensity, ..stroke[0] }];
            let found = relighter.relight(&light, RelightOptions::default(), &mut buffers);
            assert_eq!(
                found.is_ok_and(|relit| relit.planes.iter().all(|v| v.is_finite())),
                fine,
                "{intensity}"
            );
        }
    }
}

#[test]
fn rays_through_thin_thick_and_far_clouds_obey_beer_and_lambert_and_end() {
    let detail = Detail::new(&DetailParameters::default()).unwrap();
    let cases = [
        ([1, 1, 1], [100.0, 100.0, 100.0]),
        ([3, 3, 3], [100.0 / 3.0, 100.0 / 3.0, 100.0 / 3.0]),
        // Plates of 10 cm, and a cloud so far that the last digit of the distance is wider than a step.
        ([2, 2, 1000], [50.0, 50.0, 0.1]),
    ];
    for (shape, cell_m) in cases {
        for extinction in [0.0f32, 1e-9, 1e-4, 0.01, 0.1, 10.0, 1e6, 1e12] {
            let cloud = uniform(shape, cell_m, extinction);
            let prepared = CloudShape::new(&cloud);
            let cells = vec![Vec4::new(1.0, 2.0, 3.0, extinction); cloud.shape.len()];
            let picture = CloudPicture::new(&cloud, &prepared, &cells, &detail, None);
            let measured = CloudMarch::new(&cloud, Cells, MarchQuality::measured(10.0));
            let through = [
                (DVec3::new(0.3, 0.2, 0.0), DVec3::Z, 100.0),
                (DVec3::new(-60.0, 0.2, 540.0), DVec3::X, 100.0),
                (DVec3::new(-1e5, 0.2, 540.0), DVec3::X, 100.0),
                (DVec3::new(0.3, 0.2, 550.0), DVec3::Z, 50.0),
                // Along a face, out of a corner.
                (DVec3::new(-50.0, -50.0, 500.0), DVec3::ONE.normalize(), 100.0 * 3f64.sqrt()),
            ];
            for (origin, direction, length) in through {
                let ray = Ray { origin, direction };
                let projection = Projection::Perspective { vertical_fov: Radians(1.0) };
                let left = libm::exp(-f64::from(extinction) * length);
                let seen = measured.march(&WideRay::new(ray, projection, RayWidth::default()), |_| 2.0f64);
                assert!(
                    (f64::from(seen.transmittance) - left).abs() < 1e-4,
                    "{shape:?} {extinction} {origin}: {seen:?} for {left}"
                );
                assert!(
                    (seen.radiance - 1.8 * (1.0 - left)).abs() < 1e-3,
                    "{shape:?} {extinction} {origin}: {seen:?}"
                );
                let seen = picture.march(&ray);
                assert!(
                    (f64::from(seen.transmittance) - left).abs() < 0.01,
                    "{shape:?} {extinction} {origin}: {seen:?} for {left}"
                );
                assert!(
                    (f64::from(seen.radiance[1]) - 1.8 * (1.0 - left)).abs() < 0.02,
                    "{shape:?} {extinction} {origin}: {seen:?}"
                );
            }
        }
    }
}

#[test]
fn an_eye_beside_or_at_a_lamp_sees_finite_light() {
    let cloud = uniform([4, 4, 4], [25.0; 3], 0.02);
    for offset in [0.0, 1e-9, 1e-3, 1.0] {
        let light = DVec3::new(0.0, 0.0, 550.0);
        let exact = [Light::Point { position: light, intensity: 1.0 }];
        let exact = ExactDirect { lights: &exact, extinction_scale: 0.5 };
        let march = CloudMarch::new(&cloud, Cells, MarchQuality::measured(5.0)).with_exact(exact);
        let projection = Projection::Perspective { vertical_fov: Radians(1.0) };
        for direction in [DVec3::X, -DVec3::Z, DVec3::new(1.0, 1.0, 1.0).normalize()] {
            let ray = Ray { origin: light + DVec3::X * offset, direction };
            for width in [RayWidth::default(), RayWidth { start: 0.0, per_metre: 1e-3 }] {
                let seen = march.march(&WideRay::new(ray, projection, width), |_| 0.0f64);
                assert!(
                    seen.radiance.is_finite() && seen.radiance >= 0.0 && seen.transmittance > 0.0,
                    "{offset} {seen:?}"
                );
            }
        }
    }
}

#[test]
fn still_water_has_a_highlight_and_no_nonsense() {
    use glam::Vec3;
    for slope in [0.0, 1e-30, 1e-6, 1e-3, 0.1, 10.0] {
        for eye in [Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::X, -Vec3::Z] {
            for light in [Vec3::Z, Vec3::new(-0.6, 0.0, 0.8), -Vec3::X] {
                let found = rippled_highlight(Vec3::Z, light, eye, slope);
                assert!(found.is_finite() && found >= 0.0, "{slope} {eye} {light}: {found}");
            }
        }
    }
}
