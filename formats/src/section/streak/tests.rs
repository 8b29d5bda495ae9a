use super::*;
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

fn read(bytes: &[u8]) -> Result<StreakSection, ReadError> {
    StreakSection::read(bytes, 1, &Limits::default())
}

fn streak(pattern: Pattern) -> StreakPattern {
    StreakPattern {
        name: "drop".into(),
        method: Method::Edges,
        size_px: [32, 300],
        body: Body { u: [0.25, 0.75], v: [0.05, 0.97] },
        mean: 0.6,
        psnr_db: 31.25,
        ssim: 0.9,
        notes: Some(DropNotes { diameter_mm: 1.5, exposure_ms: 8.0 }),
        scene: None,
        pattern,
    }
}

fn cosines(window: Window, terms: Vec<Cosine>) -> Pattern {
    Pattern::Cosines(CosinePattern { window, constant: 0.5, terms })
}

fn edge_window() -> Window {
    Window::Edges(EdgeWindow {
        sides: [[0.3, 0.02, -0.01, 0.015], [0.7, -0.02, 0.01, 0.0]],
        ends: [[0.08, 0.01, 0.02], [0.94, 0.0, -0.03]],
        softness: [0.04, 0.06, 0.03, 0.02],
    })
}

fn power_window(exponent: [f64; 2]) -> Window {
    Window::Power(PowerWindow { centre: [0.5, 0.52], radius: [0.2, 0.4], exponent })
}

/// One pattern of every kind, with terms and without.
fn every_kind() -> StreakSection {
    let term = |across, along, amplitude, phase| Cosine { across, along, amplitude, phase };
    let terms = vec![term(2.1, -1.5, 0.13, 1.2), term(0.4, 2.9, 0.2, 4.0)];
    let tables = |count: usize| vec![(0..count).map(|i| 0.1 * i as f64 - 0.2).collect(), vec![1.0; count]];
    StreakSection {
        patterns: vec![
            streak(cosines(Window::Flat, terms.clone())),
            streak(cosines(power_window([2.0; 2]), terms.clone())),
            streak(cosines(power_window([6.0, 14.0]), vec![])),
            StreakPattern { notes: None, ..streak(cosines(edge_window(), terms)) },
            streak(Pattern::Separable(SeparablePattern { across: tables(5), along: tables(9) })),
        ],
    }
}

#[test]
fn what_was_read_writes_the_same_bytes_and_reads_the_same() {
    let bytes = every_kind().write();
    let once = read(&bytes).unwrap();
    assert_eq!(once.write(), bytes);
    assert_eq!(read(&once.write()).unwrap(), once);
    let names = |section: &StreakSection| {
        section.patterns.iter().map(|streak| streak.pattern.kind()).collect::<Vec<_>>()
    };
    assert_eq!(names(&once), names(&every_kind()));
    assert!(StreakSection::read(&bytes, 3, &Limits::default()).is_err(), "a newer version");
    for pattern in &every_kind().patterns {
        assert_eq!(pattern.quantised(), pattern.quantised().quantised());
    }
}

#[test]
fn the_ends_of_every_stored_range_come_back_as_they_were() {
    // −128 of an i8, −32768 of an i16 and −2048 of twelve bits: one beyond what plus reaches.
    let window = Window::Edges(EdgeWindow {
        sides: [[0.2, -0.125, 0.125 - 1.0 / 1024.0, 0.0], [0.8, 0.0, 0.0, -0.125]],
        ends: [[0.1, -0.25, 0.25 - 1.0 / 512.0], [0.9, 0.0, -0.25]],
        softness: [0.0625; 4],
    });
    let term = |along| Cosine { across: 4095.0, along, amplitude: 4095.0, phase: 0.0 };
    let pattern = CosinePattern { window, constant: -8.0, terms: vec![term(-2048.0), term(2047.0)] };
    let read = streak(Pattern::Cosines(pattern.clone())).quantised();
    let Pattern::Cosines(mut found) = read.pattern else { panic!("cosines") };
    if let (Window::Edges(found), Window::Edges(wanted)) = (&mut found.window, &pattern.window) {
        for (found, wanted) in found.sides.iter_mut().zip(&wanted.sides) {
            assert!((found[0] - wanted[0]).abs() < 1e-5, "a place, in steps of 1/65535");
            found[0] = wanted[0];
        }
        for (found, wanted) in found.ends.iter_mut().zip(&wanted.ends) {
            assert!((found[0] - wanted[0]).abs() < 1e-5, "a place, in steps of 1/65535");
            found[0] = wanted[0];
        }
    }
    assert_eq!(found, pattern);
}

