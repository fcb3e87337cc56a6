"""Search of a folded and a ready posture of an arm, for a model without keyframes for them.

Joint angles are drawn from a fixed seed within the limits, so that a model has the same postures
every time. Parts that touch in nearly every posture are neighbours whose shapes overlap, and do not
count as touching.

- `home` is compact. The arm is clear of the hull, of itself and of the camera's view, and the list
  of the vehicle in water is small.
- `ready` has the largest margin from singular postures and joint limits. The tool is ahead of the
  camera, at 40 to 75 % of the arm's reach.
"""

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.naming import CAMERA_SITE
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.spatial import Array

DRAWN = 3000  # number of drawn postures
# half angle of the cone around the camera's axis that the folded arm keeps clear
VIEW = float(np.radians(25.0))
_RINGS = 3  # number of rays within that angle
_SPOKES = 8  # number of rays of a ring
_FARTHEST = 3.0  # [m] range within which the view must be clear
_ALWAYS = 0.9  # share of postures from which on two touching parts are taken for neighbours
_TRIED = 400  # number of postures from which neighbours are recognised
_LOCAL = 60  # number of changes that are tried around the best posture in a round
_ROUNDS = 6  # number of rounds, each with changes half as large as those before
_LEVER = 0.4  # of the reach [m/rad]: weight of rotation against translation
_INSIDE = 0.4, 0.75  # distance of a ready tool, in shares of the reach
_ROOMY = 0.5  # [rad] or [m] distance from a joint limit from which on the limit no longer counts
_LISTS = 1.0  # [m/rad] weight of the vehicle's list against the arm's spread
_SPARE = 0.03  # share of a joint's range that a folded arm keeps from its ends


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundPosture:
    """A posture, with the figures by which it was chosen."""

    q: Array  # (n,) [rad]
    said: str  # its figures, as text


