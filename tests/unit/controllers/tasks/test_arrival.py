"""The mean of several finds, and the wait for a place that is certain enough."""

from dataclasses import replace

import numpy as np
import pytest

from at_rest import at_rest
from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.promise import NAVIGATION_TIME, PromiseLimits
from uuv.controllers.tasks import surface_work
from uuv.controllers.tasks.arrival import ScanLimits, ScanTarget, TareSensors, fuse_poses
from uuv.controllers.tasks.phase import Abort, Context, Held, PhaseEvent, ToolLine
from uuv.controllers.tasks.surface_work import CertainPlace
from uuv.sim.interfaces.messages import AbortCode, Promise, Target, ToolPath
from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import Array, exp_so3, log_so3, pose, transform_points

# far from the origin: turns have a long lever there
TRUE = pose(exp_so3([0.3, -0.5, 2.0]), [40.0, -25.0, -12.0])
PATH_T = np.linspace([-0.3, 0.0, 0.3], [0.3, 0.1, 0.3], 40)


def found(X_WT: Array, *, path: bool = True) -> Target:
    s = np.linspace(0.0, 0.6, 40)
    turned = np.ones((40, 1)) * X_WT[:3, 2]
    on = ToolPath(
        s=s,
        p=transform_points(X_WT, PATH_T),
        z=-turned,
        x=np.ones((40, 1)) * X_WT[:3, 0],
        on_scan=np.ones(40, bool),
    )
    return Target(
        time=0.0,
        X_WT=X_WT,
        accepted=True,
        check_m=0.0,
        range_m=1.0,
        reason="",
        path=on if path else None,
    )


def off(rng: np.random.Generator, move: float, turn: float) -> Array:
    """TRUE moved and turned about its own origin by random errors of those deviations [m, rad]."""
    return pose(
        exp_so3(turn * rng.normal(size=3)) @ TRUE[:3, :3], TRUE[:3, 3] + move * rng.normal(size=3)
    )


def test_mean_of_one_is_that_one(within):
    single = fuse_poses([found(TRUE)])
    within("pose", single.X_WT - TRUE, 1e-13)
    assert single.path is not None
    within("path [m]", single.path.p - transform_points(TRUE, PATH_T), 1e-13)


def test_errors_shrink_by_the_root_of_the_number(rng, within):
    """Of 9 finds a third is left, in place and in turn, over 100 means (chi-square: 4 % of
    deviation).
    """
    moves, turns = [], []
    for _ in range(100):
        mean = fuse_poses([found(off(rng, 2e-3, 3e-3)) for _ in range(9)])
        assert mean.path is not None
        # About the middle of the path, 0.3 m from the object's origin, the turn moves too.
        moves.append(mean.X_WT[:3, 3] - TRUE[:3, 3])
        turns.append(log_so3(mean.X_WT[:3, :3] @ TRUE[:3, :3].T))
    within("moves", np.std(moves) / (2e-3 / 3) - 1.0, 0.15)
    within("turns", np.std(turns) / (3e-3 / 3) - 1.0, 0.15)


def test_path_goes_with_the_pose(rng, within):
    mean = fuse_poses([found(off(rng, 2e-3, 3e-3)) for _ in range(4)])
    assert mean.path is not None
    within("points [m]", mean.path.p - transform_points(mean.X_WT, PATH_T), 1e-12)
    within("axes", mean.path.z + mean.X_WT[:3, 2], 1e-12)
    within("directions", mean.path.x - mean.X_WT[:3, 0], 1e-12)


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(pose(TRUE[:3, :3], TRUE[:3, 3] + [0.2, 0.0, 0.0]), id="elsewhere"),
        pytest.param(
            pose(TRUE[:3, :3] @ exp_so3([np.pi, 0.0, 0.0]), TRUE[:3, 3]), id="turned over"
        ),
    ],
)
def test_what_does_not_agree_is_left_out(other, within):
    within("pose", fuse_poses([found(other), found(TRUE), found(TRUE)]).X_WT - TRUE, 1e-13)
    within("the last one", fuse_poses([found(TRUE), found(TRUE), found(other)]).X_WT - TRUE, 1e-13)


def test_without_a_path(rng):
    mean = fuse_poses([replace(found(off(rng, 1e-3, 1e-3), path=False)) for _ in range(3)])
    assert mean.path is None
    assert np.linalg.norm(mean.X_WT[:3, 3] - TRUE[:3, 3]) < 5e-3


