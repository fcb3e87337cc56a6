"""Moved plugs: the case's kinds, and what counts as it should."""

import pytest

from experiments.contact.plugs import KINDS, PlugCase
from uuv.sim.interfaces.errors import ConfigurationError


def test_a_kind_that_there_is_not_is_refused() -> None:
    assert [PlugCase(kind=kind, seed=0).kind for kind in KINDS] == list(KINDS)
    with pytest.raises(ConfigurationError, match="--kind: allowed plug, stuck plug, debris"):
        PlugCase(kind="lost", seed=0)