class PostureSearch:
    """Search of postures for the arm of one vehicle."""

    def __init__(self, model: mujoco.MjModel, *, trimmed: bool = False) -> None:
        """Copy the model of a vehicle, with collision enabled between all its parts.

        Args:
            model: compiled, without a scene. Shapes with collision disabled are used only if the
                vehicle has no others.
            trimmed: the hull will be ballasted to be level with the arm folded, so that its list in
                that posture does not count.

        Raises:
            ConfigurationError: the model has no vehicle with an arm.
        """
        self.vehicle = Vehicle.of(model)
        self._lists = 0.0 if trimmed else _LISTS
        self.model = model = copy(model)
        solid = (np.asarray(model.geom_contype) | np.asarray(model.geom_conaffinity)) > 0
        bits = (solid if solid.any() else np.ones_like(solid)).astype(np.int32)
        model.geom_contype[:] = model.geom_conaffinity[:] = bits
        model.body_contype[:] = model.body_conaffinity[:] = 1

        self.data = mujoco.MjData(self.model)
        vehicle = self.vehicle
        self._low = vehicle.q_limits[:, 0]
        self._high = vehicle.q_limits[:, 1]
        self._camera = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, CAMERA_SITE)

        # Shapes that move with the arm.
        first = int(model.jnt_bodyid[vehicle.joints[0]])
        moved = [b for b in range(model.nbody) if _carried(model, b, first)]
        self._arm_geoms = np.array(
            [g for g in range(model.ngeom) if model.geom_bodyid[g] in moved], dtype=np.int64
        )

        # Box of the hull, in its own axes.
        hull_geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == vehicle.hull]
        self._at(np.clip(np.zeros(len(self._low)), self._low, self._high))
        self._box = _box(model, self.data, hull_geoms, vehicle.hull)

    @cached_property
    def _drawn(self) -> Array:
        """Postures (DRAWN, n), the same ones every time."""
        return np.random.default_rng(0).uniform(self._low, self._high, (DRAWN, len(self._low)))

    @cached_property
    def _neighbours(self) -> set[tuple[int, int]]:
        """Pairs of bodies whose shapes touch in nearly every posture."""
        return self._always_touching(self._drawn[:_TRIED])

    @cached_property
    def _tips(self) -> Array:
        return np.array([self._tip(q) for q in self._drawn])

    @cached_property
    def reach(self) -> float:
        """Largest distance [m] of the tip from the arm's base."""
        return float(np.linalg.norm(self._tips, axis=1).max())

    @cached_property
    def _masses(self) -> tuple[np.ndarray, Array, Array]:
        """Bodies, net masses and moments, see `_net_masses`."""
        return _net_masses(self.model, self.vehicle.hull)

    def home(self) -> FoundPosture:
        """The folded posture."""
        spare = _SPARE * (self._high - self._low)
        inside = np.clip(self._drawn, self._low + spare, self._high - spare)
        costs = np.array([self._spread(q) for q in inside])

        # The most compact posture that is clear of everything.
        best = None
        cost = np.inf
        for i in np.argsort(costs, kind="stable"):
            if self.is_clear(inside[i]) and self.view_blocked(inside[i]) == 0.0:
                best = inside[i]
                cost = costs[i]
                break

        if best is None:  # no posture leaves the view free: the one that blocks least of it
            clear = [q for q in inside if self.is_clear(q)] or [inside[int(np.argmin(costs))]]
            best = min(clear[:200], key=lambda q: (self.view_blocked(q), self._spread(q)))
            return FoundPosture(
                q=best,
                said=f"{self.view_blocked(best):.0%} of the camera's view is blocked by the arm",
            )

        # Small changes of that posture, as long as they make it more compact.
        for q in self._around(best, spare):
            if (
                (spread := self._spread(q)) < cost
                and self.is_clear(q)
                and self.view_blocked(q) == 0.0
            ):
                best = q
                cost = spread

        return FoundPosture(q=best, said="clear of the hull, of itself and of the camera's view")

    def ready(self) -> FoundPosture:
        """The posture from which inverse kinematics start."""
        scores = np.array([self._readiness(q) for q in self._drawn])

        # The best drawn posture that is clear.
        best = self._drawn[int(np.argmax(scores))]
        score = -np.inf
        for i in np.argsort(-scores, kind="stable"):
            if self.is_clear(self._drawn[i]):
                best = self._drawn[i]
                score = scores[i]
                break

        # Small changes of that posture.
        for q in self._around(best, np.zeros(len(self._low))):
            if (trial_score := self._readiness(q)) > score and self.is_clear(q):
                best = q
                score = trial_score

        far = float(np.linalg.norm(self._tip(best)))
        return FoundPosture(
            q=best,
            said=f"tip {far:.2f} m from the arm's base ({far / self.reach:.0%} of its reach), "
            f"smallest singular value {self.singular_value(best):.2g}",
        )

    def drawn_tips(self) -> Array:
        """Positions (DRAWN, 3) [m] of the tip in the drawn postures, hull axes."""
        return (
            self._tips @ self.data.xmat[self.vehicle.hull].reshape(3, 3) + self.vehicle.X_BA[:3, 3]
        )

    def share_touching(self, turned: int | None = None, count: int = _TRIED) -> float:
        """Share of the first `count` drawn postures in which the arm touches the hull or itself.

        Args:
            turned: index of a joint whose axis is taken in the opposite direction; None: no joint.
            count: number of postures.
        """
        postures = np.array(self._drawn[:count])
        if turned is not None:
            postures[:, turned] *= -1.0
        return float(np.mean([not self.is_clear(q) for q in postures]))

    def is_clear(self, q: Array) -> bool:
        """True if the arm touches neither the hull nor itself at joint angles `q` (n,)."""
        return not self.touching(q)

    def touching(self, q: Array) -> set[tuple[int, int]]:
        """Pairs of bodies that touch at `q` (n,), without neighbours."""
        self._at(q)
        mujoco.mj_collision(self.model, self.data)
        return _touching(self.model, self.data) - self._neighbours

    def view_blocked(self, q: Array) -> float:
        """Share of the rays within VIEW of the camera's axis that hit arm or hull at `q` (n,)."""
        return self.view_hits(q)[0]

    def view_hits(self, q: Array, half_angle: float = VIEW) -> tuple[float, str]:
        """Share of the camera's rays that hit the vehicle, and the body that most of them hit (""
        without a camera).

        Args:
            q: (n,) joint angles.
            half_angle: [rad] of the cone of rays around the camera's axis.
        """
        if self._camera < 0:
            return 0.0, ""

        self._at(q)
        model = self.model
        data = self.data
        R = data.site_xmat[self._camera].reshape(3, 3)
        p = data.site_xpos[self._camera]
        hit = np.full(1, -1, dtype=np.int32)
        hits: list[int] = []
        rays = list(_fan(half_angle))

        for ray in rays:
            distance = mujoco.mj_ray(model, data, p, R @ ray, None, 1, -1, hit)
            if (
                0.0 <= distance < _FARTHEST
                and int(hit[0]) >= 0
                and not self._behind_lens(int(hit[0]), distance)
            ):
                hits.append(int(model.geom_bodyid[hit[0]]))

        most = max(set(hits), key=hits.count) if hits else -1
        return len(hits) / len(rays), model.body(most).name if most >= 0 else ""

    def singular_value(self, q: Array) -> float:
        """Smallest singular value [-] of the tip's Jacobian, scaled by the reach and `_LEVER`."""
        self._at(q)
        return self._singular_value()

    def _singular_value(self) -> float:
        """`singular_value` at the present posture."""
        model = self.model
        data = self.data
        dof = self.vehicle.dof
        jac = np.zeros((6, model.nv))
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, jac[:3], jac[3:], self.vehicle.tip)

        # Lengths as shares of the reach, comparable with rotations.
        J = jac[:, dof]
        J[:3] /= self.reach
        J[3:] *= _LEVER

        singular_values = np.linalg.svd(J, compute_uv=False)
        return float(singular_values[min(6, len(dof)) - 1])

    def tip_axis(self, q: Array) -> tuple[Array, Array]:
        """Position (3,) [m] of the tip in hull axes, direction (3,) of the tool at `q` (n,)."""
        self._at(q)
        return self._tip_axis()

    def _tip_axis(self) -> tuple[Array, Array]:
        """`tip_axis` at the present posture."""
        vehicle = self.vehicle
        data = self.data
        R_WB = data.xmat[vehicle.hull].reshape(3, 3)
        p = data.xpos[vehicle.hull]
        return R_WB.T @ (data.site_xpos[vehicle.tip] - p), R_WB.T @ data.site_xmat[
            vehicle.tip
        ].reshape(3, 3)[:, 2]

    def _behind_lens(self, geom: int, distance: float) -> bool:
        """True for a shape of the hull that is the camera's housing. Its window is not modelled."""
        return distance < 1e-3 or (
            self._within(geom) and int(self.model.geom_bodyid[geom]) == self.vehicle.hull
        )

    def _within(self, geom: int) -> bool:
        """True if the camera is inside the bounding sphere of a small geom, such as its housing."""
        model = self.model
        data = self.data
        away = float(np.linalg.norm(data.geom_xpos[geom] - data.site_xpos[self._camera]))
        return away < float(model.geom_rbound[geom]) < 0.15

    def _readiness(self, q: Array) -> float:
        room = float(np.minimum(q - self._low, self._high - q).min())
        reach = self.reach  # this may search for a posture, so it comes before the posture is set
        self._at(q)
        sigma = self._singular_value()
        p_BG, z_BG = self._tip_axis()
        far = float(np.linalg.norm(p_BG - self.vehicle.X_BA[:3, 3])) / reach

        # Far from singular postures and joint limits, at a medium share of the reach.
        score = sigma * min(1.0, max(room, 0.0) / _ROOMY)
        score *= max(0.1, 1.0 - 4.0 * max(0.0, _INSIDE[0] - far, far - _INSIDE[1]))

        # The tool points along the camera's view, and is ahead of the camera.
        if self._camera >= 0:
            data = self.data
            R_WB = data.xmat[self.vehicle.hull].reshape(3, 3)
            p_BC = R_WB.T @ (data.site_xpos[self._camera] - data.xpos[self.vehicle.hull])
            z_BC = R_WB.T @ data.site_xmat[self._camera].reshape(3, 3)[:, 2]
            view_B = (p_BG - p_BC) / max(float(np.linalg.norm(p_BG - p_BC)), 1e-9)
            score *= (0.5 + 0.5 * max(0.0, float(z_BG @ z_BC))) * (
                0.5 + 0.5 * max(0.0, float(view_B @ z_BC))
            )

        return score

    def _around(self, q: Array, spare: Array) -> Iterator[Array]:
        """Postures near `q`, at decreasing distances, drawn from the same seed every time."""
        rng = np.random.default_rng(1)
        wide = 0.1 * (self._high - self._low)
        for _ in range(_ROUNDS):
            for _ in range(_LOCAL):
                yield np.clip(
                    q + wide * rng.standard_normal(len(q)), self._low + spare, self._high - spare
                )
            wide = 0.5 * wide

    def _at(self, q: Array) -> None:
        self.data.qpos[self.vehicle.qpos] = q
        mujoco.mj_kinematics(self.model, self.data)

    def _tip(self, q: Array) -> Array:
        """Vector (3,) [m] from the arm's base to the tip, W."""
        self._at(q)
        return self.data.site_xpos[self.vehicle.tip] - self.data.xpos[self.vehicle.arm_base]

    def _spread(self, q: Array) -> float:
        """Distance [m] by which the arm at `q` (n,) leaves the hull's box, plus weighted list."""
        self._at(q)
        model = self.model
        data = self.data
        hull = self.vehicle.hull
        positions = [data.geom_xpos[self._arm_geoms], data.site_xpos[[self.vehicle.tip]]]
        p_B = (np.vstack(positions) - data.xpos[hull]) @ data.xmat[hull].reshape(3, 3)
        radius = np.append(model.geom_rbound[self._arm_geoms], 0.0)

        out = np.maximum(np.maximum(self._box[0] - p_B, p_B - self._box[1]), 0.0)
        return float((np.linalg.norm(out, axis=1) + radius).max()) + self._lists * min(
            _list_angle(data, hull, self._masses), 1.0
        )

    def _always_touching(self, postures: Array) -> set[tuple[int, int]]:
        counts: dict[tuple[int, int], int] = {}
        for q in postures:
            self._at(q)
            mujoco.mj_collision(self.model, self.data)
            for pair in _touching(self.model, self.data):
                counts[pair] = counts.get(pair, 0) + 1
        return {pair for pair, count in counts.items() if count >= _ALWAYS * len(postures)}


