"""The native passive callback: added mass into `d.M`, drag, buoyancy and velocity terms into `d.qfrc_passive`.

Compiled by numba to a bare C function that MuJoCo calls without the GIL. It keeps no state, allocates only on MuJoCo's
own stack, and is linear in the number of bodies: per-body 6x6 inertias and wrenches are taken to world axes at the
tree's centre of mass (the reference point of `cdof` and `cvel`), summed up to the parents, and projected on each
joint's axis, as MuJoCo's own composite-rigid-body pass does for the dry inertia.

Every offset is a closure variable of `build`: numba keys its cache by their values, so a cached kernel never meets a
MuJoCo, or a table of coefficients, with another layout.
"""

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, ParamSpec, TypeVar, cast

import mujoco
import numpy as np
from llvmlite import ir
from numba import cfunc, njit, types
from numba.extending import intrinsic

from models.hydrodynamics import LAYOUT, MAX_STATIONS
from sim.interfaces.spatial import Array
from sim.mujoco_layout import offset

# What the callback reads or writes; the layout of at least these is compared with live objects.
# fmt: off
MODEL_FIELDS = (
    "nbody", "nuser_body", "body_parentid", "body_rootid", "body_treeid", "body_dofnum", "body_dofadr",
    "body_user", "M_rownnz", "M_rowadr", "M_colind",
)
DATA_FIELDS = (
    "qvel", "xpos", "xmat", "subtree_com", "cdof", "cdof_dot", "cvel", "crb", "M", "qfrc_passive",
)
# fmt: on

# `d.crb` of the world body is zero and MuJoCo zeroes it again whenever it rebuilds `d.M`, so this mark there means that
# `d.M` holds the added mass already (mj_forwardSkip and finite differences call mj_passive again without rebuilding).
WET_MARK = 6.20261121e8

# Symbols of libmujoco, which `sim.hydrodynamics.install` gives to LLVM under these names.
SYMBOLS = ("mj_factorM", "mj_markStack", "mj_freeStack", "mj_stackAllocNum")
_factor = types.ExternalFunction("mj_factorM", types.void(types.intp, types.intp))
_mark_stack = types.ExternalFunction("mj_markStack", types.void(types.intp))
_free_stack = types.ExternalFunction("mj_freeStack", types.void(types.intp))
_stack_numbers = types.ExternalFunction("mj_stackAllocNum", types.intp(types.intp, types.intp))

P = ParamSpec("P")
T = TypeVar("T")

# Plain tuples stay in registers, where numba's arrays would go through memory. An address is an integer.
Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]
Blocks = tuple[Matrix, Matrix, Matrix]  # B (linear-linear), C (linear-angular), J (angular-angular) of a 6x6 inertia


def _inline(function: Callable[P, T]) -> Callable[P, T]:
    """Compile into the callers. A multiply and an add may be fused: exact to rounding, and never reordered."""
    return njit(function, forceinline=True, error_model="numpy", fastmath={"contract"})


def _loader(result: types.Type, kind: ir.Type, scale: int) -> Callable[[int, int], Any]:
    """An intrinsic f(address, index): the `kind` that lies `index` times `scale` bytes after `address`."""

    def load(_typing: Any, _address: Any, _index: Any) -> Any:
        def codegen(_context: Any, builder: ir.IRBuilder, _signature: Any, args: Any) -> ir.Value:
            place = builder.add(args[0], builder.mul(args[1], ir.Constant(args[1].type, scale)))
            return builder.load(builder.inttoptr(place, kind.as_pointer()))

        return result(types.intp, types.intp), codegen

    return cast(Any, intrinsic(load))


def _storer() -> Callable[[int, int, float], None]:
    """An intrinsic f(address, index, value): stores the float64 `value` 8 `index` bytes after `address`."""

    def store(_typing: Any, _address: Any, _index: Any, _value: Any) -> Any:
        def codegen(context: Any, builder: ir.IRBuilder, _signature: Any, args: Any) -> ir.Value:
            place = builder.add(args[0], builder.mul(args[1], ir.Constant(args[1].type, 8)))
            builder.store(args[2], builder.inttoptr(place, ir.DoubleType().as_pointer()))
            return context.get_dummy_value()

        return types.void(types.intp, types.intp, types.float64), codegen

    return cast(Any, intrinsic(store))


