"""The benchmark of unseen objects against other libraries: figures are those of its rows, absent
peers are named.
"""

import json
from pathlib import Path
from statistics import median

import numpy as np
import pytest

from experiments.identification.registration_peers import PEERS, Model, RegistrationTask
from uuv.experiment import read_rows
from uuv.sim.interfaces.spatial import exp_so3, inverse, pose, rotation_from_z, transform_points


@pytest.mark.long
def test_two_scenes_with_the_peers_that_are_installed(script, tmp_path: Path):
    quick = ("icp", "small_gicp", "fpfh")
    run = script(
        "experiments.identification.unseen.unseen_peers",
        "--present",
        2,
        "--workers",
        1,
        "--seed",
        7,
        "--out",
        tmp_path,
        "--peers",
        *quick,
    )
    assert run.returncode == 0, run.stderr
    there = [PEERS[name].title for name in quick if not PEERS[name].missing]
    for name in quick:
        if missing := ", ".join(PEERS[name].missing):
            assert f"left out: {PEERS[name].title}, not installed: {missing}" in run.stdout

    rows = read_rows(tmp_path)
    figures = json.loads((tmp_path / "metrics.json").read_text())["Poses found, and time"]
    assert len(rows) == 2
    assert set(figures) == {"ours", *there}
    for name, of_method in figures.items():
        assert of_method["found"]["good"] == sum(row["found"][name] for row in rows)
        assert of_method["error raised"]["count"] == 0
        median_time = median(row["time"][name] for row in rows)
        assert of_method["time, median"]["median"] == pytest.approx(median_time)
    assert figures["ours"]["found"]["good"] == 2


@pytest.mark.parametrize("name", PEERS)
def test_a_peer_finds_three_blocks_without_noise(name: str):
    """A registration returns the pose of T in S, not its inverse, and refines it."""
    peer = PEERS[name]
    if peer.missing:
        pytest.skip(f"not installed: {', '.join(peer.missing)}")
    model = _three_blocks(np.random.default_rng(1))
    # one of the views in which KISS-Matcher sees the model
    R_TS = rotation_from_z(-np.ones(3), np.eye(3)[0])
    X_ST = pose(R_TS.T, [0.0, 0.0, 1.2])
    center = transform_points(X_ST, model.center)
    R = X_ST[:3, :3] @ exp_so3([0.0, 0.1, 0.0])
    points, normals = transform_points(X_ST, model.points), model.normals @ X_ST[:3, :3].T
    seen = np.einsum("ni,ni->n", points, normals) < 0.0
    task = RegistrationTask(
        points=points[seen],
        normals=normals[seen],
        sigma=0.001,
        model=model,
        approach=center + np.array([0.1, 0.0, 0.1]),
        approach_error=0.3,
        X_near=pose(R, center - R @ model.center),
        seed=0,
    )
    peer.load()
    X = peer.register(task, peer.prepare(model))
    off = inverse(X_ST) @ X
    assert np.linalg.norm(off[:3, 3]) < 0.01
    assert np.trace(off[:3, :3]) > 1.0 + 2.0 * np.cos(np.deg2rad(2.0))


def _three_blocks(rng: np.random.Generator) -> Model:
    """Surface of three blocks of different sizes that run into each other: no symmetry."""
    points, normals = [], []
    blocks = (
        ((0.0, 0.0, 0.0), (0.4, 0.1, 0.1)),
        ((0.12, 0.14, 0.0), (0.1, 0.3, 0.06)),
        ((-0.15, 0.0, 0.14), (0.06, 0.08, 0.25)),
    )
    for middle, size in blocks:
        sides = np.array(size)
        for axis in range(3):
            for sign in (-1.0, 1.0):
                area = np.prod(np.delete(sides, axis))
                p = (rng.random((int(area * 4e4), 3)) - 0.5) * sides
                p[:, axis] = 0.5 * sign * sides[axis]
                points.append(p + middle)
                normals.append(np.tile(sign * np.eye(3)[axis], (len(p), 1)))
    p = np.vstack(points)
    return Model(
        points=p, normals=np.vstack(normals), spacing=0.005, radius=0.32, center=np.zeros(3)
    )