def stated(rng: np.random.Generator, deviation: Array, error: Array | None = None) -> Target:
    """A find that is off by drawn errors (or `error`) of the stated deviations (6,) [m] of its
    twist.
    """
    center = transform_points(TRUE, np.array([0.1, 0.0, 0.2]))
    drawn = deviation * rng.normal(size=6) if error is None else error
    R = exp_so3(drawn[3:] / 0.5)
    X_WT = pose(R @ TRUE[:3, :3], center + drawn[:3] + R @ (TRUE[:3, 3] - center))
    free = np.zeros((0, 6))
    matrix = np.diag(deviation**2)
    doubt = PoseCovariance(
        matrix=matrix, free=free, center=center + drawn[:3], radius=0.5, size_sigma=1.0
    )
    return replace(found(X_WT), covariance=doubt)


def test_better_finds_weigh_more_and_the_covariance_is_right(rng):
    """Two views, each of which is loose along another direction: the mean is good along both; NEES
    6.
    """
    loose = np.full(6, 1e-3)
    squares = []
    errors = []
    first, other = np.array(loose), np.array(loose)
    first[0], other[1] = 10e-3, 10e-3
    for _ in range(300):
        targets = [stated(rng, first), stated(rng, other)]
        mean = fuse_poses(targets)
        assert mean.covariance is not None
        squares.append(mean.covariance.normalised_error(mean.X_WT, TRUE))
        errors.append(mean.covariance.twist(mean.X_WT, TRUE)[:2])
    assert np.std(errors, axis=0).max() < 1.3e-3  # 1 mm; the plain mean: 5 mm
    assert 4.5 < np.mean(squares) < 6.7


def test_outlier_is_told_by_its_normalised_distance(rng):
    """10 mm off is nothing for a loose find, and an outlier among sharp ones."""
    sharp = np.full(6, 1e-3)
    off = np.array([10e-3, 0.0, 0.0, 0.0, 0.0, 0.0])
    good = [stated(rng, sharp) for _ in range(4)]
    mean = fuse_poses([*good, stated(rng, sharp, off)])
    assert np.linalg.norm(mean.X_WT[:3, 3] - TRUE[:3, 3]) < 3e-3
    assert mean.covariance is not None
    two = fuse_poses([stated(rng, 10.0 * sharp, off), stated(rng, 10.0 * sharp, 0.0 * off)])
    assert two.covariance is not None
    assert abs(two.covariance.twist(two.X_WT, TRUE)[0] + 5e-3) < 1e-6


def looked(targets: list[Target], views: int = 3) -> tuple[Held, list[str]]:
    """Run ScanTarget over the targets of successive views, two looks each; what the phases share,
    and the events.
    """
    phase = ScanTarget(ScanLimits(views=views, finds=2, interval=0.0))
    events = []
    held = Held(X_WB=np.eye(4), X_WB_scan=np.eye(4), q=np.zeros(0))
    time = 0.0
    at = at_rest()
    state = phase.enter(held, Context(time, 0.01, at, None, None))
    for target in targets:
        time += 1.0
        outcome = phase.step(state, held, Context(time, 0.01, at, replace(target, time=time), None))
        if outcome is not None:
            events.append(outcome.code if isinstance(outcome, Abort) else outcome)
            state = phase.enter(held, Context(time, 0.01, at, None, None))
    return held, events


def test_a_loose_find_asks_for_another_view_and_both_count(rng):
    loose, other = np.full(6, 1e-3), np.full(6, 1e-3)
    loose[0], other[1] = 20e-3, 20e-3
    X_next = pose(p=[0.5, 0.5, 0.0])
    first = [replace(stated(rng, loose), next_X_WB=X_next) for _ in range(2)]
    held, events = looked([*first, stated(rng, other), stated(rng, other)])
    assert events == [PhaseEvent.REFUSED, PhaseEvent.DONE]
    assert held.target is not None
    assert held.target.covariance is not None
    assert held.target.covariance.position_sigma < 1.5e-3
    alone, events = looked(first, views=1)  # no other view may be taken: what there is has to do
    assert events == [PhaseEvent.DONE]
    assert alone.target is not None
    assert alone.next_X_WB is X_next


def test_a_loose_find_is_kept_where_the_other_view_shows_nothing(rng):
    X_next = pose(p=[0.5, 0.5, 0.0])
    loose = replace(stated(rng, np.full(6, 10e-3)), next_X_WB=X_next)
    nothing = replace(loose, accepted=False, path=None, reason="hidden")
    held, events = looked([loose, loose, nothing], views=2)
    assert events == [PhaseEvent.REFUSED, PhaseEvent.DONE]
    assert held.target is not None
    _, events = looked([nothing, nothing], views=2)
    assert events == [PhaseEvent.REFUSED, AbortCode.NOT_IDENTIFIED]


