"""Every figure of a run against its closed form, on recordings made up for it."""

import json
import re
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import jsonschema
import mujoco
import numpy as np
import pytest

from recorded_work import DT, SPEED, STEPS, TIME, TRUTH, recorded
from uuv import models
from uuv.models.objects.targets import BARREL_DIAMETER
from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.metrics import (
    AskedWork,
    assess,
    force_estimate_figures,
    hull_figures,
    reversals,
    schema,
)
from uuv.sim.evaluation.surface.force_levels import (
    JUDGED,
    SETTLING,
    contact_figures,
    unjudged_levels,
)
from uuv.sim.evaluation.surface.mesh_surface import Surface, closest_on_curve
from uuv.sim.evaluation.surface.tool_errors import (
    TrueObject,
    path_error,
    tool_figures,
    tool_twist,
    true_path_deviation,
)
from uuv.sim.evaluation.surface.tool_speed import speed_figures
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Target, WorkState
from uuv.sim.interfaces.spatial import exp_so3, pose, quat_wxyz_from_rotation, transform_points
from uuv.sim.loop.recording import STATES, Recording
from uuv.sim.runs.provenance import model_digest, provenance


def assessed(recording: Recording) -> Assessment:
    return assess(recording, TRUTH, seed=3, wall_s=0.5, identification_s=0.2)


def test_perfect_run_is_accepted_and_keeps_the_schema():
    assessment = assessed(recorded())
    assert assessment.accepted, assessment.failed
    jsonschema.validate(assessment.metrics, schema())
    assert assessment.metrics["timings"]["real_time_factor"] == pytest.approx(20.0)
    assert assessment.metrics["tool"]["speed_mean_m_s"] == pytest.approx(SPEED, rel=1e-3)


def test_schema_has_the_keys_that_others_rely_on():
    keys = {
        "identification": "position_error_m orientation_error_rad range_m check_m accepted",
        "contact": "force_error_rms_n force_error_max_n lost_s segments",
        "tool": "path_deviation_rms_m path_deviation_max_m cross_track_max_m along_track_max_m "
        "tilt_max_rad speed_mean_m_s",
        "path": "true_deviation_max_m",
        "speed": "set mean share",
        "force_estimate": "error_rms_n",
        "hull": "excursion_max_m tilt_max_rad",
        "thrusters": "saturated_s",
    }
    required = schema()["properties"]
    for group, names in keys.items():
        assert set(names.split()) <= set(required[group]["required"])
    shared = schema()["properties"]
    assert set(shared["run"]["required"]) >= {"simulated_s", "seed", "state", "trajectory_sha256"}
    assert set(shared["timings"]["required"]) == {"wall_s", "real_time_factor", "identification_s"}
    assert {"accepted", "failed"} <= set(schema()["required"])
    assert "provenance" not in schema()["required"]  # it is added when the file is written


def test_two_times_of_one_run_differ_in_the_timings_alone():
    first, second = (
        dict(
            assess(recorded(), TRUTH, seed=3, wall_s=wall_s, identification_s=0.1 * wall_s).metrics
        )
        for wall_s in (0.5, 0.7)
    )
    assert first.pop("timings") != second.pop("timings")
    assert first == second


def test_a_run_that_was_interrupted_says_so_and_is_not_accepted():
    assessment = assessed(replace(recorded(), interrupted="SIGTERM"))
    jsonschema.validate(assessment.metrics, schema())
    assert assessment.metrics["run"]["state"] == "interrupted"
    assert assessment.metrics["run"]["note"] == "by SIGTERM in state done after 10.0 s"
    assert assessment.failed == ("the run was interrupted by SIGTERM in state done after 10.0 s",)


