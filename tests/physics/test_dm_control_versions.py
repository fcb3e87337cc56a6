"""Which parts of dm_control run on this MuJoCo: on 3 all, on 4 all but its physics; the door says
so in one line.

`.ci/run` runs this folder on both. Each part is tried in a process of its own, for dm_control takes
MuJoCo's warnings away from the terminal, on which other tests here wait for them.
"""

import subprocess
import sys
from importlib.util import find_spec

import mujoco
import pytest

from uuv.sim.interfaces.extras import DM_CONTROL_RUNS

if find_spec("dm_control") is None:
    pytest.skip("dm_control is not installed here", allow_module_level=True)
NEWER = int(mujoco.__version__.partition(".")[0]) > DM_CONTROL_RUNS

_PARTS = """
import dm_control.rl.control, dm_control.composer
from dm_control import mjcf
from dm_control.utils import rewards
assert 0.0 < rewards.tolerance(0.3, bounds=(0.0, 0.1), margin=0.5) < 1.0
root = mjcf.RootElement()
root.worldbody.add("geom", name="ball", type="sphere", size=[0.1])
assert 'name="ball"' in root.to_xml_string()
"""
_PHYSICS = """
from dm_control import mjcf
root = mjcf.RootElement()
root.worldbody.add("geom", type="sphere", size=[0.1])
mjcf.Physics.from_mjcf_model(root).step()
"""
_DOOR = """
from uuv import environments as composer
composer.load("water", "hover", seed=0).reset()
"""


def ran(code: str) -> tuple[bool, str]:
    """Whether a piece of code ran in a process of its own, and the last line that it said."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    return done.returncode == 0, (done.stderr.strip().splitlines() or [""])[-1]


def test_parts_without_physics():
    worked, output = ran(_PARTS)
    assert worked, output


def test_physics():
    worked, output = ran(_PHYSICS)
    assert worked is not NEWER, output
    assert not NEWER or output.startswith("AttributeError")


def test_the_door_of_composer():
    worked, output = ran(_DOOR)
    assert worked is not NEWER, output
    assert not NEWER or "dm_control's physics, which runs on MuJoCo 3 (here 4" in output
