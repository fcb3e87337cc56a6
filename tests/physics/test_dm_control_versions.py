"""Which parts of dm_control run on this MuJoCo: on 3 all, on 4 all but its physics; the doors say so in one line.

`.ci/run` runs this folder on both.
"""

from importlib import import_module

import mujoco
import numpy as np
import pytest

from sim.interfaces.errors import MissingLibraryError
from sim.interfaces.extras import DM_CONTROL_RUNS

pytest.importorskip("dm_control", reason="not installed here", exc_type=ImportError)
NEWER = int(mujoco.__version__.partition(".")[0]) > DM_CONTROL_RUNS


@pytest.mark.parametrize("part", ["rl.control", "utils.rewards", "mjcf", "composer"])
def test_is_imported(part: str):
    import_module(f"dm_control.{part}")


def test_the_older_door_steps():
    from sim.environment import hover

    environment = hover(seed=0, time_limit=0.1)
    moment = environment.reset()
    while not moment.last():
        moment = environment.step(np.zeros(6))
    assert np.all(np.isfinite(moment.observation["position"]))


def test_physics():
    from dm_control import mjcf

    root = mjcf.RootElement()
    root.worldbody.add("geom", type="sphere", size=[0.1])
    if NEWER:
        with pytest.raises(AttributeError):
            mjcf.Physics.from_mjcf_model(root)
    else:
        mjcf.Physics.from_mjcf_model(root).step()


def test_the_door_of_composer():
    if NEWER:
        with pytest.raises(MissingLibraryError, match=r"physics, which runs on MuJoCo 3 \(here 4"):
            import_module("scenarios.composer")
    else:
        import_module("scenarios.composer")
