"""Native passive callback: added mass into `d.M`, all other terms into `qfrc_passive`.

Friction of the gears comes first (`uuv.sim.native.gear_kernel`).

Numba compiles the callback to a bare C function that MuJoCo calls without the GIL. Its only state
is a record in the model of the warnings given (`LAYOUT.seen`). It allocates on MuJoCo's own stack,
and its cost is linear in the number of bodies.

The algorithm follows MuJoCo's composite-rigid-body pass for the dry inertia. Per-body 6x6 inertias
and wrenches are taken to world axes at the tree's centre of mass, the reference point of `cdof` and
`cvel`, four bodies at a time. They are then summed up to the parents and projected on joint axes.

Every offset is a closure variable of `build`, and the store keys machine code by their values. A
kept kernel therefore never runs with another layout of MuJoCo or of the coefficients.
"""

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import mujoco
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from uuv.models.hydrodynamics import (
    INDEFINITE,
    LAYOUT,
    MAX_STATIONS,
    MAX_STRIPS,
    NO_CURRENT,
    TOO_FAST,
    TOO_HIGH,
)
from uuv.sim.interfaces.kernels import c_function
from uuv.sim.interfaces.spatial import Array
from uuv.sim.native import gear_kernel, native_motion, soil_force
from uuv.sim.native.form_kernel import form_wrench
from uuv.sim.native.mujoco_layout import offset
from uuv.sim.native.native_memory import f64 as _f64
from uuv.sim.native.native_memory import i32 as _i32
from uuv.sim.native.native_memory import pointer as _pointer
from uuv.sim.native.native_memory import put as _put
from uuv.sim.native.simd4 import all_four, at_least, four_of, load_four, put_four, transposed_four
from uuv.sim.native.vectors import Matrix, Number, Vector
from uuv.sim.native.vectors import cross as _cross
from uuv.sim.native.vectors import dot as _dot
from uuv.sim.native.vectors import inline as _inline
from uuv.sim.native.vectors import load3 as _load3
from uuv.sim.native.vectors import load6 as _load6
from uuv.sim.native.vectors import minus as _minus
from uuv.sim.native.vectors import plus as _plus
from uuv.sim.native.vectors import put3 as _put3
from uuv.sim.native.vectors import rows as _rows
from uuv.sim.native.vectors import scaled as _scaled
from uuv.sim.native.vectors import symmetric as _symmetric
from uuv.sim.native.vectors import times as _times
from uuv.sim.native.vectors import transposed as _transposed
from uuv.sim.native.vectors import turned as _turned
from uuv.sim.native.vectors import turned_symmetric as _turned_symmetric

# Fields that the callback reads or writes; their layout must be verified on live objects.
# fmt: off
MODEL_FIELDS = (
    "nv", "nbody", "nuser_body",
    "body_parentid", "body_rootid", "body_treeid", "body_dofnum", "body_dofadr", "body_user",
    "M_rownnz", "M_rowadr", "M_colind",
    *native_motion.MODEL_FIELDS, *soil_force.MODEL_FIELDS, *gear_kernel.MODEL_FIELDS,
)
DATA_FIELDS = (
    "qvel", "xpos", "xmat", "subtree_com",
    "cdof", "cdof_dot", "cvel", "crb", "M", "qLD", "qLDiagInv", "qfrc_passive",
    *native_motion.DATA_FIELDS, *soil_force.DATA_FIELDS,
    *gear_kernel.DATA_FIELDS, *gear_kernel.ISLAND_FIELDS,
)
# fmt: on

# MuJoCo zeroes `d.crb` of the world body whenever it rebuilds `d.M`. This mark, stored there, shows
# that the added mass is included. mj_forwardSkip and finite differences call mj_passive again
# without rebuilding `d.M`, and the added mass would otherwise be added twice.
WET_MARK = 6.20261121e8  # in d.crb[0, 0], which is zero otherwise; arbitrary

# Symbols of libmujoco, which `uuv.sim.native.process_callbacks` registers with LLVM by these names.
SYMBOLS = ("mj_markStack", "mj_freeStack", "mj_stackAllocNum", "mj_warning", "mju_warning")
_mark_stack = types.ExternalFunction("mj_markStack", types.void(types.intp))
_free_stack = types.ExternalFunction("mj_freeStack", types.void(types.intp))
_stack_numbers = types.ExternalFunction("mj_stackAllocNum", types.intp(types.intp, types.intp))
_count_warning = types.ExternalFunction(
    "mj_warning", types.void(types.intp, types.int32, types.int32)
)
_print_warning = types.ExternalFunction("mju_warning", types.void(types.intp))