_f64 = _loader(types.float64, ir.DoubleType(), 8)
_i32 = _loader(types.int32, ir.IntType(32), 4)
_pointer = _loader(types.intp, ir.IntType(64), 1)  # index in bytes
_put = _storer()


@_inline
def _load3(address: int, index: int) -> Vector:
    return _f64(address, index), _f64(address, index + 1), _f64(address, index + 2)


@_inline
def _load6(address: int, index: int) -> tuple[Vector, Vector]:
    return _load3(address, index), _load3(address, index + 3)


@_inline
def _put3(address: int, index: int, v: Vector) -> None:
    _put(address, index, v[0])
    _put(address, index + 1, v[1])
    _put(address, index + 2, v[2])


@_inline
def _plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@_inline
def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@_inline
def _scaled(s: float, a: Vector) -> Vector:
    return s * a[0], s * a[1], s * a[2]


@_inline
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@_inline
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@_inline
def _times(R: Matrix, v: Vector) -> Vector:
    return _dot(R[0], v), _dot(R[1], v), _dot(R[2], v)


@_inline
def _transposed(R: Matrix) -> Matrix:
    return (R[0][0], R[1][0], R[2][0]), (R[0][1], R[1][1], R[2][1]), (R[0][2], R[1][2], R[2][2])


@_inline
def _turned(R: Matrix, X: Matrix) -> Matrix:
    """R X R^T."""
    X = _transposed(X)
    Y = _transposed((_times(R, X[0]), _times(R, X[1]), _times(R, X[2])))
    return _times(R, Y[0]), _times(R, Y[1]), _times(R, Y[2])


@_inline
def _rows(address: int, index: int) -> Matrix:
    return _load3(address, index), _load3(address, index + 3), _load3(address, index + 6)


@_inline
def _symmetric(a: float, b: float, c: float, d: float, e: float, f: float) -> Matrix:
    return (a, b, c), (b, d, e), (c, e, f)


@_inline
def _body_blocks(row: int, at: int) -> Blocks:
    """The blocks of the packed upper triangle at `at`."""
    r0 = _load6(row, at)
    a, b, c, d, e = _f64(row, at + 6), _f64(row, at + 7), _f64(row, at + 8), _f64(row, at + 9), _f64(row, at + 10)
    f, g, h, i = _f64(row, at + 11), _f64(row, at + 12), _f64(row, at + 13), _f64(row, at + 14)
    J = _load6(row, at + 15)
    B = _symmetric(r0[0][0], r0[0][1], r0[0][2], a, b, f)
    C = r0[1], (c, d, e), (g, h, i)
    return B, C, _symmetric(J[0][0], J[0][1], J[0][2], J[1][0], J[1][1], J[1][2])


@_inline
def _scratch_blocks(scratch: int, at: int) -> Blocks:
    """The blocks as `_put_blocks` leaves them: B (6), C (9), J (6)."""
    B, J = _load6(scratch, at), _load6(scratch, at + 15)
    return (
        _symmetric(B[0][0], B[0][1], B[0][2], B[1][0], B[1][1], B[1][2]),
        _rows(scratch, at + 6),
        _symmetric(J[0][0], J[0][1], J[0][2], J[1][0], J[1][1], J[1][2]),
    )


@_inline
def _put_blocks(scratch: int, at: int, B: Matrix, C: Matrix, J: Matrix) -> None:
    _put3(scratch, at, B[0])
    _put3(scratch, at + 3, (B[1][1], B[1][2], B[2][2]))
    _put3(scratch, at + 6, C[0])
    _put3(scratch, at + 9, C[1])
    _put3(scratch, at + 12, C[2])
    _put3(scratch, at + 15, J[0])
    _put3(scratch, at + 18, (J[1][1], J[1][2], J[2][2]))


