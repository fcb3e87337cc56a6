"""Which of several objects is in a random scene: how often the right one is named, where it is.

An object is named if its pose is accepted and the scene is less likely with any other one; in the
wrong place it does not count as named rightly. Times are processor times of all threads, comparable
with --workers 1 only.
"""

from uuv.start import run_scenario  # isort: skip

from dataclasses import dataclass

from experiments.identification.scene_cases import SceneCase, conditions, prior, surface_of, timed
from uuv.clouds.frames import SENSORS
from uuv.clouds.scene_kinds import object_of
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.models.objects import targets
from uuv.perception.registration.recognition import recognise


@dataclass(frozen=True, kw_only=True)
class RecognitionCase(SceneCase):
    """One scene for one sensor, and the objects that come into question."""

    among: tuple[str, ...] = targets.available()
    """Names of the objects that come into question."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.among:
            object_of(name)  # refuses an unknown name


@dataclass(frozen=True, kw_only=True)
class RecognitionRow:
    """Which object was named, whether it was found, and how clearly."""

    named: str = column("named; empty: none")
    likeliest: str = column("likeliest")
    runner_up: str = column("second likeliest")
    right: bool = column("named rightly")
    wrong: bool = column("named wrongly")
    found: bool = column("found, as the likeliest")
    reason: str = column("reason")
    margin: float = column("margin of the likelihood", "nat", digits=0)
    time: float = column("processor time", "s", digits=1, tolerance=None)


@experiment(
    "recognition",
    seeds=10,
    vary={"object": targets.available(), "sensor": tuple(SENSORS)},
    paired=True,
    quick={"runs": 1, "object": ("manifold", "rock"), "sensor": ("stereo",)},
)
def recognition(case: RecognitionCase) -> RecognitionRow:
    """Asks which object is in a scene."""
    scene = case.scene()
    surfaces = {name: surface_of(name) for name in case.among}
    time, verdict = timed(
        lambda: recognise(
            scene.scan, surfaces, *prior(scene, case.start), sensor=scene.sensor.model
        )
    )

    names = [candidate.name for candidate in verdict.candidates]
    return RecognitionRow(
        named=verdict.name or "",
        likeliest=names[0],
        runner_up=names[1] if len(names) > 1 else "",
        right=verdict.name == case.object,
        wrong=verdict.accepted and verdict.name != case.object,
        # The right object in the wrong place is not found.
        found=names[0] == case.object and scene.is_found(verdict.found.X_sensor_target),
        reason=verdict.reason,
        margin=float(min(verdict.margin, 1e4)),
        time=time,
    )


def line(row: Row) -> str:
    """Line about a scene whose object was not named; empty for others."""
    if row["right"] and row["found"]:
        return ""
    verdict = f"named {row['named']}" if row["named"] else row["reason"]
    pose = "right" if row["found"] else "wrong"
    return f"{row['object']}, {row['sensor']}, seed {row['seed']}: {verdict}, pose {pose}"


recognition.line = line
recognition.page = (
    Page()
    .add(conditions)
    .add(lambda rows: f"objects that come into question: {', '.join(rows[0]['among'])}")
    .table(
        "Which object is it?",
        by="object",
        columns=[
            stat("share", lambda row: row["right"] and row["found"], "named rightly"),
            stat("count", "wrong"),
            stat("share", lambda row: row["likeliest"] == row["object"], "likeliest rightly"),
            stat("least", "margin"),
            stat("median", "margin"),
            stat("median", "time"),
        ],
        total=True,
    )
)

if __name__ == "__main__":
    run_scenario(recognition.main)
