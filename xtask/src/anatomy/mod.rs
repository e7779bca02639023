//! `cargo xtask bench-anatomy`: measured pedicles beside the phantom's true ones or published ranges,
//! planned screws beside the best that a dense search finds, and the time of a check.

mod brute;
mod ranges;
mod time;
mod truth;

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use comfy_table::presets::UTF8_FULL_CONDENSED;
use pedicle_mesh::TriMesh;
use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom, subject_seed};
use pedicle_trajectory::{
    CheckOptions, Grade, Level, PedicleOptions, Plan, ScrewReport, Side, assess_plan, measure_spine,
};
use rayon::prelude::*;

use crate::bench::new_table;
use crate::{XtaskError, say};
use brute::PlanError;
use truth::MeasureError;

/// Measure and plan generated people, or a spine, and compare with the truth and with a dense
/// search. Exit code 1 if a pedicle is missing, a limit is broken, a screw is not grade A or a check
/// takes too long.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// How many people.
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..))]
    subjects: u32,
    /// Measure and plan a spine from files instead; there is no truth, so published ranges are beside it.
    #[arg(long, value_name = "PATH", conflicts_with = "subjects")]
    spine: Option<PathBuf>,
    /// Seed of the cohort. Seeds below 1000 were used for tuning, never for reported figures.
    #[arg(long, value_name = "N", default_value_t = 20_260_101)]
    seed: u64,
    /// Cell of the grid that the people are meshed with, mm. 1 is that of a CT; with 1.95, as
    /// elsewhere, edges of 2 mm cut the tops of narrow pedicles off.
    #[arg(long, value_name = "MM", default_value_t = 1.0)]
    cell_mm: f64,
    /// Also look for a better line by a dense search, for the first N people or the spine.
    #[arg(long, value_name = "N", default_value_t = 0)]
    brute: u32,
    /// Instead, time the check of the planned screws of the spine, or of one person with at least
    /// 200 000 faces.
    #[arg(long, conflicts_with_all = ["brute", "explain", "subjects", "cell_mm"])]
    time: bool,
    /// Print every pedicle.
    #[arg(long)]
    explain: bool,
}

/// Cell of the grid at which five vertebrae have more than 200 000 faces, mm.
const TIMED_CELL_MM: f64 = 0.89;

