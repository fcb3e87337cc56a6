"""The main job by published methods: each one is run, and stands in the campaign of versions."""

import tomllib
from pathlib import Path
from typing import get_args

from experiments.papers.published_jobs import METHODS, published_jobs
from uuv.methods import ForceSource, PublishedMethod

METHODS_OF_PAPERS = {*get_args(PublishedMethod), "motors"}


def test_every_published_method_is_run_on_both_paths():
    run = {method for control in METHODS.values() for method in control.published}
    sources = {control.force_from for control in METHODS.values()}
    assert run | (sources - {"sensors"}) == METHODS_OF_PAPERS
    assert sources == set(get_args(ForceSource))
    paths = {case.path for case in published_jobs.study(published_jobs.options_with({})).cases}
    assert paths == {"longitudinal", "transverse"}


def test_every_published_method_is_a_version_of_the_campaign(root: Path):
    text = (root / "scripts" / "campaigns" / "versions.toml").read_text(encoding="utf-8")
    versions = tomllib.loads(text)["versions"].values()
    assert all(any(method in str(version) for version in versions) for method in METHODS_OF_PAPERS)
