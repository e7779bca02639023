//! Which label is which level.
//!
//! VerSe (Sekuboyina et al. 2021) counts from C1: L1 to L5 are 20 to 24. TotalSegmentator version 2
//! (Wasserthal et al. 2023) counts upwards: L5 is 27 and L1 is 31. A scheme of one's own is a file
//!
//! ```text
//! (name: "ours", levels: {L1: 1, L2: 2, L3: 3, L4: 4, L5: 5})
//! ```

use std::collections::BTreeMap;
use std::path::Path;

use pedicle_trajectory::Level;
use serde::Deserialize;

use crate::runs::label_list;
use crate::{LabelError, LabelMap};

/// Which label is which level.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelScheme {
    /// Its name, for messages.
    pub name: String,
    /// The label of every level that it knows; 0 is the background and no level.
    pub levels: BTreeMap<Level, i64>,
}

/// How the scheme is chosen.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum SchemeChoice {
    /// The one of VerSe and TotalSegmentator whose lumbar labels are there; refused if both are.
    #[default]
    Auto,
    /// This one.
    Scheme(LabelScheme),
}

impl LabelScheme {
    /// VerSe: 20 to 24.
    #[must_use]
    pub fn verse() -> Self {
        Self::known("verse", [20, 21, 22, 23, 24])
    }

    /// TotalSegmentator version 2: 31 down to 27.
    #[must_use]
    pub fn totalsegmentator() -> Self {
        Self::known("totalsegmentator", [31, 30, 29, 28, 27])
    }

    /// The schemes known by name.
    #[must_use]
    pub fn all() -> [Self; 2] {
        [Self::verse(), Self::totalsegmentator()]
    }

    fn known(name: &str, labels: [i64; 5]) -> Self {
        Self {
            name: name.to_owned(),
            levels: Level::ALL.into_iter().zip(labels).collect(),
        }
    }

    /// Reads a scheme from a RON file.
    ///
    /// # Errors
    /// [`LabelError::Scheme`] for a file that cannot be read, is not RON, names no level, gives two
    /// levels one label, or a level the background; [`LabelError::Io`] if it cannot be read.
    pub fn read(path: &Path) -> Result<Self, LabelError> {
        let refused = |message: String| LabelError::Scheme {
            path: path.to_owned(),
            message,
        };
        let text = std::fs::read_to_string(path).map_err(|source| LabelError::Io {
            path: path.to_owned(),
            source,
        })?;
        let scheme: Self = ron::from_str(&text).map_err(|e| refused(e.to_string()))?;
        if scheme.levels.is_empty() {
            return Err(refused("the scheme names no level".to_owned()));
        }
        let mut level_of: BTreeMap<i64, Level> = BTreeMap::new();
        for (&level, &label) in &scheme.levels {
            if label == 0 {
                return Err(refused(format!(
                    "{level} has the label 0, which is the background"
                )));
            }
            if let Some(other) = level_of.insert(label, level) {
                return Err(refused(format!(
                    "{other} and {level} have the same label {label}"
                )));
            }
        }
        Ok(scheme)
    }

    /// Number of its levels that a label map has.
    fn n_present(&self, map: &LabelMap) -> usize {
        let has = |label: &&i64| map.n_voxels.contains_key(label);
        self.levels.values().filter(has).count()
    }

    /// Its labels as a text: "20 to 24".
    pub(crate) fn labels(&self) -> String {
        let mut labels: Vec<i64> = self.levels.values().copied().collect();
        labels.sort_unstable();
        label_list(labels.into_iter())
    }
}

/// The scheme to use for a label map.
pub(crate) fn choose(choice: &SchemeChoice, map: &LabelMap) -> Result<LabelScheme, LabelError> {
    match choice {
        SchemeChoice::Scheme(scheme) if scheme.n_present(map) > 0 => Ok(scheme.clone()),
        SchemeChoice::Scheme(scheme) => Err(none_fits(map, scheme.name.clone(), scheme.labels())),
        SchemeChoice::Auto => detect(map),
    }
}

/// All levels of exactly one scheme, or else some levels of exactly one.
fn detect(map: &LabelMap) -> Result<LabelScheme, LabelError> {
    let all = LabelScheme::all();
    for enough in [Level::ALL.len(), 1] {
        let fit: Vec<&LabelScheme> = all
            .iter()
            .filter(|scheme| scheme.n_present(map) >= enough)
            .collect();
        match fit[..] {
            [one] => return Ok(one.clone()),
            [first, second, ..] => {
                return Err(LabelError::AmbiguousScheme {
                    path: map.path.clone(),
                    found: map.found(),
                    first: first.name.clone(),
                    second: second.name.clone(),
                });
            }
            [] => {}
        }
    }
    let names: Vec<String> = all.iter().map(|s| s.name.clone()).collect();
    let labels: Vec<String> = all.iter().map(LabelScheme::labels).collect();
    Err(none_fits(map, names.join(" or "), labels.join(" or ")))
}

fn none_fits(map: &LabelMap, scheme: String, wanted: String) -> LabelError {
    LabelError::NoLumbarLabels {
        path: map.path.clone(),
        scheme,
        wanted,
        found: found_and_fit(map),
    }
}

/// The labels found and, if there is one, the known scheme that fits them best.
pub(crate) fn found_and_fit(map: &LabelMap) -> String {
    let found = map.found();
    let best = LabelScheme::all()
        .into_iter()
        .filter(|scheme| scheme.n_present(map) > 0)
        .max_by_key(|scheme| scheme.n_present(map));
    match best {
        Some(scheme) => format!(
            "{found}; {} of them are lumbar levels under the scheme {}",
            scheme.n_present(map),
            scheme.name
        ),
        None => found,
    }
}