def test_what_it_was_made_by_is_in_the_file(tmp_path):
    @dataclass
    class Options:
        seed: int = 3
        out: Path | None = tmp_path
        forces: tuple[float, ...] = (60.0, np.inf)

    model = models.load("uuv_puma").compile()
    assessed(recorded()).made_by(provenance("clean_barrel", Options(), model)).write(
        tmp_path / "metrics.json"
    )
    document = json.loads((tmp_path / "metrics.json").read_text("utf-8"))
    jsonschema.validate(document, schema())
    origin = document["provenance"]
    assert origin["options"] == {"seed": 3, "forces": [60.0, "inf"]}
    assert origin["versions"]["mujoco"] == mujoco.__version__
    assert origin["model_sha256"] == model_digest(models.load("uuv_puma").compile())
    model.opt.timestep *= 2.0
    assert origin["model_sha256"] != model_digest(model)


def test_an_unchecked_run_keeps_why_it_would_have_been_refused(tmp_path):
    assert "unchecked" not in assessed(recorded()).metrics
    reasons = ["56% of the camera's view is blocked"]
    assessed(recorded()).extended(unchecked=reasons).write(tmp_path / "metrics.json")
    document = json.loads((tmp_path / "metrics.json").read_text("utf-8"))
    jsonschema.validate(document, schema())
    assert document["unchecked"] == reasons


def test_force_error_counts_from_one_second_after_each_change():
    force = np.interp(TIME, [0.0, 4.0, 4.5, 10.0], [60.0, 60.0, 90.0, 90.0])
    error = 2.0 * np.sin(2.0 * np.pi * 5.0 * TIME)  # whole periods in [1, 4) and [5, 10)
    error[(TIME < 0.999)] = 30.0
    error[(TIME > 4.0005) & (TIME < 4.999)] = -25.0
    overall = contact_figures(recorded(set_force=force, contact_normal=force + error))
    assert overall.force_error_rms_n == pytest.approx(np.sqrt(2.0), rel=2e-3)
    assert overall.force_error_max_n == pytest.approx(2.0, rel=2e-3)
    segments = overall.segments
    assert [s.set_n for s in segments] == [60.0, 90.0]
    assert [s.duration_s for s in segments] == pytest.approx([4.0, 6.0], abs=2 * DT)
    for segment in segments:
        assert segment.force_error_rms_n == pytest.approx(np.sqrt(2.0), rel=2e-3)


