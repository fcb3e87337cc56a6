"""Entries of the benchmark: its own controllers by name, and users' controllers, with or without
estimators.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import get_args

from uuv.experiment.loaded_code import digests, file_of
from uuv.kinds import CONTROLLERS
from uuv.methods import Method
from uuv.scenario import Control
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.spatial import shown

ENTRIES: Mapping[str, Control] = {
    "default": Control(),
    "normal-force-law": Control(published=("normal-force-law",)),
    **{f"without {method}": Control(without=(method,)) for method in get_args(Method)},
    "joint PD": Control(
        controller="uuv.controllers.whole_body.joint_force_controller:JointForceController"
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A controller that is scored, with its estimator if it has one."""

    name: str
    control: Control
    # MODULE:CLASS; empty: the entry gets the same estimates as all others
    estimator: str = ""
    # digests of the files of its classes, so that results of a changed entry are not attributed to
    # this one
    source: str = ""

    @classmethod
    def of(cls, name: str, estimator: str = "") -> "Entry":
        """The entry with a name in ENTRIES, a registered name or MODULE:CLASS.

        Args:
            name: Name of the controller.
            estimator: MODULE:CLASS of its estimator; empty: none.

        Raises:
            ConfigurationError: No controller has that name, or there is no such module.
        """
        control = ENTRIES.get(name) or Control(controller=name)
        module, colon, word = control.controller.partition(":")
        if not module or (colon and not word):
            known = ", ".join(ENTRIES)
            raise ConfigurationError(
                f"--entry: allowed {known}, a registered name or MODULE:CLASS, got {shown(name)}"
            )

        if not colon and module not in CONTROLLERS:
            known = tuple(dict.fromkeys((*ENTRIES, *CONTROLLERS.names())))
            allowed = f"{', '.join(known)}, or MODULE:CLASS"
            meant = did_you_mean(name, known)
            raise ConfigurationError(f"--entry: must be one of {allowed}, got {shown(name)}{meant}")

        if estimator:
            home, _, brought = estimator.partition(":")
            if not (home and brought):
                raise ConfigurationError(
                    f"--estimator: expected MODULE:CLASS, got {shown(estimator)}"
                )
            name += f" with {estimator}"

        code = _code(control, estimator)
        return cls(name=name, control=control, estimator=estimator, source="".join(code.values()))

    def code(self) -> dict[str, str]:
        """Digests of the files of its classes, by name as in `loaded_code.loaded_files`."""
        return _code(self.control, self.estimator)


def _code(control: Control, estimator: str) -> dict[str, str]:
    """Digests of the files of the modules, which are not imported here."""
    digests_of: dict[str, str] = {}
    for option, named in (("--entry", control.controller), ("--estimator", estimator)):
        module, colon, _ = named.partition(":")
        if not colon:
            continue
        try:
            digests_of |= digests([file_of(module)])
        except ImportError as error:
            raise ConfigurationError(f"{option}: there is no module {shown(module)}") from error
    return digests_of
