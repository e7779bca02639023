//! Simpler methods that the pipeline is held against, on the same targets.
//!
//! | method | pose of vertebra v |
//! |---|---|
//! | landmarks only | argmin over T of Σ_l \|T s_l - t_l\|², one T for all |
//! | rigid ICP | argmin over T of Σ_j ρ(n_j · (T⁻¹ p_j - q_j)), one T for all, from the landmarks |
//! | landmark line | the same for each v, from 12 turns about the line of landmarks, best fit kept |
//! | published | MSAC over the pairs that a functional map with BCICP makes of each v |
//!
//! s_l, t_l are landmarks of the source and of the target, p_j target points, q_j, n_j the source
//! surface's points closest to them and normals there. None of them knows the truth, and none of
//! them says no: whatever pose one gives, it vouches for. Millimetres and radians,
//! `target_from_source` throughout.

mod landmark_line;
mod landmarks_only;
mod published;
mod rigid_icp;
mod source;

use std::time::{Duration, Instant};

use nalgebra::{Isometry3, Point3};
use pedicle_simulation::{SuiteTarget, TargetSurface};
use pedicle_trajectory::{Landmarks, Level};

pub(crate) use rigid_icp::icp;
pub(crate) use source::{PlaneSurface, Source};

/// A pose for each vertebra, or why there is none.
pub(crate) type Poses = Vec<Result<Isometry3<f64>, String>>;

/// Which of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Method {
    LandmarksOnly,
    RigidIcp,
    LandmarkLine,
    Published,
}

impl Method {
    /// In the order of the tables.
    pub(crate) const ALL: [Self; 4] = [
        Self::LandmarksOnly,
        Self::RigidIcp,
        Self::LandmarkLine,
        Self::Published,
    ];

    /// Its name in the JSON.
    pub(crate) fn key(self) -> &'static str {
        match self {
            Self::LandmarksOnly => "landmarks_only",
            Self::RigidIcp => "rigid_icp",
            Self::LandmarkLine => "landmark_line",
            Self::Published => "published_pipeline",
        }
    }
}

impl std::fmt::Display for Method {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::LandmarksOnly => "landmarks only",
            Self::RigidIcp => "rigid ICP of the spine",
            Self::LandmarkLine => "landmark line and ICP",
            Self::Published => "published pipeline",
        })
    }
}

/// What a method may see of a target.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen<'a> {
    pub(crate) surface: &'a TargetSurface,
    /// One entry a level, none where the landmark is missing.
    pub(crate) landmarks: &'a [Option<Point3<f64>>],
    /// Of everything random.
    pub(crate) seed: u64,
}

/// Runs one method, with the time that it took.
pub(crate) fn run(
    method: Method,
    source: &Source,
    target: &SuiteTarget,
    seed: u64,
) -> (Poses, Duration) {
    let landmarks = by_level(&target.target_landmarks);
    let seen = Seen {
        surface: &target.surface,
        landmarks: &landmarks,
        seed,
    };
    let clock = Instant::now();
    let poses = match method {
        Method::LandmarksOnly => for_all(landmarks_only::pose(source, &seen)),
        Method::RigidIcp => for_all(rigid_icp::pose(source, &seen)),
        Method::LandmarkLine => landmark_line::poses(source, &seen),
        Method::Published => {
            published::poses(source, &seen).unwrap_or_else(|reason| for_all(Err(reason)))
        }
    };
    (poses, clock.elapsed())
}

/// The landmarks in the order of the levels.
pub(crate) fn by_level(landmarks: &Landmarks) -> Vec<Option<Point3<f64>>> {
    Level::ALL
        .into_iter()
        .map(|level| landmarks.landmark(level).map(|l| l.position_mm))
        .collect()
}

/// One pose for every vertebra.
fn for_all(pose: Result<Isometry3<f64>, String>) -> Poses {
    vec![pose; Level::ALL.len()]
}

/// Every n-th point, so that at most `n` are left: targets come in random order.
pub(crate) fn thinned(points: &[Point3<f64>], n: usize) -> Vec<Point3<f64>> {
    let stride = points.len().div_ceil(n.max(1)).max(1);
    points.iter().copied().step_by(stride).collect()
}

#[cfg(test)]
mod tests {
    use pedicle_simulation::{
        Deformation, MeshingOptions, PhantomParameters, SuiteCell, SuiteScenario, generate_phantom,
        simulate_suite,
    };

    use super::*;

    #[test]
    fn on_an_easy_target_each_does_what_it_can() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let case = phantom.spine_case(3500).unwrap();
        let source = Source::new(&case, &phantom.landmarks()).unwrap();
        let scenario = SuiteScenario {
            cell: SuiteCell::Paper {
                deformation: Deformation::Rigid,
                noise_mm: 0.5,
            },
            draw: 0,
            seed: 5,
        };
        let target = simulate_suite(&case, &scenario).unwrap();
        // Largest error at a centroid, mm.
        for (method, largest_mm) in [
            (Method::LandmarksOnly, 15.0),
            (Method::RigidIcp, 0.5),
            (Method::LandmarkLine, 0.6),
            (Method::Published, 5.0),
        ] {
            let (poses, _) = run(method, &source, &target, 1);
            assert_eq!(poses.len(), 5, "{method}: one a level");
            for (pose, truth) in poses.iter().zip(&target.truth) {
                let pose = pose.as_ref().unwrap();
                let error = truth.vertebra.error_of(pose).translation_mm;
                assert!(
                    error < largest_mm,
                    "{method}, {}: {error} mm",
                    truth.vertebra.level
                );
            }
        }
    }

    #[test]
    fn without_landmarks_there_is_a_word_instead_of_a_pose() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let case = phantom.spine_case(3500).unwrap();
        let source = Source::new(&case, &phantom.landmarks()).unwrap();
        let surface = TargetSurface::Cloud(case.vertebrae()[0].mesh.vertices().to_vec());
        let seen = Seen {
            surface: &surface,
            landmarks: &[None; 5],
            seed: 0,
        };
        let word = landmarks_only::pose(&source, &seen).unwrap_err();
        assert!(word.contains("0 landmark"), "{word}");
        let words = landmark_line::poses(&source, &seen);
        assert!(words.iter().all(Result::is_err), "no line");
        let word = published::poses(&source, &seen).unwrap_err();
        assert!(word.contains("cloud"), "{word}");
    }

    #[test]
    fn thinning_keeps_at_most_what_is_asked_for() {
        let points: Vec<_> = (0..10).map(|i| Point3::new(i as f64, 0.0, 0.0)).collect();
        assert_eq!(thinned(&points, 4).len(), 4, "every third");
        assert_eq!(thinned(&points, 100), points, "all");
    }
}
