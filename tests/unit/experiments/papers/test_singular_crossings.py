"""Crossings of singular configurations: what is accepted of rows made by hand."""

from typing import Any

from experiments.papers.recipes import DEFAULT, WITHOUT
from experiments.papers.singular_crossings import CrossingCase, singular_crossings


def row(recipe: str, share_off: float, joint_speed: float) -> dict[str, Any]:
    """A row of a recipe."""
    outcome = {"share_off": share_off, "joint_speed": joint_speed}
    errors = {"arm": "ur5", "position_error": 1e-3, "orientation_error": 1e-2}
    return vars(CrossingCase(recipe=recipe, path="ur5, 2 mm")) | errors | outcome


def test_only_the_recipes_that_pass_keep_the_limit_and_the_default_leaves_least():
    fair = [row(WITHOUT, 0.0, 50.0), row(DEFAULT, 0.1, 2.0), row("hold", 0.2, 2.0)]
    assert singular_crossings.summary(fair).accepted
    fast = [*fair, row("auto", 0.3, 2.1)]
    assert singular_crossings.summary(fast).failed == [
        "joint speed over the limit: 1.05, at most 1 is allowed"
    ]
    beaten = [*fair, row("auto", 0.05, 2.0)]
    failed = singular_crossings.summary(beaten).failed
    assert failed is not None
    assert len(failed) == 1
    assert failed[0].startswith("share off by the default recipe, over the least: 0.05, at most 0")