/// The bytes of SPEC.md, "STRK", put together by hand.
#[test]
fn a_pattern_written_by_hand_reads_as_the_specification_says() {
    let mut pool = b"ab".to_vec();
    // Left 13107/65535 = 0.2, right 0.8, top 0.1, bottom 0.9.
    for position in [13_107u16, 52_428, 6554, 58_982] {
        pool.extend(position.to_le_bytes());
    }
    pool.extend([16u8, 0xF0, 0, 0, 8, 0]); // bends of 1/64, −1/64, 0; 0, 1/128, 0
    pool.extend([32u8, 0, 0, 0xE0]); // tilt 1/16, curve 0; 0, −1/16
    pool.extend([112u8, 128, 96, 96]); // softness 2^−5, 2^−4, 2^−6, 2^−6
    pool.extend(2048i16.to_le_bytes()); // constant 0.5
    pool.extend([10u8, 10, 13]); // steps 2^−10, 2^−10, 2^−13
    // across 0x800, along −0x400, amplitude 0x800, phase 0x400: low nibbles first.
    pool.extend([0x00, 0x08, 0xC0, 0x00, 0x08, 0x40]);
    let mut bytes = 1u64.to_le_bytes().to_vec();
    bytes.push(0x36); // edges between cosines, found by "edges"
    bytes.extend(1u16.to_le_bytes());
    bytes.extend([32u16, 172].iter().flat_map(|side| side.to_le_bytes()));
    bytes.extend([51, 0, 204, 255]);
    bytes.extend(8192u16.to_le_bytes());
    bytes.extend(3125u16.to_le_bytes());
    bytes.extend(16_384i16.to_le_bytes());
    bytes.push(2);
    bytes.push(1);
    bytes.extend([1500u16, 8000].iter().flat_map(|note| note.to_le_bytes()));
    bytes.extend((pool.len() as u64).to_le_bytes());
    bytes.extend(&pool);

    let section = read(&bytes).unwrap();
    assert_eq!(section.write(), bytes);
    let [streak] = &section.patterns[..] else { panic!("one pattern") };
    assert_eq!((streak.name.as_str(), streak.method, streak.size_px), ("ab", Method::Edges, [32, 172]));
    assert_eq!(streak.body, Body { u: [0.2, 0.8], v: [0.0, 1.0] });
    assert_eq!((streak.mean, streak.psnr_db), (0.5, 31.25));
    assert_eq!(streak.ssim, 16_384.0 / 32_767.0);
    assert_eq!(streak.notes, Some(DropNotes { diameter_mm: 1.5, exposure_ms: 8.0 }));
    let Pattern::Cosines(pattern) = &streak.pattern else { panic!("cosines") };
    assert_eq!(pattern.constant, 0.5);
    let wanted = Cosine { across: 2.0, along: -1.0, amplitude: 0.25, phase: TAU / 4.0 };
    assert_eq!(pattern.terms, [wanted]);
    let Window::Edges(window) = pattern.window else { panic!("edges") };
    assert_eq!(window.sides[0], [0.2, 1.0 / 64.0, -1.0 / 64.0, 0.0]);
    assert_eq!(window.sides[1], [0.8, 0.0, 1.0 / 128.0, 0.0]);
    assert_eq!([window.ends[0][1], window.ends[0][2]], [1.0 / 16.0, 0.0]);
    assert_eq!([window.ends[1][1], window.ends[1][2]], [0.0, -1.0 / 16.0]);
    assert_eq!(window.softness, [-5.0, -4.0, -6.0, -6.0].map(libm::exp2));
}

#[test]
fn a_section_cut_or_lengthened_at_any_byte_is_refused() {
    let mut bytes = every_kind().write();
    for cut in 0..bytes.len() {
        assert!(read(&bytes[..cut]).is_err(), "cut at {cut}");
    }
    bytes.push(0);
    assert!(read(&bytes).is_err());
}