SINGULAR = 1e-15  # pivot below which mj_factorM warns (mjMINVAL)
NEVER = 1e300  # stands for no limit of the squared speed [(m/s)^2] or height [m]

FAST_TEXT = (
    "uuv.sim.hydrodynamics: a body moves through the water faster than its drag was "
    "judged for at this timestep"
)
NO_CURRENT_TEXT = "uuv.sim.hydrodynamics: data.userdata holds no current in its place"
HIGH_TEXT = (
    "uuv.sim.hydrodynamics: a body has risen above z = 0 and is still buoyant: there is "
    "no free surface"
)

Indices = tuple[int, int, int, int]
# B (linear-linear), C (linear-angular), J (angular-angular) of a 6x6 inertia
Blocks = tuple[Matrix, Matrix, Matrix]


def _text(text: str) -> Callable[[], int]:
    """Intrinsic f() that returns the address of `text` as a C string within the compiled code."""

    def address(_typing: Any) -> Any:
        def codegen(context: Any, builder: Any, _signature: Any, _args: Any) -> ir.Value:
            return builder.ptrtoint(
                context.insert_const_string(builder.module, text), ir.IntType(64)
            )

        return types.intp(), codegen

    return cast(Any, intrinsic(address))


_fast_text, _high_text = _text(FAST_TEXT), _text(HIGH_TEXT)
_no_current_text = _text(NO_CURRENT_TEXT)


@_inline
def _gathered(address: int, at: Indices, shift: int) -> tuple[Number, Number, Number, Number]:
    """Load four numbers at offset `shift` from each of four rows; transposed, lane k is row k."""
    return transposed_four(
        load_four(address, at[0] + shift),
        load_four(address, at[1] + shift),
        load_four(address, at[2] + shift),
        load_four(address, at[3] + shift),
    )


@_inline
def _scattered(
    address: int, at: Indices, shift: int, x: tuple[Number, Number, Number, Number]
) -> None:
    """Inverse of `_gathered`: store four numbers at offset `shift` of each row."""
    rows = transposed_four(x[0], x[1], x[2], x[3])
    put_four(address, at[0] + shift, rows[0])
    put_four(address, at[1] + shift, rows[1])
    put_four(address, at[2] + shift, rows[2])
    put_four(address, at[3] + shift, rows[3])


@_inline
def _lanes3(address: int, at: Indices, shift: int) -> Vector:
    """Load three numbers per row; this also reads the number before them, which must exist."""
    x = _gathered(address, at, shift - 1)
    return x[1], x[2], x[3]


@_inline
def _lanes6(address: int, at: Indices, shift: int) -> tuple[Vector, Vector]:
    x, y = _gathered(address, at, shift), _gathered(address, at, shift + 2)
    return (x[0], x[1], x[2]), (x[3], y[2], y[3])


@_inline
def _lanes9(address: int, at: Indices, shift: int) -> Matrix:
    x, y, z = (
        _gathered(address, at, shift),
        _gathered(address, at, shift + 4),
        _gathered(address, at, shift + 5),
    )
    return (x[0], x[1], x[2]), (x[3], y[0], y[1]), (y[2], y[3], z[3])


@_inline
def _body_blocks(user: int, rows: Indices, at: int) -> Blocks:
    """Blocks of the symmetric 6x6 matrices that are packed as upper triangles at `at`."""
    p, q, r = (
        _gathered(user, rows, at),
        _gathered(user, rows, at + 4),
        _gathered(user, rows, at + 8),
    )
    s, t, u = (
        _gathered(user, rows, at + 12),
        _gathered(user, rows, at + 16),
        _gathered(user, rows, at + 17),
    )

    B = _symmetric(p[0], p[1], p[2], q[2], q[3], r[3])
    C = (p[3], q[0], q[1]), (r[0], r[1], r[2]), (s[0], s[1], s[2])
    return B, C, _symmetric(s[3], t[0], t[1], t[2], t[3], u[3])


