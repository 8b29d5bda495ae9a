//! The tables of a thin pattern: a few products, their means over a pixel for every width, slant and length.

use super::{
    Across, BLOCK, LENGTHS, LIGHTS, LOW_RANK, Nodes, PHASES, Packet, RADIUS_ALONG, RANK, SHIFTS, WIDTHS,
    blocks_of, class_length, class_width,
};
use crate::shade::streak::profile::Profile;
use squall_formats::section::streak::Pattern;
use std::f64::consts::TAU;

/// Samples of the pattern, across and along.
const SAMPLES: [usize; 2] = [48, 192];
/// What of the light's square a narrow width may leave out: all that is in the products but where light is along.
const UNSEEN: f64 = 3e-5;

/// Makes the first product hold the light of every cross section, and the others none, without changing their sum: across it then
/// adds up to 1.
pub(super) fn gather_light(across: &mut [Profile], along: &mut [Profile]) {
    let integrals: Vec<f64> = across.iter().map(Profile::integral).collect();
    let Some(most) = (0..across.len()).max_by(|a, b| integrals[*a].abs().total_cmp(&integrals[*b].abs()))
    else {
        return;
    };
    if integrals[most].abs() < 1e-9 {
        return;
    }
    let (first, mut all) =
        (across[most].plus(1.0 / integrals[most], 0.0, &across[most]), along[most].clone());
    all = all.plus(integrals[most], 0.0, &along[most]);
    for k in (0..across.len()).filter(|k| *k != most) {
        all = all.plus(1.0, integrals[k], &along[k]);
        across[k] = across[k].plus(1.0, -integrals[k], &first);
    }
    (across[most], along[most]) = (first, all);
    across.swap(0, most);
    along.swap(0, most);
}

/// Profiles across and along of a pattern: the first holds the light of every cross section, the others what pixels `pixel` of the
/// picture's width wide show beside that, as closely as so few products can.
pub(super) fn products(pattern: &Pattern, pixel: f64) -> (Vec<Profile>, Vec<Profile>) {
    let [columns, rows] = SAMPLES;
    let mut rest = sample(pattern);
    let [du, dv] = SAMPLES.map(|count| 1.0 / count as f64);
    // Where light is across on the whole, and how much of it there is along.
    let mut mean: Vec<f64> =
        (0..columns).map(|i| (0..rows).map(|j| rest[j * columns + i].abs()).sum::<f64>() * dv).collect();
    if mean.iter().all(|&value| value <= 0.0) {
        mean.fill(1.0);
    }
    let total = mean.iter().sum::<f64>() * du;
    mean.iter_mut().for_each(|value| *value /= total);
    let light: Vec<f64> = rest.chunks(columns).map(|section| section.iter().sum::<f64>() * du).collect();
    for (section, light) in rest.chunks_mut(columns).zip(&light) {
        section.iter_mut().zip(&mean).for_each(|(value, mean)| *value -= light * mean);
    }
    let seen = blurred(&rest, pixel * columns as f64);
    let directions = strongest(&seen);
    let (mut across, mut along) = (vec![mean], vec![light]);
    for direction in directions {
        let shown: Vec<f64> = seen
            .chunks(columns)
            .map(|section| section.iter().zip(&direction).map(|(a, b)| a * b).sum::<f64>())
            .collect();
        let square: f64 = shown.iter().map(|value| value * value).sum();
        let factor = if square > 1e-18 { 1.0 / square } else { 0.0 };
        let mut own = vec![0.0; columns];
        for (section, shown) in rest.chunks(columns).zip(&shown) {
            own.iter_mut().zip(section).for_each(|(sum, value)| *sum += value * shown * factor);
        }
        across.push(own);
        along.push(shown);
    }
    let profiles =
        |all: Vec<Vec<f64>>| all.iter().map(|nodes| Profile::new(|x| between(nodes, x))).collect::<Vec<_>>();
    (profiles(across), profiles(along))
}

/// Means of each section over `width` cells around each.
fn blurred(light: &[f64], width: f64) -> Vec<f64> {
    let columns = SAMPLES[0];
    let reach = (0.5 * width).ceil() as usize;
    // How much of a cell so many cells aside lies in the box.
    let share: Vec<f64> =
        (0..=reach).map(|off| (0.5 * width + 0.5 - off as f64).clamp(0.0, 1.0).min(width)).collect();
    let total = share[0] + 2.0 * share[1..].iter().sum::<f64>();
    let mut out = vec![0.0; light.len()];
    for (section, out) in light.chunks(columns).zip(out.chunks_mut(columns)) {
        for (i, sum) in out.iter_mut().enumerate() {
            for (at, value) in section.iter().enumerate().skip(i.saturating_sub(reach)).take(2 * reach + 1) {
                *sum += share.get(at.abs_diff(i)).copied().unwrap_or(0.0) / total * value;
            }
        }
    }
    out
}

