"""How a log is compared with its replay: a value, read without the replay's kernel."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from uuv.calib.water.logs import ATTITUDE, DEPTH, FORCE, POSITION, RATE, VELOCITY

NOISE: Mapping[str, float] = {  # standard deviation of a sample, each axis
    POSITION: 0.005,  # [m]
    ATTITUDE: 0.003,  # [rad]
    RATE: 0.003,  # [rad/s]
    FORCE: 0.05,  # [m/s^2]
    VELOCITY: 0.01,  # [m/s]
    DEPTH: 0.01,  # [m]
}
SHORT = 0.5  # [s] windows of the first, rough fit


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """How a log is compared with its replay."""

    window: float = 6.0  # [s]
    rate: float = 20.0  # [Hz] to which samples are averaged
    noise: Mapping[str, float] = field(default_factory=lambda: dict(NOISE))
    current: float = 0.1  # [m/s] prior standard deviation of a log's current, each axis
    gust: float = 0.02  # [m/s] of a window's current about it
    mount: float = 0.01  # [rad] of the attitude sensor's axes on the hull, in roll and pitch
    rate_bias: float = 0.002  # [rad/s] of the gyro
    force_bias: float = 0.05  # [m/s^2] of the accelerometer
    every: int = 1  # windows of which one is used
    workers: int = 1  # threads

    def short(self) -> "FitSettings":
        """The same with windows so short that residuals are nearly straight in the parameters."""
        return replace(self, window=SHORT, every=2)
