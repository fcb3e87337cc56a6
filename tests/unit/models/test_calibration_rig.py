"""A ball in a nest of three: one place only, exactly where the nest says, whichever way it came
in.
"""

import mujoco
import numpy as np
import pytest

from uuv.models.tools import touch_rig
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import rotation_from_z

WORLD = """<mujoco><option timestep="0.001" gravity="{gravity}"/><worldbody>
<body name="link" pos="{place}"><freejoint/><geom name="old" size=".05" mass="1"/><site name="tip"/>
<geom name="pad" size=".09" mass="0"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.4, -0.3, 0.8)])
def test_ball_finds_the_nest_from_aside(axis, within):
    rng = np.random.default_rng(1)
    z = np.array(axis) / np.linalg.norm(axis)
    point = np.array([0.3, -0.2, 0.5])
    R = rotation_from_z(axis, (1.0, 0.0, 0.0))
    seats = []
    for _ in range(4):
        aside = 0.018 * R[:, :2] @ rng.uniform(-0.7, 0.7, 2)
        p_ball = point + aside + 0.05 * z
        spec = mujoco.MjSpec.from_string(
            WORLD.format(gravity=" ".join(map(str, -9.81 * z)), place=" ".join(map(str, p_ball)))
        )
        touch_rig.add_pin(spec)
        touch_rig.add_nests(spec, [point], [z])
        model = spec.compile()
        assert model.ngeom == 6  # the old tool's two, the pin's ball, the nest's three
        assert model.body("link").mass[0] == 1.0  # as before
        model.dof_damping[:] = 2.0
        data = mujoco.MjData(model)
        data.qpos[:3] = p_ball
        mujoco.mj_step(model, data, nstep=6000)
        assert np.abs(data.qvel[:3]).max() < 1e-6
        assert len(data.contact) == 3
        seats.append(data.site("tip").xpos.copy())
    # Contact is soft: the ball sinks along the axis, by the same in every touch, and not aside.
    within("seats differ [m]", np.array(seats) - seats[0], 2e-10)  # 1e-11
    sunk = np.array(seats) - point
    within("aside [m]", sunk @ R[:, :2], 2e-10)  # 1e-11
    within("sunk [m]", sunk @ z, 4e-3)  # 4e-4, of the weight of a kilogram


def test_rig_needs_a_tip():
    with pytest.raises(ConfigurationError, match="no site 'tip'"):
        touch_rig.add_pin(mujoco.MjSpec.from_string("<mujoco><worldbody/></mujoco>"))
    with pytest.raises(ConfigurationError, match="z_WN"):
        touch_rig.add_nests(mujoco.MjSpec(), np.zeros((2, 3)), np.ones((1, 3)))
