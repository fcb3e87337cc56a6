"""Reader of mesh files: PLY and OFF natively, STL, OBJ, glTF and COLLADA by trimesh.

A file that cannot be read gives the same kind of error with every reader. Trimesh is used for
corners and faces only, without textures, merging or repair. PLY and OFF are read here, because
trimesh accepts truncated files of both, and does not read binary PLY that has triangles and larger
faces.
"""

import logging
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from uuv.models.meshes.ply_files import NO_SUCH_VERTEX, need_corners, read_ply
from uuv.models.meshes.surfel_files import TEXT
from uuv.sim.interfaces.errors import ConfigurationError, MissingLibraryError
from uuv.sim.interfaces.extras import wanted
from uuv.sim.interfaces.files import bytes_of
from uuv.sim.interfaces.spatial import Array

# formats by ending
FORMATS = {"stl": "STL", "ply": "PLY", "obj": "OBJ", "off": "OFF", "gltf": "glTF", "glb": "GLB"}
_READ = {**FORMATS, "dae": "COLLADA"}  # formats that only files of vehicles refer to
_SILENT = logging.NullHandler()


def read_mesh(file: Path, what: str = "target mesh") -> tuple[Array, np.ndarray]:
    """Read vertices (V, 3) and triangles (T, 3), T > 0, of a mesh file; parts are joined in place.

    Lengths are in the file's unit, or in metres for COLLADA, which states its unit. The axes of a
    COLLADA file are not changed. Faces with more corners are triangulated. Duplicate vertices are
    merged; degenerate faces and unused vertices are left out.

    Args:
        file: path.
        what: role of the file, as first words of error messages.

    Raises:
        ConfigurationError: the file is of another format, has no triangles, or is truncated or
            otherwise malformed.
    """
    kind = file.suffix.lower().removeprefix(".")
    if kind not in _READ:
        raise ConfigurationError(
            f"{what} {str(file)!r}: the formats are {', '.join(FORMATS.values())}, and for "
            f"clouds PCD and {', '.join(TEXT)}"
        )
    reader = {"ply": read_ply, "off": _read_off}.get(kind)

    try:
        vertices, triangles = reader(bytes_of(file, what)) if reader else _read_by_trimesh(file)
        need_corners(vertices, triangles)
        if not np.isfinite(vertices[triangles]).all():
            raise ValueError("a corner of a face is not finite")
    except (MemoryError, MissingLibraryError, ConfigurationError):
        # these errors do not mean a malformed file
        raise
    except Exception as error:  # a malformed file can raise anything in trimesh
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        if kind == "obj" and isinstance(error, IndexError):
            reason = NO_SUCH_VERTEX
        raise ConfigurationError(
            f"{what} {str(file)!r}: the file cannot be read as {_READ[kind]}: {reason}"
        ) from error

    vertices, triangles = _tidied(vertices, triangles)
    if not len(triangles):
        raise ConfigurationError(
            f"{what} {str(file)!r}: no triangles could be read (formats: "
            f"{', '.join(FORMATS.values())})"
        )
    return vertices, triangles


def _read_by_trimesh(file: Path) -> tuple[Array, np.ndarray]:
    with wanted():
        import trimesh

        if file.suffix.lower() == ".dae":
            import_module("collada")  # trimesh does not know this format without the package

    # otherwise it prints tracebacks of recovered errors
    logging.getLogger("trimesh").addHandler(_SILENT)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene: Any = trimesh.load_scene(
            str(file), file_type=file.suffix[1:].lower(), process=False, skip_materials=True
        )
        parts = [
            part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)
        ]

    # text such as "0.01 * meters", in which trimesh gives the unit of COLLADA
    factor, _, of_metres = str(scene.units).partition(" * ")
    unit = float(factor) if of_metres else 1.0

    # Parts are joined to one mesh, so indices of a part are offset by its first vertex.
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = [unit * np.asarray(part.vertices, dtype=np.float64) for part in parts]
    triangles = [
        np.asarray(part.faces, dtype=np.int64) + start
        for part, start in zip(parts, first, strict=False)
    ]
    return np.vstack([np.zeros((0, 3)), *vertices]), np.vstack(
        [np.zeros((0, 3), dtype=np.int64), *triangles]
    )


def _read_off(content: bytes) -> tuple[Array, np.ndarray]:
    """Read text OFF; normals or colours after the coordinates, which variants of OFF have, are
    ignored.
    """
    lines = [line.partition("#")[0].split() for line in content.decode("ascii").splitlines()]
    lines = [words for words in lines if words]
    if not lines or not lines[0][0].upper().endswith("OFF"):
        raise ValueError("it does not begin with 'OFF'")

    head = (lines[0][1:] or [*lines, []][1]) + ["-1", "-1"]
    body = lines[1:] if len(lines[0]) > 1 else lines[2:]
    points = int(head[0])
    faces = int(head[1])
    if min(points, faces) < 0:
        raise ValueError("its header states no vertices and faces")
    if len(body) < points + faces:
        raise ValueError(f"it is truncated: its header states {points} vertices and {faces} faces")

    vertices = np.array([[float(word) for word in words[:3]] for words in body[:points]]).reshape(
        -1, 3
    )
    corners = [
        [int(word) for word in words]
        for words in (row[: int(row[0]) + 1] for row in body[points:][:faces])
    ]
    if any(len(face) <= face[0] for face in corners):
        raise ValueError("a face has fewer corners than its first number states")

    fans = [(face[1], face[k], face[k + 1]) for face in corners for k in range(2, face[0])]
    return vertices, np.array(fans, dtype=np.int64).reshape(-1, 3)


def _tidied(vertices: Array, triangles: np.ndarray) -> tuple[Array, np.ndarray]:
    """Merge duplicate vertices; drop faces that use a vertex twice, and vertices that no face
    uses.
    """
    if not len(triangles):
        return vertices, triangles
    _, first, index = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    faces = first[index.ravel()][triangles]
    keep = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    used, faces = np.unique(faces[keep], return_inverse=True)
    return vertices[used], faces.reshape(-1, 3)
