// The camera's picture with the pose that the tracker found in this very frame.

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
    this.canvas.style.aspectRatio = `${system.camera.width_px} / ${system.camera.height_px}`;
  }

  async show(header, jpeg) {
    let picture;
    try {
      picture = await createImageBitmap(jpeg);
    } catch {
      return; // not a picture: the note tells how old the last one is
    }
    const { canvas, context: c } = this;
    if (canvas.width !== picture.width || canvas.height !== picture.height)
      Object.assign(canvas, { width: picture.width, height: picture.height });
    c.drawImage(picture, 0, 0);
    picture.close();
    this.shownAt = performance.now();
    const pose = this.poseOf(header.frame);
    if (pose) {
      this.drawRegion(c, pose);
      this.drawPose(c, pose);
    }
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
    const pose = this.store.fresh("camera/pose", 1);
    const status = this.store.get("camera/status");
    const quality = pose ? `quality ${fixed(pose.quality, 2)}${pose.reason ? ` (${pose.reason})` : ""} · ${fixed(pose.psi_rad * DEG, 1)}°` : "no pose";
    text(this.note, status ? `${quality} · ${fixed(status.rate_hz, 0)} Hz · ${fixed(status.latency_s * 1000, 1)} ms` : quality);
  }
}
