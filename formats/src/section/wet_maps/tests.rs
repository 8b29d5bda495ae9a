use super::*;
use proptest::prelude::*;

const GRID: ([f64; 2], f64, [u32; 2]) = ([-3.0, 5.0], 0.25, [4, 3]);

fn maps() -> WetMapsSection {
    let heights = [0.0, 0.01, 0.15, 6.5, f32::NAN, 0.0, 0.02, 0.15, 0.0, 0.0, 12.0, -0.5];
    let light = [0.0, 1e-3, 2.0, 800.0, 0.5, 0.0, 3.0, 1.0, 0.1, 0.2, 0.3, 0.4];
    let map = |values: &[f32], squared, rounding| {
        GroundRecord::quantise(GRID, values, MOST_STEPS, squared, rounding)
    };
    let ends = [[0.0, 1.0, 3.0], [4.0, 1.0, 3.0]];
    let within = BoxRecord::around(ends.into_iter());
    let steps = |at: usize| within.steps(ends[at]);
    let both = [steps(0), steps(1)].concat().try_into().unwrap();
    let harmonics = vec![[0.5, -0.25, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]; 8];
    let (peaks, steps) = LightningRecord::quantise(&harmonics, 1);
    WetMapsSection {
        height: Some(map(&heights, false, Rounding::Up)),
        water: Some(map(&[0.0; 12], false, Rounding::Nearest)),
        overhead: vec![map(&light, true, Rounding::Nearest); 3],
        drips: DripRecords { within, ends: vec![both], drains_m2: vec![7.5] },
        fins: FinRecords { within, ends: vec![both], normals: vec![[0, 0, 127, 127, 0, 0]] },
        lightning: Some(LightningRecord {
            origin_m: [0.0; 3],
            cell_m: 2.0,
            size: [2; 3],
            directions: vec![[0.0, 0.6, 0.8]],
            peaks,
            steps,
        }),
    }
}

fn read(bytes: &[u8]) -> Result<WetMapsSection, ReadError> {
    WetMapsSection::read(bytes, WetMapsSection::VERSION, &Limits::default())
}

#[test]
fn maps_read_back_within_half_a_step_and_heights_never_below() {
    let bytes = maps().write().to_bytes();
    let read_back = read(&bytes).unwrap();
    assert_eq!(read_back, maps());
    let height = read_back.height.unwrap();
    let values = height.values().unwrap();
    for (found, wanted) in values.iter().zip([0.0, 0.01, 0.15, 6.5]) {
        assert!(*found >= wanted - 1e-6 && found - wanted <= 1.01 * height.step, "{found} {wanted}");
    }
    assert!(values[4].is_nan() && (values[10] - 12.0).abs() < 1e-5);
    assert!(read_back.water.unwrap().values().unwrap().iter().all(|depth| *depth == 0.0));
    let light = read_back.overhead[0].values().unwrap();
    for (found, wanted) in light.iter().zip([0.0f32, 1e-3, 2.0, 800.0]) {
        // The square of half a step more or less.
        let half = read_back.overhead[0].step.sqrt() * 0.5;
        assert!((found.sqrt() - wanted.sqrt()).abs() <= 1.01 * half, "{found} {wanted}");
    }
    let harmonics = read_back.lightning.unwrap().harmonics();
    assert!((harmonics[7][1] + 0.25).abs() < 1e-5 && harmonics[0][2] == 0.0);
    assert_eq!(read_back.drips.within.place([65_535, 0, 0])[0].round(), 4.0);
}

#[test]
fn flat_ground_takes_a_byte_a_cell_and_any_codes_read_back() {
    let flat = GroundRecord::quantise(GRID, &[3.0; 12], MOST_STEPS, false, Rounding::Up);
    assert_eq!((flat.code.len(), flat.values().unwrap()[11]), (12, 3.0));
    let wild = [0, 65_535, 1, 32_768, 32_767, 5, 0, 0, 65_535, 65_534, 2, 40_000];
    assert_eq!(decode(&encode(&wild, 4), [4, 3]).unwrap(), wild);
}

#[test]
fn maps_cut_at_any_byte_and_other_versions_are_refused() {
    let bytes = maps().write().to_bytes();
    assert!((0..bytes.len()).all(|cut| read(&bytes[..cut]).is_err()));
    assert!(WetMapsSection::read(&bytes, 2, &Limits::default()).is_err());
    let few = Limits { items: 0, ..Limits::default() };
    assert!(matches!(
        WetMapsSection::read(&bytes, 1, &few),
        Err(ReadError::OverLimit { field: "drips", .. })
    ));
}

#[test]
fn numbers_out_of_range_are_refused_by_name() {
    type Spoil = fn(&mut WetMapsSection);
    let spoils: [(&str, Spoil); 16] = [
        ("map.origin_m", |s| s.height.as_mut().unwrap().origin_m[1] = f64::NAN),
        ("map.cell_m", |s| s.water.as_mut().unwrap().cell_m = 0.0),
        ("map.size", |s| s.water.as_mut().unwrap().size = [0, 12]),
        ("map.code", |s| s.water.as_mut().unwrap().size = [4, 4]),
        ("map.code", |s| s.height.as_mut().unwrap().code.push(0)),
        ("map.low", |s| s.height.as_mut().unwrap().step = f32::INFINITY),
        ("overhead", |s| drop(s.overhead.pop())),
        ("box", |s| s.fins.within.step_m[0] = -1.0),
        ("drips.drains_m2", |s| s.drips.drains_m2[0] = f32::NAN),
        ("fins.normals", |s| s.fins.normals.clear()),
        ("fins.normals", |s| s.fins.normals[0] = [0, 0, 127, 0, 0, 0]),
        ("fins.normals", |s| s.fins.normals[0] = [0, 0, 123, 127, 0, 0]),
        ("fins.normals", |s| s.fins.normals[0] = [127, 127, 127, 0, 0, 127]),
        ("lightning.directions", |s| s.lightning.as_mut().unwrap().directions[0] = [0.0; 3]),
        ("lightning.peaks", |s| s.lightning.as_mut().unwrap().peaks[0][0] = -1.0),
        ("lightning.steps", |s| s.lightning.as_mut().unwrap().size = [2, 2, 3]),
    ];
    for (name, spoil) in spoils {
        let mut section = maps();
        spoil(&mut section);
        let error = read(&section.write().to_bytes()).expect_err(name).to_string();
        assert!(error.contains(name), "{name}: {error}");
    }
}

#[test]
fn the_bytes_lie_where_the_specification_says() {
    let bytes = maps().write().to_bytes();
    let float = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let double = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    let count = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    // The option's byte, then origin, cell, size, low, step, squared, code.
    assert_eq!((bytes[0], double(1), double(17), float(33)), (1, -3.0, 0.25, -0.5));
    let code = count(42) as usize;
    assert_eq!((bytes[41], code), (0, maps().height.unwrap().code.len()));
    // The water's option behind it.
    assert_eq!((bytes[50 + code], double(51 + code)), (1, -3.0));
}

proptest! {
    #[test]
    fn damaged_bytes_never_panic_and_never_pass_unchecked(at in 0usize..4000, value: u8) {
        let mut bytes = maps().write().to_bytes();
        let at = at % bytes.len();
        bytes[at] = value;
        if let Ok(section) = read(&bytes) {
            prop_assert!(section.check().is_ok());
            for map in section.height.iter().chain(&section.water).chain(&section.overhead) {
                prop_assert!(map.values().is_ok());
            }
            let _ = section.lightning.map(|lightning| lightning.harmonics());
        }
    }
}
