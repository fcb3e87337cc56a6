"""Compiled wrench of a body's forms (`uuv.models.water.forms`), from the records after its row."""

import math
from typing import Any

from numba import njit

from uuv.models.water.forms import CrossTerms, FadingDamping, LiftDrag, MunkFactor, PlanarStrip
from uuv.sim.native.native_memory import f64 as _f64
from uuv.sim.native.vectors import Vector, cross, dot, load3, plus

_MUNK = MunkFactor.kind
_FADING = FadingDamping.kind
_LIFT = LiftDrag.kind
_CROSS = CrossTerms.kind
_PLANAR = PlanarStrip.kind
_RIGHT = 0.5 * math.pi
_GAUSS = 0.5 / math.sqrt(3.0)  # half the distance of the two stations on an interval of length 1

Address = Any  # integer of the size of a pointer


@njit(error_model="numpy", fastmath={"contract"})
def form_wrench(
    row: Address, size: int, nuser: int, mass_at: int, v: Vector, w: Vector
) -> tuple[Vector, Vector]:
    """Force [N] and torque [N m] of all force models ("forms") of one body at its origin, body
    axes.

    Args:
        row: Address of the body's row.
        size: Number of entries in a row before the records.
        nuser: Number of entries in a row with the records.
        mass_at: Index of the packed added mass.
        v: (3,) [m/s] velocity relative to the water, body axes.
        w: (3,) [rad/s] angular velocity, body axes.
    """
    total = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    at = size

    # Each record has its kind, the number of its values, and the values.
    while at + 1 < nuser:
        kind = _f64(row, at)
        count = _f64(row, at + 1)
        if not (kind > 0.0 and count >= 0.0 and at + 2.0 + count <= nuser):
            break
        at += 2

        if kind == _MUNK:
            wrench = _munk(row, at, mass_at, v, w)
        elif kind == _FADING:
            wrench = _fading(row, at, v, w)
        elif kind == _LIFT:
            wrench = _lift_drag(row, at, v, w)
        elif kind == _CROSS:
            wrench = _cross_terms(row, at, int(count), v, w)
        elif kind == _PLANAR:
            wrench = _planar(row, at, v, w)
        else:
            wrench = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

        total = plus(total[0], wrench[0]), plus(total[1], wrench[1])
        at += int(count)
    return total