def test_tangential_force_is_across_the_tool():
    drag_W = TRUTH.X_WT[:3, :3] @ [18.0, -24.0, 60.0]
    force = np.tile(drag_W, (STEPS, 1))
    force[: STEPS // 2] += 6.0 * TRUTH.X_WT[:3, 2]
    force[-1] *= 2.0
    figures = contact_figures(recorded(contact_force=force))
    assert figures.tangential_max_n == pytest.approx(60.0)
    assert figures.tangential_mean_n == pytest.approx(30.0 * (STEPS + 1) / STEPS)


def test_lost_contact_is_counted_wherever_it_happens_in_the_work():
    force = np.full(STEPS, 60.0)
    force[100:137] = 0.5
    force[4000:4010] = 0.0
    assessment = assessed(recorded(contact_normal=force))
    assert assessment.metrics["contact"]["lost_s"] == pytest.approx(47 * DT)
    assert any("contact lost" in line for line in assessment.failed)


def test_peaks_and_lost_contact_are_those_of_the_substeps():
    least, most = np.full(STEPS, 60.0), np.full(STEPS, 60.0)
    least[3000:3003], most[4000] = 0.0, 72.0
    overall = contact_figures(recorded(contact_least=least))
    assert (overall.force_error_rms_n, overall.force_error_max_n) == (0.0, 60.0)
    assert overall.lost_s == pytest.approx(3 * DT)
    overall = contact_figures(recorded(contact_most=most))
    assert (overall.force_error_rms_n, overall.force_error_max_n, overall.lost_s) == (
        0.0,
        12.0,
        0.0,
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_path_error_splits_into_along_lateral_and_normal(sign: float):
    """Signed where it says so; the greatest figures are of its size, whichever way it points."""
    R_WT = TRUTH.X_WT[:3, :3]
    x, y, z = R_WT.T
    along, lateral, deeper = sign * 0.002, sign * 0.0012, sign * 0.0005
    start = recorded()
    tip = start["p_command"].value + along * x + lateral * y - deeper * z
    recording = recorded(p_pad=tip)
    error = path_error(recording)
    assert error is not None
    assert error.along == pytest.approx(along)
    assert error.normal == pytest.approx(deeper)
    assert np.abs(error.lateral) == pytest.approx(abs(lateral))
    along, lateral, deeper = abs(along), abs(lateral), abs(deeper)
    tool = tool_figures(recording, TRUTH)
    assert tool.cross_track_max_m == pytest.approx(lateral)
    assert tool.cross_track_rms_m == pytest.approx(lateral)
    assert tool.along_track_rms_m == pytest.approx(along)
    assert tool.along_track_max_m == pytest.approx(along)
    assert tool.path_deviation_max_m == pytest.approx(along)
    assert tool.path_deviation_rms_m == pytest.approx(along)
    assert tool.normal_deviation_max_m == pytest.approx(deeper)


def test_tangent_holds_while_the_commanded_point_rests():
    velocity = recorded()["v_command"].value.copy()
    velocity[:200] = velocity[-200:] = 0.0
    tip = recorded()["p_command"].value + 0.001 * TRUTH.X_WT[:3, 0]
    error = path_error(recorded(v_command=velocity, p_pad=tip))
    assert error is not None
    assert error.along == pytest.approx(0.001)
    assert error.lateral == pytest.approx(0.0, abs=1e-12)


def test_deviation_from_the_object_and_tilt_know_the_true_surface():
    # On the half circle, 2 mm off the shell, the tool leaning 1.5 deg: facets of the mesh must not
    # show.
    truth = replace(TRUTH, path="transverse")
    angle = np.linspace(-1.3, 1.3, STEPS)
    outward = np.column_stack([np.zeros(STEPS), -np.sin(angle), np.cos(angle)])
    tangent = np.column_stack([np.zeros(STEPS), -np.cos(angle), -np.sin(angle)])
    R_WT = TRUTH.X_WT[:3, :3]
    tip = transform_points(TRUTH.X_WT, (0.5 * BARREL_DIAMETER + 0.002) * outward)
    lean = np.radians(1.5)
    axis = (-np.cos(lean) * outward + np.sin(lean) * tangent) @ R_WT.T
    recording = recorded(
        p_pad=tip, p_command=tip, v_command=SPEED * tangent @ R_WT.T, tool_axis=axis
    )
    tool = tool_figures(recording, truth)
    # measured 1e-5 m (chords of the path, 5 mm long) and 2e-5 rad
    assert true_path_deviation(recording, truth) == pytest.approx(0.002, abs=5e-5)
    assert tool.tilt_max_rad == pytest.approx(lean, abs=1e-4)


def test_twist_is_the_turn_about_the_tool_axis_from_the_axis_that_the_path_keeps():
    turned = TRUTH.model.path("longitudinal").turned(0.6)
    truth = replace(TRUTH, model=TRUTH.model.with_path("longitudinal", turned))
    R_WT = TRUTH.X_WT[:3, :3]
    twist = np.linspace(-0.02, 0.03, STEPS)[:, None]
    along, aside = R_WT[:, 0], -R_WT[:, 1]  # right-handed about the tool axis, which is -z
    x = np.cos(0.6 + twist) * along + np.sin(0.6 + twist) * aside
    recording = recorded(tool_x=x)
    angle = tool_twist(recording, truth)[1]
    assert angle == pytest.approx(
        np.interp(tool_twist(recording, truth)[0], TIME, twist[:, 0]), abs=1e-9
    )
    assert tool_figures(recording, truth).twist_max_rad == pytest.approx(0.03, abs=2e-4)
    assert tool_figures(recording, TRUTH).twist_max_rad is None


def test_reversals_are_counted_beyond_the_hysteresis(rng):
    swing = np.concatenate(
        [np.linspace(0.0, 0.1, 50), np.linspace(0.1, 0.02, 40), np.linspace(0.02, 0.2, 60)]
    )
    assert reversals(swing) == 2
    assert reversals(-swing + 1.0) == 2
    assert reversals(swing + 0.002 * rng.uniform(-1.0, 1.0, swing.size)) == 2
    assert (
        reversals(0.004 * np.sin(np.arange(100.0)))
        == reversals(np.zeros(0))
        == reversals(np.ones(3))
        == 0
    )


def test_hull_is_measured_from_the_first_touch():
    force = np.full(STEPS, 60.0)
    force[:1000] = 0.0
    offset = np.zeros((STEPS, 3))
    offset[:1000] = [1.0, 0.0, 0.0]  # before the touch: does not count, wherever the hull was
    state = np.full(STEPS, STATES.index(WorkState.WORK))
    state[:1500] = STATES.index(WorkState.PRESS)
    offset[3000] = [0.003, 0.004, 0.0]
    R_0 = exp_so3([0.2, -0.1, 2.0])
    quats = np.tile(quat_wxyz_from_rotation(R_0), (STEPS, 1))
    # the other of its two quaternions
    quats[4000] = -quat_wxyz_from_rotation(R_0 @ exp_so3([0.0, 0.02, 0.0]))
    hull = hull_figures(
        recorded(contact_normal=force, state=state, p_WB=offset, quat_WB_wxyz=quats)
    )
    assert hull.excursion_max_m == pytest.approx(0.005)
    assert hull.tilt_max_rad == pytest.approx(0.02)


def test_force_estimate_and_saturation():
    felt = np.tile([3.0, 0.0, 64.0], (STEPS, 1))
    saturated = np.zeros(STEPS)
    saturated[:25] = 1.0
    recording = recorded(felt_force=felt, felt_normal=np.full(STEPS, 58.0), saturated=saturated)
    side = np.array([3.0, 0.0, 4.0])
    axis = TRUTH.X_WT[:3, 2]
    expected = {"error_rms_n": 5.0, "normal_error_rms_n": 2.0}
    expected["tangential_error_rms_n"] = float(np.linalg.norm(np.cross(axis, side)))
    assert asdict(force_estimate_figures(recording)) == pytest.approx(expected)
    assert assessed(recording).metrics["thrusters"]["saturated_s"] == pytest.approx(0.05)


def test_controller_that_believes_in_no_force_has_no_estimate():
    blind = recorded(felt_force=np.full((STEPS, 3), np.nan), felt_normal=np.full(STEPS, np.nan))
    assert force_estimate_figures(blind).error_rms_n is None


@pytest.mark.parametrize(("range_m", "accepted"), [(1.2, True), (0.5, False)])
def test_identification_is_bound_by_its_share_of_the_range(range_m: float, accepted: bool):
    # the turn is the barrel's own
    X_WT = TRUTH.X_WT @ pose(exp_so3([2.0, 0.0, 0.0]), [0.004, 0.0, 0.0])
    target = Target(
        time=0.0, X_WT=X_WT, accepted=True, check_m=0.001, range_m=range_m, reason="", path=None
    )
    assessment = assessed(replace(recorded(), targets=(target,)))
    assert assessment.metrics["identification"]["position_error_m"] == pytest.approx(0.004)
    assert assessment.metrics["identification"]["orientation_error_rad"] == pytest.approx(
        0.0, abs=1e-9
    )
    assert (
        any(line.startswith("object position error") for line in assessment.failed) is not accepted
    )


def test_what_is_judged_is_the_pose_that_the_work_went_by():
    """The last find is refused, 9 mm off, their mean 1 mm: the work went by the mean; the last
    find's range stays.
    """
    recording = recorded()
    last = replace(
        recording.targets[0],
        X_WT=pose(p=[0.009, 0.0, 0.0]) @ TRUTH.X_WT,
        range_m=1.5,
        accepted=False,
    )
    mean = replace(last, accepted=True, X_WT=pose(p=[0.001, 0.0, 0.0]) @ TRUTH.X_WT, range_m=1.0)
    figures = assessed(
        replace(recording, targets=(*recording.targets, last), goes_by=mean)
    ).metrics["identification"]
    assert figures["position_error_m"] == pytest.approx(0.001)
    assert figures["range_m"] == 1.5
    assert figures["accepted"] is True
    before = assessed(replace(recording, targets=(*recording.targets, last))).metrics[
        "identification"
    ]
    assert before["position_error_m"] == pytest.approx(0.009)
    assert before["accepted"] is False


def test_run_that_never_touched_gives_nulls_and_says_why():
    recording = recorded(
        during=WorkState.SCAN, final=WorkState.ABORT, contact_normal=np.zeros(STEPS)
    )
    assessment = assessed(replace(recording, targets=()))
    jsonschema.validate(assessment.metrics, schema())
    assert not assessment.accepted
    json.dumps(assessment.metrics, allow_nan=False)
    assert assessment.metrics["contact"]["force_error_rms_n"] is None
    assert assessment.metrics["hull"]["tilt_max_rad"] is None
    assert re.fullmatch(
        r"the work was aborted in scan at \d+\.\d s: felt force 170 N", assessment.failed[0]
    )
    assert "the object was not identified" in assessment.failed


def test_check_that_could_not_be_made_is_null():
    target = Target(
        time=0.0,
        X_WT=np.eye(4),
        accepted=False,
        check_m=np.inf,
        range_m=1.0,
        reason="no",
        path=None,
    )
    assessment = assessed(replace(recorded(), targets=(target,)))
    assert assessment.metrics["identification"]["check_m"] is None


def test_collision_is_not_accepted():
    collision = np.zeros(STEPS)
    collision[7] = 1.0
    assert assessed(recorded(collision=collision)).failed == ("collision: 0.002 s, allowed 0 s",)
    met = replace(
        recorded(collision=collision), collided="'elbow' of 'forearm' met 'target' at 7.0 s"
    )
    assert assessed(met).failed == (f"collision: 0.002 s, allowed 0 s: {met.collided}",)


def test_object_must_have_the_path():
    with pytest.raises(ConfigurationError, match=r"no path 'spiral'.*longitudinal"):
        replace(TRUTH, path="spiral")


def test_closest_points_of_a_box_are_exact_and_its_edges_sharp(within):
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-2.0, 2.0) for z in (-3.0, 3.0)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([t for a, b, c, d in quads for t in ([a, b, c], [a, c, d])])
    surface = Surface.of(corners, triangles)
    points = np.random.default_rng(0).uniform(-6.0, 6.0, (500, 3))
    points = points[np.any(np.abs(points) > [1.0, 2.0, 3.0], axis=1)]
    closest, normals = surface.closest(points)
    within("closest point of a box [m]", closest - np.clip(points, [-1, -2, -3], [1, 2, 3]), 1e-13)
    assert np.allclose(np.sort(np.abs(normals), axis=1), [0.0, 0.0, 1.0])


def test_closest_on_curve_gives_arc_lengths_past_corners_and_repeated_points():
    curve = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 2, 0]])
    closest, arc = closest_on_curve(np.array([[0.3, -1.0, 0], [2.0, 1.5, 0], [-5.0, 0, 0]]), curve)
    assert np.allclose(closest, [[0.3, 0, 0], [1.0, 1.5, 0], [0, 0, 0]])
    assert np.allclose(arc, [0.3, 2.5, 0.0])


