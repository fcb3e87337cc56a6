"""Estimators that an entry of the benchmark may bring."""

from uuv.perception.navigation.raw_navigation import RawNavigation
from uuv.perception.navigation.strapdown_filter import Navigation


class RawEstimator:
    """Navigation without fusion, made of the believed model."""

    def __init__(self, model):
        del model
        self.navigation = RawNavigation()
        self.period = self.navigation.period

    def init(self, first):
        return self.navigation.init(first)

    def step(self, state, measurements):
        return self.navigation.step(state, measurements)


def given(model):
    """The navigation that all entries without an estimator get."""
    del model
    return Navigation()
