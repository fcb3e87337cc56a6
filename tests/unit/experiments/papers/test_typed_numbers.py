"""Numbers typed in the texts beside the figures: each is the paper's, or that of the code."""

import math
import re
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from experiments.kinematics import ik_bench, ik_growth, ik_success
from experiments.papers import servo_motions
from experiments.papers.stated.statements import FIELD, PaperStatement, all_rows
from experiments.toolpath import passages
from uuv import models
from uuv.calib.simulation import HAND_NOISE
from uuv.controllers.ik import tracking
from uuv.controllers.planning import trajectories
from uuv.controllers.planning.singular_passage import PassageLimits
from uuv.controllers.tuning import PublishedForceTuning
from uuv.jobs import clean_barrel, inspect_object
from uuv.models.tools.tools import TOOLS
from uuv.models.vehicle import Vehicle
from uuv.models.water.t200_sheets import SHEETS
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.sensors.proprioception import Dvl
from uuv.sim.sensors.stereo_noise import StereoNoise
from uuv.tasks.surface_work import SurfaceWorkTask

NUMBER = re.compile(r"(?<![\w.^])[+-]?\d+(?:\.\d+)?(?!\w)")
# Names, references and units, whose digits are no figures
NAMES = re.compile(
    r"`[^`]*`|\[[^\]]*\](?:\([^)]*\))?|\b(?:fig|eq)\. \d[^.;]*|\bjoints? \d(?: and \d)?|\bT\d+\b"
)
ROWS = {row.place: row for row in all_rows()}
FRICTION = TOOLS.load("pad").contact.friction


@cache
def held() -> dict[str, list[float]]:
    """Numbers of the code that a text may state, by its place."""
    limits = PassageLimits()
    bar_a = [1e3 * bar for bar in ik_bench.BARS["A"]]
    stereo = StereoNoise()
    sheet = next(sheet for sheet in SHEETS if sheet.voltage == 14.0)
    two_t200 = 2.0 * max(sheet.thrust)
    return {
        "results: error of identification": [100 * Bounds().position_error_share],
        "experiment: range of the vision system": [stereo.disparity_sigma, 100.0 * stereo.baseline],
        "fig. 5 b, blue: tangential force": [FRICTION],
        "position-force control: displacement along G_f by a PID": [
            1e3 * PublishedForceTuning().limit
        ],
        "position-force control, by its text: the difference of the lengths of two vectors, "
        "friction included": [FRICTION, 100.0 / math.hypot(1.0, FRICTION)],
        "contact torque from a load observer in place of sensors": [friction_share()],
        "conclusion: any other kinematic scheme": [
            float(Vehicle.of(models.load(name).compile()).joints.size)
            for name in ("bluerov2_alpha5", "uuv_puma", "rexrov2_arm7")
        ],
        "section 1: B-spline with control of the speed": [6.0, trajectories.BEND],
        "eq. 6: way of the vehicle near the object, for its survey": [
            float(np.linalg.norm(inspect_object().site.current))
        ],
        "statement 4, chapter 2: the method converges": [*even_limits(), *bar_a],
        "the same, to 1 mm and 0.01 rad as in table 1, and its time": [*even_limits(), *bar_a],
        "eq. 7, 8: time against a Jacobian method": [ik_growth.LENGTH, *bar_a, *published_misses()],
        "chapter 4: joint 1 constant near the singularity, on the paper's arm and path": [
            tracking._LONGEST_HOLD
        ],
        "chapter 4: passing, at work": [
            *places_away(),
            1e3 * limits.deviation,
            math.degrees(limits.tilt),
            1e3 * limits.drift,
        ],
        "table 1: solved": [
            *servo_motions.GIVEN,
            1e3 * servo_motions.POSITION,
            servo_motions.ANGLE,
        ],
        "chapter 4, conclusion 8: time for 8 joints, and for 60 links": [float(ik_growth.LONG)],
        "results: J before and after three iterations": [1e3 * HAND_NOISE],
        "fig. 4: distances of all pairs of touches of a point": [
            10.0 * round(0.1 * 1120.0 / 28.7),
            math.sqrt(1120.0 / 28.7),
        ],
        "the same, with eccentric gears": [1e3 * 0.00022],
        "Added mass of BlueROV2 Heavy from its shape": [12.7 / 7.1],
        "Two T200 on a vehicle, on its battery": [
            two_t200,
            sheet.voltage,
            100.0 * (two_t200 / 62.0 - 1.0),
        ],
        "Noise of stereo camera, DVL, IMU, depth, vision": [
            stereo.disparity_sigma,
            1e3 * Dvl().noise,
        ],
        "Pressing with a set force from a hovering vehicle": set_forces(),
    }


