"""The wall before a vessel with a laser module: the EKF of thesis Table 8.2, with sensors of other rates and delays."""

from __future__ import annotations

import copy
import math
from bisect import insort
from dataclasses import dataclass, replace
from typing import NamedTuple

from bus.clock import NS
from bus.messages import SensorCompass, SensorLaser, WallState
from marine.dynamics.uncoupled import Tau
from marine.estimation.distance_ekf import STEADY, DistanceEkf
from marine.frames import wrap_angle
from marine.vessel import HorizontalModel, Vessel
from services.wrenches import Wrenches

_LATE_NS = 400_000_000
"""Measurements come in any order, no later than this: pictures take 0.1 s, the compass has a delay."""
GATE = 25.0
"""Largest squared innovation, in its variances."""
_NOISE_M = 0.01
_NOISE_RAD = math.radians(2.0)
"""What a sample may be off by itself (twice the filter's R): rough walls, pitching."""
JUMP_AFTER = 3
"""So many refused samples in a row are another wall."""
MISSED = 2.5
"""Sample times without dots after which the wall is predicted, not tracked."""


class _Measured(NamedTuple):
    stamp_ns: int
    psi_rad: float | None = None
    phi_rad: float | None = None
    distance_m: float | None = None


@dataclass
class _Track:
    """A filter, its time, the time of the last sample with both dots that it took, and how many it refused:
    since then, and in all.
    """

    ekf: DistanceEkf
    at_ns: int
    used_ns: int
    refused: int = 0
    rejected: int = 0


class WallTracker:
    """Takes in samples as they come, tells the wall of now.

    The filter stays `_LATE_NS` behind; what is younger is kept in the order of its stamps, and a copy of the filter
    runs through it whenever the wall is asked for. Distances along the lasers become distances square to the wall.
    """

    def __init__(self, vessel: Vessel) -> None:
        sensor = vessel.sensor("laser")
        self.possible = sensor is not None
        """Whether the vessel has a laser module."""
        self._missed_ns = round(MISSED * sensor.sample_time_s * NS) if sensor else 0
        self._model = vessel.model
        self._lost_ns = round(vessel.validity.distance_s * NS)
        self._delay_ns = round(vessel.actuation_delay_s * NS)
        self._wrenches = Wrenches()
        self._settled: _Track | None = None
        self._recent: list[_Measured] = []

    def wrench(self, stamp_ns: int, tau: Tau) -> None:
        """Take in what the actuators are told to give, from a time on."""
        self._wrenches.add(stamp_ns + self._delay_ns, tau)

    def compass(self, sample: SensorCompass) -> None:
        """Take in a heading."""
        self._take(_Measured(sample.stamp_ns, psi_rad=sample.psi_rad))

    def laser(self, sample: SensorLaser) -> None:
        """Take in distance and angle, if both dots were seen."""
        D, phi = sample.distance_m, sample.angle_rad
        if D is not None and phi is not None:
            self._take(_Measured(sample.stamp_ns, phi_rad=phi, distance_m=D * math.cos(phi)))

    def exchange(self, model: HorizontalModel) -> None:
        """Go on with another model: the wall is looked for again."""
        self._model, self._settled = model, None

    def told(self, now_ns: int) -> WallState:
        """Return the wall of now."""
        self._recent = [m for m in self._recent if m.stamp_ns <= now_ns + _LATE_NS]  # else the clock was set back
        while self._recent and self._recent[0].stamp_ns < now_ns - _LATE_NS:
            self._settled = self._after(self._settled, self._recent.pop(0))
        settled = self._settled
        track = settled and replace(settled, ekf=copy.copy(settled.ekf))
        for measured in self._recent:
            track = self._after(track, measured)
        if track is None or not -_LATE_NS <= now_ns - track.used_ns <= self._lost_ns:
            self._settled = None
            return WallState(status="lost")
        self._advance(track, now_ns)
        return self._state(track, now_ns - track.used_ns)

    def _state(self, track: _Track, age_ns: int) -> WallState:
        ekf = track.ekf
        variances = ekf.covariance.diagonal().tolist()
        return WallState(
            origin_ns=track.used_ns,
            status="predicting" if age_ns > self._missed_ns else "tracking",
            distance_m=ekf.distance_m,
            angle_rad=ekf.angle_rad,
            surge_m_s=ekf.surge_m_s,
            yaw_rad_s=ekf.yaw_rate_rad_s,
            drift_m_s=float(ekf.state[6]),
            distance_std_m=math.sqrt(variances[4]),
            angle_std_rad=math.sqrt(variances[2]),
            measurement_age_s=age_ns / NS,
            rejected=track.rejected,
        )

    def _take(self, measured: _Measured) -> None:
        if self._settled is None or measured.stamp_ns >= self._settled.at_ns:
            insort(self._recent, measured, key=lambda m: m.stamp_ns)

    def _after(self, track: _Track | None, measured: _Measured) -> _Track | None:
        """Return the track after a measurement: begun by the first with a distance, or when another wall is there."""
        seen = measured.distance_m is not None
        if track is not None and measured.stamp_ns - track.used_ns <= self._lost_ns:
            self._advance(track, measured.stamp_ns)
            if _fits(track.ekf, measured):
                track.ekf.update(psi_rad=measured.psi_rad, phi_rad=measured.phi_rad, distance_m=measured.distance_m)
                if seen:
                    track.used_ns, track.refused = measured.stamp_ns, 0
                return track
            track.refused, track.rejected = track.refused + 1, track.rejected + 1
            if track.refused < JUMP_AFTER:
                return track
        if not seen:
            return None
        ekf = DistanceEkf(self._model.surge, self._model.yaw, STEADY)
        ekf.update(phi_rad=measured.phi_rad, distance_m=measured.distance_m)
        return _Track(ekf, measured.stamp_ns, measured.stamp_ns)

    def _advance(self, track: _Track, to_ns: int) -> None:
        """Predict with the wrenches that were in force between."""
        for dt_s, (X, _, N) in self._wrenches.between(track.at_ns, to_ns):
            track.ekf.predict(dt_s, X, N)
        track.at_ns = max(track.at_ns, to_ns)


def _fits(ekf: DistanceEkf, measured: _Measured) -> bool:
    """Whether distance and angle are where the filter expects them; a heading always fits."""
    if measured.distance_m is None or measured.phi_rad is None:
        return True
    variances: list[float] = ekf.covariance.diagonal().tolist()
    off_m, off_rad = measured.distance_m - ekf.distance_m, wrap_angle(measured.phi_rad - ekf.angle_rad)
    return off_m**2 <= GATE * (variances[4] + _NOISE_M**2) and off_rad**2 <= GATE * (variances[2] + _NOISE_RAD**2)
