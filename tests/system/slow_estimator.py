"""An estimator that works 20 ms longer on each pose: the benchmark of the chain must show just that."""

import time

from services.estimator import Estimator

EXTRA_S = 0.020


class SlowEstimator(Estimator):
    """The estimator, with extra work for every pose."""

    def step(self, now_s: float) -> None:
        """Work longer, and predict to the moment after it as the real one would."""
        if self.pose.updated:
            end_s = time.perf_counter() + EXTRA_S
            while time.perf_counter() < end_s:
                pass
        super().step(now_s)
