// Calibration of the camera's lens: where to hold the board, the views taken, the result. Everything is decided by
// the process camera_calibration; this shows its state and sends it requests.

import { fixed, h, text } from "./format.js";
import { toast } from "./toasts.js";

export const CELLS = ["upper left", "top", "upper right", "left", "middle", "right", "lower left", "bottom", "lower right"];
const TILTS = ["left", "right", "top", "bottom", "flat"];

export class Calibration {
  constructor(link, store) {
    Object.assign(this, { link, store });
    const number = (name, label, value, step, min) => h("label", {}, h("span", { class: "label" }, label),
      h("input", { name, type: "number", value, step, min, required: true }));
    const button = (action, label, title) => h("button", { type: "button", id: `calibration-${action}`, title, onclick: () => this.ask(action) }, label);
    this.form = h("form", { id: "calibration-form", class: "fault", onsubmit: (event) => this.start(event) },
      h("div", { class: "inputs" },
        h("label", {}, h("span", { class: "label" }, "board"), h("select", { name: "board" },
          h("option", { value: "charuco" }, "printed board"), h("option", { value: "chessboard" }, "chessboard"))),
        number("columns", "columns", 9, 1, 3), number("rows", "rows", 6, 1, 3), number("square_mm", "square, mm", 30, "any", 1)),
      h("button", { type: "submit", id: "calibration-start" }, "Start"));
    this.help = h("p", { class: "note" }, "Squares of the board that starboard camera print-board prints, measured on the print; of a plain chessboard its inner corners.");
    this.hint = h("p", { id: "calibration-hint", role: "status" });
    this.refused = h("p", { id: "calibration-refused", role: "alert" });
    this.cells = CELLS.map((name) => h("div", { title: `corners taken in the picture's ${name}` }, "0"));
    this.tilts = TILTS.map((name) => h("div", { "data-tilt": name, title: name === "flat" ? "views that are not tilted" : `views whose ${name} edge is nearer` }, name));
    this.automatic = h("input", { type: "checkbox", id: "calibration-automatic",
      onchange: (event) => this.send({ action: "automatic", automatic: event.target.checked }) });
    this.count = h("b", { id: "calibration-count" }, "0");
    this.buttons = Object.fromEntries([
      button("capture", "Capture", "Take the board as it is seen now"), button("undo", "Undo last view", "Forget the last view"),
      button("solve", "Solve", "Work out the lens from the views"), button("save", "Save", "Write the calibration into a file"),
      button("cancel", "Cancel", "End without saving"),
    ].map((element) => [element.id.split("-")[1], element]));
    this.result = h("p", { id: "calibration-result" });
    this.rows = h("tbody");
    this.running = h("div", { id: "calibration-running", hidden: true }, this.hint, this.refused,
      h("div", { class: "calibration-maps" }, h("div", { id: "calibration-coverage", "aria-label": "Corners taken in each part of the picture" }, ...this.cells),
        h("div", { id: "calibration-tilts", "aria-label": "Views by tilt" }, ...this.tilts),
        h("div", {}, this.count, " views", h("label", { class: "check" }, this.automatic, " automatic"))),
      h("div", { class: "calibration-buttons" }, ...Object.values(this.buttons)), this.result,
      h("table", { id: "calibration-views" }, h("thead", {}, h("tr", {}, h("th", {}, "view"), h("th", {}, "nearer edge"), h("th", {}, "error, px"))), this.rows));
    document.querySelector("#calibrate").append(this.form, this.help, this.running);
    this.shown = null;
  }

  send(request) {
    if (!this.link.send({ type: "calibration", request })) toast("No connection to the server.", { level: "error" });
  }

  ask(action) {
    this.send({ action });
  }

  start(event) {
    event.preventDefault();
    const { board, columns, rows, square_mm } = Object.fromEntries(new FormData(this.form));
    this.send({ action: "start", board, columns: Number(columns), rows: Number(rows), square_m: Number(square_mm) / 1000 });
  }

  tick() {
    const state = this.store.fresh("camera/calibration", 5);
    if (state === this.shown) return;
    this.shown = state;
    const on = state !== undefined && state.state !== "idle";
    this.form.hidden = this.help.hidden = on;
    this.running.hidden = !on;
    if (on) this.show(state);
    else text(this.help, state === undefined ? "The process camera_calibration is silent." : state.refused || this.help.textContent);
  }

  show(state) {
    text(this.hint, state.state === "saved" ? "Saved. Next: the camera's place, starboard camera place." : state.hint);
    text(this.refused, state.refused);
    const most = Math.max(...state.coverage, 1);
    this.cells.forEach((cell, i) => {
      text(cell, String(state.coverage[i] ?? 0));
      cell.style.setProperty("--share", `${Math.round((100 * (state.coverage[i] ?? 0)) / most)}%`);
      cell.dataset.state = state.parts_missing.includes(CELLS[i]) ? (state.parts_missing[0] === CELLS[i] ? "next" : "missing") : "covered";
    });
    for (const cell of this.tilts) {
      const { tilt } = cell.dataset;
      text(cell, `${tilt} ${state.views.filter((view) => view.tilt === tilt).length}`);
      cell.dataset.state = state.tilts_missing.includes(tilt) ? "missing" : "covered";
    }
    text(this.count, String(state.views.length));
    this.automatic.checked = state.automatic;
    this.buttons.undo.disabled = !state.views.length;
    this.buttons.capture.disabled = !state.corners_px.length;
    this.buttons.save.disabled = state.state !== "solved";
    text(this.buttons.cancel, state.state === "saved" ? "Done" : "Cancel");
    this.showResult(state);
    this.rows.replaceChildren(...state.views.map((view) => h("tr", {}, h("td", {}, view.name.replace(".jpg", "")), h("td", {}, view.tilt),
      h("td", { class: "num" }, fixed(view.error_px, 3)))).reverse());
  }

  showResult(state) {
    const lines = [];
    if (state.rms_px != null) lines.push(`Reprojection error ${fixed(state.rms_px, 3)} px · focal length ${fixed(state.focal_px, 1)} ± ${fixed(state.focal_std_px, 1)} px`);
    lines.push(...state.advice.map((line) => (state.rms_px != null ? `Advice: ${line}` : line)));
    if (state.file) lines.push(`File: ${state.file}`);
    text(this.result, lines.join("\n"));
  }
}