/// Unit vectors across on which sections have most of their square: all but one of [`LIGHTS`].
fn strongest(sections: &[f64]) -> Vec<Vec<f64>> {
    /// Turns of the power iteration: what is left of a weaker direction falls with the ratio of squares each time.
    const TURNS: usize = 60;
    let columns = SAMPLES[0];
    let mut gram = vec![0.0; columns * columns];
    for section in sections.chunks(columns) {
        for (row, a) in gram.chunks_mut(columns).zip(section) {
            row.iter_mut().zip(section).for_each(|(sum, b)| *sum += a * b);
        }
    }
    // Light beside the middle, and light away from it, to begin with.
    let place = move |i: usize| (i as f64 + 0.5) / columns as f64 - 0.5;
    let start =
        |degree: usize| (0..columns).map(move |i| (0..=degree).fold(1.0, |power, _| power * place(i)));
    let mut basis: Vec<Vec<f64>> = (0..LIGHTS - 1).map(|degree| start(degree).collect()).collect();
    for _ in 0..TURNS {
        for at in 0..basis.len() {
            let (before, vector) = basis.split_at_mut(at);
            let vector = &mut vector[0];
            let mut next: Vec<f64> = gram
                .chunks(columns)
                .map(|row| row.iter().zip(&*vector).map(|(a, b)| a * b).sum::<f64>())
                .collect();
            // Twice, because once leaves round-off behind.
            for other in before.iter().chain(&*before) {
                let share: f64 = next.iter().zip(other).map(|(a, b)| a * b).sum();
                next.iter_mut().zip(other).for_each(|(value, other)| *value -= share * other);
            }
            let norm = next.iter().map(|value| value * value).sum::<f64>().sqrt();
            // Sections that are all alike leave nothing to say.
            let factor = if norm > 1e-12 { 1.0 / norm } else { 0.0 };
            *vector = next.into_iter().map(|value| value * factor).collect();
        }
    }
    basis
}

/// The pattern at the middles of a grid of cells, u fastest.
fn sample(pattern: &Pattern) -> Vec<f64> {
    let [columns, rows] = SAMPLES;
    let place = |index: usize, count: usize| (index as f64 + 0.5) / count as f64;
    let cells = (0..columns * rows).map(|i| (i % columns, i / columns));
    let Pattern::Cosines(cosines) = pattern else {
        return cells.map(|(i, j)| pattern.value(place(i, columns), place(j, rows))).collect();
    };
    // A term is a factor per column times a factor per row: no cosine per cell.
    let unit = |turns: f64| {
        let (sin, cos) = libm::sincos(TAU * (turns - turns.floor()));
        [cos, sin]
    };
    let mut sums = vec![cosines.constant; columns * rows];
    for term in &cosines.terms {
        let across: Vec<[f64; 2]> =
            (0..columns).map(|i| unit(term.across * place(i, columns) + term.phase / TAU)).collect();
        for j in 0..rows {
            let [cos, sin] = unit(term.along * place(j, rows)).map(|part| part * term.amplitude);
            for (sum, [a, b]) in sums[j * columns..][..columns].iter_mut().zip(&across) {
                *sum += a * cos - b * sin;
            }
        }
    }
    cells
        .zip(sums)
        .map(|((i, j), sum)| sum * cosines.window.value(place(i, columns), place(j, rows)))
        .collect()
}

/// Linear between the middles of cells, constant in the outer half cells.
fn between(nodes: &[f64], x: f64) -> f64 {
    let place = (x * nodes.len() as f64 - 0.5).clamp(0.0, (nodes.len() - 1) as f64);
    let index = (place as usize).min(nodes.len() - 2);
    nodes[index] + (nodes[index + 1] - nodes[index]) * (place - index as f64)
}

