use super::*;
use proptest::prelude::*;

/// A whole section with made-up classes whose moments are powers of R times e^{−Λa}: straight on the axis.
fn sample() -> DensitySection {
    let rates: Vec<_> = [0.1, 1.0, 10.0, 50.0, 200.0].map(MillimetresPerHour).to_vec();
    let class = |from: f64| Class {
        diameter: [Millimetres(from), Millimetres(from + 0.5)],
        representative: Millimetres(from + 0.25),
        fall_speed: MetresPerSecond(4.0),
        edge_log2: -1,
    };
    let classes = vec![class(0.5), class(1.0), class(3.0)];
    let table = |mode| {
        let mut log_moments = Vec::new();
        for &rate in &rates {
            for _ in &classes {
                let log_number = POWER * libm::log(rate.0);
                log_moments.extend((0..MOMENTS).map(|i| log_number - i as f64));
            }
        }
        Table { mode, classes: classes.clone(), log_moments }
    };
    DensitySection {
        ranges: Ranges {
            rate: [rates[0], rates[4]],
            vertical_fov: [Degrees(20.0), Degrees(140.0)],
            exposure: [Seconds(0.001), Seconds(0.033)],
            length_px: [10.0, 200.0],
        },
        asked_error: 1e-4,
        measured_error: 1e-5,
        tables: Mode::ALL.map(table).to_vec(),
        rates,
    }
}

const POWER: f64 = 0.3;

fn read(bytes: &[u8]) -> Result<DensitySection, ReadError> {
    DensitySection::read(bytes, 1, &Limits::default())
}

#[test]
fn what_is_written_reads_back() {
    let section = sample();
    assert_eq!(read(&section.write()).unwrap(), section);
    assert!(DensitySection::read(&section.write(), 2, &Limits::default()).is_err());
}

#[test]
fn a_section_cut_or_lengthened_at_any_byte_is_refused() {
    let mut bytes = sample().write();
    for cut in 0..bytes.len() {
        assert!(read(&bytes[..cut]).is_err(), "cut at {cut}");
    }
    bytes.push(0);
    assert!(read(&bytes).is_err());
}

#[test]
fn straight_logarithms_are_read_back_exactly_between_nodes_and_below_the_first() {
    let section = sample();
    for rate in [1e-3, 0.05, 0.1, 0.3, 1.0, 7.0, 49.0, 120.0, 200.0].map(MillimetresPerHour) {
        let place = section.place(rate).unwrap();
        for (i, class) in section.tables[0].classes.iter().enumerate() {
            let wanted = libm::pow(rate.0, POWER) * libm::exp(-drops::slope(rate) * class.diameter[0].0);
            let found = section.tables[0].moments(&place, i).number;
            // Round-off of exponents up to 60.
            assert!((found / wanted - 1.0).abs() < 1e-12, "{rate:?}: {found} {wanted}");
        }
    }
}

#[test]
fn rates_that_no_node_bounds_have_no_place() {
    let section = sample();
    for rate in [0.0, -1.0, 200.1, f64::NAN, f64::INFINITY] {
        assert!(section.place(MillimetresPerHour(rate)).is_none());
    }
}

#[test]
fn each_damaged_field_is_named() {
    let damage: [(&str, fn(&mut DensitySection)); 13] = [
        ("rate range", |s| s.ranges.rate[0].0 = f64::NAN),
        ("fov range", |s| s.ranges.vertical_fov[1].0 = 180.0),
        ("exposure range", |s| s.ranges.exposure[0].0 = 0.0),
        ("length range", |s| s.ranges.length_px = [9.0, 3.0]),
        ("measured error", |s| s.measured_error = -1.0),
        ("rate nodes", |s| s.rates[2].0 = 0.5),
        ("rate nodes", |s| s.rates.truncate(3)),
        ("tables", |s| s.tables.swap(0, 1)),
        ("class diameters", |s| s.tables[0].classes[1].diameter[0].0 = 0.9),
        ("fall speed", |s| s.tables[1].classes[0].fall_speed.0 = f64::INFINITY),
        ("lattice edge", |s| s.tables[1].classes[0].edge_log2 = 40),
        ("lattice edge", |s| s.tables[1].classes[0].edge_log2 = 4),
        ("moments", |s| s.tables[2].log_moments[7] = f64::NAN),
    ];
    for (name, spoil) in damage {
        let mut section = sample();
        spoil(&mut section);
        match read(&section.write()) {
            Err(ReadError::Invalid { field, .. }) => assert_eq!(field, name),
            other => panic!("{name}: {other:?}"),
        }
    }
}

#[test]
fn an_axis_of_fewer_nodes_than_a_cubic_takes_has_no_places() {
    let mut section = sample();
    section.rates.truncate(3);
    assert!(section.place(MillimetresPerHour(5.0)).is_none());
}

proptest! {
    /// Whatever reads must also answer: no byte may lead to a panic, then or later.
    #[test]
    fn bytes_with_any_change_never_panic(
        at in 0usize..4000, value in any::<u64>(), width in 1usize..9, rate in 1e-3f64..300.0,
    ) {
        let mut bytes = sample().write();
        let at = at % bytes.len();
        let stop = (at + width).min(bytes.len());
        bytes[at..stop].copy_from_slice(&value.to_le_bytes()[..stop - at]);
        if let Ok(section) = read(&bytes)
            && let Some(place) = section.place(MillimetresPerHour(rate))
        {
            for mode in Mode::ALL {
                let table = section.table(mode);
                for class in 0..table.classes.len() {
                    let _ = table.moments(&place, class).representative_length(Seconds(0.01));
                }
            }
        }
    }

    #[test]
    fn noise_is_refused(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
        prop_assert!(read(&bytes).is_err());
    }
}