#[test]
fn flipped_bits_are_refused_or_read_as_finite_light() {
    let bytes = every_kind().write();
    for at in 0..8 * bytes.len() {
        let mut bad = bytes.clone();
        bad[at / 8] ^= 1 << (at % 8);
        let Ok(section) = read(&bad) else { continue };
        for streak in &section.patterns {
            for (u, v) in [(0.5, 0.5), (0.0, 0.0), (1.0, 1.0), (-0.3, 2.0), (0.31, 0.08)] {
                assert!(streak.pattern.value(u, v).is_finite(), "bit {at}");
            }
        }
    }
}

#[test]
fn counts_above_the_limits_are_refused() {
    let few = Limits { patterns: 4, ..Limits::default() };
    let error = StreakSection::read(&every_kind().write(), 1, &few).unwrap_err();
    assert!(matches!(error, ReadError::OverLimit { wanted: 5, allowed: 4, .. }), "{error}");
    let mut bytes = StreakSection { patterns: vec![streak(cosines(Window::Flat, vec![]))] }.write();
    // The term count stands after the number of patterns and the kind.
    bytes[9..11].copy_from_slice(&1025u16.to_le_bytes());
    let error = read(&bytes).unwrap_err();
    assert!(matches!(error, ReadError::OverLimit { wanted: 1025, .. }), "{error}");
}

#[test]
fn numbers_out_of_range_are_refused_by_name() {
    let bytes = StreakSection { patterns: vec![streak(cosines(power_window([2.0; 2]), vec![]))] }.write();
    let record = 8;
    let pool = bytes.len() - (4 + 8 + 5);
    for (at, value, field) in [
        (record, 0x51u8, "pattern kind"),
        (record, 0x18, "method"),
        (record + 7, 255, "body"),
        (record + 14, 0xFF, "PSNR"),
        (pool - 1, 1, "metadata"),
        (pool, 7, "name"),
        (bytes.len() - 1, 16, "term steps"),
    ] {
        let mut bad = bytes.clone();
        bad[at] = value;
        let error = read(&bad).unwrap_err().to_string();
        assert!(error.contains(field) && error.contains("STRK"), "{field}: {error}");
    }
    let mut zero = bytes.clone();
    zero[pool + 8..pool + 10].fill(0);
    assert!(read(&zero).unwrap_err().to_string().contains("window radius"));
}

#[test]
fn what_cannot_be_stored_is_brought_into_range() {
    let wild = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300];
    for value in wild {
        let term = Cosine { across: value, along: value, amplitude: value, phase: value };
        let window =
            Window::Edges(EdgeWindow { sides: [[value; 4]; 2], ends: [[value; 3]; 2], softness: [value; 4] });
        let pattern = StreakPattern {
            name: "a\u{7}b".repeat(200),
            body: Body { u: [value; 2], v: [value; 2] },
            mean: value,
            psnr_db: value,
            ssim: value,
            ..streak(cosines(window, vec![term]))
        };
        let section = read(&StreakSection { patterns: vec![pattern] }.write()).unwrap();
        assert!(section.patterns[0].pattern.value(0.4, 0.6).is_finite());
        assert!(section.patterns[0].name.len() <= MAX_NAME && !section.patterns[0].name.contains('\u{7}'));
    }
}

