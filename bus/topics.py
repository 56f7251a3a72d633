"""Every variable, once: key, message, owner, rate, quality of service. All else is generated from this table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any, Generic, TypeVar

from bus import messages as m

M_co = TypeVar("M_co", bound=m.Message, covariant=True)


class Qos(Enum):
    """How the bus treats a topic."""

    COMMAND = "command"  # high priority, sent at once, never kept for late joiners
    STATE = "state"  # the last value wins, kept for late joiners
    REQUEST = "request"  # from several clients, must arrive, never kept
    IMAGE = "image"  # lowest priority, may be lost


OPERATOR = "operator"
"""Publisher of what people send: page, command line, any client with the right to."""


@dataclass(frozen=True)
class Topic(Generic[M_co]):
    """One variable on the bus. The full key is `<vessel>/<key>`."""

    key: str
    message: type[M_co]
    publisher: str
    doc: str
    rate_hz: float | None = None  # None: on change
    qos: Qos = Qos.STATE
    logged: bool = True

    @property
    def latched(self) -> bool:
        """Whether a late joiner gets the last value: commands and requests must never come back from the past."""
        return self.qos in (Qos.STATE, Qos.IMAGE)

    def of(self, name: str) -> Topic[M_co]:
        """Return the topic of one service from a template such as `service/{name}/heartbeat`."""
        return Topic(self.key.format(name=name), self.message, name, self.doc, self.rate_hz, self.qos, self.logged)

    @property
    def pattern(self) -> str:
        """The key as a Zenoh key expression: a template's placeholder becomes `*`."""
        return self.key.replace("{name}", "*")


CAMERA_POSE = Topic("camera/pose", m.CameraPose, "camera_tracker", "Pose of the marker in each frame.", 30.0)
CAMERA_STATUS = Topic("camera/status", m.CameraStatus, "camera_tracker", "State of camera and tracker.", 1.0)
CAMERA_IMAGE = Topic("camera/image", m.CameraImage, "camera_tracker", "Picture as JPEG.", 5.0, Qos.IMAGE)
CAMERA_CALIBRATION = Topic(
    "camera/calibration", m.CalibrationState, "camera_calibration", "How the calibration of the lens goes.", 1.0
)

SENSOR_POSITION = Topic("sensor/position", m.SensorPosition, "sensors", "Measured position, where no camera sees it.")
SENSOR_COMPASS = Topic("sensor/compass", m.SensorCompass, "sensors", "Measured heading.")
SENSOR_DEPTH = Topic("sensor/depth", m.SensorDepth, "sensors", "Measured depth.")
SENSOR_LASER = Topic("sensor/laser", m.SensorLaser, "laser_tracker", "Distance and angle to the wall ahead.", 2.0)
SENSOR_YAW_RATE = Topic("sensor/yaw_rate", m.SensorYawRate, "sensors", "Measured turn rate.")
SENSOR_SURGE_SPEED = Topic("sensor/surge_speed", m.SensorSurgeSpeed, "sensors", "Measured speed through water.")
SENSOR_SPEED = Topic("sensor/speed", m.SensorSpeed, "sensors", "Measured speed over ground.")

NAVIGATION_STATE = Topic(
    "navigation/state", m.NavigationState, "estimator", "Estimated pose, velocity, disturbance.", 30.0
)

NAVIGATION_WALL = Topic(
    "navigation/wall", m.WallState, "estimator", "Estimated distance and angle to the wall ahead.", 10.0
)

CONTROL_WRENCH = Topic("control/wrench", m.Wrench, "controller", "What the control law demands.", 30.0, Qos.COMMAND)
CONTROL_STATUS = Topic("control/status", m.ControlStatus, "controller", "Errors and integral action of the law.", 5.0)

CONTROL_GAINS = Topic("control/gains", m.ControlGains, "controller", "Law, parameters and models in force.", 1.0)
CONTROL_ANSWER = Topic(
    "control/answer", m.TuningAnswer, "controller", "Answers to requests for a tuning.", None, Qos.REQUEST
)

HELM_STATE = Topic("helm/state", m.HelmState, "helm", "Mode, reference, who has which axis, lease.", 5.0)
HELM_WRENCH = Topic("helm/wrench", m.HelmWrench, "helm", "The wrench that acts.", 30.0, Qos.COMMAND)
HELM_ANSWER = Topic("helm/answer", m.HelmAnswer, "helm", "Answers to operators' requests.", None, Qos.REQUEST)

