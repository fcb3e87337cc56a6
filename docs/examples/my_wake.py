"""Example of docs/own_current.md: water that is sheltered by the object."""

from dataclasses import dataclass, replace

import numpy as np

from uuv import Perturbation


@dataclass(frozen=True, kw_only=True)
class Shelter:
    """A share of the stream is missing behind the object, 0.5 m to each side of its middle."""

    stream: tuple[float, float, float]  # [m/s] undisturbed, in W
    share: float
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] of the object in W, set by `placed`

    def placed(self, model):
        return replace(self, place=tuple(model.body("target").pos.tolist()))

    def velocity(self, p_W, time):
        stream = np.array(self.stream)
        along = stream / np.linalg.norm(stream)
        gap = p_W - np.array(self.place)
        behind = gap @ along
        aside = np.linalg.norm(gap - behind * along)
        wake = 0.5 * (1.0 + np.tanh(behind / 0.5)) * np.exp(-((aside / 0.5) ** 2))
        return -self.share * wake * stream


@dataclass(frozen=True, kw_only=True)
class Sheltered(Perturbation):
    share: float = 0.5  # of the current

    def on_water(self, current):
        return current.with_flow(Shelter(stream=tuple(current.mean_W.tolist()), share=self.share))
