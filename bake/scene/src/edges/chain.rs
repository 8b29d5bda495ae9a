//! Pieces of one straight edge, put together again.

use super::welded;
use glam::Vec3;
use std::collections::BTreeMap;

/// A straight piece with what has to be alike in pieces that are put together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Piece {
    pub ends: [Vec3; 2],
    pub normals: [Vec3; 2],
    /// A quantity that adds up.
    pub amount: f64,
}

/// Cosine of the angle up to which pieces are straight: 2°.
const STRAIGHT: f32 = 0.9994;
/// Cosine of the angle up to which normals are alike: 4°.
const ALIKE: f32 = 0.9976;

/// Pieces that meet in a corner of a line at most; every one of more would have to be compared with all others.
const MOST_AT_A_CORNER: usize = 64;

/// Puts pieces together that follow one another in a straight line with like normals; the order is that of the first pieces.
pub(super) fn joined(pieces: Vec<Piece>) -> Vec<Piece> {
    let mut at: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    for (index, piece) in pieces.iter().enumerate() {
        for end in piece.ends {
            at.entry(welded(end)).or_default().push(index);
        }
    }
    let mut taken = vec![false; pieces.len()];
    let mut out = Vec::new();
    for start in 0..pieces.len() {
        if std::mem::replace(&mut taken[start], true) {
            continue;
        }
        let mut whole = pieces[start];
        for end in [1, 0] {
            while let Some((next, far)) = follower(&pieces, &taken, &at, &whole, end) {
                taken[next] = true;
                whole.ends[end] = far;
                whole.amount += pieces[next].amount;
            }
        }
        out.push(whole);
    }
    out
}

/// The one piece that goes on from an end, and its far end.
fn follower(
    pieces: &[Piece],
    taken: &[bool],
    at: &BTreeMap<[i64; 3], Vec<usize>>,
    whole: &Piece,
    end: usize,
) -> Option<(usize, Vec3)> {
    let here = whole.ends[end];
    let along = (here - whole.ends[1 - end]).normalize_or_zero();
    let beside = at.get(&welded(here)).filter(|beside| beside.len() <= MOST_AT_A_CORNER)?;
    beside.iter().filter(|next| !taken[**next]).find_map(|&next| {
        let piece = &pieces[next];
        let far = if welded(piece.ends[0]) == welded(here) { piece.ends[1] } else { piece.ends[0] };
        let straight = (far - here).normalize_or_zero().dot(along) > STRAIGHT;
        let alike = |a: usize, b: usize| {
            piece.normals[0].dot(whole.normals[a]) > ALIKE && piece.normals[1].dot(whole.normals[b]) > ALIKE
        };
        (straight && (alike(0, 1) || alike(1, 0))).then_some((next, far))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_through_a_hub_of_many_edges_ends_there() {
        let piece = |x: f32| Piece {
            ends: [Vec3::new(x, 0.0, 0.0), Vec3::new(x + 1.0, 0.0, 0.0)],
            normals: [Vec3::Z; 2],
            amount: 1.0,
        };
        let spoke = |at: usize| Piece {
            ends: [Vec3::X, Vec3::new(1.0, 1.0 + at as f32, 1.0)],
            normals: [Vec3::Z; 2],
            amount: 0.0,
        };
        for (spokes, wanted) in [(MOST_AT_A_CORNER - 2, 1), (MOST_AT_A_CORNER - 1, 2)] {
            let mut pieces = vec![piece(0.0), piece(1.0)];
            pieces.extend((0..spokes).map(spoke));
            let lines = joined(pieces);
            assert_eq!(lines.iter().filter(|line| line.amount > 0.0).count(), wanted, "{spokes}");
        }
    }
}
