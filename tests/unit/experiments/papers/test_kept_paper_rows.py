"""Rows of the papers' methods against the present code: a changed method leaves its kept rows."""

from dataclasses import asdict
from itertools import product
from typing import Any

import pytest

from experiments.papers.published_icp import METHODS, IcpCase, published_icp
from experiments.papers.recipes import RECIPES
from experiments.papers.servo_arm import ServoCase, servo_arm
from experiments.papers.singular_crossings import CrossingCase, singular_crossings
from experiments.papers.track_singularity import TrackCase, track_singularity
from uuv.experiment.declaration import Experiment
from uuv.results.check import deviations
from uuv.results.kept_rows import kept_rows

CASES: dict[str, tuple[Experiment[Any, Any], list[Any]]] = {
    "track_singularity": (track_singularity, [TrackCase(recipe=recipe) for recipe in RECIPES]),
    "singular_crossings": (
        singular_crossings,
        [
            CrossingCase(recipe=recipe, path=path)
            for recipe, path in product(RECIPES, ("puma560, 20 mm", "ur5, 2 mm"))
        ],
    ),
    "servo_arm": (servo_arm, [ServoCase(method="plain"), ServoCase(method="hybrid")]),
    "published_icp": (
        published_icp,
        [IcpCase(object="starfish", method=method, seed=1) for method in METHODS],
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_the_methods_of_the_papers_give_their_kept_rows(name: str) -> None:
    """Within the tolerance of each column."""
    experiment, cases = CASES[name]
    kept = kept_rows(name)
    assert kept is not None
    rows = [asdict(case) | asdict(experiment.run(case)) for case in cases]
    assert list(deviations(experiment, kept, rows)) == []
