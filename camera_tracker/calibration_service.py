"""Calibration of the camera's lens with the page: views of a board from the tracker's pictures, then lens and file.

A process of its own: a board is found in 30 ms to 0.3 s, and the tracker's frames must not wait for that.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Literal

from bus import topics
from bus.config import Deployment
from bus.messages import CalibrationRequest, CalibrationState, CalibrationView, CameraImage
from bus.service import Input, Output, Service

if TYPE_CHECKING:  # OpenCV is imported when somebody calibrates: the process is idle for months
    from camera_tracker.calibration import Calibrated
    from camera_tracker.collecting import Collection, Look

MAX_VIEWS = 40
"""More make the result no surer, and the solution slower."""
STATUS_PERIOD_S = 1.0


@dataclass
class _Session:
    """One calibration, from its start to its end."""

    title: str
    taken: Collection
    automatic: bool
    pictures: list[bytes] = field(default_factory=list)
    """JPEG of each view, as it came: `starboard camera calibrate` gets the same result from them."""
    look: Look | None = None
    image: CameraImage | None = None
    """The picture of `look`."""
    problem: str = "waiting for a picture of the camera"
    """Why there is no look."""
    errors_px: dict[str, float] = field(default_factory=dict)
    solved: Calibrated | None = None
    advice: tuple[str, ...] = ()
    state: Literal["collecting", "solved", "saved"] = "collecting"
    file: str = ""


class CameraCalibration(Service):
    """Take views of a calibration board from the camera's pictures, solve for the lens, save it: as the page asks."""

    name = "camera_calibration"
    rate_hz = 10.0

    image = Input(topics.CAMERA_IMAGE)
    request = Input(topics.OPERATOR_CALIBRATION, queue=16, wakes=True)
    state = Output(topics.CAMERA_CALIBRATION)

    def __init__(self, deployment: Deployment) -> None:
        self._folder = deployment.recordings_dir
        self._session: _Session | None = None
        self._refused = ""
        self._told_s = 0.0

    def step(self, now_s: float) -> None:
        """Follow requests, look at the newest picture, tell."""
        news = False
        for request in self.request.take():
            self._refused = self._obey(request, now_s)
            news = True
        if self._session is not None and self.image.updated and self.image.latest is not None:
            self._examine(self._session, self.image.latest)
            news = True
        if news or now_s - self._told_s >= STATUS_PERIOD_S:
            self._told_s = now_s
            self.state.publish(self._told())

    def _obey(self, request: CalibrationRequest, now_s: float) -> str:
        """Do what is asked; return why not, one line, or an empty string."""
        session, reason = self._session, ""
        if request.action == "start":
            return self._begin(request)
        if session is None:
            return "no calibration is going on: start one"
        match request.action:
            case "automatic":
                session.automatic = request.automatic
            case "capture":
                reason = self._capture(session)
            case "undo":
                reason = self._undo(session)
            case "solve":
                reason = self._solve(session)
            case "save":
                reason = self._save(session, now_s)
            case "cancel":
                self._session = None
        return reason

    def _begin(self, request: CalibrationRequest) -> str:
        import cv2

        from camera_tracker.boards import Charuco, Chessboard
        from camera_tracker.collecting import Collection

        cv2.setNumThreads(1)
        kind = Charuco if request.board == "charuco" else Chessboard
        try:
            board = kind(request.columns, request.rows, request.square_m)
        except ValueError as error:
            return str(error)
        corners = " inner corners" if request.board == "chessboard" else ""
        title = f"{request.board} {request.columns}x{request.rows}{corners}, squares {1e3 * request.square_m:g} mm"
        self._session = _Session(title, Collection(board), request.automatic)
        return ""

    def _examine(self, session: _Session, image: CameraImage) -> None:
        """Look for the board in a picture, and take the view if that is to be done by itself."""
        import cv2
        import numpy as np

        session.image, session.look = image, None
        data = np.frombuffer(image.data, np.uint8)
        picture = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
        if picture is None:
            session.problem = "the camera's picture cannot be decoded"
            return
        try:
            name = f"board-{len(session.pictures) + 1:02}.jpg"
            session.look = look = session.taken.look(name, np.asarray(picture, np.uint8), image.stamp_ns)
        except ValueError as error:
            session.problem = f"{error}: cancel, and start again"
            return
        if session.automatic and look.still and look.adds and len(session.pictures) < MAX_VIEWS:
            self._take(session)

    def _capture(self, session: _Session) -> str:
        if session.look is None or session.look.view is None:
            return "the board is not seen" if session.look is not None else session.problem
        if session.taken.is_taken(session.look.view):
            return "the board was taken in this pose already: move or tilt it"
        if len(session.pictures) >= MAX_VIEWS:
            return f"{MAX_VIEWS} views are enough: solve"
        self._take(session)
        return ""

    def _undo(self, session: _Session) -> str:
        if not session.pictures:
            return "there is no view to take back"
        session.taken.undo()
        session.pictures.pop()
        self._judge(session)
        return ""

    def _take(self, session: _Session) -> None:
        assert session.look is not None
        assert session.look.view is not None
        assert session.image is not None
        session.taken.take(session.look.view)
        session.pictures.append(session.image.data)
        self._judge(session)

    def _judge(self, session: _Session) -> None:
        """Work out the reprojection error of each view, once there are enough; what was solved is so no more."""
        from camera_tracker.calibration import MIN_VIEWS

        session.state, session.solved, session.file = "collecting", None, ""
        session.errors_px, session.advice = {}, ()
        if len(session.pictures) >= MIN_VIEWS:
            self._try(session)

    def _try(self, session: _Session) -> Calibrated | str:
        """Return the lens of the views, or why there is none."""
        from camera_tracker.calibration import CalibrationError, calibrate

        try:
            result = calibrate(session.taken.views, session.taken.size_px)
        except CalibrationError as error:
            reason = str(error)[:400]
            session.errors_px, session.advice = error.views_px, (reason,)
            return reason
        session.errors_px = result.views_px
        return result

    def _solve(self, session: _Session) -> str:
        result = self._try(session)
        if isinstance(result, str):
            return result
        session.state, session.solved, session.automatic = "solved", result, False
        session.advice = tuple(line[:400] for line in result.advice)
        return ""

    def _save(self, session: _Session, now_s: float) -> str:
        """Write lens and pictures into a new folder beside the recordings."""
        from camera_tracker.plane import CameraFile

        if session.solved is None:
            return "nothing is solved yet"
        folder = self._folder / f"calibration-{datetime.fromtimestamp(now_s, UTC):%Y%m%d-%H%M%S}"
        file = CameraFile(lens=session.solved.lens, views_px=session.solved.views_px)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for view, picture in zip(session.taken.views, session.pictures, strict=True):
                (folder / view.name).write_bytes(picture)
            path = folder / "camera.json"
            path.write_text(file.model_dump_json(indent=1), encoding="utf-8")
        except OSError as error:
            return f"{folder}: cannot be written: {error.strerror}"
        session.state, session.file = "saved", str(path)
        return ""

    def _told(self) -> CalibrationState:
        session = self._session
        if session is None:
            return CalibrationState(refused=self._refused[:400])
        from camera_tracker.calibration import coverage

        taken, look, image = session.taken, session.look, session.image
        lens = None if session.solved is None else session.solved.lens
        view = None if look is None else look.view
        return CalibrationState(
            origin_ns=None if image is None else image.stamp_ns or None,
            state=session.state,
            board=session.title,
            automatic=session.automatic,
            frame=0 if image is None else image.frame,
            width_px=taken.size_px[0],
            height_px=taken.size_px[1],
            corners_px=() if view is None else tuple(round(v, 2) for v in view.seen_px.ravel().tolist()),
            hint=session.problem if look is None else taken.hint(look),
            refused=self._refused[:400],
            views=tuple(
                CalibrationView(name=view.name, tilt=tilt, error_px=session.errors_px.get(view.name))
                for view, tilt in zip(taken.views, taken.tilts, strict=True)
            ),
            coverage=tuple(coverage(taken.views, taken.size_px).ravel().tolist()),
            parts_missing=tuple(taken.missing_parts()),
            tilts_missing=tuple(taken.missing_tilts()),
            rms_px=None if lens is None else lens.rms_px,
            focal_px=None if lens is None else lens.fx_px,
            focal_std_px=None if lens is None else lens.covariance[0][0] ** 0.5,
            advice=session.advice,
            file=session.file,
        )