#[test]
fn windows_and_cosines_have_the_values_of_their_definitions() {
    /// Sums of a few products in double precision.
    const ROUND_OFF: f64 = 1e-12;
    let close = |a: f64, b: f64| assert!((a - b).abs() < ROUND_OFF, "{a} for {b}");
    let power = PowerWindow { centre: [0.5, 0.5], radius: [0.2, 0.4], exponent: [2.0, 6.0] };
    close(power.value(0.5, 0.5), 1.0);
    close(power.value(0.7, 0.5), libm::exp(-1.0));
    close(power.value(0.6, 0.9), libm::exp(-0.25) * libm::exp(-1.0));
    // Straight edges far from each other: ½ on one, ¼ on a corner, nothing outside.
    let straight = EdgeWindow {
        sides: [[0.2, 0.0, 0.0, 0.0], [0.8, 0.0, 0.0, 0.0]],
        ends: [[0.1, 0.0, 0.0], [0.9, 0.0, 0.0]],
        softness: [0.01; 4],
    };
    close(straight.value(0.5, 0.5), 1.0);
    close(straight.value(0.2, 0.5), 0.5);
    close(straight.value(0.8, 0.9), 0.25);
    close(straight.value(0.5, 0.0), 0.0);
    close(straight.value(0.21, 0.5), 0.5 * (1.0 + libm::erf(1.0)));
    let bent = EdgeWindow { sides: [[0.2, 0.02, 0.01, 0.005], [0.8, 0.0, 0.0, 0.0]], ..straight };
    // T₁ … T₃ at y = ½: ½, −½, −1.
    close(bent.sides_at(0.75)[0], 0.2 + 0.01 - 0.005 - 0.005);
    let tilted = EdgeWindow { ends: [[0.1, 0.05, 0.02], [0.9, 0.0, 0.0]], ..straight };
    close(tilted.ends_at(0.65)[0], 0.1 + 0.5 * 0.05 + 0.25 * 0.02);
    close(tilted.ends_at(2.0)[0], 0.17);

    let term = Cosine { across: 3.0, along: -2.0, amplitude: 0.5, phase: PI / 3.0 };
    close(term.value(0.0, 0.0), 0.25);
    close(term.value(0.25, 0.5), 0.5 * libm::cos(TAU * -0.25 + PI / 3.0));
    let turned = Cosine { across: -3.0, along: 2.0, amplitude: -0.5, phase: 9.0 };
    close(turned.value(0.3, 0.4), turned.normalised().value(0.3, 0.4));
    let Cosine { across, amplitude, phase, .. } = turned.normalised();
    assert!(across >= 0.0 && amplitude >= 0.0 && (0.0..TAU).contains(&phase));

    let tables = SeparablePattern { across: vec![vec![0.0, 1.0]], along: vec![vec![2.0, 4.0, 2.0]] };
    close(tables.value(0.5, 0.5), 2.0);
    close(tables.value(0.1, 0.5), 0.0);
    close(tables.value(0.5, 1.0 / 3.0), 1.5);
    close(tables.value(1.1, 0.5), 0.0);
}

prop_compose! {
    fn any_term()(
        across in 0.0..40.0f64,
        along in -40.0..40.0f64,
        amplitude in 0.0..2.0f64,
        phase in 0.0..TAU,
    ) -> Cosine {
        Cosine { across, along, amplitude, phase }
    }
}

fn any_window() -> impl Strategy<Value = Window> {
    let pair = |low: f64, high: f64| prop::array::uniform2(low..high);
    let power = (pair(0.0, 1.0), pair(0.01, 3.9), pair(0.6, 60.0))
        .prop_map(|(centre, radius, exponent)| Window::Power(PowerWindow { centre, radius, exponent }));
    let gaussian = (pair(0.0, 1.0), pair(0.01, 3.9))
        .prop_map(|(centre, radius)| Window::Power(PowerWindow { centre, radius, exponent: [2.0; 2] }));
    let bends = prop::array::uniform6(-0.12..0.12f64);
    let caps = prop::array::uniform4(-0.24..0.24f64);
    let softness = prop::array::uniform4(0.001..0.9f64);
    let edges =
        (prop::array::uniform4(0.0..0.49f64), bends, caps, softness).prop_map(|(p, b, c, softness)| {
            let sides = [[p[0], b[0], b[1], b[2]], [1.0 - p[1], b[3], b[4], b[5]]];
            let ends = [[p[2], c[0], c[1]], [1.0 - p[3], c[2], c[3]]];
            Window::Edges(EdgeWindow { sides, ends, softness })
        });
    prop_oneof![Just(Window::Flat), power, gaussian, edges]
}

#[test]
fn a_term_that_rounds_upright_is_stored_one_way() {
    let terms = [[0.0003970559686842012, -24.342778279902923], [25.534027531576335, 0.0]]
        .map(|[across, along]| Cosine { across, along, amplitude: 1.0, phase: 1.0 });
    let pattern = CosinePattern { window: Window::Flat, constant: 0.0, terms: terms.to_vec() };
    let stored = streak(Pattern::Cosines(pattern)).quantised();
    assert_eq!(stored.quantised(), stored);
    let Pattern::Cosines(after) = &stored.pattern else { panic!("still cosines") };
    assert!(after.terms[0].across == 0.0 && after.terms[0].along > 24.0);
}

