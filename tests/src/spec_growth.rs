//! Strokes grown from SPEC.md's words alone ("Growth of a stroke"), beside those of the runtime: the same to the bit.

use squall_formats::section::bolt::StrokeRecord;
use squall_runtime::stroke::Stroke;
use std::f64::consts::TAU;

type V = [f64; 3];

fn add(a: V, b: V) -> V {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn sub(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn times(a: V, k: f64) -> V {
    [a[0] * k, a[1] * k, a[2] * k]
}

fn norm(a: V) -> f64 {
    (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt()
}

fn unit(a: V) -> V {
    times(a, 1.0 / norm(a))
}

fn mix(v: u64) -> u64 {
    let z = v.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ z >> 31
}

/// The state of the random numbers.
struct Draws(u64);

impl Draws {
    fn new(seed: u64) -> Self {
        let h = mix(0x5155_414C_4C00_0001 ^ mix(seed));
        Self(mix(h ^ mix(0x424F_4C54)))
    }

    fn u(&mut self) -> f64 {
        let bits = mix(self.0) >> 11;
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        bits as f64 * (0.5f64).powi_exact(53)
    }

    fn n(&mut self) -> f64 {
        let first = (-2.0 * libm::log(1.0 - self.u())).sqrt();
        first * libm::cos(TAU * self.u())
    }

    fn quarter_to_one(&mut self) -> f64 {
        0.25 + 0.75 * self.u()
    }

    fn across(&mut self, v: V) -> V {
        let n = if (1.0 / norm(v)).is_finite() { unit(v) } else { [0.0, 0.0, 1.0] };
        let sign = if n[2].is_sign_negative() { -1.0 } else { 1.0 };
        let a = -1.0 / (sign + n[2]);
        let e = [n[0] * n[1] * a, sign + n[1] * n[1] * a, -n[1]];
        let f = [n[1] * e[2] - e[1] * n[2], n[2] * e[0] - e[2] * n[0], n[0] * e[1] - e[0] * n[1]];
        let turn = TAU * self.u();
        add(times(e, libm::cos(turn)), times(f, libm::sin(turn)))
    }

    fn turned(&mut self, h: V, mean: f64) -> V {
        let angle = mean * (1.0 + self.n() / 3.0);
        let side = self.across(h);
        unit(add(times(h, libm::cos(angle)), times(side, libm::sin(angle))))
    }
}

/// Powers of a half without a library function.
trait Exact {
    fn powi_exact(self, n: u32) -> f64;
}

impl Exact for f64 {
    fn powi_exact(self, n: u32) -> f64 {
        (0..n).fold(1.0, |product, _| product * self)
    }
}

/// From, to, order, brightness.
type Piece = (V, V, u8, f64);

struct Branch {
    at: V,
    heading: V,
    length: f64,
    order: u8,
    brightness: f64,
}

const MOST: usize = 1 << 16;

fn main_channel(r: &StrokeRecord, draws: &mut Draws, pieces: &mut Vec<Piece>, left: &mut Vec<Branch>) {
    let mut line = vec![r.from_m, r.to_m];
    for time in 0..5 {
        let k = if time == 0 { 1.0 } else { 0.8 };
        let mut finer = vec![line[0]];
        for i in 1..line.len() {
            let (p, q) = (line[i - 1], line[i]);
            let side = draws.across(sub(q, p));
            let far = r.wander * norm(sub(q, p)) * k * draws.n() * 0.5;
            finer.push(add(times(add(p, q), 0.5), times(side, far)));
            finer.push(q);
        }
        line = finer;
    }
    let mut whole = 0.0;
    for i in 1..line.len() {
        whole += norm(sub(line[i - 1], line[i]));
    }
    let (mut a, mut goal, mut gone) = (line[0], 1, 0.0);
    while pieces.len() < MOST {
        let v = sub(line[goal], a);
        if norm(v) < 1.5 * r.segment_m {
            if goal + 1 < line.len() {
                goal += 1;
                continue;
            }
            pieces.push((a, line[goal], 0, 1.0));
            return;
        }
        let b = add(a, times(draws.turned(unit(v), r.turn_rad), r.segment_m));
        pieces.push((a, b, 0, 1.0));
        gone += r.segment_m;
        if draws.u() < r.branching && r.max_order > 0 {
            let length = f64::max(whole - gone, 0.0) * r.branch_length * draws.quarter_to_one();
            let heading = draws.turned(unit(v), r.branch_rad);
            left.push(Branch { at: b, heading, length, order: 1, brightness: r.branch_intensity });
        }
        a = b;
    }
}

fn branch(r: &StrokeRecord, own: usize, draws: &mut Draws, pieces: &mut Vec<Piece>, left: &mut Vec<Branch>) {
    let Branch { at, heading, length, order, brightness } = left[own];
    let (mut a, mut h, mut gone) = (at, heading, 0.0);
    while gone < length && pieces.len() < MOST {
        h = draws.turned(h, 0.25 * r.turn_rad);
        let b = add(a, times(draws.turned(h, r.turn_rad), r.segment_m));
        let here = brightness * libm::pow(f64::max(1.0 - gone / length, 0.0), 0.5);
        pieces.push((a, b, order, here));
        gone += r.segment_m;
        if order < r.max_order && draws.u() < r.branching {
            let next = f64::max(length - gone, 0.0) * r.branch_length * draws.quarter_to_one();
            let heading = draws.turned(h, r.branch_rad);
            let brightness = here * r.branch_intensity;
            left.push(Branch { at: b, heading, length: next, order: order + 1, brightness });
        }
        a = b;
    }
}

fn grown(r: &StrokeRecord) -> Vec<Piece> {
    let (mut draws, mut pieces, mut left) = (Draws::new(r.seed), Vec::new(), Vec::new());
    main_channel(r, &mut draws, &mut pieces, &mut left);
    let mut next = 0;
    while next < left.len() && pieces.len() < MOST {
        branch(r, next, &mut draws, &mut pieces, &mut left);
        next += 1;
    }
    for piece in &mut pieces {
        piece.3 *= norm(sub(piece.0, piece.1));
    }
    let sum: f64 = pieces.iter().map(|piece| piece.3).sum();
    let scale = if sum > 0.0 { r.intensity_w_per_sr / sum } else { 0.0 };
    pieces.iter_mut().for_each(|piece| piece.3 *= scale);
    pieces
}

#[test]
fn a_stroke_grown_from_the_specifications_words_is_the_runtimes_to_the_bit() {
    let usual = StrokeRecord {
        from_m: [30.0, -2000.0, 7000.5],
        to_m: [-400.0, -1200.0, 0.0],
        intensity_w_per_sr: 1e9,
        ..StrokeRecord::usual()
    };
    let length = usual.length();
    let mut records: Vec<StrokeRecord> =
        (0..24).map(|seed| StrokeRecord { seed, segment_m: 40.0, ..usual.clone() }).collect();
    let with = |change: fn(&mut StrokeRecord)| {
        let mut record = StrokeRecord { seed: u64::MAX - 5, segment_m: 60.0, ..usual.clone() };
        change(&mut record);
        record
    };
    records.extend([
        with(|r| r.wander = 0.0),
        with(|r| r.wander = 1.0),
        with(|r| r.max_order = 0),
        with(|r| r.branch_intensity = 0.0),
        with(|r| r.branching = 0.0),
        with(|r| r.intensity_w_per_sr = 0.0),
        // Upright, either way, where across has a corner.
        with(|r| (r.from_m, r.to_m) = ([0.0, 0.0, 900.0], [0.0; 3])),
        with(|r| (r.from_m, r.to_m) = ([0.0; 3], [0.0, 0.0, 900.0])),
        StrokeRecord { segment_m: length, ..usual.clone() },
        // One that stops at the most segments that are grown.
        StrokeRecord {
            segment_m: length / 4000.0,
            branching: 0.5,
            branch_length: 1.0,
            max_order: 8,
            ..usual.clone()
        },
    ]);
    for record in &records {
        record.check().unwrap();
        let (wanted, found) = (grown(record), Stroke::grow(record).segments);
        assert_eq!(wanted.len(), found.len(), "{record:?}");
        for ((from, to, order, intensity), segment) in wanted.into_iter().zip(found) {
            let bits = |v: V| v.map(f64::to_bits);
            assert_eq!(bits(from), bits(segment.from.to_array()), "{record:?}");
            assert_eq!(bits(to), bits(segment.to.to_array()), "{record:?}");
            assert_eq!(
                (order, intensity.to_bits()),
                (segment.order, segment.intensity.to_bits()),
                "{record:?}"
            );
        }
    }
    assert_eq!(Stroke::grow(&records[records.len() - 1]).segments.len(), MOST);
}
