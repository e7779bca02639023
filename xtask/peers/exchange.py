"""Other people's readers on our files, and files of theirs for our readers.

usage: exchange.py PEDICLE FIXTURES WORK

Runs the command line PEDICLE in the empty folder WORK, compares every number that other libraries
read from its files with what it should be, and leaves files written by them in WORK/theirs with
WORK/theirs.json, which says what is in each. Ends with an error at the first difference.
"""

import json
import subprocess
import sys
from pathlib import Path

import meshio
import nibabel
import numpy as np
import SimpleITK
import slicerio
import trimesh
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLPolyDataWriter

PEDICLE, FIXTURES, WORK = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
LEVELS = ["L1", "L2", "L3", "L4", "L5"]
LPS = np.diag([-1.0, -1.0, 1.0, 1.0])
N_CHECKS = 0


def run(*arguments, codes=(0,)):
    done = subprocess.run([PEDICLE, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode not in codes:
        sys.exit(f"pedicle {' '.join(map(str, arguments))}: {done.returncode}\n{done.stderr}")
    return done.stdout


def same(what, found, expected, tolerance=0.0):
    """All numbers as near as this; shapes must agree."""
    global N_CHECKS
    N_CHECKS += 1
    found, expected = np.asarray(found, float), np.asarray(expected, float)
    if found.shape != expected.shape:
        sys.exit(f"{what}: shape {found.shape}, expected {expected.shape}")
    worst = np.abs(found - expected).max(initial=0.0)
    if not worst <= tolerance:
        sys.exit(f"{what}: {worst} off, at most {tolerance} allowed")


def apply(matrix, points):
    return np.asarray(points) @ matrix[:3, :3].T + matrix[:3, 3]


# --- label maps: nibabel and SimpleITK write, we import, trimesh reads ------------------------

SIZE = (70, 56, 160)
HALF_AXES = np.array([16.0, 13.0, 10.0])


def center(level):
    return np.array([4.0 * level - 8.0, 2.0, 54.0 - 27.0 * level])


def spine_labels(affine, labels):
    voxels = np.stack(np.meshgrid(*map(np.arange, SIZE), indexing="ij"), axis=-1)
    points = apply(affine, voxels.reshape(-1, 3)).reshape(voxels.shape)
    volume = np.zeros(SIZE, np.int16)
    for level, label in enumerate(labels):
        volume[(((points - center(level)) / HALF_AXES) ** 2).sum(axis=-1) <= 1.0] = label
    return volume


def oblique(scale):
    c, s = np.cos(0.2), np.sin(0.2)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    affine = np.eye(4)
    affine[:3, :3] = turn @ np.diag(scale)
    affine[:3, 3] = np.array([0.0, 2.0, 0.0]) - affine[:3, :3] @ (np.array(SIZE) / 2.0)
    # What a NIfTI-1 header keeps.
    return affine.astype(np.float32).astype(float)


def check_import(name, path, volume, affine):
    folder = WORK / f"spine-{name}"
    report = json.loads(run("import", path, "-o", folder, "--json", "-"))
    voxel = abs(np.linalg.det(affine[:3, :3]))
    for level, entry in enumerate(report["levels"]):
        mesh = trimesh.load(folder / f"{LEVELS[level]}.ply", process=False)
        if not (mesh.is_watertight and mesh.is_winding_consistent):
            sys.exit(f"{name} {LEVELS[level]}: not watertight or wound both ways")
        inside = volume == entry["label"]
        expected = inside.sum() * voxel
        same(f"{name} {LEVELS[level]}: volume", mesh.volume / expected, 1.0, 2e-3)
        same(f"{name} {LEVELS[level]}: reported volume", entry["volume_mm3"] / mesh.volume, 1.0, 1e-9)
        middle = apply(affine, np.argwhere(inside)).mean(axis=0)
        same(f"{name} {LEVELS[level]}: centre", mesh.center_mass, middle, 0.05)
        same(f"{name} {LEVELS[level]}: centre of the ellipsoid", mesh.center_mass, center(level), 0.2)


def label_maps():
    verse, total = range(20, 25), range(31, 26, -1)
    cases = {
        "nifti1": (nibabel.Nifti1Image, oblique([1.0, 1.0, 1.0]), verse, np.int16, "nii.gz"),
        "nifti2": (nibabel.Nifti2Image, oblique([-1.0, -1.0, 1.0]), total, np.uint8, "nii"),
        "mirrored": (nibabel.Nifti1Image, oblique([-0.9, 1.0, 1.1]), verse, np.int32, "nii.gz"),
        "big": (nibabel.Nifti1Image, oblique([1.0, 1.0, -1.0]), verse, ">u2", "nii.gz"),
    }
    for name, (image, affine, labels, dtype, extension) in cases.items():
        volume = spine_labels(affine, labels)
        path = WORK / f"{name}.{extension}"
        header = image.header_class(endianness=">" if name == "big" else "<")
        written = image(volume.astype(dtype), affine, header=header, dtype=np.dtype(dtype))
        nibabel.save(written, path)
        check_import(name, path, volume, nibabel.load(path).affine)

    # SimpleITK keeps LPS and writes RAS.
    affine = oblique([1.0, 1.0, 1.2])
    volume = spine_labels(affine, verse)
    image = SimpleITK.GetImageFromArray(volume.transpose(2, 1, 0))
    in_lps = LPS @ affine
    scale = np.linalg.norm(in_lps[:3, :3], axis=0)
    image.SetSpacing(scale.tolist())
    image.SetOrigin(in_lps[:3, 3].tolist())
    image.SetDirection((in_lps[:3, :3] / scale).ravel().tolist())
    path = WORK / "sitk.nii.gz"
    SimpleITK.WriteImage(image, str(path))
    check_import("sitk", path, volume, nibabel.load(path).affine)

    path = WORK / "float.nii.gz"
    nibabel.save(nibabel.Nifti1Image(volume.astype(np.float32), affine), path)
    run("import", path, "-o", WORK / "spine-float", codes=(2,))


# --- 3D Slicer's Markups: no released package reads .mrk.json, so its documented fields are read here ---

MARKUP_TYPES = {"Fiducial", "Line", "Angle", "Curve", "ClosedCurve", "Plane", "ROI"}
POINT_STATES = {"undefined", "preview", "defined"}


def read_markups(path):
    """The markups of a file, after every field that we write has the type that version 1.0.3 asks for."""
    global N_CHECKS

    def needs(holds, what):
        if not holds:
            sys.exit(f"{path.name}: {what}")

    def refuse(word):
        sys.exit(f"{path.name}: {word} is no JSON")

    document = json.loads(path.read_text(), parse_constant=refuse)
    schema = document["@schema"]
    needs(schema.startswith("https://") and schema.endswith("markups-schema-v1.0.3.json#"), f"schema {schema}")
    needs(isinstance(document["markups"], list) and document["markups"], "no markups")
    for markup in document["markups"]:
        needs(markup["type"] in MARKUP_TYPES, f"type {markup['type']}")
        needs(isinstance(markup["name"], str), "a name that is no text")
        needs(markup["coordinateSystem"] in {"LPS", "RAS"}, f"in {markup['coordinateSystem']}")
        needs(markup["coordinateUnits"] == "mm", f"in {markup['coordinateUnits']}")
        points = markup["controlPoints"]
        needs(markup["type"] != "Line" or len(points) == 2, f"a line of {len(points)} points")
        needs(len({point["id"] for point in points}) == len(points), "points that share an id")
        for point in points:
            for key in ("id", "label", "description"):
                needs(isinstance(point.get(key, ""), str), f"{key} that is no text")
            position = point["position"]
            numbers = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in position)
            needs(len(position) == 3 and numbers and np.isfinite(position).all(), f"position {position}")
            needs(point["positionStatus"] in POINT_STATES, f"status {point['positionStatus']}")
    N_CHECKS += 1
    return document["markups"]


# --- a transfer: SimpleITK, trimesh, meshio and VTK read what we write -----------------------


def read_vtp(path):
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    faces = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    space = data.GetFieldData().GetAbstractArray("SPACE").GetValue(0)
    return vtk_to_numpy(data.GetPoints().GetData()), faces, space


def read_glb(path):
    scene = trimesh.load(path, process=False)
    (mesh,) = scene.geometry.values()
    return mesh.vertices, mesh.faces


def transfers():
    demo = WORK / "demo"
    run("demo", "--save", demo, "--quiet")
    result = WORK / "result.json"
    for format in ["ply", "stl", "vtp", "glb"]:
        arguments = ["transfer", "--source", demo / "source", "--plan", demo / "plan.ron"]
        arguments += ["--target", demo / "target.ply", "--format", format, "--force"]
        arguments += ["--source-landmarks", demo / "source-landmarks.ron"]
        arguments += ["--target-landmarks", demo / "target-landmarks.ron"]
        arguments += ["--spine-out", WORK / "moved", "--transforms", WORK / "transforms"]
        arguments += ["--plan-out", WORK / "moved.mrk.json", "--json", result]
        run(*arguments, codes=(0, 3))
    transfer = json.loads(result.read_text())
    listed = json.loads((WORK / "transforms" / "transforms.json").read_text())

    probes = np.array([[0.0, 0.0, 0.0], [31.0, -47.0, 12.0], [-80.5, 3.25, 140.0]])
    for entry, in_list in zip(transfer["vertebrae"], listed["vertebrae"]):
        level = entry["level"]
        target_from_source = np.array(entry["target_from_source"])
        same(f"{level}: transforms.json", in_list["target_from_source"], target_from_source)
        itk = SimpleITK.ReadTransform(str(WORK / "transforms" / f"{level}.tfm"))
        # ITK goes from the fixed to the moving points: from the target to the source, in LPS.
        on_target = apply(LPS, apply(target_from_source, probes))
        back = [itk.TransformPoint(p.tolist()) for p in on_target]
        same(f"{level}.tfm: target to source", back, apply(LPS, probes), 1e-9)

        source = trimesh.load(demo / "source" / f"{level}.ply", process=False)
        moved = apply(target_from_source, source.vertices)
        ply = trimesh.load(WORK / "moved" / f"{level}.ply", process=False)
        same(f"{level}.ply by trimesh: vertices", ply.vertices, moved, 1e-9)
        same(f"{level}.ply by trimesh: faces", ply.faces, source.faces)
        points = meshio.read(WORK / "moved" / f"{level}.ply").points
        same(f"{level}.ply by meshio: vertices", points, ply.vertices)
        exact = ply.vertices
        points, faces, space = read_vtp(WORK / "moved" / f"{level}.vtp")
        same(f"{level}.vtp by VTK: vertices", points, exact)
        same(f"{level}.vtp by VTK: faces", faces, source.faces)
        if space != "RAS":
            sys.exit(f"{level}.vtp: SPACE is {space}")
        rounded = exact.astype(np.float32)
        points, faces = read_glb(WORK / "moved" / f"{level}.glb")
        same(f"{level}.glb by trimesh: vertices", points, rounded)
        same(f"{level}.glb by trimesh: faces", faces, source.faces)
        stl = trimesh.load(WORK / "moved" / f"{level}.stl", process=False)
        same(f"{level}.stl by trimesh", stl.triangles, rounded[source.faces])
        stl = meshio.read(WORK / "moved" / f"{level}.stl")
        corners = stl.points[stl.cells_dict["triangle"]]
        same(f"{level}.stl by meshio", corners, rounded[source.faces])

    imported = WORK / "imported-glb"
    files = [WORK / "moved" / f"{level}.glb" for level in LEVELS]
    run("import", *files, "--frame", "RAS", "-o", imported)
    for level in LEVELS:
        ours = trimesh.load(imported / f"{level}.ply", process=False)
        exact = trimesh.load(WORK / "moved" / f"{level}.ply", process=False)
        same(f"{level}.glb by ourselves: vertices", ours.vertices, exact.vertices.astype(np.float32))
        same(f"{level}.glb by ourselves: faces", ours.faces, exact.faces)

    lines = read_markups(WORK / "moved.mrk.json")
    for line, t in zip(lines, transfer["trajectories"], strict=True):
        if (line["type"], line["coordinateSystem"]) != ("Line", "LPS"):
            sys.exit(f"moved.mrk.json: {line['type']} in {line['coordinateSystem']}")
        if line["name"] != f"{t['level']}_{t['side']}":
            sys.exit(f"moved.mrk.json: the name {line['name']}")
        points = [point["position"] for point in line["controlPoints"]]
        same(f"moved.mrk.json: {line['name']}", points, apply(LPS, [t["entry_mm"], t["tip_mm"]]))


# --- plans and landmarks ------------------------------------------------------------------


def markups():
    fcsv = WORK / "landmarks.fcsv"
    points = {level: [1.5 * i - 3.0, -60.25 + i, 54.125 - 27.0 * i] for i, level in enumerate(LEVELS)}
    for system in ["LPS", "RAS", "0", "1"]:
        rows = [f"{i},{x},{y},{z},0,0,0,1,1,1,0,{level},," for i, (level, (x, y, z)) in enumerate(points.items())]
        fcsv.write_text(
            f"# Markups fiducial file version = 4.11\n# CoordinateSystem = {system}\n"
            "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n" + "\n".join(rows) + "\n"
        )
        theirs = slicerio.fcsv_to_markups_json(fcsv, WORK / "theirs.mrk.json")
        run("convert", theirs, WORK / "ours.json", "--force")
        found = json.loads((WORK / "ours.json").read_text())["landmarks"]
        signs = [-1.0, -1.0, 1.0] if system in ("LPS", "1") else [1.0, 1.0, 1.0]
        for landmark in found:
            expected = np.array(points[landmark["level"]]) * signs
            same(f"slicerio {system} {landmark['level']}", landmark["position_mm"], expected)
        run("convert", WORK / "ours.json", WORK / "back.mrk.json", "--force")
        written = read_markups(WORK / "back.mrk.json")[0]
        for point in written["controlPoints"]:
            expected = np.array(points[point["label"]]) * signs * [-1.0, -1.0, 1.0]
            same(f"back {system} {point['label']}", point["position"], expected)

    plan = FIXTURES / "plan.ron"
    run("convert", plan, WORK / "plan.mrk.json", "--spine", FIXTURES)
    read_markups(WORK / "plan.mrk.json")
    run("convert", WORK / "plan.mrk.json", WORK / "plan.json", "--spine", FIXTURES)
    run("convert", plan, WORK / "direct.json")
    if (WORK / "plan.json").read_bytes() != (WORK / "direct.json").read_bytes():
        sys.exit("a plan changes on its way through Markups")
    # The same numbers called RAS are outside of the spine.
    text = (WORK / "plan.mrk.json").read_text().replace('"LPS"', '"RAS"')
    (WORK / "wrong.mrk.json").write_text(text)
    run("convert", WORK / "wrong.mrk.json", WORK / "wrong.json", "--spine", FIXTURES, codes=(2,))


# --- files of theirs, for our readers ---------------------------------------------------------


def write_vtp(path, vertices, faces, mode, compress, header, space):
    data = vtkPolyData()
    points = vtkPoints()
    points.SetData(numpy_to_vtk(vertices, deep=True))
    data.SetPoints(points)
    cells = vtkCellArray()
    offsets = np.arange(0, 3 * len(faces) + 1, 3, dtype=np.int64)
    cells.SetData(numpy_to_vtkIdTypeArray(offsets, deep=True), numpy_to_vtkIdTypeArray(faces.ravel(), deep=True))
    data.SetPolys(cells)
    name = vtkStringArray()
    name.SetName("SPACE")
    name.InsertNextValue(space)
    data.GetFieldData().AddArray(name)
    writer = vtkXMLPolyDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    {"ascii": writer.SetDataModeToAscii, "binary": writer.SetDataModeToBinary}.get(
        mode, writer.SetDataModeToAppended
    )()
    writer.SetEncodeAppendedData(mode == "base64")
    if compress:
        writer.SetCompressorTypeToZLib()
        writer.SetBlockSize(32768)
    else:
        writer.SetCompressorTypeToNone()
    (writer.SetHeaderTypeToUInt64 if header == 64 else writer.SetHeaderTypeToUInt32)()
    if not writer.Write():
        sys.exit(f"VTK cannot write {path}")


def theirs():
    folder = WORK / "theirs"
    folder.mkdir()
    source = trimesh.load(FIXTURES / "L3.ply", process=False)
    vertices, faces = np.array(source.vertices), np.array(source.faces, np.int64)
    files = []

    def left(name, precision, space=None):
        files.append({"name": name, "precision": precision, "space": space})

    for mode in ["ascii", "binary", "raw", "base64"]:
        for compress in [False, True]:
            for header in [32, 64]:
                name = f"{mode}-{compress}-{header}.vtp".lower()
                write_vtp(folder / name, vertices, faces, mode, compress, header, "LPS")
                # VTK's own text keeps 11 digits or more.
                left(name, 1e-6 if mode == "ascii" else 0.0, "LPS")
    write_vtp(folder / "f32.vtp", vertices.astype(np.float32), faces, "binary", True, 64, "RAS")
    left("f32.vtp", "f32", "RAS")
    mesh = meshio.Mesh(vertices, [("triangle", faces)])
    meshio.write(folder / "meshio.ply", mesh, binary=True)
    left("meshio.ply", 0.0)
    meshio.write(folder / "meshio-ascii.ply", mesh, binary=False)
    left("meshio-ascii.ply", 0.0)
    meshio.write(folder / "meshio.obj", mesh)
    left("meshio.obj", 1e-6)
    source.export(folder / "trimesh.ply")
    left("trimesh.ply", "f32")
    source.export(folder / "trimesh.glb")
    left("trimesh.glb", "f32")
    source.export(folder / "trimesh.obj")
    left("trimesh.obj", 1e-6)
    source.export(folder / "trimesh.off")
    left("trimesh.off", 1e-6)

    generator = np.random.default_rng(20260101)
    transforms = []
    for index in range(3):
        affine = SimpleITK.AffineTransform(3)
        affine.SetMatrix(generator.normal(size=9).tolist())
        affine.SetTranslation(generator.normal(scale=100.0, size=3).tolist())
        affine.SetCenter(generator.normal(scale=100.0, size=3).tolist())
        name = f"{index}.tfm"
        SimpleITK.WriteTransform(affine, str(folder / name))
        probe = generator.normal(scale=50.0, size=3).tolist()
        transforms.append({"name": name, "point": probe, "image": affine.TransformPoint(probe)})
    document = {
        "vertices": vertices.tolist(),
        "faces": faces.tolist(),
        "meshes": files,
        "transforms": transforms,
    }
    (WORK / "theirs.json").write_text(json.dumps(document))


label_maps()
transfers()
markups()
theirs()
print(f"{N_CHECKS} comparisons of what other readers find in our files")
