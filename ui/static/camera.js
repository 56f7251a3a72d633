// The camera's picture with the pose that the tracker found in this very frame.

import { CELLS } from "./calibration.js";
import { age, fixed, text, DEG } from "./format.js";

/** Good, good with a reason to look, in doubt: the tracker's own limits (camera_tracker/detectors/base.py). */
const colourOf = (quality) => (quality >= 0.8 ? "#7dffb0" : quality >= 0.5 ? "#ffd166" : "#ff6b6b");

export class CameraView {
  constructor(store, system) {
    Object.assign(this, { store, system });
    this.canvas = document.querySelector("#camera");
    this.context = this.canvas.getContext("2d");
    this.note = document.querySelector("#camera-note");
    this.shownAt = -Infinity;
    this.unexamined = null; // {header, picture} that waits for the corners of a board
    this.canvas.style.aspectRatio = `${system.camera.width_px} / ${system.camera.height_px}`;
  }

  async show(header, jpeg) {
    let picture;
    try {
      picture = await createImageBitmap(jpeg);
    } catch {
      return; // not a picture: the note tells how old the last one is
    }
    if (this.unexamined) this.draw(this.unexamined); // nobody looked for the board in it
    this.unexamined = { header, picture };
    if (this.calibration()) this.showExamined();
    else this.draw(this.unexamined);
  }

  /** While the lens is calibrated a picture waits for the board's corners in it: else they would lag behind. */
  showExamined() {
    if (this.unexamined && this.calibration()?.frame === this.unexamined.header.frame) this.draw(this.unexamined);
  }

  calibration() {
    const state = this.store.fresh("camera/calibration", 5);
    return state && state.state !== "idle" ? state : null;
  }

  draw({ header, picture }) {
    this.unexamined = null;
    const { canvas, context: c } = this;
    if (canvas.width !== picture.width || canvas.height !== picture.height)
      Object.assign(canvas, { width: picture.width, height: picture.height });
    c.drawImage(picture, 0, 0);
    picture.close();
    this.shownAt = performance.now();
    const calibration = this.calibration();
    if (calibration) {
      this.drawCalibration(c, calibration, header.frame);
      return;
    }
    const pose = this.poseOf(header.frame);
    if (pose) {
      this.drawRegion(c, pose);
      this.drawPose(c, pose);
    }
  }

  /** The parts of the picture that the board has not been in, and its corners in this frame. */
  drawCalibration(c, { parts_missing, corners_px, frame }, shownFrame) {
    const { width, height } = this.canvas;
    c.save();
    for (const [i, name] of parts_missing.entries()) {
      const at = CELLS.indexOf(name);
      const box = [((at % 3) * width) / 3, (Math.floor(at / 3) * height) / 3, width / 3, height / 3];
      c.fillStyle = i ? "#ffd16618" : "#ffd16648";
      c.fillRect(...box);
      c.strokeStyle = "#ffd166";
      c.lineWidth = 1;
      c.strokeRect(...box);
    }
    if (frame === shownFrame) {
      c.strokeStyle = "#7dffb0";
      c.lineWidth = Math.max(1.5, width / 500);
      for (let i = 0; i + 1 < corners_px.length; i += 2) {
        c.beginPath();
        c.arc(corners_px[i] + 0.5, corners_px[i + 1] + 0.5, width / 160, 0, 2 * Math.PI);
        c.stroke();
      }
    }
    c.restore();
  }

  /** The pose of a frame out of the history of camera/pose; the nearest, if the page did not get that one. */
  poseOf(frame) {
    const variable = this.store.variables.get("camera/pose");
    const frames = variable?.series.get("frame");
    if (!frames) return null;
    let best = frames.length - 1;
    for (let i = best; i >= 0 && i > frames.length - 60; i--)
      if (Math.abs(frames[i] - frame) < Math.abs(frames[best] - frame)) best = i;
    if (Math.abs(frames[best] - frame) > 3) return null;
    const at = (path) => variable.series.get(path)?.[best];
    const inPicture = at("psi_image_rad"); // of a calibrated camera, which may look askew
    const psi_rad = Number.isFinite(inPicture) ? inPicture : at("psi_rad");
    const region = [0, 1, 2, 3].map((i) => at(`region_px.${i}`));
    return { x_px: at("x_px"), y_px: at("y_px"), psi_rad, quality: at("quality"), region };
  }

  /** Canvas px per px of the camera. */
  scale() {
    return this.canvas.width / (this.store.get("camera/status")?.width_px || this.system.camera.width_px);
  }

  /** Where the tracker looked; nothing when it searched the whole picture. */
  drawRegion(c, { region, quality }) {
    if (!region.every(Number.isFinite)) return;
    const k = this.scale();
    const [left, top, right, bottom] = region.map((v) => v * k);
    c.save();
    c.strokeStyle = colourOf(quality);
    c.lineWidth = 1.5 * k;
    c.setLineDash([8 * k, 6 * k]);
    c.strokeRect(left, top, right - left, bottom - top);
    c.restore();
  }

  drawPose(c, { x_px, y_px, psi_rad, quality }) {
    const k = this.scale();
    const r = 0.5 * this.system.radius_m * this.system.camera.scale_px_per_m * k;
    c.save();
    c.translate((x_px + 0.5) * k, (y_px + 0.5) * k); // pixel centres are integers
    c.rotate(psi_rad);
    c.lineWidth = 3.5 * k;
    c.strokeStyle = colourOf(quality);
    c.beginPath();
    c.moveTo(-r, 0);
    c.lineTo(2.6 * r, 0);
    c.moveTo(2.6 * r - 14 * k, -8 * k);
    c.lineTo(2.6 * r, 0);
    c.lineTo(2.6 * r - 14 * k, 8 * k);
    c.moveTo(0, -r);
    c.lineTo(0, r);
    c.stroke();
    c.restore();
  }

  tick() {
    const silentS = (performance.now() - this.shownAt) / 1000;
    this.canvas.classList.toggle("stale", silentS > 1.5);
    if (silentS > 1.5) {
      text(this.note, Number.isFinite(silentS) ? `no picture for ${age(silentS)}` : "no picture yet");
      return;
    }
    const calibration = this.calibration();
    if (calibration) {
      text(this.note, `${calibration.hint} · ${calibration.views.length} views`);
      return;
    }
    const pose = this.store.fresh("camera/pose", 1);
    const status = this.store.get("camera/status");
    const quality = pose ? `quality ${fixed(pose.quality, 2)}${pose.reason ? ` (${pose.reason})` : ""} · ${fixed(pose.psi_rad * DEG, 1)}°` : "no pose";
    text(this.note, status ? `${quality} · ${fixed(status.rate_hz, 0)} Hz · ${fixed(status.latency_s * 1000, 1)} ms` : quality);
  }
}
