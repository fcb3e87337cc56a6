"""Settings of the comparison of a log with its replay, as a value that does not need the replay's
kernel.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from uuv.calib.water.logs import ATTITUDE, DEPTH, FORCE, POSITION, RATE, VELOCITY

NOISE: Mapping[str, float] = {  # standard deviation of a sample on each axis
    POSITION: 0.005,  # [m]
    ATTITUDE: 0.003,  # [rad]
    RATE: 0.003,  # [rad/s]
    FORCE: 0.05,  # [m/s^2]
    VELOCITY: 0.01,  # [m/s]
    DEPTH: 0.01,  # [m]
}
SHORT = 0.5  # [s] length of windows in the first, rough fit


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """Settings of the comparison of a log with its replay."""

    window: float = 6.0  # [s]
    rate: float = 20.0  # [Hz] rate to which samples are averaged
    noise: Mapping[str, float] = field(default_factory=lambda: dict(NOISE))
    current: float = 0.1  # [m/s] prior standard deviation of a log's current, each axis
    gust: float = 0.02  # [m/s] standard deviation of a window's current about that of the log
    # [rad] standard deviation of the attitude sensor's alignment with the hull, in roll and pitch
    mount: float = 0.01
    rate_bias: float = 0.002  # [rad/s] bias of the gyro
    force_bias: float = 0.05  # [m/s^2] bias of the accelerometer
    every: int = 1  # one of so many windows is used
    workers: int = 1  # number of threads

    def short(self) -> "FitSettings":
        """The same settings with windows so short that residuals are nearly linear in the
        parameters.
        """
        return replace(self, window=SHORT, every=2)
