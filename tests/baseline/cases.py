"""The short scenarios whose figures the baseline holds: each a function from a seed to figures by
name.

They come in by the doors that users take (the scenarios' own options, `perception.identify`,
`calib.identify`, `uuv.controllers.mkps.solve`) and give back every number that a run's metrics
hold, but its wall times.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from bands import Figures, numbers_of
from experiments.contact.force_steps import figures as figures_of_step
from experiments.contact.force_steps import steps_up
from experiments.vehicles.pushed_hover import POSTURES, flow
from experiments.vehicles.pushing import PushCase as Push
from experiments.vehicles.pushing import run as push
from uuv.arm_identification.calibration_case import nominal
from uuv.arm_identification.simulated_touches import simulated
from uuv.assembly import assemble
from uuv.calib import identify as calibrate
from uuv.calib.simulation import HAND_NOISE
from uuv.calib.verification import kabsch
from uuv.clouds.object_scenes import object_scene
from uuv.controllers.mkps import Chain, solve
from uuv.experiment.local_processes import run_all
from uuv.jobs import (
    clean_barrel,
    clean_object,
    clean_pile,
    insert_sampler,
    inspect_object,
    sample_seabed,
)
from uuv.models.arms import published_arms
from uuv.perception import identify
from uuv.runner import Run, run
from uuv.scenario import Scenario
from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import spread_directions, transform_points
from uuv.tasks.surface_work import SurfaceWorkTask

__all__ = ["CASES", "run_all"]

GUST = 0.03  # [m/s]
NO_BEHAVIOUR = ("timings", "run.seed", "run.abort")  # what metrics hold beside figures


def figures_of(assessment: Assessment) -> Figures:
    """Every number of a run's metrics that is behaviour, and its verdict."""
    return numbers_of(assessment.metrics, without=NO_BEHAVIOUR)


def ran(scenario: Scenario) -> Figures:
    return figures_of(run(assemble(scenario)).assessment)


@lru_cache(maxsize=1)
def barrel_longitudinal_run(seed: int) -> Run:
    """The main job; the last run is kept, for its trajectory is compared too."""
    return run(assemble(clean_barrel(seed=seed, quick=True)))


def barrel_longitudinal(seed: int) -> Figures:
    return figures_of(barrel_longitudinal_run(seed).assessment)


def barrel_transverse(seed: int) -> Figures:
    return ran(clean_barrel(seed=seed, quick=True, path="transverse"))


def pile(seed: int) -> Figures:
    return ran(clean_pile(seed=seed, quick=True))


def rock(seed: int) -> Figures:
    return ran(clean_object(seed=seed, quick=True, object="rock"))


def force_steps(seed: int) -> Figures:
    """The mean of three abrupt steps of the set force from 60 to 90 N while the tool moves along
    the barrel.
    """
    low = 60.0
    high = 90.0
    steps = 3
    scenario = clean_barrel(seed=seed, length=0.36, forces=(low, high) * steps)
    assert isinstance(scenario.task, SurfaceWorkTask)
    recording = run(
        assemble(replace(scenario, task=replace(scenario.task, force_rate=1e6)))
    ).recording
    responses = steps_up(recording, low, high)["true"]
    work = recording.within(WorkState.WORK)
    error = (recording["contact_normal"].scalar - recording["set_force"].scalar)[work]
    figures = {
        "steps": float(len(responses)),
        "force_error_rms_n": float(np.sqrt(np.mean(error**2))),
    }
    if not len(responses):
        return figures
    mean = responses.mean(axis=0)
    scatter = float(np.sqrt(np.mean((responses - mean) ** 2)))
    return {**figures, **figures_of_step(mean, low, high), "scatter_n": scatter}


def insertion(seed: int) -> Figures:
    return ran(insert_sampler(seed=seed, quick=True, error=(2.5, 0.0)))


def core(seed: int) -> Figures:
    return ran(sample_seabed(seed=seed, push=40.0))


def drag(seed: int) -> Figures:
    return ran(sample_seabed(seed=seed, work="drag"))


def inspection(seed: int) -> Figures:
    """Once around a rock, fast."""
    return ran(inspect_object(seed=seed, object="rock", speed=0.25))


def identification(name: str, seed: int) -> Figures:
    """Two scenes of the object, white and stereo noise: errors over all, and along the line of
    sight with its sign.
    """
    figures: dict[str, float | None] = {}
    for sensor in ("white", "stereo"):
        scenes = [object_scene(name, 2 * seed + k, sensor) for k in range(2)]
        identifications = [
            identify(s.scan, s.target, s.approach, s.orientation, sensor=s.sensor.model)
            for s in scenes
        ]
        errors = np.array(
            [
                scene.error(identified.X_sensor_target)
                for scene, identified in zip(scenes, identifications, strict=True)
            ]
        )
        farther = [  # [m] mean distance by which the found points lie behind the true ones
            np.linalg.norm(transform_points(identified.X_sensor_target, s.target.center))
            - np.linalg.norm(transform_points(s.X_CT, s.target.center))
            for s, identified in zip(scenes, identifications, strict=True)
        ]
        figures |= {
            f"{sensor}.position_m": float(np.sqrt(np.mean(errors[:, 0] ** 2))),
            f"{sensor}.orientation_rad": float(np.sqrt(np.mean(errors[:, 1] ** 2))),
            f"{sensor}.farther_m": float(np.mean(farther)),
            f"{sensor}.accepted": float(
                np.mean([identified.accepted for identified in identifications])
            ),
        }
    return figures


