"""A job on an object of its own: a slab with a closed path."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import trimesh

from uuv import Scenario, jobs
from uuv.models.objects.target_model import TargetModel
from uuv.perception.toolpath.path_shapes import laid_on, line


def slab() -> TargetModel:
    """A slab with two blocks, by which its attitude is known; axes of the mesh, z up [m]."""
    mesh = (
        trimesh.creation.box((0.8, 0.6, 0.2))
        + trimesh.creation.box((0.12, 0.2, 0.16)).apply_translation((0.32, 0.16, 0.12))
        + trimesh.creation.box((0.08, 0.3, 0.12)).apply_translation((-0.34, -0.1, 0.12))
    )
    model = TargetModel(name="slab", vertices=mesh.vertices, triangles=mesh.faces)
    corners = 0.08 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]])
    sides = [line(a, b)[:-1] for a, b in pairwise(corners)]  # no point twice
    curve = np.vstack([*sides, corners[-1:]])
    return model.with_path("square", laid_on(model, curve, [0.0, 0.0, -1.0]))  # from above


@jobs.job
def square(*, force: float = 20.0) -> Scenario:
    """Press along a square on a slab.

    Args:
        force: Set force [N].
    """
    scenario = jobs.clean_object(object="square:slab", path="square", forces=(force,))
    return replace(scenario, name="square")