@njit(error_model="numpy", fastmath={"contract"})
def _munk(row: Address, at: int, mass_at: int, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    a = load3(row, mass_at)
    b = load3(row, mass_at + 3)
    c, d = load3(row, mass_at + 6), load3(row, mass_at + 9)
    e = load3(row, mass_at + 12)

    # Upper triangle by rows: a00 a01 a02 | a03 a04 a05 | a11 a12 a13 | a14 a15 a22 | a23 a24 a25
    p = (
        dot(a, v) + dot(b, w),
        a[1] * v[0] + c[0] * v[1] + c[1] * v[2] + c[2] * w[0] + d[0] * w[1] + d[1] * w[2],
        a[2] * v[0] + c[1] * v[1] + d[2] * v[2] + dot(e, w),
    )

    share_left = 1.0 - _f64(row, at), 1.0 - _f64(row, at + 1), 1.0 - _f64(row, at + 2)
    couple = cross(v, p)
    force = cross((share_left[0] * w[0], share_left[1] * w[1], share_left[2] * w[2]), p)
    return force, (share_left[0] * couple[0], share_left[1] * couple[1], share_left[2] * couple[2])


@njit(error_model="numpy", fastmath={"contract"})
def _fading(row: Address, at: int, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    share = -math.exp(-_f64(row, at + 6) * math.sqrt(dot(v, v)))
    d = load3(row, at)
    e = load3(row, at + 3)

    return (
        (share * d[0] * v[0], share * d[1] * v[1], share * d[2] * v[2]),
        (share * e[0] * w[0], share * e[1] * w[1], share * e[2] * w[2]),
    )


@njit(error_model="numpy", fastmath={"contract"})
def _lift_drag(row: Address, at: int, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    """Lift and drag of a foil: force [N], and moment [N m] about the body's origin, in body axes.

    Args:
        row: Numbers of the body's forms, as `LiftDrag` packs them (models/water/forms).
        at: Where this foil's 20 numbers begin.
        v: [m/s] of the body's origin through the water, in body axes.
        w: [rad/s] of the body, in body axes.
    """
    point = load3(row, at)
    forward = load3(row, at + 3)
    upward = load3(row, at + 6)
    area, density, slope = load3(row, at + 9)
    drag_0, induced, drag_slope = load3(row, at + 12)
    incidence, stall, stalled = load3(row, at + 15)
    stalled_drag = _f64(row, at + 18)
    sweep = _f64(row, at + 19)

    # Flow in the plane of the forward and upward axes.
    u = plus(v, cross(w, point))
    a = dot(u, forward)
    b = dot(u, upward)
    whole = dot(u, u)
    square = a * a + b * b
    if not square > 0.0:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)

    # Incidence, also for flow from behind.
    alpha = (math.atan2(-b, a) if a >= 0.0 else math.atan2(b, -a)) + incidence
    if alpha > _RIGHT:
        alpha -= math.pi
    elif alpha < -_RIGHT:
        alpha += math.pi

    # Lift and drag, linear up to the stall and beyond it.
    near = min(abs(alpha), stall)
    beyond = max(abs(alpha) - stall, 0.0)
    lift = max(slope * near + stalled * beyond, 0.0)
    drag = drag_0 + drag_slope * near + stalled_drag * beyond + induced * lift * lift
    if alpha < 0.0:
        lift = -lift

    # Squared speed of the dynamic pressure, by `sweep`: 0 in the plane, below 0 the whole, above 0
    # that of a swept wing.
    swept = square
    if sweep < 0.0:
        swept = whole
    elif sweep > 0.0:
        swept = square * square / whole

    # Force: drag along the flow, lift across it.
    share = 0.5 * density * area * swept / math.sqrt(square)
    along = share * (-lift * b - drag * a)
    across = share * (lift * a - drag * b)

    force = (
        along * forward[0] + across * upward[0],
        along * forward[1] + across * upward[1],
        along * forward[2] + across * upward[2],
    )

    return force, cross(point, force)


@njit(error_model="numpy", fastmath={"contract"})
def _cross_terms(row: Address, at: int, count: int, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    x, y, z, k, m, n = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0

    for first in range(at, at + count - 4, 5):
        times = _component(v, w, _f64(row, first + 2))
        if _f64(row, first + 3) != 0.0:
            times = abs(times)
        coupling = -_f64(row, first + 4) * times * _component(v, w, _f64(row, first + 1))

        i = _f64(row, first)
        if i == 0.0:
            x += coupling
        elif i == 1.0:
            y += coupling
        elif i == 2.0:
            z += coupling
        elif i == 3.0:
            k += coupling
        elif i == 4.0:
            m += coupling
        else:
            n += coupling

    return (x, y, z), (k, m, n)


@njit(error_model="numpy", fastmath={"contract"})
def _planar(row: Address, at: int, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    start = load3(row, at)
    end = load3(row, at + 3)
    direction = load3(row, at + 6)
    along = end[0] - start[0], end[1] - start[1], end[2] - start[2]

    # Speed across the strip, which is linear along it, and the point where it changes sign.
    low = dot(plus(v, cross(w, start)), direction)
    rise = dot(cross(w, along), direction)
    turn = 0.0
    if low * (low + rise) < 0.0:
        turn = -low / rise

    # integrals of |u| u and of s |u| u over s from 0 to 1, exact on either side of the sign change
    zeroth = 0.0
    first = 0.0
    for begin, width in ((0.0, turn), (turn, 1.0 - turn)):
        for side in (-1.0, 1.0):
            s = begin + width * (0.5 + side * _GAUSS)
            u = low + s * rise
            share = 0.5 * width * abs(u) * u
            zeroth += share
            first += s * share

    bluff = -_f64(row, at + 9) * math.sqrt(dot(along, along))
    lever = (
        zeroth * start[0] + first * along[0],
        zeroth * start[1] + first * along[1],
        zeroth * start[2] + first * along[2],
    )

    force = (
        bluff * zeroth * direction[0],
        bluff * zeroth * direction[1],
        bluff * zeroth * direction[2],
    )
    torque = cross(lever, direction)
    return force, (bluff * torque[0], bluff * torque[1], bluff * torque[2])


@njit(error_model="numpy", fastmath={"contract"})
def _component(v: Vector, w: Vector, k: float) -> float:
    if k < 3.0:
        return v[0] if k == 0.0 else (v[1] if k == 1.0 else v[2])
    return w[0] if k == 3.0 else (w[1] if k == 4.0 else w[2])
