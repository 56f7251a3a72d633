"""Which tuning a controller runs: asked for by operators, taken up again after a restart, told on control/gains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from bus.clock import NS
from bus.messages import ControlGains, HelmState, Shaping, Tuning, TuningAnswer, TuningRequest
from marine.control.base import ControlLaw, Vector3
from marine.vessel import Vessel
from services.tuning import TuningError, complete, designed, gains, loops

TOLD_S = 1.0
REQUEST_MAX_AGE_S = 2.0
RESTORE_S = 1.0
"""How long a controller that has just started waits for what ran before it."""
RESTART_S = 30.0
"""A tuning that was last told longer ago is not taken up again: the system was started anew."""


class TuningDesk:
    """Keeps the law in force and the vessel it was designed for; the controller takes both after each change."""

    def __init__(
        self, vessel: Vessel, limits: Vector3, law: ControlLaw, parameters: object, shaping: Shaping | None
    ) -> None:
        """Begin with the configuration file's law, designed for the vessel file's models."""
        self.vessel, self.law = vessel, law
        self._file, self._limits, self._shaping = vessel, limits, shaping
        self._configured = complete(Tuning(law=law.name, parameters=asdict(parameters)), vessel)  # type: ignore[call-overload]
        self._told = self._message(self._configured, engaged=False)
        self._started_s: float | None = None
        self._restored = False
        self._told_s = 0.0

    def due(self, now_s: float) -> bool:
        """Whether there is something to do though nobody asks for anything."""
        return not self._restored or now_s - self._told_s >= TOLD_S

    def step(
        self, now_s: float, helm: HelmState | None, former: ControlGains | None, requests: Sequence[TuningRequest]
    ) -> tuple[bool, list[TuningAnswer]]:
        """Take up what ran before a restart, then what operators ask for; return whether the law changed, and answers.

        former: the newest control/gains that is not this process' own, as far as it came.
        """
        before = self._told
        self._restore(now_s, former)
        answers = [self._answer(request, helm, now_s) for request in requests]
        return self._told.tuning is not before.tuning, answers

    def news(self, now_s: float, *, changed: bool) -> ControlGains | None:
        """Return what is to be published now: at each change and once a second."""
        if not self._restored or not (changed or now_s - self._told_s >= TOLD_S):
            return None
        self._told_s = now_s
        return self._told

    def _restore(self, now_s: float, former: ControlGains | None) -> None:
        if self._started_s is None:
            self._started_s = now_s
        if self._restored or (former is None and now_s - self._started_s < RESTORE_S):
            return
        self._restored = True
        self._told = self._told.model_copy(update={"since_ns": round(now_s * NS)})
        if former is None or not former.engaged or former.configured != self._configured:
            return  # nothing was engaged, or the files were changed since
        if now_s - former.stamp_ns / NS <= RESTART_S:
            try:
                self._take(former.tuning, former.by, former.since_ns)
                self._told = self._told.model_copy(update={"before": former.before})
            except TuningError:
                pass  # as the file says

    def _answer(self, request: TuningRequest, helm: HelmState | None, now_s: float) -> TuningAnswer:
        self._restored = True  # who asks now decides, not the past
        try:
            self._check(request, helm, now_s)
            self._take(request.tuning, request.client, round(now_s * NS))
            reason = ""
        except TuningError as error:
            reason = str(error)
        return answered(request, reason)

    def _check(self, request: TuningRequest, helm: HelmState | None, now_s: float) -> None:
        """Raise TuningError when this client may not change the law now."""
        age_s = now_s - request.stamp_ns / NS
        if abs(age_s) > REQUEST_MAX_AGE_S:
            raise TuningError(f"the request is {age_s:.1f} s old: ask again")
        if helm is None:
            return
        other = helm.attended and helm.holder not in ("", request.client)
        if other and helm.lease_expires_ns > now_s * NS:
            raise TuningError(f"{helm.holder} has the helm: take over to tune")
        if helm.mode == "experiment":
            raise TuningError("an experiment is under way: wait for its end")

    def _take(self, tuning: Tuning | None, client: str, now_ns: int) -> None:
        """Design and keep a tuning (None: the file's); raise TuningError, everything as before, when it is refused."""
        wanted = tuning or self._configured
        vessel, law = designed(wanted, self._file, self._limits, trusted=tuning is None)
        before = self._told
        self.vessel, self.law = vessel, law
        self._told = self._message(complete(wanted, vessel), engaged=tuning is not None).model_copy(
            update={"since_ns": now_ns, "by": client, "before": before.tuning if before.engaged else None}
        )

    def _message(self, tuning: Tuning, *, engaged: bool) -> ControlGains:
        return ControlGains(
            tuning=tuning,
            engaged=engaged,
            since_ns=0,
            configured=self._configured,
            loops={axis: gains(loop) for axis, loop in loops(self.law).items()},
            shaping=self._shaping,
        )


def answered(request: TuningRequest, reason: str = "") -> TuningAnswer:
    """Return the answer to a request: accepted, or why not."""
    return TuningAnswer(request_id=request.request_id, client=request.client, accepted=not reason, reason=reason[:400])
