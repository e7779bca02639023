"""Runs one registration package on a list of problems.

usage: registration.py JOB.json

A problem is a source (points and unit normals of the CT surface), target points (what the sensor
saw) and a rough pose target_from_source; arrays are raw little-endian float64, n x 3, in mm. The
answer is a pose target_from_source for each problem, its seconds, or a word why there is none.
Seconds are those of the registration with all of its preprocessing, without reading and imports.
"""

import json
import sys
import time

import numpy as np

# Gate of the last ICP, mm, as ours has it, and of the first one.
LAST_GATE = 5.0
FIRST_GATE = 20.0
# Voxels of KISS-Matcher in those of Open3D.
KISS_VOXELS = 1.5


def points(path):
    return np.ascontiguousarray(np.fromfile(path, dtype="<f8").reshape(-1, 3))


def inverse(pose):
    result = np.eye(4)
    result[:3, :3] = pose[:3, :3].T
    result[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return result


def open3d_method():
    try:
        import open3d as o3d
    except (ImportError, OSError) as error:
        sys.exit(f"open3d: {error}; on Debian it needs the packages libusb-1.0-0 and libgl1")
    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    reg = o3d.pipelines.registration

    def features(cloud, voxel):
        down = cloud.voxel_down_sample(voxel)
        hybrid = o3d.geometry.KDTreeSearchParamHybrid
        if not down.has_normals():
            down.estimate_normals(hybrid(radius=2 * voxel, max_nn=30))
            # Features depend on the sign: outwards, as far as one can tell without a mesh.
            down.orient_normals_consistent_tangent_plane(15)
            normals = np.asarray(down.normals)
            rest = np.asarray(down.points) - down.get_center()
            if np.einsum("ij,ij->", rest, normals) < 0:
                down.normals = o3d.utility.Vector3dVector(-normals)
        return down, reg.compute_fpfh_feature(down, hybrid(radius=5 * voxel, max_nn=100))

    def run(source, normals, target, start, voxel):
        o3d.utility.random.seed(1)
        model, seen = o3d.geometry.PointCloud(), o3d.geometry.PointCloud()
        model.points = o3d.utility.Vector3dVector(source)
        model.normals = o3d.utility.Vector3dVector(normals)
        seen.points = o3d.utility.Vector3dVector(target)
        a, fa = features(seen, voxel)
        b, fb = features(model, voxel)
        found = reg.registration_ransac_based_on_feature_matching(
            a, b, fa, fb, True, 1.5 * voxel,
            reg.TransformationEstimationPointToPoint(False), 3,
            [reg.CorrespondenceCheckerBasedOnEdgeLength(0.9),
             reg.CorrespondenceCheckerBasedOnDistance(1.5 * voxel)],
            reg.RANSACConvergenceCriteria(100_000, 0.999),
        )
        pose = found.transformation
        for gate in (FIRST_GATE / 2, LAST_GATE):
            pose = reg.registration_icp(
                seen, model, gate, pose, reg.TransformationEstimationPointToPlane(),
                reg.ICPConvergenceCriteria(max_iteration=50),
            ).transformation
        return inverse(np.asarray(pose))

    return run, o3d.__version__


def gicp(small_gicp, source, target, pose, voxel):
    """GICP of what was seen to the model from a pose target_from_source."""
    # The model keeps its resolution; what was seen is used as it is.
    model, tree = small_gicp.preprocess_points(source, downsampling_resolution=0.5 * voxel)
    seen, _ = small_gicp.preprocess_points(target, downsampling_resolution=0.25)
    pose = inverse(pose)
    for gate in (FIRST_GATE, 2 * LAST_GATE, LAST_GATE):
        pose = small_gicp.align(
            model, seen, tree, pose, registration_type="GICP",
            max_correspondence_distance=gate, max_iterations=50,
        ).T_target_source
    return inverse(pose)


def small_gicp_method():
    import small_gicp
    from importlib.metadata import version

    def run(source, normals, target, start, voxel):
        return gicp(small_gicp, source, target, start, voxel)

    return run, version("small_gicp")


def kiss_matcher_method():
    import kiss_matcher
    import small_gicp
    from importlib.metadata import version

    def run(source, normals, target, start, voxel):
        # It turns normals towards the origin, and its bounds are made for metres: both clouds are
        # moved to their middles and given in centimetres. Finer voxels found no correspondences.
        voxel *= KISS_VOXELS
        matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel_size=0.1 * voxel))
        a, b = source.mean(axis=0), target.mean(axis=0)
        found = matcher.estimate(
            list((0.1 * (source - a)).astype(np.float32)),
            list((0.1 * (target - b)).astype(np.float32)),
        )
        if not found.valid:
            raise ValueError("no valid solution")
        pose = np.eye(4)
        pose[:3, :3] = found.rotation
        pose[:3, 3] = 10 * np.asarray(found.translation).ravel() + b - pose[:3, :3] @ a
        return gicp(small_gicp, source, target, pose, voxel / KISS_VOXELS)

    return run, version("kiss-matcher")


METHODS = {
    "open3d": open3d_method,
    "small_gicp": small_gicp_method,
    "kiss_matcher": kiss_matcher_method,
}


def main():
    with open(sys.argv[1]) as file:
        job = json.load(file)
    run, version = METHODS[job["program"]]()
    answers = []
    for problem in job["problems"]:
        source, normals, target = (points(problem[k]) for k in ("source", "normals", "target"))
        start = np.array(problem["start"]).reshape(4, 4)
        clock = time.perf_counter()
        pose, word = None, None
        try:
            pose = run(source, normals, target, start, problem["voxel_mm"])
            if not np.isfinite(pose).all():
                pose, word = None, "the pose is not finite"
        except Exception as error:  # Whatever the package throws is its answer.
            word = str(error)
        seconds = time.perf_counter() - clock
        answers.append(
            {
                "pose": None if pose is None else [float(x) for x in pose.ravel()],
                "seconds": seconds,
                "word": word,
            }
        )
    with open(job["output"], "w") as file:
        json.dump({"version": version, "answers": answers}, file)


if __name__ == "__main__":
    main()
