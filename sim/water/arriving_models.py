"""Models that reach a process without being compiled there bring the callbacks that they need.

A pickled model installs them where it is unpickled, and an MJB where it is loaded. MuJoCo tells
nobody of a model that is loaded, and cannot compile one while a callback in Python waits for it;
therefore its reader of MJB is replaced, once this module is imported.
"""

import copyreg
from functools import wraps
from typing import Any

import mujoco

from uuv.sim.water import process_callbacks


def _reduced(stored: Any) -> Any:
    """Reducer for pickle, of a model or of data."""
    model = stored if isinstance(stored, mujoco.MjModel) else stored.model
    if not process_callbacks.needed_by(model):
        return stored.__reduce_ex__(2)
    return _restored, (type(stored), stored.__getstate__())


def _restored(kind: Any, state: Any) -> Any:
    process_callbacks.install()
    stored: Any = kind.__new__(kind)
    stored.__setstate__(state)
    return stored


@wraps(mujoco.MjModel.from_binary_path)
def _from_binary_path(*args: Any, **kwargs: Any) -> mujoco.MjModel:
    """A model from an MJB, with the callbacks that it needs."""
    model = _load_binary(*args, **kwargs)
    if process_callbacks.needed_by(model):
        process_callbacks.install()
    return model


_load_binary = mujoco.MjModel.from_binary_path
mujoco.MjModel.from_binary_path = staticmethod(_from_binary_path)
copyreg.pickle(mujoco.MjModel, _reduced)
copyreg.pickle(mujoco.MjData, _reduced)
