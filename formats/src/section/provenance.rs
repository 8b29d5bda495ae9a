//! `PROV` v1: what an asset was made from, what was asked of it and what was measured. Bytes: SPEC.md, "PROV".

use crate::container::OutSection;
use crate::error::{Limits, ReadError};
use crate::meta::{self, check_version};
use crate::tag::Tag;
use serde::{Deserialize, Serialize};

/// An input file as it was when the asset was baked.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputRecord {
    /// Name as the recipe has it.
    pub name: String,
    /// Length, bytes.
    pub bytes: u64,
    /// BLAKE3 of the bytes.
    pub hash: [u8; 32],
}

/// A budget: what was asked, what was measured on the bytes that ship, and what the neighbouring settings would give.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BudgetRecord {
    /// Part of the asset: `streaks`, `density`, `response`, …
    pub part: String,
    /// What is measured, with its unit.
    pub metric: String,
    /// The bound asked for; `None` where a figure is only reported.
    pub asked: Option<f64>,
    /// The figure measured.
    pub got: f64,
    /// The setting in the asset, in words.
    pub chosen: String,
    /// The next better setting and what it costs, if there is one.
    pub next_better: Option<String>,
    /// The next cheaper setting and why it was not taken, if there is one.
    pub next_cheaper: Option<String>,
}

/// Where an asset comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProvenanceSection {
    /// Version of the tool that baked.
    pub tool: String,
    /// BLAKE3 of the recipe's bytes.
    pub recipe_hash: [u8; 32],
    /// Every file that the recipe names.
    pub inputs: Vec<InputRecord>,
    /// Budgets and reported figures.
    pub budgets: Vec<BudgetRecord>,
}

impl ProvenanceSection {
    /// The section's tag.
    pub const TAG: Tag = Tag(*b"PROV");
    /// Version that this build writes, and the newest that it reads.
    pub const VERSION: u16 = 1;

    /// Reads a record.
    ///
    /// Errors: another version, bytes that are no record of this one, more inputs or budgets than `limits.items`.
    pub fn read(bytes: &[u8], version: u16, limits: &Limits) -> Result<Self, ReadError> {
        check_version(Self::TAG, version, Self::VERSION)?;
        let section: Self = meta::decode(Self::TAG, bytes, limits)?;
        for (field, count) in [("inputs", section.inputs.len()), ("budgets", section.budgets.len())] {
            if count as u64 > limits.items {
                let (wanted, allowed) = (count as u64, limits.items);
                return Err(ReadError::OverLimit { section: Self::TAG, field, wanted, allowed });
            }
        }
        Ok(section)
    }

    /// The section's bytes.
    pub fn write(&self) -> OutSection {
        OutSection::small(Self::TAG, Self::VERSION, false, meta::encode(self))
    }
}