def test_work_without_contact_is_judged_by_its_distance(within):
    """Held 1 mm too far from the shell all along, and 3 mm too near for a moment."""
    truth = TrueObject(model=TRUTH.model, path=TRUTH.path, X_WT=TRUTH.X_WT, contactless=0.03)
    near = np.arange(STEPS) // 100 == 20  # 0.2 s, seen at 50 Hz
    height = np.where(near, 0.027, 0.031)
    tip = recorded()["p_pad"].value + height[:, None] * TRUTH.X_WT[:3, 2]
    none = np.zeros(STEPS)

    def free(p_pad: np.ndarray, contact: np.ndarray = none) -> Recording:
        return recorded(
            p_pad=p_pad, p_command=tip, set_force=none, felt_normal=none, contact_normal=contact
        )

    clean = free(tip)
    assessment = assess(clean, truth, seed=3, wall_s=0.5, identification_s=0.2)
    assert assessment.accepted, assessment.failed
    jsonschema.validate(assessment.metrics, schema())
    gap = assessment.metrics["gap"]
    assert gap["set_m"] == 0.03
    within("peak [m]", gap["error_max_m"] - 0.003, 5e-5)  # facets of the shell: 2e-5
    within("RMS [m]", gap["error_rms_m"] - np.sqrt(0.98 * 0.001**2 + 0.02 * 0.003**2), 5e-5)
    assert gap["touched_s"] == 0.0
    assert assessment.metrics["contact"] == {
        "force_error_rms_n": None,
        "force_error_max_n": None,
        "lost_s": None,
        "tangential_mean_n": None,
        "tangential_max_n": None,
        "segments": [],
    }

    failed = assess(free(tip, np.where(near, 1.0, 0.0)), truth, seed=3, wall_s=0.5).failed
    assert [line for line in failed if line.startswith("touched: 0.2 s")]
    inside = free(tip - 0.04 * TRUTH.X_WT[:3, 2])
    assert assess(inside, truth, seed=3, wall_s=0.5).metrics["gap"]["error_max_m"] == pytest.approx(
        0.03
    )
    assert assessed(recorded()).metrics["gap"] is None


