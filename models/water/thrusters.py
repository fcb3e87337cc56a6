"""Thruster model, command to thrust, stored on actuators of an MjSpec and evaluated by MuJoCo.

A command u in [-1, 1] is the normalised propeller speed (or pulse width) that is demanded. The
propeller follows within its slew rate and with a first-order lag. Its thrust is a static curve of
that speed, reduced by inflow: the bilinear model T = T_nn |n| n - T_nu |n| u_a [Fossen 2011].
Outside a dead band the curve is quadratic, a polynomial, or a table.

`attach` turns an actuator into a thruster. Its control is the command, its two activations are the
command after the slew limit and the propeller speed, and its force is the thrust in N. Its dynamics
and bias are of MuJoCo's type "user" and read their parameters from `actuator_user`
(`uuv.sim.native.actuator_dynamics`, `uuv.sim.native.thruster_force`).

The propeller's reaction torque on the hull about the thrust axis is proportional to the thrust. It
is stored in the actuator's gear, so that plant, allocation and MuJoCo use the same column.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Self

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.models.water.actuator_kinds import (
    DRIVEN,
    MOTOR,
    ROUNDED,
    check_kind,
    of_compiled,
    set_kind,
)
from uuv.models.water.measured_thruster import MeasuredThruster
from uuv.models.water.native_mark import mark
from uuv.models.water.t200_sheets import ESC, SHEETS
from uuv.models.water.thruster_sheets import Esc, Sheet, check_sheets
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number, number

# Columns of a row; the curve follows, as `uuv.models.water.thruster_curves` packs it.
FORWARD, REVERSE, DEAD_BAND, TIME_CONSTANT, INFLOW_LOSS, SLEW_RATE, TORQUE, LEAST, STAMP, COUNT = (
    range(10)
)
HEADER = 10  # number of columns before the curve; the measurements of the thruster follow the curve
STAMP_VALUE = 745530.0  # identifies rows of this layout among foreign user data

# Activations of a thruster: command after the slew limit, propeller speed
PASSED = 0  # index of the first activation
SPEED = 1  # index of the second activation
ACTIVATIONS = 2  # number of activations of a thruster

_ROWS = {"schema": {"title": "two rows of numbers", "items": {"title": "a row of numbers"}}}


@dataclass(frozen=True, slots=True, kw_only=True)
class Thruster(MeasuredThruster):
    """Parameters of one thruster: static curve, dynamics, inflow, reaction torque.

    With neither `polynomial` nor `table` (see `of_polynomial`, `of_table`) thrust is quadratic
    beyond the dead band.

    Raises:
        ConfigurationError: a figure is not finite or has the wrong sign, or the curve does not
            rise.
    """

    forward: float  # [N] thrust at command +1 in still water
    reverse: float  # [N] thrust magnitude at command -1 in still water
    # command magnitude below which thrust is zero, in [0, 1); a table has a dead band of its own
    dead_band: float = 0.0
    time_constant: float = 0.0  # [s] first-order lag of the propeller speed
    # [N]/[m/s] thrust lost at full speed per unit of inflow along the thrust
    inflow_loss: float = 0.0
    slew_rate: float = math.inf  # [1/s] largest rate of the command that the drive follows
    torque_per_thrust: float = 0.0  # [m] reaction torque about the thrust axis per thrust
    # +1: right-handed about the thrust axis for thrust ahead, so that the hull turns left-handed;
    # or -1
    handedness: int = 1
    # [N] least thrust of a turning propeller; smaller thrusts are impossible
    least_thrust: float = 0.0
    # [N] coefficients of r, r^2, ...: ahead, astern
    polynomial: tuple[tuple[float, ...], tuple[float, ...]] | None = field(
        default=None, metadata=_ROWS
    )
    # Commands, thrusts [N].
    table: tuple[tuple[float, ...], tuple[float, ...]] | None = field(default=None, metadata=_ROWS)
    voltage: float = 0.0  # [V] of the curve, within the sheets; 0 without sheets
    sheets: tuple[Sheet, ...] = ()  # thrust and current over the voltage, lowest voltage first
    esc: Esc | None = None  # from pulse width to command

    def __post_init__(self) -> None:
        for name in [entry.name for entry in fields(self) if entry.type is float]:
            object.__setattr__(self, name, number(getattr(self, name), f"thruster {name}"))
        for name in ("polynomial", "table"):
            object.__setattr__(self, name, _pair(getattr(self, name), name))

        for name in (
            "dead_band",
            "time_constant",
            "inflow_loss",
            "torque_per_thrust",
            "least_thrust",
        ):
            figure = getattr(self, name)
            if not (np.isfinite(figure) and figure >= 0.0):
                raise ConfigurationError(f"thruster {name}: must be finite and >= 0, got {figure}")

        if not self.dead_band < 1.0:
            raise ConfigurationError(f"thruster dead_band: must be in [0, 1), got {self.dead_band}")
        if not (
            np.isfinite([self.forward, self.reverse]).all()
            and self.forward > 0.0
            and self.reverse > 0.0
        ):
            raise ConfigurationError(
                f"thruster forward and reverse: must be > 0 N, got {self.forward}, {self.reverse}"
            )

        if not self.slew_rate > 0.0:
            raise ConfigurationError(
                f"thruster slew_rate: must be > 0 per second, got {self.slew_rate}"
            )
        if number(self.handedness, "thruster handedness") not in (1.0, -1.0):
            raise ConfigurationError(f"thruster handedness: must be 1 or -1, got {self.handedness}")
        if not self.least_thrust < min(self.forward, self.reverse):
            raise ConfigurationError(
                f"thruster least_thrust: must be below forward and reverse, {self.forward} and "
                f"{self.reverse} N, got {self.least_thrust}"
            )

        if self.sheets:
            check_sheets(self.sheets, self.voltage)
        elif self.voltage:
            raise ConfigurationError(
                f"thruster voltage: allowed only together with sheets, got {self.voltage:g} V "
                "without sheets"
            )

        if self.polynomial is not None and self.table is not None:
            raise ConfigurationError("thruster: must have a polynomial or a table, not both")
        if self.polynomial is None and self.table is None:
            return

        ends = _curve_ends(self)
        if not np.allclose(ends, (self.forward, self.reverse), rtol=1e-5):
            raise ConfigurationError(
                f"thruster forward and reverse: must be the ends of the curve, {ends[0]} and "
                f"{ends[1]} N, got {self.forward}, {self.reverse}"
            )

    @classmethod
    def of_polynomial(
        cls, ahead: ArrayLike, astern: ArrayLike | None = None, **figures: Any
    ) -> Self:
        """Thruster whose thrust magnitude [N] is `c[0] r + c[1] r^2 + ...`.

        Args:
            ahead: coefficients [N]; r in [0, 1] is the share of the command beyond the dead band.
            astern: coefficients [N]; by default as `ahead`.
            **figures: the other fields, without those of the curve.

        Returns:
            The thruster.

        Raises:
            ConfigurationError: a side does not rise, or the curve determines a stated field.
        """
        from uuv.models.water.thruster_curves import check_polynomial

        _refuse_curve(figures)
        both = _pair((ahead, ahead if astern is None else astern), "polynomial")
        assert both is not None
        forward, reverse = (check_polynomial(side) for side in both)
        return cls(forward=forward, reverse=reverse, polynomial=both, **figures)

    @classmethod
    def of_table(
        cls,
        command: ArrayLike,
        thrust: ArrayLike,
        *,
        neutral: float = 0.0,
        full: float | None = None,
        **figures: Any,
    ) -> Self:
        """Thruster with thrusts [N] at tabled commands, pulse widths or speeds.

        Between the points the curve is a monotone cubic [Fritsch 1984]. A command u in [-1, 1]
        corresponds to `neutral + u full` of the table; beyond an end the thrust stays constant.
        Several successive commands with zero thrust form the dead band.

        Args:
            command: (k,) in the unit of the table, rising.
            thrust: (k,) [N], rising from below zero through zero.
            neutral: table command of u = 0.
            full: table range of u = 1; by default the distance to the farther end.
            **figures: the other fields, without those of the curve.

        Returns:
            The thruster.

        Raises:
            ConfigurationError: commands or thrusts do not rise, all thrusts have one sign, or a
                field is stated that the curve determines.
        """
        from uuv.models.water.thruster_curves import check_table

        _refuse_curve(figures)

        neutral = number(neutral, "thruster neutral")
        full = None if full is None else number(full, "thruster full")

        rows = _pair((command, thrust), "table")
        assert rows is not None
        x, y = (np.array(row) for row in rows)
        reach = float(np.max(np.abs(x - neutral), initial=0.0)) if full is None else full
        if not (np.isfinite(neutral) and np.isfinite(reach) and reach > 0.0):
            raise ConfigurationError(
                f"thruster table: neutral {neutral} and full {full} must be finite, full above zero"
            )

        points = tuple(((x - neutral) / reach).tolist()), tuple(y.tolist())
        forward, reverse = check_table(*points)
        return cls(forward=forward, reverse=reverse, table=points, **figures)

    def static_curve(self) -> Array:
        """Static curve of the thruster, as a row of `uuv.models.water.thruster_curves`."""
        # imported here, since it imports numba
        from uuv.models.water import thruster_curves as rows

        if self.table is not None:
            return rows.pack_table(*self.table, self.least_thrust)
        kind = rows.QUADRATIC if self.polynomial is None else rows.POLYNOMIAL
        sides = self.polynomial or ((0.0, self.forward), (0.0, self.reverse))
        return rows.pack_polynomial(kind, *sides, self.dead_band, self.least_thrust)


# [BlueRobotics 2019], 16 V sheet: pulse width [us], thrust [N].
_T200_PULSE = (1100, 1180, 1260, 1340, 1420, 1468, 1472, 1528, 1532, 1580, 1660, 1740, 1820, 1900)
_T200_THRUST = (
    -39.91,
    -29.36,
    -19.04,
    -10.01,
    -3.16,
    -0.36,
    0,
    0,
    0.40,
    3.91,
    12.54,
    23.84,
    37.45,
    51.44,
)


def t200(
    handedness: int = 1,
    *,
    time_constant: float = 0.08,
    inflow_loss: float = 9.0,
    torque_per_thrust: float = 0.014,
    slew_rate: float = math.inf,
    least_thrust: float = 0.36,
    voltage: float = 16.0,
) -> Thruster:
    """Blue Robotics T200 at 10 to 20 V. A command u is a pulse of 1500 + 400 u us.

    Thrust and current are measured. At 16 V it was also measured that a turning propeller gives
    0.36 N or more (317 rpm). This least thrust is used at every voltage, so that the smaller 0.29 N
    astern in the sheets of 10 and 14 V becomes zero. At 16 V the curve has 14 points of the sheet
    and a dead band from 1472 to 1528 us; at any other voltage it is interpolated between the sheets
    of 10, 14, 16 and 20 V. The other defaults are assumptions, the same at each voltage, since no
    measurement was found.

    Args:
        handedness: +1 or -1, see `Thruster`.
        time_constant: [s], assumed.
        inflow_loss: [N]/[m/s], assumed: a fit T ~ 0.0113 - 0.0091 J by slim71, with zero thrust at
            5 m/s.
        torque_per_thrust: [m], assumed: 70 % of 24 A at 16 V reach the shaft at 3533 rpm and 51.44
            N.
        slew_rate: [1/s] largest rate of the command.
        least_thrust: [N] of a turning propeller, measured.
        voltage: [V] at the ESC.

    Returns:
        The thruster.

    Raises:
        ConfigurationError: a figure or the voltage is out of range.
    """
    at_16 = Thruster.of_table(
        _T200_PULSE,
        _T200_THRUST,
        neutral=1500.0,
        handedness=handedness,
        time_constant=time_constant,
        inflow_loss=inflow_loss,
        torque_per_thrust=torque_per_thrust,
        slew_rate=slew_rate,
        least_thrust=least_thrust,
        voltage=16.0,
        sheets=SHEETS,
        esc=ESC,
    )
    return at_16 if voltage == at_16.voltage else at_voltage(at_16, voltage)


def from_table(
    path: str | Path, *, voltage: float | None = None, esc: Esc | None = None, **figures: Any
) -> Thruster:
    """Thruster from a maker's table, a CSV file.

    The columns are `pulse_us`, `force_N` and, if measured, `voltage_V`, `current_A`, `power_W`
    (`uuv.models.water.sheet_file`). Lag, inflow and torque, which a table does not contain, are
    zero unless they are stated.

    Args:
        path: path of the file.
        voltage: [V] of the thruster's curve; for a table without a voltage column, the voltage of
            the measurement. Default: the middle voltage of the table.
        esc: range, dead band and direction of the pulses; default: those of the table.
        **figures: the other fields of `Thruster`, without those of the curve.

    Returns:
        The thruster.

    Raises:
        ConfigurationError: the file cannot be read, a column is missing, thrusts do not rise, or a
            voltage is out of range.
    """
    from uuv.models.water.sheet_file import read_sheets
    from uuv.models.water.thruster_curves import check_table

    _refuse_curve(figures)
    if voltage is not None:
        voltage = finite_number(voltage, "voltage [V]", above=0.0)
    sheets, esc = read_sheets(path, esc, voltage)
    middle = sheets[len(sheets) // 2]
    forward, reverse = check_table(middle.command, middle.thrust)
    thruster = Thruster(
        forward=forward, reverse=reverse, table=(middle.command, middle.thrust), esc=esc, **figures
    )
    if not middle.voltage:
        return thruster
    thruster = replace(thruster, sheets=sheets, voltage=middle.voltage)
    return thruster if voltage is None else at_voltage(thruster, voltage)


def at_voltage(thruster: Thruster, voltage: float) -> Thruster:
    """The thruster with the curve of another voltage [V], from its sheets.

    Raises:
        ConfigurationError: the thruster has no sheets, or the voltage is beyond them.
    """
    curve = thruster.between(voltage)
    command = tuple(curve.command.tolist())
    thrust = tuple(curve.thrust.tolist())
    return replace(
        thruster, table=(command, thrust), forward=thrust[-1], reverse=-thrust[0], voltage=voltage
    )


def attach(spec: mujoco.MjSpec, table: Mapping[str, Thruster]) -> None:
    """Turn actuators of `spec` into thrusters; `table` maps their names to the parameters.

    The control is then the command in [-1, 1], and the reaction torque is in the gear.

    Raises:
        ConfigurationError: `spec` has no actuator of a name, the actuator's user data holds other
            data, or the actuator is neither a thruster nor a plain motor on a site, without limits
            and with a gear of unit length.
    """
    actuators = {actuator.name: actuator for actuator in spec.actuators}
    for name, thruster in table.items():
        if name not in actuators:
            raise ConfigurationError(
                f"thruster {name!r}: there is no actuator of that name; the actuators are "
                f"{sorted(actuators)}"
            )

        actuator = actuators[name]
        row = pack(thruster)
        replaced = carries(actuator.userdata)
        if np.any(actuator.userdata) and not replaced:
            raise ConfigurationError(
                f"thruster {name!r}: the user data of its actuator holds other data already"
            )
        if not replaced and np.any(actuator.gear[3:]):
            raise ConfigurationError(
                f"thruster {name!r}: the gear of its actuator must have no torque, which "
                f"torque_per_thrust states instead; got {actuator.gear.tolist()}"
            )

        of_spec = partial(getattr, actuator)
        check_kind(name, of_spec, DRIVEN if replaced else MOTOR, actuator.refsite != "")
        actuator.gear[3:] = row[TORQUE] * actuator.gear[:3]
        actuator.userdata = row
        set_kind(actuator, DRIVEN)
        actuator.actdim = ACTIVATIONS
        actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
        actuator.ctrlrange = [-1.0, 1.0]

    if table:
        mark(spec)
    # All rows must have one length; absent values compile to zero, which decodes as "no thruster".
    spec.nuser_actuator = max(
        spec.nuser_actuator, *(len(a.userdata) for a in spec.actuators), HEADER
    )


def detach(actuator: mujoco.MjsActuator) -> None:
    """Turn a thruster into a plain motor of thrust [N] again; the reaction torque is kept.

    Args:
        actuator: changed in place; an actuator that is not a thruster is not changed.
    """
    if not carries(actuator.userdata):
        return
    set_kind(actuator, MOTOR)
    actuator.userdata = []
    actuator.actdim = -1
    actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_AUTO
    actuator.ctrlrange = [0.0, 0.0]


def pack(thruster: Thruster) -> Array:
    """Encode `thruster` as a row: HEADER numbers, its curve, and its measurements."""
    # imported here, since these import numba
    from uuv.models.water.sheet_kernels import pack_measured

    curve = thruster.static_curve()
    slew = thruster.slew_rate if np.isfinite(thruster.slew_rate) else 0.0
    # A right-handed propeller is driven about the thrust axis; the reaction turns the hull in the
    # opposite sense.
    torque = -thruster.handedness * thruster.torque_per_thrust

    header = (
        thruster.forward,
        thruster.reverse,
        thruster.dead_band,
        thruster.time_constant,
        thruster.inflow_loss,
        slew,
        torque,
        thruster.least_thrust,
        STAMP_VALUE,
        len(curve),
    )
    measured = pack_measured(thruster.voltage, thruster.esc, thruster.sheets)
    return np.array([*header, *curve, *measured])


def unpack(row: Array) -> Thruster:
    """Decode the thruster of a row.

    Raises:
        ConfigurationError: a number was changed to an invalid value, or a number that the curve
            repeats was changed without the curve; `changed` changes both.
    """
    from uuv.models.water import thruster_curves as rows
    from uuv.models.water.sheet_kernels import unpack_measured

    count = round(float(row[COUNT]))
    curve = np.asarray(row[HEADER : HEADER + max(count, 0)])
    if len(curve) != count:
        raise ConfigurationError(
            f"thruster: its row of {len(row)} numbers is too short for a curve of {count}"
        )
    polynomial, table = rows.unpack(curve)
    voltage, esc, sheets = unpack_measured(row[HEADER + count :])
    thruster = Thruster(
        forward=float(row[FORWARD]),
        reverse=float(row[REVERSE]),
        dead_band=float(row[DEAD_BAND]),
        time_constant=float(row[TIME_CONSTANT]),
        inflow_loss=float(row[INFLOW_LOSS]),
        slew_rate=float(row[SLEW_RATE]) or math.inf,
        torque_per_thrust=abs(float(row[TORQUE])),
        handedness=-1 if row[TORQUE] > 0.0 else 1,
        least_thrust=float(row[LEAST]),
        polynomial=polynomial,
        table=table,
        voltage=voltage,
        sheets=sheets,
        esc=esc,
    )

    # A table has its own dead band.
    band = thruster.dead_band if table is None else None
    if not rows.agrees(curve, (thruster.reverse, thruster.forward), band, thruster.least_thrust):
        raise ConfigurationError(
            "thruster: its row disagrees with its curve (thrust, dead band or least thrust); "
            "attach the changed thruster"
        )
    return thruster


def changed(row: Array, **values: float) -> Array:
    """A thruster's row with other `values` of the fields of `Thruster`, changed in its curve too.

    Raises:
        ConfigurationError: a value is invalid.
    """
    packed = np.array(row)
    whole = pack(replace(unpack(row), **values))
    packed[: len(whole)] = whole
    return packed


def carries(row: Array) -> bool:
    """True if a row of user data holds a thruster."""
    return len(row) >= HEADER and row[STAMP] == STAMP_VALUE


def read(model: mujoco.MjModel) -> tuple[np.ndarray, Array]:
    """Actuators (m,) of the thrusters of a compiled model, and their rows (m, width) of `pack`.

    Raises:
        ConfigurationError: a row is invalid, or an actuator differs from what `attach` sets; the
            message names the actuator.
    """
    rows = np.asarray(model.actuator_user)
    index = np.array([i for i in range(model.nu) if carries(rows[i])], dtype=np.int64)
    for i in index.tolist():
        name = model.actuator(i).name
        gear = model.actuator_gear[i]

        try:
            _check_row(rows[i].tobytes())
        except ConfigurationError as error:
            raise ConfigurationError(f"actuator {name!r}: {error}") from error

        of_model = partial(of_compiled, model, i)
        check_kind(
            name, of_model, DRIVEN, model.actuator_trnid[i, 1] >= 0 or model.actuator_plugin[i] >= 0
        )

        if np.abs(gear[3:] - rows[i, TORQUE] * gear[:3]).max() > ROUNDED:
            raise ConfigurationError(
                f"thruster {name!r}: the torque of its actuator's gear must be {rows[i, TORQUE]} "
                f"along the thrust, got {gear.tolist()}"
            )
        if model.actuator_actnum[i] != ACTIVATIONS:
            raise ConfigurationError(
                f"thruster {name!r}: its actuator must have {ACTIVATIONS} activations, got "
                f"{model.actuator_actnum[i]}"
            )
    return index, rows[index].reshape(len(index), rows.shape[-1]).copy()


@lru_cache(maxsize=256)
def _check_row(content: bytes) -> None:
    """Refuse the bytes of an invalid row as `unpack` does; a valid one is checked once."""
    unpack(np.frombuffer(content))


def sheet_blocks(table: Array) -> list[Array]:
    """Sheets of rows `table` (m, ...) for `uuv.models.water.sheet_kernels`; may be empty."""
    from uuv.models.water.sheet_kernels import block_of

    return [block_of(row[HEADER + round(float(row[COUNT])) :]) for row in table]


def curves(table: Array) -> Array:
    """Static curves (m, ...) of rows `table` (m, ...), for `uuv.models.water.thruster_curves`."""
    return np.array(table[:, HEADER:])


def inflow_levers(table: Array, wrench: Array) -> Array:
    """Levers (6, m) by which the motion through the water gives the inflow of each thruster.

    They are the wrench of unit thrust without the propeller's reaction torque.

    Args:
        table: rows of `read`.
        wrench: (6, m) wrench of unit thrusts.
    """
    levers = np.array(wrench)
    levers[3:] -= table[:, TORQUE] * levers[:3]
    return levers


def _curve_ends(thruster: Thruster) -> Sequence[float]:
    """Validated thrust magnitudes [N] at the ends of a polynomial or a table, ahead and astern."""
    # imported here, since these import numba
    from uuv.models.water.thruster_curves import check_polynomial, check_table

    if thruster.polynomial is not None:
        return [check_polynomial(side) for side in thruster.polynomial]
    assert thruster.table is not None
    if thruster.dead_band:
        raise ConfigurationError(
            "thruster dead_band: must be left out for a table, whose zero thrusts define it"
        )
    return check_table(*thruster.table)


def _refuse_curve(figures: Mapping[str, Any]) -> None:
    # These would contradict the curve, or only repeat it.
    of_curve = [name for name in ("forward", "reverse", "polynomial", "table") if name in figures]
    if of_curve:
        names = ", ".join(of_curve)
        raise ConfigurationError(
            f"thruster {names}: must be left out, since the curve determines it"
        )


def _pair(value: Any, name: str) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    if value is None:
        return None
    try:
        first, second = (tuple(number(x, f"thruster {name}") for x in side) for side in value)
    except (TypeError, ValueError):
        raise ConfigurationError(
            f"thruster {name}: expected two rows of numbers, got {value!r}"
        ) from None
    return first, second