def calibration(seed: int) -> Figures:
    """63 touches of a UR10e by hand, one distance known: what the identified arm's tip is off in
    new postures.
    """
    rng = np.random.default_rng(seed)
    source = nominal("ur10e", Path(), None, None)
    case = simulated(
        source,
        points=3,
        touches=21,
        noise=HAND_NOISE,
        pin="off-axis",
        known=True,
        errors=seed,
        rng=rng,
    )
    assert case.truth is not None
    fit = calibrate(list(case.touches.series), source.arm, distances=case.distances)
    q = rng.uniform(-np.pi, np.pi, (200, source.arm.n))
    true = case.truth.arm.tips(q, case.truth.tcp)
    figures = {"noise_m": fit.noise, "cost_m2": fit.cost, "free": float(len(fit.names))}
    for name, arm, tcp in (
        ("nominal", source.arm, fit.nominal_tcp),
        ("identified", fit.arm, fit.tcp),
    ):
        tips = arm.tips(q, tcp)
        off = transform_points(kabsch(tips, true), tips) - true  # the base of either is nobody's
        figures[f"{name}_tip_rms_m"] = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
    return figures


def inverse_kinematics(seed: int) -> Figures:
    """Poses that four published arms can take, cold starts: iterations, restarts, misses and what
    errors are left.
    """
    rng = np.random.default_rng(seed)
    figures: dict[str, float | None] = {}
    for name in ("puma560", "ur10e", "panda", "gen3"):
        arm = published_arms.load(name)
        limits = np.clip(arm.limits, -np.pi, np.pi)
        chain = Chain.from_arm(replace(arm, limits=limits))
        rows = []
        for q in rng.uniform(limits[:, 0], limits[:, 1], (150, arm.n)):
            start = rng.uniform(limits[:, 0], limits[:, 1])
            solution = solve(chain, arm.joint_frames(q)[-1], start)
            rows.append(
                (
                    solution.iterations,
                    solution.restarts,
                    not solution.converged,
                    solution.position_error,
                    solution.orientation_error,
                )
            )
        iterations, restarts, missed, position, orientation = np.array(rows, dtype=np.float64).T
        figures |= {
            f"{name}.iterations": float(np.log(iterations + 1.0).mean()),
            f"{name}.restarted": float(np.mean(restarts > 0)),
            f"{name}.missed": float(missed.sum()),
            f"{name}.position_error_log": float(np.log(position + 1e-9).mean()),
            f"{name}.orientation_error_log": float(np.log(orientation + 1e-9).mean()),
        }
    return figures


def hover_envelope(seed: int) -> Figures:
    """The tool pushed with 90 N at full reach in three directions, with and without
    compensation.
    """
    case = Push(
        directions_B=spread_directions(6)[[0, 2, 4]],
        q=np.array(POSTURES["down"]),
        settle=8.0,
        push=3.0,
        rest=1.5,
        gust=GUST,
        current_W=flow(0.2),
        seed=seed,
    )
    figures: dict[str, float | None] = {}
    for name, compensation in (("compensated", True), ("alone", False)):
        pushed = push(replace(case, compensation=compensation))
        figures |= {
            f"{name}.excursion_m": float(pushed.excursion.mean()),
            f"{name}.tilt_rad": float(pushed.tilt.mean()),
            f"{name}.turn_rad": float(pushed.turn.mean()),
            f"{name}.force_error_n": float(pushed.force_error.mean()),
            f"{name}.current_error_m_s": float(np.sqrt(np.mean(pushed.current_error**2))),
            f"{name}.command_rate": pushed.command_rate,
        }
    return figures


CASES: Mapping[str, Callable[[int], Figures]] = {
    "barrel_longitudinal": barrel_longitudinal,
    "barrel_transverse": barrel_transverse,
    "pile": pile,
    "rock": rock,
    "force_steps": force_steps,
    "insertion": insertion,
    "core": core,
    "drag": drag,
    "inspection": inspection,
    "identification_barrel": lambda seed: identification("barrel", seed),
    "identification_valve": lambda seed: identification("valve", seed),
    "identification_rock": lambda seed: identification("rock", seed),
    "calibration": calibration,
    "inverse_kinematics": inverse_kinematics,
    "hover_envelope": hover_envelope,
}
