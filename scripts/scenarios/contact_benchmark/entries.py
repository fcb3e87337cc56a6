"""Entries of the benchmark: controllers by name, those that it begins with, and those of users with estimators."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import get_args

from scenarios.scenario import Control, Method
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import shown

ENTRIES: Mapping[str, Control] = {
    "default": Control(),
    "normal-force-law": Control(published=("normal-force-law",)),
    **{f"without {method}": Control(without=(method,)) for method in get_args(Method)},
    "joint PD": Control(controller="controllers.joint_force_controller:JointForceController"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A controller that is scored, with the estimator that it brings."""

    name: str
    control: Control
    estimator: str = ""  # MODULE:CLASS; empty: the estimates are the ones that all other entries get
    source: str = ""  # digest of its modules' files; the results of a changed one are not taken for its own

    @classmethod
    def of(cls, name: str, estimator: str = "") -> "Entry":
        """The entry of a name of ENTRIES, a registered name or MODULE:CLASS.

        Args:
            name: Of the controller.
            estimator: MODULE:CLASS of the estimator that it brings; empty: none.

        Raises:
            ConfigurationError: The name is empty, or there is no such module.
        """
        control = ENTRIES.get(name) or Control(controller=name)
        module, colon, word = control.controller.partition(":")
        if not module or (colon and not word):
            known = ", ".join(ENTRIES)
            raise ConfigurationError(f"--entry: allowed {known}, a registered name or MODULE:CLASS, got {shown(name)}")
        source = _digest(module, "--entry") if colon else ""
        if estimator:
            home, _, brought = estimator.partition(":")
            if not (home and brought):
                raise ConfigurationError(f"--estimator: expected MODULE:CLASS, got {shown(estimator)}")
            source += _digest(home, "--estimator")
            name += f" with {estimator}"
        return cls(name=name, control=control, estimator=estimator, source=source)


def _digest(module: str, option: str) -> str:
    """Digest of the file of a module that is not imported here."""
    try:
        spec = find_spec(module)
    except (ImportError, ValueError) as error:
        raise ConfigurationError(f"{option}: there is no module {shown(module)}") from error
    if spec is None or spec.origin is None or not Path(spec.origin).is_file():
        raise ConfigurationError(f"{option}: there is no module {shown(module)}")
    return hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest()[:16]
