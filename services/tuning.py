"""From a tuning on the bus to a law: checked by the law itself, its gains told, its steps predicted on the models."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from typing import Any

from pydantic import TypeAdapter, ValidationError

from bus.messages import AxisModel, LoopGains, Shaping, TunedAxis, Tuning
from marine.allocation import axis_limits
from marine.control.base import ControlLaw, Vector3
from marine.control.heading import Heading
from marine.control.laws import known_laws
from marine.control.preview import StepResponse, law_step
from marine.control.stability import drag_bound, margins
from marine.control.structures import LoopDesign
from marine.guidance.abilities import Abilities
from marine.guidance.reference_filter import MotionLimits, ReferenceFilter
from marine.vessel import Axis, Sensor, Vessel
from services.models_in_force import with_models

AXES: tuple[TunedAxis, ...] = ("surge", "sway", "yaw")
STEPS: dict[TunedAxis, float] = {"surge": 1.0, "sway": 1.0, "yaw": math.pi / 2.0}
"""What is predicted: a new reference so far away, and being pushed aside so far; m or rad."""
APPROACH = 2.0
"""Rate at which the reference filter goes out, in units of the vessel's w0."""
DURATION = 40.0
"""Longest prediction, in units of 1 / w0 of the vessel."""
POINTS = 80
"""Of a predicted curve on the bus or on the page."""


class TuningError(ValueError):
    """A tuning that is not engaged; the message says why, in one line."""


def horizontal_limits(vessel: Vessel) -> Vector3:
    """Return the largest |X|, |Y|, |N| of a vessel's actuators, each alone."""
    X, Y, _, _, _, N = axis_limits(vessel)
    return X, Y, N


def serving(vessel: Vessel) -> str:
    """Return what the laws serve that a vessel is tuned by: positioning, or steering where it cannot hold a place."""
    return ControlLaw.serves if {"X", "Y", "N"} <= set(vessel.controlled) else Heading.serves


def tuned_axes(vessel: Vessel) -> tuple[TunedAxis, ...]:
    """Return the axes that are identified for its law: those that it pushes both ways."""
    controlled: dict[TunedAxis, Axis] = {"surge": "X", "sway": "Y", "yaw": "N"}
    astern = Abilities(vessel).astern_m_s > 0.0
    return tuple(a for a in AXES if controlled[a] in vessel.controlled and (astern or a != "surge"))


def parameters_of(law: type[ControlLaw], values: Any) -> Any:
    """Return the parameters of a law from plain values; raise ValueError that names law, key and reason."""
    try:
        return TypeAdapter(law.Parameters).validate_python(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in (law.name, *first["loc"]))
        if first["type"] == "unexpected_keyword_argument":
            known = ", ".join(f.name for f in fields(law.Parameters))
            raise ValueError(f"{key}: no such key; known: {known}") from None
        raise ValueError(f"{key}: {first['msg'].removeprefix('Value error, ')}") from None


def motion_for(shaping: Shaping, vessel: Vessel, limits: Vector3) -> MotionLimits:
    """Return what the reference may do, of a vessel whose actuators reach `limits` on surge, sway and yaw."""
    derived = MotionLimits.of_vessel(vessel.model, limits, shaping.share, APPROACH * vessel.hold_w0_rad_s)
    return replace(derived, **shaping.model_dump(exclude={"share"}, exclude_none=True))


def designed(tuning: Tuning, vessel: Vessel, limits: Vector3, *, trusted: bool = False) -> tuple[Vessel, ControlLaw]:
    """Return the vessel with the tuning's models, and the law designed for it; raise TuningError when it is refused.

    Refused are what the law refuses (unknown parameters, gains of an unstable loop, (8.22)) and, unless it is trusted,
    loops whose delay margin is less than what the vessel's sensors and commands take.
    """
    serves = serving(vessel)
    known = [law.name for law in known_laws().values() if law.serves == serves]
    if tuning.law not in known:
        raise TuningError(f"no law is called {tuning.law!r}; known: {', '.join(known)}")
    kind = known_laws()[tuning.law]
    tuned = checked_models(vessel, tuning.models)
    try:
        law = kind.for_vessel(parameters_of(kind, tuning.parameters), tuned, limits)
    except ValueError as error:
        raise TuningError(str(error)) from None
    for axis, loop in loops(law).items() if not trusted else ():
        if reason := too_late(loop, vessel, axis):
            raise TuningError(reason)
    return tuned, law


def checked_models(vessel: Vessel, models: Mapping[TunedAxis, AxisModel]) -> Vessel:
    """Return a vessel with other models of some axes; raise TuningError for what no vessel has."""
    for axis, model in models.items():
        if model.alpha <= 0.0 or model.beta < 0.0 or model.beta_quadratic < 0.0:
            raise TuningError(f"{axis}: inertia must be positive and drag not negative")
    return with_models(vessel, models)


