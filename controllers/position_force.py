"""Position-force control: the displacement k of the tool along the force error (paper 002, third section).

The paper displaces the tool along G_f = G_F*_imp - G_F_imp by k, from a PID on its length. Friction makes the
tangential part of that vector non-zero for as long as the tool moves, and displacing the tool against friction would
take it off its path; so the displacement here goes along the tool axis, from the normal part of the error.
"""

from dataclasses import dataclass

from sim.interfaces.errors import ConfigurationError


@dataclass(slots=True)
class DisplacementState:
    """Displacement of the tool and the PID's memory."""

    k: float = 0.0  # [m] along the tool axis, into the surface
    integral: float = 0.0  # [m]
    error: float = 0.0  # [N] of the last step


@dataclass(frozen=True, slots=True, kw_only=True)
class Displacement:
    """PID from normal force error to displacement, with anti-windup and a limit on its speed."""

    proportional: float = 6e-6  # [m]/[N]
    integral: float = 8e-4  # [m]/[N s]
    derivative: float = 0.0  # [m s]/[N]
    limit: float = 0.04  # [m] largest displacement either way
    speed: float = 0.03  # [m/s] largest speed of the displacement

    def __post_init__(self) -> None:
        for name in ("proportional", "integral", "derivative"):
            if not getattr(self, name) >= 0.0:
                raise ConfigurationError(f"displacement {name}: must be >= 0, got {getattr(self, name)}")
        if not (self.limit > 0.0 and self.speed > 0.0):
            raise ConfigurationError(f"displacement limit and speed: must be > 0, got {self.limit} m, {self.speed} m/s")

    def step(self, state: DisplacementState, error: float, dt: float) -> float:
        """Displacement k [m] for a normal force error [N] (set minus felt), `dt` [s] after the last step."""
        rate = (error - state.error) / dt
        state.error = error
        state.integral += self.integral * error * dt
        wanted = state.integral + self.proportional * error + self.derivative * rate
        most = self.speed * dt
        k = min(max(wanted, state.k - most), state.k + most)
        k = min(max(k, -self.limit), self.limit)
        state.integral += k - wanted  # anti-windup: the integral is what the output could follow
        state.k = k
        return k

    def release(self, state: DisplacementState, dt: float) -> float:
        """Let the displacement go back to zero at the limited speed, with the force loop open."""
        most = self.speed * dt
        state.k -= min(max(state.k, -most), most)
        state.integral, state.error = state.k, 0.0
        return state.k
