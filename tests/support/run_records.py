"""Entries of metrics.json that every run has."""

from typing import Any


def every_run(**run: Any) -> dict[str, Any]:
    """Content of metrics.json with no figure of the work; `run` are entries of its table of that
    name.
    """
    ended = {
        "simulated_s": 12.5,
        "seed": 3,
        "state": "done",
        "note": "",
        "abort": None,
        "collision_s": 0.0,
    }
    return {
        "run": {**ended, "trajectory_sha256": "ab" * 32, **run},
        "accepted": True,
        "failed": [],
        "timings": {"wall_s": 2.5, "real_time_factor": 5.0, "identification_s": None},
    }
