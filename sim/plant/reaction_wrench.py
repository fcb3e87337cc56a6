"""Joint reaction wrench of a subtree on its parent, including water, contacts and constraints.

MuJoCo's force and torque sensors miss everything in `qfrc_passive`, including the water. Newton's
second law for the whole subtree gives the wrench that its joint transmits, for any type of joint:

    wrench on the parent = sum of (water + weight + contacts and other loads - rate of momentum)

`mj_rnePostConstraint` sums all forces except those of water, soil, thrusters on sites and gravity
compensation, from the accelerations `data.qacc`. The forces of the water are summed here for each
body in body axes, independently of the passive callback, by the equation in `uuv.sim.hydrodynamics`
with the total acceleration.

Forces at joints (motors, springs, limits, `qfrc_applied`) act between the two bodies that the joint
connects, and are part of the transmitted wrench. An external force belongs in `xfrc_applied`.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import LAYOUT
from uuv.models.site import soil_bed
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array
from uuv.sim.native.form_kernel import form_wrench
from uuv.sim.plant.soil_contact import SoilContact, feel_soil
from uuv.sim.water.water_motion import FLOW, place_of

# relative mismatch of velocities above which the values in `data` belong to two different times
_STALE = 1e-9
_GRAVITY_OFF = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
_ROW = int(LAYOUT.size)
_MASS_AT = int(LAYOUT.added_mass)
_KIND_AT = int(FLOW.kind)
_VELOCITY_AT = int(FLOW.velocity)
_ACCELERATION_AT = int(FLOW.acceleration)
_SHEAR_AT = int(FLOW.shear)
_UNIFORM = float(FLOW.uniform)
_NOTHING = np.zeros(3)  # no gravity [m/s^2], or no torque [N m]


class ReactionWrench:
    """Wrench of one subtree on its parent; set up once per model, 10 to 20 us per measurement."""

    def __init__(
        self, model: mujoco.MjModel, body: int | str, frame: int | str | None = None
    ) -> None:
        """Set up the measurement.

        Args:
            model: Compiled model.
            body: Root of the subtree.
            frame: Body in whose frame the wrench is expressed; default: `body`.

        Raises:
            ConfigurationError: A body is unknown, or `body` is the world.
            HydrodynamicsError: The model has forces whose effect on the subtree is not known here:
                flexes, spatial tendons, gravity compensation by actuators, and actuators on
                slider-cranks, on contacts or between two sites.
        """
        self._model = model
        self._body = _body(model, body)
        self._frame = self._body if frame is None else _body(model, frame)
        if self._body == 0:
            raise ConfigurationError("reaction: the world has no parent")
        _refuse(model)

        # Bodies of the subtree.
        last = self._body + 1
        # bodies come depth first
        while last < model.nbody and model.body_parentid[last] >= self._body:
            last += 1
        carried = range(self._body, last)
        self._span = last

        self._joints = model.body_parentid, model.body_dofadr, model.body_dofnum
        self._root = int(model.body_rootid[self._body])

        # External forces on the subtree: water, thrusters, soil, gravity compensation.
        self._wet = [i for i in carried if water.carries(model.body_user[i])]
        self._water = _water_of(model, self._wet)

        sites = mujoco.mjtTrn.mjTRN_SITE
        self._thrusters = [
            i
            for i in range(model.nu)
            if model.actuator_trntype[i] == sites
            and model.site_bodyid[model.actuator_trnid[i, 0]] in carried
        ]

        soil = soil_bed.actuator_of(model)
        face = int(model.actuator_trnid[soil, 0]) if soil >= 0 else -1
        # site in the soil
        self._dug = face if face >= 0 and model.site_bodyid[face] in carried else -1

        self._lifted = [i for i in carried if model.body_gravcomp[i] != 0.0]
        self._total = np.zeros(6)

    def wrench(
        self, data: mujoco.MjData, qvel: Array | None = None, soil_W: Array | None = None
    ) -> Array:
        """Wrench (6,) [N, N m] on the parent, (force; torque) in the axes of the frame's body.

        Writes `data.cacc`, `cfrc_int` and `cfrc_ext`, as MuJoCo's sensors do.

        Args:
            data: Data after `mj_forward`.
            qvel: Joint velocities (nv,) at the time of the forces. Needed after `mj_step`, which
                advances the velocities one step beyond the other values.
            soil_W: Force (3,) [N] of the soil on the tool, W. Also needed after `mj_step`, if the
                model has soil.

        Returns:
            The wrench.

        Raises:
            HydrodynamicsError: The velocities and the forces belong to different times, the force
                of the soil is missing, or the model has hydrodynamics and the callback is not
                installed.
        """
        model = self._model
        if self._wet and not hydrodynamics.is_installed():
            raise HydrodynamicsError(
                "reaction: the hydrodynamics were not included in the last forward pass; call "
                "uuv.sim.hydrodynamics.install() before it"
            )

        # Forces of the present state, with the velocity at the same time.
        if qvel is None:
            mujoco.mj_rnePostConstraint(model, data)
            velocity = data.qvel
        else:
            ahead = data.qvel.copy()
            velocity = np.asarray(qvel, dtype=np.float64)
            data.qvel = velocity
            mujoco.mj_rnePostConstraint(model, data)
            data.qvel = ahead

        total, body = self._total, self._body
        cvel = data.cvel
        if _mismatch(body, self._span, *self._joints, data.cdof, cvel, velocity) > _STALE:
            raise HydrodynamicsError(
                "reaction: data.qvel and the forces in data belong to different times; call "
                "mj_forward first, or give the velocity before the step as qvel"
            )

        # After subtracting the external forces, the wrench of the joint remains.
        com, xpos, xmat = data.subtree_com[self._root], data.xpos, data.xmat
        gravity = _NOTHING if model.opt.disableflags & _GRAVITY_OFF else model.opt.gravity

        interaction = data.cfrc_int[body]
        total[:3], total[3:] = -interaction[3:], -interaction[:3]

        if self._wet:
            motion = xpos, xmat, cvel, data.cacc
            _add_water(self._water, data.userdata, motion, com, gravity, total)

        for i in self._thrusters:
            site = model.actuator_trnid[i, 0]
            gear = (
                data.actuator_force[i]
                * model.actuator_gear[i].reshape(2, 3)
                @ data.site_xmat[site].reshape(3, 3).T
            )
            _add(total, gear[0], gear[1], data.site_xpos[site] - com)

        if self._dug >= 0:
            _add(total, self._soil(data, qvel, soil_W), _NOTHING, data.site_xpos[self._dug] - com)

        for i in self._lifted:
            lift = -model.body_gravcomp[i] * model.body_mass[i] * gravity
            _add(total, lift, _NOTHING, data.xipos[i] - com)

        return _in_frame(total, xmat[self._frame], xpos[self._frame], com)

    def _soil(self, data: mujoco.MjData, qvel: Array | None, soil_W: Array | None) -> Array:
        """Force (3,) [N] of the soil on the tool, W, at the time of the other forces."""
        if soil_W is not None:
            return soil_W
        if qvel is not None:
            raise HydrodynamicsError(
                "reaction: after a step the state of the soil is one step ahead; give the force "
                "of the soil as soil_W"
            )

        contact = SoilContact.of(self._model, data)
        feel_soil(contact)
        return contact.force[1:]


def wrench(
    model: mujoco.MjModel, data: mujoco.MjData, body: int | str, frame: int | str | None = None
) -> Array:
    """Wrench (6,) of a subtree on its parent: `ReactionWrench(model, body, frame).wrench(data)`.

    Args:
        model: Compiled model.
        data: Data after `mj_forward`.
        body: Root of the subtree.
        frame: Body in whose frame the wrench is expressed; default: `body`.

    Returns:
        Wrench (6,) [N, N m] on the parent.

    Raises:
        ConfigurationError: As for `ReactionWrench`.
        HydrodynamicsError: As for `ReactionWrench`.
    """
    return ReactionWrench(model, body, frame).wrench(data)


class _Water(NamedTuple):
    """Coefficients of the bodies with hydrodynamics, and the place of the current."""

    bodies: np.ndarray  # (k,) indices
    matrices: Array  # (k, 2, 6, 6) added mass, linear damping
    vectors: Array  # (k, 10) quadratic damping (6), centre of buoyancy (3), displaced mass
    stations: Array  # (s, 9) row of the body, position, axis, normal and tangential drag
    rows: np.ndarray  # (k,) addresses of the user data of bodies with forms; 0 for others
    width: int  # number of entries in a row of user data
    place: int  # index of the current in `data.userdata`; -1: there is none
    wind: Array  # (3,) [m/s] current of the model; a view, like the next array
    flow: Array  # (6,) its acceleration [m/s^2] and shear [1/s]


def _water_of(model: mujoco.MjModel, wet: list[int]) -> _Water:
    bodies = [water.unpack(model.body_user[i]) for i in wet]
    matrices = np.zeros((len(wet), 2, 6, 6))
    vectors = np.zeros((len(wet), 10))

    stations = []

    for k, body in enumerate(bodies):
        matrices[k] = body.added_mass, body.linear_damping
        displaced = water.water_density(model) * body.volume
        vectors[k] = [*body.quadratic_damping, *body.center_of_buoyancy, displaced]

        # Gauss-Legendre stations along each strip.
        for strip in body.segments:
            along = strip.end - strip.start
            length = float(np.linalg.norm(along))
            for node, weight in zip(*np.polynomial.legendre.leggauss(strip.stations), strict=True):
                share = 0.5 * weight * length
                p_node = strip.start + 0.5 * (1.0 + node) * along
                stations.append(
                    [k, *p_node, *(along / length), share * strip.normal, share * strip.tangential]
                )

    first = model.body_user.ctypes.data
    rows = [
        first + 8 * model.nuser_body * i if body.terms else 0
        for i, body in zip(wet, bodies, strict=True)
    ]

    return _Water(
        bodies=np.array(wet, dtype=np.int64),
        matrices=matrices,
        vectors=vectors,
        stations=np.array(stations).reshape(-1, 9),
        rows=np.array(rows, dtype=np.int64),
        width=int(model.nuser_body),
        place=place_of(model),
        wind=model.opt.wind,
        flow=model.body_user[0, LAYOUT.current_acceleration :][:6],
    )


def _body(model: mujoco.MjModel, body: int | str) -> int:
    if isinstance(body, str):
        number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body)
        if number < 0:
            names = ", ".join(model.body(i).name for i in range(1, model.nbody))
            raise ConfigurationError(f"reaction: no such body: {body}; the model has {names}")
        return number

    if not 0 <= body < model.nbody:
        raise ConfigurationError(
            f"reaction: no such body: {body}; the model has 0 to {model.nbody - 1}"
        )
    return int(body)


def _refuse(model: mujoco.MjModel) -> None:
    """Raise HydrodynamicsError for forces whose effect on a subtree is not known here; the message
    names them.
    """
    kinds = model.actuator_trntype
    trn = mujoco.mjtTrn
    unsupported = {
        "flexes": model.nflex > 0,
        "spatial tendons": model.nwrap > 0
        and np.any(model.wrap_type != mujoco.mjtWrap.mjWRAP_JOINT),
        "slider-cranks": np.any(kinds == trn.mjTRN_SLIDERCRANK),
        "actuators on contacts (transmission body)": np.any(kinds == trn.mjTRN_BODY),
        "actuators between two sites (refsite)": np.any(
            (kinds == trn.mjTRN_SITE) & (model.actuator_trnid[:, 1] >= 0)
        ),
        "gravity compensation by actuators (actuatorgravcomp)": np.any(model.jnt_actgravcomp),
    }

    if names := [name for name, present in unsupported.items() if present]:
        raise HydrodynamicsError(
            f"reaction: the wrench cannot be computed for a model with {', '.join(names)}"
        )


@kernel
def _three(values, first):
    return values[first], values[first + 1], values[first + 2]


@kernel
def _sum(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def _scaled(s, a):
    return s * a[0], s * a[1], s * a[2]


@kernel
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _turned(R, a):
    return _dot(R[0:3], a), _dot(R[3:6], a), _dot(R[6:9], a)


@kernel
def _turned_back(R, a):
    return _dot(R[0::3], a), _dot(R[1::3], a), _dot(R[2::3], a)


@kernel
def _add(total, force, torque, lever):
    """Add a wrench that acts at `lever` from the reference point."""
    moment = _cross(lever, force)
    for k in range(3):
        total[k] += force[k]
        total[3 + k] += torque[k] + moment[k]


@kernel
def _in_frame(total, R, p, com):
    """Wrench about `com` in world axes, expressed at `p` in the axes `R`."""
    out = np.empty(6)
    force = _three(total, 0)
    out[:3] = _turned_back(R, force)

    lever = com[0] - p[0], com[1] - p[1], com[2] - p[2]
    out[3:] = _turned_back(R, _sum(_three(total, 3), _cross(lever, force)))
    return out


@kernel
def _mismatch(first, end, parent, dofadr, dofnum, cdof, cvel, qvel):
    """Largest difference between twists in `cvel` and twists computed from `qvel`, over the largest
    speed.
    """
    worst = 0.0
    largest = 1e-3

    for i in range(first, end):
        for k in range(6):
            residual = cvel[i, k] - cvel[parent[i], k]
            largest = max(largest, abs(cvel[i, k]))
            for j in range(dofadr[i], dofadr[i] + dofnum[i]):
                residual -= cdof[j, k] * qvel[j]
                largest = max(largest, abs(cdof[j, k] * qvel[j]))
            worst = max(worst, abs(residual))

    return worst / largest


@kernel
def _add_water(of_water, userdata, motion, com, gravity, total):
    """Add the water's wrench on every body with coefficients to `total`, about `com`, in world axes
    (force; torque).

    Args:
        of_water: `_Water`.
        userdata: (nuserdata,) User data of the simulation.
        motion: MuJoCo's xpos, xmat, cvel and cacc of all bodies.
        com: (3,) [m]
        gravity: (3,) [m/s^2]
        total: (6,), added to.
    """
    bodies, matrices, vectors, stations, rows, width, at, wind_of_model, flow_of_model = of_water
    xpos, xmat, cvel, cacc = motion
    nudot = np.empty(6)
    nu = np.empty(6)
    momentum = np.empty(6)
    f = np.empty(6)

    # The current of the simulation or, without one, of the model.
    wind = _three(wind_of_model, 0)
    surge = _three(flow_of_model, 0)
    shear = _three(flow_of_model, 3)
    if at >= 0 and userdata[at + _KIND_AT] == _UNIFORM:
        wind = _three(userdata, at + _VELOCITY_AT)
        surge = _three(userdata, at + _ACCELERATION_AT)
        shear = _three(userdata, at + _SHEAR_AT)

    station = 0
    for k in range(len(bodies)):
        i = bodies[k]
        R = xmat[i]
        z = xpos[i, 2]
        r = xpos[i, 0] - com[0], xpos[i, 1] - com[1], z - com[2]
        current = _sum(wind, _scaled(z, shear))
        stream = _sum(surge, _scaled(current[2], shear))  # acceleration of the water

        weightless = _sum(stream, _scaled(-1.0, gravity))

        # Twist and its rate relative to the water, body axes.
        u = _turned_back(R, current)
        w_W = _three(cvel[i], 0)
        wdot_W = _three(cacc[i], 0)
        w = _turned_back(R, w_W)
        wdot = _turned_back(R, wdot_W)

        # `cacc` is the spatial acceleration, less gravity; converted to the rate of the twist at
        # the body origin.
        a = _sum(_three(cacc[i], 3), _sum(_cross(wdot_W, r), _scaled(-1.0, weightless)))
        a = _sum(_turned_back(R, a), _cross(w, u))
        v = _sum(_turned_back(R, _sum(_three(cvel[i], 3), _cross(w_W, r))), _scaled(-1.0, u))

        for n in range(3):
            nudot[n], nudot[3 + n], nu[n], nu[3 + n] = a[n], wdot[n], v[n], w[n]

        # Added mass and damping.
        added = matrices[k, 0]
        linear = matrices[k, 1]
        numbers = vectors[k]
        for n in range(6):
            momentum[n], f[n] = 0.0, -numbers[n] * abs(nu[n]) * nu[n]
            for m in range(6):
                momentum[n] += added[n, m] * nu[m]
                f[n] -= added[n, m] * nudot[m] + linear[n, m] * nu[m]

        # Coriolis terms of the added mass.
        p = _three(momentum, 0)
        _add(
            f,
            _scaled(-1.0, _cross(w, p)),
            _scaled(-1.0, _cross(w, _three(momentum, 3))),
            (0.0, 0.0, 0.0),
        )
        _add(f, (0.0, 0.0, 0.0), _scaled(-1.0, _cross(v, p)), (0.0, 0.0, 0.0))

        # Strips.
        while station < len(stations) and stations[station, 0] == k:
            row = stations[station]
            p_element = _three(row, 1)
            axis = _three(row, 4)
            slip = _sum(v, _cross(w, p_element))
            along = _dot(slip, axis)
            across = _sum(slip, _scaled(-along, axis))
            drag = _sum(
                _scaled(-row[7] * np.sqrt(_dot(across, across)), across),
                _scaled(-row[8] * abs(along) * along, axis),
            )
            _add(f, drag, (0.0, 0.0, 0.0), p_element)
            station += 1

        if rows[k]:
            force, torque = form_wrench(rows[k], _ROW, width, _MASS_AT, v, w)
            _add(f, force, torque, (0.0, 0.0, 0.0))

        # Buoyancy.
        lift = _scaled(numbers[9], _turned_back(R, weightless))
        _add(f, lift, (0.0, 0.0, 0.0), _three(numbers, 6))

        _add(total, _turned(R, _three(f, 0)), _turned(R, _three(f, 3)), r)