proptest! {
    #[test]
    fn rounding_moves_no_number_by_more_than_its_step(
        window in any_window(),
        constant in -7.9..7.9f64,
        terms in prop::collection::vec(any_term(), 0..12),
    ) {
        let before = CosinePattern { window, constant, terms };
        let stored = streak(Pattern::Cosines(before.clone())).quantised();
        prop_assert_eq!(&stored.quantised(), &stored);
        let Pattern::Cosines(after) = &stored.pattern else { panic!("still cosines") };
        prop_assert!((after.constant - constant).abs() <= 0.5 / 4096.0 + 1e-12);
        prop_assert_eq!(after.terms.len(), before.terms.len());
        // Twelve bits span the largest of each, so a step is at most a 2047th of it.
        let largest = |value: fn(&Cosine) -> f64| before.terms.iter().map(value).fold(0.0, f64::max);
        let step = |largest: f64| (largest / 2047.0).max(1.0 / 32_768.0);
        let steps = [largest(|t| t.across), largest(|t| t.along.abs()), largest(|t| t.amplitude)].map(step);
        for (a, b) in after.terms.iter().zip(&before.terms) {
            let b = b.normalised();
            prop_assert!((a.across - b.across).abs() <= steps[0]);
            let b = if a.across == 0.0 { Cosine { across: 0.0, ..b }.normalised() } else { b };
            prop_assert!((a.along - b.along).abs() <= steps[1]);
            prop_assert!((a.amplitude - b.amplitude).abs() <= steps[2]);
            let turn = (a.phase - b.phase).abs();
            prop_assert!(turn.min(TAU - turn) <= TAU / 4096.0);
        }
        if let (Window::Edges(a), Window::Edges(b)) = (&after.window, &before.window) {
            for edge in 0..4 {
                // Sixteen codes an octave: half a step is 2.2 %.
                prop_assert!((a.softness[edge] / b.softness[edge] - 1.0).abs() < 0.023);
            }
            prop_assert!((a.sides[0][1] - b.sides[0][1]).abs() <= 0.5 / 1024.0 + 1e-12);
            prop_assert!((a.ends[1][2] - b.ends[1][2]).abs() <= 0.5 / 512.0 + 1e-12);
        }
    }

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = read(&bytes);
    }
}

#[test]
fn what_a_picture_shows_is_kept_in_a_second_version_and_silence_in_the_first() {
    let silent = every_kind();
    assert_eq!(silent.version(), 1);
    let mut telling = silent.clone();
    telling.patterns[1].scene = Some(SceneNotes {
        view_elevation_deg: 62.0,
        light_share: 0.4,
        light_azimuth_deg: -175.0,
        light_elevation_deg: 12.0,
    });
    assert_eq!(telling.version(), 2);
    let bytes = telling.write();
    let limits = Limits::default();
    let read = StreakSection::read(&bytes, 2, &limits).unwrap();
    assert_eq!((read.patterns[1].scene, read.write()), (telling.patterns[1].scene, bytes.clone()));
    assert!((read.patterns[0].scene, read.patterns[1].quantised()) == (None, read.patterns[1].clone()));
    // Neither is read as the other.
    assert!(StreakSection::read(&bytes, 1, &limits).is_err());
    assert!(StreakSection::read(&silent.write(), 2, &limits).is_err());
    for cut in 0..bytes.len() {
        assert!(StreakSection::read(&bytes[..cut], 2, &limits).is_err());
    }
    // An azimuth beyond half a turn: its two bytes stand before the elevation's one, at the end of the second record.
    let at = bytes.windows(4).position(|window| window == [102, 81, 255, 12]).unwrap() + 1;
    let mut damaged = bytes;
    damaged[at..at + 2].copy_from_slice(&200i16.to_le_bytes());
    let error = StreakSection::read(&damaged, 2, &limits).unwrap_err().to_string();
    assert!(error.contains("azimuth of the light"), "{error}");
}