EXPERIMENT_WRENCH = Topic(
    "experiment/wrench", m.Wrench, "experiment", "What the experiment demands on its axis.", 30.0, Qos.COMMAND
)
EXPERIMENT_STATUS = Topic("experiment/status", m.ExperimentStatus, "experiment", "Progress, monitoring, advice.", 5.0)
EXPERIMENT_ESTIMATE = Topic(
    "experiment/estimate", m.ExperimentEstimate, "experiment", "Parameters by recursive least squares, so far.", 1.0
)
EXPERIMENT_RESULT = Topic(
    "experiment/result", m.ExperimentResult, "experiment", "What the last experiment identified.", None
)

OPERATOR_JOYSTICK = Topic("operator/joystick", m.OperatorJoystick, OPERATOR, "Stick positions.", 20.0, Qos.COMMAND)
OPERATOR_ACTUATOR = Topic(
    "operator/actuator", m.OperatorActuator, OPERATOR, "An actuator has failed, or works again.", None, Qos.REQUEST
)
OPERATOR_REQUEST = Topic("operator/request", m.OperatorRequest, OPERATOR, "Requests to the helm.", None, Qos.REQUEST)
OPERATOR_CALIBRATION = Topic(
    "operator/calibration", m.CalibrationRequest, OPERATOR, "Requests to the camera's calibration.", None, Qos.REQUEST
)

OPERATOR_TUNING = Topic(
    "operator/tuning", m.TuningRequest, OPERATOR, "Law and parameters to engage.", None, Qos.REQUEST
)

ACTUATOR_COMMAND = Topic(
    "actuator/command", m.ActuatorCommand, "allocator", "Command of each actuator.", 30.0, Qos.COMMAND
)
ACTUATOR_ATTAINED = Topic(
    "actuator/attained", m.AttainedWrench, "allocator", "Wrench within the limits, before rounding.", 30.0
)
ACTUATOR_DELIVERED = Topic(
    "actuator/delivered",
    m.Wrench,
    "allocator",
    "Wrench of the commands as sent: rounded, with dead zone.",
    30.0,
)

ACTUATOR_FAULT = Topic(
    "actuator/fault", m.ActuatorFault, "estimator", "Actuators that do not give what they are commanded.", 1.0
)
ACTUATOR_HEALTH = Topic("actuator/health", m.ActuatorHealth, "allocator", "Actuators that are left out, and why.", 1.0)

LINK_STATUS = Topic("link/status", m.LinkStatus, "platform_link", "Statistics of the radio link.", 1.0)
LINK_TELEMETRY = Topic("link/telemetry", m.LinkTelemetry, "platform_link", "What the platform reports.", 30.0)

RECORDER_STATUS = Topic("recorder/status", m.RecorderStatus, "recorder", "State of the recording.", 1.0)

SIMULATION_TRUTH = Topic(
    "simulation/truth", m.SimulationTruth, "simulator", "True state of the simulated vessel.", 30.0
)
SIMULATION_FAULT = Topic("simulation/fault", m.SimulationFault, OPERATOR, "Faults to inject.", None, Qos.REQUEST)

HUB_STATISTICS = Topic(
    "hub/statistics", m.HubStatistics, "hub", "What the hub carries, by key and by source; readers' losses.", 1.0
)

HEARTBEAT = Topic("service/{name}/heartbeat", m.Heartbeat, "*", "Life sign from inside each service's loop.", 1.0)


def all_topics() -> Iterator[Topic[Any]]:
    """Yield every topic of this module, in the order of the file."""
    yield from (value for value in globals().values() if isinstance(value, Topic))


def find(key: str) -> Topic[Any] | None:
    """Return the topic of a key without its vessel prefix, a template included; None when nothing declares it."""
    return _EXACT.get(key) or next((t.of(key.split("/")[1]) for t in _TEMPLATES if _fits(t, key)), None)


def _fits(template: Topic[Any], key: str) -> bool:
    parts, names = key.split("/"), template.key.split("/")
    return len(parts) == len(names) and all(n in ("{name}", p) for p, n in zip(parts, names, strict=True))


_EXACT = {t.key: t for t in all_topics() if "{" not in t.key}
_TEMPLATES = [t for t in all_topics() if "{" in t.key]
