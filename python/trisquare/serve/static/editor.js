// The photograph with its outlines, which can be moved by pointer, finger and keys.

import { isByCorners } from "./outlines.js";

const SVG = "http://www.w3.org/2000/svg";
const GRIP = 22; // radius that a finger hits, screen pixels
const DOT = 7;
const MAGNIFIED = 33; // width of the magnifier in pixels of the shown picture
const SETTLED = 700; // time from the last key to the measurement of the edges, milliseconds
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export function element(name, attributes, ...children) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}

export function pathOf({ corners, sides }) {
  const points = sides ? sides.flat() : corners;
  return `M${points.map(([x, y]) => `${x},${y}`).join("L")}Z`;
}

/** Returns the nodes of a line that is visible on any background. */
export function outlineNodes(d, state) {
  return ["under", state].map((kind) => element("path", { d, class: `outline ${kind}` }));
}

export class Editor {
  #picture = null;
  #drawn = null; // corners of the square that is being drawn
  #held = null;
  #timer = 0;
  #moved = null;
  #isRendering = false; // while true, corners lose the focus and get it back

  /** `changed(square)` is called after a square was moved or drawn, with null after other changes. */
  constructor(stage, { changed }) {
    this.stage = stage;
    [this.canvas, this.svg, this.magnifier] = stage.children;
    this.changed = changed;
    this.svg.addEventListener("pointerdown", (event) => this.#press(event));
    this.svg.addEventListener("pointermove", (event) => this.#move(event));
    this.svg.addEventListener("pointerup", (event) => this.#release(event));
    this.svg.addEventListener("pointercancel", (event) => this.#release(event));
    this.svg.addEventListener("keydown", (event) => this.#key(event));
    this.svg.addEventListener("focusout", () => this.#isRendering || this.#settle());
    new ResizeObserver(() => this.render()).observe(stage);
  }

  /** Shows a photograph: {bitmap, size, outlines}. */
  show(picture) {
    this.#settle();
    this.#picture = picture;
    this.#drawn = null;
    this.stage.classList.remove("drawing");
    const { bitmap, size: [width, height] } = picture;
    Object.assign(this.canvas, { width: bitmap.width, height: bitmap.height });
    this.canvas.getContext("2d").drawImage(bitmap, 0, 0);
    // The centre of the first pixel is (0, 0).
    this.svg.setAttribute("viewBox", `-0.5 -0.5 ${width} ${height}`);
    this.render();
  }

  get isDrawing() { return this.#drawn !== null; }

  /** Starts or stops drawing a square by its corners. */
  draw(on) {
    this.#drawn = on ? [] : null;
    this.stage.classList.toggle("drawing", on);
    this.render();
  }

  /** Number of pixels of the photograph per screen pixel. */
  get #unit() {
    return this.#picture.size[0] / Math.max(this.svg.getBoundingClientRect().width, 1);
  }

  #at(event) {
    const box = this.svg.getBoundingClientRect();
    const [width, height] = this.#picture.size;
    const x = ((event.clientX - box.left) / box.width) * width - 0.5;
    const y = ((event.clientY - box.top) / box.height) * height - 0.5;
    return this.#inside([x, y]);
  }

  #inside([x, y]) {
    const [width, height] = this.#picture.size;
    const within = (value, most) => Math.round(100 * Math.min(Math.max(value, 0), most)) / 100;
    return [within(x, width - 1), within(y, height - 1)];
  }

  render() {
    if (!this.#picture) return;
    const focused = document.activeElement?.dataset?.corner;
    const unit = this.#unit;
    const nodes = [];
    this.#picture.outlines.squares.forEach((square, index) => {
      const state = square.isUsed ? square.state : "unused";
      nodes.push(...outlineNodes(pathOf(square), state));
      if (square.inner) nodes.push(...outlineNodes(pathOf({ corners: square.inner }), state));
      const [x, y] = middle(square.corners);
      const label = element("text", { x, y: y + 7 * unit, "font-size": 20 * unit });
      label.textContent = index + 1;
      nodes.push(label);
      if (!isByCorners(square)) return;
      square.corners.forEach((point, corner) => nodes.push(this.#handle(square, index, corner, point)));
    });
    if (this.#drawn?.length) {
      nodes.push(...outlineNodes(pathOf({ corners: this.#drawn }), "drawn"));
      nodes.push(...this.#drawn.map(([cx, cy]) => element("circle", { cx, cy, r: 5 * unit, fill: "#ffd23e" })));
    }
    this.#isRendering = true;
    this.svg.replaceChildren(...nodes);
    if (focused) this.svg.querySelector(`[data-corner="${focused}"]`)?.focus({ preventScroll: true });
    this.#isRendering = false;
  }

  #handle(square, index, corner, [cx, cy]) {
    const unit = this.#unit;
    const name = `Square ${index + 1}, corner ${corner + 1}: ${Math.round(cx)}, ${Math.round(cy)}`;
    const attributes = {
      class: "corner", tabindex: 0, role: "button", "aria-label": name,
      "aria-roledescription": "corner", "data-corner": `${square.id}-${corner}`,
    };
    return element(
      "g", attributes,
      element("circle", { cx, cy, r: GRIP * unit, class: "grip" }),
      element("circle", { cx, cy, r: DOT * unit, class: "dot" }),
    );
  }

  #cornerOf(node) {
    const named = node?.closest?.("[data-corner]")?.dataset.corner;
    if (!named) return null;
    const [id, corner] = named.split("-").map(Number);
    const square = this.#picture.outlines.byId(id);
    return square ? { square, corner } : null;
  }

  #press(event) {
    if (event.button !== 0 || !this.#picture) return;
    const point = this.#at(event);
    if (this.#drawn) {
      event.preventDefault();
      this.#drawn.push(point);
      if (this.#drawn.length === 4) this.#complete();
      this.render();
      return;
    }
    const held = this.#cornerOf(this.#nearestHandle(event));
    if (!held) return;
    event.preventDefault();
    this.svg.setPointerCapture(event.pointerId);
    this.svg.querySelector(`[data-corner="${held.square.id}-${held.corner}"]`).focus();
    const [x, y] = held.square.corners[held.corner];
    this.#held = { ...held, offset: [x - point[0], y - point[1]], isMoved: false };
    this.#magnify([x, y]);
  }

  /** Returns the nearest corner, if several grips overlap. */
  #nearestHandle(event) {
    const under = document.elementsFromPoint(event.clientX, event.clientY)
      .filter((node) => node.classList?.contains("grip"));
    const distance = (node) => {
      const box = node.getBoundingClientRect();
      return Math.hypot(box.x + box.width / 2 - event.clientX, box.y + box.height / 2 - event.clientY);
    };
    return under.sort((a, b) => distance(a) - distance(b))[0];
  }

  #move(event) {
    if (this.#drawn) this.#magnify(this.#at(event));
    if (!this.#held) return;
    const [x, y] = this.#at(event);
    const { square, corner, offset } = this.#held;
    if (!this.#held.isMoved) this.#picture.outlines.remember();
    this.#held.isMoved = true;
    this.#place(square, corner, [x + offset[0], y + offset[1]]);
  }

  #place(square, corner, point) {
    square.corners[corner] = this.#inside(point);
    Object.assign(square, { sides: null, state: "drawn", reason: "" });
    this.render();
    this.#magnify(square.corners[corner]);
  }

  #release() {
    const held = this.#held;
    this.#held = null;
    if (!this.#drawn) this.magnifier.hidden = true;
    if (held?.isMoved) this.changed(held.square);
  }

  #key(event) {
    if (this.#drawn && event.key === "Escape") return this.changed(null);
    const at = this.#cornerOf(event.target);
    if (!at) return;
    const { square, corner } = at;
    const { outlines } = this.#picture;
    if (event.key in STEPS) {
      event.preventDefault();
      if (this.#moved !== square) outlines.remember();
      this.#moved = square;
      const step = event.shiftKey ? 10 : 1;
      const [dx, dy] = STEPS[event.key];
      const [x, y] = square.corners[corner];
      this.#place(square, corner, [x + step * dx, y + step * dy]);
      clearTimeout(this.#timer);
      this.#timer = setTimeout(() => this.#settle(), SETTLED);
    } else if (event.key === "Delete" || event.key === "Backspace") {
      event.preventDefault();
      this.remove(square);
    }
  }

  /** Measures the square that keys have moved. */
  #settle() {
    clearTimeout(this.#timer);
    const square = this.#moved;
    this.#moved = null;
    if (!this.#held && !this.#drawn) this.magnifier.hidden = true;
    if (square) this.changed(square);
  }

  remove(square) {
    const { outlines } = this.#picture;
    outlines.remember();
    if (this.#moved === square) this.#moved = null;
    outlines.squares = outlines.squares.filter((one) => one !== square);
    this.render();
    this.changed(null);
  }

  /** Adds a square in the middle, to be moved by keys. */
  add(square) {
    const { outlines } = this.#picture;
    outlines.remember();
    outlines.squares.push(square);
    this.render();
    this.svg.querySelector(`[data-corner="${square.id}-0"]`).focus();
  }

  #complete() {
    const corners = inOrder(this.#drawn);
    this.#drawn = null;
    this.stage.classList.remove("drawing");
    this.magnifier.hidden = true;
    this.onDrawn(corners);
  }

  #magnify([x, y]) {
    const { bitmap, size } = this.#picture;
    const scale = bitmap.width / size[0];
    const side = this.magnifier.width;
    const context = this.magnifier.getContext("2d");
    context.imageSmoothingEnabled = false;
    context.fillRect(0, 0, side, side);
    const half = MAGNIFIED / 2;
    context.drawImage(
      bitmap, (x + 0.5) * scale - half, (y + 0.5) * scale - half, MAGNIFIED, MAGNIFIED, 0, 0, side, side,
    );
    context.strokeStyle = "#ffd23e";
    context.beginPath();
    context.moveTo(side / 2, 0); context.lineTo(side / 2, side);
    context.moveTo(0, side / 2); context.lineTo(side, side / 2);
    context.stroke();
    const box = this.svg.getBoundingClientRect();
    const left = (x / size[0]) * box.width, top = (y / size[1]) * box.height;
    // Beside the finger, on the side with enough room.
    const away = (value, most) => (value > side + 40 ? value - side - 30 : Math.min(value + 40, most - side));
    this.magnifier.style.left = `${Math.max(away(left, box.width), 0)}px`;
    this.magnifier.style.top = `${Math.max(away(top, box.height), 0)}px`;
    this.magnifier.hidden = false;
  }
}

export function middle(corners) {
  return [0, 1].map((axis) => corners.reduce((sum, point) => sum + point[axis], 0) / corners.length);
}

/** Returns four points in clockwise order on the screen, whatever the order of the clicks. */
function inOrder(points) {
  const [x, y] = middle(points);
  return points.toSorted((a, b) => Math.atan2(a[1] - y, a[0] - x) - Math.atan2(b[1] - y, b[0] - x));
}
