"""Solids of objects: geoms of the shape that their word says, where their pose puts them."""

from typing import get_args

import mujoco
import numpy as np
import pytest

from uuv.models.objects.solid import Solid, SolidKind
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3, pose

X_TS = pose(exp_so3([0.3, -0.2, 0.5]), [0.1, -0.2, 0.3])


@pytest.mark.parametrize("kind", get_args(SolidKind))
def test_a_solid_is_a_geom_of_its_kind_at_its_pose(kind: SolidKind) -> None:
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="target", pos=[1.0, 2.0, -1.0], quat=[0.6, 0.0, 0.8, 0.0])
    Solid(name="part", kind=kind, size=(0.2, 0.1, 0.3), X_TS=X_TS).add_to(body)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)

    geom = model.geom("part")
    assert mujoco.mjtGeom(int(geom.type[0])).name == f"mjGEOM_{kind.upper()}"
    X_WT = pose(data.body("target").xmat.reshape(3, 3), data.body("target").xpos)
    X_WS = pose(data.geom("part").xmat.reshape(3, 3), data.geom("part").xpos)
    np.testing.assert_allclose(X_WS, X_WT @ X_TS, atol=1e-12)


def test_a_solid_of_another_kind_is_refused() -> None:
    allowed = "solid 'part': kind: allowed box, capsule, cylinder, ellipsoid, sphere, got 'boks'"
    with pytest.raises(ConfigurationError, match=allowed):
        Solid(name="part", kind="boks", size=(0.1, 0.1, 0.1), X_TS=X_TS)  # pyright: ignore[reportArgumentType]
