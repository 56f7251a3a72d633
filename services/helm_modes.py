"""The modes of the helm: one row each, and the check of what is asked for in them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Literal

from bus.messages import (
    AXIS_FIELDS,
    ExperimentPlan,
    HelmState,
    Mode,
    NavigationState,
    OperatorRequest,
    WallState,
    WayPoint,
)
from marine.frames import wrap_angle
from marine.guidance.abilities import Abilities
from marine.vessel import Axis, Rudder, Vessel

Source = Literal["manual", "controller", "experiment"]
MANUAL: Source = "manual"
CONTROLLER: Source = "controller"
EXPERIMENT: Source = "experiment"

HORIZONTAL = ("surge", "sway", "yaw")

NEAREST_M = 0.1
"""Thesis 3.4: lasers are calibrated from here on."""


class Refused(Exception):  # noqa: N818 - it is an answer, not an error
    """A request that cannot be granted; the text is the reason."""


@dataclass(frozen=True)
class ModeRule:
    """law: what the controller runs. controller, stick: the axes of each. needs: axes that the vessel must control.

    keeps_depth: where the vessel can, the controller has heave too. afterwards: what becomes of the mode without an
    operator; a vessel that cannot hold stops instead. reference: parts of a request that count.
    """

    law: str = ""
    controller: tuple[str, ...] = ()
    stick: tuple[str, ...] = ()
    needs: tuple[Axis, ...] = ()
    keeps_depth: bool = False
    afterwards: Literal["stay", "hold", "stop"] = "stay"
    reference: tuple[str, ...] = ()


WALL_LAW = "distance"
"""The law that goes by navigation/wall instead of the pose."""
_POSE = ("x_m", "y_m", "psi_rad")
MODES: Mapping[Mode, ModeRule] = {
    "stop": ModeRule(),
    "manual": ModeRule(stick=(*HORIZONTAL, "heave"), afterwards="stop"),
    "hold": ModeRule(
        law="positioning", controller=HORIZONTAL, needs=("X", "Y", "N"), keeps_depth=True, reference=_POSE
    ),
    "heading": ModeRule(
        law="positioning",
        controller=("yaw",),
        stick=("surge", "sway", "heave"),
        needs=("N",),
        afterwards="hold",
        reference=("psi_rad",),
    ),
    "depth": ModeRule(law="depth", stick=HORIZONTAL, needs=("Z",), keeps_depth=True),
    "speed": ModeRule(
        law="speed",
        controller=HORIZONTAL,
        needs=("X", "N"),
        keeps_depth=True,
        afterwards="hold",
        reference=("psi_rad", "speed_m_s"),
    ),
    "distance": ModeRule(
        law=WALL_LAW,
        controller=HORIZONTAL,
        needs=("X", "N"),
        keeps_depth=True,
        reference=("distance_m",),
    ),
    "line": ModeRule(law="path", controller=HORIZONTAL, needs=("X", "N"), keeps_depth=True, afterwards="hold"),
    "path": ModeRule(law="path", controller=HORIZONTAL, needs=("X", "N"), keeps_depth=True, afterwards="hold"),
    "experiment": ModeRule(law="positioning", controller=HORIZONTAL, afterwards="hold", reference=_POSE),
}
"""Modes that there are so far. What `law` means: `services.guidance`."""

HOLD_NEEDS: tuple[Axis, ...] = MODES["hold"].needs


@dataclass(frozen=True)
class Reference:
    """What is wanted, as helm/state tells it: m, rad, m/s; None: nobody asks for it."""

    x_m: float | None = None
    y_m: float | None = None
    psi_rad: float | None = None
    z_m: float | None = None
    speed_m_s: float | None = None
    distance_m: float | None = None
    points: tuple[WayPoint, ...] = ()
    smooth: bool = False

    @classmethod
    def of(cls, state: HelmState) -> Reference:
        """Return the reference that a state tells."""
        return cls(**{field.name: getattr(state, field.name) for field in fields(cls)})  # the helm before checked it

    def __str__(self) -> str:
        """Return it as the answer to a request tells it."""
        parts = [f"{len(self.points)} way-points"] if self.points else []
        if self.x_m is not None and self.y_m is not None:
            parts += [f"x {self.x_m:.3f} m", f"y {self.y_m:.3f} m"]
        if self.speed_m_s is not None:
            parts.append(f"{self.speed_m_s:.2f} m/s")
        if self.distance_m is not None:
            parts.append(f"{self.distance_m:.2f} m from the wall")
        if self.psi_rad is not None:
            parts.append(f"psi {math.degrees(self.psi_rad):.1f} deg")
        if self.z_m is not None:
            parts.append(f"depth {self.z_m:.2f} m")
        return ", ".join(parts)


def law_of(mode: Mode, plan: ExperimentPlan | None) -> str:
    """Return what the controller runs: in an experiment with the laser it faces the wall, in one under way it runs."""
    if plan and plan.speed_m_s is not None:
        return MODES["speed"].law
    return WALL_LAW if plan and plan.sensor == "laser" else MODES[mode].law


class Task:
    """What the helm does: a mode, what is wanted in it, and who therefore has which axis."""

    def __init__(
        self, mode: Mode, reference: Reference, plan: ExperimentPlan | None = None, *, heave: bool = False
    ) -> None:
        """plan: of the experiment that has one of the axes. heave: whether there is an actuator for it."""
        self.mode, self.reference, self.plan = mode, reference, plan
        self.rule, self.law = MODES[mode], law_of(mode, plan)
        """law: what the controller runs; empty where it has no axis."""
        sources = dict.fromkeys(self.rule.stick, MANUAL) | dict.fromkeys(self.rule.controller, CONTROLLER)
        if not heave:
            sources.pop("heave", None)
        if reference.z_m is not None:
            sources["heave"] = CONTROLLER
        self.sources: dict[str, Source] = sources | ({plan.axis: EXPERIMENT} if plan else {})
        """Who has which axis."""
        self.fields = [(AXIS_FIELDS[axis], source) for axis, source in self.sources.items()]
        """The same by the field of a wrench."""
        self.has_stick = MANUAL in self.sources.values()


class Checks:
    """What is asked for against what the vessel and its pool allow."""

    def __init__(self, vessel: Vessel) -> None:
        self.vessel = vessel
        self.abilities = Abilities(vessel)
        self.can_hold = not self.abilities.lacking(HOLD_NEEDS)
        self.can_keep_depth = not self.abilities.lacking(("Z",)) and vessel.sensor("depth") is not None
        longest = vessel.validity
        self.longest_s: Mapping[Mode, float] = {mode: getattr(longest, f"{mode}_s", longest.hold_s) for mode in MODES}
        """How long a prediction without measurements counts as a pose."""

    def rule(self, mode: Mode) -> ModeRule:
        """Return the row of a mode; raise Refused when there is none, or the vessel has not the axes for it."""
        if mode not in MODES:
            raise Refused(f"{self.vessel.name} has no mode {mode} yet; known: {', '.join(MODES)}")
        if lacking := self.abilities.lacking(MODES[mode].needs):
            raise Refused(f"no mode {mode}: {lacking}")
        if mode == "depth" and not self.can_keep_depth:
            raise Refused(f"no mode depth: {self.vessel.name} has no depth sensor")
        if mode == "distance" and self.vessel.sensor("laser") is None:
            raise Refused(f"no mode distance: {self.vessel.name} has no laser module")
        return MODES[mode]

    def plan(self, request: OperatorRequest) -> ExperimentPlan:
        """Return the plan of an experiment that the vessel has an axis for. Raise Refused."""
        plan = request.experiment
        if plan is None:
            raise Refused("which experiment? the request names none")
        component = {"surge": "X", "sway": "Y", "heave": "Z", "yaw": "N"}[plan.axis]
        if component not in self.vessel.controlled:
            raise Refused(f"{self.vessel.name} has no actuators for {plan.axis}")
        if plan.sensor == "laser":
            self.rule("distance")
            if plan.axis != "surge":
                raise Refused(f"a laser module measures surge, not {plan.axis}")
        return self._under_way(plan)

    def _under_way(self, plan: ExperimentPlan) -> ExperimentPlan:
        """Return a plan with its speed: a rudder turns a vessel only while it runs. Raise Refused."""
        speed_m_s, rudders = plan.speed_m_s, any(isinstance(a, Rudder) for a in self.vessel.actuators)
        if plan.axis != "yaw":
            if speed_m_s is not None:
                raise Refused(f"a speed is kept while the vessel turns, not while {plan.axis} is pushed")
            return plan
        if speed_m_s is None and rudders:
            speed_m_s = 0.5 * self.abilities.ahead_m_s
        if speed_m_s is not None:
            self.rule("speed")
            try:
                self.abilities.check_speed(speed_m_s)
            except ValueError as error:
                raise Refused(str(error)) from None
        return plan.model_copy(update={"speed_m_s": speed_m_s})

    def reference(
        self, request: OperatorRequest, mode: Mode, pose: NavigationState, wall: WallState | None = None
    ) -> Reference:
        """Return the reference of a mode; what a request leaves open is as it is now. Raise Refused."""
        rule = MODES[mode]
        try:
            if mode == "distance":
                reference = self._distance(request, wall)
            else:
                reference = self._path(request, mode, pose) if rule.law == "path" else self._pose(request, rule, pose)
            if rule.keeps_depth and self.can_keep_depth:
                reference = replace(reference, z_m=self._depth(request, pose))
                if mode == "depth" and reference.z_m is None:
                    raise ValueError("no depth without a measured one: the sensor is silent")
        except ValueError as error:
            raise Refused(str(error)) from None
        return reference

    def _pose(self, request: OperatorRequest, rule: ModeRule, pose: NavigationState) -> Reference:
        asked = {name: getattr(request, name) for name in rule.reference}
        psi_rad = pose.psi_rad if asked.get("psi_rad") is None else wrap_angle(asked["psi_rad"])
        if "x_m" not in asked:
            speed_m_s = asked.get("speed_m_s", 0.0)
            self.abilities.check_speed(speed_m_s or 0.0)
            return Reference(
                psi_rad=psi_rad if "psi_rad" in asked else None,
                speed_m_s=(pose.surge_m_s if speed_m_s is None else speed_m_s) if "speed_m_s" in asked else None,
            )
        x_m = pose.x_m if request.x_m is None else request.x_m
        y_m = pose.y_m if request.y_m is None else request.y_m
        if (request.x_m, request.y_m) != (None, None):  # here is where it floats: never refused, not even at the wall
            self.abilities.check_place(x_m, y_m)
        return Reference(x_m, y_m, psi_rad)

    def _distance(self, request: OperatorRequest, wall: WallState | None) -> Reference:
        if wall is None or wall.status != "tracking":
            raise ValueError("the laser module does not see the wall ahead")
        laser = self.vessel.sensor("laser")
        furthest_m = (laser and laser.range_max) or math.inf
        distance_m = wall.distance_m if request.distance_m is None else request.distance_m
        if distance_m is None or not NEAREST_M <= distance_m <= furthest_m:
            raise ValueError(f"a distance from the wall is between {NEAREST_M:g} and {furthest_m:g} m")
        return Reference(distance_m=distance_m)

    def _path(self, request: OperatorRequest, mode: Mode, pose: NavigationState) -> Reference:
        points = request.points
        if mode == "line" and len(points) == 1:  # from here
            points = (WayPoint(x_m=pose.x_m, y_m=pose.y_m), *points)
        if mode == "line" and len(points) != 2:
            raise ValueError(f"a line goes from one point (or from here) to another: {len(points)} are given")
        speed_m_s = 0.5 * self.abilities.ahead_m_s if request.speed_m_s is None else request.speed_m_s
        self.abilities.check_path([(p.x_m, p.y_m) for p in points], request.smooth, speed_m_s)
        psi_rad = None if request.psi_rad is None else wrap_angle(request.psi_rad)
        return Reference(psi_rad=psi_rad, speed_m_s=speed_m_s, points=points, smooth=request.smooth)

    def _depth(self, request: OperatorRequest, pose: NavigationState) -> float | None:
        if request.z_m is None:
            return None if pose.z_m is None else max(0.0, pose.z_m)
        if request.z_m < 0.0:
            raise ValueError(f"a depth is below the surface: {request.z_m:g} m is not")
        return request.z_m

    def here(self, pose: NavigationState, gap_m: float) -> Reference:
        """Return the place where the vessel is, a little away from the walls."""
        margin, pool = self.vessel.radius_m + gap_m, self.vessel.pool
        return Reference(
            max(margin, min(pool.length_x_m - margin, pose.x_m)),
            max(margin, min(pool.length_y_m - margin, pose.y_m)),
            pose.psi_rad,
            pose.z_m if self.can_keep_depth else None,
        )
