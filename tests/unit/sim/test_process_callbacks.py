"""Several native callbacks of the process: installed together or not at all, missed by name."""

import gc
from collections.abc import Iterator
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from numba import types

from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import HydrodynamicsError
from uuv.sim.interfaces.kernels import c_function
from uuv.sim.water import process_callbacks
from uuv.sim.water.process_callbacks import NativeCallback

PUSHED = """
<mujoco>
  <worldbody> <body> <joint name="j" type="slide"/> <geom size=".1"/> </body> </worldbody>
  <actuator> <general joint="j" biastype="user"/> </actuator>
</mujoco>
"""
PUSH = 3.25  # [N]


def _push() -> object:
    @c_function(types.float64(types.intp, types.intp, types.int32))
    def push(_model: int, _data: int, _actuator: int) -> float:
        return 3.25

    return push


PUSHING = NativeCallback(
    name="actuator bias",
    source=SimpleNamespace(MODEL_FIELDS=("nv",), DATA_FIELDS=("qvel",), SYMBOLS=(), build=_push),
    set=mujoco.set_mjcb_act_bias,
    get=mujoco.get_mjcb_act_bias,
    without="nothing is pushed",
)


@pytest.fixture(autouse=True)
def two_callbacks(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    hydrodynamics.uninstall()
    monkeypatch.setattr(process_callbacks, "CALLBACKS", (*process_callbacks.CALLBACKS, PUSHING))
    yield
    hydrodynamics.uninstall()
    mujoco.set_mjcb_passive(None)
    mujoco.set_mjcb_act_bias(None)


def pushed() -> np.ndarray:
    model = mujoco.MjModel.from_xml_string(PUSHED)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return np.array(data.qfrc_actuator)


def test_all_are_installed_and_removed_together():
    hydrodynamics.install()
    assert hydrodynamics.is_installed()
    assert pushed() == PUSH
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
    with pytest.warns(RuntimeWarning, match="actuator bias callback .* nothing is pushed") as said:
        mujoco.set_mjcb_act_bias(other)
    assert said[0].filename == __file__
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
