//! Patterns as a graphics card draws them: everything that [`super::Prepared`] holds, in flat lists.

use super::choice::Choice;
use super::prepare::{PatternFrame, PatternLight, Prepared};
use super::profile::Profile;
use super::thin::flat::TableSizes;
use super::{StreakSet, prepare::Cosines};
use crate::gpu::rain::PatternHead;
use crate::parallel::prelude::*;

/// A set of patterns in flat lists.
pub struct StreakTables {
    pub heads: Vec<PatternHead>,
    /// Packets across and along, pattern after pattern.
    pub tables: Vec<[f32; 4]>,
    /// Periods across and along, amplitude, phase in turns.
    pub terms: Vec<[f32; 4]>,
    /// Half the length of every soft edge, then its values.
    pub edges: Vec<f32>,
    /// Values and first integrals.
    pub profiles: Vec<[f32; 2]>,
    /// Starts of the bins, then their patterns; empty where patterns don't say what they show.
    pub choice: Vec<u32>,
    pub sizes: Option<TableSizes>,
    /// Length over width of the shortest pattern.
    pub shortest_aspect: f32,
}

/// How a pattern is drawn where its width is resolved.
const EDGES: u32 = 0;
const PROFILE_WINDOW: u32 = 1;
const PROFILES: u32 = 2;

impl StreakSet {
    /// All patterns, prepared.
    pub(crate) fn tables(&self) -> StreakTables {
        let numbers: Vec<u32> = (0..self.patterns.len() as u32).collect();
        // A pattern takes milliseconds to prepare.
        numbers.par_iter().for_each(|number| _ = self.prepared(*number));
        let mut out = StreakTables {
            heads: Vec::new(),
            tables: Vec::new(),
            terms: Vec::new(),
            edges: self.edges.nodes(),
            profiles: Vec::new(),
            choice: self.choice().map(Choice::flat).unwrap_or_default(),
            sizes: None,
            shortest_aspect: self.shortest_aspect as f32,
        };
        for number in numbers {
            if let Some(prepared) = self.prepared(number) {
                let head = out.add(prepared, self.mean(number));
                out.heads.push(head);
                out.sizes.get_or_insert_with(|| prepared.thin.sizes());
            }
        }
        out
    }
}

impl StreakTables {
    fn add(&mut self, prepared: &Prepared, mean: f32) -> PatternHead {
        let mut head = PatternHead::default();
        let ([u, v], body) = (prepared.range, &prepared.body);
        let four = |a: [f64; 2], b: [f64; 2]| [a[0], a[1], b[0], b[1]].map(|value| value as f32);
        (head.body, head.range) = (four(body.u, body.v), four(u, v));
        head.light = [mean, prepared.finest as f32, 0.0, 0.0];
        head.tables[0] = self.tables.len() as u32;
        prepared.thin.add_across(&mut self.tables);
        head.tables[1] = self.tables.len() as u32;
        prepared.thin.add_along(&mut self.tables);
        head.tables[2] = self.terms.len() as u32;
        match &prepared.light {
            PatternLight::Cosines(cosines) => self.add_cosines(cosines, &mut head),
            PatternLight::Products(products) => {
                head.kind = [PROFILES, self.add_profiles(products), products.len() as u32, 0];
            }
        }
        head.tables[3] = self.terms.len() as u32 - head.tables[2];
        head
    }

    fn add_cosines(&mut self, cosines: &Cosines, head: &mut PatternHead) {
        head.light[2] = cosines.constant;
        self.terms.extend(cosines.terms.iter().map(|term| {
            let [across, along] = term.frequency.map(|value| value as f32);
            [across, along, term.amplitude, (term.turns - term.turns.floor()) as f32]
        }));
        match &cosines.frame {
            PatternFrame::Edges(window) => {
                head.kind = [EDGES, 0, 0, 0];
                head.sides = window.sides.map(|side| side.map(|value| value as f32));
                head.ends = window.ends.map(|end| [end[0] as f32, end[1] as f32, end[2] as f32, 0.0]);
                head.softness = window.softness.map(|value| value as f32);
            }
            PatternFrame::Profiles(profiles) => {
                head.kind = [PROFILE_WINDOW, self.add_profiles(std::slice::from_ref(profiles)), 1, 0];
            }
        }
    }

    /// Adds pairs of profiles; returns the number of the first.
    fn add_profiles(&mut self, pairs: &[[Profile; 2]]) -> u32 {
        let first = self.profiles.len() / Profile::NODES;
        pairs.iter().flatten().for_each(|profile| self.profiles.extend(profile.nodes()));
        first as u32
    }
}