def test_the_error_of_the_hull_shrinks_with_time_but_that_of_its_attitude_does_not(rng):
    """Finds with registration of 0.1 mm, hull position of 2 mm and attitude of 1 mrad; 0.03, 2.4
    and 240 s apart.
    """
    sigma = 1e-4
    offset = 2e-3
    angle = 1e-3
    lever = np.array([1.0, 0.0, -0.5])
    base = stated(rng, np.full(6, sigma), np.zeros(6))
    assert base.covariance is not None
    at = base.covariance.center - lever
    of_hull = base.covariance.of_carrier(at, np.full(3, offset), angle)
    turned = base.covariance.of_carrier(at, np.zeros(3), angle)
    find = replace(base, covariance=base.covariance.plus(of_hull), hull_covariance=of_hull)
    variances = {}
    for apart in (0.03, NAVIGATION_TIME, 100.0 * NAVIGATION_TIME):
        mean = fuse_poses([replace(find, time=k * apart) for k in range(6)])
        assert mean.covariance is not None
        variances[apart] = np.diag(mean.covariance.matrix - turned)[:3]
    # one correlation time apart
    alike = np.exp(-np.abs(np.subtract.outer(np.arange(6), np.arange(6))))
    for apart, share in zip(variances, (1.0, alike.mean(), 1.0 / 6.0), strict=True):
        assert np.sqrt(variances[apart]) == pytest.approx(offset * np.sqrt(share), rel=0.05)


def tared(
    chances: list[float], limits: PromiseLimits, monkeypatch: pytest.MonkeyPatch
) -> tuple[Held, float, Abort | None]:
    """Run the tare with a chance of `chances[k]` k seconds after it; when it was done [s], and the
    abort if any.
    """
    zero = np.zeros(3)
    began = 3.5
    at = at_rest()
    clock = {"time": 0.0}

    def told(*_: object) -> Promise:
        probability = chances[min(int(clock["time"] - began), len(chances) - 1)]
        return Promise(chance=probability, tolerance=3e-3, navigation_sigma=1e-3, object_sigma=1e-3)

    monkeypatch.setattr(surface_work, "promise", told)
    placement = Placement(
        X_WB=np.eye(4), travel_W=zero, roll=0.0, q_start=zero, margin=1.0, reached=1.0
    )
    target = found(TRUE)
    assert target.path is not None
    held = Held(X_WB=np.eye(4), X_WB_scan=np.eye(4), q=np.zeros(0), target=target)
    held.line = ToolLine(target.path, placement, -0.1)
    phase = CertainPlace(TareSensors(), limits, 0.02)
    state = phase.enter(held, Context(0.0, 0.01, at, None, None))
    for k in range(1, 6000):
        clock["time"] = 0.01 * k
        outcome = phase.step(state, held, Context(clock["time"], 0.01, at, None, None))
        assert (
            phase.setpoint(state, held, Context(clock["time"], 0.01, at, None, None)).X_WG
            is not None
        )
        if outcome is not None:
            return held, clock["time"], outcome if isinstance(outcome, Abort) else None
    raise AssertionError("it never ended")


@pytest.mark.parametrize(
    ("chances", "seconds"),
    [
        pytest.param([0.99], 0.0, id="good enough at once"),
        pytest.param([0.7, 0.7], 1.0, id="no better by waiting"),
        pytest.param([0.7, 0.8, 0.9, 0.985], 3.0, id="waits until it is good enough"),
        pytest.param([0.3 + 0.02 * k for k in range(40)], 15.0, id="but not for ever"),
    ],
)
def test_a_better_place_is_waited_for(
    chances: list[float], seconds: float, monkeypatch: pytest.MonkeyPatch
):
    held, done, abort = tared(chances, PromiseLimits(), monkeypatch)
    assert abort is None
    assert done - 3.5 == pytest.approx(seconds, abs=0.06)
    assert held.promise is not None
    assert "path error < 3 mm" in held.note


def test_too_small_a_chance_is_refused_with_its_figures(monkeypatch: pytest.MonkeyPatch):
    _, _, abort = tared([0.6], PromiseLimits(least=0.8), monkeypatch)
    assert abort is not None
    assert abort.code is AbortCode.PLACE_UNCERTAIN
    assert (
        abort.reason == "path error < 3 mm: probability 60.0% (sigma: hull 1.0 "
        "mm, object 1.0 mm); at least 80.0% is required"
    )
