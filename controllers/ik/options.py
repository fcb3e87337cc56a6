"""Options of the inverse kinematics, and their validation for the compiled loops."""

import math
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from uuv.controllers.ik import chain_kernels as kernels
from uuv.controllers.ik.chain import Chain
from uuv.controllers.ik.method import Method
from uuv.controllers.ik.pose_parts import PartTolerances, count_alike
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import number, one_of, real_array, shown, whole_number

Branch = Literal["free", "keep"]
Precision = Literal["double", "single"]
StageAxes = Literal["joint", "tip"]

METHODS = get_args(Method)
# largest number of iterations by default; sweeps are cheap
MOST: dict[str, int] = {"hybrid": 4000, "jacobian_free": 12000, "plain": 4000, "priority": 400}
_MOST_COUNTED = 10**9  # largest number of iterations or restarts that may be asked for
_MOST_THREADS = 1024  # largest number of threads that may be asked for
_MOST_KEPT = 10**6  # largest number of iterations in a history, which is allocated beforehand


@dataclass(frozen=True, slots=True, kw_only=True)
class IkOptions:
    """Options of `uuv.controllers.mkps.solve` and `solve_many` that few calls need.

    Raises:
        ConfigurationError: for an unknown word, or a number out of its range.
    """

    max_iterations: int | None = None  # default 4000, 12000 for "jacobian_free"
    max_restarts: int = 200  # "plain" makes none, nor does branch="keep"
    # Of `solve`: "single" iterates in four-byte numbers and tests the solution in double precision.
    precision: Precision = "double"
    # Of `solve`: also return the joint values after every iteration and their three goals [Danilov
    # 2021, fig. 9].
    history: bool = False
    threads: int | None = None  # of `solve_many`; default the cores that this process may use
    # (2,) [rad] of the stages F_alpha1 and F_alpha2 of "plain". By default the whole rotation is
    # then within `orientation_tolerance`. The other methods take the smaller of the two for the
    # whole rotation.
    stage_tolerances: tuple[float, float] | None = None
    # Axes that the stages of "plain" align. "tip": the tip's own z and x, as in [Danilov 2021].
    # "joint": the last joint's axis and one perpendicular to it; better for a tool that is oblique
    # to this axis, and without limits.
    stage_axes: StageAxes = "tip"
    usual: bool = field(init=False, repr=False)  # only the iterations and restarts are limited

    def __post_init__(self) -> None:
        one_of(self.precision, get_args(Precision), "precision")
        one_of(self.stage_axes, get_args(StageAxes), "stage_axes")
        if not isinstance(self.history, bool | np.bool_):
            raise ConfigurationError(f"history: must be True or False, got {shown(self.history)}")

        most, name = (
            (_MOST_KEPT, "max_iterations with history")
            if self.history
            else (_MOST_COUNTED, "max_iterations")
        )
        if self.max_iterations is not None:
            whole_number(self.max_iterations, name, least=1, most=most)
        whole_number(self.max_restarts, "max_restarts", most=_MOST_COUNTED)
        if self.threads is not None:
            whole_number(self.threads, "threads", least=1, most=_MOST_THREADS)

        if self.stage_tolerances is not None:
            both = real_array(self.stage_tolerances, "stage_tolerances [rad]", "two numbers")
            if both.shape != (2,):
                raise ConfigurationError(
                    f"stage_tolerances [rad]: expected two numbers, got shape {both.shape}"
                )
            for tolerance in both.tolist():
                _tolerance(tolerance, "stage_tolerances [rad]")

        usual = self.precision == "double" and not self.history and self.stage_tolerances is None
        object.__setattr__(self, "usual", usual)


class Tolerances(NamedTuple):
    """Tolerances as given to `uuv.controllers.mkps.solve`."""

    position: Any  # [m]
    orientation: Any  # [rad]
    axis: Any  # [rad] or None
    turn: Any  # [rad] or None


def solver_settings(
    chain: Chain, requested: Tolerances, method: str, branch: str, options: IkOptions
) -> tuple[kernels.Settings, PartTolerances | None]:
    """Validated options for the compiled loops; the parts are None unless they count apart.

    Raises:
        ConfigurationError: as `uuv.controllers.mkps.solve`.
    """
    one_of(method, METHODS, "method")
    one_of(branch, get_args(Branch), "branch")
    if not isinstance(options, IkOptions):
        raise ConfigurationError(f"options: expected IkOptions, got {shown(options)}")
    if method == "priority" and options.precision == "single":
        raise ConfigurationError(
            'precision: "priority" iterates in double precision only, got "single"'
        )

    tol_p = _tolerance(requested.position, "position_tolerance [m]")
    tol_r = _tolerance(requested.orientation, "orientation_tolerance [rad]")
    axis = tol_r if requested.axis is None else _tolerance(requested.axis, "axis_tolerance [rad]")
    turn = tol_r if requested.turn is None else _tolerance(requested.turn, "turn_tolerance [rad]")

    tol_1 = tol_2 = tol_r * 0.5**0.5
    if options.stage_tolerances is not None:
        tol_1, tol_2 = map(float, options.stage_tolerances)
        tol_r = min(tol_1, tol_2)  # a rotation error within this keeps both axes within theirs

    tol_r, parts = _by_method(chain, method, requested, Tolerances(tol_p, tol_r, axis, turn))
    settings = kernels.Settings(
        method=METHODS.index(method),
        tol_p=tol_p,
        tol_r=tol_r,
        tol_1=tol_1,
        tol_2=tol_2,
        limit=int(MOST[method] if options.max_iterations is None else options.max_iterations),
        restarts=int(options.max_restarts),
        keep=branch == "keep",
        tip_axes=options.stage_axes == "tip",
    )
    return settings, parts


def _by_method(
    chain: Chain, method: str, requested: Tolerances, tolerances: Tolerances
) -> tuple[float, PartTolerances | None]:
    """Rotation tolerance [rad] for a method, and the parts of the pose that count apart."""
    tol_p, tol_r, axis, turn = tolerances
    split = requested.axis is not None or requested.turn is not None

    counted = (
        {"axis_tolerance": axis, "turn_tolerance": turn}
        if split
        else {"orientation_tolerance": tol_r}
    )
    if tol_p == math.inf and all(angle >= math.pi for angle in counted.values()):
        raise ConfigurationError(
            f"position_tolerance, {', '.join(counted)}: at least one must be finite (an angle "
            "below pi), or no part of the pose counts"
        )

    if method == "hybrid":
        if split:
            return math.inf, PartTolerances(axis, turn)
        alike = count_alike(chain._scale, tol_p, tol_r)
        return tol_r, None if alike else PartTolerances(math.inf, math.inf)

    if method == "priority":
        if tol_p == math.inf:
            raise ConfigurationError(
                'position_tolerance: "priority" puts the position first, got inf; "hybrid" need not'
            )
        if requested.turn is not None and turn < math.pi:
            raise ConfigurationError(
                f'turn_tolerance: "priority" never counts the turn, got {turn:g}; "hybrid" does'
            )
        return axis, None

    if split or tol_p == math.inf or tol_r >= math.pi:
        raise ConfigurationError(
            f'method: {method!r} solves for whole poses; "hybrid" solves for a part of a pose, '
            "which an infinite tolerance, axis_tolerance or turn_tolerance ask for"
        )
    return tol_r, None


def _tolerance(value: Any, name: str) -> float:
    """Return `value` if it is > 0; infinity means that this error does not count."""
    tolerance = number(value, name)
    if not tolerance > 0.0:
        raise ConfigurationError(f"{name}: must be positive, got {tolerance:g}")
    return tolerance
