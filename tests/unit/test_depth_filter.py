"""Depth, heave speed and net weight from a depth sensor."""

from __future__ import annotations

import math
import random

import pytest

from marine.estimation.depth import DepthFilter
from services.vessels import load_vessel

FALCON = load_vessel("falcon")


def test_it_finds_depth_speed_and_weight_of_a_vessel_that_is_pushed_down_and_up() -> None:
    heave, sensor = FALCON.model.heave, FALCON.sensor("depth")
    assert heave is not None
    assert sensor is not None
    chance, z, w, t = random.Random(3), 0.5, 0.0, 0.0
    found = DepthFilter(heave, sensor, z, 300.0)
    errors = []
    for k in range(600):
        Z = 40.0 * math.sin(0.5 * t)
        for _ in range(10):
            w += 0.01 * (Z + 10.0 - heave.drag(w)) / heave.alpha  # heavy by 10 N
            z += 0.01 * w
            t += 0.01
        found.update(0.1, Z, round(z, 2) + chance.gauss(0.0, 0.002))
        if k > 100:
            at_z, at_w = found.predicted(0.0, Z)
            errors.append((at_z - z, at_w - w))
    rms_z, rms_w = (math.sqrt(sum(e[i] ** 2 for e in errors) / len(errors)) for i in range(2))
    assert rms_z < 0.005  # a sample is rounded to 1 cm
    assert rms_w < 0.02
    assert found._x[2] == pytest.approx(10.0, abs=8.0)


def test_it_looks_ahead_with_the_force_that_acts() -> None:
    heave, sensor = FALCON.model.heave, FALCON.sensor("depth")
    assert heave is not None
    assert sensor is not None
    found = DepthFilter(heave, sensor, 1.0, 300.0)
    z, w = found.predicted(0.2, 65.0)
    assert w == pytest.approx(0.2 * 65.0 / heave.alpha, rel=0.2)
    assert z == pytest.approx(1.0 + 0.1 * w, rel=0.01)