def set_posture(
    spec: mujoco.MjSpec,
    key: str,
    joints: Sequence[str],
    values: Mapping[str, float] | Sequence[float],
    name: str,
) -> None:
    """Add a keyframe of stated joint values; it replaces a keyframe of that name.

    Args:
        spec: vehicle with an arm.
        key: name of the keyframe.
        joints: of the arm, base to tip.
        values: [rad] or [m] of all joints, or of some by name; the other joints are at zero, or at
            the limit nearest to zero.
        name: first words of error messages.

    Raises:
        ConfigurationError: the number of values is wrong, a joint is unknown, or a value is out of
            range.
    """
    if not isinstance(values, Mapping):
        if len(values) != len(joints):
            raise ConfigurationError(
                f"{name}: must have {len(joints)} joint values, for {', '.join(joints)}; got "
                f"{len(values)}"
            )
        values = dict(zip(joints, values, strict=True))
    if unknown := [joint for joint in values if joint not in joints]:
        raise ConfigurationError(
            f"{name}: unknown joint {unknown[0]!r}; the arm has "
            f"{', '.join(joints)}{did_you_mean(unknown[0], joints)}"
        )

    for old in [old for old in spec.keys if old.name == key]:
        spec.delete(old)
    model = spec.compile()
    qpos = np.array(model.qpos0)
    for joint in joints:
        low, high = model.joint(joint).range
        value = values.get(joint, float(np.clip(0.0, low, high)))
        if not low <= value <= high:
            raise ConfigurationError(
                f"{name}: joint {joint!r} must be within its range {low:.4g} to {high:.4g}, got "
                f"{value:g}"
            )
        qpos[model.joint(joint).qposadr[0]] = value
    spec.add_key(name=key, qpos=qpos)