@_inline
def _scratch_blocks(scratch: int, at: int) -> Blocks:
    """Blocks in the scratch layout of `_put_body`."""
    B, J = _load6(scratch, at), _load6(scratch, at + 15)
    return (
        _symmetric(B[0][0], B[0][1], B[0][2], B[1][0], B[1][1], B[1][2]),
        _rows(scratch, at + 6),
        _symmetric(J[0][0], J[0][1], J[0][2], J[1][0], J[1][1], J[1][2]),
    )


@_inline
def _put_body(scratch: int, at: Indices, blocks: Blocks, force: Vector, torque: Vector) -> None:
    """Store a body's scratch: B (6), C (9), J (6), force (3), torque (3), and a zero."""
    B, C, J = blocks
    _scattered(scratch, at, 0, (B[0][0], B[0][1], B[0][2], B[1][1]))
    _scattered(scratch, at, 4, (B[1][2], B[2][2], C[0][0], C[0][1]))
    _scattered(scratch, at, 8, (C[0][2], C[1][0], C[1][1], C[1][2]))
    _scattered(scratch, at, 12, (C[2][0], C[2][1], C[2][2], J[0][0]))
    _scattered(scratch, at, 16, (J[0][1], J[0][2], J[1][1], J[1][2]))
    _scattered(scratch, at, 20, (J[2][2], force[0], force[1], force[2]))
    _scattered(scratch, at, 24, (torque[0], torque[1], torque[2], all_four(0.0)))


@_inline
def _at_reference(B: Matrix, C: Matrix, J: Matrix, r: Vector) -> Blocks:
    """Blocks shifted to the point at `-r`: T^T A T with T = [[I, -r x], [0, I]]."""
    C1 = _plus(C[0], _cross(r, B[0])), _plus(C[1], _cross(r, B[1])), _plus(C[2], _cross(r, B[2]))

    columns, old = _transposed(C1), _transposed(C)
    left = _transposed((_cross(r, columns[0]), _cross(r, columns[1]), _cross(r, columns[2])))

    x, y, z = (
        _plus(_plus(J[0], left[0]), _cross(r, old[0])),
        _plus(_plus(J[1], left[1]), _cross(r, old[1])),
        _plus(_plus(J[2], left[2]), _cross(r, old[2])),
    )

    return B, C1, _symmetric(x[0], x[1], x[2], y[1], y[2], z[2])


