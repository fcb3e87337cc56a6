"""Actuators of thrusters: what MuJoCo would apply otherwise than as the thrust is refused by
name.
"""

import re
from typing import Any

import mujoco
import numpy as np
import pytest

from uuv.models.water import thrusters
from uuv.models.water.thrusters import Thruster
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.sensors import proprioception


def spec(actuator: str) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(f"""
    <mujoco><worldbody><body name="hull"><freejoint/><geom size=".1" mass="10"/>
      <site name="screw"/><site name="other"/></body>
      <body name="post"><joint name="hinge"/><geom size=".1"/></body></worldbody>
      <actuator><general name="screw" {actuator}/></actuator></mujoco>""")


ODD = [
    ('site="screw" ctrlrange="-5 5"', "ctrlrange"),
    ('site="screw" forcerange="-5 5"', "forcerange"),
    ('site="screw" gainprm="2"', "gainprm"),
    ('site="screw" biastype="affine" biasprm="3"', "biastype"),
    ('site="screw" dyntype="filter" dynprm=".5"', "dyntype"),
    ('site="screw" refsite="other"', "refsite"),
    ('joint="hinge"', "trntype"),
    ('site="screw" gear="0 3 0 0 0 0"', "gear of length 1"),
    ('site="screw" gear="1 0 0 0.1 0 0"', "torque"),
]


@pytest.mark.parametrize("torque", [0.0, 0.02])
@pytest.mark.parametrize(("actuator", "named"), ODD)
def test_an_actuator_that_is_no_plain_motor_is_refused_where_it_is_attached_and_where_it_is_read(
    actuator, named, torque
):
    thruster = Thruster(forward=50.0, reverse=40.0, torque_per_thrust=torque)
    with pytest.raises(ConfigurationError, match=rf"'screw'.*{named}"):
        thrusters.attach(spec(actuator), {"screw": thruster})
    late = spec(actuator)
    late.actuators[0].userdata = row = thrusters.pack(thruster)
    late.nuser_actuator = len(row)
    with pytest.raises(ConfigurationError, match=r"'screw'.*attach leaves it"):
        thrusters.read(late.compile())


def test_a_motor_along_any_axis_becomes_a_thruster_and_a_motor_again():
    fine = spec('site="screw" gear="0.6 0.8 0 0 0 0" ctrllimited="false" ctrlrange="-5 5"')
    thrusters.attach(fine, {"screw": Thruster(forward=50.0, reverse=40.0)})
    hydrodynamics.install()
    model = mujoco.MjSpec.from_string(fine.to_xml()).compile()
    assert thrusters.read(model)[0].tolist() == [0]
    assert model.actuator_ctrlrange.tolist() == [[-1.0, 1.0]]
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.5
    mujoco.mj_forward(model, data)
    assert data.actuator_force[0] == 12.5

    thrusters.detach(fine.actuators[0])
    model = fine.compile()
    data = mujoco.MjData(model)
    data.ctrl[0] = 40.0
    mujoco.mj_forward(model, data)
    assert data.actuator_force[0] == 40.0


@pytest.mark.parametrize(
    ("name", "value", "named"),
    [
        ("actdim", 3, "activations"),
        ("biastype", mujoco.mjtBias.mjBIAS_NONE, "biastype"),
        ("ctrlrange", [-5.0, 5.0], "ctrlrange"),
        ("gear", [0.0, 3.0, 0.0, 0.0, 0.0, 0.0], "gear of length 1"),
        ("gear", [1.0, 0.0, 0.0, 0.1, 0.0, 0.0], "torque"),
    ],
)
def test_a_thruster_that_was_changed_afterwards_is_refused(name, value, named):
    late = spec('site="screw"')
    thrusters.attach(late, {"screw": Thruster(forward=50.0, reverse=40.0)})
    setattr(late.actuators[0], name, value)
    with pytest.raises(ConfigurationError, match=rf"'screw'.*{named}"):
        thrusters.read(late.compile())


@pytest.mark.parametrize("value", ["3", [3.0], 3j, 10**400, None, ((1.0,), (1.0, 2.0))])
def test_what_is_no_number_is_refused(value):
    figures: dict[str, Any] = {"forward": 3.0, "reverse": 3.0}
    for name in ("forward", "dead_band", "slew_rate", "handedness"):
        with pytest.raises(ConfigurationError, match=name):
            Thruster(**(figures | {name: value}))
    with pytest.raises(ConfigurationError, match="polynomial"):
        Thruster.of_polynomial([value, 3.0])
    with pytest.raises(ConfigurationError, match="table"):
        Thruster.of_table([-1.0, 0.0, value], [-1.0, 0.0, 1.0])
    with pytest.raises(ConfigurationError, match="neutral"):
        Thruster.of_table([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], neutral=value)
    with pytest.raises(ConfigurationError, match=re.escape("Dvl noise")):
        proprioception.Dvl(noise=value)
    assert Thruster(forward=np.float64(3.0), reverse=3) == Thruster(forward=3.0, reverse=3.0)
