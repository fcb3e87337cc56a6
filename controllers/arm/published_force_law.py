"""Force law as published: a PID on the force error displaces the tool [Konoplin 2022, section 3].

    e = f_set - f_felt,    displacement = K_p e + K_i int e dt + K_d de/dt

f_set is the set force of the tool on the object, f_felt the estimated one; e is the paper's G_f.
The paper gives the displacement the direction of e, and as its size k a PID on the length of e.
Here each component has a PID of its own, which is the same while the direction of e does not
change. The component along the tool axis is `PublishedForceLaw`, the two across it are
`TangentialForceLoop`; a controller with the published law has both, with the same gains.

Three readings
    Friction makes the components across the axis differ from zero for as long as the tool moves;
    the integral then drives the tool off its path. The paper also says that the displacement goes
    "towards the surface or away from it", by the sign of the difference of the two forces: read
    so, the component along the axis is the whole law. By its text that difference is of the lengths
    of the two forces, friction included (`LengthForceLaw`). `--published force-law` is the first
    reading, `normal-force-law` the second, `force-length-law` the third.

Not in the paper
    Gains, which are fixed here, whatever the surface. Limits of the displacement and of its speed,
    along the axis and across it each for itself; what a limit cuts off is taken out of the integral
    (back-calculation), so that a step of the error acts through the integral where the speed limit
    holds. The return to zero with the force loop open (`release`).
"""

from dataclasses import dataclass, field

import numpy as np

from uuv.controllers.arm.compliance import ComplianceState
from uuv.controllers.tuning import PublishedForceTuning
from uuv.sim.interfaces.messages import Reference
from uuv.sim.interfaces.spatial import Array


@dataclass(slots=True, eq=False)
class PidState:
    """Memory of one PID: displacement, integral and last error."""

    k: float = 0.0  # [m] displacement along the tool axis, into the surface
    integral: float = 0.0  # [m] integral
    error: float | None = None  # [N] error at the last step; None: the loop was open


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedForceLaw(PublishedForceTuning):
    """Component along the tool axis (`uuv.controllers.whole_body.tool_control.ForceLaw`)."""

    @property
    def closed_loop(self) -> bool:
        """True: the estimated force is controlled."""
        return True

    def init(self) -> PidState:
        """Initial state: no displacement."""
        return PidState()

    def step(
        self, state: PidState, set_force: float, felt: float, servo_compliance: float, dt: float
    ) -> float:
        """Displacement k for a set and a measured normal force.

        Args:
            state: of the loop; changed in place.
            set_force: [N] normal force to press with.
            felt: [N] measured normal force.
            servo_compliance: [m/N] not used: the published gains are fixed.
            dt: [s] since the last step.

        Returns:
            The displacement k [m] along the tool axis, positive into the surface.
        """
        error = set_force - felt
        rate = 0.0 if state.error is None else (error - state.error) / dt
        state.error = error
        state.integral += self.integral * error * dt
        k_wanted = self.proportional * error + state.integral + self.derivative * rate

        k = min(max(k_wanted, state.k - self.speed * dt), state.k + self.speed * dt)
        k = min(max(k, -self.limit), self.limit)
        state.integral += k - k_wanted  # anti-windup: back-calculation from the limited output
        state.k = k
        return k

    def release(self, state: PidState, dt: float, *, inwards: bool = True) -> float:
        """Bring the displacement back to zero at the limited speed, with the force loop open.

        Args:
            state: of the loop; changed in place.
            dt: [s] since the last step.
            inwards: False keeps a negative displacement, for a surface that is not where it was
                expected.

        Returns:
            The displacement k [m].
        """
        most = self.speed * dt
        state.k -= min(max(state.k, -most if inwards else 0.0), most)
        state.integral = state.k
        state.error = None
        return state.k


@dataclass(frozen=True, slots=True, kw_only=True)
class LengthForceLaw(PublishedForceLaw):
    """The law by its text: a PID on the difference of the forces' lengths displaces the tool
    towards the surface or away from it (`uuv.controllers.whole_body.tool_control.WholeForceLaw`).
    """

    def step_whole(self, state: PidState, set_force: float, f_tip_W: Array, dt: float) -> float:
        """Displacement k for a set force and a measured one.

        Args:
            state: of the loop; changed in place.
            set_force: [N] length of the set force.
            f_tip_W: (3,) [N] force of the world on the tip, W.
            dt: [s] since the last step.

        Returns:
            The displacement k [m] along the tool axis, positive into the surface.
        """
        return self.step(state, set_force, float(np.linalg.norm(f_tip_W)), 0.0, dt)


@dataclass(slots=True, eq=False)
class TangentialState(ComplianceState):
    """Offset perpendicular to the tool axis, and the memory of the PIDs."""

    integral_W: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m]
    error_W: Array | None = None  # (3,) [N] at the last step; None: the loop was open


@dataclass(frozen=True, slots=True, kw_only=True)
class TangentialForceLoop(PublishedForceTuning):
    """Components perpendicular to the tool axis, whose set force is zero, as a
    `SideDisplacement`.
    """

    def init(self) -> TangentialState:
        """Initial state: no offset."""
        return TangentialState()

    def acts(self, reference: Reference) -> bool:
        """True while the force is controlled."""
        return reference.force_control

    def step(
        self,
        state: TangentialState,
        f_tip_W: Array,
        z_WG: Array,
        dt: float,
        *,
        gently: bool = False,
    ) -> Array:
        """Offset of the tool for the measured contact force.

        Args:
            state: the present offset; changed in place.
            f_tip_W: (3,) [N] force of the world on the tip, W; the negative of the tool's force on
                the object.
            z_WG: (3,) unit tool axis, W.
            dt: [s] since the last step.
            gently: without effect; the loop always yields.

        Returns:
            The offset (3,) [m], W.
        """
        del gently
        error = f_tip_W - (f_tip_W @ z_WG) * z_WG
        rate = np.zeros(3) if state.error_W is None else (error - state.error_W) / dt
        state.error_W = error
        state.integral_W = state.integral_W + self.integral * dt * error
        unlimited = self.proportional * error + state.integral_W + self.derivative * rate

        offset = state.offset_W + _shortened(unlimited - state.offset_W, self.speed * dt)
        offset = _shortened(offset, self.limit)
        state.integral_W = state.integral_W + offset - unlimited
        state.offset_W = offset
        return offset

    def release(self, state: TangentialState, dt: float) -> Array:
        """Bring the offset (3,) [m] back towards zero at `speed` in `dt` [s], in open loop."""
        state.offset_W = state.offset_W - _shortened(state.offset_W, self.speed * dt)
        state.integral_W = state.offset_W
        state.error_W = None
        return state.offset_W


def _shortened(vector: Array, most: float) -> Array:
    """`vector` (3,) with a length of at most `most`."""
    return vector * min(1.0, most / max(float(np.linalg.norm(vector)), most))