def levels_of(*parts: tuple[float, float]) -> np.ndarray:
    """Set force over the run: pairs of a force [N] and the seconds for which it is set, the last
    one to the end.
    """
    forces = np.concatenate([np.full(round(seconds / DT), force) for force, seconds in parts])
    return np.pad(forces, (0, STEPS), mode="edge")[:STEPS]


def test_a_level_of_force_that_ends_before_it_has_settled_is_named():
    """Three equal parts of the path; the second force is set late in its part, or not at all."""
    third = STEPS * DT / 3.0
    late = third - SETTLING - 0.5 * JUDGED
    forces = (60.0, 90.0, 60.0)
    complete = recorded(set_force=levels_of((60.0, third), (90.0, third), (60.0, third)))
    assert unjudged_levels(complete, forces) == ()
    short = recorded(set_force=levels_of((60.0, third + late), (90.0, third - late), (60.0, third)))
    assert unjudged_levels(short, forces) == (
        "set force of 90 N, level 2 of 3: judged for 0.25 s, less than 0.5 s",
    )
    assert [segment.judged for segment in contact_figures(short).segments] == [True, False, True]
    # one level
    assert unjudged_levels(recorded(set_force=np.full(STEPS, 60.0)), (60.0,) * 40) == ()
    assert unjudged_levels(recorded(set_force=levels_of((60.0, 1.0))), forces) == (
        "set force of 90 N, level 2 of 3: judged for 0.00 s, less than 0.5 s",
    )
    work = AskedWork(forces=forces, speed=SPEED)
    assessment = assess(short, TRUTH, seed=3, wall_s=0.5, asked=work)
    assert [line for line in assessment.failed if line.startswith("set force of 90 N")]