@_inline
def _at_reference(B: Matrix, C: Matrix, J: Matrix, r: Vector) -> Blocks:
    """The blocks about the point `-r` away from the one they are given about: T^T A T with T = [[I, -r x], [0, I]]."""
    C1 = _plus(C[0], _cross(r, B[0])), _plus(C[1], _cross(r, B[1])), _plus(C[2], _cross(r, B[2]))
    columns, old = _transposed(C1), _transposed(C)
    left = _transposed((_cross(r, columns[0]), _cross(r, columns[1]), _cross(r, columns[2])))
    return (
        B,
        C1,
        (
            _plus(_plus(J[0], left[0]), _cross(r, old[0])),
            _plus(_plus(J[1], left[1]), _cross(r, old[1])),
            _plus(_plus(J[2], left[2]), _cross(r, old[2])),
        ),
    )


@_inline
def _applied(B: Matrix, C: Matrix, J: Matrix, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    """Linear and angular part of A (v; w)."""
    return _plus(_times(B, v), _times(C, w)), _plus(_times(_transposed(C), v), _times(J, w))


@_inline
def _drag(row: int, D: int, quadratic_at: int, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    """Linear (6x6 at `D`) and quadratic damping (force, torque) of a relative twist, all in body axes."""
    q = _load6(row, quadratic_at)
    force = (
        _dot(_load3(row, D), v) + _dot(_load3(row, D + 3), w) + q[0][0] * abs(v[0]) * v[0],
        _dot(_load3(row, D + 6), v) + _dot(_load3(row, D + 9), w) + q[0][1] * abs(v[1]) * v[1],
        _dot(_load3(row, D + 12), v) + _dot(_load3(row, D + 15), w) + q[0][2] * abs(v[2]) * v[2],
    )
    torque = (
        _dot(_load3(row, D + 18), v) + _dot(_load3(row, D + 21), w) + q[1][0] * abs(w[0]) * w[0],
        _dot(_load3(row, D + 24), v) + _dot(_load3(row, D + 27), w) + q[1][1] * abs(w[1]) * w[1],
        _dot(_load3(row, D + 30), v) + _dot(_load3(row, D + 33), w) + q[1][2] * abs(w[2]) * w[2],
    )
    return _scaled(-1.0, force), _scaled(-1.0, torque)


@_inline
def _strip_drag(strip: int, v: Vector, w: Vector, nodes: Array, weights: Array) -> tuple[Vector, Vector]:
    """Drag (force, torque) of one segment whose numbers begin at the address `strip`, in body axes."""
    start = _load3(strip, 0)
    along = _minus(_load3(strip, 3), start)
    length = math.sqrt(_dot(along, along))
    axis = _scaled(1.0 / length, along)
    normal, tangential, count = _f64(strip, 6), _f64(strip, 7), int(_f64(strip, 8))
    force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(count * (count - 1) // 2, count * (count + 1) // 2):
        p = _plus(start, _scaled(nodes[k], along))
        u = _plus(v, _cross(w, p))
        slip = _dot(u, axis)
        across = _minus(u, _scaled(slip, axis))
        speed = math.sqrt(_dot(across, across))
        share = -length * weights[k]
        f = _plus(_scaled(share * normal * speed, across), _scaled(share * tangential * abs(slip) * slip, axis))
        force = _plus(force, f)
        torque = _plus(torque, _cross(p, f))
    return force, torque


def build() -> Any:
    """The compiled callback, a numba CFunc `void(mjModel*, mjData*)`, for the running MuJoCo and `LAYOUT`.

    `SYMBOLS` must be known to LLVM before.
    """
    model = SimpleNamespace(**{name: offset("mjModel", name) for name in MODEL_FIELDS})
    data = SimpleNamespace(**{name: offset("mjData", name) for name in DATA_FIELDS})
    nbody_at, nuser_at, user_at = model.nbody, model.nuser_body, model.body_user
    parent_at, root_at, tree_at = model.body_parentid, model.body_rootid, model.body_treeid
    dofnum_at, dofadr_at = model.body_dofnum, model.body_dofadr
    rownnz_at, rowadr_at, colind_at = model.M_rownnz, model.M_rowadr, model.M_colind
    wind_at, gravity_at = offset("mjModel", "opt.wind"), offset("mjModel", "opt.gravity")
    disable_at, gravity_off = offset("mjModel", "opt.disableflags"), int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    qvel_at, xpos_at, xmat_at, com_at = data.qvel, data.xpos, data.xmat, data.subtree_com
    cdof_at, cdof_dot_at, cvel_at = data.cdof, data.cdof_dot, data.cvel
    crb_at, M_at, passive_at = data.crb, data.M, data.qfrc_passive
    stamp, size = LAYOUT.stamp_value, LAYOUT.size
    density_at, surge_at, shear_at = LAYOUT.density, LAYOUT.current_acceleration, LAYOUT.current_shear
    volume_at, buoyancy_at, mass_at = LAYOUT.volume, LAYOUT.center_of_buoyancy, LAYOUT.added_mass
    linear_at, quadratic_at = LAYOUT.linear_damping, LAYOUT.quadratic_damping
    strip_count_at, strips_at, strip_size = LAYOUT.strip_count, LAYOUT.strips, LAYOUT.strip_size

    # Gauss-Legendre on [0, 1]; the rule with n stations starts at n (n - 1) / 2.
    rules = [np.polynomial.legendre.leggauss(n) for n in range(1, MAX_STATIONS + 1)]
    nodes = np.concatenate([0.5 + 0.5 * x for x, _ in rules])
    weights = np.concatenate([0.5 * w for _, w in rules])

    # Scratch of each body: added mass (21), force (3), torque (3), acceleration with qacc = 0 (angular 3, linear 3),
    # and 1 if it or a descendant carries coefficients.
    wrench, acceleration, loaded, stride = 21, 27, 33, 34

    @cfunc(types.void(types.intp, types.intp), cache=True, error_model="numpy", fastmath={"contract"})
    def passive(m: int, d: int) -> None:
        nuser, user = _pointer(m, nuser_at), _pointer(m, user_at)
        if nuser < size or _f64(user, 0) != stamp:
            return
        nbody = _pointer(m, nbody_at)
        parent, root, tree = _pointer(m, parent_at), _pointer(m, root_at), _pointer(m, tree_at)
        dofnum, dofadr = _pointer(m, dofnum_at), _pointer(m, dofadr_at)
        xpos, xmat, com = _pointer(d, xpos_at), _pointer(d, xmat_at), _pointer(d, com_at)
        qvel, cvel = _pointer(d, qvel_at), _pointer(d, cvel_at)
        cdof, cdof_dot = _pointer(d, cdof_at), _pointer(d, cdof_dot_at)
        M, crb, qfrc = _pointer(d, M_at), _pointer(d, crb_at), _pointer(d, passive_at)

        density = _f64(user, density_at)
        surge, shear, wind = _load3(user, surge_at), _load3(user, shear_at), _load3(m + wind_at, 0)
        gravity = _load3(m + gravity_at, 0)
        if _i32(m + disable_at, 0) & gravity_off:
            gravity = (0.0, 0.0, 0.0)
        dry = _f64(crb, 0) != WET_MARK

        _mark_stack(d)
        scratch = _stack_numbers(d, nbody * stride)
        _put3(scratch, acceleration, (0.0, 0.0, 0.0))
        _put3(scratch, acceleration + 3, (0.0, 0.0, 0.0))

        for i in range(1, nbody):
            here = scratch + 8 * stride * i
            above = scratch + 8 * stride * _i32(parent, i)
            _put(here, loaded, 0.0)
            a_w, a_v = _load6(above, acceleration)
            for j in range(_i32(dofadr, i), _i32(dofadr, i) + _i32(dofnum, i)):
                rate = _load6(cdof_dot, 6 * j)
                a_w = _plus(a_w, _scaled(_f64(qvel, j), rate[0]))
                a_v = _plus(a_v, _scaled(_f64(qvel, j), rate[1]))
            _put3(here, acceleration, a_w)
            _put3(here, acceleration + 3, a_v)
            row = user + 8 * nuser * i
            if _i32(tree, i) < 0 or _f64(row, 0) != stamp:
                continue
            _put(here, loaded, 1.0)

            R = _rows(xmat, 9 * i)
            p = _load3(xpos, 3 * i)
            r = _minus(p, _load3(com, 3 * _i32(root, i)))
            B, C, J = _body_blocks(row, mass_at)
            B, C, J = _at_reference(_turned(R, B), _turned(R, C), _turned(R, J), r)
            _put_blocks(here, 0, B, C, J)

            # All about the tree's centre of mass, world axes: twist, relative twist, momentum of the water.
            w, v = _load6(cvel, 6 * i)
            current = _plus(wind, _scaled(p[2], shear))
            flow = _plus(surge, _scaled(current[2], shear))  # acceleration of the water itself
            v = _minus(v, current)
            a_v = _minus(_plus(a_v, _cross(w, current)), flow)
            p_v, p_w = _applied(B, C, J, v, w)
            f, t = _applied(B, C, J, a_v, a_w)
            f = _scaled(-1.0, _plus(f, _cross(w, p_v)))
            t = _scaled(-1.0, _plus(t, _plus(_cross(w, p_w), _cross(v, p_v))))

            # Drag in body axes at the body origin.
            Rt = _transposed(R)
            v_B, w_B = _times(Rt, _plus(v, _cross(w, r))), _times(Rt, w)
            drag_f, drag_t = _drag(row, linear_at, quadratic_at, v_B, w_B)
            for k in range(int(_f64(row, strip_count_at))):
                strip_f, strip_t = _strip_drag(row + 8 * (strips_at + k * strip_size), v_B, w_B, nodes, weights)
                drag_f, drag_t = _plus(drag_f, strip_f), _plus(drag_t, strip_t)
            drag_f = _times(R, drag_f)
            f = _plus(f, drag_f)
            t = _plus(t, _plus(_times(R, drag_t), _cross(r, drag_f)))

            # Buoyancy, and the pressure gradient that accelerates the water, at the centre of buoyancy.
            lift = _scaled(density * _f64(row, volume_at), _minus(flow, gravity))
            f = _plus(f, lift)
            t = _plus(t, _cross(_plus(r, _times(R, _load3(row, buoyancy_at))), lift))
            _put3(here, wrench, f)
            _put3(here, wrench + 3, t)

        rownnz, rowadr, colind = _pointer(m, rownnz_at), _pointer(m, rowadr_at), _pointer(m, colind_at)
        for i in range(nbody - 1, 0, -1):
            here = scratch + 8 * stride * i
            if _f64(here, loaded) == 0.0:
                continue
            if _i32(tree, _i32(parent, i)) >= 0:
                above = scratch + 8 * stride * _i32(parent, i)
                if _f64(above, loaded) == 0.0:
                    _put(above, loaded, 1.0)
                    for k in range(acceleration):
                        _put(above, k, _f64(here, k))
                else:
                    for k in range(acceleration):
                        _put(above, k, _f64(above, k) + _f64(here, k))
            f, t = _load6(here, wrench)
            B, C, J = _scratch_blocks(here, 0)
            for j in range(_i32(dofadr, i), _i32(dofadr, i) + _i32(dofnum, i)):
                s_w, s_v = _load6(cdof, 6 * j)
                _put(qfrc, j, _f64(qfrc, j) + _dot(s_v, f) + _dot(s_w, t))
                if dry:
                    F, T = _applied(B, C, J, s_v, s_w)
                    first = _i32(rowadr, j)
                    for k in range(first, first + _i32(rownnz, j)):
                        u_w, u_v = _load6(cdof, 6 * _i32(colind, k))
                        _put(M, k, _f64(M, k) + _dot(u_v, F) + _dot(u_w, T))
        _free_stack(d)
        if dry:
            _put(crb, 0, WET_MARK)
            _factor(m, d)

    return passive