def _fan(half_angle: float) -> Iterator[Array]:
    """Unit vectors (3,) of rays around z, on rings up to `half_angle` [rad]."""
    yield np.array([0.0, 0.0, 1.0])
    for ring in range(1, _RINGS + 1):
        tilt = half_angle * ring / _RINGS
        for spoke in range(_SPOKES):
            turn = 2.0 * np.pi * spoke / _SPOKES
            yield np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])


def _net_masses(model: mujoco.MjModel, hull: int) -> tuple[np.ndarray, Array, Array]:
    """Bodies (b,), masses minus displaced water (b,) [kg], and moments of both in the body (b, 3)
    [kg m].

    Empty arrays where the hull has no water.
    """
    if not hydrodynamics.carries(model.body_user[hull]):
        return np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 3))

    density = hydrodynamics.water_density(model)
    bodies = np.flatnonzero(model.body_rootid == model.body_rootid[hull])
    net = np.array(model.body_mass[bodies])
    local = model.body_mass[bodies, None] * model.body_ipos[bodies]
    for i, body in enumerate(bodies):
        if hydrodynamics.carries(model.body_user[body]):
            water = hydrodynamics.unpack(model.body_user[body])
            net[i] -= density * water.volume
            local[i] -= density * water.volume * water.center_of_buoyancy

    return bodies, net, local


