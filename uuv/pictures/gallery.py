"""The gallery: one table of what is shown, pictures in docs/gallery, and the page gallery.md.

Jobs stand in the table; objects and vehicles are those of their registries.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uuv.catalogue import CHECKOUT
from uuv.pictures.filmed_jobs import FILMED
from uuv.sim.interfaces.documents import json_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, pose, transform_points
from uuv.sim.reporting.scene.clip import still
from uuv.sim.runs.saving import write_whole

PAGE = CHECKOUT / "docs" / "gallery.md"
FOLDER = CHECKOUT / "docs" / "gallery"
FIGURES = FOLDER / "figures.json"  # of the pictures, by name
MOST_CLIPS = 12  # among the pictures
MOST_BYTES = 12_000_000  # of all pictures

_STILL = 800, 450  # [px] width and height
_HEADING = """# Gallery

Written by `uuv gallery`. The clips are of the commands beside them, their figures of the same
runs, against the truth. [How they are drawn](pictures.md).
"""

Figures = list[tuple[str, str]]  # name, and value with its unit


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """A picture of the gallery."""

    name: str  # of its file
    group: str  # heading on the page
    about: str
    command: str  # that makes the picture, or prints data of the thing shown
    make: Callable[["Shown", Path], Figures]  # writes the picture; figures beside it

    @property
    def file(self) -> Path:
        """The picture."""
        return FOLDER / f"{self.name}.webp"


def _filmed(shown: Shown, file: Path) -> Figures:
    """A job as a clip."""
    (job,) = (job for job in FILMED if job.name == shown.name)
    return job.film(file)


def _object(shown: Shown, file: Path) -> Figures:
    """An object with its tool paths, and its size."""
    import mujoco

    from uuv.models.objects import targets
    from uuv.sim.reporting.scene.portrait import portrait

    target = targets.named(shown.about)
    spec = mujoco.MjSpec()
    target.add_to(spec, pose(), felt=False)
    drawn: list[Array] = [
        transform_points(pose(), path.p) for path in target.paths.values() if len(path.p) > 1
    ]
    write_whole(file, still(portrait(spec, shown.about, _STILL, drawn), "webp"))
    x, y, z = np.ptp(target.vertices, axis=0)
    paths = ", ".join(target.paths) or "none"
    return [("size", f"{x:.2f} x {y:.2f} x {z:.2f} m"), ("tool paths", paths)]


def _vehicle(shown: Shown, file: Path) -> Figures:
    """A vehicle or arm, and what moves it."""
    from uuv import models
    from uuv.sim.reporting.scene.portrait import portrait

    write_whole(file, still(portrait(models.load(shown.about), shown.about, _STILL), "webp"))
    described = models.describe(shown.about)
    count = described.thrusters
    moved = f"{count} thruster{'s' * (count > 1)}" if count else described.drive
    joints = f", {len(described.joints)} joints" if described.joints else ""
    return [
        ("dry mass", f"{described.mass:.4g} kg"),
        ("degrees of freedom", str(described.dof)),
        ("moved by", moved + joints),
    ]


def entries() -> list[Shown]:
    """All that the gallery shows, in the order of the page."""
    from uuv import models
    from uuv.models.objects.targets import OBJECTS

    filmed = [
        Shown(
            name=job.name,
            group="Jobs",
            about=job.about,
            command=f"uuv run {job.command}",
            make=_filmed,
        )
        for job in FILMED
    ]

    objects = [
        Shown(
            name=f"object_{name}",
            group="Objects",
            about=name,
            command="uuv list objects",
            make=_object,
        )
        for name in OBJECTS.names()
    ]

    vehicles = [
        Shown(
            name=f"vehicle_{name}",
            group="Vehicles and arms",
            about=name,
            command=f"uuv models {name}",
            make=_vehicle,
        )
        for name in models.available()
        if models.VEHICLES.resolve(name) == name  # no alias
    ]
    return [*filmed, *objects, *vehicles]


def make(shown: Sequence[Shown]) -> None:
    """Makes pictures, keeps their figures, and writes the page of all.

    Raises:
        ConfigurationError: There is no checkout, or the pictures together are too large.
    """
    if not PAGE.is_file():
        raise ConfigurationError(
            "gallery: its pictures are in a checkout of the project alone, in docs/"
        )
    for picture in shown:
        figures = picture.make(picture, picture.file)
        kept = {**kept_figures(), picture.name: figures}
        write_whole(FIGURES, json.dumps(dict(sorted(kept.items())), indent=1) + "\n")
        write_whole(PAGE, page(entries(), kept_figures()))
        print(picture.file.relative_to(CHECKOUT), flush=True)

    size = sum(file.stat().st_size for file in FOLDER.glob("*.webp"))
    if size > MOST_BYTES:
        raise ConfigurationError(
            f"gallery: its pictures have {size / 1e6:.1f} MB, {MOST_BYTES / 1e6:g} MB are allowed"
        )


def kept_figures() -> dict[str, Figures]:
    """Figures beside the pictures, by name of the picture."""
    if not FIGURES.exists():
        return {}
    content: Mapping[str, Any] = json_of(FIGURES, "figures")
    return {name: [(word, figure) for word, figure in rows] for name, rows in content.items()}


def page(shown: Sequence[Shown], figures: Mapping[str, Figures]) -> str:
    """The page: a table of pictures for each group, those without a file left out."""
    parts = [_HEADING]
    for group in dict.fromkeys(picture.group for picture in shown):
        rows = [picture for picture in shown if picture.group == group and picture.file.exists()]
        if rows:
            parts.append(f"## {group}\n\n| | |\n|---|---|")
            parts += [_row(picture, figures.get(picture.name, [])) for picture in rows]
            parts.append("")

    return "\n".join(parts)


def _row(picture: Shown, figures: Figures) -> str:
    words = "; ".join(f"{name} {figure}" for name, figure in figures)
    shown = f"![{picture.about}](gallery/{picture.file.name})"
    return f"| {shown} | **{picture.about}**<br>`{picture.command}`<br>{words} |"
