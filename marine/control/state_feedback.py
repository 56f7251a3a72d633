"""Feedback of pose and velocity errors in {B}, with or without an integral in {E}: what several laws are made of."""

from __future__ import annotations

from marine.control.base import ZERO, ControlLaw, Reference, Vector3
from marine.control.structures import LoopDesign
from marine.frames import to_body, to_tank


class StateFeedback(ControlLaw):
    """tau = K_I R^T int e dt + K_P R^T e + K_D* (nu_ref - nu) + alpha nu_ref' + beta(nu) nu, diagonal in {B}.

    PI-D of Table 8.1 on a moving reference, the drag compensated as in (8.5). The reference acts at once: it must be
    one that the vessel can follow (`marine.guidance.reference_filter`). Anti-windup is back-calculation (8.29).
    """

    def __init__(
        self, designs: tuple[LoopDesign, LoopDesign, LoopDesign], tracking_time_s: float, limits: Vector3
    ) -> None:
        """designs: of surge, sway, yaw; tracking_time_s: T_t."""
        super().__init__(limits)
        self.designs = designs
        self._tracking_time_s = tracking_time_s
        self._held = ZERO

    def engage(self, eta: Vector3, nu: Vector3, tau: Vector3) -> None:
        """Let the integral hold what tau is more than drag: on a reference that starts here the next demand is tau."""
        X, Y, N = (
            t - d.compensation(v) if d.gains.integral else 0.0 for t, d, v in zip(tau, self.designs, nu, strict=True)
        )
        self._held = (*to_tank(X, Y, eta[2]), N)

    def demand(self, dt_s: float, reference: Reference, eta: Vector3, nu: Vector3, missing: Vector3) -> Vector3:
        """Return the demanded tau; see `ControlLaw.step`."""
        psi = eta[2]
        surge, sway, yaw = self.designs
        e_x, e_y, e_psi = self.error
        e = (*to_body(e_x, e_y, psi), e_psi)
        nu_ref = (*to_body(reference.rate[0], reference.rate[1], psi), reference.rate[2])
        led = (*to_body(reference.acceleration[0], reference.acceleration[1], psi), reference.acceleration[2])
        share = min(1.0, dt_s / self._tracking_time_s)
        held_x, held_y, held_n = self._held
        held = (*to_body(held_x, held_y, psi), held_n)
        kept = tuple(
            h + d.gains.integral * dt_s * error + (share * short if d.gains.integral else 0.0)
            for h, d, error, short in zip(held, self.designs, e, missing, strict=True)
        )
        self._held = (*to_tank(kept[0], kept[1], psi), kept[2])
        X, Y, N = (
            h + d.gains.proportional * error + d.gains.derivative * (wanted - v) + d.model.alpha * a + d.compensation(v)
            for h, d, error, wanted, v, a in zip(kept, (surge, sway, yaw), e, nu_ref, nu, led, strict=True)
        )
        return X, Y, N

    @property
    def held(self) -> Vector3:
        """What the integral holds, in {E}, N and Nm."""
        return self._held