def friction_share() -> float:
    """Dry friction of the joints over their torque limits [%]."""
    vehicle = Vehicle.of(models.load("uuv_puma").compile())
    shares = vehicle.dry_friction.coulomb / vehicle.torque_limits
    return 100.0 * float(np.median(shares))


def even_limits() -> list[float]:
    """Limits [deg] of the arms of ik_success and ik_published, of either sign."""
    return [sign * float(value) for value in ik_success.RANGES for sign in (1.0, -1.0)]


def published_misses() -> list[float]:
    """Target that the two published results of eq. 7, 8 suggest [m], and their distances [mm]."""
    target = np.array([3.5, 0.0, 0.5])
    results = [3.50067, 0.000031, 0.499905], [3.500776, 0.000607, 0.492074]
    return [*target, *(1e3 * float(np.linalg.norm(p - target)) for p in results)]


def set_forces() -> list[float]:
    """Set forces of the main job [N]."""
    task = clean_barrel(quick=True).task
    assert isinstance(task, SurfaceWorkTask)
    return list(task.forces)


def places_away() -> list[float]:
    """Distances [m] of the other two hull places from that on which the lock is passed."""
    places = []
    for name in passages.NAMES:
        text = (passages.PLACES / f"{name}.toml").read_text(encoding="utf-8")
        places.append(np.array(list(tomllib.loads(text)["task"]["hull_place"].values())))
    return [float(np.linalg.norm(place - places[0])) for place in places[1:]]


def section(page: str, anchor: str) -> str:
    """Text of a page below the heading of an anchor; all of it without an anchor."""
    if not anchor:
        return page
    for part in re.split(r"^(?=## )", page, flags=re.MULTILINE):
        heading = part.partition("\n")[0].lstrip("# ").lower()
        if heading.replace(" ", "-") == anchor:
            return part
    raise AssertionError(f"no heading for #{anchor}")


def strangers(row: PaperStatement, root: Path) -> list[str]:
    """Numbers typed in the texts of a row that nothing holds."""
    texts = (row.published, row.ours, row.remark)
    sources = [row.place, row.stated, *row.sources, *(figure.name for figure in row.figures)]
    links = re.findall(r"\]\((\w+\.md)(?:#([\w-]+))?", " ".join(texts))
    pages = [section((root / "docs" / page).read_text(encoding="utf-8"), at) for page, at in links]
    stated = {number.lstrip("+-") for text in (*sources, *pages) for number in NUMBER.findall(text)}
    stated |= {number for text in sources for number in re.findall(r"\d+(?:\.\d+)?", text)}

    unknown = []
    for text in texts:
        for number in NUMBER.findall(NAMES.sub("", FIELD.sub("", text))):
            digits = len(number.partition(".")[2])
            rounded = {round(value, digits) for value in held().get(row.place, ())}
            if number.lstrip("+-") not in stated and float(number) not in rounded:
                unknown.append(number)
    return unknown


@pytest.mark.parametrize("place", ROWS)
def test_a_typed_number_is_the_papers_or_the_codes(place: str, root: Path):
    assert strangers(ROWS[place], root) == []


def test_places_are_unique():
    assert len(ROWS) == len(all_rows())


def test_a_figure_that_is_typed_is_found(root: Path):
    row = ROWS["fig. 5: speed of the tool"]
    assert strangers(replace(row, ours="1.93 cm/s"), root) == ["1.93"]
    linked = ROWS["Calibration by touching"]
    assert strangers(replace(linked, ours=linked.ours.replace("0.32", "7.654")), root) == ["7.654"]
