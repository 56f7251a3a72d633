"""Every message on the bus: frozen, without extras, without NaN, with units in the field names.

A number whose name ends in no unit of `bus.units` has none. Angles are in radians, in (-pi, pi]; frames are those
of docs/architecture.md: {E} is the tank (x right, y down in the picture, z into the water), {B} the body.
"""

from __future__ import annotations

from operator import itemgetter
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from bus.units import unit_of

Name = Annotated[str, StringConstraints(max_length=64)]
Text = Annotated[str, StringConstraints(max_length=400)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Stick = Annotated[float, Field(ge=-1.0, le=1.0)]
Count = Annotated[int, Field(ge=0)]
Key = Annotated[str, StringConstraints(max_length=200)]
PoseCovariance = tuple[float, float, float, float, float, float]

Mode = Literal["stop", "manual", "hold", "heading", "depth", "speed", "line", "path", "distance", "experiment"]
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""The six components of state and wrench, in the order of SNAME."""
WRENCH_FIELDS = ("surge_n", "sway_n", "heave_n", "roll_nm", "pitch_nm", "yaw_nm")
"""The fields of a wrench, in the same order."""
_components = itemgetter(*WRENCH_FIELDS)


def _state_units(schema: dict[str, Any]) -> None:
    for name, field in schema.get("properties", {}).items():
        if unit := unit_of(name):
            field["unit"] = unit


class Message(BaseModel):
    """Header of every message. The run loop fills it: a service publishes only the content."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, json_schema_extra=_state_units)

    stamp_ns: int = Field(0, ge=0, le=2**63 - 1, description="when the content was true; of a command: decided")
    seq: int = Field(0, ge=0, description="counts this publisher's messages on this key; a gap is a loss")
    source: Name = Field("", description="service that published it")
    origin_ns: int | None = Field(None, ge=0, description="capture time of the camera frame it comes from")

    def stamped(self, now_ns: int, seq: int, source: str) -> Self:
        """Return the message with its header filled in; a stamp that its maker gave it stays.

        That is the message itself the first time: nobody else has it yet. One that was sent is copied and stays.
        """
        content = self.__dict__
        if not content["source"]:
            content["stamp_ns"] = content["stamp_ns"] or now_ns
            content["seq"], content["source"] = seq, source
            return self
        stamp_ns = now_ns
        if "stamp_ns" in self.__pydantic_fields_set__:
            stamp_ns = content["stamp_ns"] or now_ns
        return self.model_copy(update={"stamp_ns": stamp_ns, "seq": seq, "source": source})

    def encode(self) -> bytes:
        """Return the message as it goes over the wire: JSON."""
        return self.__pydantic_serializer__.to_json(self)

    @classmethod
    def decode(cls, payload: bytes) -> Self:
        """Return the message of a payload; raise ValueError (pydantic.ValidationError) when it is malformed."""
        message: Self = cls.__pydantic_validator__.validate_json(payload)
        return message


# --- camera -----------------------------------------------------------------------------------------------------


class CameraPose(Message):
    """Pose of the marker in one frame. `stamp_ns` is the capture time. Metres only when a scale is known."""

    name: Name = Field("", description="which vessel, where several are tracked; empty: the only one")
    frame: Count
    x_px: float
    y_px: float
    x_m: float | None = None
    y_m: float | None = None
    psi_rad: float
    psi_image_rad: float | None = Field(
        None, description="heading in the picture, where a calibration turns it into {E}"
    )
    covariance: PoseCovariance | None = Field(
        None, description="of x, y, psi (m, rad): xx, xy, xpsi, yy, ypsi, psipsi; None: no calibration"
    )
    noise_covariance: PoseCovariance | None = Field(
        None,
        description="the part of it that changes from frame to frame; the rest is the camera's place, always alike",
    )
    quality: Fraction
    reason: Text = Field("", description="why the quality is low")
    heading_ambiguous: bool = False
    region_px: tuple[int, int, int, int] | None = Field(
        None, description="where it was looked for: left, top, right, bottom; None: in the whole picture"
    )


class CameraStatus(Message):
    """How the tracker fares, once a second and at every change."""

    state: Literal["no_camera", "searching", "tracking"]
    error: Text = ""
    camera: Text = Field("", description="address of the picture source")
    frames: Count = 0
    frames_dropped: Count = 0
    poses: Count = 0
    rate_hz: float = 0.0
    latency_s: float = Field(0.0, description="from capture to publishing, mean of the last second")
    width_px: Count = 0
    height_px: Count = 0
    scale_px_per_m: float | None = None


class CameraImage(Message):
    """One picture. On the wire: 4 bytes little-endian length of the JSON header, the header, the JPEG bytes."""

    frame: Count
    width_px: Count
    height_px: Count
    data: bytes = Field(b"", exclude=True, repr=False)

    def encode(self) -> bytes:
        """Return length, header and JPEG bytes."""
        header = self.__pydantic_serializer__.to_json(self, exclude={"data"})
        return len(header).to_bytes(4, "little") + header + self.data

    @classmethod
    def decode(cls, payload: bytes) -> Self:
        """Return the image of a payload; raise ValueError when it is malformed."""
        header, data = split_image(payload)
        return cls.model_validate_json(header).model_copy(update={"data": data})


def split_image(payload: bytes) -> tuple[bytes, bytes]:
    """Return (JSON header, JPEG bytes) of an image's payload; raise ValueError when it is too short."""
    end = 4 + int.from_bytes(payload[:4], "little")
    if len(payload) < 5 or end > len(payload):
        raise ValueError("image payload is shorter than its header says")
    return payload[4:end], payload[end:]


class CalibrationRequest(Message):
    """Request to the calibration of the camera, from any client. `poke operator/calibration action=start`."""

    action: Literal["start", "automatic", "capture", "undo", "solve", "save", "cancel"]
    board: Literal["charuco", "chessboard"] = Field("charuco", description="start: what `print-board` prints, or plain")
    columns: int = Field(9, ge=3, le=50, description="start: squares; of a chessboard inner corners")
    rows: int = Field(6, ge=3, le=50)
    square_m: float = Field(0.03, gt=0.0, description="start: side of a square, measured on the print")
    automatic: bool = Field(True, description="start, automatic: take views without being asked")


class CalibrationView(BaseModel):
    """One view of the board that was taken."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: Name
    tilt: Name = Field(description="which edge of the board is nearer to the camera: flat, left, right, top, bottom")
    error_px: float | None = Field(None, description="reprojection error, once there are enough views")


class CalibrationState(Message):
    """How the calibration of the camera goes: at each picture examined, otherwise once a second."""

    state: Literal["idle", "collecting", "solved", "saved"] = "idle"
    board: Text = ""
    automatic: bool = True
    frame: Count = Field(0, description="the picture examined last")
    width_px: Count = 0
    height_px: Count = 0
    corners_px: tuple[float, ...] = Field((), description="x, y of each corner of the board in it; none: not seen")
    hint: Text = Field("", description="what to do next")
    refused: Text = Field("", description="why the last request could not be followed")
    views: tuple[CalibrationView, ...] = ()
    coverage: tuple[Count, ...] = Field((), description="corners taken in each of 3 x 3 parts, row by row")
    parts_missing: tuple[Name, ...] = Field((), description="parts with few or no corners, the next one first")
    tilts_missing: tuple[Name, ...] = Field((), description="tilts of which more is wanted")
    rms_px: float | None = Field(None, description="reprojection error of all views")
    focal_px: float | None = None
    focal_std_px: float | None = None
    advice: tuple[Text, ...] = Field((), description="what would make the result better, or why there is none")
    file: Text = Field("", description="where the result was saved")


# --- navigation -------------------------------------------------------------------------------------------------


class NavigationState(Message):
    """Estimated eta in {E}, nu in {B} and disturbance. What a vessel does not have is null."""

    status: Literal["initialising", "tracking", "predicting", "lost"]
    filtered: bool = Field(True, description="false: measured values mapped straight to estimates")
    x_m: float
    y_m: float
    z_m: float | None = None
    phi_rad: float | None = None
    theta_rad: float | None = None
    psi_rad: float
    surge_m_s: float
    sway_m_s: float
    heave_m_s: float | None = None
    roll_rad_s: float | None = None
    pitch_rad_s: float | None = None
    yaw_rad_s: float
    disturbance_x_n: float | None = Field(None, description="slowly varying force in {E}")
    disturbance_y_n: float | None = Field(None, description="slowly varying force in {E}")
    disturbance_yaw_nm: float | None = None
    x_std_m: float | None = None
    y_std_m: float | None = None
    psi_std_rad: float | None = None
    measurement_age_s: float = Field(description="time since the last measurement was captured")
    rejected: Count = Field(0, description="measurements refused by the innovation gate")
    jumps: Count = Field(0, description="times that the measured pose jumped for good, and was believed")


class WallState(Message):
    """The wall before the vessel (thesis Table 8.2), predicted through lost dots. Without a wall numbers are null."""

    status: Literal["tracking", "predicting", "lost"]
    distance_m: float | None = Field(None, description="from the laser module, square to the wall")
    angle_rad: float | None = Field(None, description="to the wall's normal: of the bow from it, clockwise")
    surge_m_s: float | None = None
    yaw_rad_s: float | None = None
    drift_m_s: float | None = Field(None, description="v_d, estimated disturbance of the distance")
    distance_std_m: float | None = None
    angle_std_rad: float | None = None
    measurement_age_s: float | None = Field(None, description="time since the last picture with both dots")
    rejected: Count = Field(0, description="measurements too far from the prediction")


# --- sensors besides the camera ---------------------------------------------------------------------------------


class SensorPosition(Message):
    """Position in {E}, as of a satellite receiver."""

    x_m: float
    y_m: float


class SensorCompass(Message):
    """Heading in {E}."""

    psi_rad: float


class SensorDepth(Message):
    """Depth below the surface."""

    z_m: float


class SensorLaser(Message):
    """Distance to a wall by two laser dots, thesis 3.4. `stamp_ns` is the capture time of the picture."""

    distance_m: float | None = Field(None, description="mean of both lasers, along them; null: a dot is lost")
    angle_rad: float | None = Field(None, description="to the wall's normal, positive: the right laser travels further")
    lost: Text = Field("", description="which dot is lost")


class SensorYawRate(Message):
    """Turn rate about the vessel's z axis."""

    yaw_rad_s: float


class SensorSurgeSpeed(Message):
    """Speed ahead through the water."""

    surge_m_s: float


class SensorSpeed(Message):
    """Speed over ground, without a direction."""

    speed_m_s: float


# --- wrenches ---------------------------------------------------------------------------------------------------


class Wrench(Message):
    """Force and moment in {B}. A component that is null is not covered by whoever publishes it."""

    surge_n: float | None = None
    sway_n: float | None = None
    heave_n: float | None = None
    roll_nm: float | None = None
    pitch_nm: float | None = None
    yaw_nm: float | None = None

    def vector(self) -> tuple[float, float, float, float, float, float]:
        """Return [X, Y, Z, K, M, N] in N and Nm, zero where a component is null."""
        x, y, z, k, m, n = _components(self.__dict__)
        return x or 0.0, y or 0.0, z or 0.0, k or 0.0, m or 0.0, n or 0.0


class HelmWrench(Wrench):
    """The wrench that acts."""

    mode: Mode
    speed_m_s: float | None = Field(None, description="speed U, for rudders and propellers that feel the flow")


class ControlStatus(Message):
    """What the controller does: the law, its errors in {E}, and what it holds besides damping as force in {E}.

    At rest `integral_*` is the force against the disturbance.
    """

    law: Name
    in_charge: bool
    error_x_m: float | None = None
    error_y_m: float | None = None
    error_psi_rad: float | None = None
    integral_x_n: float | None = Field(None, description="K_I int e - K_P eta, in {E}")
    integral_y_n: float | None = None
    integral_yaw_nm: float | None = None
    saturated: bool = False
    error_z_m: float | None = Field(None, description="of a depth that is held")
    error_speed_m_s: float | None = Field(None, description="of a speed that is held, ahead")
    error_distance_m: float | None = Field(None, description="of a distance from a wall that is kept")
    request_id: Name = Field("", description="request of helm/state that all this is about")
    reference_x_m: float | None = Field(None, description="where the vessel shall be now: on a path it moves")
    reference_y_m: float | None = None
    reference_psi_rad: float | None = None
    leg: Count | None = Field(None, description="of a path: that of way-points leg and leg + 1, from 0")
    along_m: float | None = Field(None, description="way along the path so far; 0: on the way to its beginning")
    length_m: float | None = Field(None, description="of the path")
    cross_track_m: float | None = Field(None, description="distance from the path, positive to starboard of it")
    arrived: bool = Field(False, description="the vessel is at the path's end")


class AttainedWrench(Wrench):
    """What the limits allow of the demanded wrench, before rounding; with the demand it answers."""

    demanded_surge_n: float | None = None
    demanded_sway_n: float | None = None
    demanded_heave_n: float | None = None
    demanded_roll_nm: float | None = None
    demanded_pitch_nm: float | None = None
    demanded_yaw_nm: float | None = None
    limited: bool = False


class ActuatorCommand(Message):
    """One value per actuator of the vessel file, in the actuator's own unit (thruster: command number)."""

    commands: dict[Name, float]


class ActuatorFault(Message):
    """Which actuators do not give what they are commanded, as the vessel's motion shows."""

    lost: dict[Name, Fraction] = Field({}, description="failed actuator -> part of its thrust that is lost")
    suspected: Name = Field("", description="the likeliest one that is not certain yet")
    ratio: float = Field(0.0, description="of the suspected: logarithm of the likelihood ratio against none failed")


class ActuatorHealth(Message):
    """Which actuators the allocator leaves out, and who said so."""

    failed: dict[Name, Literal["configuration", "operator", "detected"]] = Field(
        {}, description="actuators that get zero: the others take over"
    )
    lost: dict[Name, Fraction] = Field({}, description="what is detected: actuator -> part of its thrust that is lost")
    reason: Text = Field("", description="what that means for the vessel; empty: all work")


class OperatorActuator(Message):
    """An operator's word about an actuator: it has failed, or works (again)."""

    client: Name
    actuator: Name
    works: bool


# --- operator and helm ------------------------------------------------------------------------------------------


class OperatorJoystick(Message):
    """Stick positions as a part of what the vessel can do on each axis. Acts in mode manual only."""

    client: Name
    surge: Stick = 0.0
    sway: Stick = 0.0
    heave: Stick = 0.0
    yaw: Stick = 0.0


ExperimentName = Literal["step", "zigzag", "self-oscillation", "pull-out", "prbs"]
ExperimentAxis = Literal["surge", "sway", "heave", "yaw"]
AXIS_FIELDS = {a: field for a, field in zip(AXES, WRENCH_FIELDS, strict=True) if a in get_args(ExperimentAxis)}
"""Axes that a stick, a law or an experiment pushes -> their fields of a wrench."""


class ExperimentPlan(BaseModel):
    """What an identification experiment shall do. What is not given is chosen from the vessel's model."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, json_schema_extra=_state_units)

    name: ExperimentName
    axis: ExperimentAxis
    amplitude: float = Field(0.5, gt=0, le=1, description="force as a part of what the actuators can do on this axis")
    direction: Literal[-1, 1] = Field(1, description="of the first push")
    hysteresis_m: float | None = Field(
        None, gt=0, description="relay, zigzag: reverse so far from the start; not for yaw"
    )
    hysteresis_rad: float | None = Field(None, gt=0, le=3.0, description="the same for yaw")
    oscillations: int = Field(5, ge=2, le=50, description="consecutive ones that must agree; zigzag: whole turns")
    duration_s: float | None = Field(None, gt=0, le=3600, description="longest duration")
    sensor: Literal["laser"] | None = Field(
        None, description="laser: surge by the distance from the wall, which the vessel faces; none: as configured"
    )
    speed_m_s: float | None = Field(
        None, gt=0, description="yaw: surge speed kept meanwhile; none: half of what it can where a rudder turns it"
    )

    @property
    def hysteresis(self) -> float | None:
        """Where the force reverses, in m or rad."""
        return self.hysteresis_rad if self.axis == "yaw" else self.hysteresis_m


class WayPoint(BaseModel):
    """A place in {E}."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, json_schema_extra=_state_units)

    x_m: float
    y_m: float


WayPoints = Annotated[tuple[WayPoint, ...], Field(max_length=100)]


class OperatorRequest(Message):
    """A wish of an operator, answered on helm/answer. `mode` also takes the lease for `lease_s`.

    An attended lease (a page that renews it) excludes other clients unless they `take` it. An unattended one (a
    command line that has ended) only tells a restarted helm that its mode is still wanted.
    """

    request_id: Name
    client: Name
    action: Literal["mode", "renew", "release"] = "mode"
    mode: Mode | None = None
    x_m: float | None = None
    y_m: float | None = None
    psi_rad: float | None = Field(None, description="modes line, path: heading on the way; none: along the path")
    z_m: float | None = Field(None, description="depth; none: that of now, where the vessel can keep one")
    speed_m_s: float | None = Field(None, description="mode speed: ahead; line, path: along it, none: half of the top")
    distance_m: float | None = Field(None, description="mode distance: from the wall ahead; none: that of now")
    points: WayPoints = Field((), description="modes path, line: from the first to the second, or from here")
    smooth: bool = Field(False, description="mode path: a spline through the way-points instead of straight legs")
    experiment: ExperimentPlan | None = Field(None, description="mode experiment: which; its run is the request_id")
    lease_s: float = Field(3.0, gt=0.0, le=86400.0)
    attended: bool = True
    take: bool = Field(False, description="take the lease from another client that still holds it")


class HelmAnswer(Message):
    """Answer to an operator's request."""

    request_id: Name
    client: Name
    accepted: bool
    reason: Text = ""


class HelmState(Message):
    """Who has which axis, and what is wanted."""

    mode: Mode
    status: Literal["disarmed", "armed", "fault"]
    suspended: bool = Field(False, description="zero wrench until source and pose are fresh again")
    reason: Text = Field("", description="why the helm suspended, stopped or refused last")
    x_m: float | None = None
    y_m: float | None = None
    psi_rad: float | None = None
    z_m: float | None = Field(None, description="depth that is kept")
    speed_m_s: float | None = Field(None, description="mode speed: ahead; line, path: along it")
    distance_m: float | None = Field(None, description="mode distance: from the wall ahead")
    points: WayPoints = ()
    smooth: bool = Field(False, description="a spline through the way-points instead of straight legs")
    request_id: Name = Field("", description="request that mode and reference come from")
    guard: Text = Field("", description="why the guard changes the wrench: a wall; empty: it does not")
    sources: dict[Name, Literal["manual", "controller", "experiment"]] = Field(
        default_factory=dict, description="axis -> who has it"
    )
    law: Name = Field("", description="control law that the controller runs")
    experiment: ExperimentPlan | None = Field(None, description="mode experiment: what has one of the axes")
    experiment_run: Name = Field("", description="which run of it: the id of the request")
    holder: Name = Field("", description="client that holds the lease")
    attended: bool = False
    lease_expires_ns: Count = 0
    refused: Count = Field(0, description="requests refused since start")


# --- experiments ------------------------------------------------------------------------------------------------


class ExperimentStatus(Message):
    """How an experiment fares; `done` when its result is out. `unit` is that of amplitude and bias; force: N, Nm."""

    state: Literal["idle", "running", "identifying", "done", "failed"]
    run: Name = Field("", description="id of the request that started it")
    name: Name = ""
    axis: Name = ""
    unit: Literal["m", "rad"] = "m"
    phase: Name = Field("", description="what the vessel does: push, relay, coast, brake")
    progress: Fraction = 0.0
    elapsed_s: float = 0.0
    force: float = Field(0.0, description="demanded now, N or Nm")
    oscillations: Count = Field(0, description="consecutive whole ones so far")
    half_period_s: float | None = Field(None, description="of the last half oscillation")
    amplitude: float | None = Field(None, description="X_m of the last oscillation, m or rad")
    bias: float | None = Field(None, description="x_0 of the last oscillation, m or rad")
    spread: float | None = Field(None, description="of the extrema, as a part of the amplitude")
    advice: Text = Field("", description="what to change when it does not work")
    reason: Text = Field("", description="why it ended")


class IdentifiedParameter(BaseModel):
    """One identified value in SI; `std` is null where one experiment cannot tell."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: Name
    value: float
    unit: Name
    std: float | None = None


class IdentifiedModel(BaseModel):
    """What one method makes of a record; `failure` instead of parameters when it cannot be used."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    method: Text
    model: Name = ""
    parameters: tuple[IdentifiedParameter, ...] = ()
    warnings: tuple[Text, ...] = ()
    failure: Text = ""


class ExperimentEstimate(Message):
    """Recursive least squares on the running system: what is known of one axis by now; linear drag."""

    run: Name = Field("", description="the experiment's; empty: from whatever moves the vessel")
    axis: ExperimentAxis
    method: Text
    used_s: float = Field(description="time that it was made from")
    parameters: tuple[IdentifiedParameter, ...] = Field((), description="none as long as nothing can be told")
    reason: Text = Field("", description="why there are none")


class ExperimentResult(Message):
    """A finished experiment: model, how other methods see it, measured and simulated response."""

    run: Name
    plan: ExperimentPlan
    began_ns: Count
    ended_ns: Count = Field(description="of the measurement, before the braking")
    force: float = Field(description="of the plan's amplitude, N or Nm")
    methods: tuple[IdentifiedModel, ...] = Field(description="the first is the one to take, unless it failed")
    vessel_file: Text = Field("", description="vessel file with the new model; empty: none was written")
    t_s: tuple[float, ...] = ()
    measured: tuple[float, ...] = Field((), description="m, of yaw rad, from the start")
    simulated: tuple[float, ...] = Field((), description="the first method's model with the recorded force")


# --- tuning -----------------------------------------------------------------------------------------------------


TunedAxis = Literal["surge", "sway", "yaw"]


class AxisModel(BaseModel):
    """Model of one axis, alpha nu' + (beta + beta_quadratic |nu|) nu = tau, in SI: N and m, of yaw Nm and rad."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    alpha: float = Field(description="inertia, kg or kg m^2")
    beta: float = Field(0.0, description="constant drag")
    beta_quadratic: float = Field(0.0, description="drag that grows with speed")


class Tuning(BaseModel):
    """A control law with its parameters, and identified models in place of the vessel file's."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    law: Name
    parameters: dict[Name, bool | float | Text | tuple[float, ...] | None] = Field(
        {}, max_length=32, description="those not named: the defaults"
    )
    models: dict[TunedAxis, AxisModel] = Field({}, description="of the axes not named: the vessel file's")


class TuningRequest(Message):
    """A wish to run another tuning from now on, answered on control/answer."""

    request_id: Name
    client: Name
    tuning: Tuning | None = Field(None, description="null: what the configuration file says")


class TuningAnswer(HelmAnswer):
    """Answer to a request for a tuning."""


class LoopGains(BaseModel):
    """Gains of one axis, thesis Fig. 8.3; the compensated drag is apart, and compensated up to `speed_limit` only."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    k_i: float
    k_p: float
    k_d: float
    speed_limit: float | None = Field(None, description="m/s or rad/s, thesis (8.27); null: none is needed")


class Shaping(BaseModel):
    """How a new reference is approached; what is null follows from the model."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, json_schema_extra=_state_units)

    share: float
    speed_m_s: float | None = None
    acceleration_m_s2: float | None = None
    yaw_rate_rad_s: float | None = None
    yaw_acceleration_rad_s2: float | None = None


class ControlGains(Message):
    """What serves the positioning modes, or steers a vessel that has none: law, parameters, models, since when."""

    tuning: Tuning
    engaged: bool = Field(description="false: the configuration file's")
    since_ns: Count
    by: Name = Field("", description="client that engaged it")
    before: Tuning | None = Field(None, description="what ran before it; null: the configuration file's")
    configured: Tuning = Field(description="the configuration file's")
    loops: dict[TunedAxis, LoopGains] = Field({}, description="empty: the law has no such gains")
    shaping: Shaping | None = Field(None, description="the reference filter; null: steps as they are")


# --- platform link ----------------------------------------------------------------------------------------------


class LinkStatus(Message):
    """Statistics of the radio link."""

    state: Literal["disconnected", "connected"]
    error: Text = ""
    port: Text = ""
    sent: Count = 0
    received: Count = 0
    lost: Count = Field(0, description="gaps in the platform's sequence")
    crc_errors: Count = Field(0, description="frames from the platform with a wrong check sum")
    platform_crc_errors: Count = Field(0, description="frames the platform refused, as it reports")
    rejected: Count = Field(0, description="commands clamped to the limits, or refused: not for these actuators")
    rate_hz: float = Field(0.0, description="telemetry received")
    round_trip_s: float | None = None
    command_age_s: float | None = Field(None, description="age of the command that was sent last")


class LinkTelemetry(Message):
    """What the platform says it does."""

    commands: dict[Name, float] = Field(description="commands that the motor drivers run")
    dead_man: bool = Field(description="true: the platform has stopped its thrusters for want of commands")
    battery_v: float | None = None


# --- system -----------------------------------------------------------------------------------------------------


class Heartbeat(Message):
    """Life sign from inside a service's loop."""

    state: Literal["starting", "running", "stopping"]
    pid: Count
    rate_hz: float = Field(description="steps per second since the last heartbeat")
    late_steps: Count = Field(description="steps that began over one period late, since start")
    step_mean_ms: float
    step_max_ms: float
    malformed: Count = Field(0, description="messages dropped because they did not fit their schema, since start")
    gaps: Count = Field(0, description="messages missed by the sequence numbers, since start")
    dropped: Count = Field(
        0, description="messages pushed out of a full queue before the service took them, since start"
    )
    overwritten: Count = Field(
        0, description="messages that a newer one replaced before the service looked, since start"
    )
    warp: float = Field(1.0, description="how many times faster than real time the star's time shall run")
    warp_reached: float = Field(1.0, description="the same, times the part of its steps that this service kept")
    clock_offset_s: float = Field(0.0, description="what this process adds to its machine's clock to have the hub's")
    clock_uncertainty_s: float | None = Field(None, description="half the shortest round trip of that measurement")
    note: Text = Field("", description="last thing worth telling, such as the first malformed message")


class Traffic(BaseModel):
    """What goes over the hub on one key or from one source, over the last second."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, json_schema_extra=_state_units)

    messages_hz: float
    bytes_s: float


class HubStatistics(Message):
    """What the hub carries. Of keys and sources only the busiest are named."""

    clients: Count = Field(description="connected to the hub that says so, or to its standby")
    linked: bool = Field(description="the other one of hub and standby is connected")
    keys: Count = Field(description="keys that the hub knows")
    messages_hz: float
    bytes_s: float
    refused: Count = Field(0, description="messages not kept since start: too large, too many keys, wildcard keys")
    by_key: dict[Key, Traffic] = {}
    by_source: dict[Name, Traffic] = {}
    missed: dict[Name, Count] = Field({}, description="reader -> gaps and dropped messages that its heartbeat tells")


class RecorderStatus(Message):
    """State of the recording."""

    state: Literal["recording", "idle", "error"]
    error: Text = ""
    file: Text = ""
    messages: Count = 0
    size_bytes: Count = 0
    dropped: Count = 0


class SimulationTruth(Message):
    """What only the simulator knows. No service of the control chain may read it."""

    x_m: float
    y_m: float
    psi_rad: float
    surge_m_s: float
    sway_m_s: float
    yaw_rad_s: float
    current_x_m_s: float
    current_y_m_s: float
    surge_n: float
    sway_n: float
    yaw_nm: float
    commands: dict[Name, float] = Field(description="commands at the firmware's end")
    z_m: float | None = Field(None, description="depth, of a vessel that dives")
    heave_m_s: float | None = None
    phi_rad: float | None = None
    theta_rad: float | None = None


class SimulationFault(Message):
    """Order to the simulator: a fault begins (or ends with `active: false`). `poke simulation/fault`."""

    kind: Literal[
        "camera_shift",
        "camera_black",
        "flip_byte",
        "thruster_dead",
        "thruster_weak",
        "thruster_stuck",
        "current",
        "dropout",
        "board",
        "laser_lost",
        "displace",
        "clear",
    ]
    active: bool = True
    x_px: float = 0.0
    y_px: float = 0.0
    x_m_s: float = 0.0
    y_m_s: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0
    psi_rad: float = 0.0
    thruster: Name = ""
    fraction: Fraction = Field(0.0, description="that is lost: dropout of the frames, thruster_weak of the thrust")
