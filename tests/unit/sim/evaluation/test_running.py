"""Judgement step by step against the figures of the whole recording: the same error, peak, loss and
place.
"""

from dataclasses import replace

import numpy as np
import pytest

from recorded_work import DT, STEPS, TIME, TRUTH, recorded
from uuv.perception.toolpath.path_planner import path_on_model
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.evaluation.running import RunningForce, place_on_path
from uuv.sim.evaluation.surface.force_levels import contact_figures
from uuv.sim.evaluation.surface.mesh_surface import closest_on_curve

SET = 60.0  # [N]


def watched(
    normal: np.ndarray, least: np.ndarray, most: np.ndarray, bounds: Bounds
) -> tuple[RunningForce, list[str]]:
    """The steps one after another, and what was out of bounds in them."""
    force = RunningForce(SET, bounds)
    return force, [force.add(*step, DT) for step in zip(normal, least, most, strict=True)]


def test_error_and_peak_are_those_of_the_recording(rng):
    """The means make the RMS, the physics steps within them the peak; the first second counts in
    neither.
    """
    normal = SET + 2.0 * np.sin(3.0 * TIME) + 0.3 * rng.standard_normal(STEPS)
    normal[: round(0.9 / DT)] += 30.0
    least = normal - 0.5 * rng.random(STEPS)
    most = normal + 0.8 * rng.random(STEPS)
    figures = contact_figures(
        recorded(contact_normal=normal, contact_least=least, contact_most=most)
    )
    force, wrong = watched(normal, least, most, Bounds())
    # a step at the settling's end
    assert force.rms == pytest.approx(figures.force_error_rms_n, rel=1e-3)
    assert force.peak == pytest.approx(figures.force_error_max_n, rel=1e-12)
    assert 1.0 < force.rms < 2.0 < force.peak < 4.0
    assert not any(wrong)
    assert not force.missed()


@pytest.mark.parametrize(
    ("off", "said"),
    [(-59.5, "contact lost"), (-12.0, "force error 12.0 N"), (9.5, "force error 9.5 N")],
)
def test_one_physics_step_beyond_a_bound_is_noticed(off, said):
    normal, least, most = (np.full(STEPS, SET) for _ in range(3))
    (least if off < 0.0 else most)[2500] += off
    figures = contact_figures(
        recorded(contact_normal=normal, contact_least=least, contact_most=most)
    )
    force, wrong = watched(normal, least, most, Bounds())
    assert force.peak == figures.force_error_max_n == pytest.approx(abs(off))
    assert [tick for tick, text in enumerate(wrong) if text] == [2500]
    assert said in wrong[2500]
    assert (figures.lost_s or 0.0) == pytest.approx(DT if said == "contact lost" else 0.0)


def test_the_whole_is_judged_by_its_root_mean_square():
    normal = np.full(STEPS, SET + 4.0)
    assert watched(normal, normal, normal, Bounds())[0].missed() == "force error 4.0 N RMS"
    assert watched(normal, normal, normal, Bounds(force_error_rms=4.1))[0].missed() == ""


def test_the_place_on_a_path_is_the_nearest_one_across_the_tool():
    """On a curved path, from samples and from between them: as on the polyline, the depth left
    out.
    """
    path = path_on_model(TRUTH.X_WT, TRUTH.model.path("transverse"), spacing=0.01)
    rng = np.random.default_rng(5)
    for s in rng.uniform(0.05, float(path.s[-1]) - 0.05, 20):
        p, z = (
            np.array([np.interp(s, path.s, column) for column in of.T]) for of in (path.p, path.z)
        )
        z /= np.linalg.norm(z)
        side = np.cross(z, np.gradient(path.p, path.s, axis=0)[np.argmin(np.abs(path.s - s))])
        aside = rng.uniform(-0.004, 0.004) * side / np.linalg.norm(side)
        expected = closest_on_curve((p + aside)[None], path.p)[1][0]
        for depth in (0.0, 0.003):
            arc, distance = place_on_path(path, p + aside + depth * z)
            assert arc == pytest.approx(expected, abs=2e-4)
            # 1e-4: depth times half a sample's turn
            assert distance == pytest.approx(np.linalg.norm(aside), abs=2e-4)


def test_ends_of_a_path_are_its_nearest_places_beyond_them():
    path = path_on_model(TRUTH.X_WT, TRUTH.model.path("longitudinal"), spacing=0.01)
    along = (path.p[-1] - path.p[0]) / path.s[-1]
    assert place_on_path(path, path.p[-1] + 0.02 * along) == (
        pytest.approx(path.s[-1]),
        pytest.approx(0.02),
    )
    point = replace(path, s=path.s[:1], p=path.p[:1], z=path.z[:1], x=path.x[:1])
    assert place_on_path(point, path.p[0] - 0.01 * along) == (0.0, pytest.approx(0.01))
