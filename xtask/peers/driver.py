"""One measured run of pyfmaps, or of SciPy's eigsh alone.

usage: driver.py JOB.json

The job is the one that `xtask measure-pair` reads; the result has the same keys. Every stage is
timed inside this process, by the clock and on the processor, with its peak resident memory.
"""

import json
import sys
import time
import warnings

warnings.filterwarnings("ignore")

import numpy as np
import scipy
import scipy.sparse
import scipy.sparse.linalg

# Shift of shift-invert on shapes of unit area, the one that pyfmaps uses.
SHIFT = -0.01


def status_mib(key):
    try:
        with open("/proc/self/status") as status:
            for line in status:
                if line.startswith(key + ":"):
                    return int(line.split()[1]) / 1024
    except OSError:
        pass
    return None


def reset_peak():
    try:
        with open("/proc/self/clear_refs", "w") as clear:
            clear.write("5")
    except OSError:
        pass


class Recorder:
    def __init__(self):
        self.stages = []

    def run(self, name, work):
        reset_peak()
        cpu, clock = time.process_time(), time.perf_counter()
        result = work()
        self.stages.append(
            {
                "name": name,
                "seconds": time.perf_counter() - clock,
                "cpu_seconds": time.process_time() - cpu,
                "peak_mib": status_mib("VmHWM"),
            }
        )
        return result


def pair(job):
    import pyFM.refine
    from pyFM.functional import FunctionalMapping
    from pyFM.mesh import TriMesh
    from pyFM.mesh.laplacian import laplacian_spectrum

    k, threads = job["n_functions"], job["n_threads"]
    meshes = [TriMesh.load(job["source"]), TriMesh.load(job["target"])]
    record = Recorder()
    start_mib = status_mib("VmRSS")

    def operators():
        for mesh in meshes:
            mesh.compute_operators()

    def eigenpairs():
        for mesh in meshes:
            mesh.eigenvalues, mesh.eigenvectors = laplacian_spectrum(
                mesh.stiffness, mesh.mass, spectrum_size=k
            )

    record.run("operators", operators)
    record.run("eigenpairs", eigenpairs)
    model = FunctionalMapping(*meshes)
    record.run(
        "descriptors",
        lambda: model.compute_spectral_descriptors(
            n_descr=job["n_wave"],
            descr_type="WKS",
            k_descr=k,
            landmarks=np.array(job["landmarks"]),
        ),
    )
    # The weights of the package's own first example.
    record.run(
        "fit",
        lambda: model.fit(
            K=(job["n_fit"], job["n_fit"]), w_descr=1, w_lap=0.1, w_dcomm=1, w_orient=1
        ),
    )
    maps = {"fit": model.get_p2p(n_jobs=threads).tolist()}
    start = job["n_start"]
    refined = None
    for step in job["steps"]:
        name = f"ZoomOut step {step}"
        refined, p2p = record.run(
            name,
            lambda: pyFM.refine.mesh_zoomout_refine(
                model.FM_12[:start, :start],
                *meshes,
                nit=(k - start) // step,
                step=step,
                return_p2p=True,
                n_jobs=threads,
            ),
        )
        maps[name] = p2p.tolist()
    points = {}
    if job["precise"]:
        faces, weights = record.run(
            "precise map", lambda: model.get_precise_map(FM=refined, n_jobs=threads)
        )
        corners = meshes[0].vertices[meshes[0].faces[faces]]
        points["precise map"] = np.einsum("vc,vcx->vx", weights, corners).tolist()
    return {
        "stages": record.stages,
        "start_mib": start_mib,
        "eigenvalues": [mesh.eigenvalues.tolist() for mesh in meshes],
        "maps": maps,
        "points": points,
    }


def eigsh(job):
    def matrices(prefix):
        mass = np.fromfile(prefix + ".mass", dtype="<f8")
        starts = np.fromfile(prefix + ".starts", dtype="<u8").astype(np.int32)
        columns = np.fromfile(prefix + ".columns", dtype="<u8").astype(np.int32)
        values = np.fromfile(prefix + ".values", dtype="<f8")
        n = len(mass)
        # Symmetric: by rows and by columns are the same.
        stiffness = scipy.sparse.csc_matrix((values, columns, starts), shape=(n, n))
        return stiffness, scipy.sparse.diags(mass).tocsc()

    pencils = [matrices(prefix) for prefix in job["matrices"]]
    record = Recorder()
    start_mib = status_mib("VmRSS")

    def eigenpairs():
        return [
            scipy.sparse.linalg.eigsh(w, k=job["n_functions"], M=m, sigma=SHIFT)[0]
            for w, m in pencils
        ]

    eigenvalues = record.run("eigenpairs", eigenpairs)
    return {
        "stages": record.stages,
        "start_mib": start_mib,
        "eigenvalues": [values.tolist() for values in eigenvalues],
        "maps": {},
        "points": {},
    }


def main():
    with open(sys.argv[1]) as file:
        job = json.load(file)
    result = eigsh(job) if job["program"] == "scipy" else pair(job)
    result["versions"] = {
        "python": sys.version.split()[0],
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }
    with open(job["output"], "w") as file:
        json.dump(result, file)


if __name__ == "__main__":
    main()
