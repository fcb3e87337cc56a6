"""Choice of a grasp at the site: from above, clear of the object and of the ground.

The jaws close along a grasp's line and come from above, as steeply as the line allows. What they
touch first are the outermost points between their pads, not the two of the grasp; the width there
and the offset are computed from points of the surface. Grasps are ranked by their smallest margin:

- friction: the normals' slope against the coefficient of the pads,
- flatness: how far the pads meet the object away from the two points,
- moment: how far beside the line its weight acts,
- room: of the open jaws beside the object.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from uuv.models.objects.grasps import Grasp, antipodal, surface_points
from uuv.models.objects.target_model import TargetModel
from uuv.models.tools.jaw_shape import JawShape
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array, inverse, pose, readonly, transform_points

_POINTS = 4000  # of the surface, against which the jaws are tested
_LEAST_COVER = 0.003  # [m] of the pads' ends below the line, the least that counts as a grasp


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspLimits:
    """Limits that a grasp has to keep."""

    tilt: float = np.radians(25.0)  # [rad] of the closing line from the horizontal
    beside: float = 0.012  # [m] of each open jaw beside the object, at best
    least: float = 0.004  # [m] the same, at least
    ground: float = 0.006  # [m] of the fingers' ends above the ground
    deep: float = 0.02  # [m] by which the fingers reach below the line, at best
    aside: float = 0.03  # [m] lever of the weight about the line, which the pads just bear
    uneven: float = 0.012  # [m] by which the pads meet the object wider than at the two points


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedGrasp:
    """A grasp at the site: pose of the tool when the jaws close."""

    X_WG: Array  # (4, 4) tool pose, its origin between the fingers' ends
    width: float  # [m] between the pads when they have closed
    opening: float  # [m] of the jaws on the way to it
    margin: float  # [-] smallest of the margins: 1 is the best, 0 a limit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GraspChoice:
    """Grasps of one object for one gripper."""

    target: TargetModel
    jaws: JawShape
    limits: GraspLimits = field(default_factory=GraspLimits)
    grasps: tuple[Grasp, ...] = ()
    points_T: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (k, 3) [m] of the surface

    @classmethod
    def of(
        cls, target: TargetModel, jaws: JawShape, limits: GraspLimits | None = None
    ) -> "GraspChoice":
        """Grasps that the object declares, or those that its mesh has.

        Raises:
            ConfigurationError: there is none, or all are too wide.
        """
        limits = limits or GraspLimits()
        vertices = target.vertices
        triangles = target.triangles
        known = tuple(target.grasps.values())
        known = known or antipodal(vertices, triangles, friction=jaws.friction)
        widest = jaws.opening - 2.0 * limits.least
        narrow = tuple(grasp for grasp in known if grasp.width <= widest)

        if not known:
            raise ConfigurationError(
                f"object {target.name!r}: no two places of its surface face each other within "
                f"the friction of {jaws.friction:g}; it needs declared grasps"
            )
        if not narrow:
            least = min(grasp.width for grasp in known)
            raise ConfigurationError(
                f"object {target.name!r} is too wide for the jaws: {1e3 * least:.0f} mm at its "
                f"narrowest grasp; they take {1e3 * widest:.0f} mm"
            )

        points, _ = surface_points(vertices, triangles, _POINTS)
        return cls(target=target, jaws=jaws, limits=limits, grasps=narrow, points_T=points)

    def ranked(self, X_WT: Array, floor: float) -> Sequence[PlacedGrasp]:
        """Grasps of the object at `X_WT` (4, 4) on ground at the height `floor` [m], best first.

        Raises:
            ReachError: none is possible; the message says why.
        """
        points_W = transform_points(X_WT, self.points_T)
        center_W = transform_points(X_WT, self.target.center)
        refused: Counter[str] = Counter()
        placed = []
        for grasp in self.grasps:
            outcome = self._placed(grasp, X_WT, points_W, center_W, floor)
            if isinstance(outcome, str):
                refused[outcome] += 1
            else:
                placed.append(outcome)

        if not placed:
            reasons = ", ".join(f"{count} {why}" for why, count in refused.most_common())
            raise ReachError(f"no grasp from above of {len(self.grasps)}: {reasons}")
        return sorted(placed, key=lambda grasp: -grasp.margin)

    def _placed(
        self, grasp: Grasp, X_WT: Array, points_W: Array, center_W: Array, floor: float
    ) -> PlacedGrasp | str:
        """The grasp at the site, or the reason why it is not possible."""
        limits = self.limits
        jaws = self.jaws
        x = X_WT[:3, :3] @ grasp.x
        if abs(x[2]) > np.sin(limits.tilt):
            return "too steep"

        # The tool comes from above, square to the line.
        z = np.array([0.0, 0.0, -1.0])
        z -= (z @ x) * x
        z /= np.linalg.norm(z)
        middle = transform_points(X_WT, grasp.p)
        room = (middle[2] - floor - limits.ground) / -z[2]
        deep = min(limits.deep, room)
        if deep < _LEAST_COVER:
            return "too near to the ground"
        X_WG = pose(np.column_stack([x, np.cross(z, x), z]), middle + deep * z)

        # Points between the pads: what the jaws meet.
        p = transform_points(inverse(X_WG), points_W)
        between = (np.abs(p[:, 1]) <= 0.5 * jaws.breadth) & (p[:, 2] <= 0.0)
        if not between.any():
            return "beside the object"
        first = p[between, 0].min()
        last = p[between, 0].max()
        width = float(last - first)
        X_WG[:3, 3] += 0.5 * (first + last) * x

        beside = min(limits.beside, 0.5 * (jaws.opening - width))
        if beside < limits.least:
            return "too wide"
        if p[between, 2].min() < -jaws.finger:
            return "below the palm"

        # Along a line that leans, the end of the open finger on the low side comes down further
        # than the tool's origin.
        span = 0.5 * width + beside + jaws.thickness
        lowest = X_WG[2, 3] - span * abs(x[2])
        raised = max(0.0, floor + limits.ground - lowest) / -z[2]
        if deep - raised < _LEAST_COVER:
            return "too near to the ground"
        X_WG[:3, 3] -= raised * z

        # Margins, each with what its limit means.
        across = (X_WG[:3, 1]) @ (center_W - X_WG[:3, 3])
        margins = {
            "too slippery": 1.0 - grasp.slope / jaws.friction,
            "too uneven": 1.0 - max(0.0, width - grasp.width) / limits.uneven,
            "too far from the weight": 1.0 - abs(float(across)) / limits.aside,
            "too wide": beside / limits.beside,
        }
        worst = min(margins, key=lambda reason: margins[reason])
        if margins[worst] <= 0.0:
            return worst
        return PlacedGrasp(
            X_WG=readonly(X_WG),
            width=width,
            opening=width + 2.0 * beside,
            margin=float(margins[worst]),
        )


def carry_path(grasp: PlacedGrasp, p_end_W: Array, step: float = 0.02) -> ToolPath:
    """Straight tool path, without rotation, from a grasp to the place where the object is put.

    Args:
        grasp: where the jaws close.
        p_end_W: (3,) [m] position of the tool when they open.
        step: [m] between its samples.
    """
    X = grasp.X_WG
    length = float(np.linalg.norm(p_end_W - X[:3, 3]))
    count = max(4, 1 + round(length / step))
    shares = np.linspace(0.0, 1.0, count)[:, None]
    ones = np.ones((count, 1))
    return ToolPath(
        s=readonly(length * shares[:, 0]),
        p=readonly(X[:3, 3] + shares * (p_end_W - X[:3, 3])),
        z=readonly(ones * X[:3, 2]),
        x=readonly(ones * X[:3, 0]),
        on_scan=np.zeros(count, dtype=bool),
        keeps_x=True,
    )