def test_the_error_counts_from_half_a_second_after_a_long_ramp():
    """A ramp of 2 s, followed exactly: its error from the final force is none of the tool's."""
    rise = np.clip(20.0 + 30.0 * (TIME - 3.0), 20.0, 80.0)
    figures = contact_figures(recorded(set_force=rise, contact_normal=rise))
    assert figures.force_error_max_n == pytest.approx(0.0, abs=1e-9)
    assert [segment.set_n for segment in figures.segments] == [20.0, 80.0]
    assert figures.segments[1].judged_s == pytest.approx(10.0 - 3.0 - 2.0 - 0.5, abs=2 * DT)


@pytest.mark.parametrize(("share", "failed"), [(0.95, False), (0.85, True), (1.2, True)])
def test_the_mean_speed_is_that_of_the_tip_where_it_was_to_move_at_the_set_one(
    share: float, failed: bool
):
    """The tip moves at a share of the commanded speed; ramps at both ends are left out."""
    along = TRUTH.X_WT[:3, 0]
    ramp = np.clip(np.minimum(TIME, TIME[-1] - TIME), 0.0, 1.0)
    tip = np.outer(np.cumsum(share * SPEED * ramp) * DT, along)
    recording = recorded(v_command=np.outer(SPEED * ramp, along), p_pad=tip)
    figures = speed_figures(recording, SPEED)
    # 1.2e-3: the last tenth of the ramps
    assert figures.mean == pytest.approx(share * SPEED, rel=2e-3)
    assert figures.share == pytest.approx(
        (STEPS * DT - 2.0 + 2 * 0.095) / (STEPS * DT - 1.0), abs=1e-3
    )
    assessment = assess(recording, TRUTH, seed=3, wall_s=0.5, asked=AskedWork(speed=SPEED))
    assert any(line.startswith("mean speed error") for line in assessment.failed) == failed