@_inline
def _applied(B: Matrix, C: Matrix, J: Matrix, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    """Linear and angular part of A (v; w)."""
    return _plus(_times(B, v), _times(C, w)), _plus(_times(_transposed(C), v), _times(J, w))


@_inline
def _drag(
    user: int, rows: Indices, D: int, quadratic_at: int, v: Vector, w: Vector
) -> tuple[Vector, Vector]:
    """Linear (6x6 at `D`) and quadratic damping (force, torque) of relative twists, body axes."""
    q, p = _lanes6(user, rows, quadratic_at)
    a, b, c = _lanes6(user, rows, D), _lanes6(user, rows, D + 6), _lanes6(user, rows, D + 12)
    force = (
        _dot(a[0], v) + _dot(a[1], w) + q[0] * abs(v[0]) * v[0],
        _dot(b[0], v) + _dot(b[1], w) + q[1] * abs(v[1]) * v[1],
        _dot(c[0], v) + _dot(c[1], w) + q[2] * abs(v[2]) * v[2],
    )

    a, b, c = _lanes6(user, rows, D + 18), _lanes6(user, rows, D + 24), _lanes6(user, rows, D + 30)
    torque = (
        _dot(a[0], v) + _dot(a[1], w) + p[0] * abs(w[0]) * w[0],
        _dot(b[0], v) + _dot(b[1], w) + p[1] * abs(w[1]) * w[1],
        _dot(c[0], v) + _dot(c[1], w) + p[2] * abs(w[2]) * w[2],
    )

    return _scaled(-1.0, force), _scaled(-1.0, torque)


@_inline
def _stations(user: int, strip: int) -> int:
    return min(max(int(_f64(user, strip + 8)), 0), MAX_STATIONS)


@_inline
def _strip_drag(
    user: int, strips: Indices, v: Vector, w: Vector, nodes: Array, weights: Array
) -> tuple[Vector, Vector]:
    """Drag (force, torque) of one segment of each body, body axes; a row of zeros has no drag.

    At the fraction s of a segment the flow across it is a + s b, with b = w x (end - start). The
    flow along it is the same everywhere. The stations therefore reduce to three sums of |a + s b|,
    weighted by 1, s and s^2.
    """
    start = _lanes3(user, strips, 0)
    along = _minus(_lanes3(user, strips, 3), start)
    length = math.sqrt(at_least(_dot(along, along), 1e-300))
    axis = _scaled(1.0 / length, along)
    _, normal, tangential, _ = _gathered(user, strips, 5)
    n0, n1 = _stations(user, strips[0]), _stations(user, strips[1])
    n2, n3 = _stations(user, strips[2]), _stations(user, strips[3])

    u = _plus(v, _cross(w, start))
    slip = _dot(u, axis)
    a, b = _minus(u, _scaled(slip, axis)), _cross(w, along)
    aa, ab, bb = _dot(a, a), 2.0 * _dot(a, b), _dot(b, b)

    # Integrals of the speed across the segment, of its first moment and of its second moment.
    zeroth, first, second = all_four(0.0), all_four(0.0), all_four(0.0)
    for k in range(max(max(n0, n1), max(n2, n3))):
        s = four_of(nodes[n0, k], nodes[n1, k], nodes[n2, k], nodes[n3, k])
        weight = four_of(weights[n0, k], weights[n1, k], weights[n2, k], weights[n3, k])
        share = weight * math.sqrt(at_least(aa + s * (ab + s * bb), 0.0))
        zeroth = zeroth + share
        first = first + share * s
        second = second + share * s * s

    bluff, skin = -1.0 * length * normal, -1.0 * length * tangential * abs(slip) * slip
    force = _plus(_scaled(bluff, _plus(_scaled(zeroth, a), _scaled(first, b))), _scaled(skin, axis))
    lever = _scaled(bluff, _plus(_scaled(first, a), _scaled(second, b)))
    return force, _plus(_cross(start, force), _cross(along, lever))


@_inline
def _subtract(row: int, other: int, factor: float, count: int) -> None:
    """Subtract `factor` times the first `count` numbers at `other` from those at `row`."""
    four = all_four(factor)
    full = count - count % 4
    for k in range(0, full, 4):
        put_four(row, k, load_four(row, k) - four * load_four(other, k))
    for k in range(full, count):
        _put(row, k, _f64(row, k) - factor * _f64(other, k))


@_inline
def _factor(M: int, LD: int, inverse: int, nv: int, rownnz: int, rowadr: int, colind: int) -> int:
    """Factor M = L^T D L into `LD` and 1 / D into `inverse` [Featherstone 2008, table 6.3].

    Both are left as mj_factorM leaves them.

    Returns the last degree of freedom at which M is not positive definite, or -1.

    A row holds a joint's ancestors in order, so an ancestor's row has the sparsity pattern of its
    beginning. Dense subtraction, four numbers at a time, therefore suffices, also on long chains.
    """
    last = _i32(rowadr, nv - 1) + _i32(rownnz, nv - 1)
    for k in range(0, last - 3, 4):
        put_four(LD, k, load_four(M, k))
    for k in range(last - last % 4, last):
        _put(LD, k, _f64(M, k))

    # Rows from the last one on, two rows of a chain at once if possible.
    j, singular = nv - 1, -1
    while j >= 0:
        here, columns = LD + 8 * _i32(rowadr, j), colind + 4 * _i32(rowadr, j)
        count = _i32(rownnz, j)
        scale = 1.0 / _f64(here, count - 1)
        _put(inverse, j, scale)
        if _f64(here, count - 1) < SINGULAR:
            singular = j
        if count > 1 and _i32(columns, count - 2) == j - 1:
            # Two rows of a chain at once: each ancestor's row is read and written once for both.
            above = LD + 8 * _i32(rowadr, j - 1)
            _subtract(above, here, _f64(here, count - 2) * scale, count - 1)
            _put(here, count - 2, _f64(here, count - 2) * scale)
            scale_above = 1.0 / _f64(above, count - 2)
            _put(inverse, j - 1, scale_above)
            if _f64(above, count - 2) < SINGULAR:
                singular = j - 1

            for i in range(count - 3, -1, -1):
                ancestor = LD + 8 * _i32(rowadr, _i32(columns, i))
                factor, factor_above = _f64(here, i) * scale, _f64(above, i) * scale_above
                four, four_above = all_four(factor), all_four(factor_above)
                full = i + 1 - (i + 1) % 4
                for k in range(0, full, 4):
                    rest = load_four(ancestor, k) - four * load_four(here, k)
                    put_four(ancestor, k, rest - four_above * load_four(above, k))
                for k in range(full, i + 1):
                    rest = _f64(ancestor, k) - factor * _f64(here, k)
                    _put(ancestor, k, rest - factor_above * _f64(above, k))
                _put(here, i, factor)
                _put(above, i, factor_above)
            j -= 2
        else:
            for i in range(count - 2, -1, -1):
                factor = _f64(here, i) * scale
                _subtract(LD + 8 * _i32(rowadr, _i32(columns, i)), here, factor, i + 1)
                _put(here, i, factor)
            j -= 1
    return singular


@_inline
def _is_new(user: int, seen_at: int, what: int) -> bool:
    """Set the warning bit `what` in the world's row `user`; True if it was not set before."""
    marks = int(_f64(user, seen_at))
    _put(user, seen_at, float(marks | what))
    return marks & what == 0


def build() -> Any:
    """Compile the callback for the running MuJoCo: a numba CFunc `void(mjModel*, mjData*)`.

    `SYMBOLS` must be registered with LLVM before.
    """
    model = SimpleNamespace(**{name: offset("mjModel", name) for name in MODEL_FIELDS})
    data = SimpleNamespace(**{name: offset("mjData", name) for name in DATA_FIELDS})
    nbody_at, nuser_at, user_at = model.nbody, model.nuser_body, model.body_user
    parent_at, root_at, tree_at = model.body_parentid, model.body_rootid, model.body_treeid
    dofnum_at, dofadr_at = model.body_dofnum, model.body_dofadr
    rownnz_at, rowadr_at, colind_at = model.M_rownnz, model.M_rowadr, model.M_colind
    gravity_at = offset("mjModel", "opt.gravity")
    disable_at, gravity_off = (
        offset("mjModel", "opt.disableflags"),
        int(mujoco.mjtDisableBit.mjDSBL_GRAVITY),
    )
    qvel_at, xpos_at, xmat_at, com_at = (data.qvel, data.xpos, data.xmat, data.subtree_com)
    cdof_at, cdof_dot_at, cvel_at = data.cdof, data.cdof_dot, data.cvel
    nv_at, factored_at, inverse_at = model.nv, data.qLD, data.qLDiagInv
    crb_at, M_at, passive_at = data.crb, data.M, data.qfrc_passive

    # Rows of the world and of bodies.
    stamp, size = LAYOUT.stamp_value, LAYOUT.size
    own_density_at = LAYOUT.body_density
    density_at = LAYOUT.density
    # the centre of buoyancy follows the volume
    volume_at, mass_at = LAYOUT.volume, LAYOUT.added_mass
    linear_at = LAYOUT.linear_damping
    quadratic_at = LAYOUT.quadratic_damping
    strip_count_at, strips_at, strip_size = LAYOUT.strip_count, LAYOUT.strips, LAYOUT.strip_size
    timestep_at = offset("mjModel", "opt.timestep")
    rate_at, ceiling_at, seen_at = LAYOUT.drag_rate, LAYOUT.ceiling, LAYOUT.seen
    set_gear_bounds = gear_kernel.build()
    singular_kind = int(mujoco.mjtWarning.mjWARN_INERTIA)

    # Gauss-Legendre rules on [0, 1]; row n has n stations, the other entries have weight zero.
    nodes, weights = np.zeros((2, MAX_STATIONS + 1, MAX_STATIONS))
    for n in range(1, MAX_STATIONS + 1):
        x, weight = np.polynomial.legendre.leggauss(n)
        nodes[n, :n], weights[n, :n] = 0.5 + 0.5 * x, 0.5 * weight

    # Scratch memory of each body: added mass (21), force (3), torque (3), a zero, acceleration with
    # qacc = 0 (angular 3, linear 3), and 1 if the body or a descendant has coefficients. Behind all
    # bodies: indices of the bodies that have coefficients.
    wrench, summed, acceleration, loaded, stride = 21, 28, 28, 34, 36

    soil = soil_force.build_push()
    motion = native_motion.build_motion()

    @c_function(types.void(types.intp, types.intp), error_model="numpy", fastmath={"contract"})
    def passive(m: int, d: int) -> None:
        soil(m, d)
        # The mark shows whether the added mass is included. It is read before the gears may set it.
        crb = _pointer(d, crb_at)
        dry = _f64(crb, 0) != WET_MARK
        if set_gear_bounds(m, d):
            _put(crb, 0, WET_MARK)

        nuser, user = _pointer(m, nuser_at), _pointer(m, user_at)
        if nuser < size:
            return
        nbody = _pointer(m, nbody_at)
        parent, root, tree = _pointer(m, parent_at), _pointer(m, root_at), _pointer(m, tree_at)
        dofnum, dofadr = _pointer(m, dofnum_at), _pointer(m, dofadr_at)
        xpos, xmat, com = _pointer(d, xpos_at), _pointer(d, xmat_at), _pointer(d, com_at)
        qvel, cvel = _pointer(d, qvel_at), _pointer(d, cvel_at)
        cdof, cdof_dot = _pointer(d, cdof_at), _pointer(d, cdof_dot_at)
        M, qfrc = _pointer(d, M_at), _pointer(d, passive_at)

        wind, surge, shear, known = motion(m, d)
        density = 0.0
        fastest = ceiling = NEVER
        ours = _f64(user, 0) == stamp
        if ours:  # a model from MJCF does not have the world's row
            density = _f64(user, density_at)
            ceiling = _f64(user, ceiling_at)
            if _f64(user, rate_at + 1) > 0.0:  # speed at which the drag rate equals 1 / timestep
                limit = max(
                    (1.0 / _f64(m + timestep_at, 0) - _f64(user, rate_at))
                    / _f64(user, rate_at + 1),
                    0.0,
                )
                fastest = limit * limit
            if not known and _is_new(user, seen_at, NO_CURRENT):
                _print_warning(_no_current_text())
        gravity = _load3(m + gravity_at, 0)
        if _i32(m + disable_at, 0) & gravity_off:
            gravity = (0.0, 0.0, 0.0)

        _mark_stack(d)
        scratch = _stack_numbers(d, nbody * (stride + 1) + 3)
        carrying, count = scratch + 8 * nbody * stride, 0
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
            if _i32(tree, i) >= 0 and _f64(user, nuser * i) == stamp:
                _put(here, loaded, 1.0)
                _put(carrying, count, float(i))
                count += 1
        if count == 0:
            _free_stack(d)
            return
        # fill up the last four with copies of the last body, whose results are not used
        for k in range(count, count + 3):
            _put(carrying, k, _f64(carrying, count - 1))

        too_fast, too_high = all_four(0.0), all_four(0.0)
        for k in range(0, count, 4):
            i, i1 = int(_f64(carrying, k)), int(_f64(carrying, k + 1))
            i2, i3 = int(_f64(carrying, k + 2)), int(_f64(carrying, k + 3))
            row = nuser * i, nuser * i1, nuser * i2, nuser * i3
            here = stride * i, stride * i1, stride * i2, stride * i3
            roots = 3 * _i32(root, i), 3 * _i32(root, i1), 3 * _i32(root, i2), 3 * _i32(root, i3)

            R = _lanes9(xmat, (9 * i, 9 * i1, 9 * i2, 9 * i3), 0)
            p = _lanes3(xpos, (3 * i, 3 * i1, 3 * i2, 3 * i3), 0)
            r = _minus(p, _lanes3(com, roots, 0))
            B, C, J = _body_blocks(user, row, mass_at)
            B, C, J = _at_reference(
                _turned_symmetric(R, B), _turned(R, C), _turned_symmetric(R, J), r
            )

            # Twist, relative twist and momentum of the water about the tree's centre of mass, in
            # world axes.
            w, v = _lanes6(cvel, (6 * i, 6 * i1, 6 * i2, 6 * i3), 0)
            a_w, a_v = _lanes6(scratch, here, acceleration)
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
            drag_f, drag_t = _drag(user, row, linear_at, quadratic_at, v_B, w_B)
            too_fast = (
                too_fast
                + at_least(_dot(v_B, v_B) - fastest, 0.0)
                + at_least(_dot(w_B, w_B) - fastest, 0.0)
            )
            too_high = too_high + at_least(p[2] - ceiling, 0.0)
            strips = 0
            for n in row:
                strips = max(strips, int(_f64(user, n + strip_count_at)))
            for n in range(min(strips, MAX_STRIPS)):
                at = strips_at + n * strip_size
                strip = row[0] + at, row[1] + at, row[2] + at, row[3] + at
                strip_f, strip_t = _strip_drag(user, strip, v_B, w_B, nodes, weights)
                drag_f, drag_t = _plus(drag_f, strip_f), _plus(drag_t, strip_t)
            drag_f = _times(R, drag_f)
            f = _plus(f, drag_f)
            t = _plus(t, _plus(_times(R, drag_t), _cross(r, drag_f)))

            # Buoyancy, and the pressure gradient that accelerates the water, at the centre of
            # buoyancy.
            volume, x, y, z = _gathered(user, row, volume_at)
            rho = four_of(
                _f64(user, row[0] + own_density_at),
                _f64(user, row[1] + own_density_at),
                _f64(user, row[2] + own_density_at),
                _f64(user, row[3] + own_density_at),
            )
            if density > 0.0:
                rho = all_four(density)
            lift = _scaled(rho * volume, _minus(flow, gravity))
            f = _plus(f, lift)
            t = _plus(t, _cross(_plus(r, _times(R, (x, y, z))), lift))
            _put_body(scratch, here, (B, C, J), f, t)

        if nuser > size:  # the body has forms, which are records behind its row
            for k in range(count):
                i = int(_f64(carrying, k))
                row1 = user + 8 * nuser * i
                if _f64(row1, size) == 0.0:
                    continue
                turn, p_body = _rows(xmat, 9 * i), _load3(xpos, 3 * i)
                lever = _minus(p_body, _load3(com, 3 * _i32(root, i)))
                w1, v1 = _load6(cvel, 6 * i)
                v1 = _minus(v1, _plus(wind, _scaled(p_body[2], shear)))
                back = _transposed(turn)
                f1, t1 = form_wrench(
                    row1,
                    size,
                    nuser,
                    mass_at,
                    _times(back, _plus(v1, _cross(w1, lever))),
                    _times(back, w1),
                )
                f1 = _times(turn, f1)
                t1 = _plus(_times(turn, t1), _cross(lever, f1))
                here1 = scratch + 8 * stride * i
                f0, t0 = _load6(here1, wrench)
                _put3(here1, wrench, _plus(f0, f1))
                _put3(here1, wrench + 3, _plus(t0, t1))

        if ours:
            put_four(scratch, 0, too_fast)  # the world needs no wrench
            put_four(scratch, 4, too_high)
            over = _f64(scratch, 0) + _f64(scratch, 1) + _f64(scratch, 2) + _f64(scratch, 3)
            if over > 0.0 and _is_new(user, seen_at, TOO_FAST):
                _print_warning(_fast_text())
            over = _f64(scratch, 4) + _f64(scratch, 5) + _f64(scratch, 6) + _f64(scratch, 7)
            if over > 0.0 and gravity[2] < 0.0 and _is_new(user, seen_at, TOO_HIGH):
                _print_warning(_high_text())

        rownnz, rowadr, colind = (
            _pointer(m, rownnz_at),
            _pointer(m, rowadr_at),
            _pointer(m, colind_at),
        )

        # From the leaves to the root: sums over the subtrees, projected onto the joints.
        for i in range(nbody - 1, 0, -1):
            here = scratch + 8 * stride * i
            if _f64(here, loaded) == 0.0:
                continue
            if _i32(tree, _i32(parent, i)) >= 0:
                above = scratch + 8 * stride * _i32(parent, i)
                if _f64(above, loaded) == 0.0:
                    _put(above, loaded, 1.0)
                    for k in range(0, summed, 4):
                        put_four(above, k, load_four(here, k))
                else:
                    for k in range(0, summed, 4):
                        put_four(above, k, load_four(above, k) + load_four(here, k))

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

        # M has changed after MuJoCo factored it.
        if dry:
            _put(crb, 0, WET_MARK)
            factored, inverse = _pointer(d, factored_at), _pointer(d, inverse_at)
            singular = _factor(M, factored, inverse, _pointer(m, nv_at), rownnz, rowadr, colind)
            if singular >= 0:
                _count_warning(d, singular_kind, singular)
                if ours:
                    _is_new(user, seen_at, INDEFINITE)

    return passive
