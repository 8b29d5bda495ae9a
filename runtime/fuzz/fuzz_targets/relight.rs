//! Relighting, entered directly: a cloud of a few cells, rows of every kind, lights anywhere.

#![no_main]

use arbitrary::{Result, Unstructured};
use glam::DVec3;
use libfuzzer_sys::fuzz_target;
use squall_runtime::relight::{PointLight, RelightBuffers, RelightOptions, Relighter};
use squall_runtime::single_scatter::{DirectRays, DirectSettings, add_direct};
use squall_runtime::verify::verify;
use squall_runtime_fuzz::{asset, cloud, cloud_section, number, numbers, response};

/// Whether every value is a number; they are sums of a few hundred numbers of at most 10⁴.
fn sound(values: &[f32]) -> bool {
    values.iter().all(|value| value.is_finite())
}

fn relight(u: &mut Unstructured<'_>) -> Result<()> {
    let (head, extinction) = cloud(u)?;
    let asset = asset(&[cloud_section(&head, &extinction), response(u, &head)?]);
    verify(&asset).expect("the generator made a whole asset");
    let relighter = Relighter::new(&asset).expect("a whole asset relights");
    let mut buffers = RelightBuffers::default();
    let lights: Vec<PointLight> = (0..u.int_in_range(0..=4)?)
        .map(|_| {
            let position = DVec3::from_array(numbers(u, -2500.0, 6000.0)?);
            let [low, high] = relighter.bounds();
            // Half of them within the box of the virtual lights.
            let position = if u.arbitrary()? { position.clamp(low, high) } else { position };
            Ok(PointLight { position, intensity: number(u, -1e3, 1e3)? })
        })
        .collect::<Result<_>>()?;
    let options = RelightOptions { paper_ambient: u.arbitrary()? };
    let all = lights.iter().all(|light| relighter.reaches(light.position));
    match relighter.relight(&lights, options, &mut buffers) {
        Ok(relit) => {
            assert!(all && sound(relit.planes));
            let towards = DVec3::from_array(numbers(u, -1.0, 1.0)?).normalize_or(DVec3::Z);
            let mut factors = Vec::new();
            for cell in 0..relit.cells {
                let [x, y, z] = relighter.cloud().shape.cell(cell);
                relit.factors(relighter.cloud().centre([x, y, z]), towards, &mut factors);
                assert!(relit.value(cell, &factors).is_finite());
                assert!(relit.fluence(cell).is_none_or(f32::is_finite));
            }
            let split: f64 = relighter.virtual_lights(&buffers).iter().map(|light| light.intensity).sum();
            let given: f64 = lights.iter().map(|light| light.intensity).sum();
            // Single precision of a few numbers up to 10³.
            assert!((split - given).abs() < 0.1, "{split} W/sr for {given}");
            assert!(relighter.error_bounds(&buffers).iter().all(|bound| bound.is_finite()));
        }
        Err(error) => assert!(!all, "{error}"),
    }
    for kind in relighter.response().head.distant.iter().map(|source| source.kind) {
        let relit = relighter.distant(kind, &mut buffers).expect("whole rows").expect("a row of that kind");
        assert!(sound(relit.planes));
    }
    let mut j = vec![0.0; extinction.len()];
    let towards = vec![[0.6, 0.0, 0.8]; extinction.len()];
    let settings = DirectSettings { rays: DirectRays::PerPoint(16), seed: u.arbitrary()? };
    add_direct(relighter.cloud(), relighter.extinction_scale(), &lights, &towards, settings, &mut j);
    assert!(sound(&j));
    Ok(())
}

fuzz_target!(|data: &[u8]| {
    let _ = relight(&mut Unstructured::new(data));
});