def test_a_set_speed_that_is_never_commanded_has_no_figure_and_is_not_accepted():
    assessment = assess(recorded(), TRUTH, seed=3, wall_s=0.5, asked=AskedWork(speed=3.0 * SPEED))
    assert "mean speed error: no value" in assessment.failed
    assert assessment.metrics["speed"] == {
        "set": pytest.approx(3.0 * SPEED),
        "mean": None,
        "share": 0.0,
    }


def test_a_tip_beside_the_ideal_path_of_the_true_object_is_not_accepted():
    """It keeps the commanded path, which is beside the true one: by more than identification and
    path may be off.
    """
    aside = 0.0085 * (TRUTH.X_WT[:3, 1])
    p = recorded()["p_command"].value + aside
    assessment = assess(recorded(p_pad=p, p_command=p), TRUTH, seed=3, wall_s=0.5)
    assert assessment.metrics["tool"]["path_deviation_max_m"] == pytest.approx(0.0, abs=1e-9)
    (line,) = [line for line in assessment.failed if line.startswith("true path deviation, peak")]
    assert "allowed 8 mm" in line


def test_a_run_that_its_limit_ends_says_so():
    assessment = assessed(recorded(final=WorkState.WORK))
    assert assessment.metrics["run"]["abort"] == "time limit"
    assert assessment.failed[0] == (
        "the time limit ended the run after 10.0 s, in state work (--longest)"
    )


def test_on_growth_the_ideal_path_lies_on_the_true_surface():
    """The tip 30 mm above the clean path, on growth as high: only what it is beside the path, or
    off the growth.
    """
    clean = TRUTH.model
    grown = replace(
        clean, vertices=np.asarray(clean.vertices) * (1.0 + 0.03 / (0.5 * BARREL_DIAMETER))
    )
    truth = replace(TRUTH, model=grown, deformed=True)
    outward, aside = TRUTH.X_WT[:3, 2], TRUTH.X_WT[:3, 1]
    p = recorded()["p_command"].value
    on = true_path_deviation(recorded(p_pad=p + 0.03 * outward), truth)
    assert on == pytest.approx(0.0, abs=2e-4)  # 1.0e-4: the barrel's facets
    beside = true_path_deviation(recorded(p_pad=p + 0.03 * outward + 0.004 * aside), truth)
    assert beside == pytest.approx(0.004, abs=2e-4)
    above = true_path_deviation(recorded(p_pad=p + 0.035 * outward), truth)
    assert above == pytest.approx(0.005, abs=2e-4)
