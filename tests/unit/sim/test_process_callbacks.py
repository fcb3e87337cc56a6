"""Several native callbacks of the process: installed together or not at all, missed by name."""

import gc
from collections.abc import Iterator

import mujoco
import pytest

from uuv.models.water import thrusters
from uuv.models.water.thrusters import Thruster
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import HydrodynamicsError
from uuv.sim.native import process_callbacks

THRUST = 40.0  # [N] at full speed


@pytest.fixture(autouse=True)
def none_installed() -> Iterator[None]:
    hydrodynamics.uninstall()
    yield
    hydrodynamics.uninstall()
    mujoco.set_mjcb_passive(None)
    mujoco.set_mjcb_act_bias(None)


def pushed() -> float:
    """Force [N] of a thruster at full speed."""
    spec = mujoco.MjSpec.from_string("""
    <mujoco>
      <worldbody> <body> <freejoint/> <geom size=".1"/> <site name="screw"/> </body> </worldbody>
      <actuator> <motor name="screw" site="screw"/> </actuator>
    </mujoco>""")
    thrusters.attach(spec, {"screw": Thruster(forward=THRUST, reverse=THRUST)})
    model = spec.compile()
    data = mujoco.MjData(model)
    data.ctrl[0] = 1.0
    mujoco.mj_forward(model, data)
    return float(data.actuator_force[0])


def test_all_are_installed_and_removed_together():
    hydrodynamics.install()
    assert hydrodynamics.is_installed()
    assert pushed() == THRUST
    hydrodynamics.uninstall()
    assert mujoco.get_mjcb_passive() is None
    assert mujoco.get_mjcb_act_bias() is None
    assert pushed() == 0.0


def test_a_foreign_one_is_refused_by_name_and_nothing_is_installed():
    mujoco.set_mjcb_act_bias(lambda _model, _data, _actuator: 1.0)
    with pytest.raises(HydrodynamicsError, match="another actuator bias callback is installed"):
        hydrodynamics.install()
    assert mujoco.get_mjcb_passive() is None
    hydrodynamics.uninstall()
    assert mujoco.get_mjcb_act_bias() is not None


@pytest.mark.parametrize("other", [None, lambda *_: 1.0], ids=["none", "foreign"])
def test_the_one_that_is_removed_is_named_at_once_and_missed(other):
    hydrodynamics.install()
    gc.collect()
    with pytest.warns(
        RuntimeWarning, match="actuator bias callback .* thrusters give no thrust"
    ) as warned:
        mujoco.set_mjcb_act_bias(other)
    assert warned[0].filename == __file__
    assert not hydrodynamics.is_installed()
    assert process_callbacks.missing()


def test_what_is_missing_is_put_back():
    hydrodynamics.install()
    with pytest.warns(RuntimeWarning):
        mujoco.set_mjcb_act_bias(None)
    passive = mujoco.get_mjcb_passive()
    hydrodynamics.install()
    assert hydrodynamics.is_installed()
    assert mujoco.get_mjcb_passive() is passive


def test_a_model_with_thrusters_alone_installs_them_and_names_what_it_lacks():
    spec = mujoco.MjSpec.from_string("""
    <mujoco>
      <worldbody> <body> <freejoint/> <geom size=".1"/> <site name="screw"/> </body> </worldbody>
      <actuator> <motor name="screw" site="screw"/> </actuator>
    </mujoco>""")
    thrusters.attach(spec, {"screw": Thruster(forward=THRUST, reverse=THRUST)})
    model = hydrodynamics.compile(spec)
    assert hydrodynamics.is_installed()
    assert hydrodynamics.check_installed(model)
    hydrodynamics.uninstall()
    with pytest.warns(
        RuntimeWarning, match="carries thrusters or soil but they give no force: call"
    ):
        assert not hydrodynamics.check_installed(model)