/// What is found in one spine.
struct Found {
    measures: Vec<MeasureError>,
    missing: Vec<String>,
    /// Where there is no truth: the table, and what is outside.
    ranges: Option<(comfy_table::Table, Vec<String>)>,
    screws: Vec<ScrewReport>,
    brute: Vec<PlanError>,
}

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        if self.time {
            return self.time_of_check();
        }
        let started = Instant::now();
        let found = match &self.spine {
            Some(path) => {
                let vertebrae = pedicle::read_spine(path)?;
                let pairs = pedicle::level_pairs(&vertebrae);
                vec![study(
                    &path.display().to_string(),
                    &pairs,
                    None,
                    self.brute > 0,
                )?]
            }
            None => (0..self.subjects)
                .into_par_iter()
                .map(|i| {
                    let parameters = PhantomParameters::subject(subject_seed(self.seed, i));
                    let options = MeshingOptions {
                        cell_mm: self.cell_mm,
                    };
                    let phantom = generate_phantom(&parameters, &options)?;
                    let pairs: Vec<(Level, &TriMesh)> = phantom
                        .vertebrae
                        .iter()
                        .map(|v| (v.level, &v.mesh))
                        .collect();
                    let name = format!("subject {}", i + 1);
                    study(&name, &pairs, Some(&phantom), i < self.brute)
                })
                .collect::<Result<Vec<_>, XtaskError>>()?,
        };
        let held = self.report(&found);
        say(&format!("time: {:.1} s", started.elapsed().as_secs_f64()));
        Ok(held)
    }

    fn time_of_check(&self) -> Result<bool, XtaskError> {
        if let Some(path) = &self.spine {
            let vertebrae = pedicle::read_spine(path)?;
            let pairs = pedicle::level_pairs(&vertebrae);
            return time::run(&path.display().to_string(), &pairs);
        }
        let parameters = PhantomParameters::subject(subject_seed(self.seed, 0));
        let cell_mm = TIMED_CELL_MM;
        let phantom = generate_phantom(&parameters, &MeshingOptions { cell_mm })?;
        let pairs: Vec<(Level, &TriMesh)> = phantom
            .vertebrae
            .iter()
            .map(|v| (v.level, &v.mesh))
            .collect();
        time::run("subject 1", &pairs)
    }

    fn report(&self, found: &[Found]) -> bool {
        let measures: Vec<&MeasureError> = found.iter().flat_map(|f| &f.measures).collect();
        if self.explain {
            for m in &measures {
                say(&m.to_string());
            }
        }
        let mut held = true;
        for f in found {
            if let Some((table, outside)) = &f.ranges {
                say(&table.to_string());
                for words in outside {
                    say(&format!("OUTSIDE: {words}"));
                }
                held &= outside.is_empty();
            }
        }
        for missing in found.iter().flat_map(|f| &f.missing) {
            say(missing);
            held = false;
        }
        if !measures.is_empty() {
            say(&format!(
                "{} pedicles, seed {}, cells of {} mm: errors against the truth",
                measures.len(),
                self.seed,
                self.cell_mm
            ));
            let (table, within) = truth::table(&measures, UTF8_FULL_CONDENSED);
            say(&table.to_string());
            held &= within;
        }
        let screws: Vec<&ScrewReport> = found.iter().flat_map(|f| &f.screws).collect();
        let counts = Grade::ALL.map(|g| screws.iter().filter(|r| r.grade == g).count());
        let clearances = screws.iter().map(|r| r.check.min_clearance_mm());
        let facets = screws.iter().filter(|r| r.facet.grade > 0).count();
        say(&format!(
            "{} planned: grades A/B/C/D/E {}, least clearance {:.2} mm, facet violations {facets}, \
             guide wires {}",
            screws.len(),
            counts.map(|n| n.to_string()).join("/"),
            clearances.fold(f64::INFINITY, f64::min),
            screws
                .iter()
                .filter(|r| r.trajectory.diameter_mm < brute::THINNEST_SCREW_MM)
                .count()
        ));
        held &= counts[0] == screws.len();
        let brute: Vec<&PlanError> = found.iter().flat_map(|f| &f.brute).collect();
        if !brute.is_empty() {
            let mut table = new_table(
                UTF8_FULL_CONDENSED,
                ["screw", "clear mm", "dense search mm"]
                    .map(String::from)
                    .to_vec(),
            );
            for p in &brute {
                table.add_row([
                    p.name.clone(),
                    format!("{:.2}", p.planned_mm),
                    format!("{:.2}", p.best_mm),
                ]);
            }
            let worst = brute.iter().map(|p| p.best_mm - p.planned_mm);
            let worst = worst.fold(f64::NEG_INFINITY, f64::max);
            say(&format!(
                "{table}\nthe dense search is better by {worst:.2} mm at most"
            ));
            held &= worst <= brute::LIMIT_MM;
        }
        held
    }
}

fn study(
    name: &str,
    pairs: &[(Level, &TriMesh)],
    phantom: Option<&pedicle_simulation::Phantom>,
    search: bool,
) -> Result<Found, XtaskError> {
    let spine =
        measure_spine(pairs, &PedicleOptions::default()).map_err(|error| XtaskError::Anatomy {
            spine: name.to_owned(),
            error,
        })?;
    let mut found = Found {
        measures: Vec::new(),
        missing: Vec::new(),
        ranges: None,
        screws: Vec::new(),
        brute: Vec::new(),
    };
    if phantom.is_none() {
        found.ranges = Some(ranges::table(&spine, pairs, UTF8_FULL_CONDENSED));
    }
    let mut plan = Plan::default();
    for v in &spine {
        for side in Side::ALL {
            let place = format!("{name} {} {side}", v.level);
            match v.pedicle(side) {
                Ok(anatomy) => {
                    let truth =
                        phantom.map(|p| &p.vertebrae[v.level.index()].pedicles[side as usize]);
                    found
                        .measures
                        .extend(truth.map(|t| MeasureError::new(place.clone(), anatomy, t)));
                }
                Err(error) => found.missing.push(format!("{place}: {error}")),
            }
            match brute::planned(&spine, pairs, (v.level, side)) {
                Ok(screw) => plan.trajectories.push(screw),
                Err(error) => found.missing.push(format!("{place}: {error}")),
            }
        }
    }
    found.screws =
        assess_plan(&spine, pairs, &plan, &CheckOptions::default()).map_err(|error| {
            XtaskError::Check {
                scenario: name.to_owned(),
                error: error.to_string(),
            }
        })?;
    if search {
        found.brute = plan
            .trajectories
            .par_iter()
            .filter_map(|t| brute::search(name, &spine, pairs, t))
            .collect();
    }
    Ok(found)
}
