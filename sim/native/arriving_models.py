"""Models that enter a process without being compiled there install the callbacks that they need.

The callbacks are installed when a model is unpickled or loaded from a file. MuJoCo gives no notice
of a model that is loaded, and numba cannot compile a callback inside a callback of MuJoCo.
Therefore the import of this module replaces MuJoCo's readers of MJB and MJCF.
"""

import copyreg
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec

import mujoco

from uuv.sim.native import process_callbacks

P = ParamSpec("P")


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


def _bringing(load: Callable[P, mujoco.MjModel]) -> Any:
    """Wraps a function of MuJoCo that loads a model, and installs the callbacks that the model
    needs.
    """

    @wraps(load)
    def loaded(*args: P.args, **kwargs: P.kwargs) -> mujoco.MjModel:
        model = load(*args, **kwargs)
        if process_callbacks.needed_by(model):
            process_callbacks.install()
        return model

    return staticmethod(loaded)


for _name in ("from_binary_path", "from_xml_path", "from_xml_string"):
    setattr(mujoco.MjModel, _name, _bringing(getattr(mujoco.MjModel, _name)))
copyreg.pickle(mujoco.MjModel, _reduced)
copyreg.pickle(mujoco.MjData, _reduced)
