"""What cameras see of a surface: sample by sample the same as by MuJoCo's rays."""

import numpy as np
import pytest

from mujoco_visibility import MujocoVisibility
from uuv.models.meshes.visibility import SurfaceSamples, View
from uuv.models.objects import targets
from uuv.sim.interfaces.spatial import exp_so3, pose, rotation_from_z

VIEW = View((0.58, 0.43), 2.2)


@pytest.mark.parametrize("name", ["barrel", "manifold", "valve"])
def test_each_sample_is_seen_as_by_another_ray_caster(name, rng, within):
    """Forty single cameras in all directions: at most one sample in 1000 is judged otherwise (none
    was).
    """
    target = targets.named(name)
    samples = SurfaceSamples(target.vertices, target.triangles)
    X_WT = pose(exp_so3(rng.normal(size=3)), rng.uniform(-3.0, 3.0, 3))
    judge = MujocoVisibility(target.vertices, target.triangles, X_WT)
    judge = judge.at(
        samples.points @ X_WT[:3, :3].T + X_WT[:3, 3], samples.normals @ X_WT[:3, :3].T
    )
    other, shares = [], []
    for way in rng.normal(size=(40, 3)):
        way /= np.linalg.norm(way)
        aim = target.center + rng.normal(scale=0.2, size=3)
        X_TC = pose(rotation_from_z(-way, rng.normal(size=3)), aim + rng.uniform(0.8, 2.0) * way)
        ours = samples.seen(X_TC[None], VIEW)
        theirs = judge.seen((X_WT @ X_TC)[None], VIEW.half_view, VIEW.far)
        other.append((ours != theirs).mean())
        shares.append(theirs.mean())
    within("judged otherwise, share of samples", other, 1e-3)
    assert 0.05 < np.mean(shares) < 0.5