def complete(tuning: Tuning, tuned: Vessel) -> Tuning:
    """Return a tuning with every parameter and every model that is in force, for the vessel designed for."""
    kind = known_laws()[tuning.law]
    return Tuning(
        law=tuning.law,
        parameters=asdict(parameters_of(kind, tuning.parameters)),
        models={axis: AxisModel(**asdict(getattr(tuned.model, axis))) for axis in AXES},
    )


def loops(law: ControlLaw) -> dict[str, LoopDesign]:
    """Return the loops of the axes that a law acts on; empty for a law that is not made of loops."""
    found: tuple[LoopDesign, ...] = getattr(law, "designs", ())
    return {axis: loop for axis, loop in zip(AXES, found, strict=False) if loop.gains.proportional > 0.0}


def gains(loop: LoopDesign) -> LoopGains:
    """Return the gains of a loop as they go over the bus."""
    g = loop.gains
    return LoopGains(
        k_i=g.integral, k_p=g.proportional, k_d=g.derivative - loop.beta, speed_limit=_finite(loop.speed_limit)
    )


def loop_delay_s(vessel: Vessel, axis: str) -> float:
    """Return what sensor and command delay a loop on average: half a sample, the age of the newest, the command's."""
    kinds = {"yaw": ("camera", "compass"), "heave": ("depth",)}.get(axis, ("camera", "position"))
    sensor: Sensor | None = next((s for kind in kinds if (s := vessel.sensor(kind))), None)  # type: ignore[arg-type]
    return vessel.command_delay_s + (1.5 * sensor.sample_time_s + sensor.delay_s if sensor else 0.0)


def too_late(loop: LoopDesign, vessel: Vessel, axis: str) -> str:
    """Return why a loop is too fast for what sensor and command delay it, empty when it is not."""
    delay_s, margin_s = loop_delay_s(vessel, axis), margins(loop).delay_s
    if margin_s >= delay_s:
        return ""
    return (
        f"{axis} would not be stable: its delay margin is {margin_s:.3f} s, and sensor and command take "
        f"{delay_s:.3f} s: take a slower model function"
    )


# --- before engaging


def loop_figures(loop: LoopDesign) -> dict[str, Any]:
    """Return what is said of a loop: gains, bound (8.22), limiter (8.26), margins; None for what there is not."""
    g, model = loop.gains, loop.model
    bound = None
    if g.integral > 0.0 and g.derivative > 0.0:
        bound = drag_bound((g.proportional / g.integral, g.derivative / g.integral, model.alpha / g.integral))
    return {
        "structure": loop.structure.name,
        "gains": gains(loop).model_dump(include={"k_i", "k_p", "k_d"}),
        "drag_over_inertia_1_s": model.beta / model.alpha,
        "bound_1_s": bound,
        "speed_limit": _finite(loop.speed_limit),
        "margins": {name: _finite(value) for name, value in asdict(margins(loop)).items()},
    }


def step_figures(response: StepResponse, limit: float) -> dict[str, Any]:
    """Return what is said of a predicted step, in m or rad, N or Nm; limit: of the actuators."""
    speeds = (abs(b - a) for a, b in zip(response.eta, response.eta[1:], strict=False))
    return {
        "overshoot_percent": 100.0 * response.overshoot,
        "settling_s": _finite(response.settling_s),
        "largest_speed": max(speeds) / response.t_s[1],
        "largest_demand": response.peak,
        "limit": limit,
        "saturated_s": response.saturated_s,
        "actuator_activity": response.activity,
    }


def preview(
    tuning: Tuning,
    vessel: Vessel,
    limits: Vector3,
    shaping: Shaping | None,
    on: Mapping[TunedAxis, AxisModel] | None = None,
) -> dict[TunedAxis, dict[str, Any]]:
    """Return for each axis that the vessel controls what a tuning does: figures of its loop, and predictions.

    `step`: a new reference; `aside`: pushed off its place. on: the models on which it runs, None: those it is designed
    for. Raises TuningError when it would be refused.
    """
    tuned, law = designed(tuning, vessel, limits)
    true = tuned.model if on is None else checked_models(vessel, on).model
    camera = vessel.sensor("camera")
    dt_s = camera.sample_time_s if camera else 0.1
    longest_s = DURATION / vessel.hold_w0_rad_s
    found: dict[TunedAxis, dict[str, Any]] = {}
    for number, axis in enumerate(AXES):
        if limits[number] <= 0.0 or (law.serves == Heading.serves and axis != "yaw"):
            continue
        found[axis] = loop_figures(loops(law)[axis]) if axis in loops(law) else {}
        for name, aside in (("step", False), ("aside", True)):
            shaped = ReferenceFilter(motion_for(shaping, tuned, limits)) if shaping else None
            response = law_step(law, true, number, STEPS[axis], shaped, longest_s, dt_s, aside=aside)
            every = max(1, len(response.t_s) // POINTS)
            found[axis][name] = step_figures(response, limits[number]) | {
                "size": STEPS[axis],
                "dt_s": every * dt_s,
                "eta": [round(value, 4) for value in response.eta[::every]],
            }
    return found


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
