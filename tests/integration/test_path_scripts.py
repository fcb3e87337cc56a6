"""What jobs on fouled, dented and free-form objects are made of, without running them."""

import sys
from pathlib import Path

import numpy as np
import pytest

from models import open3d_loader
from models.targets import barrel
from sim.interfaces.errors import ConfigurationError

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))

import clean_barrel
import clean_object
import study_paths


@pytest.mark.parametrize("name", list(study_paths.CASES))
def test_true_objects_lie_off_their_models_where_they_should(name: str):
    """Bumps out of the shell or dents in it, of the size asked for, around the paths, and nothing else."""
    case = study_paths.CASES[name]
    true = case.true(np.random.default_rng(1), *case.bumps)
    scene = open3d_loader.ray_scene(case.known.vertices, case.known.triangles)
    tensor = open3d_loader.load().core.Tensor(np.asarray(true.vertices, dtype=np.float32))
    off = scene.compute_signed_distance(tensor).numpy() * np.sign(case.bumps[0])
    assert off.min() > -1e-3  # the sagitta of a side, and of what lies between rings
    assert abs(case.bumps[0]) - 1e-3 < off.max() < abs(case.bumps[1]) + 1e-3
    near = np.linalg.norm(true.vertices[off > 0.005][:, None] - study_paths._points(case.paths), axis=-1).min(axis=1)
    assert near.max() < 0.45


@pytest.mark.parametrize(("fouled", "dented"), [(0.03, 0.0), (0.0, 0.03), (0.02, 0.02)])
def test_job_on_what_the_sea_has_left(fouled: float, dented: float):
    """The vehicle knows the clean barrel; what stands there lies off it along the path, both ways where both are."""
    job = clean_barrel.barrel_job(clean_barrel.Options(fouled=fouled, dented=dented), np.random.default_rng(1))
    assert job.there is not None
    scene = open3d_loader.ray_scene(job.target.vertices, job.target.triangles)
    tensor = open3d_loader.load().core.Tensor(np.asarray(job.there.vertices, dtype=np.float32))
    off = scene.compute_signed_distance(tensor).numpy()
    off, near = off[np.abs(off) > 0.004], job.there.vertices[np.abs(off) > 0.004]
    assert np.linalg.norm(near[:, None] - job.target.path(job.path).p[::10], axis=-1).min(axis=1).max() < 0.3
    for height, sign in ((fouled, 1.0), (dented, -1.0)):
        assert (0.3 * height - 1e-3 < (sign * off).max() < height + 1e-3) if height else (sign * off).max() < 1e-3


def test_clean_job_has_nothing_else_there():
    assert clean_barrel.barrel_job(clean_barrel.Options(), np.random.default_rng(1)).there is None
    with pytest.raises(ConfigurationError, match="--fouled"):
        clean_barrel.barrel_job(clean_barrel.Options(fouled=-0.01), np.random.default_rng(1))
    with pytest.raises(ConfigurationError, match="--looks"):
        clean_barrel.barrel_job(clean_barrel.Options(looks=0), np.random.default_rng(1))


def test_mesh_file_gets_a_path_over_its_top(tmp_path: Path, within):
    o3d, known = open3d_loader.load(), barrel()
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(np.array(known.vertices)),
        o3d.utility.Vector3iVector(np.array(known.triangles, dtype=np.int32)),
    )
    file = tmp_path / "drum.ply"
    o3d.io.write_triangle_mesh(str(file), mesh)
    job = clean_object.object_job(clean_object.Options(object=str(file)), np.random.default_rng(0))
    path = job.target.path(job.path)
    within("on the top [m]", path.p[:, 2] - 0.3, 1e-4)
    within("length [m]", np.ptp(path.p[:, 0]) - 0.3, 1e-6)
    within("axis", path.a - [0.0, 0.0, -1.0], 1e-2)


def test_rock_is_worked_along_its_own_path():
    job = clean_object.object_job(clean_object.Options(path="across"), np.random.default_rng(0))
    assert job.target.name == "rock"
    assert job.path == "across"
    with pytest.raises(ConfigurationError, match="no path 'under'"):
        clean_object.object_job(clean_object.Options(path="under"), np.random.default_rng(0))
