// The device's camera, with the outlines found in the preview and the predicted precision.

import { ask, askJson } from "./api.js";
import { outlineNodes, pathOf } from "./editor.js";

const PREVIEW = 800; // longer side of the searched picture, pixels
const PAUSE = 60; // between two searches, milliseconds
const ENOUGH = 3; // number of squares that is enough
const STILL = 0.006; // maximum move of a corner between two searches, as a fraction of the width
const STEADY = 1200; // time without larger moves before a photograph is taken, milliseconds
const BEST = 0.0002, WORST = 0.05; // std over focal length or width at the ends of the bars

const REASONS = {
  NotAllowedError: "The browser does not give this page the camera. Allow it in the address bar, or choose photographs.",
  NotFoundError: "There is no camera. Choose photographs instead.",
  NotReadableError: "The camera is used by another program. Close that, or choose photographs.",
};

export class Camera {
  #stream = null;
  #last = null;
  #since = 0;

  /** `taken(blob, name)` is called with the picture, `failed(text)` with an error. */
  constructor({ section, video, svg, advice, bars, byItself }, { taken, failed }) {
    Object.assign(this, { section, video, svg, advice, bars, byItself, taken, failed });
  }

  get isOpen() { return this.#stream !== null; }

  async open() {
    if (!navigator.mediaDevices?.getUserMedia) {
      return this.failed("The browser gives the camera to pages of this machine or by https only. Choose photographs instead.");
    }
    try {
      const wanted = { facingMode: "environment", width: { ideal: 3840 }, height: { ideal: 2160 } };
      this.#stream = await navigator.mediaDevices.getUserMedia({ video: wanted, audio: false });
    } catch (error) {
      return this.failed(REASONS[error.name] ?? `The camera does not start: ${error.message}`);
    }
    this.section.hidden = false;
    this.video.srcObject = this.#stream;
    await this.video.play();
    this.#last = null;
    this.found = null; // from the last time it was open
    this.#search();
    this.#predict();
  }

  close() {
    this.#stream?.getTracks().forEach((track) => track.stop());
    this.#stream = null;
    this.video.srcObject = null;
    this.section.hidden = true;
  }

  #frame(longest) {
    const { videoWidth: width, videoHeight: height } = this.video;
    const scale = Math.min(1, longest / Math.max(width, height));
    const canvas = document.createElement("canvas");
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
    canvas.getContext("2d").drawImage(this.video, 0, 0, canvas.width, canvas.height);
    return canvas;
  }

  async #search() {
    while (this.isOpen) {
      if (this.video.videoWidth) {
        const frame = this.#frame(PREVIEW);
        const blob = await new Promise((resolve) => frame.toBlob(resolve, "image/jpeg", 0.9));
        try {
          const found = await ask("find", [["picture", blob, "preview.jpg"]], { targets: "squares" });
          // If it was reopened in the meantime, its size may not be known yet.
          if (this.isOpen && this.video.videoWidth) this.#show(found);
        } catch (error) {
          if (this.isOpen) this.#say(error.message);
        }
      }
      await new Promise((resolve) => setTimeout(resolve, PAUSE));
    }
  }

  /** Shows the squares that were found, in pixels of the picture that would be taken. */
  #show({ found, image_size: [width] }) {
    const { videoWidth, videoHeight } = this.video;
    const factor = videoWidth / width;
    const scaled = (points) => points.map(([x, y]) => [(x + 0.5) * factor - 0.5, (y + 0.5) * factor - 0.5]);
    const squares = found.map((one) => ({
      kind: one.kind,
      corners: scaled(one.corners),
      ...(one.sides && { sides: one.sides.map(scaled) }),
      ...(one.inner && { inner: scaled(one.inner) }),
    }));
    this.svg.setAttribute("viewBox", `-0.5 -0.5 ${videoWidth} ${videoHeight}`);
    this.svg.replaceChildren(...squares.flatMap((one) => outlineNodes(pathOf(one), "measured")));
    this.found = squares;
    this.#judgeSteadiness(squares, videoWidth);
  }

  #judgeSteadiness(squares, width) {
    const now = performance.now();
    const isStill = squares.length >= ENOUGH && this.#last?.length === squares.length
      && largestMove(squares, this.#last) < STILL * width;
    this.#last = squares;
    if (!isStill || !this.isDetermined) this.#since = now;
    else if (this.byItself.checked && now - this.#since > STEADY) this.take();
  }

  async #predict() {
    while (this.isOpen) {
      if (this.found && this.video.videoWidth) {
        const image_size = [this.video.videoWidth, this.video.videoHeight];
        try {
          const guidance = await askJson("predict", { image_size, outlines: this.found });
          if (this.isOpen) this.#tell(guidance, image_size[0]);
        } catch (error) {
          if (this.isOpen) this.#say(error.message);
        }
      }
      await new Promise((resolve) => setTimeout(resolve, 4 * PAUSE));
    }
  }

  #tell({ std, focal, advice }, width) {
    this.isDetermined = std !== null;
    for (const [name, full] of [["fx", focal], ["cx", width]]) {
      const { meter, text } = this.bars[name];
      meter.value = std ? goodness(std[name] / full) : 0;
      text.textContent = std ? `\u00b1 ${std[name].toPrecision(2)} px` : "not known yet";
    }
    this.#say(advice);
  }

  #say(text) {
    if (this.advice.textContent !== text) this.advice.textContent = text; // setting equal text would make screen readers read it again
  }

  async take() {
    if (!this.isOpen || !this.video.videoWidth) return;
    const frame = this.#frame(Infinity);
    this.close();
    const blob = await new Promise((resolve) => frame.toBlob(resolve, "image/png"));
    this.taken(blob, `camera-${new Date().toISOString().slice(11, 19).replaceAll(":", "")}.png`);
  }
}

function goodness(relative) {
  const share = Math.log(WORST / relative) / Math.log(WORST / BEST);
  return Math.min(Math.max(share, 0), 1);
}

/** Returns the largest distance of a corner from the nearest earlier one, pixels. */
function largestMove(squares, before) {
  const others = before.flatMap((one) => one.corners);
  const nearest = ([x, y]) => Math.min(...others.map(([a, b]) => Math.hypot(a - x, b - y)));
  return Math.max(...squares.flatMap((one) => one.corners.map(nearest)));
}