def _list_angle(data: mujoco.MjData, hull: int, masses: tuple[np.ndarray, Array, Array]) -> float:
    """List [rad] of a vehicle with `_net_masses`; 0 without water, or if it is unstable."""
    bodies, net, local = masses
    if not bodies.size:
        return 0.0

    # [kg m] moment of masses minus displaced water, world axes
    moment = net @ (data.xpos[bodies] - data.xpos[hull])
    moment += np.einsum("bij,bj->i", data.xmat[bodies].reshape(-1, 3, 3), local)
    moment = moment @ data.xmat[hull].reshape(3, 3)
    return float(np.hypot(*moment[:2]) / -moment[2]) if moment[2] < 0.0 else 0.0


def _touching(model: mujoco.MjModel, data: mujoco.MjData) -> set[tuple[int, int]]:
    """Pairs of bodies, the lower index first, whose shapes touch in `data`."""
    contact = data.contact
    pairs = set()
    for i in range(data.ncon):
        if contact.dist[i] > 0.0:
            continue
        a, b = (int(model.geom_bodyid[g]) for g in contact.geom[i])
        pairs.add((min(a, b), max(a, b)))
    return pairs


def _carried(model: mujoco.MjModel, body: int, by: int) -> bool:
    while body not in (0, by):
        body = int(model.body_parentid[body])
    return body == by


def _box(model: mujoco.MjModel, data: mujoco.MjData, geoms: list[int], hull: int) -> Array:
    """Corners (2, 3) [m] in hull axes of the box around `geoms`; a point without geoms."""
    if not geoms:
        return np.zeros((2, 3))
    R = data.xmat[hull].reshape(3, 3)
    p = data.xpos[hull]

    low = np.full(3, np.inf)
    high = np.full(3, -np.inf)
    for g in geoms:
        R_BG = R.T @ data.geom_xmat[g].reshape(3, 3)
        centre = R.T @ (data.geom_xpos[g] - p) + R_BG @ model.geom_aabb[g, :3]
        half = np.abs(R_BG) @ model.geom_aabb[g, 3:]
        low = np.minimum(low, centre - half)
        high = np.maximum(high, centre + half)

    return np.array([low, high])