/// Tables across of every width and shift, `halves` pixels to each side. `energies` are the squares that the products hold along.
pub(super) fn tabulate_across(
    profiles: &[Profile],
    energies: &[f64],
    halves: &[usize; WIDTHS],
) -> Vec<Across> {
    let rank = |class: usize| rank_of(profiles, energies, (class, halves[class]));
    let ranks: Vec<usize> = (0..WIDTHS).map(rank).collect();
    let mut tables = Vec::with_capacity(WIDTHS * SHIFTS.len());
    for class in 0..WIDTHS {
        let next = (class + 1).min(WIDTHS - 1);
        let [own, wider] = [class, next].map(|class| (halves[class], ranks[class]));
        for shift in SHIFTS {
            let table = |(half, rank)| tabulate(profiles, (class_width(class), shift), half, rank);
            let wider = (wider != own).then(|| table(wider));
            let values = table(own);
            tables.push(Across { rank: own.1, blocks: blocks_of(own.0), values, wider });
        }
    }
    tables
}

/// Products of a width that show.
fn rank_of(profiles: &[Profile], energies: &[f64], (class, half): (usize, usize)) -> usize {
    let values = tabulate(profiles, (class_width(class), SHIFTS[0]), half, RANK);
    let (mut whole, mut unseen) = (0.0, 0.0);
    let (packets, _) = values.as_chunks::<RANK>();
    for packet in packets {
        let square = |value: f32| f64::from(value) * f64::from(value);
        let [first, .., disc] = *packet;
        whole += square(first) * energies[0];
        unseen += square(first - disc) * energies[0];
        unseen += (1..LIGHTS).map(|k| square(packet[k]) * energies[k]).sum::<f64>();
    }
    if unseen <= UNSEEN * whole { LOW_RANK } else { RANK }
}

/// Pixels of a line at every node, of the first products: means over the shadow of a pixel on the line, a box of its own side and one
/// of what the next lines shift the streak by.
fn tabulate(profiles: &[Profile], (width, shift): (f64, f64), half: usize, rank: usize) -> Vec<f32> {
    let pixels = blocks_of(half) * BLOCK;
    let mut values = vec![0.0; (PHASES + 1) * pixels * rank];
    for node in 0..=PHASES {
        for (k, profile) in profiles.iter().enumerate().take(rank) {
            for pixel in 0..2 * half {
                let place = node as f64 / PHASES as f64 + pixel as f64 - half as f64 + 0.5 * width;
                let value = profile.mean_over_pixel(place, width, [1.0, shift]) as f32;
                values[(node * pixels + pixel) * rank + k] = value;
            }
        }
    }
    values
}

/// The first and the last place along, in nodes, that any product shows something at: all that is left of a streak.
pub(super) fn lit(table: &[Nodes]) -> [f32; 2] {
    /// Share of a product's largest value that counts as none.
    const FAINT: f32 = 1e-3;
    let shows =
        |value: &Packet, most: &Packet| value.iter().zip(most).any(|(v, most)| v.abs() > FAINT * most);
    let mut most = [0.0f32; RANK];
    for [value, _] in table {
        most.iter_mut().zip(value).for_each(|(most, value)| *most = most.max(value.abs()));
    }
    let place = |at: Option<usize>, usual: usize| at.unwrap_or(usual) as f32;
    let first = table.iter().position(|[value, _]| shows(value, &most));
    let last = table.iter().rposition(|[value, _]| shows(value, &most));
    [place(first, 0) - 1.0, place(last, table.len()) + 1.0]
}

/// Packets along, and their gains, for every length.
pub(super) fn tabulate_along(profiles: &[Profile], light: f64) -> Vec<Vec<Nodes>> {
    let table = |class: usize| {
        let scale = class_length(class);
        let length = scale + 2.0 * RADIUS_ALONG;
        let intervals = ((3.0 * length) as usize).clamp(24, 512);
        let place = |i: usize| length * i as f64 / intervals as f64 - RADIUS_ALONG;
        let packet = |i: usize| -> Packet {
            let mut packet = [0.0; RANK];
            if i > 0 && i < intervals {
                for (value, profile) in packet.iter_mut().zip(profiles) {
                    *value = (light * profile.mean_over_pixel(place(i), scale, [1.0, 0.0])) as f32;
                }
            }
            packet
        };
        let packets: Vec<Packet> = (0..=intervals).map(packet).collect();
        let gain = |i: usize| -> Packet {
            let next = packets.get(i + 1).unwrap_or(&packets[i]);
            std::array::from_fn(|k| next[k] - packets[i][k])
        };
        (0..=intervals).map(|i| [packets[i], gain(i)]).collect()
    };
    (0..LENGTHS).map(table).collect()
}
